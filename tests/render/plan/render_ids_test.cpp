// SPDX-License-Identifier: Apache-2.0
// A render id is a handle of one reply: a relight from it repeats that reply's request, whoever asked for the same before, and only
// its owner can use it.
#include <gtest/gtest.h>

#include "support/engines.h"

namespace gobo::testing {
namespace {

RenderResult renderFor(Engine& engine, const v1::RenderRequest& request, const std::string& owner = {}) {
  RenderControl control;
  control.owner = owner;
  Result<RenderResult> r = engine.render(request, control);
  EXPECT_TRUE(r.ok()) << r.status().toString();
  return r.ok() ? std::move(*r) : RenderResult{};
}

v1::RelightRequest recolour(const std::string& id) {
  v1::RelightRequest relight;
  relight.set_render_id(id);
  EXPECT_TRUE(setPath(*relight.mutable_patch(), "lights.key.gain=1,0.5,0.25").ok());
  relight.add_mask("lights.key.gain");
  return relight;
}

v1::RenderRequest keyed() {
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 16);
  for (const char* a : {"lights.key.kind=POINT", "lights.key.position=0.2,1.4,0.3", "lights.key.intensity=3"}) set(r, a);
  return r;
}

TEST(RenderIds, EqualRequestsHaveOneHashAndIdsOfTheirOwn) {
  const auto engine = makeEngine();
  const RenderResult a = renderFor(*engine, keyed()), b = renderFor(*engine, keyed());
  EXPECT_EQ(a.reply.request_hash(), b.reply.request_hash());
  EXPECT_NE(a.reply.render_id(), b.reply.render_id());
  EXPECT_GE(a.reply.render_id().size(), 33u) << "128 bits: nobody finds one by trying";
}

TEST(RenderIds, ARelightRepeatsItsOwnReply) {
  const auto engine = makeEngine();
  // The same picture twice: once because the time was up, once because one sample was asked for.
  v1::RenderRequest timed = keyed();
  timed.clear_halt();
  timed.mutable_halt()->set_time_s(1e-9);
  const RenderResult first = renderFor(*engine, timed);
  ASSERT_EQ(first.reply.resolved().halt().spp(), 1u);
  v1::RenderRequest counted = keyed();
  counted.mutable_halt()->set_spp(1);
  const RenderResult second = renderFor(*engine, counted);
  ASSERT_EQ(firstDifference(first, second), "");
  for (const RenderResult* reply : {&first, &second}) {
    const auto request = engine->relightRequest(recolour(reply->reply.render_id()));
    ASSERT_TRUE(request.ok()) << request.status().toString();
    EXPECT_FALSE(request->halt().has_time_s());
    EXPECT_EQ(request->halt().spp(), 1u);
    const RenderResult relit = renderFor(*engine, *request);
    EXPECT_EQ(relit.reply.resolved().halt().spp(), 1u);
    EXPECT_EQ(relit.reply.rays(), 0u) << "a colour alone traces nothing";
    EXPECT_NE(firstDifference(relit, *reply), "");
  }
}

TEST(RenderIds, WhatIsNoPartOfThePictureIsRepeatedToo) {
  const auto engine = makeEngine();
  std::vector<std::pair<v1::RenderRequest, std::string>> asked;
  for (const char* edit : {"scheduling.priority=BATCH", "encoding.format=PNG", "certificate.pixel_fraction=0.5", "scheduling.client=someone", "seed=0"}) {
    v1::RenderRequest r = keyed();
    set(r, edit);
    asked.emplace_back(r, renderFor(*engine, r).reply.render_id());
  }
  for (const auto& [request, id] : asked) {
    const auto recalled = engine->relightRequest(recolour(id));
    ASSERT_TRUE(recalled.ok());
    const auto resolved = engine->resolve(request);
    ASSERT_TRUE(resolved.ok());
    EXPECT_EQ(recalled->scheduling().priority(), resolved->scheduling().priority());
    EXPECT_EQ(recalled->scheduling().client(), request.scheduling().client());
    EXPECT_EQ(recalled->encoding().format() == v1::Encoding::PNG, request.encoding().format() == v1::Encoding::PNG);
    EXPECT_EQ(recalled->has_certificate(), request.has_certificate());
  }
}

TEST(RenderIds, SnapshotsHaveIdsOfTheirOwn) {
  const auto engine = makeEngine();
  v1::RenderRequest r = keyed();
  r.mutable_halt()->set_spp(64);
  std::map<std::string, uint32_t> samples;
  RenderControl control;
  control.snapshot = [&](const RenderResult& s) { samples[s.reply.render_id()] = s.reply.resolved().halt().spp(); };
  const auto last = engine->render(r, control);
  ASSERT_TRUE(last.ok());
  samples[last->reply.render_id()] = 64;
  ASSERT_EQ(samples.size(), 3u);  // 16, 32, 64
  for (const auto& [id, spp] : samples) EXPECT_EQ(engine->relightRequest(recolour(id))->halt().spp(), spp);
}

TEST(RenderIds, AreTheirOwners) {
  const auto engine = makeEngine();
  const std::string ofA = renderFor(*engine, keyed(), "a").reply.render_id(), ofNobody = renderFor(*engine, keyed()).reply.render_id();
  EXPECT_TRUE(engine->relightRequest(recolour(ofA), "a").ok());
  EXPECT_TRUE(engine->relightRequest(recolour(ofA)).ok()) << "whoever may everything";
  EXPECT_EQ(engine->relightRequest(recolour(ofA), "b").status().code(), Code::NotFound);
  EXPECT_EQ(engine->relightRequest(recolour(ofNobody), "b").status().code(), Code::NotFound);
  EXPECT_EQ(engine->relightRequest(recolour(ofA), "b").status().message().size(),
            engine->relightRequest(recolour(std::string(ofA.size(), 'x')), "b").status().message().size())
      << "like one that never was";
}

}  // namespace
}  // namespace gobo::testing
