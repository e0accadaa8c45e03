// SPDX-License-Identifier: Apache-2.0
// OpenColorIO configs, read by a shared object of their own (renderer/color) that is loaded with the first config: the library takes longer to link than the
// daemon takes to start, and most daemons have no config. docs/color.md says what users see of it. Source: opencolorio.org, version 2.1. Values are immutable
// once made; any thread.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo {
inline namespace base {

/// Scene-linear Rec. 709 (D65) to what one view of one display shows, after a look.
class ColorProcessor {
 public:
  virtual ~ColorProcessor() = default;
  /// `rgb`: 3 * pixels finite floats, in place; out come code values, 0..1 for what the display can show, and whatever the config makes of the rest, NaN too.
  /// The result of a pixel does not depend on its neighbours, nor on threads. Cost: some 15 ns a pixel and operator on one core, 60 ns for each power of three
  /// channels. InvalidArgument with the library's words if it throws.
  virtual Status apply(float* rgb, size_t pixels) const = 0;
};

/// A config that has been read and is valid.
class ColorConfig {
 public:
  struct Display {
    std::string name;
    std::vector<std::string> views;     ///< active ones, in the config's order: the first is the default
    std::vector<std::string> inactive;  ///< in the file, but not in active_views
  };
  virtual ~ColorConfig() = default;
  const std::string& file() const { return file_; }
  /// 32 hex digits: of the file's bytes, of the files that its transforms name and of the variables that it uses, as they were when it was read. Equal on every
  /// machine that has the same files, wherever they are.
  const std::string& hash() const { return hash_; }
  const std::vector<Display>& displays() const { return displays_; }  ///< active ones; the first is the default. Not empty
  const std::vector<std::string>& looks() const { return looks_; }
  const std::string& workingSpace() const { return workingSpace_; }  ///< the colour space that takes a picture's linear Rec. 709
  const std::string& caution() const { return caution_; }            ///< one sentence if the config does not say what linear Rec. 709 is; else empty
  /// Names are those of displays(), views and looks(); an empty look is none. Cost: the files of the view are read. Errors: InvalidArgument with the library's
  /// words (a file that is missing or broken); FailedPrecondition if files have changed since the hash was made.
  virtual Result<std::shared_ptr<const ColorProcessor>> processor(const std::string& display, const std::string& view, const std::string& look) const = 0;

 protected:
  std::string file_, hash_, workingSpace_, caution_;
  std::vector<Display> displays_;
  std::vector<std::string> looks_;
};

/// What the shared object exports as `gobo_color`.
struct ColorModule {
  /// `workingSpace`: a colour space, role or alias of the config; empty: found (docs/color.md, "What goes in"). Errors: NotFound, InvalidArgument with the
  /// library's words, FailedPrecondition if nothing of the config stands for linear Rec. 709.
  Result<std::shared_ptr<const ColorConfig>> (*open)(const std::string& file, const std::string& workingSpace);
};

/// Reads the file `file` (an absolute or relative path). Errors: those of ColorModule::open, Internal if the library cannot be loaded.
Result<std::shared_ptr<const ColorConfig>> openColorConfig(const std::string& file, const std::string& workingSpace);

}  // namespace base
}  // namespace gobo
