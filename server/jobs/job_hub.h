// SPDX-License-Identifier: Apache-2.0
// JobHub: what the workers, watchers and handlers of one daemon tell each other about jobs without asking the store: "something
// changed", "somebody steered" (cancel, pause, expiry), and the live progress of running frames. Thread-safe.
#pragma once

#include <atomic>
#include <condition_variable>
#include <map>
#include <mutex>

#include "server/jobs/job_store.h"

namespace gobo {
inline namespace jobs {

class JobHub {
 public:
  struct Live {
    int64_t frame = 0;
    double progress = 0, stored = 0;
    uint32_t spp = 0;
    uint64_t token = 0;
  };  ///< stored: what the store's row says; token: of the lease

  /// Something of any job, or of `job` alone: only those who wait for that one wake, and the workers.
  void changed();
  void changed(int64_t job);
  void steered();
  /// Frames may have become ready: whoever works elsewhere is told (server/farm).
  void queued();
  struct News {
    uint64_t queued = 0, steered = 0;  ///< how often
    bool operator==(const News&) const = default;
  };
  News news() const;
  /// Waits until there is other news, at most `seconds`. Changes and progress of frames wake nobody here: there may be a thousand who wait.
  News waitNews(const News& seen, double seconds) const;
  uint64_t control() const { return control_.load(); }
  uint64_t version() const;
  /// A worker's: waits until version() is not `seen`, at most `seconds`; updates `seen`. Live progress wakes none of them.
  void wait(uint64_t& seen, double seconds);
  /// Who waits for news of one job, from here to its end. Hundreds may, whom news of other jobs would wake for nothing.
  class Watch {
   public:
    Watch(JobHub& hub, int64_t job);
    ~Watch();
    Watch(const Watch&) = delete;
    Watch& operator=(const Watch&) = delete;
    /// Until there is news of the job, or live progress, since the last wait (since it began), at most `seconds`. False: there is none.
    bool wait(double seconds);

   private:
    JobHub& hub_;
    int64_t job_;
    uint64_t seen_ = 0;
  };

  void setLive(TaskId task, const Live& live);
  void clearLive(TaskId task);
  /// The same, if it is still that of the lease.
  void clearLive(TaskId task, uint64_t token);
  std::map<TaskId, Live> live() const;
  std::map<TaskId, Live> live(int64_t job) const;
  /// Adds live progress to the job, and to its frames if there are any.
  void overlay(JobRecord& record) const;

 private:
  struct Topic {
    std::condition_variable wake;
    uint64_t version = 0;
    int watches = 0;
  };
  void tell(int64_t job);  // under mutex_

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  mutable std::condition_variable newsWake_;
  uint64_t version_ = 0;
  News news_;
  std::atomic<uint64_t> control_{0};
  std::map<TaskId, Live> live_;
  std::map<int64_t, Topic> topics_;  // of jobs that somebody watches
};

}  // namespace jobs
}  // namespace gobo
