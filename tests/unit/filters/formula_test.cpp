// SPDX-License-Identifier: Apache-2.0
// Formulas of requests: their language, what they read, and what is refused.
#include <gtest/gtest.h>

#include <cmath>

#include "filters/formula/formula.h"

namespace gobo {
namespace formula_test {

constexpr std::string_view kNames[] = {"time", "distance", "x"};

double valueOf(const std::string& text, double time = 0, double distance = 0, double x = 0) {
  const Result<Formula> f = Formula::parse(text, kNames, "here");
  EXPECT_TRUE(f.ok()) << f.status().toString();
  if (!f.ok()) return NAN;
  Formula::Evaluator e(*f);
  e.name(0) = time, e.name(1) = distance, e.name(2) = x;
  return e();
}

TEST(Formula, SaysWhatItSays) {
  EXPECT_EQ(valueOf("12 - 4*distance^2", 0, 0.5), 11.0);
  EXPECT_EQ(valueOf("2 + 3 * 4 - 6 / 3"), 12.0);
  EXPECT_EQ(valueOf("2^3^2"), 512.0) << "powers from the right";
  EXPECT_EQ(valueOf("-2^2"), -4.0);
  EXPECT_EQ(valueOf("time > 1 ? 3 : 4", 2), 3.0);
  EXPECT_EQ(valueOf("time >= 1 && x != 2 || distance < 0", 1, 1, 3), 1.0);
  EXPECT_EQ(valueOf("time == 1", 1), 1.0);
  EXPECT_EQ(valueOf("clamp(x, 0, 1)", 0, 0, 7), 1.0);
  EXPECT_EQ(valueOf("mix(2, 4, 0.25)"), 2.5);
  EXPECT_EQ(valueOf("smoothstep(0, 2, x)", 0, 0, 1), 0.5);
  EXPECT_EQ(valueOf("smoothstep(1, 1, x)", 0, 0, 1), 1.0) << "a step";
  EXPECT_EQ(valueOf("max(1, x, time)", 5, 0, 3), 5.0);
  EXPECT_NEAR(valueOf("sin(pi / 6) + cos(0) + exp(ln(2)) + log10(100) + log2(8)"), 0.5 + 1 + 2 + 2 + 3, 1e-12);
  EXPECT_NEAR(valueOf("atan2(1, 1)"), std::atan(1.0), 1e-15);
  EXPECT_EQ(valueOf("1e-3*x", 0, 0, 1000), 1.0);
  EXPECT_TRUE(std::isinf(valueOf("1 / x"))) << "for the caller to refuse";
  EXPECT_TRUE(std::isnan(valueOf("sqrt(x)", 0, 0, -1)));
}

TEST(Formula, KnowsWhatItReads) {
  const auto f = Formula::parse("distance * 2 + object(\"big ball\") - object(\"floor\") * object(\"big ball\")", kNames, "here");
  ASSERT_TRUE(f.ok()) << f.status().toString();
  EXPECT_FALSE(f->reads(0));
  EXPECT_TRUE(f->reads(1));
  EXPECT_FALSE(f->reads(2));
  EXPECT_EQ(f->objects(), (std::vector<Formula::Object>{{"big ball", false}, {"floor", false}}));
  Formula::Evaluator e(*f);
  e.name(1) = 3, e.object(0) = 1, e.object(1) = 0;
  EXPECT_EQ(e(), 7.0);
  e.object(0) = 0, e.object(1) = 1;
  EXPECT_EQ(e(), 6.0);
}

TEST(Formula, TellsCastersFromObjects) {
  const auto f = Formula::parse("caster(\"a\") + 2 * object(\"a\") + 4 * caster(\"b\")", kNames, "here");
  ASSERT_TRUE(f.ok()) << f.status().toString();
  EXPECT_EQ(f->objects(), (std::vector<Formula::Object>{{"a", true}, {"a", false}, {"b", true}}));
  Formula::Evaluator e(*f);
  e.object(0) = 1, e.object(1) = 10, e.object(2) = 100;
  EXPECT_EQ(e(), 421.0);
}

TEST(Formula, EvaluatorsAreOfOneThreadEach) {
  const auto f = Formula::parse("x * 10", kNames, "here");
  ASSERT_TRUE(f.ok());
  Formula::Evaluator a(*f), b(*f);
  a.name(2) = 1, b.name(2) = 2;
  const Formula::Evaluator moved = std::move(a);
  EXPECT_EQ(moved(), 10.0);
  EXPECT_EQ(b(), 20.0);
}

TEST(Formula, WhatIsNoneIsRefusedWithItsPlace) {
  const auto refused = [](const std::string& text, const std::string& words) {
    const auto f = Formula::parse(text, kNames, "request.expressions.a.formula");
    ASSERT_FALSE(f.ok()) << text;
    EXPECT_EQ(f.status().code(), Code::InvalidArgument) << text;
    EXPECT_EQ(f.status().location(), "request.expressions.a.formula") << text;
    EXPECT_NE(f.status().message().find(words), std::string::npos) << text << ": " << f.status().toString();
  };
  refused("", "is empty");
  refused("distanc + 1", "did you mean 'distance'?");
  refused("y", "names: time, distance, x");
  refused("1 +", "");
  refused("(1", "parenthesis");
  refused("1 2", "position");
  refused("x = 3", "equality is ==");
  refused("x == 3 ? time = 1 : 2", "equality is ==");
  refused("1, 2", "list of 2 values");
  refused("sin(1, 2)", "");
  refused("x ; 2", "after 'x '");
  refused("\"x\"", "no formula");
  refused(std::string("x\0+1", 4), "no formula");
  refused("x + \xc3\xa9", "after 'x + '");
  refused("caster(floor)", "caster(\"NAME\")");
  refused("object(floor)", "object(\"NAME\")");
  refused("object(\"floor", "object(\"NAME\")");
  refused("object(\"floor\"", "object(\"NAME\")");
  refused("object_0_ + object(\"a\")", "");  // a name of ours: means what it says, or nothing
  refused(std::string(1001, '1'), "1001 characters: must be at most 1000");
  EXPECT_TRUE(Formula::parse(std::string(499, '(') + "x" + std::string(499, ')'), kNames, "here").ok()) << "depth is bounded by length alone";
}

}  // namespace formula_test
}  // namespace gobo
