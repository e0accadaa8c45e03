// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include "base/image_io.h"

namespace gobo {
inline namespace base {
namespace {

Code codeOf(int error) {
  switch (error) {
    case ENOENT:
    case ENOTDIR: return Code::NotFound;
    case EISDIR:
    case ENAMETOOLONG:
    case ELOOP: return Code::InvalidArgument;
    case EACCES:
    case EPERM:
    case EROFS: return Code::PermissionDenied;
    case ENOSPC:
    case EFBIG:
    case EDQUOT:
    case EMFILE:
    case ENFILE: return Code::ResourceExhausted;
    default: return Code::Unavailable;
  }
}

}  // namespace

Status ioError(const std::string& what, const std::string& path) { return Status(codeOf(errno), what + ": " + std::strerror(errno), path); }

Status writeFileAtomic(const std::string& path, const void* data, size_t size) {
  static std::atomic<uint64_t> counter{0};
  const std::string temporary = path + ".tmp-" + std::to_string(getpid()) + "-" + std::to_string(counter++);
  const int fd = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (fd < 0) return ioError("cannot create file", path);
  Status status;
  const char* p = static_cast<const char*>(data);
  for (size_t done = 0; done < size && status.ok();) {
    const ssize_t n = ::write(fd, p + done, size - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) status = ioError("cannot write file", path);
    else done += size_t(n);
  }
  if (status.ok() && ::fsync(fd) != 0) status = ioError("cannot flush file", path);
  if (::close(fd) != 0 && status.ok()) status = ioError("cannot close file", path);
  if (status.ok() && ::rename(temporary.c_str(), path.c_str()) != 0) status = ioError("cannot rename file into place", path);
  if (!status.ok()) ::unlink(temporary.c_str());
  return status;
}

Result<int> regularOrClose(int fd, const std::string& name) {
  struct stat info {};
  if (::fstat(fd, &info) == 0 && S_ISREG(info.st_mode)) return fd;
  ::close(fd);
  return invalidArgument("not a regular file", name);
}

Result<int> openRegular(const std::string& path) {
  // O_NONBLOCK: a FIFO in place of a file must not hang the reader before fstat refuses it.
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return ioError("cannot open file", path);
  return regularOrClose(fd, path);
}

Result<std::vector<uint8_t>> readAndClose(int fd, const std::string& name, uint64_t maxBytes, const StopToken& stop) {
  struct stat info {};
  Status status;
  std::vector<uint8_t> bytes;
  if (::fstat(fd, &info) != 0) status = ioError("cannot stat file", name);
  else if (uint64_t(info.st_size) > maxBytes)
    status = Status(Code::ResourceExhausted, "file of " + std::to_string(info.st_size) + " bytes is above the limit of " + std::to_string(maxBytes), name);
  if (status.ok()) {
    constexpr size_t piece = size_t(4) << 20;  // between two polls; memory is cleared piece by piece too
    const size_t size = size_t(info.st_size);
    bytes.reserve(size);
    size_t done = 0;
    while (done < size) {
      if (stop.stopRequested()) {
        status = Status(Code::Cancelled, "the reading was cancelled", name);
        break;
      }
      bytes.resize(std::min(size, done + piece));
      const ssize_t n = ::read(fd, bytes.data() + done, bytes.size() - done);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) {
        status = ioError("cannot read file", name);
        break;
      }
      if (n == 0) break;  // shortened while being read
      done += size_t(n);
    }
    bytes.resize(done);
  }
  ::close(fd);
  if (!status.ok()) return status;
  return bytes;
}

Result<std::vector<uint8_t>> readFile(const std::string& path, uint64_t maxBytes, const StopToken& stop) {
  GOBO_ASSIGN(const int fd, openRegular(path));
  return readAndClose(fd, path, maxBytes, stop);
}

}  // namespace base
}  // namespace gobo
