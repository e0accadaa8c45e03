// SPDX-License-Identifier: Apache-2.0
// Lights that share a cluster (more lights than integrator.max_groups), recoloured by a request: the picture is that of a scene which has
// the new colour in its file, channel by channel. Delta lights, one surface event, view samples: there is no noise to hide behind.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "scene/edit.h"
#include "support/engines.h"

namespace gobo::testing {
namespace {

constexpr int kLights = 20;

std::shared_ptr<Mesh> mesh(const char* name, std::vector<Vec3> positions, std::vector<uint32_t> indices) {
  auto m = std::make_shared<Mesh>();
  m->name = name;
  m->positions = std::move(positions);
  m->indices = std::move(indices);
  sealMesh(*m);
  return m;
}

/// A floor and a small roof over it under 20 point lights of many colours, the last four of which are weak: red, green, black and a
/// rectangle that the camera sees.
ScenePtr room() {
  auto s = std::make_shared<Scene>();
  s->name = "room";
  s->materials.resize(1);
  s->materials[0].name = "white";
  s->materials[0].bsdf.specular = 0.0f;
  s->meshes = {mesh("floor", {Vec3(-3, 0, 3), Vec3(3, 0, 3), Vec3(3, 0, -3), Vec3(-3, 0, -3)}, {0, 1, 2, 0, 2, 3}),
               mesh("roof", {Vec3(-0.5f, 0.7f, 0.5f), Vec3(0.5f, 0.7f, 0.5f), Vec3(0.5f, 0.7f, -0.5f), Vec3(-0.5f, 0.7f, -0.5f)}, {0, 1, 2, 0, 2, 3})};
  s->instances = {{"floor", 0, Mat4(1.0f)}, {"roof", 1, Mat4(1.0f)}};
  for (int i = 0; i < kLights; ++i) {
    Light l;
    l.name = "p" + std::to_string(i);
    l.shape.kind = LightKind::Point;
    l.shape.position = Vec3(2.0f * std::cos(float(i)), 1.5f + 0.05f * float(i), 2.0f * std::sin(1.7f * float(i)));
    l.power = Vec3(3.0f + float(i % 3), 3.0f + float(i % 2), 3.0f + float(i % 5));
    s->lights.push_back(l);
  }
  s->lights[16].power = Vec3(0.8f, 0.0f, 0.0f);
  s->lights[17].power = Vec3(0.0f, 0.6f, 0.0f);
  s->lights[18].power = Vec3(0.0f);
  Light& rect = s->lights[19];
  rect.shape.kind = LightKind::Rect;
  rect.shape.position = Vec3(0.2f, 1.0f, -1.0f);
  rect.shape.axis = Vec3(0, 0, 1);
  rect.shape.u = Vec3(0.3f, 0, 0);
  rect.shape.v = Vec3(0, 0.2f, 0);
  rect.power = Vec3(0.05f, 0.0f, 0.0f);
  Camera c;
  c.name = "eye";
  c.toWorld = Mat4(Vec4(1, 0, 0, 0), Vec4(0, 0.8f, -0.6f, 0), Vec4(0, 0.6f, 0.8f, 0), Vec4(0, 3.0f, 4.0f, 1));
  s->cameras = {c};
  const Status sealed = s->seal();
  EXPECT_TRUE(sealed.ok()) << sealed.toString();
  return s;
}

RenderResult renderOf(Engine& engine, const ScenePtr& scene, const v1::RenderRequest& request) {
  RenderControl control;
  control.scene = scene;
  Result<RenderResult> r = engine.render(request, control);
  EXPECT_TRUE(r.ok()) << r.status().toString();
  return r.ok() ? std::move(*r) : RenderResult{};
}

/// The largest difference of each channel over the largest value of any.
Vec3 worst(const Image& a, const Image& b) {
  Vec3 difference(0.0f);
  float most = 1e-6f;
  for (size_t i = 0; i < a.data.size(); ++i) {
    difference[int(i % 3)] = std::max(difference[int(i % 3)], std::fabs(a.data[i] - b.data[i]));
    most = std::max(most, std::fabs(b.data[i]));
  }
  return difference / most;
}

v1::RenderRequest request() {
  v1::RenderRequest r = smallRequest("room", 32, 24, 1);
  r.set_view_samples(1);
  for (const char* a :
       {"shadows.ray_traced.samples=1", "integrator.indirect=false", "integrator.at_view_samples=true", "integrator.max_groups=16", "outputs=direct,emission"})
    set(r, a);
  return r;
}

struct Edit {
  const char* what;
  std::vector<std::string> set;
  int light;
  Vec3 power;
};
const std::vector<Edit>& edits() {
  static const std::vector<Edit> all{
      {"red made blue", {"lights.p16.color=0,0,1", "lights.p16.intensity=5"}, 16, Vec3(0, 0, 5)},
      {"green made white by less", {"lights.p17.color=1,1,1", "lights.p17.intensity=0.1"}, 17, Vec3(0.1f)},
      {"black switched on", {"lights.p18.color=0.2,0.9,0.4", "lights.p18.intensity=6"}, 18, Vec3(1.2f, 5.4f, 2.4f)},
      {"red switched off", {"lights.p16.enabled=false"}, 16, Vec3(0.0f)},
      {"gain", {"lights.p17.gain=3,2,1"}, 17, Vec3(0.0f, 1.2f, 0.0f)},
      {"a lamp that is seen", {"lights.p19.color=0.1,0.2,3", "lights.p19.intensity=1"}, 19, Vec3(0.1f, 0.2f, 3.0f)},
  };
  return all;
}

TEST(ClusterEdits, AreThePictureOfTheEditedFile) {
  const ScenePtr scene = room();
  const auto warm = makeEngine();
  const RenderResult before = renderOf(*warm, scene, request());
  ASSERT_EQ(before.images.size(), 2u);
  for (const Edit& edit : edits()) {
    v1::RenderRequest relight = request();
    for (const std::string& s : edit.set) set(relight, s);
    const RenderResult relit = renderOf(*warm, scene, relight);
    const auto edited = editScene(*scene, [&](Scene& s) -> Status {
      s.lights[size_t(edit.light)].power = edit.power;
      return {};
    });
    ASSERT_TRUE(edited.ok());
    const RenderResult truth = renderOf(*makeEngine(), *edited, request());
    const bool area = edit.light == 19;  // its soft shadow is sampled: direct light is compared elsewhere, what the camera sees here
    for (size_t k = area ? 1 : 0; k < 2; ++k) {
      const Vec3 error = worst(relit.images[k].image(), truth.images[k].image()), change = worst(before.images[k].image(), truth.images[k].image());
      for (int c = 0; c < 3; ++c) EXPECT_LT(error[c], 2e-5f) << edit.what << ", " << relit.images[k].output << ", channel " << c;
      if (k == (area ? 1 : 0)) { EXPECT_GT(maxComponent(change), 1e-3f) << edit.what << ": invisible, the test says nothing"; }
    }
  }
}

// Whatever makes them: what is taken off a cluster is what the light's own technique put into it. Paths have no style, and no map's errors.
TEST(ClusterEdits, HaveTheShadowsOfTheirTechnique) {
  const ScenePtr scene = room();
  const auto engine = makeEngine();
  for (const std::string technique : {"ray_traced", "style.brightness=1", "style.inflation=0.3", "percentage_closer", "exponential"}) {
    SCOPED_TRACE(technique);
    v1::RenderRequest r = request();
    set(r, "integrator.at_view_samples=false");
    v1::ShadowTechnique& shadows = *r.mutable_shadows();
    if (technique.find('=') != std::string::npos) set(r, "shadows." + technique);
    else shadows.GetReflection()->MutableMessage(&shadows, v1::ShadowTechnique::descriptor()->FindFieldByName(technique));
    const auto edited = editScene(*scene, [&](Scene& e) -> Status {
      e.lights[16].power = Vec3(0.0f);
      e.lights[17].power = Vec3(0.0f, 1.2f, 0.0f);
      e.lights[18].power = Vec3(1.2f, 5.4f, 2.4f);
      return {};
    });
    ASSERT_TRUE(edited.ok());
    const Image plain = renderOf(*engine, scene, r).images[0].image(), truth = renderOf(*makeEngine(), *edited, r).images[0].image();
    for (const char* edit : {"lights.p16.enabled=false", "lights.p17.gain=3,2,1", "lights.p18.color=0.2,0.9,0.4", "lights.p18.intensity=6"}) set(r, edit);
    const Image relit = renderOf(*engine, scene, r).images[0].image();
    EXPECT_LT(maxComponent(worst(relit, truth)), 2e-5f);
    EXPECT_GT(maxComponent(worst(plain, truth)), 1e-3f) << "invisible, the test says nothing";
    // All of them off: no ghosts, and no light below zero.
    for (int i = 0; i < kLights; ++i) set(r, "lights.p" + std::to_string(i) + ".enabled=false");
    r.mutable_lights()->operator[]("p17").clear_gain();
    const float most = *std::max_element(plain.data.begin(), plain.data.end());
    const Image night = renderOf(*engine, scene, r).images[0].image();
    for (const float v : night.data) ASSERT_LT(std::fabs(v), 2e-5f * most);
  }
}

// However weak: inside the cluster its gain would be path traced over what transfer brought of it.
TEST(ClusterEdits, AMapHasAGroupOfItsOwn) {
  const auto withMap = editScene(*room(), [&](Scene& s) -> Status {
    Image sky(16, 8, 3);
    for (int y = 0; y < 8; ++y)
      for (int x = 0; x < 16; ++x) sky.at(x, y)[0] = sky.at(x, y)[1] = sky.at(x, y)[2] = 0.01f + 0.01f * float((x + y) % 5);
    s.environment = makeEnvironment("sky", sky);
    Light map;
    map.name = "sky";
    map.shape.kind = LightKind::Environment;
    map.power = Vec3(0.02f);
    s.lights.insert(s.lights.begin() + 7, map);
    return s.seal();
  });
  ASSERT_TRUE(withMap.ok()) << withMap.status().toString();
  for (const int most : {2, 3, 16, 20}) {
    const RelightGroups groups = makeGroups(**withMap, most);
    EXPECT_TRUE(groups.single(groups.groupOf[7])) << most;
    EXPECT_EQ(groups.count, most);
  }
  for (const std::string technique : {"environment.transfer.points=500", "environment.area_lights=8", "environment.subtractive.lights=20"}) {
    SCOPED_TRACE(technique);
    const auto engine = makeEngine();
    v1::RenderRequest r = request();
    set(r, "integrator.at_view_samples=false");
    set(r, technique);
    const auto edited = editScene(**withMap, [&](Scene& s) -> Status {
      s.lights[7].power = Vec3(0.2f);
      return {};
    });
    ASSERT_TRUE(edited.ok());
    const Image plain = renderOf(*engine, *withMap, r).images[0].image(), truth = renderOf(*makeEngine(), *edited, r).images[0].image();
    set(r, "environment.gain=10,10,10");
    const Image relit = renderOf(*engine, *withMap, r).images[0].image();
    EXPECT_LT(maxComponent(worst(relit, truth)), 2e-5f);
    EXPECT_GT(maxComponent(worst(plain, truth)), 1e-3f) << "invisible, the test says nothing";
  }
}

// The front is the technique's and the rest is traced: light that passes the surface, and light that goes on from either side of it.
TEST(ClusterEdits, HaveTheIndirectLightOfTranslucentSurfaces) {
  const auto scene = editScene(*room(), [&](Scene& s) -> Status {
    s.materials[0].bsdf.diffuseTransmission = 0.6f;
    s.materials[0].albedo.factor = Vec3(0.8f);
    return {};
  });
  ASSERT_TRUE(scene.ok());
  for (const char* technique : {"shadows.ray_traced.samples=1", "shadows.subtractive.resolution=1"}) {
    const auto mean = [&](int groups, const char* output) {
      v1::RenderRequest r = smallRequest("room", 32, 24, 256);
      for (const std::string& a : {std::string(technique), std::string("integrator.max_bounces=3"), "integrator.max_groups=" + std::to_string(groups),
                                   std::string("outputs=") + output, std::string("lights.p3.gain=4,2,0.5"), std::string("lights.p4.enabled=false"),
                                   std::string("lights.p5.enabled=false"), std::string("lights.p17.gain=9,9,9")})
        set(r, a);
      const Image picture = renderOf(*makeEngine(), *scene, r).images[0].image();
      double sum = 0;
      for (const float v : picture.data) sum += v;
      return sum / double(picture.data.size());
    };
    for (const char* output : {"indirect", "direct"}) {
      SCOPED_TRACE(std::string(technique) + ", " + output);
      const double apart = mean(16, output);
      EXPECT_GT(apart, 1e-3);
      EXPECT_NEAR(mean(1, output), apart, 0.03 * apart);
    }
  }
}

TEST(ClusterEdits, AnotherColourOfAnEditedLightTracesNothing) {
  const ScenePtr scene = room();
  const auto engine = makeEngine();
  v1::RenderRequest r = request();
  set(r, "lights.p18.intensity=2");
  renderOf(*engine, scene, r);
  set(r, "lights.p18.color=1,0,0.5");
  EXPECT_EQ(renderOf(*engine, scene, r).reply.rays(), 0u);
}

TEST(ClusterEdits, TheClustersGroupHoldsTheEdit) {
  const ScenePtr scene = room();
  const auto engine = makeEngine();
  v1::RenderRequest r = request();
  set(r, "outputs=beauty,group:p18");
  const RenderResult before = renderOf(*engine, scene, r);
  set(r, "lights.p18.intensity=6");
  const RenderResult after = renderOf(*engine, scene, r);
  Image whole = after.images[0].image(), part = after.images[1].image();
  for (size_t i = 0; i < whole.data.size(); ++i) {
    whole.data[i] -= before.images[0].image().data[i];
    part.data[i] -= before.images[1].image().data[i];
  }
  EXPECT_LT(maxComponent(worst(part, whole)), 1e-4f);
  EXPECT_GT(*std::max_element(whole.data.begin(), whole.data.end()), 0.01f);
}

}  // namespace
}  // namespace gobo::testing
