// SPDX-License-Identifier: Apache-2.0
// WorkInFlight: which recipes executors of one engine are making at this moment, so that two requests at once make a term once. Who comes second
// waits and gets the first one's result, or goes on from where that one stopped. A hint, as a cache is: nothing but time depends on it. Thread-safe.
//
// Nobody can wait in a circle: who holds a recipe waits only for what that recipe is made of, and keys of inputs are hashed into those of outputs.
// Of an extendable recipe a count waits for smaller ones, which it extends, never for larger ones: 16 samples are not late because of 4096.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <utility>

#include "base/hash.h"
#include "base/status.h"
#include "base/stop.h"
#include "terms/term.h"

namespace gobo {
inline namespace plan {

class WorkInFlight {
 public:
  class Turn;
  /// Waits until nobody makes `recipe` with `blocks` (0 where it is not extendable) or fewer, then marks it as made by the caller. When somebody
  /// finished just this meanwhile, turn.result() is that. Errors: Cancelled when `stop` fires, which is polled every few milliseconds.
  Result<Turn> take(const Hash128& recipe, uint32_t blocks, const StopToken& stop);
  /// Turns that have ended. Who asked a store before this changed has to ask again.
  uint64_t ended() const;
  uint64_t shared() const;  ///< results that were handed to somebody who had waited for them

 private:
  struct Work {
    TermPtr result;
    uint32_t waiting = 0;
    bool over = false;
  };
  using WorkPtr = std::shared_ptr<Work>;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::map<Hash128, std::map<uint32_t, WorkPtr>> running_;
  uint64_t ended_ = 0, shared_ = 0;
};

/// One's turn to make a recipe; over when it is destroyed, with or without a result.
class WorkInFlight::Turn {
 public:
  Turn(Turn&& other) noexcept
      : all_(std::exchange(other.all_, nullptr)),
        recipe_(other.recipe_),
        blocks_(other.blocks_),
        work_(std::move(other.work_)),
        result_(std::move(other.result_)) {}
  Turn& operator=(Turn&&) = delete;
  ~Turn();
  const TermPtr& result() const { return result_; }  ///< what another made; null: it is the caller's to make
  bool wanted() const;                               ///< somebody waits for the caller
  void finish(TermPtr term);                         ///< what those who wait get

 private:
  friend class WorkInFlight;
  explicit Turn(TermPtr result) : result_(std::move(result)) {}
  Turn(WorkInFlight* all, const Hash128& recipe, uint32_t blocks, WorkPtr work) : all_(all), recipe_(recipe), blocks_(blocks), work_(std::move(work)) {}
  WorkInFlight* all_ = nullptr;
  Hash128 recipe_;
  uint32_t blocks_ = 0;
  WorkPtr work_;
  TermPtr result_;
};

}  // namespace plan
}  // namespace gobo
