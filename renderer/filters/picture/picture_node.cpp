// SPDX-License-Identifier: Apache-2.0
#include "filters/picture/picture_node.h"

#include "terms/dropped_samples.h"

namespace gobo {
inline namespace filters {

NodeTraits PictureNode::linear(bool keepsRange) const {
  NodeTraits t;
  t.rangePreserving = keepsRange;
  t.linearPerGroup = keepsRange || !shape_.share;
  return t;
}

void PictureNode::hashParameters(Hasher& h) const {
  h.add(shape_.extent.width).add(shape_.extent.height).add(shape_.extent.layers).add(int(shape_.domain));
  h.add(shape_.plane).add(shape_.channels).add(shape_.share);
  hashSettings(h);
}

Result<TermShape> PictureNode::infer(std::span<const TermShape> in) const {
  Wiring w(type(), in, 1);
  w.over(0, shape_.extent).reads<float>(0, shape_.plane, {shape_.channels});
  w.require(w.input(0).domain == shape_.domain, "another domain");
  TermShape out{w.input(0).type, shape_.domain, shape_.extent, {unsetPlane<float>(shape_.plane, shape_.channels)}};
  passOnDropped(w.input(0), out);
  return w.gives(std::move(out));
}

Result<TermPtr> PictureNode::run(const RunContext& ctx) const {
  const auto out = ctx.result->writable<float>(shape_.plane);
  GOBO_TRY(apply(ctx.inputs[0]->floats(shape_.plane), out, ctx));
  if (ctx.stop.stopRequested()) return pictureStopped();
  if (shape_.share && !traits().linearPerGroup) {  // a linear one of shares keeps them by itself
    const bool complete = ctx.arena->parallelFor(
        out.size(), 1 << 16,
        [&](size_t b, size_t e) {
          for (size_t i = b; i < e; ++i) out[i] = std::clamp(out[i], 0.0f, 1.0f);
        },
        ctx.stop);
    if (!complete) return pictureStopped();
  }
  passOnDropped(*ctx.inputs[0], *ctx.result);
  return TermPtr(ctx.result);
}

}  // namespace filters
}  // namespace gobo
