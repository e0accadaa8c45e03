// SPDX-License-Identifier: Apache-2.0
// The unary calls; jobs_streams.cpp has Watch and Fetch.
#include "server/jobs/jobs_service.h"

#include <chrono>

#include "server/jobs/job_spec.h"
#include "server/log.h"
#include "server/rpc.h"

namespace gobo {

namespace {

const Status kOff(Code::FailedPrecondition, "jobs are switched off: set folder in the [jobs] section of gobod's configuration (docs/operations.md)", "jobs.folder");

}  // namespace

Result<JobRecord> JobsService::read(const std::string& text, bool frames) {
  if (!core_.durable) return kOff;
  const int64_t id = jobIdOf(text);
  if (!id) return notFound("no job '" + text.substr(0, 80) + "'", "id");
  GOBO_ASSIGN(JobRecord record, core_.durable->store().get(id, frames));
  core_.durable->hub().overlay(record);
  return record;
}

grpc::Status JobsService::Submit(grpc::ServerContext* context, const v1::JobSpec* spec, v1::Job* reply) {
  ServerCore::Call call(core_);
  if (!call.ok) return drainingStatus();
  const std::string client = clientName(*context, spec->client().empty() ? spec->request().scheduling().client() : spec->client());
  const auto submit = [&]() -> Result<int64_t> {
    if (!core_.durable) return kOff;
    DurableJobs& jobs = *core_.durable;
    // A known key first: its job stands, whatever became of the scene since.
    GOBO_ASSIGN(const int64_t known, jobs.store().findKey(client, spec->key(), specDigest(*spec)));
    if (known) return known;
    const double now = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    GOBO_ASSIGN(NewJob job, makeJob(*spec, client, core_.engine, now));
    const v1::RenderRequest& r = job.spec.request();
    const uint64_t bytes = uint64_t(r.width()) * r.height() * uint64_t(r.outputs_size()) * 16;
    if (bytes > core_.config.imageBytes)
      return invalidArgument(strf("width x height x outputs needs %llu bytes: at most %llu (limits.image_bytes)", (unsigned long long)bytes,
                                  (unsigned long long)core_.config.imageBytes), "job.request.width");
    GOBO_TRY(jobs.scenes().describe(job));
    bool existed = false;
    GOBO_ASSIGN(const int64_t id, jobs.store().submit(job, existed));
    jobs.hub().changed();
    return id;
  };
  const auto id = submit();
  Status status = id.status();
  if (status.ok()) {
    auto record = read(jobIdText(*id), false);
    status = record.status();
    if (status.ok()) *reply = std::move(record->job);
  }
  logInfo("submit job=%s scene=%s frames=%llu client=%s status=%s %s", status.ok() ? reply->id().c_str() : "-", spec->request().scene().c_str(),
          (unsigned long long)reply->frames_total(), client.c_str(), codeName(status.code()), status.message().c_str());
  return toGrpc(status);
}

grpc::Status JobsService::Get(grpc::ServerContext*, const v1::GetJobRequest* request, v1::Job* reply) {
  auto record = read(request->id(), true);
  if (record.ok()) *reply = std::move(record->job);
  return toGrpc(record.status());
}

grpc::Status JobsService::List(grpc::ServerContext*, const v1::ListJobsRequest* request, v1::ListJobsReply* reply) {
  if (!core_.durable) return toGrpc(kOff);
  JobFilter filter;
  for (const int state : request->states()) {
    if (!v1::Job::State_IsValid(state) || state == 0) return toGrpc(invalidArgument(strf("states: %d is no state", state), "states"));
    filter.states.push_back(v1::Job::State(state));
  }
  filter.client = request->client();
  if (!request->page_token().empty() && (filter.before = jobIdOf(request->page_token())) == 0)
    return toGrpc(invalidArgument("page_token = \"" + request->page_token().substr(0, 80) + "\": is none of this server", "page_token"));
  if (request->page_size() > 1000) return toGrpc(invalidArgument(strf("page_size = %u: must be at most 1000", request->page_size()), "page_size"));
  const uint32_t page = request->page_size() ? request->page_size() : 50;
  filter.limit = page + 1;
  auto jobs = core_.durable->store().list(filter);
  if (!jobs.ok()) return toGrpc(jobs.status());
  for (size_t i = 0; i < jobs->size() && i < page; ++i) {
    JobRecord record;
    record.job = std::move((*jobs)[i]);
    record.id = jobIdOf(record.job.id());
    core_.durable->hub().overlay(record);
    *reply->add_jobs() = std::move(record.job);
  }
  if (jobs->size() > page) reply->set_next_page_token(reply->jobs(int(page) - 1).id());
  return grpc::Status::OK;
}

grpc::Status JobsService::steer(const char* method, const std::string& text, Steer what, v1::Job* reply) {
  ServerCore::Call call(core_);
  if (!call.ok) return drainingStatus();
  auto record = read(text, false);
  Status status = record.status();
  if (status.ok()) status = (core_.durable->store().*what)(record->id);
  if (status.ok()) {
    core_.durable->hub().steered();
    record = read(text, false);
    status = record.status();
    if (status.ok()) *reply = std::move(record->job);
  }
  logInfo("%s job=%s status=%s %s", method, escaped(text.substr(0, 80)).c_str(), codeName(status.code()), status.message().c_str());
  return toGrpc(status);
}

grpc::Status JobsService::Cancel(grpc::ServerContext*, const v1::CancelJobRequest* r, v1::Job* reply) { return steer("cancel", r->id(), &JobStore::cancel, reply); }
grpc::Status JobsService::Pause(grpc::ServerContext*, const v1::PauseJobRequest* r, v1::Job* reply) { return steer("pause", r->id(), &JobStore::pause, reply); }
grpc::Status JobsService::Resume(grpc::ServerContext*, const v1::ResumeJobRequest* r, v1::Job* reply) { return steer("resume", r->id(), &JobStore::resume, reply); }

grpc::Status JobsService::Delete(grpc::ServerContext*, const v1::DeleteJobRequest* request, v1::DeleteJobReply*) {
  ServerCore::Call call(core_);
  if (!call.ok) return drainingStatus();
  auto record = read(request->id(), false);
  Status status = record.status();
  if (status.ok()) status = core_.durable->store().remove(record->id);
  if (status.ok()) {
    core_.durable->files().removeResults(record->id);   // a kill in between leaves litter, which the next start sweeps
    core_.durable->hub().steered();
  }
  logInfo("delete job=%s status=%s", escaped(request->id().substr(0, 80)).c_str(), codeName(status.code()));
  return toGrpc(status);
}

}  // namespace gobo
