// SPDX-License-Identifier: Apache-2.0
#include "scene/light_profile.h"

#include <algorithm>
#include <numbers>

namespace gobo {
inline namespace scene {
namespace {

constexpr double kPi2 = 2.0 * std::numbers::pi;
constexpr float kAngleSlack = 1e-5f;  // degrees as radians in single precision

Status checkAngles(const Array<float>& angles, const char* name, int count, float lo, float hi) {
  const std::string field(name);
  if (angles.size() != size_t(count)) return invalidArgument(field + ": " + std::to_string(angles.size()) + " angles for " + std::to_string(count));
  for (size_t i = 0; i < angles.size(); ++i) {
    if (!(angles[i] >= lo - kAngleSlack && angles[i] <= hi + kAngleSlack))
      return invalidArgument(field + "/" + std::to_string(i) + ": angle " + std::to_string(angles[i]) + " is not within " + std::to_string(lo) + " .. " +
                             std::to_string(hi) + " radians");
    if (i > 0 && !(angles[i] > angles[i - 1]))
      return invalidArgument(field + "/" + std::to_string(i) + ": angle " + std::to_string(angles[i]) + " is not above the one before it");
  }
  return {};
}

/// Index of the interval of ascending `angles` that holds x, which lies within them, and how far in it x is.
size_t interval(const Array<float>& angles, double x, double& along) {
  const float* at = std::upper_bound(angles.begin(), angles.end(), x, [](double value, float angle) { return value < double(angle); });
  const size_t i = std::min(size_t(std::max<std::ptrdiff_t>(at - angles.begin(), 1)), angles.size() - 1) - 1;
  along = std::clamp((x - double(angles[i])) / (double(angles[i + 1]) - double(angles[i])), 0.0, 1.0);
  return i;
}

}  // namespace

Status checkProfileShape(const LightProfile& p) {
  const bool table = p.kind == ProfileKind::Photometry;
  if (p.width < 1 || p.height < 1 || p.width > kLargestProfileSide || p.height > kLargestProfileSide)
    return invalidArgument("size " + std::to_string(p.width) + " x " + std::to_string(p.height) + " is not within 1 .. " + std::to_string(kLargestProfileSide));
  if (p.values.size() != size_t(p.width) * size_t(p.height))
    return invalidArgument("values: " + std::to_string(p.values.size()) + " for " + std::to_string(p.width) + " x " + std::to_string(p.height));
  if (!table) return p.vertical.empty() && p.horizontal.empty() ? Status() : invalidArgument("a picture has no angles");
  if (p.height < 2) return invalidArgument("vertical: one angle spans nothing");
  GOBO_TRY(checkAngles(p.vertical, "vertical", p.height, 0.0f, kPi));
  GOBO_TRY(checkAngles(p.horizontal, "horizontal", p.width, 0.0f, 2.0f * kPi));
  if (p.horizontal[0] != 0.0f || (p.width > 1 && std::fabs(p.horizontal[size_t(p.width) - 1] - 2.0f * kPi) > kAngleSlack))
    return invalidArgument("horizontal: angles do not go from 0 to 2 pi");
  return {};
}

Status sealProfile(LightProfile& p) {
  GOBO_TRY(checkProfileShape(p));
  for (size_t i = 0; i < p.values.size(); ++i)
    for (int c = 0; c < 3; ++c)
      if (const float v = std::as_const(p.values)[i][c]; !(v >= 0.0f && v <= kLargestProfileValue))
        return invalidArgument("values/" + std::to_string(i) + ": " + std::to_string(v) + " is not within 0 .. 1e6");
  p.content = Hasher("light-profile").add(p.kind).add(p.width).add(p.height).addArray(p.values).addArray(p.vertical).addArray(p.horizontal).digest();
  return {};
}

size_t profileBytes(const LightProfile& p) { return p.values.size() * sizeof(Vec3) + (p.vertical.size() + p.horizontal.size()) * sizeof(float); }

Vec3 pictureAt(const LightProfile& p, const Vec2& uv) {
  if (!(uv.x >= 0.0f && uv.x <= 1.0f && uv.y >= 0.0f && uv.y <= 1.0f)) return Vec3(0.0f);
  const float x = uv.x * float(p.width) - 0.5f, y = uv.y * float(p.height) - 0.5f, fx = std::floor(x), fy = std::floor(y), ax = x - fx, ay = y - fy;
  const int x0 = std::max(int(fx), 0), x1 = std::min(int(fx) + 1, p.width - 1), y0 = std::max(int(fy), 0), y1 = std::min(int(fy) + 1, p.height - 1);
  const Vec3 *top = p.values.data() + size_t(y0) * size_t(p.width), *bottom = p.values.data() + size_t(y1) * size_t(p.width);
  return (top[x0] * (1.0f - ax) + top[x1] * ax) * (1.0f - ay) + (bottom[x0] * (1.0f - ax) + bottom[x1] * ax) * ay;
}

Vec3 photometryAt(const LightProfile& p, double vertical, double horizontal) {
  // A table that ends at 90 or 180 degrees ends there however its last angle was rounded.
  if (!(vertical >= double(p.vertical.front()) - 1e-6 && vertical <= double(p.vertical.back()) + 1e-6)) return Vec3(0.0f);
  double down = 0, round = 0;
  const size_t row = interval(p.vertical, vertical, down), width = size_t(p.width);
  size_t column = 0;
  if (width > 1) column = interval(p.horizontal, horizontal - kPi2 * std::floor(horizontal / kPi2), round);
  const Vec3 *a = p.values.data() + row * width + column, *b = a + width;
  const size_t next = width > 1 ? 1 : 0;
  const float s = float(round), t = float(down);
  return (a[0] * (1.0f - s) + a[next] * s) * (1.0f - t) + (b[0] * (1.0f - s) + b[next] * s) * t;
}

}  // namespace scene
}  // namespace gobo
