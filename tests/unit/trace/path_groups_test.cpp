// SPDX-License-Identifier: Apache-2.0
// Small blocks of neighbouring pixels are traced together: each pixel has the bits that it has by itself, whoever its neighbours are and whether they are
// wanted.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <limits>

#include "support/tiny_scenes.h"
#include "trace/path_kernel.h"

namespace gobo {
namespace {

using namespace tests;

/// Glass that disperses and a haze under lights of every kind of sampling: whatever a lane draws by its pixel or its sample.
ScenePtr fullScene() {
  SceneMaker m;
  m.instance(m.mesh(ground(6.0f), m.material(Vec3(0.7f))));
  m.instance(m.mesh(sphere(Vec3(-0.8f, 0.8f, 0.0f), 0.7f, 12, true), m.material(Vec3(1.0f), dispersingGlass)));
  m.instance(m.mesh(sphere(Vec3(0.9f, 0.9f, 0.0f), 0.8f, 12, true), m.material(Vec3(1.0f), fog)));
  LightShape lamp;
  lamp.kind = LightKind::Disk;
  lamp.position = Vec3(0, 4, 1);
  lamp.axis = Vec3(0, -1, 0);
  lamp.radius = 0.6f;
  m.light(lamp, Vec3(6.0f));
  lamp.kind = LightKind::Point;
  lamp.position = Vec3(-2, 2, 2);
  m.light(lamp, Vec3(3.0f));
  m.camera(Vec3(0, 1.5f, 4), Vec3(0, 0.7f, 0), 0.8f);
  return m.finish();
}

constexpr int kWide = 13, kTall = 7;  // of no group's size

TEST(PathGroups, HaveTheBitsOfTheirPixels) {
  const ScenePtr scene = fullScene();
  const std::pair<SplitMode, SamplerKind> kinds[] = {{SplitMode::Combined, SamplerKind::Sobol},
                                                     {SplitMode::ByLobe, SamplerKind::Sobol},
                                                     {SplitMode::Combined, SamplerKind::Halton},
                                                     {SplitMode::Combined, SamplerKind::Independent}};
  for (const uint32_t size : {1u, 2u, 4u, 8u, 16u})
    for (const auto& [split, sampler] : kinds)
      for (const int viewSamples : {0, 3}) {
        SCOPED_TRACE(std::to_string(size) + " samples, " + std::to_string(viewSamples) + " view samples, sampler " + std::to_string(int(sampler)));
        Traced t(scene, kWide, kTall);
        t.settings.sampler = sampler;
        t.settings.split = split;
        t.settings.blockSize = int(size);
        t.settings.viewSamples = viewSamples;
        t.settings.maxBounces = 5;
        const auto tracer = t.tracer();
        const size_t slots = size_t(tracer->slots()) * 3;
        const PixelGroup group = pixelGroup(size);
        EXPECT_EQ(uint32_t(group.pixels()) * size, 16u);
        double light = 0;
        for (const uint32_t block : {0u, 3u, kBlocksPerStream + 1})
          for (int y = 0; y < kTall; y += group.height)
            for (int x = 0; x < kWide; x += group.width) {
              std::vector<double> sums(size_t(group.pixels()) * slots, 0.25);
              std::vector<double*> out;
              for (int i = 0; i < group.pixels(); ++i)
                out.push_back((x + i) % 5 == 2 || x + i % group.width >= kWide || y + i / group.width >= kTall ? nullptr : &sums[size_t(i) * slots]);
              std::vector<uint64_t> dropped(size_t(group.pixels()), 0);
              uint64_t rays = 0, alone = 0;
              tracer->traceGroup(x, y, {block / kBlocksPerStream, block % kBlocksPerStream * size, size}, out, rays, dropped);
              for (int i = 0; i < group.pixels(); ++i) {
                std::vector<double> own(slots, 0.25);
                uint64_t lost = 0;
                if (out[size_t(i)]) tracer->traceBlock(x + i % group.width, y + i / group.width, block, own.data(), alone, lost);
                ASSERT_TRUE(std::equal(own.begin(), own.end(), sums.begin() + ptrdiff_t(size_t(i) * slots))) << x << "," << y << " pixel " << i;
                EXPECT_EQ(dropped[size_t(i)], lost);
                for (const double v : own) light += v - 0.25;
              }
              EXPECT_GE(rays, alone);
            }
        EXPECT_GT(light, 1.0);
      }
}

TEST(PathGroups, CountWhatIsDroppedByPixel) {
  SceneMaker m;
  m.instance(m.mesh(ground(50.0f), m.material(Vec3(0.5f))));
  LightShape point;
  point.position = Vec3(0, 1, 0);
  m.light(point);
  m.camera(Vec3(1, 2, 0), Vec3(1, 0, 0), 1e-4f);
  Traced t(m.finish(), 8, 8);
  t.settings.nominal[0] = Vec3(std::numeric_limits<float>::infinity(), 1, 1);
  t.settings.nominal.resize(1);
  t.settings.blockSize = 4;
  const auto tracer = t.tracer();
  double sums[4][3] = {};
  double* out[4] = {sums[0], nullptr, sums[2], sums[3]};
  uint64_t rays = 0, dropped[4] = {};
  tracer->traceGroup(2, 4, {0, 0, 4}, out, rays, dropped);
  EXPECT_EQ((std::array{dropped[0], dropped[1], dropped[2], dropped[3]}), (std::array<uint64_t, 4>{4, 0, 4, 4}));
  for (const auto& pixel : sums)
    for (const double v : pixel) EXPECT_EQ(v, 0.0);
}

}  // namespace
}  // namespace gobo
