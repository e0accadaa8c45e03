// SPDX-License-Identifier: Apache-2.0
// MappedFile: a whole file mapped read-only. Whoever holds the pointer may read the bytes; a file that is shortened while it
// is mapped kills the reader (SIGBUS), so only files that nobody else writes may be mapped: the daemon's own cache folder,
// or a memfd whose writer is gone. Any thread may read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "base/status.h"

namespace gobo {

class MappedFile {
 public:
  /// Errors: NotFound, PermissionDenied, InvalidArgument (not a regular file or empty), ResourceExhausted.
  static Result<std::shared_ptr<const MappedFile>> open(const std::string& path);
  /// Of an open descriptor, which stays the caller's; `name` is used in errors.
  static Result<std::shared_ptr<const MappedFile>> map(int fd, const std::string& name);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  std::span<const uint8_t> bytes() const { return {data_, size_}; }

 private:
  MappedFile(const uint8_t* data, size_t size) : data_(data), size_(size) {}
  const uint8_t* data_;
  size_t size_;
};

}  // namespace gobo
