// SPDX-License-Identifier: Apache-2.0
#include "filters/denoise/select/select.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace gobo::denoise {

namespace {

/// Of the noise around that every pixel is taken to have: without it one that a part of the light never reaches, where nothing errs by more than what
/// filters spill from its neighbours, would decide for all of these.
constexpr double kLeastShare = 0.03;

/// Weights of a Gaussian at 0, 1, .., radius, of standard deviation radius / 2.
std::vector<float> halfGaussian(int radius) {
  std::vector<float> w(size_t(radius) + 1);
  for (int i = 0; i <= radius; ++i) w[size_t(i)] = float(std::exp(-2.0 * i * i / double(radius * radius)));
  return w;
}

/// A row of a picture of one channel, blurred: each sum in the order of its window, so that parts have the bits of the whole.
void blurAlongX(const float* in, float* out, int width, const std::vector<float>& w) {
  const int radius = int(w.size()) - 1;
  for (int x = 0; x < width; ++x) {
    float sum = 0;
    for (int u = std::max(x - radius, 0); u <= std::min(x + radius, width - 1); ++u) sum += w[size_t(std::abs(u - x))] * in[u];
    out[x] = sum;
  }
}

class SelectNode final : public Node {
 public:
  SelectNode(int width, int height, int candidates, float shareOfA) : width_(width), height_(height), candidates_(candidates), share_(shareOfA) {}
  std::string type() const override { return "denoise_select"; }
  int version() const override { return 2; }  // 2: pixels without light do not decide for their neighbours
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;
    t.halo = 2 * kSelectRadius + kBlendRadius;  // of noise, of errors, of choices
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_).add(candidates_).add(share_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const Extent all{width_, height_, 1};
    Wiring w(type(), in, size_t(candidates_) + 1);
    w.over(0, all);
    for (const char* name : {"mean", "a", "b", "variance"}) w.reads<float>(0, name, {3});
    TermShape out{"denoised", Domain::Pixel, all, {unsetPlane<float>("rgb", 3), unsetPlane<float>("choice", candidates_ + 1)}};
    for (size_t k = 1; k < w.size(); ++k)
      for (const char* name : {"rgb", "a", "b"}) w.over(k, all).reads<float>(k, name, {3});
    return w.gives(std::move(out));
  }
  size_t workingBytes() const override { return size_t(width_) * size_t(height_) * sizeof(float) * size_t(3 * (candidates_ + 1) + 2); }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, 30.0 * (candidates_ + 1) * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto& out = ctx.result;
    const auto rgb = out->writable<float>("rgb"), choice = out->writable<float>("choice");
    const size_t pixels = size_t(width_) * size_t(height_), planes = size_t(candidates_) + 1;
    const Term& noisy = *ctx.inputs[0];
    const auto a = noisy.floats("a"), b = noisy.floats("b"), mean = noisy.floats("mean"), variance = noisy.floats("variance");
    std::vector<float> error(pixels * planes), chosen(pixels * planes);  // plane by plane
    std::vector<std::span<const float>> as{a}, bs{b}, all{mean};
    for (size_t k = 1; k < planes; ++k) {
      as.push_back(ctx.inputs[k]->floats("a"));
      bs.push_back(ctx.inputs[k]->floats("b"));
      all.push_back(ctx.inputs[k]->floats("rgb"));
    }
    const auto rows = [&](const std::function<void(int y)>& body) {
      return ctx.arena->parallelFor(
          size_t(height_), 4,
          [&](size_t begin, size_t end) {
            for (int y = int(begin); y < int(end); ++y) body(y);
          },
          ctx.stop);
    };
    const std::vector<float> window = halfGaussian(kSelectRadius), blend = halfGaussian(kBlendRadius);
    std::vector<float> noise(pixels), around;
    bool complete = rows([&](int y) {
      for (size_t p = size_t(y) * size_t(width_); p < size_t(y + 1) * size_t(width_); ++p) {
        double light = 0, spread = 0;
        for (size_t c = 3 * p; c < 3 * p + 3; ++c) {
          light += double(mean[c]) * mean[c];
          spread += variance[c];
        }
        noise[p] = float(std::min(spread + 1e-4 * light, 1e36));
      }
    });
    around = noise;
    complete = complete && blurred(around, window, 1, rows);
    double across = -window[0];
    for (const float w : window) across += 2.0 * w;
    const double share = kLeastShare / (across * across);
    complete = complete && rows([&](int y) {
                 for (size_t p = size_t(y) * size_t(width_); p < size_t(y + 1) * size_t(width_); ++p) {
                   const double weight = 1.0 / (noise[p] + share * around[p] + 1e-30);
                   for (size_t k = 0; k < planes; ++k) {
                     double s = 0;
                     for (size_t c = 3 * p; c < 3 * p + 3; ++c) {
                       const double d = double(as[k][c]) - b[c], e = double(bs[k][c]) - a[c], f = double(as[k][c]) - bs[k][c];
                       s += share_ * d * d + (1 - share_) * e * e - share_ * (1 - share_) * f * f;
                     }
                     error[k * pixels + p] = float(std::clamp(s * weight, -1e6, 1e6));
                   }
                 }
               });
    complete = complete && blurred(error, window, planes, rows);
    complete = complete && rows([&](int y) {
                 for (size_t p = size_t(y) * size_t(width_); p < size_t(y + 1) * size_t(width_); ++p) {
                   size_t best = 0;
                   for (size_t k = 1; k < planes; ++k)
                     if (error[k * pixels + p] < error[best * pixels + p]) best = k;
                   for (size_t k = 0; k < planes; ++k) chosen[k * pixels + p] = k == best ? 1.0f : 0.0f;
                 }
               });
    complete = complete && blurred(chosen, blend, planes, rows);
    complete = complete && rows([&](int y) {
                 for (size_t p = size_t(y) * size_t(width_); p < size_t(y + 1) * size_t(width_); ++p) {
                   double total = 0, sum[3] = {};
                   for (size_t k = 0; k < planes; ++k) {
                     const double w = chosen[k * pixels + p];
                     total += w;
                     for (size_t c = 0; c < 3; ++c) sum[c] += w * all[k][3 * p + c];
                   }
                   for (size_t c = 0; c < 3; ++c) rgb[3 * p + c] = float(sum[c] / total);
                   for (size_t k = 0; k < planes; ++k) choice[planes * p + k] = float(chosen[k * pixels + p] / total);
                 }
               });
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  /// Each plane by a separable window, in place.
  template <typename Rows>
  bool blurred(std::vector<float>& planes, const std::vector<float>& w, size_t count, const Rows& rows) const {
    const size_t pixels = size_t(width_) * size_t(height_), width = size_t(width_);
    const int radius = int(w.size()) - 1;
    std::vector<float> across(planes.size());
    if (!rows([&](int y) {
          for (size_t k = 0; k < count; ++k) blurAlongX(&planes[k * pixels + size_t(y) * width], &across[k * pixels + size_t(y) * width], width_, w);
        }))
      return false;
    return rows([&](int y) {
      for (size_t k = 0; k < count; ++k) {
        float* out = &planes[k * pixels + size_t(y) * width];
        std::fill_n(out, width, 0.0f);
        for (int v = std::max(y - radius, 0); v <= std::min(y + radius, height_ - 1); ++v) {
          const float weight = w[size_t(std::abs(v - y))];
          const float* row = &across[k * pixels + size_t(v) * width];
          for (size_t x = 0; x < width; ++x) out[x] += weight * row[x];
        }
      }
    });
  }

  int width_, height_, candidates_;
  float share_;
};

}  // namespace

NodePtr makeSelectNode(int width, int height, int candidates, float shareOfA) { return std::make_shared<SelectNode>(width, height, candidates, shareOfA); }

}  // namespace gobo::denoise
