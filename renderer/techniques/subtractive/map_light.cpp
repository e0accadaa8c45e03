// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/map_light.h"

#include <array>
#include <limits>

#include "techniques/subtractive/receiver.h"
#include "techniques/transfer/gloss_levels.h"
#include "techniques/transfer/harmonics.h"
#include "terms/environment_cells.h"

namespace gobo::subtractive {

namespace {

constexpr int kCells = 6 * EnvironmentCells::kSide * EnvironmentCells::kSide;

class UnshadowedMapNode final : public Node {
 public:
  UnshadowedMapNode(const GBufferSettings& view, float rotation, const Vec3& scale, bool shines)
      : view_(view), rotation_(rotation), scale_(scale), shines_(shines) {}
  std::string type() const override { return "unshadowed_map"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashCamera(h, view_.camera);
    h.add(view_.width).add(view_.height).add(view_.viewSamples).add(rotation_).addPod(scale_).add(shines_);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, shines_ ? 4 : 3);
    Receivers::reads(w, view_);
    w.over(2, {1, 1, 1}).reads<float>(2, "rest", {3 * kBands * kBands});
    if (shines_)
      for (const transfer::GlossLevel& level : transfer::kGlossLevels) w.over(3, {1, 1, 1}).reads<float>(3, level.plane, {3 * level.width * level.height});
    return w.gives({type(), Domain::ViewSample, view_.extent(), {plane<float>("diffuse", 3), plane<float>("specular", 3)}});
  }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 150.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Receivers in(*ctx.inputs[0], *ctx.inputs[1], view_);
    const auto diffuse = ctx.result->writable<float>("diffuse"), specular = ctx.result->writable<float>("specular");
    const std::array<float, 3 * kHarmonics> irradiance = irradianceOf(ctx.inputs[2]->floats("rest"));
    std::unique_ptr<const transfer::GlossMap> gloss;
    if (shines_)
      gloss = std::make_unique<const transfer::GlossMap>([&](size_t k) { return ctx.inputs[3]->floats(transfer::kGlossLevels[k].plane); }, rotation_);
    const bool complete = ctx.arena->parallelFor(
        in.instance.size(), 1 << 11,
        [&](size_t begin, size_t end) {
          Looks looks;
          const auto finish = [&] {
            alignas(64) std::array<float, kHarmonics * transfer::kLanes> Y;
            transfer::harmonics16(looks.x, looks.y, looks.z, kBands, Y.data());
            for (size_t k = 0; k < looks.count; ++k) finishLook(looks.sample[k], k, Y, irradiance, in, gloss.get(), diffuse, specular);
            looks.count = 0;
          };
          for (size_t e = begin; e < end; ++e) {
            if (!in.lit(e)) continue;
            const size_t k = looks.count++;
            looks.sample[k] = e;
            looks.x[k] = in.N[3 * e];
            looks.y[k] = in.N[3 * e + 1];
            looks.z[k] = in.N[3 * e + 2];
            if (looks.count == size_t(transfer::kLanes)) finish();
          }
          if (looks.count > 0) finish();
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "unshadowed_map: stopped");
    return TermPtr(ctx.result);
  }

 private:
  static constexpr size_t kHarmonics = size_t(kBands) * kBands;
  /// Samples whose harmonics are made at once.
  struct Looks {
    size_t count = 0, sample[transfer::kLanes];
    alignas(64) float x[transfer::kLanes] = {}, y[transfer::kLanes] = {}, z[transfer::kLanes] = {};
  };

  /// Coefficients of irradiance / pi in the world's axes, channel by channel.
  std::array<float, 3 * kHarmonics> irradianceOf(std::span<const float> map) const {
    std::array<double, 3 * kHarmonics> world;
    transfer::turn(map, kBands, 3, double(rotation_), world);
    std::array<float, 3 * kHarmonics> out;
    for (int l = 0; l < kBands; ++l)
      for (size_t h = size_t(l * l); h < size_t((l + 1) * (l + 1)); ++h)
        for (size_t c = 0; c < 3; ++c)
          out[c * kHarmonics + h] = float(world[3 * h + c] * transfer::cosineCoefficient(l) / double(kPi) * double(scale_[int(c)]));
    return out;
  }

