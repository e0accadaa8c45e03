// SPDX-License-Identifier: Apache-2.0
#include "measure/change.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "base/check.h"

namespace gobo {
inline namespace measure {
namespace {

constexpr int kChannels = 3;
const char* const kChannelNames[kChannels] = {"luminance", "red - green", "blue - green"};

/// Noise is mostly of all channels alike: what it does to colour is less than what it does to each channel.
std::array<double, kChannels> opponent(const Vec3& v) { return {(double(v.x) + v.y + v.z) / 3, double(v.x) - v.y, double(v.z) - v.y}; }

/// Sums over cells of a regular grid: numerator, its variance, and how far a tolerated difference may take it.
struct Cells {
  int width = 0, height = 0;
  std::vector<double> sum, variance, slack;
  Cells(int w, int h) : width(w), height(h), sum(size_t(w) * h), variance(size_t(w) * h), slack(size_t(w) * h) {}
};

/// The grid of cells of twice the size.
Cells coarser(const Cells& c) {
  Cells out((c.width + 1) / 2, (c.height + 1) / 2);
  for (int y = 0; y < c.height; ++y)
    for (int x = 0; x < c.width; ++x) {
      const size_t from = size_t(y) * c.width + x, to = size_t(y / 2) * out.width + x / 2;
      out.sum[to] += c.sum[from];
      out.variance[to] += c.variance[from];
      out.slack[to] += c.slack[from];
    }
  return out;
}

/// t^2.
double studentized(double sum, double variance, double slack) {
  const double denominator = variance + slack * slack;
  return denominator > 0 ? std::min(sum * sum / denominator, 1e6) : sum != 0 ? 1e6 : 0.0;  // neither noise nor tolerance: anything is a change
}

/// Box mean over 3 x 3 pixels, fewer at borders.
std::vector<double> smoothed(const std::vector<double>& in, int w, int h) {
  std::vector<double> out(in.size());
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      double sum = 0;
      int n = 0;
      for (int v = std::max(0, y - 1); v <= std::min(h - 1, y + 1); ++v)
        for (int u = std::max(0, x - 1); u <= std::min(w - 1, x + 1); ++u) sum += in[size_t(v) * w + u], ++n;
      out[size_t(y) * w + x] = sum / n;
    }
  return out;
}

/// Differences of parts, weighted so that noisy pixels do not drown quiet ones. The weights are of what sign flips leave as it is.
class Differences {
 public:
  Differences(const std::vector<Image>& reference, const std::vector<Image>& now, double tolerance)
      : width_(now[0].width), height_(now[0].height), parts_(int(now.size())) {
    const size_t n = size_t(width_) * height_;
    std::vector<double> level(n);
    for (int k = 0; k < parts_; ++k)
      for (int y = 0; y < height_; ++y)
        for (int x = 0; x < width_; ++x) {
          const auto a = opponent(reference[k].rgb(x, y)), b = opponent(now[k].rgb(x, y));
          level[size_t(y) * width_ + x] += 0.5 * (std::fabs(a[0]) + std::fabs(b[0])) / parts_;
        }
    const std::vector<double> around = smoothed(level, width_, height_);
    double mean = 0;
    for (const double v : level) mean += v / double(n);
    for (size_t i = 0; i < n; ++i) level[i] = std::max({level[i], around[i], 0.01 * mean}) + 1e-30;
    for (int c = 0; c < kChannels; ++c) {
      std::vector<float>& d = difference_[c];
      d.resize(n * parts_);
      std::vector<double> power(n);
      for (int y = 0; y < height_; ++y)
        for (int x = 0; x < width_; ++x)
          for (int k = 0; k < parts_; ++k) {
            const size_t i = size_t(y) * width_ + x;
            const double v = opponent(now[k].rgb(x, y))[c] - opponent(reference[k].rgb(x, y))[c];
            d[i * parts_ + k] = float(v);
            power[i] += v * v / parts_;
          }
      power = smoothed(power, width_, height_);
      power_[c].resize(n);
      slack_[c].resize(n);
      for (size_t i = 0; i < n; ++i) {
        const double allowed = tolerance * level[i], weight = 1 / (power[i] + allowed * allowed + 1e-60);
        const double scale = weight * level[i];  // without a unit: scenes of any brightness stay within the range of a float
        for (int k = 0; k < parts_; ++k) power_[c][i] += std::pow(double(d[i * parts_ + k] = float(d[i * parts_ + k] * scale)), 2);
        slack_[c][i] = allowed * scale;
      }
    }
  }

  int width() const { return width_; }
  int height() const { return height_; }

  /// Cells of one pixel under these signs: of the differences, or of what they are beside their mean over the parts.
  Cells cells(int channel, uint32_t signs, bool centred) const {
    Cells out(width_, height_);
    std::array<float, kMostParts> sign{};
    for (int k = 0; k < parts_; ++k) sign[k] = signs >> k & 1 ? -1.0f : 1.0f;
    const float* d = difference_[channel].data();
    const double each = 1.0 / parts_, free = parts_ > 1 ? 1.0 / (parts_ * (parts_ - 1.0)) : 0.0;
    double surplus = 0;
    for (int k = 0; k < parts_; ++k) surplus += sign[k];
    for (size_t i = 0; i < out.sum.size(); ++i, d += parts_) {
      double flipped = 0, plain = 0;
      for (int k = 0; k < parts_; ++k) flipped += double(sign[k] * d[k]), plain += double(d[k]);
      const double mean = centred ? plain * each : 0.0, left = flipped - surplus * mean;
      const double sum = std::fabs(left) > 1e-12 * std::sqrt(power_[channel][i]) ? left : 0.0;  // less is rounding, which has no variance to be held against
      out.sum[i] = sum * each;
      out.variance[i] = std::max(0.0, power_[channel][i] - parts_ * mean * mean - sum * sum * each) * free;
      out.slack[i] = slack_[channel][i];
    }
    return out;
  }

 private:
  int width_, height_, parts_;
  std::vector<float> difference_[kChannels];  // pixel by pixel, the parts of one side by side
  std::vector<double> power_[kChannels];      // sums of their squares
  std::vector<double> slack_[kChannels];
};

struct Largest {
  double t = 0;
  int x = 0, y = 0, channel = 0;
};

/// What one choice of signs gives: largest |t| a scale, and the sum over all blocks of the small ones.
struct Outcome {
  std::vector<Largest> largest;
  std::vector<double> sums;
  size_t size() const { return largest.size() + sums.size(); }
  double at(size_t i) const { return i < largest.size() ? largest[i].t : sums[i - largest.size()]; }
};

constexpr int kSummedScales = 3;  // blocks of 1, 2 and 4: larger ones are too few for a sum to add anything

int scalesOf(int width, int height) {
  int scales = 1;
  for (int side = std::max(width, height); side > 1; side = (side + 1) / 2) ++scales;
  return scales;
}

/// Calls block(x, y, t^2) for blocks of this scale: 2 x 2 cells of half the side, a cell apart; at scale 0 the pixels with the variance of their neighbourhood,
/// because that of one pixel alone, from so few parts, is often far too small.
template <typename Block>
void forBlocks(const Cells& cells, int scale, const Block& block) {
  if (scale == 0) {
    const std::vector<double> variance = smoothed(cells.variance, cells.width, cells.height);
    for (int y = 0; y < cells.height; ++y)
      for (int x = 0; x < cells.width; ++x) {
        const size_t i = size_t(y) * cells.width + x;
        block(x, y, studentized(cells.sum[i], variance[i], cells.slack[i]));
      }
    return;
  }
  for (int y = 0; y < std::max(1, cells.height - 1); ++y)
    for (int x = 0; x < std::max(1, cells.width - 1); ++x) {
      double sum = 0, variance = 0, slack = 0;
      for (int v = y; v <= std::min(y + 1, cells.height - 1); ++v)
        for (int u = x; u <= std::min(x + 1, cells.width - 1); ++u) {
          const size_t i = size_t(v) * cells.width + u;
          sum += cells.sum[i];
          variance += cells.variance[i];
          slack += cells.slack[i];
        }
      block(x, y, studentized(sum, variance, slack));
    }
}

/// Calls at(scale, channel, cells) with the cells that forBlocks wants for each scale.
template <typename At>
void forScales(const Differences& d, uint32_t signs, bool centred, const At& at) {
  const int scales = scalesOf(d.width(), d.height());
  for (int c = 0; c < kChannels; ++c) {
    Cells cells = d.cells(c, signs, centred);
    at(0, c, cells);
    for (int s = 1; s < scales; ++s) {
      at(s, c, cells);
      if (s + 1 < scales) cells = coarser(cells);
    }
  }
}

Outcome outcomeOf(const Differences& d, uint32_t signs, bool centred, int parts) {
  Outcome out;
  out.largest.resize(size_t(scalesOf(d.width(), d.height())));
  out.sums.resize(kSummedScales);
  const double degrees = std::max(1, parts - 1);
  forScales(d, signs, centred, [&](int scale, int channel, const Cells& cells) {
    const int cell = scale == 0 ? 1 : 1 << (scale - 1);
    Largest& best = out.largest[size_t(scale)];
    double square = best.t * best.t, sum = 0;
    forBlocks(cells, scale, [&](int x, int y, double t2) {
      if (t2 > square) square = t2, best = {std::sqrt(t2), x * cell, y * cell, channel};
      if (scale < kSummedScales) sum += std::log1p(t2 / degrees);
    });
    if (scale < kSummedScales) out.sums[size_t(scale)] += sum;
  });
  return out;
}

struct Spread {
  double mean = 0, deviation = 0;
};
Spread spreadOf(const std::vector<double>& v) {
  Spread s;
  for (const double x : v) s.mean += x / double(v.size());
  for (const double x : v) s.deviation += (x - s.mean) * (x - s.mean) / double(v.size() - 1);
  s.deviation = std::sqrt(s.deviation);
  return s;
}

std::vector<double> valuesAt(const std::vector<Outcome>& outcomes, size_t statistic) {
  std::vector<double> v;
  for (const Outcome& o : outcomes) v.push_back(o.at(statistic));
  return v;
}

std::string scaleName(int scale) { return "blocks of " + std::to_string(1 << scale); }

Status checkParts(const std::vector<Image>& reference, const std::vector<Image>& now) {
  if (reference.empty() || now.empty()) return invalidArgument("no parts");
  if (reference.size() != now.size())
    return invalidArgument("the reference has " + std::to_string(reference.size()) + " parts, the render " + std::to_string(now.size()));
  if (int(now.size()) > kMostParts || (now.size() > 1 && int(now.size()) < kFewestParts))
    return invalidArgument(std::to_string(now.size()) + " parts: must be 1, or " + std::to_string(kFewestParts) + " to " + std::to_string(kMostParts));
  for (const auto* set : {&reference, &now})
    for (size_t k = 0; k < set->size(); ++k) {
      const Image& image = (*set)[k];
      const std::string name = (set == &reference ? "part " : "the render's part ") + std::to_string(k) + (set == &reference ? " of the reference" : "");
      if (image.pixels() == 0) return invalidArgument(name + " is empty");
      if (image.width != reference[0].width || image.height != reference[0].height)
        return invalidArgument(name + " is " + std::to_string(image.width) + "x" + std::to_string(image.height) + ", the reference is " +
                               std::to_string(reference[0].width) + "x" + std::to_string(reference[0].height));
      for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x) {
          const Vec3 v = image.rgb(x, y);
          if (!std::isfinite(v.x) || !std::isfinite(v.y) || !std::isfinite(v.z))
            return invalidArgument(name + " is not finite at pixel " + std::to_string(x) + ", " + std::to_string(y));
        }
    }
  return {};
}

bool sameBits(const std::vector<Image>& a, const std::vector<Image>& b) {
  for (size_t k = 0; k < a.size(); ++k)
    if (a[k].channels != b[k].channels || std::memcmp(a[k].data.data(), b[k].data.data(), a[k].data.size() * sizeof(float)) != 0) return false;
  return true;
}

double meanOfAll(const Image& image) {
  double sum = 0;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) sum += opponent(image.rgb(x, y))[0];
  return sum / double(image.pixels());
}

