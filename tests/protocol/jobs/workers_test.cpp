// SPDX-License-Identifier: Apache-2.0
// gobo.v1.Farm over a real server and socket: a coordinator that renders nothing itself, workers with engines and folders of their own.
#include <set>
#include <thread>

#include "protocol/jobs/farm_calls.h"
#include "server/farm/messages.h"
#include "support/small_gltf.h"

namespace gobo::farm_service_test {
namespace {

TEST_F(FarmCalls, FramesOfWorkersHaveTheSameBits) {
  hire(2);
  const v1::Job a = submit(spec(8, 4, 3));
  v1::JobSpec two = spec(4, 2, 5);
  two.mutable_request()->add_outputs("beauty");
  two.mutable_request()->add_outputs("depth");
  two.mutable_request()->mutable_encoding()->set_format(v1::Encoding::EXR);
  two.mutable_frames()->set_fps(24);
  const v1::Job b = submit(two);
  sameBits(over(a.id()));
  sameBits(over(b.id()));
  const auto rows = list();
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0].info().name(), "w0");
  EXPECT_TRUE(rows[0].attending() && rows[1].attending());
  EXPECT_EQ(rows[0].done() + rows[1].done(), 6u);
  EXPECT_EQ(rows[0].running() + rows[1].running(), 0u);
  // What a worker had of them was on its way only; the scene stays.
  for (const auto& w : workers) w->worker->stop();
  for (int i = 0; i < 2; ++i) {
    const std::string cache = folder + "/w" + std::to_string(i) + "/cache";
    EXPECT_EQ(filesUnder(cache + "/results") + filesUnder(cache + "/checkpoints") + filesUnder(cache + "/tmp"), 0u);
    EXPECT_EQ(filesUnder(cache + "/scenes"), rows[size_t(i)].done() ? 1u : 0u);
  }
  EXPECT_EQ(filesUnder(folder + "/jobs/checkpoints"), 0u);
  EXPECT_TRUE(eventually([&] { return !list()[0].attending() && !list()[1].attending(); }));
}

TEST_F(FarmCalls, FramesInPartsHaveTheBytesOfWholeOnes) {
  hire(3);
  v1::JobSpec s = spec(8, 2, 4);
  s.set_tile_px(16);  // 24 x 16: two parts
  s.mutable_frames()->set_fps(24);
  s.mutable_request()->add_outputs("beauty");
  s.mutable_request()->add_outputs("depth");
  s.mutable_request()->mutable_encoding()->set_format(v1::Encoding::EXR);
  const v1::Job job = over(submit(s).id());
  EXPECT_EQ(job.frames(0).parts(), 2u);
  EXPECT_EQ(job.frames(0).parts_done(), 2u);
  EXPECT_EQ(job.result_bytes(),
            job.frames(0).files(0).bytes() + job.frames(0).files(1).bytes() + job.frames(1).files(0).bytes() + job.frames(1).files(1).bytes());
  const auto done = [&] {
    uint64_t sum = 0;
    for (const v1::Worker& w : list()) sum += w.done();
    return sum;
  };
  EXPECT_TRUE(eventually([&] { return done() == 6; }, 10)) << done() << ": the job is over a moment before its last worker is known to have done it";
  for (const auto& w : workers) w->worker->stop();
  sameBits(job);
  EXPECT_EQ(filesUnder(folder + "/jobs/results"), 4u) << "files of parts stay";
  for (int i = 0; i < 3; ++i) EXPECT_EQ(filesUnder(folder + "/w" + std::to_string(i) + "/cache/results"), 0u);
}

