// SPDX-License-Identifier: Apache-2.0
// Shapes of terms (terms/term_shape.h): what a graph infers, what the executor makes of it, and what it does with a result that is another.
#include <gtest/gtest.h>

#include "plan/disk_store.h"
#include "plan/executor.h"

namespace gobo {
namespace {

/// n values 1; `says` of them.
class Ones final : public Node {
 public:
  Ones(int n, int makes, bool atMost = false) : n_(n), makes_(makes), atMost_(atMost) {}
  std::string type() const override { return "ones"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(n_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 0, 1);
    if (!in.empty()) w.reads<float>(0, "v").over(0, {n_, 1, 1});
    TermShape out{type(), Domain::List, {n_, 1, 1}, {unsetPlane<float>("v")}};
    out.atMost = atMost_;
    return w.gives(std::move(out));
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    ++runs;
    std::shared_ptr<Term> out = ctx.result;
    if (!out || makes_ != n_) {
      out = std::make_shared<Term>(type(), Domain::List, Extent{makes_, 1, 1});
      out->addPlane<float>("v");
    }
    for (float& v : out->writable<float>("v")) v = 1.0f;
    return TermPtr(out);
  }
  mutable int runs = 0;

 private:
  int n_, makes_;
  bool atMost_;
};

struct Fixture {
  TaskArena arena{1};
  TermStore store{1 << 20};
  ExtensionIndex extensions;
  AccelCache* accels = nullptr;
  ExecutorServices services() { return {&store, &extensions, accels, &arena}; }
};

GraphNode node(std::shared_ptr<const Node> n, std::vector<NodeId> inputs = {}) { return {std::move(n), std::move(inputs), {}, "ones", 0, nullptr, false}; }

TEST(ExecutorShapes, AResultThatIsNotWhatItsNodeSaidIsAnError) {
  Fixture f;
  for (const bool atMost : {false, true})
    for (const int makes : {2, 3, 4}) {
      Graph graph;
      const NodeId id = graph.add(node(std::make_shared<Ones>(3, makes, atMost)));
      Fixture fresh;
      const auto made = Executor(graph, fresh.services(), {}).evaluate(id);
      const bool holds = atMost ? makes <= 3 : makes == 3;
      EXPECT_EQ(made.ok(), holds) << makes << " at most " << atMost;
      EXPECT_EQ(made.status().code(), holds ? Code::Ok : Code::Internal);
    }
}

TEST(ExecutorShapes, AKeptTermOfAnotherShapeIsMadeAgain) {
  Fixture f;
  Graph graph;
  const auto ones = std::make_shared<Ones>(3, 3);
  const NodeId id = graph.add(node(ones));
  const auto key = Executor(graph, f.services(), {}).identity(id);
  ASSERT_TRUE(key.ok());
  auto other = std::make_shared<Term>("ones", Domain::List, Extent{2, 1, 1});
  other->addPlane<float>("v");
  f.store.put(*key, other, false, {});
  const auto made = Executor(graph, f.services(), {}).evaluate(id);
  ASSERT_TRUE(made.ok()) << made.status().toString();
  EXPECT_EQ((*made)->extent().width, 3);
  EXPECT_EQ(ones->runs, 1);
  ASSERT_TRUE(Executor(graph, f.services(), {}).evaluate(id).ok());
  EXPECT_EQ(ones->runs, 1);
}

TEST(ExecutorShapes, AWronglyWiredGraphRunsNothingUntilTheNodeIsTakenBack) {
  Fixture f;
  Graph graph;
  const auto first = std::make_shared<Ones>(3, 3);
  const NodeId a = graph.add(node(first));
  EXPECT_TRUE(graph.wiring().ok());
  const Graph::Mark mark = graph.mark();
  graph.add(node(std::make_shared<Ones>(4, 4), {a}));
  EXPECT_EQ(graph.wiring().message(), "ones needs 4 x 1 x 1 of input 0 (ones), which is 3 x 1 x 1");
  EXPECT_EQ(graph.wiring().location(), "node ones");
  EXPECT_FALSE(Executor(graph, f.services(), {}).evaluate(a).ok());
  EXPECT_EQ(first->runs, 0);
  graph.rollBack(mark);
  EXPECT_TRUE(graph.wiring().ok());
  EXPECT_TRUE(Executor(graph, f.services(), {}).evaluate(a).ok());
}

TEST(ExecutorShapes, BytesAreOfWhatIsSaid) {
  TermShape shape{"t", Domain::Pixel, {5, 3, 2}, {plane<double>("a", 2), plane<uint8_t>("b"), {"c", Format::U32, 1, PlaneShape::Fill::Absent}}};
  EXPECT_EQ(shape.bytes(), 30u * (16 + 1 + 4));
  const auto term = makeTerm(shape);
  EXPECT_FALSE(term->hasPlane("c"));
  EXPECT_TRUE(shape.holds(*term).ok());
  EXPECT_LE(term->bytes(), shape.bytes() + kTermBytes);
  term->addPlane<uint32_t>("c");
  EXPECT_TRUE(shape.holds(*term).ok());
  EXPECT_LE(term->bytes(), shape.bytes() + kTermBytes);
  term->addPlane<float>("d");
  EXPECT_FALSE(shape.holds(*term).ok());
  for (int k = 0; k < 40; ++k) shape.planes.push_back(plane<float>("p" + std::to_string(k)));
  EXPECT_LE(makeTerm(shape)->bytes(), shape.bytes() + kTermBytes);
}

}  // namespace
}  // namespace gobo
