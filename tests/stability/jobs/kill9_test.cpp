// SPDX-License-Identifier: Apache-2.0
// kill -9 of the real daemon, again and again, while jobs are submitted, rendered and checkpointed and a client relights. In the end
// every job that was acknowledged is done, none is there twice, its bits are those of an uninterrupted render, and no file is
// left that nothing needs. GOBO_KILLS says how often (bench/kill9: 50).
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <random>
#include <regex>
#include <thread>

#include <grpcpp/grpcpp.h>

#include "daemon.h"
#include "gobo/v1/jobs.grpc.pb.h"
#include "gobo/v1/service.grpc.pb.h"
#include "import/load.h"
#include "server/encode.h"
#include "server/jobs/sqlite_job_store.h"
#include "support/thorough.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

double since(Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); }
void nap(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }

v1::RenderRequest request(uint32_t spp, uint64_t seed) {
  v1::RenderRequest r;
  r.set_scene("cornell");
  r.set_width(24);
  r.set_height(24);
  r.set_seed(seed);
  r.mutable_halt()->set_spp(spp);
  r.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
  r.mutable_integrator()->set_max_bounces(2);
  return r;
}

v1::JobSpec spec(int i) {
  v1::JobSpec s;
  s.set_key("job-" + std::to_string(i));
  *s.mutable_request() = request(i % 5 == 0 ? 3072 : i % 2 ? 256 : 768, uint64_t(i));
  if (i % 4 == 1) {
    s.mutable_frames()->set_first(1);
    s.mutable_frames()->set_last(3);
  }
  return s;
}

void bound(grpc::ClientContext& context, double seconds = 60) {
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(int(seconds * 1e3)));
}

