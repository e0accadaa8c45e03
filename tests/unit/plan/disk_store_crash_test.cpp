// SPDX-License-Identifier: Apache-2.0
// DiskStore with several processes: a kill after every single step, kills at random moments, and two writers in one folder.
// Children are forked before this process opens the store, touch nothing of gtest and leave by _exit or SIGKILL.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <utility>

#include "plan/disk_store.h"
#include "terms/term_file.h"
#include "unit/plan/term_maker.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;
using test::fileOf;
using test::key;
using test::makeTerm;
using test::TempFolder;
using test::termFiles;

constexpr int kKeys = 40;

uint64_t next(uint64_t& state) {
  state = state * 6364136223846793005ull + 1442695040888963407ull;
  return state >> 33;
}
int sizeOf(int i) { return 100 + i * 40; }  // elements: files of 0.6 to 9 kB

template <typename F>
pid_t spawn(F work) {
  const pid_t child = ::fork();
  if (child == 0) {
    work();
    ::_exit(0);
  }
  return child;
}

/// Reads, writes and evicts `rounds` times (0: for ever); exit code 1: a wrong term, 2: an error, 3: over the bound. `begun`: is told of
/// the first change, if it is not -1.
void churn(const std::string& folder, uint64_t maxBytes, uint64_t seed, int rounds, int begun = -1) {
  auto store = DiskStore::open(folder, maxBytes);
  if (!store.ok()) ::_exit(2);
  for (int n = 0; rounds == 0 || n < rounds; ++n) {
    const int i = int(next(seed) % kKeys);
    if (next(seed) % 3 == 0) {
      const TermPtr term = (*store)->get(key(i));
      if (term && term->content() != makeTerm(i, sizeOf(i))->content()) ::_exit(1);
    } else if (!(*store)->put(key(i), *makeTerm(i, sizeOf(i))).ok()) {
      ::_exit(2);
    } else if (begun >= 0) {
      (void)!::write(begun, "b", 1);
      ::close(std::exchange(begun, -1));
    }
    if ((*store)->bytes() > maxBytes) ::_exit(3);
  }
}

/// What must hold after any crash, once one process has opened the folder again.
void expectSound(const std::string& folder, uint64_t maxBytes, const std::string& what) {
  DiskStoreOptions options;
  options.maxBytes = maxBytes;
  options.staleTempSeconds = 0;  // no writer lives
  auto opened = DiskStore::open(folder, options);
  ASSERT_TRUE(opened.ok()) << what << ": " << opened.status().toString();
  auto& store = *opened;
  const auto files = termFiles(folder);
  EXPECT_EQ(store->count(), files.count) << what;
  EXPECT_EQ(store->bytes(), files.bytes) << what;
  EXPECT_LE(files.bytes, maxBytes) << what;
  EXPECT_TRUE(fs::is_empty(folder + "/tmp")) << what;
  uint64_t readable = 0;
  for (int i = 0; i < kKeys; ++i) {
    const bool there = fs::exists(fileOf(folder, i));
    const TermPtr term = store->get(key(i));
    EXPECT_EQ(term != nullptr, there) << what;  // rename after the sync: what has its name is whole
    readable += term != nullptr;
    EXPECT_TRUE(!term || term->content() == makeTerm(i, sizeOf(i))->content()) << what;
  }
  EXPECT_EQ(readable, files.count) << what;
  EXPECT_EQ(store->stats().damaged, 0u) << what;
}

TEST(DiskStoreCrash, KilledAfterEachStepOfAPutThatEvicts) {
  const uint64_t bound = serializeTerm(*makeTerm(30, sizeOf(30)), key(30)).size() + 100;
  for (const char* at : {"create", "write", "sync", "evict", "unlink", "rename", "commit", "sync-folder", "done"}) {
    TempFolder folder;
    const pid_t child = spawn([&] {
      DiskStoreOptions options;
      options.maxBytes = bound;
      bool armed = false;
      options.step = [&](const char* step) {
        if (armed && std::strcmp(step, at) == 0) ::kill(::getpid(), SIGKILL);
        return 0;
      };
      auto store = DiskStore::open(folder.path, options);
      for (int i = 0; i < 4; ++i)
        if (!(*store)->put(key(i), *makeTerm(i, sizeOf(i))).ok()) ::_exit(2);
      armed = true;
      if (!(*store)->put(key(30), *makeTerm(30, sizeOf(30))).ok()) ::_exit(2);
    });
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status)) << "step never came: " << at;
    expectSound(folder.path, bound, at);
    const bool durable = std::strcmp(at, "sync-folder") == 0 || std::strcmp(at, "done") == 0 || std::strcmp(at, "commit") == 0;
    EXPECT_EQ(fs::exists(fileOf(folder.path, 30)), durable) << at;
  }
}

