// SPDX-License-Identifier: Apache-2.0
#include "server/unix_socket.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>
#include <utility>

namespace gobo {
inline namespace server {

Result<SocketLock> SocketLock::take(const std::string& socketPath, std::chrono::milliseconds patience) {
  const std::string path = socketPath + ".lock";
  const auto until = std::chrono::steady_clock::now() + patience;
  for (int attempt = 0; attempt < 2000; ++attempt) {
    const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (fd < 0) return Status(Code::Unavailable, "cannot open \"" + path + "\": " + std::strerror(errno));
    SocketLock lock(path, fd);
    if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
      lock.path_.clear();  // another's: not to be removed
      if (errno == EWOULDBLOCK) {
        if (std::chrono::steady_clock::now() > until) return Status(Code::Unavailable, "another server holds \"" + socketPath + "\"");
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
        continue;
      }
      return Status(Code::Unavailable, "cannot lock \"" + path + "\": " + std::strerror(errno));
    }
    // The holder before may have removed the file between our open and our lock: then this lock is on a file without a name.
    struct stat mine {
    }, named{};
    if (::fstat(fd, &mine) == 0 && ::stat(path.c_str(), &named) == 0 && mine.st_ino == named.st_ino && mine.st_dev == named.st_dev) return lock;
    lock.path_.clear();
  }
  return Status(Code::Unavailable, "cannot lock \"" + path + "\": it is removed again and again");
}

SocketLock::SocketLock(SocketLock&& other) noexcept : path_(std::exchange(other.path_, {})), fd_(std::exchange(other.fd_, -1)) {}

SocketLock& SocketLock::operator=(SocketLock&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(fd_, other.fd_);
  return *this;
}

SocketLock::~SocketLock() {
  if (fd_ < 0) return;
  if (!path_.empty()) ::unlink(path_.c_str());
  ::close(fd_);
}

Status claimSocketPath(const std::string& path) {
  struct stat info {};
  if (::lstat(path.c_str(), &info) != 0) {
    if (errno == ENOENT) return {};
    return {Code::Unavailable, "cannot use socket \"" + path + "\": " + std::strerror(errno)};
  }
  if (!S_ISSOCK(info.st_mode)) return {Code::Unavailable, "\"" + path + "\" exists and is not a socket"};
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return internalError(std::string("socket: ") + std::strerror(errno));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
  const int connected = ::connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address);
  const int error = errno;
  ::close(fd);
  // Refused: nobody listens. EAGAIN is a live listener with a full backlog.
  if (connected != 0 && error == ECONNREFUSED) {
    if (::unlink(path.c_str()) == 0 || errno == ENOENT) return {};
    return {Code::Unavailable, "cannot remove stale socket \"" + path + "\": " + std::strerror(errno)};
  }
  if (connected == 0 || error == EAGAIN) return {Code::Unavailable, "another server is listening on \"" + path + "\""};
  return {Code::Unavailable, "cannot use socket \"" + path + "\": " + std::strerror(error)};
}

}  // namespace server
}  // namespace gobo
