// SPDX-License-Identifier: Apache-2.0
#include "base/image_codec.h"

#include <dlfcn.h>

namespace gobo {
namespace {

Result<const ImageCodec*> load() {
  // Found by the program's own search path (cmake/gobo.cmake): beside it, in the build folder, or in lib/gobo.
  void* const object = ::dlopen("libgobo_image_codec.so", RTLD_NOW | RTLD_LOCAL);
  if (!object) return internalError(std::string("the picture formats cannot be loaded: ") + ::dlerror());
  const auto* const codec = static_cast<const ImageCodec*>(::dlsym(object, "gobo_image_codec"));
  if (!codec) return internalError(std::string("the picture formats cannot be loaded: ") + ::dlerror());
  return codec;
}

}  // namespace

Result<const ImageCodec*> imageCodec() {
  static const Result<const ImageCodec*> codec = load();
  return codec;
}

}  // namespace gobo
