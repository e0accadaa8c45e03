// SPDX-License-Identifier: Apache-2.0
#include "server/queue_news.h"

namespace gobo {
inline namespace server {

std::optional<v1::Progress> QueueNews::at(const std::optional<Place>& place, double ms) {
  const bool queued = place && place->queued;
  if (queued && !queued_) since_ = ms;
  queued_ = queued;
  if (queued ? ms - since_ < kShortMs || (told_ && place->ahead == ahead_ && ms - lastTold_ < kGapMs) : !told_ || !place) return std::nullopt;
  told_ = queued;
  lastTold_ = ms;
  v1::Progress progress;
  progress.set_elapsed_ms(ms);
  progress.set_eta_ms(place->expected * 1e3);
  if (queued) {
    ahead_ = place->ahead;
    progress.set_stage("queued");
    progress.set_queued(true);
    progress.set_position(uint32_t(place->ahead));
  }
  return progress;
}

}  // namespace server
}  // namespace gobo
