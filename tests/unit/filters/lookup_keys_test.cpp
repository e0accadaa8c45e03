// SPDX-License-Identifier: Apache-2.0
// Parameters that other parts of a key usually change along with them (the margins of a map's frame, its encoding): each is in the node's own
// key all the same. And what a mean over view samples leaves out.
#include <gtest/gtest.h>

#include <string>

#include "filters/composite.h"
#include "filters/shadow_map/shadow_map.h"
#include "filters/soft_shadow/soft_shadow.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

std::string key(const NodePtr& node) {
  Hasher h("parameters");
  node->hashParameters(h);
  return h.digest().hex();
}

TEST(LookupKeys, PatternOrderAndResolutionAreInThem) {
  PercentageCloserLookup regular, poisson;
  regular.taps = poisson.taps = 3;
  poisson.pattern = v1::PercentageCloserShadow::POISSON;
  EXPECT_NE(key(makePercentageCloserNode(regular)), key(makePercentageCloserNode(poisson)));
  PercentageCloserLookup regularPart = regular, poissonPart = poisson;  // disks are turned by a pixel's place in the picture
  regularPart.place = poissonPart.place = {3, 4, 64, 48};
  EXPECT_EQ(key(makePercentageCloserNode(regular)), key(makePercentageCloserNode(regularPart)));
  EXPECT_NE(key(makePercentageCloserNode(poisson)), key(makePercentageCloserNode(poissonPart)));
  EXPECT_NE(key(makeLightDepthMapNode(LightFrames(), 64)), key(makeLightDepthMapNode(LightFrames(), 65)));
  ConvolutionSoftLookup four, eight;
  eight.order = 8;
  EXPECT_NE(key(makeConvolutionSoftNode(four)), key(makeConvolutionSoftNode(eight)));
  PercentageCloserSoftLookup few, many;
  many.searchTaps = 2 * few.searchTaps;
  EXPECT_NE(key(makePercentageCloserSoftNode(few)), key(makePercentageCloserSoftNode(many)));
}

TEST(PixelMean, OverValidSamplesOnlyOrOverAll) {
  PlaneView view;
  view.width = 2;
  view.height = 1;
  view.layers = 2;
  const auto g = planeGBuffer(view);
  const auto values = floatTerm({2, 1, 2}, "V", [](int x, int, int layer) { return float(1 + 2 * layer + 4 * x); });  // 1, 3 and 5, 7
  g->writable<uint32_t>("instance")[2] = ~0u;                                                                         // pixel 0, second layer
  const auto valid = runFilter(makePixelMeanNode("V", 1, 2, 1, 2, true), {values, g});
  EXPECT_EQ(valid->floats("V")[0], 1.0f);
  EXPECT_EQ(valid->floats("V")[1], 6.0f);
  const auto all = runFilter(makePixelMeanNode("V", 1, 2, 1, 2, false), {values, g});
  EXPECT_EQ(all->floats("V")[0], 0.5f);
  EXPECT_EQ(all->floats("V")[1], 6.0f);
}

}  // namespace
}  // namespace gobo
