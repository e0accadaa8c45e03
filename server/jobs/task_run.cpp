// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/task_run.h"

#include <algorithm>
#include <cmath>

#include "server/jobs/frame_parts.h"
#include "server/jobs/job_spec.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {

constexpr double kTick = 0.02;      // seconds between ticks
constexpr double kWriteShare = 20;  // a checkpoint may take a twentieth of the time between two
constexpr double kKeep = 0.1;       // seconds between looks at the lease, at most: it may become shorter while the frame runs

double since(std::chrono::steady_clock::time_point t) { return std::chrono::duration<double>(std::chrono::steady_clock::now() - t).count(); }

std::chrono::steady_clock::time_point in(double seconds) {
  return std::chrono::steady_clock::now() + std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(seconds));
}

/// Faults that no second attempt can mend.
bool permanent(Code code) {
  return code == Code::InvalidArgument || code == Code::NotFound || code == Code::PermissionDenied || code == Code::FailedPrecondition ||
         code == Code::OutOfRange || code == Code::Unimplemented;
}

}  // namespace

void TaskRun::ask(End end) {
  if (end_.load() == End::Lost) return;
  end_.store(end);
  const std::lock_guard lock(mutex_);
  // Preempted: the path tracer parks its state, the last checkpoint. A lost frame's state is nobody's.
  if (inner_) inner_->stop(end == End::Lost ? StopReason::Cancelled : StopReason::Preempted);
}

void TaskRun::steer(const Result<v1::Job::State>& state) {
  if (!state.ok()) {
    if (state.status().code() == Code::FailedPrecondition) ask(End::Lost);
    return;
  }
  if (*state == v1::Job::PAUSED) ask(End::Release);
}

void TaskRun::renewIfDue() {
  const double lasts = w_.leaseSeconds_.load();
  nextRenew_ = std::min(nextRenew_, in(lasts / 3));
  if (Clock::now() < nextRenew_ || end() == End::Lost) return;
  Lease lease = lease_;
  const auto state = w_.store_.renew(lease, lasts);
  if (!state.ok() && state.status().code() != Code::FailedPrecondition)
    logWarn("jobs: cannot renew the lease of %s frame %lld: %s", jobIdText(lease_.task.job).c_str(), (long long)lease_.frame,
            state.status().toString().c_str());
  nextRenew_ = in(lasts * (state.ok() ? 1.0 / 3 : 1.0 / 15));
  steer(state);
}

void TaskRun::flush() {
  if (!checkpoints_->pending() || Clock::now() < flushAfter_ || end() == End::Lost) return;
  const auto start = Clock::now();
  const v1::Halt& halt = record_.job.spec().request().halt();
  const double samples = checkpoints_->samples();
  if (halt.has_spp()) progress_.store(std::max(progress_.load(), std::min(1.0, samples / halt.spp())));
  spp_.store(uint32_t(samples));
  const double progress = progress_.load();
  const Status status = checkpoints_->flush(progress, spp_.load());
  if (status.ok()) {
    storedProgress_ = progress;
    gap_ = std::max(w_.checkpointSeconds_.load(), kWriteShare * since(start));
    w_.hub_.changed(lease_.task.job);
  } else if (status.code() == Code::FailedPrecondition) {
    ask(End::Lost);
  } else {
    logWarn("jobs: checkpoint of %s frame %lld: %s", jobIdText(lease_.task.job).c_str(), (long long)lease_.frame, status.toString().c_str());
    flushAfter_ = in(1);
  }
}

bool TaskRun::tick() {
  if (w_.stopping_.load() && end() == End::None) ask(End::Release);
  if (const uint64_t control = w_.hub_.control(); control != control_) {
    control_ = control;
    steer(w_.store_.check(lease_));
  }
  if (const double asked = w_.checkpointSeconds_.load(); asked != checkpointSeconds_) gap_ = checkpointSeconds_ = asked;
  flush();
  if (const auto active = checkpoints_->activeSince(); active && end() == End::None && !checkpoints_->pending() && inSlot_.load()) {
    // Counted from the start of the node: each run of it gets on by at least one gap, or it would never end.
    if (since(std::max(*active, lastCheckpoint_)) >= gap_.load()) {
      lastCheckpoint_ = Clock::now();
      const std::lock_guard lock(mutex_);
      if (inner_) inner_->stop(StopReason::Preempted);
    }
  }
  if (const double p = progress_.load(); std::abs(p - shown_) >= 0.005) {
    shown_ = p;
    w_.hub_.setLive(lease_.task, {lease_.frame, p, storedProgress_, spp_.load(), lease_.token});
  }
  return end() == End::Lost || (end() == End::Release && !inSlot_.load());
}

