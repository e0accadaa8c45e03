// SPDX-License-Identifier: Apache-2.0
// What shadows.auto chooses among, and what each candidate costs.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "filters/automatic/automatic.h"
#include "filters/automatic/shadow_probe.h"

namespace gobo {
inline namespace filters {

/// Predicted time of a candidate, and how a map is judged.
struct CandidateCost {
  double ms = 0;                       ///< whatever is seen
  double receiver = 0;                 ///< ns, a view sample that the light can shine on
  double mapMs = 0;                    ///< soft maps: part of ms, what there is to make before lookups can be judged
  int resolution = 0, taps = 0;        ///< soft maps; of the filter
  std::optional<ProbeMap> virtualMap;  ///< hard maps; soft ones are made: their lookups read too many texels for a ray each
  /// Of a picture of `samples` view samples, `receivers` of which the light can shine on; `work`: AutomaticCandidate::work.
  double time(double samples, double receivers, std::span<const double> work) const;
};
struct Candidates {
  std::vector<AutomaticCandidate> list;
  std::vector<CandidateCost> costs;  ///< of each
  std::vector<uint32_t> rays;        ///< of the first in the list
  double probeRay = 0;               ///< ns, of a look (decision.h)
};
/// Whether the light has shadows with penumbras.
bool castsSoftShadows(const LightShape& light);
/// Errors: those of maps that do not fit the scene.
Result<Candidates> shadowCandidates(const ShadowInput& input, const v1::ShadowTechnique& technique);

}  // namespace filters
}  // namespace gobo
