// SPDX-License-Identifier: Apache-2.0
// Files that lose their bytes while they are mapped: who reads goes on, the mapping says so from then on, and every other SIGBUS still ends the
// process. Without the handler the first of these tests does.
#include "base/mapped_file.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "base/descriptor.h"
#include "base/mapped_faults.h"

namespace gobo::mapped_file_test {
namespace {

constexpr size_t kPage = 4096;

struct MappedFiles : ::testing::Test {
  std::vector<std::string> made;
  void TearDown() override {
    for (const std::string& p : made) ::unlink(p.c_str());
  }
  /// A file of `bytes` sevens.
  std::string sevens(size_t bytes) {
    std::string path = ::testing::TempDir() + "/gobo-mapped-XXXXXX";
    const Descriptor d{::mkstemp(path.data())};
    made.push_back(path);
    const std::string text(bytes, 7);
    EXPECT_EQ(::write(d.get(), text.data(), text.size()), ssize_t(bytes));
    return path;
  }
  static std::shared_ptr<const MappedFile> mapped(const std::string& path) {
    auto m = MappedFile::open(path);
    EXPECT_TRUE(m.ok()) << m.status().toString();
    return m.ok() ? *m : nullptr;
  }
  static uint64_t sum(const MappedFile& m) {
    uint64_t s = 0;
    for (const uint8_t b : m.bytes()) s += b;
    return s;
  }
};

TEST_F(MappedFiles, AFileThatIsCutShortReadsAsZeroesAndSaysSo) {
  for (const size_t left : {size_t(0), size_t(1), kPage, 2 * kPage + 5, 3 * kPage - 1}) {
    const std::string path = sevens(3 * kPage), beside = sevens(3 * kPage);
    const auto cut = mapped(path), other = mapped(beside);
    EXPECT_EQ(sum(*cut), 7u * 3 * kPage);
    EXPECT_TRUE(cut->intact());
    ASSERT_EQ(::truncate(path.c_str(), off_t(left)), 0);
    EXPECT_LE(sum(*cut), 7u * left);
    EXPECT_FALSE(cut->intact()) << left << " bytes left";
    EXPECT_EQ(cut->lost().code(), Code::DataLoss);
    EXPECT_EQ(cut->lost().location(), path);
    ASSERT_EQ(::truncate(path.c_str(), off_t(3 * kPage)), 0);
    EXPECT_FALSE(cut->intact()) << "what was read is not known any more";
    EXPECT_TRUE(other->intact());
    EXPECT_EQ(sum(*other), 7u * 3 * kPage);
  }
}

// The kernel fills the rest of the new last page with zeroes and raises nothing there.
TEST_F(MappedFiles, ACutThatRaisesNoSignalIsFoundToo) {
  const std::string path = sevens(3 * kPage - 100);
  const auto cut = mapped(path);
  ASSERT_EQ(::truncate(path.c_str(), off_t(kPage + 50)), 0);
  uint64_t page = 0;
  for (size_t i = kPage; i < 2 * kPage; ++i) page += cut->bytes()[i];
  EXPECT_EQ(page, 7u * 50);
  EXPECT_FALSE(cut->intact());
  const std::string little = sevens(100);
  const auto few = mapped(little);
  ASSERT_EQ(::truncate(little.c_str(), 60), 0);
  EXPECT_FALSE(few->intact());
}

// A patch a page would take more mappings than a process may have (65530), and 80000 signals.
TEST_F(MappedFiles, AnEmptiedFileOfManyPagesIsOneFault) {
  const std::string path = sevens(kPage);
  ASSERT_EQ(::truncate(path.c_str(), off_t(80000 * kPage)), 0);
  const auto large = mapped(path);
  EXPECT_EQ(sum(*large), 7u * kPage);
  ASSERT_EQ(::truncate(path.c_str(), 0), 0);
  uint64_t read = 0;
  for (size_t i = 0; i < large->bytes().size(); i += 2 * kPage) read += large->bytes()[i];
  EXPECT_EQ(read, 0u);
  EXPECT_FALSE(large->intact());
}

TEST_F(MappedFiles, ManyThreadsReadOnWhileOthersMapAndUnmap) {
  for (int round = 0; round < 10; ++round) {
    const std::string path = sevens(64 * kPage), whole = sevens(2 * kPage);
    const auto cut = mapped(path);
    std::atomic<bool> over{false};
    std::atomic<int> wrong{0};
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t)
      threads.emplace_back([&] {
        while (!over.load()) {
          const uint64_t s = sum(*cut);
          if (s != 7u * 64 * kPage && cut->intact()) ++wrong;
        }
      });
    for (int t = 0; t < 2; ++t)
      threads.emplace_back([&] {
        while (!over.load()) {
          const auto m = mapped(whole);
          if (sum(*m) != 7u * 2 * kPage || !m->intact()) ++wrong;
        }
      });
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    ASSERT_EQ(::truncate(path.c_str(), 0), 0);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    over.store(true);
    for (std::thread& t : threads) t.join();
    EXPECT_EQ(wrong.load(), 0);
    EXPECT_FALSE(cut->intact());
  }
}

/// How a child ends that does `what`: whether a signal, or a sanitizer's report of one, ended it.
template <typename F>
bool dies(F&& what) {
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::close(STDERR_FILENO);
    what();
    ::_exit(0);
  }
  int status = 0;
  ::waitpid(pid, &status, 0);
  return !(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

TEST_F(MappedFiles, ASigbusElsewhereStillEndsTheProcess) {
  const std::string watched = sevens(kPage), path = sevens(2 * kPage);
  const auto m = mapped(watched);
  const Descriptor d{::open(path.c_str(), O_RDWR)};
  const auto* raw = static_cast<const volatile uint8_t*>(::mmap(nullptr, 2 * kPage, PROT_READ, MAP_SHARED, d.get(), 0));
  ASSERT_NE(raw, MAP_FAILED);
  ASSERT_EQ(::ftruncate(d.get(), 0), 0);
  EXPECT_TRUE(dies([&] { (void)raw[kPage]; }));
  EXPECT_TRUE(dies([&] { ::raise(SIGBUS); })) << "sent, not a fault";
  EXPECT_FALSE(dies([&] {
    ASSERT_EQ(::truncate(watched.c_str(), 0), 0);
    (void)*static_cast<const volatile uint8_t*>(m->bytes().data());
  })) << "the handler is inherited by a fork";
  EXPECT_FALSE(m->intact()) << "the file is cut here as well";
  ::munmap(const_cast<uint8_t*>(raw), 2 * kPage);
}

TEST_F(MappedFiles, WhoWantsToKnowOfOtherBusErrorsIsTold) {
  const auto m = mapped(sevens(kPage));
  EXPECT_TRUE(dies([] {
    ::signal(SIGBUS, SIG_DFL);
    if (runOnOtherBusError([](int) {})) ::_exit(0);  // the handler is not in place: it would never be run
    ::raise(SIGBUS);
  }));
}

}  // namespace
}  // namespace gobo::mapped_file_test