Status TaskRun::work(StopToken slot, const PreparedRender& prepared) {
  inSlot_.store(true);
  const CrashMarks::Working working(w_.options_.marks, lease_.task);
  struct Leave {
    std::atomic<bool>& flag;
    ~Leave() { flag.store(false); }
  } leave{inSlot_};
  RenderControl control;
  control.scene = scene_;
  control.checkpoints = checkpoints_.get();
  control.progress = [this](const v1::Progress& p) {
    if (!checkpoints_->activeSince()) return;  // the parts before take little
    double now = progress_.load();
    while (p.fraction() > now && !progress_.compare_exchange_weak(now, p.fraction())) {}
  };
  for (;;) {
    {
      const std::lock_guard lock(mutex_);
      if (end() != End::None) return {Code::Cancelled, "the frame was given back"};
      inner_.emplace(slot);
      control.stop = inner_->token();
    }
    checkpoints_->begin();
    auto rendered = w_.engine_.run(prepared, control);
    {
      const std::lock_guard lock(mutex_);
      inner_.reset();
    }
    if (rendered.ok()) {
      result_ = std::move(rendered).value();
      return {};
    }
    if (rendered.status().code() != Code::Aborted || slot.stopRequested()) return rendered.status();
    if (end() != End::None) return {Code::Cancelled, "the frame was given back"};
    // Stopped for a checkpoint: go on from its state. A node that has left none begins anew, and is to come further before it is stopped again.
    if (!checkpoints_->kept()) gap_.store(2 * gap_.load());
  }
}

Status TaskRun::render(std::vector<EncodedImage>& images) {
  GOBO_ASSIGN(record_, w_.store_.get(lease_.task.job, false));
  place_ = placeOf(lease_.task.index, int64_t(record_.job.frames_total()), record_.parts);
  GOBO_ASSIGN(auto rows, w_.store_.checkpoints(lease_.task));
  checkpoints_ = std::make_unique<TaskCheckpoints>(w_.store_, w_.files_, lease_, std::move(rows));
  if (record_.parts && !place_.part) {
    GOBO_ASSIGN(parts_, w_.store_.parts(lease_.task));
    GOBO_TRY(joinFrame(parts_));
    if (w_.options_.displays) { GOBO_ASSIGN(result_->view, w_.options_.displays->processor(result_->reply.resolved().encoding())); }
  } else {
    v1::RenderRequest request = frameRequest(record_.job.spec(), lease_.frame);
    if (place_.part) *request.mutable_window() = partWindow(record_.job.spec(), *place_.part);
    GOBO_TRY(renderPicture(request));
  }
  if (place_.part) {
    GOBO_ASSIGN(const std::string bytes, writePart(*result_, place_));
    EncodedImage& file = images.emplace_back();
    file.bytes = std::vector<uint8_t>(bytes.begin(), bytes.end());
    file.descriptor.set_output("part");
    file.descriptor.set_format(v1::Encoding::RAW_FLOAT);
    file.descriptor.set_width(result_->reply.resolved().window().width());
    file.descriptor.set_height(result_->reply.resolved().window().height());
    return {};
  }
  GOBO_ASSIGN(images, encodeImages(*result_));
  return {};
}

