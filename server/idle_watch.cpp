// SPDX-License-Identifier: Apache-2.0
#include "server/idle_watch.h"

namespace gobo {
inline namespace server {

using Clock = std::chrono::steady_clock;
static constexpr std::chrono::milliseconds kLook{100};

IdleWatch::Wait::Wait(IdleWatch& watch, grpc::ServerContext& context) : watch_(watch) {
  const auto until = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(watch.seconds()));
  const std::lock_guard lock(watch_.mutex_);
  at_ = watch_.waits_.insert(watch_.waits_.end(), {until, &context});
  if (!watch_.looking_.started()) watch_.looking_.start(kLook, [w = &watch_] { w->look(); });
}

IdleWatch::Wait::~Wait() {
  const std::lock_guard lock(watch_.mutex_);
  watch_.waits_.erase(at_);
}

void IdleWatch::look() {
  const std::lock_guard lock(mutex_);
  const auto now = Clock::now();
  for (auto& [until, context] : waits_) {
    if (now < until) continue;
    context->TryCancel();  // does not wait; the context lives while its wait does
    until = Clock::time_point::max();
    ended_.fetch_add(1);
  }
}

}  // namespace server
}  // namespace gobo
