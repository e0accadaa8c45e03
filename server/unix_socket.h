// SPDX-License-Identifier: Apache-2.0
// Who owns a Unix socket's path. A lock file beside the socket (PATH.lock, flock) is held for as long as the daemon lives: of any
// number of daemons started at once exactly one wins, and the kernel lets go of it when the process dies, however it dies.
#pragma once

#include <chrono>
#include <string>

#include "base/status.h"

namespace gobo {
inline namespace server {

class SocketLock {
 public:
  /// `patience`: a server that was just killed holds it until the system has taken its memory back.
  /// Errors: Unavailable when another server holds it for longer than that, or the file cannot be made.
  static Result<SocketLock> take(const std::string& socketPath, std::chrono::milliseconds patience = std::chrono::seconds(4));
  SocketLock(SocketLock&& other) noexcept;
  SocketLock& operator=(SocketLock&& other) noexcept;
  ~SocketLock();  ///< removes the file while it still holds the lock

 private:
  SocketLock(std::string path, int fd) : path_(std::move(path)), fd_(fd) {}
  std::string path_;
  int fd_ = -1;
};

/// Makes `path` free for a socket: removes a stale socket file; refuses a live socket and anything that is not a socket.
/// Races with other daemons unless the caller holds the path's SocketLock.
Status claimSocketPath(const std::string& path);

}  // namespace server
}  // namespace gobo