Status TaskRun::joinFrame(const std::vector<v1::FrameFile>& parts) {
  const v1::RenderRequest whole = frameRequest(record_.job.spec(), lease_.frame);
  // The picture and one part; channels are those of the parts' files.
  uint64_t bytes = 0, largest = 0;
  for (const v1::FrameFile& f : parts) bytes += f.bytes(), largest = std::max(largest, f.bytes());
  return inSlot(bytes + 2 * largest, [&](const StopToken& slot) -> Status {
    FrameJoin join(whole);
    for (size_t i = 0; i < parts.size(); ++i) {
      if (slot.stopRequested() || end() != End::None) return {Code::Cancelled, "the frame was given back"};
      const std::string path = w_.files_.resultPath(lease_.task.job, parts[i].sha256());
      const auto file = w_.files_.read(path);
      if (!file.ok()) return {Code::DataLoss, "a part's file is missing: " + file.status().toString()};
      if (sha256Hex(file->data(), file->size()) != parts[i].sha256()) {
        w_.files_.remove(path);  // or the same part, rendered again, would keep it
        return {Code::DataLoss, "a part's file is damaged: " + path};
      }
      GOBO_TRY(join.add(file->data(), file->size(), {place_.frame, uint32_t(i)}));
      progress_.store(std::max(progress_.load(), (double(record_.parts) + double(i + 1) / double(parts.size())) / (record_.parts + 1)));
    }
    GOBO_ASSIGN(result_, join.finish());
    return {};
  });
}

