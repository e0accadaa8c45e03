// SPDX-License-Identifier: Apache-2.0
// Mattes as requests ask for them: with the edges of the beauty whatever the camera is, the same bits in parts and on any threads, of a shutter's slices.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>

#include "import/load.h"
#include "plan/cryptomatte.h"
#include "support/animated_scene.h"
#include "support/engines.h"
#include "support/tiny_scenes.h"
#include "terms/cryptomatte.h"

namespace gobo::testing::cryptomatte_plan_test {
namespace {

constexpr const char* kBoth = "outputs=cryptomatte_object,cryptomatte_material";

v1::RenderRequest request(const std::vector<std::string>& edits, const char* scene = "spheres", int spp = 64) {
  v1::RenderRequest r = smallRequest(scene, 40, 30, spp);
  set(r, kBoth);
  for (const std::string& e : edits) set(r, e);
  return r;
}

const Image& imageOf(const RenderResult& r, const std::string& output) {
  for (const RenderedImage& i : r.images)
    if (i.output == output) return i.image();
  ADD_FAILURE() << "no " << output;
  return r.images.at(0).image();
}

std::map<uint32_t, double> matteAt(const Image& image, size_t pixel) {
  std::map<uint32_t, double> out;
  for (int k = 0; k < image.channels; k += 2) {
    const float* const pair = &image.data[pixel * size_t(image.channels) + size_t(k)];
    if (pair[1] > 0.0f) out[std::bit_cast<uint32_t>(pair[0])] += double(pair[1]);
  }
  return out;
}

/// The beauty's alpha is made of the path tracer's rays: with a transparent background what is not hit is what mattes leave.
TEST(CryptomattePlan, TogetherTheyCoverWhatTheBeautyCovers) {
  const std::string moving = writeAnimatedScene("cryptomatte");
  const std::vector<std::vector<std::string>> cases{
      {},
      {"camera.lens_radius=0.15", "camera.focus_distance=3"},
      {"integrator.sampler=HALTON"},
      {"integrator.sampler=INDEPENDENT"},
      {"integrator.at_view_samples=true", "view_samples=3"},
      {"integrator.at_view_samples=true", "view_samples=4", "camera.lens_radius=0.15", "camera.focus_distance=3"},
      {"integrator.at_view_samples=true", "view_samples=4", "integrator.sampler=HALTON"},
      {"integrator.at_view_samples=true", "view_samples=7", "integrator.sampler=HALTON"},  // 64 are no multiple
      {"seed=9", "halt.spp=16"},
      {"camera.clip_near=6.6", "camera.clip_far=8.5"},
      {"camera.panorama=true"},
      {"camera.orthographic_height=30"},
      {"camera.cull_back_faces=true"},
      {"scene=moving", "camera.shutter_s=0.8", "camera.shutter_slices=4", "halt.spp=64"},
      {"scene=moving", "camera.shutter_s=0.8", "camera.shutter_slices=4", "halt.spp=64", "camera.lens_radius=0.1", "camera.focus_distance=3"}};
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene(moving, "moving").ok());
  for (const auto& edits : cases) {
    std::string name;
    for (const std::string& e : edits) name += e + " ";
    SCOPED_TRACE(name);
    v1::RenderRequest r = request(edits);
    for (const char* e : {"outputs=beauty,cryptomatte_object,cryptomatte_material", "environment.constant=1,1,1", "environment.background=TRANSPARENT"})
      set(r, e);
    const RenderResult made = mustRender(*engine, r);
    const Image& beauty = imageOf(made, "beauty");
    ASSERT_EQ(beauty.channels, 4);
    int moved = 0, edges = 0;
    double bias = 0;
    const int samples = int(r.halt().spp());
    for (size_t p = 0; p < beauty.pixels(); ++p) {
      const double alpha = beauty.data[4 * p + 3];
      edges += alpha > 0.001 && alpha < 0.999;
      for (const char* output : {"cryptomatte_object", "cryptomatte_material"}) {
        double sum = 0;
        for (const auto& [id, share] : matteAt(imageOf(made, output), p)) sum += share;
        ASSERT_NEAR(sum, alpha, 2.5 / samples) << output << " pixel " << p;  // a ray along an edge meets or misses it by its last bit
        moved += std::abs(sum - alpha) > 1e-5;
        bias += sum - alpha;
      }
    }
    EXPECT_LT(moved, int(beauty.pixels()) / 50);
    EXPECT_GT(edges, 20);
    EXPECT_LT(std::abs(bias) / double(beauty.pixels()), 1e-3);
  }
}

TEST(CryptomattePlan, IdsAreThoseOfTheSceneAndAgreeWithObjectIds) {
  const auto engine = makeEngine();
  v1::RenderRequest r = request({"view_samples=1"});
  set(r, "outputs=object_id,material_id,cryptomatte_object,cryptomatte_material");
  const RenderResult made = mustRender(*engine, r);
  const auto scene = *engine->scene("spheres");
  for (const bool materials : {false, true}) {
    const std::vector<std::string> names = matteNames(*scene, materials ? MatteOf::Materials : MatteOf::Objects);
    const Image &matte = imageOf(made, materials ? "cryptomatte_material" : "cryptomatte_object"),
                &number = imageOf(made, materials ? "material_id" : "object_id");
    int whole = 0;
    for (size_t p = 0; p < matte.pixels(); ++p) {
      const auto found = matteAt(matte, p);
      for (const auto& [id, share] : found)
        EXPECT_TRUE(std::any_of(names.begin(), names.end(), [&, id = id](const std::string& n) { return cryptomatteId(n) == id; }));
      if (found.size() != 1 || found.begin()->second < 0.9999) continue;  // what the pixel's middle shows
      ++whole;
      ASSERT_GE(number.data[p], 0.0f);
      EXPECT_EQ(found.begin()->first, cryptomatteId(names[size_t(number.data[p])])) << p;
    }
    EXPECT_GT(whole, 300);
  }
  EXPECT_EQ(made.attributes.size(), 2u);
  EXPECT_TRUE(made.attributes.at("cryptomatte_object").count("cryptomatte/f834d0a/manifest"));
  EXPECT_EQ(nodesBy(made, v1::NodeReport::RUN).count("cryptomatte"), 1u) << "one node for both";
}

TEST(CryptomattePlan, PartsAndThreadsHaveTheBitsOfTheWhole) {
  for (const std::vector<std::string>& edits : std::vector<std::vector<std::string>>{{}, {"camera.lens_radius=0.15", "camera.focus_distance=3"}}) {
    const v1::RenderRequest r = request(edits, "fence", 16);
    const RenderResult whole = mustRender(*makeEngine(256ull << 20, {}, 5), r);
    EXPECT_EQ(firstDifference(whole, mustRender(*makeEngine(256ull << 20, {}, 1), r)), "");
    v1::RenderRequest part = r;
    part.mutable_window()->set_x(7);
    part.mutable_window()->set_y(11);
    part.mutable_window()->set_width(23);
    part.mutable_window()->set_height(9);
    const RenderResult window = mustRender(*makeEngine(), part);
    for (size_t k = 0; k < 2; ++k)
      for (int y = 0; y < 9; ++y)
        for (int x = 0; x < 23; ++x)
          ASSERT_EQ(std::memcmp(window.images[k].image().at(x, y), whole.images[k].image().at(x + 7, y + 11), sizeof(float) * kCryptomatteChannels), 0);
  }
}

TEST(CryptomattePlan, AShutterRanksTheMeanOfItsSlices) {
  const std::string moving = writeAnimatedScene("cryptomatte-shutter");
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene(moving, "moving").ok());
  v1::RenderRequest r = request({"scene=moving", "camera.shutter_s=0.8", "camera.shutter_slices=4", "halt.spp=64"});
  const RenderResult blurred = mustRender(*engine, r);
  // The same moments one by one; their own sequences are others, so that pixels agree as shares of 64 rays do.
  std::vector<std::map<uint32_t, double>> sums(40 * 30);
  for (int k = 0; k < 4; ++k) {
    v1::RenderRequest moment = request({"scene=moving", "time_s=" + std::to_string((k + 0.5) / 4 * 0.8), "seed=" + std::to_string(k + 1)});
    const RenderResult made = mustRender(*engine, moment);
    for (size_t p = 0; p < sums.size(); ++p)
      for (const auto& [id, share] : matteAt(imageOf(made, "cryptomatte_object"), p)) sums[p][id] += share / 4;
  }
  const Image& image = imageOf(blurred, "cryptomatte_object");
  int partial = 0;
  for (size_t p = 0; p < sums.size(); ++p) {
    auto found = matteAt(image, p);
    for (const auto& [id, share] : sums[p]) {
      EXPECT_NEAR(found[id], share, 5 * std::sqrt(share * (1 - share) / 64) + 1.0 / 64) << p;
      partial += share > 0.01 && share < 0.99;
    }
    for (int k = 2; k < image.channels; k += 2)
      EXPECT_LE(image.data[p * size_t(image.channels) + size_t(k) + 1], image.data[p * size_t(image.channels) + size_t(k) - 1]);
  }
  EXPECT_GT(partial, 50);
}

