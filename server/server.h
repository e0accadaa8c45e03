// SPDX-License-Identifier: Apache-2.0
// Server: the services, health and the sockets of one daemon, around an engine. Without addresses it serves only
// in-process channels: `gobo --local` and the daemon run the same code. start(), shutdown() from one thread.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "server/core.h"
#include "server/door/door.h"
#include "server/http_endpoint.h"
#include "server/listener.h"
#include "server/tls.h"
#include "server/unix_socket.h"

namespace gobo::farm {
class FarmWorker;  // server/farm/farm_worker.h
}

namespace gobo {
inline namespace server {

EngineOptions engineOptions(const ServerConfig& config);
/// Of the config that [color] names; not read yet.
std::shared_ptr<DisplayTransforms> displayTransforms(const ServerConfig& config);

class Server {
 public:
  /// `config` has passed checkConfig. `sockets` false: in-process channels only.
  /// Errors: Unavailable when a live daemon holds the Unix socket, the path is no socket or an address cannot be bound; the engine's own.
  static Result<std::unique_ptr<Server>> start(const ServerConfig& config, const EngineOptions& options, bool sockets);
  ~Server();

  std::shared_ptr<grpc::Channel> inProcessChannel();
  /// The addresses that are served, with the port that was chosen for port 0.
  const std::vector<std::string>& addresses() const { return addresses_; }
  /// "http://HOST:PORT" of the viewer (server/door); empty: none.
  std::string webAddress() const { return door_ ? (door_->secure() ? "https://" : "http://") + door_->address() : std::string(); }
  /// Of /metrics, /health and /ready; empty without.
  std::string httpAddress() const { return http_ ? http_->address() : std::string(); }
  ServerCore& core() { return *core_; }
  /// Of a daemon that renders a coordinator's frames (farm.coordinator); else null.
  const farm::FarmWorker* worker() const { return worker_.get(); }

  /// Takes over what may change at run time: tokens, TLS files, roots, log, limits, drain_s. All or nothing: when anything of
  /// `next` (which has passed checkConfig) cannot be had, the error says what and the old one stays. The keys that would
  /// need a restart are in the value.
  Result<std::vector<std::string>> reload(const ServerConfig& next);

  /// Refuses new renders (UNAVAILABLE), waits up to `drainSeconds` for the running ones, cancels the rest, closes.
  /// Another thread may call core().cancelAll() to end the wait.
  void shutdown(double drainSeconds);

 private:
  Server();
  void setServing(bool serving);
  struct Services;
  std::vector<SocketLock> locks_;  // given back last
  std::unique_ptr<Engine> engine_;
  std::unique_ptr<ServerCore> core_;
  std::unique_ptr<DurableJobs> jobs_;
  std::unique_ptr<farm::FarmWorker> worker_;
  std::unique_ptr<Services> services_;
  std::shared_ptr<TlsSource> tls_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<Listener> listener_;
  std::unique_ptr<Door> door_;
  std::unique_ptr<HttpEndpoint> http_;  // goes before the core
  std::vector<std::string> addresses_;
  std::vector<std::string> socketFiles_;
};

}  // namespace server
}  // namespace gobo
