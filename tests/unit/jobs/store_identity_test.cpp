// SPDX-License-Identifier: Apache-2.0
// What becomes of a jobs folder whose store is lost, empty, another's, older than its results, or of an earlier version; and of one whose
// first start was killed. Results stay unless the store itself made and gave up their job.
#include "server/jobs/store_identity.h"
#include "import/load.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include <filesystem>
#include <fstream>

#include "server/jobs/durable_jobs.h"
#include "server/log.h"
#include "unit/jobs/store_fixture.h"

namespace gobo::store_identity_test {
namespace {

namespace fs = std::filesystem;

struct Identity : ::testing::Test {
  std::string folder;
  void SetUp() override {
    setLogLevel(LogLevel::Off);
    folder = (fs::temp_directory_path() / "gobo-identity-XXXXXX").string();
    ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  }
  void TearDown() override { fs::remove_all(folder); }
  std::string jobs() const { return folder + "/jobs"; }
  std::string database() const { return jobs() + "/jobs.sqlite"; }

  /// One start of a daemon's job side, alone: open and sweep. What went wrong, or Ok; `work` has the store meanwhile.
  Status start(const std::function<void(JobFiles&, SqliteJobStore&)>& work = {}) {
    JobFiles files;
    bool alone = false;
    GOBO_TRY(files.open(jobs(), alone));
    EXPECT_TRUE(alone);
    GOBO_ASSIGN(const auto store, openStore(files));
    GOBO_TRY(store->endAllLeases().status());
    GOBO_TRY(files.sweep(*store, 0));
    files.opened();
    if (work) work(files, *store);
    return {};
  }
  /// A job whose one frame is done, its result on disk.
  static int64_t finish(JobFiles& files, SqliteJobStore& store, const std::string& text) {
    bool existed = false;
    const auto id = store.submit(test::StoreFixture::makeJob(), existed);
    EXPECT_TRUE(id.ok()) << id.status().toString();
    const auto lease = store.claim("w", 30);
    EXPECT_TRUE(lease.ok() && *lease);
    EXPECT_EQ((*lease)->task.job, *id);
    EXPECT_TRUE(files.write(files.resultPath(*id, text), text.data(), text.size()).ok());
    EXPECT_TRUE(store.complete(**lease, test::StoreFixture::files(text), 1).ok());
    return *id;
  }
  std::string result(int64_t id, const std::string& text) const { return jobs() + "/results/" + std::to_string(id) + "/" + text; }
  void removeDatabase() {
    for (const char* tail : {"", "-wal", "-shm"}) fs::remove(database() + tail);
  }
  std::string identity() const {
    std::ifstream in(jobs() + "/identity");
    std::string text;
    std::getline(in, text);
    return text;
  }
};

TEST_F(Identity, AMissingOrEmptyDatabaseBesideResultsIsRefusedAndNothingIsSwept) {
  int64_t id = 0;
  ASSERT_TRUE(start([&](JobFiles& f, SqliteJobStore& s) { id = finish(f, s, "aa"); }).ok());
  fs::copy_file(database(), folder + "/saved");
  const std::string named = identity();
  EXPECT_EQ(named.size(), 32u);
  for (const char* how : {"missing", "empty", "no tables"})
    for (const bool withIdentity : {true, false}) {
      SCOPED_TRACE(std::string(how) + (withIdentity ? "" : ", no identity"));
      removeDatabase();
      fs::remove(jobs() + "/identity");
      if (withIdentity) std::ofstream(jobs() + "/identity") << named << "\n";
      if (how == std::string("empty")) std::ofstream(database()).flush();
      if (how == std::string("no tables")) {
        Sqlite db;
        ASSERT_TRUE(db.open(database(), 1).ok());
      }
      for (int k = 0; k < 2; ++k) {
        const Status s = start();
        EXPECT_EQ(s.code(), Code::DataLoss) << s.toString();
        EXPECT_EQ(s.location(), database());
        EXPECT_NE(s.message().find("restore jobs.sqlite"), std::string::npos) << s.toString();
        EXPECT_NE(s.message().find("move the whole folder away"), std::string::npos) << s.toString();
        EXPECT_TRUE(fs::exists(result(id, "aa")));
      }
    }
  // The remedy works: the backup comes back.
  removeDatabase();
  fs::copy_file(folder + "/saved", database());
  std::ofstream(jobs() + "/identity") << named << "\n";
  EXPECT_TRUE(start([&](JobFiles&, SqliteJobStore& s) { EXPECT_EQ(s.get(id, false)->job.state(), v1::Job::DONE); }).ok());
  EXPECT_TRUE(fs::exists(result(id, "aa")));
  // As does the other one.
  fs::rename(jobs(), folder + "/away");
  EXPECT_TRUE(start().ok());
  EXPECT_NE(identity(), named);
}

TEST_F(Identity, ADaemonDoesNotStartOnALostDatabase) {
  int64_t id = 0;
  ASSERT_TRUE(start([&](JobFiles& f, SqliteJobStore& s) { id = finish(f, s, "aa"); }).ok());
  removeDatabase();
  EngineOptions o;
  o.loader = inProcessLoader();
  o.threads = 1;
  const auto engine = std::move(*Engine::create(o));
  JobRunner runner{SchedulerOptions()};
  ServerConfig config;
  config.jobsFolder = jobs();
  const auto started = DurableJobs::start(*engine, runner, config);
  EXPECT_EQ(started.status().code(), Code::DataLoss) << started.status().toString();
  EXPECT_TRUE(fs::exists(result(id, "aa")));
}

TEST_F(Identity, AnotherFoldersDatabaseIsRefused) {
  int64_t id = 0;
  ASSERT_TRUE(start([&](JobFiles& f, SqliteJobStore& s) { id = finish(f, s, "aa"); }).ok());
  fs::rename(jobs(), folder + "/first");
  ASSERT_TRUE(start([&](JobFiles& f, SqliteJobStore& s) { finish(f, s, "bb"); }).ok());
  const std::string other = identity();
  fs::copy_file(folder + "/first/jobs.sqlite", database(), fs::copy_options::overwrite_existing);
  fs::remove(database() + "-wal");
  const Status s = start();
  EXPECT_EQ(s.code(), Code::FailedPrecondition) << s.toString();
  EXPECT_NE(s.message().find(other), std::string::npos) << s.toString();
  EXPECT_NE(s.message().find("/identity"), std::string::npos) << s.toString();
  EXPECT_TRUE(fs::exists(result(1, "bb")));
  std::ofstream(jobs() + "/identity") << "nonsense";
  EXPECT_EQ(start().code(), Code::DataLoss);
  EXPECT_EQ(start().location(), jobs() + "/identity");
}

TEST_F(Identity, AKillAnywhereInTheFirstStartIsFollowedByAStart) {
  for (int at = 0; at < 5; ++at) {
    fs::remove_all(jobs());
    const pid_t child = ::fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      JobFiles files;
      bool alone = false;
      int step = 0;
      if (!files.open(jobs(), alone).ok()) ::_exit(1);
      if (at == 0) ::_exit(9);  // folders, no store
      files.step = [&](const char*, const std::string&) {
        if (++step == at) ::_exit(9);
        return Status();
      };  // store, file half made
      (void)openStore(files);
      ::_exit(2);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    ASSERT_EQ(WEXITSTATUS(status), 9) << at;
    std::string id;
    const Status s = start([&](JobFiles&, SqliteJobStore& store) { id = *store.identity(); });
    EXPECT_TRUE(s.ok()) << at << ": " << s.toString();
    EXPECT_EQ(identity(), id) << at;
    EXPECT_TRUE(start().ok()) << at;
  }
  // SQLite was killed before its first commit: a file without tables, and nobody was promised anything.
  fs::remove_all(jobs());
  fs::create_directories(jobs());
  ::chmod(jobs().c_str(), 0700);
  std::ofstream(database()).flush();
  EXPECT_TRUE(start().ok());
}

TEST_F(Identity, AFolderOfVersionOneIsTakenOver) {
  int64_t done = 0, waiting = 0;
  ASSERT_TRUE(start([&](JobFiles& f, SqliteJobStore& s) {
                done = finish(f, s, "aa");
                bool existed = false;
                waiting = *s.submit(test::StoreFixture::makeJob(), existed);
                ASSERT_TRUE(*s.claim("killed", 30));
              }).ok());
  {
    // As version 1 left it: times of the wall clock, no identity.
    Sqlite db;
    ASSERT_TRUE(db.open(database(), 1).ok());
    ASSERT_TRUE(db.exec("DROP TABLE log; DROP TABLE depend; DROP INDEX task_queued; ALTER TABLE task DROP COLUMN waits; ALTER TABLE task DROP COLUMN whole;"
                        "ALTER TABLE job DROP COLUMN parts; CREATE INDEX task_queued ON task(job, idx) WHERE state = 1;"
                        "DROP TABLE identity; DROP TABLE clock; DROP TABLE unowned; ALTER TABLE job DROP COLUMN ended_uptime;"
                        "UPDATE task SET expires = 1.9e9, ready = 1.9e9; PRAGMA user_version = 1")
                    .ok());
  }
  fs::remove(jobs() + "/identity");
  ASSERT_TRUE(start([&](JobFiles&, SqliteJobStore& s) {
                EXPECT_EQ(s.get(done, true)->job.frames(0).files(0).sha256(), "aa");
                EXPECT_EQ(s.expireResults(1 << 20, 3600)->size(), 0u);
                const auto lease = s.claim("w", 30);
                ASSERT_TRUE(lease.ok() && *lease) << "waits for a time of the wall clock";
                EXPECT_EQ((*lease)->task.job, waiting);
                EXPECT_EQ(*s.identity(), identity());
              }).ok());
  EXPECT_TRUE(fs::exists(result(done, "aa")));
  EXPECT_EQ(identity().size(), 32u);
}

TEST_F(Identity, AnOlderCopyOfTheDatabaseLeavesNewerResultsAndTheirIdsAlone) {
  int64_t old = 0, open = 0;
  ASSERT_TRUE(start([&](JobFiles& f, SqliteJobStore& s) {
                old = finish(f, s, "aa");
                bool existed = false;
                open = *s.submit(test::StoreFixture::makeJob(), existed);
              }).ok());
  fs::copy_file(database(), folder + "/backup");
  std::vector<int64_t> newer;
  ASSERT_TRUE(start([&](JobFiles& f, SqliteJobStore& s) {
                const auto lease = s.claim("w", 30);  // the job that the backup knows as waiting
                ASSERT_EQ((*lease)->task.job, open);
                ASSERT_TRUE(f.write(f.resultPath(open, "oo"), "oo", 2).ok());
                ASSERT_TRUE(s.complete(**lease, test::StoreFixture::files("oo"), 1).ok());
                for (const char* text : {"bb", "cc", "dd"}) newer.push_back(finish(f, s, text));
                ASSERT_TRUE(f.write(f.checkpointPath({newer.back() + 1, 0}, std::string(32, 'e')), "e", 1).ok());
              }).ok());
  removeDatabase();
  fs::copy_file(folder + "/backup", database());
  for (int k = 0; k < 3; ++k) {
    ASSERT_TRUE(start([&](JobFiles& f, SqliteJobStore& s) {
                  EXPECT_TRUE(fs::exists(result(old, "aa")));
                  EXPECT_TRUE(fs::exists(result(newer[0], "bb")));
                  EXPECT_TRUE(fs::exists(result(newer[1], "cc")));
                  EXPECT_TRUE(fs::exists(result(newer[2], "dd")));
                  EXPECT_TRUE(fs::exists(f.checkpointPath({newer.back() + 1, 0}, std::string(32, 'e'))));
                  if (k == 0) {
                    EXPECT_TRUE(fs::exists(result(open, "oo")));  // what its frame comes to again
                    const auto lease = s.claim("w", 30);
                    ASSERT_TRUE(lease.ok() && *lease);
                    EXPECT_EQ((*lease)->task.job, open);
                    ASSERT_TRUE(s.complete(**lease, test::StoreFixture::files("oo"), 1).ok());
                  }
                  const int64_t fresh = finish(f, s, "ff");
                  EXPECT_GT(fresh, newer.back() + 1) << "an id that is taken";
                  EXPECT_TRUE(s.remove(fresh).ok());  // its own: swept at the next start
                }).ok());
  }
  EXPECT_TRUE(start().ok());
  for (int64_t id = newer.back() + 2; id < newer.back() + 5; ++id) EXPECT_FALSE(fs::exists(result(id, "ff"))) << id;
}

TEST_F(Identity, AFolderRemovedUnderADaemonTakesNoPromises) {
  ASSERT_TRUE(start([&](JobFiles& f, SqliteJobStore& s) {
                const int64_t id = finish(f, s, "aa");
                bool existed = false;
                ASSERT_TRUE(s.submit(test::StoreFixture::makeJob(), existed).ok());
                const auto lease = s.claim("w", 30);
                ASSERT_TRUE(lease.ok() && *lease);
                fs::rename(jobs(), folder + "/away");
                const std::vector<Status> refused = {s.submit(test::StoreFixture::makeJob(), existed).status(),
                                                     s.complete(**lease, test::StoreFixture::files("bb"), 1), s.claim("w", 30).status(), s.cancel(id + 1),
                                                     f.write(f.resultPath(id, "bb"), "bb", 2)};
                for (size_t i = 0; i < refused.size(); ++i) EXPECT_TRUE(i == 2 || !refused[i].ok()) << i;  // nothing is ready for a claim: no promise either
                EXPECT_EQ(refused[0].code(), Code::Unavailable) << refused[0].toString();
                EXPECT_EQ(refused[0].location(), database());
                EXPECT_EQ(refused[1].code(), Code::Unavailable);  // a worker repeats it
                fs::rename(folder + "/away", jobs());             // put back: it goes on
                EXPECT_TRUE(s.complete(**lease, test::StoreFixture::files("bb"), 1).ok());
              }).ok());
}

TEST_F(Identity, ADatabaseReplacedUnderADaemonTakesNoPromises) {
  ASSERT_TRUE(start([&](JobFiles& f, SqliteJobStore& s) {
                const int64_t id = finish(f, s, "aa");
                const std::string saved = folder + "/saved";
                fs::rename(database(), saved);
                fs::copy_file(saved, database());  // the same bytes, another file
                bool existed = false;
                const Status refused = s.submit(test::StoreFixture::makeJob(), existed).status();
                EXPECT_EQ(refused.code(), Code::Unavailable) << refused.toString();
                fs::rename(saved, database());  // put back: it goes on
                EXPECT_GT(finish(f, s, "bb"), id);
              }).ok());
}

}  // namespace
}  // namespace gobo::store_identity_test
