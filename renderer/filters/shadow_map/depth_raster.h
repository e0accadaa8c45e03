// SPDX-License-Identifier: Apache-2.0
// DepthRaster: linear planar depth of a light's view by scan conversion, the z-buffer (Catmull 1974) as an alternative to one ray a texel.
// The sample is the ray through the texel's centre: a texel is covered when its centre lies in the triangle, rims included, so shared
// edges leave no gap. Edge functions and depth are linear in homogeneous coordinates (Olano, Greer 1997, "Triangle scan conversion using
// 2D homogeneous coordinates"): triangles that pass the light's plane need no clipping. Set-up in double, spans in float; the nearest surface
// wins, which does not depend on order: the same bits for any number of threads.
// Cost: about 20 ns a triangle that covers no texel centre, 100 ns one that does, and one pass of 4 bytes over the map.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <vector>

#include "base/stop.h"
#include "base/task_arena.h"
#include "filters/shadow_map/light_frame.h"

namespace gobo {
inline namespace filters {

/// One instance's triangles. All pointers must outlive the raster.
struct RasterMesh {
  const uint32_t* indices = nullptr;  ///< 3 a triangle
  const Vec3* positions = nullptr;
  size_t triangles = 0;
  Mat4 toWorld{1.0f};
  bool alpha = false;  ///< may let light through: texels where it is nearest are left to rays
};

class DepthRaster {
 public:
  static constexpr int kBand = 32;  ///< rows that one task holds in its second-level cache

  DepthRaster(const LightFrame& frame, int resolution, std::span<const RasterMesh> meshes);
  int bands() const { return (resolution_ + kBand - 1) / kBand; }
  /// Sorts triangles into bands; false when stopped.
  bool sort(const TaskArena& arena, const StopToken& stop);
  /// Depth of the rows of band b into z (a map of resolution^2), in [0,1], 1 where nothing is hit. `open` becomes the texels (indices into z, ascending)
  /// that a ray must decide. After sort(); bands may run at the same time.
  void band(int b, float* z, std::vector<uint32_t>& open) const;

 private:
  struct Chunk {
    uint32_t mesh = 0, first = 0, count = 0;
    std::vector<uint32_t> start, triangles;  ///< those of band b: triangles[start[b]] .. triangles[start[b + 1] - 1]
  };
  /// x / w, y / w are texels with centres at whole numbers; z metric planar depth; w = z (perspective) or 1.
  struct Corner {
    double x, y, w, z;
  };
  struct Rows {
    double x[4], y[4], w[4], z[4];
  };
  struct Buffer;
  void corners(uint32_t mesh, uint32_t triangle, Corner (&v)[3]) const;
  bool rowsOf(const Corner (&v)[3], int& first, int& last) const;
  void sortChunk(Chunk& chunk) const;
  void triangle(const Corner (&v)[3], int y0, int y1, bool alpha, Buffer& buffer) const;

  LightFrame frame_;
  int resolution_;
  std::span<const RasterMesh> meshes_;
  std::vector<Rows> rows_;  // by mesh
  std::vector<Chunk> chunks_;
};

}  // namespace filters
}  // namespace gobo
