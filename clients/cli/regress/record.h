// SPDX-License-Identifier: Apache-2.0
// What a run of a suite found, as a value and as JSON: run.json of the output folder, and a line of history.jsonl.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "regress/references.h"

namespace gobo::cli {

/// Same: every bit. Noise: other bits, but no more than other seeds make. Changed. Slower: maxTime or maxRays. Missing: nothing is accepted yet. Failed: no
/// verdict.
enum class CaseStatus { Same, Noise, Changed, Slower, Missing, Failed };
const char* statusName(CaseStatus status);

struct CaseRecord {
  std::string name;
  CaseStatus status = CaseStatus::Failed;
  std::string message;  ///< one sentence for people
  int exitCode = 0;     ///< of a failure
  double excess = 0, chance = 1;
  std::string strongest;  ///< where the evidence is: "blocks of 4 at 16, 8 (red - green)"
  double meanReference = 0, meanNow = 0, meanStandardError = 0;
  double rmse = 0, noiseRmse = 0, flip = 0;
  std::vector<std::string> plan;  ///< planDifference
  double referenceMs = 0;
  uint64_t referenceRays = 0;
  std::string referenceDigest, by, why, when;
  std::string partsDigest;  ///< of NAME.parts.exr in the output folder; empty: it was not rendered
  RenderFacts facts;
};

struct RunRecord {
  std::string suite, when, build;
  std::vector<CaseRecord> cases;
};

std::string factsToJson(const RenderFacts& facts);
/// Throws nlohmann's exceptions.
RenderFacts factsFromJson(const std::string& text);

std::string runToJson(const RunRecord& run);
Result<RunRecord> runFromJson(const std::string& text, const std::string& file);

/// What the history keeps of a run, one line of it.
struct PastCase {
  std::string name, status;
  double excess = 0, rmse = 0, ms = 0;
  uint64_t rays = 0;
};
struct PastRun {
  std::string when, build;
  std::vector<PastCase> cases;
};
std::string historyLine(const RunRecord& run);
/// Lines that are none are left out: a history is for looking at.
std::vector<PastRun> readHistory(const std::string& text);

/// 0 all same or noise; 1 one has changed, or takes longer than allowed; a failure's own code before that; 3 a case has nothing accepted.
int exitCodeOf(const RunRecord& run);
std::string junitXml(const RunRecord& run);

}  // namespace gobo::cli
