// SPDX-License-Identifier: Apache-2.0
// A farm: three daemons, one PostgreSQL server, one folder. Daemons are killed with -9, and the server is stopped as if its machine had lost
// power, while jobs are submitted and rendered. In the end every job that was acknowledged is done, each frame once, with the bits of a render
// by one daemon alone.
#include "farm_jobs.h"
#include "server/jobs/postgres_job_store.h"
#include "support/postgres_server.h"

namespace gobo::farm_test {
namespace {

namespace fs = std::filesystem;
using test::rest;

TEST(Farm, NothingLostNothingTwiceTheSameBits) {
  if (const std::string why = test::withoutPostgres(); !why.empty()) GTEST_SKIP() << why;
  constexpr int kDaemons = 3;
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
  std::vector<const test::Daemon*> any;
  for (const auto& d : daemons) any.push_back(d.get());
  test::FarmJobs shots({768, 256});
  const auto submit = [&](int i) { shots.submit(i, any); };
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
  shots.waitUntilOver(*daemons[1]);
  shots.expectRendered(any, folder.path + "/shared/results");
  for (auto& d : daemons) {
    const int status = d->kill(SIGTERM);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  }
  shots.expectNothingElse(folder.path + "/shared/results");
  auto store = PostgresJobStore::open(server.uri());
  ASSERT_TRUE(store.ok());
  EXPECT_EQ(*(*store)->integrity(), "ok");
  std::vector<std::string> logs;
  for (const std::string& place : places) logs.push_back(place + "/log");
  EXPECT_GE(test::FarmJobs::completedOnceBy(logs), 2);
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