TEST_F(FarmCalls, PartsAreSentToWhoeverHasTheirFrame) {
  v1::JobSpec s = spec(4, 1);
  s.set_tile_px(16);
  submit(s);
  Played played(*farm);
  const v1::ClaimReply first = claim(played.id), second = claim(played.id);
  ASSERT_TRUE(first.has_lease() && second.has_lease());
  EXPECT_EQ(first.parts_size(), 0);
  EXPECT_FALSE(claim(played.id).has_lease()) << "a frame is given away before its parts are done";
  std::vector<std::string> digests;
  for (const v1::ClaimReply* reply : {&first, &second}) {
    const std::string bytes = "pixels of " + std::to_string(reply->lease().index());
    digests.push_back(sha256Hex(bytes.data(), bytes.size()));
    v1::PutFarmFileRequest::Begin begin;
    *begin.mutable_lease() = reply->lease();
    begin.set_digest(digests.back());
    begin.set_bytes(bytes.size());
    ASSERT_TRUE(put(begin, bytes).ok());
    v1::CompletionReport done;
    *done.mutable_lease() = reply->lease();
    done.add_files()->set_sha256(digests.back());
    done.mutable_files(0)->set_output("part");
    done.mutable_files(0)->set_bytes(bytes.size());
    v1::FarmAck ack;
    ASSERT_TRUE(call(&v1::Farm::Stub::Complete, done, &ack).ok());
  }
  const v1::ClaimReply frame = claim(played.id);
  ASSERT_TRUE(frame.has_lease());
  EXPECT_EQ(frame.lease().index(), 0);
  ASSERT_EQ(frame.parts_size(), 2);
  EXPECT_EQ(frame.parts(0).sha256(), digests[0]);
  const auto fetched = [&](const std::string& digest, std::string& bytes) {
    v1::GetFarmFileRequest wanted;
    *wanted.mutable_lease() = frame.lease();
    wanted.set_part(digest);
    grpc::ClientContext context;
    bound(context);
    auto reader = farm->Get(&context, wanted);
    for (v1::FarmChunk chunk; reader->Read(&chunk);) bytes += chunk.data();
    return reader->Finish().error_code();
  };
  std::string bytes;
  EXPECT_EQ(fetched(digests[1], bytes), grpc::OK);
  EXPECT_EQ(bytes, "pixels of 2");
  for (const std::string& other : {std::string(64, 'a'), std::string("../identity"), std::string()}) EXPECT_EQ(fetched(other, bytes), grpc::NOT_FOUND) << other;
  // What was put is no picture: whoever puts it together says so, and the parts are rendered again.
  v1::FailureReport failure;
  *failure.mutable_lease() = frame.lease();
  failure.mutable_error()->set_code(int(Code::DataLoss));
  failure.set_retry(true);
  v1::FarmAck ack;
  ASSERT_TRUE(call(&v1::Farm::Stub::Fail, failure, &ack).ok());
  EXPECT_TRUE(eventually([&] { return claim(played.id).has_lease(); }, 10));
}

// Scene and map are the coordinator's files: a worker has neither the files nor a program that reads them.
TEST_F(FarmCalls, ScenesAndMapsAreSent) {
  std::ofstream(folder + "/root/quad.gltf") << smallGltf("paint.png");
  std::ofstream(folder + "/root/paint.png", std::ios::binary) << smallPng(200, 40, 90);
  std::string hdr = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n";
  for (int i = 0; i < 32; ++i) hdr += {char(40 + 5 * i), char(90), char(200 - 3 * i), char(129)};
  std::ofstream(folder + "/root/map.hdr", std::ios::binary) << hdr;
  grpc::ClientContext context;
  bound(context);
  v1::OpenSceneRequest open;
  open.set_source(folder + "/root/quad.gltf");
  open.set_name("quad");
  v1::SceneInfo info;
  ASSERT_TRUE(scenes->Open(&context, open, &info).ok());
  v1::JobSpec s = spec(16, 2);
  s.mutable_request()->set_scene("quad");
  s.mutable_request()->mutable_environment()->set_path(folder + "/root/map.hdr");
  const v1::Job job = submit(s);
  hire(1);
  sameBits(over(job.id()));
  const std::string kept = folder + "/w0/cache/scenes";
  EXPECT_EQ(filesUnder(kept), 2u);
  // Once: the next worker of that folder has them already, damaged ones are sent again.
  workers.clear();
  std::string blob;
  for (const auto& e : fs::directory_iterator(kept))
    if (e.path().filename().string().rfind("scene-", 0) == 0) blob = e.path().string();
  ASSERT_FALSE(blob.empty());
  const auto size = fs::file_size(blob);
  {
    std::fstream damage(blob, std::ios::in | std::ios::out | std::ios::binary);
    damage.seekp(std::streamoff(size / 2));
    damage << "damage";
  }
  s.set_key("again");
  const v1::Job again = submit(s);
  workers.push_back(std::make_unique<WorkerHere>(config.listen[0], folder + "/w0", "w0"));
  sameBits(over(again.id()));
  EXPECT_EQ(fs::file_size(blob), size);
  // Another map under the same name: the job that was promised the old one fails, as it does here.
  s.set_key("third");
  workers.clear();
  const v1::Job third = submit(s);
  hdr.back() = char(130);
  std::ofstream(folder + "/root/map.hdr", std::ios::binary) << hdr;
  workers.push_back(std::make_unique<WorkerHere>(config.listen[0], folder + "/w1", "w1"));  // which has no copy
  const v1::Job failed = over(third.id());
  EXPECT_EQ(failed.state(), v1::Job::FAILED);
  EXPECT_NE(failed.error().message().find("changed since the job was submitted"), std::string::npos) << failed.error().message();
}

