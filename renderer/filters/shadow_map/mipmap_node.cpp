// SPDX-License-Identifier: Apache-2.0
// Filter: chain of levels of a filtered map. A texel is the mean of what it covers, for sides of any length: with from texels above to,
// each covers from / to of them, whole or in part, so that every level has the mean of the one above it (Guthe & Heckbert 2005).
#include <algorithm>
#include <cmath>

#include "filters/shadow_map/gaussian_kernels.h"
#include "filters/shadow_map/shadow_map.h"
#include "formulas/convolution_shadow_map.glsl.h"

namespace gobo {
inline namespace filters {
namespace {

class MipmapNode : public Node {
 public:
  MipmapNode(ShadowBasisPtr basis, int resolution, int faces, bool bytes) : basis_(std::move(basis)), resolution_(resolution), faces_(faces), bytes_(bytes) {}
  std::string type() const override { return "shadow_mipmap"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(basis_->logarithmic()); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    const Format format = bytes_ ? Format::U8 : Format::F32;
    w.over(0, {resolution_, resolution_, faces_}).reads(0, "B", format, {basis_->channels()});
    return w.gives({"shadow_basis", Domain::LightTexel, mipExtent(resolution_, faces_), {{"B", format, basis_->channels()}}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& map = *ctx.inputs.at(0);
    const int C = map.channels("B"), faces = map.extent().layers;
    const auto& term = ctx.result;
    const bool done = bytes_ ? chain<uint8_t>(ctx, map.plane<uint8_t>("B"), term->writable<uint8_t>("B"), size_t(C), faces)
                             : chain<float>(ctx, map.floats("B"), term->writable<float>("B"), size_t(C), faces);
    if (!done) return Status(Code::Cancelled, "shadow_mipmap stopped");
    return TermPtr(term);
  }

 private:
  struct Cover {
    int first = 0, count = 0;
    float weight[4];
  };
  static std::vector<Cover> covers(int from, int to) {
    std::vector<Cover> list(static_cast<size_t>(to));
    const double ratio = double(from) / to;
    for (int i = 0; i < to; ++i) {
      Cover& c = list[size_t(i)];
      const double lo = i * ratio, hi = std::min((i + 1) * ratio, double(from));
      c.first = int(lo);
      for (int t = c.first; t < from && double(t) < hi - 1e-9 && c.count < 4; ++t)
        c.weight[c.count++] = float((std::min(hi, t + 1.0) - std::max(lo, double(t))) / (hi - lo));
    }
    return list;
  }
  static float value(float x) { return x; }
  static float value(uint8_t x) { return float(x); }

  template <typename T>
  bool chain(const RunContext& ctx, std::span<const T> in, std::span<T> out, size_t C, int faces) const {
    const size_t square = size_t(resolution_) * size_t(resolution_), packed = mipTexels(resolution_);
    for (int face = 0; face < faces; ++face) {
      const T* from = &in[size_t(face) * square * C];
      T* base = &out[size_t(face) * packed * C];
      if (!ctx.arena->parallelFor(
              square * C, 1 << 18, [&](size_t a, size_t b) { std::copy(from + a, from + b, base + a); }, ctx.stop))
        return false;
      for (int l = 1; l < mipLevels(resolution_); ++l) {
        const MipLevel above = mipLevel(resolution_, l - 1), here = mipLevel(resolution_, l);
        const std::vector<Cover> cover = covers(above.side, here.side);
        const T* a = base + above.offset * C;
        T* h = base + here.offset * C;
        const bool done = ctx.arena->parallelFor(
            size_t(here.side), 16,
            [&](size_t begin, size_t end) {
              std::vector<float> sum(C), top(C);
              for (size_t y = begin; y < end; ++y)
                for (size_t x = 0; x < size_t(here.side); ++x)
                  mean(a, size_t(above.side), cover[x], cover[y], C, sum.data(), h + (y * size_t(here.side) + x) * C);
            },
            ctx.stop);
        if (!done) return false;
      }
    }
    return true;
  }
  template <typename T>
  void mean(const T* a, size_t side, const Cover& cx, const Cover& cy, size_t C, float* sum, T* out) const {
    const float c = basis_->logarithmic();
    const auto at = [&](int i, int j) { return a + (size_t(cy.first + j) * side + size_t(cx.first + i)) * C; };
    if (c > 0.0f) {  // one channel; ln of the mean of e^{c z}, about the largest
      float top = -1.0f, total = 0.0f;
      for (int j = 0; j < cy.count; ++j)
        for (int i = 0; i < cx.count; ++i) top = std::max(top, value(*at(i, j)));
      for (int j = 0; j < cy.count; ++j)
        for (int i = 0; i < cx.count; ++i) total += cx.weight[i] * cy.weight[j] * formulas::fastExp(c * (value(*at(i, j)) - top));
      *out = T(top + formulas::fastLog(total) / c);
      return;
    }
    std::fill_n(sum, C, 0.0f);
    for (int j = 0; j < cy.count; ++j)
      for (int i = 0; i < cx.count; ++i) {
        const T* t = at(i, j);
        const float w = cx.weight[i] * cy.weight[j];
        for (size_t k = 0; k < C; ++k) sum[k] += w * value(t[k]);
      }
    for (size_t k = 0; k < C; ++k) {
      if constexpr (sizeof(T) == 1) out[k] = T(formulas::limit(std::floor(sum[k] + 0.5f), 0.0f, 255.0f));
      else out[k] = sum[k];
    }
  }
  ShadowBasisPtr basis_;
  int resolution_, faces_;
  bool bytes_;
};

}  // namespace

NodePtr makeShadowMipmapNode(ShadowBasisPtr basis, int resolution, int faces, bool bytes) {
  return std::make_shared<MipmapNode>(std::move(basis), resolution, faces, bytes);
}

}  // namespace filters
}  // namespace gobo
