// SPDX-License-Identifier: Apache-2.0
// HttpEndpoint: GET /metrics (Prometheus text), /health (JSON, 503 while the server drains), /ready ("ready" or 503) on one small
// HTTP listener beside gRPC. Two threads, no request bodies, bounded headers and time (cpp-httplib). Nothing of it renders.
#pragma once

#include <memory>
#include <string>

#include "base/status.h"

namespace gobo {

class ServerCore;

class HttpEndpoint {
 public:
  /// `address` is HOST:PORT (port 0 picks one). Errors: Unavailable when it cannot be bound.
  static Result<std::unique_ptr<HttpEndpoint>> start(ServerCore& core, const std::string& address);
  ~HttpEndpoint();   ///< closes, joins
  /// HOST:PORT with the port that was picked.
  const std::string& address() const { return address_; }

 private:
  HttpEndpoint();
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::string address_;
};

}  // namespace gobo
