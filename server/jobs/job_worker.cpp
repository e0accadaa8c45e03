// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/job_worker.h"

#include "server/jobs/task_run.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

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

void JobWorker::loop(int number) {
  const std::string holder = options_.holder + "/" + std::to_string(number);
  uint64_t seen = hub_.version();
  while (!stopping_.load()) {
    auto lease = store_.claim(holder, leaseSeconds_.load());
    if (!lease.ok()) logWarn("jobs: cannot claim: %s", lease.status().toString().c_str());
    if (!lease.ok() || !*lease) {
      hub_.wait(seen, lease.ok() ? options_.pollSeconds : 2);
      continue;
    }
    hub_.changed((*lease)->task.job);
    TaskRun(*this, **lease).run();
    hub_.clearLive((*lease)->task);
    hub_.changed((*lease)->task.job);
  }
}

}  // namespace jobs
}  // namespace gobo
