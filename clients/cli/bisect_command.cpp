// SPDX-License-Identifier: Apache-2.0
// `gobo regress bisect`: which commit changed a case (docs/regression.md). The work folder:
//   lock                        held while it runs
//   tree                        a clone with the commit that is being built; its build folder stays from commit to commit
//   commits/ID/verdict.json     what was found of a commit, for which question: one that is asked again is not built again
//   commits/ID/build.log, run.log, out/   what its build and its run said, and the run's pictures
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>

#include <nlohmann/json.hpp>

#include "base/image_io.h"
#include "blobs.h"
#include "commands.h"
#include "regress/bisection.h"
#include "regress/child.h"
#include "regress/commits.h"
#include "regress/record.h"
#include "regress/references.h"
#include "regress/suite.h"
#include "report.h"
#include "server/encode.h"
#include "server/log.h"

namespace gobo::cli {
namespace {

namespace fs = std::filesystem;
using BisectJson = nlohmann::ordered_json;

/// What was found of one commit.
struct Found {
  Judged judged;
  std::vector<CaseRecord> cases;  ///< of a run that was recorded
  bool kept = false;              ///< from an earlier bisection
};

/// Nobody else works in the folder while this lives.
class FolderLock {
 public:
  FolderLock() = default;
  ~FolderLock() {
    if (fd_ >= 0) ::close(fd_);
  }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;
  Status take(const std::string& folder) {
    std::error_code error;
    fs::create_directories(folder, error);
    fd_ = error ? -1 : ::open((folder + "/lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (fd_ < 0) return invalidArgument("--work = \"" + folder + "\": cannot be written to");
    if (::flock(fd_, LOCK_EX | LOCK_NB) != 0) return Status(Code::FailedPrecondition, "--work = \"" + folder + "\": another bisection is at work there");
    return {};
  }

 private:
  int fd_ = -1;
};

std::string readAll(const std::string& file) {
  const auto bytes = readFile(file, 1 << 28);
  return bytes.ok() ? std::string(bytes->begin(), bytes->end()) : std::string();
}

/// A folder of this repository's below the user's cache.
Result<std::string> workFolder(const BisectCommand& command, const Commits& commits) {
  if (!command.work.empty()) return fs::absolute(command.work).lexically_normal().string();
  const char* cache = std::getenv("XDG_CACHE_HOME");
  const char* home = std::getenv("HOME");
  if (!(cache && cache[0] == '/') && !(home && home[0] == '/')) return invalidArgument("--work: neither XDG_CACHE_HOME nor HOME names a folder to work in");
  const fs::path base = cache && cache[0] == '/' ? fs::path(cache) : fs::path(home) / ".cache";
  return (base / "gobo" / "bisect" / sha256Hex(commits.store().data(), commits.store().size()).substr(0, 16)).string();
}

/// The files that a case's pictures are made of, by size and time: the scene's own, what it names (buffers, textures) and the environment.
BisectJson filesOfCase(const RegressCase& c) {
  BisectJson out = BisectJson::array();
  const auto add = [&](const std::string& name, const std::string& path) {
    std::error_code error;
    const auto size = fs::file_size(path, error);
    const auto time = error ? fs::file_time_type() : fs::last_write_time(path, error);
    if (!error) out.push_back({name, path, size, time.time_since_epoch().count()});
  };
  // Of a built-in scene there are none, and one that is away by now is the run's to refuse.
  if (const auto files = filesOf(c.scene); files.ok())
    for (const auto& [name, file] : *files) add(name, file.path);
  const std::string& map = c.environment.empty() ? c.request.environment().path() : c.environment;
  if (!map.empty()) add("environment", map);
  return out;
}

/// All of what a verdict depends on beside the commit: the suite, its cases and what is accepted for them, the files they are made of, how a commit is built.
std::string questionOf(const BisectCommand& command, const Suite& suite, const std::vector<std::string>& cases,
                       const std::map<std::string, Accepted>& accepted) {
  BisectJson j = {{"suite", readAll(suite.file)}, {"build", command.build}, {"program", command.program}, {"timeout", command.limitSeconds}};
  for (const RegressCase& c : suite.cases) {
    const auto entry = accepted.find(c.name);
    if (std::find(cases.begin(), cases.end(), c.name) == cases.end()) continue;
    j["cases"].push_back({c.name, entry->second.digest, c.scene, filesOfCase(c)});
  }
  const std::string text = j.dump(-1, ' ', false, BisectJson::error_handler_t::replace);
  return sha256Hex(text.data(), text.size());
}

class Bisect {
 public:
  Bisect(const SessionOptions& session, const BisectCommand& command, const Suite& suite, Commits commits, std::string work, std::vector<std::string> cases,
         std::string question)
      : session_(session),
        command_(command),
        suiteFile_(fs::absolute(suite.file).string()),
        commits_(std::move(commits)),
        work_(std::move(work)),
        cases_(std::move(cases)),
        question_(std::move(question)) {}

