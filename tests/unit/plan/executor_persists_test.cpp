// SPDX-License-Identifier: Apache-2.0
// When results go to disk: what a loss would cost to make again, inputs that are not there included, against what writing it takes.
#include <gtest/gtest.h>

#include <thread>

#include "plan/disk_store.h"
#include "plan/executor.h"
#include "support/temp_folder.h"

namespace gobo::executor_persists_test {
namespace {

constexpr int kValues = 100000;           // 400 kB: dear from 16 ms on
constexpr double kMsPerByte = 4.0 / 1e5;  // the rule
constexpr std::chrono::milliseconds kSleeps{6};

/// Adds one to what it gets, slowly.
class Slow final : public Node {
 public:
  Slow(int step, bool persist) : step_(step), persist_(persist) {}
  std::string type() const override { return "slow"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.persist = persist_;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(step_).add(persist_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    return Wiring(type(), in, 0, 1).gives({type(), Domain::List, {kValues, 1, 1}, {plane<float>("v")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    std::this_thread::sleep_for(kSleeps);
    for (float& v : ctx.result->writable<float>("v")) v = ctx.inputs.empty() ? 0.0f : ctx.inputs[0]->floats("v")[0] + 1.0f;
    return TermPtr(ctx.result);
  }

 private:
  int step_;
  bool persist_;
};

struct Chain {
  Graph graph;
  std::vector<NodeId> links;
  NodeId reader = -1;
  explicit Chain(int length) {
    for (int i = 0; i < length; ++i) links.push_back(add(i, true, i == 0 ? -1 : links.back()));
    reader = add(length, false, links.back());
  }
  NodeId add(int step, bool persist, NodeId input) {
    return graph.add({std::make_shared<Slow>(step, persist), input < 0 ? std::vector<NodeId>{} : std::vector{input}, {}, "slow", 0, nullptr, false});
  }
};

struct Services {
  test::TempFolder folder;
  TaskArena arena{1};
  TermStore store{64 << 20, std::move(*DiskStore::open(folder.path, 64 << 20))};
  ExtensionIndex extensions;
  ExecutorServices get() { return {&store, &extensions, nullptr, &arena}; }
  bool onDisk(const Hash128& key) {
    for (const StoredTerm& row : store.list())
      if (row.key == key) return row.diskBytes > 0;
    return false;
  }
};

TEST(ExecutorPersists, ByWhatALossWouldCost) {
  Services s;
  Chain chain(8);
  Executor executor(chain.graph, s.get(), {});
  ASSERT_TRUE(executor.evaluate(chain.reader).ok());
  double lost = 0, all = 0;
  int saved = 0;
  for (size_t i = 0; i < chain.links.size(); ++i) {
    const ExecutedNode& report = executor.report(chain.links[i]);
    lost += report.ms;
    all += report.ms;
    const bool last = i + 1 == chain.links.size();
    const bool worth = (last ? all : lost) > kMsPerByte * double(report.bytes);
    EXPECT_EQ(s.onDisk(report.key), worth) << i << ": " << report.ms << " ms";
    if (worth) lost = 0, ++saved;
  }
  EXPECT_GE(saved, 3) << "none of them is dear enough alone";
  EXPECT_TRUE(s.onDisk(executor.report(chain.links.back()).key)) << "the end of the chain is what others ask for";
  EXPECT_FALSE(s.onDisk(executor.report(chain.reader).key));
}

TEST(ExecutorPersists, WhatIsInMemoryAloneCountsWhenAChainGoesOn) {
  Services s;
  Chain one(2);
  Executor first(one.graph, s.get(), {});
  ASSERT_TRUE(first.evaluate(one.links[0]).ok());  // 6 ms: not dear enough
  if (s.onDisk(first.report(one.links[0]).key)) GTEST_SKIP() << "the machine is busy";
  double lost = first.report(one.links[0]).ms;
  Chain more(5);
  Executor second(more.graph, s.get(), {});
  ASSERT_TRUE(second.evaluate(more.links[3]).ok());
  for (int i = 1; i < 4; ++i) {
    const ExecutedNode& report = second.report(more.links[size_t(i)]);
    lost += report.ms;
    const bool worth = lost > kMsPerByte * double(report.bytes);
    EXPECT_EQ(s.onDisk(report.key), worth) << i;
    if (worth) lost = 0;
  }
}

}  // namespace
}  // namespace gobo::executor_persists_test
