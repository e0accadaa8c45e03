// SPDX-License-Identifier: Apache-2.0
#include "server/farm/remote_tasks.h"

#include <algorithm>
#include <chrono>
#include <set>

#include "server/farm/messages.h"
#include "server/farm/received_file.h"
#include "server/jobs/frame_parts.h"
#include "server/log.h"

namespace gobo::farm {

namespace {

constexpr double kCallSeconds = 30, kFileSeconds = 3600;

}  // namespace

void FarmLink::prepare(grpc::ClientContext& context, double seconds) const {
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(int64_t(seconds * 1e3)));
  if (!token.empty()) context.AddMetadata("authorization", "Bearer " + token);
}

Result<JobRecord> RemoteTasks::get(int64_t id, bool) {
  const std::lock_guard lock(mutex_);
  const auto at = jobs_.find(id);
  if (at == jobs_.end()) return notFound("no frame of " + std::to_string(id) + " is held here");
  return at->second;
}

Result<std::optional<Lease>> RemoteTasks::claim(const std::string& holder, double leaseSeconds) {
  v1::ClaimRequest request;
  request.set_worker(link_.id());
  if (request.worker().empty()) return std::optional<Lease>();  // whoever attends says why not
  grpc::ClientContext context;
  link_.prepare(context, kCallSeconds);
  v1::ClaimReply reply;
  if (const Status status = fromGrpc(link_.stub->Claim(&context, request, &reply)); !status.ok()) {
    if (status.code() == Code::Unavailable || status.code() == Code::FailedPrecondition) return std::optional<Lease>();
    return status;
  }
  if (!reply.has_lease()) return std::optional<Lease>();
  Lease lease = fromMessage(reply.lease());
  lease.holder = holder;
  Claimed claimed;
  claimed.lease = lease;
  for (const v1::FrameFile& part : reply.parts())
    if (isDigest(part.sha256(), kSha256Digits)) claimed.parts.push_back(part);
  const bool late = [&] {
    const std::lock_guard lock(mutex_);
    const auto at = claimed_.find(lease.task);
    if (at != claimed_.end() && at->second.lease.token > lease.token) return true;
    claimed_[lease.task] = claimed;  // with its parts: whoever delivers one of them just now leaves the file here
    JobRecord& record = jobs_[lease.task.job];
    record.id = lease.task.job;
    record.job = std::move(*reply.mutable_job());
    record.environmentDigest = reply.environment_sha256();
    record.parts = partsOf(record.job.spec());
    return false;
  }();
  if (late) {  // another slot has claimed it anew since this answer was sent
    (void)release(lease);
    return std::optional<Lease>();
  }
  // Files of a large frame may take longer than the lease lasts.
  auto renewed = std::chrono::steady_clock::now();
  const auto keep = [&] {
    const auto now = std::chrono::steady_clock::now();
    if (now - renewed < std::chrono::duration<double>(leaseSeconds / 3)) return;
    renewed = now;
    (void)hold(lease, true);
  };
  for (const v1::FrameFile& part : claimed.parts) {
    v1::GetFarmFileRequest wanted;
    wanted.set_part(part.sha256());
    const Status status = fetch(lease, wanted, files_.resultPath(lease.task.job, part.sha256()), keep);
    if (!status.ok()) logWarn("farm: part %s cannot be fetched: %s", part.sha256().c_str(), status.toString().c_str());
    // What the coordinator does not have is missed when the frame is put together, and rendered again; all else passes.
    if (!status.ok() && status.code() != Code::NotFound && status.code() != Code::DataLoss) {
      (void)release(lease);
      forget(lease, claimed.parts);  // whatever became of that: no frame runs here
      return std::optional<Lease>();
    }
  }
  for (const v1::CheckpointInfo& info : reply.checkpoints()) {
    if (!isDigest(info.digest(), kXxh128Digits)) continue;
    v1::GetFarmFileRequest wanted;
    wanted.set_checkpoint(info.digest());
    const std::string path = files_.checkpointPath(lease.task, info.digest());
    // One that does not come counts as not there: the frame starts anew.
    if (const Status status = fetch(lease, wanted, path, keep); !status.ok())
      logWarn("farm: checkpoint %s cannot be fetched: %s", info.digest().c_str(), status.toString().c_str());
    claimed.checkpoints.push_back(fromMessage(info));
  }
  {
    const std::lock_guard lock(mutex_);
    const auto at = claimed_.find(lease.task);
    if (at != claimed_.end() && at->second.lease.token == lease.token) {
      at->second = claimed;
      return std::optional<Lease>(lease);
    }
  }
  forget(lease, claimed.parts);  // it ended meanwhile, and files came after that
  return std::optional<Lease>();
}

