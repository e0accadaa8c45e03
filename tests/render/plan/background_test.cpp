// SPDX-License-Identifier: Apache-2.0
// environment.background: what the camera sees where it sees nothing else. Light, mirrors and refraction are those of the environment, to the bit; another
// background traces camera rays and nothing else; no path is counted twice.
#include <gtest/gtest.h>

#include <cmath>

#include "support/engines.h"

namespace gobo::testing::background_test {
namespace {

const std::vector<std::string> kWays{"shadows.ray_traced.samples=4",    "shadows.axis_aligned.k=2",        "environment.extract_lights=4",
                                     "environment.area_lights=4",       "environment.transfer.points=300", "integrator.max_groups=1",
                                     "integrator.at_view_samples=true", "integrator.indirect=false",       "seed=0"};

v1::RenderRequest request(const std::string& way, std::initializer_list<std::string> edits = {}, const char* scene = "spheres") {
  v1::RenderRequest r = smallRequest(scene, 32, 24, 16);
  set(r, "lights.lamp.kind=RECT");
  set(r, "lights.lamp.position=0,3,2");
  set(r, "lights.lamp.direction=0,-1,0");
  set(r, "lights.lamp.intensity=2");
  set(r, way);
  for (const std::string& e : edits) set(r, e);
  return r;
}

RenderResult withBackground(Engine& engine, v1::RenderRequest r, const std::string& background) {
  set(r, "environment.background=" + background);
  return mustRender(engine, r);
}

const Image& beauty(const RenderResult& r) { return r.images.at(0).image(); }

TEST(Background, AColourStandsWhereTheMapWasAndNothingElseChanges) {
  for (const std::string& way : kWays) {
    SCOPED_TRACE(way);
    const auto engine = makeEngine();
    const v1::RenderRequest base = request(way);
    const RenderResult map = mustRender(*engine, base);
    const RenderResult black = withBackground(*engine, base, "COLOR"), clear = withBackground(*engine, base, "TRANSPARENT");
    v1::RenderRequest coloured = base;
    set(coloured, "environment.background_color=0.25,0.5,4");
    const RenderResult colour = withBackground(*engine, coloured, "COLOR");
    ASSERT_EQ(beauty(clear).channels, 4);
    ASSERT_EQ(beauty(colour).channels, 3);
    int background = 0, scene = 0;
    for (int y = 0; y < 24; ++y)
      for (int x = 0; x < 32; ++x) {
        const Vec3 was = beauty(map).rgb(x, y), none = beauty(black).rgb(x, y), now = beauty(colour).rgb(x, y), front = beauty(clear).rgb(x, y);
        const float alpha = beauty(clear).at(x, y)[3];
        EXPECT_EQ(none, front) << x << "," << y;
        const Vec3 laid = front + (1.0f - alpha) * Vec3(0.25f, 0.5f, 4.0f);
        EXPECT_LT(glm::length(now - laid), 2e-6f * (1.0f + glm::length(laid))) << x << "," << y;
        if (alpha == 0.0f) {
          EXPECT_LT(glm::length(none), 1e-6f) << x << "," << y;
          ++background;
        } else if (alpha == 1.0f) {  // a camera that sees no background sees the same
          EXPECT_LT(glm::length(was - none), 1e-6f * (1.0f + glm::length(was))) << x << "," << y;
          ++scene;
        }
      }
    EXPECT_GT(background, 20);
    EXPECT_GT(scene, 100);
  }
}

TEST(Background, NothingIsTracedAgainForIt) {
  for (const std::string& way : kWays) {
    SCOPED_TRACE(way);
    const auto engine = makeEngine();
    const v1::RenderRequest base = request(way);
    (void)mustRender(*engine, base);
    for (const char* background : {"TRANSPARENT", "COLOR", "BLURRED", "MAP"}) {
      v1::RenderRequest r = base;
      set(r, "environment.background_color=1,1,1");
      for (const auto& [name, row] : nodesBy(withBackground(*engine, r, background), v1::NodeReport::RUN)) {
        const bool camera = name == "background" || name == "environment seen";
        EXPECT_TRUE(camera || row.rays() == 0) << background << " ran " << name;
        if (camera) EXPECT_LE(row.rays(), 32u * 24 * 16) << name;
      }
    }
    // From here on colours are the composite's alone.
    v1::RenderRequest other = base;
    set(other, "environment.background_color=0.2,0.3,0.4");
    uint64_t rays = 0;
    for (const auto& [name, row] : nodesBy(withBackground(*engine, other, "COLOR"), v1::NodeReport::RUN)) rays += row.rays();
    EXPECT_EQ(rays, 0u);
  }
}

TEST(Background, ClassesStillSumToTheBeauty) {
  for (const std::string& way : kWays) {
    const auto engine = makeEngine();  // light is that of the first background: NothingIsTracedAgainForIt
    for (const char* background : {"COLOR", "BLURRED", "TRANSPARENT"}) {
      SCOPED_TRACE(way + " " + background);
      const RenderResult r =
          withBackground(*engine, request(way, {"environment.background_color=0.25,0.5,4", "outputs=beauty,emission,direct,indirect"}), background);
      for (int y = 0; y < 24; ++y)
        for (int x = 0; x < 32; ++x) {
          const Vec3 sum = r.images[1].image().rgb(x, y) + r.images[2].image().rgb(x, y) + r.images[3].image().rgb(x, y);
          EXPECT_LT(glm::length(beauty(r).rgb(x, y) - sum), 1e-5f * (1.0f + glm::length(sum)));
        }
    }
  }
}

TEST(Background, ABlurredConstantIsTheConstantAndFollowsTheGain) {
  const auto engine = makeEngine();
  for (const char* groups : {"integrator.max_groups=16", "integrator.max_groups=1"}) {
    const v1::RenderRequest base = request(groups, {"environment.constant=0.5,0.25,1", "environment.gain=2,3,4"});
    const RenderResult map = mustRender(*engine, base), blurred = withBackground(*engine, base, "BLURRED");
    for (size_t i = 0; i < beauty(map).data.size(); ++i)
      EXPECT_NEAR(beauty(map).data[i], beauty(blurred).data[i], 2e-4f * (1.0f + std::fabs(beauty(map).data[i]))) << groups;
  }
}

TEST(Background, ASceneWithoutAnEnvironmentHasOneToo) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 24, 16, 4);
  set(r, "camera.clip_far=0.01");  // sees nothing else
  set(r, "environment.background_color=1,2,3");
  const RenderResult made = withBackground(*engine, r, "COLOR");
  for (size_t i = 0; i < beauty(made).pixels(); ++i) EXPECT_EQ(beauty(made).rgb(int(i % 24), int(i / 24)), Vec3(1, 2, 3));
  const RenderResult clear = withBackground(*engine, r, "TRANSPARENT");
  for (size_t i = 0; i < beauty(clear).pixels(); ++i) EXPECT_EQ(beauty(clear).data[4 * i + 3], 0.0f);
}

