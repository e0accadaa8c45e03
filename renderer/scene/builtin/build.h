// SPDX-License-Identifier: Apache-2.0
// Tools that the procedural scenes share: shapes into meshes, textures from functions, and scene assembly.
// Everything is a pure function of its arguments (hash-based noise), so a scene has the same digest on every machine.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "base/stop.h"
#include "scene/scene.h"

namespace gobo::builtin {

Mat4 translate(const Vec3& t);
Mat4 scale(const Vec3& s);
Mat4 rotateY(float radians);  ///< counter-clockwise seen from above
Mat4 rotate(const Vec3& axis, float radians);
Vec3 random3(uint64_t seed, uint64_t index);  ///< [0,1)^3

/// Periodic value noise over [0,1)^2 with `cells` cells a side, in [0,1]; and a sum of `octaves` of it.
float noise(float u, float v, int cells, uint32_t seed);
float fractalNoise(float u, float v, int cells, int octaves, uint32_t seed);

class MeshBuilder {
 public:
  uint32_t vertex(const Vec3& p, const Vec3& n, const Vec2& uv);
  void triangle(uint32_t a, uint32_t b, uint32_t c);
  /// Parallelogram corner + s eu + t ev, s,t in [0,1], facing cross(eu, ev); nu x nv cells; uv spans uvScale.
  void quad(const Vec3& corner, const Vec3& eu, const Vec3& ev, int nu = 1, int nv = 1, const Vec2& uvScale = Vec2(1.0f));
  /// Box centre +- half, turned by `frame`; 12 triangles; uv in metres times uvPerMetre.
  void box(const Vec3& centre, const Vec3& half, const Mat4& frame = Mat4(1.0f), float uvPerMetre = 1.0f);
  void sphere(const Vec3& centre, float radius, int slices, int stacks);
  /// Surface of revolution about the vertical through `base`; profile (radius, height) from bottom to top, smooth normals.
  void lathe(const Vec3& base, const std::vector<Vec2>& profile, int slices, float uvPerMetre = 1.0f);
  /// Round tube along `path`, closed at the end where the last radius is 0 by construction of the path.
  void tube(const std::vector<Vec3>& path, const std::vector<float>& radii, int slices);
  /// Seals; `smooth` false drops the normals (flat shading).
  MeshPtr finish(std::string name, int material, bool smooth = true);

 private:
  Mesh mesh_;
};

class SceneBuilder {
 public:
  /// `stop` is polled every row of a texture; finish() says Cancelled then.
  explicit SceneBuilder(std::string name, const StopToken& stop = {});
  Scene& scene() { return *scene_; }
  /// A diffuse material: exact Lambert (specular 0) unless a roughness below 1 is given with specular > 0.
  int material(std::string name, const Vec3& albedo, float roughness = 1.0f, float metallic = 0.0f, float specular = 0.0f);
  Material& at(int material) { return scene_->materials[material]; }
  /// width x height texture from f(u, v) (linear values in 0..1, texel centres), stored as 8 bits.
  TextureRef texture(std::string name, int width, int height, bool srgb, const std::function<Vec4(float, float)>& f);
  /// Tangent-space normal map of a periodic height field (metres) whose tile is `size` metres wide.
  TextureRef normalMap(std::string name, int width, float size, const std::function<float(float, float)>& height);
  int mesh(MeshBuilder& builder, std::string name, int material, bool smooth = true);
  void instance(std::string name, int mesh, const Mat4& toWorld = Mat4(1.0f));
  void add(std::string name, MeshBuilder& builder, int material, bool smooth = true);  ///< mesh + one instance
  void camera(std::string name, const Vec3& eye, const Vec3& target, float yfovDegrees);
  Light& rect(std::string name, const Vec3& centre, const Vec3& target, float halfU, float halfV, const Vec3& radiance);
  Light& disk(std::string name, const Vec3& centre, const Vec3& target, float radius, const Vec3& radiance);
  Light& ball(std::string name, const Vec3& centre, float radius, const Vec3& radiance);
  Light& point(std::string name, const Vec3& position, const Vec3& intensity);
  Light& spot(std::string name, const Vec3& position, const Vec3& target, float outerDegrees, const Vec3& intensity);
  Light& sun(std::string name, const Vec3& towardsSun, const Vec3& irradiance);
  void environment(EnvironmentPtr map, const Vec3& factor);  ///< map and its light "environment"
  Result<ScenePtr> finish();

 private:
  Light& light(std::string name, LightKind kind, const Vec3& position, const Vec3& power);
  std::shared_ptr<Scene> scene_;
  StopToken stop_;
};

Result<ScenePtr> cornell(const StopToken& stop);
Result<ScenePtr> furnace(const StopToken& stop);
Result<ScenePtr> grids(const StopToken& stop);
Result<ScenePtr> fence(const StopToken& stop);
Result<ScenePtr> tentacles(const StopToken& stop);
Result<ScenePtr> spheres(const StopToken& stop);
Result<ScenePtr> trees(const StopToken& stop);
Result<ScenePtr> lamps(const StopToken& stop);
Result<ScenePtr> atrium(const StopToken& stop);
Result<ScenePtr> lights8(const StopToken& stop);

}  // namespace gobo::builtin
