// SPDX-License-Identifier: Apache-2.0
#include "regress/child.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <mutex>
#include <set>

#include "server/log.h"

namespace gobo::cli {
namespace {

using ChildClock = std::chrono::steady_clock;
constexpr auto kPatience = std::chrono::seconds(3);  // between asking a group to end and ending it

std::mutex groupsMutex;
std::set<pid_t> groups;  // of children that are waited for

class File {
 public:
  explicit File(int fd) : fd_(fd) {}
  ~File() {
    if (fd_ >= 0) ::close(fd_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  int get() const { return fd_; }
  std::string content() const {
    std::string text;
    char buffer[4096];
    for (off_t at = 0;;) {
      const ssize_t n = ::pread(fd_, buffer, sizeof buffer, at);
      if (n <= 0) return text;
      text.append(buffer, size_t(n));
      at += n;
    }
  }

 private:
  int fd_;
};

std::vector<char*> environmentOfChildren() {
  std::vector<char*> out;
  for (char** variable = ::environ; *variable; ++variable) {
    const std::string text = *variable;
    bool kept = true;
    for (const char* prefix : {"GIT_", "GOBO_SERVER=", "GOBO_TOKEN="}) kept &= text.rfind(prefix, 0) != 0;
    if (kept) out.push_back(*variable);
  }
  out.push_back(nullptr);
  return out;
}

Result<pid_t> spawnChild(const std::vector<std::string>& words, const std::string& folder, int out, int error) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  posix_spawn_file_actions_init(&actions);
  posix_spawnattr_init(&attributes);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, out, 1);
  posix_spawn_file_actions_adddup2(&actions, error, 2);
  if (!folder.empty()) posix_spawn_file_actions_addchdir_np(&actions, folder.c_str());
  sigset_t none;
  sigemptyset(&none);  // this program waits for its signals in a thread (session.h): blocked here, they would be blocked there
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP);
  std::vector<char*> arguments;
  for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  std::vector<char*> environment = environmentOfChildren();
  pid_t pid = -1;
  int failed = 0;
  {
    const std::lock_guard lock(groupsMutex);
    failed = ::posix_spawnp(&pid, arguments[0], &actions, &attributes, arguments.data(), environment.data());
    if (!failed) groups.insert(pid);
  }
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  if (failed) return Status(failed == ENOENT ? Code::NotFound : Code::Unknown, "cannot start \"" + words[0] + "\": " + std::strerror(failed));
  return pid;
}

ChildEnd endOf(int status) {
  ChildEnd end;
  if (WIFSIGNALED(status)) end.signal = WTERMSIG(status);
  else end.code = WEXITSTATUS(status);
  return end;
}

/// Asks the group to end, and ends it.
int endGroup(pid_t pid) {
  int status = 0;
  ::kill(-pid, SIGTERM);
  const auto deadline = ChildClock::now() + kPatience;
  pid_t over = 0;
  while (over == 0 && ChildClock::now() < deadline) {
    ::usleep(20000);
    over = ::waitpid(pid, &status, WNOHANG);
  }
  ::kill(-pid, SIGKILL);  // and what of the group outlives its first
  if (over == 0) ::waitpid(pid, &status, 0);
  return status;
}

/// A group that has been waited for is nobody's to end: its number may be another's.
struct Awaited {
  explicit Awaited(pid_t pid) : pid(pid) {}
  ~Awaited() {
    const std::lock_guard lock(groupsMutex);
    groups.erase(pid);
  }
  Awaited(const Awaited&) = delete;
  Awaited& operator=(const Awaited&) = delete;
  const pid_t pid;
};

Result<ChildEnd> waitFor(pid_t pid, const ChildOptions& options) {
  const Awaited awaited(pid);
  const auto begin = ChildClock::now();
  for (int pause = 1000;; pause = std::min(20000, pause * 2)) {
    int status = 0;
    const pid_t over = ::waitpid(pid, &status, WNOHANG);
    if (over == pid) return endOf(status);
    if (over < 0 && errno != EINTR) return Status(Code::Unknown, std::string("cannot wait for a child: ") + std::strerror(errno));
    if (options.stop && options.stop()) {
      endGroup(pid);
      return Status(Code::Cancelled, "interrupted");
    }
    if (options.limitSeconds > 0 && ChildClock::now() - begin > std::chrono::duration<double>(options.limitSeconds)) {
      ChildEnd end = endOf(endGroup(pid));
      end.late = true;
      return end;
    }
    ::usleep(useconds_t(pause));
  }
}

}  // namespace

std::string ChildEnd::text() const {
  if (late) return "took longer than allowed";
  return signal ? "was ended by signal " + std::to_string(signal) : "left with exit code " + std::to_string(code);
}

Result<ChildEnd> runChild(const std::vector<std::string>& words, const std::string& log, const ChildOptions& options) {
  const File out(::open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (out.get() < 0) return Status(Code::PermissionDenied, "cannot write \"" + log + "\": " + std::strerror(errno));
  GOBO_ASSIGN(const pid_t pid, spawnChild(words, options.folder, out.get(), out.get()));
  return waitFor(pid, options);
}

Result<std::string> outputOf(const std::vector<std::string>& words) {
  const File out(::memfd_create("out", MFD_CLOEXEC)), error(::memfd_create("error", MFD_CLOEXEC));
  if (out.get() < 0 || error.get() < 0) return Status(Code::ResourceExhausted, std::string("no memory file: ") + std::strerror(errno));
  GOBO_ASSIGN(const pid_t pid, spawnChild(words, "", out.get(), error.get()));
  GOBO_ASSIGN(const ChildEnd end, waitFor(pid, {}));
  if (end.ok()) return out.content();
  std::string said = error.content();
  while (!said.empty() && (said.back() == '\n' || said.back() == ' ')) said.pop_back();
  return Status(Code::FailedPrecondition, said.empty() ? words[0] + " " + end.text() : said);
}

void endChildren() {
  groupsMutex.lock();  // and never unlocked: what starts after this would outlive the program
  for (const pid_t group : groups) ::kill(-group, SIGKILL);
}

}  // namespace gobo::cli
