// SPDX-License-Identifier: Apache-2.0
// gobod: the rendering daemon. docs/operations.md describes its configuration and its life.
#include <signal.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <CLI/CLI.hpp>

#include "plan/display_transforms.h"
#include "server/farm/farm_worker.h"
#include "server/freed_memory.h"
#include "server/jobs/postgres_job_store.h"
#include "server/notify.h"
#include "server/server.h"
#include "server/upload.h"

namespace {

constexpr double kGraceSeconds = 1.5;  // after the drain: what does not stop by then is left

/// What the command line and, below it, the environment say over the file, at the start and at every reload.
struct Flags {
  std::string configFile, cache, logLevel, logFormat, tmp, store, http, web, jobsStore, worker, workerName;
  std::vector<std::string> listen, roots;
  int threads = -1;
};

/// "a,b" -> a, b; nothing of none.
std::vector<std::string> listOf(const char* text) {
  std::vector<std::string> out;
  std::istringstream in(text ? text : "");
  for (std::string one; std::getline(in, one, ',');)
    if (!one.empty()) out.push_back(one);
  return out;
}

gobo::Result<gobo::ServerConfig> configure(const Flags& f) {
  gobo::ServerConfig config;
  if (!f.configFile.empty()) GOBO_TRY(gobo::readConfig(f.configFile, config));
  if (!f.listen.empty()) config.listen = f.listen;
  if (!f.roots.empty()) config.roots = f.roots;
  if (!f.cache.empty()) config.cacheFolder = f.cache;
  if (f.threads >= 0) config.threads = f.threads;
  if (!f.logLevel.empty()) config.logLevel = f.logLevel;
  if (!f.logFormat.empty()) config.logFormat = f.logFormat;
  if (!f.tmp.empty()) config.tmpFolder = f.tmp;
  if (!f.http.empty()) config.httpListen = f.http;
  if (!f.web.empty()) config.webListen = f.web;
  if (!f.jobsStore.empty()) config.jobsStore = f.jobsStore;
  if (!f.worker.empty()) config.farmCoordinator = f.worker;
  if (!f.workerName.empty()) config.farmName = f.workerName;
  if (!f.store.empty()) {
    const auto bytes = gobo::parseBytes(f.store);
    if (!bytes.ok()) return bytes.status().at("--store");
    config.storeBytes = *bytes;
  }
  GOBO_TRY(gobo::checkConfig(config).at(config.file));
  return config;
}

void reload(gobo::Server& server, const Flags& flags) {
  gobo::notifyManager("RELOADING=1");
  auto next = configure(flags);
  gobo::Result<std::vector<std::string>> fixed = next.ok() ? server.reload(*next) : gobo::Result<std::vector<std::string>>(next.status());
  if (!fixed.ok()) {
    if (!next.ok()) server.core().metrics.add("gobo_reloads_total", {{"result", "failed"}});
    gobo::logEvent(gobo::LogLevel::Error, "reload", {{"status", "failed"}, {"kept", "the configuration of before"}, {"error", fixed.status().toString()}});
  } else {
    std::string keys;
    for (const std::string& key : *fixed) keys += (keys.empty() ? "" : ", ") + key;
    gobo::LogFields fields{{"status", "OK"}, {"tokens", std::to_string(server.core().tokens.count())}};
    if (!keys.empty()) fields.emplace_back("not_before_restart", keys);
    gobo::logEvent(keys.empty() ? gobo::LogLevel::Info : gobo::LogLevel::Warn, "reload", fields);
  }
  gobo::notifyManager("READY=1");
}

/// 4: an address, a store or a database cannot be had just now; 2: not with this configuration.
int fail(const gobo::Status& status) {
  std::fprintf(stderr, "gobod: %s\n", gobo::escaped(status.toString()).c_str());
  return status.code() == gobo::Code::Unavailable ? 4 : 2;
}

}  // namespace

