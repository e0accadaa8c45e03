// SPDX-License-Identifier: Apache-2.0
// Styles beyond one hard contour of the picture: guard bands, windows, levels of soft visibility.
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "support/planned_nodes.h"

namespace gobo::testing {
namespace styles_guard_test {

constexpr int kWidth = 44, kHeight = 34, kGuard = 15;

/// A lamp over cornell's boxes, seen by a measured camera: `more` pixels more on each side are the same picture with more around it, from pixel (left, top) of
/// it on.
v1::RenderRequest boxes(int more = 0, int left = 0, int top = 0, int width = kWidth, int height = kHeight) {
  v1::RenderRequest r = withLamp(width + 2 * more, height + 2 * more, LightKind::Spot);
  for (const std::string& a :
       {std::string("camera.focal_x=90"), std::string("camera.focal_y=90"), "camera.center_x=" + std::to_string(kWidth / 2 + more - left),
        "camera.center_y=" + std::to_string(kHeight / 2 + more - top), std::string("lights.light.enabled=false"), std::string("lights.lamp.outer_deg=80"),
        std::string("lights.lamp.inner_deg=79"), std::string("outputs=visibility:lamp")})
    set(r, a);
  return r;
}
v1::RenderRequest styled(v1::RenderRequest r, const std::vector<std::string>& edits, const std::string& technique = "ray_traced.samples=1") {
  set(r, "lights.lamp.shadow." + technique);
  for (const std::string& e : edits) set(r, "lights.lamp.shadow.style." + e);
  return r;
}
const std::vector<std::string> kWide{"inflation=0.02", "softness=0.5", "power=4"};
std::vector<std::string> with(std::vector<std::string> edits, const std::string& more) {
  edits.push_back(more);
  return edits;
}

/// Largest difference between a and the part of b that begins at (x, y), over width x height pixels from (x0, y0) of a on.
double most(const Image& a, const Image& b, int x, int y, int x0 = 0, int y0 = 0, int width = kWidth, int height = kHeight) {
  double d = 0;
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) d = std::max(d, double(std::abs(a.at(x0 + u, y0 + v)[0] - b.at(x + u, y + v)[0])));
  return d;
}

// The guard's contours are those of a larger picture of the same projection: its middle is the guarded picture.
TEST(StylesAround, AGuardIsALargerPicture) {
  for (const char* technique : {"ray_traced.samples=1", "shadow_map={}"}) {
    const auto engine = makeEngine();
    const auto of = [&](v1::RenderRequest r, const std::vector<std::string>& edits) {
      v1::RenderRequest s = r;
      if (std::string(technique) == "shadow_map={}") {
        (*s.mutable_lights())["lamp"].mutable_shadow()->mutable_shadow_map();
        set(s, "lights.lamp.shadow.map.resolution=512");
        set(s, "lights.lamp.shadow.map.fit=CAMERA");  // of what the guard sees, too
        for (const std::string& e : edits) set(s, "lights.lamp.shadow.style." + e);
      } else s = styled(s, edits, technique);
      return mustRender(*engine, s);
    };
    const RenderResult large = of(boxes(kGuard), kWide), guarded = of(boxes(), with(kWide, "guard_px=15")), small = of(boxes(), kWide);
    EXPECT_LT(most(guarded.images[0].image(), large.images[0].image(), kGuard, kGuard), 1e-4) << technique;
    EXPECT_GT(most(small.images[0].image(), large.images[0].image(), kGuard, kGuard), 0.02) << "there is something to see around the picture";
  }
}

TEST(StylesAround, AMovingCameraDoesNotChangeTheStyle) {  // where the guard is wider than what the style reaches
  const std::vector<std::string> narrow{"inflation=0.02", "softness=0.08", "power=16"};
  const auto engine = makeEngine();
  const RenderResult here = mustRender(*engine, styled(boxes(), with(narrow, "guard_px=24"))),
                     there = mustRender(*engine, styled(boxes(0, 7, 3), with(narrow, "guard_px=24")));
  EXPECT_LT(most(here.images[0].image(), there.images[0].image(), 0, 0, 7, 3, kWidth - 7, kHeight - 3), 1e-4);
  double dark = 0;
  for (int x = 0; x < kWidth; ++x) dark += double(1 - here.images[0].image().at(x, kHeight / 2)[0]);
  EXPECT_GT(dark, 1);
}

TEST(StylesAround, OfANeutralStyleIsTheHardShadowToTheBit) {  // the picture's own pixels have the visibility that they have without
  const auto engine = makeEngine();
  v1::RenderRequest r = boxes();
  set(r, "lights.lamp.kind=RECT");
  r.mutable_lights()->at("lamp").clear_outer_deg();
  r.mutable_lights()->at("lamp").clear_inner_deg();
  r.set_view_samples(3);
  const auto edits = [&](const char* guard) { return mustRender(*engine, styled(r, {"softness=0", guard}, "ray_traced.samples=1")); };
  const RenderResult plain = mustRender(*engine, styled(r, {}, "ray_traced.samples=1"));
  EXPECT_EQ(firstDifference(edits("guard_px=9"), plain), "");
  EXPECT_EQ(firstDifference(edits("guard_px=0"), plain), "");
}

TEST(StylesAround, APanoramaHasNothingOutside) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 48, 24, 1);
  for (const char* a :
       {"camera.panorama=true", "camera.position=0.1,1,0.4", "shadows.ray_traced.samples=1", "shadows.style.softness=0.2", "outputs=visibility:light"})
    set(r, a);
  const RenderResult plain = mustRender(*engine, r);
  set(r, "shadows.style.guard_px=5");
  const RenderResult guarded = mustRender(*engine, r);
  EXPECT_EQ(firstDifference(plain, guarded), "");
  bool told = false;
  for (const std::string& w : guarded.reply.warnings()) told |= w.find("guard_px") != std::string::npos;
  EXPECT_TRUE(told);
}

