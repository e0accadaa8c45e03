// SPDX-License-Identifier: Apache-2.0
#include "shadow/oracle.h"

#include <algorithm>
#include <cmath>

#include "base/sobol.h"
#include "filters/parameter.h"
#include "filters/shadow_map/depth_compare.h"

namespace gobo::shadowbench {
namespace {

/// Calls visit(element, block, i) for every receiver that the map covers; V of the others stays 1.
template <typename Visit>
void forReceivers(Runner& r, const PlannedShadowMap& p, bool slopes, const Visit& visit) {
  const Receivers receivers(*r.gbuffer(), p.frames, p.map.resolution, p.view, {.slopes = slopes});
  r.arena().parallelFor(receivers.size(), 1024, [&](size_t begin, size_t end) {
    ReceiverBlock b;
    for (size_t first = begin; first < end; first += ReceiverBlock::kSize) {
      const int n = int(std::min<size_t>(ReceiverBlock::kSize, end - first));
      receivers.fill(first, n, b);
      for (int i = 0; i < n; ++i)
        if (b.covered[i]) visit(first + size_t(i), b, i);
    }
  });
}

struct Series {  // f_M of the thesis with the period and the offset that ship
  int order;
  double period, offset, scale;
  std::vector<double> c, w;
  Series(int m, v1::ConvolutionShadow::Correction correction) : order(m), period(1.0 + 1.0 / m) {
    const ConvolutionCorrection k = convolutionCorrection(correction, m, 0.0);
    offset = k.offset * period;
    scale = k.scale;
    for (int i = 1; i <= m; ++i) {
      c.push_back(M_PI * (2 * i - 1) / period);
      w.push_back(2.0 / (M_PI * (2 * i - 1)));
    }
  }
  double lit(double z, double d) const {
    double s = 0;
    for (int k = 0; k < order; ++k) s += w[size_t(k)] * std::sin(c[size_t(k)] * (z - d + offset));
    return 0.5 + scale * s;
  }
};

}  // namespace

Result<std::vector<float>> exactBasis(Runner& r, const v1::ShadowTechnique& t) {
  PlannedShadowMap p;
  const int blur = int(numberParameter(t.map(), "blur"));
  GOBO_ASSIGN(const TermPtr term, r.depthBounds(t, blur + 1, p));
  const DepthBounds bounds(*term, p.map.resolution);
  const std::vector<float> weights = shadowGaussian(blur);
  ShadowBasisPtr basis;
  std::unique_ptr<Series> series;
  double c = 0;
  switch (t.technique_case()) {
    case v1::ShadowTechnique::kConvolution:
      basis = makeConvolutionBasis(t.convolution());
      series = std::make_unique<Series>(int(numberParameter(t.convolution(), "order")), v1::ConvolutionShadow::OFFSET);
      break;
    case v1::ShadowTechnique::kVariance: basis = makeVarianceBasis(t.variance()); break;
    case v1::ShadowTechnique::kExponential:
      c = numberParameter(t.exponential(), "c");
      basis = makeExponentialBasis(float(c), c > 80);
      break;
    default: return invalidArgument("no float64 form of this technique");
  }
  const double minVariance = c == 0 && !series ? numberParameter(t.variance(), "min_variance") : 0,
               cut = c == 0 && !series ? numberParameter(t.variance(), "bleeding_reduction") : 0;
  const int side = p.map.resolution;
  std::vector<float> V(r.pixels(), 1.0f);
  forReceivers(r, p, basis->comparesDepth() && p.map.slopeBias > 0, [&](size_t e, const ReceiverBlock& b, int i) {
    AxisKernel kx, ky;
    interpolatedKernel(b.x[i], weights.data(), blur, kx);
    interpolatedKernel(b.y[i], weights.data(), blur, ky);
    double d = double(b.d[i]) - p.map.bias;
    if (basis->comparesDepth()) d -= double(p.map.slopeBias) * (blur + 0.5) * (std::fabs(b.slopeX[i]) + std::fabs(b.slopeY[i]));
    d = std::clamp(d, 0.0, 1.0);
    const float* z = bounds.depth(b.face[i]);
    double s = 0, first = 0, second = 0, total = 0;
    for (int y = 0; y < ky.count; ++y)
      for (int x = 0; x < kx.count; ++x) {
        const double w = double(kx.weight[x]) * ky.weight[y];
        if (w <= 0) continue;
        const double depth = z[size_t(std::clamp(ky.first + y, 0, side - 1)) * size_t(side) + size_t(std::clamp(kx.first + x, 0, side - 1))];
        total += w;
        if (series) s += w * series->lit(depth, d);
        else if (c > 0) s += w * std::exp(c * (depth - d));
        else {
          first += w * depth;
          second += w * depth * depth;
        }
      }
    if (!series && c == 0) {
      first /= total;
      second /= total;
      const double v = std::max(second - first * first, minVariance), gap = d - first;
      s = gap <= 0 ? 1.0 : v / (v + gap * gap);
      s = (s - cut) / (1 - cut);
    } else {
      s /= total;
    }
    V[e] = float(std::clamp(s, 0.0, 1.0));
  });
  return V;
}

Result<std::vector<float>> umbraDepth(Runner& r, const v1::ShadowTechnique& t) {
  PlannedShadowMap p;
  const int blur = int(numberParameter(t.map(), "blur"));
  GOBO_ASSIGN(const TermPtr term, r.depthBounds(t, blur + 1, p));
  const DepthBounds bounds(*term, p.map.resolution);
  const int side = p.map.resolution;
  std::vector<float> gap(r.pixels(), -1.0f);
  forReceivers(r, p, true, [&](size_t e, const ReceiverBlock& b, int i) {
    const float* z = bounds.depth(b.face[i]);
    float farthest = 0;
    for (int y = int(b.y[i]) - blur; y <= int(b.y[i]) + blur + 1; ++y)
      for (int x = int(b.x[i]) - blur; x <= int(b.x[i]) + blur + 1; ++x)
        farthest = std::max(farthest, z[size_t(std::clamp(y, 0, side - 1)) * size_t(side) + size_t(std::clamp(x, 0, side - 1))]);
    gap[e] = b.d[i] - (std::fabs(b.slopeX[i]) + std::fabs(b.slopeY[i])) * float(blur + 1) - farthest;
  });
  return gap;
}

namespace {

/// Sums of `channels` doubles a texel; box means at fractional edges by bilinear interpolation of the sums.
class Sums64 {
 public:
  Sums64(int side, int channels) : side_(side), channels_(channels), sums_(size_t(side + 1) * size_t(side + 1) * size_t(channels)) {}
  double* at(int x, int y) { return &sums_[(size_t(y) * size_t(side_ + 1) + size_t(x)) * size_t(channels_)]; }
  const double* at(int x, int y) const { return &sums_[(size_t(y) * size_t(side_ + 1) + size_t(x)) * size_t(channels_)]; }
  void integrate() {
    for (int y = 1; y <= side_; ++y)
      for (int x = 1; x <= side_; ++x)
        for (int k = 0; k < channels_; ++k) at(x, y)[k] += at(x - 1, y)[k] + at(x, y - 1)[k] - at(x - 1, y - 1)[k];
  }
  void mean(double x0, double x1, double y0, double y1, double* out) const {
    std::fill_n(out, channels_, 0.0);
    const double area = (x1 - x0) * (y1 - y0);
    add(x1, y1, 1 / area, out);
    add(x0, y1, -1 / area, out);
    add(x1, y0, -1 / area, out);
    add(x0, y0, 1 / area, out);
  }

