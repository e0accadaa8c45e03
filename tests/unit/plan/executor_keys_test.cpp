// SPDX-License-Identifier: Apache-2.0
// What a term is stored under: whatever makes another result makes another key, the version of the code that makes it included (a store
// on disk outlives a build).
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "plan/executor.h"

namespace gobo {
namespace {

struct Recipe {
  std::string type = "thing", numericClass = "cpu-f32-avx2";
  int version = 1, parameter = 0;
  uint32_t blocks = 0;  // above 0: an extendable node
};

class Thing final : public Node {
 public:
  explicit Thing(Recipe r) : r_(std::move(r)) {}
  std::string type() const override { return r_.type; }
  int version() const override { return r_.version; }
  std::string numericClass() const override { return r_.numericClass; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.extendable = r_.blocks > 0;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(r_.parameter); }
  Result<TermShape> infer(std::span<const TermShape> in) const override { return Wiring(type(), in, 0, 1).gives({"thing", Domain::Table, {1, 1, 1}, {}}); }
  Result<TermPtr> run(const RunContext&) const override { return Status(Code::Internal, "not asked for"); }

 private:
  Recipe r_;
};

/// Key of a node of recipe `r` behind one of recipe `input`.
std::string key(const Recipe& r, const Recipe& input = {}, std::string_view sources = {}) {
  Graph graph;
  const NodeId first = graph.add({std::make_shared<Thing>(input), {}, {}, "input", input.blocks, nullptr, false});
  const NodeId second = graph.add({std::make_shared<Thing>(r), {first}, {}, "thing", r.blocks, nullptr, false});
  ExecutorServices services;
  services.sources = sources;
  Executor executor(graph, services, {});
  const auto identity = executor.identity(second);
  EXPECT_TRUE(identity.ok()) << identity.status().toString();
  return identity.ok() ? identity->hex() : "";
}

TEST(ExecutorKeys, EachPartOfARecipeMakesAnotherKey) {
  std::map<std::string, std::string> seen;
  const auto add = [&](const std::string& what, const std::string& k) {
    const auto [other, fresh] = seen.emplace(k, what);
    EXPECT_TRUE(fresh) << what << " has the key of " << other->second;
  };
  Recipe r;
  r.parameter = 7;  // unlike its input
  add("the base", key(r));
  EXPECT_EQ(seen.begin()->first, key(r));
  Recipe other = r;
  other.type = "another";
  add("type", key(other));
  other = r;
  other.version = 2;
  add("version", key(other));
  other = r;
  other.numericClass = "vulkan-f32";
  add("numeric class", key(other));
  other = r;
  other.parameter = 8;
  add("parameter", key(other));
  other = r;
  other.blocks = 4;
  add("4 blocks", key(other));
  other.blocks = 5;
  add("5 blocks", key(other));
  Recipe input;
  input.version = 2;
  add("version of the input", key(r, input));
  input = {};
  input.blocks = 3;
  add("3 blocks of the input", key(r, input));
}

TEST(ExecutorKeys, BuildsForWorkOnTheCodeKeyByItsSources) {
  const Recipe r;
  EXPECT_EQ(key(r, {}, ""), key(r));
  EXPECT_NE(key(r, {}, "one"), key(r));
  EXPECT_NE(key(r, {}, "one"), key(r, {}, "other"));
#ifdef GOBO_SOURCE_DIGEST
  EXPECT_EQ(sourceDigest().size(), 64u);
#else
  EXPECT_TRUE(sourceDigest().empty()) << "a release keeps its stores from build to build";
#endif
}

}  // namespace
}  // namespace gobo
