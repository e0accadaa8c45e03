// SPDX-License-Identifier: Apache-2.0
// The path tracer by Halton points and by independent numbers: lanes, means, parts of a sequence.
#include <gtest/gtest.h>

#include "base/halton.h"
#include "base/independent.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"
#include "trace/sample_set.h"

namespace gobo {
namespace {

using namespace tests;

constexpr SamplerKind kKinds[] = {SamplerKind::Sobol, SamplerKind::Halton, SamplerKind::Independent};
const char* const kNames[] = {"Sobol", "Halton", "independent"};

template <class Sampler>
void expectLanes(SamplerKind kind) {
  uint64_t seeds[kLanes];
  for (int i = 0; i < kLanes; ++i) seeds[i] = hash64(5, uint64_t(i));
  for (const int sequences : {1, 2, 4, 8, 16})
    for (const uint32_t first : {0u, 3u, 1024u, 0xfffffff0u}) {
      const SampleSet set(std::span<const uint64_t>(seeds, size_t(sequences)), first, kind);
      const int each = kLanes / sequences;
      float x[300][kLanes], y[300][kLanes];
      for (uint32_t d = 0; d < 300; ++d) {
        if (d % 3 == 2) set.draw1D(d, x[d]);
        else set.draw2D(d, x[d], y[d]);
      }
      for (uint32_t d = 3; d < 9; ++d) {  // three at once: each has the numbers that it has alone
        float at[6][kLanes];
        set.draw3x2D(d, at);
        for (uint32_t k = 0; k < 3; ++k) {
          float alone[2][kLanes];
          set.draw2D(d + k, alone[0], alone[1]);
          for (int i = 0; i < kLanes; ++i)
            ASSERT_EQ(Vec2(at[2 * k][i], at[2 * k + 1][i]), Vec2(alone[0][i], alone[1][i])) << "dimension " << d << " + " << k << " lane " << i;
        }
      }
      for (int i = 0; i < kLanes; ++i) {
        EXPECT_EQ(set.seed(i), seeds[i / each]);
        Sampler s(seeds[i / each], first + uint32_t(i % each));
        for (uint32_t d = 0; d < 300; ++d) {
          if (d % 3 == 2) ASSERT_EQ(s.next1D(), x[d][i]) << "dimension " << d << " lane " << i;
          else ASSERT_EQ(s.next2D(), Vec2(x[d][i], y[d][i])) << "dimension " << d << " lane " << i;
        }
      }
    }
}

TEST(SampleSet, LanesAreTheScalarNumbersOfEverySampler) {
  expectLanes<SobolSampler>(SamplerKind::Sobol);
  expectLanes<HaltonSampler>(SamplerKind::Halton);
  expectLanes<IndependentSampler>(SamplerKind::Independent);
}

TEST(SampleSet, TurnsAreTakenEquallyOften) {
  for (const uint32_t n : {1u, 3u, 5u, 14u, 16u}) {
    const SampleSet set(9, 0, SamplerKind::Halton);
    int moved = 0;
    for (uint64_t begin = 0; begin < 40 * n; begin += n) {
      std::vector<int> count(n, 0);
      for (uint64_t i = begin; i < begin + n; ++i) ++count[(i + set.turnShift(0, i, n)) % n];
      for (const int c : count) ASSERT_EQ(c, 1) << n;
      moved += set.turnShift(0, begin, n) != 0;
    }
    EXPECT_EQ(moved == 0, n == 1) << n;
    EXPECT_EQ(SampleSet(9, 0).turnShift(0, 77, n), 0u);
    EXPECT_EQ(SampleSet(9, 0, SamplerKind::Independent).turnShift(0, 77, n), 0u);
  }
}

/// A lit room corner with a gloss, a blocker before the lamp, and edges in every pixel.
ScenePtr blockedLamp() {
  SceneMaker m;
  m.instance(m.mesh(ground(3.0f), m.material(Vec3(0.7f, 0.5f, 0.3f))));
  m.instance(m.mesh(quad(Vec3(-3, 0, -1.5f), Vec3(6, 0, 0), Vec3(0, 3, 0)), m.material(Vec3(0.3f, 0.6f, 0.7f))));
  m.instance(m.mesh(box(Vec3(-0.4f, 0, -0.4f), Vec3(0.4f, 0.8f, 0.4f)), m.material(Vec3(0.6f), [](Material& x) {
    x.bsdf.specular = 1.0f;
    x.bsdf.roughness = 0.3f;
  })));
  m.instance(m.mesh(box(Vec3(0.3f, 1.2f, -1), Vec3(0.9f, 1.3f, 1)), m.material(Vec3(0.2f))));
  LightShape lamp;
  lamp.kind = LightKind::Rect;
  lamp.position = Vec3(0.2f, 2.5f, 0.2f);
  lamp.u = Vec3(0.8f, 0, 0);
  lamp.v = Vec3(0, 0, 0.6f);
  m.light(lamp, Vec3(6.0f));
  m.environment(constantEnvironment(Vec3(0.2f, 0.3f, 0.4f)));
  m.camera(Vec3(0.5f, 2, 4), Vec3(0, 0.4f, 0), 0.7f);
  return m.finish();
}

/// Glass that disperses over a patch, and a ball of fog.
ScenePtr glassAndFog() {
  SceneMaker m;
  m.instance(m.mesh(ground(3.0f), m.material(Vec3(0.7f))));
  m.instance(m.mesh(quad(Vec3(-2, 0, -1.5f), Vec3(2, 0, 0), Vec3(0, 2.5f, 0)), m.material(Vec3(0.05f))));
  m.instance(m.mesh(sphere(Vec3(-0.7f, 0.8f, 0.0f), 0.7f, 12, true), m.material(Vec3(1.0f), dispersingGlass)));
  m.instance(m.mesh(sphere(Vec3(0.9f, 0.9f, 0.0f), 0.6f, 12, true), m.material(Vec3(1.0f), fog)));
  LightShape lamp;
  lamp.kind = LightKind::Disk;
  lamp.position = Vec3(0, 3, 1);
  lamp.axis = Vec3(0, -1, 0);
  lamp.radius = 0.6f;
  m.light(lamp, Vec3(6.0f));
  m.environment(constantEnvironment(Vec3(0.4f)));
  m.camera(Vec3(0, 1.2f, 4), Vec3(0, 0.8f, 0), 0.6f);
  return m.finish();
}

TEST(Samplers, HaveTheSameMeans) {
  const struct {
    const char* name;
    ScenePtr scene;
    int viewSamples, bounces;
    SplitMode split;
  } cases[] = {{"blocked lamp", blockedLamp(), 0, 4, SplitMode::DirectIndirect},
               {"blocked lamp, 5 view samples", blockedLamp(), 5, 2, SplitMode::Combined},
               {"glass and fog", glassAndFog(), 0, 12, SplitMode::Combined},
               {"glass and fog, 3 view samples", glassAndFog(), 3, 5, SplitMode::Combined}};
  const int blocks = testing::thoroughOr(300, 150);
  for (const auto& c : cases) {
    SCOPED_TRACE(c.name);
    Traced t(c.scene, 6, 6);
    t.settings.maxBounces = c.bounces;
    t.settings.split = c.split;
    t.settings.viewSamples = c.viewSamples;
    t.settings.blockSize = c.viewSamples > 0 ? 4 * c.viewSamples : 16;  // a block has each view sample equally often
    Measured m[3];
    for (int k = 0; k < 3; ++k) {
      t.settings.sampler = kKinds[k];
      t.settings.seed = 31 + uint64_t(k);
      m[k] = estimate(t, blocks);
      for (size_t slot = 0; slot < m[0].slots.size(); ++slot) expectSame(m[k][slot], m[0][slot]);
    }
    const size_t last = m[0].slots.size() - 1;
    EXPECT_LT(m[0][last].error.x, testing::thoroughOr(0.03, 0.042) * m[0][last].mean.x);  // of half of the blocks: root 2 times as much
    const size_t shown = c.split == SplitMode::DirectIndirect ? 1 : 0;
    const double sobol = m[0][shown].error.y, halton = m[1][shown].error.y, independent = m[2][shown].error.y;
    std::printf("  %s: errors of Sobol %.5f, Halton %.5f, independent %.5f at %.4f\n", c.name, sobol, halton, independent, m[0][shown].mean.y);
    if (shown == 0) continue;  // rare paths decide
    EXPECT_LT(sobol, 0.7 * independent);
    EXPECT_LT(halton, 0.7 * independent);
  }
}

/// One sequence of one pixel that sees all of the scene. Turns that were tied to digits of the points would each see a part of the lamp, or of the pixel,
/// however many samples there are.
TEST(Samplers, OneSequenceConvergesWithViewSamplesAndDispersion) {
  for (const auto& [name, scene, viewSamples] :
       {std::tuple("5 view samples", blockedLamp(), 5), {"7 view samples", blockedLamp(), 7}, {"dispersion", glassAndFog(), 0}}) {
    SCOPED_TRACE(name);
    Traced t(scene, 1, 1);
    t.settings.viewSamples = viewSamples;
    t.settings.maxBounces = 5;
    const int samples = 4096 * std::max(viewSamples, 3), size = samples / 8;
    t.settings.blockSize = size <= 4096 ? size : 4096;
    const int blocks = samples / t.settings.blockSize;
    const auto mean = [&](SamplerKind kind, uint64_t seed) {
      t.settings.sampler = kind;
      t.settings.seed = seed;
      DVec3 sum(0.0);
      uint64_t rays = 0, dropped = 0;
      for (int b = 0; b < blocks; ++b) t.tracer()->traceBlock(0, 0, uint32_t(b), &sum.x, rays, dropped);
      return sum / double(blocks * t.settings.blockSize);
    };
    DVec3 truth(0.0);
    const uint64_t sequences = viewSamples > 0 ? testing::thoroughOr<uint64_t>(8, 4) : 8;  // dispersion is noisy
    for (uint64_t seed = 100; seed < 100 + sequences; ++seed) truth += mean(SamplerKind::Sobol, seed) / double(sequences);
    for (const SamplerKind kind : {SamplerKind::Halton, SamplerKind::Independent}) {
      if (!testing::thorough() && kind == SamplerKind::Independent && viewSamples == 7) continue;  // 5 are as good: it has no base
      double squares = 0;
      for (uint64_t seed = 0; seed < 8; ++seed) {
        const DVec3 apart = mean(kind, seed) / truth - 1.0;
        squares += glm::dot(apart, apart) / (3 * 8);
      }
      std::printf("  %s, %s: RMS %.4f of the truth\n", name, kNames[int(kind)], std::sqrt(squares));
      EXPECT_LT(std::sqrt(squares), viewSamples > 0 ? 0.012 : 0.03) << kNames[int(kind)];  // tied: 0.12, 0.026, 0.079
    }
  }
}

/// Channels and view samples take turns; where 3 divides the number of view samples each of these must be seen in every channel all the same.
TEST(Samplers, ChannelsAreNotTiedToViewSamples) {
  for (const int viewSamples : {3, 4, 9}) {
    Traced t(glassAndFog(), 1, 1);
    t.settings.viewSamples = viewSamples;
    t.settings.maxBounces = 5;
    t.settings.blockSize = 64 * viewSamples;
    DVec3 means[6], all(0.0);
    for (uint64_t seed = 0; seed < 6; ++seed) {  // which channel begins is the seed's
      t.settings.seed = seed;
      DVec3 sum(0.0);
      uint64_t rays = 0, dropped = 0;
      const uint32_t blocks = uint32_t(200 / viewSamples);
      for (uint32_t b = 0; b < blocks; ++b) t.tracer()->traceBlock(0, 0, b, &sum.x, rays, dropped);
      means[seed] = sum / (double(blocks) * t.settings.blockSize);
      all += means[seed] / 6.0;
    }
    double squares = 0;
    for (const DVec3& mean : means) squares += glm::dot(mean / all - 1.0, mean / all - 1.0) / 18;
    std::printf("  %d view samples: seeds are apart by %.4f of the mean\n", viewSamples, std::sqrt(squares));
    EXPECT_LT(std::sqrt(squares), 0.03) << viewSamples;
  }
}

/// Samples are numbered through: blocks of any size are parts of one sequence.
TEST(Samplers, BlocksOfAnySizeArePartsOfOneSequence) {
  for (const int viewSamples : {0, 3})
    for (const SamplerKind kind : kKinds) {
      Traced t(glassAndFog(), 3, 2);
      t.settings.sampler = kind;
      t.settings.viewSamples = viewSamples;
      const auto sum = [&](int size) {
        t.settings.blockSize = size;
        const auto tracer = t.tracer();
        std::vector<double> out(3, 0.0);
        uint64_t rays = 0, dropped = 0;
        for (int b = 0; b < 192 / size; ++b) tracer->traceBlock(1, 1, uint32_t(b), out.data(), rays, dropped);
        return out;
      };
      const std::vector<double> whole = sum(192);
      EXPECT_GT(whole[0], 0.0);
      for (const int size : {16, 64}) EXPECT_EQ(sum(size), whole) << kNames[int(kind)] << " in blocks of " << size;
      for (const int size : {1, 2, 6, 24}) {  // added up in another order
        const std::vector<double> parts = sum(size);
        for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(parts[c], whole[c], 1e-9 * whole[c]) << kNames[int(kind)] << " in blocks of " << size;
      }
    }
}

}  // namespace
}  // namespace gobo
