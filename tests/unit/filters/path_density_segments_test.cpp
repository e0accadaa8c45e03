// SPDX-License-Identifier: Apache-2.0
// Mean shift on samples: ways end at modes, segments are what is joined, small ones are rejected.
#include "filters/path_density/sample_segments.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "path_density_clouds.h"

namespace gobo {
namespace path_density_segments_test {

using namespace pathdensity;
using pathdensitytest::evenSamples;
using pathdensitytest::meansOf;
using pathdensitytest::unit;

const TaskArena& arena() {
  static const TaskArena a(2);
  return a;
}
Settings together(int k = 10) {
  Settings s;
  s.neighbours = k;
  s.judged = Judged::Together;
  s.spread = 0;
  return s;
}
Segments segmentsOf(const SampleView& v, const SegmentSettings& s = {}) {
  auto r = segmentSamples(v, together(), s, LightTerm::All, arena());
  EXPECT_TRUE(r.ok()) << r.status().toString();
  return r.ok() ? *r : Segments{};
}
/// Grey of that lightness.
Vec3 lightness(double l) { return Vec3(float(std::pow((l + 16) / 116, 3.0))); }

TEST(SampleSegments, TwoColoursAreTwoSegmentsAndEvenLightIsOne) {
  // L* = 40 on the left, 70 on the right: 1.5 h_c apart, windows of 1; noise of a tenth of that.
  const auto samples = evenSamples(20, 12, 16, 3, [](uint64_t i, const Vec2& film) { return lightness((film.x < 9 ? 40 : 70) + 6 * unit(3, i, 9) - 3); });
  const Segments s = segmentsOf(samples.view());
  ASSERT_EQ(s.of.size(), samples.size());
  for (size_t i = 0; i < samples.size(); ++i) {
    const bool left = samples.view().film[2 * i] < 9;
    EXPECT_EQ(s.of[i], left ? 0u : 9u * 16) << i;
    EXPECT_EQ(s.size[i], left ? 9u * 12 * 16 : 11u * 12 * 16);
  }
}

TEST(SampleSegments, AWayGoesToTheMeanOfItsWindow) {
  // Colours at 0, 0.9 and 1.7 h_c (10, 1 and 10 samples of one pixel). From the middle one's window of 1 both others are seen, and it stays between them; those
  // see it, but not each other, and go nearly nowhere. What joins (half a window) tells three segments; without a step the same.
  const auto cloud = [](double middle) {
    PathSamples s(1, 1);
    for (int i = 0; i < 21; ++i) EXPECT_TRUE(s.add(0, 0, Vec2(0.5f), lightness(30 + 20 * (i < 10 ? 0.0 : i == 10 ? middle : 1.7)), Vec3(0.0f)).ok());
    return s;
  };
  EXPECT_EQ(segmentsOf(cloud(0.9).view()).size[10], 1u);
  // At 0.6 it sees the first ten only (1.7 is 1.1 away): its first step ends at 0.6 / 11, among them.
  SegmentSettings none;
  none.most = 0;
  EXPECT_EQ(segmentsOf(cloud(0.6).view(), none).size[10], 1u);
  SegmentSettings one;
  one.most = 1;
  const Segments shifted = segmentsOf(cloud(0.6).view(), one);
  EXPECT_EQ(shifted.size[10], 11u);
  EXPECT_EQ(shifted.of[10], 0u);
  EXPECT_EQ(shifted.size[20], 10u);
}

TEST(SampleSegments, LoneSamplesGoWhateverTheirHeightAndEvenLightStays) {
  for (const float height : {1e2f, 1e5f, 1e30f}) {
    const auto samples = evenSamples(24, 24, 16, 5, [&](uint64_t i, const Vec2&) { return Vec3(i % 911 == 7 ? height : 0.5f); });
    const auto f = rejectSmallSegments(samples.view(), together(50), {}, arena());
    ASSERT_TRUE(f.ok());
    for (const float v : f->rgb) EXPECT_EQ(v, 0.5f);
    const auto mean = meansOf(samples.view());
    double rejected = 0;
    for (size_t i = 0; i < mean.size(); ++i) {
      EXPECT_NEAR(double(f->rgb[i]) + double(f->rejected[i]), mean[i], 1e-6 * mean[i]);
      rejected += double(f->rejected[i]);
    }
    EXPECT_GT(rejected, 1.0);
  }
}

TEST(SampleSegments, SegmentsOfKOthersAreKept) {
  // A spot of m bright samples in one pixel: whole from m - 1 = k on, gone at m - 1 <= 4 k / 9.
  const auto keptOf = [](int m) {
    const auto samples = evenSamples(16, 16, 24, 6, [&](uint64_t i, const Vec2&) { return Vec3(i >= 24 * 136 && i < 24 * 136 + uint64_t(m) ? 50.0f : 0.5f); });
    const auto f = rejectSmallSegments(samples.view(), together(18), {}, arena());
    EXPECT_TRUE(f.ok());
    return double(f->weight[136]);
  };
  EXPECT_NEAR(keptOf(9), 15.0 / 24, 1e-6);
  EXPECT_EQ(keptOf(19), 1.0);
  const double between = keptOf(14);
  EXPECT_GT(between, 10.5 / 24);
  EXPECT_LT(between, 23.5 / 24);
}

TEST(SampleSegments, SameBitsForAnyThreadsAndMistakes) {
  const auto samples = evenSamples(19, 13, 8, 8, [](uint64_t i, const Vec2&) {
    return Vec3(float(unit(8, i, 5)), 0.4f * float(unit(8, i, 6)), 0.2f) * (unit(8, i, 3) < 0.03 ? 1e3f : 1.0f);
  });
  std::vector<float> expected;
  std::vector<uint32_t> of;
  for (const int threads : {1, 3}) {
    const TaskArena some(threads);
    const auto f = rejectSmallSegments(samples.view(), together(), {}, some);
    const auto s = segmentSamples(samples.view(), together(), {}, LightTerm::All, some);
    ASSERT_TRUE(f.ok() && s.ok());
    if (expected.empty()) expected = f->rgb, of = s->of;
    EXPECT_EQ(f->rgb, expected);
    EXPECT_EQ(s->of, of);
  }
  const auto refused = [&](auto change) {
    SegmentSettings s;
    change(s);
    const auto r = segmentSamples(samples.view(), together(), s, LightTerm::All, arena());
    return !r.ok() && r.status().code() == Code::InvalidArgument;
  };
  EXPECT_TRUE(refused([](SegmentSettings& s) { s.film = 0; }));
  EXPECT_TRUE(refused([](SegmentSettings& s) { s.film = 9; }));
  EXPECT_TRUE(refused([](SegmentSettings& s) { s.colour = 0; }));
  EXPECT_TRUE(refused([](SegmentSettings& s) { s.join = 0.01f; }));
  EXPECT_TRUE(refused([](SegmentSettings& s) { s.most = -1; }));
  EXPECT_FALSE(rejectSmallSegments(samples.view(), together(500), {}, arena()).ok());
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_EQ(segmentSamples(samples.view(), together(), {}, LightTerm::All, arena(), stop.token()).status().code(), Code::Cancelled);
  // Nothing, and one alone.
  PathSamples few(3, 2);
  EXPECT_TRUE(rejectSmallSegments(few.view(), together(), {}, arena()).ok());
  ASSERT_TRUE(few.add(1, 1, Vec2(1.5f), Vec3(7.0f), Vec3(0.0f)).ok());
  Settings own = together(1);
  own.fewer = true;
  const auto lone = rejectSmallSegments(few.view(), own, {}, arena());
  ASSERT_TRUE(lone.ok());
  EXPECT_EQ(lone->weight[4], 1.0f);
}

}  // namespace path_density_segments_test
}  // namespace gobo