void addMeans(const std::vector<Image>& reference, const std::vector<Image>& now, ChangeFigures& out) {
  const double parts = double(now.size());
  std::vector<double> shifts;
  for (size_t k = 0; k < now.size(); ++k) {
    const double a = meanOfAll(reference[k]), b = meanOfAll(now[k]);
    out.meanReference += a / parts;
    out.meanNow += b / parts;
    shifts.push_back(b - a);
  }
  if (now.size() == 1) return;
  out.meanStandardError = spreadOf(shifts).deviation / std::sqrt(parts);
  const size_t values = now[0].pixels() * 3;
  for (int y = 0; y < now[0].height; ++y)
    for (int x = 0; x < now[0].width; ++x)
      for (int c = 0; c < 3; ++c) {
        double sum = 0, squares = 0;
        for (size_t k = 0; k < now.size(); ++k) {
          const double d = double(now[k].rgb(x, y)[c]) - reference[k].rgb(x, y)[c];
          sum += d, squares += d * d;
        }
        out.noiseRmse += std::max(0.0, squares - sum * sum / parts) / (parts * (parts - 1)) / double(values);
      }
  out.noiseRmse = std::sqrt(out.noiseRmse);
}

/// Every pixel: the largest excess of a block that it lies in.
std::vector<float> excessMap(const Differences& d, const std::vector<ChangeStatistic>& statistics) {
  std::vector<float> map(size_t(d.width()) * d.height(), 0.0f);
  forScales(d, 0, false, [&](int scale, int, const Cells& cells) {
    if (scale > 3) return;  // larger blocks do not say where
    const int cell = scale == 0 ? 1 : 1 << (scale - 1), side = 1 << scale;
    const ChangeStatistic& s = statistics[size_t(scale)];
    forBlocks(cells, scale, [&](int x, int y, double t2) {
      const float excess = float((std::sqrt(t2) - s.expected) / s.spread);
      if (excess <= 0) return;
      for (int v = y * cell; v < std::min(d.height(), y * cell + side); ++v)
        for (int u = x * cell; u < std::min(d.width(), x * cell + side); ++u) {
          float& to = map[size_t(v) * d.width() + u];
          to = std::max(to, excess);
        }
    });
  });
  return map;
}

}  // namespace

