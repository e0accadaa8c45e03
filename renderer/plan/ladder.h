// SPDX-License-Identifier: Apache-2.0
// What a progressive reply shows and when. First a small picture of one sample a pixel, a request of its own, so that what it shows can be asked for again;
// then the whole one after 1, 2, 4, 8, 16, 32, ... samples, each of which is the beginning of the next (trace/sample_passes.h): nothing is traced twice, and
// the last has the bits that it has without the others.
#pragma once

#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace plan {

/// How much smaller each way the small picture is.
inline constexpr uint32_t kShrink = 4, kShrinkMore = 8;

/// How long small pictures of each scene took, so that the next one is there soon: smaller where that takes longer than a look, or where so many wait that
/// each has a long turn, and where nobody knows yet. Thread-safe.
class RungPace {
 public:
  /// kShrink, or kShrinkMore: of a picture of `pixels` that `waiting` others wait for as well.
  uint32_t shrink(const std::string& scene, uint64_t pixels, size_t waiting) const;
  /// A picture of `pixels` took `ms`.
  void took(const std::string& scene, uint64_t pixels, double ms);

 private:
  mutable std::mutex mutex_;
  std::map<std::string, double> msPerPixel_;  // bounded: forgotten all at once
};

/// A quarter of the size each way, or as `shrink` says; nothing for pictures that are small themselves, and for windows (their place in the whole is what they
/// are).
std::optional<v1::RenderRequest> smallRung(const v1::RenderRequest& resolved, uint32_t shrink = kShrink);

/// The small picture path traced, for where its own techniques have to look, fit or precompute first; nothing where it asks for none of them, or for outputs
/// that only they have.
std::optional<v1::RenderRequest> plainRung(const v1::RenderRequest& rung);
/// A small picture for which that is expected to take longer is path traced instead, ms.
inline constexpr double kRungMs = 50;

/// How many samples a pixel the next picture shall have, when `spp` of at most `most` are there. Times in ms.
struct RungTimes {
  double perSample = 0;  ///< that the last samples of all pixels took, each; 0: nobody knows
  bool rough = false;    ///< that has in it what is made once
  double left = -1;      ///< until the time that the request gives is up; negative: it gives none
};
/// `spp` itself where nothing more fits into the time that is left. Counts are realised as they are: samplesOf() of some passes.
uint32_t nextRung(uint32_t spp, uint32_t most, const RungTimes& times);

}  // namespace plan
}  // namespace gobo
