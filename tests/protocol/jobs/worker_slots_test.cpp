// SPDX-License-Identifier: Apache-2.0
// One worker that renders several frames at once: its slots have one id, one folder and one way to the coordinator, and each has a lease of its own.
#include <algorithm>
#include <optional>
#include <thread>

#include "protocol/jobs/farm_calls.h"
#include "server/farm/messages.h"
#include "server/farm/remote_scenes.h"
#include "server/farm/remote_tasks.h"

namespace gobo::farm_service_test {
namespace {

/// A worker's side of the store without its threads: the test is every slot, so it says what happens between two steps of one.
struct FarmSlots : FarmCalls {
  std::unique_ptr<Played> played;
  farm::FarmLink link;
  JobFiles files;
  JobHub hub;
  std::unique_ptr<farm::RemoteTasks> tasks;

  void SetUp() override {
    FarmCalls::SetUp();
    played = std::make_unique<Played>(*farm);
    link.stub = v1::Farm::NewStub(channel);
    link.worker = played->id;
    bool alone = false;
    ASSERT_TRUE(files.open(folder + "/slots", alone).ok());
    tasks = std::make_unique<farm::RemoteTasks>(link, files, hub);
  }
  void TearDown() override {
    tasks.reset();
    link.stub.reset();
    played.reset();
    FarmCalls::TearDown();
  }
  std::optional<Lease> take(int slot) {
    const auto lease = tasks->claim("slots/" + std::to_string(slot), config.jobsLeaseSeconds);
    EXPECT_TRUE(lease.ok()) << lease.status().toString();
    return lease.ok() ? *lease : std::nullopt;
  }
  static v1::FrameFile fileOf(const std::string& bytes) {
    v1::FrameFile f;
    f.set_output("beauty");
    f.set_bytes(bytes.size());
    f.set_sha256(sha256Hex(bytes.data(), bytes.size()));
    return f;
  }
  /// What a frame does before it reports that it is done.
  v1::FrameFile write(const Lease& lease, const std::string& bytes) {
    const v1::FrameFile f = fileOf(bytes);
    tasks->delivers(lease, {f});
    EXPECT_TRUE(files.write(files.resultPath(lease.task.job, f.sha256()), bytes.data(), bytes.size()).ok());
    return f;
  }
  bool here(const v1::FrameFile& f) const { return fs::exists(files.resultPath(1, f.sha256())); }
  size_t resultsHere() const { return filesUnder(folder + "/slots/results"); }

