// SPDX-License-Identifier: Apache-2.0
// Rigs against closed forms: key frames evaluated by hand, skins and morph targets of known shape, and what a pose shares with
// the scene that it was made of.
#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>

#include "import/load.h"
#include "scene/edit.h"
#include "scene/rig_sample.h"
#include "support/animated_scene.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;
const fs::path kModels = "../shared/data/gltf/khronos";

RigSampler sampler(RigInterpolation mode, std::vector<float> times, std::vector<float> values) {
  return {mode, Array<float>(std::move(times)), Array<float>(std::move(values))};
}

TEST(Rig, StepAndLinearHoldTheirEnds) {
  for (const auto mode : {RigInterpolation::Step, RigInterpolation::Linear}) {
    const RigSampler s = sampler(mode, {1, 2, 4}, {10, 20, 60});
    double v = 0;
    for (const auto& [time, step, linear] :
         {std::tuple{0.0, 10.0, 10.0}, {1.0, 10.0, 10.0}, {1.5, 10.0, 15.0}, {2.0, 20.0, 20.0}, {3.5, 20.0, 50.0}, {4.0, 60.0, 60.0}, {9.0, 60.0, 60.0}}) {
      sampleAt(s, time, 1, false, &v);
      EXPECT_DOUBLE_EQ(v, mode == RigInterpolation::Step ? step : linear) << time;
    }
  }
}

TEST(Rig, CubicSplineIsTheHermiteCurveThroughItsKeys) {
  // x(t) = t^3 - 2 t^2 + 3 at 0, 2 and 3: a cubic is its own Hermite interpolant, with x' = 3 t^2 - 4 t. Tangents on the outer
  // sides of the end keys must not count.
  const auto x = [](double t) { return t * t * t - 2 * t * t + 3; };
  const auto slope = [](double t) { return float(3 * t * t - 4 * t); };
  const RigSampler s =
      sampler(RigInterpolation::CubicSpline, {0, 2, 3}, {999, float(x(0)), slope(0), slope(2), float(x(2)), slope(2), slope(3), float(x(3)), 999});
  for (double t = 0; t <= 3.0; t += 0.125) {
    double v = 0;
    sampleAt(s, t, 1, false, &v);
    EXPECT_NEAR(v, x(t), 1e-12) << t;
  }
  double v = 0;
  sampleAt(s, 7, 1, false, &v);
  EXPECT_DOUBLE_EQ(v, x(3));
}

TEST(Rig, RotationsTakeTheShorterWayAtEvenSpeed) {
  const double half = std::sqrt(0.5);
  for (const float sign : {1.0f, -1.0f}) {  // q and -q are one rotation
    const RigSampler s = sampler(RigInterpolation::Linear, {0, 1}, {0, 0, 0, 1, 0, 0, sign * float(half), sign * float(half)});
    for (const double t : {0.0, 0.25, 0.5, 0.9, 1.0}) {
      double q[4];
      sampleAt(s, t, 4, true, q);
      const double angle = t * 0.25 * std::acos(-1.0);  // half of 90 degrees x t
      EXPECT_NEAR(std::fabs(q[3]), std::cos(angle), 1e-7);
      EXPECT_NEAR(std::fabs(q[2]), std::sin(angle), 1e-7);
    }
  }
  const RigSampler near = sampler(RigInterpolation::Linear, {0, 1}, {0, 0, 0, 1, 0, 0, 0, 1});  // equal ends: no division by sin 0
  double q[4];
  sampleAt(near, 0.5, 4, true, q);
  EXPECT_DOUBLE_EQ(q[3], 1.0);
  const RigSampler none = sampler(RigInterpolation::Step, {0}, {0, 0, 0, 0});  // no length: the identity, not NaN
  sampleAt(none, 0, 4, true, q);
  EXPECT_DOUBLE_EQ(q[3], 1.0);
}

MeshPtr quad() {
  auto m = std::make_shared<Mesh>();
  m->indices = {0, 1, 2, 0, 2, 3};
  m->positions = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(1, 1, 0), Vec3(0, 1, 0)};
  m->normals = Array<Vec3>(4, glm::normalize(Vec3(1, 0, 1)));
  m->tangents = Array<Vec4>(4, Vec4(1, 0, 0, -1));
  sealMesh(*m);
  return m;
}

