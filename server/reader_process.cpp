// SPDX-License-Identifier: Apache-2.0
#include "server/reader_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <map>
#include <mutex>
#include <utility>

#include "base/descriptor.h"
#include "ingest/descriptors.h"
#include "ingest/nursery.h"
#include "ingest/wire.h"

namespace gobo {
inline namespace server {
namespace {

/// `output` < 0: /dev/null, which keeps descriptor 4 from being anything else.
Result<pid_t> spawn(const std::string& program, const char* argument, int socket, int output) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawnattr_init(&attributes);
  for (int fd = 0; fd < 3; ++fd) ::posix_spawn_file_actions_addopen(&actions, fd, "/dev/null", O_RDWR, 0);
  ::posix_spawn_file_actions_adddup2(&actions, socket, ingest::kSocket);
  if (output >= 0) ::posix_spawn_file_actions_adddup2(&actions, output, ingest::kOutput);
  else ::posix_spawn_file_actions_addopen(&actions, ingest::kOutput, "/dev/null", O_RDWR, 0);
  ::posix_spawn_file_actions_addclosefrom_np(&actions, ingest::kOutput + 1);
  sigset_t none, all;
  sigemptyset(&none);
  sigfillset(&all);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setsigdefault(&attributes, &all);
  ::posix_spawnattr_setpgroup(&attributes, 0);  // a terminal's Ctrl-C is the daemon's business
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  std::string name = program, option = argument ? argument : "", locale = "LC_ALL=C", library;
  const char* path = std::getenv("LD_LIBRARY_PATH");
  if (path) library = std::string("LD_LIBRARY_PATH=") + path;
  char* argv[] = {name.data(), argument ? option.data() : nullptr, nullptr};
  char* environment[] = {locale.data(), path ? library.data() : nullptr, nullptr};
  pid_t pid = -1;
  const int error = ::posix_spawn(&pid, program.c_str(), &actions, &attributes, argv, environment);
  ::posix_spawn_file_actions_destroy(&actions);
  ::posix_spawnattr_destroy(&attributes);
  if (error == 0) return pid;
  return Status(error == EAGAIN || error == ENOMEM ? Code::ResourceExhausted : Code::Internal,
                "cannot start \"" + program + "\": " + strerrordesc_np(error) + " (ingest.program)");
}

void reap(pid_t pid, int& status) {
  while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {}
}

class SpawnedReader final : public ReaderProcess {
 public:
  explicit SpawnedReader(pid_t pid) : pid_(pid) {}
  ~SpawnedReader() override { end(); }
  bool gone(int& status) override {
    if (::waitpid(pid_, &status, WNOHANG) != pid_) return false;
    pid_ = -1;
    return true;
  }
  void end() override {
    if (pid_ < 0) return;
    if (::kill(-pid_, SIGKILL) != 0) ::kill(pid_, SIGKILL);  // the group: the program and the reader that it forked
    int ignored;
    reap(pid_, ignored);
    pid_ = -1;
  }

 private:
  pid_t pid_;
};

class SpawnedReaders final : public Readers {
 public:
  SpawnedReaders(const std::string& program, const char* argument) : program_(program), argument_(argument) {}
  Result<std::unique_ptr<ReaderProcess>> start(int socket, int output, const StopToken&) override {
    GOBO_ASSIGN(const pid_t pid, spawn(program_, argument_, socket, output));
    return std::unique_ptr<ReaderProcess>(std::make_unique<SpawnedReader>(pid));
  }

 private:
  const std::string program_;
  const char* const argument_;
};

/// The process that forks readers. It ends when its socket does.
class Nursery {
 public:
  static Result<std::shared_ptr<Nursery>> start(const std::string& program) {
    int pair[2];
    if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0)
      return Status(Code::ResourceExhausted, std::string("cannot make a socket pair: ") + ::strerror(errno));
    auto made = std::make_shared<Nursery>();
    made->control_ = Descriptor(pair[0]);
    const Descriptor low(pair[1]), theirs(::fcntl(low.get(), F_DUPFD_CLOEXEC, 16));
    if (theirs.get() < 0) return Status(Code::ResourceExhausted, std::string("no descriptor left: ") + ::strerror(errno));
    GOBO_ASSIGN(made->pid_, spawn(program, "--nursery", theirs.get(), -1));
    return made;
  }
  ~Nursery() {
    if (pid_ <= 0) return;
    kill();  // it may be loading libraries still. No reader is left, each keeps its nursery
    int ignored;
    reap(pid_, ignored);
  }
  /// It did not do what it was asked for: the next reader comes of another.
  void lost() { lost_ = true; }
  bool isLost() const { return lost_; }
  /// False: it is gone, or does not take what it is asked for.
  bool ask(int socket, int output, int life) { return ingest::sendDescriptors(control_.get(), {socket, output, life}); }
  /// With every reader of it.
  void kill() { ::kill(-pid_, SIGKILL); }

 private:
  Descriptor control_{-1};
  pid_t pid_ = -1;
  std::atomic<bool> lost_{false};
};

/// Known by its life line alone: no process number that might by now be another's.
class ForkedReader final : public ReaderProcess {
 public:
  ForkedReader(std::shared_ptr<Nursery> nursery, Descriptor life, double patience)
      : nursery_(std::move(nursery)), life_(std::move(life)), killWaits_(int(std::clamp(patience, 1.0, double(kPatience)))) {}
  ~ForkedReader() override { end(); }
  /// Within so many seconds, or not.
  bool begins(double patience, const StopToken& stop) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(patience);
    while (!look() && !takenIn_ && !stop.stopRequested() && std::chrono::steady_clock::now() < until) wait(20);
    return takenIn_;
  }
  /// It has not begun; if it does, its life line has ended.
  void abandon() { over_ = true; }
  bool gone(int& status) override {
    if (!look()) return false;
    status = status_;
    return true;
  }
  void end() override {
    if (over_) return;
    ::shutdown(life_.get(), SHUT_WR);
    for (int waits = 0; !look(); ++waits) {
      if (waits == killWaits_) {  // it never took this reader in, or the guard is stopped: nobody must wait for it for ever
        nursery_->lost();
        nursery_->kill();
      }
      wait(1000);
    }
  }

