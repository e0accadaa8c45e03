// SPDX-License-Identifier: Apache-2.0
// Listener: the daemon's own listening sockets. gRPC 1.51 stops accepting for good once accept() finds no descriptor, and bounds
// neither connections nor what one address may open; so connections are accepted here and handed to gRPC.
// Above `most`, or of an address that has `mostOfPeer`, a new connection takes the place of one that never sent a byte, or is closed
// at once; one descriptor is kept in reserve, so that a process without any still takes connections off the queue (and closes
// them). What gRPC has closed is noticed by the socket's inode: descriptors are used again, inodes of living sockets are not.
// One thread.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "base/descriptor.h"
#include "base/status.h"

namespace gobo {
inline namespace server {

struct ListenerLimits {
  uint32_t most = 1024, mostOfPeer = 256;
};

struct ListenerStats {
  uint64_t accepted = 0, refused = 0, noDescriptor = 0;
  uint64_t evicted = 0;  ///< silent ones that had to go for others
  uint64_t looked = 0;   ///< system calls that asked about a connection which is there: a few for each new one, however many are open
  uint32_t open = 0;
};

class Listener {
 public:
  /// Takes over a connection: its descriptor, from which socket of addresses() it came.
  using Take = std::function<void(int fd, size_t socket)>;
  explicit Listener(const ListenerLimits& limits) : limits_(limits) {}
  ~Listener() { stop(); }

  /// Binds and listens: "unix:PATH" (made with mode 0600) or HOST:PORT, all addresses of the name; port 0 picks one. What is served, with
  /// the port. Errors: Unavailable "cannot listen on ...". Before start().
  Result<std::string> add(const std::string& address);
  void start(Take take);
  void stop();
  ListenerStats stats() const;
  /// Connects to the socket behind the given index and waits until it was accepted here: the proof that a client would be, too.
  bool reachable(size_t socket, double seconds);

 private:
  struct Socket {
    Descriptor fd;
    size_t index;
    bool isUnix = false;
  };
  struct Peer {
    int fd;
    uint64_t inode;
    std::string address;
    std::chrono::steady_clock::time_point since;
    bool spoke = false;  ///< known to have sent a byte
  };
  void loop();
  void accept(Socket& from);
  bool makeRoom(const std::string& address);  ///< under mutex_; false: there is none
  bool evictSilent(const std::string* address);
  void forgetClosed();
  void forgetClosed(std::chrono::milliseconds age);  ///< unless that was done less than `age` ago
  const ListenerLimits limits_;
  std::vector<Socket> sockets_;  // several where a name has several addresses
  size_t added_ = 0;
  Take take_;
  Descriptor reserve_, wake_;
  std::thread thread_;
  std::atomic<bool> stopping_{false};
  mutable std::mutex mutex_;  // below
  std::condition_variable probed_;
  std::vector<Peer> peers_;
  std::map<std::string, uint32_t> ofPeer_;
  std::chrono::steady_clock::time_point forgotten_{};
  std::set<std::string> probes_;  // local addresses of connections made by reachable()
  ListenerStats stats_;
};

}  // namespace server
}  // namespace gobo
