// SPDX-License-Identifier: Apache-2.0
#include "measure/metrics.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <string>

#include "base/check.h"
#include "measure/confidence.h"
#include "measure/halves.h"
#include "measure/perceptual.h"

namespace gobo {
inline namespace measure {
namespace {

Status sameSize(const Image& a, const Image& b) {
  const auto size = [](const Image& i) { return std::to_string(i.width) + "x" + std::to_string(i.height); };
  if (a.width != b.width || a.height != b.height) return invalidArgument("pictures differ in size: " + size(a) + " and " + size(b));
  if (a.pixels() == 0 || a.channels < 1 || b.channels < 1) return invalidArgument("empty picture");
  return {};
}

bool sameBits(const Vec3& a, const Vec3& b) {
  for (int c = 0; c < 3; ++c)
    if (std::bit_cast<uint32_t>(float(a[c])) != std::bit_cast<uint32_t>(float(b[c]))) return false;
  return true;
}

double luminanceD(const Vec3& c) { return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z; }

ErrorFigures pixelErrors(const Image& a, const Image& b, const std::vector<uint8_t>* mask) {
  ErrorFigures out;
  std::vector<double> distances;
  distances.reserve(a.pixels());
  double squared = 0, relative = 0, absolute = 0;
  for (int y = 0; y < a.height; ++y)
    for (int x = 0; x < a.width; ++x) {
      if (mask && !(*mask)[size_t(y) * a.width + x]) continue;
      const Vec3 p = a.rgb(x, y), q = b.rgb(x, y);
      out.differingPixels += !sameBits(p, q);
      if (!isFinite(p) || !isFinite(q)) {
        ++out.nonFinite;
        out.nonFiniteApart += !sameBits(p, q);
        continue;
      }
      double distance = 0;
      for (int c = 0; c < 3; ++c) {
        const double d = double(p[c]) - q[c];
        squared += d * d;
        relative += d * d / (double(q[c]) * q[c] + kRelMseEpsilon);
        distance += std::fabs(d);
        out.maxAbs = std::max(out.maxAbs, std::fabs(d));
      }
      absolute += distance;
      distances.push_back(distance / 3);
      out.meanA += luminanceD(p);
      out.meanB += luminanceD(q);
    }
  if (distances.empty()) return out;
  const double n = double(distances.size());
  out.rmse = std::sqrt(squared / (3 * n));
  out.relMse = relative / (3 * n);
  out.meanAbs = absolute / (3 * n);
  out.meanA /= n;
  out.meanB /= n;
  const size_t rank = size_t(std::ceil(0.99 * n)) - 1;
  std::nth_element(distances.begin(), distances.begin() + ptrdiff_t(rank), distances.end());
  out.p99 = distances[rank];
  return out;
}

}  // namespace

Result<ErrorFigures> compareImages(const Image& a, const Image& b) {
  GOBO_TRY(sameSize(a, b));
  ErrorFigures out = pixelErrors(a, b, nullptr);
  out.ssim = structuralSimilarity(a, b);
  for (double f : flipMap(b, a, flipPixelsPerDegree())) out.flip += f;
  out.flip /= double(a.pixels());
  return out;
}

Result<ErrorFigures> compareImages(const Image& a, const Image& b, const std::vector<uint8_t>& mask) {
  GOBO_TRY(sameSize(a, b));
  if (mask.size() != a.pixels()) return invalidArgument("mask has " + std::to_string(mask.size()) + " entries for " + std::to_string(a.pixels()) + " pixels");
  return pixelErrors(a, b, &mask);
}

std::vector<uint8_t> penumbraMask(const Image& truth, float low, float high, int dilation) {
  const int w = truth.width, h = truth.height;
  std::vector<uint8_t> out(truth.pixels(), 0);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const float v = truth.at(x, y)[0];
      if (!(v > low && v < high)) continue;
      for (int j = std::max(0, y - dilation); j <= std::min(h - 1, y + dilation); ++j)
        for (int i = std::max(0, x - dilation); i <= std::min(w - 1, x + dilation); ++i) out[size_t(j) * w + i] = 1;
    }
  return out;
}

Result<HalvesError> errorAgainstHalves(const Image& picture, const Image& halfA, const Image& halfB) {
  GOBO_TRY(sameSize(picture, halfA));
  GOBO_TRY(sameSize(picture, halfB));
  HalvesError out;
  std::vector<double> squared, relative;
  squared.reserve(picture.pixels());
  relative.reserve(picture.pixels());
  double jackknife = 0;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      const Vec3 p = picture.rgb(x, y), a = halfA.rgb(x, y), b = halfB.rgb(x, y);
      if (!isFinite(p) || !isFinite(a) || !isFinite(b)) {
        ++out.nonFinite;
        continue;
      }
      squared.push_back(squaredErrorOfHalves(p, a, b));
      const RelativeError r = relativeErrorOfHalves(p, a, b);
      relative.push_back(r.leaning);
      jackknife += r.jackknife;
    }
  if (squared.empty()) return out;
  const MeanInterval mse = meanInterval(squared), rel = meanInterval(relative);
  const double positive = std::max(mse.mean, 0.0);
  out.mse = mse.mean;
  out.standardError = mse.standardError;
  out.mseLow = mse.low, out.mseHigh = mse.high;
  out.rmse = std::sqrt(positive);
  out.rmseStandardError = std::sqrt(positive + mse.standardError) - out.rmse;
  out.relMse = rel.mean;
  out.relMseStandardError = std::hypot(rel.standardError, jackknife / double(relative.size()) - rel.mean);
  return out;
}

Image differenceImage(const Image& a, const Image& b, float scale) {
  GOBO_CHECK(sameSize(a, b).ok());
  GOBO_CHECK(scale > 0);
  Image out(a.width, a.height, 3);
  for (int y = 0; y < a.height; ++y)
    for (int x = 0; x < a.width; ++x) {
      const double d = (luminanceD(a.rgb(x, y)) - luminanceD(b.rgb(x, y))) / double(scale);
      if (!std::isfinite(d)) continue;
      const float strength = float(std::min(std::fabs(d), 1.0)), rest = 1 - strength;
      float* to = out.at(x, y);
      to[0] = d > 0 ? 1.0f : rest;
      to[1] = rest;
      to[2] = d > 0 ? rest : 1.0f;
    }
  return out;
}

}  // namespace measure
}  // namespace gobo
