// SPDX-License-Identifier: Apache-2.0
// Reading the picture formats of OpenImageIO, in a shared object of their own (renderer/codec) that is loaded with the first picture that needs
// them: OpenImageIO brings 230 libraries along (GDAL, FFmpeg, OpenCV), 0.4 s of processor at each start of a program that may read no PNG.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "base/image.h"
#include "base/status.h"

namespace gobo {
inline namespace base {

struct ReadLimits;

/// What the shared object exports as `gobo_image_codec`. Thread-safe. It has no state of this program: the check of sizes is handed in.
struct ImageCodec {
  using SizeCheck = Status (*)(int64_t width, int64_t height, int64_t channels, size_t fileBytes, const ReadLimits& limits);
  /// `format` as an extension. Errors: InvalidArgument, Unimplemented, Cancelled, those of `check`; may throw what the library throws.
  Result<Image> (*decode)(const uint8_t* bytes, size_t size, const std::string& format, const std::string& name, const ReadLimits& limits, SizeCheck check);
  void (*useOneThread)();  ///< from now on, of the whole process
};

/// Loads it at the first call. Internal when it cannot be loaded: why.
Result<const ImageCodec*> imageCodec();

}  // namespace base
}  // namespace gobo
