// SPDX-License-Identifier: Apache-2.0
// A job store in a fresh folder with a clock that stands still until it is told to move.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>

#include "server/jobs/sqlite_job_store.h"

namespace gobo::test {

struct StoreFixture : ::testing::Test {
  std::string folder;
  double time = 1000;
  JobStoreOptions options;
  std::unique_ptr<SqliteJobStore> store;

  void SetUp() override {
    folder = (std::filesystem::temp_directory_path() / "gobo-jobs-XXXXXX").string();
    ASSERT_NE(::mkdtemp(folder.data()), nullptr);
    options.now = [this] { return time; };
    open();
  }
  void TearDown() override {
    store.reset();
    std::filesystem::remove_all(folder);
  }
  std::string path() const { return folder + "/jobs.sqlite"; }
  void open() {
    store.reset();
    auto opened = SqliteJobStore::open(path(), options);
    ASSERT_TRUE(opened.ok()) << opened.status().toString();
    store = std::move(*opened);
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

}  // namespace gobo::test
