// SPDX-License-Identifier: Apache-2.0
#include "measure/confidence.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/check.h"

namespace gobo {
inline namespace measure {
namespace {

constexpr double kNormal975 = 1.959963984540054;
/// Size of the unseen event that the upper limit grants, over the largest seen. Fay and Feuer's 1 is exact for errors of one
/// size; heavy tails (log-normal errors) hold 93 % only with more, and regular pictures pay 1 % of the width for it.
constexpr double kGranted = 1.5;

/// -ln 0.05: an area that is drawn this often on the average is missed with a chance of 5 %.
constexpr double kThree = 2.995732273553991;

/// P(shape, x): power series below the mean, Lentz's continued fraction above it.
double regularisedGamma(double shape, double x) {
  if (x <= 0) return 0;
  const double scale = std::exp(shape * std::log(x) - x - std::lgamma(shape));
  if (x < shape + 1) {
    double term = 1 / shape, sum = term;
    for (int k = 1; k < 10000 && term > sum * 1e-16; ++k) sum += term *= x / (shape + k);
    return std::min(1.0, sum * scale);
  }
  double b = x + 1 - shape, c = 1e300, d = 1 / b, fraction = d;
  for (int k = 1; k < 10000; ++k) {
    const double a = -k * (k - shape);
    b += 2;
    d = 1 / (a * d + b);
    c = b + a / c;
    const double step = c * d;
    fraction *= step;
    if (std::fabs(step - 1) < 1e-15) break;
  }
  return std::clamp(1 - fraction * scale, 0.0, 1.0);
}

/// Fay and Feuer's 97.5 % limit of a weighted sum of Poisson counts, `sum` seen with this variance; `granted`: weight of one event more.
double poissonLimit(double sum, double variance, double granted) {
  const double y = sum + granted, v = variance + granted * granted;
  return y > 0 && v > 0 ? v / y * gammaQuantile(y * y / v, 0.975) : 0.0;
}

}  // namespace

double studentQuantile(double q, double degrees) {
  const double q3 = q * q * q, q5 = q3 * q * q, q7 = q5 * q * q;
  return q + (q3 + q) / (4 * degrees) + (5 * q5 + 16 * q3 + 3 * q) / (96 * degrees * degrees) +
         (3 * q7 + 19 * q5 + 17 * q3 - 15 * q) / (384 * degrees * degrees * degrees);
}

double gammaQuantile(double shape, double probability) {
  GOBO_CHECK(shape > 0 && probability > 0 && probability < 1);
  if (shape > 1e6 && probability == 0.975) {  // Wilson & Hilferty 1931, off by far less than 1e-9 here, where the series is long
    const double root = 1 - 1 / (9 * shape) + kNormal975 / (3 * std::sqrt(shape));
    return shape * root * root * root;
  }
  double high = std::max(1.0, shape);
  while (regularisedGamma(shape, high) < probability) high *= 2;
  // P is increasing: bisect, in the logarithm once the answer is known to be small (tiny shapes put it near zero).
  double low = high * 0.5;
  while (low > 1e-300 && regularisedGamma(shape, low) >= probability) high = low, low *= 0.5;
  if (low <= 1e-300) return 0;
  for (int i = 0; i < 60 && high - low > 1e-12 * high; ++i) {
    const double middle = 0.5 * (low + high);
    (regularisedGamma(shape, middle) < probability ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

MeanInterval meanInterval(const std::vector<double>& z) {
  MeanInterval out;
  const size_t n = z.size();
  if (n == 0) return out;
  double sum = 0, squares = 0, largest = 0;
  for (double v : z) sum += v, squares += v * v, largest = std::max(largest, v);
  out.mean = sum / double(n);
  double deviations = 0;
  for (double v : z) deviations += (v - out.mean) * (v - out.mean);
  out.standardError = n > 1 ? std::sqrt(deviations / (double(n) * double(n - 1))) : std::fabs(out.mean);
  const double t = studentQuantile(kNormal975, std::max(3.0, double(n) - 1)) * out.standardError;
  out.low = std::max(0.0, out.mean - t);
  out.high = std::max(0.0, out.mean + t);

  out.high = std::max(out.high, poissonLimit(std::max(out.mean, 0.0), squares / (double(n) * double(n)), kGranted * largest / double(n)));
  return out;
}

namespace {

/// Degrees of freedom of one pixel's noise, a jackknife over four parts.
constexpr double kPixelDegrees = 3;

/// Pixels of largest value whose spread stands for that of the certain ones.
constexpr size_t kWorst = 64;

double pooledSpread(const std::vector<DrawnValue>& drawn) {
  std::vector<size_t> order(drawn.size());
  std::iota(order.begin(), order.end(), size_t(0));
  const size_t count = std::min(kWorst, order.size());
  std::nth_element(order.begin(), order.begin() + count - 1, order.end(),
                   [&](size_t a, size_t b) { return drawn[a].value != drawn[b].value ? drawn[a].value > drawn[b].value : a < b; });
  std::sort(order.begin(), order.begin() + count);  // a sum in one order, whatever the selection did
  double worst = 0, certain = 0;
  size_t certainCount = 0;
  for (size_t i = 0; i < count; ++i) worst += drawn[order[i]].spread;
  for (const DrawnValue& d : drawn)
    if (d.chance >= 1) certain += d.spread, ++certainCount;
  return std::max(worst / double(count), certainCount ? certain / double(certainCount) : 0.0);
}

/// Pixels whose unseen fellows must be reckoned with: Poisson events. The others' error is known but for noise.
struct Events {
  double sum = 0, variance = 0, largest = 0;
  void add(double weight, double share, double noise) {
    sum += weight;
    variance += share * weight * weight + noise;
    largest = std::max(largest, std::sqrt(share) * weight);
  }
  /// Distance of the 97.5 % limit from the sum.
  double above(double t) const { return std::max(t * std::sqrt(variance), poissonLimit(std::max(sum, 0.0), variance, kGranted * largest) - sum); }
};
struct Known {
  double noise = 0, noise2 = 0, positive = 0, positive2 = 0;  // ...2: sums of squares
  void add(const DrawnValue& d, double pixelNoise, double all) {
    const double value = std::max(d.value, 0.0) / (all * all);
    noise += pixelNoise, noise2 += pixelNoise * pixelNoise;
    positive += value, positive2 += value * value;
  }
  double variance(double spread) const { return std::max(noise, 4 * positive * spread); }
  /// Of the variance (Satterthwaite 1946): few where few pixels make it.
  double degrees(double spread) const {
    const bool own = noise >= 4 * positive * spread;
    const double sum = own ? noise : positive, squares = own ? noise2 : positive2;
    return squares > 0 ? kPixelDegrees * sum * sum / squares : 1e9;
  }
};

}  // namespace

DrawnInterval drawnInterval(const std::vector<DrawnValue>& drawn, double all) {
  DrawnInterval out;
  if (drawn.empty() || !(all > 0)) {
    out.unseenArea = 1;
    return out;
  }
  Events byChance, doubtful;  // the second: those and the dark ones
  Known certain, bright;
  double largestValue = 0, leastChance = 1;
  for (const DrawnValue& d : drawn) {
    const double weight = d.value / (d.chance * all), noise = d.noise / d.chance / (all * all);
    const bool chance = d.chance < 1;
    out.mean += weight;
    if (chance) {
      byChance.add(weight, 1 - d.chance, noise);
      largestValue = std::max(largestValue, d.value);
      leastChance = std::min(leastChance, d.chance);
    } else {
      certain.add(d, noise, all);
    }
    if (chance || d.dark) doubtful.add(weight, d.dark ? 1 : 1 - d.chance, noise);
    else bright.add(d, noise, all);
  }
  const double spread = pooledSpread(drawn), t = studentQuantile(kNormal975, std::max(3.0, double(drawn.size()) - 1));
  const auto limit = [&](const Events& events, const Known& known) {
    const double up = events.above(t), few = studentQuantile(kNormal975, std::max(kPixelDegrees, known.degrees(spread)));
    return std::max(0.0, out.mean + std::sqrt(up * up + few * few * known.variance(spread)));
  };
  out.standardError = std::sqrt(certain.variance(spread) + byChance.variance);
  out.low = std::max(0.0, out.mean - t * out.standardError);
  out.highTrimmed = std::max(out.low, limit(byChance, certain));
  if (leastChance < 1) out.unseenArea = std::min(1.0, -kThree / (all * std::log1p(-leastChance)));
  out.high = std::max(out.highTrimmed, limit(doubtful, bright)) + out.unseenArea * largestValue;
  return out;
}

}  // namespace measure
}  // namespace gobo