/// Whatever a render shows on its way and wherever it ends: what it says that it got is a request of the same mattes.
TEST(CryptomattePlan, RaysAreThoseOfTheSamplesThatItGot) {
  const auto engine = makeEngine(), cold = makeEngine();
  v1::RenderRequest r = request({});
  std::vector<RenderResult> snapshots;
  RenderControl control;
  control.snapshot = [&](const RenderResult& s) { snapshots.push_back(s); };
  const auto last = engine->render(r, control);
  ASSERT_TRUE(last.ok()) << last.status().toString();
  ASSERT_EQ(snapshots.size(), 2u);  // of 16 and 32
  for (const RenderResult& s : snapshots) EXPECT_EQ(firstDifference(s, mustRender(*cold, s.reply.resolved())), "") << s.reply.resolved().halt().spp();
  EXPECT_EQ(last->reply.resolved().halt().spp(), 64u);
  EXPECT_EQ(firstDifference(*last, mustRender(*cold, r)), "");
  EXPECT_NE(firstDifference(snapshots[0], *last), "");
  set(r, "halt.spp=4096");  // beyond 256 nothing changes: that is the reply
  snapshots.clear();
  const auto many = engine->render(r, control);
  ASSERT_TRUE(many.ok()) << many.status().toString();
  EXPECT_EQ(snapshots.size(), 4u);
  EXPECT_EQ(many->reply.resolved().halt().spp(), 4096u);
  r.clear_halt();
  r.mutable_halt()->set_time_s(20);
  const RenderResult timed = mustRender(*engine, r);
  EXPECT_EQ(timed.reply.resolved().halt().spp(), 256u);
  EXPECT_EQ(firstDifference(timed, mustRender(*cold, timed.reply.resolved())), "");
  EXPECT_EQ(firstDifference(timed, *many), "");
}

