// SPDX-License-Identifier: Apache-2.0
#include "measure/certificate.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "base/sobol.h"
#include "measure/confidence.h"
#include "measure/halves.h"

namespace gobo {
namespace {

/// [0, n) from a hash; the bias of at most n / 2^64 is far below any test.
uint64_t below(uint64_t n, uint64_t hash) { return uint64_t((__uint128_t(hash) * n) >> 64); }

}  // namespace

std::vector<uint32_t> certificatePixels(int width, int height, double fraction, uint64_t seed) {
  if (width <= 0 || height <= 0) return {};
  const uint64_t w = uint64_t(width), h = uint64_t(height), all = w * h;
  GOBO_CHECK(all <= UINT32_MAX);
  GOBO_CHECK(fraction >= 0);
  const double wanted = std::min(std::round(fraction * double(all)), double(all));
  const uint64_t n = std::max<uint64_t>(std::min<uint64_t>(64, all), uint64_t(wanted));

  // Bands as high as a stratum is wide; along a band column by column, bands in alternating directions.
  const uint64_t bands = std::clamp<uint64_t>(uint64_t(std::lround(double(h) / std::sqrt(double(all) / double(n)))), 1, h);
  const auto pixelAt = [&](uint64_t position) {
    const uint64_t row = position / w;                        // a row of the band that holds the position
    uint64_t band = row * bands / h;
    while (band + 1 < bands && (band + 1) * h / bands <= row) ++band;
    const uint64_t top = band * h / bands, rows = (band + 1) * h / bands - top, inBand = position - top * w;
    const uint64_t column = inBand / rows, x = band % 2 ? w - 1 - column : column;
    return uint32_t((top + inBand % rows) * w + x);
  };

  const uint64_t rotation = below(all, hash64(seed, 0x726f746174696f6eull));
  std::vector<uint32_t> pixels(n);
  for (uint64_t k = 0; k < n; ++k) {
    const uint64_t begin = k * all / n, size = (k + 1) * all / n - begin;
    pixels[k] = pixelAt((rotation + begin + below(size, hash64(hash64(seed, 0x73747261746121ull), k))) % all);
  }
  std::sort(pixels.begin(), pixels.end());
  return pixels;
}

CertificateFigures certify(const std::vector<PixelEvidence>& evidence, uint64_t) {
  CertificateFigures out;
  std::vector<double> squared, leaning, jackknife;
  squared.reserve(evidence.size());
  leaning.reserve(evidence.size());
  jackknife.reserve(evidence.size());
  for (const PixelEvidence& e : evidence) {
    if (!isFinite(e.picture) || !isFinite(e.halfA) || !isFinite(e.halfB)) {
      ++out.nonFinite;
      continue;
    }
    squared.push_back(squaredErrorOfHalves(e.picture, e.halfA, e.halfB));
    const RelativeError r = relativeErrorOfHalves(e.picture, e.halfA, e.halfB);
    leaning.push_back(r.leaning);
    jackknife.push_back(r.jackknife);
  }
  const size_t n = squared.size();
  out.unseenArea = n == 0 ? 1.0 : std::min(1.0, 3.0 / double(n) + double(out.nonFinite) / double(evidence.size()));
  const MeanInterval mse = meanInterval(squared), rel = meanInterval(leaning), other = meanInterval(jackknife);
  const double positive = std::max(mse.mean, 0.0);
  out.rmse = std::sqrt(positive);
  out.rmseLow = std::sqrt(mse.low);
  out.rmseHigh = std::sqrt(mse.high);
  out.rmseStandardError = std::sqrt(positive + mse.standardError) - out.rmse;
  out.relMse = std::max(rel.mean, 0.0);
  const double doubt = 0.5 * std::fabs(rel.mean - other.mean);    // skewed noise biases both to the same side
  out.relMseLow = std::max(0.0, std::min(rel.low, other.low) - doubt);
  out.relMseHigh = std::max(rel.high, other.high) + doubt;
  return out;
}

}  // namespace gobo