/// A quad on two joints; both carry half of every vertex.
Rig halves(const Mat4& second) {
  Rig r;
  r.nodes.resize(2);
  r.nodes[1].fixed = true;
  r.nodes[1].matrix = second;
  r.meshes = {quad()};
  r.skins = {{Array<int32_t>{0, 1}, Array<Mat4>(2, Mat4(1.0f))}};
  RigSource s;
  s.influences = 4;
  for (int i = 0; i < 4; ++i) {
    for (const int j : {0, 1, 0, 0}) s.joints.push_back(uint16_t(j));
    for (const float w : {0.5f, 0.5f, 0.0f, 0.0f}) s.weights.push_back(w);
  }
  r.sources = {s};
  RigDeformed d;
  d.skin = 0;
  r.deformed = {d};
  return r;
}

TEST(Rig, BlendedNormalsAreThoseOfTheBlendedSurface) {
  Mat4 stretch(1.0f);
  stretch[0][0] = 5.0f;  // the blend stretches x by 3: the normal (1,0,1) becomes (1/3,0,1)
  stretch[3] = Vec4(0, 0, 8, 1);
  const Rig rig = halves(stretch);
  const MeshPtr m = deformMesh(rig, 0, evaluatePose(rig, {}, 0), *rig.meshes[0]);
  EXPECT_EQ(m->positions[2], Vec3(3, 1, 4));
  EXPECT_LT(glm::length(m->normals[0] - glm::normalize(Vec3(1.0f / 3.0f, 0, 1))), 1e-6f);
  EXPECT_EQ(m->tangents[0], Vec4(1, 0, 0, -1));
  Mat4 mirror(1.0f);
  mirror[2][2] = -3.0f;  // the blend mirrors z: outside stays outside
  const Rig mirrored = halves(mirror);
  const MeshPtr n = deformMesh(mirrored, 0, evaluatePose(mirrored, {}, 0), *mirrored.meshes[0]);
  EXPECT_LT(glm::length(n->normals[0] - glm::normalize(Vec3(1, 0, -1))), 1e-6f);
  EXPECT_EQ(rig.meshes[0]->positions[2], Vec3(1, 1, 0)) << "the source stays";
}

TEST(Rig, MorphTargetsMoveEveryAttribute) {
  auto mesh = std::make_shared<Mesh>(*quad());
  mesh->uv[1] = Array<Vec2>(4, Vec2(0.5f));
  mesh->colours = Array<Vec4>(4, Vec4(0.9f));
  Rig rig;
  rig.nodes.resize(1);
  rig.meshes = {mesh};
  RigSource s;
  s.targets.resize(2);
  s.targets[0].positions = Array<Vec3>(4, Vec3(0, 0, 2));
  s.targets[0].normals = Array<Vec3>(4, Vec3(-mesh->normals[0].x * 2, 0, 0));
  s.targets[1].tangents = Array<Vec3>(4, Vec3(-4, 0, 4));
  s.targets[1].uv[1] = Array<Vec2>(4, Vec2(1, -1));
  s.targets[1].colours = Array<Vec4>(4, Vec4(0.8f, -0.4f, 0, 0));
  rig.sources = {s};
  RigDeformed d;
  d.weights = {0.5f, 0.25f};
  rig.deformed = {d};
  const MeshPtr m = deformMesh(rig, 0, evaluatePose(rig, {}, 0), *mesh);
  EXPECT_EQ(m->positions[2], Vec3(1, 1, 1));
  EXPECT_LT(glm::length(m->normals[0] - Vec3(0, 0, 1)), 1e-6f) << "renormalised";
  EXPECT_LT(glm::length(m->tangents[0] - Vec4(0, 0, 1, -1)), 1e-6f);
  EXPECT_EQ(m->uv[1][3], Vec2(0.75f, 0.25f));
  EXPECT_LT(glm::length(m->colours[0] - Vec4(1.0f, 0.8f, 0.9f, 0.9f)), 1e-6f) << "clamped to 1";
}

