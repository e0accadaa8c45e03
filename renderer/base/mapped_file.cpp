// SPDX-License-Identifier: Apache-2.0
#include "base/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>

#include "base/mapped_faults.h"

namespace gobo {
inline namespace base {

Result<std::shared_ptr<const MappedFile>> MappedFile::open(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0)
    return Status(errno == ENOENT   ? Code::NotFound
                  : errno == EACCES ? Code::PermissionDenied
                                    : Code::Unavailable,
                  std::string("cannot open file: ") + std::strerror(errno), path);
  auto mapped = map(fd, path);
  ::close(fd);
  return mapped;
}

Result<std::shared_ptr<const MappedFile>> MappedFile::map(int fd, const std::string& name) {
  struct stat info {};
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) return invalidArgument("not a regular file", name);
  if (info.st_size <= 0) return invalidArgument("file is empty", name);
  void* p = ::mmap(nullptr, size_t(info.st_size), PROT_READ, MAP_SHARED, fd, 0);
  if (p == MAP_FAILED) return Status(Code::ResourceExhausted, std::string("cannot map file: ") + std::strerror(errno), name);
  std::shared_ptr<const MappedFile> mapped(new MappedFile(static_cast<const uint8_t*>(p), info, name));
  if (!mapped->intact()) return mapped->lost();
  return mapped;
}

MappedFile::MappedFile(const uint8_t* data, const struct stat& info, std::string name)
    : data_(data),
      size_(size_t(info.st_size)),
      name_(std::move(name)),
      device_(uint64_t(info.st_dev)),
      inode_(uint64_t(info.st_ino)),
      range_(watchMapped(data, size_)) {
  static std::atomic<uint64_t> made{0};
  id_ = ++made;
  tail_ = tail();
}

MappedFile::~MappedFile() {
  unwatchMapped(range_);
  ::munmap(const_cast<uint8_t*>(data_), size_);
}

Hash128 MappedFile::tail() const {
  const size_t page = size_t(::sysconf(_SC_PAGESIZE)), begin = (size_ - 1) / page * page;
  return hashBytes(data_ + begin, size_ - begin);
}

bool MappedFile::intact() const {
  if (!range_->broken.load() && tail() != tail_) range_->broken.store(true);
  return !range_->broken.load();
}

bool MappedFile::isOf(const struct stat& info) const { return device_ == uint64_t(info.st_dev) && inode_ == uint64_t(info.st_ino); }

Status MappedFile::lost() const { return {Code::DataLoss, "mapped file was cut short, or the disk cannot read it", name_}; }

}  // namespace base
}  // namespace gobo
