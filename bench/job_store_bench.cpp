// SPDX-License-Identifier: Apache-2.0
// What a queue costs: claim and complete in a store with many frames queued, by one to eight connections at once, each on a thread with a store of
// its own, as a daemon has. SQLite in a folder, PostgreSQL in a private server there (fsync on for both).
// Usage: job_store_bench [--frames N] [--seconds S] [FOLDER]; a table, milliseconds.
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <functional>
#include <thread>

#include "latencies.h"
#include "server/jobs/postgres_job_store.h"
#include "server/jobs/sqlite_job_store.h"
#include "support/postgres_server.h"

using namespace gobo;

namespace {

using Store = std::unique_ptr<SqlJobStore>;
using BenchClock = std::chrono::steady_clock;

using bench::quantile;

void fill(SqlJobStore& store, int frames, int jobs) {
  for (int j = 0; j < jobs; ++j) {
    NewJob job;
    job.spec.mutable_request()->set_scene("cornell");
    job.spec.set_max_attempts(3);
    job.client = "c" + std::to_string(j % 3);
    for (int i = 0; i < frames / jobs; ++i) job.frames.push_back(i);
    bool existed = false;
    if (!store.submit(job, existed).ok()) std::abort();
  }
}

void race(const char* name, const std::function<Store()>& open, int connections, double seconds) {
  std::vector<std::vector<double>> claims(static_cast<size_t>(connections)), ends(static_cast<size_t>(connections));
  std::vector<Store> stores;
  for (int i = 0; i < connections; ++i) stores.push_back(open());
  const auto begun = BenchClock::now();
  std::vector<std::thread> threads;
  for (size_t i = 0; i < stores.size(); ++i)
    threads.emplace_back([&, i] {
      while (bench::millisSince(begun) < seconds * 1e3) {
        auto t = BenchClock::now();
        const auto lease = stores[i]->claim("w", 300);
        if (!lease.ok()) std::printf("%s\n", lease.status().toString().c_str());
        if (!lease.ok() || !*lease) return;
        claims[i].push_back(bench::millisSince(t));
        t = BenchClock::now();
        if (!stores[i]->complete(**lease, {}, 1).ok()) return;
        ends[i].push_back(bench::millisSince(t));
      }
    });
  for (auto& t : threads) t.join();
  const double took = bench::millisSince(begun) / 1e3;
  std::vector<double> claim, end;
  for (size_t i = 0; i < claims.size(); ++i) {
    claim.insert(claim.end(), claims[i].begin(), claims[i].end());
    end.insert(end.end(), ends[i].begin(), ends[i].end());
  }
  std::printf("%-10s %d connections  claim p50 %6.2f p99 %7.2f   complete p50 %6.2f p99 %7.2f   %6.0f frames/s\n", name, connections, quantile(claim, 0.5),
              quantile(claim, 0.99), quantile(end, 0.5), quantile(end, 0.99), double(end.size()) / took);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  int frames = 100000;
  double seconds = 5;
  std::string folder = std::filesystem::temp_directory_path();
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--frames") && i + 1 < argc) frames = std::atoi(argv[++i]);
    else if (!std::strcmp(argv[i], "--seconds") && i + 1 < argc) seconds = std::atof(argv[++i]);
    else folder = argv[i];
  }
  for (const int jobs : {1, 100}) {
    std::printf("%d frames queued in %d jobs of %d clients\n", frames, jobs, std::min(jobs, 3));
    const std::string path = folder + "/gobo-job-bench-" + std::to_string(::getpid()) + ".sqlite";
    const auto sqlite = [&]() -> Store { return std::move(*SqliteJobStore::open(path)); };
    fill(*sqlite(), frames, jobs);
    for (const int n : {1, 2, 4, 8}) race("SQLite", sqlite, n, seconds);
    for (const char* tail : {"", "-wal", "-shm"}) std::filesystem::remove(path + tail);
    if (!test::PostgresServer::installed()) continue;
    test::PostgresServer server(true);
    const auto postgres = [&]() -> Store { return std::move(*PostgresJobStore::open(server.uri())); };
    fill(*postgres(), frames, jobs);
    for (const int n : {1, 2, 4, 8}) race("PostgreSQL", postgres, n, seconds);
  }
  return 0;
}
