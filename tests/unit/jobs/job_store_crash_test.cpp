// SPDX-License-Identifier: Apache-2.0
// The store's file under crashes, refusals and several processes. Children are forked before this process opens the store and
// leave by _exit or SIGKILL.
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <functional>

#include "support/thorough.h"
#include "unit/jobs/store_fixture.h"

namespace gobo {
namespace {

struct Crash : test::StoreFixture {
  void SetUp() override {
    makePlace();
    options.now = [this] { return time; };
  }
  template <typename F>
  static pid_t spawn(F work) {
    const pid_t child = ::fork();
    if (child == 0) {
      work();
      ::_exit(0);
    }
    return child;
  }
};

using EachCrash = test::OnEachStore<Crash>;
INSTANTIATE_TEST_SUITE_P(Stores, EachCrash, test::kBothStores, test::storeName);

/// A life of jobs that comes by every kind of change; `op` is called with each, in order.
void script(SqlJobStore& store, double& time, const std::function<void(const std::function<Status()>&)>& op) {
  using Fixture = test::StoreFixture;
  auto a = std::make_shared<std::optional<Lease>>(), b = std::make_shared<std::optional<Lease>>();
  bool existed = false;
  const auto claim = [&](auto& lease) {
    return [&store, lease]() -> Status {
      auto got = store.claim("w", 30);
      if (got.ok()) *lease = *got;
      return got.status();
    };
  };
  op([&] { return store.submit(Fixture::makeJob(3, "k"), existed).status(); });
  op(claim(a));
  op(claim(b));
  op([&] { return store.checkpoint(**a, {"r", "d1", 4, 10}, 0.3, 16).status(); });
  op([&] { return store.checkpoint(**a, {"r", "d2", 4, 10}, 0.6, 16).status(); });
  op([&] { return store.complete(**a, Fixture::files(), 1); });
  op([&] { return store.fail(**b, {{Code::Internal, "x"}}); });
  op([&] { return store.pause(1); });
  op([&] { return store.resume(1); });
  op(claim(a));
  time += 31;
  op([&] { return store.expireLeases().status(); });
  op(claim(b));
  op([&] { return store.release(**b); });
  op([&] { return store.submit(Fixture::makeJob(2), existed).status(); });
  op([&] { return store.cancel(1); });
  op([&] { return store.expireResults(0, 1e9).status(); });
  op([&] { return store.remove(1); });
  NewJob waiting = Fixture::makeJob(1);
  waiting.after = {2};
  op([&] { return store.submit(waiting, existed).status(); });
  op([&] { return store.submit(Fixture::makeJob(1), existed).status(); });
  op([&] { return store.depend(3, {2, 4}); });
  op([&] { return store.prioritize(4, v1::JobSpec::HIGH); });
  op(claim(a));
  op([&] { return store.complete(**a, Fixture::files(), 1); });  // lets go of one need
  op([&] { return store.cancel(2); });
  op([&] { return store.retry(2); });
  op([&] { return store.depend(3, {}); });
  op([&] { return store.blame({2, 0}, {Code::Internal, "crashed"}, true); });
}

std::string dump(SqlJobStore& store, bool revisions) {
  std::string text;
  const std::vector<v1::Job> jobs = *store.list({});
  for (const v1::Job& job : jobs) {
    const JobRecord r = *store.get(jobIdOf(job.id()), true);
    text += (revisions ? std::to_string(r.revision) + " " : "") + r.job.ShortDebugString() + "\n";
    const std::vector<v1::JobLogEntry> log = *store.log(r.id, {});
    for (v1::JobLogEntry e : log) {
      if (!revisions) e.clear_sequence();  // a rollback skips some
      text += "  " + e.ShortDebugString() + "\n";
    }
  }
  const std::vector<std::string> checkpoints = *store.neededCheckpoints();
  for (const auto& c : checkpoints) text += c + " ";
  return text;
}

TEST_P(EachCrash, AKillBeforeAnyStatementLeavesTheStateBeforeOrAfterTheOperation) {
  std::vector<std::string> states;  // after 0, 1, 2 ... operations
  int statements = 0;
  {
    options.step = [&](const char*) {
      ++statements;
      return Status();
    };
    options.now = [this] { return time; };
    open();
    states.push_back(dump(*store, !postgres()));
    statements = 0;
    int counted = 0;
    script(*store, time, [&](const auto& change) {
      const int before = statements;
      ASSERT_TRUE(change().ok());
      counted += statements - before;
      states.push_back(dump(*store, !postgres()));
    });
    statements = counted;
    store.reset();
  }
  ASSERT_EQ(states.size(), 28u);
  ASSERT_GT(statements, 60);
  // A server's schema takes longer to make; every third statement is still one of almost every operation.
  for (int at = 1; at <= statements; at += postgres() ? testing::thoroughOr(5, 11) : testing::thoroughOr(1, 3)) {
    std::filesystem::remove_all(folder);
    std::filesystem::create_directory(folder);
    if (postgres()) dropSchema();
    const pid_t child = spawn([&] {
      double clock = 1000;
      int seen = 0, acknowledged = 0;
      options.now = [&] { return clock; };
      options.step = [&](const char*) {
        if (++seen == at) ::_exit(100 + acknowledged);
        return Status();
      };
      auto opened = another();
      if (!opened.ok()) ::_exit(1);
      script(**opened, clock, [&](const auto& change) {
        if (!change().ok()) ::_exit(2);
        ++acknowledged;
      });
    });
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFEXITED(status));
    const int acknowledged = WEXITSTATUS(status) - 100;
    ASSERT_GE(acknowledged, 0) << "statement " << at;
    options.step = nullptr;
    open();
    EXPECT_EQ(*store->integrity(), "ok");
    EXPECT_EQ(dump(*store, !postgres()), states[size_t(acknowledged)]) << "statement " << at;  // killed before the COMMIT: before
    store.reset();
  }
}

TEST_P(EachCrash, AStatementThatFailsRollsBackAndTheReportIsRepeated) {
  std::string refuse;
  options.step = [&](const char* sql) {
    return !refuse.empty() && std::string(sql).find(refuse) == 0 ? Status(Code::ResourceExhausted, "disk full") : Status();
  };
  open();
  const int64_t id = submit(makeJob());
  const auto lease = claim();
  const std::string before = dump(*store, !postgres());
  for (const char* at : {"BEGIN", postgres() ? "SELECT pg_current_xact_id" : "UPDATE counter", "INSERT INTO file", "INSERT INTO log", "DELETE FROM checkpoint",
                         "UPDATE task", "UPDATE job", "COMMIT"}) {
    refuse = at;
    EXPECT_EQ(store->complete(*lease, files(), 1).code(), Code::ResourceExhausted) << at;
    refuse.clear();
    EXPECT_EQ(dump(*store, !postgres()), before) << at;
  }
  EXPECT_TRUE(store->complete(*lease, files(), 1).ok());
  EXPECT_EQ(get(id).state(), v1::Job::DONE);
}

// Whoever opens a store that is not there yet makes it; none of those who come together is turned away.
TEST_P(EachCrash, ManyOpenANewStoreAtOnce) {
  for (int round = 0; round < (postgres() ? 2 : 12); ++round) {
    store.reset();
    std::filesystem::remove_all(folder);
    std::filesystem::create_directory(folder);
    if (postgres()) dropSchema();
    const std::string flag = folder + "/go";
    std::vector<pid_t> children;
    for (int n = 0; n < 6; ++n)
      children.push_back(spawn([&] {
        while (!std::filesystem::exists(flag)) ::usleep(200);
        const auto opened = another();
        if (!opened.ok()) std::fprintf(stderr, "%s\n", opened.status().toString().c_str());
        ::_exit(opened.ok() ? 0 : 1);
      }));
    std::ofstream(flag).put('1');
    for (const pid_t child : children) {
      int status = 0;
      ASSERT_EQ(::waitpid(child, &status, 0), child);
      EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status << " in round " << round;
    }
  }
}

// Three processes share the work; one kills itself while it holds a lease. Every frame is done once, tokens are never shared.
TEST_P(EachCrash, SeveralProcessesOnOneStore) {
  constexpr int kFrames = 60;
  options.now = nullptr;  // the real clock
  std::vector<pid_t> children;
  for (int n = 0; n < 3; ++n) {
    children.push_back(spawn([&] {
      std::ofstream log(folder + "/log" + std::to_string(n));
      auto opened = another();
      if (!opened.ok()) ::_exit(1);
      SqlJobStore& s = **opened;
      for (int done = 0;;) {
        if (!s.expireLeases().ok()) ::_exit(2);
        auto lease = s.claim("p" + std::to_string(n), 0.5);
        if (!lease.ok()) ::_exit(3);
        if (!*lease) {
          const auto job = s.get(1, false);
          if (job.ok() && jobIsOver(job->job.state())) break;
          ::usleep(20000);
          continue;
        }
        if (n == 0 && done == 5) ::raise(SIGKILL);
        if ((*lease)->task.index % 7 == 3 && n == 1) ::usleep(2000);
        const Status status = s.complete(**lease, files(std::to_string((*lease)->token)), 0);
        if (!status.ok()) ::_exit(4);
        log << (*lease)->task.index << " " << (*lease)->token << std::endl;
        ++done;
      }
    }));
  }
  open();
  submit(makeJob(kFrames));
  for (size_t n = 0; n < children.size(); ++n) {
    int status = 0;
    ASSERT_EQ(::waitpid(children[n], &status, 0), children[n]);
    if (n == 0) EXPECT_TRUE((WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) || WIFEXITED(status));
    else EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  }
  const v1::Job job = get(1);
  EXPECT_EQ(job.state(), v1::Job::DONE);
  std::map<int64_t, std::string> winners;
  std::map<std::string, int> tokens;
  for (int n = 0; n < 3; ++n) {
    std::ifstream log(folder + "/log" + std::to_string(n));
    int64_t index;
    std::string token;
    while (log >> index >> token) {
      EXPECT_TRUE(winners.emplace(index, token).second) << "frame " << index << " completed twice";
      EXPECT_EQ(++tokens[token], 1) << "token " << token;
    }
  }
  EXPECT_EQ(winners.size(), size_t(kFrames));
  for (const auto& [index, token] : winners) EXPECT_EQ(job.frames(int(index)).files(0).sha256(), token);
  EXPECT_EQ(*store->integrity(), "ok");
}

TEST_F(Crash, ADamagedOrForeignFileIsRefusedNotReplaced) {
  std::ofstream(path(), std::ios::binary) << std::string(4096, 'x');
  const auto size = std::filesystem::file_size(path());
  auto opened = SqliteJobStore::open(path(), options);
  EXPECT_EQ(opened.status().code(), Code::DataLoss) << opened.status().toString();
  EXPECT_NE(opened.status().toString().find(path()), std::string::npos);
  EXPECT_EQ(std::filesystem::file_size(path()), size);
  std::filesystem::remove(path());
  {
    Sqlite db;
    ASSERT_TRUE(db.open(path(), 1).ok());
    ASSERT_TRUE(db.exec("PRAGMA user_version = 4; CREATE TABLE other(x)").ok());
  }
  opened = SqliteJobStore::open(path(), options);
  EXPECT_EQ(opened.status().code(), Code::FailedPrecondition) << opened.status().toString();
  EXPECT_NE(opened.status().message().find("version 4"), std::string::npos);
}

}  // namespace
}  // namespace gobo
