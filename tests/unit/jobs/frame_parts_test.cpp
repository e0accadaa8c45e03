// SPDX-License-Identifier: Apache-2.0
// Frames in parts: what they are put together to is what one render of the whole gives, file header and all; and what the store promises of them.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "import/load.h"
#include "plan/picture_warnings.h"
#include "request/request.h"
#include "server/encode.h"
#include "server/jobs/frame_parts.h"
#include "server/jobs/job_spec.h"
#include "unit/jobs/store_fixture.h"

namespace gobo {
namespace {

std::unique_ptr<Engine> newEngine() {
  EngineOptions o;
  o.loader = inProcessLoader();
  o.threads = 2;
  o.storeBytes = 256 << 20;
  return std::move(*Engine::create(o));
}

v1::RenderRequest pictureOf(const std::string& json) {
  v1::RenderRequest r;
  EXPECT_TRUE(messageFromJson(json, r, "test").ok()) << json;
  return r;
}

/// The whole's files, and those of its parts put together, each made by an engine of its own.
void expectSameFiles(const std::string& json, uint32_t tile) {
  SCOPED_TRACE(json);
  auto engine = newEngine();
  v1::JobSpec spec;
  spec.set_tile_px(tile);
  auto resolved = engine->resolve(pictureOf(json), {});
  ASSERT_TRUE(resolved.ok()) << resolved.status().toString();
  *spec.mutable_request() = *resolved;
  auto whole = engine->render(*resolved);
  ASSERT_TRUE(whole.ok()) << whole.status().toString();
  const auto expected = encodeImages(*whole);
  ASSERT_TRUE(expected.ok());
  const uint32_t parts = partsOf(spec);
  ASSERT_GT(parts, 1u);
  FrameJoin join(spec.request());
  std::set<std::string> files;
  for (uint32_t p = 0; p < parts; ++p) {
    v1::RenderRequest request = spec.request();
    *request.mutable_window() = partWindow(spec, p);
    auto part = newEngine()->render(request);
    ASSERT_TRUE(part.ok()) << p << ": " << part.status().toString();
    const std::string file = *writePart(*part, {3, p});
    files.insert(file);
    ASSERT_TRUE(join.add(file.data(), file.size(), {3, p}).ok());
  }
  EXPECT_EQ(files.size(), parts);
  auto joined = join.finish();
  ASSERT_TRUE(joined.ok()) << joined.status().toString();
  const auto made = encodeImages(*joined);
  ASSERT_TRUE(made.ok());
  ASSERT_EQ(made->size(), expected->size());
  for (size_t i = 0; i < made->size(); ++i) {
    EXPECT_EQ((*made)[i].descriptor.output(), (*expected)[i].descriptor.output());
    EXPECT_EQ((*made)[i].bytes.copy(), (*expected)[i].bytes.copy()) << (*made)[i].descriptor.output();
  }
}

// Sizes that no tile divides; scenes, techniques and outputs as named, before any was run.
TEST(FrameParts, PutTogetherHaveTheBytesOfTheWholesFile) {
  expectSameFiles(R"({"scene": "cornell", "width": 41, "height": 29, "halt": {"spp": 4}})", 16);
  expectSameFiles(R"({"scene": "cornell", "width": 40, "height": 33, "halt": {"spp": 3}, "shadows": {"ray_traced": {}}, "encoding": {"layers": true},
                      "outputs": ["beauty", "depth", "normal", "variance", "sample_count", "object_id", "cryptomatte_object", "group:light", "visibility:light"]})",
                  17);
  expectSameFiles(
      R"({"scene": "lights8", "width": 36, "height": 20, "halt": {"spp": 2}, "shadows": {"percentage_closer_soft": {}}, "encoding": {"format": "PNG"},
                      "outputs": ["beauty", "depth", "motion"]})",
      16);
  expectSameFiles(R"({"scene": "fence", "width": 50, "height": 34, "halt": {"spp": 4}, "encoding": {"format": "RAW_FLOAT"},
                      "filters": [{"bilateral": {}}, {"sharpen": {}}]})",
                  24);
  expectSameFiles(R"({"scene": "grids", "width": 40, "height": 24, "halt": {"spp": 4}, "shadows": {"axis_aligned": {}}, "encoding": {"half": true},
                      "denoise": {"non_local_means": {}}})",
                  20);
}

