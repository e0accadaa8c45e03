// SPDX-License-Identifier: Apache-2.0
// Radiance by tracing light forwards: particles leave the light with its flux, follow the surfaces' BSDFs and the media, and are counted where
// they land on one receiver (Veach 1997, section 4.5: the adjoint of path tracing). No light sampling, no path kernel, no photon
// map, no medium stack: of the renderer only its rays, its surfaces and its BSDF functions, the latter in reverse, by their definition.
// Grey scenes (the red channel is traced), closed media that do not overlap, power 1.
#pragma once

#include <vector>

#include "base/sobol.h"
#include "support/tiny_scenes.h"
#include "trace/surface.h"

namespace gobo::tests {

/// What lands on `instance` inside [lo, hi] (x and z), as an orthographic camera in direction `towardsCamera` sees it.
struct LightReceiver {
  uint32_t instance = 0;
  Vec2 lo{0.0f}, hi{0.0f};
  Vec3 towardsCamera{0, 1, 0};
};

class LightTracer {
 public:
  /// `inside`: material of the medium around a finite light, -1: none. `centre`, `radius`: a sphere around the scene.
  LightTracer(const Traced& traced, int light, int inside, const LightReceiver& receiver, const Vec3& centre, float radius)
      : traced_(traced), light_(traced.scene->lights[size_t(light)]), receiver_(receiver), centre_(centre), radius_(radius) {
    surfaces_.build(traced.view(), *traced.accel);
    around_ = inside < 0 ? -1 : surfaces_.interiorOf(inside);
  }

  /// Mean radiance of the receiver; the error is that of 32 independent sequences of `particles` each.
  Estimate measure(int particles, uint64_t seed) const {
    constexpr int kSequences = 32;
    std::vector<double> sums(kSequences, 0.0);
    traced_.arena.parallelFor(kSequences, 1, [&](size_t begin, size_t end) {
      for (size_t r = begin; r < end; ++r)
        for (int i = 0; i < particles; ++i) sums[r] += particle(hash64(seed, r), uint32_t(i)) / particles;
    });
    double mean = 0, square = 0;
    for (double s : sums) {
      mean += s / kSequences;
      square += s * s / kSequences;
    }
    Estimate e;
    e.mean = DVec3(mean);
    e.error = DVec3(std::sqrt(std::max(0.0, square - mean * mean) / (kSequences - 1)));
    return e;
  }

 private:
  struct Particle {
    Vec3 origin, direction;
    double flux = 0;
    int inside = -1;
  };
  static constexpr int kMostEvents = 64, kMostSteps = 4096;

  static Vec3 onSphere(const Vec2& u) {
    const float z = 1.0f - 2.0f * u.x, r = std::sqrt(std::max(0.0f, 1.0f - z * z)), phi = float(2 * M_PI) * u.y;
    return Vec3(r * std::cos(phi), r * std::sin(phi), z);
  }
  static Vec3 cosine(const Vec3& n, const Vec2& u) {
    const float r = std::sqrt(u.x), phi = float(2 * M_PI) * u.y;
    return Frame(n).toWorld(Vec3(r * std::cos(phi), r * std::sin(phi), std::sqrt(1.0f - u.x)));
  }
  Vec3 onDisk(const Vec3& centre, const Vec3& n, float radius, const Vec2& u) const {
    const float r = radius * std::sqrt(u.x), phi = float(2 * M_PI) * u.y;
    return centre + Frame(n).toWorld(Vec3(r * std::cos(phi), r * std::sin(phi), 0.0f));
  }

