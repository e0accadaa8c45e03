// SPDX-License-Identifier: Apache-2.0
// Plans of scenes with clear glass: pictures by every technique against path tracing, keys, and what is reported as not covered.
#include <gtest/gtest.h>

#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "plan/planner.h"
#include "request/material_kinds.h"
#include "support/engines.h"
#include "support/tiny_scenes.h"

namespace gobo::testing {
namespace {

/// A floor, a small solid above it, and a pane over both; the camera is between pane and floor.
struct Glazed {
  std::string path;
  explicit Glazed(const std::string& pane, int number = 0) {
    path = (std::filesystem::temp_directory_path() / ("gobo-glazed-" + std::to_string(::getpid()) + "-" + std::to_string(number) + ".gltf")).string();
    std::ofstream(path)
        << R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1,2,3]}],"cameras":[{"type":"perspective","perspective":{"yfov":0.8,"znear":0.1}}],
"nodes":[{"name":"floor","mesh":0,"rotation":[-0.70710678,0,0,0.70710678],"scale":[4,4,4]},{"name":"solid","mesh":0,"rotation":[-0.70710678,0,0,0.70710678],"translation":[0.2,0.5,0],"scale":[0.4,0.4,0.4]},
{"name":"pane","mesh":1,"rotation":[-0.70710678,0,0,0.70710678],"translation":[0,2,0],"scale":[4,4,4]},
{"camera":0,"translation":[0,1.5,3],"rotation":[-0.2588,0,0,0.9659]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0}]},{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":1}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[-1,-1,0],"max":[1,1,0]},{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":12}],
"buffers":[{"byteLength":60,"uri":"data:application/octet-stream;base64,AACAvwAAgL8AAAAAAACAPwAAgL8AAAAAAACAPwAAgD8AAAAAAACAvwAAgD8AAAAAAAABAAIAAAACAAMA"}],
"materials":[{"doubleSided":true,"pbrMetallicRoughness":{"roughnessFactor":1,"metallicFactor":0,"baseColorFactor":[0.6,0.6,0.6,1]}},)"
        << pane << R"(],"extensionsUsed":["KHR_materials_transmission","KHR_materials_ior"]})";
  }
  ~Glazed() {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
  }
};
std::string pane(const char* colour, double ior, double transmission = 1) {
  return std::string(R"({"doubleSided":true,"pbrMetallicRoughness":{"roughnessFactor":0,"metallicFactor":0,"baseColorFactor":[)") + colour +
         R"(,1]},"extensions":{"KHR_materials_transmission":{"transmissionFactor":)" + std::to_string(transmission) + R"(},"KHR_materials_ior":{"ior":)" +
         std::to_string(ior) + "}}}";
}

v1::RenderRequest request(const std::string& scene, const char* technique, bool area, int spp = 64) {
  v1::RenderRequest r = smallRequest(scene, 24, 18, spp);
  for (const char* e : {"integrator.at_view_samples=true", "lights.lamp.position=0.6,5,0.5", "lights.lamp.direction=0,-1,0", technique}) set(r, e);
  if (area)
    for (const char* e : {"lights.lamp.kind=RECT", "lights.lamp.width=0.5", "lights.lamp.height=0.5", "lights.lamp.intensity=40"}) set(r, e);
  else
    for (const char* e : {"lights.lamp.kind=POINT", "lights.lamp.intensity=20"}) set(r, e);
  return r;
}
double mean(const Image& image, int channel) {
  double s = 0;
  for (size_t i = size_t(channel); i < image.data.size(); i += 3) s += image.data[i] * 3.0 / double(image.data.size());
  return s;
}

TEST(ClearGlassPlans, EveryTechniqueShowsTheTracersPicture) {
  const Glazed file(pane("0.9,0.6,0.3", 1.5));
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene(file.path, "glazed").ok());
  for (const bool area : {false, true}) {
    const RenderResult traced = mustRender(*engine, request("glazed", "shadows.path_traced=", area));
    ASSERT_FALSE(traced.images.empty());
    const Image& a = traced.images[0].image();
    EXPECT_LT(mean(a, 2), 0.5 * mean(a, 0)) << "the floor is lit through the pane";
    for (const char* technique : {"shadows.ray_traced.samples=16", "shadows.axis_aligned.max_samples=64", "shadows.percentage_closer.taps=2",
                                  "shadows.percentage_closer_soft.filter_taps=64", "shadows.auto.error=0.05"}) {
      SCOPED_TRACE(std::string(technique) + (area ? " area" : " point"));
      if (!area && std::string(technique).find("axis") != std::string::npos) continue;
      const RenderResult other = mustRender(*engine, request("glazed", technique, area));
      ASSERT_FALSE(other.images.empty());
      const Image& b = other.images[0].image();
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(mean(b, c), mean(a, c), 0.03 * mean(a, c));
    }
  }
}

