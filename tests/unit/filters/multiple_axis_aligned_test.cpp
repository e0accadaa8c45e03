// SPDX-License-Identifier: Apache-2.0
// Bands of the light: they sum to the light, and the nodes around the axis-aligned filter pass on what they are given.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "filters/multiple_axis_aligned/bands.h"
#include "terms/light_samples.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

TEST(LightBands, ProfilesSumToOneAndHaveTheirMeans) {
  for (const LightBands& bands : {LightBands{{0.0f}}, LightBands{{1.0f, 0.0f}}, LightBands{{0.8f, 0.3f, 0.0f}}}) {
    std::vector<double> mean(size_t(bands.count()));
    const int n = 400;
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        const float u = (2 * (float(x) + 0.5f)) / float(n) - 1, v = (2 * (float(y) + 0.5f)) / float(n) - 1;
        double sum = 0;
        for (int j = 0; j < bands.count(); ++j) {
          const float l = bands.profile(j, u, v);
          ASSERT_GE(l, -1e-6f);
          mean[size_t(j)] += double(l) / (n * n);
          sum += double(l);
        }
        ASSERT_NEAR(sum, 1, 1e-6);
      }
    double all = 0;
    for (int j = 0; j < bands.count(); ++j) {
      EXPECT_NEAR(mean[size_t(j)], bands.mean(j), 1e-4) << j;
      all += double(bands.mean(j));
    }
    EXPECT_NEAR(all, 1, 1e-6);
  }
}

TEST(LightBands, SmoothestProfileFallsToNothingAtTheEnds) {
  const LightBands bands{{1.0f, 0.0f}};
  EXPECT_EQ(bands.profile(0, 1.0f, 0.0f), 0.0f);
  EXPECT_EQ(bands.profile(0, 0.2f, -1.0f), 0.0f);
  EXPECT_EQ(bands.profile(0, 0.0f, 0.0f), 1.0f);
  EXPECT_EQ(bands.profile(1, 1.0f, 0.3f), 1.0f);
}

TEST(LightBandSum, OneInputStaysToTheBitAndManyAreLimited) {
  const Extent e{16, 8, 1};
  const auto noise = noiseTerm(e, "V", 1);
  const auto one = runFilter(makeLightBandSum(), {noise}), two = runFilter(makeLightBandSum(), {noise, noise});
  for (size_t p = 0; p < e.elements(); ++p) {
    ASSERT_EQ(one->floats("V")[p], noise->floats("V")[p]);
    ASSERT_EQ(two->floats("V")[p], std::min(2 * noise->floats("V")[p], 1.0f));
  }
}

TEST(LightBandSum, NotANumberIsRefused) {
  const auto bad = floatTerm({4, 4, 1}, "V", [](int x, int, int) { return x == 1 ? std::numeric_limits<float>::infinity() : 0.0f; });
  TaskArena arena(1);
  RunContext ctx;
  ctx.inputs = {bad};
  ctx.arena = &arena;
  EXPECT_EQ(runNode(*makeLightBandSum(), ctx).status().code(), Code::Internal);
}

TEST(LightBandNode, PicksItsChannelAndRefusesOneThatIsNot) {
  const Extent e{5, 3, 1};
  auto t = std::make_shared<Term>("light_samples", Domain::ViewSample, e);
  auto band = t->addPlane<float>("band", 3);
  for (size_t i = 0; i < band.size(); ++i) band[i] = float(i);
  const auto out = runFilter(makeLightBand(1), {t});
  for (size_t p = 0; p < e.elements(); ++p) ASSERT_EQ(out->floats("V")[p], float(3 * p + 1));
  const TermShape shape = shapeOf(*t);
  EXPECT_FALSE(makeLightBand(3)->infer({&shape, 1}).ok());
}

}  // namespace
}  // namespace gobo