ScenePtr loaded(const fs::path& file) {
  auto s = loadGltf(file.string());
  EXPECT_TRUE(s.ok()) << s.status().toString();
  return s.ok() ? *s : nullptr;
}
ScenePtr at(const ScenePtr& s, const std::string& animation, double time) {
  auto posed = posedScene(s, animation, time);
  EXPECT_TRUE(posed.ok()) << posed.status().toString();
  return posed.ok() ? *posed : nullptr;
}

TEST(Rig, SimpleSkinBendsByItsAngle) {
  if (!fs::exists(kModels)) GTEST_SKIP() << "../shared/data/gltf/khronos is absent";
  const ScenePtr rest = loaded(kModels / "SimpleSkin/glTF/SimpleSkin.gltf");
  ASSERT_TRUE(rest && rest->rig);
  ASSERT_EQ(rest->meshes.size(), 1u);
  const double degrees = std::acos(-1.0) / 180;
  // The strip is 2 high; a vertex at height y hangs by y/2 on the upper joint at height 1, which turns 45 degrees a half second.
  for (const auto& [time, angle] : {std::pair{0.0, 0.0}, {0.5, 45.0}, {0.75, 67.5}, {1.0, 90.0}}) {
    const ScenePtr s = at(rest, "", time);
    for (size_t i = 0; i < rest->meshes[0]->positions.size(); ++i) {
      const glm::dvec3 p(rest->meshes[0]->positions[i]);
      const double w = p.y / 2, c = std::cos(angle * degrees), n = std::sin(angle * degrees);
      const glm::dvec3 turned(c * p.x - n * (p.y - 1), n * p.x + c * (p.y - 1) + 1, 0), expected = p * (1 - w) + turned * w;
      EXPECT_LT(glm::length(glm::dvec3(s->meshes[0]->positions[i]) - expected), 1e-3) << time << " vertex " << i;  // the file's keys have three digits
    }
  }
  EXPECT_EQ(at(rest, "", 1e9)->hash(), at(rest, "", 5.5)->hash()) << "time is clamped";
  EXPECT_EQ(at(rest, "", -3)->hash(), at(rest, "", 0)->hash());
}

TEST(Rig, SimpleMorphFollowsItsWeights) {
  if (!fs::exists(kModels)) GTEST_SKIP() << "../shared/data/gltf/khronos is absent";
  const ScenePtr rest = loaded(kModels / "SimpleMorph/glTF/SimpleMorph.gltf");
  ASSERT_TRUE(rest);
  // Apex (0.5, 0.5) plus a (-1, 1) plus b (1, 1); weights a, b: (0,0) (0,1) (1,1) (1,0) (0,0) at 0..4 s, (0.5, 0.5) at rest.
  EXPECT_LT(glm::length(rest->meshes[0]->positions[2] - Vec3(0.5f, 1.5f, 0)), 1e-6f);
  for (const auto& [time, apex] : {std::pair{0.0, Vec3(0.5f, 0.5f, 0)}, {0.5, Vec3(1, 1, 0)}, {1.5, Vec3(1, 2, 0)}, {3.0, Vec3(-0.5f, 1.5f, 0)}})
    EXPECT_LT(glm::length(at(rest, "", time)->meshes[0]->positions[2] - apex), 1e-6f) << time;
}

