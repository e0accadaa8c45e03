// SPDX-License-Identifier: Apache-2.0
// Slices of a shutter: what becomes of each kind of plane.
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "filters/slice_sum.h"
#include "terms/node.h"

namespace gobo::slice_sum_test {
namespace {

using How = SlicePlane::How;
constexpr int kSlices = 3, kWidth = 4;

/// Slice k of three: four pixels that are seen in (all, the first two, the last, no) slices, with values that name slice and pixel.
TermPtr slice(int k) {
  auto t = std::make_shared<Term>("slice", Domain::Pixel, Extent{kWidth, 1, 1});
  const auto share = t->addPlane<float>("coverage"), value = t->addPlane<float>("value", 2), rgb = t->addPlane<float>("rgb", 3);
  const bool seen[kWidth] = {true, k < 2, k == 2, false};
  const float part[kSlices] = {1.0f, 0.25f, 0.5f};
  for (int p = 0; p < kWidth; ++p) {
    share[size_t(p)] = seen[p] ? part[k] : 0.0f;
    for (int c = 0; c < 2; ++c) value[size_t(2 * p + c)] = float(100 * (k + 1) + 10 * p + c);
    for (int c = 0; c < 3; ++c) rgb[size_t(3 * p + c)] = float(k * k) + float(p) - float(c);
  }
  return t;
}

TermPtr run(const NodePtr& node, std::vector<TermPtr> inputs) {
  TaskArena arena(2);
  RunContext ctx;
  ctx.arena = &arena;
  const auto run = [&]() -> Result<TermPtr> {
    const auto* fold = dynamic_cast<const FoldNode*>(node.get());
    if (!fold) {
      ctx.inputs = std::move(inputs);
      return runNode(*node, ctx);
    }
    std::vector<TermShape> in;
    for (const TermPtr& input : inputs) in.push_back(shapeOf(*input));
    GOBO_ASSIGN(const TermShape shape, node->infer(in));
    auto state = fold->begin(ctx, {});
    for (int k = 0; k < kSlices; ++k) GOBO_TRY(fold->step(ctx, *state, k, {inputs.begin() + k * fold->stride(), inputs.begin() + (k + 1) * fold->stride()}));
    ctx.result = makeTerm(shape);
    return fold->finish(ctx, std::move(state));
  };
  const auto made = run();
  EXPECT_TRUE(made.ok()) << made.status().toString();
  return made.ok() ? *made : nullptr;
}

TEST(SliceSum, EachPlaneIsPutTogetherAsItSays) {
  const std::vector<SlicePlane> planes{{"coverage", 1},
                                       {"value", 2, How::MeanOverSeen, 0},
                                       {"value", 2, How::MeanOfSeen, 0},
                                       {"value", 2, How::Least},
                                       {"rgb", 3},
                                       {"rgb", 3, How::MeanOfEven},
                                       {"rgb", 3, How::Sum}};
  std::vector<TermPtr> inputs;
  for (int k = 0; k < kSlices; ++k)
    for (size_t i = 0; i < planes.size(); ++i) inputs.push_back(slice(k));
  const TermPtr sum = run(makeSliceSumNode(planes, kWidth, 1, kSlices), inputs);
  ASSERT_TRUE(sum);
  const auto at = [&](size_t i, size_t k) { return sum->floats(slicedPlane(i))[k]; };
  for (size_t c = 0; c < 2; ++c) {
    const float n = float(c);
    // Seen in all slices by 1, 1/4 and 1/2; in two of them by 1 and 1/4; in the last; in none.
    EXPECT_FLOAT_EQ(at(1, c), (100 + 0.25f * 200 + 0.5f * 300) / 1.75f + n);
    EXPECT_FLOAT_EQ(at(1, 2 + c), (110 + 0.25f * 210) / 1.25f + n);
    EXPECT_FLOAT_EQ(at(1, 4 + c), 320 + n);
    EXPECT_EQ(at(1, 6 + c), 0.0f);
    EXPECT_FLOAT_EQ(at(2, c), 200 + n);
    EXPECT_FLOAT_EQ(at(2, 2 + c), (110 + 210 + 2 * n) / 3);
    EXPECT_FLOAT_EQ(at(2, 4 + c), (320 + n) / 3);
    EXPECT_EQ(at(2, 6 + c), 1.0f);
    for (size_t p = 0; p < 4; ++p) EXPECT_EQ(at(3, 2 * p + c), 100 + 10 * float(p) + n);
  }
  for (size_t p = 0; p < 4; ++p)
    for (size_t c = 0; c < 3; ++c) {
      const float rest = float(p) - float(c);
      EXPECT_FLOAT_EQ(at(4, 3 * p + c), 5.0f / 3 + rest);
      EXPECT_FLOAT_EQ(at(5, 3 * p + c), 2.0f + rest) << "of slices 0 and 2";
      EXPECT_FLOAT_EQ(at(6, 3 * p + c), 5.0f + 3 * rest);
    }
  const TermPtr part = run(makeSlicePartNode("features", {{"share", 1}, {"place", 2}}, 0, kWidth, 1), {sum});
  ASSERT_TRUE(part);
  EXPECT_EQ(part->type(), "features");
  for (size_t p = 0; p < 4; ++p) {
    EXPECT_EQ(part->floats("share")[p], at(0, p));
    EXPECT_EQ(part->floats("place")[2 * p + 1], at(1, 2 * p + 1));
  }
}

TEST(SliceSum, WrongPlanesAreNoPlan) {
  const auto wired = [](std::vector<SlicePlane> planes) {
    std::vector<TermShape> in(planes.size(), shapeOf(*slice(0)));
    return makeSliceSumNode(planes, kWidth, 1, 1)->infer(in).ok();
  };
  EXPECT_TRUE(wired({{"coverage", 1}, {"value", 2, How::MeanOverSeen, 0}}));
  EXPECT_FALSE(wired({{"coverage", 1}, {"value", 2, How::MeanOverSeen}})) << "by nothing";
  EXPECT_FALSE(wired({{"coverage", 1}, {"value", 2, How::MeanOfSeen, 7}}));
  EXPECT_FALSE(wired({{"rgb", 3}, {"value", 2, How::MeanOverSeen, 0}})) << "by three channels";
  EXPECT_FALSE(wired({{"coverage", 1, How::Least}, {"value", 2, How::MeanOfSeen, 0}}));
  EXPECT_FALSE(wired({{"coverage", 1}, {"value", 2, How::Mean, 0}}));
  EXPECT_FALSE(wired({{"value", 3}})) << "of two channels";
}

}  // namespace
}  // namespace gobo::slice_sum_test
