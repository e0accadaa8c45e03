// SPDX-License-Identifier: Apache-2.0
// What the executor teaches KnownTimes of the nodes that it runs. Nodes sleep: a sleep may be longer than it was asked to be, never shorter, so that ratios
// have lower bounds here; an upper one only where what may not count is a multiple of it.
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <memory>
#include <thread>

#include "plan/executor.h"

namespace gobo::executor_times_test {
namespace {

using From = KnownTimes::From;

void sleepFor(double ms) { std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(ms)); }

struct Says {
  std::string name;
  double expectedMs = 10;  ///< of one block, of one core
  bool extendable = false;
  std::function<Status(const RunContext&)> does = [](const RunContext&) { return Status(); };
};

TermShape shapeOf(const Says& s) { return {s.name, Domain::List, {1, 1, 1}, {plane<float>("v")}}; }

class Sleeper final : public Node {
 public:
  explicit Sleeper(Says says) : says_(std::move(says)) {}
  std::string type() const override { return says_.name; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.extendable = says_.extendable;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(says_.name); }
  Result<TermShape> infer(std::span<const TermShape> in) const override { return Wiring(type(), in, 0, 0).gives(shapeOf(says_)); }
  Cost cost(const TermShape&, uint32_t blocks) const override { return {0.0, 1e6 * says_.expectedMs * (says_.extendable ? blocks : 1)}; }
  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_TRY(says_.does(ctx));
    ctx.result->writable<float>("v")[0] = float(ctx.targetBlocks);
    return TermPtr(ctx.result);
  }

 private:
  Says says_;
};

class FoldOver final : public FoldNode {
 public:
  FoldOver(double expectedMs, double stepMs) : expectedMs_(expectedMs), stepMs_(stepMs) {}
  std::string type() const override { return "fold"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher&) const override {}
  Result<TermShape> infer(std::span<const TermShape> in) const override { return Wiring(type(), in, 0, SIZE_MAX).gives(shapeOf({type()})); }
  Cost cost(const TermShape&, uint32_t) const override { return {0.0, 1e6 * expectedMs_}; }
  int fixedInputs() const override { return 0; }
  int stride() const override { return 1; }
  std::unique_ptr<State> begin(const RunContext&, const std::vector<TermPtr>&) const override { return std::make_unique<State>(); }
  Status step(const RunContext&, State&, int, const std::vector<TermPtr>&) const override {
    sleepFor(stepMs_);
    return {};
  }
  Result<TermPtr> finish(const RunContext& ctx, std::unique_ptr<State>) const override {
    ctx.result->writable<float>("v")[0] = 0.0f;
    return TermPtr(ctx.result);
  }

 private:
  double expectedMs_, stepMs_;
};

struct Bench {
  explicit Bench(int threads = 1) : arena(threads) {}
  TaskArena arena;
  TermStore store{1 << 20};
  ExtensionIndex extensions;
  std::unique_ptr<KnownTimes> times = std::make_unique<KnownTimes>();
  Result<TermPtr> evaluate(const Graph& graph, NodeId id) {
    ExecutorServices services{&store, &extensions, nullptr, &arena};
    services.times = times.get();
    services.scene = "hall";
    return Executor(graph, services, {}).evaluate(id);
  }
  Result<TermPtr> run(const Says& says, uint32_t blocks = 0) {
    Graph graph;
    return evaluate(graph, graph.add({std::make_shared<Sleeper>(says), {}, {}, labelOf(says.name), blocks, nullptr, false}));
  }
  static std::string labelOf(const std::string& type) { return type + ":here"; }
  KnownTimes::Ratio of(const std::string& type) const { return times->of({"hall", labelOf(type), type}); }
};

Says sleeps(double ms) {
  return {"sleeper", 10, false, [ms](const RunContext&) {
            sleepFor(ms);
            return Status();
          }};
}