TEST(Rig, APoseSharesWhatItDoesNotMove) {
  const ScenePtr rest = loaded(testing::writeAnimatedScene("share"));
  ASSERT_TRUE(rest && rest->rig);
  const ScenePtr slid = at(rest, "slide", 0.5);
  EXPECT_EQ(slid->meshes, rest->meshes) << "meshes are the same objects";
  EXPECT_LT(glm::length(Vec3(slid->instances[1].toWorld[3]) - Vec3(0.3f, 0.5f, 0)), 1e-6f);
  EXPECT_EQ(slid->instances[0].toWorld, rest->instances[0].toWorld);
  EXPECT_EQ(at(rest, "slide", 0)->hash(), rest->hash());
  const std::vector<int> none;
  EXPECT_NE(slid->facetHash(Facet::Pose, none), rest->facetHash(Facet::Pose, none));
  EXPECT_EQ(slid->facetHash(Facet::Topology | Facet::Shading | Facet::Cameras | Facet::Albedo | Facet::Bsdf, none),
            rest->facetHash(Facet::Topology | Facet::Shading | Facet::Cameras | Facet::Albedo | Facet::Bsdf, none));
  const ScenePtr lamp = at(rest, "lamp", 1), all = at(rest, "*", 1);
  EXPECT_EQ(lamp->facetHash(Facet::Pose, none), rest->facetHash(Facet::Pose, none));
  EXPECT_EQ(lamp->lights[lamp->findLight("lamp")].shape.position, Vec3(0.5f, 2, 0.3f));
  EXPECT_EQ(Vec3(all->cameras[0].toWorld[3]), Vec3(0.5f, 1, 4));
  EXPECT_EQ(all->lights[all->findLight("lamp")].shape.position, Vec3(0.5f, 2, 0.3f));
  // An edited instance that the animation does not move keeps its edit.
  const auto edited = editScene(*rest, [](Scene& s) -> Status {
    s.instances[0].toWorld[3] = Vec4(0, -1, 0, 1);
    return {};
  });
  EXPECT_EQ(at(*edited, "slide", 1)->instances[0].toWorld[3], Vec4(0, -1, 0, 1));
  EXPECT_EQ(posedScene(rest, "jump", 0).status().code(), Code::NotFound);
  EXPECT_EQ(posedScene(rest, "", std::nan("")).status().code(), Code::InvalidArgument);
  EXPECT_NE(editScene(*rest,
                      [](Scene& s) -> Status {
                        s.rig = nullptr;
                        return {};
                      })
                .value()
                ->hash(),
            rest->hash())
      << "the rig is part of the scene's identity";
}

