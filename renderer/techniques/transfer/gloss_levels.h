// SPDX-License-Identifier: Apache-2.0
// A map without its lights, prefiltered for the specular lobes of some roughnesses (Kautz, Vazquez, Heidrich, Seidel 2000; the lobe of GGX seen from its own
// mirror direction, as Karis 2013 has it: elongated highlights at grazing angles are what it leaves out). Lat-long, map axes.
#pragma once

#include <array>
#include <span>
#include <utility>
#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/environment.h"

namespace gobo::transfer {

struct GlossLevel {
  const char* plane;  ///< of the term
  float roughness;    ///< 0: the map itself
  int width, height, sourceWidth;
};
/// Sharper than the first but one there is the map itself, in texels of 0.7 degrees.
inline constexpr std::array<GlossLevel, 6> kGlossLevels{{
    {"level0", 0.0f, 512, 256, 0},
    {"level1", 0.1f, 256, 128, 256},
    {"level2", 0.2f, 128, 64, 128},
    {"level3", 0.35f, 64, 32, 64},
    {"level4", 0.6f, 32, 16, 32},
    {"level5", 1.0f, 32, 16, 32},
}};

/// Level 0: means over the parts of the map's texels that lie in one of its own, each times what is `left` of its cell (terms/environment_cells.h); a coarser
/// map is looked up. `out`: width x height x 3. False: stopped.
bool sharpLevel(const Environment& map, std::span<const float> left, const TaskArena& arena, const StopToken& stop, std::span<float> out);
/// Level k > 0 from level 0. A constant map stays constant.
bool glossLevel(size_t k, std::span<const float> sharp, const TaskArena& arena, const StopToken& stop, std::span<float> out);

/// Levels for looking up: linear in roughness between two.
class GlossMap {
 public:
  /// `level(k)`: width x height x 3 floats.
  template <typename Level>
  GlossMap(Level&& level, float rotation) {
    for (size_t k = 0; k < kGlossLevels.size(); ++k) {
      const std::span<const float> from = level(k);
      std::vector<Vec3> texels(from.size() / 3);
      for (size_t i = 0; i < texels.size(); ++i) texels[i] = Vec3(from[3 * i], from[3 * i + 1], from[3 * i + 2]);
      maps_[k].width = kGlossLevels[k].width;
      maps_[k].height = kGlossLevels[k].height;
      maps_[k].rotation = rotation;
      const size_t width = size_t(kGlossLevels[k].width);
      for (size_t x = 0; x < width; ++x) {
        poles_[k][0] += texels[x] / float(width);
        poles_[k][1] += texels[texels.size() - width + x] / float(width);
      }
      maps_[k].texels = std::move(texels);
    }
  }
  /// Mean radiance in the lobe about a direction in the world.
  Vec3 at(const Vec3& direction, float roughness) const;

 private:
  Vec3 level(size_t k, const Vec3& direction) const;
  std::array<Environment, kGlossLevels.size()> maps_;
  std::array<std::array<Vec3, 2>, kGlossLevels.size()> poles_{};  // means of the rows about them: a look-up beyond the last row would depend on the azimuth
};

}  // namespace gobo::transfer
