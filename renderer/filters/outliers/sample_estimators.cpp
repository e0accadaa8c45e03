// SPDX-License-Identifier: Apache-2.0
#include "filters/outliers/sample_estimators.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

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

/// Tiles, each with the cascades of its pixels and of those around, three rows at once: what is held depends neither on the picture's size nor on `base`.
constexpr int kTile = 32;
/// Each holds one tile's: admission is told of as many, whatever the threads.
constexpr size_t kMostTasks = 256;

double luminanceOf(const DVec3& v) { return 0.2126 * v.x + 0.7152 * v.y + 0.0722 * v.z; }

/// One cascade of one pixel; those of a pixel come upwards, and most have none.
struct CascadeLight {
  int cascade;
  double samples;  ///< of about its brightness
  DVec3 light;
};

class CascadeRule {
 public:
  explicit CascadeRule(const Reweighting& r) : start_(double(r.start)), base_(double(r.base)), logBase_(std::log(base_)) {
    // Up to 3e38: log(3e38 / start) / log(base) cascades and one beyond.
    count_ = std::max(int(std::log(3.0e38 / start_) / logBase_) + 2, 2);
  }
  /// Cascades that a pixel of so many samples may have light in.
  uint64_t most(uint64_t samples) const { return std::min(2 * samples, uint64_t(count_)); }
  /// Of a pixel's samples, behind what is there. Sums are in the samples' order.
  void append(const SampleView& s, std::span<const uint32_t> samples, std::vector<CascadeLight>& out) const {
    const size_t first = out.size();
    for (const uint32_t i : samples) {
      DVec3 v(0.0);
      for (size_t c = 0; c < 3; ++c) v[int(c)] = double(s.directAt(3 * size_t(i) + c)) + double(s.indirect[3 * size_t(i) + c]);
      const double l = luminanceOf(v);
      if (!(l > start_)) {
        lightOf(0, first, out) += v;
        continue;
      }
      const int k = std::min(int(std::log(l / start_) / logBase_), count_ - 2);
      // By 1 / l between the cascades, so that a sample of luminance l counts as one sample of them together.
      const double low = std::clamp((startOf(k) / l - 1 / base_) / (1 - 1 / base_), 0.0, 1.0);
      lightOf(k, first, out) += low * v;
      lightOf(k + 1, first, out) += (1 - low) * v;
    }
    for (size_t k = first; k < out.size(); ++k) out[k].samples = std::max(0.0, luminanceOf(out[k].light)) / startOf(out[k].cascade);
  }

 private:
  double startOf(int k) const { return start_ * std::pow(base_, k); }
  static DVec3& lightOf(int cascade, size_t first, std::vector<CascadeLight>& out) {
    auto at = std::lower_bound(out.begin() + ptrdiff_t(first), out.end(), cascade, [](const CascadeLight& c, int k) { return c.cascade < k; });
    if (at == out.end() || at->cascade != cascade) at = out.insert(at, CascadeLight{cascade, 0.0, DVec3(0.0)});
    return at->light;
  }
  double start_, base_, logBase_;
  int count_;
};

/// Sums of `part`'s samples, by weights of all.
class ReweightedTiles {
 public:
  ReweightedTiles(const SampleView& s, const SampleBins& all, const SampleBins& part, const Reweighting& r)
      : s_(s), all_(all), part_(part), rule_(r), enough_(double(r.enough)), across_((s.width + kTile - 1) / kTile) {}
  static size_t count(int width, int height) { return size_t((width + kTile - 1) / kTile) * size_t((height + kTile - 1) / kTile); }

  /// What a task holds, whose tiles use it one after the other.
  struct Held {
    struct Row {
      std::vector<CascadeLight> lights;
      std::vector<size_t> first;  ///< of each pixel; one more at the end
    };
    std::array<Row, 3> rows;  ///< y - 1, y, y + 1; y is in rows[y % 3]
    std::vector<CascadeLight> own;
    int left = 0;  ///< x of the rows' first pixel
    std::span<const CascadeLight> of(int x, int y) const {
      const Row& row = rows[size_t(y % 3)];
      const size_t i = size_t(x - left);
      return std::span<const CascadeLight>(row.lights).subspan(row.first[i], row.first[i + 1] - row.first[i]);
    }
  };

  void tile(size_t t, Held& held, const StopToken& stop, std::vector<float>& out) const {
    const int x0 = int(t) % across_ * kTile, x1 = std::min(x0 + kTile, s_.width), y0 = int(t) / across_ * kTile, y1 = std::min(y0 + kTile, s_.height);
    held.left = std::max(x0 - 1, 0);
    int next = std::max(y0 - 1, 0);  // row that is not there yet
    for (int y = y0; y < y1; ++y) {
      for (; next <= std::min(y + 1, s_.height - 1); ++next) {
        if (stop.stopRequested()) return;
        fill(held.rows[size_t(next % 3)], held.left, std::min(x1 + 1, s_.width), next);
      }
      for (int x = x0; x < x1; ++x) pixel(x, y, held, out);
    }
  }

