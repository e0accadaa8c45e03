// SPDX-License-Identifier: Apache-2.0
// A farm: three daemons, one PostgreSQL server, one folder. Daemons are killed with -9, and the server is stopped as if its machine had lost
// power, while jobs are submitted and rendered. In the end every job that was acknowledged is done, each frame once, with the bits of a render
// by one daemon alone.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "daemon.h"
#include "import/load.h"
#include "server/encode.h"
#include "server/jobs/postgres_job_store.h"
#include "support/postgres_server.h"

namespace gobo::farm_test {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

void rest(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }

v1::JobSpec spec(int i) {
  v1::JobSpec s;
  s.set_key("shot-" + std::to_string(i));
  s.mutable_frames()->set_first(1);
  s.mutable_frames()->set_last(3);
  v1::RenderRequest& r = *s.mutable_request();
  r.set_scene("cornell");
  r.set_width(24);
  r.set_height(24);
  r.set_seed(uint64_t(i));
  r.mutable_halt()->set_spp(i % 2 ? 256 : 768);
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

TEST(Farm, NothingLostNothingTwiceTheSameBits) {
  if (const std::string why = test::withoutPostgres(); !why.empty()) GTEST_SKIP() << why;
  constexpr int kDaemons = 3, kJobs = 6;
  test::PostgresServer server(true);
  const test::TemporaryFolder folder;
  const std::string jobs = "folder = \"" + folder.path + "/shared\"\nstore = \"" + server.uri() + "\"\nlease_s = 1\n";
  std::vector<std::unique_ptr<test::Daemon>> daemons;
  std::vector<std::string> places;
  for (int i = 0; i < kDaemons; ++i) {
    places.push_back(folder.path + "/daemon" + std::to_string(i));
    fs::create_directory(places.back());
    daemons.push_back(std::make_unique<test::Daemon>(places.back(), 1, jobs));
    ASSERT_TRUE(daemons.back()->start());
  }
  // Jobs go to any of the daemons, and again until one has acknowledged them.
  std::map<std::string, std::string> ids;
  const auto submit = [&](int i) {
    for (int attempt = 0; attempt < 60 && !ids.count(spec(i).key()); ++attempt) {
      v1::Job job;
      if (ask(*daemons[size_t(i + attempt) % kDaemons], &v1::Jobs::Stub::Submit, spec(i), job)) ids[spec(i).key()] = job.id();
      else rest(0.1);
    }
  };
  const auto killed = [&](int i) {
    const int status = daemons[size_t(i)]->kill(SIGKILL);
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) << "daemon " << i << " died by itself: " << status;
  };
  submit(0), submit(1);
  rest(0.6);
  killed(0);
  submit(2);
  rest(0.3);
  server.stop(SIGQUIT);
  rest(0.4);
  server.start();
  ASSERT_TRUE(daemons[0]->start());
  submit(3);
  rest(0.3);
  killed(1);
  killed(2);
  submit(4);
  server.stop(SIGQUIT);
  server.start();
  ASSERT_TRUE(daemons[1]->start());
  submit(5);
  ASSERT_TRUE(daemons[2]->start());
  ASSERT_EQ(ids.size(), size_t(kJobs));

  std::vector<v1::Job> all;
  for (const auto start = Clock::now();; rest(0.1)) {
    v1::ListJobsRequest l;
    l.set_page_size(100);
    v1::ListJobsReply reply;
    if (ask(*daemons[1], &v1::Jobs::Stub::List, l, reply)) {
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
    ASSERT_TRUE(ask(*daemons[size_t(i) % kDaemons], &v1::Jobs::Stub::Get, g, job));
    EXPECT_EQ(job.state(), v1::Job::DONE) << job.ShortDebugString();
    EXPECT_EQ(job.frames_done(), 3u);
    const auto whole = engine->render(spec(i).request());
    ASSERT_TRUE(whole.ok());
    const std::vector<uint8_t> bits = rawBytes(whole->images[0].pixels(), false).copy();
    for (const v1::Frame& frame : job.frames()) {
      EXPECT_EQ(frame.attempts(), 1u) << job.id();
      ASSERT_EQ(frame.files_size(), 1);
      const std::string path = folder.path + "/shared/results/" + job.id().substr(2) + "/" + frame.files(0).sha256();
      wanted.insert(path);
      std::ifstream in(path, std::ios::binary);
      const std::string bytes((std::istreambuf_iterator<char>(in)), {});
      EXPECT_TRUE(bytes == std::string(bits.begin(), bits.end())) << job.id() << " frame " << frame.frame();
    }
  }
  for (auto& d : daemons) {
    const int status = d->kill(SIGTERM);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  }
  for (const auto& entry : fs::recursive_directory_iterator(folder.path + "/shared/results"))
    EXPECT_TRUE(!entry.is_regular_file() || wanted.count(entry.path().string())) << entry.path() << " is nobody's";
  auto store = PostgresJobStore::open(server.uri());
  ASSERT_TRUE(store.ok());
  EXPECT_EQ(*(*store)->integrity(), "ok");
  // The daemons' own words: each frame was completed once, and more than one daemon did some.
  std::map<std::string, int> done;
  int hands = 0;
  for (const std::string& place : places) {
    std::ifstream log(place + "/log");
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

int run(const std::vector<std::string>& words, std::string& said) {
  const std::string out = (fs::temp_directory_path() / ("gobo-check-" + std::to_string(::getpid()))).string();
  std::string line;
  for (const std::string& w : words) line += "'" + w + "' ";
  const int status = std::system((line + "> " + out + " 2>&1").c_str());
  std::ifstream in(out);
  said.assign(std::istreambuf_iterator<char>(in), {});
  fs::remove(out);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST(Farm, CheckSaysWhatIsWrongWithTheStore) {
  if (const std::string why = test::withoutPostgres(); !why.empty()) GTEST_SKIP() << why;
  test::PostgresServer server;
  const test::TemporaryFolder folder;
  std::ofstream(folder.path + "/gobod.toml") << "[jobs]\nfolder = \"jobs\"\n";
  const auto check = [&](const std::string& uri, std::string& said) {
    return run({GOBOD, "--config", folder.path + "/gobod.toml", "--check", "--jobs-store", uri}, said);
  };
  std::string said;
  EXPECT_EQ(check(server.uri(), said), 0) << said;
  EXPECT_FALSE(fs::exists(folder.path + "/jobs")) << "a check makes nothing";
  EXPECT_EQ(check("postgresql://gobo@/nowhere?host=" + server.folder(), said), 4);
  EXPECT_NE(said.find("\"nowhere\" does not exist"), std::string::npos) << said;
  EXPECT_EQ(check("postgresql://gobo:hunter2@/postgres?host=" + server.folder(), said), 2);
  EXPECT_NE(said.find("PGPASSFILE"), std::string::npos) << said;
  EXPECT_EQ(said.find("hunter2"), std::string::npos) << said;
  const std::string uri = server.uri();
  server.stop(SIGINT);
  EXPECT_EQ(check(uri, said), 4);
  EXPECT_NE(said.find("jobs.store"), std::string::npos) << said;
}

}  // namespace
}  // namespace gobo::farm_test
