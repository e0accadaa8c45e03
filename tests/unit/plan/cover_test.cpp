// SPDX-License-Identifier: Apache-2.0
// No picture holds a path twice or silently lacks one: what techniques get wrong is an error while planning.
#include <gtest/gtest.h>

#include "technique/cover.h"

namespace gobo {
namespace {

constexpr PathSet kWanted = PathSet::Emission | PathSet::Direct | PathSet::Indirect;

TEST(Cover, TheRestIsWhatNobodyClaimed) {
  Cover cover(2, kWanted);
  EXPECT_EQ(cover.rest(0), kWanted);
  ASSERT_TRUE(cover.claim(0, PathSet::Direct, "shadows").ok());
  ASSERT_TRUE(cover.claim(0, PathSet::IndirectDiffuse, "cache").ok());
  EXPECT_EQ(cover.rest(0), PathSet::Emission | PathSet::IndirectSpecular);
  EXPECT_EQ(cover.rest(1), kWanted);
  EXPECT_EQ(cover.claimedBy(0, "cache"), PathSet::IndirectDiffuse);
  EXPECT_EQ(cover.claimedBy(1, "cache"), PathSet::None);
}

TEST(Cover, OverlapIsAnErrorThatNamesBoth) {
  Cover cover(1, kWanted);
  ASSERT_TRUE(cover.claim(0, PathSet::Front, "shadows").ok());
  const Status overlap = cover.claim(0, PathSet::Direct & PathSet::Specular, "highlights");
  EXPECT_EQ(overlap.code(), Code::Internal);
  for (const char* part : {"highlights", "shadows", "direct front specular", "light 0"}) EXPECT_NE(overlap.message().find(part), std::string::npos) << part;
  EXPECT_EQ(overlap.message().find("behind"), std::string::npos) << overlap.message();
  EXPECT_EQ(cover.claimed(0), PathSet::Front) << "a refused claim leaves nothing";
}

TEST(Cover, PathsAreBroughtOnceByWhoClaimedThem) {
  Cover cover(1, kWanted);
  EXPECT_FALSE(cover.bring(0, PathSet::Front, "shadows").ok()) << "without a claim";
  ASSERT_TRUE(cover.claim(0, PathSet::Direct, "shadows").ok());
  EXPECT_FALSE(cover.bring(0, PathSet::Front, "another").ok()) << "somebody else's";
  EXPECT_FALSE(cover.bring(0, PathSet::Front | PathSet::Emission, "shadows").ok()) << "more than claimed";
  ASSERT_TRUE(cover.bring(0, PathSet::Front, "shadows").ok());
  EXPECT_FALSE(cover.bring(0, PathSet::FrontDiffuse, "shadows").ok()) << "twice";
  const Status incomplete = cover.complete();
  EXPECT_FALSE(incomplete.ok());
  EXPECT_NE(incomplete.message().find("direct behind"), std::string::npos) << incomplete.message();
  ASSERT_TRUE(cover.bring(0, PathSet::Behind, "shadows").ok());
  EXPECT_TRUE(cover.complete().ok());
}

TEST(Cover, ClassesAndLobesPartitionAllPaths) {
  EXPECT_EQ(PathSet::Emission | PathSet::Diffuse | PathSet::Specular, PathSet::All);
  EXPECT_FALSE(overlaps(PathSet::Diffuse, PathSet::Specular));
  const PathSet classes[] = {PathSet::Emission, PathSet::Front, PathSet::Behind, PathSet::Indirect, PathSet::Caustic};
  PathSet all = PathSet::None;
  for (const PathSet c : classes) {
    EXPECT_FALSE(overlaps(all, c)) << names(c);
    all = all | c;
  }
  EXPECT_EQ(all, PathSet::All);
  EXPECT_EQ(pathSet(PathClass::All) | PathSet::Caustic, PathSet::All);
  EXPECT_TRUE(cuts(PathSet::Diffuse, PathSet::Direct));
  EXPECT_FALSE(cuts(PathSet::Direct, PathSet::FrontDiffuse));
  EXPECT_FALSE(cuts(PathSet::Direct, PathSet::Indirect));
}

}  // namespace
}  // namespace gobo
