// SPDX-License-Identifier: Apache-2.0
// Do K independent pictures of ours and one low-noise picture of a peer have the same expectation? Pure functions of pixels.
//
// Noise. Ours: the sample variance over the K pictures, per pixel and channel. Samples of neighbouring pixels are independent, so
// a pixel's variance is the larger of its own and the mean over its 3x3 neighbourhood (9 (K - 1) degrees of freedom): its own alone
// has heavy tails at small K. The peer's: ours times the ratio of the sample counts, which the file names tell; it is small beside ours.
// Tests, two-sided at 1 % family-wise by Sidak's correction (as Mitsuba's renders are tested): every pixel and channel, and
// every 8 x 8 tile and channel, where noise is 8 times smaller, so that differences of a few per cent show. On top of the noise a
// relative tolerance stands for what is no noise: float32 geometry and 32-bit against 24-bit colours in the file.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "base/image.h"
#include "measure/confidence.h"

namespace gobo::testing {

struct Agreement {
  std::array<double, 3> ratio{};         ///< mean of ours / mean of the peer's
  std::array<double, 3> ratioError{};    ///< one standard error of it
  size_t pixels = 0, tiles = 0;          ///< compared (not masked out)
  size_t badPixels = 0, badTiles = 0;    ///< with a channel beyond the corrected limit
  double worstPixel = 0, worstTile = 0;  ///< largest |z|
  double pixelLimit = 0, tileLimit = 0;
  double zz = 0;             ///< mean of z^2 over pixels and channels that have noise: 1 where all difference is noise
  double tileZz = 0;         ///< the same over tiles
  double unexplained = 0;    ///< RMS of what noise does not explain / RMS of the peer's picture
  std::vector<uint8_t> bad;  ///< per pixel: 1 beyond the limit
};

/// z with P(|N(0,1)| > z) = `probability`, by bisection of erfc; 0 < probability < 1.
inline double twoSidedNormal(double probability) {
  double low = 0, high = 40;
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (std::erfc(middle / std::sqrt(2.0)) > probability ? low : high) = middle;
  }
  return high;
}

inline double sidakLimit(double familyWise, size_t tests, double degrees) {
  return studentQuantile(twoSidedNormal(-std::expm1(std::log1p(-familyWise) / double(tests))), degrees);
}

