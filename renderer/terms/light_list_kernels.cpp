// SPDX-License-Identifier: Apache-2.0
#include "terms/light_list.h"

#include <immintrin.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <numbers>

#include "base/check.h"
#include "scene/light_axes.h"
#include "terms/light_rules.h"
#include "trace/distant_light.h"

namespace gobo {
inline namespace terms {

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

}  // namespace

/// A point, with one look at its material.
struct LightList::Point {
  const LitPoint& lit;
  size_t element;
  Frame frame;
  Vec3 wo;
  BsdfLook look;
  Point(const LitPoint& p, size_t e) : lit(p), element(e), frame(p.frame()), wo(frame.toLocal(p.wo)), look(p.bsdf, wo) {}
};

/// The material's parts under weighted directions.
struct LightList::WeightedLobes {
  const BsdfLook& look;
  const size_t parts;
  BsdfLook::Directions way;
  alignas(32) float weight[BsdfLook::kMost];
  double sum[4][kLane] = {};  // lane by lane: in one order whatever the machine's registers
  WeightedLobes(const BsdfLook& l, bool glossy) : look(l), parts(glossy ? 4 : 1) {}
  void add(size_t count) {
    BsdfLook::Lobes lobes;
    look.at(way, count, lobes);
    const float* const of[4] = {lobes.diffuse, lobes.facets, lobes.grazing, lobes.bounced};
    for (size_t part = 0; part < parts; ++part)
      for (size_t k = 0; k < count; k += kLane)
        for (size_t i = 0; i < kLane; ++i) sum[part][i] += double(weight[k + i]) * double(of[part][k + i]);
  }
  /// Of a flat light: `c` to its place (0, 0), u and v from there along a rule's coordinates, local; its weight times `scale`, by distance and `height` of
  /// the point above its plane.
  void addFlat(const LightRule& rule, const Vec3& c, const Vec3& u, const Vec3& v, float scale, float height) {
    for (size_t begin = 0; begin < rule.count(); begin += BsdfLook::kMost) {
      const size_t count = std::min(BsdfLook::kMost, rule.count() - begin);
      for (size_t k = 0; k < count; ++k) {
        const float x = c.x + u.x * rule.x[begin + k] + v.x * rule.y[begin + k], y = c.y + u.y * rule.x[begin + k] + v.y * rule.y[begin + k],
                    z = c.z + u.z * rule.x[begin + k] + v.z * rule.y[begin + k];
        const float inverse = 1.0f / std::sqrt(x * x + y * y + z * z), square2 = inverse * inverse;
        way.x[k] = x * inverse;
        way.y[k] = y * inverse;
        way.z[k] = z * inverse;
        weight[k] = rule.weight[begin + k] * scale * height * inverse * square2;
      }
      add(count);
    }
  }
  double total(size_t part) const {
    double out = 0;
    for (size_t i = 0; i < kLane; ++i) out += sum[part][i];
    return out;
  }
};

/// A light of some size as it is seen: half angle by its sine (patches: half diagonal by distance, may be over 1), cosines of its centre to both normals and
/// of a patch's own axis to the point.
struct LightList::SeenSize {
  double sine, up, above, turned;
  bool patch;
  /// Y of the header, without the horizons' part: the lobe at its sharpest within the light.
  double worst(const Vec3& towards, const Vec3& wo, double alpha2) const {
    const Vec3 middle = towards + wo;  // twice the half vector times the cosine between both
    const double length = std::max(double(glm::length(middle)), 1e-9), c = std::max(0.5 * length - 0.5 * sine, 1e-9);
    const double tilt = std::sqrt(double(middle.x) * middle.x + double(middle.y) * middle.y) / length;
    const double least = std::max(tilt - 0.5 * sine / c, 0.0);  // of the half vector, which turns by no more than 1 / 2c of what the light spans
    return sine * sine * (1.0 / (c * c * (least * least + alpha2)) + 4.0 + (patch ? 1.0 / std::max(turned * turned, 1e-30) : 0.0));
  }
};

LightList::Kind LightList::kindOf(const LightShape& s) {
  switch (s.kind) {
    case LightKind::Point:
    case LightKind::Spot: return hasProfile(s) ? Others : Points;
    case LightKind::Directional: return !isWideDirectional(s) ? Directions : s.angularSize != 0.0f ? Caps : Squares;
    case LightKind::Sphere: return Caps;
    case LightKind::Rect:
    case LightKind::Disk: return Patches;
    case LightKind::Mesh:
    case LightKind::Environment: break;
  }
  return Others;
}

bool LightList::hasRules(const LightShape& shape) {
  const Kind kind = kindOf(shape);
  return kind == Caps || kind == Patches || kind == Squares;
}

LightList::LightList(const SceneView& view, const LightSampler& sampler, std::span<const SceneLight> lights, int samples, uint64_t seed) {
  std::vector<int> of[Kinds];
  for (size_t i = 0; i < lights.size(); ++i) {
    const LightShape& s = view.lightShape(lights[i].light);
    whole_.emplace_back(sampler, s, lights[i].light, samples, seed);
    shapes_.push_back(s);
    const bool square = kindOf(s) == Squares;
    const Frame sky = square ? mapFrame(s) : Frame(Vec3(0, 0, 1));
    edges_[0].push_back(sky.x * (0.5f * s.skyRectangle.x));
    edges_[1].push_back(sky.y * (0.5f * s.skyRectangle.y));
    of[whole_.back().facets().empty() ? kindOf(s) : Meshes].push_back(int(i));
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
      const bool square = kind == Squares;  // radiance by the tangent plane's area
      scale_.push_back(float(square                      ? double(s.skyRectangle.x) * s.skyRectangle.y / DistantLight(s).irradiance()
                             : distant                   ? 1.0 / (std::numbers::pi * std::max(sine * sine, 1e-30))
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

BsdfValue LightList::only(const LitPoint& point, size_t element, Values& values) const {
  GOBO_CHECK(whole_.size() == 1);
  at(point, element, values);
  const size_t place = size_t(std::find(index_.begin(), index_.end(), 0) - index_.begin());
  BsdfValue out;
  for (int c = 0; c < 3; ++c) {
    out.diffuse[c] = values.diffuse[c][place];
    if (values.glossy) out.specular[c] = values.specular[c][place];
  }
  return out;
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
  for (size_t place = begin_[Squares]; covered && place < begin_[Meshes + 1]; ++place) {
    if (index_[place] < 0) sampled(at, place, out);  // nobody's
    else if (place < begin_[Meshes]) square(at, place, out, ways);
    else mesh(at, place, out, ways);
  }
  for (int kind = 0; covered && kind < Squares; ++kind)
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

/// The rule for a light of some size over gloss, by Y.
RuleSize LightList::sizeOf(const Point& at, const SeenSize& l, const Vec3& towards) const {
  const LitPoint& p = at.lit;
  const double y = l.worst(towards, at.wo, double(at.look.alpha2()));
  const Vec3 folded = towards - 2.0f * glm::dot(towards, p.bsdf.facing) * p.bsdf.facing;
  const bool bent = p.n != p.ng && (l.above < l.sine || double(folded.z) > -l.sine), near = l.patch && (l.sine > 1.0 || l.turned < l.sine);
  if (bent || near) return y <= kCut ? RuleSize::Points1024 : RuleSize::None;
  if (l.up < l.sine) return y <= kDense[0] ? RuleSize::Points256 : y <= kCut ? RuleSize::Points1024 : RuleSize::None;
  const double x = y + l.sine * l.sine / (l.up * l.up);
  return x <= double(kOne)    ? RuleSize::One
         : x <= double(kMany) ? RuleSize::Many
         : x <= kDense[0]     ? RuleSize::Points64
         : x <= kDense[1]     ? RuleSize::Points256
         : x <= kDense[2]     ? RuleSize::Points1024
                              : RuleSize::None;
}

void LightList::give(const Point& at, size_t place, const WeightedLobes& f, Values& out) const {
  for (int c = 0; c < 3; ++c) {
    out.diffuse[c][place] = at.look.albedo[c] * float(f.total(0)) * power_[c][place];
    if (out.glossy)
      out.specular[c][place] =
          float(double(at.look.facets[c]) * f.total(1) + double(at.look.grazing[c]) * f.total(2) + double(at.look.bounced[c]) * f.total(3)) * power_[c][place];
  }
}

void LightList::larger(const Point& at, Kind kind, size_t place, float x, Values& out, Ways& ways) const {
  const LightShape& s = shapes_[size_t(index_[place])];
  const LitPoint& p = at.lit;
  if (Vec3 f; kind == Patches && !out.glossy && whole_[size_t(index_[place])].closedForm(p, LobePart::Diffuse, f)) {
    ++ways.closed;
    for (int c = 0; c < 3; ++c) out.diffuse[c][place] = f[c] * power_[c][place];
    return;
  }
  const bool distant = s.kind == LightKind::Directional, square = s.kind == LightKind::Rect;
  const DVec3 d = distant ? -DVec3(s.axis) : DVec3(s.position) - DVec3(p.p);
  const double d2 = glm::dot(d, d);
  const Vec3 w(d / std::sqrt(d2)), towards = at.frame.toLocal(w);
  RuleSize size = x <= kSeven ? RuleSize::Seven : x <= kMany ? RuleSize::Many : RuleSize::None;
  if (size == RuleSize::None && out.glossy) {
    SeenSize l{std::sqrt(double(size2_[place]) / (distant ? 1.0 : d2)), double(towards.z), double(glm::dot(w, p.ng)), -double(glm::dot(w, s.axis)),
               kind == Patches};
    if (s.twoSided) l.turned = std::fabs(l.turned);
    size = std::max(sizeOf(at, l, towards), RuleSize::Points64);
  }
  if (size == RuleSize::None) {
    ++ways.sampled;
    return sampled(at, place, out);
  }
  ++(size == RuleSize::Seven ? ways.seven : size == RuleSize::Many ? ways.many : ways.dense);
  WeightedLobes f(at.look, out.glossy);
  if (kind == Caps) {
    const LightRule& rule = lightRule(RuleShape::Disk, size);
    const double sine2 = double(size2_[place]) / (distant ? 1.0 : d2), gap = sine2 / (1.0 + std::sqrt(1.0 - sine2));
    const float drop = float(gap), scale = float(2.0 * std::numbers::pi * gap * double(scale_[place]));
    const Frame frame(towards);
    for (size_t begin = 0; begin < rule.count(); begin += BsdfLook::kMost) {
      const size_t count = std::min(BsdfLook::kMost, rule.count() - begin);
      for (size_t k = 0; k < count; ++k) {
        // The disk's area is the cap's: 1 - cosine is drop by the squared radius.
        const float fall = rule.r2[begin + k] * drop, side = std::sqrt(drop * (2.0f - fall)), u = rule.x[begin + k] * side, v = rule.y[begin + k] * side,
                    z = 1.0f - fall;
        f.way.x[k] = frame.x.x * u + frame.y.x * v + frame.z.x * z;
        f.way.y[k] = frame.x.y * u + frame.y.y * v + frame.z.y * z;
        f.way.z[k] = frame.x.z * u + frame.y.z * v + frame.z.z * z;
        f.weight[k] = rule.weight[begin + k] * scale;
      }
      f.add(count);
    }
  } else {
    const Frame frame(s.axis);
    const Vec3 u = at.frame.toLocal(square ? s.u : frame.x * s.radius), v = at.frame.toLocal(square ? s.v : frame.y * s.radius);
    const double height = -glm::dot(d, DVec3(s.axis));
    f.addFlat(lightRule(square ? RuleShape::Square : RuleShape::Disk, size), at.frame.toLocal(Vec3(d)), u, v, scale_[place],
              float(s.twoSided ? std::fabs(height) : std::max(height, 0.0)));
  }
  give(at, place, f, out);
}

/// A rectangle at infinity: the diffuse lobe under its centre (direct_unoccluded.h), the glossy one under all of it.
void LightList::square(const Point& at, size_t place, Values& out, Ways& ways) const {
  const size_t i = size_t(index_[place]);
  const LightShape& s = shapes_[i];
  const Vec3 w = -s.axis, towards = at.frame.toLocal(w);
  const float above = glm::dot(w, at.lit.ng);
  const double sine = 0.5 * std::hypot(double(s.skyRectangle.x), double(s.skyRectangle.y));
  if (std::min(double(towards.z), double(above)) < -sine) {
    ++ways.closed;
    for (int c = 0; c < 3; ++c) {
      out.diffuse[c][place] = 0.0f;
      if (out.glossy) out.specular[c][place] = 0.0f;
    }
    return;
  }
  if (out.glossy) {
    const RuleSize size = sizeOf(at, {sine, double(towards.z), double(above), 1.0, true}, towards);
    if (size > kMostOfSquares) {
      ++ways.sampled;
      return sampled(at, place, out);
    }
    ++(size == RuleSize::One ? ways.one : size == RuleSize::Many ? ways.many : ways.dense);
    WeightedLobes f(at.look, true);
    f.addFlat(lightRule(RuleShape::Square, size), towards, at.frame.toLocal(edges_[0][i]), at.frame.toLocal(edges_[1][i]), scale_[place], 1.0f);
    give(at, place, f, out);
  } else {
    ++ways.closed;
  }
  BsdfLook::Directions way;
  BsdfLook::Lobes centre;
  for (size_t k = 0; k < kLane; ++k) way.x[k] = towards.x, way.y[k] = towards.y, way.z[k] = above > 0.0f ? towards.z : -1.0f;
  at.look.at(way, kLane, centre);
  for (int c = 0; c < 3; ++c) out.diffuse[c][place] = at.look.albedo[c] * centre.diffuse[0] * power_[c][place];
}

/// A mesh light by the rules of its triangles, if all of them have one.
void LightList::mesh(const Point& at, size_t place, Values& out, Ways& ways) const {
  const UnoccludedLight& whole = whole_[size_t(index_[place])];
  const LitPoint& p = at.lit;
  if (Vec3 f; !out.glossy) {
    const bool closed = whole.closedForm(p, LobePart::Diffuse, f);
    ++(closed ? ways.closed : ways.sampled);
    if (!closed) return sampled(at, place, out);
    for (int c = 0; c < 3; ++c) out.diffuse[c][place] = f[c] * power_[c][place];
    return;
  }
  struct Shown {
    const LightFacet* facet;
    Vec3 corner;
    float height;
    const LightRule* rule;
  };
  std::array<Shown, UnoccludedLight::kMostFacets> shown;
  size_t count = 0, points = 0;
  RuleSize largest = RuleSize::One;
  for (const LightFacet& f : whole.facets()) {
    UnoccludedLight::SeenFacet seen;
    if (!whole.sees(p, f, seen)) continue;
    const DVec3 centre = (seen.corners[0] + seen.corners[1] + seen.corners[2]) / 3.0;
    double reach2 = 0;
    for (const DVec3& c : seen.corners) reach2 = std::max(reach2, glm::dot(c - centre, c - centre));
    const double d2 = std::max(glm::dot(centre, centre), 1e-300), height = std::fabs(glm::dot(seen.corners[0], DVec3(f.n)));
    const Vec3 w(centre / std::sqrt(d2)), towards = at.frame.toLocal(w);
    const RuleSize size = sizeOf(at, {std::sqrt(reach2 / d2), double(towards.z), double(glm::dot(w, p.ng)), height / std::sqrt(d2), true}, towards);
    const LightRule& rule = lightRule(RuleShape::Triangle, std::min(size, RuleSize::Points1024));
    points += rule.count();
    if (size == RuleSize::None || points > kMostPoints) {
      ++ways.sampled;
      return sampled(at, place, out);
    }
    largest = std::max(largest, size);
    shown[count++] = {&f, Vec3(seen.corners[0]), float(height), &rule};
  }
  WeightedLobes sum(at.look, true);
  for (const Shown& s : std::span(shown.data(), count)) {
    const LightFacet& f = *s.facet;
    sum.addFlat(*s.rule, at.frame.toLocal(s.corner), at.frame.toLocal(f.e1), at.frame.toLocal(f.e2),
                float(0.5 * glm::length(glm::cross(DVec3(f.e1), DVec3(f.e2)))), s.height);
  }
  ++(largest == RuleSize::One ? ways.one : largest <= RuleSize::Many ? ways.many : ways.dense);
  give(at, place, sum, out);
}

}  // namespace terms
}  // namespace gobo
