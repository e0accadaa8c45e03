// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/spread.h"

#include <algorithm>
#include <cmath>

namespace gobo::pathdensity {

namespace {

/// in * G, RGB, nothing beyond the border. False: stopped.
bool gaussianSums(const std::vector<double>& in, int width, int height, const std::vector<double>& kernel, std::vector<double>& out, const TaskArena& arena,
                  const StopToken& stop) {
  const int reach = int(kernel.size()) - 1;
  std::vector<double> rows(in.size());
  out.assign(in.size(), 0.0);
  const bool complete = arena.parallelFor(
      size_t(height), 1,
      [&](size_t y, size_t) {
        const double* from = in.data() + 3 * y * size_t(width);
        double* to = rows.data() + 3 * y * size_t(width);
        for (int x = 0; x < width; ++x) {
          double sum[3] = {};
          for (int u = std::max(x - reach, 0); u <= std::min(x + reach, width - 1); ++u)
            for (int c = 0; c < 3; ++c) sum[c] += kernel[size_t(std::abs(u - x))] * from[3 * u + c];
          for (int c = 0; c < 3; ++c) to[3 * x + c] = sum[c];
        }
      },
      stop);
  return complete && arena.parallelFor(
                         size_t(height), 1,
                         [&](size_t y, size_t) {
                           double* to = out.data() + 3 * y * size_t(width);
                           for (int v = std::max(int(y) - reach, 0); v <= std::min(int(y) + reach, height - 1); ++v) {
                             const double w = kernel[size_t(std::abs(v - int(y)))];
                             const double* from = rows.data() + 3 * size_t(v) * size_t(width);
                             for (int i = 0; i < 3 * width; ++i) to[i] += w * from[i];
                           }
                         },
                         stop);
}

}  // namespace

bool spreadRejected(std::vector<double>& kept, std::vector<double>& rejected, int width, int height, double sigma, double most, const TaskArena& arena,
                    const StopToken& stop) {
  std::vector<double> kernel(size_t(std::ceil(3 * sigma)) + 1), around, share(kept.size()), back;
  for (size_t i = 0; i < kernel.size(); ++i) kernel[i] = std::exp(-0.5 * double(i * i) / (sigma * sigma));
  for (size_t i = 0; i < kept.size(); ++i) share[i] = std::abs(kept[i]);
  if (!gaussianSums(share, width, height, kernel, around, arena, stop)) return false;
  for (size_t i = 0; i < kept.size(); ++i) share[i] = around[i] > 0 ? rejected[i] / around[i] : 0.0;
  if (!gaussianSums(share, width, height, kernel, back, arena, stop)) return false;
  for (size_t i = 0; i < kept.size(); ++i) {
    const double more = std::abs(kept[i]) * std::clamp(back[i], -1.0, most);
    kept[i] += more;
    rejected[i] -= more;
  }
  return true;
}

}  // namespace gobo::pathdensity
