// SPDX-License-Identifier: Apache-2.0
// A private PostgreSQL server in a temporary folder, on a Unix socket in it and no other address. It ends with the process that started it,
// however that ends. PostgreSQL does not run as root: then it runs as "nobody". A cluster that is made once is kept as
// GOBO_POSTGRES_TEMPLATE, which is copied: making one takes a second.
#pragma once

#include <fcntl.h>
#include <grp.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace gobo::test {

class PostgresServer {
 public:
  /// The path of one of its programs; empty where it is not installed.
  static std::string program(const std::string& name) {
    namespace fs = std::filesystem;
    std::error_code error;
    std::string newest;
    int version = 0;
    for (fs::directory_iterator it("/usr/lib/postgresql", error), end; !error && it != end; it.increment(error)) {  // Debian's, which are in no PATH
      const int v = std::atoi(it->path().filename().c_str());
      if (v > version && ::access((it->path() / "bin" / name).c_str(), X_OK) == 0) version = v, newest = it->path() / "bin" / name;
    }
    if (!newest.empty()) return newest;
    const char* path = std::getenv("PATH");
    std::istringstream folders(path ? path : "");
    for (std::string folder; std::getline(folders, folder, ':');)
      if (::access((folder + "/" + name).c_str(), X_OK) == 0) return folder + "/" + name;
    return {};
  }
  static bool installed() { return !program("initdb").empty() && !program("postgres").empty(); }

  /// `durable`: fsync. Throws when it does not start, with its log.
  explicit PostgresServer(bool durable = false) : durable_(durable) {
    folder_ = (std::filesystem::temp_directory_path() / "gobo-pg-XXXXXX").string();
    if (!::mkdtemp(folder_.data())) throw std::runtime_error("no temporary folder");
    own(folder_);
    make();
    start();
  }
  ~PostgresServer() {
    stop(SIGQUIT);
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  PostgresServer(const PostgresServer&) = delete;
  PostgresServer& operator=(const PostgresServer&) = delete;

  std::string uri(const std::string& more = "") const { return "postgresql://gobo@/postgres?host=" + folder_ + more; }
  const std::string& folder() const { return folder_; }
  std::string data() const { return folder_ + "/data"; }

  void start() {
    pid_ = spawn({program("postgres"), "-D", data(), "-k", folder_, "-c", "listen_addresses=", "-c", durable_ ? "fsync=on" : "fsync=off", "-c",
                  "shared_buffers=32MB", "-c", "max_connections=80", "-c", "log_min_messages=warning", "-c", "autovacuum=off"});
    for (int i = 0; i < 3000; ++i) {
      std::ifstream in(data() + "/postmaster.pid");
      std::string line;
      for (int n = 0; n < 8; ++n) std::getline(in, line);
      if (line.rfind("ready", 0) == 0) return;
      if (::waitpid(pid_, nullptr, WNOHANG) == pid_) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    pid_ = -1;
    throw std::runtime_error("PostgreSQL does not start: " + log());
  }
  /// SIGQUIT: as pg_ctl -m immediate, no checkpoint; SIGINT: in order; SIGKILL with all its processes.
  void stop(int signal) {
    if (pid_ < 0) return;
    ::kill(pid_, signal);
    ::waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }

 private:
  static bool root() { return ::geteuid() == 0; }
  static constexpr uid_t kNobody = 65534;
  static void own(const std::string& path) {
    if (root() && ::chown(path.c_str(), kNobody, kNobody) != 0) throw std::runtime_error("cannot give away " + path);
  }
  std::string log() const {
    std::ifstream in(folder_ + "/log");
    return {std::istreambuf_iterator<char>(in), {}};
  }
  pid_t spawn(const std::vector<std::string>& words) const {
    std::vector<char*> argv;
    for (const std::string& w : words) argv.push_back(const_cast<char*>(w.c_str()));
    argv.push_back(nullptr);
    const std::string logPath = folder_ + "/log";
    const pid_t parent = ::getpid(), child = ::fork();
    if (child != 0) return child;
    if (root() && (::setgroups(0, nullptr) != 0 || ::setresgid(kNobody, kNobody, kNobody) != 0 || ::setresuid(kNobody, kNobody, kNobody) != 0)) ::_exit(126);
    ::prctl(PR_SET_PDEATHSIG, SIGQUIT);
    if (::getppid() != parent) ::_exit(125);
    sigset_t none;
    sigemptyset(&none);
    ::sigprocmask(SIG_SETMASK, &none, nullptr);
    ::setpgid(0, 0);  // not the terminal's interrupts
    const int out = ::open(logPath.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600), in = ::open("/dev/null", O_RDONLY);
    ::dup2(in, 0);
    ::dup2(out, 1);
    ::dup2(out, 2);
    for (int fd = 3; fd < 1024; ++fd) ::close(fd);
    if (::chdir("/") != 0) ::_exit(124);
    ::setenv("LC_ALL", "C", 1);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  void make() {
    namespace fs = std::filesystem;
    std::error_code error;
#ifdef GOBO_POSTGRES_TEMPLATE
    const std::string kept = GOBO_POSTGRES_TEMPLATE;
    if (fs::exists(kept, error)) {
      fs::copy(kept, data(), fs::copy_options::recursive, error);
      if (!error) {
        own(data());
        for (const auto& entry : fs::recursive_directory_iterator(data())) own(entry.path().string());
        return;
      }
      fs::remove_all(data(), error);
    }
#endif
    const pid_t child = spawn({program("initdb"), "-D", data(), "-U", "gobo", "-A", "trust", "-E", "UTF8", "--no-locale", "--no-sync"});
    int status = 0;
    ::waitpid(child, &status, 0);
    if (status != 0) throw std::runtime_error("initdb failed: " + log());
#ifdef GOBO_POSTGRES_TEMPLATE
    const std::string fresh = kept + "." + std::to_string(::getpid());
    fs::copy(data(), fresh, fs::copy_options::recursive, error);
    if (!error) fs::rename(fresh, kept, error);  // another process may have been first
    if (error) fs::remove_all(fresh, error);
#endif
  }

  bool durable_;
  std::string folder_;
  pid_t pid_ = -1;
};

/// Why a test with PostgreSQL is skipped; empty: it runs. Never skipped for want of the server where GOBO_REQUIRE_POSTGRES is set (.ci/run).
inline std::string withoutPostgres() {
#ifdef __SANITIZE_THREAD__
  return "libpq is not instrumented for the thread sanitizer";
#else
  if (PostgresServer::installed() || std::getenv("GOBO_REQUIRE_POSTGRES")) return {};
  return "PostgreSQL is not installed (deploy/install-deps has it)";
#endif
}

/// The server of this program, started by the first test that asks.
inline PostgresServer& postgresServer() {
  static PostgresServer server;
  return server;
}

}  // namespace gobo::test
