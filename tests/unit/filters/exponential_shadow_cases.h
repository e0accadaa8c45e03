// SPDX-License-Identifier: Apache-2.0
// Terms made by hand for the tests of exponential shadow maps.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "base/sobol.h"
#include "filters/exponential_shadow_map/exponential_shadow_map.h"

namespace gobo::esmtest {

inline TermPtr depthMap(int width, int height, const std::function<float(int, int)>& z) {
  auto term = std::make_shared<Term>("light_depth_map", Domain::LightTexel, Extent{width, height, 1});
  auto plane = term->addPlane<float>("z");
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) plane[size_t(y) * width + x] = z(x, y);
  return term;
}

/// A G-buffer of the given points, in one row.
inline TermPtr receivers(const std::vector<Vec3>& points) {
  auto term = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{int(points.size()), 1, 1});
  auto P = term->addPlane<float>("P", 3);
  auto instance = term->addPlane<uint32_t>("instance");
  for (size_t i = 0; i < points.size(); ++i) {
    for (int k = 0; k < 3; ++k) P[3 * i + k] = points[i][k];
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

inline TermPtr runNode(const NodePtr& node, std::vector<TermPtr> inputs, int threads = 2) {
  TaskArena arena(threads);
  RunContext ctx;
  ctx.inputs = std::move(inputs);
  ctx.arena = &arena;
  auto result = node->run(ctx);
  if (!result.ok()) {
    std::cerr << result.status().toString() << std::endl;
    return nullptr;
  }
  return *result;
}

inline TermPtr encode(const TermPtr& depth, float c, int blur, int threads = 2, std::shared_ptr<ComputeDevice> device = nullptr) {
  return runNode(makeExponentialShadowEncodeNode(c, blur, depth->extent().width, device), {depth}, threads);
}
inline TermPtr lookup(const TermPtr& gbuffer, const TermPtr& map, const ExponentialShadowLookup& l, int threads = 2,
                      std::shared_ptr<ComputeDevice> device = nullptr) {
  return runNode(makeExponentialShadowLookupNode(l, gbuffer->extent().elements(), device), {gbuffer, map}, threads);
}

inline float random01(uint64_t a, uint64_t b) { return toUnit(hash32(a, b)); }

}  // namespace gobo::esmtest
