// SPDX-License-Identifier: Apache-2.0
// JobShares: which client's frame is next. Start-time fair queueing over clients: each has a virtual time, the seconds that its frames
// have taken; the least goes first; one that comes back from idle starts at the least of the others, so nothing is saved up. Priorities
// and deadlines order a client's own jobs: no client passes another by calling everything urgent.
// Kept in memory by each process for its own workers. Not thread-safe.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "server/jobs/job_store.h"

namespace gobo {
inline namespace jobs {

class JobShares {
 public:
  /// Forgets clients that have no job, once the others have had as much: a client that submits frame by frame would come back as one that had nothing.
  void retain(const std::vector<std::string>& active);
  /// The client that is to be served first, first; equal ones by when they were served last, then by name.
  void order(std::vector<std::string>& clients) const;
  void started(const std::string& client, const Lease& lease, double now);
  /// Whatever its end was. Unknown leases are another process's, or ended before.
  void ended(const Lease& lease, double now);

 private:
  static constexpr double kGuess = 1;  // seconds that a frame counts with while it runs
  struct Client {
    double virtualTime = 0;
    uint64_t served = 0;
  };
  struct Running {
    std::string client;
    double since = 0;
    uint64_t token = 0;  // of the lease
  };
  std::map<std::string, Client> clients_;
  std::map<TaskId, Running> running_;
  uint64_t served_ = 0;
};

}  // namespace jobs
}  // namespace gobo
