// SPDX-License-Identifier: Apache-2.0
#include "regress/bisection.h"

#include "server/log.h"

namespace gobo::cli {

const char* verdictName(Verdict verdict) {
  switch (verdict) {
    case Verdict::Good: return "good";
    case Verdict::Bad: return "bad";
    case Verdict::Skip: break;
  }
  return "skip";
}

std::optional<Verdict> verdictNamed(const std::string& name) {
  for (const Verdict v : {Verdict::Good, Verdict::Bad, Verdict::Skip})
    if (name == verdictName(v)) return v;
  return std::nullopt;
}

std::vector<size_t> Bisection::untried() const {
  std::vector<size_t> out;
  for (size_t i = low_; i < high_; ++i)
    if (!skipped_[i]) out.push_back(i);
  return out;
}

std::optional<size_t> Bisection::next() const {
  const std::vector<size_t> left = untried();
  if (left.empty()) return std::nullopt;
  return left[left.size() / 2];
}

void Bisection::tell(size_t commit, Verdict verdict) {
  switch (verdict) {
    case Verdict::Good: low_ = commit + 1; return;
    case Verdict::Bad: high_ = commit; return;
    case Verdict::Skip: skipped_[commit] = true; return;
  }
}

std::vector<size_t> Bisection::suspects() const {
  std::vector<size_t> out;
  for (size_t i = low_; i <= high_; ++i) out.push_back(i);
  return out;
}

int Bisection::left() const {
  int tries = 0;
  for (size_t answers = untried().size() + 1; answers > 1; answers = (answers + 1) / 2) ++tries;
  return tries;
}

Judged judge(const ChildEnd& end, const Result<RunRecord>& run, const std::vector<std::string>& cases) {
  if (end.signal || end.late) return {Verdict::Skip, "its program " + end.text()};
  if (!run.ok()) return {Verdict::Skip, "its program " + end.text() + " without a record of the run"};
  Judged out{Verdict::Good, "every case passes"};
  for (const std::string& name : cases) {
    const CaseRecord* found = nullptr;
    for (const CaseRecord& c : run->cases)
      if (c.name == name) found = &c;
    if (found && (found->status == CaseStatus::Changed || found->status == CaseStatus::Slower))
      return {Verdict::Bad, "case \"" + name + "\" is " + statusName(found->status) + ": " + escaped(found->message)};
    if (found && (found->status == CaseStatus::Same || found->status == CaseStatus::Noise)) continue;
    if (out.verdict == Verdict::Good)
      out = {Verdict::Skip, "case \"" + name + "\": " + (found ? std::string(statusName(found->status)) + ": " + escaped(found->message) : "was not rendered")};
  }
  return out;
}

}  // namespace gobo::cli
