// SPDX-License-Identifier: Apache-2.0
// What several connections do to each other, and what a server does to them: claims side by side, revisions in the order of commits, the
// server's clock, lost connections, errors by their class, refusals that name no secret.
#include <atomic>
#include <condition_variable>
#include <mutex>
#include <set>
#include <thread>

#include "server/config.h"
#include "server/jobs/job_news.h"
#include "server/jobs/store_identity.h"
#include "unit/jobs/store_fixture.h"

namespace gobo::postgres_job_store_test {
namespace {

struct PostgresStore : test::StoreFixture {
  bool postgres() const override { return true; }
  void SetUp() override {
    makePlace();
    if (!IsSkipped()) open();  // the server's clock
  }
  /// A connection of the test's own.
  static std::string sql(const std::string& text) {
    Postgres db(test::postgresServer().uri(), 5);
    EXPECT_TRUE(db.connect().ok());
    EXPECT_TRUE(db.exec("SET client_min_messages = error").ok());
    const auto value = db.exec(text);
    EXPECT_TRUE(value.ok()) << value.status().toString();
    return value.ok() ? *value : "";
  }
  std::unique_ptr<SqlJobStore> second() const {
    auto opened = another();
    EXPECT_TRUE(opened.ok()) << opened.status().toString();
    return std::move(*opened);
  }
  void complete(const Lease& lease) { EXPECT_TRUE(store->complete(lease, files(), 1).ok()); }
};

TEST_F(PostgresStore, AClaimWaitsForNoFrameThatAnotherOneIsTaking) {
  const int64_t first = submit(makeJob(2)), next = submit(makeJob(1));
  complete(*claim());  // the job runs, one frame is left
  const auto other = [&] {
    NewJob more = makeJob(3, "", v1::JobSpec::HIGH);
    return submit(more);
  }();
  complete(*claim());  // that one runs too
  Postgres holder(test::postgresServer().uri(), 5);
  ASSERT_TRUE(holder.connect().ok());
  const std::string lock = "SELECT idx FROM gobo.task WHERE job = " + std::to_string(other) + " AND idx ";
  ASSERT_TRUE(holder.exec("BEGIN; " + lock + "= 1 FOR UPDATE").ok());
  const auto begun = std::chrono::steady_clock::now();
  const auto a = claim();
  ASSERT_TRUE(a);
  EXPECT_EQ(a->task, (TaskId{other, 2}));
  const auto b = claim();  // the only one that is left there is being taken: on to the next job
  ASSERT_TRUE(b);
  EXPECT_EQ(b->task, (TaskId{first, 1}));
  const auto c = claim();
  ASSERT_TRUE(c);
  EXPECT_EQ(c->task, (TaskId{next, 0}));
  EXPECT_FALSE(claim());
  EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count(), 4);
  ASSERT_TRUE(holder.exec("ROLLBACK").ok());
  EXPECT_EQ(claim()->task, (TaskId{other, 1}));
}

TEST_F(PostgresStore, EachFrameGoesToOneOfManyConnections) {
  constexpr int kConnections = 6, kFrames = 240;
  std::vector<std::unique_ptr<SqlJobStore>> stores;
  for (int i = 0; i < kConnections; ++i) stores.push_back(second());
  for (int i = 0; i < 3; ++i) submit(makeJob(kFrames / 3));
  std::mutex mutex;
  std::map<TaskId, int> taken;
  std::map<uint64_t, int> tokens;
  std::atomic<int> failed{0};
  std::vector<std::thread> threads;
  for (auto& s : stores)
    threads.emplace_back([&, s = s.get()] {
      for (uint64_t last = 0;;) {
        const auto lease = s->claim("w", 300);
        if (!lease.ok()) ++failed;
        if (!lease.ok() || !*lease) return;
        if ((*lease)->token <= last) ++failed;  // tokens grow
        last = (*lease)->token;
        if (!s->complete(**lease, files(), 1).ok()) ++failed;
        const std::lock_guard lock(mutex);
        ++taken[(*lease)->task];
        ++tokens[last];
      }
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(failed.load(), 0);
  EXPECT_EQ(taken.size(), size_t(kFrames));
  for (const auto& [task, n] : taken) EXPECT_EQ(n, 1) << task.job << "-" << task.index;
  EXPECT_EQ(tokens.size(), size_t(kFrames));
  EXPECT_EQ(store->totals()->done, 3u);
  EXPECT_EQ(*store->integrity(), "ok");
}

/// Stands still before a statement, COMMIT if nothing else is named, until it is let go.
struct Gate {
  std::string at = "COMMIT";
  std::mutex mutex;
  std::condition_variable wake;
  bool armed = false, reached = false, open = false;
  Status step(const char* text) {
    std::unique_lock lock(mutex);
    if (!armed || std::string(text).rfind(at, 0) != 0) return {};
    armed = false;
    reached = true;
    wake.notify_all();
    wake.wait(lock, [&] { return open; });
    return {};
  }
  void await() {
    std::unique_lock lock(mutex);
    wake.wait(lock, [&] { return reached; });
  }
  void let() {
    const std::lock_guard lock(mutex);
    open = true;
    wake.notify_all();
  }
};

TEST_F(PostgresStore, AChangeThatIsCommittedLateIsNotSkipped) {
  const int64_t id = submit(makeJob(3));
  complete(*claim());  // the job runs: claims of its frames share it
  Gate gate;
  options.step = [&](const char* text) { return gate.step(text); };
  const auto slow = second();
  gate.armed = true;
  std::thread late([&] { EXPECT_TRUE(slow->claim("slow", 30).ok()); });
  gate.await();  // frame 1 is taken, with the older revision, and not committed
  const uint64_t before = store->get(id, false)->revision;
  ASSERT_EQ(claim()->task.index, 2);
  const auto seen = *store->changes(id, before);
  std::set<int64_t> told;
  for (const v1::Frame& f : seen.job.frames()) told.insert(f.frame());
  EXPECT_TRUE(told.count(12));
  EXPECT_FALSE(told.count(11));
  gate.let();
  late.join();
  const auto then = *store->changes(id, seen.revision);
  told.clear();
  for (const v1::Frame& f : then.job.frames()) told.insert(f.frame());
  EXPECT_TRUE(told.count(11)) << "the change that was committed late";
  EXPECT_EQ(store->changes(id, then.revision)->job.frames_size(), 0);  // nothing runs now: nothing is told again
}

TEST_F(PostgresStore, TwoCompletionsAtOnceEndTheJob) {
  const int64_t id = submit(makeJob(2));
  const auto a = claim(), b = claim();
  Gate gate;
  options.step = [&](const char* text) { return gate.step(text); };
  const auto slow = second();
  gate.armed = true;
  std::thread late([&] { EXPECT_TRUE(slow->complete(*a, files(), 1).ok()); });
  gate.await();
  std::thread other([&] { complete(*b); });  // waits for the first
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  gate.let();
  late.join();
  other.join();
  EXPECT_EQ(get(id).state(), v1::Job::DONE);
  EXPECT_EQ(get(id).frames_done(), 2u);
}

TEST_F(PostgresStore, AJobIsNotIdleWhileAClaimOfItIsCommitted) {
  const int64_t id = submit(makeJob(3));
  const auto a = claim();
  Gate gate;
  options.step = [&](const char* text) { return gate.step(text); };
  const auto slow = second();
  gate.armed = true;
  std::thread late([&] { EXPECT_TRUE(slow->claim("slow", 30).ok()); });
  gate.await();
  std::thread other([&] { EXPECT_TRUE(store->release(*a).ok()); });  // no frame runs but the one that is being claimed
  std::this_thread::sleep_for(std::chrono::milliseconds(150));
  gate.let();
  late.join();
  other.join();
  EXPECT_EQ(get(id).state(), v1::Job::RUNNING);
  EXPECT_EQ(*store->integrity(), "ok");
}

TEST_F(PostgresStore, APauseThatMeetsTheFirstClaimIsKept) {
  const int64_t id = submit(makeJob(2));
  Gate gate;
  gate.at = "SELECT idx, frame, progress FROM task";
  options.step = [&](const char* text) { return gate.step(text); };
  const auto slow = second();
  gate.armed = true;
  std::thread late([&] { EXPECT_TRUE(slow->claim("slow", 30).ok()); });
  gate.await();
  std::thread other([&] { EXPECT_TRUE(store->pause(id).ok()); });
  std::this_thread::sleep_for(std::chrono::milliseconds(150));
  gate.let();
  late.join();
  other.join();
  EXPECT_EQ(get(id).state(), v1::Job::PAUSED);
}

TEST_F(PostgresStore, AReportThatMeetsTheEndOfItsLeaseIsRefused) {
  const int64_t id = submit(makeJob(1));
  const auto lease = claim(30);
  Gate gate;
  options.step = [&](const char* text) { return gate.step(text); };
  const auto ender = second();
  gate.armed = true;
  std::thread late([&] { EXPECT_EQ(*ender->endAllLeases(), 1u); });
  gate.await();
  Status status;
  std::thread report([&] { status = store->checkpoint(*lease, {"r", "d", 1, 1}, 0.5, 16).status(); });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  gate.let();
  late.join();
  report.join();
  EXPECT_EQ(status.code(), Code::FailedPrecondition) << status.toString();
  EXPECT_TRUE(store->neededCheckpoints()->empty());
  EXPECT_EQ(get(id).state(), v1::Job::QUEUED);
}

TEST_F(PostgresStore, OneJobForOneKeyAndOneBoundForAll) {
  options.maxActiveTasks = 10;
  std::vector<std::unique_ptr<SqlJobStore>> stores;
  for (int i = 0; i < 4; ++i) stores.push_back(second());
  std::set<int64_t> ids;
  std::mutex mutex;
  std::atomic<int> accepted{0};
  std::vector<std::thread> threads;
  for (auto& s : stores)
    threads.emplace_back([&, s = s.get()] {
      bool existed = false;
      const auto id = s->submit(makeJob(1, "same"), existed);
      EXPECT_TRUE(id.ok()) << id.status().toString();
      for (int i = 0; i < 3; ++i) accepted += s->submit(makeJob(3), existed).ok();
      const std::lock_guard lock(mutex);
      ids.insert(*id);
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(ids.size(), 1u);
  EXPECT_EQ(accepted.load(), 3);  // 1 + 3 x 3 = 10
}

TEST_F(PostgresStore, ManyHandsLeaveCountsRightAndNoDeadlock) {
  const std::string deadlocks = "SELECT sum(deadlocks) FROM pg_stat_database";
  const std::string before = sql(deadlocks);
  constexpr int kJobs = 4;
  for (int i = 0; i < kJobs; ++i) submit(makeJob(12));
  std::vector<std::unique_ptr<SqlJobStore>> stores;
  for (int i = 0; i < 5; ++i) stores.push_back(second());
  std::atomic<int> wrong{0}, done{0};
  std::vector<std::thread> threads;
  for (size_t n = 0; n < stores.size(); ++n)
    threads.emplace_back([&, n, s = stores[n].get()] {
      const auto fine = [&](const Status& status) {  // what another one did first is no fault
        if (status.ok() || status.code() == Code::FailedPrecondition) return;
        ++wrong;
        ADD_FAILURE() << status.toString();
      };
      uint64_t state = n * 977 + 1;
      for (int i = 0; i < 60; ++i) {
        state = state * 6364136223846793005ull + 1442695040888963407ull;
        const int what = int(state >> 33) % 16;
        const int64_t job = 1 + int64_t(state >> 40) % kJobs;
        if (what == 0) fine(s->pause(job));
        else if (what == 1) fine(s->resume(job));
        else if (what == 2) fine(s->endAllLeases().status());
        else if (what == 3) fine(s->expireLeases().status());
        else if (what == 4) fine(s->blame({job, 0}, {Code::Internal, "x"}, false));
        else {
          auto lease = s->claim("w" + std::to_string(n), 30);
          fine(lease.status());
          if (!lease.ok() || !*lease) continue;
          if (what < 8) fine(s->checkpoint(**lease, {"r", std::to_string(i), 1, 1}, 0.5, 4).status());
          if (what < 10) fine(s->renew(**lease, 30).status());
          if (what == 10) fine(s->release(**lease));
          else if (what == 11) fine(s->fail(**lease, {{Code::Internal, "x"}}));
          else fine(s->complete(**lease, files(), 1)), ++done;
        }
      }
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(wrong.load(), 0);
  EXPECT_GT(done.load(), 10);
  EXPECT_EQ(*store->integrity(), "ok");
  EXPECT_EQ(sql("SELECT pg_stat_force_next_flush(); " + deadlocks), before);
}

TEST_F(PostgresStore, LeasesFollowTheServersClockNotTheWorkers) {
  submit(makeJob());
  const auto clock = [](const std::string& ahead) {
    sql("CREATE OR REPLACE FUNCTION gobo.seconds() RETURNS double precision LANGUAGE sql AS 'SELECT extract(epoch FROM clock_timestamp())::double precision "
        "+ " +
        ahead + "'");
  };
  clock("1e6");
  const auto lease = claim(30);
  ASSERT_TRUE(lease);
  EXPECT_NEAR(lease->expires, std::stod(sql("SELECT gobo.seconds()")) + 30, 5);
  EXPECT_EQ(*store->expireLeases(), 0u);
  clock("1e6 + 31");
  EXPECT_EQ(*store->expireLeases(), 1u);
  EXPECT_EQ(store->complete(*lease, files(), 1).code(), Code::FailedPrecondition);
  EXPECT_NEAR(get(1).started_unix_s(), lease->expires - 30, 1);
}

TEST_F(PostgresStore, GoesOnAfterALostConnection) {
  const int64_t id = submit(makeJob(2));
  const std::string terminate = "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity WHERE application_name = 'gobod' AND pid <> pg_backend_pid()";
  sql(terminate);
  const auto lease = claim();  // made anew, and the operation with it
  ASSERT_TRUE(lease);
  // Lost when COMMIT is sent: it may have happened or not, so nothing is done again by itself.
  bool once = true;
  options.step = [&](const char* text) {
    if (once && std::string(text) == "COMMIT") once = false, sql(terminate);
    return Status();
  };
  const auto unlucky = second();
  once = true;
  const Status status = unlucky->complete(*lease, files(), 1);
  EXPECT_EQ(status.code(), Code::Unavailable) << status.toString();
  EXPECT_EQ(get(id).frames_done(), 0u);
  EXPECT_TRUE(unlucky->complete(*lease, files(), 1).ok());  // repeated
  EXPECT_EQ(get(id).frames_done(), 1u);
}

TEST_F(PostgresStore, OutlivesAnImmediateStopOfItsServer) {
  test::PostgresServer server(true);
  auto own = std::move(*PostgresJobStore::open(server.uri()));
  bool existed = false;
  const int64_t id = *own->submit(makeJob(2), existed);
  const auto lease = *own->claim("w", 30);
  ASSERT_TRUE(own->complete(*lease, files(), 1).ok());
  const auto held = *own->claim("w", 30);
  server.stop(SIGQUIT);
  const Status gone = own->complete(*held, files("bb"), 1);
  EXPECT_EQ(gone.code(), Code::Unavailable) << gone.toString();
  EXPECT_NE(gone.location().find("postgresql://gobo@/postgres"), std::string::npos) << gone.location();
  const auto begun = std::chrono::steady_clock::now();
  EXPECT_EQ(own->get(id, false).status().code(), Code::Unavailable);  // at once: the last attempt has only just failed
  EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count(), 0.5);
  server.start();
  std::this_thread::sleep_for(std::chrono::milliseconds(1100));
  EXPECT_TRUE(own->complete(*held, files("bb"), 1).ok());
  EXPECT_EQ(own->get(id, false)->job.state(), v1::Job::DONE);
  const int64_t later = *own->submit(makeJob(1), existed);
  EXPECT_GT(later, id);
  EXPECT_GT((*own->claim("w", 30))->token, held->token);
  EXPECT_EQ(*own->integrity(), "ok");
}

TEST_F(PostgresStore, ErrorsByTheirClass) {
  submit(makeJob(1));
  const auto lease = claim();
  const auto raise = [](const std::string& state, int times) {
    sql("DROP TRIGGER IF EXISTS t ON gobo.file; DROP SEQUENCE IF EXISTS gobo.tries; CREATE SEQUENCE gobo.tries;"
        "CREATE OR REPLACE FUNCTION gobo.fault() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN IF nextval('gobo.tries') <= " +
        std::to_string(times) + " THEN RAISE EXCEPTION 'on purpose' USING ERRCODE = '" + state +
        "'; END IF; RETURN NEW; END $$; CREATE TRIGGER t BEFORE INSERT ON gobo.file FOR EACH ROW EXECUTE FUNCTION gobo.fault()");
  };
  const std::pair<const char*, Code> cases[] = {{"53100", Code::ResourceExhausted}, {"53200", Code::ResourceExhausted}, {"XX001", Code::DataLoss},
                                                {"55P03", Code::Unavailable},       {"57014", Code::Unavailable},       {"42501", Code::PermissionDenied},
                                                {"22012", Code::Internal}};
  for (const auto& [state, code] : cases) {
    raise(state, 1000);
    const Status status = store->complete(*lease, files(), 1);
    EXPECT_EQ(status.code(), code) << state << " " << status.toString();
    EXPECT_NE(status.message().find(state), std::string::npos) << status.message();
    EXPECT_TRUE(store->check(*lease).ok());
  }
  raise("40P01", 1000);
  EXPECT_EQ(store->complete(*lease, files(), 1).code(), Code::Unavailable);  // not for ever
  EXPECT_LT(std::stoi(sql("SELECT last_value FROM gobo.tries")), 50);
  raise("40001", 3);
  EXPECT_TRUE(store->complete(*lease, files(), 1).ok());  // run again until it passes
  EXPECT_EQ(sql("SELECT last_value FROM gobo.tries"), "4");
  EXPECT_EQ(get(1).frames_done(), 1u);
}

TEST_F(PostgresStore, TakesAnyText) {
  const int64_t id = submit(makeJob(1));
  const std::string odd("a\0b\xff\xc3\xa9?1'\\", 10);
  EXPECT_TRUE(store->fail(*claim(), {{Code::Internal, odd}, false}).ok());
  EXPECT_EQ(get(id).state(), v1::Job::FAILED);
  EXPECT_NE(get(id).frames(0).error().message().find("\xc3\xa9?1'\\"), std::string::npos);
}

TEST_F(PostgresStore, RefusesWhatIsNoStoreOfItsOwn) {
  const std::string uri = test::postgresServer().uri();
  EXPECT_TRUE(PostgresJobStore::check(uri).ok());
  sql("UPDATE gobo.store SET version = 3");
  for (const Status& status : {PostgresJobStore::open(uri).status(), PostgresJobStore::check(uri)}) {
    EXPECT_EQ(status.code(), Code::FailedPrecondition) << status.toString();
    EXPECT_NE(status.message().find("version 3"), std::string::npos) << status.message();
  }
  EXPECT_EQ(sql("SELECT version FROM gobo.store"), "3");
  dropSchema();
  sql("CREATE SCHEMA gobo; CREATE TABLE gobo.others(x int)");
  EXPECT_EQ(PostgresJobStore::open(uri).status().code(), Code::FailedPrecondition);
  dropSchema();
  EXPECT_TRUE(PostgresJobStore::check(uri).ok());  // it could be made
  JobStoreOptions keep;
  keep.create = false;
  EXPECT_EQ(PostgresJobStore::open(uri, keep).status().code(), Code::DataLoss);
  sql("DO $$ BEGIN IF NOT EXISTS(SELECT 1 FROM pg_roles WHERE rolname = 'guest') THEN CREATE ROLE guest LOGIN; END IF; END $$;"
      "REVOKE CREATE ON DATABASE postgres FROM PUBLIC");
  std::string guest = uri;
  guest.replace(guest.find("gobo@"), 5, "guest@");
  EXPECT_EQ(PostgresJobStore::check(guest).code(), Code::PermissionDenied);
  EXPECT_EQ(PostgresJobStore::open(guest).status().code(), Code::PermissionDenied);
  open();
  EXPECT_EQ(PostgresJobStore::check(guest).code(), Code::PermissionDenied) << "it may not read the tables";
  sql("DROP DATABASE IF EXISTS ascii");
  sql("CREATE DATABASE ascii ENCODING 'SQL_ASCII' TEMPLATE template0");
  std::string ascii = uri;
  ascii.replace(ascii.find("/postgres?"), 10, "/ascii?");
  EXPECT_EQ(PostgresJobStore::check(ascii).code(), Code::FailedPrecondition);
  const Status unreachable = PostgresJobStore::check("postgresql://gobo@/postgres?host=/nonexistent");
  EXPECT_EQ(unreachable.code(), Code::Unavailable);
  EXPECT_NE(unreachable.toString().find("/nonexistent"), std::string::npos);
}

TEST_F(PostgresStore, AStoreOfVersionOneIsTakenOver) {
  const int64_t old = submit(makeJob(2));
  const auto lease = claim();
  ASSERT_TRUE(lease);
  store.reset();
  Postgres db(test::postgresServer().uri(), 5);
  ASSERT_TRUE(db.connect().ok());
  ASSERT_TRUE(
      db.exec("SET search_path = gobo; DROP TABLE log; DROP TABLE depend; DROP INDEX task_queued; ALTER TABLE task DROP COLUMN waits, DROP COLUMN whole;"
              "ALTER TABLE job DROP COLUMN parts; CREATE INDEX task_queued ON task(job, idx) WHERE state = 1; UPDATE store SET version = 1")
          .ok());
  open();
  EXPECT_EQ(*db.exec("SELECT version FROM gobo.store"), "2");
  EXPECT_TRUE(store->complete(*lease, files(), 1).ok()) << "what was running goes on";
  const auto next = claim();
  ASSERT_TRUE(next);
  EXPECT_EQ(next->task, (TaskId{old, 1}));
  NewJob split = makeJob(1);
  split.parts = 2;
  const int64_t id = submit(split);
  const auto part = claim();
  ASSERT_TRUE(part);
  EXPECT_EQ(part->task, (TaskId{id, 1}));
  EXPECT_EQ(*store->integrity(), "ok");
}

TEST_F(PostgresStore, RevisionsGoOnInADatabaseThatWasRestored) {
  const int64_t id = submit(makeJob(2));
  sql("UPDATE gobo.task SET revision = 1000000000000");  // as of a cluster that had seen more transactions
  open();
  const auto lease = claim();
  const uint64_t seen = store->get(id, false)->revision;
  EXPECT_GT(seen, 1000000000000u);
  complete(*lease);
  const auto news = *store->changes(id, seen);
  ASSERT_EQ(news.job.frames_size(), 1);
  EXPECT_EQ(news.job.frames(0).state(), v1::Frame::DONE);
  open();  // once
  EXPECT_EQ(store->changes(id, news.revision)->job.frames_size(), 0);
  EXPECT_LT(store->get(id, false)->revision, 1000000100000u);
}

TEST_F(PostgresStore, TheFolderAndItsDatabaseBelongTogether) {
  JobFiles files_;
  bool alone = false;
  ASSERT_TRUE(files_.open(folder + "/jobs", alone).ok());
  files_.opened();
  const std::string uri = test::postgresServer().uri();
  {
    const auto opened = openPostgresStore(files_, uri);
    ASSERT_TRUE(opened.ok()) << opened.status().toString();
    EXPECT_EQ(*(*opened)->identity(), *files_.identity());
  }
  EXPECT_TRUE(openPostgresStore(files_, uri).ok());
  store.reset();
  dropSchema();
  const Status lost = openPostgresStore(files_, uri).status();
  EXPECT_EQ(lost.code(), Code::DataLoss) << lost.toString();
  EXPECT_NE(lost.message().find("restore the database"), std::string::npos) << lost.message();
  open();  // another store
  EXPECT_EQ(openPostgresStore(files_, uri).status().code(), Code::FailedPrecondition);
}

TEST_F(PostgresStore, OthersHearOfWorkAndOfSteering) {
  std::atomic<int> work{0}, steered{0};
  JobNews news(test::postgresServer().uri(), [&](bool s) { ++(s ? steered : work); });
  const auto until = [](const std::function<bool()>& what) {
    for (int i = 0; i < 800 && !what(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return what();
  };
  ASSERT_TRUE(until([&] { return steered == 1; })) << "connected: something may have been missed";
  const int64_t id = submit(makeJob());
  EXPECT_TRUE(until([&] { return work == 1; }));
  EXPECT_EQ(steered.load(), 1);
  ASSERT_TRUE(store->pause(id).ok());
  EXPECT_TRUE(until([&] { return steered == 2; }));
  sql("SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity WHERE query LIKE 'LISTEN%'");
  EXPECT_TRUE(until([&] { return steered == 3; })) << "connected anew";
  ASSERT_TRUE(store->cancel(id).ok());
  EXPECT_TRUE(until([&] { return steered == 4; }));
}

TEST(PostgresUri, IsCheckedAndNamesNoSecret) {
  EXPECT_TRUE(checkPostgresUri("postgresql:///gobo?host=/run/postgresql").ok());
  EXPECT_EQ(postgresName("postgresql://me@db.example:5433/gobo?sslmode=verify-full"), "postgresql://me@db.example:5433/gobo");
  for (const char* bad : {"postgresql://me:hunter2@db/gobo", "postgresql://db/gobo?password=hunter2", "postgresql://me:hunter2@x@db:y/gobo",
                          "postgresql://db/gobo?nonsense=hunter2@", "host=db password=hunter2", "mysql://hunter2/x", ""}) {
    const Status status = checkPostgresUri(bad);
    EXPECT_EQ(status.code(), Code::InvalidArgument) << bad;
    EXPECT_EQ(status.toString().find("hunter2"), std::string::npos) << status.toString();
    ServerConfig config;
    config.jobsFolder = "/tmp/x";
    config.jobsStore = bad;
    if (*bad) { EXPECT_NE(checkConfig(config).message().find("jobs.store"), std::string::npos); }
    EXPECT_EQ(checkConfig(config).toString().find("hunter2"), std::string::npos);
  }
  ServerConfig config;
  config.jobsStore = "postgresql:///gobo";
  EXPECT_NE(checkConfig(config).message().find("jobs.folder"), std::string::npos);
}

}  // namespace
}  // namespace gobo::postgres_job_store_test