// Words of a linear code of 7 bits, a column a part, all different; of 8 parts they are all there are.
std::vector<uint32_t> signFlips(int parts) {
  constexpr std::array<uint32_t, kMostParts> kColumns{0, 1, 2, 4, 8, 16, 32, 64, 7, 25, 42, 52, 75, 85, 102, 120};
  const uint32_t words = 1u << std::min(parts - 1, 7);
  std::vector<uint32_t> out;
  for (uint32_t word = 1; word < words; ++word) {
    uint32_t signs = 0;
    for (int k = 0; k < parts; ++k) signs |= uint32_t(std::popcount(word & kColumns[size_t(k)]) & 1) << k;
    out.push_back(signs);
  }
  return out;
}

Image meanOf(const std::vector<Image>& parts) {
  GOBO_CHECK(!parts.empty());
  Image out(parts[0].width, parts[0].height, 3);
  for (const Image& part : parts) GOBO_CHECK(part.width == out.width && part.height == out.height);
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x)
      for (int c = 0; c < 3; ++c) {
        double sum = 0;
        for (const Image& part : parts) sum += part.rgb(x, y)[c];
        out.at(x, y)[c] = float(sum / double(parts.size()));
      }
  return out;
}

Result<ChangeFigures> findChange(const std::vector<Image>& reference, const std::vector<Image>& now, const ChangeOptions& options) {
  GOBO_TRY(checkParts(reference, now));
  ChangeFigures out;
  addMeans(reference, now, out);
  out.sameBits = sameBits(reference, now);
  if (out.sameBits) return out;
  const int parts = int(now.size());
  const Differences d(reference, now, options.tolerance);
  const Outcome observed = outcomeOf(d, 0, false, parts);
  std::vector<Outcome> noise;
  const std::vector<uint32_t> all = parts > 1 ? signFlips(parts) : std::vector<uint32_t>();
  for (const uint32_t signs : all) noise.push_back(outcomeOf(d, signs, true, parts));
  const size_t scales = observed.largest.size();
  for (size_t i = 0; i < observed.size(); ++i) {
    ChangeStatistic s;
    s.name = i < scales ? scaleName(int(i)) : "all " + scaleName(int(i - scales));
    if (i < scales) {
      const Largest& l = observed.largest[i];
      s.x = l.x, s.y = l.y, s.size = 1 << i, s.channel = kChannelNames[l.channel];
    } else if (parts == 1) break;
    s.observed = observed.at(i);
    if (parts > 1) {
      const Spread spread = spreadOf(valuesAt(noise, i));
      // At least a normal deviate's: where the tolerance outweighs the noise, flips differ by less than the tolerance is worth.
      s.expected = spread.mean;
      s.spread = std::max(spread.deviation, i < scales ? 0.4 : 0.05 * std::sqrt(double(now[0].pixels())));
    } else {
      // No noise: a block may be off by what is tolerated, which is t = 1, and no more.
      s.spread = 1 / kChangeExcess;
    }
    s.excess = (s.observed - s.expected) / s.spread;
    out.statistics.push_back(std::move(s));
  }
  for (size_t i = 0; i < out.statistics.size(); ++i)
    if (out.strongest < 0 || out.statistics[i].excess > out.statistics[size_t(out.strongest)].excess) out.strongest = int(i);
  out.excess = out.statistics[size_t(out.strongest)].excess;
  // What is seen must stand out further, in whichever statistic does most, than every flip of it: by noise of any kind one time in 128.
  out.changed = out.excess > kChangeExcess;
  for (size_t f = 0; out.changed && f < all.size(); ++f) {
    const Outcome flip = outcomeOf(d, all[f], false, parts);
    for (size_t i = 0; i < out.statistics.size(); ++i) out.changed &= (flip.at(i) - out.statistics[i].expected) / out.statistics[i].spread < out.excess;
  }
  constexpr double kEuler = 0.5772156649, kSlope = 1.2825498302;  // of Gumbel's distribution with mean 0 and variance 1
  out.chance = parts == 1 ? (out.changed ? 0.0 : 1.0) : std::min(1.0, double(out.statistics.size()) * -std::expm1(-std::exp(-kSlope * out.excess - kEuler)));
  out.map = excessMap(d, out.statistics);
  return out;
}

}  // namespace measure
}  // namespace gobo
