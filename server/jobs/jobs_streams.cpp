// SPDX-License-Identifier: Apache-2.0
// Jobs.Watch and Jobs.Fetch: both read the store again whenever something changed, so they miss nothing that is durable and need
// no state of their own. They do not hold up a drain: they end with UNAVAILABLE.
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <optional>
#include <set>

#include "base/descriptor.h"
#include "server/jobs/jobs_service.h"
#include "server/jobs/out_pattern.h"
#include "server/log.h"
#include "server/rpc.h"

namespace gobo {
inline namespace jobs {

namespace {

constexpr double kStreamPoll = 0.25;  // seconds: how soon a client that has gone, a drain, or another daemon's work is noticed

/// A place among the streams that live as long as their client likes.
std::unique_ptr<SharedLimit::Hold> place(const Rpc& rpc) { return rpc.core().watches.take(rpc.who().name, 1); }

grpc::Status noPlace(Rpc& rpc) { return rpc.refuseFull("watches", "Watch and Fetch calls run", rpc.core().watches, "limits.watches", 1000); }

template <typename Message>
bool send(Rpc& rpc, grpc::ServerWriter<Message>& writer, const Message& message) {
  const IdleWatch::Wait wait(rpc.core().idle, rpc.context());
  return writer.Write(message);
}

v1::JobEvent eventOf(const v1::Job& job, const v1::Frame* frame) {
  v1::JobEvent event;
  *event.mutable_job() = job;
  event.mutable_job()->clear_frames();
  event.mutable_job()->clear_spec();
  if (frame) *event.mutable_frame() = *frame;
  return event;
}

}  // namespace

grpc::Status JobsService::Watch(grpc::ServerContext* context, const v1::WatchJobRequest* request, grpc::ServerWriter<v1::JobEvent>* writer) {
  return serve(core_, *context, "watch", [&](Rpc& rpc) {
    rpc.quiet();
    return watch(rpc, *request, *writer);
  });
}

grpc::Status JobsService::Fetch(grpc::ServerContext* context, const v1::FetchRequest* request, grpc::ServerWriter<v1::FetchReply>* writer) {
  return serve(core_, *context, "fetch", [&](Rpc& rpc) { return fetch(rpc, *request, *writer); });
}

grpc::Status JobsService::watch(Rpc& rpc, const v1::WatchJobRequest& sent, grpc::ServerWriter<v1::JobEvent>& to) {
  grpc::ServerContext* context = &rpc.context();
  const v1::WatchJobRequest* request = &sent;
  grpc::ServerWriter<v1::JobEvent>* writer = &to;
  const auto held = place(rpc);
  if (!held) return noPlace(rpc);
  auto record = read(rpc, request->id(), true);
  if (!record.ok()) return toGrpc(record.status());
  JobHub& hub = core_.durable->hub();
  JobHub::Watch watched(hub, record->id);
  uint64_t revision = record->revision;
  v1::JobEvent first;
  *first.mutable_job() = record->job;
  if (!send(rpc, *writer, first)) return {grpc::StatusCode::CANCELLED, "the client has gone"};
  std::string shown = eventOf(record->job, nullptr).SerializeAsString();
  std::map<TaskId, double> progress;  // of live frames, as sent
  std::optional<uint64_t> look;       // of the store, at `known`
  JobRecord known;                    // without frames
  v1::Job::State state = record->job.state();
  while (!jobIsOver(state)) {
    const bool told_now = watched.wait(kStreamPoll);
    if (context->IsCancelled()) return {grpc::StatusCode::CANCELLED, "the client has gone"};
    if (core_.draining()) return rpc.refuseDraining();
    const uint64_t next = core_.durable->looks().number(hub.version());
    if (next == look && !told_now) continue;
    Result<JobRecord> news = known;
    if (next != look) {
      news = core_.durable->store().changes(record->id, revision);
      if (!news.ok()) return toGrpc(news.status());
      look = next;
      known = *news;
      known.job.clear_frames();
    }
    hub.overlay(*news);
    revision = news->revision;
    state = news->job.state();
    std::set<int64_t> told;
    bool gone = false;
    for (const v1::Frame& frame : news->job.frames()) {
      told.insert(frame.frame());
      gone = gone || !send(rpc, *writer, eventOf(news->job, &frame));
    }
    for (const auto& [task, live] : hub.live(record->id)) {
      const bool part = task.index >= int64_t(news->job.frames_total());  // shows in the job's progress; its frame changes when it is done
      if (part || told.count(live.frame) || jobIsOver(state) || live.progress - progress[task] < 0.005) continue;
      progress[task] = live.progress;
      v1::Frame frame;
      frame.set_frame(live.frame);
      frame.set_state(v1::Frame::RUNNING);
      frame.set_progress(live.progress);
      frame.set_spp(live.spp);
      gone = gone || !send(rpc, *writer, eventOf(news->job, &frame));
      told.insert(live.frame);
    }
    const std::string now = eventOf(news->job, nullptr).SerializeAsString();
    // The last event is the one in which the job is over.
    if (now != shown && (told.empty() || jobIsOver(state))) gone = gone || !send(rpc, *writer, eventOf(news->job, nullptr));
    shown = now;
    if (gone) return {grpc::StatusCode::CANCELLED, "the client has gone"};
  }
  return grpc::Status::OK;
}

Status JobsService::sendFile(Rpc& rpc, grpc::ServerWriter<v1::FetchReply>& writer, int64_t job, const v1::Frame& frame, const v1::FrameFile& file,
                             uint64_t offset) {
  if (offset > file.bytes())
    return {Code::OutOfRange, strf("offset = %llu: %s has %llu bytes", (unsigned long long)offset, file.name().c_str(), (unsigned long long)file.bytes()),
            "offset"};
  const std::string path = core_.durable->files().resultPath(job, file.sha256());
  const Descriptor d{::open(path.c_str(), O_RDONLY | O_CLOEXEC)};
  if (!d) return {Code::DataLoss, "cannot read " + path + ": " + std::strerror(errno)};
  const Status left(Code::Cancelled, "the client has gone");
  v1::FetchReply reply;
  v1::FetchedFile& head = *reply.mutable_file();
  head.set_frame(frame.frame());
  *head.mutable_file() = file;
  head.set_offset(offset);
  if (!send(rpc, writer, reply)) return left;
  while (offset < file.bytes()) {
    v1::FetchedChunk& chunk = *reply.mutable_chunk();
    chunk.set_offset(offset);
    std::string& data = *chunk.mutable_data();
    data.resize(size_t(std::min<uint64_t>(core_.live()->chunkBytes, file.bytes() - offset)));
    const ssize_t n = ::pread(d.get(), data.data(), data.size(), off_t(offset));
    if (n <= 0) return {Code::DataLoss, path + " ends early: " + (n < 0 ? std::strerror(errno) : "damaged")};
    data.resize(size_t(n));
    offset += uint64_t(n);
    if (rpc.context().IsCancelled() || !send(rpc, writer, reply)) return left;
  }
  return {};
}

grpc::Status JobsService::fetch(Rpc& rpc, const v1::FetchRequest& sent, grpc::ServerWriter<v1::FetchReply>& to) {
  grpc::ServerContext* context = &rpc.context();
  const v1::FetchRequest* request = &sent;
  grpc::ServerWriter<v1::FetchReply>* writer = &to;
  rpc.note("job", request->id().substr(0, 80));
  const auto held = place(rpc);
  if (!held) return noPlace(rpc);
  auto record = read(rpc, request->id(), true);
  if (!record.ok()) return toGrpc(record.status());
  std::set<int64_t> wanted(request->frames().begin(), request->frames().end());
  const std::set<std::string> outputs(request->outputs().begin(), request->outputs().end());
  std::set<int64_t> known;
  for (const v1::Frame& f : record->job.frames()) known.insert(f.frame());
  for (const int64_t frame : wanted)
    if (!known.count(frame)) return toGrpc(invalidArgument(strf("frames: the job has no frame %lld", (long long)frame), "frames"));
  for (const std::string& output : outputs) {
    const std::vector<std::string> all = outputsInFiles(record->job.spec());
    const std::string where = all == std::vector<std::string>{"layers"} ? ": its files are 'layers'" : "";
    if (std::find(all.begin(), all.end(), output) == all.end())
      return toGrpc(invalidArgument("outputs: the job has no output '" + output + "'" + where, "outputs"));
  }
  if (record->job.results_expired())
    return toGrpc({Code::NotFound, "the results of " + request->id() + " were removed by the daemon's limits (jobs.keep_bytes, jobs.keep_days)", "id"});
  if (wanted.empty()) wanted = known;
  uint64_t offset = request->offset();
  JobHub& hub = core_.durable->hub();
  JobHub::Watch watched(hub, record->id);
  std::optional<uint64_t> look;  // of the store, at `record`
  // Ascending by frame, always: a later frame that is finished already waits for its turn.
  for (int at = 0; at < record->job.frames_size();) {
    const v1::Frame& frame = record->job.frames(at);
    const bool open = frame.state() == v1::Frame::QUEUED || frame.state() == v1::Frame::RUNNING;
    if (!wanted.count(frame.frame()) || (frame.state() != v1::Frame::DONE && !(open && request->follow()))) {
      ++at;
      continue;
    }
    if (frame.state() == v1::Frame::DONE) {
      for (const v1::FrameFile& file : frame.files()) {
        if (!outputs.empty() && !outputs.count(file.output())) continue;
        const Status status = sendFile(rpc, *writer, record->id, frame, file, std::exchange(offset, 0));
        if (!status.ok()) return toGrpc(status);
      }
      ++at;
      continue;
    }
    watched.wait(kStreamPoll);
    if (context->IsCancelled()) return {grpc::StatusCode::CANCELLED, "the client has gone"};
    if (core_.draining()) return rpc.refuseDraining();
    const uint64_t next = core_.durable->looks().number(hub.version());
    if (next == look) continue;
    auto news = core_.durable->store().changes(record->id, record->revision);
    if (!news.ok()) return toGrpc(news.status());
    look = next;
    record->revision = news->revision;
    std::map<int64_t, const v1::Frame*> changed;
    for (const v1::Frame& f : news->job.frames()) changed[f.frame()] = &f;
    for (v1::Frame& f : *record->job.mutable_frames())
      if (const auto it = changed.find(f.frame()); it != changed.end()) f = *it->second;
  }
  return grpc::Status::OK;
}

}  // namespace jobs
}  // namespace gobo
