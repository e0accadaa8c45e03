// SPDX-License-Identifier: Apache-2.0
// Filter: comparisons over a kernel of the depth map (Reeves, Salesin, Cook 1987; thesis eq. 5.4), the exact target of the pre-filtered
// bases. Wide kernels that lie wholly on one side of the receiver are decided by the depth pyramid: one fetch where most pixels are.
#include <algorithm>
#include <cmath>
#include <optional>

#include "base/sobol.h"
#include "filters/shadow_map/depth_compare.h"
#include "filters/shadow_map/percentage_closer_kernels.h"

namespace gobo {
inline namespace filters {
namespace {

class PercentageCloserNode : public Node {
 public:
  explicit PercentageCloserNode(const PercentageCloserLookup& l) : l_(l), gaussian_(shadowGaussian(l.map.blur)) {
    // Texels that the kernel can meet before and after the one under a receiver.
    switch (l.pattern) {
      case v1::PercentageCloserShadow::GAUSSIAN:
        before_ = l.map.blur;
        after_ = l.map.blur + 1;
        break;
      case v1::PercentageCloserShadow::POISSON:
        before_ = l.taps / 2 + 1;
        after_ = l.taps / 2 + 2;
        break;
      case v1::PercentageCloserShadow::FOOTPRINT: before_ = after_ = kWidest / 2 + 1; break;
      default: before_ = after_ = (l.taps - 1) / 2 + 1; break;
    }
  }
  std::string type() const override { return l_.hard ? "shadow_map_lookup" : "percentage_closer"; }
  NodeTraits traits() const override { return {.tileable = true}; }
  void hashParameters(Hasher& h) const override {
    l_.frames.hash(h);
    h.add(int(l_.pattern)).add(l_.pattern == v1::PercentageCloserShadow::GAUSSIAN ? l_.map.blur : l_.taps).add(l_.hard).add(l_.map.bias).add(l_.map.slopeBias);
    if (footprints()) h.addPod(l_.view.eye).add(l_.view.perspective);
    if (turns()) l_.place.hash(h);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    Receivers::reads(w, 0, needs());
    if (w.input(1).find("bounds")) w.over(1, DepthBounds::extent(l_.map.resolution, l_.frames.count)).reads<float>(1, "bounds");
    else w.require(!readsDepthBounds(l_), "depth bounds").over(1, {l_.map.resolution, l_.map.resolution, l_.frames.count}).reads<float>(1, "z");
    return w.gives(visibilityOver(w.input(0), PlaneShape::Fill::Unset));
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& gbuffer = *ctx.inputs.at(0);
    const Term& map = *ctx.inputs.at(1);  // depth_bounds or, for kernels that do not ask it, light_depth_map
    std::optional<DepthBounds> bounds;
    if (map.type() == "depth_bounds") bounds.emplace(map, l_.map.resolution);
    Depths depths{bounds ? bounds->depth(0) : map.floats("z").data(), bounds ? bounds->faceTexels() : size_t(l_.map.resolution) * size_t(l_.map.resolution)};
    const Receivers receivers(gbuffer, l_.frames, l_.map.resolution, l_.view, needs());
    const FilmElements film(gbuffer.extent(), l_.place);
    const auto& term = ctx.result;
    const std::span<float> V = term->writable<float>("V");
    const bool skips = bounds && readsDepthBounds(l_);
    const bool bilinear = !l_.hard && l_.pattern == v1::PercentageCloserShadow::REGULAR && l_.taps == 2;
    const bool done = ctx.arena->parallelFor(
        V.size(), receiverGrain(texelsRead()),
        [&](size_t begin, size_t end) {
          ReceiverBlock b;
          int32_t verdict[ReceiverBlock::kSize];
          for (size_t first = begin; first < end; first += ReceiverBlock::kSize) {
            const int n = int(std::min<size_t>(ReceiverBlock::kSize, end - first));
            receivers.fill(first, n, b);
            if (bilinear) {
              bilinearComparisons(depths.z, l_.map.resolution, depths.faceTexels, b, n, l_.map.bias, l_.map.slopeBias, &V[first]);
              continue;
            }
            if (skips) {
              kernelVerdicts(*bounds, b, n, before_, after_, l_.map.bias, l_.map.slopeBias, verdict);
              for (int i = 0; i < n; ++i) V[first + size_t(i)] = float(verdict[i]);
            }
            for (int i = 0; i < n; ++i)
              if (!skips || verdict[i] == 2) V[first + size_t(i)] = b.covered[i] ? visibility(depths, b, i, film, first + size_t(i)) : 1.0f;
          }
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, type() + " stopped");
    return TermPtr(term);
  }

 private:
  static constexpr int kWidest = 16;  // texels a side of a FOOTPRINT kernel
  struct Depths {
    const float* z;
    size_t faceTexels;
  };
  ReceiverNeeds needs() const { return {.slopes = l_.map.slopeBias > 0.0f, .footprints = footprints()}; }
  /// Texels, at most.
  double texelsRead() const {
    if (l_.hard) return 1;
    const double side = turns() ? 4 * l_.taps : before_ + after_ + 1;  // a point of a disk takes as long as 16 texels: it is turned
    return side * side;
  }
  bool footprints() const { return !l_.hard && l_.pattern == v1::PercentageCloserShadow::FOOTPRINT; }
  bool turns() const { return !l_.hard && l_.pattern == v1::PercentageCloserShadow::POISSON; }

  float visibility(const Depths& depths, const ReceiverBlock& b, int i, const FilmElements& film, size_t element) const {
    const float* z = depths.z + size_t(b.face[i]) * depths.faceTexels;
    const int side = l_.map.resolution;
    const ReceiverPlane r = receiverPlane(b, i, l_.map.bias, l_.map.slopeBias);
    if (l_.hard) {
      const int x = int(r.x + 0.5f), y = int(r.y + 0.5f);
      return z[size_t(y) * size_t(side) + size_t(x)] < r.at(x, y) ? 0.0f : 1.0f;  // a depth that is no number is lit
    }
    if (turns()) return poisson(z, side, r, film(element));
    AxisKernel kx, ky;
    if (l_.pattern == v1::PercentageCloserShadow::GAUSSIAN) {
      interpolatedKernel(r.x, gaussian_.data(), l_.map.blur, kx);
      interpolatedKernel(r.y, gaussian_.data(), l_.map.blur, ky);
    } else if (footprints()) {
      // A box with the variance of the parallelogram that the pixel covers.
      const float least = float(std::max(l_.taps - 1, 1));
      boxKernel(r.x, std::clamp(std::sqrt(b.majorX[i] * b.majorX[i] + b.minorX[i] * b.minorX[i]), least, float(kWidest)), kx);
      boxKernel(r.y, std::clamp(std::sqrt(b.majorY[i] * b.majorY[i] + b.minorY[i] * b.minorY[i]), least, float(kWidest)), ky);
    } else {
      const float width = std::max(float(l_.taps - 1), 1e-3f);  // n x n comparisons: n - 1 texels, bilinear at the ends
      boxKernel(r.x, width, kx);
      boxKernel(r.y, width, ky);
    }
    return compareKernel(z, side, r, kx, ky);
  }

  // taps^2 points of Vogel's spiral, an even disk, turned by a hash of the view sample, by its place in the whole picture; nearest texels.
  float poisson(const float* z, int side, const ReceiverPlane& r, size_t element) const {
    const int count = l_.taps * l_.taps;
    const float radius = 0.5f * float(l_.taps);
    const float turn = float(hash64(element, 0x5eed) >> 40) * float(2 * M_PI / (1 << 24));
    int lit = 0;
    for (int k = 0; k < count; ++k) {
      const float distance = radius * std::sqrt((float(k) + 0.5f) / float(count)), angle = turn + 2.39996323f * float(k);
      const int x = int(std::floor(r.x + distance * std::cos(angle) + 0.5f)), y = int(std::floor(r.y + distance * std::sin(angle) + 0.5f));
      lit += !(z[size_t(std::clamp(y, 0, side - 1)) * size_t(side) + size_t(std::clamp(x, 0, side - 1))] < r.at(x, y));
    }
    return float(lit) / float(count);
  }

  PercentageCloserLookup l_;
  std::vector<float> gaussian_;
  int before_ = 0, after_ = 0;
};

}  // namespace

bool readsDepthBounds(const PercentageCloserLookup& l) {
  if (l.hard || !l.skip) return false;
  switch (l.pattern) {  // up to 4 texels a row, comparing is as fast as asking
    case v1::PercentageCloserShadow::GAUSSIAN: return 2 * l.map.blur + 2 > 4;
    case v1::PercentageCloserShadow::POISSON: return true;
    case v1::PercentageCloserShadow::FOOTPRINT: return false;
    default: return l.taps > 4;
  }
}

NodePtr makePercentageCloserNode(const PercentageCloserLookup& lookup) { return std::make_shared<PercentageCloserNode>(lookup); }

}  // namespace filters
}  // namespace gobo