/// The exit code of what only says something: 1 where that could not be written.
static int said() {
  if (std::fflush(stdout) == 0 && !std::ferror(stdout) && std::cout.flush()) return 0;
  std::fprintf(stderr, "gobod: cannot write to standard output: %s\n", std::strerror(errno));
  return 1;
}

int main(int argc, char** argv) {
  const auto begun = std::chrono::steady_clock::now();
  gobo::FreedMemory::boundMalloc();
  Flags flags;
  bool check = false, version = false;
  CLI::App app("gobod: the Gobo rendering daemon");
  app.add_option("--config", flags.configFile, "TOML configuration; configs/gobod.toml documents every key")->envname("GOBO_CONFIG");
  app.add_option("--listen", flags.listen, "unix:PATH or 127.0.0.1:PORT; repeat for several; default " + gobo::defaultAddress());
  app.add_option("--root", flags.roots, "folder under which scene and environment files may be opened; repeat for several");
  app.add_option("--cache", flags.cache, "folder of the disk cache")->envname("GOBO_CACHE");
  app.add_option("--store", flags.store, "bytes of the term store, such as 4GiB")->envname("GOBO_STORE");
  app.add_option("--threads", flags.threads, "render threads; 0: all")->check(CLI::Range(0, 1024))->envname("GOBO_THREADS");
  app.add_option("--log", flags.logLevel, "debug, info, warn, error, off")->envname("GOBO_LOG");
  app.add_option("--log-format", flags.logFormat, "text, json")->envname("GOBO_LOG_FORMAT");
  app.add_option("--http", flags.http, "HOST:PORT of /metrics, /health and /ready")->envname("GOBO_HTTP");
  app.add_option("--web", flags.web, "HOST:PORT of the viewer in a browser and of calls over HTTP")->envname("GOBO_WEB");
  app.add_option("--tmp", flags.tmp, "folder for uploads")->envname("GOBO_TMP");
  app.add_option("--jobs-store", flags.jobsStore, "postgresql://... of the queue that several daemons share (jobs.store)")->envname("GOBO_JOBS_STORE");
  app.add_option("--worker", flags.worker, "render frames of the jobs of the daemon at this address (farm.coordinator; docs/farm.md)")->envname("GOBO_WORKER");
  app.add_option("--worker-name", flags.workerName, "how the coordinator calls this worker; the host's name")->envname("GOBO_WORKER_NAME");
  app.add_flag("--check", check, "check the configuration and leave");
  app.add_flag("--version", version, "print the version");
  app.footer(
      "Flags override the environment, which overrides the configuration file: GOBO_LISTEN and GOBO_ROOT (several with commas\n"
      "between them), GOBO_CONFIG, GOBO_CACHE, GOBO_STORE, GOBO_THREADS, GOBO_LOG, GOBO_LOG_FORMAT, GOBO_HTTP, GOBO_WEB, GOBO_TMP,\n"
      "GOBO_JOBS_STORE, GOBO_WORKER, GOBO_WORKER_NAME. A worker without --listen has no socket of its own.\n"
      "SIGTERM and SIGINT drain: running renders finish (scheduler.drain_s), a\n"
      "second signal ends at once. SIGHUP reads the configuration again. Exit codes: 0 ok, 1 what ran did not end,\n"
      "2 bad configuration, 4 an address or the jobs' database cannot be had.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) { return app.exit(e) == 0 ? said() : 2; }
  if (flags.listen.empty()) flags.listen = listOf(std::getenv("GOBO_LISTEN"));
  if (flags.roots.empty()) flags.roots = listOf(std::getenv("GOBO_ROOT"));
  if (version) {
    std::printf("gobod %s\n", gobo::buildVersion().c_str());
    return said();
  }
  auto configured = configure(flags);
  if (!configured.ok()) return fail(configured.status());
  const gobo::ServerConfig& config = *configured;
  if (check) {
    if (config.tls.on())
      if (const auto tls = gobo::readTls(config.tls); !tls.ok()) return fail(tls.status());
    if (const gobo::Status color = gobo::displayTransforms(config)->check(); !color.ok()) return fail(color.at("color.ocio"));
    if (!config.jobsStore.empty())
      if (const gobo::Status store = gobo::PostgresJobStore::check(config.jobsStore); !store.ok())
        return fail({store.code(), "jobs.store: " + store.message(), store.location()});
    std::printf("gobod: configuration is fine\n");
    return said();
  }
  gobo::setLogLevel(*gobo::parseLogLevel(config.logLevel));
  gobo::setLogFormat(*gobo::parseLogFormat(config.logFormat));

  // Signals are taken by sigtimedwait below; threads made from here on inherit the mask.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  ::signal(SIGPIPE, SIG_IGN);

  // As many descriptors as this user may have: each connection takes one.
  if (rlimit files{}; ::getrlimit(RLIMIT_NOFILE, &files) == 0 && files.rlim_cur < files.rlim_max) {
    files.rlim_cur = std::min<rlim_t>(files.rlim_max, 1 << 16);
    ::setrlimit(RLIMIT_NOFILE, &files);
  }

  gobo::removeStaleUploads(config.tmpFolder);
  auto started = gobo::Server::start(config, gobo::engineOptions(config), true);
  if (!started.ok()) return fail(started.status());
  gobo::Server& server = **started;
  std::string where;
  for (const std::string& address : server.addresses()) where += (where.empty() ? "" : ", ") + address;
  if (!server.httpAddress().empty()) where += ", http://" + server.httpAddress();
  if (!server.webAddress().empty()) where += ", " + server.webAddress();
  if (server.worker()) where += (where.empty() ? "" : ", ") + ("worker " + server.worker()->name() + " of " + config.farmCoordinator);
  const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count();
  std::printf("gobod ready on %s in %.0f ms\n", where.c_str(), ms);
  std::fflush(stdout);
  gobo::logInfo("gobod %s ready on %s threads=%d", gobo::buildVersion().c_str(), where.c_str(), server.core().engine.threads());

  gobo::notifyManager("READY=1");

  const timespec tick{0, 50 * 1000 * 1000};
  const auto waitSignal = [&] { return sigtimedwait(&signals, nullptr, &tick); };
  int signal = -1;
  while (!server.core().shutdownAsked.load()) {
    signal = waitSignal();
    if (signal == SIGHUP) reload(server, flags);
    else if (signal > 0) break;
  }
  gobo::notifyManager("STOPPING=1");
  const double drainSeconds = server.core().live()->drainSeconds;
  gobo::logInfo("%s: draining for up to %.0f s", signal < 0 ? "shutdown" : strsignal(signal), drainSeconds);
  std::atomic<bool> down{false};
  bool hurried = false;
  std::thread closer([&] {
    server.shutdown(drainSeconds);
    down.store(true);
  });
  // Whatever still runs then is left as it is: a supervisor's own patience must never be needed.
  using Seconds = std::chrono::duration<double>;
  auto kill = std::chrono::steady_clock::now() + std::chrono::duration_cast<std::chrono::steady_clock::duration>(Seconds(drainSeconds + kGraceSeconds));
  while (!down.load()) {
    if (const int again = waitSignal(); again > 0 && again != SIGHUP) {
      gobo::logWarn("second signal: cancelling what runs");
      server.core().cancelAll();
      hurried = true;
      kill = std::min(kill, std::chrono::steady_clock::now() + std::chrono::milliseconds(1500));
    }
    if (std::chrono::steady_clock::now() > kill) {  // as safe as kill -9, which leaves nothing wrong
      gobo::logWarn("what runs does not stop: leaving it");
      ::_exit(hurried ? 1 : 0);
    }
  }
  closer.join();
  gobo::logInfo("gobod stopped");
  return 0;
}
