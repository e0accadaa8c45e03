// SPDX-License-Identifier: Apache-2.0
// Scenes far from their file's origin, and tiny ones: the same scene, and the same picture, as near it. Whatever puts them there: one node, a matrix,
// every node by itself, the vertices, joints, keys of an animation.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "scene/blob.h"
#include "support/engines.h"
#include "support/small_gltf.h"
#include "support/temp_folder.h"

namespace gobo::testing {
namespace {

using Json = nlohmann::json;

enum class By { Root, Matrix, Nodes, Vertices };
const std::pair<By, const char*> kWays[] = {{By::Root, "root"}, {By::Matrix, "matrix"}, {By::Nodes, "nodes"}, {By::Vertices, "vertices"}};

class FarOrigin : public ::testing::Test {
 protected:
  /// Floor, a board that slides, a skinned strip, lamps, camera; 4 m wide. `scale`: of all lengths.
  std::string write(const std::string& name, By by, const DVec3& at, double scale = 1.0) {
    std::vector<char> bin;
    Json accessors = Json::array(), views = Json::array();
    const auto add = [&](const auto& values, int component, const char* type, bool bounds = false) {
      using T = std::decay_t<decltype(values[0])>;
      while (bin.size() % 4) bin.push_back(0);
      const int width = std::string(type) == "MAT4" ? 16 : std::string(type) == "VEC4" ? 4 : std::string(type) == "VEC3" ? 3 : 1;
      const size_t bytes = values.size() * sizeof(T);
      views.push_back({{"buffer", 0}, {"byteOffset", bin.size()}, {"byteLength", bytes}});
      const auto* p = reinterpret_cast<const char*>(values.data());
      bin.insert(bin.end(), p, p + bytes);
      accessors.push_back({{"bufferView", views.size() - 1}, {"componentType", component}, {"count", values.size() / size_t(width)}, {"type", type}});
      if (bounds) {
        Json lo = Json::array(), hi = Json::array();
        for (int c = 0; c < width; ++c) {
          float a = values[size_t(c)], b = a;
          for (size_t i = size_t(c); i < values.size(); i += size_t(width)) a = std::min(a, float(values[i])), b = std::max(b, float(values[i]));
          lo.push_back(a);
          hi.push_back(b);
        }
        accessors.back()["min"] = lo;
        accessors.back()["max"] = hi;
      }
      return int(accessors.size()) - 1;
    };
    const DVec3 inVertices = by == By::Vertices ? at : DVec3(0.0);
    const auto square = [&](float half) {
      std::vector<float> p;
      for (const auto& [x, z] : {std::pair{-1, 1}, {1, 1}, {1, -1}, {-1, -1}})
        for (const double v : {x * half * scale + inVertices.x, inVertices.y, z * half * scale + inVertices.z}) p.push_back(float(v));
      return p;
    };
    const std::vector<uint16_t> corners{0, 1, 2, 0, 2, 3};
    const int floor = add(square(2), 5126, "VEC3", true), board = add(square(0.5f), 5126, "VEC3", true), index = add(corners, 5123, "SCALAR");
    std::vector<float> strip;
    for (const double v : {-1.0, 0.25, 1.0, -0.5, 0.25, 1.0, -0.5, 1.0, 1.0, -1.0, 1.0, 1.0}) strip.push_back(float(v * scale));
    const int skinned = add(strip, 5126, "VEC3", true);
    const std::vector<uint8_t> joints{0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};
    const std::vector<float> weights{1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, times{0, 1};
    const int joint = add(joints, 5121, "VEC4"), weight = add(weights, 5126, "VEC4"), time = add(times, 5126, "SCALAR", true);
    const DVec3 own = by == By::Nodes ? at : DVec3(0.0), ofLamps = by == By::Nodes || by == By::Vertices ? at : DVec3(0.0);
    const auto place = [&](double x, double y, double z, const DVec3& moved) { return Json{x * scale + moved.x, y * scale + moved.y, z * scale + moved.z}; };
    std::vector<float> slide;
    for (const double v : {0.0, 0.5, 0.0, 0.5, 0.75, 0.25})
      slide.push_back(float(v * scale + (slide.size() % 3 == 0 ? ofLamps.x : slide.size() % 3 == 1 ? ofLamps.y : ofLamps.z)));
    const int moves = add(slide, 5126, "VEC3");
    const auto mesh = [&](int positions) { return Json{{"primitives", {{{"attributes", {{"POSITION", positions}}}, {"indices", index}, {"material", 0}}}}}; };
    Json strips = mesh(skinned);
    strips["primitives"][0]["attributes"]["JOINTS_0"] = joint;
    strips["primitives"][0]["attributes"]["WEIGHTS_0"] = weight;
    const auto lamp = [](int k) { return Json{{"KHR_lights_punctual", {{"light", k}}}}; };
    Json doc = {
        {"asset", {{"version", "2.0"}}},
        {"extensionsUsed", {"KHR_lights_punctual"}},
        {"extensions",
         {{"KHR_lights_punctual", {{"lights", {{{"type", "point"}, {"intensity", 12 * scale * scale}}, {{"type", "directional"}, {"intensity", 2}}}}}}}},
        {"nodes",
         {{{"name", "floor"}, {"mesh", 0}, {"translation", place(0, 0, 0, own)}},
          {{"name", "board"}, {"mesh", 1}, {"translation", place(0, 0.5, 0, own)}},
          {{"name", "lamp"}, {"translation", place(0.75, 2, 0.5, ofLamps)}, {"extensions", lamp(0)}},
          {{"name", "sun"}, {"rotation", {-0.5, 0, 0, 0.8660254}}, {"translation", place(0, 3, 0, ofLamps)}, {"extensions", lamp(1)}},
          {{"name", "panel"},
           {"rotation", {-0.70710678, 0, 0, 0.70710678}},
           {"translation", place(-0.75, 2, 0, ofLamps)},
           {"extras", {{"gobo_light", {{"type", "rect"}, {"width", scale}, {"height", 0.5 * scale}, {"radiance", {3, 2, 1}}}}}}},
          {{"name", "eye"}, {"camera", 0}, {"rotation", {-0.2588190, 0, 0, 0.9659258}}, {"translation", place(0, 2.5, 4, ofLamps)}},
          {{"name", "strip"}, {"mesh", 2}, {"skin", 0}},
          {{"name", "lower"}, {"translation", place(0, 0, 0, ofLamps)}},
          {{"name", "upper"}, {"translation", place(0.25, 0.5, -0.5, ofLamps)}}}},
        {"skins", {{{"joints", {7, 8}}}}},
        {"cameras", {{{"type", "perspective"}, {"perspective", {{"yfov", 0.8}, {"znear", 0.01}}}}}},
        {"materials", {{{"pbrMetallicRoughness", {{"baseColorFactor", {0.7, 0.5, 0.3, 1}}, {"metallicFactor", 0}}}, {"doubleSided", true}}}},
        {"meshes", {mesh(floor), mesh(board), strips}},
        {"animations",
         {{{"samplers", {{{"input", time}, {"output", moves}}}}, {"channels", {{{"sampler", 0}, {"target", {{"node", 1}, {"path", "translation"}}}}}}}}},
        {"accessors", accessors},
        {"bufferViews", views}};
    if (by == By::Vertices) doc["animations"][0]["channels"][0]["target"]["node"] = 2;  // the lamp then
    Json all = Json::array();
    for (size_t i = 0; i < doc["nodes"].size(); ++i) all.push_back(i);
    if (by == By::Root || by == By::Matrix) {
      Json root = {{"name", "root"}, {"children", all}};
      if (by == By::Root) root["translation"] = {at.x, at.y, at.z};
      else root["matrix"] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, at.x, at.y, at.z, 1};
      doc["nodes"].push_back(root);
      all = Json::array({doc["nodes"].size() - 1});
    }
    doc["scenes"] = {{{"nodes", all}}};
    doc["scene"] = 0;
    doc["buffers"] = {{{"byteLength", bin.size()}, {"uri", "data:application/octet-stream;base64," + base64(bin.data(), bin.size())}}};
    const std::string path = folder_.path + "/" + name + ".gltf";
    std::ofstream(path) << doc.dump();
    return path;
  }

