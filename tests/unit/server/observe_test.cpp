// SPDX-License-Identifier: Apache-2.0
// Log formats, the metrics' text, the load gate, the rate of a token, the lock beside a socket.
#include <gtest/gtest.h>
#include <stdlib.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <limits>
#include <thread>

#include <nlohmann/json.hpp>

#include "server/auth.h"
#include "server/load_gate.h"
#include "server/log.h"
#include "server/metrics.h"
#include "server/unix_socket.h"

namespace gobo::observe_test {
namespace {

class LogLines : public ::testing::Test {
 protected:
  void SetUp() override {
    setLogSink([this](const std::string& line) { lines.push_back(line); });
    setLogLevel(LogLevel::Info);
  }
  void TearDown() override {
    setLogSink({});
    setLogFormat(LogFormat::Text);
    setLogLevel(LogLevel::Info);
  }
  std::vector<std::string> lines;
};

TEST_F(LogLines, TextQuotesWhatIsNotOneWord) {
  logEvent(LogLevel::Info, "render", {{"scene", "cornell"}, {"error", "no \"x\" here"}, {"empty", ""}, {"forged", "a\nERROR b"}});
  logEvent(LogLevel::Debug, "unseen", {});
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(lines[0].substr(24), " INFO render scene=cornell error=\"no \\\"x\\\" here\" empty=\"\" forged=\"a\\x0aERROR b\"");
}

TEST_F(LogLines, JsonIsJsonWhateverTheClientSent) {
  setLogFormat(LogFormat::Json);
  const std::string odd = std::string("\x00\x01\n\"\\\x7f", 6) + "\xc3\xa9 \xff \xed\xa0\x80 \xc0\xaf \xf0\x9f\x98\x80 \xe2\x82";
  logEvent(LogLevel::Warn, "render", {{"scene", odd}});
  logWarn("free %d", 3);
  ASSERT_EQ(lines.size(), 2u);
  const auto j = nlohmann::json::parse(lines[0]);  // throws on bytes that are no UTF-8
  EXPECT_EQ(j["level"], "WARN");
  EXPECT_EQ(j["event"], "render");
  const std::string scene = j["scene"];
  EXPECT_EQ(scene.substr(0, 6), std::string("\x00\x01\n\"\\\x7f", 6));
  EXPECT_NE(scene.find("\xc3\xa9 \xef\xbf\xbd "), std::string::npos);
  EXPECT_NE(scene.find("\xf0\x9f\x98\x80"), std::string::npos) << "what is valid stays";
  EXPECT_EQ(nlohmann::json::parse(lines[1])["message"], "free 3");
}

TEST_F(LogLines, LinesCarryTheRequestOfTheirThread) {
  {
    const LogRequest outer("id-1");
    logInfo("inside");
    std::thread([] { logInfo("elsewhere"); }).join();
  }
  logInfo("after");
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_NE(lines[0].find("inside request=id-1"), std::string::npos);
  EXPECT_EQ(lines[1].find("id-1"), std::string::npos);
  EXPECT_EQ(lines[2].find("id-1"), std::string::npos);
}

TEST(MetricsText, CountersHistogramsAndEscapes) {
  Metrics m;
  m.counter("c_total", "Things.");
  m.histogram("h_seconds", "Times.", {0.1, 1});
  m.add("c_total", {{"k", "a\"b\\c\nd"}}, 2);
  m.add("c_total", {{"k", "a\"b\\c\nd"}});
  for (const double v : {0.05, 0.1, 0.5, 7.0}) m.observe("h_seconds", {}, v);
  m.collect([](MetricsWriter& out) {
    out.family("g", "gauge", "Now.");
    out.sample("g", {}, 1.5);
    out.sample("g", {{"x", "y"}}, std::numeric_limits<double>::infinity());
  });
  EXPECT_EQ(m.text(),
            "# HELP c_total Things.\n# TYPE c_total counter\nc_total{k=\"a\\\"b\\\\c\\nd\"} 3\n"
            "# HELP h_seconds Times.\n# TYPE h_seconds histogram\nh_seconds_bucket{le=\"0.1\"} 2\nh_seconds_bucket{le=\"1\"} 3\n"
            "h_seconds_bucket{le=\"+Inf\"} 4\nh_seconds_sum 7.65\nh_seconds_count 4\n# HELP g Now.\n# TYPE g gauge\ng 1.5\ng{x=\"y\"} +Inf\n");
  EXPECT_EQ(m.value("h_seconds"), 4);
}

TEST(Gate, BoundsWhatRunsAndPassesStops) {
  LoadGate gate;
  gate.setLimit(2);
  std::atomic<int> running{0}, most{0}, done{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 6; ++i)
    threads.emplace_back([&, i] {
      const Status s = gate.run(
          "client " + std::to_string(i),
          [&](const StopToken&) -> Status {
            const int now = ++running;
            int seen = most.load();
            while (now > seen && !most.compare_exchange_weak(seen, now)) {}
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
            --running;
            return {};
          },
          [] { return false; });
      done += s.ok();
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(done, 6);
  EXPECT_LE(most, 2);
  // The caller leaves while the work runs: the token says so, and the work's own answer counts.
  const Status stopped = gate.run(
      "someone",
      [](const StopToken& stop) -> Status {
        for (int i = 0; i < 5000 && !stop.stopRequested(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        return {stop.stopRequested() ? Code::Cancelled : Code::Internal, "ended"};
      },
      [] { return true; });
  EXPECT_EQ(stopped.code(), Code::Cancelled);
  const Status thrown = gate.run(
      "someone", [](const StopToken&) -> Status { throw std::runtime_error("boom"); }, [] { return false; });
  EXPECT_EQ(thrown.code(), Code::Internal);
  EXPECT_NE(thrown.message().find("boom"), std::string::npos);
  EXPECT_EQ(gate.running(), 0u);
}

struct Loads {
  LoadGate gate;
  std::atomic<bool> release{false};
  std::mutex mutex;
  std::vector<std::string> order;  // in which clients got their place
  std::vector<std::thread> threads;
  Status run(const std::string& client) {
    return gate.run(
        client,
        [&, client](const StopToken&) -> Status {
          {
            const std::lock_guard lock(mutex);
            order.push_back(client);
          }
          while (!release) std::this_thread::sleep_for(std::chrono::milliseconds(1));
          return {};
        },
        [] { return false; });
  }
  void start(const std::string& client, uint32_t running, uint32_t waiting) {
    threads.emplace_back([this, client] { EXPECT_TRUE(run(client).ok()); });
    for (int i = 0; i < 20000 && (gate.running() != running || gate.waiting() != waiting); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    EXPECT_EQ(gate.running(), running);
    EXPECT_EQ(gate.waiting(), waiting);
  }
  /// Who got a place, in order, once `n` have.
  std::vector<std::string> served(size_t n) {
    for (int i = 0; i < 20000; ++i, std::this_thread::sleep_for(std::chrono::milliseconds(1))) {
      const std::lock_guard lock(mutex);
      if (order.size() >= n) return order;
    }
    return {};
  }
  ~Loads() {
    release = true;
    for (auto& t : threads) t.join();
  }
};

TEST(Gate, RefusesWhenTooManyWait) {
  Loads loads;
  loads.gate.setLimit(1);
  loads.start("a", 1, 0);
  for (uint32_t i = 0; i < LoadGate::kWaitingOfOne; ++i) loads.start("a", 1, i + 1);
  const Status mine = loads.run("a");
  EXPECT_EQ(mine.code(), Code::ResourceExhausted);
  EXPECT_NE(mine.message().find("16 of one client"), std::string::npos) << mine.message();
  for (uint32_t i = LoadGate::kWaitingOfOne; i < LoadGate::kWaiting; ++i) loads.start("b", 1, i + 1);  // others still may
  EXPECT_EQ(loads.run("c").code(), Code::ResourceExhausted);
}

// Whoever has many slow loads leaves a place, and the next free one is not his.
TEST(Gate, OneClientNeverHoldsEveryPlace) {
  Loads loads;
  loads.gate.setLimit(2);
  loads.start("greedy", 1, 0);
  for (uint32_t i = 1; i <= 3; ++i) loads.start("greedy", 1, i);
  loads.start("other", 2, 3);
  EXPECT_EQ(loads.served(2), (std::vector<std::string>{"greedy", "other"}));
}

TEST(Gate, PlacesGoToWhoWasServedLongestAgo) {
  LoadGate gate;
  gate.setLimit(1);
  std::mutex mutex;
  std::vector<std::string> order;
  std::atomic<bool> release{false};
  std::vector<std::thread> threads;
  const auto start = [&](const std::string& client, uint32_t waiting) {
    threads.emplace_back([&, client] {
      EXPECT_TRUE(gate.run(
                          client,
                          [&](const StopToken&) -> Status {
                            while (!release) std::this_thread::sleep_for(std::chrono::milliseconds(1));
                            const std::lock_guard lock(mutex);
                            order.push_back(client);
                            return {};
                          },
                          [] { return false; })
                      .ok());
    });
    while (gate.running() != 1 || gate.waiting() != waiting) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  start("a", 0);
  for (uint32_t i = 1; i <= 3; ++i) start("a", i);
  start("b", 4);
  start("c", 5);
  release = true;
  for (auto& t : threads) t.join();
  EXPECT_EQ(order, (std::vector<std::string>{"a", "b", "c", "a", "a", "a"}));
}

// Oracle: a bucket of `burst` that fills with `rate` gives burst + rate * T requests in T seconds, whatever the steps.
TEST(TokenRate, BurstAndLongRun) {
  Principal who;
  auto config = std::make_shared<TokenConfig>();
  config->requestsPerSecond = 4;
  config->burst = 3;
  who.token = config;
  who.use = std::make_shared<TokenUse>();
  int taken = 0;
  for (int i = 0; i <= 1000; ++i) taken += who.takeRequest(100 + i * 0.01) == 0;  // 10 s
  EXPECT_NEAR(taken, 43, 1);
  EXPECT_NEAR(who.takeRequest(110), 0.25, 0.251);
  EXPECT_EQ(who.takeRequest(1000), 0);
  EXPECT_EQ(who.takeRequest(1000), 0);
  EXPECT_EQ(who.takeRequest(1000), 0);
  EXPECT_NEAR(who.takeRequest(1000), 0.25, 1e-9) << "idle time saves no more than the burst";
}

TEST(SocketLockFile, OneHolderAndNoLitter) {
  std::string folder = (std::filesystem::temp_directory_path() / "gobo-lock-XXXXXX").string();
  ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  const std::string path = folder + "/s.sock";
  {
    auto first = SocketLock::take(path);
    ASSERT_TRUE(first.ok());
    const std::chrono::milliseconds soon(50);
    EXPECT_EQ(SocketLock::take(path, soon).status().code(), Code::Unavailable);
    EXPECT_TRUE(std::filesystem::exists(path + ".lock")) << "a refused taker leaves the holder's file";
    EXPECT_EQ(SocketLock::take(path, soon).status().code(), Code::Unavailable);
  }
  EXPECT_FALSE(std::filesystem::exists(path + ".lock"));
  // Threads that take and give back: never two at once.
  std::atomic<int> holders{0}, wins{0};
  std::atomic<bool> twice{false};
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&] {
      for (int k = 0; k < 300; ++k)
        if (auto lock = SocketLock::take(path); lock.ok()) {
          if (++holders > 1) twice = true;
          ++wins;
          std::this_thread::yield();
          --holders;
        }
    });
  for (auto& t : threads) t.join();
  EXPECT_FALSE(twice);
  EXPECT_GT(wins, 0);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace gobo::observe_test
