// SPDX-License-Identifier: Apache-2.0
// The planner with materials that need more than one node for a class: unlit surfaces (in no light's group) and translucent
// ones (direct light through them is traced, whatever the technique).
#include <gtest/gtest.h>

#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "plan/planner.h"
#include "request/material_kinds.h"
#include "scene/load.h"
#include "support/engines.h"
#include "support/tiny_scenes.h"
#include "terms/surface_reader.h"

namespace gobo::testing::material_plans_test {
namespace {

/// A floor with material 0 and a wall behind it with material 1.
struct TwoQuads {
  std::string path;
  explicit TwoQuads(const std::string& materials) {
    path = (std::filesystem::temp_directory_path() / ("gobo-two-quads-" + std::to_string(::getpid()) + ".gltf")).string();
    std::ofstream(path)
        << R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1,2]}],"cameras":[{"type":"perspective","perspective":{"yfov":0.8,"znear":0.1}}],
"nodes":[{"name":"floor","mesh":0,"rotation":[-0.70710678,0,0,0.70710678],"scale":[4,4,4]},{"name":"wall","mesh":1,"translation":[0,2,-3],"scale":[4,4,4]},
{"camera":0,"translation":[0,1.5,5]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0}]},{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":1}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[-1,-1,0],"max":[1,1,0]},{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":12}],
"buffers":[{"byteLength":60,"uri":"data:application/octet-stream;base64,AACAvwAAgL8AAAAAAACAPwAAgL8AAAAAAACAPwAAgD8AAAAAAACAvwAAgD8AAAAAAAABAAIAAAACAAMA"}],
"materials":)"
        << materials << "}";
  }
  ~TwoQuads() {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
  }
};

const char* const kMirrorAndUnlit = R"([{"pbrMetallicRoughness":{"metallicFactor":1,"roughnessFactor":0}},
{"pbrMetallicRoughness":{"baseColorFactor":[0.9,0.3,0.1,1]},"extensions":{"KHR_materials_unlit":{}}}],"extensionsUsed":["KHR_materials_unlit"])";
const char* const kLeaf =
    R"([{"pbrMetallicRoughness":{"roughnessFactor":0.7,"metallicFactor":0},"extensions":{"KHR_materials_diffuse_transmission":{"diffuseTransmissionFactor":0.5}}},
{"pbrMetallicRoughness":{"baseColorFactor":[0.2,0.5,0.7,1]}}],"extensionsUsed":["KHR_materials_diffuse_transmission"])";

double mean(const Image& image) {
  double s = 0;
  for (float v : image.data) s += v / double(image.data.size());
  return s;
}

TEST(MaterialPlans, UnlitIsPartOfTheBeautyAndOfNoGroup) {
  const TwoQuads file(kMirrorAndUnlit);
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene(file.path, "quads").ok());
  v1::RenderRequest r = smallRequest("quads", 32, 24, 16);
  for (const char* e : {"outputs=beauty,emission,direct,indirect,group:lamp", "lights.lamp.kind=RECT", "lights.lamp.position=0,6,2",
                        "lights.lamp.direction=0,-1,0", "lights.lamp.width=1", "lights.lamp.height=1", "lights.lamp.intensity=9"})
    set(r, e);
  const RenderResult a = mustRender(*engine, r);
  ASSERT_EQ(a.images.size(), 5u);
  const Image &beauty = a.images[0].image(), &emission = a.images[1].image(), &direct = a.images[2].image(), &indirect = a.images[3].image();
  double shown = 0, reflected = 0;
  for (size_t i = 0; i < beauty.data.size(); ++i) {
    const double sum = double(emission.data[i]) + direct.data[i] + indirect.data[i];
    EXPECT_NEAR(beauty.data[i], sum, 1e-5 * (1 + sum));
    if (i % 3 == 0) {
      shown = std::max(shown, double(emission.data[i]));
      reflected = std::max(reflected, double(indirect.data[i]));
    }
  }
  EXPECT_NEAR(shown, 0.9, 1e-4);
  EXPECT_GT(reflected, 0.8);
  set(r, "lights.lamp.gain=5,5,5");
  const RenderResult b = mustRender(*engine, r);
  for (size_t i = 0; i < beauty.data.size(); ++i) {  // only the lamp's group takes the gain
    const double lamp = a.images[4].image().data[i], rest = beauty.data[i] - lamp;
    EXPECT_NEAR(b.images[4].image().data[i], 5 * lamp, 1e-4 * (1 + lamp));
    EXPECT_NEAR(b.images[0].image().data[i], 5 * lamp + rest, 1e-4 * (1 + lamp));
  }
  v1::RenderRequest dark = smallRequest("quads", 32, 24, 16);  // no light at all: unlit still shows
  const RenderResult c = mustRender(*engine, dark);
  ASSERT_FALSE(c.images.empty());
  EXPECT_GT(mean(c.images[0].image()), 0.05);
  // The tone curve is of the whole picture: FILMIC bends unlit colours, LINEAR keeps them (docs/gltf.md).
  const Image& linear = c.images[0].image();
  v1::ToneMap curve;
  curve.set_curve(v1::ToneMap::LINEAR);
  const Image kept = toneMapped(linear, curve);
  curve.set_curve(v1::ToneMap::FILMIC);
  const Image bent = toneMapped(linear, curve);
  size_t pixels = 0;
  for (size_t p = 0; p < linear.pixels(); ++p) {
    if (std::fabs(linear.data[3 * p] - 0.9f) > 1e-5f || std::fabs(linear.data[3 * p + 1] - 0.3f) > 1e-5f) continue;
    ++pixels;
    for (size_t k = 0; k < 3; ++k) {
      const double x = linear.data[3 * p + k];
      EXPECT_EQ(kept.data[3 * p + k], linear.data[3 * p + k]);
      EXPECT_NEAR(bent.data[3 * p + k], x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1e-5);
    }
  }
  EXPECT_GT(pixels, 20u);
}