TEST_F(FarmCalls, AFrameOfADeadWorkerGoesOnFromItsCheckpoint) {
  const v1::Job job = submit(spec(3000, 1));
  hire(1);
  ASSERT_TRUE(eventually([&] { return !get(job.id()).frames(0).checkpoint().empty(); })) << get(job.id()).ShortDebugString();
  // Dead: nothing of it is released. (Its threads end, but its reports have no way.)
  v1::Job mid = get(job.id());
  workers[0]->worker->stop();  // gives it back with a checkpoint
  ASSERT_TRUE(eventually([&] { return get(job.id()).frames(0).state() != v1::Frame::RUNNING; }));
  workers.clear();
  hire(1);
  const v1::Job done = over(job.id(), 120);
  sameBits(done);
  EXPECT_EQ(done.frames(0).attempts(), 1u);
  EXPECT_GT(mid.frames(0).progress(), 0);
  ASSERT_NE(workers[0]->worker->stats(), nullptr);
  EXPECT_EQ(workers[0]->worker->stats()->resumed.load(), 1u) << "from the checkpoint that came with the claim";
}

TEST_F(FarmCalls, PauseAndCancelReachWorkers) {
  const v1::Job job = submit(spec(1 << 20, 1));
  hire(1);
  ASSERT_TRUE(eventually([&] { return get(job.id()).frames(0).state() == v1::Frame::RUNNING; }));
  grpc::ClientContext a, b, c;
  v1::Job reply;
  v1::PauseJobRequest pause;
  pause.set_id(job.id());
  ASSERT_TRUE(jobs->Pause(&a, pause, &reply).ok());
  EXPECT_TRUE(eventually([&] { return get(job.id()).frames(0).state() == v1::Frame::QUEUED; }));
  EXPECT_TRUE(eventually([&] { return list().at(0).running() == 0; }));
  v1::ResumeJobRequest resume;
  resume.set_id(job.id());
  ASSERT_TRUE(jobs->Resume(&b, resume, &reply).ok());
  EXPECT_TRUE(eventually([&] { return get(job.id()).frames(0).state() == v1::Frame::RUNNING; }));
  v1::CancelJobRequest cancel;
  cancel.set_id(job.id());
  ASSERT_TRUE(jobs->Cancel(&c, cancel, &reply).ok());
  // The worker lets it go: it takes the next one.
  const v1::Job next = submit(spec(4, 1));
  sameBits(over(next.id()));
}

// A worker goes on through a restart of its coordinator: its lease is not ended with those of the dead.
TEST_F(FarmCalls, TheCoordinatorMayBeRestarted) {
  const v1::Job job = submit(spec(2500, 1));
  hire(1);
  ASSERT_TRUE(eventually([&] { return get(job.id()).frames(0).state() == v1::Frame::RUNNING; }));
  ASSERT_NO_FATAL_FAILURE(restart());
  const v1::Job done = over(job.id(), 120);
  sameBits(done);
  EXPECT_EQ(done.frames(0).attempts(), 1u);
  EXPECT_EQ(workers[0]->worker->stats()->lost.load(), 0u);
  EXPECT_EQ(workers[0]->worker->stats()->frames.load(), 1u);
}

/// Leases and checkpoints so seldom that nothing else tells how far a frame is.
struct FarmProgress : FarmCalls {
  void configure(ServerConfig& c) override {
    FarmCalls::configure(c);
    c.jobsLeaseSeconds = 600;
    c.jobsCheckpointSeconds = 600;
  }
};

