// SPDX-License-Identifier: Apache-2.0
// The emission profile of a point or spot light where the light stands: its value by direction, directions drawn by it, its flux.
// Directions go away from the light, in world space. Immutable; any thread. Look-up: 20 ns (pictures), 40 ns (tables by angle).
#pragma once

#include <vector>

#include "scene/camera.h"
#include "scene/light.h"
#include "scene/light_profile.h"
#include "trace/alias_table.h"

namespace gobo {
inline namespace trace {

class EmissionProfile {
 public:
  /// `light`: hasProfile(); `profile` is its own.
  EmissionProfile(const LightShape& light, LightProfilePtr profile);
  /// Factor on the intensity. A spot's falloff between its cones is no part of it.
  Vec3 at(const Vec3& direction) const;

 private:
  friend class ProfileDistribution;
  /// Of pictures: tangents of the half angles under which they stand. A cone of nearly 90 degrees has them end at 89.9.
  static Vec2 halfSize(const LightShape& light, const LightProfile& profile);
  Frame frame_;
  LightProfilePtr profile_;
  Vec2 half_{1.0f};
};

/// Directions with a density that is constant over cells (pictures: of the plane at distance 1; tables: of solid angle), nearly in proportion to
/// the profile's luminance times the spot's falloff, and 0 only where one of them is. Building: O(values).
class ProfileDistribution {
 public:
  ProfileDistribution(const LightShape& light, LightProfilePtr profile);
  /// False where the profile is black all over. pick, u in [0,1). density: per solid angle.
  bool sample(float pick, const Vec2& u, Vec3& direction, double& density) const;
  double density(const Vec3& direction) const;
  /// About the integral of luminance and falloff over solid angle; 0 only where all is black.
  double flux() const { return total_; }
  /// Of the uniform light that is as concentrated: of cells of weight w and solid angle o, (sum w)^2 / sum(w^2 / o).
  double solidAngle() const { return solidAngle_; }

 private:
  struct Cell {
    float x0, x1, y0, y1;  // pictures: of the plane at distance 1, right and down; tables: horizontal and vertical angles
    double density;        // pictures: by area of that plane; tables: by solid angle
  };
  void addPicture(const LightShape& light);
  void addTable(const LightShape& light);
  EmissionProfile placed_;
  std::vector<float> columns_, rows_;  // borders of cells
  std::vector<Cell> cells_;            // row-major
  std::vector<double> weights_, solidAngles_;
  AliasTable table_;
  double total_ = 0, solidAngle_ = 0;
};

/// Integral of the profile's luminance times the spot's falloff over solid angle, sr: what intensity 1 sends in watts. Exact for tables at points.
double profileFlux(const LightShape& light, const LightProfile& profile);

}  // namespace trace
}  // namespace gobo