/// A file of two nodes: a lamp at (0, 1, 2), turned so that -z of its own is +y, with a camera, whose scale goes from one vector to another
/// within a second; and the camera "still". `lamp`: what the node says further, and what the file does.
Result<ScenePtr> scaledLamp(const std::string& lamp, const Vec3& rest, const Vec3& from, const Vec3& to, const std::string& file = "") {
  const fs::path folder = fs::temp_directory_path() / ("gobo-scaled-lamp-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const float keys[] = {0, 1, from.x, from.y, from.z, to.x, to.y, to.z};
  std::ofstream(folder / "keys.bin", std::ios::binary).write(reinterpret_cast<const char*>(keys), sizeof keys);
  std::ofstream(folder / "lamp.gltf") << R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0,1]}],"nodes":[{"name":"lamp","camera":0,"translation":[0,1,2],
    "rotation":[0.70710678,0,0,0.70710678],"scale":[)"
                                      << rest.x << "," << rest.y << "," << rest.z << "]," << lamp << R"(},{"name":"still","camera":0}],
    "cameras":[{"type":"perspective","perspective":{"yfov":0.7,"znear":0.1}}],"buffers":[{"uri":"keys.bin","byteLength":32}],
    "bufferViews":[{"buffer":0,"byteLength":8},{"buffer":0,"byteOffset":8,"byteLength":24}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":2,"type":"SCALAR","min":[0],"max":[1]},{"bufferView":1,"componentType":5126,"count":2,"type":"VEC3"}],
    "animations":[{"samplers":[{"input":0,"output":1}],"channels":[{"sampler":0,"target":{"node":0,"path":"scale"}}]}])"
                                      << file << "}";
  auto scene = loadGltf((folder / "lamp.gltf").string());
  fs::remove_all(folder);
  return scene;
}

/// Watts of an area light whose radiance is 1, by pi.
double lampArea(const LightShape& s) {
  if (s.kind == LightKind::Rect) return 4.0 * glm::length(DVec3(s.u)) * glm::length(DVec3(s.v));
  return (s.kind == LightKind::Disk ? 1.0 : 4.0) * M_PI * double(s.radius) * double(s.radius);
}

TEST(Rig, ALampScaledToNothingIsDarkAndComesBack) {
  const auto lampOf = [](const ScenePtr& s) { return s->lights[size_t(s->findLight("lamp"))]; };
  for (const char* type : {"rect", "disk", "sphere"}) {
    const std::string lamp = std::string(R"("extras":{"gobo_light":{"type":")") + type + R"(","radiance":[5,5,5]}})";
    for (const Vec3& gone : {Vec3(0.0f), Vec3(0, 1, 1), Vec3(0, 1, 0), Vec3(0, 0, 1)}) {
      SCOPED_TRACE(std::string(type) + " " + std::to_string(gone.y) + " " + std::to_string(gone.z));
      // It shrinks: half way it has half its sizes, at the end none, and its light is of the direction that it had.
      const auto shrinks = scaledLamp(lamp, Vec3(1.0f), Vec3(1.0f), gone);
      ASSERT_TRUE(shrinks.ok()) << shrinks.status().toString();
      const Light whole = lampOf(*shrinks), half = lampOf(at(*shrinks, "", 0.5)), none = lampOf(at(*shrinks, "", 1.0));
      EXPECT_GT(lampArea(whole.shape), 0.7);
      EXPECT_LT(lampArea(half.shape), 0.51 * lampArea(whole.shape));
      EXPECT_GT(lampArea(half.shape), 0.24 * lampArea(whole.shape));
      EXPECT_LT(lampArea(none.shape), 1e-8);
      EXPECT_EQ(none.power, whole.power) << "its radiance";
      EXPECT_EQ(none.shape.position, Vec3(0, 1, 2));
      EXPECT_LT(glm::length(none.shape.axis - Vec3(0, 1, 0)), 1e-6f);
      EXPECT_LT(glm::length(half.shape.axis - Vec3(0, 1, 0)), 1e-6f);
      EXPECT_EQ(at(*shrinks, "", 0.0)->hash(), (*shrinks)->hash());

      // It grows: the file rests where it has no size.
      const auto grows = scaledLamp(lamp, gone, gone, Vec3(1.0f));
      ASSERT_TRUE(grows.ok()) << grows.status().toString();
      ASSERT_GE((*grows)->findLight("lamp"), 0);
      EXPECT_LT(lampArea(lampOf(*grows).shape), 1e-8);
      const LightShape grown = lampOf(at(*grows, "", 1.0)).shape;
      EXPECT_NEAR(lampArea(grown), lampArea(whole.shape), 1e-6);
      EXPECT_LT(glm::length(grown.axis - whole.shape.axis) + glm::length(grown.u - whole.shape.u) + glm::length(grown.v - whole.shape.v), 1e-5f);
      // So does the camera, which no scale blinds.
      const int eye = (*grows)->findCamera("lamp");
      ASSERT_GE(eye, 0);
      for (const double t : {0.0, 1.0}) EXPECT_LT(glm::length(Vec3(at(*grows, "", t)->cameras[size_t(eye)].toWorld[2]) - Vec3(0, -1, 0)), 1e-6f) << t;
    }
    // Watts of a lamp that has no size, or less than lamps are made of, are no radiance.
    const std::string watts = std::string(R"("extras":{"gobo_light":{"type":")") + type + R"(","power_w":[5,5,5]}})";
    for (const Vec3& gone : {Vec3(0.0f), Vec3(0, 1, 1), Vec3(1e-12f, 1, 1)}) {
      const Status s = scaledLamp(watts, gone, gone, Vec3(1.0f)).status();
      EXPECT_NE(s.message().find("too small for its power"), std::string::npos) << s.toString();
      EXPECT_NE(s.location().find("#/nodes/0/extras/gobo_light/power_w"), std::string::npos) << s.toString();
    }
  }
  // A light that has its power by itself keeps it, its place and, of its rotation alone, its direction.
  for (const char* type : {"point", "spot", "directional"}) {
    const std::string lights = std::string(R"(,"extensionsUsed":["KHR_lights_punctual"],"extensions":{"KHR_lights_punctual":{"lights":[{"type":")") + type +
                               R"(","intensity":10)" + (std::string(type) == "spot" ? R"(,"spot":{})" : "") + "}]}}";
    for (const Vec3& rest : {Vec3(0.0f), Vec3(1.0f)}) {
      const auto s = scaledLamp(R"("extensions":{"KHR_lights_punctual":{"light":0}})", rest, rest, Vec3(1.0f) - rest, lights);
      ASSERT_TRUE(s.ok()) << s.status().toString();
      for (const double t : {0.0, 0.5, 1.0}) {
        const Light l = lampOf(at(*s, "", t));
        EXPECT_EQ(l.power, Vec3(10.0f)) << type << t;
        EXPECT_EQ(l.shape.position, Vec3(0, 1, 2)) << type << t;
        EXPECT_LT(glm::length(l.shape.axis - Vec3(0, 1, 0)), 1e-6f) << type << t;
      }
    }
  }
}

