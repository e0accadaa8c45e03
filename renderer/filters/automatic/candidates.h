// SPDX-License-Identifier: Apache-2.0
// What shadows.auto chooses among, and what each candidate costs.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "filters/automatic/automatic.h"
#include "filters/automatic/probe_windows.h"
#include "filters/automatic/shadow_probe.h"
#include "filters/soft_shadow/soft_kernels.h"

namespace gobo {
inline namespace filters {

/// Predicted time of a candidate, and how a map is judged.
struct CandidateCost {
  double ms = 0;                                     ///< whatever is seen
  double receiver = 0;                               ///< ns, a view sample that the light can shine on
  double judgeMs = 0;                                ///< what there is to make before it can be judged: a soft map (part of ms), windows that are filtered
  int resolution = 0, taps = 0;                      ///< soft maps; of the filter
  uint32_t filtered = 0;                             ///< axis-aligned filtering: rays of a view sample in a penumbra; 0: none
  std::array<double, SoftWork::kChannels> workNs{};  ///< ns of each of AutomaticCandidate::work
  std::optional<ProbeMap> virtualMap;                ///< hard maps; soft ones are made: their lookups read too many texels for a ray each
  /// Of a picture of `samples` view samples, `receivers` of which the light can shine on; `work`: AutomaticCandidate::work.
  double time(double samples, double receivers, std::span<const double> work) const;
};
struct Candidates {
  std::vector<AutomaticCandidate> list;
  std::vector<CandidateCost> costs;  ///< of each
  std::vector<uint32_t> rays;        ///< of the first in the list
  double probeRay = 0;               ///< ns, of a look (decision.h)
};
constexpr uint32_t kFilterPilot = 4;  ///< rays of axis-aligned filtering wherever the light can shine: the schema's default

/// The windows that axis-aligned filtering is judged by; camera, size and seed are the caller's.
ProbeWindowsSettings filterWindows(int viewSamples);
/// Whether the light has shadows with penumbras.
bool castsSoftShadows(const LightShape& light);
/// Errors: those of maps that do not fit the scene.
Result<Candidates> shadowCandidates(const ShadowInput& input, const v1::ShadowTechnique& technique);

}  // namespace filters
}  // namespace gobo
