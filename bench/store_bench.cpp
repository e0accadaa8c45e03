// SPDX-License-Identifier: Apache-2.0
// What the tiers cost: MB/s of DiskStore put (with and without the sync), get, serialise and parse, and get by TermStore.
// Usage: store_bench [FOLDER] (default: the temp folder); medians, JSON lines.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>

#include "plan/disk_store.h"
#include "plan/store.h"
#include "terms/term_file.h"

using namespace gobo;

namespace {

std::shared_ptr<Term> makeTerm(uint32_t seed, size_t bytes) {
  auto term = std::make_shared<Term>("bench", Domain::List, Extent{int(bytes / 4), 1, 1});
  for (uint32_t& v : term->addPlane<uint32_t>("v")) v = seed = seed * 1664525u + 1013904223u;
  return term;
}

template <typename F>
double medianSeconds(int runs, F f) {
  std::vector<double> times;
  for (int i = 0; i < runs; ++i) {
    const auto from = std::chrono::steady_clock::now();
    f(i);
    times.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - from).count());
  }
  std::nth_element(times.begin(), times.begin() + runs / 2, times.end());
  return times[size_t(runs) / 2];
}

}  // namespace

int main(int argc, char** argv) {
  const std::string folder =
      std::string(argc > 1 ? argv[1] : std::filesystem::temp_directory_path().c_str()) + "/gobo-store-bench-" + std::to_string(::getpid());
  for (const size_t bytes : {size_t(64) << 10, size_t(1) << 20, size_t(32) << 20}) {
    auto opened = DiskStore::open(folder, 2ull << 30);
    if (!opened.ok()) return std::fprintf(stderr, "%s\n", opened.status().toString().c_str()), 1;
    const int runs = bytes > (8u << 20) ? 5 : 21;
    std::vector<std::shared_ptr<Term>> terms;
    for (int i = 0; i < runs; ++i) terms.push_back(makeTerm(uint32_t(i + 1), bytes));
    const auto keyOf = [](int i) { return Hasher("bench").add(i).digest(); };
    const double put = medianSeconds(runs, [&](int i) {
      if (!(*opened)->put(keyOf(i), *terms[size_t(i)]).ok()) std::abort();
    });
    const double get = medianSeconds(runs, [&](int i) {
      if (!(*opened)->get(keyOf(i))) std::abort();
    });
    std::vector<uint8_t> file;
    const double serialise = medianSeconds(runs, [&](int i) { file = serializeTerm(*terms[size_t(i)], keyOf(i)); });
    const double parse = medianSeconds(runs, [&](int) {
      if (!parseTerm(file.data(), file.size(), keyOf(runs - 1))) std::abort();
    });
    (*opened)->clear();
    TermStore store(1ull << 30, std::move(*opened));
    store.put(keyOf(0), terms[0], false);
    const double memory = medianSeconds(101, [&](int) {
      if (!store.get(keyOf(0))) std::abort();
    });
    const double mb = double(bytes) * 1e-6;
    std::printf(
        "{\"bench\":\"store\",\"term_mb\":%.3f,\"put_ms\":%.3f,\"put_mb_s\":%.0f,\"get_mb_s\":%.0f,\"serialise_mb_s\":%.0f,"
        "\"parse_mb_s\":%.0f,\"memory_get_us\":%.2f}\n",
        mb, put * 1e3, mb / put, mb / get, mb / serialise, mb / parse, memory * 1e6);
  }
  std::filesystem::remove_all(folder);
}