// The limit of what a node of a small scale shows, mirrored or not, its own mirror or its parent's.
TEST(Rig, AnAxisOfNoLengthFollowsItsLimit) {
  const fs::path folder = fs::temp_directory_path() / ("gobo-no-axis-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const auto towards = [&](const char* parent, const std::string& scale) {
    std::ofstream(folder / "lamp.gltf") << R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[1]}],"nodes":[{"name":"lamp","rotation":[0.18301270,0.50000000,
      0.18301270,0.8264458],"scale":)" << scale
                                        << R"(,"extensions":{"KHR_lights_punctual":{"light":0}}},{"name":"parent","scale":)" << parent
                                        << R"(,"children":[0]}],"extensionsUsed":["KHR_lights_punctual"],
      "extensions":{"KHR_lights_punctual":{"lights":[{"type":"directional","intensity":10}]}}})";
    const auto scene = loadGltf((folder / "lamp.gltf").string());
    EXPECT_TRUE(scene.ok()) << scene.status().toString();
    return scene.ok() && !(*scene)->lights.empty() ? (*scene)->lights[0].shape.axis : Vec3(0.0f);
  };
  for (const char* parent : {"[1,1,1]", "[-1,1,1]", "[1,1,-2]", "[-1,-1,-1]"})
    for (const char* own : {"[1,1,", "[-1,1,", "[1,-3,", "[-1,-1,"}) {
      const Vec3 limit = towards(parent, std::string(own) + "1e-4]"), flat = towards(parent, std::string(own) + "0]");
      EXPECT_NEAR(glm::length(limit), 1.0f, 1e-5f);
      EXPECT_LT(glm::length(flat - limit), 1e-3f) << parent << " " << own << " 0]";
    }
  fs::remove_all(folder);
}

// A matrix of nothing is the same however it is turned; the light has its direction all the same.
TEST(Rig, ALampOfScale0Turns) {
  const fs::path folder = fs::temp_directory_path() / ("gobo-turned-lamp-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const float keys[] = {0, 1, 0, 0, 0, 1, std::sqrt(0.5f), 0, 0, std::sqrt(0.5f)};
  std::ofstream(folder / "keys.bin", std::ios::binary).write(reinterpret_cast<const char*>(keys), sizeof keys);
  std::ofstream(folder / "lamp.gltf") << R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],
    "nodes":[{"name":"lamp","scale":[0,0,0],"extensions":{"KHR_lights_punctual":{"light":0}}}],"extensionsUsed":["KHR_lights_punctual"],
    "extensions":{"KHR_lights_punctual":{"lights":[{"type":"directional","intensity":10}]}},"buffers":[{"uri":"keys.bin","byteLength":40}],
    "bufferViews":[{"buffer":0,"byteLength":8},{"buffer":0,"byteOffset":8,"byteLength":32}],
    "accessors":[{"bufferView":0,"componentType":5126,"count":2,"type":"SCALAR","min":[0],"max":[1]},{"bufferView":1,"componentType":5126,"count":2,"type":"VEC4"}],
    "animations":[{"samplers":[{"input":0,"output":1}],"channels":[{"sampler":0,"target":{"node":0,"path":"rotation"}}]}]})";
  const auto scene = loadGltf((folder / "lamp.gltf").string());
  fs::remove_all(folder);
  ASSERT_TRUE(scene.ok()) << scene.status().toString();
  for (const auto& [time, axis] : {std::pair{0.0, Vec3(0, 0, -1)}, {0.5, Vec3(0, std::sqrt(0.5f), -std::sqrt(0.5f))}, {1.0, Vec3(0, 1, 0)}})
    EXPECT_LT(glm::length(at(*scene, "", time)->lights[0].shape.axis - axis), 1e-6f) << time;
}

