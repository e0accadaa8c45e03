// SPDX-License-Identifier: Apache-2.0
// Workers with a real engine and tiny pictures: checkpoints go on with the same bits, reports are repeated until acknowledged, lost
// leases are let go, and a job never renders another scene than the one it was submitted with.
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>

#include "base/image_io.h"
#include "import/load.h"
#include "server/encode.h"
#include "server/ingest_loader.h"
#include "server/jobs/frame_parts.h"
#include "server/jobs/job_scenes.h"
#include "server/jobs/job_spec.h"
#include "server/jobs/job_worker.h"
#include "server/log.h"
#include "support/instrumented.h"
#include "support/small_gltf.h"
#include "unit/jobs/store_fixture.h"

namespace gobo {
namespace {

struct Worker : test::StoreFixture {
  std::unique_ptr<Engine> engine;
  std::unique_ptr<JobRunner> runner;
  JobFiles files_;
  JobHub hub;
  std::unique_ptr<JobScenes> scenes;
  std::unique_ptr<JobWorker> worker;
  JobWorkerOptions workerOptions;
  std::function<void(EngineOptions&)> change = [](EngineOptions&) {};

  void SetUp() override {
    setLogLevel(LogLevel::Off);
    StoreFixture::SetUp();
    options.now = nullptr;
    open();
    bool alone = false;
    ASSERT_TRUE(files_.open(folder, alone).ok());
    EXPECT_TRUE(alone);
    files_.opened();
    workerOptions.checkpointSeconds = 0.05;
    workerOptions.leaseSeconds = 10;
    newEngine();
  }
  void TearDown() override {
    worker.reset();
    StoreFixture::TearDown();
  }
  /// As after a restart: nothing in memory.
  void newEngine() {
    worker.reset();
    scenes.reset();
    runner.reset();
    EngineOptions o;
    o.loader = inProcessLoader();
    o.threads = 2;
    o.storeBytes = 256 << 20;
    change(o);
    engine = std::move(*Engine::create(o));
    SchedulerOptions s;
    runner = std::make_unique<JobRunner>(s);
    scenes = std::make_unique<JobScenes>(*engine, files_);
  }
  void start() { worker = std::make_unique<JobWorker>(*engine, *runner, *store, files_, *scenes, hub, workerOptions); }
  static v1::JobSpec spec(uint32_t spp, uint64_t seed = 0) {
    v1::JobSpec s;
    v1::RenderRequest& r = *s.mutable_request();
    r.set_scene("cornell");
    r.set_width(24);
    r.set_height(16);
    r.set_seed(seed);
    r.mutable_halt()->set_spp(spp);
    r.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
    r.mutable_integrator()->set_max_bounces(2);
    return s;
  }
  int64_t put(const v1::JobSpec& s) {
    auto job = gobo::makeJob(s, "me", *engine, 0);
    EXPECT_TRUE(job.ok()) << job.status().toString();
    EXPECT_TRUE(scenes->describe(*job).ok());
    const int64_t id = submit(*job);
    hub.changed();
    return id;
  }
  bool eventually(const std::function<bool()>& condition, double seconds = 60) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (std::chrono::steady_clock::now() < end) {
      if (condition()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return condition();
  }
  bool over(int64_t id) {
    return eventually([&] { return jobIsOver(get(id).state()); });
  }
  std::vector<uint8_t> expected(const v1::JobSpec& s) {
    EngineOptions o;
    o.loader = inProcessLoader();
    o.threads = 2;
    auto fresh = std::move(*Engine::create(o));
    auto result = fresh->render(s.request());
    EXPECT_TRUE(result.ok());
    return rawBytes(result->images[0].pixels(), false).copy();
  }
  std::vector<uint8_t> result(int64_t id, int frame = 0) {
    const v1::Job job = get(id);
    EXPECT_EQ(job.state(), v1::Job::DONE) << job.error().message();
    if (job.frames(frame).files_size() == 0) return {};
    return *files_.read(files_.resultPath(id, job.frames(frame).files(0).sha256()));
  }
  size_t filesIn(const std::string& sub) {
    return size_t(std::distance(std::filesystem::directory_iterator(folder + "/" + sub), std::filesystem::directory_iterator()));
  }
  void breakItsBlob(bool opened);
};

// The file is where job.out says before the frame counts as done; until it can be written the report is repeated.
TEST_F(Worker, FilesOfJobOutAreWrittenBeforeTheFrameIsDone) {
  std::filesystem::create_directory(folder + "/shots");
  JobOut out;
  out.open(folder + "/shots");
  std::atomic<int> refusals{3};
  std::atomic<bool> early{false};
  out.step = [&](const char* step, const std::string&) {
    if (std::string(step) == "write" && refusals.fetch_sub(1) > 0) return Status(Code::ResourceExhausted, "disk full");
    if (std::string(step) == "sync-folder") early = early || store->get(1, true)->job.frames(0).state() != v1::Frame::RUNNING;
    return Status();
  };
  workerOptions.out = &out;
  v1::JobSpec s = spec(4);
  s.set_out("{job}/{frame:04}.{ext}");
  s.set_name("x");
  const int64_t id = put(s);
  start();
  ASSERT_TRUE(over(id));
  std::ifstream in(folder + "/shots/j-1/0000.raw", std::ios::binary);
  EXPECT_EQ((std::vector<uint8_t>{std::istreambuf_iterator<char>(in), {}}), result(id));
  EXPECT_FALSE(early);
  EXPECT_GE(worker->stats().repeatedReports, 3u);
  EXPECT_EQ(get(id).frames(0).attempts(), 1u) << "that is no failure of the frame";
}

// A kill between the file and the report: another worker renders the frame again, to the same bits.
TEST_F(Worker, AFileWrittenBeforeACrashIsReplacedByTheSame) {
  std::filesystem::create_directory(folder + "/shots");
  JobOut out;
  out.open(folder + "/shots");
  v1::JobSpec s = spec(4);
  s.set_out("{frame}.raw");
  const int64_t id = put(s);
  const auto lost = claim(1000, "dead");
  ASSERT_TRUE(lost);
  const std::vector<uint8_t> bits = expected(s);
  v1::FrameFile f;
  f.set_output("beauty");
  f.set_bytes(bits.size());
  f.set_sha256(sha256Hex(bits.data(), bits.size()));
  ASSERT_TRUE(files_.write(files_.resultPath(id, f.sha256()), bits.data(), bits.size()).ok());
  ASSERT_TRUE(out.deliver(*store, files_, *lost, {f}).ok());
  const std::string path = folder + "/shots/0.raw";
  ASSERT_TRUE(std::filesystem::exists(path));
  ASSERT_EQ(*store->endAllLeases(), 1u);
  std::filesystem::resize_file(path, 3);  // to see that it is written again
  ASSERT_TRUE(out.deliver(*store, files_, *lost, {f}).ok());
  EXPECT_EQ(std::filesystem::file_size(path), 3u) << "whose lease is over writes nothing";
  workerOptions.out = &out;
  start();
  ASSERT_TRUE(over(id));
  std::ifstream in(path, std::ios::binary);
  EXPECT_EQ((std::vector<uint8_t>{std::istreambuf_iterator<char>(in), {}}), bits);
  // A daemon that was started without the folder keeps the frame: the report is repeated.
  worker.reset();
  put(s);
  const auto held = claim(1000);
  ASSERT_TRUE(held);
  EXPECT_EQ(JobOut().deliver(*store, files_, *held, {f}).code(), Code::Unavailable);
}

TEST_F(Worker, ACheckpointedFrameGoesOnAfterARestartWithTheSameBits) {
  const v1::JobSpec s = spec(testing::asLong(8192));
  const int64_t id = put(s);
  start();
  ASSERT_TRUE(eventually([&] { return !get(id).frames(0).checkpoint().empty(); }));
  worker->stop();
  ASSERT_NE(get(id).state(), v1::Job::DONE) << "too fast to be interrupted";
  EXPECT_GT(get(id).progress(), 0);
  EXPECT_EQ(filesIn("checkpoints"), 1u);
  newEngine();
  start();
  ASSERT_TRUE(over(id));
  EXPECT_TRUE(eventually([&] { return filesIn("checkpoints") == 0; }));
  worker->stop();
  EXPECT_GE(worker->stats().resumed.load(), 1u);
  EXPECT_EQ(result(id), expected(s));
  EXPECT_EQ(filesIn("tmp"), 0u);
  EXPECT_EQ(get(id).frames(0).attempts(), 1u);
}

TEST_F(Worker, AFrameInPartsHasTheBitsOfTheWhole) {
  v1::JobSpec s = spec(64);
  s.set_tile_px(16);
  s.mutable_frames()->set_last(1);
  workerOptions.workers = 3;
  const int64_t id = put(s);
  start();
  ASSERT_TRUE(over(id));
  worker->stop();
  EXPECT_EQ(result(id), expected(s));
  EXPECT_EQ(result(id, 1), expected(s));
  EXPECT_EQ(get(id).frames(0).parts(), 2u);
  EXPECT_EQ(get(id).frames(0).parts_done(), 2u);
  EXPECT_EQ(worker->stats().frames.load(), 6u);
  EXPECT_EQ(filesIn("checkpoints"), 0u);
  EXPECT_EQ(filesIn("results/" + std::to_string(id)), 1u) << "files of parts stay (the frames' are one: they are equal)";
}

TEST_F(Worker, APartsFileThatIsDamagedOrGoneIsMadeAgain) {
  v1::JobSpec s = spec(16);
  s.set_tile_px(16);
  const int64_t id = put(s);
  // As if it were done by another process, whose disk lied.
  std::vector<Lease> parts;
  while (const auto lease = claim(1e6)) parts.push_back(*lease);
  ASSERT_EQ(parts.size(), 2u);
  const v1::JobSpec resolved = get(id).spec();
  v1::RenderRequest request = frameRequest(resolved, 0);
  *request.mutable_window() = partWindow(resolved, 1);
  const std::string real = *writePart(*engine->render(request), {0, 1});
  for (size_t i = 0; i < 2; ++i) {
    v1::FrameFile f;
    f.set_output("part");
    f.set_bytes(real.size());
    f.set_sha256(i ? sha256Hex(real.data(), real.size()) : std::string(64, '0'));
    std::string damaged = real;
    damaged[real.size() / 2] ^= 1;
    if (i == 1) { ASSERT_TRUE(files_.write(files_.resultPath(id, f.sha256()), damaged.data(), damaged.size()).ok()); }
    ASSERT_TRUE(store->complete(parts[i], {f}, 1).ok());
  }
  start();
  ASSERT_TRUE(over(id));
  worker->stop();
  EXPECT_EQ(worker->stats().failures.load(), 2u) << "one is gone, then one is damaged";
  EXPECT_EQ(result(id), expected(s));
}

TEST_F(Worker, ADamagedCheckpointMeansAnewNotWrong) {
  const v1::JobSpec s = spec(testing::asLong(4096));
  const int64_t id = put(s);
  start();
  ASSERT_TRUE(eventually([&] { return !get(id).frames(0).checkpoint().empty(); }));
  worker->stop();
  ASSERT_NE(get(id).state(), v1::Job::DONE);
  for (const auto& file : std::filesystem::directory_iterator(folder + "/checkpoints")) {
    auto bytes = *files_.read(file.path().string());
    bytes[bytes.size() / 2] ^= 0x40;
    std::filesystem::remove(file.path());
    ASSERT_TRUE(files_.write(file.path().string(), bytes.data(), bytes.size()).ok());
  }
  newEngine();
  start();
  ASSERT_TRUE(over(id));
  worker->stop();
  EXPECT_EQ(worker->stats().resumed.load(), 0u);
  EXPECT_EQ(result(id), expected(s));
}

// What cannot be continued is not stopped for checkpoints for ever: each of its runs may be longer.
TEST_F(Worker, AFrameWithoutCheckpointsComesToItsEnd) {
  v1::JobSpec s = spec(testing::asLong(512));
  s.mutable_request()->mutable_denoise()->mutable_outliers()->mutable_trimmed();
  workerOptions.checkpointSeconds = 0.002;
  const int64_t id = put(s);
  start();
  ASSERT_TRUE(over(id));
  worker->stop();
  EXPECT_EQ(result(id), expected(s));
  EXPECT_EQ(get(id).frames(0).attempts(), 1u);
}

/// The store, for those that do one thing otherwise.
struct Forwards : TaskStore {
  TaskStore& store;
  explicit Forwards(TaskStore& s) : store(s) {}
  Result<JobRecord> get(int64_t id, bool withFrames) override { return store.get(id, withFrames); }
  Result<std::optional<Lease>> claim(const std::string& holder, double leaseSeconds) override { return store.claim(holder, leaseSeconds); }
  Result<v1::Job::State> renew(Lease& lease, double leaseSeconds) override { return store.renew(lease, leaseSeconds); }
  Result<v1::Job::State> check(const Lease& lease) override { return store.check(lease); }
  Result<std::vector<CheckpointRow>> checkpoint(const Lease& lease, const CheckpointRow& row, double progress, uint32_t spp) override {
    return store.checkpoint(lease, row, progress, spp);
  }
  Result<std::vector<CheckpointRow>> checkpoints(TaskId task) override { return store.checkpoints(task); }
  Result<std::vector<v1::FrameFile>> parts(TaskId task) override { return store.parts(task); }
  Status complete(const Lease& lease, const std::vector<v1::FrameFile>& files, double seconds) override { return store.complete(lease, files, seconds); }
  Status fail(const Lease& lease, const FailedReport& report) override { return store.fail(lease, report); }
  Status release(const Lease& lease) override { return store.release(lease); }
};

/// A coordinator that took a report whose answer was lost: the lease is over, and what was here of the frame is gone with it.
struct Forgets final : Forwards {
  using Forwards::Forwards;
  std::atomic<uint64_t> token{0};  // of the lease that it did this to: the first
  Status complete(const Lease& lease, const std::vector<v1::FrameFile>& files, double seconds) override {
    uint64_t none = 0;
    const bool first = token.compare_exchange_strong(none, lease.token);
    if (!first && token == lease.token) return notFound("its files are gone");
    GOBO_TRY(store.complete(lease, files, seconds));
    return first ? Status(Code::Unavailable, "the answer was lost") : Status();
  }
};

TEST_F(Worker, AReportWhoseLeaseIsOverIsGivenUp) {
  Forgets forgets(*store);
  workerOptions.leaseSeconds = 0.6;
  worker = std::make_unique<JobWorker>(*engine, *runner, forgets, files_, *scenes, hub, workerOptions);
  const int64_t first = put(spec(4)), second = put(spec(4, 1));
  ASSERT_TRUE(over(first));
  EXPECT_TRUE(over(second)) << "the worker still waits for the first";
  worker->stop();
  EXPECT_EQ(get(first).state(), v1::Job::DONE);
}

// Renewed by itself, whatever the frame is at: here its files are sent for longer than the lease.
TEST_F(Worker, ALeaseIsKeptWhileFilesAreWritten) {
  std::filesystem::create_directory(folder + "/shots");
  JobOut out;
  out.open(folder + "/shots");
  std::atomic<int> slow{1};
  out.step = [&](const char* step, const std::string&) {
    if (std::string(step) == "write" && slow.fetch_sub(1) > 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1500));
      EXPECT_EQ(*store->expireLeases(), 0u);
    }
    return Status();
  };
  workerOptions.out = &out;
  workerOptions.leaseSeconds = 0.6;
  v1::JobSpec s = spec(4);
  s.set_out("{frame}.raw");
  const int64_t id = put(s);
  start();
  ASSERT_TRUE(over(id));
  worker->stop();
  EXPECT_EQ(worker->stats().lost.load(), 0u);
  EXPECT_EQ(get(id).frames(0).attempts(), 1u);
  EXPECT_EQ(result(id), expected(s));
}

/// Counts renewals for less than a second.
struct Renewals final : Forwards {
  using Forwards::Forwards;
  std::atomic<int> quick{0};
  Result<v1::Job::State> renew(Lease& lease, double leaseSeconds) override {
    quick += leaseSeconds < 1;
    return store.renew(lease, leaseSeconds);
  }
};

// Shorter times hold for a frame that runs, though neither a renewal nor a checkpoint of it was due for minutes.
TEST_F(Worker, TimesMayChangeWhileAFrameRuns) {
  Renewals renewals(*store);
  workerOptions.leaseSeconds = workerOptions.checkpointSeconds = 600;
  worker = std::make_unique<JobWorker>(*engine, *runner, renewals, files_, *scenes, hub, workerOptions);
  const int64_t id = put(spec(1 << 20));
  EXPECT_TRUE(eventually([&] { return get(id).frames(0).state() == v1::Frame::RUNNING; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_TRUE(get(id).frames(0).checkpoint().empty());
  EXPECT_EQ(renewals.quick.load(), 0);
  worker->setTimes(0.6, 0.05);
  EXPECT_TRUE(eventually([&] { return renewals.quick.load() >= 3 && !get(id).frames(0).checkpoint().empty(); }, 20)) << renewals.quick.load();
  EXPECT_TRUE(store->cancel(id).ok());
  hub.steered();
  worker->stop();  // before the store that it has goes
}

TEST_F(Worker, AReportThatCannotBeWrittenIsRepeatedUntilAcknowledged) {
  std::atomic<int> refusals{3};
  options.step = [&](const char* sql) {
    if (std::string(sql).rfind("INSERT INTO file", 0) != 0 || refusals.load() == 0) return Status();
    --refusals;
    return Status(Code::Unavailable, "database is locked");
  };
  open();
  scenes.reset();
  newEngine();
  const v1::JobSpec s = spec(16);
  const int64_t id = put(s);
  start();
  ASSERT_TRUE(over(id));
  worker->stop();
  EXPECT_EQ(worker->stats().repeatedReports.load(), 3u);
  EXPECT_EQ(worker->stats().frames.load(), 1u);
  EXPECT_EQ(get(id).frames(0).attempts(), 1u);  // rendered once
  EXPECT_EQ(result(id), expected(s));
}

TEST_F(Worker, ALostLeaseIsLetGoAndTheFrameIsDoneOnce) {
  const v1::JobSpec s = spec(testing::asLong(4096));
  const int64_t id = put(s);
  workerOptions.leaseSeconds = 1;
  start();
  ASSERT_TRUE(eventually([&] { return get(id).frames(0).state() == v1::Frame::RUNNING; }));
  EXPECT_EQ(*store->endAllLeases(), 1u);
  hub.steered();
  ASSERT_TRUE(over(id));
  worker->stop();
  EXPECT_EQ(worker->stats().lost.load(), 1u);
  EXPECT_EQ(worker->stats().frames.load(), 1u);
  EXPECT_EQ(result(id), expected(s));
}

TEST_F(Worker, PauseKeepsTheCheckpointAndCancelRemovesIt) {
  const int64_t id = put(spec(1 << 20));
  start();
  ASSERT_TRUE(eventually([&] { return get(id).frames(0).state() == v1::Frame::RUNNING && get(id).frames(0).spp() > 0; }));
  ASSERT_TRUE(store->pause(id).ok());
  hub.steered();
  ASSERT_TRUE(eventually([&] { return get(id).frames(0).state() == v1::Frame::QUEUED; }));
  EXPECT_FALSE(get(id).frames(0).checkpoint().empty());
  ASSERT_TRUE(store->resume(id).ok());
  hub.steered();
  ASSERT_TRUE(eventually([&] { return get(id).frames(0).state() == v1::Frame::RUNNING; }));
  ASSERT_TRUE(store->cancel(id).ok());
  hub.steered();
  EXPECT_TRUE(eventually([&] { return filesIn("checkpoints") == 0 && runner->stats().running == 0; }));
  EXPECT_EQ(get(id).state(), v1::Job::CANCELLED);
}

// What was checkpointed before the break is right, what was traced after it is not kept: the next attempt loads the file again and goes on.
// The scene is a client's, or one that only the job holds.
void Worker::breakItsBlob(bool opened) {
  const std::string file = folder + "/scene.gltf", blobs = folder + "/blobs";
  std::ofstream(file, std::ios::binary) << smallGltf("paint.png");
  Image paint(128, 128, 3);
  for (size_t i = 0; i < paint.data.size(); ++i) paint.data[i] = float(i * 7919 % 251) / 250.0f;
  const auto png = *encodePng(paint);
  std::ofstream(folder + "/paint.png", std::ios::binary).write(reinterpret_cast<const char*>(png.data()), std::streamsize(png.size()));
  change = [&](EngineOptions& o) {
    IngestOptions ingest;
    ingest.cacheFolder = blobs;
    o.anyPath = true;
    o.loader = *childLoader(ingest);
  };
  newEngine();
  const auto info = engine->openScene(file, "scene");
  ASSERT_TRUE(info.ok()) << info.status().toString();
  v1::JobSpec s = spec(testing::asLong(8192));
  s.mutable_request()->set_scene("scene");
  s.mutable_request()->mutable_camera()->mutable_position()->set_z(2.5f);
  s.mutable_request()->mutable_camera()->mutable_look_at();
  const int64_t id = put(s);
  if (!opened) { ASSERT_TRUE(engine->unloadScene("scene").ok()); }
  start();
  ASSERT_TRUE(eventually([&] { return !get(id).frames(0).checkpoint().empty(); }));
  size_t cut = 0;
  for (const auto& e : std::filesystem::directory_iterator(blobs))
    if (e.path().extension() == ".blob") {
      std::filesystem::resize_file(e.path(), e.file_size() / 3);
      ++cut;
    }
  EXPECT_EQ(cut, 1u);
  EXPECT_NE(get(id).state(), v1::Job::DONE) << "too fast to be broken";
  ASSERT_TRUE(over(id));
  worker->stop();
  EXPECT_GE(get(id).frames(0).attempts(), 2u);
  EngineOptions o;
  o.loader = inProcessLoader();
  o.threads = 2;
  o.anyPath = true;
  auto fresh = std::move(*Engine::create(o));
  ASSERT_TRUE(fresh->openScene(file, "scene").ok());
  const auto right = fresh->render(s.request());
  ASSERT_TRUE(right.ok()) << right.status().toString();
  EXPECT_EQ(result(id), rawBytes(right->images[0].pixels(), false).copy());
}

TEST_F(Worker, AFrameWhoseBlobBreaksIsDoneAgainRight) { breakItsBlob(true); }
TEST_F(Worker, AFrameWhoseOwnBlobBreaksIsDoneAgainRight) { breakItsBlob(false); }

/// Files of one client's jobs cannot be read.
struct BrokenMount final : TaskScenes {
  TaskScenes& good;
  std::atomic<int> asked{0};
  explicit BrokenMount(TaskScenes& scenes) : good(scenes) {}
  Result<TaskScene> get(const JobRecord& record) override {
    if (record.job.spec().request().seed() != 13) return good.get(record);
    ++asked;
    return Status(Code::Unavailable, "map.hdr: Input/output error");
  }
};

// An input that cannot be read is a failure of the frame, after which others have their turn, not a reason to give the frame back and take it again at once.
TEST_F(Worker, AnInputThatCannotBeReadIsTriedAsOftenAsTheJobSays) {
  options.retrySeconds = 0.05;
  open();
  BrokenMount mount(*scenes);
  v1::JobSpec broken = spec(4, 13);
  broken.set_max_attempts(2);
  const int64_t a = put(broken), b = put(spec(4));
  workerOptions.workers = 1;
  worker = std::make_unique<JobWorker>(*engine, *runner, *store, files_, mount, hub, workerOptions);
  ASSERT_TRUE(over(b));
  EXPECT_EQ(result(b), expected(spec(4)));
  ASSERT_TRUE(over(a));
  const v1::Job failed = get(a);
  EXPECT_EQ(failed.state(), v1::Job::FAILED);
  EXPECT_EQ(failed.frames(0).attempts(), 2u);
  EXPECT_EQ(mount.asked.load(), 2);
  EXPECT_NE(failed.frames(0).error().message().find("Input/output error"), std::string::npos) << failed.ShortDebugString();
}

// Elsewhere it means that the coordinator is away: whoever is back goes on.
TEST_F(Worker, ARemoteWorkerGivesBackWhatItCannotHaveNow) {
  BrokenMount mount(*scenes);
  const int64_t a = put(spec(4, 13));
  workerOptions.workers = 1;
  workerOptions.delivers = [](const Lease&, const std::vector<v1::FrameFile>&) {};
  const auto begun = std::chrono::steady_clock::now();
  worker = std::make_unique<JobWorker>(*engine, *runner, *store, files_, mount, hub, workerOptions);
  ASSERT_TRUE(eventually([&] { return mount.asked.load() > 3; }));
  EXPECT_GE(std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count(), 0.65) << "it takes it again without pause";
  worker.reset();
  EXPECT_EQ(get(a).frames(0).state(), v1::Frame::QUEUED);
  EXPECT_EQ(get(a).state(), v1::Job::QUEUED);
}

TEST_F(Worker, APatchedSceneIsNotTheJobs) {
  const v1::JobSpec s = spec(16);
  const int64_t id = put(s);
  v1::PatchSceneRequest patch;
  patch.set_scene("cornell");
  patch.mutable_lights()->operator[]("light").mutable_color()->set_x(1);
  ASSERT_TRUE(engine->patchScene(patch).ok());
  start();
  ASSERT_TRUE(over(id));
  EXPECT_EQ(result(id), expected(s));  // the built-in is loaded again beside the patched one
}

TEST_F(Worker, AnotherSceneFailsTheJobAndNamesBothHashes) {
  auto job = *gobo::makeJob(spec(16), "me", *engine, 0);
  ASSERT_TRUE(scenes->describe(job).ok());
  const std::string now = job.sceneHash;
  job.sceneHash = std::string(32, '1');
  job.spec.mutable_request()->set_scene_hash(job.sceneHash);
  const int64_t id = submit(job);
  start();
  ASSERT_TRUE(over(id));
  const v1::Job failed = get(id);
  EXPECT_EQ(failed.state(), v1::Job::FAILED);
  EXPECT_EQ(failed.error().code(), int(Code::FailedPrecondition));
  EXPECT_NE(failed.error().message().find("changed since the job was submitted"), std::string::npos) << failed.error().message();
  EXPECT_NE(failed.error().message().find(job.sceneHash), std::string::npos);
  EXPECT_NE(failed.error().message().find(now), std::string::npos);
}

TEST(JobSpecs, FramesKeysAndFaults) {
  EngineOptions o;
  o.loader = inProcessLoader();
  o.threads = 1;
  auto engine = std::move(*Engine::create(o));
  v1::JobSpec s = Worker::spec(16);
  s.mutable_frames()->set_first(-2);
  s.mutable_frames()->set_last(7);
  s.mutable_frames()->set_step(4);
  auto job = gobo::makeJob(s, "me", *engine, 100);
  ASSERT_TRUE(job.ok()) << job.status().toString();
  EXPECT_EQ(job->frames, (std::vector<int64_t>{-2, 2, 6}));
  EXPECT_EQ(job->spec.request().scheduling().priority(), v1::Scheduling::BATCH);
  EXPECT_FALSE(job->sceneHash.empty());
  const auto refused = [&](const v1::JobSpec& bad, const char* where) {
    const auto r = gobo::makeJob(bad, "me", *engine, 100);
    EXPECT_FALSE(r.ok()) << where;
    EXPECT_EQ(r.status().location(), where) << r.status().toString();
  };
  v1::JobSpec bad = s;
  bad.mutable_frames()->set_last(-3);
  refused(bad, "job.frames.last");
  bad = s;
  bad.mutable_frames()->set_last(1000000);
  bad.mutable_frames()->set_step(1);
  refused(bad, "job.frames");
  bad = s;
  bad.mutable_frames()->set_step(0);
  refused(bad, "job.frames.step");
  bad = s;
  bad.set_max_attempts(0);
  refused(bad, "job.max_attempts");
  bad = s;
  bad.set_deadline_unix_s(99);
  refused(bad, "job.deadline_unix_s");
  bad = s;
  bad.mutable_request()->mutable_halt()->set_time_s(1);
  refused(bad, "job.request.halt.time_s");
  bad = s;
  bad.set_key(std::string(201, 'k'));
  refused(bad, "job.key");
  bad = s;
  bad.clear_request();
  refused(bad, "job.request");
  s.set_name("../a b");
  EXPECT_EQ(resultName(s, 7, "beauty", v1::Encoding::PNG), "_._a_b.0007.png");
  s.mutable_request()->add_outputs("beauty");
  s.mutable_request()->add_outputs("visibility:key");
  EXPECT_EQ(resultName(s, -7, "visibility:key", v1::Encoding::EXR), "_._a_b.-0007.visibility_key.exr");
}

}  // namespace
}  // namespace gobo
