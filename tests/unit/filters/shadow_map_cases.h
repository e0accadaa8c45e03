// SPDX-License-Identifier: Apache-2.0
// Terms made by hand, and single nodes run on them, for the tests of filterable shadow maps.
#pragma once

#include <functional>
#include <iostream>
#include <memory>
#include <vector>

#include "base/sobol.h"
#include "filters/shadow_map/shadow_map.h"
#include "formulas/convolution_shadow_map.glsl.h"

namespace gobo::shadowtest {

inline TermPtr depthMap(int width, int height, const std::function<float(int, int)>& z) {
  auto term = std::make_shared<Term>("light_depth_map", Domain::LightTexel, Extent{width, height, 1});
  auto plane = term->addPlane<float>("z");
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) plane[size_t(y) * width + x] = z(x, y);
  return term;
}
inline TermPtr depthMap(int side, const std::function<float(int, int)>& z) { return depthMap(side, side, z); }

/// A filtered map of given values: for lookups on values that no encoder makes.
inline TermPtr basisMap(int side, int channels, const std::function<float(int, int, int)>& value) {
  auto term = std::make_shared<Term>("shadow_basis", Domain::LightTexel, Extent{side, side, 1});
  auto plane = term->addPlane<float>("B", channels);
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x)
      for (int k = 0; k < channels; ++k) plane[(size_t(y) * size_t(side) + size_t(x)) * size_t(channels) + size_t(k)] = value(x, y, k);
  return term;
}

/// A G-buffer of the given points, in one row, on surfaces of geometric normal `normal` whose pixels are `footprint` wide (metres).
inline TermPtr receivers(const std::vector<Vec3>& points, const Vec3& normal = Vec3(0, 0, -1), float footprint = 0.0f) {
  auto term = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{int(points.size()), 1, 1});
  auto P = term->addPlane<float>("P", 3), Ng = term->addPlane<float>("Ng", 3);
  auto width = term->addPlane<float>("footprint");
  auto instance = term->addPlane<uint32_t>("instance");
  for (size_t i = 0; i < points.size(); ++i) {
    for (int k = 0; k < 3; ++k) {
      P[3 * i + size_t(k)] = points[i][k];
      Ng[3 * i + size_t(k)] = normal[k];
    }
    width[i] = footprint;
    instance[i] = 0;
  }
  return term;
}

/// Orthographic frame whose map coordinates and depth are the world's x, y, z in [0,1].
inline LightFrame unitFrame() {
  LightFrame f;
  f.lo = Vec2(0.0f);
  f.hi = Vec2(1.0f);
  return f;
}
inline LightFrames oneFace(const LightFrame& f) {
  LightFrames frames;
  frames.face[0] = f;
  return frames;
}

inline TermPtr runNode(const NodePtr& node, std::vector<TermPtr> inputs, int threads = 2) {
  TaskArena arena(threads);
  RunContext ctx;
  ctx.inputs = std::move(inputs);
  ctx.arena = &arena;
  auto result = runNode(*node, ctx);
  if (!result.ok()) {
    std::cerr << result.status().toString() << std::endl;
    return nullptr;
  }
  return *result;
}

inline std::vector<float> values(const TermPtr& term, const char* plane) {
  const auto span = term->floats(plane);
  return {span.begin(), span.end()};
}

// ---- Any basis ------------------------------------------------------------------------------------------------------------------
inline TermPtr encodeBasis(const TermPtr& depth, const ShadowBasisPtr& basis, int blur, bool bytes = false, int threads = 2,
                           std::shared_ptr<ComputeDevice> device = nullptr) {
  return runNode(makeShadowEncodeNode(basis, blur, depth->extent().width, depth->extent().layers, bytes, device), {depth}, threads);
}
inline TermPtr depthBounds(const TermPtr& depth, int threads = 2) {
  return runNode(makeDepthBoundsNode(depth->extent().width, depth->extent().layers), {depth}, threads);
}

/// Lookups in the unit frame without any bias; `blur` as in the encode.
inline ShadowLookup unitLookup(int resolution, int blur = 0, float bias = 0.0f) {
  ShadowLookup l;
  l.frames = oneFace(unitFrame());
  l.map.resolution = resolution;
  l.map.blur = blur;
  l.map.bias = bias;
  l.map.slopeBias = 0.0f;
  l.view = {Vec3(0, 0, -1), false};  // seen along the light: footprints are what the G-buffer says
  return l;
}
inline TermPtr lookupBasis(const TermPtr& gbuffer, const TermPtr& map, const ShadowBasisPtr& basis, const ShadowLookup& l, const TermPtr& bounds = nullptr,
                           int threads = 2) {
  std::vector<TermPtr> inputs{gbuffer, map};
  if (bounds) inputs.push_back(bounds);
  return runNode(makeShadowLookupNode(basis, l), std::move(inputs), threads);
}
/// Encode, blur, look up: V of the points over a square map.
inline std::vector<float> visibility(const TermPtr& depth, const ShadowBasisPtr& basis, int blur, const std::vector<Vec3>& points, float bias = 0.0f,
                                     bool bytes = false) {
  return values(lookupBasis(receivers(points), encodeBasis(depth, basis, blur, bytes), basis, unitLookup(depth->extent().width, blur, bias)), "V");
}

inline PercentageCloserLookup unitComparison(int resolution, v1::PercentageCloserShadow::Pattern pattern, int size) {
  PercentageCloserLookup l;
  const ShadowLookup u = unitLookup(resolution);
  l.frames = u.frames;
  l.map = u.map;
  l.view = u.view;
  l.pattern = pattern;
  (pattern == v1::PercentageCloserShadow::GAUSSIAN ? l.map.blur : l.taps) = size;
  return l;
}
inline std::vector<float> compare(const TermPtr& depth, const PercentageCloserLookup& l, const TermPtr& gbuffer, int threads = 2) {
  return values(runNode(makePercentageCloserNode(l), {gbuffer, depthBounds(depth)}, threads), "V");
}

// ---- The exponential map -----------------------------------------------------------------------------------------------------------
struct ExponentialCase {
  LightFrame frame;
  float c, bias;
};

inline TermPtr encode(const TermPtr& depth, float c, int blur, int threads = 2, std::shared_ptr<ComputeDevice> device = nullptr) {
  return encodeBasis(depth, makeExponentialBasis(c, false), blur, false, threads, std::move(device));
}
inline NodePtr exponentialLookupNode(const ExponentialCase& e, int resolution, std::shared_ptr<ComputeDevice> device = nullptr) {
  ShadowLookup l = unitLookup(resolution, 0, e.bias);
  l.frames = oneFace(e.frame);
  return makeShadowLookupNode(makeExponentialBasis(e.c, false), l, std::move(device));
}
inline TermPtr lookup(const TermPtr& gbuffer, const TermPtr& map, const ExponentialCase& e, int threads = 2, std::shared_ptr<ComputeDevice> device = nullptr) {
  return runNode(exponentialLookupNode(e, map->extent().width, std::move(device)), {gbuffer, map}, threads);
}

inline float random01(uint64_t a, uint64_t b) { return toUnit(hash32(a, b)); }

/// Weights of the pre-filter in double, normalised.
inline std::vector<double> gaussian(int radius) {
  std::vector<double> w(size_t(2 * radius + 1));
  const double sigma = (2 * radius + 1) / 4.0;
  double sum = 0;
  for (int k = -radius; k <= radius; ++k) sum += w[size_t(k + radius)] = std::exp(-0.5 * k * k / (sigma * sigma));
  for (double& x : w) x /= sum;
  return w;
}

}  // namespace gobo::shadowtest
