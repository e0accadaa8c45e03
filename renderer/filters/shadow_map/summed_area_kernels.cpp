// SPDX-License-Identifier: Apache-2.0
#include "filters/shadow_map/summed_area.h"

#include <algorithm>
#include <cmath>

#include "formulas/math.glsl.h"

namespace gobo {
inline namespace filters {

namespace {
constexpr int kLift = 8;        // texels between lifted sums
constexpr int kLargest = 8192;  // side up to which 4 (side + side) unit < 2^31
constexpr double kUnit = 32767;
constexpr int kLiftShift = 16;

int liftSide(int resolution) { return (resolution + kLift - 1) / kLift; }
int32_t quantise(float v) { return int32_t(std::lrint(double(formulas::limit(formulas::finiteOr(v, 0.0f), -1.0f, 1.0f)) * kUnit)); }

class SummedAreaNode : public Node {
 public:
  SummedAreaNode(ShadowBasisPtr basis, int resolution, int faces) : basis_(std::move(basis)), resolution_(resolution), faces_(faces) {
    GOBO_CHECK(basis_->bounded() && resolution >= 1 && resolution <= kLargest);
  }
  std::string type() const override { return "shadow_summed_area"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher&) const override {}
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, {resolution_, resolution_, faces_}).reads<float>(0, "B", {basis_->channels()});
    return w.gives({type(), Domain::LightTexel, SummedArea::extent(resolution_, faces_), {plane<uint32_t>("sums", basis_->channels())}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& map = *ctx.inputs.at(0);
    const std::span<const float> B = map.floats("B");
    const size_t C = size_t(map.channels("B")), side = size_t(resolution_), lifted = size_t(liftSide(resolution_));
    const size_t texelSums = side * side * C, faceSums = texelSums + lifted * lifted * C;
    const int faces = map.extent().layers;
    GOBO_CHECK_EQ(B.size(), texelSums * size_t(faces));
    const auto& term = ctx.result;
    const std::span<uint32_t> sums = term->writable<uint32_t>("sums");
    std::vector<int64_t> blocks(lifted * lifted * C);
    for (int face = 0; face < faces; ++face) {
      uint32_t* to = &sums[size_t(face) * faceSums];
      if (!rows(ctx, &B[size_t(face) * texelSums], to, blocks.data(), side, C) || !columns(ctx, to, side, C) ||
          !lift(ctx, blocks.data(), to + texelSums, lifted, C))
        return Status(Code::Cancelled, "shadow_summed_area stopped");
    }
    return TermPtr(term);
  }

 private:
  // Sums along rows, modulo 2^32; and sums along rows of blocks of 8 x 8 texels, whole.
  static bool rows(const RunContext& ctx, const float* B, uint32_t* sums, int64_t* blocks, size_t side, size_t C) {
    const size_t lifted = size_t(liftSide(int(side)));
    return ctx.arena->parallelFor(
        lifted, 1,
        [&](size_t begin, size_t end) {
          for (size_t band = begin; band < end; ++band) {
            int64_t* row = blocks + band * lifted * C;
            std::fill_n(row, lifted * C, int64_t(0));
            for (size_t y = band * kLift; y < std::min((band + 1) * kLift, side); ++y) {
              const float* b = B + y * side * C;
              uint32_t* to = sums + y * side * C;
              for (size_t x = 0; x < side; ++x) {
                int64_t* block = row + x / kLift * C;
                for (size_t k = 0; k < C; ++k) {
                  const int32_t q = quantise(b[x * C + k]);
                  block[k] += q;
                  to[x * C + k] = uint32_t(q) + (x ? to[(x - 1) * C + k] : 0u);
                }
              }
            }
            for (size_t i = C; i < lifted * C; ++i) row[i] += row[i - C];
          }
        },
        ctx.stop);
  }
  static bool columns(const RunContext& ctx, uint32_t* sums, size_t side, size_t C) {
    constexpr size_t kColumns = 512;  // a strip of values that stays in the cache from row to row
    const size_t row = side * C, strips = (row + kColumns - 1) / kColumns;
    return ctx.arena->parallelFor(
        strips, 1,
        [&](size_t begin, size_t end) {
          for (size_t s = begin; s < end; ++s)
            for (size_t y = 1; y < side; ++y) {
              uint32_t* here = sums + y * row + s * kColumns;
              const uint32_t* above = here - row;
              const size_t n = std::min(kColumns, row - s * kColumns);
              for (size_t i = 0; i < n; ++i) here[i] += above[i];
            }
        },
        ctx.stop);
  }
  static bool lift(const RunContext& ctx, const int64_t* blocks, uint32_t* out, size_t lifted, size_t C) {
    return ctx.arena->parallelFor(
        lifted, 64,
        [&](size_t begin, size_t end) {
          std::vector<int64_t> sum((end - begin) * C);
          for (size_t y = 0; y < lifted; ++y)
            for (size_t i = begin * C; i < end * C; ++i) {
              int64_t& s = sum[i - begin * C];
              s += blocks[y * lifted * C + i];
              out[y * lifted * C + i] = uint32_t(int32_t((s + (int64_t(1) << (kLiftShift - 1))) >> kLiftShift));
            }
        },
        ctx.stop);
  }
  ShadowBasisPtr basis_;
  int resolution_, faces_;
};

}  // namespace

Extent SummedArea::extent(int resolution, int faces) { return {resolution * resolution + liftSide(resolution) * liftSide(resolution), 1, faces}; }

SummedArea::SummedArea(const Term& term, int resolution) : channels_(term.channels("sums")), resolution_(resolution) {
  const std::span<const uint32_t> sums = term.plane<uint32_t>("sums");
  const size_t side = size_t(resolution), lifted = size_t(liftSide(resolution)), C = size_t(channels_);
  face_ = (side * side + lifted * lifted) * C;
  GOBO_CHECK_EQ(sums.size(), face_ * size_t(term.extent().layers));
  sums_ = sums.data();
  lift_ = sums.data() + side * side * C;
}

namespace {
// An edge at a fractional position is the mix of the two whole ones around it: exact for texels of constant value. Four whole edges a
// side of the box, with their weights in F(hi) - F(lo).
struct Edges {
  int at[4];
  double weight[4];
};
Edges edges(float lo, float hi, int side) {
  Edges e;
  const int a = std::min(int(lo), side - 1), b = std::min(int(hi), side - 1);
  const double f = double(lo) - a, g = double(hi) - b;
  e = {{a, a + 1, b, b + 1}, {-(1.0 - f), -f, 1.0 - g, g}};
  return e;
}
}  // namespace

void SummedArea::box(int face, float x, float y, float width, float height, int begin, int end, float* out) const {
  const float last = float(resolution_);
  const auto span = [last](float centre, float size, float& lo, float& hi) {  // texel i is [i, i + 1]
    const float c = formulas::limit(centre + 0.5f, 0.5f, last - 0.5f), half = 0.5f * std::max(size, 1.0f);
    lo = std::max(c - half, 0.0f);
    hi = std::min(c + half, last);
  };
  float x0, x1, y0, y1;
  span(x, width, x0, x1);
  span(y, height, y0, y1);
  const Edges ex = edges(x0, x1, resolution_), ey = edges(y0, y1, resolution_);
  const size_t C = size_t(channels_), side = size_t(resolution_), lifted = size_t(liftSide(resolution_));
  const uint32_t* sums = sums_ + size_t(face) * face_;
  const uint32_t* lift = lift_ + size_t(face) * face_;
  constexpr int kMost = 4 * 32 + 1;  // channels of the widest basis (convolution soft shadows of order 32)
  GOBO_CHECK(end - begin <= kMost);
  double total[kMost];
  for (int c = begin; c < end; ++c) total[c - begin] = 0.0;
  for (int j = 0; j < 4; ++j)
    for (int i = 0; i < 4; ++i) {
      const int u = ex.at[i], v = ey.at[j];
      const double w = ex.weight[i] * ey.weight[j];
      if (u == 0 || v == 0 || w == 0.0) continue;
      // Sum over [0, u) x [0, v): the one modulo 2^32 that lies nearest to its lifted neighbour.
      const uint32_t* near = sums + (size_t(v - 1) * side + size_t(u - 1)) * C;
      const int li = (u + kLift / 2) / kLift, lj = (v + kLift / 2) / kLift;
      const uint32_t* far = li && lj ? lift + (size_t(std::min(lj, int(lifted)) - 1) * lifted + size_t(std::min(li, int(lifted)) - 1)) * C : nullptr;
      for (int c = begin; c < end; ++c) {
        const uint32_t steps = far ? far[c] : 0u;
        const int32_t rest = int32_t(near[c] - (steps << kLiftShift));
        total[c - begin] += w * (double(int32_t(steps)) * double(1 << kLiftShift) + double(rest));
      }
    }
  const double inverse = 1.0 / ((double(x1) - double(x0)) * (double(y1) - double(y0)) * kUnit);
  for (int c = begin; c < end; ++c) out[c - begin] = float(total[c - begin] * inverse);
}

NodePtr makeShadowSummedAreaNode(ShadowBasisPtr basis, int resolution, int faces) {
  return std::make_shared<SummedAreaNode>(std::move(basis), resolution, faces);
}

}  // namespace filters
}  // namespace gobo