TEST_F(FarmProgress, IsSeenWhereTheJobIs) {
  v1::JobSpec large = spec(512, 1);  // many tiles: the path tracer tells when some are done
  large.mutable_request()->set_width(320);
  large.mutable_request()->set_height(240);
  const v1::Job job = submit(large);
  hire(1);
  double progress = 0;
  EXPECT_TRUE(eventually([&] { return (progress = get(job.id()).frames(0).progress()) > 0; })) << progress;
  EXPECT_LT(progress, 1);
  grpc::ClientContext context;
  v1::Job reply;
  v1::CancelJobRequest cancel;
  cancel.set_id(job.id());
  ASSERT_TRUE(jobs->Cancel(&context, cancel, &reply).ok());
  EXPECT_TRUE(eventually([&] { return list().at(0).running() == 0; })) << "told at once, not with the next renewal";
}

// A worker keeps the times of the coordinator that it attends, not those of its first one: here leases would run out before it thinks of them.
TEST_F(FarmProgress, TimesAreThoseOfTheCoordinatorThatIsThere) {
  hire(1);
  ASSERT_TRUE(eventually([&] { return workers[0]->worker->attends(); }));
  config.jobsLeaseSeconds = 1;
  config.jobsCheckpointSeconds = 0.05;
  ASSERT_NO_FATAL_FAILURE(restart());
  ASSERT_TRUE(eventually([&] {
    const auto rows = list();
    return rows.size() == 1 && rows[0].attending();
  }));
  const v1::Job job = submit(spec(1 << 20, 1));
  EXPECT_TRUE(eventually([&] { return !get(job.id()).frames(0).checkpoint().empty(); }));
  std::this_thread::sleep_for(std::chrono::milliseconds(2500));  // two leases
  const v1::Job now = get(job.id());
  EXPECT_EQ(now.frames(0).state(), v1::Frame::RUNNING) << now.ShortDebugString();
  EXPECT_EQ(list().at(0).running(), 1u);
  EXPECT_EQ(workers[0]->worker->stats()->lost.load(), 0u);
  grpc::ClientContext context;
  v1::Job reply;
  v1::CancelJobRequest cancel;
  cancel.set_id(job.id());
  ASSERT_TRUE(jobs->Cancel(&context, cancel, &reply).ok());
  EXPECT_TRUE(eventually([&] { return list().at(0).running() == 0; }));
}

// It goes with the lease: a worker that is gone takes nothing back itself.
TEST_F(FarmProgress, OfAWorkerThatIsGoneIsTakenAway) {
  config.jobsLeaseSeconds = 1;
  ASSERT_NO_FATAL_FAILURE(restart());
  const v1::Job job = submit(spec(4, 1));
  Played played(*farm);
  const v1::ClaimReply claimed = claim(played.id);
  ASSERT_TRUE(claimed.has_lease());
  v1::HoldRequest hold;
  *hold.mutable_lease() = claimed.lease();
  hold.set_progress(0.6);
  v1::HoldReply held;
  ASSERT_TRUE(call(&v1::Farm::Stub::Hold, hold, &held).ok());
  EXPECT_TRUE(eventually([&] { return get(job.id()).frames(0).state() == v1::Frame::QUEUED; }));
  EXPECT_TRUE(eventually([&] { return get(job.id()).progress() == 0; })) << get(job.id()).ShortDebugString();
}

// Of a part that runs only its share of the frame shows, in the job alone and in the list of all.
TEST_F(FarmProgress, OfAPartIsItsShareOfTheFrame) {
  v1::JobSpec s = spec(4, 1);
  s.set_tile_px(16);  // two parts, and putting them together: thirds
  const v1::Job job = submit(s);
  Played played(*farm);
  const v1::ClaimReply part = claim(played.id);
  ASSERT_TRUE(part.has_lease());
  v1::HoldRequest hold;
  *hold.mutable_lease() = part.lease();
  hold.set_progress(0.75);
  v1::HoldReply held;
  ASSERT_TRUE(call(&v1::Farm::Stub::Hold, hold, &held).ok());
  EXPECT_DOUBLE_EQ(get(job.id()).progress(), 0.25);
  EXPECT_DOUBLE_EQ(get(job.id()).frames(0).progress(), 0.25);
  grpc::ClientContext context;
  bound(context);
  v1::ListJobsReply all;
  ASSERT_TRUE(jobs->List(&context, {}, &all).ok());
  ASSERT_EQ(all.jobs_size(), 1);
  EXPECT_DOUBLE_EQ(all.jobs(0).progress(), 0.25);
}

