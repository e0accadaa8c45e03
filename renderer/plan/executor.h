// SPDX-License-Identifier: Apache-2.0
// Executor: evaluates nodes of a graph on demand. The output is asked for; what the store has is not run, and neither is
// anything that only it needs. Keys:
//   recipe key  = H(type, version, numeric class, parameters, facet digests, input identities)
//   identity    = content digest for small outputs, H(recipe key, blocks) for extendable nodes, recipe key otherwise
// One executor serves one request on one thread; nodes use the arena.
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <vector>

#include "base/latest_map.h"
#include "base/status.h"
#include "base/stop.h"
#include "plan/checkpoints.h"
#include "plan/extension_index.h"
#include "plan/known_times.h"
#include "plan/lifetimes.h"
#include "plan/source_digest.h"
#include "plan/store.h"
#include "plan/work_in_flight.h"
#include "terms/graph.h"

namespace gobo {
inline namespace plan {

class MappedGuard;  // plan/mapped_guard.h

struct ExecutedNode {
  enum class State { NotNeeded, Run, Reused } state = State::NotNeeded;
  double ms = 0;
  uint64_t rays = 0, bytes = 0, dropped = 0;
  std::string reason;
  Hash128 key;
  uint32_t count = 0;  ///< evaluations (transient nodes of a fold may be folded into one row by the reporter)
};

struct ExecutorServices {
  TermStore* store = nullptr;
  ExtensionIndex* extensions = nullptr;
  AccelCache* accels = nullptr;
  const TaskArena* arena = nullptr;
  RenderCheckpoints* checkpoints = nullptr;  ///< may be null; takes the place of parking for this request
  WorkInFlight* inFlight = nullptr;          ///< null: nobody else makes terms at the same time
  const MappedGuard* guard = nullptr;        ///< asked before anything is kept; null: nothing is mapped
  KnownTimes* times = nullptr;               ///< null: nobody learns from it, and nodes are expected to take what they say
  std::string_view sources = sourceDigest();
  std::string scene;  ///< its id, for whoever lists what the store holds and for `times`
};

class Executor {
 public:
  Executor(const Graph& graph, const ExecutorServices& services, StopToken stop, std::function<void(const std::string&, double)> progress = {});
  /// All that will be asked of it: from now on results go when their last reader is made. Not called: they stay while it does.
  void asks(std::span<const NodeId> nodes);
  Result<TermPtr> evaluate(NodeId id);
  /// The key under which the node's result is stored. May evaluate small-output nodes above it.
  Result<Hash128> identity(NodeId id);
  /// The key under which the node's result is or will be stored, if it can be said without running a node: what it depends on by content is known.
  std::optional<Hash128> knownKey(NodeId id);
  const ExecutedNode& report(NodeId id);
  uint64_t peakBytes() const { return peakBytes_; }
  const ExecutorServices& services() const { return services_; }

 private:
  Result<Hash128> recipeKey(NodeId id);
  Result<TermPtr> run(NodeId id, const Hash128& recipe, const Hash128& key);
  Result<TermPtr> runFold(NodeId id, const class FoldNode& fold, RunContext& ctx);
  bool wanted() const;
  TermPtr kept(NodeId id, const Hash128& key);
  TermPtr reused(NodeId id, TermPtr term, const char* from);
  RunContext context(NodeId id);
  void grow();
  void drop(NodeId id);

  const Graph& graph_;
  ExecutorServices services_;
  StopToken stop_;
  std::function<void(const std::string&, double)> progress_;
  std::vector<TermPtr> results_;
  std::optional<Lifetimes> lifetimes_;
  std::vector<Hash128> recipes_;
  std::vector<ExecutedNode> reports_;
  std::vector<bool> endsChain_;                  // somebody reads it who does not go to disk himself
  std::vector<double> chain_;                    // ms that this executor took for a term that may go to disk and for its inputs of the kind
  std::vector<double> unsaved_;                  // TermNote::unsaved of results
  std::vector<const WorkInFlight::Turn*> held_;  // what this executor makes now: a node, what needs it, and so on
  uint64_t heldBytes_ = 0, peakBytes_ = 0;
  std::optional<KnownTimes::Run> timed_;  // of the outermost node that runs: folds run others
  double spentMs_ = 0;                    // of all nodes that ran, each without those that it ran
};

/// First non-finite value of a term, as "plane V, element 12: nan"; empty if there is none. +inf is allowed in planes
/// called "depth" only. Errors: Cancelled.
Result<std::string> firstNonFinite(const Term& term, const TaskArena& arena, const StopToken& stop = {});

}  // namespace plan
}  // namespace gobo
