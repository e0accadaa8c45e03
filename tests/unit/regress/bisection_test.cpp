// SPDX-License-Identifier: Apache-2.0
// The search for the first bad commit: every length, every place, commits that cannot be tried; what a commit's run is taken for; children.
#include "regress/bisection.h"

#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include <gtest/gtest.h>

#include "regress/child.h"

namespace gobo::cli {
namespace {

struct Searched {
  std::vector<size_t> suspects;
  int tries = 0, skips = 0;
  bool promised = true;  ///< `left` never grew, and was kept
};

Searched searchFor(size_t firstBad, const std::vector<bool>& broken) {
  Bisection search(broken.size());
  Searched out;
  int left = search.left();
  while (const auto next = search.next()) {
    EXPECT_LT(*next, broken.size() - 1) << "the last is known";
    const bool skip = broken[*next];
    search.tell(*next, skip ? Verdict::Skip : *next >= firstBad ? Verdict::Bad : Verdict::Good);
    out.promised &= skip ? search.left() <= left : search.left() <= left - 1;
    left = search.left();
    ++out.tries;
    out.skips += skip;
  }
  EXPECT_EQ(left, 0);
  out.suspects = search.suspects();
  return out;
}

TEST(Bisection, FindsEveryPlaceOfEveryLengthWithinTheLogarithm) {
  for (size_t n = 1; n <= 70; ++n)
    for (size_t bad = 0; bad < n; ++bad) {
      const Searched s = searchFor(bad, std::vector<bool>(n, false));
      EXPECT_EQ(s.suspects, std::vector<size_t>{bad}) << n;
      EXPECT_LE(s.tries, int(std::ceil(std::log2(double(n))))) << n << ", " << bad;
      EXPECT_TRUE(s.promised) << n << ", " << bad;
    }
}

TEST(Bisection, CommitsThatCannotBeTriedCostOneTryEachAndLeaveSuspectsOnlyAroundTheAnswer) {
  std::mt19937 random(7);
  for (int round = 0; round < 3000; ++round) {
    const size_t n = 1 + random() % 40, bad = random() % n;
    std::vector<bool> broken(n);
    const unsigned share = random() % 4;
    for (size_t i = 0; i + 1 < n; ++i) broken[i] = random() % 4 < share;
    const Searched s = searchFor(bad, broken);
    EXPECT_LE(s.tries, int(std::ceil(std::log2(double(n)))) + s.skips);
    EXPECT_TRUE(s.promised);
    // Exactly what no one could tell better: back over broken commits from the answer, and forth to the first that could be tried.
    size_t first = bad, last = bad;
    while (first > 0 && broken[first - 1]) --first;
    while (broken[last]) ++last;
    if (!broken[bad]) last = bad;
    std::vector<size_t> expected;
    for (size_t i = first; i <= last; ++i) expected.push_back(i);
    EXPECT_EQ(s.suspects, expected) << n << ", " << bad;
  }
}

RunRecord recordOf(const std::vector<std::pair<std::string, CaseStatus>>& cases) {
  RunRecord run;
  for (const auto& [name, status] : cases) {
    CaseRecord c;
    c.name = name;
    c.status = status;
    c.message = "said\nof " + name;
    run.cases.push_back(c);
  }
  return run;
}

TEST(Judge, OneChangedCaseIsBadAndOnlyAllThatPassAreGood) {
  const auto verdict = [](const std::vector<std::pair<std::string, CaseStatus>>& cases) { return judge({}, recordOf(cases), {"a", "b"}).verdict; };
  EXPECT_EQ(verdict({{"a", CaseStatus::Same}, {"b", CaseStatus::Noise}}), Verdict::Good);
  EXPECT_EQ(verdict({{"a", CaseStatus::Same}, {"b", CaseStatus::Changed}}), Verdict::Bad);
  EXPECT_EQ(verdict({{"a", CaseStatus::Slower}, {"b", CaseStatus::Same}}), Verdict::Bad);
  EXPECT_EQ(verdict({{"a", CaseStatus::Failed}, {"b", CaseStatus::Changed}}), Verdict::Bad);
  EXPECT_EQ(verdict({{"a", CaseStatus::Same}, {"b", CaseStatus::Failed}}), Verdict::Skip);
  EXPECT_EQ(verdict({{"a", CaseStatus::Missing}, {"b", CaseStatus::Same}}), Verdict::Skip);
  EXPECT_EQ(verdict({{"a", CaseStatus::Same}}), Verdict::Skip);
  EXPECT_EQ(verdict({{"a", CaseStatus::Same}, {"b", CaseStatus::Same}, {"c", CaseStatus::Changed}}), Verdict::Good);  // nobody asked for c
  EXPECT_EQ(judge({}, recordOf({{"a", CaseStatus::Changed}}), {"a"}).why, "case \"a\" is changed: said\\x0aof a");
}

TEST(Judge, WhatASignalEndedOrWroteNothingIsSkippedWhateverItsRecordSays) {
  const RunRecord changed = recordOf({{"a", CaseStatus::Changed}}), same = recordOf({{"a", CaseStatus::Same}});
  for (const RunRecord& run : {changed, same}) {
    EXPECT_EQ(judge({0, SIGSEGV, false}, run, {"a"}).verdict, Verdict::Skip);
    EXPECT_EQ(judge({0, 0, true}, run, {"a"}).verdict, Verdict::Skip);
  }
  EXPECT_EQ(judge({0, SIGSEGV, false}, same, {"a"}).why, "its program was ended by signal 11");
  const Judged none = judge({2, 0, false}, invalidArgument("no record"), {"a"});
  EXPECT_EQ(none.verdict, Verdict::Skip);
  EXPECT_EQ(none.why, "its program left with exit code 2 without a record of the run");
  EXPECT_EQ(judge({1, 0, false}, same, {"a"}).verdict, Verdict::Good);  // another case's exit code
}

TEST(Judge, WordsOfVerdicts) {
  for (const Verdict v : {Verdict::Good, Verdict::Bad, Verdict::Skip}) EXPECT_EQ(verdictNamed(verdictName(v)), v);
  EXPECT_FALSE(verdictNamed("fair"));
}

class Child : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(::testing::TempDir()) / ("child-" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  Result<ChildEnd> shell(const std::string& text, ChildOptions options = {}) { return runChild({"/bin/sh", "-c", text}, log(), options); }
  std::string log() const { return (folder_ / "log").string(); }
  std::string said() const {
    std::ostringstream text;
    text << std::ifstream(log()).rdbuf();
    return text.str();
  }
  std::filesystem::path folder_;
};

TEST_F(Child, EndsAndBothOutputs) {
  auto end = shell("echo one; echo two >&2; exit 7");
  ASSERT_TRUE(end.ok());
  EXPECT_EQ(end->code, 7);
  EXPECT_FALSE(end->ok());
  EXPECT_EQ(end->text(), "left with exit code 7");
  EXPECT_EQ(said(), "one\ntwo\n");
  end = shell("kill -SEGV $$");
  ASSERT_TRUE(end.ok());
  EXPECT_EQ(end->signal, SIGSEGV);
  EXPECT_EQ(said(), "");
  EXPECT_EQ(runChild({"/nonesuch"}, log(), {}).status().code(), Code::NotFound);
  const auto out = outputOf({"/bin/sh", "-c", "echo out; echo err >&2"});
  ASSERT_TRUE(out.ok());
  EXPECT_EQ(*out, "out\n");
  EXPECT_EQ(outputOf({"/bin/sh", "-c", "echo out; echo err >&2; exit 1"}).status().message(), "err");
}

TEST_F(Child, StartsWhereItIsToldWithoutWhatWouldLeadItElsewhere) {
  ::setenv("GIT_DIR", "/nonesuch", 1), ::setenv("GOBO_SERVER", "unix:/nonesuch", 1), ::setenv("GOBO_KEPT", "yes", 1);
  ChildOptions options;
  options.folder = folder_.string();
  ASSERT_TRUE(shell("pwd; echo ${GIT_DIR-none} ${GOBO_SERVER-none} $GOBO_KEPT; cat", options).ok());
  ::unsetenv("GIT_DIR"), ::unsetenv("GOBO_SERVER"), ::unsetenv("GOBO_KEPT");
  EXPECT_EQ(said(), std::filesystem::canonical(folder_).string() + "\nnone none yes\n");
}

TEST_F(Child, WhatIsLateOrStoppedEndsWithAllThatItStarted) {
  const auto gone = [&] {  // the grandchild, which does not listen to SIGTERM
    pid_t pid = 0;
    std::ifstream(folder_ / "pid") >> pid;
    EXPECT_GT(pid, 0);
    for (int i = 0; i < 100 && ::kill(pid, 0) == 0; ++i) {
      std::ifstream stat("/proc/" + std::to_string(pid) + "/stat");
      std::string text((std::istreambuf_iterator<char>(stat)), {});
      if (text.find(") Z") != std::string::npos) return true;  // ended, and whoever inherits it has not asked
      ::usleep(20000);
    }
    return ::kill(pid, 0) != 0;
  };
  const std::string text = "sh -c 'trap \"\" TERM; echo $$ > pid; while :; do sleep 0.05; done' & while [ ! -s pid ]; do sleep 0.01; done; touch up; wait";
  ChildOptions options;
  options.folder = folder_.string();
  options.limitSeconds = 0.5;
  const auto late = shell(text, options);
  ASSERT_TRUE(late.ok());
  EXPECT_TRUE(late->late);
  EXPECT_EQ(late->text(), "took longer than allowed");
  EXPECT_TRUE(gone());
  std::filesystem::remove(folder_ / "pid"), std::filesystem::remove(folder_ / "up");
  options.limitSeconds = 0;
  options.stop = [&] { return std::filesystem::exists(folder_ / "up"); };
  EXPECT_EQ(shell(text, options).status().code(), Code::Cancelled);
  EXPECT_TRUE(gone());
}

}  // namespace
}  // namespace gobo::cli