TEST(ExecutorTimes, ANodeThatRanAloneIsKnown) {
  Bench b;
  ASSERT_TRUE(b.run(sleeps(30)).ok());
  EXPECT_EQ(b.of("sleeper").from, From::Node);
  EXPECT_GE(b.of("sleeper").value, 3.0);
}

TEST(ExecutorTimes, ThreadsShareTheTimeThatIsExpected) {
  Bench b(2);
  ASSERT_TRUE(b.run(sleeps(30)).ok());
  EXPECT_GE(b.of("sleeper").value, 6.0) << "10 ms of one core are 5 of two";
}

TEST(ExecutorTimes, ANodeBesideOthersTeachesNothing) {
  Bench b;
  Says says = sleeps(20);
  says.does = [&](const RunContext&) {
    const KnownTimes::Run other(*b.times);
    sleepFor(20);
    return Status();
  };
  ASSERT_TRUE(b.run(says).ok());
  EXPECT_EQ(b.of("sleeper").from, From::Nothing);
  b.store.clear(false);
  ASSERT_TRUE(b.run(sleeps(20)).ok());
  EXPECT_EQ(b.of("sleeper").from, From::Node) << "alone again";
}

TEST(ExecutorTimes, ANodeThatFailsTeachesNothing) {
  Bench b;
  Says says = sleeps(0);
  says.does = [](const RunContext&) {
    sleepFor(20);
    return Status(Code::Cancelled, "stopped");
  };
  EXPECT_FALSE(b.run(says).ok());
  EXPECT_EQ(b.of("sleeper").from, From::Nothing);
}

TEST(ExecutorTimes, TheAccelerationStructureIsNotTheNodes) {
  Bench b;
  Says says = sleeps(0);
  says.expectedMs = 1000;
  says.does = [](const RunContext& ctx) {
    sleepFor(300);
    ctx.counters->accelNs += 300'000'000;
    return Status();
  };
  ASSERT_TRUE(b.run(says).ok());
  EXPECT_EQ(b.of("sleeper").from, From::Node);
  EXPECT_LT(b.of("sleeper").value, 0.3);
}

TEST(ExecutorTimes, AFoldIsWithoutTheNodesThatItRuns) {
  Bench b;
  Graph graph;
  std::vector<NodeId> inputs;
  for (const char* name : {"first", "second"}) {
    Says says = sleeps(150);
    says.name = name;
    inputs.push_back(graph.add({std::make_shared<Sleeper>(says), {}, {}, Bench::labelOf(name), 0, nullptr, true}));
  }
  const NodeId fold = graph.add({std::make_shared<FoldOver>(100.0, 10.0), inputs, {}, Bench::labelOf("fold"), 0, nullptr, false});
  ASSERT_TRUE(b.evaluate(graph, fold).ok());
  for (const char* name : {"first", "second"}) {
    EXPECT_EQ(b.of(name).from, From::Node) << name << ": what a fold runs is not beside others";
    EXPECT_GE(b.of(name).value, 15.0) << name;
  }
  EXPECT_EQ(b.of("fold").from, From::Node);
  EXPECT_GE(b.of("fold").value, 0.2) << "two steps of 10 ms";
  EXPECT_LT(b.of("fold").value, 3.0) << "and not the 300 ms between them";
}

TEST(ExecutorTimes, WhatIsExtendedIsExpectedWithoutWhatWasThere) {
  Bench b;
  Says says = sleeps(0);
  says.extendable = true;
  ASSERT_TRUE(b.run(says, 1).ok());
  says.does = [](const RunContext& ctx) {
    EXPECT_TRUE(ctx.previous);
    sleepFor(60);
    return Status();
  };
  b.times = std::make_unique<KnownTimes>();
  ASSERT_TRUE(b.run(says, 4).ok());
  EXPECT_GE(b.of("sleeper").value, 2.0) << "60 ms where three blocks of 10 were left";
}

}  // namespace
}  // namespace gobo::executor_times_test
