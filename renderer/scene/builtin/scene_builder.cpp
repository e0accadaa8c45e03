// SPDX-License-Identifier: Apache-2.0
#include "base/transfer.h"
#include "scene/builtin/build.h"

namespace gobo::builtin {

SceneBuilder::SceneBuilder(std::string name, const StopToken& stop) : scene_(std::make_shared<Scene>()), stop_(stop) { scene_->name = std::move(name); }

int SceneBuilder::material(std::string name, const Vec3& albedo, float roughness, float metallic, float specular) {
  Material m;
  m.name = std::move(name);
  m.albedo.factor = albedo;
  m.bsdf.roughness = roughness;
  m.bsdf.metallic = metallic;
  m.bsdf.specular = specular;
  scene_->materials.push_back(std::move(m));
  return int(scene_->materials.size() - 1);
}

TextureRef SceneBuilder::texture(std::string name, int width, int height, bool srgb, const std::function<Vec4(float, float)>& f) {
  auto t = std::make_shared<Texture>();
  t->name = std::move(name);
  t->width = width;
  t->height = height;
  t->srgb = srgb;
  t->texels8.resize(size_t(width) * height * 4);
  for (int y = 0; y < height && !stop_.stopRequested(); ++y)
    for (int x = 0; x < width; ++x) {
      const Vec4 c = f((x + 0.5f) / width, (y + 0.5f) / height);
      for (int k = 0; k < 4; ++k) {
        double v = clamp01(c[k]);
        if (srgb && k < 3) v = encodeTransfer(Transfer::Srgb, v);
        t->texels8[(size_t(y) * width + x) * 4 + k] = uint8_t(v * 255.0 + 0.5);
      }
    }
  sealTexture(*t);
  scene_->textures.push_back(std::move(t));
  TextureRef ref;
  ref.texture = int(scene_->textures.size() - 1);
  return ref;
}

TextureRef SceneBuilder::normalMap(std::string name, int width, float size, const std::function<float(float, float)>& height) {
  std::vector<float> h(size_t(width) * width);
  for (int y = 0; y < width && !stop_.stopRequested(); ++y)
    for (int x = 0; x < width; ++x) h[size_t(y) * width + x] = height((x + 0.5f) / width, (y + 0.5f) / width);
  const float scale = 0.5f * width / size;
  return texture(std::move(name), width, width, false, [&](float u, float v) {
    const int x = std::min(int(u * width), width - 1), y = std::min(int(v * width), width - 1);
    auto at = [&](int i, int j) { return h[size_t((j + width) % width) * width + (i + width) % width]; };
    const float dx = (at(x + 1, y) - at(x - 1, y)) * scale, dy = (at(x, y - 1) - at(x, y + 1)) * scale;  // +y of the map is up
    return Vec4(glm::normalize(Vec3(-dx, -dy, 1.0f)) * 0.5f + Vec3(0.5f), 1.0f);
  });
}

int SceneBuilder::mesh(MeshBuilder& builder, std::string name, int material, bool smooth) {
  scene_->meshes.push_back(builder.finish(std::move(name), material, smooth));
  return int(scene_->meshes.size() - 1);
}

void SceneBuilder::instance(std::string name, int mesh, const Mat4& toWorld) { scene_->instances.push_back({std::move(name), mesh, toWorld}); }

void SceneBuilder::add(std::string name, MeshBuilder& builder, int material, bool smooth) {
  const int m = mesh(builder, name, material, smooth);
  instance(std::move(name), m);
}

void SceneBuilder::camera(std::string name, const Vec3& eye, const Vec3& target, float yfovDegrees) {
  Camera c;
  c.name = std::move(name);
  c.yfov = yfovDegrees * kPi / 180.0f;
  const Vec3 back = glm::normalize(eye - target);
  const Vec3 hint = std::fabs(back.y) > 0.999f ? Vec3(0, 0, -1) : Vec3(0, 1, 0);
  const Vec3 right = glm::normalize(glm::cross(hint, back));
  c.toWorld = Mat4(Vec4(right, 0), Vec4(glm::cross(back, right), 0), Vec4(back, 0), Vec4(eye, 1));
  scene_->cameras.push_back(c);
}

Light& SceneBuilder::light(std::string name, LightKind kind, const Vec3& position, const Vec3& power) {
  Light l;
  l.name = std::move(name);
  l.shape.kind = kind;
  l.shape.position = position;
  l.power = power;
  scene_->lights.push_back(std::move(l));
  return scene_->lights.back();
}

Light& SceneBuilder::rect(std::string name, const Vec3& centre, const Vec3& target, float halfU, float halfV, const Vec3& radiance) {
  Light& l = light(std::move(name), LightKind::Rect, centre, radiance);
  l.shape.axis = glm::normalize(target - centre);
  const Vec3 hint = std::fabs(l.shape.axis.y) > 0.999f ? Vec3(0, 0, 1) : Vec3(0, 1, 0);
  const Vec3 u = glm::normalize(glm::cross(hint, l.shape.axis));
  l.shape.u = u * halfU;
  l.shape.v = glm::cross(l.shape.axis, u) * halfV;
  return l;
}

Light& SceneBuilder::disk(std::string name, const Vec3& centre, const Vec3& target, float radius, const Vec3& radiance) {
  Light& l = light(std::move(name), LightKind::Disk, centre, radiance);
  l.shape.axis = glm::normalize(target - centre);
  l.shape.radius = radius;
  return l;
}

Light& SceneBuilder::ball(std::string name, const Vec3& centre, float radius, const Vec3& radiance) {
  Light& l = light(std::move(name), LightKind::Sphere, centre, radiance);
  l.shape.radius = radius;
  return l;
}

Light& SceneBuilder::point(std::string name, const Vec3& position, const Vec3& intensity) {
  return light(std::move(name), LightKind::Point, position, intensity);
}

Light& SceneBuilder::spot(std::string name, const Vec3& position, const Vec3& target, float outerDegrees, const Vec3& intensity) {
  Light& l = light(std::move(name), LightKind::Spot, position, intensity);
  l.shape.axis = glm::normalize(target - position);
  l.shape.cosOuter = std::cos(outerDegrees * kPi / 180.0f);
  l.shape.cosInner = std::cos(0.7f * outerDegrees * kPi / 180.0f);
  return l;
}

Light& SceneBuilder::sun(std::string name, const Vec3& towardsSun, const Vec3& irradiance) {
  Light& l = light(std::move(name), LightKind::Directional, Vec3(0.0f), irradiance);
  l.shape.axis = -glm::normalize(towardsSun);
  return l;
}

void SceneBuilder::environment(EnvironmentPtr map, const Vec3& factor) {
  scene_->environment = std::move(map);
  light("environment", LightKind::Environment, Vec3(0.0f), factor);
}

Result<ScenePtr> SceneBuilder::finish() {
  if (stop_.stopRequested()) return Status(Code::Cancelled, "the load was cancelled", scene_->name);
  GOBO_TRY(scene_->seal());
  return ScenePtr(scene_);
}

}  // namespace gobo::builtin
