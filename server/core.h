// SPDX-License-Identifier: Apache-2.0
// ServerCore: what the services of one daemon share: the engine, the configuration, the job runner, counters, and the list
// of running calls, so that a shutdown can refuse new work, wait for the running one, and at last stop it. Thread-safe.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <vector>

#include "base/stop.h"
#include "plan/engine.h"
#include "server/auth.h"
#include "server/config.h"
#include "server/device_probe.h"
#include "server/encode_pace.h"
#include "server/fair_gate.h"
#include "server/freed_memory.h"
#include "server/idle_watch.h"
#include "server/job_runner.h"
#include "server/load_gate.h"
#include "server/metrics.h"
#include "server/refusal_pause.h"
#include "server/sandbox_probe.h"
#include "server/sessions.h"
#include "server/shared_limit.h"

namespace gobo {
inline namespace jobs {
class DurableJobs;  // server/jobs/durable_jobs.h
}
}  // namespace gobo

namespace gobo {
inline namespace server {

class FileStore;  // server/file_store.h

class ServerCore {
 public:
  ServerCore(Engine& engine, const ServerConfig& config);

  Engine& engine;
  const ServerConfig config;  ///< as at the start: what is fixed until a restart
  /// As of the last reload; hold the pointer for as long as one call needs one view of it.
  std::shared_ptr<const ServerConfig> live() const;
  void setLive(const ServerConfig& config);  ///< with its tokens
  Metrics metrics;                           ///< other parts register their own (server/server_metrics.h)
  TokenBook tokens;
  LoadGate loads;
  FairGate planning;       ///< plans being made before admission: they load environments and pose scenes; entered with plansFull()
  RefusalPause impatient;  ///< answers to who does not wait for his hint
  IdleWatch idle;
  FreedMemory freed;
  SharedLimit uploads, watches;  ///< calls in progress
  EncodePace encodePace;
  SharedLimit replies;                    ///< bytes of pictures that are being made or sent
  Sessions sessions;                      ///< of viewers
  SharedLimit edits{Sessions::kWaiting};  ///< requests that wait for their turn in a session, of which one client may have half
  DeviceProbe devices;
  SandboxProbe sandbox;
  JobRunner jobs;
  std::vector<std::shared_ptr<const MemoryHolder>> accounts;  ///< what it adds to the engine's memory()
  std::shared_ptr<FileStore> files;                           ///< what clients put; set before serving
  DurableJobs* durable = nullptr;                             ///< null: switched off
  std::atomic<uint64_t> renders{0};                           ///< finished with a picture
  const std::chrono::steady_clock::time_point started = std::chrono::steady_clock::now();

  /// While one lives, the call counts as running. `ok` is false once the server drains: refuse the request.
  class Call {
   public:
    explicit Call(ServerCore& core);
    ~Call();
    Call(const Call&) = delete;
    Call& operator=(const Call&) = delete;
    bool ok = false;
    StopSource stop;

   private:
    ServerCore& core_;
    std::list<StopSource*>::iterator at_;
  };

  /// From now on new calls are refused; running ones go on. The first call of it runs `onDrain` before.
  void drain();
  std::function<void()> onDrain;  ///< set before serving: health says so first
  /// Whether a connection to each of the daemon's addresses is accepted within `seconds`; empty: no sockets. For the HTTP door, which lives
  /// between the two changes of it.
  std::function<bool(double seconds)> reachable;
  bool draining() const { return draining_.load(); }
  /// Waits until no call runs, at most `seconds`; true if none runs.
  bool waitIdle(double seconds);
  /// Stops every running call (Cancelled).
  void cancelAll();
  bool cancelledAll() const { return cancelled_.load(); }
  size_t running() const;

  /// For planning.enter() of every call: refuses one that would have to wait where as many wait as the queues take. Each holds a thread of limits.rpc_threads,
  /// and only those of the queues are kept for them: status must get through. Of one caller three quarters wait, of all callers, with those in the queues, all.
  /// `full`, which must outlive the call of enter(), says whether it refused.
  std::function<bool(const FairGate::Queue&)> plansFull(bool& full);
  /// What the refused one is told, with kPlanRetryMs.
  std::string plansFullText() const;
  static constexpr double kPlanRetryMs = 200;  ///< plans end one by one, soon

  /// A part of /health: `value` gives the JSON value of `key`, on any thread.
  void addHealth(const std::string& key, std::function<std::string()> value);
  std::string healthExtras() const;  ///< ",\"key\":value" of each

  /// Asked for by Admin.Shutdown; the owner (main, tests) polls it.
  std::atomic<bool> shutdownAsked{false};

 private:
  std::atomic<bool> draining_{false}, cancelled_{false}, drainSeen_{false};
  mutable std::mutex liveMutex_;
  std::shared_ptr<const ServerConfig> live_;
  std::vector<std::pair<std::string, std::function<std::string()>>> health_;  // under liveMutex_
  mutable std::mutex mutex_;
  std::condition_variable idle_;
  std::list<StopSource*> calls_;
};

}  // namespace server
}  // namespace gobo