TEST(Rig, VariantsChangeMaterialsAlone) {
  const ScenePtr rest = loaded(testing::writeAnimatedScene("variants"));
  const auto red = withVariant(rest, "red");
  ASSERT_TRUE(red.ok());
  EXPECT_EQ((*red)->materials[(*red)->meshes[0]->material].name, "red");
  EXPECT_EQ((*red)->facetHash(Facet::Pose | Facet::Albedo, {}), rest->facetHash(Facet::Pose | Facet::Albedo, {}));
  EXPECT_EQ((*red)->meshes[0]->positions.data(), rest->meshes[0]->positions.data()) << "arrays are shared";
  EXPECT_EQ((*withVariant(rest, "grey"))->hash(), rest->hash());
  EXPECT_EQ(withVariant(rest, "blue").status().code(), Code::NotFound);
}

TEST(Rig, SealRefusesWhatPosingCouldNotUse) {
  Scene scene;
  scene.name = "s";
  scene.meshes = {quad()};
  const Rig good = halves(Mat4(1.0f));
  Rig rig = good;
  EXPECT_TRUE(sealRig(rig, scene).ok());
  const Hash128 content = rig.content;
  const auto refused = [&](const char* where, const std::function<void(Rig&)>& spoil) {
    Rig bad = good;
    spoil(bad);
    const Status s = sealRig(bad, scene);
    EXPECT_EQ(s.code(), Code::InvalidArgument) << where;
    EXPECT_NE(s.location().find(where), std::string::npos) << s.toString();
  };
  refused("nodes/0", [](Rig& r) { r.nodes[0].parent = 1; });
  refused("nodes/1", [](Rig& r) { r.nodes[1].matrix[0][0] = std::nanf(""); });
  refused("skins/0", [](Rig& r) { r.skins[0].joints[0] = 7; });
  refused("sources/0", [](Rig& r) { r.sources[0].joints.pop_back(); });
  refused("deformed/0", [](Rig& r) { r.sources[0].joints[1] = 2; });
  refused("deformed/0", [](Rig& r) { r.deformed[0].mesh = 1; });
  refused("sources/0", [](Rig& r) {
    r.sources[0].targets.resize(1);
    r.sources[0].targets[0].positions = Array<Vec3>(3);
  });
  const auto withMesh = [&](const std::function<void(Mesh&)>& spoil) {
    refused("sources/0", [&](Rig& r) {
      auto mesh = std::make_shared<Mesh>(*r.meshes[0]);
      spoil(*mesh);
      sealMesh(*mesh);
      r.meshes[0] = mesh;
    });
  };
  for (const size_t n : {1, 3, 5}) {  // of four vertices
    SCOPED_TRACE(n);
    withMesh([&](Mesh& m) { m.normals = Array<Vec3>(n, Vec3(0, 0, 1)); });
    withMesh([&](Mesh& m) { m.tangents = Array<Vec4>(n, Vec4(1, 0, 0, 1)); });
    withMesh([&](Mesh& m) { m.colours = Array<Vec4>(n, Vec4(1)); });
    for (int set = 0; set < kUvSets; ++set) withMesh([&](Mesh& m) { m.uv[size_t(set)] = Array<Vec2>(n, Vec2(0)); });
  }
  withMesh([](Mesh& m) { m.indices[5] = 4; });
  refused("followers/0", [](Rig& r) { r.followers.push_back({RigKind::Camera, 0, 0}); });
  const auto animate = [](Rig& r, RigSampler s) {
    RigAnimation a;
    a.samplers = {std::move(s)};
    a.channels = {{0, RigPath::Translation, 0}};
    r.animations = {a};
  };
  refused("animations/0", [&](Rig& r) { animate(r, sampler(RigInterpolation::Linear, {0, 0}, {0, 0, 0, 1, 1, 1})); });
  refused("animations/0", [&](Rig& r) { animate(r, sampler(RigInterpolation::CubicSpline, {0, 1}, {0, 0, 0, 1, 1, 1})); });
  Rig moved = good;
  moved.nodes[0].translation.x = 1;
  ASSERT_TRUE(sealRig(moved, scene).ok());
  EXPECT_NE(moved.content, content);
}

}  // namespace
}  // namespace gobo
