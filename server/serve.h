// SPDX-License-Identifier: Apache-2.0
// serve(): the frame around every handler: request id, token, rate, log line, metrics, error details. Handlers of all services
// are written as
//   return serve(core_, *context, "open", [&](Rpc& rpc) -> grpc::Status { ...; rpc.note("scene", id); return ...; });
// A method without it would be open to callers without a token; tests/protocol/server/tokens_test.cpp calls every method of
// the schema without one. An Rpc belongs to its handler's thread.
#pragma once

#include <chrono>
#include <string>

#include <grpcpp/grpcpp.h>

#include "plan/scene_access.h"
#include "server/auth.h"
#include "server/core.h"
#include "server/log.h"
#include "server/rpc.h"

namespace gobo {
inline namespace server {

class Rpc {
 public:
  Rpc(ServerCore& core, grpc::ServerContext& context, const char* method);

  /// Who calls, and whether now: UNAUTHENTICATED, or RESOURCE_EXHAUSTED beyond the token's rate.
  grpc::Status admit();
  /// Logs and counts the call, gives errors their details ("grpc-status-details-bin": google.rpc.RequestInfo, RetryInfo). Once.
  grpc::Status finish(grpc::Status status);
  /// After finish(): keeps the answer back from a caller who was told when to come back and did not wait.
  void pause();

  ServerCore& core() const { return core_; }
  grpc::ServerContext& context() { return context_; }
  /// "x-request-id" of the client if it is 1..64 letters, digits and ._:- ; else 16 random hex digits.
  const std::string& id() const { return id_; }
  const Principal& who() const { return who_; }
  /// A field of this call's log line.
  void note(std::string key, std::string value) { fields_.emplace_back(std::move(key), std::move(value)); }
  /// Calls that only look are logged at debug level when they succeed.
  void quiet() { quiet_ = true; }

  // Refusals, counted by reason (a word of a fixed list: docs/operations.md).
  grpc::Status refuse(const char* reason, const Status& status);
  /// With a retry hint.
  grpc::Status refuseBusy(const char* reason, const std::string& what, double retryMs);
  /// The same where the places of `limit`, of which one client may have half, are taken by what `what` says is at it; `option` sets it, if one does.
  grpc::Status refuseFull(const char* reason, const std::string& what, const SharedLimit& limit, const std::string& option, double retryMs);
  grpc::Status refuseDraining();
  /// PERMISSION_DENIED unless the caller has the admin right.
  grpc::Status needAdmin(const char* what);
  /// The same for the right of workers.
  grpc::Status needWorker(const char* what);

  /// The client of the fair share: the token's name; else `named` (scheduling.client), which may not be a token's name; else the peer.
  Result<std::string> client(const std::string& named) const;
  /// What this caller may do with loaded scenes: a token without the admin right uses what is its own, everybody's, or shared with it.
  SceneAccess access() const { return {who_.token ? who_.name : std::string(), !who_.token || who_.admin}; }
  /// Whose the render ids of this call are: the token's name; empty without a token.
  std::string renderOwner() const { return who_.token ? who_.name : std::string(); }

 private:
  ServerCore& core_;
  grpc::ServerContext& context_;
  const char* method_;
  std::string id_;
  LogRequest log_;
  Principal who_;
  LogFields fields_;
  bool quiet_ = false;
  double retryMs_ = 0;
  const std::chrono::steady_clock::time_point begun_ = std::chrono::steady_clock::now();
};

template <typename Body>
grpc::Status serve(ServerCore& core, grpc::ServerContext& context, const char* method, Body&& body) {
  Rpc rpc(core, context, method);
  try {
    grpc::Status status = rpc.admit();
    if (status.ok()) status = body(rpc);
    status = rpc.finish(std::move(status));
    rpc.pause();
    return status;
  } catch (const std::exception& e) { return rpc.finish({grpc::StatusCode::INTERNAL, std::string("exception in a handler: ") + e.what()}); }
}

}  // namespace server
}  // namespace gobo
