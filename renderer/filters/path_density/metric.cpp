// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/metric.h"

#include <algorithm>

namespace gobo::pathdensity {

namespace {

constexpr float kMost = 1e18f;  // of light and of coordinates, whose squares are finite

}  // namespace

bool makePoints(const SampleView& s, const SampleBins& bins, const Metric& metric, LightTerm term, MetricPoints& p, const TaskArena& arena,
                const StopToken& stop) {
  const size_t n = s.size();
  for (std::vector<float>* v : {&p.x, &p.y, &p.l, &p.a, &p.b}) v->resize(n);
  const float perPixel = 1.0f / metric.filmScale, perColour = 1.0f / metric.colourScale, perLight = 1.0f / metric.white;
  return arena.parallelFor(
      n, 1 << 14,
      [&](size_t begin, size_t end) {
        for (size_t k = begin; k < end; ++k) {
          const size_t i = bins.order[k];
          p.x[k] = s.film[2 * i] * perPixel;
          p.y[k] = s.film[2 * i + 1] * perPixel;
          float* const colour[3] = {&p.l[k], &p.a[k], &p.b[k]};
          for (size_t c = 0; c < 3; ++c) {
            const float direct = term == LightTerm::Indirect ? 0.0f : s.directAt(3 * i + c),
                        indirect = term == LightTerm::Direct ? 0.0f : s.indirect[3 * i + c];
            *colour[c] = std::clamp((direct + indirect) * perLight, -kMost, kMost);
          }
        }
        float scale = perColour;
        if (metric.space == ColourSpace::Lab) labOf(&p.l[begin], &p.a[begin], &p.b[begin], int(end - begin));
        else scale *= 100.0f;
        for (std::vector<float>* v : {&p.l, &p.a, &p.b})
          for (size_t k = begin; k < end; ++k) (*v)[k] = std::clamp((*v)[k] * scale, -kMost, kMost);
      },
      stop);
}

}  // namespace gobo::pathdensity
