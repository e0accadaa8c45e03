// SPDX-License-Identifier: Apache-2.0
// Environment: radiance from infinity as a lat-long map. Top row is +Y; u = 0.5 + atan2(z, x) / (2 pi) in world axes when
// the rotation is 0; `rotation` turns the map about +Y (radians, counter-clockwise seen from above).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/array.h"
#include "base/hash.h"
#include "base/image.h"
#include "base/status.h"
#include "base/stop.h"
#include "base/vec.h"

namespace gobo {
inline namespace base {
class MappedFile;  // base/mapped_file.h
}
}  // namespace gobo

namespace gobo {
inline namespace scene {

struct Environment {
  std::string name;
  int width = 0, height = 0;
  Array<Vec3> texels;                                ///< linear radiance, row-major, all finite and >= 0
  float rotation = 0.0f;                             ///< radians
  int repairedTexels = 0;                            ///< NaN, Inf or negative texels replaced by 0 at load (reported by inspect)
  Hash128 content;                                   ///< digest of size and texels (not of rotation)
  std::shared_ptr<const MappedFile> file = nullptr;  ///< that the texels lie in; null: none, or the scene's

  /// Direction (unit) to continuous map coordinates in [0,1)^2, and back. Rotation applied.
  Vec2 toUv(const Vec3& direction) const;
  Vec3 toDirection(const Vec2& uv) const;
  /// Radiance from a direction, bilinear between texel centres (environment_tents.h); the samplers' density is that, whatever the contrast.
  Vec3 eval(const Vec3& direction) const;
};
using EnvironmentPtr = std::shared_ptr<const Environment>;

/// Repairs NaN/Inf/negative texels (counted), computes the digest. Null if `stop` fired first.
EnvironmentPtr makeEnvironment(std::string name, Image image, const StopToken& stop = {});
/// Any picture in memory: lat-long, or a cube map (environment_cube.h), which is resampled to lat-long. The colours of PNG and JPEG are sRGB code values, those
/// of everything else linear radiance. `name` is used in errors and to guess the format. Errors name the file; Cancelled soon after `stop`.
Result<EnvironmentPtr> readEnvironment(const uint8_t* bytes, size_t size, const std::string& name, const StopToken& stop = {});
/// The same from a file.
Result<EnvironmentPtr> loadEnvironment(const std::string& path, const StopToken& stop = {});
/// What `content` must be.
Hash128 environmentDigest(const Environment& map);
/// Uniform radiance in every direction (1x1 map).
EnvironmentPtr constantEnvironment(const Vec3& radiance);

struct SkyParameters {
  Vec3 sunDirection{0.4f, 0.8f, 0.3f};
  float turbidity = 3.0f;
  float sunRadiusDeg = 0.2665f;
  float sunScale = 1.0f;
  Vec3 groundAlbedo{0.2f};
};
/// Analytic clear sky with sun disk (Preetham et al. 1999), baked to width x width/2. Radiance scaled so that the zenith is of order 1.
/// Null if `stop`, polled every row, fired first.
EnvironmentPtr skyEnvironment(const SkyParameters& parameters, int width = 512, const StopToken& stop = {});

}  // namespace scene
}  // namespace gobo
