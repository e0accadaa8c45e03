// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/summed_area.h"

#include <algorithm>
#include <cmath>

#include "formulas/math.glsl.h"

namespace gobo {

namespace {
constexpr int kCoarse = 16;             // texels a side of the coarse table's texel
constexpr float kLargestFine = 248.0f;  // texels a side of a box: 250^2 (both ends cut) times 2^15 stays below 2^31
/// Steps per 1 such that a box of `side` texels stays below 2^31.
double unit(int side) { return std::min(32768.0, std::floor(2147483647.0 / (double(side) * side))); }
double fineUnit(int resolution) { return unit(std::min(resolution, 250)); }
int coarseSide(int resolution) { return (resolution + kCoarse - 1) / kCoarse; }

uint32_t quantise(float v, double unit) { return uint32_t(int32_t(std::lrint(double(formulas::limit(formulas::finiteOr(v, 0.0f), -1.0f, 1.0f)) * unit))); }

class SummedAreaNode : public Node {
 public:
  SummedAreaNode(ShadowBasisPtr basis, int resolution, int faces) : basis_(std::move(basis)), resolution_(resolution), faces_(faces) {
    GOBO_CHECK(basis_->bounded());
  }
  std::string type() const override { return "shadow_summed_area"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher&) const override {}
  size_t outputBytes() const override {
    const size_t fine = size_t(resolution_) * size_t(resolution_), coarse = size_t(coarseSide(resolution_)) * size_t(coarseSide(resolution_));
    return (fine + coarse) * size_t(faces_) * size_t(basis_->channels()) * 4;
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& map = *ctx.inputs.at(0);
    const std::span<const float> B = map.floats("B");
    const size_t C = size_t(map.channels("B")), side = size_t(resolution_), coarse = size_t(coarseSide(resolution_));
    const size_t fineSums = side * side * C, faceSums = fineSums + coarse * coarse * C;
    const int faces = map.extent().layers;
    GOBO_CHECK_EQ(B.size(), fineSums * size_t(faces));
    auto term = std::make_shared<Term>("shadow_summed_area", Domain::LightTexel, Extent{int(side * side + coarse * coarse), 1, faces});
    const std::span<uint32_t> sums = term->addPlane<uint32_t>("sums", int(C));
    const auto stopped = [] { return Status(Code::Cancelled, "shadow_summed_area stopped"); };
    for (int face = 0; face < faces; ++face) {
      uint32_t* fine = &sums[size_t(face) * faceSums];
      uint32_t* rough = fine + fineSums;
      const float* b = &B[size_t(face) * fineSums];
      if (!rows(ctx, fine, side, C, [&](size_t x, size_t y, size_t k) { return quantise(b[(y * side + x) * C + k], fineUnit(resolution_)); })) return stopped();
      const auto mean = [&](size_t x, size_t y, size_t k) {
        const size_t x1 = std::min((x + 1) * kCoarse, side), y1 = std::min((y + 1) * kCoarse, side);
        double sum = 0;
        for (size_t j = y * kCoarse; j < y1; ++j)
          for (size_t i = x * kCoarse; i < x1; ++i) sum += double(b[(j * side + i) * C + k]);
        return quantise(float(sum / double((x1 - x * kCoarse) * (y1 - y * kCoarse))), unit(int(coarse)));
      };
      if (!rows(ctx, rough, coarse, C, mean)) return stopped();
      if (!columns(ctx, fine, side, C) || !columns(ctx, rough, coarse, C)) return stopped();
    }
    return TermPtr(term);
  }