TEST(FrameParts, CoverThePictureOnce) {
  for (const auto& [width, height, tile] : {std::tuple(100u, 60u, 16u), {64u, 64u, 32u}, {33u, 7u, 16u}, {16u, 17u, 16u}}) {
    v1::JobSpec spec;
    spec.mutable_request()->set_width(width);
    spec.mutable_request()->set_height(height);
    spec.set_tile_px(tile);
    std::vector<int> seen(size_t(width) * height);
    for (uint32_t p = 0; p < partsOf(spec); ++p) {
      const v1::Window w = partWindow(spec, p);
      EXPECT_LE(std::max(w.width(), w.height()), tile);
      for (uint32_t y = w.y(); y < w.y() + w.height(); ++y)
        for (uint32_t x = w.x(); x < w.x() + w.width(); ++x) ++seen.at(size_t(y) * width + x);
    }
    EXPECT_EQ(std::set<int>(seen.begin(), seen.end()), std::set<int>{1}) << width << " x " << height << ", " << tile;
  }
  v1::JobSpec one;
  one.mutable_request()->set_width(64);
  one.mutable_request()->set_height(30);
  EXPECT_EQ(partsOf(one), 0u);
  one.set_tile_px(64);
  EXPECT_EQ(partsOf(one), 0u) << "one tile is the frame";
}

TEST(FrameParts, ADamagedFileIsRefusedAsLostData) {
  auto engine = newEngine();
  v1::JobSpec spec;
  spec.set_tile_px(16);
  *spec.mutable_request() = *engine->resolve(pictureOf(R"({"scene": "cornell", "width": 32, "height": 16, "halt": {"spp": 1}})"), {});
  std::vector<std::string> files;
  for (uint32_t p = 0; p < 2; ++p) {
    v1::RenderRequest request = spec.request();
    *request.mutable_window() = partWindow(spec, p);
    const auto rendered = engine->render(request);
    files.push_back(*writePart(*rendered, {0, p}));
    EXPECT_EQ(files.back(), *writePart(*newEngine()->render(request), {0, p})) << "another render has other bytes";
    EXPECT_TRUE(writePart(*rendered, {0, p}, 16 * 16 * 12).ok());
    EXPECT_EQ(writePart(*rendered, {0, p}, 16 * 16 * 12 - 1).status().code(), Code::OutOfRange);
  }
  const auto add = [&](FrameJoin& join, const std::string& bytes, uint32_t p) { return join.add(bytes.data(), bytes.size(), {0, p}).code(); };
  {
    FrameJoin join(spec.request());
    EXPECT_EQ(add(join, "\xff\xff nothing of ours", 0), Code::DataLoss);
    EXPECT_EQ(add(join, files[1], 0), Code::DataLoss) << "another part";
    EXPECT_EQ(join.add(files[0].data(), files[0].size(), {1, 0}).code(), Code::DataLoss) << "of another frame";
    EXPECT_EQ(add(join, files[0], 0), Code::Ok);
    EXPECT_EQ(join.finish().status().code(), Code::DataLoss) << "one is missing";
  }
  const auto changed = [&](const std::function<void(v1::RenderedPart&)>& change) {
    v1::RenderedPart part;
    EXPECT_TRUE(part.ParseFromString(files[1]));
    change(part);
    FrameJoin join(spec.request());
    EXPECT_EQ(add(join, files[0], 0), Code::Ok);
    return add(join, part.SerializeAsString(), 1);
  };
  EXPECT_EQ(changed([](v1::RenderedPart&) {}), Code::Ok);
  EXPECT_EQ(changed([](v1::RenderedPart& p) { p.mutable_window()->set_x(17); }), Code::DataLoss);
  EXPECT_EQ(changed([](v1::RenderedPart& p) { p.mutable_window()->set_width(0); }), Code::DataLoss);
  EXPECT_EQ(changed([](v1::RenderedPart& p) { p.clear_pictures(); }), Code::DataLoss);
  EXPECT_EQ(changed([](v1::RenderedPart& p) { p.mutable_pictures(0)->mutable_pixels()->pop_back(); }), Code::DataLoss);
  EXPECT_EQ(changed([](v1::RenderedPart& p) { p.mutable_pictures(0)->set_channels(4); }), Code::DataLoss);
  EXPECT_EQ(changed([](v1::RenderedPart& p) { p.mutable_pictures(0)->set_width(15); }), Code::DataLoss);
  EXPECT_EQ(changed([](v1::RenderedPart& p) { p.mutable_pictures(0)->set_output("depth"); }), Code::DataLoss);
}