// An idle worker asks seldom: it is the stream that says that there is something.
TEST_F(FarmProgress, IdleWorkersAreToldOfWork) {
  hire(1);
  ASSERT_TRUE(eventually([&] { return workers[0]->worker->attends(); }));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));  // its first claim found nothing
  const auto begun = std::chrono::steady_clock::now();
  over(submit(spec(4, 1)).id());
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::milliseconds(4500)) << "not by its own next question";
}

TEST_F(FarmCalls, OthersAreRefusedWithBothNames) {
  const auto attend = [&](const std::function<void(v1::WorkerInfo&)>& change) {
    v1::AttendRequest r;
    r.mutable_worker()->set_name("x");
    r.mutable_worker()->set_build(buildVersion());
    r.mutable_worker()->set_numeric_class(gobo::numericClass());
    change(*r.mutable_worker());
    grpc::ClientContext context;
    bound(context);
    auto reader = farm->Attend(&context, r);
    v1::FarmNews news;
    EXPECT_FALSE(reader->Read(&news));
    return reader->Finish();
  };
  const grpc::Status build = attend([](v1::WorkerInfo& w) { w.set_build("0.0.1 other"); });
  EXPECT_EQ(build.error_code(), grpc::FAILED_PRECONDITION);
  EXPECT_NE(build.error_message().find("0.0.1 other"), std::string::npos) << build.error_message();
  EXPECT_NE(build.error_message().find(buildVersion()), std::string::npos) << build.error_message();
  const grpc::Status bits = attend([](v1::WorkerInfo& w) { w.set_numeric_class("x86-64-v4"); });
  EXPECT_EQ(bits.error_code(), grpc::FAILED_PRECONDITION);
  EXPECT_NE(bits.error_message().find("\"x86-64-v4\", the coordinator's \"" + gobo::numericClass()), std::string::npos) << bits.error_message();
  for (const std::string& name : {std::string(), std::string("a b"), std::string(65, 'n'), std::string("../x")})
    EXPECT_EQ(attend([&](v1::WorkerInfo& w) { w.set_name(name); }).error_code(), grpc::INVALID_ARGUMENT) << name;
  EXPECT_TRUE(list().empty());
  Played one(*farm), two(*farm), three(*farm), four(*farm);
  const grpc::Status full = attend([](v1::WorkerInfo&) {});
  EXPECT_EQ(full.error_code(), grpc::RESOURCE_EXHAUSTED);
  EXPECT_NE(full.error_message().find("farm.workers"), std::string::npos) << full.error_message();
}

