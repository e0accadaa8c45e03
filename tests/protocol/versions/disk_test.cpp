// SPDX-License-Identifier: Apache-2.0
// Files between releases: what each release left on the disk (RELEASE/disk) is read by this build, or set aside with a line that names file,
// version found and version supported; so are files one version older or newer. Caches are made again; the store of jobs is read or refused and
// in no case changed or swept.
#include <map>
#include <mutex>

#include "gobo/v1/jobs.grpc.pb.h"
#include "plan/disk_store.h"
#include "protocol/server/harness.h"
#include "scene/environment.h"
#include "server/blob_cache.h"
#include "server/jobs/crash_marks.h"
#include "server/jobs/store_identity.h"
#include "server/jobs/task_checkpoints.h"
#include "support/blob_bytes.h"
#include "support/releases.h"
#include "support/sealable_scene.h"
#include "terms/term_file.h"
#include "unit/jobs/store_fixture.h"
#include "unit/plan/term_maker.h"

namespace gobo::release_files_test {
namespace {

using namespace testing;  // gobo's

namespace fs = std::filesystem;
using test::fileOf;
using test::key;
using test::makeTerm;
using test::TempFolder;

constexpr int kTerms = 3;

void copyFolder(const std::string& from, const std::string& to) {
  fs::create_directories(to);
  fs::copy(from, to, fs::copy_options::recursive | fs::copy_options::overwrite_existing);
}
BlobBytes blobIn(const std::string& path) {
  const std::string bytes = readAll(path);
  return {{bytes.begin(), bytes.end()}};
}
void write(const std::string& path, const std::vector<uint8_t>& bytes) { writeAll(path, std::string(bytes.begin(), bytes.end())); }
std::vector<uint8_t> bytesOfTerm(int i) { return serializeTerm(*makeTerm(i, 40), key(i)); }
uint8_t termVersion() { return bytesOfTerm(0)[7]; }
/// A whole file of another version.
std::vector<uint8_t> withTermVersion(std::vector<uint8_t> bytes, uint8_t version) {
  bytes[7] = version;
  const Hash128 digest = hashBytes(bytes.data(), bytes.size() - 16);
  std::memcpy(bytes.data() + bytes.size() - 16, &digest, 16);
  return bytes;
}
BlobBytes withBlobVersion(BlobBytes blob, uint32_t version) {
  std::memcpy(blob.bytes.data() + 8, &version, 4);
  blob.mend();
  return blob;
}
void setUserVersion(const std::string& database, int version) {
  Sqlite db;
  ASSERT_TRUE(db.open(database, 1).ok());
  ASSERT_TRUE(db.exec("PRAGMA user_version = " + std::to_string(version)).ok());
}
int userVersion(const std::string& database) {
  Sqlite db;
  EXPECT_TRUE(db.open(database, 1).ok());
  const auto text = db.value("PRAGMA user_version");
  return text.ok() ? std::atoi(text->c_str()) : -1;
}
/// One file, as it is between two processes.
void closeLog(const std::string& database) {
  {
    Sqlite db;
    ASSERT_TRUE(db.open(database, 1).ok());
    ASSERT_TRUE(db.value("PRAGMA wal_checkpoint(TRUNCATE)").ok());
  }
  for (const char* tail : {"-wal", "-shm"}) fs::remove(database + tail);
}
/// Names and bytes of all files below, but for the lock and what SQLite keeps beside a database.
std::map<std::string, std::string> contents(const std::string& folder) {
  std::map<std::string, std::string> out;
  for (const auto& e : fs::recursive_directory_iterator(folder)) {
    const std::string name = e.path().filename().string();
    if (e.is_regular_file() && name != "lock" && name.find("sqlite-") == std::string::npos)
      out[fs::relative(e.path(), folder).string()] = readAll(e.path().string());
  }
  return out;
}

/// Lines of the log while it lives.
struct Lines {
  std::mutex mutex;
  std::vector<std::string> lines;
  Lines() {
    setLogLevel(LogLevel::Warn);
    setLogSink([this](const std::string& line) {
      const std::lock_guard hold(mutex);
      lines.push_back(line);
    });
  }
  ~Lines() {
    setLogSink({});
    setLogLevel(LogLevel::Off);
  }
  /// Lines that have every part.
  size_t with(const std::vector<std::string>& parts) {
    const std::lock_guard hold(mutex);
    return size_t(std::count_if(lines.begin(), lines.end(), [&](const std::string& line) {
      return std::all_of(parts.begin(), parts.end(), [&](const std::string& p) { return line.find(p) != std::string::npos; });
    }));
  }
  std::string all() {
    const std::lock_guard hold(mutex);
    std::string out;
    for (const std::string& line : lines) out += line + "\n";
    return out;
  }
};

/// The store of jobs and what lies beside it: a finished job of a real server, and one that waits with a checkpoint.
struct JobsOfAServer : ServerTest {
  Lines log;
  std::string jobsFolder;
  void configure(ServerConfig& c) override {
    jobsFolder = c.jobsFolder = folder + "/jobs";
    setLogLevel(LogLevel::Warn);
    c.logLevel = "warn";
  }
  void record() {
    const auto jobs = v1::Jobs::NewStub(channel);
    v1::JobSpec spec;
    spec.set_name("shot");
    spec.set_key("shot");
    spec.set_client("me");
    *spec.mutable_request() = small(4);
    spec.mutable_request()->set_width(16);
    spec.mutable_request()->set_height(12);
    spec.mutable_frames()->set_last(2);
    grpc::ClientContext context, watching;
    bound(context);
    bound(watching);
    v1::Job job;
    ASSERT_TRUE(jobs->Submit(&context, spec, &job).ok());
    v1::WatchJobRequest watch;
    watch.set_id(job.id());
    auto reader = jobs->Watch(&watching, watch);
    for (v1::JobEvent e; reader->Read(&e);) {}
    server->shutdown(0);
    server.reset();
    JobFiles files;
    bool alone = false;
    ASSERT_TRUE(files.open(jobsFolder, alone).ok());
    {
      auto store = std::move(*openStore(files));
      bool existed = false;
      const auto id = store->submit(test::StoreFixture::makeJob(1, "waiting"), existed);
      ASSERT_TRUE(id.ok());
      const auto lease = store->claim("w", 30);
      ASSERT_TRUE(lease.ok() && *lease);
      TaskCheckpoints writing(*store, files, **lease, {});
      writing.save(key(9), 1, makeTerm(9, 20));
      ASSERT_TRUE(writing.flush(0.5, 16).ok());
      ASSERT_TRUE(store->release(**lease).ok());
      ASSERT_TRUE(store->pause(*id).ok());
    }
    closeLog(jobsFolder + "/jobs.sqlite");
    for (const auto& [name, bytes] : contents(jobsFolder)) writeAll(releaseFile(thisRelease(), "disk/jobs/" + name), bytes);
  }
  /// The server again, over the jobs of the release as `change` leaves them.
  Status start(const std::string& release, const std::function<void()>& change = {}) {
    if (server) server->shutdown(0);
    server.reset();
    fs::remove_all(jobsFolder);
    copyFolder(releaseFile(release, "disk/jobs"), jobsFolder);
    fs::permissions(jobsFolder, fs::perms::owner_all);
    if (change) change();
    auto started = Server::start(config, engineOptions(config), true);
    if (!started.ok()) return started.status();
    server = std::move(*started);
    channel = grpc::CreateChannel(server->addresses()[0], grpc::InsecureChannelCredentials());
    return {};
  }
  v1::ListJobsReply list() {
    grpc::ClientContext context;
    bound(context);
    v1::ListJobsReply reply;
    EXPECT_TRUE(v1::Jobs::NewStub(channel)->List(&context, {}, &reply).ok());
    return reply;
  }
};

TEST_F(JobsOfAServer, OfEveryReleaseAreThere) {
  if (recording()) record();
  for (const std::string& release : releases()) {
    SCOPED_TRACE(release);
    const Status started = start(release);
    ASSERT_TRUE(started.ok()) << started.toString();
    const v1::ListJobsReply reply = list();
    ASSERT_EQ(reply.jobs_size(), 2);
    EXPECT_EQ(reply.jobs(0).spec().key(), "waiting");
    EXPECT_EQ(reply.jobs(0).state(), v1::Job::PAUSED);
    EXPECT_EQ(reply.jobs(0).progress(), 0.5);
    const v1::Job& done = reply.jobs(1);
    EXPECT_EQ(done.state(), v1::Job::DONE) << done.ShortDebugString();
    EXPECT_EQ(done.spec().name(), "shot");
    EXPECT_EQ(done.spec().request().width(), 16u);
    grpc::ClientContext context;
    bound(context);
    v1::FetchRequest fetch;
    fetch.set_id(done.id());
    auto reader = v1::Jobs::NewStub(channel)->Fetch(&context, fetch);
    std::vector<std::string> digests, bytes;
    for (v1::FetchReply part; reader->Read(&part);) {
      if (part.has_file()) digests.push_back(part.file().file().sha256()), bytes.emplace_back();
      else bytes.back() += part.chunk().data();
    }
    ASSERT_EQ(digests.size(), 3u);
    for (size_t i = 0; i < digests.size(); ++i) EXPECT_EQ(sha256Hex(bytes[i].data(), bytes[i].size()), digests[i]);
    // What is asked again with the same key is the same job.
    v1::JobSpec again;
    again.set_name("shot");
    again.set_key("shot");
    again.set_client("me");
    *again.mutable_request() = small(4);
    again.mutable_request()->set_width(16);
    again.mutable_request()->set_height(12);
    again.mutable_frames()->set_last(2);
    grpc::ClientContext second;
    bound(second);
    v1::Job same;
    ASSERT_TRUE(v1::Jobs::NewStub(channel)->Submit(&second, again, &same).ok());
    EXPECT_EQ(same.id(), done.id());
  }
}

TEST_F(JobsOfAServer, OfAnotherVersionStopTheStartAndStayAsTheyAre) {
  const std::string database = jobsFolder + "/jobs.sqlite";
  for (const std::string& release : releases()) {
    ASSERT_TRUE(start(release).ok());
    server->shutdown(0);
    server.reset();
    const int now = userVersion(database);
    EXPECT_GE(now, 2);
    // One version on; this one's tables under an older number; no number.
    for (const int other : {now + 1, now - 1, 0}) {
      SCOPED_TRACE(release + " as version " + std::to_string(other));
      std::map<std::string, std::string> before;
      const Status refused = start(release, [&] {
        {
          JobFiles files;
          bool alone = false;
          ASSERT_TRUE(files.open(jobsFolder, alone).ok());
          ASSERT_TRUE(openStore(files).ok());  // as this build has it
        }
        setUserVersion(database, other);
        closeLog(database);
        before = contents(jobsFolder);
      });
      ASSERT_FALSE(refused.ok());
      EXPECT_EQ(refused.location(), database) << refused.toString();
      if (other > now) {
        EXPECT_EQ(refused.code(), Code::FailedPrecondition);
        EXPECT_NE(refused.message().find("version " + std::to_string(other) + ", this build reads versions 1 to " + std::to_string(now)), std::string::npos)
            << refused.toString();
      }
      EXPECT_TRUE(before == contents(jobsFolder)) << "something was changed";
      EXPECT_GE(before.size(), 4u);  // store, identity, a checkpoint, a result
      // Set right again, everything is there.
      setUserVersion(database, now);
      JobFiles files;
      bool alone = false;
      ASSERT_TRUE(files.open(jobsFolder, alone).ok());
      const auto store = openStore(files);
      ASSERT_TRUE(store.ok()) << store.status().toString();
      EXPECT_EQ((*store)->jobIds()->size(), 2u);
    }
  }
}

TEST_F(JobsOfAServer, CheckpointsAreReadOrTheFrameStartsAnew) {
  for (const std::string& release : releases()) {
    SCOPED_TRACE(release);
    for (const int by : {0, 1, -1}) {
      fs::remove_all(jobsFolder);
      copyFolder(releaseFile(release, "disk/jobs"), jobsFolder);
      fs::permissions(jobsFolder, fs::perms::owner_all);
      JobFiles files;
      bool alone = false;
      ASSERT_TRUE(files.open(jobsFolder, alone).ok());
      auto store = std::move(*openStore(files));
      const TaskId task{2, 0};
      std::vector<CheckpointRow> rows = *store->checkpoints(task);
      ASSERT_EQ(rows.size(), 1u);
      auto bytes = *files.read(files.checkpointPath(task, rows[0].digest));
      const uint8_t found = uint8_t(bytes[7] + by);
      bytes = withTermVersion(bytes, found);
      rows[0].digest = hashBytes(bytes.data(), bytes.size()).hex();
      ASSERT_TRUE(files.write(files.checkpointPath(task, rows[0].digest), bytes.data(), bytes.size()).ok());
      Lease lease;
      lease.task = task;
      TaskCheckpoints reading(*store, files, lease, rows);
      const TermPtr term = reading.load(key(9), 1);
      EXPECT_EQ(term != nullptr, found == termVersion());
      if (term) {
        EXPECT_EQ(term->content(), makeTerm(9, 20)->content());
      } else {
        EXPECT_EQ(log.with({files.checkpointPath(task, rows[0].digest), std::string("term file version ") + char(found),
                            std::string("this build reads version ") + char(termVersion()), "starts anew"}),
                  1u)
            << log.all();
      }
    }
  }
}

TEST(FilesOfReleases, BlobsAreReadOrSayWhyNot) {
  auto scene = tests::sealableScene();
  ASSERT_TRUE(scene->seal().ok());
  if (recording()) {
    write(releaseFile(thisRelease(), "disk/scene.blob"), blobOf(*scene).bytes);
    write(releaseFile(thisRelease(), "disk/environment.blob"), blobOf(*skyEnvironment({}, 8)).bytes);
  }
  for (const std::string& release : releases())
    for (const bool isScene : {true, false}) {
      SCOPED_TRACE(release + (isScene ? " scene" : " environment"));
      const BlobBytes b = blobIn(releaseFile(release, isScene ? "disk/scene.blob" : "disk/environment.blob"));
      const auto read = [&](const BlobBytes& blob) {
        const auto [owner, view] = blob.aligned();
        return isScene ? readSceneBlob(owner, view, BlobTrust::Foreign).status() : readEnvironmentBlob(owner, view, BlobTrust::Foreign).status();
      };
      const uint32_t version = b.at<uint32_t>(8);
      const bool ours = version == kBlobVersion && b.at<Hash128>(32) == blobFormatHash();
      const Status status = read(b);
      EXPECT_EQ(status.ok(), ours) << status.toString();
      const std::string reads = ", this build reads version " + std::to_string(kBlobVersion);
      if (!ours) {
        EXPECT_NE(status.message().find(version == kBlobVersion ? "other fields" : "version " + std::to_string(version) + reads), std::string::npos)
            << status.toString();
      }
      for (const uint32_t other : {kBlobVersion - 1, kBlobVersion + 1}) {
        const Status refused = read(withBlobVersion(b, other));
        EXPECT_EQ(refused.code(), Code::DataLoss);
        EXPECT_NE(refused.message().find("version " + std::to_string(other) + reads), std::string::npos) << refused.toString();
      }
    }
}

TEST(FilesOfReleases, ACacheFolderIsReadOrMadeAgain) {
  if (recording()) {
    TempFolder folder;
    {
      auto store = std::move(*DiskStore::open(folder.path, 1 << 20));
      for (int i = 0; i < kTerms; ++i) ASSERT_TRUE(store->put(key(i), *makeTerm(i, 40)).ok());
    }
    closeLog(folder.path + "/index.sqlite");
    for (const auto& [name, bytes] : contents(folder.path)) writeAll(releaseFile(thisRelease(), "disk/cache/" + name), bytes);
  }
  for (const std::string& release : releases())
    for (const int by : {0, 1, -1}) {
      SCOPED_TRACE(release + " by " + std::to_string(by));
      TempFolder folder;
      copyFolder(releaseFile(release, "disk/cache"), folder.path);
      const std::string index = folder.path + "/index.sqlite";
      const int indexVersion = userVersion(index) + by;
      uint8_t found = 0;
      if (by) setUserVersion(index, indexVersion);
      for (int i = 0; i < kTerms; ++i) {
        const std::string bytes = readAll(fileOf(folder.path, i));
        found = uint8_t(bytes[7] + by);
        write(fileOf(folder.path, i), withTermVersion({bytes.begin(), bytes.end()}, found));
      }
      std::vector<std::string> said;
      DiskStoreOptions options;
      options.maxBytes = 1 << 20;
      options.say = [&](const std::string& line) { said.push_back(line); };
      auto store = std::move(*DiskStore::open(folder.path, options));
      EXPECT_EQ(store->count(), uint64_t(kTerms));
      const bool indexIsOurs = indexVersion == userVersion(index);  // read after the opening: what this build has
      EXPECT_EQ(store->stats().rebuilds, indexIsOurs ? 0u : 1u);
      for (int i = 0; i < kTerms; ++i) {
        const TermPtr term = store->get(key(i));
        ASSERT_EQ(term != nullptr, found == termVersion());
        if (term) { EXPECT_EQ(term->content(), makeTerm(i, 40)->content()); }
        ASSERT_TRUE(store->put(key(i), *makeTerm(i, 40)).ok());
        ASSERT_NE(store->get(key(i)), nullptr);
      }
      EXPECT_EQ(store->stats().damaged, 0u);
      std::vector<std::string> expected;
      if (!indexIsOurs)
        expected.push_back("cache folder: " + index + " has version " + std::to_string(indexVersion) + ", this build reads version " +
                           std::to_string(userVersion(index)) + ": it is made anew from the files");
      if (found != termVersion())
        expected.push_back("cache folder: " + fileOf(folder.path, 0) + ": term file version " + char(found) + ", this build reads version " +
                           char(termVersion()) + ": its term is made again, as are others like it (said once)");
      EXPECT_EQ(said, expected);
    }
}

/// A daemon over folders in which every file is one version too new, or too old.
struct DaemonOverForeignCaches : ServerTest {
  Lines log;
  std::string blob;
  int by = 1;
  void configure(ServerConfig& c) override {
    setLogLevel(LogLevel::Warn);
    c.logLevel = "warn";
    c.cacheFolder = folder + "/cache";
    c.ingestCacheFolder = folder + "/cache/ingest";
    fill();
  }
  void fill() {
    fs::remove_all(folder + "/cache");
    copyFolder(releaseFile(thisRelease(), "disk/cache"), folder + "/cache");
    setUserVersion(folder + "/cache/index.sqlite", 1 + by);
    fs::create_directories(folder + "/cache/ingest");
    fs::permissions(folder + "/cache", fs::perms::owner_all);
    fs::permissions(folder + "/cache/ingest", fs::perms::owner_all);
    blob = folder + "/cache/ingest/" + std::string(64, 'a') + ".blob";
    write(blob, withBlobVersion(blobIn(releaseFile(thisRelease(), "disk/scene.blob")), uint32_t(int(kBlobVersion) + by)).bytes);
  }
};

TEST_F(DaemonOverForeignCaches, StartsSaysSoAndRenders) {
  for (by = 1; by >= -1; by -= 2) {
    SCOPED_TRACE(by);
    if (by < 0) {
      server->shutdown(0);
      server.reset();
      fill();
      auto started = Server::start(config, engineOptions(config), true);
      ASSERT_TRUE(started.ok()) << started.status().toString();
      server = std::move(*started);
      render = v1::Render::NewStub(grpc::CreateChannel(server->addresses()[0], grpc::InsecureChannelCredentials()));
    }
    EXPECT_EQ(log.with({blob, "version " + std::to_string(int(kBlobVersion) + by), "this build reads version " + std::to_string(kBlobVersion)}), 1u)
        << log.all();
    EXPECT_EQ(log.with({folder + "/cache/index.sqlite", "version " + std::to_string(1 + by) + ",", "this build reads version 1"}), 1u) << log.all();
    EXPECT_TRUE(fs::exists(blob)) << "nothing of it is lost";
    const Collected got = renderOnce(small(4));
    EXPECT_TRUE(got.status.ok()) << got.status.error_message();
  }
}

TEST(FilesOfReleases, CrashMarksOfAnotherVersionAreSaidAndDropped) {
  TempFolder folder;
  fs::create_directories(folder.path + "/marks");
  // A page of this build: magic, signal 11, nothing beside it, frame 3 of job 7; and one shorter, as another version's may be.
  const auto page = [](char version, size_t bytes) {
    std::string p = std::string("GBOMARK") + version + std::string("\x0b\0\0\0\0\0\0\0\x07\0\0\0\0\0\0\0\x03", 17);
    p.resize(bytes, '\0');
    return p;
  };
  const size_t whole = 16 + 128 * 16;
  if (recording()) writeAll(releaseFile(thisRelease(), "disk/marks"), page('1', whole));
  for (const std::string& release : releases()) {
    Lines log;
    writeAll(folder.path + "/marks/1-1", readAll(releaseFile(release, "disk/marks")));
    const auto reports = CrashMarks::read(folder.path);
    EXPECT_EQ(reports.size() + log.with({"/marks/1-1", "this build reads version"}), 1u) << release;
    if (release == thisRelease()) {
      ASSERT_EQ(reports.size(), 1u);
      EXPECT_EQ(reports[0].signal, 11);
      EXPECT_TRUE(reports[0].alone);
      EXPECT_EQ(reports[0].tasks, (std::vector<TaskId>{{7, 3}}));
    }
  }
  for (const char version : {'0', '2'})
    for (const size_t bytes : {whole, size_t(256)}) {
      Lines log;
      writeAll(folder.path + "/marks/1-1", page(version, bytes));
      EXPECT_TRUE(CrashMarks::read(folder.path).empty());
      EXPECT_EQ(log.with({folder.path + "/marks/1-1", std::string("version '") + version + "'", "this build reads version '1'"}), 1u) << log.all();
      EXPECT_FALSE(fs::exists(folder.path + "/marks/1-1"));
    }
}

}  // namespace
}  // namespace gobo::release_files_test