TEST(Kill9, NothingLostNothingTwiceTheSameBits) {
  const char* asked = std::getenv("GOBO_KILLS");
  const int kills = asked ? std::atoi(asked) : testing::thoroughOr(6, 4);
  const test::TemporaryFolder temporary;
  const std::string& folder = temporary.path;
  test::Daemon daemon(folder, 2);
  std::mt19937 random(20240501);
  const auto begun = Clock::now();
  int submitted = 0, repeated = 0, inFlight = 0;
  std::map<std::string, std::string> ids;  // key -> id, as acknowledged
  std::atomic<uint64_t> relights{0};
  for (int cycle = 0; cycle <= kills; ++cycle) {
    ASSERT_TRUE(daemon.start()) << "cycle " << cycle;
    std::atomic<bool> over{false};
    // Load: an interactive client.
    std::thread client([&, channel = daemon.channel(), cycle] {
      const auto stub = v1::Render::NewStub(channel);
      for (uint32_t n = 0; !over.load(); ++n) {
        grpc::ClientContext context;
        bound(context, 10);
        v1::RenderRequest r = request(16, 1000000 + uint64_t(cycle));
        r.mutable_scheduling()->set_priority(v1::Scheduling::INTERACTIVE);
        r.mutable_tone_map()->set_exposure(double(n % 7));
        v1::InlineReply reply;
        if (stub->RenderInline(&context, r, &reply).ok()) ++relights;
        nap(0.02);
      }
    });
    // Jobs: new ones, and again those whose acknowledgement did not arrive.
    std::thread submitter([&, channel = daemon.channel()] {
      const auto stub = v1::Jobs::NewStub(channel);
      const int until = std::min(cycle, kills - 1) + 1;
      for (int i = 0; i < until && !over.load(); ++i) {
        if (ids.count("job-" + std::to_string(i))) continue;
        grpc::ClientContext context;
        bound(context, 10);
        v1::Job job;
        repeated += i < submitted;
        submitted = std::max(submitted, i + 1);
        if (stub->Submit(&context, spec(i), &job).ok()) ids[spec(i).key()] = job.id();
      }
    });
    if (cycle == kills) {
      submitter.join();
      over.store(true);
      client.join();
      break;
    }
    nap(std::uniform_real_distribution<double>(0.02, 0.9)(random));
    {
      grpc::ClientContext context;
      bound(context, 5);
      v1::ListJobsRequest l;
      l.add_states(v1::Job::RUNNING);
      v1::ListJobsReply reply;
      if (v1::Jobs::NewStub(daemon.channel())->List(&context, l, &reply).ok()) inFlight += reply.jobs_size() > 0;
    }
    nap(std::uniform_real_distribution<double>(0, 0.03)(random));
    const int status = daemon.kill(SIGKILL);
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) << "the daemon died by itself: " << status;
    over.store(true);
    client.join();
    submitter.join();
  }
  const double killSeconds = since(begun);
  ASSERT_EQ(ids.size(), size_t(kills));

  const auto stub = v1::Jobs::NewStub(daemon.channel());
  std::vector<v1::Job> jobs;
  for (const auto start = Clock::now();; nap(0.1)) {
    grpc::ClientContext context;
    bound(context);
    v1::ListJobsRequest l;
    l.set_page_size(1000);
    v1::ListJobsReply reply;
    ASSERT_TRUE(stub->List(&context, l, &reply).ok());
    jobs.assign(reply.jobs().begin(), reply.jobs().end());
    if (std::all_of(jobs.begin(), jobs.end(), [](const v1::Job& j) { return jobIsOver(j.state()); })) break;
    ASSERT_LT(since(start), 400) << "jobs do not end";
  }
  EXPECT_EQ(jobs.size(), size_t(kills)) << "a job is there twice, or not at all";
  // Every frame: done, once, with the bits of a render that nobody interrupted.
  EngineOptions options;
  options.loader = inProcessLoader();
  options.threads = 2;
  auto engine = std::move(*Engine::create(options));
  size_t frames = 0, differing = 0, lost = 0, twice = jobs.size() > size_t(kills) ? jobs.size() - size_t(kills) : 0, stray = 0;
  std::map<std::string, std::string> wanted;  // result file -> job
  for (int i = 0; i < kills; ++i) {
    grpc::ClientContext context;
    bound(context);
    v1::GetJobRequest g;
    g.set_id(ids[spec(i).key()]);
    v1::Job job;
    ASSERT_TRUE(stub->Get(&context, g, &job).ok());
    EXPECT_EQ(job.state(), v1::Job::DONE) << job.ShortDebugString();
    EXPECT_EQ(job.frames_done(), job.frames_total());
    lost += job.frames_total() - job.frames_done();
    const auto whole = engine->render(spec(i).request());
    ASSERT_TRUE(whole.ok());
    const std::vector<uint8_t> bits = rawBytes(whole->images[0].pixels(), false).copy();
    grpc::ClientContext fetching;
    bound(fetching);
    v1::FetchRequest f;
    f.set_id(job.id());
    auto reader = stub->Fetch(&fetching, f);
    v1::FetchReply reply;
    std::vector<std::string> pictures;
    while (reader->Read(&reply)) {
      if (reply.has_file()) pictures.emplace_back();
      else pictures.back() += reply.chunk().data();
    }
    EXPECT_TRUE(reader->Finish().ok());
    EXPECT_EQ(pictures.size(), size_t(job.frames_total()));
    for (const std::string& p : pictures) {
      ++frames;
      differing += p != std::string(bits.begin(), bits.end());
    }
    for (const v1::Frame& frame : job.frames()) {
      EXPECT_EQ(frame.attempts(), 1u) << job.id();
      for (const auto& file : frame.files()) wanted[job.id().substr(2) + "/" + file.sha256()] = file.sha256();
    }
  }
  EXPECT_EQ(differing, 0u);
  // A drained daemon leaves nothing but the store and the results.
  const int status = daemon.kill(SIGTERM);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  for (const char* sub : {"/jobs/tmp", "/jobs/checkpoints"})
    for (const auto& entry : fs::directory_iterator(folder + sub)) {
      ADD_FAILURE() << entry.path() << " is left";
      ++stray;
    }
  size_t results = 0, corrupt = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder + "/jobs/results")) {
    if (!entry.is_regular_file()) continue;
    ++results;
    std::ifstream in(entry.path(), std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(in)), {});
    const std::string sha = entry.path().filename().string();
    corrupt += sha256Hex(bytes.data(), bytes.size()) != sha;
    const bool known = wanted.count(entry.path().parent_path().filename().string() + "/" + sha) > 0;
    EXPECT_TRUE(known) << entry.path() << " is nobody's";
    stray += !known;
  }
  EXPECT_EQ(corrupt, 0u);
  EXPECT_EQ(results, wanted.size());
  auto store = SqliteJobStore::open(folder + "/jobs/jobs.sqlite");
  ASSERT_TRUE(store.ok());
  const std::string integrity = *(*store)->integrity();
  EXPECT_EQ(integrity, "ok");
  // The daemons' own words.
  std::map<std::string, int> done;
  size_t resumed = 0, checkpoints = 0, taken = 0;
  std::ifstream log(folder + "/log");
  const std::regex doneLine("job (j-[0-9]+ frame -?[0-9]+) done seconds=[0-9.]+ checkpoints=([0-9]+) resumed=([0-9]+)"),
      takenLine("jobs: ([0-9]+) frames of a killed");
  for (std::string line; std::getline(log, line);) {
    std::smatch m;
    if (std::regex_search(line, m, doneLine)) {
      EXPECT_EQ(++done[m[1]], 1) << m[1] << " was completed twice";
      twice += done[m[1]] > 1;
      checkpoints += std::stoul(m[2]);
      resumed += std::stoul(m[3]) > 0;
    } else if (std::regex_search(line, m, takenLine)) {
      taken += std::stoul(m[1]);
    }
  }
  std::printf(
      "kill -9: %d times in %.1f s, %d with a job running, %zu running frames taken up again, %zu frames finished from a checkpoint of a killed daemon\n"
      "jobs: %zu submitted, %zu frames done, %d submissions repeated; frames lost %zu, twice %zu, with other bits %zu; files corrupt %zu, stray %zu; integrity "
      "%s\n"
      "load: %llu interactive renders answered meanwhile; all in %.1f s\n",
      kills, killSeconds, inFlight, taken, resumed, jobs.size(), frames, repeated, lost, twice, differing, corrupt, stray, integrity.c_str(),
      (unsigned long long)relights.load(), since(begun));
}

}  // namespace
}  // namespace gobo