  /// Flux over density of one particle, by the definitions of scene/light.h.
  Particle emit(const Vec2& u, const Vec2& v, float w) const {
    const LightShape& s = light_.shape;
    const double power = double(light_.power.x);
    switch (s.kind) {
      case LightKind::Point: return {s.position, onSphere(u), power * 4 * M_PI, around_};
      case LightKind::Spot: {
        const float c = 1.0f - u.x * (1.0f - s.cosOuter), r = std::sqrt(1.0f - c * c), phi = float(2 * M_PI) * u.y;
        const double ramp = std::clamp((double(c) - s.cosOuter) / std::max(1e-3, double(s.cosInner) - s.cosOuter), 0.0, 1.0);
        return {s.position, Frame(s.axis).toWorld(Vec3(r * std::cos(phi), r * std::sin(phi), c)), power * 2 * M_PI * (1 - double(s.cosOuter)) * ramp * ramp,
                around_};
      }
      case LightKind::Directional: {
        if (s.angularSize != 0.0f) {  // uniform radiance over a disk at infinity
          const float half = 0.5f * s.angularSize, c = 1.0f - v.x * (1.0f - std::cos(half)), r = std::sqrt(1.0f - c * c), phi = float(2 * M_PI) * v.y;
          const Vec3 d = Frame(s.axis).toWorld(Vec3(r * std::cos(phi), r * std::sin(phi), c));
          const double radiance = power / (M_PI * double(std::sin(half)) * std::sin(half));
          return {onDisk(centre_ - 2.0f * radius_ * d, d, radius_, u), d, radiance * 2 * M_PI * (1 - std::cos(double(half))) * M_PI * double(radius_) * radius_,
                  -1};
        }
        return {onDisk(centre_ - 2.0f * radius_ * s.axis, s.axis, radius_, u), s.axis, power * M_PI * double(radius_) * radius_, -1};
      }
      case LightKind::Rect: {
        const double area = 4.0 * glm::length(s.u) * glm::length(s.v);
        return {s.position + s.u * (2 * u.x - 1) + s.v * (2 * u.y - 1), cosine(s.axis, v), power * area * M_PI, around_};
      }
      case LightKind::Disk: return {onDisk(s.position, s.axis, s.radius, u), cosine(s.axis, v), power * M_PI * M_PI * double(s.radius) * s.radius, around_};
      case LightKind::Sphere: {
        const Vec3 n = onSphere(u);
        return {s.position + n * s.radius, cosine(n, v), power * 4 * M_PI * M_PI * double(s.radius) * s.radius, around_};
      }
      case LightKind::Mesh: {  // two triangles of one size
        const Mesh& m = *traced_.scene->meshes[size_t(traced_.scene->instances[s.instance].mesh)];
        const uint32_t* t = m.indices.data() + 3 * size_t(w < 0.5f ? 0 : 1);
        const Vec3 e1 = m.positions[t[1]] - m.positions[t[0]], e2 = m.positions[t[2]] - m.positions[t[0]];
        const float q = std::sqrt(u.x);
        const Vec3 n = glm::normalize(glm::cross(e1, e2));
        return {m.positions[t[0]] + e1 * (q * (1 - u.y)) + e2 * (q * u.y) + n * 1e-5f, cosine(n, v), power * double(glm::length(glm::cross(e1, e2))) * M_PI,
                around_};
      }
      case LightKind::Environment: {
        const Vec3 d = onSphere(u);
        return {onDisk(centre_ - 2.0f * radius_ * d, d, radius_, v), d,
                power * double(traced_.scene->environment->eval(-d).x) * 4 * M_PI * M_PI * double(radius_) * radius_, -1};
      }
    }
    return {};
  }

  double landed(const Hit& hit, const Surface& s, const Vec3& d, double flux) const {
    if (hit.instance != receiver_.instance || !s.front) return 0;
    if (s.p.x < receiver_.lo.x || s.p.x > receiver_.hi.x || s.p.z < receiver_.lo.y || s.p.z > receiver_.hi.y) return 0;
    Surface seen;  // the shading normal may depend on the viewer
    surfaces_.interact(hit.instance, hit.primitive, hit.u, hit.v, hit.Ng, -receiver_.towardsCamera, seen);
    const Frame frame = seen.frame();
    const Vec3 wi = frame.toLocal(-d);
    if (!(wi.z > 0.0f)) return 0;
    const double value = bsdfEval(seen.bsdf, frame.toLocal(receiver_.towardsCamera), wi).sum().x;
    const double area = double(receiver_.hi.x - receiver_.lo.x) * double(receiver_.hi.y - receiver_.lo.y);
    return flux * value / std::fabs(glm::dot(d, s.Ng)) / area;
  }

