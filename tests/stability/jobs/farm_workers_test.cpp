// SPDX-License-Identifier: Apache-2.0
// A coordinator and workers that share nothing but a socket. Workers and the coordinator are killed with -9, and one worker is frozen for longer
// than its lease, while frames are rendered. In the end every job is done, each frame was completed once, with the bits of a render by one
// daemon alone, and nothing that nobody needs lies in the coordinator's folder.
#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>

#include "daemon.h"
#include "import/load.h"
#include "plan/engine.h"
#include "server/encode.h"
#include "server/jobs/sqlite_job_store.h"

namespace gobo::farm_workers_test {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

void rest(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }

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

v1::JobSpec spec(int i) {
  v1::JobSpec s;
  s.set_key("shot-" + std::to_string(i));
  s.mutable_frames()->set_first(1);
  s.mutable_frames()->set_last(3);
  v1::RenderRequest& r = *s.mutable_request();
  r.set_scene(i % 3 == 2 ? "grids" : "cornell");
  r.set_width(24);
  r.set_height(24);
  r.set_seed(uint64_t(i));
  r.mutable_halt()->set_spp(i % 2 ? 256 : 512);
  r.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
  r.mutable_integrator()->set_max_bounces(2);
  return s;
}

template <typename Request, typename Reply, typename Call>
bool ask(const test::Daemon& daemon, Call call, const Request& request, Reply& reply) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(10));
  const auto stub = v1::Jobs::NewStub(daemon.channel());
  return (stub.get()->*call)(&context, request, &reply).ok();
}

TEST(FarmWorkers, NothingLostNothingTwiceTheSameBits) {
  constexpr int kWorkers = 3, kJobs = 5;
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
  std::map<std::string, std::string> ids;
  const auto submit = [&](int i) {
    for (int attempt = 0; attempt < 60 && !ids.count(spec(i).key()); ++attempt) {
      v1::Job job;
      if (ask(coordinator, &v1::Jobs::Stub::Submit, spec(i), job)) ids[spec(i).key()] = job.id();
      else rest(0.1);
    }
  };
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
  ASSERT_EQ(ids.size(), size_t(kJobs));

  std::vector<v1::Job> all;
  for (const auto start = Clock::now();; rest(0.1)) {
    v1::ListJobsRequest l;
    l.set_page_size(100);
    v1::ListJobsReply reply;
    if (ask(coordinator, &v1::Jobs::Stub::List, l, reply)) {
      all.assign(reply.jobs().begin(), reply.jobs().end());
      if (all.size() >= size_t(kJobs) && std::all_of(all.begin(), all.end(), [](const v1::Job& j) { return jobIsOver(j.state()); })) break;
    }
    ASSERT_LT(std::chrono::duration<double>(Clock::now() - start).count(), 120) << "jobs do not end";
  }
  EXPECT_EQ(all.size(), size_t(kJobs)) << "a job is there twice";
  EngineOptions options;
  options.loader = inProcessLoader();
  options.threads = 2;
  auto engine = std::move(*Engine::create(options));
  std::set<std::string> wanted;
  for (int i = 0; i < kJobs; ++i) {
    v1::GetJobRequest g;
    g.set_id(ids[spec(i).key()]);
    v1::Job job;
    ASSERT_TRUE(ask(coordinator, &v1::Jobs::Stub::Get, g, job));
    EXPECT_EQ(job.state(), v1::Job::DONE) << job.ShortDebugString();
    EXPECT_EQ(job.frames_done(), 3u);
    const auto whole = engine->render(spec(i).request());
    ASSERT_TRUE(whole.ok());
    const std::vector<uint8_t> bits = rawBytes(whole->images[0].pixels(), false).copy();
    for (const v1::Frame& frame : job.frames()) {
      EXPECT_EQ(frame.attempts(), 1u) << job.id();
      ASSERT_EQ(frame.files_size(), 1);
      const std::string path = place + "/jobs/results/" + job.id().substr(2) + "/" + frame.files(0).sha256();
      wanted.insert(path);
      std::ifstream in(path, std::ios::binary);
      const std::string bytes((std::istreambuf_iterator<char>(in)), {});
      EXPECT_TRUE(bytes == std::string(bits.begin(), bits.end())) << job.id() << " frame " << frame.frame();
    }
  }
  for (auto& w : workers) {
    const int status = w->kill(SIGTERM);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  }
  const int status = coordinator.kill(SIGTERM);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  for (const auto& entry : fs::recursive_directory_iterator(place + "/jobs/results"))
    EXPECT_TRUE(!entry.is_regular_file() || wanted.count(entry.path().string())) << entry.path() << " is nobody's";
  for (const auto& entry : fs::directory_iterator(folder.path))
    EXPECT_EQ(entry.path().filename().string().rfind("gobo-worker-", 0), std::string::npos) << "a worker left " << entry.path();
  // The workers' own words: each frame was completed once, and more than one worker did some.
  std::map<std::string, int> done;
  int hands = 0;
  for (int i = 0; i < kWorkers; ++i) {
    std::ifstream log(folder.path + "/w" + std::to_string(i) + ".log");
    bool some = false;
    for (std::string line; std::getline(log, line);) {
      const size_t at = line.find(" done seconds=");
      if (at == std::string::npos) continue;
      const std::string name = line.substr(line.find("job j-"), at - line.find("job j-"));
      EXPECT_EQ(++done[name], 1) << name << " was completed twice";
      some = true;
    }
    hands += some;
  }
  EXPECT_GE(hands, 2);
}

}  // namespace
}  // namespace gobo::farm_workers_test