/// A file may have lamps alone: mattes of it are asked for, and there are none.
TEST(CryptomattePlan, ASceneWithoutObjectsHasNone) {
  tests::SceneMaker m;
  m.light(LightShape{});
  m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.5f);
  RenderControl control;
  control.scene = m.finish();
  for (const char* outputs : {kBoth, "outputs=cryptomatte_object", "outputs=cryptomatte_material"}) {
    const auto made = makeEngine()->render(request({outputs}), control);
    ASSERT_TRUE(made.ok()) << outputs << ": " << made.status().toString();
    for (const RenderedImage& image : made->images)
      for (const float v : image.pixels()) ASSERT_EQ(v, 0.0f) << image.output;
    EXPECT_EQ(made->attributes.size(), made->images.size());
    for (const auto& [output, attributes] : made->attributes)
      EXPECT_EQ(attributes.at(output == "cryptomatte_object" ? "cryptomatte/f834d0a/manifest" : "cryptomatte/bda530a/manifest"), "{}");
  }
}

TEST(CryptomattePlan, HalvesHoldNoIds) {
  const auto engine = makeEngine();
  const Status refused = engine->render(request({"encoding.format=RAW_HALF"})).status();
  EXPECT_EQ(refused.code(), Code::InvalidArgument);
  EXPECT_EQ(refused.location(), "request.encoding.format");
  EXPECT_NE(refused.message().find("RAW_HALF: 16 bits do not hold the ids of 'cryptomatte_object'"), std::string::npos) << refused.message();
  for (const char* format : {"encoding.format=RAW_FLOAT", "encoding.format=PNG", "encoding.half=true"})
    EXPECT_TRUE(engine->render(request({format})).ok()) << format;
}

