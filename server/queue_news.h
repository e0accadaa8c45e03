// SPDX-License-Identifier: Apache-2.0
// QueueNews: what a caller who watches a render is told while it waits for others: its place once a second and when that changes, and that the
// wait is over. Who waits for less than kShort is told nothing. Pure; one thread at a time.
#pragma once

#include <optional>

#include "gobo/v1/render.pb.h"
#include "server/scheduler.h"

namespace gobo {
inline namespace server {

class QueueNews {
 public:
  static constexpr double kShortMs = 50, kGapMs = 1000;
  /// `place`: nothing where the render is over. `ms`: since the call began, never less than before. The message to send now, if any.
  std::optional<v1::Progress> at(const std::optional<Place>& place, double ms);

 private:
  bool queued_ = false, told_ = false;
  double since_ = 0, lastTold_ = 0;
  size_t ahead_ = 0;
};

}  // namespace server
}  // namespace gobo