  /// What is left of flux that arrives along -wo and goes on along b.wi: the BSDF with its arguments exchanged, over the density.
  static double adjoint(const BsdfParams& p, const Vec3& wo, const BsdfSample& b) {
    if (b.delta) {
      if (!b.transmitted || p.thin || std::fabs(p.ior - 1.0f) < 1e-3f) return b.weight.x;
      return double(b.weight.x) * (p.entering ? double(p.ior) * p.ior : 1.0 / (double(p.ior) * p.ior));
    }
    BsdfParams back = p;
    Vec3 from = b.wi, to = wo;
    if (b.transmitted) {
      back.entering = !p.entering;
      from.z = -from.z;
      to.z = -to.z;
    }
    return double(bsdfEval(back, from, to).sum().x) / std::fabs(to.z) * std::fabs(b.wi.z) / b.pdf;
  }

  double particle(uint64_t seed, uint32_t index) const {
    SobolSampler draw(seed, index);
    const Vec2 u = draw.next2D(), v = draw.next2D();
    Particle at = emit(u, v, draw.next1D());
    const double first = at.flux;
    double sum = 0;
    int events = 0;
    for (int step = 0; step < kMostSteps && events < kMostEvents && at.flux > 0; ++step) {
      Ray ray{at.origin, at.direction};
      Hit hit;
      const bool found = traced_.accel->intersect(ray, hit);
      if (at.inside >= 0) {
        const Interior& m = surfaces_.interiors()[size_t(at.inside)];
        if (!m.scatters) {
          at.flux *= found ? std::exp(-double(m.sigma.x) * hit.t) : 0.0;
        } else {
          const uint64_t bits = hash64(hash64(seed, index), uint64_t(step));
          const float way = -std::log(1.0f - toUnit(uint32_t(bits))) / m.sigma.x;
          if (way < (found ? hit.t : 3e38f)) {
            at.flux *= double(m.albedo.x);
            if (toUnit(uint32_t(bits >> 32)) * first > at.flux) return sum;  // roulette
            at.flux = std::max(at.flux, first);
            at.origin += at.direction * way;
            at.direction = turned(at.direction, m.g, hash64(bits, 1));
            continue;
          }
        }
      }
      if (!found) return sum;
      Surface s;
      surfaces_.interact(hit.instance, hit.primitive, hit.u, hit.v, hit.Ng, at.direction, s);
      sum += landed(hit, s, at.direction, at.flux);
      const Frame frame = s.frame();
      const Vec3 wo = frame.toLocal(-at.direction), facing = s.facing();
      const float lobe = draw.next1D();
      BsdfSample b;
      if (!bsdfSample(s.bsdf, wo, lobe, draw.next2D(), b)) return sum;
      const Vec3 wi = glm::normalize(frame.toWorld(b.wi));
      const float side = glm::dot(wi, facing);
      if (b.transmitted ? !(side < 0.0f) : !(side > 0.0f)) return sum;
      const double bent = std::fabs(double(wo.z) * side / (double(glm::dot(at.direction, facing)) * b.wi.z));  // of shading normals; else 1
      at.flux *= adjoint(s.bsdf, wo, b) * bent;
      const double survive = std::min(1.0, at.flux / first);
      if (draw.next1D() >= survive) return sum;
      at.flux /= survive;
      at.origin = s.origin(side > 0.0f ? facing : -facing);
      at.direction = wi;
      if (b.transmitted && s.material->interior >= 0) at.inside = s.front ? s.material->interior : -1;
      ++events;
    }
    return sum;
  }
  /// Henyey & Greenstein 1941 by inversion.
  static Vec3 turned(const Vec3& d, float g, uint64_t bits) {
    const float u = toUnit(uint32_t(bits)), phi = float(2 * M_PI) * toUnit(uint32_t(bits >> 32));
    float c = 1.0f - 2.0f * u;
    if (std::fabs(g) > 1e-3f) {
      const float q = (1.0f - g * g) / (1.0f - g + 2.0f * g * u);
      c = (1.0f + g * g - q * q) / (2.0f * g);
    }
    const float r = std::sqrt(std::max(0.0f, 1.0f - c * c));
    return glm::normalize(Frame(d).toWorld(Vec3(r * std::cos(phi), r * std::sin(phi), c)));
  }

  const Traced& traced_;
  const Light& light_;
  LightReceiver receiver_;
  Vec3 centre_;
  float radius_;
  SurfaceTable surfaces_;
  int around_ = -1;
};

}  // namespace gobo::tests