  /// A frame done by somebody else, or so that this worker's slots do not learn of it.
  v1::FrameFile doneElsewhere(const v1::FarmLease& lease, const std::string& bytes) {
    v1::FrameFile f = fileOf(bytes);
    v1::PutFarmFileRequest::Begin begin;
    *begin.mutable_lease() = lease;
    begin.set_digest(f.sha256());
    begin.set_bytes(bytes.size());
    EXPECT_TRUE(put(begin, bytes).ok());
    v1::CompletionReport done;
    *done.mutable_lease() = lease;
    *done.add_files() = f;
    v1::FarmAck ack;
    const grpc::Status status = call(&v1::Farm::Stub::Complete, done, &ack);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return f;
  }
  void releasedElsewhere(const v1::FarmLease& lease) {
    v1::ReleaseReport release;
    *release.mutable_lease() = lease;
    v1::FarmAck ack;
    EXPECT_TRUE(call(&v1::Farm::Stub::Release, release, &ack).ok());
  }
  static v1::JobSpec inParts(int frames) {
    v1::JobSpec s = spec(4, frames);
    s.set_tile_px(16);  // 24 x 16: two parts
    return s;
  }
  /// An equirectangular map of one colour.
  std::string mapFile(const std::string& name, char red) const {
    std::string hdr = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n";
    for (int i = 0; i < 32; ++i) hdr += {red, char(90), char(60), char(129)};
    std::ofstream(folder + "/root/" + name, std::ios::binary) << hdr;
    return folder + "/root/" + name;
  }
};

// While one slot fetches what its frame needs, another claims: files of the first are not asked for with the lease of the second.
TEST_F(FarmSlots, EachFetchesWithItsOwnLease) {
  submit(inParts(2));
  std::vector<v1::FarmLease> parts;
  for (int i = 0; i < 4; ++i) {
    const v1::ClaimReply reply = claim(played->id);
    ASSERT_TRUE(reply.has_lease());
    parts.push_back(reply.lease());
  }
  std::sort(parts.begin(), parts.end(), [](const v1::FarmLease& a, const v1::FarmLease& b) { return a.index() < b.index(); });
  const v1::FrameFile first = doneElsewhere(parts[0], "part 0"), second = doneElsewhere(parts[1], "part 1");
  // A state of the frame that somebody left; nothing else is ready.
  const v1::ClaimReply left = claim(played->id);
  ASSERT_TRUE(left.has_lease());
  ASSERT_EQ(left.lease().index(), 0);
  const std::string state = "a state, say", digest = hashBytes(state.data(), state.size()).hex();
  v1::PutFarmFileRequest::Begin begin;
  *begin.mutable_lease() = left.lease();
  begin.set_checkpoint(true);
  begin.set_digest(digest);
  begin.set_bytes(state.size());
  ASSERT_TRUE(put(begin, state).ok());
  v1::CheckpointReport report;
  *report.mutable_lease() = left.lease();
  report.mutable_checkpoint()->set_recipe(std::string(32, '1'));
  report.mutable_checkpoint()->set_digest(digest);
  report.mutable_checkpoint()->set_bytes(state.size());
  v1::CheckpointReply replaced;
  ASSERT_TRUE(call(&v1::Farm::Stub::Checkpoint, report, &replaced).ok());
  releasedElsewhere(left.lease());

  std::optional<Lease> other;
  files.step = [&](const char* step, const std::string&) {
    if (std::string(step) == "write" && !other) {
      releasedElsewhere(parts[2]);
      other = take(1);
    }
    return Status();
  };
  const auto frame = take(0);
  files.step = {};
  ASSERT_TRUE(frame && other);
  EXPECT_EQ(frame->task.index, 0);
  EXPECT_EQ(other->task.index, parts[2].index());
  EXPECT_EQ(tasks->parts(frame->task)->size(), 2u);
  EXPECT_TRUE(here(first));
  EXPECT_TRUE(here(second)) << "asked for after the other slot's claim";
  ASSERT_EQ(tasks->checkpoints(frame->task)->size(), 1u);
  EXPECT_TRUE(fs::exists(files.checkpointPath(frame->task, digest)));
}

// A job's scene may be had with any lease of it: one that has ended meanwhile is not the end of the others' frames.
TEST_F(FarmSlots, ScenesComeWithAnyLeaseOfTheJob) {
  submit(spec(4, 2));
  const auto a = take(0), b = take(1);
  ASSERT_TRUE(a && b);
  releasedElsewhere(farm::toMessage(*b));
  v1::GetFarmFileRequest wanted;
  wanted.set_scene(true);
  const Status status = tasks->fetch(1, wanted, files.scenePath("scene"));
  EXPECT_TRUE(status.ok()) << status.toString();
  EXPECT_TRUE(fs::exists(files.scenePath("scene")));
  releasedElsewhere(farm::toMessage(*a));
  EXPECT_EQ(tasks->fetch(1, wanted, files.scenePath("scene")).code(), Code::FailedPrecondition);
  EXPECT_EQ(tasks->fetch(2, wanted, files.scenePath("scene")).code(), Code::NotFound);
}

// A picture that the coordinator has is not kept until the job's last frame is done; equal ones are one file, until the last of them has been sent.
TEST_F(FarmSlots, WhatWasDeliveredGoesWhileOtherFramesAreHeld) {
  submit(spec(4, 4));
  std::vector<Lease> held;
  for (int i = 0; i < 4; ++i) {
    const auto lease = take(i);
    ASSERT_TRUE(lease);
    held.push_back(*lease);
  }
  const v1::FrameFile own = write(held[0], "a picture of its own");
  const v1::FrameFile equal = write(held[1], "a picture of two");
  write(held[2], "a picture of two");
  Status done = tasks->complete(held[0], {own}, 1);
  EXPECT_TRUE(done.ok()) << done.toString();
  EXPECT_FALSE(here(own));
  EXPECT_TRUE(here(equal));
  done = tasks->complete(held[1], {equal}, 1);
  EXPECT_TRUE(done.ok()) << done.toString();
  EXPECT_TRUE(here(equal)) << "another frame delivers it";
  done = tasks->complete(held[2], {equal}, 1);
  EXPECT_TRUE(done.ok()) << done.toString();
  EXPECT_EQ(resultsHere(), 0u);
  EXPECT_TRUE(tasks->get(1, false).ok()) << "a frame of the job is held";
  EXPECT_EQ(get("j-1").frames_done(), 3u);
  // One that fails after it has written a file leaves none, nor does the last.
  const v1::FrameFile unsent = write(held[3], "a picture that is not sent");
  EXPECT_TRUE(here(unsent));
  EXPECT_TRUE(tasks->fail(held[3], {internalError("the lamp fell over"), true, false}).ok());
  EXPECT_EQ(resultsHere(), 0u);
  EXPECT_EQ(tasks->get(1, false).status().code(), Code::NotFound);
}

// The frame of a part is ready before whoever rendered the part knows that it was taken: another slot then has it fetched into the same file.
TEST_F(FarmSlots, APartThatAnotherSlotNeedsStays) {
  submit(inParts(2));
  std::vector<Lease> parts;
  for (int i = 0; i < 4; ++i) {
    const auto lease = take(i);
    ASSERT_TRUE(lease);
    parts.push_back(*lease);
  }
  std::sort(parts.begin(), parts.end(), [](const Lease& a, const Lease& b) { return a.task < b.task; });
  const v1::FrameFile first = write(parts[0], "part 0"), second = write(parts[1], "part 1");
  Status done = tasks->complete(parts[0], {first}, 1);
  ASSERT_TRUE(done.ok()) << done.toString();
  EXPECT_FALSE(here(first));
  doneElsewhere(farm::toMessage(parts[1]), "part 1");  // taken, but the answer is still on its way
  const auto frame = take(4);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->task.index, 0);
  ASSERT_TRUE(here(first) && here(second));
  done = tasks->complete(parts[1], {second}, 1);
  EXPECT_TRUE(done.ok()) << done.toString();
  EXPECT_TRUE(here(first) && here(second)) << "the frame is not put together yet";
  EXPECT_TRUE(tasks->release(*frame).ok());
  EXPECT_EQ(resultsHere(), 0u) << "parts of the other frame are held, their files are not needed";
}

// Nobody runs a frame whose parts did not come: it is not held here, whether the coordinator has heard of that or not.
TEST_F(FarmSlots, AClaimWhoseFilesDoNotComeIsForgotten) {
  submit(inParts(1));
  const v1::ClaimReply a = claim(played->id), b = claim(played->id);
  ASSERT_TRUE(a.has_lease() && b.has_lease());
  doneElsewhere(a.lease(), "part 0");
  doneElsewhere(b.lease(), "part 1");
  int written = 0;
  files.step = [&](const char* step, const std::string&) {
    if (std::string(step) != "write" || ++written < 2) return Status();
    link.token = "that nobody has";  // so that the release is refused
    return Status(Code::ResourceExhausted, "disk full");
  };
  EXPECT_FALSE(take(0));
  files.step = {};
  EXPECT_EQ(written, 2);
  EXPECT_EQ(resultsHere(), 0u);
  EXPECT_EQ(tasks->get(1, false).status().code(), Code::NotFound);
}

// Two jobs with maps of their own: whatever is fetched for one meanwhile, the other's frame has its own, and never none.
TEST_F(FarmSlots, ScenesHaveTheMapsOfTheirJobs) {
  v1::JobSpec s = spec(4, 1);
  s.mutable_request()->mutable_environment()->set_path(mapFile("a.hdr", 40));
  submit(s);
  s.mutable_request()->mutable_environment()->set_path(mapFile("b.hdr", 80));
  submit(s);
  s.mutable_request()->clear_environment();
  submit(s);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(take(i)) << i;
  farm::RemoteScenes remote(*tasks, files, 1 << 30);
  std::vector<JobRecord> records;
  for (int64_t id = 1; id <= 3; ++id) {
    const auto record = tasks->get(id, false);
    ASSERT_TRUE(record.ok()) << record.status().toString();
    records.push_back(*record);
  }
  std::vector<Hash128> maps;
  for (int i = 0; i < 2; ++i) {
    const auto got = remote.get(records[size_t(i)]);
    ASSERT_TRUE(got.ok()) << got.status().toString();
    ASSERT_TRUE(got->scene && got->environment.map);
    maps.push_back(got->environment.map->content);
  }
  EXPECT_NE(maps[0].hex(), maps[1].hex());
  const auto bare = remote.get(records[2]);
  ASSERT_TRUE(bare.ok()) << bare.status().toString();
  EXPECT_TRUE(bare->scene && !bare->environment.map && bare->environment.file.empty());
  std::vector<std::thread> slots;
  std::atomic<int> wrong{0};
  for (size_t slot = 0; slot < 2; ++slot)
    slots.emplace_back([&, slot] {
      for (int n = 0; n < 50; ++n) {
        const auto got = remote.get(records[slot]);
        wrong += !got.ok() || !got->environment.map || got->environment.map->content.hex() != maps[slot].hex();
      }
    });
  for (std::thread& t : slots) t.join();
  EXPECT_EQ(wrong.load(), 0);
}

struct FarmSlotsLost : FarmSlots {
  void configure(ServerConfig& c) override {
    FarmSlots::configure(c);
    c.jobsLeaseSeconds = 1;
  }
};

// A slot that has lost its frame to another of this worker takes nothing of it away, and leaves nothing behind.
TEST_F(FarmSlotsLost, WhoHasTheFrameNowKeepsItsFiles) {
  submit(spec(4, 1));
  const auto old = take(0);
  ASSERT_TRUE(old);
  const std::string state = "a state, say", digest = hashBytes(state.data(), state.size()).hex(), path = files.checkpointPath(old->task, digest);
  ASSERT_TRUE(files.write(path, state.data(), state.size()).ok());
  const auto kept = tasks->checkpoint(*old, {std::string(32, '1'), digest, 1, state.size()}, 0.5, 2);
  ASSERT_TRUE(kept.ok()) << kept.status().toString();
  std::optional<Lease> fresh;
  ASSERT_TRUE(eventually([&] { return (fresh = take(1)).has_value(); }));  // the lease has run out
  EXPECT_EQ(fresh->task, old->task);
  const v1::FrameFile late = write(*old, "a picture that is late");
  EXPECT_TRUE(here(late));
  EXPECT_EQ(tasks->complete(*old, {late}, 1).code(), Code::FailedPrecondition);
  EXPECT_FALSE(here(late));
  EXPECT_TRUE(fs::exists(path));
  EXPECT_TRUE(tasks->get(1, false).ok());
  EXPECT_EQ(tasks->checkpoints(fresh->task)->size(), 1u);
}

struct FarmTwoSlots : FarmSlots {};

// All of it at once: two slots, two jobs with maps of their own, one of them in parts, frames with equal pictures.
TEST_F(FarmTwoSlots, RenderSideBySide) {
  v1::JobSpec s = inParts(6);
  s.mutable_request()->mutable_environment()->set_path(mapFile("a.hdr", 40));
  const v1::Job a = submit(s);
  s = spec(4, 6);
  s.mutable_request()->mutable_environment()->set_path(mapFile("b.hdr", 80));
  const v1::Job b = submit(s);
  hire(1, 2);
  size_t most = 0;
  EXPECT_TRUE(eventually(
      [&] {
        most = std::max(most, filesUnder(folder + "/w0/cache/results"));
        return jobIsOver(get(a.id()).state()) && jobIsOver(get(b.id()).state());
      },
      60));
  EXPECT_LE(most, 6u) << "two parts and a picture for each slot";
  sameBits(get(a.id()));
  sameBits(get(b.id()));
  ASSERT_NE(workers[0]->worker->stats(), nullptr);
  EXPECT_EQ(workers[0]->worker->stats()->failures.load(), 0u);
  EXPECT_EQ(workers[0]->worker->stats()->lost.load(), 0u);
  workers[0]->worker->stop();
  EXPECT_EQ(filesUnder(folder + "/w0/cache/results"), 0u);
}

}  // namespace
}  // namespace gobo::farm_service_test
