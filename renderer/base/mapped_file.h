// SPDX-License-Identifier: Apache-2.0
// MappedFile: a whole file mapped read-only. Whoever holds the pointer may read the bytes. A file that is cut short, or a disk that cannot
// read it, raises SIGBUS in whoever touches the page; mapped_faults.h then puts zeroes over the mapping, and intact() is false from there
// on: whoever has worked with the bytes asks for it before anything made of them is kept or leaves. Any thread may read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "base/hash.h"
#include "base/status.h"

struct stat;

namespace gobo {
inline namespace base {

class MappedFile {
 public:
  /// Errors: NotFound, PermissionDenied, InvalidArgument (not a regular file or empty), ResourceExhausted, DataLoss (cut short meanwhile).
  static Result<std::shared_ptr<const MappedFile>> open(const std::string& path);
  /// Of an open descriptor, which stays the caller's; `name` is used in errors.
  static Result<std::shared_ptr<const MappedFile>> map(int fd, const std::string& name);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  std::span<const uint8_t> bytes() const { return {data_, size_}; }
  const std::string& name() const { return name_; }
  /// Of no other mapping of this process, ever.
  uint64_t id() const { return id_; }
  /// That what was read so far is what the file held. False: some of it may have been zeroes. Once false it stays so.
  /// Costs a look at the last page: the kernel shows zeroes, and raises no signal, between a file's new end and the end of that page.
  bool intact() const;
  /// Whether `info` is of the very file that is mapped, whatever it is called now.
  bool isOf(const struct stat& info) const;
  /// DataLoss that names the file.
  Status lost() const;

 private:
  MappedFile(const uint8_t* data, const struct stat& info, std::string name);
  Hash128 tail() const;
  const uint8_t* data_;
  size_t size_;
  std::string name_;
  uint64_t id_, device_, inode_;
  struct MappedRange* range_;  // in the table of mapped_faults.h
  Hash128 tail_;               // of the last page as it was when it was mapped
};

}  // namespace base
}  // namespace gobo
