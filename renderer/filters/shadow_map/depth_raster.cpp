// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/depth_raster.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "filters/shadow_map/depth_raster_kernels.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr size_t kChunk = 4096;  // triangles sorted by one task
// Coverage is decided in double, where texel positions err by 1e-12: corners that lie on a centre count as covering it.
constexpr double kRim = 1e-6;

struct Line {
  double a, b, c;
};  // a x + b y + c
template <typename Corner>
Line through(const Corner& p, const Corner& q) {
  return {p.y * q.w - p.w * q.y, p.w * q.x - p.x * q.w, p.x * q.y - p.y * q.x};
}

}  // namespace

struct DepthRaster::Buffer {
  int first = 0, side = 0;  // row of the map, texels a row
  std::vector<float> q;
  std::vector<uint8_t> open;  // empty until an alpha surface comes
};

DepthRaster::DepthRaster(const LightFrame& frame, int resolution, std::span<const RasterMesh> meshes)
    : frame_(frame), resolution_(resolution), meshes_(meshes) {
  GOBO_CHECK(resolution >= 1);
  using D = glm::dvec3;
  const double sx = resolution / (double(frame.hi.x) - frame.lo.x), sy = resolution / (double(frame.hi.y) - frame.lo.y);
  const D right(frame.right), up(frame.up), forward(frame.forward);
  // Texel positions as rows of an affine map on p - origin, x = (right . p - lo w) s - w / 2 with w = forward . p or 1.
  const double ox = frame.lo.x * sx + 0.5, oy = frame.lo.y * sy + 0.5;
  struct Row {
    D a;
    double b;
  };
  const Row w = frame.perspective ? Row{forward, 0.0} : Row{D(0.0), 1.0};
  const Row rows[4] = {{right * sx - w.a * ox, -w.b * ox}, {up * sy - w.a * oy, -w.b * oy}, w, {forward, 0.0}};
  rows_.reserve(meshes.size());
  for (uint32_t m = 0; m < meshes.size(); ++m) {
    const glm::dmat4 toWorld(meshes[m].toWorld);
    Rows r{};
    double* const to[4] = {r.x, r.y, r.w, r.z};
    for (int k = 0; k < 4; ++k) {
      for (int c = 0; c < 3; ++c) to[k][c] = glm::dot(rows[k].a, D(toWorld[c]));
      to[k][3] = glm::dot(rows[k].a, D(toWorld[3]) - D(frame.origin)) + rows[k].b;
    }
    rows_.push_back(r);
    for (size_t first = 0; first < meshes[m].triangles; first += kChunk) {
      Chunk c;
      c.mesh = m;
      c.first = uint32_t(first);
      c.count = uint32_t(std::min(kChunk, meshes[m].triangles - first));
      chunks_.push_back(std::move(c));
    }
  }
}

void DepthRaster::corners(uint32_t mesh, uint32_t triangle, Corner (&v)[3]) const {
  const RasterMesh& m = meshes_[mesh];
  const Rows& r = rows_[mesh];
  for (int k = 0; k < 3; ++k) {
    const Vec3& p = m.positions[m.indices[3 * size_t(triangle) + size_t(k)]];
    const double x = p.x, y = p.y, z = p.z;
    const auto row = [&](const double* a) { return (a[0] * x + a[1] * y) + (a[2] * z + a[3]); };
    v[k].x = row(r.x);
    v[k].y = row(r.y);
    v[k].z = row(r.z);
    v[k].w = frame_.perspective ? v[k].z : 1.0;
  }
}

// Rows whose texel centres the triangle may cover; false: it covers none.
bool DepthRaster::rowsOf(const Corner (&v)[3], int& first, int& last) const {
  const double most = std::max({v[0].w, v[1].w, v[2].w}), least = std::min({v[0].w, v[1].w, v[2].w});
  if (!(most > 0.0)) return false;
  const double end = resolution_ - 1;
  double x0 = 0.0, x1 = end, y0 = 0.0, y1 = end;
  if (least > 1e-9 * most) {
    double x[3], y[3];
    for (int k = 0; k < 3; ++k) {
      const double inverse = frame_.perspective ? 1.0 / v[k].w : 1.0;
      x[k] = v[k].x * inverse;
      y[k] = v[k].y * inverse;
    }
    x0 = std::max(x0, std::ceil(std::min({x[0], x[1], x[2]}) - kRim));
    x1 = std::min(x1, std::floor(std::max({x[0], x[1], x[2]}) + kRim));
    y0 = std::max(y0, std::ceil(std::min({y[0], y[1], y[2]}) - kRim));
    y1 = std::min(y1, std::floor(std::max({y[0], y[1], y[2]}) + kRim));
  }
  if (!(x0 <= x1 && y0 <= y1)) return false;
  first = int(y0);
  last = int(y1);
  return true;
}

void DepthRaster::sortChunk(Chunk& c) const {
  struct Entry {
    uint32_t triangle;
    int first, last;
  };
  std::vector<Entry> entries;
  c.start.assign(size_t(bands()) + 1, 0);
  for (uint32_t t = c.first; t < c.first + c.count; ++t) {
    Corner v[3];
    corners(c.mesh, t, v);
    int y0, y1;
    if (!rowsOf(v, y0, y1)) continue;
    entries.push_back({t, y0 / kBand, y1 / kBand});
    for (int b = y0 / kBand; b <= y1 / kBand; ++b) ++c.start[size_t(b) + 1];
  }
  for (size_t b = 1; b < c.start.size(); ++b) c.start[b] += c.start[b - 1];
  c.triangles.resize(c.start.back());
  std::vector<uint32_t> at(c.start.begin(), c.start.end() - 1);
  for (const Entry& e : entries)
    for (int b = e.first; b <= e.last; ++b) c.triangles[at[size_t(b)]++] = e.triangle;
}

