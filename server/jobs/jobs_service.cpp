// SPDX-License-Identifier: Apache-2.0
// The unary calls; jobs_streams.cpp has Watch and Fetch.
#include "server/jobs/jobs_service.h"

#include <algorithm>
#include <chrono>

#include "server/blobs_service.h"
#include "server/jobs/frame_parts.h"
#include "server/jobs/job_spec.h"
#include "server/limits.h"

namespace gobo {
inline namespace jobs {

namespace {

const Status kOff(Code::FailedPrecondition, "jobs are switched off: set folder in the [jobs] section of gobod's configuration (docs/operations.md)",
                  "jobs.folder");

constexpr uint64_t kPageBytes = 8 << 20;  // of one reply of List
constexpr uint64_t kLogBytes = 3 << 20;   // of one of Log: clients take 4 MiB unless they are told otherwise
constexpr int kLogFrames = 1000;

/// The caller is bound to the jobs of its own token.
bool bound(const Rpc& rpc) { return rpc.who().token && !rpc.who().admin; }

}  // namespace

Result<JobRecord> JobsService::read(const Rpc& rpc, const std::string& text, bool frames) {
  if (!core_.durable) return kOff;
  const Status none = notFound("no job '" + text.substr(0, 80) + "'", "id");
  const int64_t id = jobIdOf(text);
  if (!id) return none;
  GOBO_ASSIGN(JobRecord record, core_.durable->store().get(id, frames));
  if (bound(rpc) && record.job.spec().client() != rpc.who().name) return none;
  core_.durable->hub().overlay(record);
  return record;
}

Result<std::vector<int64_t>> JobsService::readNeeds(const Rpc& rpc, const google::protobuf::RepeatedPtrField<std::string>& ids, const std::string& field) {
  GOBO_ASSIGN(const std::vector<int64_t> needs, parseJobIds(ids, field));
  for (size_t i = 0; i < needs.size(); ++i) {
    const auto record = core_.durable->store().get(needs[i], false);
    const bool hidden = record.ok() && bound(rpc) && record->job.spec().client() != rpc.who().name;
    const std::string where = strf("%s[%zu]", field.c_str(), i);
    if (hidden || record.status().code() == Code::NotFound) return notFound(where + ": no job '" + jobIdText(needs[i]) + "'", where);
    if (!record.ok()) return record.status();
  }
  return needs;
}

grpc::Status JobsService::Submit(grpc::ServerContext* context, const v1::JobSpec* spec, v1::Job* reply) {
  return serve(core_, *context, "submit", [&](Rpc& rpc) { return submit(rpc, *spec, reply); });
}

grpc::Status JobsService::submit(Rpc& rpc, const v1::JobSpec& spec, v1::Job* reply) {
  ServerCore::Call call(core_);
  if (!call.ok) return rpc.refuseDraining();
  rpc.note("scene", spec.request().scene());
  const auto client = rpc.client(spec.client().empty() ? spec.request().scheduling().client() : spec.client());
  if (!client.ok()) return rpc.refuse("client", client.status());
  if (!core_.durable) return toGrpc(kOff);
  DurableJobs& jobs = *core_.durable;
  // A known key first: its job stands, whatever became of the scene since.
  auto id = jobs.store().findKey(*client, spec.key(), specDigest(spec));
  if (!id.ok()) return toGrpc(id.status());
  if (*id == 0) {
    if (const auto needs = readNeeds(rpc, spec.after(), "job.after"); !needs.ok()) return toGrpc(needs.status());
    if (!spec.out().empty() && !jobs.out().on())
      return toGrpc(
          {Code::FailedPrecondition, "job.out: this daemon writes no files of jobs: set out_folder in its [jobs] section (docs/operations.md)", "job.out"});
    const double now = std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
    // Before anything is opened: an answer must not tell which files exist where the caller may not look.
    const grpc::Status path = checkPath(rpc, spec.request().environment().path(), "job.request.environment.path");
    if (!path.ok()) return path;
    const auto environment = environmentFile(rpc, spec.request(), "job.request.environment.digest", call.stop.token());
    if (!environment.ok()) return toGrpc(environment.status());
    bool full = false;
    auto place = core_.planning.enter(
        rpc.who().name, [&] { return rpc.context().IsCancelled() || call.stop.token().stopRequested(); }, core_.plansFull(full));
    if (!place && full) return rpc.refuseBusy("queue", core_.plansFullText(), ServerCore::kPlanRetryMs);
    if (!place) return toGrpc(Status(Code::Cancelled, "cancelled while it waited to be planned"));
    auto job = makeJob(spec, *client, core_.engine, now, rpc.access(), call.stop.token(), environment->path);
    place.reset();  // planned
    if (!job.ok()) return toGrpc(job.status());
    const grpc::Status allowed = checkRender(rpc, *job->spec.mutable_request(), job->spec.request());
    if (!allowed.ok()) return allowed;
    const Status described = jobs.scenes().describe(*job, rpc.access(), call.stop.token(), environment->path);
    if (!described.ok()) return toGrpc(described);
    bool existed = false;
    id = jobs.store().submit(*job, existed);
    if (!id.ok()) return toGrpc(id.status());
    jobs.hub().queued();
  }
  auto record = read(rpc, jobIdText(*id), false);
  if (!record.ok()) return toGrpc(record.status());
  *reply = std::move(record->job);
  rpc.note("job", reply->id());
  rpc.note("frames", std::to_string(reply->frames_total()));
  return grpc::Status::OK;
}

grpc::Status JobsService::Get(grpc::ServerContext* context, const v1::GetJobRequest* request, v1::Job* reply) {
  return serve(core_, *context, "get", [&](Rpc& rpc) {
    rpc.quiet();
    auto record = read(rpc, request->id(), true);
    if (record.ok()) *reply = std::move(record->job);
    return toGrpc(record.status());
  });
}

grpc::Status JobsService::List(grpc::ServerContext* context, const v1::ListJobsRequest* request, v1::ListJobsReply* reply) {
  return serve(core_, *context, "list_jobs", [&](Rpc& rpc) {
    rpc.quiet();
    return list(rpc, *request, reply);
  });
}

grpc::Status JobsService::list(Rpc& rpc, const v1::ListJobsRequest& sent, v1::ListJobsReply* reply) {
  const v1::ListJobsRequest* request = &sent;
  if (!core_.durable) return toGrpc(kOff);
  JobFilter filter;
  for (const int state : request->states()) {
    if (!v1::Job::State_IsValid(state) || state == 0) return toGrpc(invalidArgument(strf("states: %d is no state", state), "states"));
    if (std::find(filter.states.begin(), filter.states.end(), state) == filter.states.end()) filter.states.push_back(v1::Job::State(state));
  }
  filter.client = request->client();
  if (bound(rpc)) {
    if (!filter.client.empty() && filter.client != rpc.who().name) return grpc::Status::OK;
    filter.client = rpc.who().name;
  }
  if (!request->page_token().empty() && (filter.before = jobIdOf(request->page_token())) == 0)
    return toGrpc(invalidArgument("page_token = \"" + request->page_token().substr(0, 80) + "\": is none of this server", "page_token"));
  if (request->page_size() > 1000) return toGrpc(invalidArgument(strf("page_size = %u: must be at most 1000", request->page_size()), "page_size"));
  const uint32_t page = request->page_size() ? request->page_size() : 50;
  filter.limit = page + 1;
  filter.bytes = kPageBytes;
  auto jobs = core_.durable->store().list(filter);
  if (!jobs.ok()) return toGrpc(jobs.status());
  // The last one only shows that there are more: a page ends by number or by bytes.
  uint64_t bytes = 0;
  for (const v1::Job& job : *jobs) bytes += job.ByteSizeLong();
  const bool more = jobs->size() > page || (jobs->size() > 1 && bytes > kPageBytes);
  for (size_t i = 0; i + more < jobs->size(); ++i) {
    JobRecord record;
    record.job = std::move((*jobs)[i]);
    record.id = jobIdOf(record.job.id());
    record.parts = partsOf(record.job.spec());
    core_.durable->hub().overlay(record);
    *reply->add_jobs() = std::move(record.job);
  }
  if (more) reply->set_next_page_token(reply->jobs(reply->jobs_size() - 1).id());
  return grpc::Status::OK;
}

grpc::Status JobsService::steer(grpc::ServerContext& context, const char* method, const std::string& text, const Steer& what, v1::Job* reply) {
  return serve(core_, context, method, [&](Rpc& rpc) -> grpc::Status {
    ServerCore::Call call(core_);
    if (!call.ok) return rpc.refuseDraining();
    rpc.note("job", text.substr(0, 80));
    auto record = read(rpc, text, false);
    if (!record.ok()) return toGrpc(record.status());
    const Status status = what(*record);
    if (!status.ok()) return toGrpc(status);
    core_.durable->hub().steered();
    record = read(rpc, text, false);
    if (!record.ok()) return toGrpc(record.status());
    *reply = std::move(record->job);
    return grpc::Status::OK;
  });
}

grpc::Status JobsService::Cancel(grpc::ServerContext* c, const v1::CancelJobRequest* r, v1::Job* reply) {
  return steer(
      *c, "cancel", r->id(),
      [&](const JobRecord& record) -> Status {
        GOBO_TRY(core_.durable->store().cancel(record.id));
        core_.durable->files().removeCheckpoints(record.id);
        return {};
      },
      reply);
}
grpc::Status JobsService::Pause(grpc::ServerContext* c, const v1::PauseJobRequest* r, v1::Job* reply) {
  return steer(
      *c, "pause", r->id(), [&](const JobRecord& record) { return core_.durable->store().pause(record.id); }, reply);
}
grpc::Status JobsService::Resume(grpc::ServerContext* c, const v1::ResumeJobRequest* r, v1::Job* reply) {
  return steer(
      *c, "resume", r->id(), [&](const JobRecord& record) { return core_.durable->store().resume(record.id); }, reply);
}
grpc::Status JobsService::Retry(grpc::ServerContext* c, const v1::RetryJobRequest* r, v1::Job* reply) {
  return steer(
      *c, "retry", r->id(),
      [&](const JobRecord& record) -> Status {
        if (record.job.state() != v1::Job::DONE) GOBO_TRY(core_.durable->scenes().keepAgain(record));  // a done one has nothing to render
        return core_.durable->store().retry(record.id);
      },
      reply);
}
grpc::Status JobsService::Prioritize(grpc::ServerContext* c, const v1::PrioritizeJobRequest* r, v1::Job* reply) {
  return steer(
      *c, "prioritize", r->id(),
      [&](const JobRecord& record) -> Status {
        if (r->priority() == v1::JobSpec::PRIORITY_UNSPECIFIED || !v1::JobSpec::Priority_IsValid(r->priority()))
          return invalidArgument(strf("priority = %d: must be LOW, MEDIUM or HIGH", int(r->priority())), "priority");
        return core_.durable->store().prioritize(record.id, r->priority());
      },
      reply);
}

grpc::Status JobsService::Depend(grpc::ServerContext* c, const v1::DependRequest* r, v1::Job* reply) {
  return serve(core_, *c, "depend", [&](Rpc& rpc) -> grpc::Status {
    ServerCore::Call call(core_);
    if (!call.ok) return rpc.refuseDraining();
    rpc.note("job", r->id().substr(0, 80));
    auto record = read(rpc, r->id(), false);
    if (!record.ok()) return toGrpc(record.status());
    const auto needs = readNeeds(rpc, r->after(), "after");
    if (!needs.ok()) return toGrpc(needs.status());
    const Status status = core_.durable->store().depend(record->id, *needs);
    if (!status.ok()) return toGrpc(status);
    core_.durable->hub().queued();  // what waits for nothing any more
    record = read(rpc, r->id(), false);
    if (!record.ok()) return toGrpc(record.status());
    *reply = std::move(record->job);
    return grpc::Status::OK;
  });
}

grpc::Status JobsService::Log(grpc::ServerContext* c, const v1::JobLogRequest* r, v1::JobLogReply* reply) {
  return serve(core_, *c, "job_log", [&](Rpc& rpc) {
    rpc.quiet();
    return toGrpc(log(rpc, *r, reply));
  });
}

Status JobsService::log(const Rpc& rpc, const v1::JobLogRequest& request, v1::JobLogReply* reply) {
  GOBO_ASSIGN(const JobRecord record, read(rpc, request.id(), false));
  if (request.most() > 10000) return invalidArgument(strf("most = %u: must be at most 10000", request.most()), "most");
  if (request.frames_size() > kLogFrames) return invalidArgument(strf("frames: %d frames, at most %d", request.frames_size(), kLogFrames), "frames");
  JobLogFilter filter;
  for (const int64_t frame : request.frames()) {
    if (!jobHasFrame(record.job.spec(), frame)) return invalidArgument(strf("frames: the job has no frame %lld", (long long)frame), "frames");
    filter.frames.push_back(frame);
  }
  filter.after = request.after();
  if (request.most()) filter.most = request.most();
  filter.bytes = kLogBytes;
  GOBO_ASSIGN(const std::vector<v1::JobLogEntry> entries, core_.durable->store().log(record.id, filter));
  reply->mutable_entries()->Add(entries.begin(), entries.end());
  return {};
}

grpc::Status JobsService::Delete(grpc::ServerContext* context, const v1::DeleteJobRequest* request, v1::DeleteJobReply*) {
  return serve(core_, *context, "delete", [&](Rpc& rpc) -> grpc::Status {
    ServerCore::Call call(core_);
    if (!call.ok) return rpc.refuseDraining();
    rpc.note("job", request->id().substr(0, 80));
    auto record = read(rpc, request->id(), false);
    if (!record.ok()) return toGrpc(record.status());
    const Status status = core_.durable->store().remove(record->id);
    if (!status.ok()) return toGrpc(status);
    core_.durable->files().removeResults(record->id);  // a kill in between leaves litter, which the next start sweeps
    core_.durable->hub().steered();
    return grpc::Status::OK;
  });
}

}  // namespace jobs
}  // namespace gobo
