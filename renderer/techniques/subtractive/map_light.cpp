// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/map_light.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "techniques/prefilter/irradiance_matrix.h"
#include "techniques/subtractive/receiver.h"
#include "techniques/subtractive/residual_map.h"

namespace gobo::subtractive {

namespace {

/// Irradiance of unshadowed planes of every normal, in the map's axes, from lights at the centroids of cells of equal flux (a lamp lies where it lies: cells of
/// equal size would shift it by half of theirs). Rows from pole to pole, both with values of their own; bilinear.
class IrradianceTable {
 public:
  /// Empty if `stop` fired first.
  IrradianceTable(const Environment& map, const TaskArena& arena, const StopToken& stop) {
    const std::vector<MapLight> lights = extractLights(map, kCellsOfMap, ExtractBy::MedianCut, &arena, stop);
    if (stop.stopRequested()) return;
    std::vector<DVec3> values(size_t(kColumns) * kRows);
    const bool whole = arena.parallelFor(
        values.size(), 32,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            const double polar = double(i / kColumns) * std::numbers::pi / (kRows - 1), azimuth = double(i % kColumns) * 2.0 * std::numbers::pi / kColumns;
            const DVec3 n(std::sin(polar) * std::cos(azimuth), std::cos(polar), std::sin(polar) * std::sin(azimuth));
            for (const MapLight& light : lights) values[i] += light.flux * std::max(glm::dot(n, light.direction), 0.0);
          }
        },
        stop);
    if (whole && !stop.stopRequested()) values_ = std::move(values);
  }
  bool empty() const { return values_.empty(); }
  DVec3 at(const DVec3& normal) const {
    const double v = std::acos(std::clamp(normal.y, -1.0, 1.0)) / std::numbers::pi * (kRows - 1);
    double u = std::atan2(normal.z, normal.x) / (2.0 * std::numbers::pi) * kColumns;
    if (u < 0.0) u += kColumns;
    const size_t x = std::min(size_t(u), size_t(kColumns - 1)), y = std::min(size_t(v), size_t(kRows - 2)), next = (x + 1) % kColumns;
    const double s = std::clamp(u - double(x), 0.0, 1.0), t = std::clamp(v - double(y), 0.0, 1.0);
    const auto row = [&](size_t j) { return values_[j * kColumns + x] * (1.0 - s) + values_[j * kColumns + next] * s; };
    return row(y) * (1.0 - t) + row(y + 1) * t;
  }

 private:
  static constexpr int kColumns = 128, kRows = 65, kCellsOfMap = 2048;
  std::vector<DVec3> values_;
};

