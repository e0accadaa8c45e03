// SPDX-License-Identifier: Apache-2.0
#include "base/shared_object.h"

#include <dlfcn.h>

#include <filesystem>
#include <string>
#include <system_error>

namespace gobo {
inline namespace base {
namespace {

void* openObject(const char* name) {
  // By the program's place, not by its search path: a sanitizer's dlopen asks its own.
  std::error_code error;
  const auto folder = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  for (const char* place : {".", "../renderer", "../lib/gobo"}) {
    const auto file = folder / place / name;
    if (std::filesystem::exists(file, error)) return ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  }
  return ::dlopen(name, RTLD_NOW | RTLD_LOCAL);
}

}  // namespace

Result<const void*> sharedSymbol(const char* name, const char* symbol, const char* what) {
  void* const object = openObject(name);
  const void* const found = object ? ::dlsym(object, symbol) : nullptr;
  if (!found) return internalError(std::string(what) + " cannot be loaded: " + ::dlerror());
  return found;
}

}  // namespace base
}  // namespace gobo
