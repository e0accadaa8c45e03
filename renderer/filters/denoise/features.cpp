// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/features.h"

#include <cmath>

#include "base/vec.h"
#include "terms/surface.h"

namespace gobo::denoise {

namespace {

class FeaturesNode final : public Node {
 public:
  FeaturesNode(int width, int height, int samples, LobePart lobe) : width_(width), height_(height), samples_(samples), lobe_(lobe) {}
  std::string type() const override { return "denoise_features"; }
  int version() const override { return 2; }  // 2: the plane even
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(samples_).add(lobe_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, {width_, height_, samples_}).reads<float>(0, "P", {3}).reads<float>(0, "N", {3}).reads<float>(0, "depth").reads<float>(0, "footprint");
    w.over(1, {width_, height_, samples_}).reads<float>(1, "albedo", {3}).reads<float>(1, "N", {3});
    w.reads<float>(1, "material", {5}).reads<uint8_t>(1, "flags");
    TermShape out{type(),
                  Domain::Pixel,
                  {width_, height_, 1},
                  {unsetPlane<float>("albedo", 3), unsetPlane<float>("normal", 3), unsetPlane<float>("position", 3), unsetPlane<float>("depth"),
                   unsetPlane<float>("footprint"), unsetPlane<float>("coverage"), unsetPlane<float>("even"), unsetPlane<float>("modulation", 3)}};
    if (lobe_ == LobePart::Specular) out.planes.push_back(unsetPlane<float>("alpha"));
    return w.gives(std::move(out));
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &seen = *ctx.inputs[0], &surface = *ctx.inputs[1];
    const auto at = seen.floats("P"), distance = seen.floats("depth"), width = seen.floats("footprint");
    const auto colour = surface.floats("albedo"), facing = surface.floats("N"), material = surface.floats("material"), smooth = seen.floats("N");
    const auto flags = surface.plane<uint8_t>("flags");
    const auto& out = ctx.result;
    const auto albedo = out->writable<float>("albedo"), normal = out->writable<float>("normal"), position = out->writable<float>("position");
    const auto depth = out->writable<float>("depth"), footprint = out->writable<float>("footprint"), coverage = out->writable<float>("coverage");
    const auto modulation = out->writable<float>("modulation"), even = out->writable<float>("even");
    const std::span<float> alpha = lobe_ == LobePart::Specular ? out->writable<float>("alpha") : std::span<float>();
    const size_t pixels = size_t(width_) * size_t(height_);
    const bool complete = ctx.arena->parallelFor(
        pixels, 1 << 12,
        [&](size_t begin, size_t end) {
          for (size_t p = begin; p < end; ++p) {
            DVec3 a(0.0), n(0.0), x(0.0), m(0.0);
            double d = 0, f = 0, wide = 0;
            int hits = 0;
            for (int s = 0; s < samples_; ++s) {
              const size_t i = size_t(s) * pixels + p;
              if (!std::isfinite(distance[i])) continue;
              ++hits;
              for (size_t c = 0; c < 3; ++c) {
                a[c] += colour[3 * i + c];
                n[c] += facing[3 * i + c];
                x[c] += at[3 * i + c];
              }
              m += DVec3(modulationOf(lobe_, Vec3(colour[3 * i], colour[3 * i + 1], colour[3 * i + 2]), &material[5 * i]));
              if (!(flags[i] & kSurfaceExtended)) wide += double(material[5 * i + 1]) * material[5 * i + 1];
              d += distance[i];
              f += width[i];
            }
            const double each = 1.0 / samples_, hit = hits ? 1.0 / hits : 0.0;
            for (size_t c = 0; c < 3; ++c) {
              albedo[3 * p + c] = float(a[c] * each);
              normal[3 * p + c] = float(n[c] * each);
              position[3 * p + c] = float(x[c] * hit);
            }
            depth[p] = float(d * hit);
            footprint[p] = float(f * hit);
            coverage[p] = float(hits * each);
            even[p] = hits == samples_ && oneSurface(at, smooth, p, pixels, DVec3(x) * hit, f * hit) ? 1.0f : 0.0f;
            for (size_t c = 0; c < 3; ++c)
              modulation[3 * p + c] = !hits ? 1.0f : lobe_ == LobePart::Both ? albedo[3 * p + c] + 0.04f * coverage[p] : float(m[int(c)] * each);
            if (!alpha.empty()) alpha[p] = float(wide * hit);
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  /// All samples of pixel p, whose mean is `centre`, lie on a plane, within `width`.
  bool oneSurface(std::span<const float> at, std::span<const float> facing, size_t p, size_t pixels, const DVec3& centre, double width) const {
    DVec3 mean(0.0);
    for (int s = 0; s < samples_; ++s)
      for (size_t c = 0; c < 3; ++c) mean[int(c)] += facing[3 * (size_t(s) * pixels + p) + c];
    const double length = glm::length(mean);
    if (!(length > 0)) return false;
    for (int s = 0; s < samples_; ++s) {
      double turned = 0, off = 0;
      for (size_t c = 0; c < 3; ++c) {
        const size_t i = 3 * (size_t(s) * pixels + p) + c;
        turned += mean[int(c)] * facing[i];
        off += mean[int(c)] * (at[i] - centre[int(c)]);
      }
      if (!(turned >= 0.906307787 * length) || !(std::abs(off) <= width * length)) return false;
    }
    return true;
  }

  int width_, height_, samples_;
  LobePart lobe_;
};

}  // namespace

Vec3 modulationOf(LobePart lobe, const Vec3& albedo, const float* material) {
  const float metallic = material[0], specular = material[2], transmission = material[4];
  switch (lobe) {
    case LobePart::Diffuse: return albedo * ((1.0f - metallic) * (1.0f - transmission)) + 0.04f;
    case LobePart::Specular: return albedo * (metallic + (1.0f - metallic) * transmission) + 0.04f * ((1.0f - metallic) * specular + 1.0f);
    case LobePart::Both: break;
  }
  return albedo + 0.04f;
}

NodePtr makeFeaturesNode(int width, int height, int viewSamples, LobePart lobe) { return std::make_shared<FeaturesNode>(width, height, viewSamples, lobe); }

}  // namespace gobo::denoise
