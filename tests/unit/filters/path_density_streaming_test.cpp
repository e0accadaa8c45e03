// SPDX-License-Identifier: Apache-2.0
// Path density of two streams by a grid: the laws of the exact search within a tolerance, order, threads, passes, memory, mistakes.
#include "filters/path_density/streaming_density.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "filters/path_density/trace_samples.h"
#include "path_density_clouds.h"
#include "support/tiny_scenes.h"
#include "trace/accel.h"

namespace gobo {
namespace path_density_streaming_test {

using namespace pathdensity;
using pathdensitytest::evenSamples;
using pathdensitytest::meansOf;
using pathdensitytest::uniformSamples;
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
StreamingDensity streamOf(const SampleView& v, const Settings& s, const GridSettings& g = {}) {
  auto r = StreamingDensity::create(v.width, v.height, s, g);
  EXPECT_TRUE(r.ok()) << r.status().toString();
  return std::move(*r);
}
Filtered streamed(const SampleView& v, const Settings& s, const GridSettings& g = {}) {
  StreamingDensity d = streamOf(v, s, g);
  EXPECT_TRUE(d.count(v, arena()).ok());
  const Status weighed = d.weigh(v, arena());
  EXPECT_TRUE(weighed.ok()) << weighed.toString();
  auto f = d.finish(arena());
  EXPECT_TRUE(f.ok()) << f.status().toString();
  return f.ok() ? *f : Filtered{};
}
/// Noise of many colours and some fireflies, in direct and indirect light.
PathSamples noisy(int width, int height, int n, uint64_t seed, double fireflies = 0.02) {
  PathSamples s(width, height);
  uint64_t i = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int k = 0; k < n; ++k, ++i) {
        const Vec2 film(float(x) + float(unit(seed, i, 0)), float(y) + float(unit(seed, i, 1)));
        const float bright = unit(seed, i, 3) < fireflies ? float(std::pow(10.0, 5 * unit(seed, i, 4))) : 1.0f;
        const Vec3 light(0.2f + 0.5f * float(unit(seed, i, 5)), 0.3f * float(unit(seed, i, 6)), x > width / 2 ? 0.4f : 0.1f);
        EXPECT_TRUE(s.add(x, y, film, Vec3(0.1f, 0.2f, 0.3f * float(unit(seed, i, 8))), light * bright).ok());
      }
  return s;
}

TEST(PathDensityStreaming, EvenLightStaysWhole) {
  for (const int n : {4, 16, 64})
    for (const int cell : {1, 2}) {
      const auto samples = evenSamples(24, 19, n, uint64_t(20 + n), [](uint64_t, const Vec2&) { return Vec3(0.7f, 0.2f, 0.05f); });
      Settings s = together(std::max(1, int(0.8 * mostNeighbours(n, 24, 19, together()))));
      const Filtered f = streamed(samples.view(), s, {cell, 8});
      for (size_t p = 0; p < f.weight.size(); ++p) {
        EXPECT_GT(f.weight[p], 0.97f) << n << ", cells of " << cell << ", pixel " << p;
        EXPECT_EQ(f.rgb[3 * p], 0.7f);
      }
      s.neighbours = n;
      for (const float w : streamed(samples.view(), s, {cell, 8}).weight) EXPECT_EQ(w, 1.0f);
    }
}

TEST(PathDensityStreaming, RareColoursAppearAtTheTransitionOfTheLaw) {
  // As of the exact search (9 pi n q = k, 81 pi n q = 4 k, within 10 %): here within 12 % with cells of a pixel, 15 % with cells of two.
  const int n = 16, k = 50, size = 64;
  for (const auto& [cell, tolerance] : {std::pair{1, 0.12}, {2, 0.15}}) {
    const auto sigmaAt = [&, cell = cell](double nq) {
      double sum = 0, count = 0;
      for (const uint64_t seed : {11u, 12u, 13u, 14u}) {
        std::vector<bool> rare;
        const auto samples = uniformSamples(size, size, n, seed, [&](uint64_t i, const Vec2&) {
          rare.push_back(unit(seed, i, 7) < nq / n);
          return Vec3(float(std::pow((50.0 + (rare.back() ? 120.0 : 0.0) + 16.0) / 116.0, 3.0)));  // 6 h_c apart
        });
        const SampleView v = samples.view();
        StreamingDensity d = streamOf(v, together(k), {cell, 8});
        EXPECT_TRUE(d.count(v, arena()).ok());
        ColourGrid grid = d.grid();
        grid.settle(arena());
        const SampleBins bins = binSamples(v);
        MetricPoints p;
        EXPECT_TRUE(makePoints(v, bins, together(k).metric, LightTerm::All, p, arena(), {}));
        ColourGrid::Scratch scratch;
        for (size_t i = 0; i < p.size(); ++i) {
          const size_t at = bins.order[i];
          const float x = v.film[2 * at], y = v.film[2 * at + 1];
          if (!rare[at] || std::min(x, y) < 6 || std::max(x, y) > float(size) - 6) continue;
          sum += double(grid.meanDistance(x, y, gridColourOf(p.l[i], p.a[i], p.b[i]), k, 1.0f, {}, scratch));
          count += 1;
        }
      }
      return sum / count;
    };
    for (const auto& [threshold, law] : {std::pair{2.0, k / (9 * M_PI)}, {3.0, 4 * k / (81 * M_PI)}}) {
      EXPECT_GT(sigmaAt((1 - tolerance) * law), threshold) << cell;
      EXPECT_LT(sigmaAt((1 + tolerance) * law), threshold) << cell;
    }
  }
}

TEST(PathDensityStreaming, SigmasAreNearThoseOfTheExactSearch) {
  // Noise of all colours: of the samples that the exact search keeps or rejects clearly (sigma below 1.7 or above 3.5) hardly any is judged otherwise.
  const auto samples = noisy(40, 30, 16, 31);
  const SampleView v = samples.view();
  const auto exact = sigmasOf(v, together(), LightTerm::All, arena());
  ASSERT_TRUE(exact.ok());
  StreamingDensity d = streamOf(v, together(), {1, 32});
  ASSERT_TRUE(d.count(v, arena()).ok());
  ColourGrid grid = d.grid();
  grid.settle(arena());
  const SampleBins bins = binSamples(v);
  MetricPoints p;
  ASSERT_TRUE(makePoints(v, bins, together().metric, LightTerm::All, p, arena(), {}));
  ColourGrid::Scratch scratch;
  size_t clear = 0, otherwise = 0, rejected = 0;
  for (size_t i = 0; i < p.size(); ++i) {
    const size_t at = bins.order[i];
    const float own = (*exact)[at];
    if (own > 1.7f && own < 3.5f) continue;
    const float sigma = grid.meanDistance(v.film[2 * at], v.film[2 * at + 1], gridColourOf(p.l[i], p.a[i], p.b[i]), 10, 1.0f, {-1.0f, 6.0f}, scratch);
    ++clear;
    rejected += own >= 3.5f;
    otherwise += own < 2 ? sigma > 3 : sigma < 2;
    // Bounds end the search and change no outcome.
    const float bounded = grid.meanDistance(v.film[2 * at], v.film[2 * at + 1], gridColourOf(p.l[i], p.a[i], p.b[i]), 10, 1.0f, {2.0f, 3.0f}, scratch);
    EXPECT_EQ(weightOf(bounded, together()), weightOf(sigma, together()));
  }
  EXPECT_GT(rejected, 50u);
  EXPECT_LT(double(otherwise), 0.003 * double(clear));
}

TEST(PathDensityStreaming, AFireflyGoesWhateverItsHeightAndALonePixelOfThemShowsTheNearest) {
  std::vector<float> first;
  for (const float height : {1e2f, 1e5f, 1e30f}) {
    const auto samples = evenSamples(24, 24, 16, 5, [&](uint64_t i, const Vec2&) { return Vec3(unit(5, i, 7) < 0.01 ? height : 0.5f); });
    const Filtered f = streamed(samples.view(), together(50));
    for (const float v : f.rgb) EXPECT_EQ(v, 0.5f);
    const auto mean = meansOf(samples.view());
    for (size_t i = 0; i < mean.size(); ++i) EXPECT_NEAR(double(f.rgb[i]) + double(f.rejected[i]), mean[i], 1e-6 * mean[i]);
  }
  // All of one pixel: 3 h_c and more from the rest; the darker is nearer to it.
  const auto samples =
      evenSamples(16, 16, 4, 6, [](uint64_t i, const Vec2&) { return Vec3(i / 4 == 8 * 16 + 8 ? (i % 4 == 2 ? 40.0f : 1e4f * float(i % 4 + 1)) : 0.5f); });
  const Filtered f = streamed(samples.view(), together(10));
  EXPECT_EQ(f.allRejected, 1u);
  EXPECT_EQ(f.rgb[3 * (8 * 16 + 8)], 40.0f);
}

TEST(PathDensityStreaming, SameBitsForAnyThreadsAndAnyPasses) {
  const int width = 23, height = 17, n = 12;
  const auto samples = noisy(width, height, n, 41);
  const SampleView v = samples.view();
  for (const Judged judged : {Judged::Together, Judged::Indirect}) {
    Settings s = together();
    s.judged = judged;
    s.spread = 3;
    std::vector<float> expected;
    for (const int threads : {1, 3})
      for (const auto& cuts : std::vector<std::vector<int>>{{0, n}, {0, 1, 5, n}, {0, 7, 8, 9, n}}) {
        const TaskArena some(threads);
        StreamingDensity d = streamOf(v, s, {2, 8});
        for (const bool weigh : {false, true})
          for (size_t pass = 0; pass + 1 < cuts.size(); ++pass) {
            // Samples [cuts[pass], cuts[pass + 1]) of every pixel; counted backwards, which must not matter.
            const size_t at = weigh ? pass : cuts.size() - 2 - pass;
            PathSamples part(width, height);
            for (size_t i = 0; i < v.size(); ++i) {
              if (int(i) % n < cuts[at] || int(i) % n >= cuts[at + 1]) continue;
              const auto vec = [&](const auto& from) { return Vec3(from[3 * i], from[3 * i + 1], from[3 * i + 2]); };
              ASSERT_TRUE(part.add(int(v.film[2 * i]), int(v.film[2 * i + 1]), Vec2(v.film[2 * i], v.film[2 * i + 1]), vec(v.direct), vec(v.indirect)).ok());
            }
            ASSERT_TRUE((weigh ? d.weigh(part.view(), some) : d.count(part.view(), some)).ok());
          }
        const auto f = d.finish(some);
        ASSERT_TRUE(f.ok());
        double rejected = 0;
        for (const float r : f->rejected) rejected += double(r);
        EXPECT_GT(rejected, 1.0);
        if (expected.empty()) expected = f->rgb;
        EXPECT_EQ(f->rgb, expected) << threads << " threads, " << cuts.size() - 1 << " passes";
      }
  }
}

TEST(PathDensityStreaming, ATracersBlocksTracedTwiceAreTheStoredSamples) {
  tests::SceneMaker m;
  m.instance(m.mesh(tests::box(Vec3(-2, 0, -2), Vec3(2, 3, 2), true), m.material(Vec3(0.7f, 0.5f, 0.3f))));
  LightShape lamp;
  lamp.kind = LightKind::Rect;
  lamp.position = Vec3(0, 2.9f, 0);
  lamp.u = Vec3(0.5f, 0, 0);
  lamp.v = Vec3(0, 0, 0.5f);
  lamp.axis = Vec3(0, -1, 0);
  m.light(lamp, Vec3(4.0f, 3.0f, 2.0f));
  m.camera(Vec3(0.1f, 1.3f, 1.8f), Vec3(0, 1.9f, 0), 1.1f);
  tests::Traced t(m.finish(), 15, 11);
  t.settings.blockSize = 16;
  uint64_t rays = 0, dropped = 0;
  const auto traced = [&](uint32_t first, uint32_t blocks) {
    // A tracer of its own each time, as one that begins again has.
    auto samples = traceSamples(*t.tracer(), t.settings, first, blocks, size_t(1) << 24, arena(), rays, dropped);
    EXPECT_TRUE(samples.ok()) << samples.status().toString();
    return std::move(*samples);
  };
  Settings s;
  s.hard = 1.0f;  // tight, so that there is something to reject
  s.soft = 0.4f;
  const Filtered stored = streamed(traced(0, 3).view(), s);
  StreamingDensity d = streamOf(traced(0, 1).view(), s);
  for (uint32_t block = 0; block < 3; ++block) ASSERT_TRUE(d.count(traced(block, 1).view(), arena()).ok());
  for (uint32_t block = 0; block < 3; ++block) ASSERT_TRUE(d.weigh(traced(block, 1).view(), arena()).ok());
  const auto again = d.finish(arena());
  ASSERT_TRUE(again.ok());
  EXPECT_EQ(again->rgb, stored.rgb);
  EXPECT_EQ(again->rejected, stored.rejected);
  double rejected = 0;
  for (const float r : stored.rejected) rejected += std::abs(double(r));
  EXPECT_GT(rejected, 1e-3);
}

TEST(PathDensityStreaming, MemoryDoesNotGrowWithSamples) {
  Settings s = together();
  size_t before = 0;
  for (const int n : {4, 64, 256}) {
    const auto samples = noisy(16, 12, n, 51);
    StreamingDensity d = streamOf(samples.view(), s, {2, 16});
    if (before == 0) before = d.bytes();
    EXPECT_TRUE(d.count(samples.view(), arena()).ok());
    EXPECT_TRUE(d.weigh(samples.view(), arena()).ok());
    EXPECT_EQ(d.bytes(), before) << n;
    EXPECT_LT(double(before) / (16 * 12), 340.0);
    if (n == 64) { EXPECT_GT(PathSamples::kBytesOfSample * samples.size(), 6 * before); }
  }
}

TEST(PathDensityStreaming, BinsAreTheFinestAtWhichAllFitInAnyOrder) {
  const int bins = 8;
  std::vector<GridColour> colours;
  for (uint64_t i = 0; i < 200; ++i) colours.push_back({int32_t(unit(61, i, 0) * 400) - 200, int32_t(unit(61, i, 1) * 150), int32_t(unit(61, i, 2) * 60)});
  const auto distinct = [&](int bits) {
    std::vector<GridColour> keys;
    for (const GridColour& c : colours) keys.push_back({c[0] >> bits, c[1] >> bits, c[2] >> bits});
    std::sort(keys.begin(), keys.end());
    return std::unique(keys.begin(), keys.end()) - keys.begin();
  };
  int bits = 5;
  while (distinct(bits) > bins) ++bits;
  ASSERT_GT(bits, 6);
  float first = 0;
  for (const size_t from : {size_t(0), size_t(77), size_t(150)}) {
    ColourGrid grid(3, 3, 3, bins);
    for (size_t i = 0; i < colours.size(); ++i) ASSERT_TRUE(grid.add(1, 2, colours[(i + from) % colours.size()]));
    grid.settle(arena());
    EXPECT_EQ(grid.binWidth(0, 0), std::ldexp(1.0, bits - 6));
    ColourGrid::Scratch scratch;
    const float sigma = grid.meanDistance(1.5f, 1.5f, colours[0], 1000, 1.0f, {}, scratch);
    if (from == 0) first = sigma;
    EXPECT_EQ(sigma, first);
    // To all others, evenly in a cell of 3 pixels.
    double least = 0;
    for (const GridColour& c : colours)
      least += std::hypot(double(c[0] - colours[0][0]), double(c[1] - colours[0][1]), double(c[2] - colours[0][2])) / 64 / 199;
    EXPECT_NEAR(double(sigma), least + std::sqrt(9.0 / 12), 0.05 * least);
  }
  // A lone sample has nobody; the same again has one at no distance of colour.
  ColourGrid grid(1, 1, 1, bins);
  ASSERT_TRUE(grid.add(0, 0, {100, -700, 3}));
  ColourGrid::Scratch scratch;
  EXPECT_EQ(grid.meanDistance(0.5f, 0.5f, {100, -700, 3}, 5, 1.0f, {}, scratch), 0.0f);
  ASSERT_TRUE(grid.add(0, 0, {100, -700, 3}));
  EXPECT_FLOAT_EQ(grid.meanDistance(0.5f, 0.5f, {100, -700, 3}, 5, 1.0f, {}, scratch), std::sqrt(1.0f / 12));
}

TEST(PathDensityStreaming, ColoursBeyondAllBoundsAreCounted) {
  EXPECT_EQ(gridColourOf(1e18f, -1e18f, 0.5f), (GridColour{524287, -524287, 32}));
  ColourGrid grid(1, 1, 1, 8);
  for (const int32_t a : {-524287, 0, 524287})
    for (const int32_t b : {-524287, 0, 524287})
      for (const int32_t c : {-524287, 0, 524287}) ASSERT_TRUE(grid.add(0, 0, {a, b, c}));
  ColourGrid::Scratch scratch;
  const float sigma = grid.meanDistance(0.5f, 0.5f, {0, 0, 0}, 26, 1.0f, {}, scratch);
  EXPECT_TRUE(std::isfinite(sigma));
  EXPECT_GT(sigma, 1000.0f);
}

TEST(PathDensityStreaming, DirectLightStaysAndWithoutThresholdsItIsTheMean) {
  const auto samples = noisy(13, 11, 9, 71);
  Settings s = together();
  s.judged = Judged::Indirect;
  const auto mean = meansOf(samples.view());
  const Filtered f = streamed(samples.view(), s);
  for (size_t i = 0; i < mean.size(); ++i) EXPECT_NEAR(double(f.rgb[i]) + double(f.rejected[i]), mean[i], 1e-6 * (mean[i] + double(f.rgb[i])));
  // The same with direct light a million times as bright: what is rejected is the same.
  PathSamples bright(13, 11);
  const SampleView v = samples.view();
  for (size_t i = 0; i < v.size(); ++i)
    ASSERT_TRUE(bright
                    .add(int(v.film[2 * i]), int(v.film[2 * i + 1]), Vec2(v.film[2 * i], v.film[2 * i + 1]), Vec3(1e6f * float(i)),
                         Vec3(v.indirect[3 * i], v.indirect[3 * i + 1], v.indirect[3 * i + 2]))
                    .ok());
  EXPECT_EQ(streamed(bright.view(), s).rejected, f.rejected);
  s.soft = s.hard = std::numeric_limits<float>::infinity();
  s.neighbours = 1000;
  const Filtered whole = streamed(samples.view(), s);
  for (size_t i = 0; i < mean.size(); ++i) EXPECT_NEAR(double(whole.rgb[i]), mean[i], 1e-6 * mean[i]);
  for (const float r : whole.rejected) EXPECT_EQ(r, 0.0f);
}

TEST(PathDensityStreaming, SaysWhatItDoesNotTake) {
  const auto samples = noisy(9, 8, 4, 81);
  const SampleView v = samples.view();
  const auto refused = [&](auto change, GridSettings g = {}) {
    Settings s = together();
    change(s);
    const auto r = StreamingDensity::create(9, 8, s, g);
    return !r.ok() && r.status().code() == Code::InvalidArgument;
  };
  EXPECT_FALSE(refused([](Settings&) {}));
  EXPECT_TRUE(refused([](Settings& s) { s.judged = Judged::Apart; }));
  EXPECT_TRUE(refused([](Settings& s) { s.border = Border::Correct; }));
  EXPECT_TRUE(refused([](Settings& s) { s.density = true; }));
  EXPECT_TRUE(refused([](Settings& s) { s.first = 1; }));
  EXPECT_TRUE(refused([](Settings& s) { s.hard = 1; }));
  EXPECT_TRUE(refused([](Settings&) {}, {0, 16}));
  EXPECT_TRUE(refused([](Settings&) {}, {3, 16}));
  EXPECT_FALSE(refused([](Settings& s) { s.metric.filmScale = 1.5f; }, {3, 16}));
  EXPECT_TRUE(refused([](Settings&) {}, {2, 7}));
  EXPECT_FALSE(StreamingDensity::create(0, 8, together()).ok());
  // Streams that are not the same, or in the wrong order.
  StreamingDensity d = streamOf(v, together());
  ASSERT_TRUE(d.count(v, arena()).ok());
  EXPECT_EQ(d.finish(arena()).status().code(), Code::FailedPrecondition);
  ASSERT_TRUE(d.weigh(v, arena()).ok());
  EXPECT_EQ(d.count(v, arena()).code(), Code::FailedPrecondition);
  EXPECT_TRUE(d.finish(arena()).ok());
  ASSERT_TRUE(d.weigh(v, arena()).ok());
  EXPECT_EQ(d.finish(arena()).status().code(), Code::FailedPrecondition);
  // More neighbours than even light has; another size; correlated; stopped.
  StreamingDensity more = streamOf(v, together(40));
  ASSERT_TRUE(more.count(v, arena()).ok());
  EXPECT_EQ(more.weigh(v, arena()).code(), Code::InvalidArgument);
  SampleView other = v;
  other.width = 8;
  EXPECT_EQ(streamOf(v, together()).count(other, arena()).code(), Code::InvalidArgument);
  other = v;
  other.correlated = true;
  EXPECT_EQ(streamOf(v, together()).count(other, arena()).code(), Code::InvalidArgument);
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_EQ(streamOf(v, together()).count(v, arena(), stop.token()).code(), Code::Cancelled);
  EXPECT_EQ(streamOf(v, together()).weigh(v, arena(), stop.token()).code(), Code::Cancelled);
  // No samples at all.
  StreamingDensity none = streamOf(v, together());
  const auto f = none.finish(arena());
  ASSERT_TRUE(f.ok());
  EXPECT_EQ(f->empty, 72u);
}

}  // namespace path_density_streaming_test
}  // namespace gobo
