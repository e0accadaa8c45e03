// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "filters/soft_shadow/moment_sums.h"
#include "formulas/variance_shadow_map.glsl.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr double kUnit = 1073741824.0;  // 2^30

class MomentSumsNode : public Node {
 public:
  MomentSumsNode(int resolution, int faces) : resolution_(resolution), faces_(faces) {}
  std::string type() const override { return "shadow_moment_sums"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher&) const override {}
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, {resolution_, resolution_, faces_}).reads<float>(0, "z");
    return w.gives({type(), Domain::LightTexel, MomentSums::extent(resolution_, faces_), {plane<double>("sums", 2)}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& depth = *ctx.inputs.at(0);
    const std::span<const float> z = depth.floats("z");
    const size_t side = size_t(resolution_), row = 2 * (side + 1), face = row * (side + 1);
    const int faces = depth.extent().layers;
    const auto& term = ctx.result;
    const std::span<double> sums = term->writable<double>("sums");
    const auto stopped = [] { return Status(Code::Cancelled, "shadow_moment_sums stopped"); };
    if (!ctx.arena->parallelFor(
            side * size_t(faces), 16,
            [&](size_t begin, size_t end) {
              for (size_t r = begin; r < end; ++r) {
                double* to = &sums[(r / side) * face + (r % side + 1) * row];
                const float* from = &z[r * side];
                double m1 = 0, m2 = 0;
                for (size_t x = 0; x < side; ++x) {
                  const double m = std::rint(double(formulas::vsmFirst(from[x])) * kUnit) / kUnit;
                  m1 += m;
                  m2 += std::rint(m * m * kUnit) / kUnit;
                  to[2 * (x + 1)] = m1;
                  to[2 * (x + 1) + 1] = m2;
                }
              }
            },
            ctx.stop))
      return stopped();
    constexpr size_t kColumns = 256;
    const size_t strips = (row + kColumns - 1) / kColumns;
    if (!ctx.arena->parallelFor(
            strips * size_t(faces), 1,
            [&](size_t begin, size_t end) {
              for (size_t s = begin; s < end; ++s)
                for (size_t y = 2; y <= side; ++y) {
                  double* here = &sums[(s / strips) * face + y * row + (s % strips) * kColumns];
                  const double* above = here - row;
                  const size_t n = std::min(kColumns, row - (s % strips) * kColumns);
                  for (size_t i = 0; i < n; ++i) here[i] += above[i];
                }
            },
            ctx.stop))
      return stopped();
    return TermPtr(term);
  }

 private:
  int resolution_, faces_;
};

}  // namespace

MomentSums::MomentSums(const Term& term, int resolution)
    : sums_(term.plane<double>("sums").data()), row_(2 * (size_t(resolution) + 1)), face_(row_ * (size_t(resolution) + 1)) {
  GOBO_CHECK_EQ(term.extent().width, resolution + 1);
}

void MomentSums::box(int face, const SoftBox& b, float& first, float& second) const {
  // An edge between two columns of the table is the mix of both: exact for texels of constant value.
  const size_t last = row_ / 2 - 2;
  const size_t xa = std::min(size_t(b.x0), last), xb = std::min(size_t(b.x1), last), ya = std::min(size_t(b.y0), last), yb = std::min(size_t(b.y1), last);
  const double fxa = double(b.x0) - double(xa), fxb = double(b.x1) - double(xb), fya = double(b.y0) - double(ya), fyb = double(b.y1) - double(yb);
  const double* base = sums_ + size_t(face) * face_;
  const auto line = [&](size_t y, double out[2]) {  // over one line of the table: between both ends
    const double* r = base + y * row_;
    const double *a = r + 2 * xa, *c = r + 2 * xb;
    for (int k = 0; k < 2; ++k) out[k] = (c[k] + fxb * (c[k + 2] - c[k])) - (a[k] + fxa * (a[k + 2] - a[k]));
  };
  double a0[2], a1[2], b0[2], b1[2];
  line(ya, a0);
  line(ya + 1, a1);
  line(yb, b0);
  line(yb + 1, b1);
  const double inverse = 1.0 / ((double(b.x1) - double(b.x0)) * (double(b.y1) - double(b.y0)));
  double m[2];
  for (int k = 0; k < 2; ++k) m[k] = ((b0[k] + fyb * (b1[k] - b0[k])) - (a0[k] + fya * (a1[k] - a0[k]))) * inverse;
  first = float(m[0]);
  second = float(m[1]);
}

NodePtr makeMomentSumsNode(int resolution, int faces) { return std::make_shared<MomentSumsNode>(resolution, faces); }

}  // namespace filters
}  // namespace gobo
