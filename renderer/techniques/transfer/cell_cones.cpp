// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/cell_cones.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace gobo::transfer {

namespace {

constexpr size_t kLane = 4;  // runs are padded to multiples of it with weights of 0

struct Run {
  uint16_t cell, count;  // count: with padding
};
/// By vertex the cells of its cone as runs of neighbours in a row, and the Gaussian's weights of them.
struct SmoothingWeights {
  std::vector<uint32_t> firstRun, firstWeight;  // one more than vertices
  std::vector<Run> runs;
  std::vector<float> weights;

  SmoothingWeights() {
    const Icosphere& sphere = icosphere(kSmoothLevel);
    constexpr size_t n = EnvironmentCells::kSide;
    runs.reserve(sphere.vertices.size() * 20);
    weights.reserve(sphere.vertices.size() * 190);
    for (const DVec3& v : sphere.vertices) {
      firstRun.push_back(uint32_t(runs.size()));
      firstWeight.push_back(uint32_t(weights.size()));
      size_t next = size_t(-1);
      const auto pad = [&] {
        while (weights.size() % kLane) {
          weights.push_back(0.0f);
          ++runs.back().count;
        }
      };
      cellsWithin(v, kSupport, [&](size_t i, double cosine) {
        if (i != next || i % n == 0) {
          pad();
          runs.push_back({uint16_t(i), 0});
        }
        // exp(-angle^2 / 2 sigma^2) with angle^2 = 2 (1 - cosine), within 0.2 % up to the end
        weights.push_back(float(std::exp((cosine - 1) / (kSmooth * kSmooth))));
        ++runs.back().count;
        next = i + 1;
      });
      pad();
    }
    firstRun.push_back(uint32_t(runs.size()));
    firstWeight.push_back(uint32_t(weights.size()));
    runs.shrink_to_fit();
    weights.shrink_to_fit();
  }
};
const SmoothingWeights& smoothingWeights() {
  static const SmoothingWeights made;
  return made;
}

}  // namespace

bool boxOfCone(int face, const DVec3& d, double angle, CellBox& box) {
  constexpr int n = EnvironmentCells::kSide;
  box = {0, n - 1, 0, n - 1};
  const int axis = face / 2;
  const double along = face % 2 ? -d[axis] : d[axis];
  const double towards = std::acos(std::clamp(along, -1.0, 1.0));
  if (towards - angle > 55 * kDegree) return false;  // a face's corners are 54.74 degrees off its middle
  if (towards + angle >= 80 * kDegree) return true;  // the cone may come near the plane of the centre: the whole face
  const double u = d[(axis + 1) % 3] / along, v = d[(axis + 2) % 3] / along;
  // A cone's image lies within tan(towards + angle) - tan(towards) of its axis's, and in no direction further.
  const double reach = std::tan(towards + angle) - std::tan(towards) + 2.0 / n;
  if (u + reach < -1 || u - reach > 1 || v + reach < -1 || v - reach > 1) return false;
  const auto cell = [](double t) { return std::clamp(int(std::floor((t + 1) * 0.5 * n)), 0, n - 1); };
  box = {cell(u - reach), cell(u + reach), cell(v - reach), cell(v + reach)};
  return true;
}

const std::vector<DVec3>& cellDirections() {
  static const std::vector<DVec3> made = [] {
    std::vector<DVec3> all(size_t(6) * EnvironmentCells::kSide * EnvironmentCells::kSide);
    for (size_t i = 0; i < all.size(); ++i) all[i] = EnvironmentCells::cellDirection(i);
    return all;
  }();
  return made;
}