TEST(MaterialPlans, LightThroughALeafIsTheSameByEveryTechnique) {
  const TwoQuads file(kLeaf);
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene(file.path, "quads").ok());
  const auto direct = [&](const char* technique) {
    v1::RenderRequest r = smallRequest("quads", 24, 18, 256);
    for (const char* e : {"outputs=direct", "integrator.indirect=false", "view_samples=4", "integrator.at_view_samples=true", "lights.under.kind=RECT",
                          "lights.under.position=0.5,-2,0.5", "lights.under.direction=0,1,0", "lights.under.width=1", "lights.under.height=1",
                          "lights.under.intensity=30", "lights.over.kind=POINT", "lights.over.position=-1,2,1", "lights.over.intensity=3", technique})
      set(r, e);
    return mustRender(*engine, r);
  };
  const RenderResult traced = direct("shadows.path_traced="), rays = direct("shadows.ray_traced.samples=64");
  ASSERT_FALSE(traced.images.empty() || rays.images.empty());
  const Image &a = traced.images[0].image(), &b = rays.images[0].image();
  double difference = 0;
  for (size_t i = 0; i < a.data.size(); ++i) difference += std::fabs(a.data[i] - b.data[i]) / double(a.data.size());
  EXPECT_LT(difference, 0.03 * mean(a));
  EXPECT_NEAR(mean(b), mean(a), 0.01 * mean(a));
  EXPECT_TRUE(nodesBy(rays, v1::NodeReport::RUN).count("through") || nodesBy(rays, v1::NodeReport::RUN).count("through:mean")) << "light from below is traced";
}

TEST(MaterialPlans, WhatTheTracerCannotJoinIsNamed) {
  const auto missing = [](const std::function<void(Bsdf&)>& change, bool delta = true) {
    Scene s = **makeBuiltinScene("cornell");
    for (Material& m : s.materials) {
      m.bsdf.roughness = 1;
      change(m.bsdf);
    }
    Light l;
    l.name = "probe";
    l.shape.kind = delta ? LightKind::Point : LightKind::Sphere;
    s.lights.push_back(l);
    return classesNotCovered(s).size();
  };
  EXPECT_EQ(missing([](Bsdf&) {}), 0u);
  EXPECT_EQ(missing([](Bsdf& b) {
              b.metallic = 1;
              b.roughness = 0;
            }),
            1u);
  EXPECT_EQ(missing(
                [](Bsdf& b) {
                  b.metallic = 1;
                  b.roughness = 0;
                },
                false),
            0u);
  EXPECT_EQ(missing([](Bsdf& b) {
              b.specular = 1;
              b.roughness = 0;
            }),
            1u);
  EXPECT_EQ(missing([](Bsdf& b) { b.clearcoat = 1; }), 1u);
  EXPECT_EQ(missing([](Bsdf& b) {
              b.clearcoat = 1;
              b.clearcoatRoughness = 0.5f;
            }),
            0u);
  EXPECT_EQ(missing([](Bsdf& b) { b.transmission = 1; }), 0u);
  EXPECT_EQ(missing([](Bsdf& b) {
              b.transmission = 1;
              b.roughness = 0;
            }),
            1u);
  EXPECT_EQ(missing([](Bsdf& b) {
              b.transmission = 1;
              b.ior = 1;
            }),
            0u)
      << "shadow rays go straight on";
  EXPECT_EQ(missing([](Bsdf& b) {
              b.transmission = 1;
              b.ior = 1;
              b.thickness = 1;
              b.roughness = 0;
            }),
            0u);
  EXPECT_EQ(missing([](Bsdf& b) {
              b.transmission = 0.5f;
              b.specular = 1;
              b.ior = 1;
              b.roughness = 0;
            }),
            1u)
      << "the other half is a smooth coat on diffuse";
  EXPECT_EQ(missing([](Bsdf& b) {
              b.transmission = b.thickness = 1;
              b.roughness = 0;
            }),
            1u);
  EXPECT_EQ(missing([](Bsdf& b) {
              b.transmission = b.thickness = 1;
              b.roughness = 0;
              b.attenuationDistance = 1;
              b.attenuationColor = b.scatterAlbedo = Vec3(0.5f);
            }),
            2u)
      << "on surfaces and inside";
  EXPECT_EQ(missing([](Bsdf& b) {
              b.metallic = 1;
              b.roughness = 0;
              b.unlit = true;
            }),
            0u);
}