  void finishLook(size_t e, size_t lane, const std::array<float, kHarmonics * transfer::kLanes>& Y, const std::array<float, 3 * kHarmonics>& irradiance,
                  const Receivers& in, const transfer::GlossMap* gloss, std::span<float> diffuse, std::span<float> specular) const {
    const BsdfParams b = in.bsdf(e);
    const LobeAlbedos by = in.albedos(e, b);
    for (size_t c = 0; c < 3; ++c) {
      float sum = 0;
      for (size_t h = 0; h < kHarmonics; ++h) sum += irradiance[c * kHarmonics + h] * Y[h * size_t(transfer::kLanes) + lane];
      diffuse[3 * e + c] = by.diffuse[int(c)] * std::clamp(sum, 0.0f, kMost);
    }
    const float alpha = sqr(b.roughness), mu = glm::dot(Receivers::at(in.N, e), in.out(e));
    if (!gloss || alpha < kDeltaAlpha || !(mu > 1e-4f) || !(b.metallic > 0.0f || b.specular > 0.0f)) return;
    // The lobe's middle lies between the mirror direction and the normal; below the surface it is mirrored back, as trace/bsdf.h does.
    const Vec3 axis = Receivers::at(in.N, e), facing = Receivers::at(in.Ng, e);
    Vec3 r = 2.0f * mu * axis - in.out(e);
    if (const float below = glm::dot(r, facing); below < 0.0f) r -= 2.0f * below * facing;
    r = glm::normalize(axis + (1.0f - alpha) * (std::sqrt(1.0f - alpha) + alpha) * (r - axis));
    const Vec3 light = by.specular * scale_ * gloss->at(r, b.roughness);
    for (int c = 0; c < 3; ++c) specular[3 * e + size_t(c)] = std::clamp(light[c], 0.0f, kMost);
  }
  static constexpr float kMost = 1e30f;

  GBufferSettings view_;
  float rotation_;
  Vec3 scale_;
  bool shines_;
};

class ResidualLightsNode final : public Node {
 public:
  ResidualLightsNode(EnvironmentPtr map, int lights, ExtractBy by) : map_(std::move(map)), lights_(lights), by_(by) {}
  std::string type() const override { return "residual_lights"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(map_->content).add(lights_).add(int(by_)); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, {1, 1, 1}).reads<float>(0, "left", {kCells});
    TermShape out{"light_list", Domain::List, {lights_, 1, 1}, {plane<float>("direction", 3), plane<float>("irradiance", 3)}};
    out.atMost = true;
    return w.gives(std::move(out));
  }
  size_t workingBytes() const override { return size_t(64) * kTexels; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto& level = transfer::kGlossLevels[0];
    Image picture(level.width, level.height, 3);
    if (!transfer::sharpLevel(*map_, ctx.inputs[0]->floats("left"), *ctx.arena, ctx.stop, picture.data)) return Status(Code::Cancelled, "stopped");
    const EnvironmentPtr map = makeEnvironment("residual", std::move(picture), ctx.stop);
    if (!map) return Status(Code::Cancelled, "stopped");
    const std::vector<MapLight> lights = extractLights(*map, lights_, by_, ctx.arena, ctx.stop);
    if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
    auto out = std::make_shared<Term>("light_list", Domain::List, Extent{int(lights.size()), 1, 1});
    const auto direction = out->addPlane<float>("direction", 3), irradiance = out->addPlane<float>("irradiance", 3);
    for (size_t i = 0; i < lights.size(); ++i)
      for (int k = 0; k < 3; ++k) {
        direction[3 * i + size_t(k)] = float(lights[i].direction[k]);
        irradiance[3 * i + size_t(k)] = float(std::min(lights[i].flux[k], double(std::numeric_limits<float>::max())));
      }
    return TermPtr(out);
  }

 private:
  static constexpr size_t kTexels = size_t(transfer::kGlossLevels[0].width) * transfer::kGlossLevels[0].height;
  EnvironmentPtr map_;
  int lights_;
  ExtractBy by_;
};

}  // namespace

NodePtr makeUnshadowedMapNode(const GBufferSettings& view, float rotation, const Vec3& scale, bool shines) {
  return std::make_shared<UnshadowedMapNode>(view, rotation, scale, shines);
}
NodePtr makeResidualLightsNode(EnvironmentPtr map, int lights, ExtractBy by) { return std::make_shared<ResidualLightsNode>(std::move(map), lights, by); }

}  // namespace gobo::subtractive
