// SPDX-License-Identifier: Apache-2.0
// A render that is stopped at any of its polls says so, leaves nothing wrong behind, and polls often: for every technique of the
// registry, for environments of every kind, and for what runs while planning.
#include <gtest/gtest.h>

#include "filters/shadow_technique.h"
#include "plan/certify_picture.h"
#include "plan/checkpoints.h"
#include "plan/reference.h"
#include "support/engines.h"
#include "support/stopping.h"

namespace gobo::testing {
namespace {

constexpr int kMany = 1 << 30;

struct Case {
  std::string name;
  v1::RenderRequest request;
};

std::vector<Case> cases() {
  std::vector<Case> out;
  for (const ShadowTechniqueEntry& t : shadowTechniques()) {
    v1::RenderRequest r = smallRequest("cornell", 24, 16, 2);
    set(r, std::string("lights.lamp.kind=") + (t.supports(LightKind::Rect) ? "RECT" : "SPOT"));
    for (const char* a : {"lights.lamp.position=0.2,1.6,0.4", "lights.lamp.direction=0,-1,-0.2", "lights.lamp.intensity=3"}) set(r, a);
    v1::ShadowTechnique& technique = *(*r.mutable_lights())["lamp"].mutable_shadow();
    technique.GetReflection()->MutableMessage(&technique, technique.GetDescriptor()->FindFieldByNumber(t.key));
    if (t.usesMap || technique.has_auto_()) technique.mutable_map()->set_resolution(32);
    if (technique.has_auto_()) technique.mutable_auto_()->set_error(0.05);
    out.push_back({t.name, r});
  }
  for (const char* kind : {"environment.area_lights=6", "environment.extract_lights=6", "environment.transfer.points=300", "seed=1"}) {
    v1::RenderRequest r = smallRequest("cornell", 24, 16, 2);
    set(r, "environment.sky.turbidity=3");
    set(r, kind);
    out.push_back({kind, r});
  }
  for (const char* by : {"STRUCTURED", "WAVELET"}) {
    v1::RenderRequest r = smallRequest("cornell", 24, 16, 2);
    for (const char* a : {"environment.sky.turbidity=3", "environment.extract_lights=6"}) set(r, a);
    set(r, std::string("environment.extract_by=") + by);
    out.push_back({by, r});
  }
  v1::RenderRequest caustics = smallRequest("spheres", 24, 16, 2);
  for (const char* a : {"lights.lamp.kind=POINT", "lights.lamp.position=1,3,1", "lights.lamp.intensity=5", "integrator.caustic_photons=500"}) set(caustics, a);
  out.push_back({"caustics", caustics});
  v1::RenderRequest certified = smallRequest("spheres", 24, 16, 1);
  for (const char* a : {"certificate.min_pixels=16", "certificate.spp=4"}) set(certified, a);
  out.push_back({"certificate", certified});
  v1::RenderRequest cluster = smallRequest("cornell", 24, 16, 1);  // its lights are folded
  for (const char* a : {"integrator.max_groups=1", "shadows.ray_traced.samples=1", "lights.a.kind=SPOT", "lights.a.position=0,1,0", "lights.b.kind=POINT",
                        "lights.b.position=0.3,1,0"})
    set(cluster, a);
  out.push_back({"cluster", cluster});
  v1::RenderRequest shutter = smallRequest("cornell", 24, 16, 4);
  for (const char* a : {"camera.shutter_s=1", "camera.shutter_slices=2", "curves.camera.yfov_deg.time_s=0,1", "curves.camera.yfov_deg.value=30,50"})
    set(shutter, a);
  out.push_back({"shutter", shutter});
  return out;
}

TEST(Stops, AtAnyPollARenderEndsAndLeavesNothingWrong) {
  for (const Case& c : cases()) {
    RenderControl counting;
    StopSource count;
    count.stopAtPoll(kMany);
    counting.stop = count.token();
    const auto engine = makeEngine(256ull << 20, {}, 1);
    const auto whole = engine->render(c.request, counting);
    ASSERT_TRUE(whole.ok()) << c.name << ": " << whole.status().toString();
    const int polls = kMany - count.pollsLeft();
    EXPECT_GT(polls, 20) << c.name;
    const auto stopped = makeEngine(256ull << 20, {}, 1);
    for (int k = 0; k < 5; ++k) {  // the same engine again and again: it goes on from what the stopped ones left
      StopSource stop;
      stop.stopAtPoll(1 + polls * k / 6);
      RenderControl control;
      control.stop = stop.token();
      const auto result = stopped->render(c.request, control);
      if (result.ok()) {  // the store had the rest
        EXPECT_EQ(firstDifference(*result, *whole), "") << c.name << " stopped at " << k << "/6";
      } else {
        EXPECT_EQ(result.status().code(), Code::Cancelled) << c.name << ": " << result.status().toString();
      }
    }
    EXPECT_EQ(firstDifference(mustRender(*stopped, c.request), *whole), "") << c.name;
  }
}

TEST(Stops, ABuiltInSceneThatARenderWaitsForIsNotKept) {
  const auto engine = makeEngine(256ull << 20, {}, 1);
  for (const bool planning : {false, true}) {
    StopSource stop;
    stop.stopAtPoll(700);  // among the rows of its textures
    RenderControl control;
    control.stop = stop.token();
    const v1::RenderRequest request = smallRequest("atrium", 24, 16, 1);
    const Status status = planning ? engine->prepare(request, nullptr, stop.token()).status() : engine->render(request, control).status();
    EXPECT_EQ(status.code(), Code::Cancelled) << status.toString();
    EXPECT_TRUE(engine->listScenes().empty());
  }
  EXPECT_EQ(engine->openScene("atrium", "", tests::stoppedAlready()).status().code(), Code::Cancelled);
  EXPECT_TRUE(engine->listScenes().empty());
  EXPECT_TRUE(engine->openScene("atrium", "").ok());
}

TEST(Stops, PlanningPollsWhileItBakesASkyAndWeighsLights) {
  v1::RenderRequest sky = smallRequest("cornell", 24, 16, 1);
  set(sky, "environment.sky.turbidity=3");
  const auto engine = makeEngine(256ull << 20, {}, 1);
  ASSERT_TRUE(engine->prepare(smallRequest("cornell", 24, 16, 1)).ok());
  // Of 512 x 256 texels the rows above the horizon, the rings of the sun, all rows.
  EXPECT_GE(tests::pollsOf([&](const StopToken& s) { ASSERT_TRUE(engine->prepare(sky, nullptr, s).ok()); }), 128 + 64 + 256);
  for (const int k : {1, 100, 180, 300}) {
    set(sky, "environment.sky.turbidity=" + std::to_string(4 + 0.01 * k));  // another each time: the last one's map is kept
    EXPECT_EQ(engine->prepare(sky, nullptr, tests::stopAt(k)).status().code(), Code::Cancelled) << k;
  }
  const ScenePtr spheres = *engine->loadScene("spheres", true);  // under a map of 128 x 64
  EXPECT_GE(tests::pollsOf([&](const StopToken& s) { (void)makeGroups(*spheres, 1, s); }), 64);
}

TEST(Stops, ACertificatePollsBeforeItTraces) {
  constexpr int width = 200, height = 100;
  Image picture(width, height, 3);
  for (size_t i = 0; i < picture.data.size(); ++i) picture.data[i] = float(i % 97);
  v1::CertificateSettings settings;
  settings.set_pixel_fraction(0.1);
  // The picture copied, medians, two sums over windows.
  EXPECT_GE(tests::pollsOf([&](const StopToken& s) { (void)drawCertificate(picture, settings, s); }), 4 * height);
  const auto engine = makeEngine(256ull << 20, {}, 1);
  const auto request = engine->resolve(smallRequest("spheres", width, height, 1));
  ASSERT_TRUE(request.ok());
  const auto effective = makeEffectiveScene(*engine->scene("spheres"), *request, {});
  ASSERT_TRUE(effective.ok());
  const ReferenceRecipe recipe = referenceRecipe(*effective, *request);
  const TaskArena arena(1);
  std::atomic<uint64_t> rays{0};
  const auto make = [&](const StopToken& s) {
    AccelCache accels;
    return ReferenceTracer(*effective, width, height, recipe, accels, arena, s).trace({1, 2, 3}, 0, 1, rays).status();
  };
  const int polls = tests::pollsOf([&](const StopToken& s) { EXPECT_TRUE(make(s).ok()); });
  EXPECT_GE(polls, 10 + 2 * 64);  // the hierarchy; the map's distribution and flux
  for (const int k : {1, polls / 2, polls}) EXPECT_EQ(make(tests::stopAt(k)).code(), Code::Cancelled) << k << " of " << polls;
}

/// Preempts the render that asks for a checkpoint, and has none.
struct Preempting final : RenderCheckpoints {
  explicit Preempting(StopSource& s) : source(s) {}
  TermPtr load(const Hash128&, uint32_t) override {
    source.stop(StopReason::Preempted);
    return nullptr;
  }
  void save(const Hash128&, uint32_t, TermPtr state) override { saved = std::move(state); }
  StopSource& source;
  TermPtr saved;
};

TEST(Stops, AStateTakenUpAgainIsKeptWhenItsNodeIsPreemptedBeforeItBegins) {
  const auto engine = makeEngine(256ull << 20, {}, 1);
  const v1::RenderRequest request = smallRequest("cornell", 160, 96, 16);
  StopSource first;
  RenderControl control;
  control.stop = first.token();
  control.progress = [&](const v1::Progress&) { first.stop(StopReason::Preempted); };  // path tracing reports, in its midst
  ASSERT_EQ(engine->render(request, control).status().code(), Code::Aborted);
  StopSource second;
  Preempting checkpoints(second);
  RenderControl again;
  again.stop = second.token();
  again.checkpoints = &checkpoints;
  ASSERT_EQ(engine->render(request, again).status().code(), Code::Aborted);
  ASSERT_NE(checkpoints.saved, nullptr);
  uint64_t samples = 0;
  for (const uint32_t s : checkpoints.saved->plane<uint32_t>("samples")) samples += s;
  EXPECT_GT(samples, 0u);
}

TEST(Stops, APlanStopsInItsExpanders) {
  for (const Case& c : cases()) {
    if (c.name.find("environment.") == std::string::npos && c.name != "auto") continue;
    v1::StatusReply before;
    const auto prepares = makeEngine(256ull << 20, {}, 1);
    ASSERT_TRUE(prepares->prepare(c.request).ok()) << c.name;
    prepares->fillStatus(before);
    EXPECT_EQ(before.store_terms(), 0u) << c.name << ": a node ran before admission";
    const auto planned = [&](StopToken stop) {
      RenderControl control;
      control.stop = stop;
      return makeEngine(256ull << 20, {}, 1)->render(c.request, control).status();
    };
    for (const int n : {2, 20, 30}) EXPECT_EQ(planned(tests::stopAt(n)).code(), Code::Cancelled) << c.name << " at " << n;
  }
}

}  // namespace
}  // namespace gobo::testing
