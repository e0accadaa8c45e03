// SPDX-License-Identifier: Apache-2.0
#include "plan/remembered_renders.h"

#include <algorithm>
#include <cstdio>
#include <random>

namespace gobo {
inline namespace plan {

namespace {
std::string randomId() {
  static thread_local std::random_device device;  // the system's generator
  char text[34];
  std::snprintf(text, sizeof text, "r%08x%08x%08x%08x", device(), device(), device(), device());
  return text;
}
}  // namespace

std::string RememberedRenders::add(const v1::RenderRequest& request, const std::string& owner) {
  const std::string id = randomId();
  std::lock_guard lock(mutex_);
  Entry& entry = entries_[id];
  entry = {request, owner, uint64_t(request.SpaceUsedLong()) + 256};
  Held& mine = owners_[owner];
  mine.order.push_back(id);
  mine.bytes += entry.bytes;
  held_ += entry.bytes;
  while (entries_.size() > keep_ || (held_ > bytes_ && entries_.size() > 1)) {
    const bool number = entries_.size() > keep_;
    const auto most = std::max_element(owners_.begin(), owners_.end(), [&](const auto& a, const auto& b) {
      return number ? a.second.order.size() < b.second.order.size() : a.second.bytes < b.second.bytes;
    });
    const auto gone = entries_.find(most->second.order.front());
    most->second.bytes -= gone->second.bytes;
    held_ -= gone->second.bytes;
    entries_.erase(gone);
    most->second.order.pop_front();
    if (most->second.order.empty()) owners_.erase(most);
  }
  return id;
}

std::optional<v1::RenderRequest> RememberedRenders::find(const std::string& id, const std::string& caller) {
  std::lock_guard lock(mutex_);
  const auto entry = entries_.find(id);
  if (entry == entries_.end() || (!caller.empty() && entry->second.owner != caller)) return std::nullopt;
  // One that a client relights from again and again stays.
  std::list<std::string>& order = owners_[entry->second.owner].order;
  const auto at = std::find(order.rbegin(), order.rend(), id);
  if (at != order.rend()) order.splice(order.end(), order, std::prev(at.base()));
  return entry->second.request;
}

std::map<std::string, uint64_t> RememberedRenders::bytesOfOwners() const {
  std::lock_guard lock(mutex_);
  std::map<std::string, uint64_t> out;
  for (const auto& [owner, held] : owners_) out[owner] = held.bytes;
  return out;
}

uint64_t RememberedRenders::bytes() const {
  std::lock_guard lock(mutex_);
  return held_;
}

}  // namespace plan
}  // namespace gobo
