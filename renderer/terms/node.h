// SPDX-License-Identifier: Apache-2.0
// Node: a recipe that makes a Term from scene facets and other terms.
//   Source  declares the facets and lights it reads; may trace rays.
//   Filter  declares no facet: it gets no scene at all, so it cannot trace or peek (passive, stateless, deterministic).
// A node object is immutable; run() is const and may be called from several threads at once.
// The recipe key hashes type, version, numeric class, parameters, facet digests and input identities (plan/executor.h).
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/hash.h"
#include "base/status.h"
#include "base/stop.h"
#include "base/task_arena.h"
#include "scene/scene.h"
#include "terms/term.h"
#include "terms/term_shape.h"

namespace gobo {
inline namespace trace {
class Accel;       // trace/accel.h
class AccelCache;  // acceleration structures shared by the nodes of an engine
}  // namespace trace
}  // namespace gobo

namespace gobo {
inline namespace terms {

/// What the node claims about itself. Every node of every kind is held to them (tests/render/plan/node_claims_test.cpp).
struct NodeTraits {
  Facet facets = Facet::None;    ///< None: a filter
  bool smallOutput = false;      ///< passed on by content digest (at most 128 KiB): equal results re-run nothing behind it
  bool extendable = false;       ///< result depends on a block count that is not in the recipe key
  bool linearPerGroup = false;   ///< affine in its first input: f(x + y) + f(0) = f(x) + f(y)
  bool rangePreserving = false;  ///< output within [min, max] of the first input
  bool tileable = false;         ///< an output pixel depends only on inputs within `halo` pixels
  int halo = 0;
  bool persist = false;  ///< dear enough to write to the disk tier
};

struct RunCounters {
  std::atomic<uint64_t> rays{0};     ///< every ray handed to Embree: primary, bounce, shadow
  std::atomic<uint64_t> accelNs{0};  ///< until the acceleration structure was there: building it, or waiting for who does
};

struct RunContext {
  const SceneView* scene = nullptr;  ///< null for filters
  std::vector<TermPtr> inputs;
  /// Made for this run after what Node::infer said, to be written and returned; null where the size comes with the result. Folds: when they finish.
  std::shared_ptr<Term> result;
  const TaskArena* arena = nullptr;
  AccelCache* accels = nullptr;  ///< null for filters
  StopToken stop;
  RunCounters* counters = nullptr;
  std::function<void(double fraction)> progress;  ///< may be empty; called from any thread

  /// The acceleration structure of `scene`, whose node declares kAccelFacets (CHECKed). Errors: Cancelled when `stop` fired first.
  Result<std::shared_ptr<const Accel>> accel() const;

  // Extendable nodes only. Result(n) = fixed-order sum of blocks 0..n-1, whatever it started from.
  uint32_t targetBlocks = 0;
  TermPtr previous;              ///< a state of the same recipe with fewer blocks, or a parked one; may be null
  TermPtr* park = nullptr;       ///< a stopped node may leave a partial state here
  std::function<bool()> wanted;  ///< may be empty: does another request wait for the same result?
  /// Whether a stopped node should leave its state: this request, or one that waits for the same, will go on with it.
  bool leavesState() const { return park && (stop.reason() == StopReason::Preempted || (wanted && wanted())); }
};

/// What a node is expected to take: rays handed to Embree, and time of one core of the machine of docs/benchmarks.md. Of scenes it knows nothing, so
/// both are of a picture that something fills.
struct Cost {
  double rays = 0, ns = 0;
};
inline constexpr double kReceiving = 0.7;  ///< share of view samples that look at a surface that a light may shine on

class Node {
 public:
  virtual ~Node() = default;
  virtual std::string type() const = 0;      ///< stable name, e.g. "axis_aligned_filter"
  virtual int version() const { return 1; }  ///< bump when the result changes for the same parameters
  virtual std::string numericClass() const { return "cpu-f32-avx2"; }
  virtual std::string device() const { return "cpu"; }
  virtual NodeTraits traits() const = 0;
  virtual void hashParameters(Hasher& hasher) const = 0;
  /// What the result looks like, from what the inputs do: wrong wiring is found here, while planning. Errors: Internal (Wiring).
  virtual Result<TermShape> infer(std::span<const TermShape> in) const = 0;
  /// Of extendable nodes whose result grows with its blocks: what infer() said, after so many.
  virtual TermShape afterBlocks(TermShape inferred, uint32_t blocks) const {
    (void)blocks;
    return inferred;
  }
  /// Bytes that a run holds beside its result and inputs, where they are many; an upper bound, for admission.
  virtual size_t workingBytes() const { return 0; }
  /// `blocks`: of extendable nodes. Here: a pass over its result.
  virtual Cost cost(const TermShape& result, uint32_t blocks) const {
    (void)blocks;
    return {0.0, 0.6 * double(result.bytes())};
  }
  /// ctx.result, written; by runNode(). Errors: Cancelled when ctx.stop fired; Internal when a non-finite value would leave the node.
  virtual Result<TermPtr> run(const RunContext& ctx) const = 0;
};
using NodePtr = std::shared_ptr<const Node>;

/// Of `blocks` where `before` of them are there already (extendable nodes only; 0 elsewhere).
Cost costBeyond(const Node& node, const TermShape& result, uint32_t blocks, uint32_t before);

/// Runs a node on ctx.inputs: makes ctx.result and holds what comes out to what infer() said. Not for folds.
Result<TermPtr> runNode(const Node& node, RunContext& ctx);
/// The same, of a shape that is known.
Result<TermPtr> runNode(const Node& node, const TermShape& shape, RunContext& ctx);

/// Folds: a node whose inputs are evaluated and dropped group by group, in order, in bounded memory (1000 lights never
/// means 1000 buffers). Inputs of step i are inputs [i*stride, (i+1)*stride) after the first `fixedInputs()`, which stay.
class FoldNode : public Node {
 public:
  virtual int fixedInputs() const = 0;
  virtual int stride() const = 0;
  class State {
   public:
    virtual ~State() = default;
  };
  virtual std::unique_ptr<State> begin(const RunContext& ctx, const std::vector<TermPtr>& fixed) const = 0;
  virtual Status step(const RunContext& ctx, State& state, int index, const std::vector<TermPtr>& inputs) const = 0;
  virtual Result<TermPtr> finish(const RunContext& ctx, std::unique_ptr<State> state) const = 0;
  Result<TermPtr> run(const RunContext&) const final { return internalError("a fold runs by steps"); }
};

}  // namespace terms
}  // namespace gobo