 private:
  void add(double x, double y, double weight, double* out) const {
    const int ix = std::clamp(int(x), 0, side_ - 1), iy = std::clamp(int(y), 0, side_ - 1);
    const double fx = x - ix, fy = y - iy;
    const double *a = at(ix, iy), *b = at(ix + 1, iy), *c = at(ix, iy + 1), *d = at(ix + 1, iy + 1);
    for (int k = 0; k < channels_; ++k) out[k] += weight * ((1 - fy) * ((1 - fx) * a[k] + fx * b[k]) + fy * ((1 - fx) * c[k] + fx * d[k]));
  }
  int side_, channels_;
  std::vector<double> sums_;
};

}  // namespace

Result<std::vector<float>> exactConvolutionSoft(Runner& r, const v1::ShadowTechnique& t, int order) {
  PlannedShadowMap p;
  GOBO_ASSIGN(const TermPtr term, r.depthBounds(t, 1, p));
  const LightShape& light = r.scene()->lights[size_t(r.light())].shape;
  if (p.frames.count != 1 || (light.kind != LightKind::Rect && light.kind != LightKind::Disk))
    return invalidArgument("exact convolution soft shadows: Rect and Disk lights only");
  const DepthBounds bounds(*term, p.map.resolution);
  const int side = p.map.resolution, channels = 4 * order + 1;
  const Series s(order, v1::ConvolutionShadow::SHIFTED_SCALING);
  Sums64 sums(side, channels);
  const float* z = bounds.depth(0);
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const double depth = z[size_t(y) * size_t(side) + size_t(x)];
      double* out = sums.at(x + 1, y + 1);
      for (int k = 0; k < order; ++k) {
        out[4 * k] = std::sin(s.c[size_t(k)] * depth);
        out[4 * k + 1] = std::cos(s.c[size_t(k)] * depth);
        out[4 * k + 2] = depth * out[4 * k];
        out[4 * k + 3] = depth * out[4 * k + 1];
      }
      out[4 * order] = depth;
    }
  sums.integrate();
  const LightFrame& f = p.frames.face[0];
  const double range = double(f.far) - f.near, texels = side / (double(f.hi.x) - f.lo.x);
  const bool rect = light.kind == LightKind::Rect;
  const double sizeX = rect ? 2.0 * glm::length(light.u) : light.radius * std::sqrt(M_PI), sizeY = rect ? 2.0 * glm::length(light.v) : sizeX;
  std::vector<float> V(r.pixels(), 1.0f);
  forReceivers(r, p, true, [&](size_t e, const ReceiverBlock& b, int i) {
    const double x = b.x[i] + 0.5, y = b.y[i] + 0.5, metric = f.near + b.d[i] * range;
    double x0, x1, y0, y1;
    const auto box = [&](double plane, double& wx, double& wy) {  // the cone from the receiver to the light, cut at a plane
      const double gap = std::max(metric - plane, 0.0) / std::max(metric * plane, 1e-12) * texels;
      wx = std::clamp(sizeX * gap, 1.0, double(side));
      wy = std::clamp(sizeY * gap, 1.0, double(side));
      x0 = std::clamp(x - wx / 2, 0.0, double(side) - 1e-3);
      x1 = std::clamp(x + wx / 2, x0 + 1e-3, double(side));
      y0 = std::clamp(y - wy / 2, 0.0, double(side) - 1e-3);
      y1 = std::clamp(y + wy / 2, y0 + 1e-3, double(side));
    };
    double plane = std::max(double(f.near), 1e-3 * range), wx, wy;
    float lo = 0, hi = 1;
    for (int k = 0; k < 4; ++k) {
      box(plane, wx, wy);
      bounds.range(0, int(x0), int(y0), std::min(int(x1), side - 1), std::min(int(y1), side - 1), lo, hi);
      plane = std::max(f.near + lo * range, 1e-3 * range);
    }
    const double d0 = double(b.d[i]) - p.map.bias, own = 0.5 * p.map.slopeBias * (std::fabs(b.slopeX[i]) * wx + std::fabs(b.slopeY[i]) * wy);
    if (lo >= d0) return;  // nothing before the receiver
    double d = d0 - std::min(own, 0.5 * (d0 - lo));
    std::vector<double> m(static_cast<size_t>(channels));
    const auto blocked = [&](double& share, double& depth) {
      sums.mean(x0, x1, y0, y1, m.data());
      share = 0.5;
      depth = 0.5 * m[size_t(4 * order)];
      for (int k = 0; k < order; ++k) {
        const double a = s.c[size_t(k)] * (d - s.offset), w = s.scale * s.w[size_t(k)], sine = std::sin(a), cosine = std::cos(a);
        share -= w * (cosine * m[size_t(4 * k)] - sine * m[size_t(4 * k + 1)]);
        depth -= w * (cosine * m[size_t(4 * k + 2)] - sine * m[size_t(4 * k + 3)]);
      }
    };
    double share, depth;
    blocked(share, depth);
    if (share < 0.005) return;
    const double average = std::clamp(depth / share, double(lo), d0);
    box(f.near + average * range, wx, wy);
    d = d0 - std::min(0.5 * p.map.slopeBias * (std::fabs(b.slopeX[i]) * wx + std::fabs(b.slopeY[i]) * wy), 0.5 * (d0 - average));
    blocked(share, depth);
    V[e] = float(std::clamp(1.0 - share, 0.0, 1.0));
  });
  return V;
}

