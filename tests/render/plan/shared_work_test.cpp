// SPDX-License-Identifier: Apache-2.0
// Requests at the same time on one engine: what they have in common is traced once, whoever comes first, and everybody's picture is that of an engine
// of his own. A request that is given up does not cost those who wait for the same what it had traced.
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "support/engines.h"

namespace gobo::testing {
namespace {

v1::RenderRequest busy(int spp = 96) {
  v1::RenderRequest r = smallRequest("cornell", 64, 48, spp);
  r.mutable_integrator()->set_max_bounces(4);
  return r;
}

uint64_t raysAlone(const v1::RenderRequest& r) { return mustRender(*makeEngine(), r).reply.rays(); }

TEST(SharedWork, EqualRequestsAtOnceTraceOnce) {
  for (const char* technique : {"", "shadows.ray_traced.samples=4", "shadows.axis_aligned.mu=2", "environment.extract_lights=2"}) {
    SCOPED_TRACE(technique);
    v1::RenderRequest r = busy();
    if (*technique) {
      r.set_scene("fence");
      if (std::string(technique).starts_with("environment")) set(r, "environment.sky.sun_direction=0.3,0.8,0.2");
      set(r, technique);
    }
    const RenderResult alone = mustRender(*makeEngine(), r);
    const auto engine = makeEngine();
    std::atomic<uint64_t> rays{0};
    std::vector<std::thread> callers;
    for (int i = 0; i < 4; ++i)
      callers.emplace_back([&] {
        const RenderResult mine = mustRender(*engine, r);
        rays += mine.reply.rays();
        EXPECT_EQ(firstDifference(mine, alone), "");
      });
    for (auto& t : callers) t.join();
    EXPECT_EQ(rays, alone.reply.rays());
  }
}

TEST(SharedWork, RelightsAndOutputsOfOneSceneTraceOnce) {
  std::vector<v1::RenderRequest> requests(3, busy());
  set(requests[1], "lights.light.gain=0.2,1,0.4");
  set(requests[2], "tone_map.exposure=1");
  const auto engine = makeEngine();
  std::atomic<uint64_t> rays{0};
  std::vector<std::thread> callers;
  for (const auto& r : requests)
    callers.emplace_back([&] {
      const RenderResult mine = mustRender(*engine, r);
      rays += mine.reply.rays();
      EXPECT_EQ(firstDifference(mine, mustRender(*makeEngine(), r)), "");
    });
  for (auto& t : callers) t.join();
  EXPECT_EQ(rays, raysAlone(requests[0]));
}

v1::RenderRequest many(int spp) { return smallRequest("cornell", 160, 96, spp); }  // progress is told every 16 tiles

// The one who traces gives up in the middle: who waits goes on from there. Nothing outside says when the second has begun to wait, so one of some tries
// must show it; the picture is right in each. (That few samples do not wait for many: WorkInFlight.FewerBlocksAreWaitedForAndMoreAreNot.)
TEST(SharedWork, WhoWaitsGoesOnWhereAnotherGaveUp) {
  const v1::RenderRequest r = many(256);
  const RenderResult alone = mustRender(*makeEngine(), r);
  bool wentOn = false;
  for (int attempt = 0; attempt < 6 && !wentOn; ++attempt) {
    const auto engine = makeEngine();
    StopSource giveUp;
    std::atomic<bool> begun{false}, waits{false};
    std::atomic<double> reached{0};
    RenderControl first;
    first.stop = giveUp.token();
    first.progress = [&](const v1::Progress& p) {
      begun = true;
      if (!waits || p.fraction() < 0.2 || p.fraction() > 0.99) return;
      reached = p.fraction();
      giveUp.stop(StopReason::Cancelled);
    };
    Code ended = Code::Ok;
    std::thread gaveUp([&] { ended = engine->render(r, first).status().code(); });
    while (!begun) std::this_thread::yield();
    std::thread soon([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(20 << attempt));
      waits = true;
    });
    const RenderResult mine = mustRender(*engine, r);
    soon.join();
    gaveUp.join();
    EXPECT_EQ(firstDifference(mine, alone), "");
    wentOn = ended == Code::Cancelled && double(mine.reply.rays()) < (1.1 - reached) * double(alone.reply.rays());
  }
  EXPECT_TRUE(wentOn) << "what had been traced was thrown away";
}

// The map of a sky is made once for requests that follow one another; it is counted, and goes when it is asked to.
TEST(SharedWork, OfSkiesTheLastOneIsKeptAndNeverTakenForAnother) {
  const auto engine = makeEngine();
  const auto environmentBytes = [&] {
    v1::StatusReply status;
    engine->fillStatus(status);
    for (const auto& m : status.memory())
      if (m.name() == "environments") return m.bytes();
    return uint64_t(0);
  };
  std::vector<v1::RenderRequest> asked;
  for (const char* sky : {"turbidity=3", "turbidity=6", "turbidity=6", "sun_scale=0", "sun_direction=0,1,1", "turbidity=3"}) {
    v1::RenderRequest r = smallRequest("cornell", 8, 6, 1);
    set(r, std::string("environment.sky.") + sky);
    set(r, "environment.background=BLURRED");
    r.set_seed(asked.size());  // every node that reads the sky runs
    asked.push_back(r);
  }
  std::vector<RenderResult> made;
  for (const v1::RenderRequest& r : asked) {
    made.push_back(mustRender(*engine, r));
    EXPECT_EQ(firstDifference(made.back(), mustRender(*makeEngine(), r)), "") << messageToJson(r.environment(), false);
    EXPECT_EQ(environmentBytes(), 512u * 256u * sizeof(Vec3));
  }
  for (size_t k = 1; k < made.size(); ++k) EXPECT_NE(firstDifference(made[k], made[k - 1]), "") << k;
  engine->dropCaches(false);
  EXPECT_EQ(environmentBytes(), 0u);
}

}  // namespace
}  // namespace gobo::testing
