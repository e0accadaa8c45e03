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

namespace {

/// Light by cascade and pixel; cascades are made when needed: most are empty.
class Cascades {
 public:
  Cascades(const SampleView& s, const Reweighting& r) : s_(s), start_(double(r.start)), base_(double(r.base)) {
    // Up to 3e38: log(3e38 / start) / log(base) cascades and one beyond.
    light_.resize(size_t(std::clamp(int(std::log(3.0e38 / start_) / std::log(base_)) + 2, 2, 160)));
  }
  int count() const { return int(light_.size()); }
  double startOf(int k) const { return start_ * std::pow(base_, k); }
  bool has(int k) const { return k >= 0 && k < count() && !light_[size_t(k)].empty(); }
  const DVec3& of(int k, size_t p) const { return light_[size_t(k)][p]; }
  void add(const SampleBins& bins, const Rows& rows) {
    for (int y = 0; y < s_.height && !rows.stop.stopRequested(); ++y)
      for (int x = 0; x < s_.width; ++x)
        for (size_t i = bins.pixelBegin(x, y); i < bins.pixelEnd(x, y); ++i) addSample(3 * size_t(bins.order[i]), size_t(y) * size_t(s_.width) + size_t(x));
  }
  /// Samples of about that brightness.
  double samplesOf(int k, size_t p) const {
    if (!has(k)) return 0.0;
    const DVec3& v = of(k, p);
    return std::max(0.0, 0.2126 * v.x + 0.7152 * v.y + 0.0722 * v.z) / startOf(k);
  }

 private:
  DVec3& at(int k, size_t p) {
    auto& one = light_[size_t(k)];
    if (one.empty()) one.assign(size_t(s_.width) * size_t(s_.height), DVec3(0.0));
    return one[p];
  }
  void addSample(size_t j, size_t p) {
    DVec3 v(0.0);
    for (int c = 0; c < 3; ++c) v[c] = double(s_.directAt(j + size_t(c))) + double(s_.indirect[j + size_t(c)]);
    const double l = 0.2126 * v.x + 0.7152 * v.y + 0.0722 * v.z;
    if (!(l > start_)) {
      at(0, p) += v;
      return;
    }
    const int k = std::min(int(std::log(l / start_) / std::log(base_)), count() - 2);
    // By 1 / l between the cascades, so that a sample of luminance l counts as one sample of them together.
    const double low = std::clamp((startOf(k) / l - 1 / base_) / (1 - 1 / base_), 0.0, 1.0);
    at(k, p) += low * v;
    at(k + 1, p) += (1 - low) * v;
  }
  const SampleView& s_;
  double start_, base_;
  std::vector<std::vector<DVec3>> light_;
};

/// Sums of `summed`, by weights of `all`; n samples of a pixel in bins.
std::vector<float> reweighted(const SampleView& s, const Cascades& all, const Cascades& summed, const SampleBins& bins, double enough, const Rows& rows) {
  std::vector<float> out(3 * size_t(s.width) * size_t(s.height), 0.0f);
  forRows(s.height, rows, [&](int y) {
    for (int x = 0; x < s.width; ++x) {
      const double n = double(bins.pixelEnd(x, y) - bins.pixelBegin(x, y));
      if (n == 0) continue;
      const size_t p = size_t(y) * size_t(s.width) + size_t(x);
      DVec3 sum(0.0);
      for (int k = 0; k < all.count(); ++k) {
        if (!summed.has(k)) continue;
        double around = 0;
        for (int v = std::max(y - 1, 0); v <= std::min(y + 1, s.height - 1); ++v)
          for (int u = std::max(x - 1, 0); u <= std::min(x + 1, s.width - 1); ++u)
            for (int j = k - 1; j <= k + 1; ++j) around += all.samplesOf(j, size_t(v) * size_t(s.width) + size_t(u));
        const double w = k == 0 ? 1.0 : std::clamp((around - 1) / (enough - 1), 0.0, 1.0);
        sum += w * summed.of(k, p);
      }
      for (int c = 0; c < 3; ++c) out[3 * p + size_t(c)] = float(std::clamp(sum[c] / n, -3.4e38, 3.4e38));
    }
  });
  return out;
}

}  // namespace

std::vector<float> reweightedMean(const SampleView& s, const SampleBins& bins, const Reweighting& r, const Rows& rows) {
  Cascades all(s, r);
  all.add(bins, rows);
  return reweighted(s, all, all, bins, double(r.enough), rows);
}

std::vector<float> reweightedPart(const SampleView& s, const SampleBins& bins, const SampleBins& part, const Reweighting& r, const Rows& rows) {
  Cascades all(s, r), some(s, r);
  all.add(bins, rows);
  some.add(part, rows);
  return reweighted(s, all, some, part, double(r.enough), rows);
}

}  // namespace gobo::outliers