SmoothedMap smoothedCells(const EnvironmentCells& cells, const TaskArena& arena, const StopToken& stop) {
  const SmoothingWeights& table = smoothingWeights();
  const size_t count = cells.cells.size();
  std::vector<double> weight(count + kLane), angle(count + kLane);  // padding reads on
  for (size_t i = 0; i < count; ++i) {
    weight[i] = cells.cells[i].weight;
    angle[i] = cells.cells[i].solidAngle;
  }
  SmoothedMap out;
  out.value.resize(table.firstRun.size() - 1);
  out.within.resize(out.value.size());
  const bool complete = arena.parallelFor(
      out.value.size(), 512,
      [&](size_t begin, size_t end) {
        for (size_t v = begin; v < end; ++v) {
          double light[kLane] = {}, all[kLane] = {}, flux[kLane] = {};
          const float* g = table.weights.data() + table.firstWeight[v];
          for (uint32_t r = table.firstRun[v]; r < table.firstRun[v + 1]; ++r) {
            const double* w = weight.data() + table.runs[r].cell;
            const double* a = angle.data() + table.runs[r].cell;
            for (size_t i = 0; i < table.runs[r].count; i += kLane, g += kLane)
              for (size_t k = 0; k < kLane; ++k) {
                light[k] += double(g[k]) * w[i + k];
                all[k] += double(g[k]) * a[i + k];
                flux[k] += w[i + k];
              }
          }
          const double total = (all[0] + all[1]) + (all[2] + all[3]);
          out.value[v] = total > 0 ? ((light[0] + light[1]) + (light[2] + light[3])) / total : 0.0;
          out.within[v] = (flux[0] + flux[1]) + (flux[2] + flux[3]);
        }
      },
      stop);
  return complete ? out : SmoothedMap();
}

namespace {

constexpr int kBlock = 4;
struct BlockWeight {
  uint32_t block;
  float weight;
};
/// By vertex.
const std::vector<std::vector<BlockWeight>>& blockWeights() {
  static const std::vector<std::vector<BlockWeight>> made = [] {
    constexpr int n = EnvironmentCells::kSide / kBlock;
    const Icosphere& sphere = icosphere(kBroadLevel);
    std::vector<std::vector<BlockWeight>> out(sphere.vertices.size());
    for (uint32_t b = 0; b < 6 * n * n; ++b) {
      const DVec3 d = EnvironmentCells::direction(int(b) / (n * n), (2.0 * (b % n) + 1) / n - 1, (2.0 * (b / n % n) + 1) / n - 1);
      for (size_t v = 0; v < out.size(); ++v)
        if (const double cosine = glm::dot(d, sphere.vertices[v]); cosine >= std::cos(kBroadSupport))
          out[v].push_back({b, float(std::exp((cosine - 1) / (kBroad * kBroad)))});
    }
    return out;
  }();
  return made;
}

}  // namespace

SmoothedMap smoothedBlocks(const EnvironmentCells& cells, const std::vector<double>& left) {
  constexpr size_t n = EnvironmentCells::kSide, blocks = n / kBlock;
  std::vector<double> weight(6 * blocks * blocks), angle(weight.size());
  for (size_t i = 0; i < cells.cells.size(); ++i) {
    const size_t block = (i / (n * n) * blocks + i / n % n / kBlock) * blocks + i % n / kBlock;
    weight[block] += left[i] * cells.cells[i].weight;
    angle[block] += cells.cells[i].solidAngle;
  }
  SmoothedMap out;
  for (const std::vector<BlockWeight>& about : blockWeights()) {
    double light = 0, all = 0, flux = 0;
    for (const BlockWeight& b : about) {
      light += double(b.weight) * weight[b.block];
      all += double(b.weight) * angle[b.block];
      flux += weight[b.block];
    }
    out.value.push_back(all > 0 ? light / all : 0.0);
    out.within.push_back(flux);
  }
  return out;
}

std::vector<int> climbed(const std::vector<double>& value, const Icosphere& sphere) {
  std::vector<int> root(value.size());
  for (size_t v = 0; v < value.size(); ++v) {
    root[v] = int(v);
    for (const int n : sphere.neighbours[v])
      if (n >= 0 && (value[size_t(n)] > value[size_t(root[v])] || (value[size_t(n)] == value[size_t(root[v])] && n < root[v]))) root[v] = n;
  }
  for (int& r : root)
    while (root[size_t(r)] != r) r = root[size_t(r)];
  return root;
}

}  // namespace gobo::transfer
