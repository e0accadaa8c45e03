// SPDX-License-Identifier: Apache-2.0
// Door: Gobo over HTTP, for browsers, curl and whatever has no gRPC: the viewer's page, and JSON calls that become calls of a gRPC channel
// (docs/live.md). It renders nothing and knows no engine: rights, limits, log lines and metrics are those of the service behind the channel.
//
//   GET  /, /NAME            the viewer (clients/viewer)
//   GET  /v1/schema          what a request may hold: fields, kinds, ranges, defaults, help (schema.h)
//   GET  /v1/status          StatusReply
//   GET  /v1/jobs            ListJobsReply, the newest 50, without spec.request     GET /v1/workers  WorkersReply (Farm.Workers: needs the worker or admin
//   right of a token) GET  /v1/scenes          ListScenesReply          POST /v1/scenes {"source"}   SceneInfo (Open) GET  /v1/scenes/ID       SceneInfo GET
//   /v1/blobs/SHA256?bytes=N           {"received"}: how much of that file is there    POST ...?bytes=N&offset=K   the file from there on, as it is POST
//   /v1/plan            RenderRequest -> PlanReply POST /v1/render          RenderRequest -> one picture    /v1/relight   RelightRequest -> one picture POST
//   /v1/render/stream   RenderRequest -> frames         /v1/relight/stream POST /render             Drake's glTF Render Client-Server API: a form with a scene
//   and a camera -> PNG or TIFF (docs/drake.md)
//
// A frame is a 32-bit little-endian length, that many bytes of JSON ({"bytes": N, "progress" | "snapshot" | "reply" | "error": ...}), and N bytes
// of pictures in the order of the reply's images. Errors before the first frame are an HTTP status and {"error": {"code", "message"}},
// of POST /render an HTTP status and one sentence of plain text.
//
// A thread for each of at most kConnections connections. A client that closes its connection has its call cancelled within kPoll.
// Pages of other origins get nothing: Origin, where a browser sends one, must be this door's, and Host a loopback name or the door's own.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "base/status.h"

namespace gobo {
inline namespace door {

struct DoorOptions {
  std::string listen;                                     ///< HOST:PORT; port 0 picks one
  std::shared_ptr<grpc::Channel> channel;                 ///< whose Scenes, Render, Blobs, Admin, Jobs and Farm it calls
  bool tellsPeer = false;                                 ///< the channel is inside the process and the server is to see callers as those of a socket (rpc.h)
  std::string secret;                                     ///< if set: the bearer token that callers must send; it ends here
  std::string authorization;                              ///< with a secret: what the channel's calls send as their own authorization; may be empty
  std::vector<std::string> hosts;                         ///< names that callers may use for it beside loopback's and its own
  std::string cert, key;                                  ///< PEM texts: HTTPS; empty: plain
  uint64_t requestBytes = 16ull << 20;                    ///< of one body
  std::function<uint64_t()> sceneBytes;                   ///< of a scene in a form to /render, asked for each; null: there is no such path
  std::function<std::string(const std::string&)> nameOf;  ///< whom an Authorization header's value is; of callers that the service lets in, for /render
};

class Door {
 public:
  static constexpr unsigned kConnections = 96;
  static constexpr std::chrono::milliseconds kPoll{10};
  /// Errors: Unavailable when the address cannot be bound.
  static Result<std::unique_ptr<Door>> start(DoorOptions options);
  ~Door();  ///< cancels what runs, closes, joins
  /// HOST:PORT with the port that was picked.
  const std::string& address() const { return address_; }
  bool secure() const;
  /// PEM texts, for connections from now on; those that there are keep theirs, for one more answer. Nothing for a door without HTTPS.
  /// Not from two threads at once. Errors: Unavailable; the certificate of before goes on being served.
  Status setCertificate(const std::string& cert, const std::string& key);

 private:
  Door();
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::string address_;
};

}  // namespace door
}  // namespace gobo
