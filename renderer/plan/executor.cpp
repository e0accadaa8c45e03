// SPDX-License-Identifier: Apache-2.0
#include "plan/executor.h"

#include <algorithm>
#include <chrono>
#include <new>

#include "plan/mapped_guard.h"
#include "terms/dropped_samples.h"
#include "trace/sample_passes.h"

namespace gobo {
inline namespace plan {

namespace {
/// A term goes to disk when making it, and those of its inputs that are not there, took four times as long as writing it (about 100 MB/s synced:
/// bench/store_bench), ms per byte. The last of a chain of such terms, which others read, goes there when the whole chain did.
constexpr double kWorthPersisting = 4.0 / 1e5;
}  // namespace

Executor::Executor(const Graph& graph, const ExecutorServices& services, StopToken stop, std::function<void(const std::string&, double)> progress)
    : graph_(graph), services_(services), stop_(stop), progress_(std::move(progress)) {}

void Executor::grow() {
  const NodeId before = NodeId(results_.size());
  if (before >= graph_.size()) return;
  results_.resize(graph_.size());
  recipes_.resize(graph_.size());
  reports_.resize(graph_.size());
  unsaved_.resize(graph_.size());
  chain_.resize(graph_.size());
  endsChain_.resize(graph_.size());
  for (NodeId id = before; id < graph_.size(); ++id) {
    const GraphNode& n = graph_.at(id);
    if (n.node->traits().persist) continue;
    for (const NodeId input : n.inputs) endsChain_[size_t(input)] = true;
  }
}

void Executor::asks(std::span<const NodeId> nodes) { lifetimes_.emplace(graph_).ask(nodes); }

void Executor::drop(NodeId id) {
  if (!results_[id]) return;
  heldBytes_ -= results_[id]->bytes();
  results_[id].reset();
}

const ExecutedNode& Executor::report(NodeId id) {
  grow();
  return reports_[id];
}

std::optional<Hash128> Executor::knownKey(NodeId id) {
  grow();
  const GraphNode& n = graph_.at(id);
  const auto inputs = recipes_[size_t(id)].isZero() ? std::span<const NodeId>(n.inputs) : std::span<const NodeId>();
  for (const NodeId input : inputs) {
    const std::optional<Hash128> key = knownKey(input);
    if (!key) return std::nullopt;
    if (graph_.at(input).node->traits().smallOutput && !results_[size_t(input)]) {
      if (services_.store->holds(*key) != TermStore::Tier::Memory) return std::nullopt;
      results_[size_t(input)] = services_.store->get(*key);
      if (!results_[size_t(input)]) return std::nullopt;
    }
  }
  const Result<Hash128> recipe = recipeKey(id);
  if (!recipe.ok()) return std::nullopt;
  return n.node->traits().extendable ? Hasher("blocks").add(*recipe).add(n.blocks).digest() : *recipe;
}

Result<Hash128> Executor::recipeKey(NodeId id) {
  grow();
  if (!recipes_[id].isZero()) return recipes_[id];
  const GraphNode& n = graph_.at(id);
  const NodeTraits traits = n.node->traits();
  Hasher h("recipe");
  h.add(n.node->type()).add(n.node->version()).add(n.node->numericClass());
  if (!services_.sources.empty()) h.add(services_.sources);
  n.node->hashParameters(h);
  if (traits.facets != Facet::None) h.add(n.scene->facetHash(traits.facets, n.lights));  // by content and order, not by index in the scene
  for (NodeId input : n.inputs) {
    GOBO_ASSIGN(const Hash128 digest, identity(input));
    h.add(digest);
  }
  grow();
  return recipes_[id] = h.digest();
}

Result<Hash128> Executor::identity(NodeId id) {
  grow();
  const GraphNode& n = graph_.at(id);
  const NodeTraits traits = n.node->traits();
  if (traits.smallOutput) {
    GOBO_ASSIGN(const TermPtr term, evaluate(id));
    return term->content();
  }
  GOBO_ASSIGN(const Hash128 recipe, recipeKey(id));
  if (!traits.extendable) return recipe;
  return Hasher("blocks").add(recipe).add(n.blocks).digest();
}

Result<TermPtr> Executor::evaluate(NodeId id) {
  grow();
  if (results_[id]) return results_[id];
  if (stop_.stopRequested()) return Status(Code::Cancelled, "stopped");
  const GraphNode& n = graph_.at(id);
  GOBO_ASSIGN(const Hash128 recipe, recipeKey(id));
  const Hash128 key = n.node->traits().extendable ? Hasher("blocks").add(recipe).add(n.blocks).digest() : recipe;
  reports_[id].key = key;
  const uint64_t before = services_.inFlight ? services_.inFlight->ended() : 0;
  TermPtr term = kept(id, key);
  bool made = false;
  if (!term && (n.transient || !services_.inFlight)) {
    GOBO_ASSIGN(term, run(id, recipe, key));
    made = true;
  } else if (!term) {
    GOBO_ASSIGN(WorkInFlight::Turn turn, services_.inFlight->take(recipe, n.node->traits().extendable ? n.blocks : 0, stop_));
    if (turn.result()) term = reused(id, turn.result(), "another request that ran at the same time");
    if (!term && services_.inFlight->ended() != before) term = kept(id, key);
    if (!term) {
      held_.push_back(&turn);
      Result<TermPtr> result = run(id, recipe, key);
      held_.pop_back();
      GOBO_ASSIGN(term, std::move(result));
      turn.finish(term);
      made = true;
    }
  }
  if (!n.transient || n.node->traits().smallOutput) {
    results_[id] = term;
    heldBytes_ += term->bytes();
    peakBytes_ = std::max(peakBytes_, heldBytes_);
  }
  if (lifetimes_) {
    lifetimes_->resolve(id);
    const auto gone = [this](NodeId other) { drop(other); };
    if (!made) lifetimes_->reused(id, gone);
    else if (!dynamic_cast<const FoldNode*>(n.node.get())) lifetimes_->made(id, gone);
  }
  return term;
}

// Who waits for what this is for waits for this.
bool Executor::wanted() const {
  return std::any_of(held_.begin(), held_.end(), [](const WorkInFlight::Turn* t) { return t->wanted(); });
}

TermPtr Executor::reused(NodeId id, TermPtr term, const char* from) {
  ExecutedNode& report = reports_[id];
  report.state = ExecutedNode::State::Reused;
  report.reason = from;
  report.bytes = term->bytes();
  report.dropped = droppedTotal(*term).samples;
  report.count = 1;
  return term;
}

TermPtr Executor::kept(NodeId id, const Hash128& key) {
  TermStore::Tier tier = TermStore::Tier::None;
  TermPtr term = services_.store->get(key, &tier, stop_);
  if (term && !graph_.at(id).shape.holds(*term).ok()) return nullptr;  // comes from a file
  if (!term) return nullptr;
  unsaved_[size_t(id)] = tier == TermStore::Tier::Memory && graph_.at(id).node->traits().persist ? services_.store->note(key).unsaved : 0.0;
  return reused(id, std::move(term), tier == TermStore::Tier::Disk ? "disk" : "memory");
}

RunContext Executor::context(NodeId id) {
  const GraphNode& n = graph_.at(id);
  RunContext ctx;
  ctx.arena = services_.arena;
  ctx.stop = stop_;
  if (n.node->traits().facets != Facet::None) ctx.accels = services_.accels;
  if (progress_) ctx.progress = [this, label = n.label](double fraction) { progress_(label, fraction); };
  return ctx;
}

Result<TermPtr> Executor::run(NodeId id, const Hash128& recipe, const Hash128& key) {
  GOBO_TRY(graph_.wiring());
  const GraphNode& n = graph_.at(id);
  const NodeTraits traits = n.node->traits();
  const auto* fold = dynamic_cast<const FoldNode*>(n.node.get());
  RunContext ctx = context(id);
  if (!fold) {
    for (NodeId input : n.inputs) {
      GOBO_ASSIGN(TermPtr term, evaluate(input));
      ctx.inputs.push_back(std::move(term));
    }
  }
  RunCounters counters;
  ctx.counters = &counters;
  std::optional<SceneView> view;
  if (traits.facets != Facet::None) ctx.scene = &view.emplace(*n.scene, traits.facets, n.lights);
  std::string reason;
  TermPtr parked, taken;  // taken: what was parked before
  uint32_t before = 0;    // blocks that the state it goes on from has; where it was stopped on the way nobody knows
  if (traits.extendable) {
    ctx.targetBlocks = n.blocks;
    ctx.park = &parked;
    ctx.wanted = [this] { return wanted(); };
    if (services_.checkpoints) ctx.previous = services_.checkpoints->load(recipe, n.blocks);
    if (ctx.previous && !n.shape.holds(*ctx.previous).ok()) ctx.previous = nullptr;  // comes from a file
    if (!ctx.previous) taken = ctx.previous = services_.extensions->takeParked(recipe, n.blocks);
    if (ctx.previous) reason = "resumed";
    if (!ctx.previous) {
      for (uint32_t blocks : services_.extensions->below(recipe, n.blocks)) {
        ctx.previous = services_.store->get(Hasher("blocks").add(recipe).add(blocks).digest(), nullptr, stop_);
        if (!ctx.previous) continue;
        before = blocks;
        reason = "extended from " + std::to_string(samplesOf(blocks)) + " samples";
        break;
      }
    }
  }

  const bool outermost = services_.times && !timed_;
  if (outermost) timed_.emplace(*services_.times);
  const double spentBefore = spentMs_;
  const auto start = std::chrono::steady_clock::now();
  Result<TermPtr> result = internalError("not run");
  try {
    result = fold ? runFold(id, *fold, ctx) : runNode(*n.node, n.shape, ctx);
  } catch (const std::bad_alloc&) { result = Status(Code::ResourceExhausted, "out of memory in node " + n.label, n.label); }
  const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  const double alone = ms - (spentMs_ - spentBefore);  // without the nodes that it ran
  spentMs_ += alone;
  if (services_.times && result.ok() && timed_->alone() && (before || !ctx.previous))
    services_.times->add({services_.scene, n.label, n.node->type()}, costBeyond(*n.node, n.shape, n.blocks, before).ns * 1e-6 / services_.arena->threads(),
                         alone - 1e-6 * double(counters.accelNs.load()));
  if (outermost) timed_.reset();
  if (result.ok()) {
    const Result<std::string> bad = firstNonFinite(**result, *services_.arena, stop_);
    if (!bad.ok()) {
      if (traits.extendable && ctx.leavesState()) parked = *result;  // made, but not read to its end: whoever goes on reads it
      result = bad.status();
    } else if (!bad->empty()) {
      result = internalError("a non-finite value would leave the node: " + *bad, "node " + n.label);
    }
  }
  if (services_.guard) GOBO_TRY(services_.guard->check());
  if (!result.ok() && !parked && ctx.leavesState()) parked = taken;  // preempted before the node came to it
  if (parked && !result.ok()) {
    if (services_.checkpoints) services_.checkpoints->save(recipe, n.blocks, parked);
    if (!services_.checkpoints || (wanted())) services_.extensions->park(recipe, n.blocks, parked);
  }
  if (!result.ok()) return result.status().at("node " + n.label);
  const TermPtr term = *result;

  ExecutedNode& report = reports_[id];
  report.state = ExecutedNode::State::Run;
  report.ms += ms;
  report.rays += counters.rays.load();
  report.bytes = term->bytes();
  report.dropped += droppedTotal(*term).samples;
  report.reason = reason;
  report.count += 1;
  if (!n.transient) {
    double unsaved = 0, chain = 0;
    if (traits.persist) {
      unsaved = chain = ms;
      bool made = false;
      for (const NodeId input : n.inputs) {
        unsaved += unsaved_[size_t(input)];
        chain += chain_[size_t(input)];
        made = made || chain_[size_t(input)] > 0;
      }
      chain_[size_t(id)] = chain;
      if (!made || !endsChain_[size_t(id)]) chain = unsaved;
    }
    const bool worth = traits.persist && !stop_.stopRequested() && chain > kWorthPersisting * double(term->bytes());
    const bool saved = services_.store->put(key, term, worth, stop_, {n.label, services_.scene, ms, unsaved});
    unsaved_[size_t(id)] = saved ? 0.0 : unsaved;
    if (traits.extendable) services_.extensions->add(recipe, n.blocks);
    if (traits.extendable && services_.checkpoints) services_.checkpoints->save(recipe, n.blocks, term);
  }
  return term;
}

Result<TermPtr> Executor::runFold(NodeId id, const FoldNode& fold, RunContext& ctx) {
  const GraphNode& n = graph_.at(id);
  const auto read = [&](int input) {
    if (lifetimes_) lifetimes_->read(id, n.inputs[size_t(input)], [this](NodeId other) { drop(other); });
  };
  std::vector<TermPtr> fixed;
  for (int i = 0; i < fold.fixedInputs(); ++i) {
    GOBO_ASSIGN(TermPtr term, evaluate(n.inputs[i]));
    fixed.push_back(std::move(term));
  }
  std::unique_ptr<FoldNode::State> state = fold.begin(ctx, fixed);
  const int steps = (int(n.inputs.size()) - fold.fixedInputs()) / fold.stride();
  for (int s = 0; s < steps; ++s) {
    if (stop_.stopRequested()) return Status(Code::Cancelled, "stopped");
    std::vector<TermPtr> inputs;
    uint64_t stepBytes = 0;
    for (int k = 0; k < fold.stride(); ++k) {
      GOBO_ASSIGN(TermPtr term, evaluate(n.inputs[fold.fixedInputs() + s * fold.stride() + k]));
      if (!results_[n.inputs[fold.fixedInputs() + s * fold.stride() + k]]) stepBytes += term->bytes();  // held by nobody else
      inputs.push_back(std::move(term));
    }
    peakBytes_ = std::max(peakBytes_, heldBytes_ + stepBytes);
    GOBO_TRY(fold.step(ctx, *state, s, inputs));
    for (int k = 0; k < fold.stride(); ++k) read(fold.fixedInputs() + s * fold.stride() + k);
    if (ctx.progress) ctx.progress(double(s + 1) / steps);
  }
  ctx.result = makeTerm(n.shape);
  Result<TermPtr> result = fold.finish(ctx, std::move(state));
  if (result.ok()) GOBO_TRY(n.shape.holds(**result));
  for (int i = 0; i < fold.fixedInputs(); ++i) read(i);
  return result;
}

}  // namespace plan
}  // namespace gobo
