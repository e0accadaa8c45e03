// SPDX-License-Identifier: Apache-2.0
// A pixel's samples in the order in which pictures take them: blocks of 16, the first one in passes of 1, 1, 2, 4 and 8 samples, so that a picture of
// few samples is the beginning of the one of many: what the first picture of a progressive render traced is part of its last. Whoever traces the first
// block does it in these passes, each with the same neighbours in the kernel's lanes, so that the result does not depend on where a render began or stopped.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

namespace gobo {
inline namespace trace {

inline constexpr uint32_t kBlockSamples = 16;
inline constexpr uint32_t kFirstPasses = 5;  ///< of the first block

struct SamplePass {
  uint32_t block = 0;             ///< which block of samples it is of
  uint32_t first = 0, count = 0;  ///< samples of that block
};

constexpr SamplePass samplePass(uint32_t index) {
  if (index >= kFirstPasses) return {index - kFirstPasses + 1, 0, kBlockSamples};
  return index == 0 ? SamplePass{0, 0, 1} : SamplePass{0, 1u << (index - 1), 1u << (index - 1)};
}
/// Samples that a pixel has after so many passes.
constexpr uint32_t samplesOf(uint32_t passes) {
  if (passes > kFirstPasses) return (passes - kFirstPasses + 1) * kBlockSamples;
  return passes == 0 ? 0 : 1u << (passes - 1);
}
/// The fewest passes that give at least so many samples; samplesOf(passesFor(n)) is what `n` is realised as.
constexpr uint32_t passesFor(uint32_t samples) {
  if (samples > kBlockSamples) return kFirstPasses - 1 + (samples - 1) / kBlockSamples + 1;
  return samples == 0 ? 0 : uint32_t(std::bit_width(samples - 1)) + 1;
}
/// One of several pictures that take turns in one sequence of numbers (slices of a shutter): each has an aligned part of every pass of all of them, so that
/// after any number of passes they are together the beginning of the sequence, each number once.
struct SequenceShare {
  uint32_t index = 0, of = 1;
};
/// Where in the sequence the samples of a pass are that begins at sample `first` of the picture alone.
constexpr uint32_t sharedFirst(uint32_t first, uint32_t count, const SequenceShare& share) { return first * share.of + share.index * count; }
/// Samples of the first `samples` of a pixel that are of stream k of `streams`, blocks being dealt out to the streams in turn.
constexpr uint32_t samplesOfStream(uint32_t samples, uint32_t k, uint32_t streams) {
  const uint32_t blocks = samples / kBlockSamples, rest = k == blocks % streams ? samples % kBlockSamples : 0;
  return (blocks > k ? (blocks - k - 1) / streams + 1 : 0) * kBlockSamples + rest;
}

}  // namespace trace
}  // namespace gobo
