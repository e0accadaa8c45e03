// SPDX-License-Identifier: Apache-2.0
// A coordinator and workers that share nothing but a socket. Workers and the coordinator are killed with -9, and one worker is frozen for longer
// than its lease, while frames are rendered. In the end every job is done, each frame was completed once, with the bits of a render by one
// daemon alone, and nothing that nobody needs lies in the coordinator's folder.
#include <random>

#include "farm_jobs.h"

namespace gobo::farm_workers_test {
namespace {

namespace fs = std::filesystem;
using test::rest;

class WorkerProcess {
 public:
  WorkerProcess(std::string folder, std::string coordinator, int number)
      : folder_(std::move(folder)), coordinator_(std::move(coordinator)), name_("w" + std::to_string(number)) {}
  ~WorkerProcess() { kill(SIGKILL); }
  void start() {
    pid_ = ::fork();
    if (pid_ != 0) return;
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    const int log = ::open((folder_ + "/" + name_ + ".log").c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
    ::dup2(log, 1);
    ::dup2(log, 2);
    ::execl(GOBOD, "gobod", "--worker", coordinator_.c_str(), "--worker-name", name_.c_str(), "--threads", "1", "--tmp", folder_.c_str(), nullptr);
    ::_exit(127);
  }
  int kill(int signal) {
    int status = 0;
    if (pid_ <= 0) return status;
    ::kill(pid_, signal);
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    return status;
  }
  void freeze() const { ::kill(pid_, SIGSTOP); }
  void thaw() const { ::kill(pid_, SIGCONT); }

 private:
  const std::string folder_, coordinator_, name_;
  pid_t pid_ = -1;
};

TEST(FarmWorkers, NothingLostNothingTwiceTheSameBits) {
  constexpr int kWorkers = 3;
  const test::TemporaryFolder folder;
  const std::string place = folder.path + "/coordinator";
  fs::create_directory(place);
  test::Daemon coordinator(place, 0, "folder = \"jobs\"\nlease_s = 1\n");
  ASSERT_TRUE(coordinator.start());
  std::vector<std::unique_ptr<WorkerProcess>> workers;
  for (int i = 0; i < kWorkers; ++i) {
    workers.push_back(std::make_unique<WorkerProcess>(folder.path, "unix:" + place + "/s.sock", i));
    workers.back()->start();
  }
  test::FarmJobs shots({512, 256});
  const auto submit = [&](int i) { shots.submit(i, {&coordinator}); };
  std::minstd_rand random(7);
  const auto killed = [&](int i) {
    const int status = workers[size_t(i)]->kill(SIGKILL);
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) << "worker " << i << " died by itself: " << status;
    workers[size_t(i)]->start();
  };
  submit(0), submit(1);
  rest(0.5);
  workers[2]->freeze();
  for (int round = 0; round < 4; ++round) {
    rest(0.2 + 0.001 * double(random() % 300));
    killed(round % 2);
    if (round == 1) {
      const int status = coordinator.kill(SIGKILL);
      EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) << status;
      ASSERT_TRUE(coordinator.start());
    }
    if (round < 3) submit(2 + round);
  }
  workers[2]->thaw();
  shots.waitUntilOver(coordinator);
  shots.expectRendered({&coordinator}, place + "/jobs/results");
  for (auto& w : workers) {
    const int status = w->kill(SIGTERM);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  }
  const int status = coordinator.kill(SIGTERM);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  shots.expectNothingElse(place + "/jobs/results");
  for (const auto& entry : fs::directory_iterator(folder.path))
    EXPECT_EQ(entry.path().filename().string().rfind("gobo-worker-", 0), std::string::npos) << "a worker left " << entry.path();
  std::vector<std::string> logs;
  for (int i = 0; i < kWorkers; ++i) logs.push_back(folder.path + "/w" + std::to_string(i) + ".log");
  EXPECT_GE(test::FarmJobs::completedOnceBy(logs), 2);
}

}  // namespace
}  // namespace gobo::farm_workers_test
