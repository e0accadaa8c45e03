// SPDX-License-Identifier: Apache-2.0
// Synthetic G-buffers, terms and runs for tests of filters: no scene, no ray.
#pragma once

#include <functional>
#include <memory>

#include "base/sobol.h"
#include "filters/axis_aligned/filter.h"
#include "terms/node.h"

namespace gobo::test {

/// A plane seen pixel by pixel: position = origin + x*du + y*dv, one instance, unit normal n, footprint |du|.
struct PlaneView {
  int width = 64, height = 64, layers = 1;
  Vec3 origin{0.0f}, du{0.1f, 0, 0}, dv{0, 0.1f, 0}, normal{0, 0, 1};
};
inline std::shared_ptr<Term> planeGBuffer(const PlaneView& v) {
  auto t = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{v.width, v.height, v.layers});
  auto P = t->addPlane<float>("P", 3), N = t->addPlane<float>("N", 3), Ng = t->addPlane<float>("Ng", 3), depth = t->addPlane<float>("depth");
  auto footprint = t->addPlane<float>("footprint");
  t->addPlane<uint32_t>("instance");
  for (int l = 0, e = 0; l < v.layers; ++l)
    for (int y = 0; y < v.height; ++y)
      for (int x = 0; x < v.width; ++x, ++e) {
        const Vec3 p = v.origin + float(x) * v.du + float(y) * v.dv;
        for (int c = 0; c < 3; ++c) {
          P[3 * e + c] = p[c];
          N[3 * e + c] = Ng[3 * e + c] = v.normal[c];
        }
        depth[e] = 1.0f;
        footprint[e] = glm::length(v.du);
      }
  return t;
}

inline std::shared_ptr<Term> floatTerm(const Extent& extent, const char* name, const std::function<float(int x, int y, int layer)>& f) {
  auto t = std::make_shared<Term>("synthetic", Domain::ViewSample, extent);
  auto v = t->addPlane<float>(name);
  for (int l = 0, e = 0; l < extent.layers; ++l)
    for (int y = 0; y < extent.height; ++y)
      for (int x = 0; x < extent.width; ++x, ++e) v[e] = f(x, y, l);
  return t;
}
inline std::shared_ptr<Term> noiseTerm(const Extent& extent, const char* name, uint64_t seed) {
  return floatTerm(extent, name, [&](int x, int y, int l) { return toUnit(hash32(seed, (uint64_t(l) * extent.height + y) * extent.width + x)); });
}

inline Result<TermPtr> tryFilter(const NodePtr& node, std::vector<TermPtr> inputs, int threads = 2) {
  TaskArena arena(threads);
  RunContext ctx;
  ctx.inputs = std::move(inputs);
  ctx.arena = &arena;
  return runNode(*node, ctx);
}
/// Runs a filter; fails the CHECK when it returns an error.
inline TermPtr runFilter(const NodePtr& node, std::vector<TermPtr> inputs, int threads = 2) {
  const Result<TermPtr> r = tryFilter(node, std::move(inputs), threads);
  if (!r.ok()) std::cerr << r.status().toString() << std::endl;
  GOBO_CHECK(r.ok());
  return *r;
}

/// Cuts a window out of every plane of a term.
inline std::shared_ptr<Term> cropTerm(const Term& term, int x0, int y0, int width, int height) {
  const Extent e = term.extent();
  auto out = std::make_shared<Term>(term.type(), term.domain(), Extent{width, height, e.layers});
  for (const Plane& p : term.planes()) {
    Plane& q = out->addRaw(p.name, p.format, p.channels);
    const size_t unit = formatSize(p.format) * p.channels;
    for (int l = 0; l < e.layers; ++l)
      for (int y = 0; y < height; ++y)
        std::copy_n(p.bytes.begin() + ((size_t(l) * e.height + y0 + y) * e.width + x0) * unit, width * unit,
                    q.bytes.begin() + (size_t(l) * height + y) * width * unit);
  }
  return out;
}

/// Axis-aligned filter settings for a light facing -z far above the plane of PlaneView's defaults.
inline AxisAlignedFilterSettings axisAlignedSettings(int radiusPx = 32) {
  AxisAlignedFilterSettings s;
  s.light.centre = Vec3(0, 0, 10);
  s.light.axis = Vec3(0, 0, -1);
  s.radiusPx = radiusPx;
  return s;
}
inline NodePtr axisAligned(const AxisAlignedFilterSettings& s) { return makeAxisAlignedFilter(s); }

}  // namespace gobo::test
