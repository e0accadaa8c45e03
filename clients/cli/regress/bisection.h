// SPDX-License-Identifier: Apache-2.0
// Which commit of a line was the first whose pictures are not the accepted ones: the search alone, without git and without renders (commits.h has the former).
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "regress/child.h"
#include "regress/record.h"

namespace gobo::cli {

/// Of one commit. Skip: it cannot be told, since it does not build, or its program crashes or fails.
enum class Verdict { Good, Bad, Skip };
const char* verdictName(Verdict verdict);
/// The inverse; none for other words.
std::optional<Verdict> verdictNamed(const std::string& name);

/// Binary search over commits 0 .. count - 1, oldest first, whose last is known to be bad and whose parent of the first is known to be good. Commits that were
/// skipped are passed over. Of n commits at most ceil(log2 n) are tried beside those that are skipped, if verdicts go from good to bad once.
class Bisection {
 public:
  /// count: 1 or more.
  explicit Bisection(size_t count) : high_(count - 1), skipped_(count, false) {}
  /// The next commit to try: the middle of those that can still tell something; none when all is known that can be.
  std::optional<size_t> next() const;
  /// What `next` was found to be.
  void tell(size_t commit, Verdict verdict);
  /// The commits of which one is the first bad one, oldest first: one, or more where commits beside it were skipped.
  std::vector<size_t> suspects() const;
  /// Commits that must still be tried at most, if none of them is skipped.
  int left() const;

 private:
  std::vector<size_t> untried() const;
  size_t low_ = 0;  ///< the oldest commit that may be the first bad one
  size_t high_;     ///< the oldest that is known to be bad
  std::vector<bool> skipped_;
};

/// A verdict and the sentence that says why.
struct Judged {
  Verdict verdict = Verdict::Skip;
  std::string why;
};

/// What the end of a commit's `gobo regress run` and what it wrote say of the cases of these names. Bad: one has changed (or is slower than allowed), whatever
/// the others are. Good: every one passes. Skip: anything else, a program that a signal ended first of all: what it wrote may be of half a run.
Judged judge(const ChildEnd& end, const Result<RunRecord>& run, const std::vector<std::string>& cases);

}  // namespace gobo::cli
