// SPDX-License-Identifier: Apache-2.0
// A git repository as `gobo regress bisect` needs it: read alone. Commits are built in a clone elsewhere that borrows its objects, so that neither its
// worktree, index, branches nor its list of worktrees know of it.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "regress/child.h"

namespace gobo::cli {

struct Commit {
  std::string id;  ///< 40 (or 64) digits
  std::string subject;
  int parents = 1;
  std::string shortId() const { return id.substr(0, 12); }
};

class Commits {
 public:
  /// `folder`: anywhere in a worktree, or a bare repository. Errors: InvalidArgument "--repo = ...".
  static Result<Commits> open(const std::string& folder);
  /// `revision` as git knows it in the folder: HEAD is that worktree's own. Errors: InvalidArgument "OPTION = REVISION: ...".
  Result<Commit> find(const std::string& option, const std::string& revision) const;
  /// Commits after `good` up to `bad` along first parents, oldest first; not empty. Errors: InvalidArgument that names --good and --bad where good is not on
  /// that line.
  Result<std::vector<Commit>> line(const Commit& good, const Commit& bad) const;
  /// The commit's files in `tree`, a clone that is made where there is none. What git ignores there (a build folder) stays, all else is the commit's.
  Status checkOut(const Commit& commit, const std::string& tree) const;
  /// The repository's own folder (.git, absolute): what a clone borrows from.
  const std::string& store() const { return store_; }

 private:
  Commits(std::string folder, std::string store) : folder_(std::move(folder)), store_(std::move(store)) {}
  std::vector<std::string> git(const std::vector<std::string>& words) const;
  std::string folder_, store_;
};

}  // namespace gobo::cli