TEST(FrameParts, WarnOfWhatTheWholeWouldWarnOf) {
  auto engine = newEngine();
  v1::JobSpec spec;
  spec.set_tile_px(16);
  *spec.mutable_request() = *engine->resolve(pictureOf(R"({"scene": "cornell", "width": 32, "height": 16, "halt": {"spp": 1}})"), {});
  std::vector<v1::RenderedPart> parts(2);
  for (uint32_t p = 0; p < 2; ++p) {
    v1::RenderRequest request = spec.request();
    *request.mutable_window() = partWindow(spec, p);
    ASSERT_TRUE(parts[p].ParseFromString(*writePart(*engine->render(request), {0, p})));
    parts[p].mutable_reply()->clear_warnings();
    parts[p].mutable_reply()->add_warnings("of both");
  }
  const auto warnings = [&] {
    FrameJoin join(spec.request());
    for (uint32_t p = 0; p < 2; ++p) {
      const std::string bytes = parts[p].SerializeAsString();
      EXPECT_TRUE(join.add(bytes.data(), bytes.size(), {0, p}).ok());
    }
    const auto joined = join.finish();
    return std::vector<std::string>(joined->reply.warnings().begin(), joined->reply.warnings().end());
  };
  const auto drop = [&](size_t p, uint64_t samples, uint64_t pixels) {
    parts[p].mutable_pictures(0)->set_dropped_samples(samples);
    parts[p].mutable_pictures(0)->set_dropped_pixels(pixels);
    parts[p].mutable_reply()->add_warnings(droppedWarning("beauty", {samples, pixels}));
  };
  drop(0, 3, 2);
  drop(1, 4, 1);
  parts[1].mutable_reply()->add_warnings("of one");
  const std::vector<std::string> counted = {"of both", "of one", droppedWarning("beauty", {7, 3})};
  EXPECT_EQ(warnings(), counted);
  // One part is so bright that its lights may be in candela; the whole is not, until the other is as well.
  Image bright(16, 16, 3);
  std::fill(bright.data.begin(), bright.data.end(), 100.0f);
  const std::string candela = photometricWarning(bright);
  ASSERT_FALSE(candela.empty());
  parts[1].mutable_reply()->add_warnings(candela);
  EXPECT_EQ(warnings(), counted);
  for (v1::RenderedPart& part : parts) part.mutable_pictures(0)->set_pixels(bright.data.data(), bright.data.size() * sizeof(float));
  auto all = counted;
  all.push_back(candela);
  EXPECT_EQ(warnings(), all);
}

TEST(FrameParts, WhatIsOfAWholePictureIsRefusedWhenTheJobIsSubmitted) {
  auto engine = newEngine();
  const auto refusal = [&](const std::string& json, uint32_t tile, int64_t last) {
    v1::JobSpec spec;
    *spec.mutable_request() = pictureOf(json);
    spec.set_tile_px(tile);
    spec.mutable_frames()->set_last(last);
    const auto job = makeJob(spec, "me", *engine, 0);
    return job.ok() ? Status() : job.status();
  };
  EXPECT_TRUE(refusal(R"({"scene": "cornell", "width": 64, "height": 64})", 16, 0).ok());
  for (const auto& [json, tile, last, word] : {std::tuple(R"({"scene": "cornell", "certificate": {}})", 64u, 0, "certificate"),
                                               {R"({"scene": "cornell", "halt": {"error": 0.1}})", 64u, 0, "halt.error"},
                                               {R"({"scene": "cornell", "window": {"width": 10, "height": 10}})", 64u, 0, "window"},
                                               {R"({"scene": "cornell", "width": 640, "height": 640})", 16u, 200, "201 frames of 1600 parts"},
                                               {R"({"scene": "cornell", "filters": [{"bloom": {}}]})", 64u, 0, "bloom"},
                                               {R"({"scene": "cornell"})", 15u, 0, "16"}}) {
    const Status status = refusal(json, tile, last);
    EXPECT_EQ(status.code(), Code::InvalidArgument) << json;
    EXPECT_EQ(status.location(), "job.tile_px") << status.toString();
    EXPECT_NE(status.message().find(word), std::string::npos) << status.toString();
  }
}

