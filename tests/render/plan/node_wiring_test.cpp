// SPDX-License-Identifier: Apache-2.0
// What nodes ask of their inputs (Node::infer), held against every node of every kind of plan: wiring that infer accepts runs, and wiring that a node
// cannot read is an error before anything runs.
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <functional>
#include <set>

#include "filters/composite.h"
#include "support/planned_nodes.h"
#include "support/thorough.h"
#include "technique/plan_context.h"
#include "techniques/path_traced/technique.h"

namespace gobo::testing {
namespace {

std::vector<TermShape> shapesOf(const std::vector<TermPtr>& terms) {
  std::vector<TermShape> out;
  for (const TermPtr& t : terms) out.push_back(shapeOf(*t));
  return out;
}

/// A copy with each plane as change(plane) says; none: left out.
TermPtr rebuilt(const Term& from, const std::function<std::optional<PlaneShape>(const Plane&)>& change, const Extent& extent) {
  auto to = std::make_shared<Term>(from.type(), from.domain(), extent);
  for (const Plane& p : from.planes()) {
    const std::optional<PlaneShape> as = change(p);
    if (!as) continue;
    Plane& copy = to->addRaw(as->name, as->format, as->channels);
    if (copy.bytes.size() == p.bytes.size() && as->format == p.format) std::memcpy(copy.bytes.data(), p.bytes.data(), p.bytes.size());
  }
  return to;
}

struct Seen {
  int refused = 0, ran = 0;
};

/// Runs each kind of node on inputs of which one is changed, wherever infer takes them: it has to say how, and make what it said (all of them, or each
/// input's first and a share of the others).
Seen holdWiring(const std::function<std::vector<TermPtr>(const Term&)>& changes) {
  Seen seen;
  std::set<std::string> kinds;
  size_t taken = 0;
  for (const auto& [name, request] : requestsWithAllNodes(19, 13)) {
    Planned p(request, 2);
    if (!p.plan) continue;
    for (NodeId id = 0; id < p.plan->graph.size(); ++id) {
      const GraphNode& n = p.plan->graph.at(id);
      if (n.inputs.empty() || !kinds.insert(n.node->type() + std::to_string(n.inputs.size()) + p.plan->graph.at(n.inputs.back()).node->type()).second) continue;
      SCOPED_TRACE(name + ", node " + n.label + " (" + n.node->type() + ")");
      std::vector<TermPtr> inputs;
      for (const NodeId i : n.inputs) inputs.push_back(p.input(i));
      EXPECT_TRUE(n.node->infer(shapesOf(inputs)).ok());
      for (size_t i = 0; i < std::min<size_t>(inputs.size(), 4); ++i) {
        bool first = true;
        for (const TermPtr& other : changes(*inputs[i])) {
          std::vector<TermPtr> changed = inputs;
          changed[i] = other;
          const Result<TermShape> shape = n.node->infer(shapesOf(changed));
          if (!shape.ok()) {
            EXPECT_EQ(shape.status().code(), Code::Internal);
            EXPECT_NE(shape.status().message().find(n.node->type()), std::string::npos) << shape.status().message();
            ++seen.refused;
            continue;
          }
          // A node that takes another extent gives another, but for those that read a part or a list: beyond it a loop would read what is nobody's.
          const Extent &was = inputs[i]->extent(), &is = other->extent();
          const bool part = (n.node->type() == "object_id" || n.node->type() == "material_id") && is.width == was.width && is.height == was.height;
          if (!(is == was) && !part) { EXPECT_FALSE(shape->extent == n.shape.extent) << "input " << i; }
          if (!inSweep(taken++, 4) && !first) continue;
          first = false;
          const auto made = p.runOn(id, changed);
          EXPECT_EQ(made.status().message().find("is not the"), std::string::npos) << made.status().toString();
          ++seen.ran;
        }
      }
    }
  }
  return seen;
}

TEST(NodeWiring, APlaneThatIsNotThereIsRefusedOrNotRead) {
  const Seen seen = holdWiring([](const Term& t) {
    std::vector<TermPtr> all;
    for (const Plane& without : t.planes())
      all.push_back(rebuilt(
          t,
          [&](const Plane& p) {
            return p.name == without.name ? std::nullopt : std::optional(PlaneShape{p.name, p.format, p.channels});
          },
          t.extent()));
    return all;
  });
  EXPECT_GT(seen.refused, 40);
  EXPECT_GT(seen.ran, thoroughOr(20, 10));
}

TEST(NodeWiring, APlaneOfAnotherFormatOrNumberOfChannelsIsRefusedOrNotRead) {
  const Seen seen = holdWiring([](const Term& t) {
    std::vector<TermPtr> all;
    for (const Plane& other : t.planes()) {
      const auto as = [&](Format format, int channels) {
        return rebuilt(
            t,
            [&](const Plane& p) {
              return p.name == other.name ? PlaneShape{p.name, format, channels} : PlaneShape{p.name, p.format, p.channels};
            },
            t.extent());
      };
      all.push_back(as(other.format == Format::F32 ? Format::F64 : Format::F32, other.channels));
      all.push_back(as(other.format, other.channels + 1));
    }
    return all;
  });
  EXPECT_GT(seen.refused, 80);
  EXPECT_GT(seen.ran, thoroughOr(40, 15));
}

TEST(NodeWiring, AnotherExtentIsRefusedOrServed) {
  const Seen seen = holdWiring([](const Term& t) {
    std::vector<TermPtr> all;
    const Extent e = t.extent();
    for (const Extent& other : {Extent{e.width + 1, e.height, e.layers}, Extent{e.width, e.height + 1, e.layers}, Extent{e.width, e.height, e.layers + 1},
                                Extent{std::max(e.width - 1, 1), e.height, e.layers}})
      if (!(other == e))
        all.push_back(rebuilt(
            t,
            [](const Plane& p) {
              return PlaneShape{p.name, p.format, p.channels};
            },
            other));
    return all;
  });
  EXPECT_GT(seen.refused, 40);
}

TEST(NodeWiring, TheWrongNumberOfInputsIsRefused) {
  std::set<std::string> kinds;
  for (const auto& [name, request] : requestsWithAllNodes(19, 13)) {
    Planned p(request, 1);
    ASSERT_NE(p.plan, nullptr);
    for (NodeId id = 0; id < p.plan->graph.size(); ++id) {
      const GraphNode& n = p.plan->graph.at(id);
      if (!kinds.insert(n.node->type()).second || n.node->type() == "composite" || n.node->type() == "pixel_sample_count") continue;  // any number
      std::vector<TermShape> in;
      for (const NodeId i : n.inputs) in.push_back(p.plan->graph.at(i).shape);
      const TermShape none;
      for (int k = 0; k < 3; ++k) in.push_back(none);
      EXPECT_FALSE(n.node->infer(in).ok()) << n.node->type();
      EXPECT_FALSE(n.node->infer({}).ok() && !n.inputs.empty() && n.node->type() != "shadow_mu") << n.node->type();
    }
  }
}

/// A technique that adds a node which cannot read what it is given.
class WrongWiring final : public Technique {
 public:
  explicit WrongWiring(bool expands) : expands_(expands) {}
  const char* name() const override { return "wrong_wiring"; }
  Status claim(PlanContext&) const override { return {}; }
  Status plan(PlanContext& c) const override {
    const GBufferSettings& view = c.view();
    const NodeId wrong = c.filter(makeShadeNode(view.width, view.height, view.viewSamples), {c.gbuffer(), c.surface()}, "highlights:lamp");
    if (expands_) GOBO_TRY(c.expand(wrong).status());
    c.add({wrong, "rgb", Vec3(1.0f), PathSet::None, -1});
    return {};
  }

 private:
  bool expands_;
};

TEST(NodeWiring, AWrongTechniqueIsAnErrorOfThePlanAndRunsNothing) {
  const auto engine = makeEngine(64ull << 20, {}, 2);
  const auto request = engine->resolve(withLamp(16, 12, LightKind::Spot));
  ASSERT_TRUE(request.ok());
  for (const bool expands : {false, true})
    for (const bool bounding : {false, true}) {
      const WrongWiring wrong(expands);
      const std::array<const Technique*, 2> both{&pathTraced(), &wrong};
      PlannerServices services;
      services.techniques = both;
      int ran = 0;
      if (!bounding)
        services.expand = [&](const Graph&, NodeId) -> Result<TermPtr> {
          ++ran;
          return internalError("ran");
        };
      const auto plan = makePlan(*engine->scene("cornell"), *request, 1, services);
      ASSERT_FALSE(plan.ok());
      EXPECT_EQ(plan.status().code(), Code::Internal);
      EXPECT_EQ(plan.status().location(), "node highlights:lamp");
      EXPECT_EQ(plan.status().message(), "shade reads a plane L that input 0 (gbuffer) has not");
      EXPECT_EQ(ran, 0);
    }
}

}  // namespace
}  // namespace gobo::testing
