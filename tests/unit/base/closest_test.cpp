// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "base/closest.h"

namespace gobo {
namespace {

TEST(Closest, Distances) {
  EXPECT_EQ(editDistance("", ""), 0u);
  EXPECT_EQ(editDistance("", "abc"), 3u);
  EXPECT_EQ(editDistance("render", "render"), 0u);
  EXPECT_EQ(editDistance("rendr", "render"), 1u);
  EXPECT_EQ(editDistance("redner", "render"), 1u) << "neighbours swapped";
  EXPECT_EQ(editDistance("Render", "rENDER"), 0u);
  EXPECT_EQ(editDistance("kitten", "sitting"), 3u);
  EXPECT_EQ(editDistance("sitting", "kitten"), 3u);
}

TEST(Closest, TheNearestOrNothing) {
  const std::vector<std::string> known{"render", "relight", "plan", "jobs"};
  EXPECT_EQ(closest("rendr", known), "render");
  EXPECT_EQ(closest("relite", known), "");  // three of seven letters
  EXPECT_EQ(closest("relght", known), "relight");
  EXPECT_EQ(closest("plna", known), "plan");
  EXPECT_EQ(closest("xyz", known), "");
  EXPECT_EQ(closest("", known), "");
  EXPECT_EQ(closest(std::string(100000, 'r'), known), "");
  EXPECT_EQ(closest("jbs", {"jabs", "jobs"}), "jabs") << "the first of equals";
  EXPECT_EQ(didYouMean("cornel", {"cornell"}), "; did you mean 'cornell'?");
  EXPECT_EQ(didYouMean("atrium2000", {"cornell"}), "");
}

TEST(Closest, SomeOfManyNames) {
  EXPECT_EQ(someOf({}), "none");
  EXPECT_EQ(someOf({"a", "b"}), "a, b");
  const std::string some = someOf(std::vector<std::string>(1000, "a name"));
  EXPECT_TRUE(some.starts_with("a name, a name"));
  EXPECT_TRUE(some.ends_with(", ..."));
  EXPECT_LT(some.size(), 330u);
  std::string wide;
  for (int i = 0; i < 1000; ++i) wide += "\xc3\xbc";
  EXPECT_EQ(someOf({"a" + wide, "b"}), "a" + wide.substr(0, 298) + "..., ...") << "characters stay whole";
}

}  // namespace
}  // namespace gobo
