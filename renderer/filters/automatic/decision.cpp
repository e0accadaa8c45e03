// SPDX-License-Identifier: Apache-2.0
#include "filters/automatic/decision.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr double kNearMiss = 1.25;     // what a probe cannot tell apart
constexpr double kCloser = 0.5;        // standard error of an estimate after another look, of what it was
constexpr double kUnseen = 1.0 / 12;   // of the pixel that a probe without any error did not see: a straight edge's mean square against the pixel's area
constexpr double kShareOfTime = 0.05;  // of a time budget, for another look
constexpr double kInsurance = 0.03;    // of a choice's time, for another look whatever the chance: how few pixels hold an error is not known either
constexpr double kBlind = 0.5;         // of the error allowed, that one unseen pixel may make
constexpr double kAssurance = 0.25;    // of a choice's time, for another look where the first saw no error at all
constexpr double kRivalErrors = 2.0;   // standard errors that a rival may be better than it was seen

bool betterEvidence(const ProbeEvidence& x, const ProbeEvidence& y, const ShadowBudget& b) {
  const auto closer = [&] { return x.high() != y.high() ? x.high() < y.high() : x.ms < y.ms; };
  if (b.timeMs > 0) {
    const bool fx = x.ms <= b.timeMs, fy = y.ms <= b.timeMs;
    return fx != fy ? fx : fx ? closer() : x.ms < y.ms;
  }
  const bool fx = x.high() <= b.error, fy = y.high() <= b.error;
  return fx != fy ? fx : fx ? x.ms < y.ms : closer();
}

/// That its error is found to be at most `keeps` by another look, a normal distribution's error taken for what is known.
double chanceOf(const ProbeEvidence& e, double keeps) {
  const double error = e.variance > 0 ? std::sqrt(e.variance) : kUnseen / e.pixels;
  return 0.5 * std::erfc((e.mse + kCloser * error - keeps * keeps) / error * M_SQRT1_2);
}

}  // namespace

void ProbeEvidence::add(double otherMse, double otherVariance, double otherPixels) {
  const double n = pixels + otherPixels;
  if (!(n > 0)) return;
  const double p = pixels / n, q = otherPixels / n;
  mse = p * mse + q * otherMse;
  variance = p * p * variance + q * q * otherVariance;
  pixels = n;
}
double ProbeEvidence::high() const {
  if (judged() && !(variance > 0)) return std::sqrt(std::max(mse, kUnseen / pixels));
  return std::sqrt(std::max(0.0, mse + std::sqrt(std::max(0.0, variance))));
}
double ProbeEvidence::low() const { return std::sqrt(std::max(0.0, mse - std::sqrt(std::max(0.0, variance)))); }

std::vector<ProbeEvidence> fallingErrors(std::span<const ProbeEvidence> rays) {
  struct Block {
    double mse, variance, pixels, count;
  };
  std::vector<Block> blocks;
  for (const ProbeEvidence& e : rays) {
    blocks.push_back({e.mse, e.variance, std::max(e.pixels, 1.0), 1.0});
    while (blocks.size() > 1 && blocks[blocks.size() - 2].mse < blocks.back().mse) {
      const Block last = blocks.back();
      blocks.pop_back();
      Block& b = blocks.back();
      const double n = b.pixels + last.pixels;
      b.mse = (b.pixels * b.mse + last.pixels * last.mse) / n;
      b.variance = (b.pixels * b.variance + last.pixels * last.variance) / n;  // what they saw is the same pixels
      b.pixels = n;
      b.count += last.count;
    }
  }
  std::vector<ProbeEvidence> out(rays.begin(), rays.end());
  size_t k = 0;
  for (const Block& b : blocks)
    for (double i = 0; i < b.count; ++i, ++k) out[k].mse = b.mse, out[k].variance = b.variance;
  return out;
}

size_t chooseByEvidence(std::span<const ProbeEvidence> candidates, const ShadowBudget& budget) {
  size_t chosen = candidates.size();
  for (size_t k = 0; k < candidates.size(); ++k)
    if (candidates[k].judged() && (chosen == candidates.size() || betterEvidence(candidates[k], candidates[chosen], budget))) chosen = k;
  GOBO_CHECK(chosen < candidates.size());
  const double least = candidates[chosen].high();
  if (!(budget.timeMs > 0) && least > budget.error)
    for (size_t k = 0; k < candidates.size(); ++k)
      if (candidates[k].judged() && candidates[k].high() <= kNearMiss * least && candidates[k].ms < candidates[chosen].ms) chosen = k;
  return chosen;
}

std::vector<size_t> rivalsOf(std::span<const ProbeEvidence> candidates, const ShadowBudget& budget, size_t chosen) {
  std::vector<size_t> out;
  const double high = candidates[chosen].high();
  for (size_t k = 0; k < candidates.size(); ++k) {
    const ProbeEvidence& c = candidates[k];
    if (k == chosen || !c.judged()) continue;
    const double low = std::sqrt(std::max(0.0, c.mse - kRivalErrors * std::sqrt(std::max(0.0, c.variance))));
    if (budget.timeMs > 0 ? c.ms <= budget.timeMs && low < high
                          : c.ms < candidates[chosen].ms && low <= (high <= budget.error ? budget.error : kNearMiss * high))
      out.push_back(k);
  }
  return out;
}

bool blindChoice(std::span<const ProbeEvidence> candidates, const ShadowBudget& budget, size_t chosen) {
  const ProbeEvidence& c = candidates[chosen];
  return !(budget.timeMs > 0) && !(c.variance > 0) && c.high() > kBlind * budget.error;
}

bool worthAnotherLook(std::span<const ProbeEvidence> candidates, const ShadowBudget& budget, size_t chosen, std::span<const size_t> rivals, double costMs) {
  if (blindChoice(candidates, budget, chosen) && costMs < kAssurance * candidates[chosen].ms) return true;
  if (rivals.empty()) return false;
  if (budget.timeMs > 0) return costMs <= kShareOfTime * budget.timeMs;
  const double high = candidates[chosen].high(), keeps = high <= budget.error ? budget.error : kNearMiss * high;
  double saved = 0, most = 0;
  for (const size_t k : rivals) {
    const double less = candidates[chosen].ms - candidates[k].ms;
    most = std::max(most, less);
    saved = std::max(saved, chanceOf(candidates[k], keeps) * less);
  }
  return saved > costMs || costMs < kInsurance * most;
}

}  // namespace filters
}  // namespace gobo
