// SPDX-License-Identifier: Apache-2.0
// What rays of a probe see, and what arrives there.
#pragma once

#include <span>

#include "base/sobol.h"
#include "scene/camera.h"
#include "terms/hit_place.h"
#include "terms/light_points.h"
#include "trace/back_faces.h"
#include "trace/solid_scene.h"

namespace gobo {
inline namespace filters {

/// Elements of a term: a G-buffer without what shadows do not need.
struct Surfaces {
  std::span<float> P, N, Ng;
  std::span<uint32_t> instance;
  bool hit(size_t e) const { return instance[e] != kNoHit; }
  Vec3 position(size_t e) const { return Vec3(P[3 * e], P[3 * e + 1], P[3 * e + 2]); }
  Vec3 normal(size_t e) const { return Vec3(N[3 * e], N[3 * e + 1], N[3 * e + 2]); }
  Vec3 geometricNormal(size_t e) const { return Vec3(Ng[3 * e], Ng[3 * e + 1], Ng[3 * e + 2]); }
};
struct Eye {
  FilmRays film;
  BackFaces passed;
};

/// Elements first .. first + count - 1, at most 16: what the rays see. N is Ng: a probe of single pixels can do without shading normals.
inline void look(const SolidScene& scene, const Eye& eye, const Ray* ray, int count, const Surfaces& at, size_t first) {
  Hit hit[16];
  scene.accel().intersect16(ray, count, hit, &eye.passed);
  for (int i = 0; i < count; ++i) {
    const size_t e = first + size_t(i);
    at.instance[e] = hit[i].instance;
    const Vec3 p = hit[i].valid() ? hitPosition(scene.accel(), hit[i]) : Vec3(0.0f);
    const Vec3 n = !hit[i].valid() ? Vec3(0.0f) : glm::dot(hit[i].Ng, ray[i].direction) < 0 ? hit[i].Ng : -hit[i].Ng;
    for (int c = 0; c < 3; ++c) {
      at.P[3 * e + c] = p[c];
      at.N[3 * e + c] = at.Ng[3 * e + c] = n[c];
    }
  }
}

constexpr uint32_t kMostProbeRays = 64;
/// prefix[i]: visibility at surface `e` by the first i + 1 of `count` points (at most kMostProbeRays) of a sequence. How many of them the light can shine
/// from; 1 where from none.
inline uint32_t visibilityOfPoints(const SolidScene& scene, const LightPoints& light, const Surfaces& at, size_t e, uint64_t seed, uint32_t count,
                                   float* prefix, uint64_t& rays) {
  const Vec3 p = at.position(e), N = at.normal(e), Ng = at.geometricNormal(e), reach = scene.accel().reach(at.instance[e]);
  Ray packet[16];
  uint32_t place[16];
  int waiting = 0;
  float weight[kMostProbeRays] = {};
  bool open[kMostProbeRays] = {};
  GOBO_CHECK(count <= kMostProbeRays);
  const auto flush = [&] {
    const uint32_t blocked = waiting ? scene.occluded16(packet, waiting) : 0;
    for (int i = 0; i < waiting; ++i) open[place[i]] = !(blocked >> i & 1);
    rays += uint64_t(waiting);
    waiting = 0;
  };
  for (uint32_t i = 0; i < count; ++i) {
    LightPoint point;
    const Vec2 u = light.pointLike() ? Vec2(0.5f) : SobolSampler(seed, i).next2D();
    if (!light.sample(p, N, Ng, u, point)) continue;
    if (point.belowSurface) continue;
    weight[i] = point.weight;
    packet[waiting] = shadowRay(reach, p, Ng, point);
    place[waiting++] = i;
    if (waiting == 16) flush();
  }
  flush();
  double seen = 0, sum = 0;
  uint32_t shine = 0;
  for (uint32_t i = 0; i < count; ++i) {
    sum += weight[i];
    if (weight[i] > 0.0f) ++shine;
    if (open[i]) seen += weight[i];
    prefix[i] = sum > 0 ? float(seen / sum) : 1.0f;
  }
  return shine;
}

}  // namespace filters
}  // namespace gobo
