// SPDX-License-Identifier: Apache-2.0
#include "server/farm/worker_book.h"

#include <algorithm>
#include <chrono>
#include <tuple>

#include "server/jobs/job_store.h"
#include "server/random_hex.h"

namespace gobo::farm {

namespace {

constexpr double kRemembered = 3600;  // seconds after it left

double unixNow() { return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count(); }

}  // namespace

std::optional<std::string> WorkerBook::join(const v1::WorkerInfo& info, const std::string& peer, uint32_t most) {
  const std::lock_guard lock(mutex_);
  forget();
  const auto attend = std::count_if(workers_.begin(), workers_.end(), [](const auto& w) { return w.second.row.attending(); });
  if (uint64_t(attend) >= most) return std::nullopt;
  const auto random = randomHex(8);
  if (!random) return std::nullopt;
  const std::string id = *random;
  v1::Worker& row = workers_[id].row;
  row.set_id(id);
  *row.mutable_info() = info;
  row.set_peer(peer);
  row.set_attending(true);
  row.set_since_unix_s(unixNow());
  return id;
}

void WorkerBook::leave(const std::string& id) {
  const std::lock_guard lock(mutex_);
  const auto at = workers_.find(id);
  if (at == workers_.end()) return;
  at->second.row.set_attending(false);
  at->second.row.set_since_unix_s(unixNow());
}

std::string WorkerBook::nameOf(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  const auto at = workers_.find(id);
  return at != workers_.end() && at->second.row.attending() ? at->second.row.info().name() : std::string();
}

void WorkerBook::claimed(const std::string& id, const Lease& lease) {
  const std::lock_guard lock(mutex_);
  for (auto& [other, entry] : workers_) entry.held.erase(lease.task);  // whoever had it lost it
  if (const auto at = workers_.find(id); at != workers_.end()) at->second.held[lease.task] = {lease.token, lease.frame};
}

void WorkerBook::ended(const TaskId& task, uint64_t token, End how) {
  const std::lock_guard lock(mutex_);
  for (auto& [id, entry] : workers_) {
    const auto at = entry.held.find(task);
    if (at == entry.held.end() || at->second.first != token) continue;
    entry.held.erase(at);
    if (how == End::Done) entry.row.set_done(entry.row.done() + 1);
    if (how == End::Failed) entry.row.set_failed(entry.row.failed() + 1);
    return;
  }
}

std::vector<v1::Worker> WorkerBook::list() {
  const std::lock_guard lock(mutex_);
  forget();
  std::vector<v1::Worker> rows;
  for (const auto& [id, entry] : workers_) {
    v1::Worker& row = rows.emplace_back(entry.row);
    row.set_running(uint32_t(entry.held.size()));
    for (const auto& [task, held] : entry.held) row.add_frames(jobIdText(task.job) + ":" + std::to_string(held.second));
  }
  std::sort(rows.begin(), rows.end(), [](const v1::Worker& a, const v1::Worker& b) {
    return std::tuple(a.info().name(), !a.attending(), a.id()) < std::tuple(b.info().name(), !b.attending(), b.id());
  });
  return rows;
}

uint32_t WorkerBook::attending() const {
  const std::lock_guard lock(mutex_);
  return uint32_t(std::count_if(workers_.begin(), workers_.end(), [](const auto& w) { return w.second.row.attending(); }));
}

void WorkerBook::forget() {
  const double before = unixNow() - kRemembered;
  std::erase_if(workers_, [&](const auto& w) { return !w.second.row.attending() && w.second.row.since_unix_s() < before; });
}

}  // namespace gobo::farm