  /// What is known of a commit, or else what a build and a run of it say. `again`: a skip of an earlier bisection is not taken for an answer; what was amiss
  /// then, a tool or a disk, may be mended.
  Result<const Found*> look(const Commit& commit, bool again = false) {
    const auto known = found_.find(commit.id);
    if (known != found_.end()) return &known->second;
    Found found;
    if (!readVerdict(commit, found) || (again && found.judged.verdict == Verdict::Skip)) {
      GOBO_ASSIGN(found, tryCommit(commit));
      // Who stops a service ends all its processes, so that the child may be gone first: that says nothing of the commit.
      if (found.judged.verdict == Verdict::Skip && interrupted()) return Status(Code::Cancelled, "interrupted");
      GOBO_TRY(writeVerdict(commit, found));
    }
    return &(found_[commit.id] = std::move(found));
  }
  std::string folder(const Commit& commit) const { return work_ + "/commits/" + commit.id; }
  int builds() const { return builds_; }
  const std::string& work() const { return work_; }

 private:
  Result<Found> tryCommit(const Commit& commit) {
    std::error_code error;
    fs::remove_all(folder(commit), error);  // of another question
    fs::create_directories(folder(commit), error);
    if (error) return invalidArgument("--work = \"" + work_ + "\": cannot make \"" + folder(commit) + "\": " + error.message());
    const std::string tree = work_ + "/tree";
    GOBO_TRY(commits_.checkOut(commit, tree));
    ChildOptions options;
    options.folder = tree;
    options.limitSeconds = command_.limitSeconds;
    options.stop = [] { return interrupted(); };
    ++builds_;
    Found found;
    GOBO_ASSIGN(const ChildEnd built, runChild({"/bin/sh", "-c", command_.build}, folder(commit) + "/build.log", options));
    if (!built.ok()) {
      found.judged.why = "its build " + built.text() + ": " + folder(commit) + "/build.log";
      return found;
    }
    const std::string program = (fs::path(tree) / command_.program).lexically_normal().string();
    if (::access(program.c_str(), X_OK) != 0) {
      found.judged.why = "its build makes no program \"" + command_.program + "\" (--program)";
      return found;
    }
    std::vector<std::string> words{program, "--local"};
    if (session_.threads) words.insert(words.end(), {"--threads", std::to_string(session_.threads)});
    words.insert(words.end(), {"regress", "run", suiteFile_});
    words.insert(words.end(), cases_.begin(), cases_.end());
    words.insert(words.end(), {"--out", folder(commit) + "/out"});
    GOBO_ASSIGN(const ChildEnd ran, runChild(words, folder(commit) + "/run.log", options));
    const Result<RunRecord> run = readRun(commit);
    found.judged = judge(ran, run, cases_);
    if (found.judged.verdict == Verdict::Skip) found.judged.why += ": " + folder(commit) + "/run.log";
    if (run.ok()) found.cases = run->cases;
    return found;
  }

  Result<RunRecord> readRun(const Commit& commit) const {
    const std::string file = folder(commit) + "/out/run.json";
    return runFromJson(readAll(file), file);
  }
  bool readVerdict(const Commit& commit, Found& to) const {
    try {
      const BisectJson j = BisectJson::parse(readAll(folder(commit) + "/verdict.json"));
      const auto verdict = verdictNamed(j.at("verdict"));
      if (j.at("question") != question_ || !verdict) return false;
      to.judged = {*verdict, j.at("why")};
    } catch (const std::exception&) { return false; }  // none yet, or damaged: it is made again
    const Result<RunRecord> run = readRun(commit);
    if (run.ok()) to.cases = run->cases;
    to.kept = true;
    return run.ok() || to.judged.verdict == Verdict::Skip;
  }
  Status writeVerdict(const Commit& commit, const Found& found) const {
    const BisectJson j = {{"question", question_}, {"verdict", verdictName(found.judged.verdict)}, {"why", found.judged.why}, {"subject", commit.subject}};
    const std::string text = j.dump(1, ' ', false, BisectJson::error_handler_t::replace) + "\n";
    return writeFileAtomic(folder(commit) + "/verdict.json", text.data(), text.size());
  }

