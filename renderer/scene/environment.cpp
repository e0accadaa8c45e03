// SPDX-License-Identifier: Apache-2.0
#include "scene/environment.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "base/check.h"
#include "base/image_io.h"
#include "base/srgb_values.h"
#include "base/utf8.h"
#include "scene/environment_cube.h"
#include "scene/environment_tents.h"

namespace gobo {
inline namespace scene {
namespace {

constexpr float kBelowOne = 0x1.fffffep-1f;

}  // namespace

Hash128 environmentDigest(const Environment& map) { return Hasher("environment").add(map.width).add(map.height).addArray(map.texels).digest(); }

// A counter-clockwise turn seen from above takes azimuth atan2(z, x) = a to a - rotation, so a world direction of azimuth
// `a` looks up the map at a + rotation. Both ways go through double: the pair are inverses to float rounding.
Vec2 Environment::toUv(const Vec3& d) const {
  const double x = d.x, y = d.y, z = d.z;
  double u = 0.5 + (std::atan2(z, x) + double(rotation)) / (2.0 * std::numbers::pi);
  u -= std::floor(u);
  const double v = std::atan2(std::sqrt(x * x + z * z), y) / std::numbers::pi;  // well conditioned at the poles, unlike acos(y)
  return Vec2(std::min(float(u), kBelowOne), std::min(float(v), kBelowOne));
}

Vec3 Environment::toDirection(const Vec2& uv) const {
  const double azimuth = (double(uv.x) - 0.5) * 2.0 * std::numbers::pi - double(rotation), polar = double(uv.y) * std::numbers::pi;
  const double s = std::sin(polar);
  return Vec3(float(s * std::cos(azimuth)), float(std::cos(polar)), float(s * std::sin(azimuth)));
}

Vec3 Environment::eval(const Vec3& direction) const {
  if (texels.size() == 1) return texels[0];  // uniform: two inverse functions saved for each ray that meets nothing
  const Vec2 uv = toUv(direction);
  return interpolateTexels(*this, double(uv.x) * width, double(uv.y) * height);
}

EnvironmentPtr makeEnvironment(std::string name, Image image, const StopToken& stop) {
  GOBO_CHECK_GT(image.width, 0);
  GOBO_CHECK_GT(image.height, 0);
  GOBO_CHECK_GT(image.channels, 0);
  auto map = std::make_shared<Environment>();
  map->name = std::move(name);
  map->width = image.width;
  map->height = image.height;
  std::vector<Vec3> texels;
  texels.reserve(image.pixels());  // not cleared first: hundreds of MB at once would be long without a poll
  for (int y = 0; y < image.height; ++y) {
    if (stop.stopRequested()) return nullptr;
    for (int x = 0; x < image.width; ++x) {
      Vec3 c = image.rgb(x, y);
      if (!isFinite(c) || c.x < 0.0f || c.y < 0.0f || c.z < 0.0f) {
        c = Vec3(0.0f);
        ++map->repairedTexels;
      }
      texels.push_back(c + Vec3(0.0f));  // -0 becomes +0: one digest per radiance
    }
  }
  map->texels = std::move(texels);
  map->content = environmentDigest(*map);
  return map;
}

Result<EnvironmentPtr> readEnvironment(const uint8_t* bytes, size_t size, const std::string& name, const StopToken& stop) {
  ReadLimits limits;
  limits.stop = stop;
  GOBO_ASSIGN(Image image, readImageFromMemory(bytes, size, name, limits));
  if (image.channels < 1) return invalidArgument("environment map has no channels", name);
  if (holdsSrgbValues(bytes, size) && !decodeSrgbValues(image, stop)) return Status(Code::Cancelled, "the reading was cancelled", name);
  const CubeLayout layout = cubeLayout(image, exrEnvironmentKind(bytes, size));
  if (layout != CubeLayout::None) image = latLongFromCube(image, layout, stop);
  EnvironmentPtr made = makeEnvironment(cleanUtf8(name.substr(name.find_last_of('/') + 1)), std::move(image), stop);
  if (!made) return Status(Code::Cancelled, "the reading was cancelled", name);
  return made;
}

Result<EnvironmentPtr> loadEnvironment(const std::string& path, const StopToken& stop) {
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, readFile(path, kMostFileBytes, stop));
  return readEnvironment(bytes.data(), bytes.size(), path, stop);
}

EnvironmentPtr constantEnvironment(const Vec3& radiance) {
  Image image(1, 1, 3);
  for (int c = 0; c < 3; ++c) image.data[c] = radiance[c];
  return makeEnvironment("constant", std::move(image));
}

}  // namespace scene
}  // namespace gobo