 private:
  static constexpr int kPatience = 5;  // seconds that a kill may take at most; no longer than beginning may
  void wait(int ms) {
    pollfd line{life_.get(), POLLIN, 0};
    ::poll(&line, 1, ms);
  }
  /// Whether it is over.
  bool look() {
    while (!over_) {
      int32_t word = 0;
      const ssize_t n = ::recv(life_.get(), &word, sizeof word, MSG_DONTWAIT);
      if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) break;
      if (n == ssize_t(sizeof word) && word == ingest::kTakenIn) {
        takenIn_ = true;
        continue;
      }
      if (n != ssize_t(sizeof word)) nursery_->lost();  // without a word: whoever watched the reader was killed, and took it along
      status_ = n == ssize_t(sizeof word) ? word : SIGKILL;
      over_ = true;
    }
    return over_;
  }
  const std::shared_ptr<Nursery> nursery_;  // when it goes, its readers do
  Descriptor life_;
  const int killWaits_;
  int status_ = 0;
  bool takenIn_ = false, over_ = false;
};

class ForkedReaders final : public Readers {
 public:
  ForkedReaders(const std::string& program, double patience) : program_(program), patience_(patience) {}
  Result<std::unique_ptr<ReaderProcess>> start(int socket, int output, const StopToken& stop) override {
    for (int tries = 0; tries < 2; ++tries) {  // one that was killed from outside, or is stuck, is replaced
      int pair[2];
      if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) != 0)
        return Status(Code::ResourceExhausted, std::string("cannot make a socket pair: ") + ::strerror(errno));
      Descriptor mine(pair[0]), theirs(pair[1]);
      GOBO_ASSIGN(const std::shared_ptr<Nursery> nursery, current());
      const bool asked = nursery->ask(socket, output, theirs.get());
      theirs.close();  // or its end would not be seen here
      if (asked) {
        auto reader = std::make_unique<ForkedReader>(nursery, std::move(mine), patience_);
        if (reader->begins(patience_, stop) || stop.stopRequested()) return std::unique_ptr<ReaderProcess>(std::move(reader));
        reader->abandon();  // readers that began go on; with the last of them the process goes
      }
      drop(nursery);
    }
    return internalError("\"" + program_ + "\" does not start readers (ingest.program)");
  }
  void prepare() override { (void)current(); }
  void crashed() override { drop(nullptr); }

 private:
  Result<std::shared_ptr<Nursery>> current() {
    const std::lock_guard hold(mutex_);
    if (!nursery_ || nursery_->isLost()) { GOBO_ASSIGN(nursery_, Nursery::start(program_)); }
    return nursery_;
  }
  /// The next reader comes of a new one. Null: whichever there is.
  void drop(const std::shared_ptr<Nursery>& which) {
    std::shared_ptr<Nursery> last;
    const std::lock_guard hold(mutex_);
    if (!which || which == nursery_) last = std::exchange(nursery_, nullptr);
  }
  const std::string program_;
  const double patience_;
  std::mutex mutex_;
  std::shared_ptr<Nursery> nursery_;
};

#if defined(__SANITIZE_ADDRESS__) || defined(GOBO_THREAD_SANITIZER)
constexpr bool kForks = false;
#else
constexpr bool kForks = true;
#endif

}  // namespace

std::shared_ptr<Readers> spawnedReaders(const std::string& program) { return std::make_shared<SpawnedReaders>(program, nullptr); }
std::shared_ptr<Readers> bareReaders(const std::string& program) { return std::make_shared<SpawnedReaders>(program, "--bare"); }

std::shared_ptr<Readers> forkedReaders(const std::string& program, double patience) {
  static std::mutex mutex;
  static std::map<std::string, std::shared_ptr<Readers>> known;
  const std::lock_guard hold(mutex);
  auto& readers = known[program];
  // A sanitizer's allocator does not survive the fork of a process with threads always: not to be tried twice a reader.
  if (!readers) readers = kForks ? std::shared_ptr<Readers>(std::make_shared<ForkedReaders>(program, patience)) : spawnedReaders(program);
  return readers;
}

}  // namespace server
}  // namespace gobo
