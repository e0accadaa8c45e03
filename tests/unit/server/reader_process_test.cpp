// SPDX-License-Identifier: Apache-2.0
// Readers that are forked of one process: each is on its own, ends when it is told to, and takes nobody along.
#include "server/reader_process.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>
#include <vector>

#include "base/descriptor.h"
#include "server/ingest_child.h"
#include "support/readers_left.h"

namespace gobo::reader_process_test {
namespace {

Status probe(Readers& readers, const std::string& what, const StopToken& stop = {}, uint32_t cpu = 20) {
  const Descriptor out(::memfd_create("probe", MFD_CLOEXEC));
  const auto result = runIngest(readers, {ingest::Task::Probe, what, 0, 0, 0, 256ull << 20, 8 << 20, cpu}, out.get(), 60, stop);
  return result.ok() ? Status() : result.status();
}

/// Processes of gobo-ingest that this one started itself.
std::vector<int> nurseries() {
  std::vector<int> out;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::ifstream children(task.path() / "children");
    for (int pid; children >> pid;) out.push_back(pid);
  }
  return out;
}

bool readersBecome(int number) {
  for (int tries = 0; tries < 2000; ++tries) {  // seen once: a look between a fork and what it leads to counts otherwise
    if (readersNow() == number) return true;
    ::usleep(10000);
  }
  return false;
}

class Forked : public ::testing::Test {
 protected:
  void SetUp() override {
#if defined(__SANITIZE_ADDRESS__) || defined(GOBO_THREAD_SANITIZER)
    GTEST_SKIP() << "readers are spawned under a sanitizer";
#endif
    ASSERT_FALSE(findIngestProgram().empty());
    readers = forkedReaders(findIngestProgram(), 5);
  }
  void TearDown() override { EXPECT_TRUE(noReaderIsLeft()); }
  std::shared_ptr<Readers> readers;
};

TEST_F(Forked, ManyComeOfOneProcess) {
  ASSERT_TRUE(probe(*readers, "empty").ok());
  const auto first = nurseries();
  std::vector<std::thread> together;
  for (int i = 0; i < 8; ++i) together.emplace_back([&] { EXPECT_TRUE(probe(*readers, "empty").ok()); });
  for (auto& t : together) t.join();
  EXPECT_EQ(first.size(), 1u);
  EXPECT_EQ(nurseries(), first);
  EXPECT_EQ(forkedReaders(findIngestProgram()), readers);
}

TEST_F(Forked, OneThatIsCancelledIsGoneAndTheOthersReadOn) {
  StopSource stop, other;
  Status cancelled, sleeping;
  std::thread long1([&] { cancelled = probe(*readers, "sleep", stop.token()); });
  std::thread long2([&] { sleeping = probe(*readers, "sleep", other.token()); });
  EXPECT_TRUE(readersBecome(4));  // two, each with its guard
  stop.stop(StopReason::Cancelled);
  long1.join();
  EXPECT_EQ(cancelled.code(), Code::Cancelled);
  EXPECT_TRUE(readersBecome(2));
  other.stop(StopReason::Cancelled);
  long2.join();
  EXPECT_EQ(sleeping.code(), Code::Cancelled);
}

// Where one crashed by an address that it guessed, the next guess must start anew; but whoever reads meanwhile reads on.
TEST_F(Forked, AfterACrashTheNextComesOfANewProcessAndTheOthersReadOn) {
  ASSERT_TRUE(probe(*readers, "empty").ok());
  const auto before = nurseries();
  StopSource stop;
  Status reading;
  std::thread other([&] { reading = probe(*readers, "sleep", stop.token()); });
  EXPECT_TRUE(readersBecome(2));
  const Status crashed = probe(*readers, "segv");
  EXPECT_EQ(crashed.code(), Code::InvalidArgument) << crashed.toString();
  EXPECT_TRUE(probe(*readers, "empty").ok());
  EXPECT_NE(nurseries(), before);
  EXPECT_TRUE(readersBecome(2));
  stop.stop(StopReason::Cancelled);
  other.join();
  EXPECT_EQ(reading.code(), Code::Cancelled) << reading.toString();
  const auto after = nurseries();
  EXPECT_EQ(after.size(), 1u);
  EXPECT_FALSE(probe(*readers, "spin", {}, 1).ok());  // a limit is no crash
  EXPECT_EQ(nurseries(), after);
}

TEST_F(Forked, OneWhoseProcessIsKilledIsAnErrorAndTheNextOneReads) {
  ASSERT_TRUE(probe(*readers, "empty").ok());
  Status killed;
  std::atomic<bool> over{false};
  std::thread reader([&] {
    killed = probe(*readers, "sleep");
    over = true;
  });
  EXPECT_TRUE(readersBecome(2));
  // Killed before it is known to have begun, it is begun once more, of another process: that one is met the second time.
  while (!over) {
    for (const int pid : nurseries()) ::kill(-pid, SIGKILL);
    for (int tries = 0; tries < 200 && !over; ++tries) ::usleep(10000);
  }
  reader.join();
  EXPECT_EQ(killed.code(), Code::ResourceExhausted) << killed.toString();
  EXPECT_NE(killed.message().find("killed"), std::string::npos);
  EXPECT_TRUE(probe(*readers, "empty").ok() || probe(*readers, "empty").ok());  // the first may meet it dying
}

/// A nursery that takes nothing in.
struct Deaf {
  Deaf() {
    EXPECT_NE(::mkdtemp(folder.data()), nullptr);
    std::ofstream(program()) << "#!/bin/sh\nsleep 100000\n";
    std::filesystem::permissions(program(), std::filesystem::perms::owner_all);
  }
  ~Deaf() { std::filesystem::remove_all(folder); }
  std::string program() const { return folder + "/deaf.sh"; }
  std::string folder = (std::filesystem::temp_directory_path() / "gobo-nursery-XXXXXX").string();
};

// Its life line is in a queue that nobody reads; whoever gives the load up must come away.
TEST_F(Forked, OneThatNeverTakesItInIsKilled) {
  const Deaf deaf;
  StopSource stop;
  stop.stop(StopReason::Cancelled);
  EXPECT_EQ(probe(*forkedReaders(deaf.program(), 1), "empty", stop.token()).code(), Code::Cancelled);
}

// Not found out by the first load whose time is over.
TEST_F(Forked, ANurseryThatIsStuckIsReplacedAtOnce) {
  const Deaf deaf;
  const auto others = nurseries();
  const Status stuck = probe(*forkedReaders(deaf.program(), 0.2), "empty");
  EXPECT_EQ(stuck.code(), Code::Internal) << stuck.toString();
  EXPECT_NE(stuck.message().find("does not start readers (ingest.program)"), std::string::npos) << stuck.message();
  EXPECT_EQ(nurseries(), others);
  ASSERT_TRUE(probe(*readers, "empty").ok());
  for (const int pid : nurseries()) ::kill(pid, SIGSTOP);
  EXPECT_TRUE(probe(*forkedReaders(findIngestProgram()), "empty").ok());
}

TEST_F(Forked, AProgramThatIsNoneIsTheServersFault) {
  const Status absent = probe(*forkedReaders("/no/such/program"), "empty"), other = probe(*forkedReaders("/bin/true"), "empty");
  EXPECT_EQ(absent.code(), Code::Internal);
  EXPECT_NE(absent.message().find("ingest.program"), std::string::npos);
  EXPECT_FALSE(other.ok());
}

}  // namespace
}  // namespace gobo::reader_process_test