TEST(ClearGlassPlans, VisibilityAsAnOutputIsTheLuminanceOfItsChannels) {
  const Glazed file(pane("0.9,0.6,0.3", 1.0));
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene(file.path, "glazed").ok());
  v1::RenderRequest r = request("glazed", "shadows.ray_traced.samples=1", false, 1);
  set(r, "outputs=visibility:lamp");
  const RenderResult a = mustRender(*engine, r);
  ASSERT_EQ(a.images.size(), 1u);
  EXPECT_EQ(a.images[0].image().channels, 1);
  float most = 0;
  size_t tinted = 0;
  for (float v : a.images[0].image().data) tinted += std::fabs(v - (0.2126f * 0.9f + 0.7152f * 0.6f + 0.0722f * 0.3f)) < 1e-3f, most = std::max(most, v);
  EXPECT_GT(tinted, 100u);
  EXPECT_LE(most, 1.0f);
}

TEST(ClearGlassPlans, ColdIsWarmWhateverOfThePaneChanges) {
  // Scenes that differ in the pane alone: colour, index, how much it transmits. One engine gives what a fresh one gives.
  const auto warm = makeEngine();
  int number = 0;
  for (const std::string& p :
       {pane("0.9,0.6,0.3", 1.0), pane("0.3,0.6,0.9", 1.0), pane("0.3,0.6,0.9", 1.6), pane("0.3,0.6,0.9", 1.6, 0.5), pane("0.3,0.6,0.9", 1.6, 0.0)}) {
    const Glazed file(p, ++number);
    const std::string name = "glazed" + std::to_string(number);
    ASSERT_TRUE(warm->openScene(file.path, name).ok());
    const auto cold = makeEngine();
    ASSERT_TRUE(cold->openScene(file.path, name).ok());
    for (const char* technique :
         {"shadows.ray_traced.samples=2", "shadows.axis_aligned.max_samples=16", "shadows.percentage_closer_soft.filter_taps=16", "shadows.auto.error=0.1"}) {
      v1::RenderRequest r = request(name, technique, true, 1);
      set(r, "outputs=direct,visibility:lamp");
      EXPECT_EQ(firstDifference(mustRender(*warm, r), mustRender(*cold, r)), "") << p << " " << technique;
    }
  }
}

TEST(ClearGlassPlans, OnlyReflectionsAreLeftToPhotons) {
  const auto kinds = [](const std::function<void(Bsdf&)>& change) {
    tests::SceneMaker m;
    m.instance(m.mesh(tests::ground(1.0f), m.material(Vec3(0.5f), [&](Material& x) {
      x.bsdf = {};
      x.bsdf.transmission = 1;
      x.bsdf.roughness = 0;
      change(x.bsdf);
    })));
    LightShape s;
    m.light(s);
    m.camera(Vec3(0, 2, 0), Vec3(0.0f));
    return materialKinds(*m.finish());
  };
  const MaterialKinds nothing = kinds([](Bsdf&b) { b.ior = 1; }), fog = kinds([](Bsdf&b) {
                                                                    b.ior = 1;
                                                                    b.thickness = 1;
                                                                    b.attenuationColor = Vec3(0.5f);
                                                                    b.attenuationDistance = 1;
                                                                  });
  EXPECT_TRUE(nothing.clear && fog.clear);
  EXPECT_FALSE(nothing.specular || fog.specular) << "shadow rays reach every light through an index of 1";
  const MaterialKinds half = kinds([](Bsdf&b) {
    b.ior = 1;
    b.transmission = 0.5f;
  }),
                      glass = kinds([](Bsdf&) {});
  EXPECT_TRUE(half.clear && half.specular && glass.clear && glass.specular) << "a pane reflects besides";
  const MaterialKinds block = kinds([](Bsdf& b) { b.thickness = 1; });
  EXPECT_TRUE(!block.clear && block.specular);
}

}  // namespace
}  // namespace gobo::testing