TEST_F(FarmCalls, OnlyWhatWasAnnouncedIsTakenIn) {
  const v1::Job job = submit(spec(4, 2));
  Played played(*farm);
  const v1::ClaimReply held = claim(played.id);
  ASSERT_TRUE(held.has_lease());
  const std::string bytes = "a picture, say", sha = sha256Hex(bytes.data(), bytes.size()), xxh = hashBytes(bytes.data(), bytes.size()).hex();
  const auto begin = [&](bool checkpoint, const std::string& digest, uint64_t size) {
    v1::PutFarmFileRequest::Begin b;
    *b.mutable_lease() = held.lease();
    b.set_checkpoint(checkpoint);
    b.set_digest(digest);
    b.set_bytes(size);
    return b;
  };
  const std::string jobsFolder = folder + "/jobs";
  const size_t before = filesUnder(jobsFolder);
  std::string other = sha;
  other[0] = other[0] == 'a' ? 'b' : 'a';
  for (const auto& [b, why] : {std::pair(begin(false, other, bytes.size()), "digest"), std::pair(begin(false, sha, bytes.size() + 1), "announced"),
                               std::pair(begin(false, sha, bytes.size() - 1), "announced"), std::pair(begin(false, "../../../evil", bytes.size()), "hex"),
                               std::pair(begin(false, xxh, bytes.size()), "64"), std::pair(begin(true, sha, bytes.size()), "32"),
                               std::pair(begin(true, std::string(32, 'A'), bytes.size()), "hex")}) {
    const grpc::Status status = put(b, bytes);
    EXPECT_EQ(status.error_code(), grpc::INVALID_ARGUMENT) << b.ShortDebugString();
    EXPECT_NE(status.error_message().find(why), std::string::npos) << status.error_message();
  }
  EXPECT_EQ(put(begin(false, sha, 1ull << 60), bytes).error_code(), grpc::OUT_OF_RANGE);
  {
    grpc::ClientContext bare;
    bound(bare);
    v1::FarmAck ignored;
    auto writer = farm->Put(&bare, &ignored);
    v1::PutFarmFileRequest data;
    data.set_data(bytes);
    writer->Write(data);
    writer->WritesDone();
    EXPECT_EQ(writer->Finish().error_code(), grpc::INVALID_ARGUMENT) << "bytes of no file";
  }
  EXPECT_EQ(filesUnder(jobsFolder), before) << "nothing stays of what was refused";

  // Reports about files that are not there.
  v1::CompletionReport done;
  *done.mutable_lease() = held.lease();
  v1::FrameFile& f = *done.add_files();
  f.set_output("beauty");
  f.set_sha256(sha);
  f.set_bytes(bytes.size());
  v1::FarmAck ack;
  EXPECT_EQ(call(&v1::Farm::Stub::Complete, done, &ack).error_code(), grpc::INVALID_ARGUMENT);
  v1::CheckpointReport checkpoint;
  *checkpoint.mutable_lease() = held.lease();
  checkpoint.mutable_checkpoint()->set_recipe(std::string(32, '1'));
  checkpoint.mutable_checkpoint()->set_digest(xxh);
  checkpoint.mutable_checkpoint()->set_bytes(bytes.size());
  v1::CheckpointReply replaced;
  EXPECT_EQ(call(&v1::Farm::Stub::Checkpoint, checkpoint, &replaced).error_code(), grpc::INVALID_ARGUMENT);
  checkpoint.mutable_checkpoint()->set_digest("../" + xxh);
  EXPECT_EQ(call(&v1::Farm::Stub::Checkpoint, checkpoint, &replaced).error_code(), grpc::INVALID_ARGUMENT);
  f.set_sha256("../../" + sha);
  EXPECT_EQ(call(&v1::Farm::Stub::Complete, done, &ack).error_code(), grpc::INVALID_ARGUMENT);
  f.set_sha256(sha);

  // As it should be; a report may be repeated.
  ASSERT_TRUE(put(begin(true, xxh, bytes.size()), bytes).ok());
  checkpoint.mutable_checkpoint()->set_digest(xxh);
  EXPECT_TRUE(call(&v1::Farm::Stub::Checkpoint, checkpoint, &replaced).ok());
  EXPECT_TRUE(call(&v1::Farm::Stub::Checkpoint, checkpoint, &replaced).ok());
  v1::GetFarmFileRequest wanted;
  *wanted.mutable_lease() = held.lease();
  wanted.set_checkpoint(xxh);
  grpc::ClientContext context;
  auto reader = farm->Get(&context, wanted);
  v1::FarmChunk chunk;
  ASSERT_TRUE(reader->Read(&chunk));
  EXPECT_EQ(chunk.data(), bytes);
  EXPECT_FALSE(reader->Read(&chunk));
  EXPECT_TRUE(reader->Finish().ok());
  ASSERT_TRUE(put(begin(false, sha, bytes.size()), bytes).ok());
  f.set_bytes(bytes.size() + 1);
  EXPECT_EQ(call(&v1::Farm::Stub::Complete, done, &ack).error_code(), grpc::INVALID_ARGUMENT) << "another size than that of the file";
  f.set_bytes(bytes.size());
  EXPECT_TRUE(call(&v1::Farm::Stub::Complete, done, &ack).ok());
  EXPECT_TRUE(call(&v1::Farm::Stub::Complete, done, &ack).ok()) << "its first answer may have been lost";
  EXPECT_EQ(filesUnder(jobsFolder + "/checkpoints"), 0u);
  EXPECT_EQ(get(job.id()).frames_done(), 1u);
}

struct FarmLost : FarmCalls {
  void configure(ServerConfig& c) override {
    FarmCalls::configure(c);
    c.jobsLeaseSeconds = 1;
  }
};

