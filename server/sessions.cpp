// SPDX-License-Identifier: Apache-2.0
#include "server/sessions.h"

namespace gobo {
inline namespace server {

namespace {
constexpr std::chrono::milliseconds kTurnPoll{10};
}

// The owner's length keeps ("a", "b:c") apart from ("a:b", "c").
Sessions::Turn::Turn(Sessions& sessions, const std::string& owner, const std::string& name)
    : sessions_(sessions), key_(name.empty() ? std::string() : std::to_string(owner.size()) + ":" + owner + ":" + name) {
  if (key_.empty()) return;
  const std::lock_guard lock(sessions_.mutex_);
  Session& session = sessions_.sessions_[key_];
  if (session.waiting) session.waiting->replaced_ = true;
  if (session.running) session.waiting = this;
  else session.running = this;
  sessions_.changed_.notify_all();
}

Sessions::Turn::~Turn() {
  if (key_.empty()) return;
  const std::lock_guard lock(sessions_.mutex_);
  const auto at = sessions_.sessions_.find(key_);
  if (at == sessions_.sessions_.end()) return;
  Session& session = at->second;
  if (session.waiting == this) session.waiting = nullptr;
  if (session.running == this) {
    session.running = session.waiting;
    session.waiting = nullptr;
  }
  if (!session.running) sessions_.sessions_.erase(at);
  sessions_.changed_.notify_all();
}

Sessions::Turn::Begin Sessions::Turn::begin(const std::function<bool()>& gone) {
  if (key_.empty()) return Begin::Now;
  std::unique_lock lock(sessions_.mutex_);
  for (;;) {
    if (replaced_) return Begin::Replaced;
    if (sessions_.sessions_[key_].running == this) return Begin::Now;
    sessions_.changed_.wait_for(lock, kTurnPoll);
    lock.unlock();
    const bool left = gone();
    lock.lock();
    if (left) return Begin::Gone;
  }
}

bool Sessions::Turn::over() const {
  if (key_.empty() || !shown_) return false;
  const std::lock_guard lock(sessions_.mutex_);
  return sessions_.sessions_[key_].waiting != nullptr;
}

size_t Sessions::size() const {
  const std::lock_guard lock(mutex_);
  return sessions_.size();
}

}  // namespace server
}  // namespace gobo
