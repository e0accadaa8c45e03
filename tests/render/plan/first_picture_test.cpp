// SPDX-License-Identifier: Apache-2.0
// Never black, never white: what lights a scene that has no light, and the exposure of a PNG that would show nothing.
#include <gtest/gtest.h>

#include <fstream>
#include <limits>

#include "plan/auto_exposure.h"
#include "scene/studio.h"
#include "support/engines.h"
#include "support/small_gltf.h"
#include "support/temp_folder.h"

namespace gobo::testing::first_picture_test {
namespace {

class FirstPicture : public ::testing::Test {
 protected:
  /// The quad of smallGltf with other words in place of some.
  v1::RenderRequest request(std::initializer_list<std::pair<const char*, const char*>> words) {
    std::string text = smallGltf("");
    for (const auto& [from, to] : words) {
      const size_t at = text.find(from);
      EXPECT_NE(at, std::string::npos) << from;
      text.replace(at, std::strlen(from), to);
    }
    const std::string path = folder_.path + "/" + "quad" + std::to_string(files_++) + ".gltf";
    std::ofstream(path) << text;
    EXPECT_TRUE(engine_->openScene(path, path).ok());
    EXPECT_TRUE(cold_->openScene(path, path).ok());
    return smallRequest(path, 16, 12, 16);
  }
  v1::RenderRequest dark() { return request({{R"("nodes":[0,1])", R"("nodes":[0])"}}); }

  static double mean(const RenderResult& r) {
    double sum = 0;
    const Image& image = r.images.at(0).image();
    for (const float v : image.data) sum += v;
    return sum / double(image.data.size());
  }
  static bool warns(const RenderResult& r, const std::string& words) {
    for (const std::string& w : r.reply.warnings())
      if (w.find(words) != std::string::npos) return true;
    return false;
  }

