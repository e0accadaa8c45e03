// SPDX-License-Identifier: Apache-2.0
// What nodes claim of themselves (terms/node.h), held against every node of every kind of plan, on the inputs that it has there: same bits for any
// number of threads; bytes within what it said; tiles with halo; affine where it says so; an extended result equal to one made at once. The list of
// kinds is read from the sources: one that no plan here holds fails.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>

#include "support/planned_nodes.h"
#include "support/thorough.h"

namespace gobo::testing {
namespace {

constexpr int kWidth = 37, kHeight = 29;  // no multiple of any block or tile

std::string nameOf(const std::string& request, const GraphNode& n) { return request + ", node " + n.label + " (" + n.node->type() + ")"; }

std::string kindOf(const Plan& plan, const GraphNode& n) {
  std::string kind = n.node->type();
  for (const NodeId i : n.inputs) kind += " " + plan.graph.at(i).node->type();
  return kind;
}

/// Each kind of node once for each set of claims, with the request that has it.
void forEachKind(const std::function<void(Planned&, NodeId, const std::string&)>& visit) {
  std::set<std::string> seen;
  for (const auto& [name, request] : requestsWithAllNodes(kWidth, kHeight)) {
    Planned p(request, 2);
    ASSERT_NE(p.plan, nullptr);
    for (NodeId id = 0; id < p.plan->graph.size(); ++id) {
      const GraphNode& n = p.plan->graph.at(id);
      if (seen.insert(kindOf(*p.plan, n)).second) visit(p, id, nameOf(name, n));
    }
  }
}

/// A copy with values changed by f(plane's name, element, channel, value); planes of other types than float and double as they are.
template <class F>
TermPtr changed(const Term& from, F&& f) {
  auto to = std::make_shared<Term>(from.type(), from.domain(), from.extent());
  for (const Plane& p : from.planes()) {
    Plane& copy = to->addRaw(p.name, p.format, p.channels);
    std::memcpy(copy.bytes.data(), p.bytes.data(), p.bytes.size());
    if (p.format == Format::F32) {
      const auto v = to->writable<float>(p.name);
      for (size_t i = 0; i < v.size(); ++i) v[i] = float(f(p, i, double(v[i])));
    } else if (p.format == Format::F64) {
      const auto v = to->writable<double>(p.name);
      for (size_t i = 0; i < v.size(); ++i) v[i] = f(p, i, v[i]);
    }
  }
  return to;
}

TEST(NodeClaims, EveryKindOfNodeIsHeldToItsClaims) {
  // "std::string type() const override { return "name"; }": one or two names on the line.
  std::map<std::string, std::string> kinds;
  for (const auto& entry : std::filesystem::recursive_directory_iterator("renderer")) {
    if (entry.path().extension() != ".cpp" && entry.path().extension() != ".h") continue;
    std::ifstream in(entry.path());
    for (std::string line; std::getline(in, line);) {
      if (line.find("std::string type() const override {") == std::string::npos) continue;
      static const std::regex quoted("\"([a-z0-9_]+)\"");
      for (std::sregex_iterator it(line.begin(), line.end(), quoted), end; it != end; ++it) kinds[(*it)[1]] = entry.path().string();
    }
  }
  ASSERT_GE(kinds.size(), 40u);
  std::set<std::string> held;
  forEachKind([&](Planned& p, NodeId id, const std::string&) { held.insert(p.plan->graph.at(id).node->type()); });
  for (const auto& [kind, file] : kinds) EXPECT_TRUE(held.count(kind)) << kind << " of " << file << " is in no plan of requestsWithAllNodes()";
  for (const std::string& kind : held) EXPECT_TRUE(kinds.count(kind)) << kind << " is not found in the sources";
}

TEST(NodeClaims, BitsDoNotDependOnThreadsAndBytesAreAsSaid) {
  std::set<std::string> kinds;
  size_t repeated = 0;
  for (const auto& [name, request] : requestsWithAllNodes(kWidth, kHeight)) {
    std::map<std::string, Hash128> contents;  // one arena after the other: the smallest that is alive bounds the threads of all
    std::set<NodeId> left;                    // kinds that were there before: a share of them
    for (const int threads : {5, 1}) {
      Planned p(request, threads);
      for (NodeId id = 0; id < p.plan->graph.size(); ++id) {
        const GraphNode& n = p.plan->graph.at(id);
        if (threads == 5 && !kinds.insert(kindOf(*p.plan, n)).second && !inSweep(repeated++, 4)) left.insert(id);
        if (left.count(id)) continue;
        SCOPED_TRACE(nameOf(name, n));
        const auto made = p.run(id);
        ASSERT_TRUE(made.ok()) << made.status().toString();
        const auto known = contents.emplace(std::to_string(id) + n.label, (*made)->content());
        EXPECT_EQ(known.first->second, (*made)->content());
        EXPECT_EQ(known.second, threads == 5) << "another plan";
        EXPECT_LE((*made)->bytes(), n.shape.bytes() + kTermBytes);
        if (n.node->traits().smallOutput) { EXPECT_LE((*made)->bytes(), 128u << 10); }
      }
    }
  }
}

TEST(NodeClaims, AnExtendedResultIsTheOneMadeAtOnce) {
  int held = 0;
  forEachKind([&](Planned& p, NodeId id, const std::string& name) {
    const GraphNode& n = p.plan->graph.at(id);
    if (!n.node->traits().extendable) return;
    SCOPED_TRACE(name);
    ++held;
    std::vector<TermPtr> inputs;
    for (const NodeId i : n.inputs) inputs.push_back(p.input(i));
    const auto first = p.runOn(id, inputs, {}, 1), extended = p.runOn(id, inputs, {}, 3, *first), atOnce = p.runOn(id, inputs, {}, 3);
    ASSERT_TRUE(extended.ok() && atOnce.ok());
    EXPECT_EQ((*extended)->content(), (*atOnce)->content());
    EXPECT_NE((*first)->content(), (*atOnce)->content());
  });
  EXPECT_GE(held, 2);
}

TEST(NodeClaims, AffineInTheFirstInputWhereItSaysSo) {
  int held = 0;
  forEachKind([&](Planned& p, NodeId id, const std::string& name) {
    const GraphNode& n = p.plan->graph.at(id);
    if (!n.node->traits().linearPerGroup) return;
    SCOPED_TRACE(name);
    ++held;
    std::vector<TermPtr> inputs;
    for (const NodeId i : n.inputs) inputs.push_back(p.input(i));
    const TermPtr x = inputs.at(0);
    // Another picture: x from its other end, weakened.
    const auto y = changed(*x, [&](const Plane& plane, size_t i, double) {
      const size_t other = x->extent().elements() * size_t(plane.channels) - 1 - i;
      return 0.75 * (plane.format == Format::F32 ? double(x->floats(plane.name)[other]) : x->plane<double>(plane.name)[other]);
    });
    const auto sum = changed(*x, [&](const Plane& plane, size_t i, double v) {
      return v + (plane.format == Format::F32 ? double(y->floats(plane.name)[i]) : y->plane<double>(plane.name)[i]);
    });
    const auto zero = changed(*x, [](const Plane&, size_t, double) { return 0.0; });
    std::vector<TermPtr> out;
    for (const TermPtr& first : {x, TermPtr(y), TermPtr(sum), TermPtr(zero)}) {
      inputs[0] = first;
      const auto made = p.runOn(id, inputs);
      ASSERT_TRUE(made.ok()) << made.status().toString();
      out.push_back(*made);
    }
    double differs = 0;
    for (const Plane& plane : out[0]->planes()) {
      if (plane.format != Format::F32) continue;
      const auto fx = out[0]->floats(plane.name), fy = out[1]->floats(plane.name), fsum = out[2]->floats(plane.name), f0 = out[3]->floats(plane.name);
      for (size_t i = 0; i < fx.size(); ++i) {
        const double scale = std::abs(fx[i]) + std::abs(fy[i]) + std::abs(f0[i]) + 1e-3;
        ASSERT_NEAR(double(fsum[i]) + f0[i], double(fx[i]) + fy[i], 1e-5 * scale) << plane.name << " " << i;
        differs = std::max(differs, std::abs(double(fx[i]) - f0[i]));
      }
    }
    EXPECT_GT(differs, 0.0) << "its first input does not matter";
  });
  EXPECT_GE(held, 4);
}

TEST(NodeClaims, TilesDependOnNothingBeyondTheirHalo) {
  int held = 0;
  forEachKind([&](Planned& p, NodeId id, const std::string& name) {
    const GraphNode& n = p.plan->graph.at(id);
    const NodeTraits traits = n.node->traits();
    if (!traits.tileable) return;
    SCOPED_TRACE(name);
    ++held;
    std::vector<TermPtr> inputs;
    for (const NodeId i : n.inputs) inputs.push_back(p.input(i));
    const auto whole = p.runOn(id, inputs);
    ASSERT_TRUE(whole.ok());
    const Extent e = (*whole)->extent();
    const int x0 = 14, x1 = 24, y0 = 11, y1 = 19, halo = traits.halo;
    const auto outside = [&](size_t element, const Extent& of) {
      const int x = int(element % size_t(of.width)), y = int(element / size_t(of.width) % size_t(of.height));
      return x < x0 - halo || x >= x1 + halo || y < y0 - halo || y >= y1 + halo;
    };
    bool any = false;
    for (TermPtr& input : inputs) {
      const Extent of = input->extent();
      if (of.width != e.width || of.height != e.height) continue;
      input = changed(*input, [&](const Plane& plane, size_t i, double v) {
        if (!outside(i / size_t(plane.channels), of)) return v;
        any = true;
        return std::isfinite(v) ? 0.5 * v + 0.125 : v;
      });
    }
    if (halo == 0 && !inputs.empty()) { EXPECT_TRUE(any) << "nothing was changed"; }
    const auto part = p.runOn(id, inputs);
    ASSERT_TRUE(part.ok()) << part.status().toString();
    for (const Plane& plane : (*whole)->planes()) {
      const Plane& other = (*part)->planes().at(size_t(&plane - (*whole)->planes().data()));
      ASSERT_EQ(other.name, plane.name);
      const size_t bytes = plane.bytes.size() / e.elements();
      for (size_t element = 0; element < e.elements(); ++element) {
        const int x = int(element % size_t(e.width)), y = int(element / size_t(e.width) % size_t(e.height));
        if (x < x0 || x >= x1 || y < y0 || y >= y1) continue;
        ASSERT_EQ(std::memcmp(plane.bytes.data() + element * bytes, other.bytes.data() + element * bytes, bytes), 0) << plane.name << " at " << x << "," << y;
      }
    }
  });
  EXPECT_GE(held, 8);
}

}  // namespace
}  // namespace gobo::testing
