// SPDX-License-Identifier: Apache-2.0
// gobod: the rendering daemon. docs/operations.md describes its configuration and its life.
#include <signal.h>
#include <string.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <thread>

#include <CLI/CLI.hpp>

#include "server/server.h"
#include "server/upload.h"

namespace {

int fail(const gobo::Status& status) {
  std::fprintf(stderr, "gobod: %s\n", gobo::escaped(status.toString()).c_str());
  return status.code() == gobo::Code::Unavailable || status.code() == gobo::Code::FailedPrecondition ? 4 : 2;
}

}  // namespace

int main(int argc, char** argv) {
  const auto begun = std::chrono::steady_clock::now();
  std::string configFile, cache, logLevel, tmp, store;
  std::vector<std::string> listen, roots;
  int threads = -1;
  bool check = false, version = false;
  CLI::App app("gobod: the Gobo rendering daemon");
  app.add_option("--config", configFile, "TOML configuration; configs/gobod.toml documents every key");
  app.add_option("--listen", listen, "unix:PATH or 127.0.0.1:PORT; repeat for several; default " + gobo::defaultAddress());
  app.add_option("--root", roots, "folder under which scene and environment files may be opened; repeat for several");
  app.add_option("--cache", cache, "folder of the disk cache");
  app.add_option("--store", store, "bytes of the term store, such as 4GiB");
  app.add_option("--threads", threads, "render threads; 0: all")->check(CLI::Range(0, 1024));
  app.add_option("--log", logLevel, "debug, info, warn, error, off");
  app.add_option("--tmp", tmp, "folder for uploads");
  app.add_flag("--check", check, "check the configuration and leave");
  app.add_flag("--version", version, "print the version");
  app.footer("Flags override the configuration file. SIGTERM and SIGINT drain: running renders finish (scheduler.drain_s), a\n"
             "second signal cancels them. Exit codes: 0 ok, 2 bad configuration, 4 address in use.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  if (version) {
    std::printf("gobod %s\n", gobo::buildVersion().c_str());
    return 0;
  }
  gobo::ServerConfig config;
  if (!configFile.empty())
    if (const auto status = gobo::readConfig(configFile, config); !status.ok()) return fail(status);
  if (!listen.empty()) config.listen = listen;
  if (!roots.empty()) config.roots = roots;
  if (!cache.empty()) config.cacheFolder = cache;
  if (threads >= 0) config.threads = threads;
  if (!logLevel.empty()) config.logLevel = logLevel;
  if (!tmp.empty()) config.tmpFolder = tmp;
  if (!store.empty()) {
    auto bytes = gobo::parseBytes(store);
    if (!bytes.ok()) return fail(bytes.status().at("--store"));
    config.storeBytes = *bytes;
  }
  if (const auto status = gobo::checkConfig(config); !status.ok()) return fail(status);
  if (check) {
    std::printf("gobod: configuration is fine\n");
    return 0;
  }
  gobo::setLogLevel(*gobo::parseLogLevel(config.logLevel));

  // Signals are taken by sigtimedwait below; threads made from here on inherit the mask.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  ::signal(SIGPIPE, SIG_IGN);

  gobo::removeStaleUploads(config.tmpFolder);
  auto started = gobo::Server::start(config, gobo::engineOptions(config), true);
  if (!started.ok()) return fail(started.status());
  gobo::Server& server = **started;
  std::string where;
  for (const std::string& address : server.addresses()) where += (where.empty() ? "" : ", ") + address;
  const double ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count();
  std::printf("gobod ready on %s in %.0f ms\n", where.c_str(), ms);
  std::fflush(stdout);
  gobo::logInfo("gobod %s ready on %s threads=%d", gobo::buildVersion().c_str(), where.c_str(), server.core().engine.threads());

  const timespec tick{0, 50 * 1000 * 1000};
  const auto waitSignal = [&] { return sigtimedwait(&signals, nullptr, &tick); };
  int signal = -1;
  while (signal < 0 && !server.core().shutdownAsked.load()) signal = waitSignal();
  gobo::logInfo("%s: draining for up to %.0f s", signal < 0 ? "shutdown" : strsignal(signal), config.drainSeconds);
  std::atomic<bool> down{false};
  std::thread closer([&] {
    server.shutdown(config.drainSeconds);
    down.store(true);
  });
  while (!down.load())
    if (waitSignal() > 0) {
      gobo::logWarn("second signal: cancelling what runs");
      server.core().cancelAll();
    }
  closer.join();
  gobo::logInfo("gobod stopped");
  return 0;
}
