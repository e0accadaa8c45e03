// SPDX-License-Identifier: Apache-2.0
// Samples that were left out of a sum because a part of them was not finite, counted per element in a plane "dropped"
// (uint32), which exists only where there are any. Filters that sum radiance pass it on, so that the picture itself says how
// many samples it lacks, whatever of it came from the store. Values that were clamped to what float holds count as well.
#pragma once

#include <mutex>

#include "terms/term_shape.h"

namespace gobo {
inline namespace terms {

inline constexpr const char* kDroppedPlane = "dropped";

/// The plane of a shape whose node may leave samples out.
inline PlaneShape mayDrop() { return {kDroppedPlane, Format::U32, 1, PlaneShape::Fill::Absent}; }
/// The same, if `from` may have it.
inline void passOnDropped(const TermShape& from, TermShape& to) {
  if (from.find(kDroppedPlane) && !to.find(kDroppedPlane)) to.planes.push_back(mayDrop());
}

/// Writes the plane of a term under construction; any thread. The plane is made with the first sample.
class DroppedSamples {
 public:
  explicit DroppedSamples(Term& term) : term_(term) {}
  void add(size_t element, uint64_t count) {
    if (count == 0) return;
    const std::lock_guard lock(mutex_);
    if (!term_.hasPlane(kDroppedPlane)) counts_ = term_.addPlane<uint32_t>(kDroppedPlane);
    else if (counts_.empty()) counts_ = term_.writable<uint32_t>(kDroppedPlane);
    counts_[element] += uint32_t(count);
  }

 private:
  Term& term_;
  std::mutex mutex_;
  std::span<uint32_t> counts_;
};

/// The plane, or nothing.
inline std::span<const uint32_t> droppedPlane(const Term& term) {
  return term.hasPlane(kDroppedPlane) ? term.plane<uint32_t>(kDroppedPlane) : std::span<const uint32_t>{};
}

/// Adds the counts of `from` to those of `to`, whose elements are pixels; `from` may have layers of them.
inline void passOnDropped(const Term& from, Term& to) {
  const std::span<const uint32_t> counts = droppedPlane(from);
  if (counts.empty()) return;
  DroppedSamples sum(to);
  for (size_t i = 0; i < counts.size(); ++i) sum.add(i % to.extent().elements(), counts[i]);
}

struct DroppedTotal {
  uint64_t samples = 0, elements = 0;
};
inline DroppedTotal droppedTotal(const Term& term) {
  DroppedTotal total;
  for (const uint32_t count : droppedPlane(term)) {
    total.samples += count;
    total.elements += count > 0;
  }
  return total;
}

}  // namespace terms
}  // namespace gobo