/// Runs `body` as batch work of the scheduler; again where its queue was full.
Status TaskRun::inSlot(uint64_t bytes, const std::function<Status(StopToken)>& body) {
  JobSpec spec;
  spec.client = record_.job.spec().client();
  spec.jobClass = JobClass::Batch;
  spec.pinnedBytes = bytes;
  RunControl control;
  control.gone = [this] { return tick(); };
  control.pollSeconds = kTick;
  for (;;) {
    const RunReport report = w_.runner_.run(spec, body, control);
    ranSeconds_ = report.ranSeconds;
    if (report.status.code() != Code::ResourceExhausted || report.retryMs <= 0) return report.status;
    // The batch queue is full: not this frame's fault. Wait as others do.
    for (const auto until = in(std::min(report.retryMs * 1e-3, 5.0)); Clock::now() < until && end() == End::None;) {
      tick();
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    if (end() != End::None) return {Code::Cancelled, "the frame was given back"};
  }
}

Status TaskRun::renderPicture(const v1::RenderRequest& request) {
  const auto found = w_.scenes_.get(record_);
  if (!found.ok()) {
    sceneFault_ = true;
    inputFault_ = !w_.options_.delivers;  // a worker elsewhere has them of its coordinator, which may be away
    return found.status();
  }
  scene_ = found->scene;
  const Result<PreparedRender> prepared = [&] {
    const CrashMarks::Working working(w_.options_.marks, lease_.task);
    return w_.engine_.prepare(request, scene_, {}, {}, found->environment);
  }();
  if (!prepared.ok()) return prepared.status();
  return inSlot(prepared->pinnedBytes, [&](StopToken slot) { return work(slot, *prepared); });
}

Status TaskRun::report(const char* what, const std::function<Status()>& attempt) {
  double wait = 0.05;
  for (int n = 1;; ++n) {
    // A lease may end while nobody listens, perhaps by this very report, of which only the answer was lost: it is told once more, so that what it leaves
    // behind is cleared, and then what it says of is another's.
    const bool over = end() == End::Lost;
    const Status status = attempt();
    if (status.ok() || status.code() == Code::FailedPrecondition || status.code() == Code::DataLoss || status.code() == Code::OutOfRange) return status;
    if (over) return {Code::FailedPrecondition, "its lease is over"};
    ++w_.stats_.repeatedReports;
    logWarn("jobs: %s of %s frame %lld, attempt %d: %s", what, jobIdText(lease_.task.job).c_str(), (long long)lease_.frame, n, status.toString().c_str());
    if (w_.stopping_.load() && n >= 5) return status;  // the next daemon goes on from the last checkpoint
    for (const auto until = in(wait); Clock::now() < until && end() != End::Lost && !(w_.stopping_.load() && n >= 5);)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    wait = std::min(5.0, wait * 2);
  }
}

Status TaskRun::deliver(const std::vector<EncodedImage>& images) {
  std::vector<v1::FrameFile> files;
  for (const EncodedImage& image : images) {
    v1::FrameFile& f = files.emplace_back();
    const v1::ImageDescriptor& d = image.descriptor;
    f.set_output(d.output());
    f.set_name(place_.part ? strf("part %u", *place_.part) : resultName(record_.job.spec(), lease_.frame, d.output(), d.format()));
    f.set_bytes(image.bytes.size());
    f.set_sha256(sha256Hex(image.bytes.data(), image.bytes.size()));
    f.set_format(d.format());
    f.set_width(d.width());
    f.set_height(d.height());
  }
  if (w_.options_.delivers) w_.options_.delivers(lease_, files);
  for (size_t i = 0; i < files.size(); ++i) {
    const std::string path = w_.files_.resultPath(lease_.task.job, files[i].sha256());
    GOBO_TRY(report("result file", [&] { return w_.files_.write(path, images[i].bytes.data(), images[i].bytes.size()); }));
  }
  if (w_.options_.out) GOBO_TRY(report("file of job.out", [&] { return w_.options_.out->deliver(w_.store_, w_.files_, lease_, files); }));
  GOBO_TRY(report("completion report", [&] { return w_.store_.complete(lease_, files, ranSeconds_); }));
  for (const v1::FrameFile& part : parts_) w_.files_.remove(w_.files_.resultPath(lease_.task.job, part.sha256()));
  return {};
}

bool TaskRun::run() {
  control_ = w_.hub_.control();
  gap_ = checkpointSeconds_ = w_.checkpointSeconds_.load();
  const double lasts = w_.leaseSeconds_.load();
  nextRenew_ = in(lasts / 3);
  keeper_.start(std::chrono::milliseconds(std::max(int64_t(std::min(lasts / 15, kKeep) * 1e3), int64_t(1))), [this] { renewIfDue(); });
  progress_ = storedProgress_ = lease_.progress;
  w_.hub_.setLive(lease_.task, {lease_.frame, storedProgress_, storedProgress_, 0, lease_.token});
  std::vector<EncodedImage> images;
  Status status = render(images);
  if (status.ok()) status = deliver(images);
  finish(status);
  return !wanting_;
}

void TaskRun::finish(const Status& status) {
  const std::string name = jobIdText(lease_.task.job) + " frame " + std::to_string(lease_.frame) + (place_.part ? strf(" part %u", *place_.part) : "");
  if (checkpoints_) {
    if (end() == End::Release && !status.ok()) flushAfter_ = {}, flush();
    w_.stats_.checkpoints += checkpoints_->written();
    w_.stats_.resumed += checkpoints_->resumed();
  }
  if (status.ok()) {
    checkpoints_->drop();
    ++w_.stats_.frames;
    logInfo("job %s done seconds=%.1f checkpoints=%llu resumed=%llu", name.c_str(), since(begun_), (unsigned long long)checkpoints_->written(),
            (unsigned long long)checkpoints_->resumed());
    return;
  }
  // Asked for, or the daemon's own state.
  const bool transient = status.code() == Code::Cancelled || (status.code() == Code::Unavailable && (!inputFault_ || w_.stopping_.load()));
  if (end() == End::Lost || (!transient && !w_.store_.check(lease_).ok() && w_.store_.check(lease_).status().code() == Code::FailedPrecondition)) {
    ++w_.stats_.lost;
    if (checkpoints_) {
      const auto job = w_.store_.get(lease_.task.job, false);
      if (!job.ok() || jobIsOver(job->job.state())) checkpoints_->drop();  // cancelled: nobody goes on from them
    }
    logInfo("job %s given up: its lease is over", name.c_str());
    (void)w_.store_.release(lease_);  // refused; but the time that it took is its client's, who may have cancelled it
    return;
  }
  Status told;
  if (end() == End::Release || transient) {
    wanting_ = end() != End::Release;
    told = report("release", [&] { return w_.store_.release(lease_); });
    logInfo("job %s released at %.0f %%", name.c_str(), progress_.load() * 100);
  } else {
    const bool retry = !permanent(status.code());
    ++w_.stats_.failures;
    logWarn("job %s failed%s: %s", name.c_str(), retry ? "" : " for good", status.toString().c_str());
    told = report("failure report", [&] { return w_.store_.fail(lease_, {status, retry, sceneFault_ && !retry}); });
    const auto job = w_.store_.get(lease_.task.job, false);
    if (checkpoints_ && (!retry || !job.ok() || jobIsOver(job->job.state()))) checkpoints_->drop();
  }
  if (!told.ok()) logWarn("job %s: %s", name.c_str(), told.toString().c_str());
}

}  // namespace jobs
}  // namespace gobo
