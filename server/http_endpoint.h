// SPDX-License-Identifier: Apache-2.0
// HttpEndpoint: GET /metrics (Prometheus text), /health (JSON, 503 while the server drains), /ready ("ready", or 503 while it drains or when
// a connection to one of the daemon's own addresses is not accepted) on one small HTTP listener beside gRPC. One event-driven thread
// (libmicrohttpd): a slow client costs a connection, not a thread. Connections are bounded; one that is older than kOldest seconds has to
// go when there are many, whatever it drips. No request bodies. Nothing of it renders. Browser clients can have their door here: replies may
// be streamed and suspended.
#pragma once

#include <memory>
#include <string>

#include "base/status.h"

namespace gobo {
inline namespace server {

class ServerCore;

class HttpEndpoint {
 public:
  static constexpr unsigned kConnections = 128;
  static constexpr double kOldest = 5;
  /// `address` is HOST:PORT (port 0 picks one). Errors: Unavailable when it cannot be bound.
  static Result<std::unique_ptr<HttpEndpoint>> start(ServerCore& core, const std::string& address);
  ~HttpEndpoint();  ///< closes, joins
  /// HOST:PORT with the port that was picked.
  const std::string& address() const { return address_; }

 private:
  HttpEndpoint();
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::string address_;
};

}  // namespace server
}  // namespace gobo