  test::TempFolder folder_;
  int files_ = 0;
  std::unique_ptr<Engine> engine_ = makeEngine(), cold_ = makeEngine(0);
};

TEST_F(FirstPicture, ASceneWithoutLightIsLitAndTheReplySaysSo) {
  const RenderResult lit = mustRender(*engine_, dark());
  EXPECT_GT(mean(lit), 0.1);
  EXPECT_LT(mean(lit), 2.0);
  EXPECT_TRUE(warns(lit, "environment.default = STUDIO"));
  EXPECT_EQ(lit.reply.resolved().environment().default_(), v1::EnvironmentSettings::STUDIO);
  EXPECT_EQ(lit.reply.path_classes_missing_size(), 0);

  const RenderResult again = mustRender(*cold_, lit.reply.resolved());
  EXPECT_EQ(firstDifference(lit, again), "");
  EXPECT_EQ(lit.reply.request_hash(), again.reply.request_hash());

  v1::RenderRequest turned = dark();
  set(turned, "environment.rotation_deg=90");
  EXPECT_NE(firstDifference(lit, mustRender(*engine_, turned)), "");
  v1::RenderRequest gained = dark();
  set(gained, "environment.gain=2,2,2");
  EXPECT_NEAR(mean(mustRender(*engine_, gained)), 2.0 * mean(lit), 1e-4);
  v1::RenderRequest edited = dark();  // it is a light by its name, like any environment
  set(edited, "lights.environment.gain=0.5,0.5,0.5");
  EXPECT_NEAR(mean(mustRender(*engine_, edited)), 0.5 * mean(lit), 1e-4);
}

TEST_F(FirstPicture, APlanThatPrunesEverythingWarns) {
  for (const char* way : {"integrator.max_groups=16", "shadows.ray_traced.samples=1"})
    for (const char* off : {"lights.lamp.enabled=false", "lights.lamp.gain=0,0,0", "lights.lamp.intensity=0"}) {
      v1::RenderRequest r = request({});
      set(r, way);
      EXPECT_FALSE(warns(mustRender(*engine_, r), "is black")) << way;
      set(r, off);
      const RenderResult black = mustRender(*engine_, r);
      EXPECT_EQ(mean(black), 0.0) << off;
      EXPECT_TRUE(warns(black, "beauty is black: no light is left in it")) << way << " " << off;
    }
}

TEST_F(FirstPicture, NoneLeavesItBlack) {
  v1::RenderRequest r = dark();
  set(r, "environment.default=NONE");
  const RenderResult black = mustRender(*engine_, r);
  EXPECT_EQ(mean(black), 0.0);
  EXPECT_TRUE(warns(black, "the picture is black"));
  EXPECT_NE(black.reply.request_hash(), mustRender(*engine_, dark()).reply.request_hash());
}

TEST_F(FirstPicture, AnyLightOfTheSceneOrTheRequestIsEnough) {
  const auto usesStudio = [&](v1::RenderRequest r, std::initializer_list<const char*> edits) {
    for (const char* e : edits) set(r, e);
    return warns(mustRender(*engine_, r), "STUDIO");
  };
  EXPECT_TRUE(usesStudio(dark(), {}));
  EXPECT_FALSE(usesStudio(request({}), {})) << "a lamp";
  EXPECT_FALSE(usesStudio(request({}), {"lights.lamp.enabled=false"})) << "a lamp that is off is off";
  EXPECT_FALSE(usesStudio(dark(), {"lights.new.kind=POINT", "lights.new.position=0,0,2"})) << "a lamp of the request";
  EXPECT_FALSE(usesStudio(dark(), {"environment.constant=1,1,1"}));
  EXPECT_FALSE(usesStudio(dark(), {"environment.constant=0,0,0"})) << "black was asked for";
  EXPECT_FALSE(usesStudio(dark(), {"environment.sky.turbidity=3"}));
  EXPECT_FALSE(usesStudio(dark(), {"environment.path=none"})) << "no environment was asked for";
  EXPECT_FALSE(usesStudio(request({{R"("nodes":[0,1])", R"("nodes":[0])"}, {R"("metallicFactor":0})", R"("metallicFactor":0},"emissiveFactor":[1,1,1])"}}), {}))
      << "an emissive surface";
  const auto glow = [&](const char* material, const char* used) {  // its picture is white
    return request({{R"("nodes":[0,1])", R"("nodes":[0])"},
                    {R"("extensionsUsed":["KHR_lights_punctual")", used},
                    {R"("materials":)", R"("images":[{"uri":"white.png"}],"textures":[{"source":0}],"materials":)"},
                    {R"("metallicFactor":0})", material}});
  };
  const char* plain = R"("extensionsUsed":["KHR_lights_punctual")";
  const std::string white = smallPng(255, 255, 255);
  std::ofstream(folder_.path + "/white.png", std::ios::binary).write(white.data(), std::streamsize(white.size()));
  const char* painted = R"("metallicFactor":0},"emissiveFactor":[1,1,1],"emissiveTexture":{"index":0})";
  EXPECT_TRUE(usesStudio(glow(painted, plain), {})) << "a picture that glows is no lamp";
  EXPECT_FALSE(usesStudio(glow(painted, plain), {"environment.default=NONE"}));
  EXPECT_FALSE(usesStudio(
      glow(
          R"("metallicFactor":0},"emissiveFactor":[1,1,1],"emissiveTexture":{"index":0},"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":2}})",
          R"("extensionsUsed":["KHR_lights_punctual","KHR_materials_emissive_strength")"),
      {}))
      << "a picture that is a lamp";
  EXPECT_FALSE(usesStudio(request({{R"("nodes":[0,1])", R"("nodes":[0])"},
                                   {R"("extensionsUsed":["KHR_lights_punctual")", R"("extensionsUsed":["KHR_lights_punctual","KHR_materials_unlit")"},
                                   {R"("metallicFactor":0})", R"("metallicFactor":0},"extensions":{"KHR_materials_unlit":{}})"}}),
                          {}))
      << "colours that need no light";
}

TEST_F(FirstPicture, TheStudioGivesAFrontWhatItPromises) {
  const EnvironmentPtr studio = studioEnvironment();
  double front = 0.0, whole = 0.0;
  constexpr int kSide = 256;  // directions of equal solid angle
  for (int j = 0; j < kSide; ++j)
    for (int i = 0; i < 2 * kSide; ++i) {
      const double y = 1.0 - 2.0 * (j + 0.5) / kSide, s = std::sqrt(1.0 - y * y), a = kPi * (i + 0.5) / kSide;
      const Vec3 d{float(s * std::cos(a)), float(y), float(s * std::sin(a))};
      const Vec3 l = studio->eval(d);
      ASSERT_GT(l.x, 0.0f);
      ASSERT_EQ(l.x, l.y);
      ASSERT_EQ(l.x, l.z);
      front += double(l.x) * std::max(double(d.z), 0.0);
      whole += 1.0;
    }
  EXPECT_NEAR(front / whole * 4.0, 0.9, 0.01);  // irradiance / pi: 4 pi / pi times the mean
}

TEST_F(FirstPicture, ExposureIsChosenForWhatWouldShowNothing) {
  const auto of = [](std::initializer_list<float> grey) {
    Image image(int(grey.size()), 1, 3);
    size_t k = 0;
    for (const float v : grey)
      for (int c = 0; c < 3; ++c) image.data[k++] = v;
    return chooseExposure(image);
  };
  for (const float fine : {1.0f / 128, 0.18f, 1.0f, 2.0f}) EXPECT_FALSE(of({fine})) << fine;
  EXPECT_FALSE(of({0.0f, 0.0f}));
  EXPECT_FALSE(of({0.0f, 0.0f, 0.0f, 0.3f})) << "black around it does not count";
  EXPECT_EQ(of({1000.0f})->stops, -12.5);               // log2(0.18 / 1000) = -12.44
  EXPECT_EQ(of({1e-4f})->stops, 10.75);                 // 10.81
  EXPECT_NEAR(of({1.0f, 1e6f})->luminance, 1e3, 1e-2);  // the log-average
  EXPECT_EQ(of({1e-30f})->stops, 32.0);                 // its range
  Image large(1000, 500, 3);                            // looked at in steps; bright columns do not fall between them
  for (size_t p = 0; p < large.pixels(); ++p)
    for (size_t c = 0; c < 3; ++c) large.data[p * 3 + c] = p % 2 ? 1e6f : 1.0f;
  ASSERT_TRUE(chooseExposure(large));
  EXPECT_NEAR(std::log2(chooseExposure(large)->luminance), std::log2(1e3), 0.01);
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(of({1000.0f, inf, nan, -5.0f})->stops, -12.5);
}

TEST_F(FirstPicture, ALampInCandelaIsNotWhite) {
  v1::RenderRequest r = request({{R"("intensity":10)", R"("intensity":54351)"}});
  const RenderResult exr = mustRender(*engine_, r);
  EXPECT_EQ(exr.reply.resolved().tone_map().exposure(), 0.0) << "scene-linear files are left alone";
  EXPECT_FALSE(warns(exr, "tone_map.exposure"));
  EXPECT_TRUE(warns(exr, "request.photometric"));  // 54 351 cd is 80 W/sr
  set(r, "encoding.format=PNG");
  const RenderResult png = mustRender(*engine_, r);
  const double stops = png.reply.resolved().tone_map().exposure();
  EXPECT_LT(stops, -6.0);
  EXPECT_TRUE(warns(png, "tone_map.exposure"));
  EXPECT_EQ(firstDifference(exr, png), "");

  const RenderResult again = mustRender(*cold_, png.reply.resolved());
  EXPECT_EQ(again.reply.resolved().tone_map().exposure(), stops);
  EXPECT_EQ(again.reply.request_hash(), png.reply.request_hash());

  // What was chosen stays when the light is dragged.
  v1::RelightRequest relight;
  relight.set_render_id(png.reply.render_id());
  relight.add_mask("lights.lamp.gain");
  set(*relight.mutable_patch(), "lights.lamp.gain=0.001,0.001,0.001");
  const auto edited = engine_->relightRequest(relight);
  ASSERT_TRUE(edited.ok());
  EXPECT_EQ(mustRender(*engine_, *edited).reply.resolved().tone_map().exposure(), stops);

  for (const char* kept : {"tone_map.exposure=0", "tone_map.auto_exposure=false", "window.width=4"}) {
    v1::RenderRequest other = r;
    set(other, kept);
    if (other.has_window()) set(other, "window.height=4");
    EXPECT_EQ(mustRender(*engine_, other).reply.resolved().tone_map().exposure(), 0.0) << kept;
  }
}

}  // namespace
}  // namespace gobo::testing::first_picture_test
