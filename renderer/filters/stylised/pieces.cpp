// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/pieces.h"

#include <algorithm>
#include <cmath>
#include <complex>

namespace gobo {
inline namespace filters {

namespace {

constexpr double kAlikeVariances = 0.02;  // relative difference of variances below which they say nothing of a direction
constexpr double kThinnestShape = 1e-6;   // standard deviation by the other
constexpr size_t kRowsBetweenStops = 16;

struct SampleCell {
  DVec3 x{0.0}, y{0.0};  ///< sides of the parallelogram
  double area = 0;
};

SampleCell surfaceCellOf(const ContourInput& in, const SurfaceLinks& links, size_t e) {
  const DVec3 P(in.at(in.P, e));
  const auto step = [&](int after, int before) {
    const DVec3 to = links.has(e, after) ? DVec3(in.at(in.P, links.neighbour(e, after))) : P;
    const DVec3 from = links.has(e, before) ? DVec3(in.at(in.P, links.neighbour(e, before))) : P;
    return links.has(e, after) && links.has(e, before) ? 0.5 * (to - from) : to - from;
  };
  SampleCell cell{step(kRight, kLeft), step(kBelow, kAbove)};
  cell.area = glm::length(glm::cross(cell.x, cell.y));
  if (cell.area > 0) return cell;
  const Frame frame(in.at(in.N, e));
  const double width = double(in.footprint[e]);
  return {DVec3(frame.x) * width, DVec3(frame.y) * width, width * width};
}

/// Roots are the first samples of their pieces.
class UnionFind {
 public:
  explicit UnionFind(size_t n) : parent_(n) {
    for (size_t k = 0; k < n; ++k) parent_[k] = uint32_t(k);
  }
  uint32_t root(uint32_t e) {
    while (parent_[e] != e) e = parent_[e] = parent_[parent_[e]];
    return e;
  }
  void join(uint32_t a, uint32_t b) {
    a = root(a), b = root(b);
    if (a < b) parent_[b] = a;
    else parent_[a] = b;
  }

 private:
  std::vector<uint32_t> parent_;
};

struct PieceSums {
  DVec3 places{0.0}, normals{0.0};
  Frame frame{Vec3(0, 0, 1)};
  double uu = 0, uv = 0, vv = 0;
  std::complex<double> fourth = 0;
};

Result<ShadowPieces> labelled(const ContourInput& in, const SurfaceLinks& links, std::span<const float> D, const StopToken& stop) {
  const size_t w = size_t(in.width);
  const auto shadowed = [&](size_t e) { return D[e] < 0.0f && in.valid(e); };
  UnionFind sets(D.size());
  ShadowPieces out;
  out.label.assign(D.size(), ShadowPieces::kNone);
  for (size_t e = 0; e < D.size(); ++e) {
    if (e % (kRowsBetweenStops * w) == 0 && stop.stopRequested()) return Status(Code::Cancelled, "pieces: stopped");
    if (!shadowed(e)) continue;
    for (const int k : {kRight, kBelowRight, kBelow, kBelowLeft})
      if (links.has(e, k) && shadowed(links.neighbour(e, k))) sets.join(uint32_t(e), uint32_t(links.neighbour(e, k)));
  }
  for (size_t e = 0; e < D.size(); ++e) {
    if (!shadowed(e)) continue;
    const uint32_t root = sets.root(uint32_t(e));
    if (root == e) {
      out.label[e] = uint32_t(out.pieces.size());
      out.pieces.emplace_back();
    } else out.label[e] = out.label[root];
    ++out.pieces[out.label[e]].samples;
  }
  return out;
}

void shapePiece(ShadowPiece& piece, const PieceSums& sums, double angularity) {
  const double uu = sums.uu / piece.area, uv = sums.uv / piece.area, vv = sums.vv / piece.area, total = uu + vv;
  if (!(total > 0) || !std::isfinite(total)) return;
  double turn = 0.5 * std::atan2(2 * uv, uu - vv);
  const bool alike = std::hypot(uu - vv, 2 * uv) < kAlikeVariances * total;
  // Of a square with sides along u and v the mean of (u + iv)^4 is negative.
  if (alike && angularity > 0 && std::abs(sums.fourth) > 0) turn = 0.25 * std::arg(-sums.fourth);
  const double c = std::cos(turn), s = std::sin(turn);
  const double along = std::sqrt(std::max(c * c * uu + 2 * c * s * uv + s * s * vv, 0.0)),
               across = std::sqrt(std::max(s * s * uu - 2 * c * s * uv + c * c * vv, 0.0));
  const double least = kThinnestShape * std::max(along, across);
  piece.u = DVec3(sums.frame.x) * c + DVec3(sums.frame.y) * s;
  piece.v = DVec3(sums.frame.y) * c - DVec3(sums.frame.x) * s;
  piece.shape = TargetShape::ofArea(piece.area, std::max(along, least), std::max(across, least), angularity);
  piece.whole = true;
}

}  // namespace

Result<ShadowPieces> shadowPieces(const ContourInput& in, const SurfaceLinks& links, std::span<const float> D, double angularity, const StopToken& stop) {
  GOBO_ASSIGN(ShadowPieces out, labelled(in, links, D, stop));
  std::vector<PieceSums> sums(out.pieces.size());
  const auto over = [&](const auto& body) {
    for (size_t e = 0; e < D.size(); ++e) {
      if (e % (kRowsBetweenStops * size_t(in.width)) == 0 && stop.stopRequested()) return false;
      if (out.label[e] != ShadowPieces::kNone) body(e, out.pieces[out.label[e]], sums[out.label[e]]);
    }
    return true;
  };
  const Status stopped(Code::Cancelled, "pieces: stopped");
  if (!over([&](size_t e, ShadowPiece& p, PieceSums& s) {
        const double area = surfaceCellOf(in, links, e).area;
        p.area += area;
        s.places += area * DVec3(in.at(in.P, e));
        s.normals += area * DVec3(in.at(in.N, e));
      }))
    return stopped;
  std::vector<uint8_t> seen(out.pieces.size(), 0);
  for (size_t e = 0; e < D.size(); ++e) {  // the first sample's normal where the mean has no direction
    const uint32_t k = out.label[e];
    if (k == ShadowPieces::kNone || seen[k]) continue;
    seen[k] = 1;
    ShadowPiece& p = out.pieces[k];
    const double length = glm::length(sums[k].normals);
    p.normal = length > 1e-6 * p.area ? Vec3(sums[k].normals / length) : in.at(in.N, e);
    sums[k].frame = Frame(p.normal);
    if (p.area > 0) p.centre = sums[k].places / p.area;
  }
  if (!over([&](size_t e, ShadowPiece& p, PieceSums& s) {
        const SampleCell cell = surfaceCellOf(in, links, e);
        const DVec3 d = DVec3(in.at(in.P, e)) - p.centre, x(s.frame.x), y(s.frame.y);
        const double u = glm::dot(d, x), v = glm::dot(d, y), xu = glm::dot(cell.x, x), xv = glm::dot(cell.x, y), yu = glm::dot(cell.y, x),
                     yv = glm::dot(cell.y, y);
        s.uu += cell.area * (u * u + (xu * xu + yu * yu) / 12);
        s.uv += cell.area * (u * v + (xu * xv + yu * yv) / 12);
        s.vv += cell.area * (v * v + (xv * xv + yv * yv) / 12);
        const std::complex<double> z(u, v), square = z * z;
        s.fourth += cell.area * square * square;
        p.thickness = std::max(p.thickness, std::abs(glm::dot(d, DVec3(p.normal))) + double(in.footprint[e]));
      }))
    return stopped;
  for (size_t k = 0; k < out.pieces.size(); ++k)
    if (out.pieces[k].area > 0) shapePiece(out.pieces[k], sums[k], angularity);
  return out;
}

double distanceToTarget(const ShadowPiece& piece, const DVec3& x) {
  const DVec3 d = x - piece.centre;
  const double away = std::max(std::abs(glm::dot(d, DVec3(piece.normal))) - piece.thickness, 0.0);
  const double flat = piece.shape.distance(glm::dot(d, piece.u), glm::dot(d, piece.v));
  return away > 0 ? std::hypot(std::max(flat, 0.0), away) : flat;
}

}  // namespace filters
}  // namespace gobo
