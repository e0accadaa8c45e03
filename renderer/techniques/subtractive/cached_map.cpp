// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/cached_map.h"

#include <algorithm>
#include <cmath>

#include "techniques/prefilter/lobe_cache.h"
#include "techniques/subtractive/map_light.h"
#include "techniques/subtractive/receiver.h"
#include "techniques/subtractive/residual_map.h"
#include "trace/bsdf_lobe_terms.h"
#include "trace/surface.h"

namespace gobo::subtractive {

namespace {

constexpr int kCellsOfMap = 2048;
constexpr float kMostLight = 1e30f;

std::string lobePlane(size_t k) { return "lobe" + std::to_string(k); }
int lobeFloats(int side) { return 3 * prefilter::kLobeMeans * side * side; }

class RadianceCacheNode final : public Node {
 public:
  explicit RadianceCacheNode(const RadianceCacheSettings& s) : s_(s) {}
  std::string type() const override { return "radiance_cache"; }
  int version() const override { return 2; }  // 2: maps of any size whole
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    h.add(s_.map->content).addPod(s_.towards).add(s_.side).add(s_.samples);
    h.addArray(s_.roughness);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, {1, 1, 1}).reads<float>(0, "left", {kSplitCells});
    TermShape out{type(), Domain::Table, {1, 1, 1}, {unsetPlane<float>("cosine", 3 * s_.side * s_.side)}};
    for (size_t k = 0; k < s_.roughness.size(); ++k) out.planes.push_back(unsetPlane<float>(lobePlane(k), lobeFloats(s_.side)));
    return w.gives(out);
  }
  size_t workingBytes() const override { return kResidualBytes + prefilter::EnvironmentPyramid::kBytes; }
  Cost cost(const TermShape&, uint32_t) const override {
    const double texels = double(s_.side) * s_.side;
    return {0.0, 2e8 + texels * (2.0 * kCellsOfMap + double(s_.roughness.size()) * (100.0 * s_.samples + 10.0 * kCellsOfMap))};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto stopped = [] { return Status(Code::Cancelled, "radiance_cache: stopped"); };
    const EnvironmentPtr residual = residualMap(*s_.map, ctx.inputs[0]->floats("left"), *ctx.arena, ctx.stop);
    if (!residual) return stopped();
    const std::vector<MapLight> lights = extractLights(*residual, kCellsOfMap, ExtractBy::MedianCut, ctx.arena, ctx.stop);
    if (ctx.stop.stopRequested()) return stopped();
    const prefilter::NormalPicture picture(s_.side, s_.towards);
    if (!prefilter::cosineMeans(picture, lights, *ctx.arena, ctx.stop, ctx.result->writable<float>("cosine"))) return stopped();
    if (s_.roughness.empty()) return TermPtr(ctx.result);
    const prefilter::EnvironmentPyramid pyramid(*residual, ctx.stop);
    if (pyramid.empty()) return stopped();
    for (size_t k = 0; k < s_.roughness.size(); ++k) {
      if (!prefilter::lobeMeans(picture, pyramid, lights, s_.roughness[k], s_.samples, *ctx.arena, ctx.stop, ctx.result->writable<float>(lobePlane(k))))
        return stopped();
      if (ctx.progress) ctx.progress(double(k + 1) / double(s_.roughness.size()));
    }
    return TermPtr(ctx.result);
  }

 private:
  RadianceCacheSettings s_;
};

