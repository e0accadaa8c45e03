// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/job_worker.h"

#include <algorithm>
#include <chrono>

#include "server/jobs/task_run.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {
constexpr double kFirstRest = 0.1, kMostRest = 5;  // seconds before the next claim of who gave a frame back for want of its scene
}

JobWorker::JobWorker(Engine& engine, JobRunner& runner, TaskStore& store, JobFiles& files, TaskScenes& scenes, JobHub& hub, const JobWorkerOptions& options)
    : engine_(engine),
      runner_(runner),
      store_(store),
      files_(files),
      scenes_(scenes),
      hub_(hub),
      options_(options),
      leaseSeconds_(options.leaseSeconds),
      checkpointSeconds_(options.checkpointSeconds) {
  for (int i = 0; i < options_.workers; ++i) threads_.emplace_back([this, i] { loop(i); });
}

void JobWorker::stop() {
  stopping_.store(true);
  hub_.steered();
  for (auto& t : threads_)
    if (t.joinable()) t.join();
  threads_.clear();
}

void JobWorker::setTimes(double leaseSeconds, double checkpointSeconds) {
  leaseSeconds_.store(leaseSeconds);
  checkpointSeconds_.store(checkpointSeconds);
}

void JobWorker::rest(double seconds, uint64_t& seen) {
  using Clock = std::chrono::steady_clock;
  const auto until = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  // News of any kind wake it; stop() is one.
  for (auto now = Clock::now(); now < until && !stopping_.load(); now = Clock::now()) hub_.wait(seen, std::chrono::duration<double>(until - now).count());
}

void JobWorker::loop(int number) {
  const std::string holder = options_.holder + "/" + std::to_string(number);
  uint64_t seen = hub_.version();
  double pause = 0;
  while (!stopping_.load()) {
    auto lease = store_.claim(holder, leaseSeconds_.load());
    if (!lease.ok()) logWarn("jobs: cannot claim: %s", lease.status().toString().c_str());
    if (!lease.ok() || !*lease) {
      hub_.wait(seen, lease.ok() ? options_.pollSeconds : 2);
      continue;
    }
    hub_.changed((*lease)->task.job);
    const bool had = TaskRun(*this, **lease).run();
    hub_.clearLive((*lease)->task);
    hub_.changed((*lease)->task.job);
    pause = had ? 0 : std::clamp(2 * pause, kFirstRest, kMostRest);
    if (pause > 0) rest(pause, seen);
  }
}

}  // namespace jobs
}  // namespace gobo
