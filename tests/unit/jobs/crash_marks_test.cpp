// SPDX-License-Identifier: Apache-2.0
// What a process leaves of the frames that it worked on, by the way it ended, and what the store makes of it.
#include "server/jobs/crash_marks.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <functional>

#include "store_fixture.h"

namespace gobo::crash_marks_test {
namespace {

class CrashMarksTest : public test::StoreFixture {
 protected:
  /// Runs `work` in a process of its own with marks in this folder, and waits for its end.
  void live(const std::function<void(CrashMarks&)>& work) {
    const pid_t pid = ::fork();
    if (pid == 0) {
      const rlimit none{0, 0};
      ::setrlimit(RLIMIT_CORE, &none);
      for (const int s : {SIGSEGV, SIGABRT, SIGFPE, SIGILL, SIGBUS}) ::signal(s, SIG_DFL);  // as in the daemon: a sanitizer's own handler would stay
      auto marks = CrashMarks::open(folder);
      if (!marks.ok()) ::_exit(9);
      work(**marks);
      marks->reset();
      ::_exit(0);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(pid, &status, 0), pid);
    ASSERT_FALSE(WIFEXITED(status) && WEXITSTATUS(status) == 9);
  }
};

TEST_F(CrashMarksTest, ACrashNamesItsFrame) {
  for (const int signal : {SIGSEGV, SIGABRT, SIGFPE, SIGILL, SIGBUS}) {
    live([&](CrashMarks& marks) {
      { const CrashMarks::Working before(&marks, {7, 1}); }  // over: not to blame
      const CrashMarks::Working working(&marks, {7, 2});
      ::raise(signal);
    });
    const auto reports = CrashMarks::read(folder);
    ASSERT_EQ(reports.size(), 1u) << signal;
    EXPECT_EQ(reports[0].signal, signal);
    EXPECT_EQ(reports[0].tasks, (std::vector<TaskId>{{7, 2}}));
    EXPECT_TRUE(reports[0].alone);
    EXPECT_TRUE(CrashMarks::read(folder).empty());  // told once
  }
}

TEST_F(CrashMarksTest, BesideOtherWorkNobodyIsSure) {
  live([](CrashMarks& marks) {
    const CrashMarks::Working a(&marks, {1, 0}), b(&marks, {2, 0});
    ::raise(SIGSEGV);
  });
  auto reports = CrashMarks::read(folder);
  ASSERT_EQ(reports.size(), 1u);
  EXPECT_EQ(reports[0].tasks.size(), 2u);
  EXPECT_FALSE(reports[0].alone);
  live([](CrashMarks& marks) {
    const CrashMarks::Working a(&marks, {1, 0});
    const CrashMarks::Other other;
    ::raise(SIGSEGV);
  });
  reports = CrashMarks::read(folder);
  ASSERT_EQ(reports.size(), 1u);
  EXPECT_FALSE(reports[0].alone);
}

TEST_F(CrashMarksTest, AKillFromOutsideAndAGoodEndBlameNobody) {
  live([](CrashMarks& marks) {
    const CrashMarks::Working working(&marks, {7, 2});
    ::raise(SIGKILL);
  });
  EXPECT_TRUE(CrashMarks::read(folder).empty());
  live([](CrashMarks& marks) { const CrashMarks::Working working(&marks, {7, 2}); });
  EXPECT_TRUE(CrashMarks::read(folder).empty());
  live([](CrashMarks&) { ::raise(SIGSEGV); });  // not while a frame was worked on
  EXPECT_TRUE(CrashMarks::read(folder).empty());
}

TEST_F(CrashMarksTest, MarksOfALivingProcessAreLeftAlone) {
  const auto marks = CrashMarks::open(folder);
  ASSERT_TRUE(marks.ok()) << marks.status().toString();
  const CrashMarks::Working working(marks->get(), {7, 2});
  EXPECT_TRUE(CrashMarks::read(folder).empty());
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder + "/marks"), std::filesystem::directory_iterator()), 1);
}

TEST_F(CrashMarksTest, ACertainCulpritIsSetAsideAtOnceAndTheRestGoesOn) {
  const int64_t id = submit(makeJob(2));
  ASSERT_TRUE(claim());
  ASSERT_TRUE(store->endAllLeases().ok());
  ASSERT_TRUE(store->blame({id, 0}, {Code::Internal, "it crashed"}, true).ok());
  v1::Job job = get(id);
  EXPECT_EQ(job.frames(0).state(), v1::Frame::FAILED);
  EXPECT_EQ(job.frames(0).error().message(), "it crashed");
  EXPECT_EQ(job.state(), v1::Job::QUEUED);
  const auto lease = claim();
  ASSERT_TRUE(lease);
  EXPECT_EQ(lease->task.index, 1);
  ASSERT_TRUE(store->complete(*lease, files(), 1).ok());
  EXPECT_EQ(get(id).state(), v1::Job::FAILED);
  EXPECT_NE(get(id).error().message().find("it crashed"), std::string::npos);
}

TEST_F(CrashMarksTest, ASuspectIsSetAsideTheThirdTime) {
  const int64_t id = submit(makeJob(1));
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(claim()) << i;
    ASSERT_TRUE(store->endAllLeases().ok());
    ASSERT_TRUE(store->blame({id, 0}, {Code::Internal, "it crashed"}, false).ok());
  }
  EXPECT_EQ(get(id).state(), v1::Job::FAILED);
}

// Blame comes from a file: what it names may be over, gone, or with another worker by now.
TEST_F(CrashMarksTest, BlameOfWhatIsOverChangesNothing) {
  const int64_t id = submit(makeJob(1));
  const auto lease = claim();
  ASSERT_TRUE(lease);
  EXPECT_TRUE(store->blame({id, 0}, {Code::Internal, "beside others"}, false).ok());
  ASSERT_TRUE(store->complete(*lease, files(), 1).ok());  // its present holder is not disturbed
  EXPECT_TRUE(store->blame({id, 0}, {Code::Internal, "late"}, true).ok());
  EXPECT_EQ(get(id).state(), v1::Job::DONE);
  EXPECT_TRUE(store->blame({id + 5, 3}, {Code::Internal, "unknown"}, true).ok());
  ASSERT_TRUE(store->remove(id).ok());
  EXPECT_TRUE(store->blame({id, 0}, {Code::Internal, "deleted"}, true).ok());
}

}  // namespace
}  // namespace gobo::crash_marks_test
