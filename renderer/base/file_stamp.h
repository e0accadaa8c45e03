// SPDX-License-Identifier: Apache-2.0
// FileStamp: what stat says about a file's identity and last change, to know again without reading it that a file is the one
// seen before. ctime counts beside mtime: a program can set back mtime, not ctime. A stamp taken too soon after a change says
// nothing (a second change in the same clock tick leaves it as it is): trust it only if settled().
#pragma once

#include <sys/stat.h>
#include <time.h>

#include <compare>
#include <cstdint>
#include <string>

namespace gobo {
inline namespace base {

struct FileStamp {
  uint64_t device = 0, inode = 0, size = 0;
  int64_t modifiedNs = 0, changedNs = 0;
  auto operator<=>(const FileStamp&) const = default;

  static FileStamp of(const struct stat& s) {
    return {uint64_t(s.st_dev), uint64_t(s.st_ino), uint64_t(s.st_size), s.st_mtim.tv_sec * 1000000000ll + s.st_mtim.tv_nsec,
            s.st_ctim.tv_sec * 1000000000ll + s.st_ctim.tv_nsec};
  }
  /// Zero (inode 0) when the file cannot be examined.
  static FileStamp of(const std::string& path) {
    struct stat s {};
    return ::stat(path.c_str(), &s) == 0 ? of(s) : FileStamp{};
  }
  /// The last change lies at least two seconds back.
  bool settled() const {
    timespec now{};
    ::clock_gettime(CLOCK_REALTIME, &now);
    const int64_t limit = (now.tv_sec - 2) * 1000000000ll + now.tv_nsec;
    return inode != 0 && modifiedNs < limit && changedNs < limit;
  }
  std::string text() const {
    return std::to_string(device) + ":" + std::to_string(inode) + ":" + std::to_string(size) + ":" + std::to_string(modifiedNs) + ":" +
           std::to_string(changedNs);
  }
};

}  // namespace base
}  // namespace gobo
