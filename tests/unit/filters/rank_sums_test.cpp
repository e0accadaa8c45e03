// SPDX-License-Identifier: Apache-2.0
// Ranked pairs of many slices: exact means, ranked anew; what becomes of more ids than are kept.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <map>
#include <random>

#include "filters/rank_sums.h"

namespace gobo {
namespace {

float idBits(uint32_t id) { return std::bit_cast<float>(id); }
constexpr uint32_t kA = 0x3f000001, kB = 0x3f000002, kC = 0xbf000003;

TEST(RankSums, AreMeansRankedAnew) {
  RankSums sums(3);
  const float one[] = {idBits(kA), 0.75f, idBits(kB), 0.25f, 0, 0}, two[] = {idBits(kB), 1.0f, 0, 0, 0, 0},
              three[] = {idBits(kC), 0.5f, idBits(kA), 0.5f, 0, 0};
  for (const auto& slice : {one, two, three}) sums.add(1, std::span(slice, 6));
  float out[6];
  sums.write(1, 3, out);
  const float third = 1.25f / 3;  // A and B alike: by id
  EXPECT_EQ(std::bit_cast<uint32_t>(out[0]), kA);
  EXPECT_FLOAT_EQ(out[1], third);
  EXPECT_EQ(std::bit_cast<uint32_t>(out[2]), kB);
  EXPECT_FLOAT_EQ(out[3], third);
  EXPECT_EQ(std::bit_cast<uint32_t>(out[4]), kC);
  EXPECT_FLOAT_EQ(out[5], 0.5f / 3);
  sums.write(0, 3, out);
  for (const float v : out) EXPECT_EQ(v, 0.0f) << "its neighbour has nothing";
  float wide[28];
  sums.write(1, 3, wide);
  for (int k = 6; k < 28; ++k) EXPECT_EQ(wide[k], 0.0f);
}

TEST(RankSums, OrderOfSlicesDoesNotMatterAndNothingIsLost) {
  std::mt19937 random(5);
  std::vector<std::vector<float>> slices;
  std::map<uint32_t, double> truth;
  for (int s = 0; s < 256; ++s) {
    std::vector<float> pairs;
    float left = 1.0f;
    for (int k = 0; k < 6; ++k) {
      const uint32_t id = 0x40000000u + (random() + uint32_t(k) * 2) % 12;  // of twelve
      const float coverage = k == 5 ? left : left * float(random() % 1000) / 1000.0f;
      left -= coverage;
      pairs.insert(pairs.end(), {idBits(id), coverage});
      truth[id] += double(coverage) / 256;
    }
    slices.push_back(pairs);
  }
  ASSERT_EQ(truth.size(), size_t(RankSums::kKept));
  RankSums first(1), second(1);
  for (const auto& s : slices) first.add(0, s);
  std::shuffle(slices.begin(), slices.end(), random);
  for (const auto& s : slices) second.add(0, s);
  float a[24], b[24];
  first.write(0, 256, a);
  second.write(0, 256, b);
  EXPECT_TRUE(std::equal(a, a + 24, b));
  for (int k = 0; k < 24; k += 2) {
    EXPECT_NEAR(a[k + 1], truth.at(std::bit_cast<uint32_t>(a[k])), 1e-7);
    if (k) { EXPECT_LE(a[k + 1], a[k - 1]); }
  }
}

TEST(RankSums, OfMoreIdsTheLeastGo) {
  RankSums sums(1);
  for (uint32_t id = 1; id <= 13; ++id) {  // one too many; the fourth has the least
    const float pair[] = {idBits(0x40000000u + id), id == 4 ? 0.01f : 0.05f + 0.01f * float(id)};
    sums.add(0, pair);
  }
  float out[26];
  sums.write(0, 1, out);
  for (int k = 0; k < 24; k += 2) EXPECT_NE(std::bit_cast<uint32_t>(out[k]), 0x40000004u);
  EXPECT_EQ(std::bit_cast<uint32_t>(out[0]), 0x4000000du);
  EXPECT_EQ(out[25], 0.0f);
  const float less[] = {idBits(0x40000020u), 0.001f};
  sums.add(0, less);
  float same[26];
  sums.write(0, 1, same);
  EXPECT_TRUE(std::equal(out, out + 26, same)) << "less than all that are kept";
}

TEST(RankSums, WhatIsNoCoverageIsNone) {
  RankSums sums(1);
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinite = std::numeric_limits<float>::infinity();
  const float pairs[] = {idBits(kA), nan, idBits(kB), -1.0f, idBits(kC), infinite};
  sums.add(0, pairs);
  float out[4];
  sums.write(0, 1, out);
  EXPECT_EQ(std::bit_cast<uint32_t>(out[0]), kC);
  EXPECT_EQ(out[1], 1.0f);
  EXPECT_EQ(out[3], 0.0f);
}

}  // namespace
}  // namespace gobo
