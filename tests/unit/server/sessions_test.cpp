// SPDX-License-Identifier: Apache-2.0
// Of one session's requests the latest wins: who runs, who waits, who is replaced.
#include "server/sessions.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

namespace gobo {
namespace {

using Begin = Sessions::Turn::Begin;
const auto kStays = [] { return false; };

TEST(Sessions, WithoutANameNobodyWaits) {
  Sessions sessions;
  Sessions::Turn a(sessions, "me", ""), b(sessions, "me", "");
  EXPECT_EQ(a.begin(kStays), Begin::Now);
  EXPECT_EQ(b.begin(kStays), Begin::Now);
  a.shown();
  EXPECT_FALSE(a.over());
  EXPECT_EQ(sessions.size(), 0u);
}

TEST(Sessions, ANewerOneEndsWhatHasBeenSeen) {
  Sessions sessions;
  Sessions::Turn first(sessions, "me", "s");
  EXPECT_EQ(first.begin(kStays), Begin::Now);
  EXPECT_FALSE(first.over());
  Sessions::Turn second(sessions, "me", "s");
  EXPECT_FALSE(first.over()) << "it has shown nothing yet";
  first.shown();
  EXPECT_TRUE(first.over());
}

TEST(Sessions, TheWaitingOneIsReplacedAndTheLatestRuns) {
  Sessions sessions;
  auto first = std::make_unique<Sessions::Turn>(sessions, "me", "s");
  ASSERT_EQ(first->begin(kStays), Begin::Now);
  Sessions::Turn second(sessions, "me", "s");
  std::atomic<int> ended{0};
  Begin secondEnd{}, thirdEnd{};
  std::thread waiting([&] { secondEnd = second.begin(kStays), ++ended; });
  Sessions::Turn third(sessions, "me", "s");
  waiting.join();
  EXPECT_EQ(secondEnd, Begin::Replaced);
  std::thread latest([&] { thirdEnd = third.begin(kStays), ++ended; });
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  EXPECT_EQ(ended.load(), 1) << "the first one still runs";
  first.reset();
  latest.join();
  EXPECT_EQ(thirdEnd, Begin::Now);
}

TEST(Sessions, AReplacedOnesEndTakesNothingFromTheOthers) {
  Sessions sessions;
  auto first = std::make_unique<Sessions::Turn>(sessions, "me", "s");
  auto second = std::make_unique<Sessions::Turn>(sessions, "me", "s");
  Sessions::Turn third(sessions, "me", "s");
  EXPECT_EQ(second->begin(kStays), Begin::Replaced);
  second.reset();
  first->shown();
  EXPECT_TRUE(first->over()) << "the third one waits";
  first.reset();
  EXPECT_EQ(third.begin(kStays), Begin::Now);
}

TEST(Sessions, WhoHasGoneDoesNotWait) {
  Sessions sessions;
  Sessions::Turn first(sessions, "me", "s");
  {
    Sessions::Turn second(sessions, "me", "s");
    EXPECT_EQ(second.begin([] { return true; }), Begin::Gone);
  }
  first.shown();
  EXPECT_FALSE(first.over()) << "nobody waits any more";
}

TEST(Sessions, NamesBelongToTheirOwners) {
  Sessions sessions;
  Sessions::Turn mine(sessions, "a", "b:c"), other(sessions, "a:b", "c"), third(sessions, "b", "b:c");
  EXPECT_EQ(mine.begin(kStays), Begin::Now);
  EXPECT_EQ(other.begin(kStays), Begin::Now);
  EXPECT_EQ(third.begin(kStays), Begin::Now);
  EXPECT_EQ(sessions.size(), 3u);
}

TEST(Sessions, NothingStays) {
  Sessions sessions;
  for (int i = 0; i < 3; ++i) {
    Sessions::Turn a(sessions, "me", std::to_string(i)), b(sessions, "me", std::to_string(i));
    EXPECT_EQ(a.begin(kStays), Begin::Now);
  }
  EXPECT_EQ(sessions.size(), 0u);
}

}  // namespace
}  // namespace gobo
