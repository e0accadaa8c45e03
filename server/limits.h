// SPDX-License-Identifier: Apache-2.0
// What the configuration and the caller's token allow of one request. Errors name field, value and limit with its key, and are
// counted by reason. Every service that takes renders (Render, jobs) asks here. Pure but for the counting; thread-safe.
#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "gobo/v1/render.pb.h"
#include "server/serve.h"

namespace gobo {
inline namespace server {

/// The caller's token, if there is one, allows the class (tokens.classes).
bool mayUse(const Rpc& rpc, v1::Scheduling::Class priority);
/// Where the caller named no class and may use it, INTERACTIVE for what somebody looks at while it comes: progressive calls, requests of a session, and
/// requests that show first hits alone (albedo, normal, position, depth, alpha, ids, motion), which cost next to nothing.
void chooseClass(const Rpc& rpc, bool progressive, v1::RenderRequest& request, v1::RenderRequest& resolved);
/// Checks `resolved` (of Engine::resolve) against [limits] and the token: class, pixels, samples, pictures' bytes, environment path.
/// Where the token bounds the samples and the request has none, sets request.halt.spp to the bound.
/// Ok, or the status to answer with.
grpc::Status checkRender(Rpc& rpc, v1::RenderRequest& request, const v1::RenderRequest& resolved);
/// A file or folder that a request names: under the token's roots, if it has any of its own. Built-in names and "none" pass.
grpc::Status checkPath(Rpc& rpc, const std::string& path, const char* field);
/// The bytes that one upload may have, and the name of what says so.
struct UploadLimit {
  uint64_t bytes;
  const char* key;
};
UploadLimit uploadLimit(const Rpc& rpc);

/// The earliest of deadlineOf(), limits.request_s and the token's max_s.
struct Deadline {
  std::optional<std::chrono::steady_clock::time_point> at;
  std::string limit;  ///< "limits.request_s = 5" when a limit of the server is the earliest; else empty
  bool passed() const { return at && std::chrono::steady_clock::now() >= *at; }
};
Deadline deadlineFor(const Rpc& rpc, const grpc::ServerContext& context, const v1::Scheduling& scheduling);

}  // namespace server
}  // namespace gobo
