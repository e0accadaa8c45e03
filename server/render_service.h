// SPDX-License-Identifier: Apache-2.0
// gobo.v1.Render over the job runner: validates, admits, renders, encodes, streams. Synchronous handlers; thread-safe.
// The handler thread watches the client while the render runs on its own thread (render_call.h): a client that has gone or
// cancelled stops its render within 10 ms plus the engine's own polling interval.
#pragma once

#include <functional>

#include "gobo/v1/service.grpc.pb.h"
#include "server/encode.h"
#include "server/serve.h"

namespace gobo {
inline namespace server {

class RenderService final : public v1::Render::Service {
 public:
  explicit RenderService(ServerCore& core) : core_(core) {}
  grpc::Status Render(grpc::ServerContext*, const v1::RenderRequest*, grpc::ServerWriter<v1::RenderEvent>*) override;
  grpc::Status RenderProgressive(grpc::ServerContext*, const v1::RenderRequest*, grpc::ServerWriter<v1::RenderEvent>*) override;
  grpc::Status RenderInline(grpc::ServerContext*, const v1::RenderRequest*, v1::InlineReply*) override;
  grpc::Status Plan(grpc::ServerContext*, const v1::RenderRequest*, v1::PlanReply*) override;
  grpc::Status Relight(grpc::ServerContext*, const v1::RelightRequest*, grpc::ServerWriter<v1::RenderEvent>*) override;

 private:
  /// What a finished or partial render does with its encoded pictures; false: the client has gone.
  using Deliver = std::function<bool(v1::RenderReply&& reply, std::vector<EncodedImage>&& images, bool last)>;
  using Report = std::function<bool(const v1::Progress&)>;
  grpc::Status run(Rpc& rpc, v1::RenderRequest request, const Deliver& deliver, const Report* report);
  grpc::Status stream(Rpc& rpc, const v1::RenderRequest& request, grpc::ServerWriter<v1::RenderEvent>& writer, bool progressive);
  grpc::Status inlined(Rpc& rpc, const v1::RenderRequest& request, v1::InlineReply* reply);
  ServerCore& core_;
};

}  // namespace server
}  // namespace gobo
