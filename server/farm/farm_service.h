// SPDX-License-Identifier: Apache-2.0
// gobo.v1.Farm: a coordinator's side of its workers, over the daemon's own job store, files and scenes. What a worker reports is written
// through the store's fences; its files are taken in only with the digest that names them. Synchronous handlers; thread-safe.
#pragma once

#include "gobo/v1/farm.grpc.pb.h"
#include "server/core.h"
#include "server/farm/worker_book.h"
#include "server/jobs/durable_jobs.h"
#include "server/serve.h"

namespace gobo::farm {

class FarmService final : public v1::Farm::Service {
 public:
  explicit FarmService(ServerCore& core);
  grpc::Status Attend(grpc::ServerContext*, const v1::AttendRequest*, grpc::ServerWriter<v1::FarmNews>*) override;
  grpc::Status Claim(grpc::ServerContext*, const v1::ClaimRequest*, v1::ClaimReply*) override;
  grpc::Status Hold(grpc::ServerContext*, const v1::HoldRequest*, v1::HoldReply*) override;
  grpc::Status Checkpoint(grpc::ServerContext*, const v1::CheckpointReport*, v1::CheckpointReply*) override;
  grpc::Status Complete(grpc::ServerContext*, const v1::CompletionReport*, v1::FarmAck*) override;
  grpc::Status Fail(grpc::ServerContext*, const v1::FailureReport*, v1::FarmAck*) override;
  grpc::Status Release(grpc::ServerContext*, const v1::ReleaseReport*, v1::FarmAck*) override;
  grpc::Status Put(grpc::ServerContext*, grpc::ServerReader<v1::PutFarmFileRequest>*, v1::FarmAck*) override;
  grpc::Status Get(grpc::ServerContext*, const v1::GetFarmFileRequest*, grpc::ServerWriter<v1::FarmChunk>*) override;
  grpc::Status Workers(grpc::ServerContext*, const v1::WorkersRequest*, v1::WorkersReply*) override;

 private:
  template <typename Body>
  grpc::Status handle(grpc::ServerContext& context, const char* method, Body&& body);
  grpc::Status attend(Rpc& rpc, const v1::AttendRequest& request, grpc::ServerWriter<v1::FarmNews>& writer);
  Status claim(const v1::ClaimRequest& request, v1::ClaimReply& reply);
  Status complete(const v1::CompletionReport& report);
  Status put(Rpc& rpc, grpc::ServerReader<v1::PutFarmFileRequest>& reader);
  Status get(Rpc& rpc, const v1::GetFarmFileRequest& request, grpc::ServerWriter<v1::FarmChunk>& writer);
  JobStore& store() { return core_.durable->store(); }
  JobFiles& files() { return core_.durable->files(); }
  ServerCore& core_;
  WorkerBook book_;
};

}  // namespace gobo::farm
