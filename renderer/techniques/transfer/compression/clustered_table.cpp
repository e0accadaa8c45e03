// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/compression/clustered_table.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "base/hash.h"
#include "base/sobol.h"
#include "techniques/transfer/compression/half_float.h"
#include "techniques/transfer/compression/symmetric_eigen.h"

namespace gobo::transfer {

namespace {

constexpr size_t kRowsOfABlock = 512;  // never of the number of threads
constexpr long kNearest = 16;          // clusters that a row may change to in a round
constexpr float kLargest = 1e30f;      // of a number: products with scales stay within floats

Status checkTable(std::span<const float> table, size_t width) {
  if (width == 0 || table.size() % width != 0)
    return invalidArgument("transfer table: " + std::to_string(table.size()) + " numbers are no rows of " + std::to_string(width));
  for (size_t i = 0; i < table.size(); ++i)
    if (!(std::fabs(table[i]) <= kLargest))
      return invalidArgument("transfer table: number " + std::to_string(i % width) + " of row " + std::to_string(i / width) + " is not finite, or beyond 1e30");
  return {};
}

double squaredDistance(const float* a, const float* b, size_t width) {
  double sum = 0;
  for (size_t k = 0; k < width; ++k) sum += (double(a[k]) - double(b[k])) * (double(a[k]) - double(b[k]));
  return sum;
}

/// A clustering on its way: which row is whose, and what of each cluster is known.
class Clustering {
 public:
  Clustering(std::span<const float> table, size_t width, const TaskArena& arena, const StopToken& stop)
      : table_(table), width_(width), rows_(table.size() / width), arena_(arena), stop_(stop), owner(rows_, 0) {}

  size_t count() const { return mean.size() / width_; }
  const float* row(size_t i) const { return table_.data() + i * width_; }

  /// Centres drawn one after the other in proportion to the squared distance to those before (Arthur & Vassilvitskii 2007).
  void seed(size_t most, uint64_t key) {
    std::vector<double> nearest(rows_, std::numeric_limits<double>::infinity());
    std::vector<float> centre(row(0), row(0) + width_);
    mean.clear();
    while (true) {
      const size_t k = count();
      mean.insert(mean.end(), centre.begin(), centre.end());
      if (k + 1 >= most || stop_.stopRequested()) break;
      arena_.parallelFor(rows_, kRowsOfABlock, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) nearest[i] = std::min(nearest[i], distance(i, k));
      });
      double all = 0;
      for (const double d : nearest) all += d;
      if (!(all > 0)) break;  // every row is a centre
      double at = all * (double(hash64(key, k) >> 11) * 0x1p-53);
      size_t next = 0;
      for (size_t i = 0; i < rows_; ++i)
        if (nearest[i] > 0) {
          next = i;
          if ((at -= nearest[i]) < 0) break;
        }
      centre.assign(row(next), row(next) + width_);
    }
  }

  /// Rows to the nearest of the means; true if one moved.
  bool assignByMeans() {
    return assign([&](size_t i) {
      std::pair<double, size_t> best(std::numeric_limits<double>::infinity(), 0);
      for (size_t c = 0; c < count(); ++c) best = std::min(best, {distance(i, c), c});
      return best.second;
    });
  }
  /// Rows to the cluster whose directions leave least of them, of their own and the few whose means are nearest.
  bool assignByDirections(size_t kept) {
    return assign([&](size_t i) {
      std::vector<std::pair<double, size_t>> near;
      for (size_t c = 0; c < count(); ++c) near.emplace_back(distance(i, c), c);
      const auto own = near[owner[i]];
      if (near.size() > size_t(kNearest)) {
        std::nth_element(near.begin(), near.begin() + kNearest, near.end());
        near.resize(size_t(kNearest));
      }
      near.push_back(own);
      std::pair<double, size_t> best(std::numeric_limits<double>::infinity(), 0);
      for (const auto& [away, c] : near) best = std::min(best, {away - taken(i, c, kept), c});
      return best.second;
    });
  }

  /// Means of the rows that clusters have; those without rows are left out.
  void recentre() {
    const std::vector<std::vector<size_t>> members = membersOf();
    std::vector<float> next;
    std::vector<size_t> renamed(count(), 0);
    for (size_t c = 0, kept = 0; c < members.size(); ++c) {
      if (members[c].empty()) continue;
      renamed[c] = kept++;
      std::vector<double> sum(width_, 0.0);
      for (const size_t i : members[c])
        for (size_t d = 0; d < width_; ++d) sum[d] += double(row(i)[d]);
      for (size_t d = 0; d < width_; ++d) next.push_back(float(sum[d] / double(members[c].size())));
    }
    mean = std::move(next);
    for (size_t& c : owner) c = renamed[c];
  }

