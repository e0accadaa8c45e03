// SPDX-License-Identifier: Apache-2.0
// The seam between Gobo's values and gRPC's: statuses, peers, deadlines, retry hints.
#pragma once

#include <chrono>
#include <optional>
#include <string>

#include <sys/socket.h>

#include <grpcpp/grpcpp.h>

#include "base/status.h"
#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace server {

/// Code and "message (at location)", cut so that it fits into HTTP/2 trailers: a client that gets more than 8 KiB of them sees RESOURCE_EXHAUSTED in the
/// place of any code. The location is kept where the message is long.
grpc::Status toGrpc(const Status& status);
/// RESOURCE_EXHAUSTED that may pass: trailing metadata "retry-after-ms" and the same in the message.
grpc::Status busy(grpc::ServerContext& context, const std::string& what, double retryAfterMs);
/// UNAVAILABLE for requests that arrive while the daemon drains (Rpc::refuseDraining adds the retry hint).
grpc::Status drainingStatus();
/// The peer that gRPC names; of a call that the HTTP door makes for somebody "http:ADDRESS:PORT" (only calls inside the process may say so).
std::string peerOf(const grpc::ServerContext& context);
/// The form of peerOf for an address of a socket.
std::string peerText(const sockaddr& address);
/// A Unix socket or a channel inside the process.
bool isLocalPeer(const grpc::ServerContext& context);
/// scheduling.client, or the peer without its port.
std::string clientName(const grpc::ServerContext& context, const std::string& named);
/// The earlier of scheduling.deadline_ms from now and the RPC's own deadline.
std::optional<std::chrono::steady_clock::time_point> deadlineOf(const grpc::ServerContext& context, const v1::Scheduling& scheduling);

constexpr const char* kRetryAfterKey = "retry-after-ms";
constexpr const char* kRequestIdKey = "x-request-id";
constexpr const char* kPeerKey = "x-gobo-http-peer";
constexpr double kDrainRetryMs = 1000;  ///< hint to callers of a daemon that drains: its successor needs about that long

}  // namespace server
}  // namespace gobo