bool DepthRaster::sort(const TaskArena& arena, const StopToken& stop) {
  return arena.parallelFor(
      chunks_.size(), 1,
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) sortChunk(chunks_[i]);
      },
      stop);
}

void DepthRaster::triangle(const Corner (&v)[3], int y0, int y1, bool alpha, Buffer& buffer) const {
  Line e[3] = {through(v[1], v[2]), through(v[2], v[0]), through(v[0], v[1])};
  const double D = v[0].x * e[0].a + v[0].y * e[0].b + v[0].w * e[0].c;
  if (!(std::fabs(D) > 0.0) || !std::isfinite(D)) return;  // seen edge on
  const double inverse = 1.0 / D;
  // sum_i e_i is det / w for a perspective map, which has 1 / depth = sum_i e_i / D; else depth = sum_i depth_i e_i / D.
  double f[3];
  for (int k = 0; k < 3; ++k) f[k] = frame_.perspective ? inverse : -v[k].z * inverse;
  const Line q{f[0] * e[0].a + f[1] * e[1].a + f[2] * e[2].a, f[0] * e[0].b + f[1] * e[1].b + f[2] * e[2].b, f[0] * e[0].c + f[1] * e[1].c + f[2] * e[2].c};
  DepthSpan span{0.0f, float(q.a), 0.0f, 3.0e38f};
  const double least = std::min({v[0].z, v[1].z, v[2].z}), most = std::max({v[0].z, v[1].z, v[2].z});
  if (!frame_.perspective) {
    span.lo = float(-most);
    span.hi = float(-least);
  } else {
    span.lo = float(1.0 / most);  // most > 0, or rowsOf() had said no
    if (least > 1e-30) span.hi = std::min(float(1.0 / least), 3.0e38f);
  }
  if (!std::isfinite(span.step)) return;
  double inverseA[3];
  for (int k = 0; k < 3; ++k) {
    if (D < 0.0) e[k] = {-e[k].a, -e[k].b, -e[k].c};  // now e >= 0 inside, in front of the light
    inverseA[k] = e[k].a != 0.0 ? 1.0 / e[k].a : 0.0;
  }
  for (int y = y0; y <= y1; ++y) {
    double x0 = 0.0, x1 = resolution_ - 1;
    bool empty = false;
    for (int k = 0; k < 3; ++k) {
      const double c = e[k].b * y + e[k].c;
      if (e[k].a > 0.0) x0 = std::max(x0, std::ceil(-c * inverseA[k] - kRim));
      else if (e[k].a < 0.0) x1 = std::min(x1, std::floor(-c * inverseA[k] + kRim));
      else empty |= !(c >= -1e-9 * (std::fabs(e[k].b * y) + std::fabs(e[k].c)));
    }
    if (empty || !(x0 <= x1)) continue;
    const int first = int(x0);
    const size_t n = size_t(x1 - x0) + 1, at = size_t(y - buffer.first) * size_t(buffer.side) + size_t(first);
    span.start = float(q.a * x0 + (q.b * y + q.c));
    if (alpha) openSpan(&buffer.q[at], &buffer.open[at], n, span);
    else nearestSpan(&buffer.q[at], n, span);
  }
}

void DepthRaster::band(int b, float* z, std::vector<uint32_t>& open) const {
  open.clear();
  const int y0 = b * kBand, y1 = std::min(y0 + kBand, resolution_) - 1;
  const size_t texels = size_t(y1 - y0 + 1) * size_t(resolution_);
  const float nothing = frame_.perspective ? 0.0f : -3.0e38f;
  Buffer buffer;
  buffer.first = y0;
  buffer.side = resolution_;
  buffer.q.assign(texels, nothing);
  for (int pass = 0; pass < 2; ++pass) {  // opaque ones first: what lies behind them needs no ray
    for (const Chunk& c : chunks_) {
      if (meshes_[c.mesh].alpha != (pass == 1) || c.start[size_t(b)] == c.start[size_t(b) + 1]) continue;
      if (pass == 1 && buffer.open.empty()) buffer.open.assign(texels, 0);
      for (uint32_t i = c.start[size_t(b)]; i < c.start[size_t(b) + 1]; ++i) {
        Corner v[3];
        corners(c.mesh, c.triangles[i], v);
        int first, last;
        if (rowsOf(v, first, last)) triangle(v, std::max(first, y0), std::min(last, y1), pass == 1, buffer);
      }
    }
  }
  const float scale = 1.0f / (frame_.far - frame_.near);
  float* out = z + size_t(y0) * size_t(resolution_);
  if (frame_.perspective) resolvePerspective(buffer.q.data(), out, texels, frame_.near, scale, nothing);
  else resolveOrthographic(buffer.q.data(), out, texels, frame_.near, scale, nothing);
  for (size_t i = 0; i < buffer.open.size(); ++i)
    if (buffer.open[i]) open.push_back(uint32_t(size_t(y0) * size_t(resolution_) + i));
}

}  // namespace filters
}  // namespace gobo
