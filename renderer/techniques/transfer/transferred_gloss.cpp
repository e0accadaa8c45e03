// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "techniques/transfer/gloss_levels.h"
#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/receiver_mesh.h"
#include "terms/surface.h"
#include "trace/bsdf.h"

namespace gobo::transfer {

namespace {

/// Bands of a lobe of standard deviation `sigma`; without one, those of a wall's edge ring.
std::array<float, kMaxBands> lobeBands(float sigma) {
  std::array<float, kMaxBands> out;
  for (int l = 0; l < kMaxBands; ++l) out[size_t(l)] = std::exp(-0.5f * float(l * (l + 1)) * sqr(sigma));
  return out;
}

class TransferredGlossNode final : public Node {
 public:
  TransferredGlossNode(const TransferSettings& s, const GBufferSettings& view, std::string part, float rotation, const Vec3& scale)
      : s_(s), view_(view), part_(std::move(part)), bounced_(part_ == "bounced"), rotation_(rotation), scale_(scale) {
    for (int l = 0; l < s_.bands; ++l) open_[size_t(l)] = float((2 * l + 1) / (4 * double(kPi)) * cosineCoefficient(l));
  }
  std::string type() const override { return "transferred_gloss"; }
  int version() const override { return 2; }  // 2: what the specular lobe reflects without its table's padding
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashView(h, view_);
    h.add(part_).add(s_.bands).add(rotation_).addPod(scale_);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 7);
    w.over(0, view_.extent()).reads<uint32_t>(0, "instance").reads<float>(0, "P", {3}).reads<float>(0, "Ng", {3});
    w.over(1, view_.extent()).reads<float>(1, "N", {3}).reads<float>(1, "albedo", {3}).reads<float>(1, "material", {5}).reads<uint8_t>(1, "flags");
    w.over(2, view_.extent()).reads<uint32_t>(2, "point", {kCorners}).reads<float>(2, "weight", {kCorners});
    w.over(3, s_.extent()).reads<float>(3, "normal", {3}).over(4, s_.extent()).reads<float>(4, "transfer", {s_.harmonics()});
    w.over(5, s_.extent()).reads<float>(5, "bounced", {3}).over(6, {1, 1, 1});
    for (const GlossLevel& level : kGlossLevels) w.reads<float>(6, level.plane, {3 * level.width * level.height});
    return w.gives({"direct_light", Domain::Pixel, {view_.width, view_.height, 1}, {plane<float>("rgb", 3)}});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    return {0.0, double(view_.width) * view_.height * view_.viewSamples * (200.0 + 4.0 * s_.harmonics())};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &g = *ctx.inputs[0], &surface = *ctx.inputs[1], &levels = *ctx.inputs[6];
    const auto instance = g.plane<uint32_t>("instance"), point = ctx.inputs[2]->plane<uint32_t>("point");
    const auto P = g.floats("P"), Ng = g.floats("Ng"), N = surface.floats("N"), albedo = surface.floats("albedo"), material = surface.floats("material");
    const auto flags = surface.plane<uint8_t>("flags");
    const auto weight = ctx.inputs[2]->floats("weight"), normal = ctx.inputs[3]->floats("normal"), transfer = ctx.inputs[4]->floats("transfer"),
               around = ctx.inputs[5]->floats("bounced");
    const GlossMap map([&](size_t k) { return levels.floats(kGlossLevels[k].plane); }, rotation_);
    const auto rgb = ctx.result->writable<float>("rgb");
    const size_t pixels = size_t(view_.width) * size_t(view_.height), n = size_t(s_.harmonics());
    const float share = 1.0f / float(view_.viewSamples);
    const Vec3 eye(view_.camera.toWorld[3]), back(view_.camera.toWorld[2]);
    const bool complete = ctx.arena->parallelFor(
        pixels, 1 << 11,
        [&](size_t begin, size_t end) {
          Looks looks;
          for (size_t s = 0; s < size_t(view_.viewSamples); ++s) {
            const auto finish = [&] {
              finishLooks(looks, map, point, weight, normal, transfer, around, n, s * pixels, share, rgb);
              looks.count = 0;
            };
            for (size_t p = begin; p < end; ++p) {
              const size_t i = s * pixels + p;
              if (instance[i] == ~0u || (flags[i] & (kSurfaceUnlit | kSurfaceExtended))) continue;
              if (!(material[5 * i] > 0.0f) && !(material[5 * i + 2] > 0.0f)) continue;
              const Vec3 place(P[3 * i], P[3 * i + 1], P[3 * i + 2]), facing(Ng[3 * i], Ng[3 * i + 1], Ng[3 * i + 2]);
              const Vec3 axis(N[3 * i], N[3 * i + 1], N[3 * i + 2]), out = view_.camera.perspective ? glm::normalize(eye - place) : back;
              BsdfParams b;
              b.albedo = Vec3(albedo[3 * i], albedo[3 * i + 1], albedo[3 * i + 2]);
              b.metallic = material[5 * i];
              b.roughness = material[5 * i + 1];
              b.specular = material[5 * i + 2];
              b.ior = material[5 * i + 3];
              const float mu = glm::dot(axis, out);
              if (!(mu > 1e-4f)) continue;
              const size_t k = looks.count++;
              looks.pixel[k] = p;
              looks.albedo[k] = bsdfLobeAlbedos(b, mu).specular;
              looks.roughness[k] = clamp01(b.roughness);
              // Where a rough lobe is strongest lies between the mirror's direction and the normal (Lagarde & de Rousiers 2014, 4.9.3).
              const float alpha = sqr(looks.roughness[k]), towards = (1.0f - alpha) * (std::sqrt(1.0f - alpha) + alpha);
              Vec3 r = 2.0f * mu * axis - out;
              if (const float below = glm::dot(r, facing); below < 0.0f) r -= 2.0f * below * facing;  // as trace/bsdf.h does
              r = glm::normalize(axis + towards * (r - axis));
              looks.x[k] = r.x;
              looks.y[k] = r.y;
              looks.z[k] = r.z;
              if (looks.count == kLanes) finish();
            }
            finish();
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  /// Samples whose harmonics are made at once.
  struct Looks {
    size_t count = 0;
    size_t pixel[kLanes];
    Vec3 albedo[kLanes];
    float roughness[kLanes];
    alignas(64) float x[kLanes] = {}, y[kLanes] = {}, z[kLanes] = {};
  };

  void finishLooks(const Looks& looks, const GlossMap& map, std::span<const uint32_t> point, std::span<const float> weight, std::span<const float> normal,
                   std::span<const float> transfer, std::span<const float> around, size_t n, size_t first, float share, std::span<float> rgb) const {
    if (looks.count == 0) return;
    std::array<float, kMaxHarmonics * kLanes> Y;
    harmonics16(looks.x, looks.y, looks.z, s_.bands, Y.data());
    for (size_t k = 0; k < looks.count; ++k) {
      const size_t i = first + looks.pixel[k];
      const Vec3 r(looks.x[k], looks.y[k], looks.z[k]);
      const std::array<float, kMaxBands> lobe = lobeBands(std::sqrt(0.06f + 0.5f * sqr(sqr(looks.roughness[k]))));
      float seen = 0, open = 0, sky = 0;
      Vec3 bounced(0.0f);
      for (size_t v = 0; v < kCorners; ++v) {
        const float w = weight[kCorners * i + v];
        if (!(w > 0.0f)) continue;
        const size_t at = point[kCorners * i + v];
        const float* t = transfer.data() + at * n;
        size_t h = 0;
        for (int l = 0; l < s_.bands; ++l) {
          float band = 0;
          for (; h < size_t((l + 1) * (l + 1)); ++h) band += t[h] * Y[h * kLanes + k];
          seen += w * lobe[size_t(l)] * band;
        }
        open += w * openness(r.x * normal[3 * at] + r.y * normal[3 * at + 1] + r.z * normal[3 * at + 2], lobe);
        sky += w * t[0];
        for (int c = 0; c < 3; ++c) bounced[c] += w * around[3 * at + size_t(c)];
      }
      const float visible = clamp01(seen / maxOf(open, 0.05f));
      Vec3 light;
      if (bounced_) {
        // t[0] is the visible share of the hemisphere, by the cosine, times pi Y_0.
        const float closed = maxOf(1.0f - sky / (kPi * 0.28209479f), 0.1f);
        light = bounced * (kInvPi * minOf((1.0f - visible) / closed, 1.0f / closed));
      } else light = scale_ * map.at(r, looks.roughness[k]) * visible;
      light *= looks.albedo[k] * share;
      if (!isFinite(light)) continue;
      for (int c = 0; c < 3; ++c) rgb[3 * looks.pixel[k] + size_t(c)] += light[c];
    }
  }
  /// What `seen` is where nothing stands around: the clamped cosine about a normal, convolved with the lobe, at cosine x from it.
  float openness(float x, const std::array<float, kMaxBands>& lobe) const {
    float before = 1, legendre = x, sum = open_[0] * lobe[0];
    for (int l = 1; l < s_.bands; ++l) {
      sum += open_[size_t(l)] * lobe[size_t(l)] * legendre;
      const float next = (float(2 * l + 1) * x * legendre - float(l) * before) / float(l + 1);
      before = legendre;
      legendre = next;
    }
    return sum;
  }

  TransferSettings s_;
  GBufferSettings view_;
  std::string part_;
  bool bounced_;
  float rotation_;
  Vec3 scale_;
  std::array<float, kMaxBands> open_{};
};

}  // namespace

NodePtr makeTransferredGlossNode(const TransferSettings& settings, const GBufferSettings& view, const char* part, float rotation, const Vec3& scale) {
  return std::make_shared<TransferredGlossNode>(settings, view, part, rotation, scale);
}

}  // namespace gobo::transfer
