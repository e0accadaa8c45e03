// SPDX-License-Identifier: Apache-2.0
// What a progressive reply shows when: pure functions of counts and times.
#include "plan/ladder.h"

#include <gtest/gtest.h>

#include <limits>

#include "base/hash.h"
#include "base/sobol.h"
#include "trace/sample_passes.h"

namespace gobo {
namespace {

TEST(Ladder, ClimbsToWhatWasAsked) {
  // Any counts, any times (seed 1): each rung is one that can be realised, higher than the last, and the top is reached, not passed.
  for (uint64_t seed = 0; seed < 2000; ++seed) {
    auto draw = [seed, k = uint64_t(0)]() mutable { return double(hash64(1, seed * 64 + k++) >> 11) * 0x1p-53; };
    const uint32_t most = 1 + uint32_t(draw() * draw() * 3000);
    RungTimes t;
    t.perSample = draw() < 0.1 ? 0 : std::exp(draw() * 16 - 8);
    uint32_t spp = draw() < 0.7 ? 1 : std::min(most, kBlockSamples), rungs = 0;
    while (spp < most) {
      const uint32_t next = nextRung(spp, most, t);
      ASSERT_GT(next, spp) << seed;
      ASSERT_EQ(samplesOf(passesFor(next)), next) << seed;
      ASSERT_LE(next, samplesOf(passesFor(most))) << seed;
      if (next < samplesOf(passesFor(most))) { EXPECT_GE(next, spp < kBlockSamples ? 2 * spp : 2 * spp - kBlockSamples) << "about twice as many, at least"; }
      spp = next;
      ASSERT_LT(++rungs, 400u);
    }
    EXPECT_EQ(nextRung(spp, most, t), spp);
  }
}

TEST(Ladder, ShowsTheFirstSamplesOneByOneWhereTheyAreDear) {
  RungTimes t{500, true, -1};
  std::vector<uint32_t> seen{1};
  while (seen.back() < 128) seen.push_back(nextRung(seen.back(), 128, t));
  EXPECT_EQ(seen, (std::vector<uint32_t>{1, 2, 4, 8, 16, 32, 64, 128}));
  t.perSample = 1;  // nobody sees pictures that follow each other so fast
  EXPECT_EQ(nextRung(1, 128, t), 16u);
  EXPECT_EQ(nextRung(1, 8, t), 8u);
  EXPECT_EQ(nextRung(16, 4096, t), 32u) << "from a block on every doubling is shown";
  EXPECT_EQ(nextRung(32, 4096, t), 64u);
  t.perSample = 20;
  EXPECT_EQ(nextRung(1, 128, t), 4u);
}

TEST(Ladder, TakesNoMoreThanFits) {
  RungTimes t{10, false, 1000};
  EXPECT_EQ(nextRung(16, 4096, t), 32u);
  t.left = 600;                             // 60 samples
  EXPECT_EQ(nextRung(128, 4096, t), 176u);  // 48 more
  t.left = 120;                             // 12 samples: a block more may just be done
  EXPECT_EQ(nextRung(128, 4096, t), 144u);
  t.left = 90;
  EXPECT_EQ(nextRung(128, 4096, t), 128u);
  t.left = 0;
  EXPECT_EQ(nextRung(128, 4096, t), 128u);
  t = {1000, true, 100};  // the first sample's time has in it what is made once
  EXPECT_EQ(nextRung(1, 4096, t), 2u);
}

TEST(Ladder, WhereNobodyKnowsHowLongSamplesTakeTheyAreDoubled) {
  const RungTimes unknown{0, false, 500};  // the samples before were there already; so, perhaps, are the next
  EXPECT_EQ(nextRung(1, 4096, unknown), 2u);
  EXPECT_EQ(nextRung(4, 4096, unknown), 8u);
  EXPECT_EQ(nextRung(64, 4096, unknown), 128u);
  EXPECT_EQ(nextRung(4096, 4096, unknown), 4096u);
}

TEST(Ladder, SmallPicturesAndWindowsHaveNoSmallerOne) {
  v1::RenderRequest r;
  r.set_width(128);
  r.set_height(128);
  EXPECT_FALSE(smallRung(r));
  r.set_width(130);
  ASSERT_TRUE(smallRung(r));
  EXPECT_EQ(smallRung(r)->width(), 32u);
  r.set_width(16384);
  r.set_height(2);
  ASSERT_TRUE(smallRung(r));
  EXPECT_EQ(smallRung(r)->height(), 1u);
  r.mutable_window()->set_width(4);
  EXPECT_FALSE(smallRung(r));
}

TEST(Ladder, SmallPicturesAreSmallerWhereTheyComeLate) {
  RungPace pace;
  const uint64_t pixels = 640 * 480;
  EXPECT_EQ(pace.shrink("new", pixels, 0), kShrinkMore) << "nothing is known";
  EXPECT_EQ(pace.shrink("new", pixels / 4, 100), kShrink) << "it would be too small to see anything";
  pace.took("quick", pixels / 16, 10);
  EXPECT_EQ(pace.shrink("quick", pixels, 0), kShrink);
  EXPECT_EQ(pace.shrink("quick", pixels, 15), kShrink);  // 160 ms for all
  EXPECT_EQ(pace.shrink("quick", pixels, 31), kShrinkMore);
  EXPECT_EQ(pace.shrink("quick", 8 * pixels, 0), kShrinkMore);
  pace.took("slow", pixels / 64, 20);  // a small one of a slow scene says as much
  EXPECT_EQ(pace.shrink("slow", pixels, 0), kShrinkMore);
  EXPECT_EQ(pace.shrink("slow", pixels / 4, 0), kShrink);
  EXPECT_EQ(pace.shrink("quick", pixels, 0), kShrink) << "each scene for itself";
  for (int i = 0; i < 40; ++i) pace.took("slow", pixels / 16, 10);
  EXPECT_EQ(pace.shrink("slow", pixels, 0), kShrink) << "it learns";
  pace.took("none", 0, 10);
  pace.took("none", 10, std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(pace.shrink("none", pixels, 0), kShrinkMore) << "still nothing is known";

  v1::RenderRequest r;
  r.set_width(1280);
  r.set_height(720);
  EXPECT_EQ(smallRung(r, kShrinkMore)->width(), 160u);
  EXPECT_EQ(smallRung(r, kShrinkMore)->height(), 90u);
}

// The intrinsics of a small picture are its own, whatever moves them while the shutter is open.
TEST(Ladder, SmallPicturesHaveTheirOwnIntrinsics) {
  v1::RenderRequest r;
  r.set_width(400);
  r.set_height(300);
  r.mutable_camera()->set_focal_x(300);
  for (const char* path : {"camera.focal_x", "camera.center_y", "camera.position"}) (*r.mutable_curves())[path].add_value(1);
  (*r.mutable_expressions())["camera.focal_y"].set_formula("300");
  const auto small = smallRung(r);
  ASSERT_TRUE(small);
  EXPECT_NEAR(small->camera().focal_x(), 300.0 * small->width() / 400, 1e-9);
  EXPECT_EQ(small->curves().size(), 1u);
  EXPECT_TRUE(small->curves().contains("camera.position"));
  EXPECT_TRUE(small->expressions().empty());
}

TEST(Ladder, WhatIsPathTracedFirstNamesNothingThatHasGone) {
  v1::RenderRequest r;
  r.set_width(1280);
  r.set_height(720);
  r.add_outputs("beauty");
  r.mutable_shadows()->mutable_axis_aligned();
  for (const char* path :
       {"shadows.axis_aligned.k", "lights.key.shadow.ray_traced.samples", "filters[1].bloom.gain", "camera.position", "lights.key.intensity"})
    (*r.mutable_curves())[path].add_value(1);
  (*r.mutable_expressions())["shadows.axis_aligned.k"].set_formula("1");
  r.add_filters()->set_term("visibility:key");
  r.mutable_filters(0)->mutable_gaussian();
  r.add_filters()->mutable_bloom();
  const auto plain = plainRung(r);
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->filters_size(), 1);
  EXPECT_EQ(plain->curves().size(), 2u);
  EXPECT_TRUE(plain->curves().contains("camera.position") && plain->curves().contains("lights.key.intensity"));
  EXPECT_TRUE(plain->expressions().empty());
  r.add_outputs("filtered:1");
  EXPECT_FALSE(plainRung(r)) << "its number would be another filter's";
}

TEST(Ladder, WhatHasToLookFirstIsPathTraced) {
  v1::RenderRequest r;
  r.set_width(1280);
  r.set_height(720);
  r.add_outputs("beauty");
  r.mutable_shadows()->mutable_path_traced();
  r.mutable_environment()->set_rotation_deg(30);
  EXPECT_FALSE(plainRung(r)) << "it is";
  const v1::RenderRequest traced = r;
  r.mutable_shadows()->mutable_auto_();
  r.mutable_environment()->mutable_transfer();
  r.mutable_environment()->set_extract_lights(8);
  r.mutable_environment()->set_area_lights(8);
  r.mutable_environment()->set_area_lights_if_worth(true);
  (*r.mutable_lights())["key"].mutable_shadow()->mutable_auto_();
  (*r.mutable_lights())["key"].set_intensity(3);
  const auto plain = plainRung(r);
  ASSERT_TRUE(plain);
  EXPECT_TRUE(plain->shadows().has_path_traced());
  EXPECT_FALSE(plain->lights().at("key").has_shadow());
  EXPECT_EQ(plain->lights().at("key").intensity(), 3);
  EXPECT_EQ(plain->environment().SerializeAsString(), traced.environment().SerializeAsString());
  r.add_outputs("visibility:key");
  EXPECT_FALSE(plainRung(r)) << "an output that path tracing has not";
}

}  // namespace
}  // namespace gobo
