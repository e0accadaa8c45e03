// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/depth_bounds.h"

#include <algorithm>

#include "formulas/shadow_map.glsl.h"

namespace gobo {
inline namespace filters {

MipLevel mipLevel(int resolution, int level) {
  MipLevel m{0, resolution};
  for (int l = 0; l < level; ++l) {
    m.offset += size_t(m.side) * size_t(m.side);
    m.side = (m.side + 1) / 2;
  }
  return m;
}

int mipLevels(int resolution) {
  int n = 1;
  while (resolution > 1) {
    resolution = (resolution + 1) / 2;
    ++n;
  }
  return n;
}

DepthBounds::DepthBounds(const Term& term, int resolution) : texels_(term.floats("bounds").data()), resolution_(resolution) {
  faceTexels_ = size_t(term.extent().width) * size_t(term.extent().height);
  GOBO_CHECK_EQ(faceTexels_, faceSize(resolution));
  const int levels = mipLevels(resolution);
  GOBO_CHECK(levels <= kMaxLevels);
  const size_t chain = mipTexels(resolution) - size_t(resolution) * size_t(resolution);
  for (int l = 0; l < kMaxLevels; ++l) {
    const MipLevel m = mipLevel(resolution, std::min(l, levels - 1));
    lo_[l] = m.offset;
    hi_[l] = m.offset + (m.offset ? chain : 0);
    side_[l] = m.side;
  }
}

namespace {

class DepthBoundsNode : public Node {
 public:
  DepthBoundsNode(int resolution, int faces) : resolution_(resolution), faces_(faces) {}
  std::string type() const override { return "depth_bounds"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher&) const override {}
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, {resolution_, resolution_, faces_}).reads<float>(0, "z");
    return w.gives({type(), Domain::LightTexel, DepthBounds::extent(resolution_, faces_), {unsetPlane<float>("bounds")}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& depth = *ctx.inputs.at(0);
    const Extent e = depth.extent();
    const std::span<const float> z = depth.floats("z");
    const size_t packed = DepthBounds::faceSize(resolution_), square = size_t(resolution_) * size_t(resolution_), chain = mipTexels(resolution_) - square;
    const auto& term = ctx.result;
    const auto bounds = term->writable<float>("bounds");
    for (int face = 0; face < e.layers; ++face) {
      float* base = &bounds[size_t(face) * packed];
      const float* depths = &z[size_t(face) * square];
      if (!ctx.arena->parallelFor(
              square, 1 << 16,
              [&](size_t from, size_t to) {
                for (size_t i = from; i < to; ++i) base[i] = formulas::shadowDepth(depths[i]);
              },
              ctx.stop))
        return Status(Code::Cancelled, "depth_bounds stopped");
      for (int l = 1; l < mipLevels(resolution_); ++l) {
        const MipLevel from = mipLevel(resolution_, l - 1), to = mipLevel(resolution_, l);
        const bool done = ctx.arena->parallelFor(
            size_t(to.side), 64,
            [&](size_t begin, size_t end) {
              const float *low = base + from.offset, *high = base + from.offset + (l > 1 ? chain : 0);
              for (size_t y = begin; y < end; ++y) {
                const size_t y0 = 2 * y * size_t(from.side), y1 = std::min(2 * y + 1, size_t(from.side - 1)) * size_t(from.side),
                             out = to.offset + y * size_t(to.side);
                row(low + y0, low + y1, base + out, from.side, to.side, [](float a, float b) { return a < b ? a : b; });
                row(high + y0, high + y1, base + out + chain, from.side, to.side, [](float a, float b) { return a > b ? a : b; });
              }
            },
            ctx.stop);
        if (!done) return Status(Code::Cancelled, "depth_bounds stopped");
      }
    }
    return TermPtr(term);
  }

 private:
  template <typename Pick>
  static void row(const float* a, const float* b, float* out, int from, int to, Pick pick) {
    const int whole = from / 2;
    for (int x = 0; x < whole; ++x) out[x] = pick(pick(a[2 * x], a[2 * x + 1]), pick(b[2 * x], b[2 * x + 1]));
    if (whole < to) out[whole] = pick(a[from - 1], b[from - 1]);
  }
  int resolution_, faces_;
};

}  // namespace

NodePtr makeDepthBoundsNode(int resolution, int faces) { return std::make_shared<DepthBoundsNode>(resolution, faces); }

}  // namespace filters
}  // namespace gobo