struct PartsStore : test::OnEachStore<test::StoreFixture> {
  static NewJob split(int frames, uint32_t parts) {
    NewJob job = makeJob(frames);
    job.parts = parts;
    return job;
  }
  static std::vector<v1::FrameFile> partFile(const Lease& lease) { return files("p" + std::to_string(lease.task.index)); }
  std::vector<std::string> partsOfFrame(int64_t job, int64_t frame) {
    std::vector<std::string> found;
    const auto files = store->parts({job, frame});
    for (const v1::FrameFile& f : *files) found.push_back(f.sha256());
    return found;
  }
};
INSTANTIATE_TEST_SUITE_P(Stores, PartsStore, test::kBothStores, test::storeName);

TEST_P(PartsStore, AFrameIsReadyWhenItsPartsAreDone) {
  const int64_t id = submit(split(2, 3));
  std::vector<Lease> parts;
  while (const auto lease = claim()) parts.push_back(*lease);
  ASSERT_EQ(parts.size(), 6u) << "frames are ready before their parts";
  for (size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(parts[i].task.index, int64_t(2 + i));
    EXPECT_EQ(parts[i].frame, 10 + int64_t(i / 3));
    const TaskPlace place = placeOf(parts[i].task.index, 2, 3);
    EXPECT_EQ(place.frame, int64_t(i / 3));
    EXPECT_EQ(place.part, uint32_t(i % 3));
  }
  v1::Job job = get(id);
  EXPECT_EQ(job.frames_total(), 2u);
  ASSERT_EQ(job.frames_size(), 2);
  EXPECT_EQ(job.frames(0).state(), v1::Frame::RUNNING);
  EXPECT_EQ(job.frames(1).parts(), 3u);
  // Those of the second frame first, in any order.
  for (const size_t i : {5u, 3u, 4u}) {
    EXPECT_TRUE(partsOfFrame(id, 1).empty());
    EXPECT_FALSE(claim());
    const uint64_t before = store->get(id, false)->revision;
    EXPECT_TRUE(store->complete(parts[i], partFile(parts[i]), 2).ok());
    const auto changed = store->changes(id, before);
    ASSERT_EQ(changed->job.frames_size(), 1) << "whoever watches is told";
    EXPECT_EQ(changed->job.frames(0).frame(), 11);
  }
  job = get(id);
  EXPECT_EQ(job.frames(1).parts_done(), 3u);
  EXPECT_EQ(job.frames(1).state(), v1::Frame::QUEUED);
  EXPECT_DOUBLE_EQ(job.frames(1).progress(), 0.75);
  EXPECT_DOUBLE_EQ(job.progress(), 0.375);
  EXPECT_EQ(job.frames(0).parts_done(), 0u);
  EXPECT_EQ(job.frames_done(), 0u);
  EXPECT_EQ(job.frames(1).files_size(), 0) << "a part's file is no result";
  EXPECT_EQ(job.result_bytes(), 21u);
  EXPECT_EQ(partsOfFrame(id, 1), (std::vector<std::string>{"p5", "p6", "p7"}));
  EXPECT_TRUE(partsOfFrame(id, 0).empty());
  const auto frame = claim();
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->task, (TaskId{id, 1}));
  EXPECT_TRUE(store->complete(*frame, files("whole"), 1).ok());
  EXPECT_TRUE(store->complete(*frame, files("whole"), 1).ok()) << "repeated";
  job = get(id);
  EXPECT_EQ(job.frames(1).state(), v1::Frame::DONE);
  EXPECT_EQ(job.frames(1).files(0).sha256(), "whole");
  EXPECT_DOUBLE_EQ(job.frames(1).seconds(), 7) << "of all parts together";
  EXPECT_EQ(job.frames_done(), 1u);
  EXPECT_EQ(job.result_bytes(), 7u) << "its parts are needed no more";
  EXPECT_EQ(store->neededResults(id)->size(), 1u);
  for (const size_t i : {0u, 1u, 2u}) EXPECT_TRUE(store->complete(parts[i], partFile(parts[i]), 2).ok());
  const auto last = claim();
  ASSERT_TRUE(last);
  EXPECT_TRUE(store->complete(*last, files("first"), 1).ok());
  EXPECT_EQ(get(id).state(), v1::Job::DONE);
  EXPECT_EQ(*store->integrity(), "ok");
}