TEST(StylesAround, AGuardOfItsOwnRunsWhatItSees) {
  const auto engine = makeEngine();
  const auto ran = [&](const std::vector<std::string>& edits) {
    std::set<std::string> out;
    for (const auto& [label, n] : nodesBy(mustRender(*engine, styled(boxes(), edits)), v1::NodeReport::RUN)) out.insert(label);
    return out;
  };
  ran({"softness=0.2"});
  using Labels = std::set<std::string>;
  EXPECT_EQ(ran({"softness=0.2", "guard_px=4"}),
            (Labels{"gbuffer with guard", "visibility:lamp", "style_distance:lamp", "style_transfer:lamp", "style_crop:lamp"}));
  EXPECT_EQ(ran({"softness=0.3", "guard_px=4"}),
            (Labels{"style_transfer:lamp", "style_crop:lamp", "visibility:lamp"}));  // the last is the mean of the view samples
  EXPECT_EQ(ran({"softness=0.2", "guard_px=0"}), Labels{});
}

TEST(StylesAround, MoreThanAPictureMayHaveIsRefusedByName) {
  const auto engine = makeEngine();
  v1::RenderRequest r = styled(boxes(), {"softness=0.2"});
  r.set_width(16384), r.set_height(16384), r.set_view_samples(2);
  set(r, "lights.lamp.shadow.style.guard_px=1000");
  const auto guarded = engine->render(r);
  ASSERT_FALSE(guarded.ok());
  EXPECT_EQ(guarded.status().code(), Code::ResourceExhausted);
  EXPECT_EQ(guarded.status().location(), "request.shadows.style.guard_px") << guarded.status().toString();
  set(r, "lights.lamp.shadow.style.guard_px=0");
  r.set_view_samples(16);
  for (const char* e : {"window.x=3", "window.y=2", "window.width=9", "window.height=7"}) set(r, e);
  const auto window = engine->render(r);
  ASSERT_FALSE(window.ok());
  EXPECT_EQ(window.status().location(), "request.window") << window.status().toString();
}

// The style is that of the whole picture: Window.HasTheBitsOfTheWhole* over styles of every kind.
TEST(StylesAround, AWindowHasTheBitsOfTheWhole) {
  const auto engine = makeEngine();
  for (const std::vector<std::string>& edits :
       std::vector<std::vector<std::string>>{{"abstraction=0.1"}, {"guard_px=5"}, {"samples=9"}, {"levels=3", "guard_px=2"}}) {
    v1::RenderRequest r = styled(boxes(), kWide, "ray_traced.samples=4");
    for (const std::string& e : edits) set(r, "lights.lamp.shadow.style." + e);
    r.add_outputs("beauty");
    const RenderResult whole = mustRender(*engine, r);
    for (const char* e : {"window.x=13", "window.y=8", "window.width=20", "window.height=11"}) set(r, e);
    const RenderResult part = mustRender(*makeEngine(), r);
    for (size_t k = 0; k < 2; ++k) EXPECT_EQ(most(part.images[k].image(), whole.images[k].image(), 13, 8, 0, 0, 20, 11), 0) << edits[0];
  }
}

// ---- Levels -----------------------------------------------------------------------------------------------------------------
TEST(StyleLevelsOfPlans, OfHardVisibilityAreOneToTheBit) {
  const auto engine = makeEngine();
  const RenderResult one = mustRender(*engine, styled(boxes(), kWide));
  for (const char* levels : {"levels=1", "levels=2", "levels=7"})
    EXPECT_EQ(firstDifference(mustRender(*engine, styled(boxes(), with(kWide, levels))), one), "") << levels;
}

