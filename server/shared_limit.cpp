// SPDX-License-Identifier: Apache-2.0
#include "server/shared_limit.h"

#include <algorithm>

namespace gobo {
inline namespace server {

std::unique_ptr<SharedLimit::Hold> SharedLimit::take(const std::string& client, uint64_t amount) {
  const std::lock_guard lock(mutex_);
  const auto mine = clients_.find(client);
  const uint64_t has = mine == clients_.end() ? 0 : mine->second;
  const auto part = std::max<uint64_t>(1, uint64_t(double(limit_) * part_));
  const bool fits = amount <= limit_ && used_ <= limit_ - amount && (has == 0 || (amount <= part && has <= part - amount));
  if (!fits && used_ > 0) return nullptr;
  if (limit_ == 0) return nullptr;
  used_ += amount;
  clients_[client] += amount;
  return std::unique_ptr<Hold>(new Hold(*this, client, amount));
}

SharedLimit::Hold::~Hold() {
  const std::lock_guard lock(limit_.mutex_);
  limit_.used_ -= amount_;
  const auto mine = limit_.clients_.find(client_);
  // Not there: this one is of nothing, and another that was has gone.
  if (mine != limit_.clients_.end() && (mine->second -= amount_) == 0) limit_.clients_.erase(mine);
}

void SharedLimit::setLimit(uint64_t limit) {
  const std::lock_guard lock(mutex_);
  limit_ = limit;
}

uint64_t SharedLimit::limit() const {
  const std::lock_guard lock(mutex_);
  return limit_;
}

uint64_t SharedLimit::used() const {
  const std::lock_guard lock(mutex_);
  return used_;
}

uint64_t SharedLimit::usedBy(const std::string& client) const {
  const std::lock_guard lock(mutex_);
  const auto mine = clients_.find(client);
  return mine == clients_.end() ? 0 : mine->second;
}

std::map<std::string, uint64_t> SharedLimit::clients() const {
  const std::lock_guard lock(mutex_);
  return clients_;
}

}  // namespace server
}  // namespace gobo
