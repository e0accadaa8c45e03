// SPDX-License-Identifier: Apache-2.0
#include "regress/commits.h"

#include <filesystem>
#include <sstream>

#include "server/log.h"

namespace gobo::cli {
namespace {

namespace fs = std::filesystem;

std::string firstLine(const std::string& text) { return text.substr(0, text.find('\n')); }

/// Of rev-list, which no setting of the user changes.
constexpr const char* kCommitFormat = "--format=%H%x00%P%x00%s";

Result<Commit> commitOf(const std::string& text) {
  const size_t a = text.find('\0'), b = a == std::string::npos ? a : text.find('\0', a + 1);
  if (b == std::string::npos) return internalError("git rev-list says \"" + escaped(text) + "\"");
  Commit out;
  out.id = text.substr(0, a);
  std::istringstream parents(text.substr(a + 1, b - a - 1));
  out.parents = 0;
  for (std::string parent; parents >> parent;) ++out.parents;
  out.subject = text.substr(b + 1);
  return out;
}

/// git in the clone, whose folders are named: where it is damaged, git must not find a repository around it instead.
std::vector<std::string> gitInTree(const std::string& tree, const std::vector<std::string>& words) {
  std::vector<std::string> all{
      "git", "-C", tree, "--git-dir=" + tree + "/.git", "--work-tree=" + tree, "-c", "core.hooksPath=/dev/null", "-c", "advice.detachedHead=false"};
  all.insert(all.end(), words.begin(), words.end());
  return all;
}

}  // namespace

std::vector<std::string> Commits::git(const std::vector<std::string>& words) const {
  std::vector<std::string> all{"git", "--git-dir=" + store_};
  all.insert(all.end(), words.begin(), words.end());
  return all;
}

Result<Commits> Commits::open(const std::string& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) return invalidArgument("--repo = \"" + folder + "\": is no folder");
  const auto store = outputOf({"git", "-C", folder, "rev-parse", "--path-format=absolute", "--git-common-dir"});
  if (!store.ok()) return invalidArgument("--repo = \"" + folder + "\": " + firstLine(store.status().message()));
  return Commits(folder, firstLine(*store));
}

Result<Commit> Commits::find(const std::string& option, const std::string& revision) const {
  const std::string named = option + " = \"" + revision + "\"";
  // A revision that begins with '-' would be an option to git. In the folder: the store's HEAD is the main worktree's, which a linked one has of its own.
  const auto id = revision.empty() || revision[0] == '-' ? Result<std::string>(invalidArgument(""))
                                                         : outputOf({"git", "-C", folder_, "rev-parse", "--verify", "--quiet", revision + "^{commit}"});
  if (!id.ok()) return invalidArgument(named + ": git knows no such commit in " + store_);
  const auto said = outputOf(git({"rev-list", "--max-count=1", "--no-commit-header", kCommitFormat, firstLine(*id)}));
  if (!said.ok()) return invalidArgument(named + ": " + said.status().message());
  return commitOf(firstLine(*said));
}

Result<std::vector<Commit>> Commits::line(const Commit& good, const Commit& bad) const {
  const std::string both = "--good = " + good.shortId() + ", --bad = " + bad.shortId() + ": ";
  if (good.id == bad.id) return invalidArgument(both + "are the same commit");
  const auto isAncestor = [&](const Commit& a, const Commit& b) { return outputOf(git({"merge-base", "--is-ancestor", a.id, b.id})).ok(); };
  if (!isAncestor(good, bad)) return invalidArgument(both + "good must be an ancestor of bad" + (isAncestor(bad, good) ? ": it is the other way round" : ""));
  GOBO_ASSIGN(const std::string said, outputOf(git({"rev-list", "--first-parent", "--reverse", "--no-commit-header", kCommitFormat, good.id + ".." + bad.id})));
  std::vector<Commit> out;
  std::istringstream lines(said);
  for (std::string text; std::getline(lines, text);) {
    GOBO_ASSIGN(Commit commit, commitOf(text));
    out.push_back(std::move(commit));
  }
  // Else the oldest one's parent is a commit that nobody called good.
  GOBO_ASSIGN(const std::string before, outputOf(git({"rev-parse", out.front().id + "^1"})));
  if (firstLine(before) != good.id)
    return invalidArgument(both + "good is an ancestor of bad, but not along first parents: it came by a merge. The line's own commit there is " +
                           firstLine(before));
  return out;
}

Status Commits::checkOut(const Commit& commit, const std::string& tree) const {
  std::error_code error;
  // Of an older repository, or half made: what is in it can be made again.
  if (fs::exists(tree, error) && !outputOf(gitInTree(tree, {"cat-file", "-e", commit.id + "^{commit}"})).ok()) fs::remove_all(tree, error);
  if (!fs::exists(tree, error)) {
    const std::string part = tree + ".part";
    fs::remove_all(part, error);
    GOBO_TRY(outputOf({"git", "clone", "--quiet", "--shared", "--no-checkout", "--template=", store_, part}).status());
    fs::rename(part, tree, error);
    if (error) return Status(Code::PermissionDenied, "cannot make \"" + tree + "\": " + error.message());
  }
  // Of one that was killed; the caller has the folder to itself.
  for (const char* lock : {".git/index.lock", ".git/HEAD.lock"}) fs::remove(fs::path(tree) / lock, error);
  GOBO_TRY(outputOf(gitInTree(tree, {"checkout", "--quiet", "--force", "--detach", commit.id})).status());
  return outputOf(gitInTree(tree, {"clean", "--quiet", "-ffd"})).status();
}

}  // namespace gobo::cli