TEST(StylesAround, AMapThatIsFittedToTheCameraIsFittedToTheGuard) {  // a sun's, whose window is that of what is seen
  const auto engine = makeEngine();
  const auto of = [&](int more, const char* guard) {
    v1::RenderRequest r = smallRequest("fence", kWidth + 2 * more, kHeight + 2 * more, 1);
    for (const std::string& a : {std::string("camera.focal_x=150"), std::string("camera.focal_y=150"), std::string("shadows.shadow_map={}"),
                                 std::string("shadows.map.resolution=512"), std::string("shadows.map.fit=CAMERA"), std::string("shadows.style.softness=0.5"),
                                 std::string("shadows.style.power=4"), std::string(guard), std::string("outputs=visibility:sun")}) {
      if (a.ends_with("={}")) r.mutable_shadows()->mutable_shadow_map();
      else set(r, a);
    }
    return mustRender(*engine, r);
  };
  const RenderResult large = of(30, "shadows.style.guard_px=0"), guarded = of(0, "shadows.style.guard_px=30");
  EXPECT_LT(most(guarded.images[0].image(), large.images[0].image(), 30, 30), 1e-4);
}

TEST(StyleLevelsOfPlans, OfANeutralStyleAreSoftVisibilityInSteps) {
  const auto engine = makeEngine();
  v1::RenderRequest r = boxes();
  set(r, "lights.lamp.kind=RECT");
  set(r, "lights.lamp.width=0.5");
  set(r, "lights.lamp.height=0.5");
  r.mutable_lights()->at("lamp").clear_outer_deg();
  r.mutable_lights()->at("lamp").clear_inner_deg();
  const Image plain = mustRender(*engine, styled(r, {}, "ray_traced.samples=64")).images[0].image();
  const Image soft = mustRender(*engine, styled(r, {"levels=16"}, "ray_traced.samples=64")).images[0].image();
  const Image hard = mustRender(*engine, styled(r, {"levels=1"}, "ray_traced.samples=64")).images[0].image();
  EXPECT_LE(most(plain, soft, 0, 0), 0.5 / 16 + 1e-5);
  EXPECT_GT(most(plain, hard, 0, 0), 0.2);
}

TEST(StyleLevelsOfPlans, HaveTheDistanceOfTheMiddleOne) {  // of an odd number: the contour of one half, as one level has it
  const auto engine = makeEngine();
  v1::RenderRequest r = boxes();
  r.set_view_samples(1);
  set(r, "lights.lamp.kind=RECT");
  set(r, "lights.lamp.width=0.5");
  set(r, "lights.lamp.height=0.5");
  r.mutable_lights()->at("lamp").clear_outer_deg();
  r.mutable_lights()->at("lamp").clear_inner_deg();
  const Image soft = mustRender(*engine, styled(r, {}, "ray_traced.samples=64")).images[0].image();
  const auto distance = [&](const char* levels) {
    v1::RenderRequest s = styled(r, {levels}, "ray_traced.samples=64");
    s.clear_outputs();
    s.add_outputs("shadow_distance:lamp");
    return mustRender(*engine, s).images[0].image();
  };
  const Image one = distance("levels=1");
  int between = 0, dark = 0;  // light by one half, dark by the levels above
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      between += soft.at(x, y)[0] > 0.5f && soft.at(x, y)[0] < 0.7f;
      dark += one.at(x, y)[0] < 0.0f;
    }
  EXPECT_GT(between, 0);
  EXPECT_GT(dark, 0);
  for (const char* levels : {"levels=3", "levels=5", "levels=7"}) {
    const Image several = distance(levels);
    int other = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) other += (several.at(x, y)[0] < 0.0f) != (one.at(x, y)[0] < 0.0f);
    EXPECT_EQ(other, 0) << levels;
  }
}

TEST(StyleLevelsOfPlans, KeepDistancesAndHoldOneLevelAtATime) {
  const auto engine = makeEngine();
  v1::RenderRequest r = styled(boxes(), {"softness=0.2", "abstraction=0.05", "levels=3"});
  std::set<std::string> labels;
  for (const auto& [label, n] : nodesBy(mustRender(*engine, r), v1::NodeReport::RUN)) {
    labels.insert(label);
    if (label == "style_levels:lamp") { EXPECT_TRUE(n.approximate()); }
  }
  for (const char* label : {"style_distance 1/3:lamp", "style_distance 3/3:lamp", "style_abstraction 2/3:lamp", "style_transfer (folded)", "style_levels:lamp"})
    EXPECT_TRUE(labels.count(label)) << label;
  set(r, "lights.lamp.shadow.style.softness=0.3");
  for (const auto& [label, n] : nodesBy(mustRender(*engine, r), v1::NodeReport::RUN))
    EXPECT_TRUE(label.starts_with("style_transfer") || label.starts_with("style_levels") || label == "visibility:lamp") << label;
  v1::RenderRequest large = styled(boxes(), {"softness=0.2", "levels=2"});
  large.set_width(1024), large.set_height(1024);
  const auto two = engine->prepare(large, nullptr);
  set(large, "lights.lamp.shadow.style.levels=64");
  const auto many = engine->prepare(large, nullptr);
  ASSERT_TRUE(two.ok() && many.ok());
  EXPECT_LT(double(many->pinnedBytes), 1.05 * double(two->pinnedBytes));
}

}  // namespace styles_guard_test
}  // namespace gobo::testing
