// SPDX-License-Identifier: Apache-2.0
#include "base/mapped_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace gobo {

Result<std::shared_ptr<const MappedFile>> MappedFile::open(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return Status(errno == ENOENT ? Code::NotFound : errno == EACCES ? Code::PermissionDenied : Code::Unavailable, std::string("cannot open file: ") + std::strerror(errno), path);
  auto mapped = map(fd, path);
  ::close(fd);
  return mapped;
}

Result<std::shared_ptr<const MappedFile>> MappedFile::map(int fd, const std::string& name) {
  struct stat info{};
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) return invalidArgument("not a regular file", name);
  if (info.st_size <= 0) return invalidArgument("file is empty", name);
  void* p = ::mmap(nullptr, size_t(info.st_size), PROT_READ, MAP_SHARED, fd, 0);
  if (p == MAP_FAILED) return Status(Code::ResourceExhausted, std::string("cannot map file: ") + std::strerror(errno), name);
  return std::shared_ptr<const MappedFile>(new MappedFile(static_cast<const uint8_t*>(p), size_t(info.st_size)));
}

MappedFile::~MappedFile() { ::munmap(const_cast<uint8_t*>(data_), size_); }

}  // namespace gobo