TEST_F(FarmLost, WhoLostALeaseIsRefusedEverything) {
  submit(spec(4, 1));
  Played played(*farm, "slow");
  const v1::ClaimReply held = claim(played.id);
  ASSERT_TRUE(held.has_lease());
  EXPECT_EQ(list().at(0).frames(0), "j-1:1");
  EXPECT_FALSE(claim(played.id).has_lease());
  // It is silent for longer than its lease; another takes over.
  Played other(*farm, "fast");
  v1::ClaimReply again;
  ASSERT_TRUE(eventually([&] { return (again = claim(other.id)).has_lease(); }));
  EXPECT_GT(again.lease().token(), held.lease().token());
  v1::HoldRequest hold;
  *hold.mutable_lease() = held.lease();
  v1::HoldReply state;
  EXPECT_EQ(call(&v1::Farm::Stub::Hold, hold, &state).error_code(), grpc::FAILED_PRECONDITION);
  hold.set_renew(true);
  EXPECT_EQ(call(&v1::Farm::Stub::Hold, hold, &state).error_code(), grpc::FAILED_PRECONDITION);
  v1::PutFarmFileRequest::Begin b;
  *b.mutable_lease() = held.lease();
  b.set_digest(sha256Hex("x", 1));
  b.set_bytes(1);
  EXPECT_EQ(put(b, "x").error_code(), grpc::FAILED_PRECONDITION);
  v1::GetFarmFileRequest wanted;
  *wanted.mutable_lease() = held.lease();
  wanted.set_scene(true);
  grpc::ClientContext context;
  auto reader = farm->Get(&context, wanted);
  v1::FarmChunk chunk;
  EXPECT_FALSE(reader->Read(&chunk));
  EXPECT_EQ(reader->Finish().error_code(), grpc::FAILED_PRECONDITION);
  v1::CompletionReport done;
  *done.mutable_lease() = held.lease();
  v1::FailureReport failed;
  *failed.mutable_lease() = held.lease();
  failed.mutable_error()->set_code(13);
  v1::ReleaseReport release;
  *release.mutable_lease() = held.lease();
  v1::FarmAck ack;
  EXPECT_EQ(call(&v1::Farm::Stub::Complete, done, &ack).error_code(), grpc::FAILED_PRECONDITION);
  EXPECT_EQ(call(&v1::Farm::Stub::Fail, failed, &ack).error_code(), grpc::FAILED_PRECONDITION);
  EXPECT_EQ(call(&v1::Farm::Stub::Release, release, &ack).error_code(), grpc::FAILED_PRECONDITION);
  // The one that has it may still do all of that.
  hold.mutable_lease()->CopyFrom(again.lease());
  EXPECT_TRUE(call(&v1::Farm::Stub::Hold, hold, &state).ok());
  release.mutable_lease()->CopyFrom(again.lease());
  EXPECT_TRUE(call(&v1::Farm::Stub::Release, release, &ack).ok());
}

TEST_F(FarmCalls, AFailureIsCountedAndSaid) {
  v1::JobSpec s = spec(4, 1);
  s.set_max_attempts(1);
  const v1::Job job = submit(s);
  Played played(*farm);
  const v1::ClaimReply held = claim(played.id);
  v1::FailureReport failed;
  *failed.mutable_lease() = held.lease();
  failed.mutable_error()->set_code(0);
  v1::FarmAck ack;
  EXPECT_EQ(call(&v1::Farm::Stub::Fail, failed, &ack).error_code(), grpc::INVALID_ARGUMENT) << "a failure without a reason";
  failed.mutable_error()->set_code(13);
  failed.mutable_error()->set_message("the lamp fell over");
  failed.set_retry(true);
  EXPECT_TRUE(call(&v1::Farm::Stub::Fail, failed, &ack).ok());
  const v1::Job now = get(job.id());
  EXPECT_EQ(now.state(), v1::Job::FAILED);
  EXPECT_NE(now.error().message().find("the lamp fell over"), std::string::npos);
  EXPECT_EQ(list().at(0).failed(), 1u);
}

// A reason is cut where it is long, and may be within a character: a text that is no UTF-8 would make every list with the job unreadable.
TEST_F(FarmCalls, ALongReasonCanBeRead) {
  v1::JobSpec s = spec(4, 1);
  s.set_max_attempts(1);
  const v1::Job job = submit(s);
  Played played(*farm);
  v1::FailureReport failed;
  *failed.mutable_lease() = claim(played.id).lease();
  failed.mutable_error()->set_code(13);
  for (int i = 0; i < 3000; ++i) failed.mutable_error()->mutable_message()->append(i ? "\u00e9" : "x");
  failed.set_location("scene ");
  for (int i = 0; i < 600; ++i) failed.mutable_location()->append(i ? "\u00e9" : "x");
  v1::FarmAck ack;
  ASSERT_TRUE(call(&v1::Farm::Stub::Fail, failed, &ack).ok());
  const v1::Job now = get(job.id());
  EXPECT_EQ(now.state(), v1::Job::FAILED);
  EXPECT_NE(now.error().message().find("x\u00e9\u00e9"), std::string::npos) << "the reply could be parsed";
}

