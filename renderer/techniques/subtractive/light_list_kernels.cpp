// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/light_list.h"

#include <immintrin.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <numbers>

#include "techniques/subtractive/scene_lights.h"

namespace gobo::subtractive {

namespace {

using Lane = __m256;
constexpr size_t kLane = 8;

inline Lane every(float v) { return _mm256_set1_ps(v); }
inline Lane below(const Lane& a, const Lane& b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
inline Lane and8(const Lane& a, const Lane& b) { return _mm256_and_ps(a, b); }
inline Lane either(const Lane& mask, const Lane& yes, const Lane& no) { return _mm256_blendv_ps(no, yes, mask); }
inline Lane unit(const Lane& v) { return _mm256_min_ps(_mm256_max_ps(v, every(0.0f)), every(1.0f)); }

struct Lane3x {
  Lane x, y, z;
};
inline Lane dot8(const Lane3x& a, const Vec3& b) { return a.x * every(b.x) + a.y * every(b.y) + a.z * every(b.z); }
inline Lane dot8(const Lane3x& a, const Lane3x& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Lane3x load3(const std::vector<float>* v, size_t at) {
  return {_mm256_loadu_ps(v[0].data() + at), _mm256_loadu_ps(v[1].data() + at), _mm256_loadu_ps(v[2].data() + at)};
}

/// As trace/light_sampling.cpp.
constexpr float kNearest2 = 1e-12f;

/// Weights of points that stand for a unit disk, or for the square +-1.
struct QuadratureRule {
  size_t count = 0;
  std::array<Vec2, 24> at{};
  std::array<double, 24> weight{};
};

QuadratureRule sevenOfADisk() {
  QuadratureRule r;
  r.at[0] = Vec2(0.0f);
  r.weight[0] = 0.25;
  for (int k = 0; k < 6; ++k) {
    const double phi = std::numbers::pi * k / 3.0, radius = std::sqrt(2.0 / 3.0);
    r.at[size_t(k) + 1] = Vec2(float(radius * std::cos(phi)), float(radius * std::sin(phi)));
    r.weight[size_t(k) + 1] = 0.125;
  }
  r.count = 7;
  return r;
}

QuadratureRule manyOfADisk() {
  QuadratureRule r;
  const double node[3] = {0.5 - 0.5 * std::sqrt(0.6), 0.5, 0.5 + 0.5 * std::sqrt(0.6)}, weight[3] = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};
  for (int ring = 0; ring < 3; ++ring)
    for (int k = 0; k < 8; ++k) {
      const double phi = 2.0 * std::numbers::pi * (k + 0.5 * (ring % 2)) / 8.0, radius = std::sqrt(node[ring]);
      r.at[r.count] = Vec2(float(radius * std::cos(phi)), float(radius * std::sin(phi)));
      r.weight[r.count++] = weight[ring] / 8.0;
    }
  return r;
}

QuadratureRule sixteenOfASquare() {
  QuadratureRule r;
  const double inner = std::sqrt(3.0 / 7.0 - 2.0 / 7.0 * std::sqrt(1.2)), outer = std::sqrt(3.0 / 7.0 + 2.0 / 7.0 * std::sqrt(1.2));
  const double node[4] = {-outer, -inner, inner, outer}, wi = (18.0 + std::sqrt(30.0)) / 72.0, wo = (18.0 - std::sqrt(30.0)) / 72.0,
               weight[4] = {wo, wi, wi, wo};
  for (int u = 0; u < 4; ++u)
    for (int v = 0; v < 4; ++v) {
      r.at[r.count] = Vec2(float(node[u]), float(node[v]));
      r.weight[r.count++] = weight[u] * weight[v];
    }
  return r;
}

const QuadratureRule& sevenPoints() {
  static const QuadratureRule rule = sevenOfADisk();
  return rule;
}
const QuadratureRule& manyPoints() {
  static const QuadratureRule rule = manyOfADisk();
  return rule;
}
const QuadratureRule& squarePoints() {
  static const QuadratureRule rule = sixteenOfASquare();
  return rule;
}

}  // namespace

double diskFormFactor(const DVec3& p, const DVec3& n, const DVec3& centre, const DVec3& axis, double radius) {
  const DVec3 d = centre - p;
  const double h = -glm::dot(d, axis), r2 = radius * radius;
  if (!(h > 0)) return 0.0;
  const DVec3 aside = d + h * axis;
  const double a2 = glm::dot(aside, aside), a = std::sqrt(a2), z = h * h + a2 + r2, root = std::sqrt(std::max(z * z - 4.0 * a2 * r2, 1e-300));
  const double along = 0.5 * (1.0 - (h * h + a2 - r2) / root);
  const double across = a > 1e-9 * h ? 0.5 * h / a * (z / root - 1.0) : 0.0;
  return std::max(-glm::dot(n, axis) * along + (a > 0 ? glm::dot(n, aside) / a : 0.0) * across, 0.0);
}

/// A point, with one look at its material.
struct LightList::Point {
  const LitPoint& lit;
  size_t element;
  Frame frame;
  Vec3 wo;
  BsdfLook look;
  bool flat;  // one normal for both horizons
  Point(const LitPoint& p, size_t e) : lit(p), element(e), frame(p.frame()), wo(frame.toLocal(p.wo)), look(p.bsdf, wo), flat(p.n == p.ng) {}
};

LightList::LightList(const SceneView& view, const LightSampler& sampler, std::span<const SceneLight> lights, int samples, uint64_t seed) {
  std::vector<int> of[Kinds];
  for (size_t i = 0; i < lights.size(); ++i) {
    const LightShape& s = view.lightShape(lights[i].light);
    whole_.emplace_back(sampler, s, lights[i].light, samples, seed);
    shapes_.push_back(s);
    Kind kind = Others;
    switch (s.kind) {
      case LightKind::Point:
      case LightKind::Spot: kind = hasProfile(s) ? Others : Points; break;
      case LightKind::Directional: kind = !isWideDirectional(s) ? Directions : s.angularSize != 0.0f ? Caps : Others; break;
      case LightKind::Sphere: kind = Caps; break;
      case LightKind::Rect:
      case LightKind::Disk: kind = Patches; break;
      case LightKind::Mesh:
      case LightKind::Environment: break;
    }
    of[kind].push_back(int(i));
  }
  for (int kind = 0; kind < Kinds; ++kind) {
    for (const int i : of[kind]) {
      const LightShape& s = shapes_[size_t(i)];
      index_.push_back(i);
      const bool distant = s.kind == LightKind::Directional;
      const Vec3 at = distant ? -s.axis : s.position, axis = s.kind == LightKind::Point ? Vec3(0.0f) : s.axis;
      for (int c = 0; c < 3; ++c) {
        power_[c].push_back(lights[size_t(i)].power[c]);
        at_[c].push_back(at[c]);
        axis_[c].push_back(axis[c]);
      }
      const bool spot = s.kind == LightKind::Spot;
      cut_.push_back(spot ? s.cosOuter : -4.0f);
      ramp_.push_back(spot ? 1.0f / maxOf(s.cosInner - s.cosOuter, 1e-3f) : 1.0f);
      range_.push_back(s.range > 0.0f ? float(1.0 / (double(s.range) * s.range)) : 0.0f);
      const double sine = std::sin(0.5 * double(s.angularSize)), r2 = double(s.radius) * s.radius, uu = glm::dot(DVec3(s.u), DVec3(s.u)),
                   vv = glm::dot(DVec3(s.v), DVec3(s.v));
      size2_.push_back(float(distant ? sine * sine : s.kind == LightKind::Rect ? uu + vv : r2));
      scale_.push_back(float(distant                     ? 1.0 / (std::numbers::pi * std::max(sine * sine, 1e-30))
                             : s.kind == LightKind::Rect ? 4.0 * std::sqrt(uu * vv)
                             : s.kind == LightKind::Disk ? std::numbers::pi * r2
                                                         : 1.0));
      far_.push_back(distant ? 1.0f : 0.0f);
    }
    // To the next multiple of 8: lights without power.
    while (index_.size() % kLane) {
      index_.push_back(-1);
      for (int c = 0; c < 3; ++c) power_[c].push_back(0.0f), at_[c].push_back(c == 1 ? 1.0f : 0.0f), axis_[c].push_back(0.0f);
      cut_.push_back(-4.0f), ramp_.push_back(1.0f), range_.push_back(0.0f), size2_.push_back(0.0f), scale_.push_back(0.0f), far_.push_back(1.0f);
    }
    begin_[kind + 1] = index_.size();
  }
}

void LightList::at(const LitPoint& point, size_t element, Values& out) const {
  Ways ways;
  run(point, element, out, ways);
}

void LightList::choose(const Values& values, size_t most, Choice& out) const {
  const size_t n = places();
  const auto lobe = [&](const std::vector<float>* v, size_t i) { return luminance(Vec3(v[0][i], v[1][i], v[2][i])); };
  out.order.assign(n, 0);
  out.positive.clear();
  for (size_t i = 0; i < n; ++i) {
    const float given = lobe(values.diffuse, i) + (values.glossy ? lobe(values.specular, i) : 0.0f);
    if (!(given > 0.0f)) continue;
    // Bits of positive numbers are in the numbers' order.
    out.order[i] = uint64_t(std::bit_cast<uint32_t>(given)) << 32 | ~uint32_t(index_[i]);
    out.positive.push_back(out.order[i]);
  }
  uint64_t least = most > 0 ? 1 : ~uint64_t(0);
  if (most > 0 && out.positive.size() > most) {
    const auto last = out.positive.begin() + std::ptrdiff_t(most - 1);
    std::nth_element(out.positive.begin(), last, out.positive.end(), std::greater<>());
    least = *last;
  }
  out.chosen.clear();
  double rest[6] = {0, 0, 0, 0, 0, 0};
  for (size_t i = 0; i < n; ++i) {
    if (out.order[i] == 0) continue;
    if (out.order[i] >= least) {
      out.chosen.push_back({index_[i], i});
      continue;
    }
    for (size_t c = 0; c < 3; ++c) {
      rest[c] += double(values.diffuse[c][i]);
      if (values.glossy) rest[3 + c] += double(values.specular[c][i]);
    }
  }
  out.rest[0] = DVec3(rest[0], rest[1], rest[2]);
  out.rest[1] = DVec3(rest[3], rest[4], rest[5]);
  std::sort(out.chosen.begin(), out.chosen.end(), [](const Choice::Chosen& a, const Choice::Chosen& b) { return a.light < b.light; });
}

LightList::Ways LightList::ways(const LitPoint& point, size_t element) const {
  Values values;
  Ways ways;
  run(point, element, values, ways);
  return ways;
}

void LightList::run(const LitPoint& point, size_t element, Values& out, Ways& ways) const {
  const Point at(point, element);
  const bool covered = BsdfLook::covers(point.bsdf) && !point.extended && !point.hasTangent;
  out.glossy = covered ? !at.look.lambert() : !point.lambert();
  for (int c = 0; c < 3; ++c) out.diffuse[c].resize(places());
  if (out.glossy)
    for (int c = 0; c < 3; ++c) out.specular[c].resize(places());
  const size_t from = covered ? begin_[Others] : 0;
  for (int kind = 0; covered && kind < Others; ++kind)
    for (size_t begin = begin_[kind]; begin < begin_[kind + 1]; begin += BsdfLook::kMost)
      block(at, Kind(kind), begin, std::min(BsdfLook::kMost, begin_[kind + 1] - begin), out, ways);
  for (size_t place = from; place < places(); ++place) {
    ways.sampled += index_[place] >= 0 && !isDeltaLight(shapes_[size_t(index_[place])]);
    sampled(at, place, out);
  }
}

void LightList::sampled(const Point& at, size_t place, Values& out) const {
  BsdfValue f;
  if (const int i = index_[place]; i >= 0) f = whole_[size_t(i)].lobes(at.lit, at.element);
  for (int c = 0; c < 3; ++c) {
    out.diffuse[c][place] = f.diffuse[c] * power_[c][place];
    if (out.glossy) out.specular[c][place] = f.specular[c] * power_[c][place];
  }
}

/// One direction for each of `count` lights; those of some size for which that will not do are found anew, one by one.
void LightList::block(const Point& at, Kind kind, size_t begin, size_t count, Values& out, Ways& ways) const {
  if (count == 0) return;
  BsdfLook::Directions way;
  BsdfLook::Lobes lobes;
  alignas(32) float value[BsdfLook::kMost], sine2[BsdfLook::kMost], needs[BsdfLook::kMost];
  const Lane zero = every(0.0f), one = every(1.0f);
  const LitPoint& p = at.lit;
  for (size_t k = 0; k < count; k += kLane) {
    const size_t place = begin + k;
    Lane3x w = load3(at_, place);
    Lane v = one, s2 = zero, turned = one;  // turned: the patch's own cosine
    if (kind != Directions) {
      const Lane infinite = below(zero, _mm256_loadu_ps(far_.data() + place));
      const Lane3x d{w.x - every(p.p.x), w.y - every(p.p.y), w.z - every(p.p.z)};
      const Lane d2 = either(infinite, one, dot8(d, d)), inverse = one / _mm256_sqrt_ps(d2);
      w = {either(infinite, w.x, d.x * inverse), either(infinite, w.y, d.y * inverse), either(infinite, w.z, d.z * inverse)};
      if (kind == Points) {
        const Lane x = d2 * _mm256_loadu_ps(range_.data() + place), window = unit(one - x * x);
        const Lane cone = unit((zero - dot8(w, load3(axis_, place)) - _mm256_loadu_ps(cut_.data() + place)) * _mm256_loadu_ps(ramp_.data() + place));
        v = window * cone * cone / _mm256_max_ps(d2, every(kNearest2));
      } else {
        s2 = _mm256_loadu_ps(size2_.data() + place) / d2;
        v = _mm256_loadu_ps(scale_.data() + place);
        if (kind == Caps) {
          v = and8(below(s2, one), v * every(kPi) * s2);
        } else {
          turned = zero - dot8(w, load3(axis_, place));
          for (size_t i = 0; i < kLane; ++i)  // few
            if (index_[place + i] >= 0 && shapes_[size_t(index_[place + i])].twoSided)
              reinterpret_cast<float*>(&turned)[i] = std::fabs(reinterpret_cast<const float*>(&turned)[i]);
          v = v * _mm256_max_ps(turned, zero) / d2;
        }
      }
    }
    const Lane up = dot8(w, p.n), above = dot8(w, p.ng);
    const Lane arrives = and8(below(zero, up), below(zero, above));
    _mm256_store_ps(way.x + k, dot8(w, at.frame.x));
    _mm256_store_ps(way.y + k, dot8(w, at.frame.y));
    _mm256_store_ps(way.z + k, either(arrives, up, every(-1.0f)));
    _mm256_store_ps(value + k, either(and8(arrives, below(zero, v)), v, zero));
    if (kind < Caps) continue;
    // Where a horizon is near: without end, unless all of it is below.
    const Lane sine = _mm256_sqrt_ps(s2), low = _mm256_min_ps(up, above);
    Lane x = s2 / _mm256_max_ps(up * up, every(1e-30f));
    if (kind == Patches) x = x + s2 / _mm256_max_ps(turned * turned, every(1e-30f));
    if (kind == Patches || out.glossy) x = x + every(4.0f) * s2;
    else x = zero;  // a ball or a sun, all above: exact
    x = either(below(low, sine), every(1e30f), x);
    x = either(below(low, zero - sine), zero, x);
    if (kind == Patches) x = and8(below(zero - sine, turned), x);  // from behind, all of it
    else x = and8(below(s2, one), x);                              // inside a ball
    _mm256_store_ps(needs + k, x);
    _mm256_store_ps(sine2 + k, s2);
  }
  at.look.at(way, count, lobes);
  for (size_t k = 0; k < count; k += kLane) {
    const size_t place = begin + k;
    const Lane v = _mm256_load_ps(value + k), d = _mm256_load_ps(lobes.diffuse + k) * v;
    const Lane3x power = load3(power_, place);
    const Lane of[3] = {power.x, power.y, power.z};
    for (int c = 0; c < 3; ++c) _mm256_storeu_ps(out.diffuse[c].data() + place, every(at.look.albedo[c]) * d * of[c]);
    if (!out.glossy) continue;
    const Lane f = _mm256_load_ps(lobes.facets + k), g = _mm256_load_ps(lobes.grazing + k), b = _mm256_load_ps(lobes.bounced + k);
    for (int c = 0; c < 3; ++c) {
      const Lane s = every(at.look.facets[c]) * f + every(at.look.grazing[c]) * g + every(at.look.bounced[c]) * b;
      _mm256_storeu_ps(out.specular[c].data() + place, s * v * of[c]);
    }
  }
  if (kind < Caps) return;
  for (size_t k = 0; k < count; ++k) {
    if (index_[begin + k] < 0) continue;
    const float x = needs[k] > 0.0f && out.glossy ? needs[k] + sine2[k] * lobes.sharpness[k] : needs[k];
    if (x > kOne) larger(at, kind, begin + k, x, out, ways);
    else ++ways.one;
  }
}

void LightList::larger(const Point& at, Kind kind, size_t place, float x, Values& out, Ways& ways) const {
  const LightShape& s = shapes_[size_t(index_[place])];
  const LitPoint& p = at.lit;
  if (kind == Patches && !out.glossy) {
    if (s.kind == LightKind::Rect) {
      ++(at.flat || x < 1e29f ? ways.closed : ways.sampled);  // clipped by one horizon, or by neither
      return sampled(at, place, out);
    }
    const DVec3 axis(s.axis), d = DVec3(s.position) - DVec3(p.p), facing = s.twoSided && glm::dot(d, axis) > 0 ? -axis : axis;
    const auto whole = [&](const Vec3& normal) {
      const DVec3 n(normal);
      return glm::dot(d, n) >= double(s.radius) * std::sqrt(std::max(1.0 - glm::dot(n, axis) * glm::dot(n, axis), 0.0));
    };
    if (whole(p.n) && whole(p.ng)) {
      ++ways.closed;
      const double e = diskFormFactor(DVec3(p.p), DVec3(p.n), DVec3(s.position), facing, double(s.radius));
      for (int c = 0; c < 3; ++c) out.diffuse[c][place] = at.look.albedo[c] * float(e) * power_[c][place];
      return;
    }
  }
  if (!(x <= kMany)) {
    ++ways.sampled;
    return sampled(at, place, out);
  }
  const bool square = s.kind == LightKind::Rect;
  const QuadratureRule& rule = square ? squarePoints() : x <= kSeven ? sevenPoints() : manyPoints();
  ++(x <= kSeven ? ways.seven : ways.many);

  BsdfLook::Directions way;
  BsdfLook::Lobes lobes;
  double weight[24];
  if (kind == Caps) {
    const bool distant = s.kind == LightKind::Directional;
    const DVec3 d = distant ? -DVec3(s.axis) : DVec3(s.position) - DVec3(p.p);
    const double d2 = glm::dot(d, d), sine2 = distant ? double(size2_[place]) : double(size2_[place]) / d2;
    const double drop = sine2 / (1.0 + std::sqrt(1.0 - sine2)), scale = 2.0 * std::numbers::pi * drop * double(scale_[place]);
    const Vec3 centre = at.frame.toLocal(Vec3(d / std::sqrt(d2)));
    const Frame f(centre);
    for (size_t k = 0; k < rule.count; ++k) {
      // The disk's area is the cap's: 1 - cosine is drop by the squared radius.
      const double r2 = double(rule.at[k].x) * rule.at[k].x + double(rule.at[k].y) * rule.at[k].y, fall = r2 * drop;
      const float side = float(std::sqrt(drop * (2.0 - fall)));
      const Vec3 w = f.x * (rule.at[k].x * side) + f.y * (rule.at[k].y * side) + f.z * float(1.0 - fall);
      way.x[k] = w.x, way.y[k] = w.y, way.z[k] = w.z;
      weight[k] = rule.weight[k] * scale;
    }
  } else {
    const Frame f(s.axis);
    const Vec3 u = square ? s.u : f.x * s.radius, v = square ? s.v : f.y * s.radius;
    for (size_t k = 0; k < rule.count; ++k) {
      const DVec3 d = DVec3(s.position) - DVec3(p.p) + DVec3(u) * double(rule.at[k].x) + DVec3(v) * double(rule.at[k].y);
      const double d2 = glm::dot(d, d), distance = std::sqrt(d2), cosine = -glm::dot(d, DVec3(s.axis)) / distance;
      const Vec3 w = at.frame.toLocal(Vec3(d / distance));
      way.x[k] = w.x, way.y[k] = w.y, way.z[k] = w.z;
      weight[k] = rule.weight[k] * double(scale_[place]) * std::max(s.twoSided ? std::fabs(cosine) : cosine, 0.0) / d2;
    }
  }
  for (size_t k = rule.count; k % kLane; ++k) way.x[k] = way.y[k] = 0.0f, way.z[k] = -1.0f;
  at.look.at(way, rule.count, lobes);
  double d = 0, f = 0, g = 0, b = 0;
  for (size_t k = 0; k < rule.count; ++k) {
    d += weight[k] * double(lobes.diffuse[k]);
    if (!out.glossy) continue;
    f += weight[k] * double(lobes.facets[k]);
    g += weight[k] * double(lobes.grazing[k]);
    b += weight[k] * double(lobes.bounced[k]);
  }
  for (int c = 0; c < 3; ++c) {
    out.diffuse[c][place] = at.look.albedo[c] * float(d) * power_[c][place];
    if (out.glossy)
      out.specular[c][place] = float(double(at.look.facets[c]) * f + double(at.look.grazing[c]) * g + double(at.look.bounced[c]) * b) * power_[c][place];
  }
}

}  // namespace gobo::subtractive
