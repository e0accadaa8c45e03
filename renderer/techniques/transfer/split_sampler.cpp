// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/split_sampler.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "terms/environment_cells.h"

namespace gobo::transfer {

namespace {

constexpr size_t kSide = EnvironmentCells::kSide, kCells = 6 * kSide * kSide;
/// Of the chance is spread evenly over the sphere: a texel's tent reaches over the border of the cell that has its flux.
constexpr double kEven = 0.02;
/// A light's radius is that of an even disk with its second moment: of a lamp with a soft rim a part lies beside it, as the tents of a sun's last texels do.
/// What is missed by the disks is found by the even share alone, with weights that no number of samples settles.
constexpr double kWider = 1.4;

struct Place {
  size_t cell;
  double perSolidAngle;  // of what is even in the cell's own coordinates
};
Place placeOf(const DVec3& d) {
  const int face = EnvironmentCells::faceOf(d);
  double x = 0, y = 0;
  EnvironmentCells::project(face, d, x, y);
  const auto index = [](double t) { return size_t(std::clamp(int((t + 1) * 0.5 * double(kSide)), 0, int(kSide) - 1)); };
  const double r2 = 1 + x * x + y * y;
  return {(size_t(face) * kSide + index(y)) * kSide + index(x), 0.25 * double(kSide) * double(kSide) * r2 * std::sqrt(r2)};
}

}  // namespace

SplitSampler::SplitSampler(const EnvironmentSplit& split, const Environment& map) {
  const EnvironmentCells cells(map);
  double all = cells.weight;
  if (!(all > 0)) return;
  const double texel = std::numbers::pi / std::max(map.height, 1);
  for (const SkyDisk& light : split.lights) {
    const double chance = (1 - kEven) * luminanceOf(light.flux) / all, cosine = std::cos(std::min(kWider * light.radius + texel, std::numbers::pi));
    if (!(chance > 0)) continue;
    disks_.push_back({light.direction, cosine, chance, 2 * std::numbers::pi * (1 - cosine)});
    inDisks_ += chance;
  }
  cells_.resize(kCells);
  double sum = 0;
  for (size_t i = 0; i < kCells; ++i) cells_[i] = sum += cells.cells[i].weight * (split.left.empty() ? 1.0 : split.left[i]);
  if (!(sum > 0)) sum = 1.0;  // nothing is left
  const double rest = std::max(1 - kEven - inDisks_, 0.0);
  for (double& c : cells_) c *= rest / sum;
}

bool SplitSampler::sample(const Vec2& u, DVec3& direction, double& density) const {
  if (cells_.empty()) return false;
  double x = double(u.x);
  for (const Disk& disk : disks_) {
    if (x < disk.chance) {
      const double cosine = 1 - std::min(x / disk.chance, 1 - 1e-9) * (1 - disk.cosine), sine = std::sqrt(std::max(1 - cosine * cosine, 0.0)),
                   around = 2 * std::numbers::pi * double(u.y);
      // In double, or directions at the rim of a small sun would lie beside it by density()'s word.
      const DVec3 right = glm::normalize(glm::cross(std::fabs(disk.direction.y) < 0.9 ? DVec3(0, 1, 0) : DVec3(1, 0, 0), disk.direction));
      direction = glm::normalize(cosine * disk.direction + sine * (std::cos(around) * right + std::sin(around) * glm::cross(disk.direction, right)));
      density = this->density(direction);
      return density > 0;
    }
    x -= disk.chance;
  }
  if (x < cells_.back()) {
    const size_t cell = size_t(std::upper_bound(cells_.begin(), cells_.end(), x) - cells_.begin());
    const double before = cell > 0 ? cells_[cell - 1] : 0.0, across = (x - before) / (cells_[cell] - before);
    const auto at = [](size_t index, double part) { return 2 * (double(index) + part) / double(kSide) - 1; };
    direction = EnvironmentCells::direction(int(cell / (kSide * kSide)), at(cell % kSide, across), at(cell / kSide % kSide, double(u.y)));
  } else {
    const double y = 1 - 2 * std::clamp((x - cells_.back()) / kEven, 0.0, 1.0), r = std::sqrt(std::max(1 - y * y, 0.0)),
                 around = 2 * std::numbers::pi * double(u.y);
    direction = DVec3(r * std::cos(around), y, r * std::sin(around));
  }
  density = this->density(direction);
  return density > 0;
}

double SplitSampler::density(const DVec3& direction) const {
  if (cells_.empty()) return 0;
  const Place place = placeOf(direction);
  double sum = kEven / (4 * std::numbers::pi) + (cells_[place.cell] - (place.cell > 0 ? cells_[place.cell - 1] : 0.0)) * place.perSolidAngle;
  for (const Disk& disk : disks_)
    if (glm::dot(direction, disk.direction) >= disk.cosine) sum += disk.chance / disk.solidAngle;
  return sum;
}

}  // namespace gobo::transfer