Result<std::vector<CheckpointRow>> RemoteTasks::checkpoints(TaskId task) {
  const std::lock_guard lock(mutex_);
  const auto at = claimed_.find(task);
  return at == claimed_.end() ? std::vector<CheckpointRow>() : at->second.checkpoints;
}

Result<std::vector<v1::FrameFile>> RemoteTasks::parts(TaskId task) {
  const std::lock_guard lock(mutex_);
  const auto at = claimed_.find(task);
  return at == claimed_.end() ? std::vector<v1::FrameFile>() : at->second.parts;
}

Result<v1::Job::State> RemoteTasks::hold(const Lease& lease, bool renew) {
  v1::HoldRequest request;
  *request.mutable_lease() = toMessage(lease);
  request.set_renew(renew);
  const auto live = hub_.live(lease.task.job);
  if (const auto at = live.find(lease.task); at != live.end()) {
    request.set_progress(at->second.progress);
    request.set_spp(at->second.spp);
  }
  grpc::ClientContext context;
  link_.prepare(context, kCallSeconds);
  v1::HoldReply reply;
  GOBO_TRY(ended(lease, fromGrpc(link_.stub->Hold(&context, request, &reply)), false));
  return reply.state();
}

void RemoteTasks::delivers(const Lease& lease, const std::vector<v1::FrameFile>& files) {
  const std::lock_guard lock(mutex_);
  const auto at = claimed_.find(lease.task);
  if (at != claimed_.end() && at->second.lease.token == lease.token) at->second.files = files;  // else it is over: its report will be refused
}

void RemoteTasks::tellProgress() {
  std::vector<Lease> changed;
  {
    const std::lock_guard lock(mutex_);
    for (auto& [task, claimed] : claimed_) {
      const auto live = hub_.live(task.job);
      const auto at = live.find(task);
      if (at == live.end() || at->second.progress - claimed.told < 0.005) continue;
      claimed.told = at->second.progress;
      changed.push_back(claimed.lease);
    }
  }
  for (const Lease& lease : changed) (void)hold(lease, false);
}

Status RemoteTasks::put(const Lease& lease, bool checkpoint, const std::string& digest, const std::string& path) {
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, files_.read(path));
  grpc::ClientContext context;
  link_.prepare(context, kFileSeconds);
  v1::FarmAck ack;
  const auto writer = link_.stub->Put(&context, &ack);
  v1::PutFarmFileRequest message;
  v1::PutFarmFileRequest::Begin& begin = *message.mutable_begin();
  *begin.mutable_lease() = toMessage(lease);
  begin.set_checkpoint(checkpoint);
  begin.set_digest(digest);
  begin.set_bytes(bytes.size());
  bool taken = writer->Write(message);
  for (size_t at = 0; taken && at < bytes.size(); at += kChunkBytes) {
    message.set_data(bytes.data() + at, std::min(kChunkBytes, bytes.size() - at));
    taken = writer->Write(message);
  }
  writer->WritesDone();
  return fromGrpc(writer->Finish());  // also where it took no more: it says why
}

Status RemoteTasks::fetch(int64_t job, const v1::GetFarmFileRequest& request, const std::string& path) {
  std::vector<Lease> held;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [task, claimed] : claimed_)
      if (task.job == job) held.push_back(claimed.lease);
  }
  // The last first: an earlier one may be over without anybody here knowing. But each may end before the coordinator reads its name.
  std::sort(held.begin(), held.end(), [](const Lease& a, const Lease& b) { return a.token > b.token; });
  Status status = notFound("no frame of job " + std::to_string(job) + " is held here");
  for (const Lease& lease : held) {
    status = fetch(lease, request, path);
    if (status.code() != Code::FailedPrecondition) break;
  }
  return status;
}

Status RemoteTasks::fetch(const Lease& lease, v1::GetFarmFileRequest request, const std::string& path, const std::function<void()>& meanwhile) {
  *request.mutable_lease() = toMessage(lease);
  grpc::ClientContext context;
  link_.prepare(context, kFileSeconds);
  const auto reader = link_.stub->Get(&context, request);
  JobFiles::Incoming file;
  Status status = file.begin(files_, path);
  v1::FarmChunk chunk;
  while (status.ok() && reader->Read(&chunk)) {
    status = file.add(chunk.data().data(), chunk.data().size());
    if (meanwhile) meanwhile();
  }
  if (!status.ok()) context.TryCancel();
  const Status end = fromGrpc(reader->Finish());
  if (!status.ok()) return status;
  GOBO_TRY(end);
  return file.commit();
}