class CachedMapNode final : public Node {
 public:
  CachedMapNode(const GBufferSettings& view, const RadianceCacheSettings& cache, float rotation, const Vec3& scale)
      : view_(view), cache_(cache), rotation_(rotation), scale_(scale) {}
  std::string type() const override { return "cached_map"; }
  int version() const override { return 2; }  // 2: what the specular lobe reflects without its table's padding
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashView(h, view_);
    h.addPod(cache_.towards).add(cache_.side).add(rotation_).addPod(scale_);
    h.addArray(cache_.roughness);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    Receivers::reads(w, view_);
    w.over(2, {1, 1, 1}).reads<float>(2, "cosine", {3 * cache_.side * cache_.side});
    for (size_t k = 0; k < cache_.roughness.size(); ++k) w.reads<float>(2, lobePlane(k), {lobeFloats(cache_.side)});
    return w.gives({"unshadowed_map", Domain::ViewSample, view_.extent(), {plane<float>("diffuse", 3), plane<float>("specular", 3)}});
  }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * 200.0 * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Receivers in(*ctx.inputs[0], *ctx.inputs[1], view_);
    const auto diffuse = ctx.result->writable<float>("diffuse"), specular = ctx.result->writable<float>("specular");
    const prefilter::NormalPicture picture(cache_.side, cache_.towards);
    const std::span<const float> cosine = ctx.inputs[2]->floats("cosine");
    std::vector<std::span<const float>> lobes;
    for (size_t k = 0; k < cache_.roughness.size(); ++k) lobes.push_back(ctx.inputs[2]->floats(lobePlane(k)));
    const bool complete = ctx.arena->parallelFor(
        in.instance.size(), 1 << 11,
        [&](size_t begin, size_t end) {
          for (size_t e = begin; e < end; ++e) {
            if (!in.lit(e)) continue;
            const auto place = picture.at(toMapAxes(Receivers::at(in.N, e), rotation_));
            const Vec3 open = Vec3(place.blend([&](size_t t) { return DVec3(cosine[3 * t], cosine[3 * t + 1], cosine[3 * t + 2]); }));
            const BsdfParams b = in.bsdf(e);
            const LobeTerms terms = bsdfLobeTerms(b, std::clamp(glm::dot(Receivers::at(in.N, e), in.out(e)), 1e-3f, 1.0f));
            Vec3 light[2] = {terms.diffuse * open, Vec3(0.0f)};
            if (!lobes.empty() && (b.metallic > 0.0f || b.specular > 0.0f)) {
              const Means m = meansAt(place, lobes, b.roughness);
              light[0] = terms.diffuse * (terms.open * open + terms.deficit * m.of[2] + terms.schlick * m.of[3]);
              light[1] = terms.microfacets * m.of[0] + terms.grazing * m.of[1] + terms.bounced * m.of[2];
            }
            for (int c = 0; c < 3; ++c) {
              diffuse[3 * e + size_t(c)] = bounded(light[0][c] * scale_[c]);
              specular[3 * e + size_t(c)] = bounded(light[1][c] * scale_[c]);
            }
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "cached_map: stopped");
    return TermPtr(ctx.result);
  }

 private:
  struct Means {
    Vec3 of[prefilter::kLobeMeans];
  };
  static float bounded(float v) { return v > 0.0f ? minOf(v, kMostLight) : 0.0f; }  // NaN: nothing

  /// Linear between the roughnesses about it, bilinear in each.
  Means meansAt(const prefilter::NormalPicture::Place& place, const std::vector<std::span<const float>>& lobes, float roughness) const {
    const std::vector<float>& at = cache_.roughness;
    const size_t above = size_t(std::lower_bound(at.begin(), at.end(), roughness) - at.begin());
    const size_t b = std::min(above, at.size() - 1), a = above == 0 || at[b] <= roughness ? b : above - 1;
    const float t = a == b ? 0.0f : (roughness - at[a]) / (at[b] - at[a]);
    Means out;
    for (size_t k = 0; k < size_t(prefilter::kLobeMeans); ++k) {
      const auto of = [&](size_t lobe) {
        return Vec3(place.blend([&](size_t texel) {
          const float* v = lobes[lobe].data() + 3 * (size_t(prefilter::kLobeMeans) * texel + k);
          return DVec3(v[0], v[1], v[2]);
        }));
      };
      out.of[k] = t > 0.0f ? glm::mix(of(a), of(b), t) : of(a);
    }
    return out;
  }

  GBufferSettings view_;
  RadianceCacheSettings cache_;
  float rotation_;
  Vec3 scale_;
};

}  // namespace

std::vector<float> cachedRoughnesses(const Scene& scene) {
  const float least = std::sqrt(kDeltaAlpha) * 1.0001f;  // its square is no mirror
  std::vector<float> found;
  bool textured = false;
  for (const Instance& i : scene.instances) {
    const Material& m = scene.materials[size_t(scene.meshes[size_t(i.mesh)]->material)];
    if (m.bsdf.unlit || makeSurfaceMaterial(m.albedo, m.bsdf, scene.textures).lambert) continue;
    textured = textured || m.bsdf.metallicRoughness.valid();
    found.push_back(std::clamp(m.bsdf.roughness, least, 1.0f));
  }
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  if (found.empty() || (!textured && found.size() <= size_t(kMostRoughnesses))) return found;
  const float low = textured ? least : found.front(), high = found.back();
  found.assign(1, low);
  if (high > low)
    for (int k = 1; k < kMostRoughnesses; ++k) found.push_back(k + 1 < kMostRoughnesses ? low + (high - low) * float(k) / float(kMostRoughnesses - 1) : high);
  return found;
}

DVec3 toMapAxes(const Vec3& world, float rotation) {
  const double cosR = std::cos(double(rotation)), sinR = std::sin(double(rotation)), x = double(world.x), z = double(world.z);
  return {x * cosR - z * sinR, double(world.y), x * sinR + z * cosR};
}

NodePtr makeRadianceCacheNode(const RadianceCacheSettings& settings) { return std::make_shared<RadianceCacheNode>(settings); }
NodePtr makeCachedMapNode(const GBufferSettings& view, const RadianceCacheSettings& cache, float rotation, const Vec3& scale) {
  return std::make_shared<CachedMapNode>(view, cache, rotation, scale);
}

}  // namespace gobo::subtractive
