// SPDX-License-Identifier: Apache-2.0
#include "base/image_codec.h"

#include <dlfcn.h>

#include <filesystem>
#include <system_error>

namespace gobo {
namespace {

constexpr const char* kName = "libgobo_image_codec.so";

void* open() {
  // By the program's place (beside it, in the build folder, installed), not by its search path: a sanitizer's dlopen asks its own.
  std::error_code error;
  const auto folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  for (const char* place : {".", "../renderer", "../lib/gobo"}) {
    const auto file = folder / place / kName;
    if (std::filesystem::exists(file, error)) return ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  }
  return ::dlopen(kName, RTLD_NOW | RTLD_LOCAL);
}

Result<const ImageCodec*> load() {
  void* const object = open();
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