TEST_P(PartsStore, APartThatFailsForGoodFailsItsFrameAlone) {
  const int64_t id = submit(split(2, 3));
  const auto a = claim(), b = claim();
  ASSERT_TRUE(a && b);
  EXPECT_TRUE(store->fail(*b, {{Code::InvalidArgument, "no such lamp"}, false, false}).ok());
  v1::Job job = get(id);
  EXPECT_EQ(job.frames(0).state(), v1::Frame::FAILED);
  EXPECT_NE(job.frames(0).error().message().find("part 1: no such lamp"), std::string::npos);
  EXPECT_EQ(job.frames_failed(), 1u);
  EXPECT_EQ(store->complete(*a, partFile(*a), 1).code(), Code::FailedPrecondition) << "its other parts are over";
  std::vector<Lease> rest;
  while (const auto lease = claim()) rest.push_back(*lease);
  ASSERT_EQ(rest.size(), 3u);
  for (const Lease& lease : rest) EXPECT_TRUE(store->complete(lease, partFile(lease), 1).ok());
  const auto frame = claim();
  ASSERT_TRUE(frame);
  EXPECT_TRUE(store->complete(*frame, files("b"), 1).ok());
  job = get(id);
  EXPECT_EQ(job.state(), v1::Job::FAILED);
  EXPECT_EQ(job.frames_done(), 1u);
  EXPECT_EQ(*store->integrity(), "ok");
  // And again: all three, since none of them was done.
  EXPECT_TRUE(store->retry(id).ok());
  rest.clear();
  while (const auto lease = claim()) rest.push_back(*lease);
  ASSERT_EQ(rest.size(), 3u);
  for (const Lease& lease : rest) EXPECT_TRUE(store->complete(lease, partFile(lease), 1).ok());
  const auto again = claim();
  ASSERT_TRUE(again);
  EXPECT_EQ(again->task.index, 0);
  EXPECT_TRUE(store->complete(*again, files("a"), 1).ok());
  EXPECT_EQ(get(id).state(), v1::Job::DONE);
  EXPECT_EQ(*store->integrity(), "ok");
}

TEST_P(PartsStore, PartsThatAreDoneStayThroughCancelAndRetry) {
  const int64_t id = submit(split(1, 3));
  const auto a = claim(), b = claim();
  EXPECT_TRUE(store->complete(*a, partFile(*a), 1).ok());
  EXPECT_TRUE(store->cancel(id).ok());
  EXPECT_EQ(store->complete(*b, partFile(*b), 1).code(), Code::FailedPrecondition);
  EXPECT_EQ(store->neededResults(id)->size(), 1u);
  EXPECT_TRUE(store->retry(id).ok());
  std::vector<int64_t> left;
  std::vector<Lease> leases;
  while (const auto lease = claim()) leases.push_back(*lease), left.push_back(lease->task.index);
  EXPECT_EQ(left, (std::vector<int64_t>{2, 3}));
  for (const Lease& lease : leases) EXPECT_TRUE(store->complete(lease, partFile(lease), 1).ok());
  const auto frame = claim();
  ASSERT_TRUE(frame);
  EXPECT_EQ(partsOfFrame(id, 0).size(), 3u);
}

