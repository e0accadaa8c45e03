// SPDX-License-Identifier: Apache-2.0
#include "filters/soft_shadow/blocker_search.h"

#include <algorithm>

#include "formulas/soft_shadow.glsl.h"

namespace gobo {
inline namespace filters {

using namespace formulas;

bool BlockerSearch::run(const SoftReceivers& receivers, const DepthBounds& bounds, size_t first, int count, bool skip, float* V, Work& w,
                        const StopToken& stop) const {
  SoftBlock& b = w.b;
  receivers.fill(first, count, b, V);
  w.count = 0;
  w.taps.count = 0;
  std::fill_n(w.done, count, SoftWork());
  softSearches(receivers, bounds, b, w.search);
  for (int k = 0; k < b.activeCount; ++k) {
    const int i = b.active[k];
    if (skip && w.search[i].verdict != SoftSearch::Mixed) {
      V[i] = w.search[i].verdict == SoftSearch::Lit ? 1.0f : 0.0f;
      continue;
    }
    w.open[w.count++] = i;
    if (pattern_.taps == 0 || softTexels(w.search[i].box) <= kDensePerTap * pattern_.taps) continue;
    w.done[i].taps += float(pattern_.taps);
    w.taps.add(b, i, w.search[i].box, bounds.faceTexels(), receivers.filmElement(first + size_t(i)));
  }
  // Few taps in a wide box miss what little there is in it: a probe finds how near to the light blockers really are, and the box shrinks to that.
  if (w.taps.count) softProbe(bounds.depth(0), bounds.resolution(), pattern_, b.perspective, w.taps);
  for (int k = 0; k < w.taps.count; ++k) {
    SoftSearch& s = w.search[w.taps.receiver[k]];
    if (w.taps.nearest[k] > 1.0f || w.taps.nearest[k] <= s.lo) continue;
    receivers.width(b, w.taps.receiver[k], receivers.metric(b.at.face[w.taps.receiver[k]], w.taps.nearest[k]), s.wx, s.wy);
    s.box = receivers.box(b, w.taps.receiver[k], s.wx, s.wy);
  }
  if (!softSums(SoftAsk::Blockers, receivers, bounds, pattern_, first, w, stop, [&](int i) { return w.search[i].box; })) return false;
  int blocked = 0;
  for (int k = 0; k < w.count; ++k) {
    const int i = w.open[k];
    V[i] = 1.0f;
    if (!(w.blocked[i] > 0.0f)) continue;
    const float z = softBlocker(w.depth[i], w.blocked[i], w.search[i].lo, b.limit[i], w.search[i].lo);
    receivers.width(b, i, receivers.metric(b.at.face[i], z), w.wx[i], w.wy[i]);
    w.open[blocked++] = i;
  }
  w.count = blocked;
  return true;
}

}  // namespace filters
}  // namespace gobo