  ScenePtr load(const std::string& path) {
    auto scene = loadGltf(path);
    EXPECT_TRUE(scene.ok()) << scene.status().toString();
    return scene.ok() ? *scene : nullptr;
  }

  RenderResult render(const std::string& path, const std::vector<const char*>& edits) {
    const auto opened = engine_->openScene(path, path);
    EXPECT_TRUE(opened.ok()) << opened.status().toString();
    v1::RenderRequest r = smallRequest(path, 48, 36, 16);
    for (const char* e : edits) set(r, e);
    return mustRender(*engine_, r);
  }

  test::TempFolder folder_;
  std::unique_ptr<Engine> engine_ = makeEngine();
};

const std::vector<std::vector<const char*>> kTechniques = {
    {},
    {"integrator.indirect=false"},
    {"integrator.indirect=false", "shadows.ray_traced.samples=4"},
    {"integrator.indirect=false", "shadows.axis_aligned.radius_px=4", "lights.lamp.shadow.ray_traced.samples=1", "lights.sun.shadow.ray_traced.samples=1"},
    {"integrator.indirect=false", "shadows.path_traced=", "lights.lamp.shadow.variance.min_variance=1e-6", "lights.lamp.shadow.map.resolution=256",
     "lights.sun.shadow.percentage_closer.taps=3", "lights.sun.shadow.map.resolution=256"}};

double rmse(const RenderResult& a, const RenderResult& b) {
  const Image &x = a.images.at(0).image(), &y = b.images.at(0).image();
  double sum = 0.0;
  for (size_t k = 0; k < x.data.size(); ++k) sum += std::pow(double(x.data[k]) - double(y.data[k]), 2);
  return std::sqrt(sum / double(x.data.size()));
}

/// Every facet, which is all that keys and pictures know; the scene's own hash has the rig as the file wrote it.
std::string content(const Scene& scene) {
  std::vector<int> lights;
  for (size_t i = 0; i < scene.lights.size(); ++i) lights.push_back(int(i));
  return scene.facetHash(Facet::All, lights).hex();
}

// By whole steps of the grid that origins lie on the scene is the same to the last bit, at rest and in motion.
TEST_F(FarOrigin, TheSceneIsTheSame) {
  for (const auto& [by, name] : kWays) {
    const ScenePtr near = load(write("near", by, DVec3(0.0)));
    ASSERT_TRUE(near);
    EXPECT_EQ(near->origin, DVec3(0.0));
    const auto nearPosed = posedScene(near, "", 0.5);
    for (const double far : {4096.0, 131072.0, 1000000.0}) {
      SCOPED_TRACE(std::string(name) + " " + std::to_string(far));
      const DVec3 at(far, -0.5 * far, 0.75 * far);
      const ScenePtr scene = load(write("far", by, at));
      ASSERT_TRUE(scene);
      EXPECT_EQ(scene->origin, at);
      EXPECT_EQ(content(*scene), content(*near));
      ASSERT_EQ(scene->warnings.size(), near->warnings.size() + 1) << scene->warnings.back();
      EXPECT_EQ(std::count_if(scene->warnings.begin(), scene->warnings.end(),
                              [](const std::string& w) { return w.find("coordinates are relative to") != std::string::npos; }),
                1);
      const auto posed = posedScene(scene, "", 0.5);
      ASSERT_TRUE(posed.ok());
      EXPECT_EQ(content(**posed), content(**nearPosed));
    }
  }
}

// Anywhere else coordinates are rounded once, to 2^-24 of the scene's size.
TEST_F(FarOrigin, ThePictureIsTheSame) {
  const std::string near = write("near", By::Nodes, DVec3(0.0));
  for (const auto& edits : kTechniques) {
    const RenderResult origin = render(near, edits);
    for (const auto& [by, name] : kWays) {
      if (by == By::Vertices) continue;  // floats of the file: it has the scene in steps of 6 cm
      const std::string far = write(name, by, DVec3(1000000.3, -500000.7, 1234567.1));
      EXPECT_LT(rmse(origin, render(far, edits)), 2e-3) << name << " " << (edits.empty() ? "path traced" : edits.back());
    }
    const std::string small = write("small", By::Nodes, DVec3(0.0), 1e-3), large = write("large", By::Nodes, DVec3(0.0), 1e3);
    EXPECT_LT(rmse(origin, render(small, edits)), 2e-3) << "1 mm " << (edits.empty() ? "path traced" : edits.back());
    EXPECT_LT(rmse(origin, render(large, edits)), 2e-3) << "1 km " << (edits.empty() ? "path traced" : edits.back());
  }
}

TEST_F(FarOrigin, NearScenesStayWhereTheyAre) {
  const ScenePtr scene = load(write("here", By::Root, DVec3(200, 0, 0)));  // 50 times its size
  ASSERT_TRUE(scene);
  EXPECT_EQ(scene->origin, DVec3(0.0));
  EXPECT_EQ(scene->instances[0].toWorld[3].x, 200.0f);
  EXPECT_TRUE(scene->warnings.empty());
}

TEST_F(FarOrigin, BeyondTheLargestCoordinateItIsRefusedAsBefore) {
  const auto scene = loadGltf(write("away", By::Root, DVec3(1e18, 0, 0)));
  ASSERT_FALSE(scene.ok());
  EXPECT_EQ(scene.status().code(), Code::InvalidArgument) << scene.status().toString();
}

TEST_F(FarOrigin, IsToldAndKept) {
  const std::string path = write("told", By::Root, DVec3(1000000.5, 0, -2000000.25));
  const auto info = engine_->openScene(path, "told");
  ASSERT_TRUE(info.ok()) << info.status().toString();
  ASSERT_TRUE(info->has_origin());
  EXPECT_EQ(info->origin().x(), 1000000.0);  // of steps of 4 m
  EXPECT_EQ(info->origin().z(), -2000000.0);
  EXPECT_LT(std::fabs(info->bounds_min().x()), 4.0f);
  std::string blob;
  ASSERT_TRUE(writeBlob(*load(path), [&](const void* data, size_t bytes) {
                blob.append(static_cast<const char*>(data), bytes);
                return Status();
              }).ok());
  std::vector<uint8_t> room(blob.size() + 64);
  uint8_t* const at = room.data() + (64 - reinterpret_cast<uintptr_t>(room.data()) % 64);
  std::memcpy(at, blob.data(), blob.size());
  const auto again = readSceneBlob(nullptr, {at, blob.size()}, BlobTrust::Foreign);
  ASSERT_TRUE(again.ok()) << again.status().toString();
  EXPECT_EQ((*again)->origin, DVec3(1000000.0, 0.0, -2000000.0));
  const auto posed = posedScene(*again, "", 0.5), posedFirst = posedScene(load(path), "", 0.5);
  EXPECT_EQ((*posed)->hash().hex(), (*posedFirst)->hash().hex());
}

}  // namespace
}  // namespace gobo::testing