  const SessionOptions& session_;
  const BisectCommand& command_;
  const std::string suiteFile_;
  const Commits commits_;
  const std::string work_;
  const std::vector<std::string> cases_;
  const std::string question_;
  std::map<std::string, Found> found_;
  int builds_ = 0;
};

void say(const Commit& commit, const Found& found, const std::string& left) {
  std::fprintf(stderr, "%s  %-4s%s %s (%s)%s\n", commit.shortId().c_str(), verdictName(found.judged.verdict), found.kept ? "*" : " ",
               escaped(commit.subject).c_str(), escaped(found.judged.why).c_str(), left.c_str());
}

const CaseRecord* caseNamed(const Found& found, const std::string& name) {
  for (const CaseRecord& c : found.cases)
    if (c.name == name) return &c;
  return nullptr;
}

std::string meanText(const CaseRecord& c) { return c.meanReference != 0 ? strf("%+.3f %%", 100 * (c.meanNow / c.meanReference - 1)) : "-"; }
bool isBad(const CaseRecord* c) { return c && (c->status == CaseStatus::Changed || c->status == CaseStatus::Slower); }

struct FirstBad {
  std::vector<Commit> suspects;
  Commit before;
  Found was, now;                  ///< of the commit before the suspects, and of the last suspect
  std::vector<std::string> later;  ///< cases that are bad in the end and were not yet then
};

BisectJson figuresOf(const CaseRecord* c) {
  if (!c) return nullptr;
  return {{"status", statusName(c->status)},
          {"excess", c->excess},
          {"mean_reference", c->meanReference},
          {"mean_now", c->meanNow},
          {"rmse", c->rmse},
          {"noise_rmse", c->noiseRmse},
          {"strongest", c->strongest},
          {"ms", c->facts.ms},
          {"rays", c->facts.rays},
          {"message", c->message}};
}

void printJson(const FirstBad& answer, const std::vector<std::string>& cases, const Bisect& bisect) {
  const auto json = [](const Commit& c) { return BisectJson{{"commit", c.id}, {"subject", c.subject}}; };
  BisectJson j = {{"before", json(answer.before)}, {"builds", bisect.builds()}, {"work", bisect.work()}};
  for (const Commit& c : answer.suspects) j["suspects"].push_back(json(c));
  j["first_bad"] = answer.suspects.size() == 1 ? json(answer.suspects[0]) : BisectJson(nullptr);
  for (const std::string& name : cases)
    j["cases"].push_back({{"case", name}, {"before", figuresOf(caseNamed(answer.was, name))}, {"after", figuresOf(caseNamed(answer.now, name))}});
  j["later"] = answer.later;
  std::printf("%s\n", j.dump(1, ' ', false, BisectJson::error_handler_t::replace).c_str());
}

void printAnswer(const FirstBad& answer, const std::vector<std::string>& cases, const BisectCommand& command, const Bisect& bisect) {
  const Commit& bad = answer.suspects.back();
  if (answer.suspects.size() == 1) std::printf("first bad commit: %s\n    %s\n", bad.id.c_str(), escaped(bad.subject).c_str());
  else {
    std::printf("the first bad commit is one of these %zu: all but the last cannot be told\n", answer.suspects.size());
    for (const Commit& c : answer.suspects) std::printf("%s\n    %s\n", c.id.c_str(), escaped(c.subject).c_str());
  }
  if (bad.parents > 1)
    std::printf("It is a merge: gobo regress bisect ... --good \"$(git merge-base %s^1 %s^2)\" --bad %s^2 looks into what it merges.\n", bad.shortId().c_str(),
                bad.shortId().c_str(), bad.shortId().c_str());
  std::vector<std::vector<std::string>> rows;
  for (const std::string& name : cases)
    for (const auto& [commit, found] : {std::pair(&answer.before, &answer.was), std::pair(&bad, &answer.now)})
      if (const CaseRecord* c = caseNamed(*found, name))
        rows.push_back({name, commit->shortId(), statusName(c->status), strf("%.1f", c->excess), meanText(*c), strf("%.3g", c->rmse),
                        strf("%.3g", c->noiseRmse), escaped(c->message)});
  printTable({"case", "commit", "status", "excess", "mean", "RMSE", "of noise", "what"}, rows, {false, false, false, true, true, true, true, false});
  for (const std::string& name : answer.later)
    std::printf("Case \"%s\" changed later: gobo regress bisect %s %s --good %s --bad %s\n", name.c_str(), command.suite.c_str(), name.c_str(),
                bad.shortId().c_str(), command.bad.c_str());
  std::printf("%d built; pictures and logs: %s\n", bisect.builds(), bisect.folder(bad).c_str());
}

Result<int> runBisection(const SessionOptions& session, const BisectCommand& command) {
  GOBO_ASSIGN(const Suite suite, readSuite(command.suite));
  if (command.build.empty()) return invalidArgument("--build = \"\": must be a command");
  if (command.program.empty() || fs::path(command.program).is_absolute())
    return invalidArgument("--program = \"" + command.program + "\": must be a path below the commit's folder, such as build/clients/gobo");
  std::vector<std::string> cases = command.cases;
  for (const std::string& name : cases) {
    const bool known = std::any_of(suite.cases.begin(), suite.cases.end(), [&](const RegressCase& c) { return c.name == name; });
    if (!known) return notFound(suite.file + ": no case \"" + name + "\"");
  }
  if (cases.empty())
    for (const RegressCase& c : suite.cases) cases.push_back(c.name);
  GOBO_ASSIGN(const auto accepted, References(suite.references).accepted());
  for (const std::string& name : cases)
    if (!accepted.count(name)) return notFound(suite.file + ": case \"" + name + "\": nothing is accepted for it, so that nothing can be told of it");
  GOBO_ASSIGN(const Commits commits, Commits::open(command.repository));
  GOBO_ASSIGN(const Commit good, commits.find("--good", command.good));
  GOBO_ASSIGN(const Commit bad, commits.find("--bad", command.bad));
  GOBO_ASSIGN(const std::vector<Commit> line, commits.line(good, bad));
  GOBO_ASSIGN(const std::string work, workFolder(command, commits));
  FolderLock lock;
  GOBO_TRY(lock.take(work));
  const Unfinished unfinished;  // Ctrl-C ends the child and all that it has started
  Bisect bisect(session, command, suite, commits, work, cases, questionOf(command, suite, cases, accepted));

  const auto end = [&](const char* option, const std::string& revision, const Commit& commit, Verdict wanted, const char* instead) -> Status {
    GOBO_ASSIGN(const Found* const found, bisect.look(commit, true));
    say(commit, *found, "");
    if (found->judged.verdict == wanted) return {};
    return invalidArgument(std::string(option) + " = \"" + revision + "\" (" + commit.shortId() +
                           "): " + (found->judged.verdict == Verdict::Skip ? "cannot be told" : instead) + ": " + found->judged.why);
  };
  GOBO_TRY(end("--good", command.good, good, Verdict::Good, "fails already"));
  GOBO_TRY(end("--bad", command.bad, bad, Verdict::Bad, "passes"));
  Bisection search(line.size());
  while (const auto next = search.next()) {
    GOBO_ASSIGN(const Found* const found, bisect.look(line[*next]));
    search.tell(*next, found->judged.verdict);
    say(line[*next], *found, strf(", %d left", search.left()));
  }
  FirstBad answer;
  const std::vector<size_t> suspects = search.suspects();
  for (const size_t i : suspects) answer.suspects.push_back(line[i]);
  answer.before = suspects[0] == 0 ? good : line[suspects[0] - 1];
  GOBO_ASSIGN(const Found* const was, bisect.look(answer.before));
  answer.was = *was;
  GOBO_ASSIGN(const Found* const now, bisect.look(answer.suspects.back()));
  answer.now = *now;
  GOBO_ASSIGN(const Found* const last, bisect.look(bad));
  for (const std::string& name : cases)
    if (isBad(caseNamed(*last, name)) && !isBad(caseNamed(answer.now, name))) answer.later.push_back(name);
  if (command.json) printJson(answer, cases, bisect);
  else printAnswer(answer, cases, command, bisect);
  return answer.suspects.size() == 1 ? int(kOk) : int(kFailure);
}

}  // namespace

int runBisect(const SessionOptions& session, const BisectCommand& command) {
  const Result<int> code = runBisection(session, command);
  return code.ok() ? *code : complain(code.status());
}

}  // namespace gobo::cli
