// SPDX-License-Identifier: Apache-2.0
// WorkerBook: the workers of a coordinator: who attends, what each holds, what became of it. For people and for claims; leases are the
// store's alone. Thread-safe.
#pragma once

#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "gobo/v1/farm.pb.h"
#include "server/jobs/task_store.h"

namespace gobo::farm {

class WorkerBook {
 public:
  enum class End { Done, Failed, Released, Lost };

  /// Its id. Nothing: `most` attend already.
  std::optional<std::string> join(const v1::WorkerInfo& info, const std::string& peer, uint32_t most);
  void leave(const std::string& id);
  /// Name of one that attends; empty: none.
  std::string nameOf(const std::string& id) const;
  void claimed(const std::string& id, const Lease& lease);
  void ended(const TaskId& task, uint64_t token, End how);
  /// By name. Those that left more than an hour ago are gone.
  std::vector<v1::Worker> list();
  uint32_t attending() const;

 private:
  struct Entry {
    v1::Worker row;
    std::map<TaskId, std::pair<uint64_t, int64_t>> held;  // token, frame
  };
  void forget();
  mutable std::mutex mutex_;
  std::map<std::string, Entry> workers_;
};

}  // namespace gobo::farm
