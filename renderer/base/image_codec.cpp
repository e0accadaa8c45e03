// SPDX-License-Identifier: Apache-2.0
#include "base/image_codec.h"

#include "base/shared_object.h"

namespace gobo {
inline namespace base {

Result<const ImageCodec*> imageCodec() {
  static const Result<const ImageCodec*> codec = []() -> Result<const ImageCodec*> {
    GOBO_ASSIGN(const void* const symbol, sharedSymbol("libgobo_image_codec.so", "gobo_image_codec", "the picture formats"));
    return static_cast<const ImageCodec*>(symbol);
  }();
  return codec;
}

}  // namespace base
}  // namespace gobo
