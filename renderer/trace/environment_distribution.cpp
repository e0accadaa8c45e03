// SPDX-License-Identifier: Apache-2.0
#include "trace/environment_distribution.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/small_angle.h"

namespace gobo {
inline namespace trace {
namespace {

double texelLuminance(const Vec3& c) { return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z; }

/// Index of the cell that holds x of inclusive prefix sums, and the place of x inside it in [0,1). Cells of weight zero are
/// never chosen because their sums repeat.
size_t locate(const double* sums, size_t n, double u, double& rest) {
  const double x = u * sums[n - 1];
  size_t i = 0;  // first sum above x; without branches, which would be mispredicted half of the time
  for (size_t length = n; length > 1;) {
    const size_t half = length / 2;
    i += sums[i + half - 1] <= x ? half : 0;
    length -= half;
  }
  if (!(sums[i] > x)) i = size_t(std::lower_bound(sums, sums + n, sums[n - 1]) - sums);  // rounding at the top end: last cell with weight
  const double low = i ? sums[i - 1] : 0.0;
  rest = std::clamp((x - low) / (sums[i] - low), 0.0, 1.0);
  return i;
}

}  // namespace

EnvironmentDistribution::EnvironmentDistribution(EnvironmentPtr map, const StopToken& stop) : map_(std::move(map)) {
  if (!map_) return;
  const size_t w = size_t(map_->width), h = size_t(map_->height);
  tents_.emplace(map_->width, map_->height);
  for (size_t x = 0; x < w; ++x) {
    const double azimuth = ((double(x) + 0.5) / double(w) - 0.5) * 2.0 * std::numbers::pi - double(map_->rotation);
    azimuths_.push_back({std::cos(azimuth), std::sin(azimuth)});
  }
  rows_.resize(h);
  columns_ = std::make_unique_for_overwrite<double[]>(w * h);
  for (size_t y = 0; y < h && !stop.stopRequested(); ++y) {
    double sum = 0;
    for (size_t x = 0; x < w; ++x) columns_[y * w + x] = sum += texelLuminance(map_->texels[y * w + x]);
    rows_[y] = total_ += sum * tents_->weight(int(y));
  }
}

bool EnvironmentDistribution::sample(const Vec2& u, Vec3& direction, Vec3& radiance, float& pdf) const {
  if (!(total_ > 0)) return false;
  const size_t w = size_t(map_->width), h = size_t(map_->height);
  double fy, fx;
  const size_t y = locate(rows_.data(), h, u.y, fy);
  const size_t x = locate(columns_.get() + y * w, w, u.x, fx);
  const auto [polar, sine, cosine] = tents_->polar(int(y), fy);
  const double offset = EnvironmentTents::across(fx), across = double(x) + 0.5 + offset;
  const SmallAngle turn(offset * tents_->azimuthStep());
  const Azimuth& centre = azimuths_[x];
  direction = Vec3(float(sine * (centre.cosine * turn.cosine - centre.sine * turn.sine)), float(cosine),
                   float(sine * (centre.sine * turn.cosine + centre.cosine * turn.sine)));
  radiance = interpolateTexels(*map_, across, polar / std::numbers::pi * double(h));
  pdf = float(texelLuminance(radiance) / total_);
  return pdf > 0.0f;
}

float EnvironmentDistribution::pdfOf(const Vec3& radiance) const { return total_ > 0 ? float(texelLuminance(radiance) / total_) : 0.0f; }

}  // namespace trace
}  // namespace gobo