/// `ours`: K >= 2 pictures of equal size and sample count with independent noise; `sampleRatio` = samples in all of ours together /
/// samples in the peer's; `tolerance` relative to the peer's value (or to 1 % of the picture's mean where that is larger);
/// `skip`: pixels left out (1), or empty.
inline Agreement compareWithPeer(const std::vector<Image>& ours, const Image& peer, double sampleRatio, double tolerance,
                                 const std::vector<uint8_t>& skip = {}) {
  Agreement out;
  const int w = peer.width, h = peer.height, K = int(ours.size());
  const size_t n = size_t(w) * h;
  out.bad.assign(n, 0);
  std::vector<double> mean(3 * n), variance(3 * n);  // variance of the mean of the K
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      for (int c = 0; c < 3; ++c) {
        double s = 0, q = 0;
        for (const Image& o : ours) s += o.at(x, y)[c];
        s /= K;
        for (const Image& o : ours) q += (o.at(x, y)[c] - s) * (o.at(x, y)[c] - s);
        const size_t k = 3 * (size_t(y) * w + x) + c;
        mean[k] = s;
        variance[k] = q / (K - 1) / K;
      }
  const auto compared = [&](int x, int y) { return skip.empty() || !skip[size_t(y) * w + x]; };
  std::array<double, 3> sumOurs{}, sumPeer{}, sumVariance{};
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x)
      if (compared(x, y)) {
        ++out.pixels;
        for (int c = 0; c < 3; ++c) {
          const size_t k = 3 * (size_t(y) * w + x) + c;
          sumOurs[c] += mean[k];
          sumPeer[c] += peer.at(x, y)[c];
          sumVariance[c] += variance[k] * (1 + sampleRatio);
        }
      }
  double average = 0;
  for (int c = 0; c < 3; ++c) {
    out.ratio[c] = sumOurs[c] / sumPeer[c];
    out.ratioError[c] = std::sqrt(sumVariance[c]) / sumPeer[c];
    average += sumPeer[c] / double(out.pixels) / 3;
  }
  constexpr int kTile = 8;
  out.tiles = size_t((w + kTile - 1) / kTile) * size_t((h + kTile - 1) / kTile);
  out.pixelLimit = sidakLimit(0.01, 3 * out.pixels, 9.0 * (K - 1));
  out.tileLimit = sidakLimit(0.01, 3 * out.tiles, 64.0 * (K - 1));
  const auto slack = [&](double value) { return tolerance * std::max(value, 0.01 * average); };
  size_t noisy = 0, tilesSeen = 0;
  double power = 0, left = 0;
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      if (!compared(x, y)) continue;
      for (int c = 0; c < 3; ++c) {
        const size_t k = 3 * (size_t(y) * w + x) + c;
        double near = 0;
        int count = 0;
        for (int v = std::max(0, y - 1); v <= std::min(h - 1, y + 1); ++v)
          for (int u = std::max(0, x - 1); u <= std::min(w - 1, x + 1); ++u) near += variance[3 * (size_t(v) * w + u) + c], ++count;
        const double p = peer.at(x, y)[c], d = mean[k] - p, own = variance[k] * (1 + sampleRatio);
        const double both = std::max(variance[k], near / count) * (1 + sampleRatio);
        const double z = std::fabs(d) / std::sqrt(both + slack(p) * slack(p) + 1e-30);
        out.worstPixel = std::max(out.worstPixel, z);
        if (z > out.pixelLimit) out.bad[size_t(y) * w + x] = 1;
        if (own > slack(p) * slack(p)) out.zz += d * d / (near / count * (1 + sampleRatio)), ++noisy;
        left += d * d - own;
        power += p * p;
      }
      out.badPixels += out.bad[size_t(y) * w + x];
    }
  out.zz /= double(std::max<size_t>(1, noisy));
  out.unexplained = std::sqrt(std::max(0.0, left) / power);
  for (int ty = 0; ty < h; ty += kTile)
    for (int tx = 0; tx < w; tx += kTile) {
      bool bad = false;
      for (int c = 0; c < 3; ++c) {
        double d = 0, s = 0, p = 0;
        int count = 0;
        for (int y = ty; y < std::min(h, ty + kTile); ++y)
          for (int x = tx; x < std::min(w, tx + kTile); ++x)
            if (compared(x, y)) {
              const size_t k = 3 * (size_t(y) * w + x) + c;
              d += mean[k] - peer.at(x, y)[c];
              s += variance[k] * (1 + sampleRatio);
              p += peer.at(x, y)[c];
              ++count;
            }
        if (count == 0) continue;
        const double allowed = count * slack(p / count), z = std::fabs(d) / std::sqrt(s + allowed * allowed + 1e-30);
        out.worstTile = std::max(out.worstTile, z);
        bad |= z > out.tileLimit;
        out.tileZz += z * z;
        ++tilesSeen;
      }
      out.badTiles += bad;
    }
  out.tileZz /= double(std::max<size_t>(1, tilesSeen));
  return out;
}

inline std::string describe(const Agreement& a) {
  char text[512];
  std::snprintf(text, sizeof text,
                "mean ratio %.5f %.5f %.5f (se %.5f %.5f %.5f), pixels beyond %.2f sigma: %zu of %zu (worst %.1f), tiles beyond %.2f: %zu of "
                "%zu (worst %.1f), mean z^2 of pixels %.3f, of tiles %.3f, unexplained RMS %.4f %%",
                a.ratio[0], a.ratio[1], a.ratio[2], a.ratioError[0], a.ratioError[1], a.ratioError[2], a.pixelLimit, a.badPixels, a.pixels, a.worstPixel,
                a.tileLimit, a.badTiles, a.tiles, a.worstTile, a.zz, a.tileZz, 100 * a.unexplained);
  return text;
}

}  // namespace gobo::testing
