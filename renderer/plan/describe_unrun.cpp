// SPDX-License-Identifier: Apache-2.0
#include "plan/describe_unrun.h"

#include <algorithm>
#include <array>
#include <map>

namespace gobo {
inline namespace plan {

namespace {

struct Rows {
  const Plan& plan;
  Executor& executor;
  const ExecutorServices& services;
  std::vector<TermStore::Tier> found;
  std::vector<int> makings;  // how often it would be made; -1: found

  Rows(const Plan& p, Executor& e)
      : plan(p), executor(e), services(e.services()), found(size_t(p.graph.size()), TermStore::Tier::None), makings(size_t(p.graph.size()), 0) {}
  void ask(NodeId id) {
    const GraphNode& n = plan.graph.at(id);
    int& made = makings[size_t(id)];
    const bool again = n.transient && made > 0;  // made for each reader
    if (made != 0 && !again) return;
    if (made == 0) {
      if (const auto key = executor.knownKey(id)) found[size_t(id)] = services.store->holds(*key);
      if (found[size_t(id)] != TermStore::Tier::None) {
        made = -1;
        return;
      }
    }
    ++made;
    for (const NodeId input : n.inputs) ask(input);
  }
  /// Of making the node once, of so many blocks: an extendable one goes on from the longest beginning of it that the plan has, too.
  Cost cost(NodeId id, uint32_t blocks) const {
    const GraphNode& n = plan.graph.at(id);
    uint32_t before = 0;
    for (NodeId k = 0; n.node->traits().extendable && k < plan.graph.size(); ++k) {
      const GraphNode& other = plan.graph.at(k);
      if (other.node == n.node && other.blocks < n.blocks && other.lights == n.lights) before = std::max(before, other.blocks);
    }
    return costBeyond(*n.node, n.shape, blocks, before);
  }
  KnownTimes::Ratio ratio(NodeId id) const {
    const GraphNode& n = plan.graph.at(id);
    return services.times ? services.times->of({services.scene, n.label, n.node->type()}) : KnownTimes::Ratio();
  }
  /// Of making the node once, on an idle machine.
  double ms(NodeId id) const { return ratio(id).value * cost(id, plan.graph.at(id).blocks).ns * 1e-6 / services.arena->threads(); }
};

}  // namespace

void addPrunedRows(const Graph& graph, google::protobuf::RepeatedPtrField<v1::NodeReport>& rows) {
  for (const PrunedNode& p : graph.pruned()) {
    v1::NodeReport* row = rows.Add();
    row->set_node(p.label);
    row->set_state(v1::NodeReport::PRUNED);
    row->set_reason(p.reason);
    row->set_approximate(p.approximate);
    row->set_count(1);
  }
}

double expectedMs(const Plan& plan, Executor& executor) {
  Rows rows(plan, executor);
  for (const NodeId id : plan.expanded) rows.ask(id);
  for (const PlannedOutput& o : plan.outputs) rows.ask(o.node);
  double ms = 0;
  for (NodeId id = 0; id < plan.graph.size(); ++id) {
    if (const int made = rows.makings[size_t(id)]; made > 0) ms += made * rows.ms(id);
  }
  return ms;
}

double aheadMs(const Plan& plan, Executor& executor) {
  Rows first(plan, executor), all(plan, executor);
  for (const NodeId id : plan.expanded) first.ask(id), all.ask(id);
  for (const PlannedOutput& o : plan.outputs) all.ask(o.node);
  double ms = 0;
  for (NodeId id = 0; id < plan.graph.size(); ++id) {
    const GraphNode& n = plan.graph.at(id);
    const NodeTraits traits = n.node->traits();
    const bool table = traits.persist && !traits.extendable;  // what takes samples is the picture itself
    const int made = first.makings[size_t(id)] > 0 ? first.makings[size_t(id)] : table ? all.makings[size_t(id)] : 0;
    if (made > 0) ms += made * all.ms(id);
  }
  return ms;
}

bool samplesDecideAll(const Plan& plan) {
  if (!plan.missing.empty() || !plan.expanded.empty()) return false;
  for (const PrunedNode& p : plan.graph.pruned())
    if (p.approximate) return false;
  for (NodeId id = 0; id < plan.graph.size(); ++id) {
    const GraphNode& n = plan.graph.at(id);
    if (!n.approximate.empty() || (!n.node->traits().extendable && n.node->cost(n.shape, n.blocks).rays > 0)) return false;
  }
  return true;
}

void describeUnrun(const Plan& plan, Executor& executor, v1::PlanReply& reply) {
  Rows rows(plan, executor);
  for (const NodeId id : plan.expanded) rows.ask(id);
  for (const PlannedOutput& o : plan.outputs) rows.ask(o.node);
  double ms = 0, rays = 0;
  std::array<double, KnownTimes::kFroms> from{};
  std::map<std::string, v1::NodeReport*> folded;  // transient nodes, one row a type and state, as replies have them
  for (NodeId id = 0; id < plan.graph.size(); ++id) {
    const GraphNode& n = plan.graph.at(id);
    const int made = rows.makings[size_t(id)];
    const auto state = made > 0 ? v1::NodeReport::RUN : made < 0 ? v1::NodeReport::REUSED : v1::NodeReport::NOT_NEEDED;
    const double rowMs = made > 0 ? made * rows.ms(id) : 0, rowRays = made > 0 ? made * rows.cost(id, n.blocks).rays : 0;
    ms += rowMs;
    rays += rowRays;
    from[size_t(rows.ratio(id).from)] += rowMs;
    v1::NodeReport* row = nullptr;
    if (n.transient) {
      v1::NodeReport*& slot = folded[n.node->type() + std::to_string(state)];
      if (!slot) slot = reply.add_plan();
      row = slot;
      row->set_node(n.node->type() + " (folded)");
      row->set_bytes(std::max<uint64_t>(row->bytes(), n.shape.bytes()));
    } else {
      row = reply.add_plan();
      row->set_node(n.label);
      row->set_bytes(n.shape.bytes());
      if (n.node->traits().extendable) row->set_samples(n.blocks);
    }
    row->set_state(state);
    row->set_device(n.node->device());
    row->set_count(row->count() + 1);
    if (made > 0) {
      row->set_ms(row->ms() + rowMs);
      row->set_rays(row->rays() + uint64_t(rowRays));
    }
    std::string reason = state == v1::NodeReport::NOT_NEEDED ? "what it feeds is there"
                         : made < 0                          ? (rows.found[size_t(id)] == TermStore::Tier::Disk ? "disk" : "memory")
                                                             : "";
    if (!n.approximate.empty()) {
      reason += (reason.empty() ? "" : "; ") + n.approximate;
      row->set_approximate(true);
    }
    row->set_reason(reason);
  }
  addPrunedRows(plan.graph, *reply.mutable_plan());
  reply.set_rays(uint64_t(rays));
  reply.set_ms(ms);
  reply.set_time_from(timesFromText(from));
  reply.set_pinned_bytes(plan.pinnedBytes);
  reply.set_decides_while_planning(!plan.expanded.empty());
  for (const std::string& w : plan.warnings) reply.add_warnings(w);
  for (const std::string& m : plan.missing) reply.add_path_classes_missing(m);
}

}  // namespace plan
}  // namespace gobo