// Every call wants the right: a client's token has it not, a worker's has.
TEST_F(FarmCalls, NeedsTheRightOfWorkers) {
  const auto with = [&](const std::string& token, auto&& call) {
    grpc::ClientContext context;
    bound(context);
    context.AddMetadata("authorization", "Bearer secret-" + token);
    return call(context).error_code();
  };
  v1::FarmAck ack;
  for (const std::string& token : {std::string("plain"), std::string("worker")}) {
    const bool may = token == "worker";
    v1::WorkersReply workersReply;
    EXPECT_EQ(with(token, [&](auto& c) { return farm->Workers(&c, {}, &workersReply); }), may ? grpc::OK : grpc::PERMISSION_DENIED);
    v1::ClaimReply claimReply;
    EXPECT_EQ(with(token, [&](auto& c) { return farm->Claim(&c, {}, &claimReply); }), may ? grpc::FAILED_PRECONDITION : grpc::PERMISSION_DENIED);
    v1::HoldReply holdReply;
    EXPECT_EQ(with(token, [&](auto& c) { return farm->Hold(&c, {}, &holdReply); }), may ? grpc::FAILED_PRECONDITION : grpc::PERMISSION_DENIED);
    v1::CheckpointReply checkpointReply;
    EXPECT_EQ(with(token, [&](auto& c) { return farm->Checkpoint(&c, {}, &checkpointReply); }), may ? grpc::INVALID_ARGUMENT : grpc::PERMISSION_DENIED);
    EXPECT_EQ(with(token, [&](auto& c) { return farm->Complete(&c, {}, &ack); }), may ? grpc::FAILED_PRECONDITION : grpc::PERMISSION_DENIED);
    EXPECT_EQ(with(token, [&](auto& c) { return farm->Fail(&c, {}, &ack); }), may ? grpc::INVALID_ARGUMENT : grpc::PERMISSION_DENIED);
    EXPECT_EQ(with(token, [&](auto& c) { return farm->Release(&c, {}, &ack); }), may ? grpc::FAILED_PRECONDITION : grpc::PERMISSION_DENIED);
    const auto attendCode = with(token, [&](auto& c) {
      auto reader = farm->Attend(&c, {});
      v1::FarmNews news;
      while (reader->Read(&news)) {}
      return reader->Finish();
    });
    EXPECT_EQ(attendCode, may ? grpc::INVALID_ARGUMENT : grpc::PERMISSION_DENIED);
    const auto getCode = with(token, [&](auto& c) {
      auto reader = farm->Get(&c, {});
      v1::FarmChunk chunk;
      while (reader->Read(&chunk)) {}
      return reader->Finish();
    });
    EXPECT_EQ(getCode, may ? grpc::FAILED_PRECONDITION : grpc::PERMISSION_DENIED);
    const auto putCode = with(token, [&](auto& c) {
      auto writer = farm->Put(&c, &ack);
      writer->WritesDone();
      return writer->Finish();
    });
    EXPECT_EQ(putCode, may ? grpc::INVALID_ARGUMENT : grpc::PERMISSION_DENIED);
  }
}

/// The coordinator writes them, wherever the frames are rendered.
TEST_F(FarmCalls, FilesOfJobOutOfFramesThatWorkersRender) {
  hire(1);
  v1::JobSpec s = spec(4, 3);
  s.set_out("{job}/f.{frame:03}.{ext}");
  const v1::Job job = over(submit(s).id());
  sameBits(job);
  for (int i = 0; i < 3; ++i) {
    std::ifstream in(folder + strf("/shots/j-1/f.%03d.raw", i + 1), std::ios::binary);
    EXPECT_EQ((std::string{std::istreambuf_iterator<char>(in), {}}), resultBytes(job.id(), job.frames(i))) << i;
    EXPECT_EQ(job.frames(i).holder().rfind("farm/w0/", 0), 0u) << job.frames(i).holder();
  }
  EXPECT_EQ(filesUnder(folder + "/w0/shots"), 0u);
  EXPECT_EQ(filesUnder(folder + "/shots"), 3u);
}

}  // namespace
}  // namespace gobo::farm_service_test
