// SPDX-License-Identifier: Apache-2.0
#include "trace/emission_profile.h"

#include <algorithm>
#include <numbers>

#include "base/check.h"
#include "scene/light_axes.h"
#include "trace/spot_falloff.h"

namespace gobo {
inline namespace trace {
namespace {

constexpr int kMostProfileCells = 256, kFewestProfileCells = 16;  // of a picture, by axis
constexpr double kWidestCell = 3.0 * std::numbers::pi / 180;      // of a table, by vertical angle

/// Of the rectangle [x0, x1] x [y0, y1] on the plane at distance 1.
double rectangleSolidAngle(double x0, double x1, double y0, double y1) {
  const auto corner = [](double x, double y) { return std::atan2(x * y, std::sqrt(1.0 + x * x + y * y)); };
  return std::max(corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0), 0.0);
}

/// Of a band of one radian around the axis: cos(from) - cos(to), without cancellation.
double bandSolidAngle(double from, double to) { return 2.0 * std::sin(0.5 * (from + to)) * std::sin(0.5 * (to - from)); }

/// Vertical angles of a table with steps of at most `widest` between.
std::vector<float> verticalSteps(const LightProfile& p, double widest) {
  std::vector<float> out{p.vertical.front()};
  for (size_t i = 1; i < p.vertical.size(); ++i) {
    const double from = p.vertical[i - 1], to = p.vertical[i];
    const int n = std::max(1, int(std::ceil((to - from) / widest)));
    for (int k = 1; k < n; ++k)
      if (const float at = float(from + (to - from) * k / n); at > out.back() && at < float(to)) out.push_back(at);
    out.push_back(float(to));
  }
  return out;
}

/// Cell of ascending borders that holds x; -1 outside.
int cellOf(const std::vector<float>& borders, double x) {
  if (!(x >= borders.front() && x <= borders.back())) return -1;
  const auto at = std::upper_bound(borders.begin(), borders.end(), x, [](double value, float border) { return value < double(border); });
  return std::min(int(at - borders.begin()), int(borders.size()) - 1) - 1;
}

float falloffOf(const LightShape& light, double cosine) { return light.kind == LightKind::Spot ? spotFalloff(light, float(cosine)) : 1.0f; }

/// Mean luminance of the texels that take part in look-ups within [from, to] of each axis, in texels.
double meanTexel(const LightProfile& p, double x0, double x1, double y0, double y1) {
  const int left = std::clamp(int(std::floor(x0 - 0.5)), 0, p.width - 1), right = std::clamp(int(std::floor(x1 - 0.5)) + 1, 0, p.width - 1),
            top = std::clamp(int(std::floor(y0 - 0.5)), 0, p.height - 1), bottom = std::clamp(int(std::floor(y1 - 0.5)) + 1, 0, p.height - 1);
  double sum = 0;
  for (int y = top; y <= bottom; ++y)
    for (int x = left; x <= right; ++x) sum += double(luminance(p.values[size_t(y) * size_t(p.width) + size_t(x)]));
  return sum / (double(right - left + 1) * double(bottom - top + 1));
}

}  // namespace

Vec2 EmissionProfile::halfSize(const LightShape& light, const LightProfile& p) {
  const double c = std::max(double(light.cosOuter), 1.7e-3), tangent = std::sqrt(std::max(1.0 - c * c, 1e-14)) / c, side = std::min(p.width, p.height);
  return Vec2(float(tangent * p.width / side), float(tangent * p.height / side));
}

EmissionProfile::EmissionProfile(const LightShape& light, LightProfilePtr profile) : frame_(profileFrame(light)), profile_(std::move(profile)) {
  GOBO_CHECK(hasProfile(light) && profile_);
  if (profile_->kind == ProfileKind::Picture) half_ = halfSize(light, *profile_);
}

Vec3 EmissionProfile::at(const Vec3& direction) const {
  const Vec3 d = frame_.toLocal(direction);
  if (profile_->kind == ProfileKind::Picture) {
    if (!(d.z > 0.0f)) return Vec3(0.0f);
    return pictureAt(*profile_, Vec2(0.5f + 0.5f * d.x / (d.z * half_.x), 0.5f + 0.5f * d.y / (d.z * half_.y)));
  }
  const double across = std::sqrt(double(d.x) * d.x + double(d.y) * d.y);
  return photometryAt(*profile_, std::atan2(across, double(d.z)), across > 0.0 ? std::atan2(-double(d.y), double(d.x)) : 0.0);
}

ProfileDistribution::ProfileDistribution(const LightShape& light, LightProfilePtr profile) : placed_(light, std::move(profile)) {
  if (placed_.profile_->kind == ProfileKind::Picture) addPicture(light);
  else addTable(light);
  double squares = 0;
  for (size_t i = 0; i < weights_.size(); ++i) {
    total_ += weights_[i];
    if (solidAngles_[i] > 0.0) squares += weights_[i] * weights_[i] / solidAngles_[i];
  }
  if (!(total_ > 0.0)) return;
  solidAngle_ = total_ * total_ / squares;
  table_ = AliasTable(weights_);
  for (size_t i = 0; i < cells_.size(); ++i) cells_[i].density *= weights_[i] / total_;
  weights_ = solidAngles_ = {};
}

void ProfileDistribution::addPicture(const LightShape& light) {
  const LightProfile& p = *placed_.profile_;
  const Vec2 half = placed_.half_;
  const int nx = std::clamp(p.width, kFewestProfileCells, kMostProfileCells), ny = std::clamp(p.height, kFewestProfileCells, kMostProfileCells);
  for (int x = 0; x <= nx; ++x) columns_.push_back(half.x * (2.0f * float(x) / float(nx) - 1.0f));
  for (int y = 0; y <= ny; ++y) rows_.push_back(half.y * (2.0f * float(y) / float(ny) - 1.0f));
  for (int y = 0; y < ny; ++y)
    for (int x = 0; x < nx; ++x) {
      const Cell c{columns_[size_t(x)], columns_[size_t(x) + 1], rows_[size_t(y)], rows_[size_t(y) + 1],
                   1.0 / (double(columns_[size_t(x) + 1] - columns_[size_t(x)]) * double(rows_[size_t(y) + 1] - rows_[size_t(y)]))};
      // Falloff is largest where the cell is nearest to the axis.
      const double nearX = std::clamp(0.0, double(c.x0), double(c.x1)), nearY = std::clamp(0.0, double(c.y0), double(c.y1));
      const double falloff = falloffOf(light, 1.0 / std::sqrt(1.0 + nearX * nearX + nearY * nearY));
      const double mean =
          falloff > 0.0 ? meanTexel(p, double(x) * p.width / nx, (x + 1.0) * p.width / nx, double(y) * p.height / ny, (y + 1.0) * p.height / ny) : 0.0;
      cells_.push_back(c);
      solidAngles_.push_back(rectangleSolidAngle(c.x0, c.x1, c.y0, c.y1));
      weights_.push_back(mean * falloff * solidAngles_.back());
    }
}

void ProfileDistribution::addTable(const LightShape& light) {
  const LightProfile& p = *placed_.profile_;
  rows_ = verticalSteps(p, kWidestCell);
  columns_ = p.width > 1 ? std::vector<float>(p.horizontal.begin(), p.horizontal.end()) : std::vector<float>{0.0f, 2.0f * kPi};
  columns_.back() = 2.0f * kPi;
  const auto at = [&](size_t row, size_t column) { return double(luminance(photometryAt(p, rows_[row], columns_[column]))); };
  for (size_t y = 0; y + 1 < rows_.size(); ++y)
    for (size_t x = 0; x + 1 < columns_.size(); ++x) {
      const double solid = bandSolidAngle(rows_[y], rows_[y + 1]) * (double(columns_[x + 1]) - double(columns_[x]));
      cells_.push_back({columns_[x], columns_[x + 1], rows_[y], rows_[y + 1], solid > 0.0 ? 1.0 / solid : 0.0});
      solidAngles_.push_back(solid);
      weights_.push_back(0.25 * (at(y, x) + at(y, x + 1) + at(y + 1, x) + at(y + 1, x + 1)) * falloffOf(light, std::cos(double(rows_[y]))) * solid);
    }
}

bool ProfileDistribution::sample(float pick, const Vec2& u, Vec3& direction, double& density) const {
  if (table_.empty()) return false;
  const Cell& c = cells_[table_.sample(pick)];
  Vec3 d;
  if (placed_.profile_->kind == ProfileKind::Picture) {
    const double x = double(c.x0) + (double(c.x1) - double(c.x0)) * double(u.x), y = double(c.y0) + (double(c.y1) - double(c.y0)) * double(u.y);
    const double length = std::sqrt(1.0 + x * x + y * y);
    d = Vec3(float(x / length), float(y / length), float(1.0 / length));
    density = c.density * length * length * length;
  } else {
    const auto gap = [](double angle) { return 2.0 * sqr(std::sin(0.5 * angle)); };  // 1 - cosine
    const double from = gap(c.y0), g = from + (gap(c.y1) - from) * double(u.x), z = 1.0 - g, r = std::sqrt(std::max(g * (2.0 - g), 0.0));
    const double phi = double(c.x0) + (double(c.x1) - double(c.x0)) * double(u.y);
    d = Vec3(float(r * std::cos(phi)), float(-r * std::sin(phi)), float(z));
    density = c.density;
  }
  direction = glm::normalize(placed_.frame_.toWorld(d));
  return density > 0.0;
}

double ProfileDistribution::density(const Vec3& direction) const {
  if (table_.empty()) return 0.0;
  const Vec3 d = placed_.frame_.toLocal(direction);
  const double across = std::sqrt(double(d.x) * d.x + double(d.y) * d.y);
  int x, y;
  double scale = 1.0;
  if (placed_.profile_->kind == ProfileKind::Picture) {
    if (!(d.z > 0.0f)) return 0.0;
    x = cellOf(columns_, double(d.x) / d.z);
    y = cellOf(rows_, double(d.y) / d.z);
    scale = 1.0 / (double(d.z) * d.z * d.z);
  } else {
    double phi = across > 0.0 ? std::atan2(-double(d.y), double(d.x)) : 0.0;
    if (phi < 0.0) phi += 2.0 * std::numbers::pi;
    x = cellOf(columns_, phi);
    y = cellOf(rows_, std::atan2(across, double(d.z)));
  }
  return x < 0 || y < 0 ? 0.0 : cells_[size_t(y) * (columns_.size() - 1) + size_t(x)].density * scale;
}

double profileFlux(const LightShape& light, const LightProfile& p) {
  double sum = 0;
  if (p.kind == ProfileKind::Picture) {
    // Rings of the cone's disk on the plane at distance 1, equal in the cosine.
    constexpr int kRings = 64, kSteps = 128;
    LightShape straight;  // axis and right do not matter to the integral
    straight.kind = LightKind::Spot;
    straight.cosOuter = light.cosOuter;
    straight.profile = 0;
    const double gap = 1.0 - std::max(double(light.cosOuter), 1.7e-3);
    const EmissionProfile placed(straight, LightProfilePtr(LightProfilePtr(), &p));
    const Frame frame = profileFrame(straight);
    for (int i = 0; i < kRings; ++i) {
      const double c = 1.0 - gap * (i + 0.5) / kRings, r = std::sqrt(1.0 - c * c), falloff = falloffOf(light, c);
      for (int k = 0; k < kSteps; ++k) {
        const double phi = 2.0 * std::numbers::pi * (k + 0.5) / kSteps;
        sum += falloff * double(luminance(placed.at(frame.toWorld(Vec3(float(r * std::cos(phi)), float(r * std::sin(phi)), float(c))))));
      }
    }
    return sum * gap * 2.0 * std::numbers::pi / (double(kRings) * kSteps);
  }
  const std::vector<float> rows = verticalSteps(p, std::numbers::pi / 360);
  std::vector<double> mean(rows.size(), 0.0);  // round the axis
  for (size_t y = 0; y < rows.size(); ++y) {
    if (p.width == 1) mean[y] = double(luminance(photometryAt(p, rows[y], 0.0)));
    for (size_t x = 0; x + 1 < size_t(p.width); ++x)
      mean[y] += 0.5 * double(luminance(photometryAt(p, rows[y], p.horizontal[x])) + luminance(photometryAt(p, rows[y], p.horizontal[x + 1]))) *
                 (double(p.horizontal[x + 1]) - double(p.horizontal[x])) / (2.0 * std::numbers::pi);
  }
  for (size_t y = 0; y + 1 < rows.size(); ++y) {
    const double from = rows[y], to = rows[y + 1], slope = (mean[y + 1] - mean[y]) / (to - from);
    // The integral of a + b t with sin t.
    const double ring = mean[y] * std::cos(from) - mean[y + 1] * std::cos(to) + slope * (std::sin(to) - std::sin(from));
    sum += ring * falloffOf(light, std::cos(0.5 * (from + to)));
  }
  return 2.0 * std::numbers::pi * sum;
}

}  // namespace trace
}  // namespace gobo
