// SPDX-License-Identifier: Apache-2.0
#include "server/farm/farm_service.h"

#include <sys/stat.h>

#include <algorithm>

#include "base/utf8.h"
#include "scene/blob.h"
#include "server/farm/messages.h"
#include "server/farm/numeric_class.h"
#include "server/farm/received_file.h"
#include "server/log.h"

namespace gobo::farm {

namespace {

constexpr double kPoll = 0.25;  // seconds: how soon a worker that has gone, a drain, or another daemon's work is noticed

const Status kOff(Code::FailedPrecondition, "this daemon has no jobs, so no frames to give away: set folder in the [jobs] section of its configuration",
                  "jobs.folder");

Status checkInfo(const v1::WorkerInfo& info) {
  const std::string& name = info.name();
  const bool fine = !name.empty() && name.size() <= 64 &&
                    std::all_of(name.begin(), name.end(), [](unsigned char c) { return c < 0x80 && (std::isalnum(c) || c == '.' || c == '_' || c == '-'); });
  if (!fine) return invalidArgument("name = \"" + escaped(name.substr(0, 80)) + "\": must be 1 to 64 letters, digits and ._-", "worker.name");
  const auto other = [](const char* what, const std::string& theirs, const std::string& ours) {
    return Status(Code::FailedPrecondition, std::string("the worker's ") + what + " is \"" + escaped(theirs.substr(0, 200)) + "\", the coordinator's \"" +
                                                ours + "\": their pictures would not have the same bits");
  };
  if (info.build() != buildVersion()) return other("build", info.build(), buildVersion());
  if (info.numeric_class() != numericClass()) return other("numeric class", info.numeric_class(), numericClass());
  return {};
}

/// Bytes that a blob consists of, in messages of a chunk each. False when the worker has gone.
class ChunkWriter {
 public:
  ChunkWriter(Rpc& rpc, grpc::ServerWriter<v1::FarmChunk>& writer) : rpc_(rpc), writer_(writer) {}
  Status add(const void* data, size_t bytes) {
    const auto* p = static_cast<const char*>(data);
    while (bytes > 0) {
      const size_t n = std::min(bytes, kChunkBytes - chunk_.data().size());
      chunk_.mutable_data()->append(p, n);
      p += n;
      bytes -= n;
      if (chunk_.data().size() == kChunkBytes) GOBO_TRY(flush());
    }
    return {};
  }
  Status flush() {
    if (chunk_.data().empty()) return {};
    const IdleWatch::Wait wait(rpc_.core().idle, rpc_.context());
    const bool sent = writer_.Write(chunk_);
    chunk_.mutable_data()->clear();
    return sent ? Status() : Status(Code::Cancelled, "the worker has gone");
  }

