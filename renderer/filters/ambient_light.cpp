// SPDX-License-Identifier: Apache-2.0
#include "filters/ambient_light.h"

#include <memory>

#include "base/check.h"
#include "filters/diffuse_albedo.h"
#include "formulas/harmonics.glsl.h"
#include "terms/gbuffer.h"
#include "terms/surface.h"
#include "terms/surface_reader.h"

namespace gobo {
inline namespace filters {

namespace {

class AmbientLightNode final : public Node {
 public:
  explicit AmbientLightNode(const AmbientLightSettings& s) : s_(s) {}
  std::string type() const override { return "ambient_light"; }
  int version() const override { return 2; }  // 2: directions to extended surfaces from the G-buffer's points
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    if (s_.extended) t.facets = kSurfaceFacets;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    for (const Vec3& c : s_.radiance) h.addPod(c);
    h.add(s_.rotation).add(s_.width).add(s_.height).add(s_.viewSamples);
    if (!s_.extended) return;
    h.add(s_.extended);
    hashCamera(h, s_.camera);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    const Extent view{s_.width, s_.height, s_.viewSamples};
    w.over(0, view).reads<uint32_t>(0, "instance");
    if (s_.extended) SurfaceReader::reads(w, 0);
    w.over(1, view).reads<float>(1, "N", {3}).reads<float>(1, "albedo", {3}).reads<float>(1, "material", {5}).reads<uint8_t>(1, "flags");
    return w.gives({"direct_light", Domain::Pixel, {s_.width, s_.height, 1}, {plane<float>("rgb", 3)}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto instance = ctx.inputs[0]->plane<uint32_t>("instance");
    const Term& surface = *ctx.inputs[1];
    const auto N = surface.floats("N"), albedo = surface.floats("albedo"), material = surface.floats("material");
    const auto flags = surface.plane<uint8_t>("flags");
    GOBO_CHECK_EQ(instance.size(), pixels() * size_t(s_.viewSamples));
    const auto& out = ctx.result;
    const auto rgb = out->writable<float>("rgb");
    const float cosR = std::cos(s_.rotation), sinR = std::sin(s_.rotation), scale = kInvPi / float(s_.viewSamples);
    const auto& c = s_.radiance;
    std::unique_ptr<const SurfaceReader> reader;
    if (s_.extended) {
      GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
      reader = std::make_unique<const SurfaceReader>(*ctx.scene, accel, *ctx.inputs[0], s_.camera);
    }
    const bool complete = ctx.arena->parallelFor(
        pixels(), albedoGrain(1 << 12, s_.extended, s_.viewSamples),
        [&](size_t begin, size_t end) {
          for (int s = 0; s < s_.viewSamples; ++s)
            for (size_t p = begin; p < end; ++p) {
              const size_t i = size_t(s) * pixels() + p;
              if (instance[i] == ~0u || (flags[i] & kSurfaceUnlit)) continue;
              const float x = N[3 * i] * cosR - N[3 * i + 2] * sinR, y = N[3 * i + 1], z = N[3 * i] * sinR + N[3 * i + 2] * cosR;  // into the map's axes
              Vec3 colour(albedo[3 * i], albedo[3 * i + 1], albedo[3 * i + 2]);
              float reflecting = (1.0f - material[5 * i]) * (1.0f - material[5 * i + 4]) * scale;
              if (flags[i] & kSurfaceExtended) {
                GOBO_CHECK(reader != nullptr);
                colour = diffuseAlbedo(*reader, i);
                reflecting = scale;
              }
              for (int k = 0; k < 3; ++k) {
                const float e = formulas::harmonicIrradiance0(c[0][k]) + formulas::harmonicIrradiance1(x, y, z, c[1][k], c[2][k], c[3][k]) +
                                formulas::harmonicIrradiance2(x, y, z, c[4][k], c[5][k], c[6][k], c[7][k], c[8][k]);
                rgb[3 * p + k] += colour[k] * reflecting * maxOf(e, 0.0f);
              }
            }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  size_t pixels() const { return size_t(s_.width) * s_.height; }
  AmbientLightSettings s_;
};

}  // namespace

NodePtr makeAmbientLightNode(const AmbientLightSettings& settings) { return std::make_shared<AmbientLightNode>(settings); }

}  // namespace filters
}  // namespace gobo
