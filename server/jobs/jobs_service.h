// SPDX-License-Identifier: Apache-2.0
// gobo.v1.Jobs over DurableJobs; without them every call says how to switch them on. A caller with a token sees and steers the
// jobs of that token only, unless it has the admin right. Synchronous handlers; thread-safe.
#pragma once

#include <functional>

#include "gobo/v1/jobs.grpc.pb.h"
#include "server/core.h"
#include "server/jobs/durable_jobs.h"
#include "server/serve.h"

namespace gobo {
inline namespace jobs {

class JobsService final : public v1::Jobs::Service {
 public:
  explicit JobsService(ServerCore& core) : core_(core) {}
  grpc::Status Submit(grpc::ServerContext*, const v1::JobSpec*, v1::Job*) override;
  grpc::Status Get(grpc::ServerContext*, const v1::GetJobRequest*, v1::Job*) override;
  grpc::Status List(grpc::ServerContext*, const v1::ListJobsRequest*, v1::ListJobsReply*) override;
  grpc::Status Cancel(grpc::ServerContext*, const v1::CancelJobRequest*, v1::Job*) override;
  grpc::Status Pause(grpc::ServerContext*, const v1::PauseJobRequest*, v1::Job*) override;
  grpc::Status Resume(grpc::ServerContext*, const v1::ResumeJobRequest*, v1::Job*) override;
  grpc::Status Retry(grpc::ServerContext*, const v1::RetryJobRequest*, v1::Job*) override;
  grpc::Status Prioritize(grpc::ServerContext*, const v1::PrioritizeJobRequest*, v1::Job*) override;
  grpc::Status Depend(grpc::ServerContext*, const v1::DependRequest*, v1::Job*) override;
  grpc::Status Log(grpc::ServerContext*, const v1::JobLogRequest*, v1::JobLogReply*) override;
  grpc::Status Watch(grpc::ServerContext*, const v1::WatchJobRequest*, grpc::ServerWriter<v1::JobEvent>*) override;
  grpc::Status Fetch(grpc::ServerContext*, const v1::FetchRequest*, grpc::ServerWriter<v1::FetchReply>*) override;
  grpc::Status Delete(grpc::ServerContext*, const v1::DeleteJobRequest*, v1::DeleteJobReply*) override;

 private:
  using Steer = std::function<Status(const JobRecord&)>;
  grpc::Status steer(grpc::ServerContext& context, const char* method, const std::string& id, const Steer& what, v1::Job* reply);
  grpc::Status submit(Rpc& rpc, const v1::JobSpec& spec, v1::Job* reply);
  grpc::Status list(Rpc& rpc, const v1::ListJobsRequest& request, v1::ListJobsReply* reply);
  grpc::Status watch(Rpc& rpc, const v1::WatchJobRequest& request, grpc::ServerWriter<v1::JobEvent>& writer);
  grpc::Status fetch(Rpc& rpc, const v1::FetchRequest& request, grpc::ServerWriter<v1::FetchReply>& writer);
  /// NotFound for a job of somebody else as for one that does not exist.
  Result<JobRecord> read(const Rpc& rpc, const std::string& id, bool frames);
  /// The jobs that one is to wait for, all of them the caller's to see. Errors: as parseJobIds.
  Result<std::vector<int64_t>> readNeeds(const Rpc& rpc, const google::protobuf::RepeatedPtrField<std::string>& ids, const std::string& field);
  Status log(const Rpc& rpc, const v1::JobLogRequest& request, v1::JobLogReply* reply);
  Status sendFile(Rpc&, grpc::ServerWriter<v1::FetchReply>&, int64_t job, const v1::Frame& frame, const v1::FrameFile& file, uint64_t offset);
  ServerCore& core_;
};

}  // namespace jobs
}  // namespace gobo
