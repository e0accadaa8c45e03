// SPDX-License-Identifier: Apache-2.0
// A program as a child: in a process group of its own, so that all of a build ends together; without what would lead it elsewhere (GIT_*, GOBO_SERVER,
// GOBO_TOKEN).
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo::cli {

struct ChildEnd {
  int code = 0;       ///< its exit code, where it exited
  int signal = 0;     ///< that ended it; 0: none
  bool late = false;  ///< it was ended since it took longer than allowed
  bool ok() const { return code == 0 && signal == 0 && !late; }
  /// "left with exit code 2", "was ended by signal 11", "took longer than allowed".
  std::string text() const;
};

struct ChildOptions {
  std::string folder;          ///< to start it in; empty: here
  double limitSeconds = 0;     ///< 0: any
  std::function<bool()> stop;  ///< asked 50 times a second; true ends the child and its group
};

/// Runs a program with both its outputs in a file, which is made anew. Errors: NotFound or Unknown where it cannot be started, Cancelled by `stop`.
Result<ChildEnd> runChild(const std::vector<std::string>& words, const std::string& log, const ChildOptions& options);
/// The output of a program that must succeed; else FailedPrecondition with what it says on standard error.
Result<std::string> outputOf(const std::vector<std::string>& words);
/// For a program that leaves without waiting: ends the groups of all children, and none starts any more. Any thread.
void endChildren();

}  // namespace gobo::cli