class UnshadowedMapNode final : public Node {
 public:
  UnshadowedMapNode(const GBufferSettings& view, EnvironmentPtr map, float rotation, const Vec3& scale, bool shines, DiffuseBy by)
      : view_(view), map_(std::move(map)), rotation_(rotation), scale_(scale), shines_(shines), by_(by) {}
  std::string type() const override { return "unshadowed_map"; }
  int version() const override { return 3; }  // 2: maps of any size whole; 3: what the specular lobe reflects without its table's padding
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashView(h, view_);
    h.add(map_->content).add(rotation_).addPod(scale_).add(shines_);
    if (by_ == DiffuseBy::Harmonics) h.add("harmonics");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, shines_ ? 4 : 3);
    Receivers::reads(w, view_);
    w.over(2, {1, 1, 1});
    if (by_ == DiffuseBy::Harmonics) w.reads<float>(2, "rest", {3 * kBands * kBands});
    else w.reads<float>(2, "left", {kSplitCells});
    if (shines_)
      for (const transfer::GlossLevel& level : transfer::kGlossLevels) w.over(3, {1, 1, 1}).reads<float>(3, level.plane, {3 * level.width * level.height});
    return w.gives({type(), Domain::ViewSample, view_.extent(), {plane<float>("diffuse", 3), plane<float>("specular", 3)}});
  }
  size_t workingBytes() const override { return by_ == DiffuseBy::Table ? kResidualBytes : 0; }
  Cost cost(const TermShape& result, uint32_t) const override {
    return {0.0, (by_ == DiffuseBy::Table ? 3e7 : 0.0) + kReceiving * 100.0 * double(result.extent.elements())};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Receivers in(*ctx.inputs[0], *ctx.inputs[1], view_);
    const auto diffuse = ctx.result->writable<float>("diffuse"), specular = ctx.result->writable<float>("specular");
    std::function<DVec3(const DVec3&)> irradiance;
    if (by_ == DiffuseBy::Harmonics) {
      const auto rest = ctx.inputs[2]->floats("rest");
      irradiance = [m = prefilter::irradianceMatrix(std::vector<double>(rest.begin(), rest.end()))](const DVec3& n) { return m.at(n); };
    } else {
      const EnvironmentPtr residual = residualMap(*map_, ctx.inputs[2]->floats("left"), *ctx.arena, ctx.stop);
      if (!residual) return Status(Code::Cancelled, "unshadowed_map: stopped");
      auto table = std::make_shared<const IrradianceTable>(*residual, *ctx.arena, ctx.stop);
      if (table->empty()) return Status(Code::Cancelled, "unshadowed_map: stopped");
      irradiance = [table](const DVec3& n) { return table->at(n); };
    }
    std::unique_ptr<const transfer::GlossMap> gloss;
    if (shines_)
      gloss = std::make_unique<const transfer::GlossMap>([&](size_t k) { return ctx.inputs[3]->floats(transfer::kGlossLevels[k].plane); }, rotation_);
    const double cosR = std::cos(double(rotation_)), sinR = std::sin(double(rotation_));
    const bool complete = ctx.arena->parallelFor(
        in.instance.size(), 1 << 11,
        [&](size_t begin, size_t end) {
          for (size_t e = begin; e < end; ++e) {
            if (!in.lit(e)) continue;
            const BsdfParams b = in.bsdf(e);
            const LobeAlbedos by = in.albedos(e, b);
            const DVec3 n(Receivers::at(in.N, e));
            const DVec3 arriving = irradiance(DVec3(n.x * cosR - n.z * sinR, n.y, n.x * sinR + n.z * cosR));  // the map's axes
            const Vec3 light = by.diffuse * scale_ * (Vec3(arriving) * kInvPi);
            for (int c = 0; c < 3; ++c) diffuse[3 * e + size_t(c)] = std::clamp(light[c], 0.0f, kMost);
            if (gloss) shine(in, e, b, by.specular, *gloss, specular.data() + 3 * e);
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "unshadowed_map: stopped");
    return TermPtr(ctx.result);
  }

 private:
  static constexpr float kMost = 1e30f;

  void shine(const Receivers& in, size_t e, const BsdfParams& b, const Vec3& albedo, const transfer::GlossMap& gloss, float* specular) const {
    const float alpha = sqr(b.roughness), mu = glm::dot(Receivers::at(in.N, e), in.out(e));
    if (alpha < kDeltaAlpha || !(mu > 1e-4f) || !(b.metallic > 0.0f || b.specular > 0.0f)) return;
    // The lobe's middle lies between the mirror direction and the normal; below the surface it is mirrored back, as trace/bsdf.h does.
    const Vec3 axis = Receivers::at(in.N, e), facing = Receivers::at(in.Ng, e);
    Vec3 r = 2.0f * mu * axis - in.out(e);
    if (const float below = glm::dot(r, facing); below < 0.0f) r -= 2.0f * below * facing;
    r = glm::normalize(axis + (1.0f - alpha) * (std::sqrt(1.0f - alpha) + alpha) * (r - axis));
    const Vec3 light = albedo * scale_ * gloss.at(r, b.roughness);
    for (int c = 0; c < 3; ++c) specular[c] = std::clamp(light[c], 0.0f, kMost);
  }

  GBufferSettings view_;
  EnvironmentPtr map_;
  float rotation_;
  Vec3 scale_;
  bool shines_;
  DiffuseBy by_;
};

class ResidualLightsNode final : public Node {
 public:
  ResidualLightsNode(EnvironmentPtr map, int lights, ExtractBy by) : map_(std::move(map)), lights_(lights), by_(by) {}
  std::string type() const override { return "residual_lights"; }
  int version() const override { return 2; }  // 2: maps of any size whole
  NodeTraits traits() const override {
    NodeTraits t;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(map_->content).add(lights_).add(int(by_)); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, {1, 1, 1}).reads<float>(0, "left", {kSplitCells});
    TermShape out{"light_list", Domain::List, {lights_, 1, 1}, {plane<float>("direction", 3), plane<float>("irradiance", 3)}};
    out.atMost = true;
    return w.gives(std::move(out));
  }
  size_t workingBytes() const override { return kResidualBytes; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const EnvironmentPtr map = residualMap(*map_, ctx.inputs[0]->floats("left"), *ctx.arena, ctx.stop);
    if (!map) return Status(Code::Cancelled, "stopped");
    const std::vector<MapLight> lights = extractLights(*map, lights_, by_, ctx.arena, ctx.stop);
    if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
    return lightListTerm(lights);
  }

 private:
  EnvironmentPtr map_;
  int lights_;
  ExtractBy by_;
};

}  // namespace

EnvironmentPtr residualMap(const Environment& map, std::span<const float> left, const TaskArena& arena, const StopToken& stop) {
  const auto& level = transfer::kGlossLevels[0];
  Image picture(level.width, level.height, 3);
  if (!transfer::sharpLevel(map, left, arena, stop, picture.data)) return nullptr;
  return makeEnvironment("residual", std::move(picture), stop);
}

NodePtr makeUnshadowedMapNode(const GBufferSettings& view, EnvironmentPtr map, float rotation, const Vec3& scale, bool shines, DiffuseBy by) {
  return std::make_shared<UnshadowedMapNode>(view, std::move(map), rotation, scale, shines, by);
}
NodePtr makeResidualLightsNode(EnvironmentPtr map, int lights, ExtractBy by) { return std::make_shared<ResidualLightsNode>(std::move(map), lights, by); }

}  // namespace gobo::subtractive
