// SPDX-License-Identifier: Apache-2.0
#include "trace/sample_passes.h"

#include <gtest/gtest.h>

namespace gobo {
namespace {

TEST(SamplePasses, ArePiecesOfOneSequence) {
  uint32_t next = 0;
  for (uint32_t i = 0; i < 300; ++i) {
    const SamplePass p = samplePass(i);
    EXPECT_EQ(samplesOf(i), next);
    EXPECT_EQ(p.block * kBlockSamples + p.first, next) << "pass " << i;
    EXPECT_LE(p.first + p.count, kBlockSamples);
    next += p.count;
  }
  EXPECT_EQ(samplesOf(65540), 1048576u);
}

TEST(SamplePasses, AreTheFewestThatSuffice) {
  for (uint32_t n = 1; n < 5000; ++n) {
    const uint32_t passes = passesFor(n);
    EXPECT_GE(samplesOf(passes), n);
    EXPECT_LT(samplesOf(passes - 1), n);
    EXPECT_EQ(passesFor(samplesOf(passes)), passes) << "what is realised, asked for again, is the same";
  }
  EXPECT_EQ(passesFor(0), 0u);
  EXPECT_EQ(samplesOf(passesFor(1048576)), 1048576u);
}

TEST(SamplePasses, StreamsHaveAllOfThem) {
  for (const uint32_t streams : {1u, 2u, 8u})
    for (uint32_t passes = 0; passes < 60; ++passes) {
      std::vector<uint32_t> dealt(streams, 0);
      for (uint32_t i = 0; i < passes; ++i) dealt[samplePass(i).block % streams] += samplePass(i).count;
      for (uint32_t k = 0; k < streams; ++k) EXPECT_EQ(samplesOfStream(samplesOf(passes), k, streams), dealt[k]) << passes << " passes, stream " << k;
    }
}

}  // namespace
}  // namespace gobo