Result<std::vector<float>> sampledKernel(Runner& r, const v1::ShadowTechnique& t, int taps, double* ms) {
  PlannedShadowMap p;
  const int blur = int(numberParameter(t.map(), "blur"));
  GOBO_ASSIGN(const TermPtr term, r.depthBounds(t, blur + 1, p));
  const DepthBounds bounds(*term, p.map.resolution);
  const std::vector<float> weights = shadowGaussian(blur);
  const int side = p.map.resolution, kernel = 2 * blur + 1;
  std::vector<float> cumulated(weights.begin(), weights.end());
  for (int k = 1; k < kernel; ++k) cumulated[size_t(k)] += cumulated[size_t(k - 1)];
  // Inverse of the kernel's piecewise constant density: Gaussian weights convolved with a texel's box.
  std::vector<float> table(257);
  for (int j = 0; j <= 256; ++j) {
    const float u = std::min(float(j) / 256.0f, 0.999999f);
    int k = 0;
    while (k + 1 < kernel && cumulated[size_t(k)] < u) ++k;
    const float before = k ? cumulated[size_t(k - 1)] : 0.0f;
    table[size_t(j)] = float(k - blur) - 0.5f + (u - before) / weights[size_t(k)];
  }
  std::vector<float> u(static_cast<size_t>(taps)), v(static_cast<size_t>(taps));
  for (int k = 0; k < taps; ++k) {  // Fibonacci-like lattice
    u[size_t(k)] = (float(k) + 0.5f) / float(taps);
    v[size_t(k)] = float(std::fmod(0.6180339887498949 * (k + 0.5), 1.0));
  }
  std::vector<float> V(r.pixels(), 1.0f);
  const double begin = r.now();
  forReceivers(r, p, p.map.slopeBias > 0, [&](size_t e, const ReceiverBlock& b, int i) {
    const ReceiverPlane plane = receiverPlane(b, i, p.map.bias, p.map.slopeBias);
    const float* z = bounds.depth(b.face[i]);
    const float su = toUnit(hash32(e, 1)), sv = toUnit(hash32(e, 2));
    int lit = 0;
    for (int k = 0; k < taps; ++k) {
      float a = u[size_t(k)] + su, c = v[size_t(k)] + sv;
      a -= a >= 1.0f ? 1.0f : 0.0f;
      c -= c >= 1.0f ? 1.0f : 0.0f;
      const int x = std::clamp(int(std::floor(plane.x + table[size_t(a * 256.0f)] + 0.5f)), 0, side - 1),
                y = std::clamp(int(std::floor(plane.y + table[size_t(c * 256.0f)] + 0.5f)), 0, side - 1);
      lit += plane.at(x, y) <= z[size_t(y) * size_t(side) + size_t(x)];
    }
    V[e] = float(lit) / float(taps);
  });
  if (ms) *ms = r.now() - begin;
  return V;
}

}  // namespace gobo::shadowbench
