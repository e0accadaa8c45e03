// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/durable_jobs.h"

#include <unistd.h>

#include <cstring>
#include <random>

#include "server/jobs/store_identity.h"
#include "server/log.h"
#include "server/server.h"

namespace gobo {
inline namespace jobs {

namespace {
constexpr int kResultsEvery = 60, kLiveEvery = 60, kSweepEvery = 3600;  // seconds
constexpr double kSweepAge = 86400;                                     // of files beside living daemons
}  // namespace

Result<std::unique_ptr<DurableJobs>> DurableJobs::start(Engine& engine, JobRunner& runner, const ServerConfig& config) {
  std::unique_ptr<DurableJobs> self(new DurableJobs);
  self->engine_ = &engine;
  self->keepBytes_ = config.jobsKeepBytes;
  self->keepSeconds_ = config.jobsKeepDays * 86400;
  bool alone = false;
  GOBO_TRY(self->files_.open(config.jobsFolder, alone));
  self->out_.open(config.jobsOutFolder);
  const bool farm = !config.jobsStore.empty();
  if (farm) {
    GOBO_ASSIGN(self->store_, openPostgresStore(self->files_, config.jobsStore));
  } else {
    GOBO_ASSIGN(self->store_, openStore(self->files_));
  }
  // Of a farm nobody knows to be alone: daemons of other machines may not be seen in the folder's lock. Leases of dead ones run out.
  if (alone && !farm) {
    // Whoever held leases is dead: its frames are taken up at once, not when their leases run out.
    GOBO_ASSIGN(const uint64_t ended, self->store_->endAllLeases());
    if (ended) logInfo("jobs: %llu frames of a killed daemon go on", (unsigned long long)ended);
    GOBO_TRY(self->files_.sweep(*self->store_, 0));
  }
  // Before anything is claimed: what crashed the last daemon must not be the first thing this one starts.
  for (const CrashReport& crash : CrashMarks::read(config.jobsFolder)) {
    const char* name = ::sigabbrev_np(crash.signal);
    const std::string signal = std::string("SIG") + (name ? name : std::to_string(crash.signal).c_str());
    for (const TaskId& task : crash.tasks) {
      GOBO_TRY(self->store_->blame(task,
                                   {Code::Internal, "the daemon crashed (" + signal + ") while it rendered this frame" +
                                                        (crash.alone ? "" : ", for the third time, each beside other work") + "; it is set aside"},
                                   crash.alone));
      logWarn("jobs: the last daemon crashed (%s) in %s, frame index %lld%s", signal.c_str(), jobIdText(task.job).c_str(), (long long)task.index,
              crash.alone ? ": set aside" : ", beside other work");
    }
  }
  GOBO_ASSIGN(self->marks_, CrashMarks::open(config.jobsFolder));
  self->files_.opened();
  self->scenes_ = std::make_unique<JobScenes>(engine, self->files_, config.ingestInputBytes);
  std::random_device random;
  JobWorkerOptions options;
  options.displays = displayTransforms(config);
  options.workers = int(config.jobsWorkers);
  options.leaseSeconds = config.jobsLeaseSeconds;
  options.checkpointSeconds = config.jobsCheckpointSeconds;
  options.marks = self->marks_.get();
  options.out = &self->out_;
  options.holder = std::to_string(::getpid()) + "-" + std::to_string(random());
  self->looks_ = std::make_unique<StoreLooks>(*self->store_);
  self->worker_ = std::make_unique<JobWorker>(engine, runner, *self->store_, self->files_, *self->scenes_, self->hub_, options);
  const auto tell = [hub = &self->hub_](bool steered) {
    if (steered) hub->steered();
    else hub->queued();
  };
  if (farm) self->news_ = std::make_unique<JobNews>(config.jobsStore, tell);
  self->mind();  // leases of a daemon that is gone, at once
  self->minder_.start(std::chrono::seconds(1), [s = self.get()] { s->mind(); });
  return self;
}

void DurableJobs::stop() {
  if (!worker_) return;
  worker_->stop();
  minder_.stop();
  news_.reset();
}

void DurableJobs::mind() {
  const auto expired = store_->expireLeases();
  if (!expired.ok()) logWarn("jobs: %s", expired.status().toString().c_str());
  if (expired.ok() && *expired) hub_.steered();
  if (second_ % kLiveEvery == 0 || (expired.ok() && *expired)) mindLive();
  if (second_ % kResultsEvery == 0) mindResults();
  if (second_ % kSweepEvery == kSweepEvery - 1) (void)files_.sweep(*store_, kSweepAge);
  ++second_;
}

/// Progress of frames whose worker is gone, or that others have ended: nobody else takes it away.
void DurableJobs::mindLive() {
  for (const auto& [task, live] : hub_.live()) {
    Lease lease;
    lease.task = task;
    lease.token = live.token;
    const Code code = store_->check(lease).status().code();
    if (code == Code::FailedPrecondition || code == Code::NotFound) hub_.clearLive(task, live.token);
  }
}

void DurableJobs::mindResults() {
  const auto gone = store_->expireResults(keepBytes_, keepSeconds_);
  if (!gone.ok()) return logWarn("jobs: %s", gone.status().toString().c_str());
  for (int64_t id : *gone) {
    files_.removeResults(id);
    logInfo("job %s: results removed (jobs.keep_bytes, jobs.keep_days)", jobIdText(id).c_str());
  }
  const auto needed = store_->neededScenes();
  if (!needed.ok()) return;
  std::vector<std::string> loaded;
  for (const v1::SceneInfo& info : engine_->listScenes())
    if (const std::string digest = keptSceneDigest(info.source()); !digest.empty()) loaded.push_back(digest);
  files_.sweepScenes(*needed, loaded);
}

}  // namespace jobs
}  // namespace gobo
