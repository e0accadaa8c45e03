// SPDX-License-Identifier: Apache-2.0
// KnownTimes: how many times longer nodes took than they expected (Node::cost, which knows neither this machine nor the scene), so that expected times become
// those of here. A node's ratio is the median of its last ones; of a node that has not run, that of its type in the same scene, of its type in others, of
// whatever ran (three types at least); each of these the median of what it is made of, so that neither a slow first run nor many runs of one node decide.
// Learned from renders that ran alone: what others took away is not the node's. Expected times decide what waits, what is told and which early snapshots come,
// never a bit of the picture. Bounded, thread-safe.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

#include "base/hash.h"
#include "base/latest_map.h"

namespace gobo {
inline namespace plan {

/// What runs, and where: a label is unique in its graph ("visibility:lamp"), a type is a kind of node ("visibility").
struct TimedNode {
  std::string scene, label, type;
};

class KnownTimes {
 public:
  enum class From { Nothing, Machine, Type, Scene, Node };
  static constexpr size_t kFroms = 5;
  struct Ratio {
    double value = 1;
    From from = From::Nothing;
  };
  /// `keep`: ratios of nodes, scenes' types and types, together.
  explicit KnownTimes(size_t keep = 4096) : known_(keep) {}

  /// It took `ms` where `expectedMs` were expected. Nothing is learned from what is too short to be told from its overhead.
  void add(const TimedNode& node, double expectedMs, double ms);
  Ratio of(const TimedNode& node) const;

  /// From here to its end a node runs, and whatever runs for it. Of an engine's renders; one thread each.
  class Run {
   public:
    explicit Run(KnownTimes& times);
    ~Run();
    Run(const Run&) = delete;
    Run& operator=(const Run&) = delete;
    /// No other was there since it began.
    bool alone() const;

   private:
    KnownTimes& times_;
    uint64_t begun_;
    bool first_;
  };

 private:
  /// Ratios by where they come from, the latest last.
  class Ratios {
   public:
    void add(uint64_t source, double ratio, size_t keep);
    size_t count() const { return latest_.size(); }
    double median() const;  // the lesser of two in the middle: what disturbs only adds
   private:
    std::vector<std::pair<uint64_t, double>> latest_;
  };

  mutable std::mutex mutex_;
  LatestMap<Hash128, Ratios> known_;
  uint64_t adds_ = 0, begun_ = 0;
  int running_ = 0;
};

/// Shares of an expected time by where its nodes' ratios come from, in words: "this scene 97 %, other scenes 3 %". Empty where nothing is known.
std::string timesFromText(const std::array<double, KnownTimes::kFroms>& ms);

}  // namespace plan
}  // namespace gobo
