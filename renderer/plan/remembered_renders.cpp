// SPDX-License-Identifier: Apache-2.0
#include "plan/remembered_renders.h"

#include <algorithm>
#include <cstdio>
#include <random>

namespace gobo {

namespace {
std::string randomId() {
  static thread_local std::random_device device;   // the system's generator
  char text[34];
  std::snprintf(text, sizeof text, "r%08x%08x%08x%08x", device(), device(), device(), device());
  return text;
}
}  // namespace

std::string RememberedRenders::add(const v1::RenderRequest& request, const std::string& owner) {
  const std::string id = randomId();
  std::lock_guard lock(mutex_);
  entries_[id] = {request, owner};
  order_.push_back(id);
  while (order_.size() > keep_) {
    entries_.erase(order_.front());
    order_.pop_front();
  }
  return id;
}

std::optional<v1::RenderRequest> RememberedRenders::find(const std::string& id, const std::string& caller) {
  std::lock_guard lock(mutex_);
  const auto entry = entries_.find(id);
  if (entry == entries_.end() || (!caller.empty() && entry->second.owner != caller)) return std::nullopt;
  // One that a client relights from again and again stays.
  const auto at = std::find(order_.rbegin(), order_.rend(), id);
  if (at != order_.rend()) std::rotate(std::prev(at.base()), at.base(), order_.end());
  return entry->second.request;
}

}  // namespace gobo
