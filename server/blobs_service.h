// SPDX-License-Identifier: Apache-2.0
// gobo.v1.Blobs over the daemon's FileStore. Synchronous handlers; thread-safe.
#pragma once

#include "gobo/v1/service.grpc.pb.h"
#include "server/file_store.h"
#include "server/serve.h"

namespace gobo {
inline namespace server {

class BlobsService final : public v1::Blobs::Service {
 public:
  explicit BlobsService(ServerCore& core) : core_(core) {}
  grpc::Status Missing(grpc::ServerContext*, const v1::MissingBlobsRequest*, v1::MissingBlobsReply*) override;
  grpc::Status Put(grpc::ServerContext*, grpc::ServerReader<v1::PutBlobRequest>*, v1::PutBlobReply*) override;

 private:
  grpc::Status put(Rpc& rpc, grpc::ServerReader<v1::PutBlobRequest>& reader, v1::PutBlobReply* reply);
  ServerCore& core_;
};

/// The file behind request.environment.digest, held while `held` lives; both empty without a digest.
struct EnvironmentFile {
  std::string path;
  std::shared_ptr<const FileTree> held;
};
/// Of what the caller of `rpc` has put. Errors at `field`: as FileStore::environment.
Result<EnvironmentFile> environmentFile(const Rpc& rpc, const v1::RenderRequest& request, const std::string& field, const StopToken& stop);

}  // namespace server
}  // namespace gobo