  /// Principal directions about the means as they are rounded, and what those beyond `kept` cost.
  bool findDirections(size_t kept) {
    const std::vector<std::vector<size_t>> members = membersOf();
    directions_.assign(count() * kept * width_, 0.0);
    discarded.assign(count(), 0.0);
    return arena_.parallelFor(
        count(), 1,
        [&](size_t begin, size_t end) {
          for (size_t c = begin; c < end; ++c) {
            std::vector<double> moments(width_ * width_, 0.0), off(width_);
            for (const size_t i : members[c]) {
              for (size_t d = 0; d < width_; ++d) off[d] = double(row(i)[d]) - double(mean[c * width_ + d]);
              for (size_t a = 0; a < width_; ++a)
                for (size_t b = a; b < width_; ++b) moments[a * width_ + b] += off[a] * off[b];
            }
            for (size_t a = 0; a < width_; ++a)
              for (size_t b = 0; b < a; ++b) moments[a * width_ + b] = moments[b * width_ + a];
            const SymmetricEigen eigen = symmetricEigen(std::move(moments), width_);
            std::copy(eigen.vectors.begin(), eigen.vectors.begin() + long(kept * width_), directions_.begin() + long(c * kept * width_));
            for (size_t k = width_; k-- > kept;) discarded[c] += std::max(eigen.values[k], 0.0);
          }
        },
        stop_);
  }
  const std::vector<double>& directions() const { return directions_; }
  std::vector<std::vector<size_t>> membersOf() const {
    std::vector<std::vector<size_t>> members(count());
    for (size_t i = 0; i < rows_; ++i) members[owner[i]].push_back(i);
    return members;
  }

 private:
  double distance(size_t i, size_t c) const { return squaredDistance(row(i), mean.data() + c * width_, width_); }
  /// Of the squared distance to c's mean, what its directions take.
  double taken(size_t i, size_t c, size_t kept) const {
    const float *own = row(i), *middle = mean.data() + c * width_;
    double sum = 0;
    for (size_t k = 0; k < kept; ++k) {
      const double* direction = directions_.data() + (c * kept + k) * width_;
      double w = 0;
      for (size_t d = 0; d < width_; ++d) w += (double(own[d]) - double(middle[d])) * direction[d];
      sum += w * w;
    }
    return sum;
  }
  template <typename Best>
  bool assign(const Best& bestOf) {
    std::vector<uint8_t> moved((rows_ + kRowsOfABlock - 1) / kRowsOfABlock, 0);
    arena_.parallelFor(
        moved.size(), 1,
        [&](size_t begin, size_t end) {
          for (size_t b = begin; b < end; ++b)
            for (size_t i = b * kRowsOfABlock; i < std::min((b + 1) * kRowsOfABlock, rows_); ++i) {
              const size_t best = bestOf(i);
              moved[b] |= best != owner[i];
              owner[i] = best;
            }
        },
        stop_);
    return std::any_of(moved.begin(), moved.end(), [](uint8_t m) { return m != 0; });
  }

  std::span<const float> table_;
  size_t width_, rows_;
  const TaskArena& arena_;
  const StopToken& stop_;
  std::vector<double> directions_;

 public:
  std::vector<size_t> owner;
  std::vector<float> mean;
  std::vector<double> discarded;
};

/// Weights of a row by rounded directions: each of what those before it left, their rounding too.
void weightsOf(const float* row, const ClusteredTable& t, size_t c, std::vector<double>& left, std::vector<double>& out) {
  for (size_t d = 0; d < t.width; ++d) left[d] = double(row[d]) - double(t.mean[c * t.width + d]);
  for (size_t k = 0; k < t.kept; ++k) {
    const uint16_t* direction = t.directions.data() + (c * t.kept + k) * t.width;
    double along = 0, size = 0;
    for (size_t d = 0; d < t.width; ++d) {
      along += left[d] * double(floatOf(direction[d]));
      size += double(floatOf(direction[d])) * double(floatOf(direction[d]));
    }
    out[k] = size > 0 ? along / size : 0.0;
    if (const double scale = double(t.scale[c]); scale > 0) {
      const double rounded = double(floatOf(halfOf(float(out[k] / scale)))) * scale;
      for (size_t d = 0; d < t.width; ++d) left[d] -= rounded * double(floatOf(direction[d]));
    }
  }
}

}  // namespace

void HalfTable::row(size_t i, std::span<float> out) const {
  for (size_t d = 0; d < width; ++d) out[d] = std::ldexp(floatOf(values[i * width + d]), exponent);
}