Result<std::vector<CheckpointRow>> RemoteTasks::checkpoint(const Lease& lease, const CheckpointRow& row, double progress, uint32_t spp) {
  GOBO_TRY(ended(lease, put(lease, true, row.digest, files_.checkpointPath(lease.task, row.digest)), false));
  v1::CheckpointReport report;
  *report.mutable_lease() = toMessage(lease);
  *report.mutable_checkpoint() = toMessage(row);
  report.set_progress(std::clamp(progress, 0.0, 1.0));
  report.set_spp(spp);
  grpc::ClientContext context;
  link_.prepare(context, kCallSeconds);
  v1::CheckpointReply reply;
  GOBO_TRY(ended(lease, fromGrpc(link_.stub->Checkpoint(&context, report, &reply)), false));
  std::vector<CheckpointRow> old;
  for (const std::string& digest : reply.replaced())
    if (isDigest(digest, kXxh128Digits)) old.push_back({"", digest, 0, 0});
  return old;
}

Status RemoteTasks::complete(const Lease& lease, const std::vector<v1::FrameFile>& files, double seconds) {
  v1::CompletionReport report;
  *report.mutable_lease() = toMessage(lease);
  report.set_seconds(seconds);
  bool unsent = false;
  for (const v1::FrameFile& f : files) {
    // Refused as over, and the file forgotten here for that: perhaps because an earlier report of this completion arrived and only its answer did not.
    // Then it is taken again.
    const Status sent = put(lease, false, f.sha256(), files_.resultPath(lease.task.job, f.sha256()));
    if (!sent.ok() && sent.code() != Code::FailedPrecondition && sent.code() != Code::NotFound) return sent;
    unsent = unsent || !sent.ok();
    *report.add_files() = f;
  }
  grpc::ClientContext context;
  link_.prepare(context, kCallSeconds);
  v1::FarmAck ack;
  Status answer = fromGrpc(link_.stub->Complete(&context, report, &ack));
  if (unsent && answer.code() == Code::InvalidArgument) {  // it does not have them either: no repetition of this report changes that
    const auto state = hold(lease, false);
    answer = state.ok() ? Status(Code::DataLoss, "a file of the frame has gone before it was sent") : state.status();
  }
  return ended(lease, answer, true, files);
}

Status RemoteTasks::fail(const Lease& lease, const FailedReport& failed) {
  v1::FailureReport report;
  *report.mutable_lease() = toMessage(lease);
  report.mutable_error()->set_code(int(failed.reason.code()));
  report.mutable_error()->set_message(failed.reason.message());
  report.set_location(failed.reason.location());
  report.set_retry(failed.retry);
  report.set_whole_job(failed.wholeJob);
  grpc::ClientContext context;
  link_.prepare(context, kCallSeconds);
  v1::FarmAck ack;
  return ended(lease, fromGrpc(link_.stub->Fail(&context, report, &ack)));
}

Status RemoteTasks::release(const Lease& lease) {
  v1::ReleaseReport report;
  *report.mutable_lease() = toMessage(lease);
  grpc::ClientContext context;
  link_.prepare(context, kCallSeconds);
  v1::FarmAck ack;
  return ended(lease, fromGrpc(link_.stub->Release(&context, report, &ack)));
}

/// A report that was taken, or refused because the lease is over: what lies here of the frame was only on its way.
Status RemoteTasks::ended(const Lease& lease, const Status& answer, bool taken, const std::vector<v1::FrameFile>& files) {
  if (answer.ok() ? taken : answer.code() == Code::FailedPrecondition) forget(lease, files);
  return answer;
}

/// `files`: what it may have left among the results, also where it was forgotten before.
void RemoteTasks::forget(const Lease& lease, const std::vector<v1::FrameFile>& files) {
  // All under one lock: whoever claims the task anew, or a frame that needs one of the files, is there before, or fetches them after.
  const std::lock_guard lock(mutex_);
  std::set<std::string> left, used;
  for (const v1::FrameFile& f : files) left.insert(f.sha256());
  const auto at = claimed_.find(lease.task);
  if (at == claimed_.end() || at->second.lease.token == lease.token) files_.removeCheckpoints(lease.task);
  if (at != claimed_.end() && at->second.lease.token == lease.token) {
    for (const auto* own : {&at->second.parts, &at->second.files})
      for (const v1::FrameFile& f : *own) left.insert(f.sha256());
    claimed_.erase(at);
  }
  bool more = false;
  for (const auto& [task, claimed] : claimed_) {
    if (task.job != lease.task.job) continue;
    more = true;
    for (const auto* needed : {&claimed.parts, &claimed.files})
      for (const v1::FrameFile& f : *needed) used.insert(f.sha256());
  }
  if (!more) {
    jobs_.erase(lease.task.job);
    files_.removeResults(lease.task.job);
    return;
  }
  for (const std::string& digest : left)
    if (!used.count(digest)) files_.remove(files_.resultPath(lease.task.job, digest));
}

}  // namespace gobo::farm
