// SPDX-License-Identifier: Apache-2.0
// Results are held until their last reader is made, no longer, and admission's bound holds whatever the store has: random graphs of plain nodes,
// folds over transient ones, and small ones whose content is part of keys.
#include <gtest/gtest.h>

#include <iostream>
#include <map>
#include <random>

#include "plan/executor.h"
#include "plan/live_bytes.h"

namespace gobo {
namespace {

struct Counts {
  std::map<int, int> runs;  // by name of the node
};

TermPtr termOf(int name, int elements, const std::vector<TermPtr>& inputs, double extra = 0) {
  auto term = std::make_shared<Term>("sum", Domain::List, Extent{elements, 1, 1});
  double sum = name + extra;
  for (const TermPtr& input : inputs) sum = 0.5 * sum + double(input->floats("v")[0]);
  for (float& v : term->addPlane<float>("v")) v = float(sum);
  return term;
}

class Sum final : public Node {
 public:
  Sum(int name, int elements, bool small, Counts* counts) : name_(name), elements_(elements), small_(small), counts_(counts) {}
  std::string type() const override { return "sum"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.smallOutput = small_;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(name_).add(elements_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    return Wiring(type(), in, 0, SIZE_MAX).gives({"sum", Domain::List, {elements_, 1, 1}, {plane<float>("v")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    ++counts_->runs[name_];
    return termOf(name_, elements_, ctx.inputs);
  }

 private:
  int name_, elements_;
  bool small_;
  Counts* counts_;
};

class SumFold final : public FoldNode {
 public:
  SumFold(int name, int elements, int fixed, Counts* counts) : name_(name), elements_(elements), fixed_(fixed), counts_(counts) {}
  std::string type() const override { return "sum_fold"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(name_).add(elements_).add(fixed_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    return Wiring(type(), in, 0, SIZE_MAX).gives({"sum", Domain::List, {elements_, 1, 1}, {plane<float>("v")}});
  }
  int fixedInputs() const override { return fixed_; }
  int stride() const override { return 1; }
  struct Total : State {
    double sum = 0;
  };
  std::unique_ptr<State> begin(const RunContext&, const std::vector<TermPtr>& fixed) const override {
    ++counts_->runs[name_];
    auto state = std::make_unique<Total>();
    for (const TermPtr& t : fixed) state->sum += double(t->floats("v")[0]);
    return state;
  }
  Status step(const RunContext&, State& state, int, const std::vector<TermPtr>& inputs) const override {
    auto& total = static_cast<Total&>(state).sum;
    total = 0.5 * total + double(inputs[0]->floats("v")[0]);
    return {};
  }
  Result<TermPtr> finish(const RunContext&, std::unique_ptr<State> state) const override {
    return termOf(name_, elements_, {}, static_cast<Total&>(*state).sum);
  }

 private:
  int name_, elements_, fixed_;
  Counts* counts_;
};

struct RandomGraph {
  Graph graph;
  std::vector<NodeId> outputs;
};

RandomGraph randomGraph(uint32_t seed, Counts& counts) {
  std::mt19937 random(seed);
  const auto below = [&](int n) { return int(random() % uint32_t(n)); };
  RandomGraph out;
  const int nodes = 4 + below(24);
  for (int name = 0; name < nodes; ++name) {
    std::vector<NodeId> inputs;
    for (int k = below(4); k > 0 && out.graph.size() > 0; --k) inputs.push_back(below(out.graph.size()));
    const int elements = 1 + below(4000);
    GraphNode n;
    n.label = std::to_string(name);
    const int kind = below(6);
    if (kind == 0 && !inputs.empty()) {
      // Over transient nodes of its own, that read what others made.
      const int fixed = below(int(inputs.size()) + 1);
      std::vector<NodeId> all(inputs.begin(), inputs.begin() + fixed);
      for (int k = 0; k < 3; ++k) {
        GraphNode passing{std::make_shared<Sum>(1000 + 10 * name + k, elements, below(4) == 0, &counts), inputs, {}, "passing"};
        passing.transient = true;
        all.push_back(out.graph.add(std::move(passing)));
      }
      n.node = std::make_shared<SumFold>(name, elements, fixed, &counts);
      n.inputs = all;
    } else {
      n.node = std::make_shared<Sum>(name, kind == 1 ? 1 : elements, kind == 1, &counts);
      n.inputs = inputs;
    }
    out.graph.add(std::move(n));
  }
  for (int k = 1 + below(3); k > 0; --k) {
    NodeId id = below(out.graph.size());
    while (out.graph.at(id).transient) id = (id + 1) % out.graph.size();
    out.outputs.push_back(id);
  }
  return out;
}

struct Ran {
  std::vector<float> values;
  uint64_t peak = 0;
};

Ran execute(const RandomGraph& g, TermStore& store, bool asks) {
  ExtensionIndex extensions;
  const TaskArena arena(1);
  ExecutorServices services;
  services.store = &store;
  services.extensions = &extensions;
  services.arena = &arena;
  Executor executor(g.graph, services, {});
  if (asks) executor.asks(g.outputs);
  Ran ran;
  std::vector<TermPtr> held;
  for (const NodeId id : g.outputs) {
    const auto term = executor.evaluate(id);
    EXPECT_TRUE(term.ok()) << term.status().toString();
    held.push_back(*term);
    ran.values.push_back((*term)->floats("v")[0]);
  }
  ran.peak = executor.peakBytes();
  return ran;
}

TEST(Lifetimes, ResultsGoAfterTheirLastReader) {
  Counts counts;
  Graph graph;
  const auto node = [&](int name, std::vector<NodeId> inputs) {
    return graph.add({std::make_shared<Sum>(name, 1000, false, &counts), std::move(inputs), {}, std::to_string(name)});
  };
  NodeId last = node(0, {});
  for (int k = 1; k < 10; ++k) last = node(k, {last});
  RandomGraph chain{std::move(graph), {last}};
  const uint64_t one = termOf(0, 1000, {})->bytes(), said = 4000 + kTermBytes;
  TermStore nothing(0);
  EXPECT_EQ(execute(chain, nothing, true).peak, 2 * one);
  EXPECT_EQ(mostLiveBytes(chain.graph, chain.outputs), 2 * said);
  EXPECT_EQ(execute(chain, nothing, false).peak, 10 * one);
}

TEST(Lifetimes, BoundHoldsColdAndHalfWarm) {
  double used = 0;
  for (uint32_t seed = 0; seed < 400; ++seed) {
    SCOPED_TRACE(seed);
    Counts counts;
    const RandomGraph g = randomGraph(seed, counts);
    const uint64_t bound = mostLiveBytes(g.graph, g.outputs);
    TermStore plain(1 << 28), cold(1 << 28);
    const Ran reference = execute(g, plain, false);
    const std::map<int, int> once = std::exchange(counts.runs, {});
    const Ran ran = execute(g, cold, true);
    EXPECT_EQ(ran.values, reference.values);
    EXPECT_EQ(counts.runs, once) << "letting go makes nothing twice";
    EXPECT_LE(ran.peak, bound);
    EXPECT_LE(ran.peak, reference.peak);
    used += double(ran.peak) / double(bound) / 400;
    // A store that has what some other outputs left.
    std::mt19937 random(seed + 7);
    for (int round = 0; round < 4; ++round) {
      TermStore half(1 << 28);
      RandomGraph part{g.graph, {}};
      for (int k = 0; k < 2; ++k) {
        const NodeId id = NodeId(random() % uint32_t(g.graph.size()));
        if (!g.graph.at(id).transient) part.outputs.push_back(id);
      }
      execute(part, half, true);
      const Ran warm = execute(g, half, true);
      EXPECT_EQ(warm.values, reference.values);
      EXPECT_LE(warm.peak, bound);
    }
    // A store that keeps nothing: whatever went too early would be made again.
    counts.runs.clear();
    TermStore nothing(0);
    const Ran bare = execute(g, nothing, true);
    EXPECT_EQ(bare.values, reference.values);
    EXPECT_EQ(counts.runs, once);
    EXPECT_LE(bare.peak, bound);
  }
  std::cout << "held at most with an empty store, as a share of the bound: mean " << used << "\n";
  EXPECT_GE(used, 0.6) << "a bound of no use";
}

TEST(Lifetimes, WhatOnlyAReusedNodeReadsIsNotHeldForIt) {
  Counts counts;
  Graph graph;
  const auto node = [&](int name, std::vector<NodeId> inputs) {
    return graph.add({std::make_shared<Sum>(name, 1000, false, &counts), std::move(inputs), {}, std::to_string(name)});
  };
  const NodeId shared = node(0, {}), dear = node(1, {shared}), cheap = node(2, {shared}), sum = node(3, {cheap, dear}), last = node(4, {sum}),
               end = node(5, {last});
  TermStore store(1 << 20);
  ASSERT_FALSE(execute({graph, {dear}}, store, true).values.empty());
  const uint64_t one = termOf(0, 1000, {})->bytes();
  const Ran ran = execute({graph, {end}}, store, true);
  EXPECT_EQ(ran.peak, 3 * one) << "cheap, dear and their sum; what they were made of is gone by then";
}

TEST(Lifetimes, AReusedNodeTakesItsReadsBackAndNoOthers) {
  Counts counts;
  Graph graph;
  const auto add = [&](NodePtr node, std::vector<NodeId> inputs, bool transient = false) {
    GraphNode n{std::move(node), std::move(inputs), {}, "node"};
    n.transient = transient;
    return graph.add(std::move(n));
  };
  const auto sum = [&](int name) { return std::make_shared<Sum>(name, 1000, false, &counts); };
  const NodeId source = add(sum(0), {}), shared = add(sum(1), {source}), first = add(sum(2), {shared}), second = add(sum(3), {shared});
  const NodeId passing = add(sum(4), {shared}, true), fold = add(std::make_shared<SumFold>(5, 1000, 0, &counts), {passing});
  const std::vector<NodeId> outputs{first, second, fold};
  Lifetimes lifetimes(graph);
  lifetimes.ask(outputs);
  EXPECT_EQ(lifetimes.readers(shared), 3);
  std::vector<NodeId> gone;
  const auto note = [&](NodeId id) { gone.push_back(id); };
  lifetimes.resolve(fold);
  lifetimes.reused(fold, note);
  EXPECT_EQ(lifetimes.readers(shared), 2) << "what the fold would have been made of reads it no more";
  lifetimes.resolve(first);
  lifetimes.reused(first, note);
  EXPECT_EQ(lifetimes.readers(shared), 1);
  EXPECT_TRUE(gone.empty()) << "the second still reads it";
  EXPECT_EQ(lifetimes.readers(source), 1) << "it is still to be made";
  lifetimes.resolve(second);
  lifetimes.reused(second, note);
  EXPECT_EQ(lifetimes.readers(source), 0) << "nobody makes what it was for";
  EXPECT_EQ(gone, (std::vector<NodeId>{shared, source}));
}

}  // namespace
}  // namespace gobo
