// SPDX-License-Identifier: Apache-2.0
// gobo.v1.Scenes over an engine. Synchronous handlers; thread-safe.
#pragma once

#include "gobo/v1/service.grpc.pb.h"
#include "server/serve.h"

namespace gobo {
inline namespace server {

class ScenesService final : public v1::Scenes::Service {
 public:
  explicit ScenesService(ServerCore& core) : core_(core) {}
  grpc::Status Open(grpc::ServerContext*, const v1::OpenSceneRequest*, v1::SceneInfo*) override;
  grpc::Status Upload(grpc::ServerContext*, grpc::ServerReader<v1::UploadSceneRequest>*, v1::SceneInfo*) override;
  grpc::Status List(grpc::ServerContext*, const v1::ListScenesRequest*, v1::ListScenesReply*) override;
  grpc::Status Inspect(grpc::ServerContext*, const v1::InspectSceneRequest*, v1::SceneInfo*) override;
  grpc::Status Patch(grpc::ServerContext*, const v1::PatchSceneRequest*, v1::SceneInfo*) override;
  grpc::Status Unload(grpc::ServerContext*, const v1::UnloadSceneRequest*, v1::UnloadSceneReply*) override;

 private:
  grpc::Status openFiles(Rpc& rpc, ServerCore::Call& call, const v1::OpenSceneRequest& request, v1::SceneInfo* reply);
  grpc::Status upload(Rpc& rpc, grpc::ServerReader<v1::UploadSceneRequest>& reader, v1::SceneInfo* reply);
  ServerCore& core_;
};

}  // namespace server
}  // namespace gobo