TEST(CryptomattePlan, NamesOfOneIdAreWarnedOf) {
  tests::SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  const int square = m.mesh(tests::quad(Vec3(-1, -1, 0), Vec3(2, 0, 0), Vec3(0, 2, 0)), grey);
  m.scene.instances.push_back({"ball23993", square, Mat4(1.0f)});
  m.scene.instances.push_back({"ball112595", square, Mat4(1.0f)});
  m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.5f);
  RenderControl control;
  control.scene = m.finish();
  const v1::RenderRequest r = request({});
  const auto made = makeEngine()->render(r, control);
  ASSERT_TRUE(made.ok()) << made.status().toString();
  const auto& warnings = made->reply.warnings();
  EXPECT_EQ(std::count(warnings.begin(), warnings.end(), "cryptomatte_object: names 'ball23993' and 'ball112595' have one id"), 1);
  EXPECT_TRUE(std::none_of(warnings.begin(), warnings.end(), [](const std::string& w) { return w.starts_with("cryptomatte_material"); }));
}

TEST(CryptomattePlan, BackFacesThatTheCameraPassesAreNotThere) {
  tests::SceneMaker m;
  const int wall = m.material(Vec3(0.5f), [](Material&k) { k.coverage.doubleSided = false; }), blue = m.material(Vec3(0.5f));
  m.instance(m.mesh(tests::quad(Vec3(1, -1, 1), Vec3(-2, 0, 0), Vec3(0, 2, 0)), wall));  // turned away
  m.instance(m.mesh(tests::sphere(Vec3(0.0f), 0.5f, 12, true), blue));
  m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.5f);
  RenderControl control;
  control.scene = m.finish();
  for (const bool passes : {false, true}) {
    v1::RenderRequest r = request({"camera.cull_back_faces=" + std::string(passes ? "true" : "false")});
    const auto made = makeEngine()->render(r, control);
    ASSERT_TRUE(made.ok()) << made.status().toString();
    double ball = 0, front = 0;
    for (size_t p = 0; p < 40 * 30; ++p) {
      auto found = matteAt(imageOf(*made, "cryptomatte_object"), p);
      ball += found[cryptomatteId("i1")];
      front += found[cryptomatteId("i0")];
    }
    EXPECT_EQ(ball > 50, passes) << ball;
    EXPECT_EQ(front > 50, !passes) << front;
  }
}

/// What is edited of lights does not trace mattes again; a camera that moves does.
TEST(CryptomattePlan, IsKeptWhileLightsChange) {
  const auto engine = makeEngine();
  v1::RenderRequest r = request({"lights.lamp.kind=POINT", "lights.lamp.position=1,3,1"});
  mustRender(*engine, r);
  set(r, "lights.lamp.intensity=4");
  EXPECT_TRUE(nodesBy(mustRender(*engine, r), v1::NodeReport::RUN).empty());
  set(r, "seed=3");
  EXPECT_EQ(nodesBy(mustRender(*engine, r), v1::NodeReport::RUN).count("cryptomatte"), 1u);
}

}  // namespace
}  // namespace gobo::testing::cryptomatte_plan_test