 private:
  template <typename Value>
  static bool rows(const RunContext& ctx, uint32_t* sums, size_t side, size_t C, const Value& value) {
    return ctx.arena->parallelFor(side, 8, [&](size_t begin, size_t end) {
      for (size_t y = begin; y < end; ++y)
        for (size_t x = 0; x < side; ++x)
          for (size_t k = 0; k < C; ++k) {
            const size_t at = (y * side + x) * C + k;
            sums[at] = value(x, y, k) + (x ? sums[at - C] : 0u);
          }
    }, ctx.stop);
  }
  static bool columns(const RunContext& ctx, uint32_t* sums, size_t side, size_t C) {
    constexpr size_t kColumns = 512;   // a strip of values that stays in the cache from row to row
    const size_t row = side * C, strips = (row + kColumns - 1) / kColumns;
    return ctx.arena->parallelFor(strips, 1, [&](size_t begin, size_t end) {
      for (size_t s = begin; s < end; ++s)
        for (size_t y = 1; y < side; ++y) {
          uint32_t* here = sums + y * row + s * kColumns;
          const uint32_t* above = here - row;
          const size_t n = std::min(kColumns, row - s * kColumns);
          for (size_t i = 0; i < n; ++i) here[i] += above[i];
        }
    }, ctx.stop);
  }
  ShadowBasisPtr basis_;
  int resolution_, faces_;
};

}  // namespace

SummedArea::SummedArea(const Term& term, int resolution) : channels_(term.channels("sums")), resolution_(resolution) {
  const std::span<const uint32_t> sums = term.plane<uint32_t>("sums");
  const size_t side = size_t(resolution), coarse = size_t(coarseSide(resolution)), C = size_t(channels_);
  const size_t faceSums = (side * side + coarse * coarse) * C;
  GOBO_CHECK_EQ(sums.size(), faceSums * size_t(term.extent().layers));
  fine_ = {sums.data(), faceSums, resolution, fineUnit(resolution)};
  coarse_ = {sums.data() + side * side * C, faceSums, int(coarse), unit(int(coarse))};
}

void SummedArea::box(int face, float x, float y, float width, float height, int begin, int end, float* out) const {
  const float last = float(resolution_);
  const auto span = [last](float centre, float size, float& lo, float& hi) {   // texel i is [i, i + 1]
    const float c = formulas::limit(centre + 0.5f, 0.5f, last - 0.5f), half = 0.5f * std::max(size, 1.0f);
    lo = std::max(c - half, 0.0f);
    hi = std::min(c + half, last);
  };
  float x0, x1, y0, y1;
  span(x, width, x0, x1);
  span(y, height, y0, y1);
  if (x1 - x0 <= kLargestFine && y1 - y0 <= kLargestFine) return corners(fine_, face, x0, y0, x1, y1, begin, end, out);
  const float s = 1.0f / float(kCoarse);
  corners(coarse_, face, x0 * s, y0 * s, std::max(x1 * s, x0 * s + 1.0f), std::max(y1 * s, y0 * s + 1.0f), begin, end, out);
}

namespace {
// An edge at a fractional position is the mix of the two whole ones around it: exact for texels of constant value.
struct Edge { int at; float f; };
Edge edge(float x, int side) {
  const float c = std::min(x, float(side));
  const int at = std::min(int(c), side - 1);
  return {at, c - float(at)};
}
}  // namespace

void SummedArea::corners(const Table& t, int face, float x0, float y0, float x1, float y1, int begin, int end, float* out) const {
  const size_t C = size_t(channels_), side = size_t(t.side);
  const uint32_t* base = t.sums + size_t(face) * t.faceSums;
  const Edge ax = edge(x0, t.side), bx = edge(x1, t.side), ay = edge(y0, t.side), by = edge(y1, t.side);
  // Sum of texels [0, x) x [0, y); 0 at the rim.
  const auto prefix = [&](int x, int y, size_t k) { return x == 0 || y == 0 ? 0u : base[(size_t(y - 1) * side + size_t(x - 1)) * C + k]; };
  // Box sums by difference wrap around exactly; they are made whole numbers before they meet fractions. The box is cut into the whole
  // texels and strips at its four sides: mean = sum over corners of bilinear weights of *differences*, so each difference is taken in
  // integers first.
  const double area = (double(x1) - double(x0)) * (double(y1) - double(y0));
  for (int c = begin; c < end; ++c) {
    const size_t k = size_t(c);
    // F(u, v) = sum over [ax.at, u) x [ay.at, v), relative to the box's own corner: small enough for 32 bits.
    const uint32_t p00 = prefix(ax.at, ay.at, k);
    const auto F = [&](int u, int v) {
      return double(int32_t(prefix(u, v, k) - prefix(ax.at, v, k) - prefix(u, ay.at, k) + p00));
    };
    const auto alongX = [&](const Edge& e, int v) { return e.f == 0.0f ? F(e.at, v) : F(e.at, v) * (1.0 - double(e.f)) + F(e.at + 1, v) * double(e.f); };
    const auto at = [&](const Edge& ex, const Edge& ey) {
      return ey.f == 0.0f ? alongX(ex, ey.at) : alongX(ex, ey.at) * (1.0 - double(ey.f)) + alongX(ex, ey.at + 1) * double(ey.f);
    };
    const double sum = at(bx, by) - at(ax, by) - at(bx, ay) + at(ax, ay);
    out[c - begin] = float(sum / (area * t.unit));
  }
}

NodePtr makeShadowSummedAreaNode(ShadowBasisPtr basis, int resolution, int faces) { return std::make_shared<SummedAreaNode>(std::move(basis), resolution, faces); }

}  // namespace gobo