// A texture makes a mirror of what its factor says is rough: where its lowest texel does, and exactly there.
TEST(MaterialPlans, WhatARoughnessTextureMakesSmoothIsNamed) {
  const auto scene = [](const std::function<void(Bsdf&)>& change, int texel) {
    tests::SceneMaker m;
    auto t = std::make_shared<Texture>();
    t->name = "roughness";
    t->width = t->height = 2;
    t->nearest = true;
    for (int i = 0; i < 4; ++i)
      for (int c = 0; c < 4; ++c) t->texels8.push_back(uint8_t(c == 1 && i == 2 ? texel : 255));
    sealTexture(*t);
    m.scene.textures.push_back(t);
    m.instance(m.mesh(tests::ground(1.0f), m.material(Vec3(0.5f), [&](Material& x) {
      x.bsdf = {};
      change(x.bsdf);
    })));
    LightShape s;
    s.position = Vec3(0, 2, 0);
    m.light(s);
    m.camera(Vec3(0, 2, 0), Vec3(0.0f));
    return m.finish();
  };
  // The same surface at that texel as the tracer has it.
  const auto mirror = [](const Scene& s) {
    const std::vector<int> none;
    const TaskArena arena(1);
    const SceneView view(s, kSurfaceFacets, none);
    const AccelPtr accel = Accel::build(view, arena);
    SurfaceTable table;
    table.build(view, *accel);
    for (int k = 0; k < 16; ++k) {  // both triangles and every texel
      Hit hit;
      if (!accel->intersect({Vec3(-0.75f + 0.5f * float(k % 4), 1, -0.75f + 0.5f * float(k / 4)), Vec3(0, -1, 0)}, hit)) continue;
      Surface at;
      table.interact(hit.instance, hit.primitive, hit.u, hit.v, hit.Ng, Vec3(0, -1, 0), at);
      if (bsdfIsDelta(at.bsdf)) return true;
    }
    return false;
  };
  const auto named = [](const Scene& s) { return !classesNotCovered(s, false).empty(); };
  int smooth = 0;
  for (const float factor : {1.0f, 0.5f, 0.1f, 0.02f})
    for (const int texel : {0, 4, 8, 9, 60, 90, 255}) {
      const ScenePtr metal = scene(
          [&](Bsdf& b) {
            b.metallic = 1;
            b.roughness = factor;
            b.metallicRoughness.texture = 0;
          },
          texel);
      EXPECT_EQ(named(*metal), mirror(*metal)) << "factor " << factor << ", texel " << texel;
      EXPECT_EQ(materialKinds(*metal).specular, mirror(*metal)) << "factor " << factor << ", texel " << texel;
      const ScenePtr coat = scene(
          [&](Bsdf& b) {
            b.roughness = 1;
            b.clearcoat = 1;
            b.clearcoatRoughness = factor;
            b.clearcoatRoughnessTexture.texture = 0;
          },
          texel);
      EXPECT_EQ(named(*coat), mirror(*metal)) << "coat, factor " << factor << ", texel " << texel;
      const ScenePtr pane = scene(
          [&](Bsdf& b) {
            b.transmission = 1;
            b.roughness = factor;
            b.metallicRoughness.texture = 0;
          },
          texel);
      EXPECT_EQ(materialKinds(*pane).pane, mirror(*pane)) << "pane, factor " << factor << ", texel " << texel;
      smooth += mirror(*metal);
    }
  EXPECT_GT(smooth, 8);
  EXPECT_LT(smooth, 24);
}

}  // namespace
}  // namespace gobo::testing::material_plans_test