TEST_P(PartsStore, APartWhoseFileIsLostIsRenderedAgain) {
  const int64_t id = submit(split(2, 2));
  std::vector<Lease> parts;
  while (const auto lease = claim()) parts.push_back(*lease);
  for (const Lease& lease : parts) EXPECT_TRUE(store->complete(lease, partFile(lease), 1).ok());
  auto frame = claim();
  ASSERT_TRUE(frame && frame->task.index == 0);
  EXPECT_TRUE(store->fail(*frame, {{Code::DataLoss, "a part's file is damaged"}, true, false}).ok());
  EXPECT_TRUE(partsOfFrame(id, 0).empty());
  EXPECT_EQ(partsOfFrame(id, 1).size(), 2u) << "another frame's";
  EXPECT_EQ(get(id).result_bytes(), 14u);
  time += 5;
  parts.clear();
  while (const auto lease = claim()) parts.push_back(*lease);
  ASSERT_EQ(parts.size(), 3u);
  EXPECT_EQ(parts[0].task.index, 1);
  EXPECT_TRUE(store->complete(parts[0], files("b"), 1).ok());
  for (const size_t i : {1u, 2u}) EXPECT_TRUE(store->complete(parts[i], partFile(parts[i]), 1).ok());
  frame = claim();
  ASSERT_TRUE(frame && frame->task.index == 0);
  EXPECT_TRUE(store->complete(*frame, files("a"), 1).ok());
  EXPECT_EQ(get(id).state(), v1::Job::DONE);
  EXPECT_EQ(*store->integrity(), "ok");
}

// With one try the frame fails, and a retry of the job renders what is lost.
TEST_P(PartsStore, APartWhoseFileIsLostAtTheLastTryIsRenderedByARetry) {
  NewJob job = split(1, 2);
  job.spec.set_max_attempts(1);
  const int64_t id = submit(job);
  for (int round = 0; round < 2; ++round) {
    std::vector<Lease> parts;
    for (int i = 0; i < 2; ++i) {
      const auto lease = claim();
      ASSERT_TRUE(lease && lease->task.index > 0) << round;
      parts.push_back(*lease);
    }
    for (const Lease& lease : parts) EXPECT_TRUE(store->complete(lease, partFile(lease), 1).ok());
    const auto frame = claim();
    ASSERT_TRUE(frame && frame->task.index == 0);
    if (round == 1) {
      EXPECT_TRUE(store->complete(*frame, files("a"), 1).ok());
      break;
    }
    EXPECT_TRUE(store->fail(*frame, {{Code::DataLoss, "a part's file is damaged"}, true, false}).ok());
    EXPECT_EQ(get(id).state(), v1::Job::FAILED);
    EXPECT_FALSE(claim());
    EXPECT_EQ(*store->integrity(), "ok");
    ASSERT_TRUE(store->retry(id).ok());
  }
  EXPECT_EQ(get(id).state(), v1::Job::DONE);
  EXPECT_EQ(*store->integrity(), "ok");
}

TEST_P(PartsStore, LostWorkersOfAPartSetItsFrameAside) {
  options.maxLosses = 3;
  open();
  const int64_t id = submit(split(1, 2));
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(claim(10));
    time += 11;
    EXPECT_EQ(*store->expireLeases(), 1u);
  }
  const v1::Job job = get(id);
  EXPECT_EQ(job.state(), v1::Job::FAILED);
  EXPECT_EQ(job.frames(0).state(), v1::Frame::FAILED);
  EXPECT_FALSE(claim());
  EXPECT_EQ(*store->integrity(), "ok");
}

// A daemon that dies with several parts of a frame: the frame is set aside once, and the job goes on with the others.
TEST_P(PartsStore, PartsThatAreLostTogetherSetTheirFrameAsideOnce) {
  options.maxLosses = 3;
  open();
  const int64_t id = submit(split(2, 2));
  for (int i = 0; i < 3; ++i) {
    const auto a = claim(), b = claim();
    ASSERT_TRUE(a && b);
    EXPECT_EQ(a->frame, b->frame);
    EXPECT_EQ(*store->endAllLeases(), i < 2 ? 2u : 1u);
  }
  const v1::Job job = get(id);
  EXPECT_EQ(job.frames_failed(), 1u);
  EXPECT_FALSE(jobIsOver(job.state()));
  EXPECT_EQ(job.frames(0).state(), v1::Frame::FAILED);
  EXPECT_EQ(*store->integrity(), "ok");
  const auto next = claim();
  ASSERT_TRUE(next);
  EXPECT_EQ(next->frame, job.frames(1).frame());
}

TEST_P(PartsStore, WaitingPartsCountAgainstTheBoundOnFrames) {
  options.maxActiveTasks = 8;
  open();
  submit(split(2, 2));
  bool existed = false;
  EXPECT_EQ(store->submit(split(1, 2), existed).status().code(), Code::ResourceExhausted);
  EXPECT_TRUE(store->submit(makeJob(2), existed).ok());
}

}  // namespace
}  // namespace gobo
