// SPDX-License-Identifier: Apache-2.0
#include "server/render_call.h"

#include <algorithm>
#include <atomic>

#include "server/jobs/crash_marks.h"
#include "server/rest_estimate.h"

namespace gobo {
inline namespace server {

using Clock = std::chrono::steady_clock;

JobClass jobClassOf(v1::Scheduling::Class priority) {
  return priority == v1::Scheduling::INTERACTIVE ? JobClass::Interactive : priority == v1::Scheduling::BATCH ? JobClass::Batch : JobClass::Normal;
}

RenderCall::RenderCall(ServerCore& core, StopSource stop, v1::RenderRequest request, RenderCallOptions options)
    : core_(core), stop_(std::move(stop)), request_(std::move(request)), options_(std::move(options)) {
  thread_ = std::thread([this] { work(); });
}

RenderCall::~RenderCall() {
  cancel();
  thread_.join();
}

void RenderCall::work() {
  const Clock::time_point submitted = Clock::now();
  JobSpec spec;
  spec.client = options_.client;
  spec.group = options_.payer;
  spec.jobClass = jobClassOf(request_.scheduling().priority());
  if (options_.deadline) spec.deadline = std::chrono::duration<double>(options_.deadline->time_since_epoch()).count();  // JobRunner::now()
  Result<PreparedRender> prepared = [&]() -> Result<PreparedRender> {
    if (Submit refusal = core_.jobs.refusal(spec); !refusal.status.ok()) {
      retryAfterMs_ = refusal.retryMs;
      return refusal.status;
    }
    bool full = false;
    const auto place = core_.planning.enter(
        options_.payer, [stop = stop_.token()] { return stop.stopRequested(); }, core_.plansFull(full));
    if (!place && full) {
      retryAfterMs_ = ServerCore::kPlanRetryMs;
      return Status(Code::ResourceExhausted, core_.plansFullText());
    }
    if (!place) return Status(Code::Cancelled, "cancelled while it waited to be planned");
    {
      const std::lock_guard lock(mutex_);
      planning_ = true;
    }
    const CrashMarks::Other other;
    return core_.engine.prepare(request_, nullptr, stop_.token(), options_.access, options_.environmentFile);
  }();
  if (!prepared.ok() && prepared.status().code() == Code::Cancelled && stop_.token().reason() == StopReason::Deadline)
    prepared = Status(Code::DeadlineExceeded, "the deadline passed while planning");
  {
    const std::lock_guard lock(mutex_);
    planned_ = prepared.ok();
    if (!planned_) {
      status_ = prepared.status();
      done_ = true;
      changed_.notify_one();
      return;
    }
  }
  RenderControl control;
  std::atomic<bool> shown{false};
  RestEstimate rest(prepared->resolved.halt(), prepared->expectedMs);
  control.owner = options_.owner;
  control.access = options_.access;
  control.afterwardsMs = options_.encodeMs;
  control.waiting = [this] { return core_.jobs.stats().classes[size_t(JobClass::Interactive)].queued; };
  if (options_.events) {
    control.progress = [this, &rest](const v1::Progress& progress) {
      const std::lock_guard lock(mutex_);
      progress_ = progress;
      progress_->set_eta_ms(rest.rest(progress.elapsed_ms()));
      changed_.notify_one();
    };
    control.snapshot = [this, &shown, &rest](const RenderResult& result) {
      shown = true;
      const std::lock_guard lock(mutex_);
      rest.passDone(result.reply.resolved().halt().spp(), result.reply.total_ms());
      const size_t keep = firstTaken_ ? 0 : 1;
      while (snapshots_.size() > keep) snapshots_.pop_back();
      snapshots_.push_back(result);
      changed_.notify_one();
    };
  }
  spec.pinnedBytes = prepared->pinnedBytes;
  spec.small = prepared->small;
  const v1::Halt& halt = prepared->resolved.halt();
  spec.expected = halt.has_time_s() ? halt.time_s() : halt.has_error() ? 0 : prepared->expectedMs * 1e-3;
  RunControl runControl;
  runControl.gone = [stop = stop_.token()] { return stop.stopRequested(); };
  runControl.pollSeconds = 0.005;
  runControl.admitted = [this](JobId id) {
    const std::lock_guard lock(mutex_);
    job_ = id;
  };
  RunSoFar soFar;
  control.soFar = &soFar;
  std::optional<RenderResult> result;
  const RunReport report = core_.jobs.run(
      spec,
      [&](StopToken stop) -> Status {
        control.stop = stop;
        if (!reply_ && options_.replyBytes && !(reply_ = core_.replies.take(options_.payer, options_.replyBytes))) {
          replyRefused_ = true;
          return Status(Code::ResourceExhausted, "no room for its pictures");
        }
        const CrashMarks::Other other;
        control.ladder = !shown;  // after a preemption nobody wants to see less than before
        auto rendered = core_.engine.run(*prepared, control);
        if (!rendered.ok()) return rendered.status();
        result = std::move(rendered).value();
        return {};
      },
      runControl);
  const std::lock_guard lock(mutex_);
  queueMs_ = report.queuedSeconds * 1e3;
  ranMs_ = report.ranSeconds * 1e3;
  runs_ = report.runs;
  retryAfterMs_ = report.retryMs;
  status_ = report.status;
  if (status_.ok()) {
    result_ = std::move(result);
    result_->reply.set_queue_ms(queueMs_);
    result_->reply.set_total_ms(std::chrono::duration<double, std::milli>(Clock::now() - submitted).count());
  }
  done_ = true;
  changed_.notify_one();
}

std::optional<Place> RenderCall::place() {
  std::unique_lock lock(mutex_);
  if (done_) return std::nullopt;
  if (!job_) return Place{!planning_, 0, 0};
  const JobId id = *job_;
  lock.unlock();
  return core_.jobs.place(id);
}

RenderCall::News RenderCall::wait(std::chrono::milliseconds timeout) {
  std::unique_lock lock(mutex_);
  // In the queue and in a slot the scheduler keeps the deadline.
  if (!planned_ && !done_ && options_.deadline) {
    timeout = std::min(timeout, std::chrono::ceil<std::chrono::milliseconds>(std::max(*options_.deadline - Clock::now(), Clock::duration::zero())));
    if (Clock::now() >= *options_.deadline) stop_.stop(StopReason::Deadline);
    if (timeout.count() == 0) timeout = std::chrono::milliseconds(1);
  }
  changed_.wait_for(lock, timeout, [&] { return done_ || progress_ || !snapshots_.empty(); });
  News news;
  news.progress = std::move(progress_);
  progress_.reset();
  // Once the answer is there only the first snapshot is still worth its transfer.
  if (!snapshots_.empty() && done_ && firstTaken_) snapshots_.clear();
  if (!snapshots_.empty()) {
    news.snapshot = std::move(snapshots_.front());
    snapshots_.pop_front();
    firstTaken_ = true;
    if (done_) snapshots_.clear();
  }
  news.done = done_ && !news.snapshot;
  return news;
}

}  // namespace server
}  // namespace gobo
