// SPDX-License-Identifier: Apache-2.0
#include "server/core.h"

#include "server/log.h"
#include "server/server_metrics.h"

namespace gobo {
inline namespace server {

namespace {

SchedulerOptions schedulerOptions(const ServerConfig& c) {
  SchedulerOptions o;
  o.slots = int(c.running);
  if (c.pinnedBytes) o.pinnedLimit = c.pinnedBytes;
  o.queueLimit = {c.queuedInteractive, c.queuedNormal, c.queuedBatch};
  o.clientLimit = c.queuedPerClient;
  o.clientPart = 0.75;
  o.slice = {0.03, 0.5, 5};
  o.beside = 1;
  o.ageing = {kNever, c.ageingNormal, c.ageingBatch};
  return o;
}

/// Half of the threads that nothing else can wait in.
uint32_t heldRefusals(const ServerConfig& c) {
  return uint32_t(std::min<uint64_t>(64, (c.rpcThreads - std::min<uint64_t>(c.rpcThreads, callsThatMayWait(c))) / 2));
}

/// Plans that may wait at once: what the queues take, of which one caller may have three quarters.
size_t mostPlansWaiting(const ServerConfig& c) { return std::max<size_t>(1, size_t(c.queuedInteractive) + c.queuedNormal + c.queuedBatch); }
size_t mostPlansOfOne(const ServerConfig& c) { return std::max<size_t>(1, mostPlansWaiting(c) * 3 / 4); }

}  // namespace

constexpr uint32_t kPlansAtOnce = 16;  // of one caller as many as there are cores, so that each of fifteen others finds a place

ServerCore::ServerCore(Engine& e, const ServerConfig& c)
    : engine(e),
      config(c),
      planning({kPlansAtOnce, uint32_t(std::max(1, e.threads()))}),
      impatient(heldRefusals(c)),
      idle(c.clientIdleSeconds),
      freed(FreedMemory::keepOf(e.memory().total())),
      uploads(c.uploadsAtOnce),
      watches(c.watches),
      replies(c.replyBytes),
      sandbox(c.ingestProgram),
      jobs(schedulerOptions(c)) {
  setLive(c);
  accounts.push_back(engine.memory().add({"running renders",
                                          [this] { return config.pinnedBytes ? config.pinnedBytes : UINT64_MAX; },
                                          [this] { return jobs.stats().pinnedBytes; },
                                          {},
                                          [this] { return jobs.stats().pinnedOfGroups; }}));
  accounts.push_back(engine.memory().add(
      {"pictures made or sent", [this] { return replies.limit(); }, [this] { return replies.used(); }, {}, [this] { return replies.clients(); }}));
  declareServerMetrics(*this);
  freed.start();
}

std::shared_ptr<const ServerConfig> ServerCore::live() const {
  const std::lock_guard lock(liveMutex_);
  return live_;
}

void ServerCore::setLive(const ServerConfig& c) {
  tokens.reload(c.tokens, c.requireToken == "always");
  loads.setLimit(c.loadsAtOnce);
  idle.setSeconds(c.clientIdleSeconds);
  uploads.setLimit(c.uploadsAtOnce);
  watches.setLimit(c.watches);
  replies.setLimit(c.replyBytes);
  const std::lock_guard lock(liveMutex_);
  live_ = std::make_shared<ServerConfig>(c);
}

std::function<bool(const FairGate::Queue&)> ServerCore::plansFull(bool& full) {
  return [this, &full](const FairGate::Queue& q) {
    full = !q.free && (q.ofClient >= mostPlansOfOne(config) || q.waiting + jobs.queued() >= mostPlansWaiting(config));
    return full;
  };
}

std::string ServerCore::plansFullText() const {
  return strf(
      "too many calls wait to be planned: at most %zu, those in the queues included, and %zu of one caller (scheduler.queued_interactive, _normal, _batch)",
      mostPlansWaiting(config), mostPlansOfOne(config));
}

void ServerCore::addHealth(const std::string& key, std::function<std::string()> value) {
  const std::lock_guard lock(liveMutex_);
  health_.emplace_back(key, std::move(value));
}

std::string ServerCore::healthExtras() const {
  std::vector<std::pair<std::string, std::function<std::string()>>> parts;
  {
    const std::lock_guard lock(liveMutex_);
    parts = health_;
  }
  std::string out;
  for (const auto& [key, value] : parts) out += "," + jsonString(key) + ":" + value();
  return out;
}

ServerCore::Call::Call(ServerCore& core) : core_(core) {
  const std::lock_guard lock(core_.mutex_);
  if (core_.draining_.load()) return;
  ok = true;
  at_ = core_.calls_.insert(core_.calls_.end(), &stop);
}

ServerCore::Call::~Call() {
  if (!ok) return;
  const std::lock_guard lock(core_.mutex_);
  core_.calls_.erase(at_);
  core_.idle_.notify_all();
}

void ServerCore::drain() {
  if (!drainSeen_.exchange(true) && onDrain) onDrain();
  const std::lock_guard lock(mutex_);
  draining_.store(true);
}

bool ServerCore::waitIdle(double seconds) {
  std::unique_lock lock(mutex_);
  return idle_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return calls_.empty(); });
}

void ServerCore::cancelAll() {
  const std::lock_guard lock(mutex_);
  cancelled_.store(true);
  for (StopSource* source : calls_) source->stop(StopReason::Cancelled);
}

size_t ServerCore::running() const {
  const std::lock_guard lock(mutex_);
  return calls_.size();
}

}  // namespace server
}  // namespace gobo
