// SPDX-License-Identifier: Apache-2.0
// Soft shadows on depth maps made by hand: a light at the origin that looks along +z, blockers at known depths, receivers on planes.
#pragma once

#include <cmath>

#include "filters/soft_shadow/moment_sums.h"
#include "filters/soft_shadow/soft_shadow.h"
#include "unit/filters/synthetic.h"

namespace gobo::test {

/// near 2 m, far 12 m as in digest 7.11; window of +-half tangents (or metres).
struct SoftCase {
  int resolution = 512;
  float half = 0.35f, near = 2, far = 12;
  bool perspective = true;
  Vec2 size{1.0f};
  float bias = 0;
  std::function<float(float x, float y)> depth = [](float, float) { return 1.0f; };  ///< linear depth at map offset (x, y)

  LightFrames frames() const {
    LightFrames f;
    f.face[0].perspective = perspective;
    f.face[0].lo = Vec2(-half);
    f.face[0].hi = Vec2(half);
    f.face[0].near = near;
    f.face[0].far = far;
    return f;
  }
  float linear(float metres) const { return (metres - near) / (far - near); }
  std::shared_ptr<Term> map() const {
    auto t = std::make_shared<Term>("light_depth_map", Domain::LightTexel, Extent{resolution, resolution, 1});
    const auto z = t->addPlane<float>("z");
    for (int y = 0; y < resolution; ++y)
      for (int x = 0; x < resolution; ++x)
        z[size_t(y) * size_t(resolution) + size_t(x)] =
            depth(half * (2 * (float(x) + 0.5f) / float(resolution) - 1), half * (2 * (float(y) + 0.5f) / float(resolution) - 1));
    return t;
  }
  template <typename Lookup>
  Lookup lookup() const {
    Lookup l;
    l.frames = frames();
    l.map.resolution = resolution;
    l.map.bias = bias;
    l.light = {size, 0.5f * size, SoftLight::Rectangle};
    return l;
  }
};

/// A row of receivers x in [x0, x1] at depth d, facing the light.
inline std::shared_ptr<Term> facingRow(int count, float x0, float x1, float d, float y = 0) {
  PlaneView v;
  v.width = count;
  v.height = 1;
  v.origin = Vec3(x0, y, d);
  v.du = Vec3(count > 1 ? (x1 - x0) / float(count - 1) : 0.0f, 0, 0);
  v.normal = Vec3(0, 0, -1);
  return planeGBuffer(v);
}

/// The terms that lookups of one map share.
struct SoftMaps {
  explicit SoftMaps(const SoftCase& c) : resolution(c.resolution), map(c.map()) { bounds = runFilter(makeDepthBoundsNode(resolution, 1), {map}); }
  explicit SoftMaps(TermPtr depth, int side) : resolution(side), map(std::move(depth)) {
    bounds = runFilter(makeDepthBoundsNode(resolution, map->extent().layers), {map});
  }
  int resolution;
  TermPtr map, bounds;
  TermPtr images(int order) const {
    return runFilter(makeShadowEncodeNode(makeConvolutionSoftBasis(order), 0, resolution, map->extent().layers, false), {map});
  }
  TermPtr sums(int order) const {
    return runFilter(makeShadowSummedAreaNode(makeConvolutionSoftBasis(order), resolution, map->extent().layers), {images(order)});
  }
  TermPtr chain(int order) const {
    return runFilter(makeShadowMipmapNode(makeConvolutionSoftBasis(order), resolution, map->extent().layers, false), {images(order)});
  }
  TermPtr moments() const { return runFilter(makeMomentSumsNode(resolution, map->extent().layers), {map}); }
  TermPtr exponentials(const ExponentialVarianceSoftLookup& l) const {
    const ShadowBasisPtr basis = makeExponentialVarianceBasis(l.cPositive, l.cNegative, 1e-7f, l.bleedingReduction);
    return runFilter(makeShadowMipmapNode(basis, resolution, map->extent().layers, false),
                     {runFilter(makeShadowEncodeNode(basis, 0, resolution, map->extent().layers, false), {map})});
  }
};

inline TermPtr softDenseShadow(const SoftCase& c, const SoftMaps& m, const TermPtr& gbuffer, bool skip = true) {
  auto l = c.lookup<PercentageCloserSoftLookup>();
  l.dense = true;
  l.skip = skip;
  return runFilter(makePercentageCloserSoftNode(l), {gbuffer, m.bounds});
}

inline double rmsDifference(const TermPtr& V, const std::function<double(size_t)>& b) {
  const std::span<const float> a = V->floats("V");
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += sqr(double(a[i]) - b(i));
  return std::sqrt(sum / double(a.size()));
}

}  // namespace gobo::test
