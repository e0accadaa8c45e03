// SPDX-License-Identifier: Apache-2.0
// Displays and views of an OpenColorIO config for pictures that are looked at: request.encoding.display, view and look in place of tone_map.curve and
// encoding.transfer (docs/color.md). The config is of whoever runs the renderer; requests name what it has. Thread-safe.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <tuple>

#include "base/color_config.h"
#include "base/image.h"
#include "base/status.h"
#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace plan {

class DisplayTransforms {
 public:
  struct Options {
    std::string file;                                  ///< of the config; empty: there is none, and requests that want one are refused
    std::string workingSpace;                          ///< that takes linear Rec. 709; empty: found (base/color_config.h)
    std::function<void(const std::string& line)> say;  ///< told once what the config leaves open; may be empty
  };
  explicit DisplayTransforms(Options options);

  /// Reads the config now, if there is one; otherwise the first request that wants it does. Errors: those of openColorConfig, at every call.
  Status load();
  /// Makes what each view of each display is made of, and forgets it. Errors: as load(); the first that cannot be made.
  Status check();

  /// Of a request whose defaults are filled in: whether it is shown by a view, and by which. Then display, view and ocio_hash are filled in, and tone_map.curve
  /// and encoding.transfer, which nothing reads, are cleared; otherwise ocio_hash is. `asked`: the request before defaults. Errors: InvalidArgument at the
  /// field that is not of the config, says nothing (look alone, EXR) or stands in another's place; FailedPrecondition without a config, of a broken one or of
  /// another hash.
  Status resolve(v1::RenderRequest& resolved, const v1::RenderRequest& asked);
  /// What a resolved encoding names; null: no view. Errors: FailedPrecondition without a config or of one with another hash.
  Result<std::shared_ptr<const ColorProcessor>> processor(const v1::Encoding& resolved);

 private:
  Result<std::shared_ptr<const ColorConfig>> config();

  static constexpr size_t kKept = 64;  // processors; beyond it all go
  const Options options_;
  std::mutex mutex_;
  std::optional<Result<std::shared_ptr<const ColorConfig>>> config_;
  std::map<std::tuple<std::string, std::string, std::string>, std::shared_ptr<const ColorProcessor>> processors_;
};

/// Whether an encoding asks for a view of a display.
bool throughView(const v1::Encoding& encoding);
/// `base`, changed by a relight whose mask is `mask`: where it names a view the curve and the transfer function that the base has from before go, and the other
/// way round. What the mask itself names stays, so that a request that names both is refused as it would be without a base.
void replaceView(v1::RenderRequest& base, const google::protobuf::RepeatedPtrField<std::string>& mask);

/// A picture as code values, 0..1: scene-linear radiance (1, 3 or 4 channels) times 2^exposure, through the view; three channels, or four with straight alpha
/// as toneMapped() has it. `onBlack`: three channels whatever the alpha, of the light before black. Values enter within +-65504, NaN as 0; what the view makes
/// of them is clamped, NaN to 0. Errors: the processor's.
Result<Image> shownByView(const Image& linear, double exposure, const ColorProcessor& processor, bool onBlack);

}  // namespace plan
}  // namespace gobo
