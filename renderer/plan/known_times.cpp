// SPDX-License-Identifier: Apache-2.0
#include "plan/known_times.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace gobo {
inline namespace plan {

namespace {

constexpr double kLeastExpectedMs = 1, kLeastMs = 10;  // what is below both is overhead of starting, page faults and caches, and says nothing of more of it
constexpr double kMostTimes = 1e3;                     // a ratio beyond is a node that did other work than it expected
constexpr size_t kOfNode = 5, kOfType = 9, kOfMachine = 33;  // ratios that a median is of, at most
constexpr size_t kLeastOfMachine = 3;                        // and at least: types differ by more than machines

Hash128 nodeKey(const TimedNode& n) { return Hasher("node").add(n.scene).add(n.label).digest(); }
Hash128 typeOfSceneKey(const TimedNode& n) { return Hasher("type of scene").add(n.scene).add(n.type).digest(); }
Hash128 typeKey(const TimedNode& n) { return Hasher("type").add(n.type).digest(); }
Hash128 machineKey() { return Hasher("machine").digest(); }

}  // namespace

void KnownTimes::Ratios::add(uint64_t source, double ratio, size_t keep) {
  std::erase_if(latest_, [&](const auto& r) { return r.first == source; });
  latest_.emplace_back(source, ratio);
  if (latest_.size() > keep) latest_.erase(latest_.begin());
}

double KnownTimes::Ratios::median() const {
  std::vector<double> sorted;
  for (const auto& [source, ratio] : latest_) sorted.push_back(ratio);
  const auto middle = sorted.begin() + ptrdiff_t(sorted.size() - 1) / 2;
  std::nth_element(sorted.begin(), middle, sorted.end());
  return *middle;
}

void KnownTimes::add(const TimedNode& node, double expectedMs, double ms) {
  if (!(expectedMs >= kLeastExpectedMs || ms >= kLeastMs) || !(expectedMs > 0) || !std::isfinite(expectedMs) || !std::isfinite(ms)) return;
  const double ratio = std::clamp(ms / expectedMs, 1 / kMostTimes, kMostTimes);
  const Hash128 ofNode = nodeKey(node), ofScene = typeOfSceneKey(node), ofType = typeKey(node);
  std::lock_guard lock(mutex_);
  const auto learn = [&](const Hash128& key, uint64_t source, double from, size_t keep) {
    Ratios& r = known_.touch(key);
    r.add(source, from, keep);
    return r.median();
  };
  double median = learn(ofNode, ++adds_, ratio, kOfNode);
  median = learn(ofScene, ofNode.lo, median, kOfType);
  median = learn(ofType, ofScene.lo, median, kOfType);
  learn(machineKey(), ofType.lo, median, kOfMachine);
}

KnownTimes::Ratio KnownTimes::of(const TimedNode& node) const {
  std::lock_guard lock(mutex_);
  if (const Ratios* r = known_.find(nodeKey(node))) return {r->median(), From::Node};
  if (const Ratios* r = known_.find(typeOfSceneKey(node))) return {r->median(), From::Scene};
  if (const Ratios* r = known_.find(typeKey(node))) return {r->median(), From::Type};
  if (const Ratios* r = known_.find(machineKey()); r && r->count() >= kLeastOfMachine) return {r->median(), From::Machine};
  return {};
}

KnownTimes::Run::Run(KnownTimes& times) : times_(times) {
  std::lock_guard lock(times_.mutex_);
  begun_ = ++times_.begun_;
  first_ = ++times_.running_ == 1;
}

KnownTimes::Run::~Run() {
  std::lock_guard lock(times_.mutex_);
  --times_.running_;
}

bool KnownTimes::Run::alone() const {
  std::lock_guard lock(times_.mutex_);
  return first_ && begun_ == times_.begun_;
}

std::string timesFromText(const std::array<double, KnownTimes::kFroms>& ms) {
  static constexpr std::array<const char*, KnownTimes::kFroms> kNames = {"the documented machine", "this machine", "other scenes", "like nodes of this scene",
                                                                         "this scene"};
  const double all = std::accumulate(ms.begin(), ms.end(), 0.0);
  if (!(all > ms[0])) return "";
  std::string text;
  for (size_t i = ms.size(); i-- > 0;) {
    const long percent = std::lround(100 * ms[i] / all);
    if (percent > 0) text += (text.empty() ? "" : ", ") + std::string(kNames[i]) + " " + std::to_string(percent) + " %";
  }
  return text;
}

}  // namespace plan
}  // namespace gobo
