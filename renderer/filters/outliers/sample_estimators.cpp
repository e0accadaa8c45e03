// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/sample_estimators.h"

#include <algorithm>
#include <cmath>

#include "base/vec.h"

namespace gobo::outliers {

namespace {

/// row(y) for every row.
template <class F>
void forRows(int height, const Rows& rows, F&& row) {
  const auto some = [&](size_t begin, size_t end) {
    for (size_t y = begin; y < end && !rows.stop.stopRequested(); ++y) row(int(y));
  };
  if (rows.arena) rows.arena->parallelFor(size_t(height), 1, some, rows.stop);
  else some(0, size_t(height));
}

/// result(values of a channel, in the samples' order) for every pixel.
template <class Estimate>
std::vector<float> byPixel(const SampleView& s, const SampleBins& bins, const Rows& rows, Estimate&& result) {
  std::vector<float> out(3 * size_t(s.width) * size_t(s.height), 0.0f);
  forRows(s.height, rows, [&](int y) {
    std::vector<double> values;
    for (int x = 0; x < s.width; ++x)
      for (size_t c = 0; c < 3; ++c) {
        values.clear();
        for (size_t i = bins.pixelBegin(x, y); i < bins.pixelEnd(x, y); ++i) {
          const size_t at = 3 * size_t(bins.order[i]) + c;
          values.push_back(double(s.directAt(at)) + double(s.indirect[at]));
        }
        if (!values.empty()) out[3 * (size_t(y) * size_t(s.width) + size_t(x)) + c] = float(std::clamp(result(values), -3.4e38, 3.4e38));
      }
  });
  return out;
}
double meanOf(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / double(values.size());
}

}  // namespace

std::vector<float> meanPicture(const SampleView& s, const SampleBins& bins, const Rows& rows) { return byPixel(s, bins, rows, meanOf); }

std::vector<float> trimmedMean(const SampleView& s, const SampleBins& bins, double share, const Rows& rows) {
  return byPixel(s, bins, rows, [share](std::vector<double>& v) {
    std::sort(v.begin(), v.end());
    const double n = double(v.size()), cut = std::clamp(share, 0.0, 0.5) * n;
    if (n - 2 * cut < 1e-9) return 0.5 * (v[(v.size() - 1) / 2] + v[v.size() / 2]);
    double sum = 0;
    for (size_t i = 0; i < v.size(); ++i) {
      // The part of [i, i + 1) that lies in [cut, n - cut).
      const double part = std::min(double(i + 1), n - cut) - std::max(double(i), cut);
      if (part > 0) sum += part * v[i];
    }
    return sum / (n - 2 * cut);
  });
}

double giniCoefficient(const std::vector<double>& sorted) {
  double sum = 0, ranked = 0;
  const double n = double(sorted.size());
  for (size_t i = 0; i < sorted.size(); ++i) {
    sum += sorted[i];
    ranked += (2.0 * double(i + 1) - n - 1) * sorted[i];
  }
  return sum > 0 ? std::clamp(ranked / (n * sum), 0.0, 1.0) : 0.0;
}

std::vector<float> adaptiveMedianOfMeans(const SampleView& s, const SampleBins& bins, int buckets, const Rows& rows) {
  return byPixel(s, bins, rows, [buckets](const std::vector<double>& v) {
    const size_t most = std::min(size_t(std::max(buckets, 1)), v.size()), m = most % 2 ? most : most - 1;
    std::vector<double> means(m, 0.0);
    for (size_t i = 0; i < v.size(); ++i) means[i % m] += v[i];
    for (size_t k = 0; k < m; ++k) means[k] /= double(v.size() / m + (k < v.size() % m ? 1 : 0));
    std::sort(means.begin(), means.end());
    const size_t out = std::min(size_t(giniCoefficient(means) * double(m) / 2), (m - 1) / 2);
    return meanOf(std::vector<double>(means.begin() + ptrdiff_t(out), means.end() - ptrdiff_t(out)));
  });
}

std::vector<float> reweightedMean(const SampleView& s, const SampleBins& bins, const Reweighting& r, const Rows& rows) {
  const size_t pixels = size_t(s.width) * size_t(s.height);
  // Up to 3e38: log(3e38 / start) / log(base) cascades and one beyond.
  const int cascades = std::clamp(int(std::log(3.0e38 / double(r.start)) / std::log(double(r.base))) + 2, 2, 160);
  std::vector<std::vector<DVec3>> light(static_cast<size_t>(cascades));  // made when needed: most are empty
  const auto at = [&](int k, size_t p) -> DVec3& {
    auto& one = light[size_t(k)];
    if (one.empty()) one.assign(pixels, DVec3(0.0));
    return one[p];
  };
  const auto startOf = [&](int k) { return double(r.start) * std::pow(double(r.base), k); };
  for (int y = 0; y < s.height && !rows.stop.stopRequested(); ++y)
    for (int x = 0; x < s.width; ++x)
      for (size_t i = bins.pixelBegin(x, y); i < bins.pixelEnd(x, y); ++i) {
        const size_t j = 3 * size_t(bins.order[i]), p = size_t(y) * size_t(s.width) + size_t(x);
        DVec3 v(0.0);
        for (int c = 0; c < 3; ++c) v[c] = double(s.directAt(j + size_t(c))) + double(s.indirect[j + size_t(c)]);
        const double l = 0.2126 * v.x + 0.7152 * v.y + 0.0722 * v.z;
        if (!(l > double(r.start))) {
          at(0, p) += v;
          continue;
        }
        const int k = std::min(int(std::log(l / double(r.start)) / std::log(double(r.base))), cascades - 2);
        // By 1 / l between the cascades, so that a sample of luminance l counts as one sample of them together.
        const double low = std::clamp((startOf(k) / l - 1 / double(r.base)) / (1 - 1 / double(r.base)), 0.0, 1.0);
        at(k, p) += low * v;
        at(k + 1, p) += (1 - low) * v;
      }
  std::vector<float> out(3 * pixels, 0.0f);
  const auto count = [&](int k, size_t p) {
    if (k < 0 || k >= cascades || light[size_t(k)].empty()) return 0.0;
    const DVec3& v = light[size_t(k)][p];
    return std::max(0.0, 0.2126 * v.x + 0.7152 * v.y + 0.0722 * v.z) / startOf(k);
  };
  forRows(s.height, rows, [&](int y) {
    for (int x = 0; x < s.width; ++x) {
      const double n = double(bins.pixelEnd(x, y) - bins.pixelBegin(x, y));
      if (n == 0) continue;
      const size_t p = size_t(y) * size_t(s.width) + size_t(x);
      DVec3 sum(0.0);
      for (int k = 0; k < cascades; ++k) {
        if (light[size_t(k)].empty()) continue;
        double around = 0;
        for (int v = std::max(y - 1, 0); v <= std::min(y + 1, s.height - 1); ++v)
          for (int u = std::max(x - 1, 0); u <= std::min(x + 1, s.width - 1); ++u)
            for (int j = k - 1; j <= k + 1; ++j) around += count(j, size_t(v) * size_t(s.width) + size_t(u));
        const double w = k == 0 ? 1.0 : std::clamp((around - 1) / (double(r.enough) - 1), 0.0, 1.0);
        sum += w * light[size_t(k)][p];
      }
      for (int c = 0; c < 3; ++c) out[3 * p + size_t(c)] = float(std::clamp(sum[c] / n, -3.4e38, 3.4e38));
    }
  });
  return out;
}

}  // namespace gobo::outliers