 private:
  static std::span<const uint32_t> samplesOf(const SampleBins& bins, int x, int y) {
    return std::span<const uint32_t>(bins.order).subspan(bins.pixelBegin(x, y), bins.pixelEnd(x, y) - bins.pixelBegin(x, y));
  }
  void fill(Held::Row& row, int x0, int x1, int y) const {
    size_t most = 0;
    for (int x = x0; x < x1; ++x) most += size_t(rule_.most(samplesOf(all_, x, y).size()));
    row.lights.clear();
    if (row.lights.capacity() < most) std::vector<CascadeLight>().swap(row.lights);  // or a larger one would be held beside it
    row.lights.reserve(most);
    row.first.clear();
    row.first.reserve(size_t(kTile) + 3);
    for (int x = x0; x < x1; ++x) {
      row.first.push_back(row.lights.size());
      rule_.append(s_, samplesOf(all_, x, y), row.lights);
    }
    row.first.push_back(row.lights.size());
  }
  void pixel(int x, int y, Held& held, std::vector<float>& out) const {
    const std::span<const uint32_t> samples = samplesOf(part_, x, y);
    if (samples.empty()) return;
    std::span<const CascadeLight> summed = held.of(x, y);
    if (&part_ != &all_) {
      held.own.clear();
      held.own.reserve(size_t(rule_.most(samples.size())));
      rule_.append(s_, samples, held.own);
      summed = held.own;
    }
    std::array<std::span<const CascadeLight>, 9> around;
    size_t n = 0;
    for (int v = std::max(y - 1, 0); v <= std::min(y + 1, s_.height - 1); ++v)
      for (int u = std::max(x - 1, 0); u <= std::min(x + 1, s_.width - 1); ++u) around[n++] = held.of(u, v);
    DVec3 sum(0.0);
    for (const CascadeLight& c : summed) {
      double found = 0;  // next to this cascade, around
      for (size_t i = 0; i < n && c.cascade > 0; ++i) {
        std::span<const CascadeLight>& there = around[i];
        while (!there.empty() && there.front().cascade < c.cascade - 1) there = there.subspan(1);
        for (size_t j = 0; j < there.size() && there[j].cascade <= c.cascade + 1; ++j) found += there[j].samples;
      }
      const double w = c.cascade == 0 ? 1.0 : std::clamp((found - 1) / (enough_ - 1), 0.0, 1.0);
      sum += w * c.light;
    }
    const size_t p = size_t(y) * size_t(s_.width) + size_t(x);
    for (int c = 0; c < 3; ++c) out[3 * p + size_t(c)] = float(std::clamp(sum[c] / double(samples.size()), -3.4e38, 3.4e38));
  }

  const SampleView& s_;
  const SampleBins &all_, &part_;
  CascadeRule rule_;
  double enough_;
  int across_;
};

}  // namespace

std::vector<float> reweightedMean(const SampleView& s, const SampleBins& bins, const Reweighting& r, const Rows& rows) {
  return reweightedPart(s, bins, bins, r, rows);
}

std::vector<float> reweightedPart(const SampleView& s, const SampleBins& bins, const SampleBins& part, const Reweighting& r, const Rows& rows) {
  std::vector<float> out(3 * size_t(s.width) * size_t(s.height), 0.0f);
  const ReweightedTiles tiles(s, bins, part, r);
  const size_t count = ReweightedTiles::count(s.width, s.height), tasks = std::min(count, kMostTasks);
  const auto some = [&](size_t begin, size_t end) {
    for (size_t task = begin; task < end; ++task) {
      ReweightedTiles::Held held;
      for (size_t t = task; t < count && !rows.stop.stopRequested(); t += tasks) tiles.tile(t, held, rows.stop, out);
    }
  };
  if (rows.arena) rows.arena->parallelFor(tasks, 1, some, rows.stop);
  else some(0, tasks);
  return out;
}

uint64_t reweightingBytes(int width, int height, uint64_t samples, const Reweighting& r) {
  const uint64_t row = uint64_t(std::min(width, kTile + 2)), pixels = row * uint64_t(std::min(height, 3)) + 1;  // and one of a part
  const uint64_t task = pixels * CascadeRule(r).most(samples) * sizeof(CascadeLight) + 3 * uint64_t(kTile + 3) * sizeof(size_t);
  return task * std::min(ReweightedTiles::count(width, height), kMostTasks);
}

}  // namespace gobo::outliers
