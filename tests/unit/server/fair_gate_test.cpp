// SPDX-License-Identifier: Apache-2.0
#include "server/fair_gate.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <thread>
#include <vector>

namespace gobo::fair_gate_test {
namespace {

const auto kNever = [] { return false; };

/// A caller that holds its place until it is told to leave.
struct Caller {
  Caller(FairGate& gate, const std::string& client)
      : thread([this, &gate, client] {
          const auto place = gate.enter(client, [this] { return gone.load(); });
          inside = place.has_value();
          while (place && !leave) std::this_thread::sleep_for(std::chrono::milliseconds(1));
          over = true;
        }) {}
  ~Caller() {
    leave = gone = true;
    thread.join();
  }
  std::atomic<bool> inside{false}, leave{false}, gone{false}, over{false};
  std::thread thread;
};

bool eventually(const std::function<bool()>& what) {
  for (int i = 0; i < 20000 && !what(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return what();
}

// As planning uses it: a crowd of one caller has the shared places only, and everybody else finds one at once.
TEST(FairGate, ACrowdOfOneClientLeavesPlacesForTheFirstOfOthers) {
  FairGate gate({6, 2});
  std::vector<std::unique_ptr<Caller>> crowd;
  for (uint32_t i = 0; i < 10; ++i) {
    crowd.push_back(std::make_unique<Caller>(gate, "crowd"));
    ASSERT_TRUE(eventually([&] { return gate.running() + gate.waiting() == i + 1; }));
  }
  EXPECT_EQ(gate.running(), 2u);
  std::vector<std::unique_ptr<Caller>> others;
  for (uint32_t i = 0; i < 4; ++i) {
    others.push_back(std::make_unique<Caller>(gate, "other " + std::to_string(i)));
    ASSERT_TRUE(eventually([&] { return gate.running() == 3 + i; })) << i;
  }
  Caller more(gate, "other 0"), last(gate, "other 4");
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 10; }));
  EXPECT_EQ(gate.running(), 6u);
  others[1]->leave = true;  // a place for one that has none, not for the crowd that came first
  EXPECT_TRUE(eventually([&] { return last.inside.load(); }));
  EXPECT_EQ(gate.running(), 6u);
  EXPECT_FALSE(more.inside);
  for (auto& c : crowd) c->leave = c->gone = true;
}

TEST(FairGate, WhoHasGoneWaitsNoLongerAndAFullQueueRefuses) {
  FairGate gate({1, 1});
  const auto held = gate.enter("a", kNever);
  ASSERT_TRUE(held);
  EXPECT_FALSE(gate.enter("b", [] { return true; }));
  EXPECT_EQ(gate.waiting(), 0u);
  FairGate::Queue seen;
  Caller waiting(gate, "b");
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  EXPECT_FALSE(gate.enter("b", kNever, [&](const FairGate::Queue& queue) {
    seen = queue;
    return queue.ofClient >= 1;
  }));
  EXPECT_EQ(seen.waiting, 1u);
  EXPECT_EQ(seen.ofClient, 1u);
  EXPECT_EQ(seen.running, 1u);
  EXPECT_EQ(gate.waiting(), 1u);
}

TEST(FairGate, WhoComesKnowsWhetherThereIsAPlaceForHim) {
  FairGate gate({2, 1});
  const auto free = [&](const std::string& client) {
    bool is = false;
    EXPECT_FALSE(gate.enter(client, kNever, [&](const FairGate::Queue& queue) {
      is = queue.free;
      return true;
    }));
    return is;
  };
  EXPECT_TRUE(free("a"));
  const auto first = gate.enter("a", kNever);
  EXPECT_FALSE(free("a")) << "the other place is for somebody who has none";
  EXPECT_TRUE(free("b"));
  const auto second = gate.enter("b", kNever);
  EXPECT_FALSE(free("c"));
}

TEST(FairGate, APlaceComesBackHoweverItIsMoved) {
  FairGate gate({1, 1});
  {
    auto first = gate.enter("a", kNever);
    const std::optional<FairGate::Place> second = std::move(first);
    EXPECT_EQ(gate.running(), 1u);
  }
  EXPECT_EQ(gate.running(), 0u);
  EXPECT_TRUE(gate.enter("b", kNever));
}

}  // namespace
}  // namespace gobo::fair_gate_test