TEST(Background, WarmIsColdAndAWindowIsThePart) {
  for (const char* background : {"COLOR", "TRANSPARENT", "BLURRED"}) {
    const auto warm = makeEngine();
    const v1::RenderRequest base = request("shadows.ray_traced.samples=4", {"environment.background_color=0.1,0.2,0.3"});
    (void)mustRender(*warm, base);
    const RenderResult a = withBackground(*warm, base, background), b = withBackground(*makeEngine(0, {}, 1), base, background);
    EXPECT_EQ(firstDifference(a, b), "") << background;
    v1::RenderRequest part = base;
    for (const char* e : {"window.x=3", "window.y=2", "window.width=9", "window.height=7"}) set(part, e);
    const RenderResult w = withBackground(*warm, part, background);
    for (int y = 0; y < 7; ++y)
      for (int x = 0; x < 9; ++x)
        for (int c = 0; c < beauty(a).channels; ++c) EXPECT_EQ(beauty(w).at(x, y)[c], beauty(a).at(x + 3, y + 2)[c]) << background;
  }
}

TEST(Background, TheCertificateMeasuresAgainstIt) {
  const auto engine = makeEngine();
  const v1::RenderRequest base = request(
      "seed=0", {"environment.background_color=3,3,3", "halt.spp=64", "certificate.pixel_fraction=1", "certificate.spp=64", "integrator.max_bounces=8"});
  const double rmse = mustRender(*engine, base).reply.certificate().rmse();
  for (const char* background : {"COLOR", "TRANSPARENT", "BLURRED"})
    EXPECT_LT(withBackground(*engine, base, background).reply.certificate().rmse(), 2.0 * rmse + 0.02) << background;
}

