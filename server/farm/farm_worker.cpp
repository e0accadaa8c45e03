// SPDX-License-Identifier: Apache-2.0
#include "server/farm/farm_worker.h"

#include <unistd.h>

#include <algorithm>
#include <random>

#include "server/dial.h"
#include "server/farm/messages.h"
#include "server/farm/numeric_class.h"
#include "server/log.h"
#include "server/machine_memory.h"
#include "server/server.h"
#include "server/upload.h"

namespace gobo::farm {

namespace {

constexpr double kFirstWait = 0.1, kMostWait = 5, kRefusedWait = 30;  // seconds before the coordinator is asked again
constexpr double kIdlePoll = 5;  // between claims when nothing is ready: news come over the stream, but for frames whose wait after a failure is over

/// The host's name, of what a worker's name may hold.
std::string hostName() {
  char text[65] = {};
  ::gethostname(text, sizeof text - 1);
  std::string name(text);
  std::erase_if(name, [](unsigned char c) { return c >= 0x80 || (!std::isalnum(c) && c != '.' && c != '_' && c != '-'); });
  return name.empty() ? "worker" : name;
}

/// No second try mends these by itself.
bool refusal(Code code) {
  return code == Code::FailedPrecondition || code == Code::PermissionDenied || code == Code::Unauthenticated || code == Code::InvalidArgument ||
         code == Code::Unimplemented;
}

}  // namespace

Result<std::unique_ptr<FarmWorker>> FarmWorker::start(Engine& engine, JobRunner& runner, const ServerConfig& config) {
  std::unique_ptr<FarmWorker> self(new FarmWorker(engine, runner, config));
  self->name_ = config.farmName.empty() ? hostName() : config.farmName;
  const char* token = std::getenv("GOBO_TOKEN");
  GOBO_ASSIGN(Dialled dialled, dial({config.farmCoordinator, config.farmTls, config.farmCa, config.farmCert, config.farmKey, config.farmTokenFile,
                                     token ? token : "", "farm.", "_"}));
  self->link_.stub = v1::Farm::NewStub(dialled.channel);
  self->link_.token = std::move(dialled.token);
  std::string folder = config.farmFolder;
  if (folder.empty()) {
    GOBO_ASSIGN(self->ownFolder_, ScratchFolder::make(config.tmpFolder, kWorkerFolder));
    folder = self->ownFolder_->path();
  }
  bool alone = false;
  GOBO_TRY(self->files_.open(folder, alone));
  if (!alone) return Status(Code::Unavailable, "another worker uses the folder (farm.folder)", folder);
  self->files_.removeAllOnTheirWay();  // of a killed one: the coordinator has what was reported
  self->files_.opened();
  self->tasks_ = std::make_unique<RemoteTasks>(self->link_, self->files_, self->hub_);
  self->scenes_ = std::make_unique<RemoteScenes>(*self->tasks_, self->files_, config.farmCacheBytes);
  self->telling_.start(std::chrono::seconds(1), [tasks = self->tasks_.get()] { tasks->tellProgress(); });
  self->thread_ = std::thread([s = self.get()] { s->attendLoop(); });
  return self;
}

FarmWorker::~FarmWorker() { stop(); }

void FarmWorker::stop() {
  if (!thread_.joinable()) return;
  JobWorker* worker = nullptr;
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    worker = worker_.get();
  }
  telling_.stop();
  if (worker) worker->stop();  // while the stream is open: reports still go through
  {
    const std::lock_guard lock(mutex_);
    if (attending_) attending_->TryCancel();
    wake_.notify_all();
  }
  thread_.join();
}

Status FarmWorker::refused() const {
  const std::lock_guard lock(mutex_);
  return refused_;
}

const JobWorkerStats* FarmWorker::stats() const {
  const std::lock_guard lock(mutex_);
  return worker_ ? &worker_->stats() : nullptr;
}

void FarmWorker::attendLoop() {
  std::minstd_rand random{std::random_device{}()};
  double wait = kFirstWait;
  std::string told;
  for (;;) {
    const auto begun = std::chrono::steady_clock::now();
    const Status status = attendOnce();
    {
      const std::lock_guard lock(link_.mutex);
      link_.worker.clear();
    }
    std::unique_lock lock(mutex_);
    if (stopping_) return;
    refused_ = refusal(status.code()) ? status : Status();
    // Said once, not at every try.
    if (status.toString() != told) logWarn("farm: coordinator %s: %s; it is asked again", config_.farmCoordinator.c_str(), status.toString().c_str());
    told = status.toString();
    if (std::chrono::steady_clock::now() - begun > std::chrono::seconds(10)) wait = kFirstWait;  // it was there
    // Workers that lost one coordinator together do not come back in one moment.
    const double seconds = (refused_.ok() ? wait : kRefusedWait) * (0.5 + 0.5 * double(random()) / double(random.max()));
    wait = std::min(kMostWait, 2 * wait);
    if (wake_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return stopping_; })) return;
  }
}

Status FarmWorker::attendOnce() {
  v1::AttendRequest request;
  v1::WorkerInfo& info = *request.mutable_worker();
  info.set_name(name_);
  info.set_build(buildVersion());
  info.set_numeric_class(numericClass());
  info.set_threads(uint32_t(engine_.threads()));
  info.set_frames(std::max(1u, config_.jobsWorkers));
  info.set_memory_bytes(machineMemory());
  grpc::ClientContext context;
  if (!link_.token.empty()) context.AddMetadata("authorization", "Bearer " + link_.token);
  {
    const std::lock_guard lock(mutex_);
    if (stopping_) return {Code::Cancelled, "stopped"};
    attending_ = &context;
  }
  const auto reader = link_.stub->Attend(&context, request);
  v1::FarmNews news;
  uint64_t steered = 0;
  while (reader->Read(&news)) {
    if (link_.id().empty()) {
      if (news.worker().empty()) {  // no coordinator of this build
        context.TryCancel();
        break;
      }
      steered = news.steered();
      const double lease = std::clamp(news.lease_s(), 1.0, 86400.0), checkpoint = std::clamp(news.checkpoint_s(), 0.05, 86400.0);
      {  // before slots can claim by the new name
        const std::lock_guard lock(mutex_);
        if (worker_) worker_->setTimes(lease, checkpoint);
      }
      {
        const std::lock_guard lock(link_.mutex);
        link_.worker = news.worker();
      }
      const std::lock_guard lock(mutex_);
      refused_ = {};
      logInfo("farm: attends coordinator %s as %s (%s)", config_.farmCoordinator.c_str(), name_.c_str(), news.worker().c_str());
      if (!worker_ && !stopping_) {
        JobWorkerOptions options;
        options.displays = displayTransforms(config_);
        options.workers = int(info.frames());
        options.leaseSeconds = lease;
        options.checkpointSeconds = checkpoint;
        options.holder = name_;
        options.pollSeconds = kIdlePoll;
        options.delivers = [tasks = tasks_.get()](const Lease& held, const std::vector<v1::FrameFile>& files) { tasks->delivers(held, files); };
        worker_ = std::make_unique<JobWorker>(engine_, runner_, *tasks_, files_, *scenes_, hub_, options);
      }
    }
    if (news.steered() != steered) hub_.steered();
    else hub_.changed();
    steered = news.steered();
  }
  const Status end = fromGrpc(reader->Finish());
  const std::lock_guard lock(mutex_);
  attending_ = nullptr;
  return end.ok() ? Status(Code::Unavailable, "the coordinator ended the stream") : end;
}

}  // namespace gobo::farm