Result<HalfTable> halfTable(std::span<const float> table, size_t width, const TaskArena& arena) {
  GOBO_TRY(checkTable(table, width));
  HalfTable out;
  out.width = width;
  float largest = 0;
  for (const float v : table) largest = std::max(largest, std::fabs(v));
  // The largest number at 2^14 or so: as far above what halves round coarsely as there is room.
  if (largest > 0) out.exponent = std::ilogb(largest) - 14;
  out.values.resize(table.size());
  std::vector<double> worst(out.rows(), 0.0);
  arena.parallelFor(out.rows(), kRowsOfABlock, [&](size_t begin, size_t end) {
    std::vector<float> back(width);
    for (size_t i = begin; i < end; ++i) {
      for (size_t d = 0; d < width; ++d) out.values[i * width + d] = halfOf(std::ldexp(table[i * width + d], -out.exponent));
      out.row(i, back);
      worst[i] = squaredDistance(back.data(), table.data() + i * width, width);
    }
  });
  for (const double w : worst) out.bound = std::max(out.bound, std::sqrt(w));
  return out;
}

size_t ClusteredTable::bytes() const {
  const size_t number = clusters() <= 1 ? 0 : clusters() <= 256 ? 1 : 2;
  return rows() * number + 2 * weights.size() + 4 * (mean.size() + scale.size()) + 2 * directions.size();
}

void ClusteredTable::row(size_t i, std::span<float> out) const {
  const size_t c = cluster[i];
  std::copy_n(mean.begin() + long(c * width), width, out.begin());
  for (size_t k = 0; k < kept; ++k) {
    const float w = floatOf(weights[i * kept + k]) * scale[c];
    const uint16_t* direction = directions.data() + (c * kept + k) * width;
    for (size_t d = 0; d < width; ++d) out[d] += w * floatOf(direction[d]);
  }
}

Result<ClusteredTable> clusteredTable(std::span<const float> table, size_t width, const ClusterSettings& settings, const TaskArena& arena,
                                      const StopToken& stop) {
  GOBO_TRY(checkTable(table, width));
  if (settings.clusters < 1 || settings.clusters > 65536)
    return invalidArgument("transfer table: " + std::to_string(settings.clusters) + " clusters; 1 to 65536");
  ClusteredTable out;
  out.width = width;
  out.kept = std::min(settings.kept, width);
  const size_t rows = table.size() / width;
  if (rows == 0) return out;

  Clustering clusters(table, width, arena, stop);
  clusters.seed(std::min(settings.clusters, rows), settings.seed);
  for (int r = 0; r < std::max(settings.means, 1); ++r) {
    const bool moved = clusters.assignByMeans();
    if (stop.stopRequested()) return ClusteredTable{};
    clusters.recentre();
    if (!moved) break;
  }
  for (int r = 0;; ++r) {
    if (!clusters.findDirections(out.kept)) return ClusteredTable{};
    if (r >= settings.exchanges || clusters.count() < 2) break;
    const bool moved = clusters.assignByDirections(out.kept);
    if (stop.stopRequested()) return ClusteredTable{};
    if (!moved) break;
    clusters.recentre();
  }

  const size_t count = clusters.count();
  out.cluster.resize(rows);
  for (size_t i = 0; i < rows; ++i) out.cluster[i] = uint16_t(clusters.owner[i]);
  out.mean = clusters.mean;
  out.discarded = clusters.discarded;
  for (const double d : clusters.directions()) out.directions.push_back(halfOf(float(d)));
  out.scale.assign(count, 0.0f);
  out.weights.assign(rows * out.kept, 0);
  out.bound.assign(count, 0.0);
  out.squared.assign(count, 0.0);
  const std::vector<std::vector<size_t>> members = clusters.membersOf();
  const bool complete = arena.parallelFor(
      count, 1,
      [&](size_t begin, size_t end) {
        std::vector<double> left(width), weights(out.kept);
        std::vector<float> back(width);
        for (size_t c = begin; c < end; ++c) {
          // The farthest row's distance is no less than any weight (but for rounding): halves of them keep what they have near 1.
          double farthest = 0;
          for (const size_t i : members[c]) farthest = std::max(farthest, squaredDistance(clusters.row(i), out.mean.data() + c * width, width));
          out.scale[c] = float(std::sqrt(farthest));
          for (const size_t i : members[c]) {
            weightsOf(clusters.row(i), out, c, left, weights);
            if (out.scale[c] > 0)
              for (size_t k = 0; k < out.kept; ++k) out.weights[i * out.kept + k] = halfOf(float(weights[k] / double(out.scale[c])));
            out.row(i, back);
            const double missed = squaredDistance(back.data(), clusters.row(i), width);
            out.squared[c] += missed;
            out.bound[c] = std::max(out.bound[c], std::sqrt(missed));
          }
        }
      },
      stop);
  if (!complete) return ClusteredTable{};
  return out;
}

}  // namespace gobo::transfer