TEST(Background, VarianceIsOfThePictureThatIsShown) {
  const auto engine = makeEngine();
  const v1::RenderRequest base = request("seed=0", {"outputs=beauty,variance", "halt.spp=128"});
  const RenderResult r = withBackground(*engine, base, "COLOR");  // black
  for (size_t p = 0; p < beauty(r).pixels(); ++p)
    if (beauty(r).data[3 * p] == 0.0f && beauty(r).data[3 * p + 1] == 0.0f) EXPECT_EQ(r.images[1].image().data[3 * p], 0.0f);
}

TEST(Background, APngHasStraightAlphaAndShowsLampsInFrontOfNothing) {
  Image in(4, 1, 4);
  const float pixels[] = {0.25f, 0.125f, 0.0f, 0.5f,  // half covered: the surface's own colour is twice that
                          0.0f,  0.0f,   0.0f, 0.0f,  // nothing
                          0.75f, 0.5f,   0.0f, 0.0f,  // light without a surface: as much alpha as shows it on black
                          2.0f,  1.0f,   0.5f, 1.0f};
  std::copy(std::begin(pixels), std::end(pixels), in.data.begin());
  v1::ToneMap linear;
  linear.set_curve(v1::ToneMap::LINEAR);
  const Image out = toneMapped(in, linear);
  const float expected[] = {0.5f, 0.25f, 0.0f, 0.5f, 0.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.5f / 0.75f, 0.0f, 0.75f, out.data[12], 1.0f, 0.5f, 1.0f};
  ASSERT_EQ(out.channels, 4);
  for (size_t i = 0; i < 16; ++i) EXPECT_NEAR(out.data[i], expected[i], 1e-6f) << i;
  Image edge(1, 1, 4);  // of a bright surface: its share of the pixel is no matter of the exposure
  for (const double stops : {-1.0, 0.0, 3.0}) {
    edge.data = {0.8f, 0.6f, 0.4f, 0.5f};
    linear.set_exposure(stops);
    const Image shown = toneMapped(edge, linear);
    EXPECT_EQ(shown.data[3], 0.5f);
    EXPECT_NEAR(shown.data[2], std::min(0.8f * std::exp2(float(stops)), 1.0f), 1e-5f);
  }
  Image lamp(3, 1, 4);  // behind an edge: what the edge lets by is seen as the rest of it is
  lamp.data = {2.0f, 2.0f, 2.0f, 0.0f, 1.5f, 1.5f, 1.5f, 0.25f, 0.1f, 0.1f, 0.1f, 1.0f};
  linear.set_exposure(0);
  const Image rim = toneMapped(lamp, linear);
  for (const size_t p : {0, 1, 2}) EXPECT_EQ(rim.data[4 * p + 3], 1.0f) << p;
  for (const auto curve : {v1::ToneMap::REINHARD, v1::ToneMap::FILMIC, v1::ToneMap::ACES, v1::ToneMap::PBR_NEUTRAL}) {
    v1::ToneMap t;
    t.set_curve(curve);
    const Image shown = toneMapped(in, t);
    for (const size_t p : {0, 1, 3}) EXPECT_EQ(shown.data[4 * p + 3], in.data[4 * p + 3]) << "alpha is no colour";
  }
}

TEST(Background, BadColoursAreRefusedByName) {
  const auto engine = makeEngine();
  v1::RenderRequest r = request("seed=0");
  set(r, "environment.background=COLOR");
  r.mutable_environment()->mutable_background_color()->set_y(-1.0f);
  const auto made = engine->render(r);
  ASSERT_FALSE(made.ok());
  EXPECT_EQ(made.status().location(), "request.environment.background_color");
}

}  // namespace
}  // namespace gobo::testing::background_test
