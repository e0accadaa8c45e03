// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/job_shares.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <tuple>

namespace gobo {
inline namespace jobs {

void JobShares::retain(const std::vector<std::string>& active) {
  const std::set<std::string> names(active.begin(), active.end());
  double least = std::numeric_limits<double>::infinity();
  for (const auto& [name, c] : clients_)
    if (names.count(name)) least = std::min(least, c.virtualTime);
  std::erase_if(clients_, [&](const auto& c) { return !names.count(c.first) && !(c.second.virtualTime > least); });
  for (const std::string& name : names) clients_.try_emplace(name, Client{std::isfinite(least) ? least : 0, 0});
}

void JobShares::order(std::vector<std::string>& clients) const {
  const auto key = [&](const std::string& name) {
    const auto at = clients_.find(name);
    return at == clients_.end() ? std::tuple(0.0, uint64_t(0), name) : std::tuple(at->second.virtualTime, at->second.served, name);
  };
  std::sort(clients.begin(), clients.end(), [&](const std::string& a, const std::string& b) { return key(a) < key(b); });
}

void JobShares::started(const std::string& client, const Lease& lease, double now) {
  Client& c = clients_[client];
  c.served = ++served_;
  c.virtualTime += kGuess;
  running_[lease.task] = {client, now, lease.token};
}

void JobShares::ended(const Lease& lease, double now) {
  const auto at = running_.find(lease.task);
  if (at == running_.end() || at->second.token != lease.token) return;
  if (const auto c = clients_.find(at->second.client); c != clients_.end()) c->second.virtualTime += std::max(0.0, now - at->second.since) - kGuess;
  running_.erase(at);
}

}  // namespace jobs
}  // namespace gobo
