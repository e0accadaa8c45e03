// SPDX-License-Identifier: Apache-2.0
// Server: the services, health and the sockets of one daemon, around an engine. Without addresses it serves only
// in-process channels: `gobo --local` and the daemon run the same code. start(), shutdown() from one thread.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "server/core.h"

namespace gobo {

EngineOptions engineOptions(const ServerConfig& config);

class Server {
 public:
  /// `config` has passed checkConfig. `sockets` false: in-process channels only.
  /// Errors: FailedPrecondition when a live daemon holds the Unix socket or the path is no socket; Unavailable when an
  /// address cannot be bound; the engine's own.
  static Result<std::unique_ptr<Server>> start(const ServerConfig& config, const EngineOptions& options, bool sockets);
  ~Server();

  std::shared_ptr<grpc::Channel> inProcessChannel();
  /// The addresses that are served, with the port that was chosen for port 0.
  const std::vector<std::string>& addresses() const { return addresses_; }
  ServerCore& core() { return *core_; }

  /// Refuses new renders (UNAVAILABLE), waits up to `drainSeconds` for the running ones, cancels the rest, closes.
  /// Another thread may call core().cancelAll() to end the wait.
  void shutdown(double drainSeconds);

 private:
  Server();
  struct Services;
  std::unique_ptr<Engine> engine_;
  std::unique_ptr<ServerCore> core_;
  std::unique_ptr<DurableJobs> jobs_;
  std::unique_ptr<Services> services_;
  std::unique_ptr<grpc::Server> server_;
  std::vector<std::string> addresses_;
  std::vector<std::string> socketFiles_;
};

/// Makes `path` free for a socket: removes a stale socket file; refuses a live socket and anything that is not a socket.
Status claimSocketPath(const std::string& path);

}  // namespace gobo
