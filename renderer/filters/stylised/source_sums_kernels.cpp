// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>

#include "filters/stylised/source_sums.h"
#include "formulas/math.glsl.h"

namespace gobo {
inline namespace filters {

namespace {

/// (nearest2 / r2)^(p/2) of every point: at most about 1, so that it underflows at worst.
template <int kPower>
inline void ratioPowers(const float* __restrict nearest2, const float* __restrict inverse2, int p, size_t n, float* __restrict power) {
  if constexpr (kPower == 8) {
    for (size_t k = 0; k < n; ++k) {
      const float q = nearest2[k] * inverse2[k], q2 = q * q;
      power[k] = q2 * q2;
    }
  } else {
    float square[kPatchPoints];
    for (size_t k = 0; k < n; ++k) square[k] = nearest2[k] * inverse2[k];
    for (size_t k = 0; k < n; ++k) power[k] = p % 2 ? std::sqrt(square[k]) : 1.0f;
    for (int bits = p / 2; bits > 0; bits /= 2) {
      if (bits % 2)
        for (size_t k = 0; k < n; ++k) power[k] *= square[k];
      for (size_t k = 0; k < n; ++k) square[k] *= square[k];
    }
  }
}

/// The usual power in one loop.
void addEighth(const PatchSource& s, size_t n, const float* __restrict px, const float* __restrict py, const float* __restrict pz,
               const float* __restrict nearest2, float* __restrict sum) {
  const float sx = s.x, sy = s.y, sz = s.z, length = s.length;
  if (s.point) {
    for (size_t k = 0; k < n; ++k) {
      const float x = px[k] - sx, y = py[k] - sy, z = pz[k] - sz, q = nearest2[k] / (x * x + y * y + z * z), q2 = q * q;
      sum[k] += length * (q2 * q2);
    }
    return;
  }
  const float xx = s.moment[0], yy = s.moment[1], zz = s.moment[2], xy = 2.0f * s.moment[3], xz = 2.0f * s.moment[4], yz = 2.0f * s.moment[5];
  const float trace = xx + yy + zz;
  for (size_t k = 0; k < n; ++k) {
    const float x = px[k] - sx, y = py[k] - sy, z = pz[k] - sz, i2 = 1.0f / (x * x + y * y + z * z), q = nearest2[k] * i2, q2 = q * q;
    const float along = (x * (xx * x + xy * y + xz * z) + y * (yy * y + yz * z) + z * zz * z) * i2;
    sum[k] += length * (q2 * q2) * (1.0f + 4.0f * i2 * (10.0f * along - trace));
  }
}

template <int kPower>
void add(const std::vector<PatchSource>& sources, int p, PatchPoints& points) {
  if constexpr (kPower == 8) {
    for (const PatchSource& s : sources) addEighth(s, points.lanes, points.x, points.y, points.z, points.nearest2, points.sum);
    return;
  }
  const size_t n = points.lanes;
  float inverse2[kPatchPoints], power[kPatchPoints];
  for (const PatchSource& s : sources) {
    const float sx = s.x, sy = s.y, sz = s.z;
    for (size_t k = 0; k < n; ++k) {
      const float x = points.x[k] - sx, y = points.y[k] - sy, z = points.z[k] - sz;
      inverse2[k] = 1.0f / (x * x + y * y + z * z);
    }
    ratioPowers<kPower>(points.nearest2, inverse2, p, n, power);
    if (s.point) {
      for (size_t k = 0; k < n; ++k) points.sum[k] += s.length * power[k];
      continue;
    }
    const float xx = s.moment[0], yy = s.moment[1], zz = s.moment[2], xy = s.moment[3], xz = s.moment[4], yz = s.moment[5];
    const float trace = xx + yy + zz, half = 0.5f * float(p), next = float(p + 2);
    for (size_t k = 0; k < n; ++k) {
      const float x = points.x[k] - sx, y = points.y[k] - sy, z = points.z[k] - sz, i2 = inverse2[k];
      const float along = (x * (xx * x + 2.0f * (xy * y + xz * z)) + y * (yy * y + 2.0f * yz * z) + z * zz * z) * i2;
      points.sum[k] += s.length * power[k] * (1.0f + half * i2 * (next * along - trace));
    }
  }
}

/// Nodes and weights on [-1, 1] of Gauss's rules of two and four points, and the factors of their errors (contour_tree.cpp).
constexpr float kNode2 = 0.577350269f, kNode4[4] = {-0.861136312f, -0.339981044f, 0.339981044f, 0.861136312f},
                kWeight4[4] = {0.347854845f, 0.652145155f, 0.652145155f, 0.347854845f};
constexpr double kAccuracy = 1e-6;
constexpr int kMostPieces = 64;

double reachOf(double factor, int derivatives, int p) {
  for (int k = 0; k < derivatives; ++k) factor *= double(p + k);
  return std::pow(kAccuracy / factor, 1.0 / derivatives);
}

template <int kPower>
inline void addNode(const float* __restrict from, const float* __restrict length, const float* __restrict h2, float at, float weight, int p,
                    float* __restrict sum) {
  for (size_t k = 0; k < kLanes; ++k) {
    const float t = from[k] + at * length[k], q = 1.0f / (h2[k] + t * t);
    float power = 1.0f;
    if constexpr (kPower == 8) {
      const float q2 = q * q;
      power = q2 * q2;
    } else {
      float square = q;
      if (p % 2) power = std::sqrt(q);
      for (int bits = p / 2; bits > 0; bits /= 2) {
        if (bits % 2) power *= square;
        square *= square;
      }
    }
    sum[k] += weight * power;
  }
}

template <int kPower>
void addNear(const std::vector<NearSegment>& segments, int p, NearPoints& points) {
  const double reach2 = reachOf(3.7037e-3, 4, p), reach4 = reachOf(1.4397e-7, 8, p);
  float inverse[kPatchPoints];
  for (size_t k = 0; k < points.lanes; ++k) inverse[k] = float(1.0 / std::sqrt(std::max(points.nearest2[k], 1e-70)));
  for (const NearSegment& s : segments)
    for (size_t first = 0; first < points.lanes; first += kLanes) {
      float from[kLanes], length[kLanes], h2[kLanes], seen[kLanes], sum[kLanes];
      double d2[kLanes];
      for (size_t l = 0; l < kLanes; ++l) {
        const size_t k = first + l;
        const double x = s.ax - points.x[k], y = s.ay - points.y[k], z = s.az - points.z[k], along = x * s.ux + y * s.uy + z * s.uz;
        const double cx = x - along * s.ux, cy = y - along * s.uy, cz = z - along * s.uz, across2 = cx * cx + cy * cy + cz * cz;
        const double before = along > 0.0 ? along : 0.0, after = -(along + s.length) > 0.0 ? -(along + s.length) : 0.0, rest = before + after;
        d2[l] = across2 + rest * rest;
        from[l] = float(along) * inverse[k];
        length[l] = float(s.length) * inverse[k];
        h2[l] = float(across2 / points.nearest2[k]);
        seen[l] = s.nx * points.nx[k] + s.ny * points.ny[k] + s.nz * points.nz[k] >= s.cosine ? 1.0f : 0.0f;
        sum[l] = 0;
      }
      double least2 = HUGE_VAL;
      for (size_t l = 0; l < kLanes; ++l)
        if (seen[l] != 0.0f && points.nearest2[first + l] > 0) least2 = std::min(least2, d2[l]);
      if (least2 == HUGE_VAL) continue;
      const double half = 0.5 * s.length / std::sqrt(least2);
      if (half <= reach2) {
        for (const float node : {-kNode2, kNode2}) addNode<kPower>(from, length, h2, 0.5f + 0.5f * node, 0.5f, p, sum);
      } else if (half <= reach4 * kMostPieces) {
        const int pieces = int(half / reach4) + 1;
        const float piece = 1.0f / float(pieces);
        for (int n = 0; n < pieces; ++n)
          for (int k = 0; k < 4; ++k) addNode<kPower>(from, length, h2, (float(n) + 0.5f + 0.5f * kNode4[k]) * piece, 0.5f * kWeight4[k] * piece, p, sum);
      } else {
        const DVec3 a(s.ax, s.ay, s.az), b = a + s.length * DVec3(s.ux, s.uy, s.uz);
        for (size_t l = 0; l < kLanes; ++l) {
          const size_t k = first + l;
          if (seen[l] != 0.0f && points.nearest2[k] > 0)
            points.sum[k] += inversePowerIntegral(DVec3(points.x[k], points.y[k], points.z[k]), a, b, p, points.nearest2[k]);
        }
        continue;
      }
      for (size_t l = 0; l < kLanes; ++l) points.sum[first + l] += seen[l] != 0.0f ? double(sum[l]) * s.length : 0.0;
    }
}

}  // namespace

PatchSource patchSource(const PatchSources::Source& source, const DVec3& centre, double unit) {
  const DVec3 at = (source.at - centre) / unit;
  PatchSource s{float(at.x), float(at.y), float(at.z), float(source.length / unit), {}, source.point};
  for (size_t k = 0; k < 6; ++k) s.moment[k] = float(source.moment[k] / (unit * unit));
  return s;
}

void nearestSources(const std::vector<PatchSource>& sources, PatchPoints& points) {
  const size_t n = points.lanes;
  for (const PatchSource& s : sources) {
    const float sx = s.x, sy = s.y, sz = s.z;
    for (size_t k = 0; k < n; ++k) {
      const float x = points.x[k] - sx, y = points.y[k] - sy, z = points.z[k] - sz, d2 = x * x + y * y + z * z;
      points.nearest2[k] = d2 < points.nearest2[k] ? d2 : points.nearest2[k];
    }
  }
}

void addSources(const std::vector<PatchSource>& sources, int p, PatchPoints& points) {
  if (p == 8) add<8>(sources, p, points);
  else add<0>(sources, p, points);
}

void nearestSegments(const std::vector<NearSegment>& segments, NearPoints& points) {
  for (const NearSegment& s : segments) {
    const double guarded = s.cosine > -2.0f ? s.length : 0.0;
    for (size_t k = 0; k < points.lanes; ++k) {
      const double x = s.ax - points.x[k], y = s.ay - points.y[k], z = s.az - points.z[k], along = x * s.ux + y * s.uy + z * s.uz;
      const double cx = x - along * s.ux, cy = y - along * s.uy, cz = z - along * s.uz;
      const double before = along > 0.0 ? along : 0.0, after = -(along + s.length) > 0.0 ? -(along + s.length) : 0.0, rest = before + after;
      const double d2 = cx * cx + cy * cy + cz * cz + rest * rest;
      const bool seen = s.nx * points.nx[k] + s.ny * points.ny[k] + s.nz * points.nz[k] >= s.cosine;
      points.nearest2[k] = seen && d2 < points.nearest2[k] ? d2 : points.nearest2[k];
      points.length[k] += seen ? guarded : 0.0;
    }
  }
}

void addSegments(const std::vector<NearSegment>& segments, int p, NearPoints& points) {
  if (p == 8) addNear<8>(segments, p, points);
  else addNear<0>(segments, p, points);
}

void powers(const float* __restrict ratio, float exponent, size_t n, float* __restrict d) {
  for (size_t k = 0; k < n; ++k) d[k] = formulas::fastExp(formulas::fastLog(ratio[k]) * exponent);
}

void interpolated(const InterpolatedSum& of, const float* __restrict u, const float* __restrict v, size_t n, float* __restrict sum) {
  constexpr size_t kSide = InterpolatedSum::kSide;
  for (size_t first = 0; first < n; first += kLanes) {
    float row[kLanes], all[kLanes] = {};
    for (size_t i = kSide; i-- > 0;) {
      const float* __restrict c = &of.share[i * kSide];
      for (size_t l = 0; l < kLanes; ++l) row[l] = c[kSide - 1];
      for (size_t j = kSide - 1; j-- > 0;)
        for (size_t l = 0; l < kLanes; ++l) row[l] = row[l] * v[first + l] + c[j];
      for (size_t l = 0; l < kLanes; ++l) all[l] = all[l] * u[first + l] + row[l];
    }
    for (size_t l = 0; l < kLanes; ++l) sum[first + l] = all[l];
  }
}

bool isOneSurface(const SurfacePatch& p, float cosine, float reach) {
  int alike = 1;
  for (size_t k = 0; k < kPatchPoints; ++k) {
    const float x = p.x[k] - p.x[0], y = p.y[k] - p.y[0], z = p.z[k] - p.z[0], w = reach * (p.width[k] > p.width[0] ? p.width[k] : p.width[0]);
    const float turn = p.nx[k] * p.nx[0] + p.ny[k] * p.ny[0] + p.nz[k] * p.nz[0];
    alike &= int(p.id[k] == p.id[0]) & int(turn >= cosine) & int(x * x + y * y + z * z <= w * w);
  }
  return alike && p.id[0] != ~0u;
}

Span spanAlong(const SurfacePatch& p, const Vec3& from, const Vec3& along) {
  float low[kLanes], high[kLanes];
  for (size_t l = 0; l < kLanes; ++l) low[l] = std::numeric_limits<float>::max(), high[l] = -low[l];
  for (size_t first = 0; first < kPatchPoints; first += kLanes)
    for (size_t l = 0; l < kLanes; ++l) {
      const size_t k = first + l;
      const float at = (p.x[k] - from.x) * along.x + (p.y[k] - from.y) * along.y + (p.z[k] - from.z) * along.z;
      low[l] = at < low[l] ? at : low[l];
      high[l] = at > high[l] ? at : high[l];
    }
  return {*std::min_element(low, low + kLanes), *std::max_element(high, high + kLanes)};
}

void boundsOf(const SurfacePatch& p, const Vec3& from, const Vec3& axis, float& farthest2, float& least) {
  float far[kLanes], low[kLanes];
  for (size_t l = 0; l < kLanes; ++l) far[l] = 0, low[l] = 1;
  for (size_t first = 0; first < kPatchPoints; first += kLanes)
    for (size_t l = 0; l < kLanes; ++l) {
      const size_t k = first + l;
      const float x = p.x[k] - from.x, y = p.y[k] - from.y, z = p.z[k] - from.z, r2 = x * x + y * y + z * z;
      const float turn = p.nx[k] * axis.x + p.ny[k] * axis.y + p.nz[k] * axis.z;
      far[l] = r2 > far[l] ? r2 : far[l];
      low[l] = turn < low[l] ? turn : low[l];
    }
  farthest2 = *std::max_element(far, far + kLanes);
  least = *std::min_element(low, low + kLanes);
}

}  // namespace filters
}  // namespace gobo
