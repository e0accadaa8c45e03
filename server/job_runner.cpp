// SPDX-License-Identifier: Apache-2.0
#include "server/job_runner.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>

#include "base/check.h"

namespace gobo {
inline namespace server {

double JobRunner::now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

JobRunner::JobRunner(const SchedulerOptions& options) : scheduler_(options) {
  workers_.resize(size_t(options.slots));
  for (WorkerState& w : workers_) w.seconds = now();
  for (size_t i = 0; i < workers_.size() + size_t(options.beside); ++i) threads_.emplace_back([this, i] { slotLoop(i); });
  threads_.emplace_back([this] { timerLoop(); });
}

JobRunner::~JobRunner() {
  drain(0);
  {
    std::lock_guard hold(mutex_);
    closing_ = true;
  }
  ready_.notify_all();
  readyBeside_.notify_all();
  timer_.notify_all();
  for (auto& t : threads_) t.join();
}

void JobRunner::finish(Job& job, Status status) {
  job.report.status = std::move(status);
  job.over = true;
  job.done.notify_all();
}

void JobRunner::pump() {
  const double time = now();
  for (const Action& a : scheduler_.decide(time)) {
    const auto at = jobs_.find(a.id);
    GOBO_CHECK(at != jobs_.end());
    Job& job = *at->second;
    switch (a.kind) {
      case Action::Kind::Start:
        job.report.queuedSeconds += time - job.since;
        job.since = time;
        job.stop = StopSource();
        (a.beside ? startingBeside_ : starting_).push_back(a.id);
        (a.beside ? readyBeside_ : ready_).notify_one();
        break;
      case Action::Kind::Preempt:
      case Action::Kind::Stop: job.stop.stop(a.reason); break;
      case Action::Kind::Expire:
        job.report.queuedSeconds += time - job.since;
        finish(job, {Code::DeadlineExceeded, "the deadline passed in the queue"});
        jobs_.erase(at);
    }
  }
  if (jobs_.empty()) empty_.notify_all();
  timer_.notify_one();  // the next event may be an earlier one
}

RunReport JobRunner::run(const JobSpec& spec, Work work, const RunControl& control) {
  const auto job = std::make_shared<Job>();
  job->work = std::move(work);
  job->spec = spec;
  std::unique_lock hold(mutex_);
  if (draining_) {
    job->report.status = {Code::Unavailable, "the server is shutting down"};
    return job->report;
  }
  job->since = now();
  const Submit submit = scheduler_.submit(spec, job->since);
  if (!submit.status.ok()) {
    job->report.status = submit.status;
    job->report.retryMs = submit.retryMs;
    return job->report;
  }
  jobs_[submit.id] = job;
  if (control.admitted) {
    hold.unlock();  // it may call cancel()
    control.admitted(submit.id);
    hold.lock();
  }
  pump();
  while (!job->over) {
    if (!control.gone) {
      job->done.wait(hold);
      continue;
    }
    job->done.wait_for(hold, std::chrono::duration<double>(control.pollSeconds));
    if (job->over) break;
    hold.unlock();
    const bool left = control.gone();
    if (left) cancel(submit.id);
    hold.lock();
    if (left) job->done.wait(hold, [&] { return job->over; });
  }
  return job->report;
}

bool JobRunner::cancel(JobId id) {
  std::lock_guard hold(mutex_);
  const auto at = jobs_.find(id);
  if (at == jobs_.end()) return false;
  const CancelResult result = scheduler_.cancel(id, now());
  if (result == CancelResult::Unknown) return false;  // its work has ended, its caller is about to be told
  if (result == CancelResult::Removed) {
    Job& job = *at->second;
    job.report.queuedSeconds += now() - job.since;
    finish(job, {Code::Cancelled, "cancelled in the queue"});
    jobs_.erase(at);
  }
  pump();  // carries the Stop to the token
  return true;
}

namespace {

JobId takeFirst(std::vector<JobId>& ids) {
  const JobId id = ids.front();
  ids.erase(ids.begin());
  return id;
}

}  // namespace

void JobRunner::slotLoop(size_t slot) {
  std::unique_lock hold(mutex_);
  const bool beside = slot >= workers_.size();
  std::vector<JobId>& starting = beside ? startingBeside_ : starting_;
  for (;;) {
    (beside ? readyBeside_ : ready_).wait(hold, [&] { return closing_ || !starting.empty(); });
    if (starting.empty()) return;
    const JobId id = takeFirst(starting);
    const std::shared_ptr<Job> job = jobs_.at(id);
    const StopToken token = job->stop.token();
    const bool stopped = token.stopRequested();  // between the decision and now
    job->report.runs += !stopped;
    if (!beside) workers_[slot] = {true, id, job->spec.client, job->spec.jobClass, now()};
    hold.unlock();
    Status status(Code::Aborted, "stopped");
    try {
      if (!stopped) status = job->work(token);
    } catch (const std::exception& e) { status = internalError(std::string("exception in a job: ") + e.what()); } catch (...) {
      status = internalError("exception of unknown kind in a job");
    }
    hold.lock();
    const double time = now();
    job->report.ranSeconds += time - job->since;
    job->since = time;
    if (!beside) workers_[slot] = {false, 0, {}, JobClass::Normal, time};
    if (status.code() == Code::Aborted && token.reason() == StopReason::Preempted) {
      if (scheduler_.preempted(id, time)) {
        pump();
        continue;
      }
      // Gave way when its deadline came: nobody will call it again.
      status = {Code::DeadlineExceeded, "the deadline passed"};
    } else {
      scheduler_.finished(id, time, status.ok() ? Outcome::Done : Outcome::Failed);
      if (status.code() == Code::Aborted && token.reason() == StopReason::Cancelled) status = {Code::Cancelled, "cancelled"};
      if (status.code() == Code::Aborted && token.reason() == StopReason::Deadline) status = {Code::DeadlineExceeded, "the deadline passed"};
    }
    hold.unlock();
    job->work = nullptr;  // what it captured goes before the caller goes on, and not under the lock
    hold.lock();
    finish(*job, std::move(status));
    jobs_.erase(id);
    pump();
  }
}

void JobRunner::timerLoop() {
  std::unique_lock hold(mutex_);
  while (!closing_) {
    const auto next = scheduler_.nextEvent(now());
    if (!next) {
      timer_.wait(hold);
      continue;
    }
    // Capped: far deadlines must not overflow the clock's arithmetic. The 0.1 ms make sure that its time has come on waking.
    const double wait = std::min(*next - now(), 3600.0);
    if (wait > 0) timer_.wait_for(hold, std::chrono::duration<double>(wait + 1e-4));
    if (const auto due = scheduler_.nextEvent(now()); due && *due <= now() && !closing_) pump();
  }
}

void JobRunner::drain(double seconds) {
  std::unique_lock hold(mutex_);
  draining_ = true;
  if (seconds > 0) empty_.wait_for(hold, std::chrono::duration<double>(seconds), [&] { return jobs_.empty(); });
  std::vector<JobId> left;
  for (const auto& [id, job] : jobs_) left.push_back(id);
  hold.unlock();
  // The latest first: one that waits must not be started by the end of one before it.
  for (auto id = left.rbegin(); id != left.rend(); ++id) cancel(*id);
  hold.lock();
  empty_.wait(hold, [&] { return jobs_.empty(); });
}

std::vector<WorkerState> JobRunner::workers() const {
  const std::lock_guard hold(mutex_);
  std::vector<WorkerState> out = workers_;
  for (WorkerState& w : out) w.seconds = now() - w.seconds;
  return out;
}

std::optional<Place> JobRunner::place(JobId id) {
  const std::lock_guard hold(mutex_);
  return scheduler_.place(id, now());
}

SchedulerStats JobRunner::stats() const {
  std::lock_guard hold(mutex_);
  return scheduler_.stats();
}

}  // namespace server
}  // namespace gobo