 private:
  Rpc& rpc_;
  grpc::ServerWriter<v1::FarmChunk>& writer_;
  v1::FarmChunk chunk_;
};

}  // namespace

FarmService::FarmService(ServerCore& core) : core_(core) {
  core_.metrics.collect([this](MetricsWriter& out) {
    out.family("gobo_farm_workers", "gauge", "Workers elsewhere that attend.");
    out.sample("gobo_farm_workers", {}, book_.attending());
  });
}

template <typename Body>
grpc::Status FarmService::handle(grpc::ServerContext& context, const char* method, Body&& body) {
  return serve(core_, context, method, [&](Rpc& rpc) -> grpc::Status {
    rpc.quiet();
    const grpc::Status allowed = rpc.needWorker(method);
    if (!allowed.ok()) return allowed;
    if (!core_.durable) return toGrpc(kOff);
    return body(rpc);
  });
}

grpc::Status FarmService::Attend(grpc::ServerContext* context, const v1::AttendRequest* request, grpc::ServerWriter<v1::FarmNews>* writer) {
  return handle(*context, "attend", [&](Rpc& rpc) { return attend(rpc, *request, *writer); });
}

grpc::Status FarmService::attend(Rpc& rpc, const v1::AttendRequest& request, grpc::ServerWriter<v1::FarmNews>& writer) {
  const v1::WorkerInfo& info = request.worker();
  if (const Status fine = checkInfo(info); !fine.ok()) return rpc.refuse("worker", fine);
  const uint32_t most = core_.config.farmWorkers;
  const auto id = book_.join(info, peerOf(rpc.context()), most);
  if (!id) return rpc.refuseBusy("worker", strf("%u workers attend: that is the limit (farm.workers)", most), 5000);
  struct Leave {
    WorkerBook& book;
    const v1::WorkerInfo& info;
    const std::string& id;
    ~Leave() {
      book.leave(id);
      logInfo("farm: worker %s (%s) left", info.name().c_str(), id.c_str());
    }
  } leave{book_, info, *id};
  logInfo("farm: worker %s (%s) attends from %s threads=%u", info.name().c_str(), id->c_str(), peerOf(rpc.context()).c_str(), info.threads());
  JobHub& hub = core_.durable->hub();
  v1::FarmNews news;
  news.set_worker(*id);
  news.set_lease_s(core_.config.jobsLeaseSeconds);
  news.set_checkpoint_s(core_.config.jobsCheckpointSeconds);
  JobHub::News seen = hub.news();
  for (bool tell = true;;) {
    news.set_queued(seen.queued);
    news.set_steered(seen.steered);
    if (tell) {
      const IdleWatch::Wait wait(core_.idle, rpc.context());
      if (!writer.Write(news)) return {grpc::StatusCode::CANCELLED, "the worker has gone"};
    }
    const JobHub::News now = hub.waitNews(seen, kPoll);
    if (rpc.context().IsCancelled()) return {grpc::StatusCode::CANCELLED, "the worker has gone"};
    if (core_.draining()) return rpc.refuseDraining();
    tell = now != seen;
    seen = now;
  }
}

grpc::Status FarmService::Claim(grpc::ServerContext* context, const v1::ClaimRequest* request, v1::ClaimReply* reply) {
  return handle(*context, "claim", [&](Rpc& rpc) -> grpc::Status {
    if (core_.draining()) return rpc.refuseDraining();
    return toGrpc(claim(*request, *reply));
  });
}

Status FarmService::claim(const v1::ClaimRequest& request, v1::ClaimReply& reply) {
  const std::string name = book_.nameOf(request.worker());
  if (name.empty()) return {Code::FailedPrecondition, "no worker \"" + escaped(request.worker().substr(0, 40)) + "\" attends", "worker"};
  GOBO_ASSIGN(const auto lease, store().claim(kRemoteHolder + name + "/" + request.worker(), core_.config.jobsLeaseSeconds));
  if (!lease) return {};
  const auto fill = [&]() -> Status {
    GOBO_ASSIGN(JobRecord record, store().get(lease->task.job, false));
    GOBO_ASSIGN(const auto rows, store().checkpoints(lease->task));
    *reply.mutable_lease() = toMessage(*lease);
    *reply.mutable_job() = std::move(record.job);
    reply.set_environment_sha256(record.environmentDigest);
    for (const CheckpointRow& row : rows) *reply.add_checkpoints() = toMessage(row);
    if (record.parts == 0) return {};
    GOBO_ASSIGN(const auto parts, store().parts(lease->task));
    *reply.mutable_parts() = {parts.begin(), parts.end()};
    return {};
  };
  if (const Status status = fill(); !status.ok()) {
    (void)store().release(*lease);  // or it waits until the lease runs out
    reply.Clear();
    return status;
  }
  book_.claimed(request.worker(), *lease);
  core_.durable->hub().changed(lease->task.job);
  return {};
}

grpc::Status FarmService::Hold(grpc::ServerContext* context, const v1::HoldRequest* request, v1::HoldReply* reply) {
  return handle(*context, "hold", [&](Rpc&) -> grpc::Status {
    Lease lease = fromMessage(request->lease());
    const auto state = request->renew() ? store().renew(lease, core_.config.jobsLeaseSeconds) : store().check(lease);
    if (!state.ok()) {
      if (state.status().code() == Code::FailedPrecondition) {
        book_.ended(lease.task, lease.token, WorkerBook::End::Lost);
        core_.durable->hub().clearLive(lease.task);
      }
      return toGrpc(state.status());
    }
    reply->set_state(*state);
    if (request->progress() > 0 && request->progress() <= 1)
      core_.durable->hub().setLive(lease.task, {lease.frame, request->progress(), lease.progress, request->spp(), lease.token});
    return grpc::Status::OK;
  });
}

grpc::Status FarmService::Checkpoint(grpc::ServerContext* context, const v1::CheckpointReport* report, v1::CheckpointReply* reply) {
  return handle(*context, "checkpoint", [&](Rpc&) -> grpc::Status {
    const CheckpointRow row = fromMessage(report->checkpoint());
    if (!isDigest(row.digest, kXxh128Digits)) return toGrpc(invalidArgument("must be 32 lower-case hex digits", "checkpoint.digest"));
    if (!isDigest(row.recipe, kXxh128Digits)) return toGrpc(invalidArgument("must be 32 lower-case hex digits", "checkpoint.recipe"));
    const double progress = report->progress();
    if (!(progress >= 0 && progress <= 1)) return toGrpc(invalidArgument(strf("= %g: must be in 0..1", progress), "progress"));
    const Lease lease = fromMessage(report->lease());
    const std::string path = files().checkpointPath(lease.task, row.digest);
    struct stat info {};
    if (::stat(path.c_str(), &info) != 0 || uint64_t(info.st_size) != row.bytes) return toGrpc(invalidArgument("put the file first", "checkpoint"));
    const auto old = store().checkpoint(lease, row, progress, report->spp());
    if (!old.ok()) {
      if (old.status().code() == Code::FailedPrecondition) files().remove(path);
      return toGrpc(old.status());
    }
    for (const CheckpointRow& o : *old) {
      files().remove(files().checkpointPath(lease.task, o.digest));
      reply->add_replaced(o.digest);
    }
    core_.durable->hub().changed(lease.task.job);
    return grpc::Status::OK;
  });
}

grpc::Status FarmService::Complete(grpc::ServerContext* context, const v1::CompletionReport* report, v1::FarmAck*) {
  return handle(*context, "complete", [&](Rpc&) { return toGrpc(complete(*report)); });
}

Status FarmService::complete(const v1::CompletionReport& report) {
  const Lease lease = fromMessage(report.lease());
  if (!(report.seconds() >= 0 && report.seconds() < 1e12)) return invalidArgument(strf("= %g: must be a time", report.seconds()), "seconds");
  for (const v1::FrameFile& f : report.files()) {
    if (!isDigest(f.sha256(), kSha256Digits)) return invalidArgument("must be 64 lower-case hex digits", "files.sha256");
    struct stat info {};
    if (::stat(files().resultPath(lease.task.job, f.sha256()).c_str(), &info) != 0 || uint64_t(info.st_size) != f.bytes())
      return invalidArgument("file " + f.sha256() + " of output " + escaped(f.output().substr(0, 80)) + " was not put", "files");
  }
  const std::vector<v1::FrameFile> done(report.files().begin(), report.files().end());
  GOBO_ASSIGN(const auto parts, store().parts(lease.task));
  GOBO_TRY(core_.durable->out().deliver(store(), files(), lease, done));
  GOBO_TRY(store().complete(lease, done, report.seconds()));
  for (const v1::FrameFile& part : parts) files().remove(files().resultPath(lease.task.job, part.sha256()));
  files().removeCheckpoints(lease.task);
  book_.ended(lease.task, lease.token, WorkerBook::End::Done);
  core_.durable->hub().clearLive(lease.task);
  core_.durable->hub().changed(lease.task.job);
  return {};
}

grpc::Status FarmService::Fail(grpc::ServerContext* context, const v1::FailureReport* report, v1::FarmAck*) {
  return handle(*context, "fail", [&](Rpc&) -> grpc::Status {
    const Lease lease = fromMessage(report->lease());
    const int code = report->error().code();
    if (code < 1 || code > 16) return toGrpc(invalidArgument(strf("= %d: must be a gRPC status code, 1 to 16", code), "error.code"));
    const Status status = store().fail(lease, {cleanUtf8(Status(Code(code), report->error().message().substr(0, 4096), report->location().substr(0, 1024))),
                                               report->retry(), report->whole_job()});
    if (!status.ok()) return toGrpc(status);
    const auto record = store().get(lease.task.job, false);
    if (!report->retry() || !record.ok() || jobIsOver(record->job.state())) files().removeCheckpoints(lease.task);
    book_.ended(lease.task, lease.token, WorkerBook::End::Failed);
    core_.durable->hub().clearLive(lease.task);
    core_.durable->hub().queued();
    return grpc::Status::OK;
  });
}

grpc::Status FarmService::Release(grpc::ServerContext* context, const v1::ReleaseReport* report, v1::FarmAck*) {
  return handle(*context, "release", [&](Rpc&) -> grpc::Status {
    const Lease lease = fromMessage(report->lease());
    const Status status = store().release(lease);
    if (!status.ok()) return toGrpc(status);
    book_.ended(lease.task, lease.token, WorkerBook::End::Released);
    core_.durable->hub().clearLive(lease.task);
    core_.durable->hub().queued();
    return grpc::Status::OK;
  });
}

grpc::Status FarmService::Put(grpc::ServerContext* context, grpc::ServerReader<v1::PutFarmFileRequest>* reader, v1::FarmAck*) {
  return handle(*context, "put", [&](Rpc& rpc) { return toGrpc(put(rpc, *reader)); });
}

Status FarmService::put(Rpc& rpc, grpc::ServerReader<v1::PutFarmFileRequest>& reader) {
  v1::PutFarmFileRequest message;
  const auto next = [&] {
    const IdleWatch::Wait wait(core_.idle, rpc.context());
    return reader.Read(&message);
  };
  if (!next() || !message.has_begin()) return invalidArgument("the first message must have it", "begin");
  const v1::PutFarmFileRequest::Begin begin = message.begin();
  const Lease lease = fromMessage(begin.lease());
  GOBO_TRY(store().check(lease).status());
  const size_t digits = begin.checkpoint() ? kXxh128Digits : kSha256Digits;
  if (!isDigest(begin.digest(), digits)) return invalidArgument(strf("must be %zu lower-case hex digits", digits), "begin.digest");
  if (const uint64_t most = 4 * core_.live()->imageBytes; begin.bytes() > most)
    return Status(
        Code::OutOfRange,  // of the frame, for good: trying again does not help
        strf("= %llu: a file of a worker has at most %llu bytes (four times limits.image_bytes)", (unsigned long long)begin.bytes(), (unsigned long long)most),
        "begin.bytes");
  ReceivedFile file(begin.digest(), begin.bytes());
  GOBO_TRY(file.begin(files(), begin.checkpoint() ? files().checkpointPath(lease.task, begin.digest()) : files().resultPath(lease.task.job, begin.digest())));
  while (next()) {
    if (message.has_begin()) return invalidArgument("may only be in the first message", "begin");
    GOBO_TRY(file.add(message.data()));
  }
  if (rpc.context().IsCancelled()) return Status(Code::Cancelled, "the worker has gone");
  return file.finish();
}

grpc::Status FarmService::Get(grpc::ServerContext* context, const v1::GetFarmFileRequest* request, grpc::ServerWriter<v1::FarmChunk>* writer) {
  return handle(*context, "get", [&](Rpc& rpc) { return toGrpc(get(rpc, *request, *writer)); });
}

Status FarmService::get(Rpc& rpc, const v1::GetFarmFileRequest& request, grpc::ServerWriter<v1::FarmChunk>& writer) {
  const Lease lease = fromMessage(request.lease());
  GOBO_TRY(store().check(lease).status());
  ServerCore::Call call(core_);
  ChunkWriter out(rpc, writer);
  const BlobSink sink = [&](const void* data, size_t bytes) { return out.add(data, bytes); };
  if (request.file_case() == v1::GetFarmFileRequest::kCheckpoint) {
    if (!isDigest(request.checkpoint(), kXxh128Digits)) return invalidArgument("must be 32 lower-case hex digits", "checkpoint");
    const auto bytes = files().read(files().checkpointPath(lease.task, request.checkpoint()));
    if (!bytes.ok()) return Status(bytes.status().code(), "checkpoint " + request.checkpoint() + " is not here");
    GOBO_TRY(out.add(bytes->data(), bytes->size()));
    return out.flush();
  }
  if (request.file_case() == v1::GetFarmFileRequest::kPart) {
    GOBO_ASSIGN(const auto parts, store().parts(lease.task));
    if (std::none_of(parts.begin(), parts.end(), [&](const v1::FrameFile& f) { return f.sha256() == request.part(); }))
      return notFound("is no part of this frame", "part");
    const auto bytes = files().read(files().resultPath(lease.task.job, request.part()));
    if (!bytes.ok()) return Status(bytes.status().code(), "part " + request.part() + " is not here");
    GOBO_TRY(out.add(bytes->data(), bytes->size()));
    return out.flush();
  }
  GOBO_ASSIGN(const JobRecord record, store().get(lease.task.job, false));
  GOBO_ASSIGN(const TaskScene held, core_.durable->scenes().get(record));  // holds the map's file to its digest, too
  switch (request.file_case()) {
    case v1::GetFarmFileRequest::kScene: GOBO_TRY(writeBlob(*held.scene, sink)); break;
    case v1::GetFarmFileRequest::kEnvironment: {
      GOBO_ASSIGN(const EnvironmentPtr map, core_.durable->scenes().map(record, call.stop.token()));
      if (!map) return notFound("the job has no map", "environment");
      GOBO_TRY(writeBlob(*map, sink));
      break;
    }
    case v1::GetFarmFileRequest::kCheckpoint:
    case v1::GetFarmFileRequest::kPart:
    case v1::GetFarmFileRequest::FILE_NOT_SET: return invalidArgument("must be one of scene, environment, checkpoint, part", "file");
  }
  return out.flush();
}

grpc::Status FarmService::Workers(grpc::ServerContext* context, const v1::WorkersRequest*, v1::WorkersReply* reply) {
  return handle(*context, "workers", [&](Rpc&) -> grpc::Status {
    for (v1::Worker& row : book_.list()) *reply->add_workers() = std::move(row);
    return grpc::Status::OK;
  });
}

}  // namespace gobo::farm