TEST(DiskStoreCrash, SurvivorGoesOnWhileAnotherIsKilledHoldingTheFolder) {
  TempFolder folder;
  const uint64_t bound = 60000;
  auto survivor = DiskStore::open(folder.path, bound);  // opened here; the child opens its own
  const pid_t child = spawn([&] {
    DiskStoreOptions options;
    options.maxBytes = bound;
    options.step = [](const char* step) {
      static int commits = 0;
      if (std::strcmp(step, "commit") == 0 && ++commits == 4) ::kill(::getpid(), SIGKILL);  // after the rename
      return 0;
    };
    auto store = DiskStore::open(folder.path, options);
    for (int i = 0; i < 10; ++i) (void)(*store)->put(key(i), *makeTerm(i, sizeOf(i)));
  });
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  const auto files = termFiles(folder.path);
  EXPECT_EQ(files.count, (*survivor)->count() + 1);  // the one renamed but not committed
  for (int i = 0; i < 10; ++i) (void)(*survivor)->get(key(i));
  ASSERT_TRUE((*survivor)->put(key(20), *makeTerm(20, sizeOf(20))).ok());
  EXPECT_EQ((*survivor)->bytes(), termFiles(folder.path).bytes);  // came across it, took it in
  EXPECT_EQ((*survivor)->stats().adopted, 1u);
}

// Instrumented children take that much longer to have written anything.
#if defined(__SANITIZE_ADDRESS__) || defined(GOBO_THREAD_SANITIZER)
constexpr int kPatience = 12;
#else
constexpr int kPatience = 1;
#endif

TEST(DiskStoreCrash, KilledAtRandomMomentsThirtyTimes) {
  TempFolder folder;
  const uint64_t bound = 60000;
  uint64_t random = 4711;
  int kills = 0;
  for (int round = 0; round < 30; ++round) {
    int begun[2];
    ASSERT_EQ(::pipe(begun), 0);
    const pid_t child = spawn([&] { churn(folder.path, bound, 100 + uint64_t(round), 0, begun[1]); });
    ::close(begun[1]);
    // Every other kill counts from the first change: on a busy machine a child may need longer than all of its time to come to it.
    char byte;
    if (round % 2 == 0) { EXPECT_EQ(::read(begun[0], &byte, 1), 1); }
    ::usleep(kPatience * (2000 + useconds_t(next(random) % 18000)));
    ::kill(child, SIGKILL);
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ::close(begun[0]);  // not before: a child that still writes must not die of it
    ASSERT_TRUE(WIFSIGNALED(status)) << "child left by itself with " << WEXITSTATUS(status);
    ++kills;
    if (round % 3 == 2) expectSound(folder.path, bound, "kill " + std::to_string(round));  // else crash upon crash
  }
  EXPECT_EQ(kills, 30);
  EXPECT_GT(termFiles(folder.path).count, 3u);
}

TEST(DiskStoreCrash, TwoProcessesWriteReadAndEvictInOneFolder) {
  TempFolder folder;
  const uint64_t bound = 50000;  // a quarter of all terms
  for (int c = 0; c < 2; ++c) spawn([&] { churn(folder.path, bound, 7 + uint64_t(c), 250); });
  uint64_t worst = 0;
  for (int left = 2; left > 0;) {
    worst = std::max(worst, termFiles(folder.path).bytes);
    int status = 0;
    const pid_t gone = ::waitpid(-1, &status, WNOHANG);
    if (gone <= 0) continue;
    --left;
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << "exit code " << WEXITSTATUS(status);
  }
  // A file seen here may be evicted while its followers are counted: one listing may count a term too many.
  EXPECT_LE(worst, bound + 3 * serializeTerm(*makeTerm(kKeys - 1, sizeOf(kKeys - 1)), key(kKeys - 1)).size());
  expectSound(folder.path, bound, "two processes");
}

TEST(DiskStoreCrash, KillsBesideALivingWriterNeverHurtIt) {
  TempFolder folder;
  const uint64_t bound = 50000;
  const pid_t steady = spawn([&] { churn(folder.path, bound, 99, 300); });
  uint64_t random = 5;
  int status = 0;
  while (::waitpid(steady, &status, WNOHANG) == 0) {
    const pid_t victim = spawn([&] { churn(folder.path, bound, next(random), 0); });
    ::usleep(2000 + useconds_t(next(random) % 10000));
    ::kill(victim, SIGKILL);
    ASSERT_EQ(::waitpid(victim, nullptr, 0), victim);
  }
  EXPECT_TRUE(WIFEXITED(status) && (WEXITSTATUS(status) == 0 || WEXITSTATUS(status) == 3)) << status;
  expectSound(folder.path, bound, "kills beside a writer");
}

}  // namespace
}  // namespace gobo
