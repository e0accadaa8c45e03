// SPDX-License-Identifier: Apache-2.0
// A job store in a fresh folder, or in a fresh schema of this program's PostgreSQL server, with a clock that stands still until it is told
// to move.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>

#include "server/jobs/postgres_job_store.h"
#include "server/jobs/sqlite_job_store.h"
#include "support/postgres_server.h"

namespace gobo::test {

struct StoreFixture : ::testing::Test {
  std::string folder;
  double time = 1000;
  JobStoreOptions options;
  std::unique_ptr<SqlJobStore> store;

  virtual bool postgres() const { return false; }
  void SetUp() override {
    makePlace();
    if (IsSkipped() || HasFatalFailure()) return;
    options.now = [this] { return time; };
    open();
  }
  void makePlace() {
    if (postgres()) {
      if (const std::string why = withoutPostgres(); !why.empty()) GTEST_SKIP() << why;
      dropSchema();
    }
    folder = (std::filesystem::temp_directory_path() / "gobo-jobs-XXXXXX").string();
    ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  }
  void TearDown() override {
    store.reset();
    if (!folder.empty()) std::filesystem::remove_all(folder);
  }
  static void dropSchema() {
    Postgres db(postgresServer().uri(), 5);
    ASSERT_TRUE(db.connect().ok());
    ASSERT_TRUE(db.exec("SET client_min_messages = error; DROP SCHEMA IF EXISTS gobo CASCADE").ok());
  }
  std::string path() const { return folder + "/jobs.sqlite"; }
  void open() {
    store.reset();
    auto opened = another();
    ASSERT_TRUE(opened.ok()) << opened.status().toString();
    store = std::move(*opened);
  }
  /// As another process opens it.
  Result<std::unique_ptr<SqlJobStore>> another() const {
    const auto upcast = [](auto opened) -> Result<std::unique_ptr<SqlJobStore>> {
      if (!opened.ok()) return opened.status();
      return std::unique_ptr<SqlJobStore>(std::move(*opened));
    };
    return postgres() ? upcast(PostgresJobStore::open(postgresServer().uri(), options)) : upcast(SqliteJobStore::open(path(), options));
  }
  static NewJob makeJob(int frames = 1, const std::string& key = "", v1::JobSpec::Priority priority = v1::JobSpec::MEDIUM, double deadline = 0) {
    NewJob job;
    job.spec.set_name("test");
    job.spec.mutable_request()->set_scene("cornell");
    job.spec.set_key(key);
    job.spec.set_priority(priority);
    job.spec.set_max_attempts(3);
    if (deadline > 0) job.spec.set_deadline_unix_s(deadline);
    job.client = "me";
    job.digest = "d";
    job.sceneHash = "h";
    job.sceneSource = "cornell";
    for (int i = 0; i < frames; ++i) job.frames.push_back(10 + i);
    return job;
  }
  int64_t submit(const NewJob& job) {
    bool existed = false;
    auto id = store->submit(job, existed);
    EXPECT_TRUE(id.ok()) << id.status().toString();
    return id.ok() ? *id : 0;
  }
  std::optional<Lease> claim(double seconds = 30, const std::string& holder = "w") {
    auto lease = store->claim(holder, seconds);
    EXPECT_TRUE(lease.ok()) << lease.status().toString();
    return lease.ok() ? *lease : std::nullopt;
  }
  v1::Job get(int64_t id) {
    auto record = store->get(id, true);
    EXPECT_TRUE(record.ok()) << record.status().toString();
    return record.ok() ? record->job : v1::Job();
  }
  static std::vector<v1::FrameFile> files(const std::string& digest = "aa") {
    v1::FrameFile f;
    f.set_output("beauty");
    f.set_bytes(7);
    f.set_sha256(digest);
    return {f};
  }
};

/// `Fixture` for each kind of store: a test that is written with TEST_P holds for both. INSTANTIATE_TEST_SUITE_P(Stores, SUITE, kBothStores, storeName).
template <typename Fixture>
struct OnEachStore : Fixture, ::testing::WithParamInterface<bool> {
  bool postgres() const override { return GetParam(); }
};
inline const auto kBothStores = ::testing::Bool();
inline std::string storeName(const ::testing::TestParamInfo<bool>& info) { return info.param ? "Postgres" : "Sqlite"; }

}  // namespace gobo::test
