// SPDX-License-Identifier: Apache-2.0
#include "scene/environment_blur.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <list>
#include <mutex>

#include "scene/environment_tents.h"

namespace gobo {
inline namespace scene {

namespace {

/// Lat-long colours, a plane a channel, in double.
struct Grid {
  int width, height;
  std::vector<float> channel[3];
  Grid(int w, int h) : width(w), height(h) {
    for (auto& c : channel) c.assign(size_t(w) * size_t(h), 0.0f);
  }
  double polar(double row) const { return M_PI * row / height; }
  /// Solid angle of a texel of the row.
  double weight(int y) const { return (std::cos(polar(y)) - std::cos(polar(y + 1))) * 2.0 * M_PI / width; }
};

/// Between which two of `count` cell centres a position lies, and the second one's share.
struct Between {
  int first, second;
  double share;
};
Between around(double at, int count, bool wraps) {
  const double x = at - 0.5, low = std::floor(x);
  const int i = int(low);
  const auto cell = [&](int k) { return wraps ? (k % count + count) % count : std::clamp(k, 0, count - 1); };
  return {cell(i), cell(i + 1), x - low};
}

/// The map on a coarser grid, every texel dealt out to the cells around it by tents: where its light is stays what it was, which boxes would move
/// by up to half a cell.
Grid resampled(const Environment& map, int width, int height, const StopToken& stop) {
  const int W = std::max(map.width, 2 * width), H = std::max(map.height, 2 * height);
  const bool texels = W == map.width && H == map.height;
  std::vector<double> sums(size_t(width) * size_t(height) * 4, 0.0);  // colour, weight
  for (int y = 0; y < H && !stop.stopRequested(); ++y) {
    const double v = (y + 0.5) / H, solid = std::sin(M_PI * v);
    const Between rows = around(v * height, height, false);
    for (int x = 0; x < W; ++x) {
      const double u = (x + 0.5) / W;
      const DVec3 light(texels ? map.texels[size_t(y) * size_t(W) + size_t(x)] : interpolateTexels(map, u * map.width, v * map.height));
      const Between columns = around(u * width, width, true);
      for (int k = 0; k < 4; ++k) {
        const double weight = solid * (k & 1 ? columns.share : 1.0 - columns.share) * (k & 2 ? rows.share : 1.0 - rows.share);
        double* const to = sums.data() + 4 * (size_t(k & 2 ? rows.second : rows.first) * size_t(width) + size_t(k & 1 ? columns.second : columns.first));
        for (int c = 0; c < 3; ++c) to[c] += weight * light[c];
        to[3] += weight;
      }
    }
  }
  Grid out(width, height);
  for (size_t i = 0; i < size_t(width) * size_t(height); ++i)
    for (int c = 0; c < 3; ++c) out.channel[c][i] = float(sums[4 * i + size_t(c)] / sums[4 * i + 3]);
  return out;
}

/// Adds `weight` times the row `from`, turned by `shift`, to `to`.
void addTurned(const float* from, int width, int shift, float weight, float* to) {
  const int head = width - shift;
  for (int x = 0; x < head; ++x) to[x] += weight * from[x + shift];
  for (int x = head; x < width; ++x) to[x] += weight * from[x - head];
}

Grid convolved(const Grid& in, double sigma, const StopToken& stop) {
  const int W = in.width, H = in.height;
  Grid out(W, H);
  const double texel = M_PI / H;
  const double variance = sigma * sigma - texel * texel / 3.0;  // the tents of the grid and of its look-up blur as well
  const double reach = std::min(4.0 * sigma, M_PI);
  const int rows = int(std::ceil(reach / texel));
  struct Term {
    int row, shift;
    double weight;
  };
  std::vector<Term> terms;
  for (int y = 0; y < H && !stop.stopRequested(); ++y) {
    terms.clear();
    double all = 0.0;
    const double a = in.polar(y + 0.5);
    for (int r = std::max(0, y - rows); r <= std::min(H - 1, y + rows); ++r) {
      const double b = in.polar(r + 0.5), solid = in.weight(r);
      for (int shift = 0; shift < W; ++shift) {
        const double turn = 2.0 * M_PI * shift / W;
        const double cosine = std::cos(a) * std::cos(b) + std::sin(a) * std::sin(b) * std::cos(turn), angle = std::acos(std::clamp(cosine, -1.0, 1.0));
        if (angle > reach) continue;
        const double weight = solid * std::exp(-0.5 * angle * angle / variance);
        terms.push_back({r, shift, weight});
        all += weight;
      }
    }
    for (const Term& t : terms)  // weights that sum to 1: no sum is larger than the largest texel
      for (int k = 0; k < 3; ++k)
        addTurned(in.channel[k].data() + size_t(t.row) * size_t(W), W, t.shift, float(t.weight / all), out.channel[k].data() + size_t(y) * size_t(W));
  }
  return out;
}

struct Kept {
  Hash128 content;
  double sigma;
  EnvironmentPtr blurred;
};
constexpr size_t kKept = 4;  // of at most 6 MB each
std::mutex keptMutex;
std::list<Kept> kept;

EnvironmentPtr turned(const EnvironmentPtr& map, float rotation) {
  if (map->rotation == rotation) return map;
  auto out = std::make_shared<Environment>(*map);
  out->rotation = rotation;
  return out;
}

}  // namespace

EnvironmentPtr blurredEnvironment(const Environment& map, double sigma, const StopToken& stop) {
  {
    std::lock_guard lock(keptMutex);
    for (const Kept& k : kept)
      if (k.content == map.content && k.sigma == sigma) return turned(k.blurred, map.rotation);
  }
  const int width = std::clamp(2 * int(std::ceil(4.0 * M_PI / sigma)), 96, 1024), height = width / 2;
  const Grid grid = convolved(resampled(map, width, height, stop), sigma, stop);
  if (stop.stopRequested()) return nullptr;
  Image image(width, height, 3);
  for (size_t i = 0; i < image.pixels(); ++i)
    for (size_t k = 0; k < 3; ++k) image.data[3 * i + k] = std::min(grid.channel[k][i], std::numeric_limits<float>::max());
  const EnvironmentPtr blurred = makeEnvironment(map.name + " (blurred)", std::move(image), stop);
  if (!blurred) return nullptr;
  std::lock_guard lock(keptMutex);
  kept.push_front({map.content, sigma, blurred});
  if (kept.size() > kKept) kept.pop_back();
  return turned(blurred, map.rotation);
}

}  // namespace scene
}  // namespace gobo
