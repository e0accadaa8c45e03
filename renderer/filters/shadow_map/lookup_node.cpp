// SPDX-License-Identifier: Apache-2.0
// Filter: G-buffer positions + filtered basis -> visibility. Per block of receivers: coordinates, fetches, reconstruction; each a loop.
#include <algorithm>

#include "filters/shadow_map/depth_compare.h"
#include "filters/shadow_map/exponential_device.h"
#include "filters/shadow_map/shadow_texture.h"
#include "filters/shadow_map/summed_area.h"
#include "formulas/math.glsl.h"

namespace gobo {
inline namespace filters {
namespace {

using Settings = v1::ShadowMapSettings;
using Exponential = v1::ExponentialShadow;

class LookupNode : public Node {
 public:
  LookupNode(ShadowBasisPtr basis, const ShadowLookup& lookup, std::shared_ptr<ComputeDevice> device)
      : basis_(std::move(basis)), l_(lookup), device_(std::move(device)), gaussian_(shadowGaussian(lookup.map.blur)) {}
  std::string type() const override { return "shadow_lookup"; }
  int version() const override { return device_ ? 2 : 1; }  // 2, of devices: what turns away from the light is lit
  std::string numericClass() const override { return device_ ? device_->numericClass() : Node::numericClass(); }
  std::string device() const override { return device_ ? std::string(device_->kind()) + ": " + device_->name() : "cpu"; }
  NodeTraits traits() const override { return {.tileable = true}; }
  void hashParameters(Hasher& h) const override {
    l_.frames.hash(h);
    h.add(std::string_view(basis_->name())).add(l_.map.bias).add(int(l_.map.lookup));
    basis_->hashEncode(h);
    basis_->hashReconstruct(h);
    if (basis_->comparesDepth()) h.add(l_.map.slopeBias).add(l_.map.blur);
    if (footprints()) h.add(l_.map.anisotropy).add(l_.map.blur).addPod(l_.view.eye).add(l_.view.perspective);
    if (classified()) h.add(int(l_.classification)).add(l_.epsilon).add(l_.fallbackKernel).add(l_.map.slopeBias).add(l_.map.blur);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, classified() ? 3 : 2);
    Receivers::reads(w, 0, needs());
    const int side = l_.map.resolution, faces = l_.frames.count;
    const Extent& map = w.input(1).extent;
    if (l_.map.lookup == Settings::SUMMED_AREA) w.over(1, SummedArea::extent(side, faces)).reads<uint32_t>(1, "sums", {basis_->channels()});
    else readsBasis(w, 1, basis_->channels()).require(side == 0 || map == Extent{side, side, faces} || map == mipExtent(side, faces), "a map of its size");
    if (classified()) w.over(2, DepthBounds::extent(side, faces)).reads<float>(2, "bounds");
    TermShape out = visibilityOver(w.input(0), PlaneShape::Fill::Unset);
    if (classified()) out.planes.push_back(plane<float>("flags"));
    return w.gives(std::move(out));
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& gbuffer = *ctx.inputs.at(0);
    const Term& map = *ctx.inputs.at(1);
    const auto& term = ctx.result;
    const std::span<float> V = term->writable<float>("V");
    const std::span<float> flags = classified() ? term->writable<float>("flags") : std::span<float>();
    if (l_.map.resolution == 0) {  // an empty map reaches nowhere
      std::fill(V.begin(), V.end(), 1.0f);
      return TermPtr(term);
    }
    const Receivers receivers(gbuffer, l_.frames, l_.map.resolution, l_.view, needs());
    if (device_) {
      GOBO_TRY(deviceLookup(ResidentPlanes::of(device_), {l_.frames.face[0], basis_->exponent(), l_.map.bias}, ctx.inputs[1], ctx.inputs[0], V, ctx.stop));
      if (!lightAway(ctx, receivers, V)) return Status(Code::Cancelled, "shadow_lookup stopped");
      return TermPtr(term);
    }
    std::optional<ShadowTexture> texture;
    std::optional<SummedArea> sums;
    std::optional<DepthBounds> bounds;
    if (l_.map.lookup == Settings::SUMMED_AREA) sums.emplace(map, l_.map.resolution);
    else texture.emplace(map, l_.map.resolution, basis_->logarithmic());
    if (classified()) bounds.emplace(*ctx.inputs.at(2), l_.map.resolution);
    const bool done = ctx.arena->parallelFor(
        V.size(), receiverGrain(classified() ? repairReads() : 1),
        [&](size_t begin, size_t end) {
          ReceiverBlock b;
          std::vector<float> values(size_t(basis_->channels()) * kN);
          for (size_t first = begin; first < end; first += kN) {
            const int n = int(std::min<size_t>(kN, end - first));
            receivers.fill(first, n, b);
            fetch(texture, sums, b, n, values.data());
            float d[kN], s[kN];
            for (int i = 0; i < n; ++i) d[i] = b.d[i] - l_.map.bias;
            if (basis_->comparesDepth()) {
              for (int i = 0; i < n; ++i) {  // the surface's own depth changes over the kernel
                const Vec2 reach = this->reach(b, i, 0.5f);
                d[i] -= l_.map.slopeBias * (reach.x * std::fabs(b.slopeX[i]) + reach.y * std::fabs(b.slopeY[i]));
              }
            }
            basis_->reconstruct(values.data(), kN, d, s, size_t(n));
            if (classified()) repair(*bounds, b, n, s, &flags[first]);
            for (int i = 0; i < n; ++i) V[first + size_t(i)] = b.covered[i] ? std::clamp(s[i], 0.0f, 1.0f) : 1.0f;
          }
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, "shadow_lookup stopped");
    return TermPtr(term);
  }

 private:
  static constexpr int kN = ReceiverBlock::kSize;
  ReceiverNeeds needs() const { return {.slopes = (basis_->comparesDepth() || classified()) && l_.map.slopeBias > 0.0f, .footprints = footprints()}; }
  bool footprints() const { return l_.map.lookup != Settings::BILINEAR; }
  bool classified() const { return l_.classification == Exponential::THRESHOLD || l_.classification == Exponential::Z_MAX; }

  /// Devices know no normals: what turns away from the light is lit after them, by the rule that receivers here have. False: stopped.
  static bool lightAway(const RunContext& ctx, const Receivers& receivers, std::span<float> V) {
    return ctx.arena->parallelFor(
        V.size(), 4096,
        [&](size_t begin, size_t end) {
          ReceiverBlock b;
          for (size_t first = begin; first < end; first += kN) {
            const int n = int(std::min<size_t>(kN, end - first));
            std::fill_n(b.covered, n, 1);
            receivers.facing(first, n, b);
            for (int i = 0; i < n; ++i)
              if (!b.covered[i]) V[first + size_t(i)] = 1.0f;
          }
        },
        ctx.stop);
  }

  // Half sides, in texels, of the region around receiver i whose surface the lookup averages: the pre-filter and the footprint, or `least`
  // beyond the pre-filter where the footprint is smaller.
  Vec2 reach(const ReceiverBlock& b, int i, float least) const {
    const float blur = float(l_.map.blur);
    if (!footprints()) return Vec2(blur + least);
    const Vec2 major(b.majorX[i], b.majorY[i]), minor(b.minorX[i], b.minorY[i]);
    if (l_.map.lookup == Settings::TRILINEAR) return Vec2(blur + std::max(least, 0.5f * std::max(glm::length(major), glm::length(minor))));
    return Vec2(blur + std::max(least, 0.5f * (std::fabs(major.x) + std::fabs(minor.x))),
                blur + std::max(least, 0.5f * (std::fabs(major.y) + std::fabs(minor.y))));
  }

  // Texels of the map that the lookup can touch around receiver i, beyond those that hold its position: what Z_MAX asks about. A trilinear
  // lookup at level l reads texels up to 1.5 of the next level's away: 1.5 * 2^(l + 1) <= 6 times the footprint's half side; with more taps along
  // the axis, that of the taps' size more. On bilinear lookups exactly the pre-filter.
  Vec2 touched(const ReceiverBlock& b, int i) const {
    const float blur = float(l_.map.blur);
    if (!footprints()) return Vec2(blur);
    const Vec2 major(b.majorX[i], b.majorY[i]), minor(b.minorX[i], b.minorY[i]);
    const float longer = std::max(glm::length(major), glm::length(minor));
    if (l_.map.lookup == Settings::TRILINEAR) return Vec2(blur + 3.0f * std::max(longer, 1.0f));
    const float shorter = std::min(glm::length(major), glm::length(minor));
    const float tap = 3.0f * std::max({shorter, longer / float(l_.map.anisotropy), 1.0f});
    return Vec2(blur + tap) + 0.5f * Vec2(std::max(std::fabs(major.x), std::fabs(minor.x)), std::max(std::fabs(major.y), std::fabs(minor.y)));
  }

  void fetch(const std::optional<ShadowTexture>& texture, const std::optional<SummedArea>& sums, const ReceiverBlock& b, int n, float* values) const {
    if (l_.map.lookup == Settings::BILINEAR) return texture->bilinear(b, n, values, kN);
    float one[2 * 32 * 2 + 1];
    const int channels = basis_->channels();
    for (int i = 0; i < n; ++i) {
      const Vec2 major(b.majorX[i], b.majorY[i]), minor(b.minorX[i], b.minorY[i]);
      switch (l_.map.lookup) {
        case Settings::TRILINEAR:
          texture->trilinear(b.face[i], b.x[i], b.y[i], std::log2(std::max({glm::length(major), glm::length(minor), 1.0f})), one);
          break;
        case Settings::ANISOTROPIC: texture->anisotropic(b.face[i], b.x[i], b.y[i], major, minor, l_.map.anisotropy, one); break;
        default: {  // the box around the footprint, at least what bilinear lookups span
          const float width = std::max(std::fabs(major.x) + std::fabs(minor.x), 1.0f), height = std::max(std::fabs(major.y) + std::fabs(minor.y), 1.0f);
          sums->box(b.face[i], b.x[i], b.y[i], width, height, one);
        }
      }
      for (int k = 0; k < channels; ++k) values[size_t(k) * kN + size_t(i)] = one[k];
    }
  }

  // Upper bound of what a lit plane of the receiver's slope gives: e^{x^2 / 2}, x^2 = c^2 (m_x^2 v_x + m_y^2 v_y), m the slope and v the kernel's
  // variance (digest 6.4). It is no violation.
  float overshoot(const ReceiverBlock& b, int i) const {
    const float blur = l_.map.blur ? (2.0f * float(l_.map.blur) + 1.0f) / 4.0f : 0.0f, c = basis_->exponent();
    const Vec2 beyond = reach(b, i, 0.5f) - Vec2(float(l_.map.blur));
    const float x = c * b.slopeX[i], y = c * b.slopeY[i];
    return formulas::fastExp(0.5f * (x * x * (blur * blur + beyond.x * beyond.x) + y * y * (blur * blur + beyond.y * beyond.y)));
  }

  static constexpr int kExact = 1024;  // texels that reachesBehind() reads at most

  // Is any depth that the lookup reads further behind the receiver than its own surface spans? The pyramid's bounds first, wider than the
  // kernel by up to its size; then, for kernels that are not large, its texels.
  bool reachesBehind(const DepthBounds& bounds, const ReceiverBlock& b, int i) const {
    const int side = l_.map.resolution;
    const Vec2 t = touched(b, i);
    const auto low = [](float at, float by) { return std::max(int(at - std::min(by, at)), 0); };
    const auto high = [&](float at, float by) { return std::min(int(at + std::min(by, float(side))) + 1, side - 1); };
    const int x0 = low(b.x[i], t.x), x1 = high(b.x[i], t.x), y0 = low(b.y[i], t.y), y1 = high(b.y[i], t.y);
    float lo, hi;
    bounds.range(b.face[i], x0, y0, x1, y1, lo, hi);
    const float own = std::fabs(b.slopeX[i]) * (t.x + 1.0f) + std::fabs(b.slopeY[i]) * (t.y + 1.0f);
    const float end = b.d[i] + own + l_.epsilon / basis_->exponent();
    if (!(end < hi) || (x1 - x0 + 1) * (y1 - y0 + 1) > kExact) return end < hi;
    hi = 0.0f;
    for (int y = y0; y <= y1; ++y) {
      const float* row = bounds.depth(b.face[i]) + size_t(y) * size_t(side);
      for (int x = x0; x <= x1; ++x) hi = std::max(hi, row[x]);
    }
    return end < hi;
  }

  /// Texels, at most.
  double repairReads() const {
    const double side = 2 * (l_.fallbackKernel ? l_.map.blur : 0) + 2;
    return kExact + side * side;
  }

  // Thesis 7.3: where the kernel reaches behind the receiver the exponential has no meaning; there depths are compared.
  void repair(const DepthBounds& bounds, const ReceiverBlock& b, int n, float* s, float* flags) const {
    const int side = l_.map.resolution, radius = l_.fallbackKernel ? l_.map.blur : 0;
    static constexpr float kOne[1] = {1.0f};
    for (int i = 0; i < n; ++i) {
      flags[i] = 0.0f;
      if (!b.covered[i]) continue;
      const ReceiverPlane r = receiverPlane(b, i, l_.map.bias, l_.map.slopeBias);
      if (!(l_.classification == Exponential::THRESHOLD ? s[i] > (1.0f + l_.epsilon) * overshoot(b, i) : reachesBehind(bounds, b, i))) continue;
      flags[i] = 1.0f;
      AxisKernel kx, ky;
      interpolatedKernel(b.x[i], radius ? gaussian_.data() : kOne, radius, kx);
      interpolatedKernel(b.y[i], radius ? gaussian_.data() : kOne, radius, ky);
      const KernelVerdict v = kernelVerdict(bounds, b.face[i], r, kx.first, ky.first, kx.last(), ky.last());
      s[i] = v == KernelVerdict::Lit ? 1.0f : v == KernelVerdict::Dark ? 0.0f : compareKernel(bounds.depth(b.face[i]), side, r, kx, ky);
    }
  }

  ShadowBasisPtr basis_;
  ShadowLookup l_;
  std::shared_ptr<ComputeDevice> device_;
  std::vector<float> gaussian_;
};

}  // namespace

NodePtr makeShadowLookupNode(ShadowBasisPtr basis, const ShadowLookup& lookup, std::shared_ptr<ComputeDevice> device) {
  return std::make_shared<LookupNode>(std::move(basis), lookup, std::move(device));
}

}  // namespace filters
}  // namespace gobo
