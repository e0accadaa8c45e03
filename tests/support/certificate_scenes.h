// SPDX-License-Identifier: Apache-2.0
// The scenes and pictures that certificates are tried on: built-in ones, four made here, and two files where they are at hand.
// Half of them were used while the method was tuned, no choice was made by looking at the others (docs/certificate.md).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "plan/engine.h"
#include "request/request.h"
#include "scene/builtin/build.h"

namespace gobo::testing {

/// A solid glass ball and a frosted one under a rectangle: caustics that paths find by chance.
inline Result<ScenePtr> glassScene() {
  builtin::SceneBuilder b("glass");
  const int floor = b.material("floor", Vec3(0.6f, 0.55f, 0.5f)), clear = b.material("clear", Vec3(1.0f), 0.0f, 0.0f, 1.0f),
            frosted = b.material("frosted", Vec3(1.0f), 0.35f, 0.0f, 1.0f);
  for (int m : {clear, frosted}) b.at(m).bsdf.transmission = 1.0f, b.at(m).bsdf.thickness = 1.0f;
  builtin::MeshBuilder ground, ball, other;
  ground.quad(Vec3(-3, 0, 2), Vec3(6, 0, 0), Vec3(0, 0, -5));
  ground.quad(Vec3(-3, 0, -3), Vec3(6, 0, 0), Vec3(0, 4, 0));
  ball.sphere(Vec3(-0.6f, 0.6f, 0), 0.6f, 48, 24);
  other.sphere(Vec3(0.8f, 0.45f, 0.4f), 0.45f, 48, 24);
  b.add("ground", ground, floor, false);
  b.add("ball", ball, clear);
  b.add("other", other, frosted);
  b.rect("key", Vec3(-1.2f, 3.0f, 1.0f), Vec3(0, 0.4f, 0), 0.4f, 0.4f, Vec3(24, 22, 18));
  b.environment(constantEnvironment(Vec3(0.1f, 0.12f, 0.15f)), Vec3(1.0f));
  b.camera("front", Vec3(0, 1.8f, 4.2f), Vec3(0, 0.5f, 0), 40.0f);
  return b.finish();
}

/// A scattering ball beside a grey one, lit by a ball lamp and a dim sky.
inline Result<ScenePtr> mediaScene() {
  builtin::SceneBuilder b("media");
  const int floor = b.material("floor", Vec3(0.5f)), wax = b.material("wax", Vec3(1.0f), 0.2f, 0.0f, 1.0f),
            grey = b.material("grey", Vec3(0.3f, 0.4f, 0.5f), 0.3f, 0.0f, 1.0f);
  Bsdf& inside = b.at(wax).bsdf;
  inside.transmission = 1.0f, inside.thickness = 1.0f, inside.attenuationDistance = 0.3f;
  inside.attenuationColor = Vec3(0.8f, 0.6f, 0.4f), inside.scatterAlbedo = Vec3(0.9f, 0.8f, 0.6f);
  builtin::MeshBuilder ground, ball, other;
  ground.quad(Vec3(-4, 0, 3), Vec3(8, 0, 0), Vec3(0, 0, -8));
  ball.sphere(Vec3(-0.5f, 0.7f, 0), 0.7f, 40, 20);
  other.sphere(Vec3(0.9f, 0.4f, 0.3f), 0.4f, 40, 20);
  b.add("ground", ground, floor, false);
  b.add("ball", ball, wax);
  b.add("other", other, grey);
  b.ball("key", Vec3(1.5f, 2.2f, 1.2f), 0.15f, Vec3(90, 80, 70));
  b.environment(constantEnvironment(Vec3(0.15f)), Vec3(1.0f));
  b.camera("front", Vec3(0, 1.5f, 4.5f), Vec3(0.1f, 0.5f, 0), 38.0f);
  return b.finish();
}

/// A small bright lamp behind a screen in a closed room with a glossy floor and a mirror: most of its light comes by rare paths.
inline Result<ScenePtr> fireflyScene() {
  builtin::SceneBuilder b("fireflies");
  const int wall = b.material("wall", Vec3(0.7f)), gloss = b.material("gloss", Vec3(0.6f, 0.5f, 0.4f), 0.15f, 1.0f, 1.0f),
            mirror = b.material("mirror", Vec3(0.9f), 0.0f, 1.0f, 1.0f);
  builtin::MeshBuilder room, floor, ball, screen;
  room.quad(Vec3(-2, 0, -2), Vec3(4, 0, 0), Vec3(0, 3, 0));
  room.quad(Vec3(-2, 0, 2), Vec3(0, 0, -4), Vec3(0, 3, 0));
  room.quad(Vec3(2, 0, -2), Vec3(0, 0, 4), Vec3(0, 3, 0));
  room.quad(Vec3(-2, 3, -2), Vec3(4, 0, 0), Vec3(0, 0, 4));
  room.quad(Vec3(2, 0, 2), Vec3(-4, 0, 0), Vec3(0, 3, 0));
  floor.quad(Vec3(-2, 0, 2), Vec3(4, 0, 0), Vec3(0, 0, -4));
  ball.sphere(Vec3(0.8f, 0.5f, -0.8f), 0.5f, 40, 20);
  screen.box(Vec3(-1.1f, 1.0f, -0.8f), Vec3(0.5f, 0.6f, 0.02f));
  b.add("room", room, wall, false);
  b.add("floor", floor, gloss, false);
  b.add("ball", ball, mirror);
  b.add("screen", screen, wall, false);
  b.ball("lamp", Vec3(-1.1f, 1.0f, -1.4f), 0.04f, Vec3(900, 800, 650));
  b.camera("front", Vec3(0, 1.4f, 1.9f), Vec3(0, 1.1f, -1), 70.0f);
  return b.finish();
}

/// A corridor with a row of glowing bars (mesh lights), a point light and a spot, rough metal and coated pillars.
inline Result<ScenePtr> corridorScene() {
  builtin::SceneBuilder b("corridor");
  const int wall = b.material("wall", Vec3(0.65f, 0.6f, 0.5f)), metal = b.material("metal", Vec3(0.8f, 0.7f, 0.5f), 0.3f, 1.0f, 1.0f);
  const int coated = b.material("coated", Vec3(0.4f, 0.1f, 0.1f), 0.6f, 0.0f, 1.0f), glow = b.material("glow", Vec3(0.0f));
  b.at(coated).bsdf.clearcoat = 1.0f, b.at(coated).bsdf.clearcoatRoughness = 0.05f;
  b.at(glow).emission.radiance = Vec3(12, 10, 7);
  builtin::MeshBuilder hall, pillars, shiny, bars;
  hall.quad(Vec3(-1.5f, 0, 2), Vec3(3, 0, 0), Vec3(0, 0, -10));
  hall.quad(Vec3(-1.5f, 2.6f, -8), Vec3(3, 0, 0), Vec3(0, 0, 10));
  hall.quad(Vec3(-1.5f, 0, 2), Vec3(0, 0, -10), Vec3(0, 2.6f, 0));
  hall.quad(Vec3(1.5f, 0, -8), Vec3(0, 0, 10), Vec3(0, 2.6f, 0));
  hall.quad(Vec3(-1.5f, 0, -8), Vec3(3, 0, 0), Vec3(0, 2.6f, 0));
  for (int i = 0; i < 3; ++i) {
    pillars.box(Vec3(-1.0f, 1.0f, -1.0f - 2.0f * i), Vec3(0.15f, 1.0f, 0.15f));
    shiny.sphere(Vec3(0.9f, 0.35f, -0.5f - 2.0f * i), 0.35f, 32, 16);
    bars.box(Vec3(0, 2.5f, -0.5f - 2.5f * i), Vec3(0.5f, 0.02f, 0.05f));
  }
  b.add("hall", hall, wall, false);
  b.add("pillars", pillars, coated, false);
  b.add("shiny", shiny, metal);
  b.add("bars", bars, glow, false);
  b.point("lamp", Vec3(0.2f, 1.2f, -6.5f), Vec3(0.8f, 0.9f, 1.4f));
  b.spot("spot", Vec3(-1.2f, 2.4f, 1.0f), Vec3(0.8f, 0.2f, -1.5f), 25.0f, Vec3(6, 5, 4));
  b.camera("front", Vec3(0.1f, 1.4f, 1.8f), Vec3(0, 1.0f, -4), 60.0f);
  return b.finish();
}

struct TriedScene {
  std::string name;
  bool tuned;
};
/// Alphabetical.
inline std::vector<TriedScene> triedScenes() {
  return {{"atrium", false},   {"cornell", true},  {"cornell_dragon", false}, {"corridor", false}, {"fence", true},
          {"fireflies", true}, {"glass", true},    {"grids", false},          {"lamps", true},     {"lights8", false},
          {"media", true},     {"spheres", false}, {"teapot_table", false},   {"tentacles", true}, {"trees", false}};
}

/// Errors: NotFound where the scene's file is not at hand.
inline Result<ScenePtr> openTried(const Engine& engine, const std::string& name, const std::string& data) {
  if (name == "glass") return glassScene();
  if (name == "media") return mediaScene();
  if (name == "fireflies") return fireflyScene();
  if (name == "corridor") return corridorScene();
  const std::string file = data + "/derived/" + name + ".glb";
  if (name == "cornell_dragon" || name == "teapot_table")
    return std::filesystem::exists(file) ? engine.loadScene(file, true) : Result<ScenePtr>(notFound(file, "scene"));
  return engine.loadScene(name, true);
}

struct TriedPicture {
  std::string name;
  v1::RenderRequest request;
};

/// One request with assignments as on the command line; a wrong one aborts.
inline TriedPicture triedPicture(const std::string& name, int size, int spp, const std::vector<std::string>& assignments) {
  TriedPicture out{name, {}};
  out.request.set_scene(name);
  out.request.set_width(uint32_t(size));
  out.request.set_height(uint32_t(size));
  out.request.mutable_halt()->set_spp(uint32_t(spp));
  out.request.set_seed(42);
  for (const std::string& a : assignments) GOBO_CHECK(setPath(out.request, a).ok());
  return out;
}

/// Eight pictures: four by path tracing alone, four with every approximation that the scene's lights allow. Scenes with many lights
/// (a map each) are path traced with other light selections instead.
inline std::vector<TriedPicture> triedPictures(const Scene& scene, int size) {
  bool delta = false, area = false, sky = false;
  for (const Light& l : scene.lights) {
    delta = delta || isDeltaLight(l.shape);
    area = area || l.shape.kind == LightKind::Rect || l.shape.kind == LightKind::Disk || l.shape.kind == LightKind::Sphere;
    sky = sky || l.shape.kind == LightKind::Environment;
  }
  std::vector<TriedPicture> out;
  std::vector<std::string> always;
  if (scene.lights.empty()) always.push_back("environment.sky.turbidity=3"), sky = true;  // files that come without light
  const auto triedPicture = [&always](const std::string& name, int side, int spp, std::vector<std::string> assignments) {
    assignments.insert(assignments.end(), always.begin(), always.end());
    return testing::triedPicture(name, side, spp, assignments);
  };
  for (int spp : {4, 8, 16, 64}) out.push_back(triedPicture("path " + std::to_string(spp), size, spp, {}));
  if (scene.lights.size() > 64) {
    out.push_back(triedPicture("by power 32", size, 32, {"integrator.light_selection=POWER"}));
    out.push_back(triedPicture("evenly 32", size, 32, {"integrator.light_selection=UNIFORM"}));
    out.push_back(triedPicture("no indirect 32", size, 32, {"integrator.indirect=false"}));
    out.push_back(triedPicture("one bounce 32", size, 32, {"integrator.max_bounces=1"}));
    return out;
  }
  out.push_back(delta ? triedPicture("percentage-closer 16", size, 16, {"shadows.percentage_closer="})
                      : triedPicture("percentage-closer soft 16", size, 16, {"shadows.percentage_closer_soft="}));
  out.push_back(delta ? triedPicture("moment 32", size, 32, {"shadows.moment="}) : triedPicture("variance soft 32", size, 32, {"shadows.variance_soft="}));
  out.push_back(area ? triedPicture("axis-aligned 16", size, 16, {"shadows.axis_aligned="}) : triedPicture("ray-traced 16", size, 16, {"shadows.ray_traced="}));
  out.push_back(sky ? triedPicture("area lights 16", size, 16, {"environment.area_lights=8"})
                    : triedPicture("one bounce 32", size, 32, {"integrator.max_bounces=1"}));
  return out;
}

}  // namespace gobo::testing
