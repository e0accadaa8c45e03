// SPDX-License-Identifier: Apache-2.0
#include "measure/certificate.h"

#include <algorithm>
#include <cmath>

#include "measure/confidence.h"

namespace gobo {
inline namespace measure {

CertificateFigures certify(const std::vector<PixelEvidence>& evidence, uint64_t pixels) {
  CertificateFigures out;
  std::vector<DrawnValue> squared, leaning, jackknife;
  for (auto* v : {&squared, &leaning, &jackknife}) v->reserve(evidence.size());
  double broken = 0;  // pixels that evidence without figures stands for
  for (const PixelEvidence& e : evidence) {
    if (!isFinite(e.picture) || !std::all_of(e.parts.begin(), e.parts.end(), [](const Vec3& v) { return isFinite(v); })) {
      ++out.nonFinite;
      broken += 1 / e.chance;
      continue;
    }
    out.certain += e.chance >= 1;
    double excess = 0;  // of the picture over the reference
    for (const Vec3& part : e.parts)
      for (int c = 0; c < 3; ++c) excess += double(e.picture[c]) - part[c];
    const bool dark = excess < 0;
    const PartsEstimate s = squaredErrorOfParts(e.picture, e.parts);
    const RelativePartsEstimate r = relativeErrorOfParts(e.picture, e.parts);
    squared.push_back({s.value, s.noise, s.spread, e.chance, dark});
    // The weights follow the parts, which the jackknife does not see: each pixel's value is doubted as a whole.
    const double doubted = std::max(r.leaning.noise, r.leaning.value * r.leaning.value);
    leaning.push_back({r.leaning.value, doubted, r.leaning.spread, e.chance, dark});
    jackknife.push_back({r.jackknife, doubted, r.leaning.spread, e.chance, dark});
  }
  const double all = double(pixels);
  const DrawnInterval mse = drawnInterval(squared, all), rel = drawnInterval(leaning, all), other = drawnInterval(jackknife, all);
  out.unseenArea = pixels == 0 ? 1.0 : std::min(1.0, mse.unseenArea + broken / all);
  const double positive = std::max(mse.mean, 0.0);
  out.rmse = std::sqrt(positive);
  out.rmseLow = std::sqrt(mse.low);
  out.rmseHigh = std::sqrt(mse.high);
  out.rmseHighTrimmed = std::sqrt(mse.highTrimmed);
  out.rmseStandardError = std::sqrt(positive + mse.standardError) - out.rmse;
  out.relMse = std::max(rel.mean, 0.0);
  const double doubt = std::fabs(rel.mean - other.mean);  // skewed noise biases both to the same side
  out.relMseLow = std::max(0.0, std::min(rel.low, other.low) - doubt);
  out.relMseHigh = std::max(rel.high, other.high) + doubt;
  out.relMseHighTrimmed = std::max(rel.highTrimmed, other.highTrimmed) + doubt;
  return out;
}

}  // namespace measure
}  // namespace gobo
