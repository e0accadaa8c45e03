// SPDX-License-Identifier: Apache-2.0
#include "plan/engine.h"
#include "import/load.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <thread>

#include "support/certificate_scenes.h"
#include "support/engines.h"
#include "support/instrumented.h"
#include "support/tiny_scenes.h"

namespace gobo::testing {
namespace {

Code codeOf(Engine& engine, const v1::RenderRequest& r) { return engine.render(r).status().code(); }

TEST(Engine, BadRequestsNameFieldAndValueBeforeAnyWork) {
  const auto engine = makeEngine();
  const auto expect = [&](const std::string& edit, Code code, const std::string& place, const std::string& word) {
    v1::RenderRequest r = smallRequest("cornell");
    set(r, edit);
    const Result<RenderResult> result = engine->render(r);
    EXPECT_EQ(result.status().code(), code) << edit << ": " << result.status().toString();
    EXPECT_NE(result.status().location().find(place), std::string::npos) << edit << ": " << result.status().toString();
    EXPECT_NE(result.status().message().find(word), std::string::npos) << edit << ": " << result.status().toString();
  };
  expect("scene=nowhere", Code::NotFound, "request.scene", "nowhere");
  expect("width=0", Code::InvalidArgument, "request.width", "0");
  expect("width=20000", Code::InvalidArgument, "request.width", "20000");
  expect("outputs=beauty,shine", Code::InvalidArgument, "request.outputs", "shine");
  expect("outputs=visibility:moon", Code::NotFound, "request.outputs", "moon");
  expect("camera.name=side", Code::NotFound, "request.camera.name", "side");
  expect("lights.moon.intensity=3", Code::NotFound, "request.lights.moon", "moon");
  expect("lights.moon.kind=RECT", Code::Ok, "", "");
  expect("shadows.exponential.c=2001", Code::InvalidArgument, "c", "2001");
  expect("environment.path=/nowhere/x.hdr", Code::NotFound, "request.environment.path", "/nowhere/x.hdr");
  expect("camera.up=0,0,0", Code::InvalidArgument, "request.camera.up", "zero");
  expect("integrator.max_bounces=65", Code::InvalidArgument, "request.integrator.max_bounces", "65");
  expect("halt.spp=0", Code::InvalidArgument, "request.halt.spp", "0");
}

TEST(Engine, ShadowSettingsThatCannotBeAreRefused) {
  const auto engine = makeEngine();
  const auto tell = [&](std::initializer_list<const char*> edits) {
    v1::RenderRequest r = smallRequest("spheres", 8, 6);
    for (const char* e : {"lights.lamp.kind=SPOT", "lights.lamp.position=0,3,1", "lights.lamp.direction=0,-1,0", "lights.lamp.intensity=9",
                          "shadows.map.resolution=16", "outputs=visibility:lamp"})
      set(r, e);
    for (const char* e : edits) set(r, e);
    return engine->render(r).status();
  };
  const auto refused = [&](std::initializer_list<const char*> edits, const char* field, const char* value) {
    const Status s = tell(edits);
    EXPECT_EQ(s.code(), Code::InvalidArgument) << *edits.begin();
    EXPECT_NE((s.location() + " " + s.message()).find(field), std::string::npos) << *edits.begin() << ": " << s.toString();
    EXPECT_NE(s.message().find(value), std::string::npos) << *edits.begin() << ": " << s.toString();
  };
  const auto fine = [&](std::initializer_list<const char*> edits) { EXPECT_EQ(tell(edits).toString(), Status().toString()) << *edits.begin(); };
  // e^(c z) is a float up to c = 88; filtered linearly only up to 80, whatever the kernel. AUTO and LOGARITHMIC hold the rest.
  refused({"shadows.exponential.c=80.5", "shadows.exponential.filtering=LINEAR"}, "exponential.c", "80.5");
  fine({"shadows.exponential.c=80", "shadows.exponential.filtering=LINEAR"});
  fine({"shadows.exponential.c=2000"});
  fine({"shadows.exponential.c=2000", "shadows.exponential.filtering=AUTO"});
  fine({"shadows.exponential.c=2000", "shadows.exponential.filtering=LOGARITHMIC"});
  refused({"shadows.exponential.c=0.5"}, "exponential.c", "0.5");
  refused({"shadows.exponential.c=80", "shadows.map.lookup=SUMMED_AREA"}, "map.lookup", "SUMMED_AREA");
  refused({"shadows.convolution.bytes=true", "shadows.map.lookup=SUMMED_AREA"}, "convolution.bytes", "bytes");
  fine({"shadows.convolution.order=2", "shadows.map.lookup=SUMMED_AREA"});
  refused({"shadows.convolution.order=33"}, "convolution.order", "33");
  refused({"shadows.percentage_closer.taps=17"}, "percentage_closer.taps", "17");
  refused({"shadows.exponential_variance.c_positive=43"}, "exponential_variance.c_positive", "43");
  refused({"shadows.variance.min_variance=2"}, "variance.min_variance", "2");
  refused({"shadows.moment.moment_bias=0"}, "moment.moment_bias", "0");
  refused({"shadows.shadow_map=", "shadows.map.resolution=8193"}, "map.resolution", "8193");
  refused({"shadows.shadow_map=", "shadows.map.blur=65"}, "map.blur", "65");
  fine({"shadows.shadow_map=", "shadows.map.resolution=1"});
}

TEST(Engine, ARootIsTheOnlyDoorToFiles) {
  EngineOptions o;
  o.loader = inProcessLoader();
  o.roots = {"/usr/share"};
  const auto engine = *Engine::create(o);
  EXPECT_EQ(engine->openScene("/etc/passwd", "x").status().code(), Code::PermissionDenied);
  EXPECT_EQ(engine->openScene("/usr/share/../../etc/passwd", "x").status().code(), Code::PermissionDenied);
  EXPECT_EQ(engine->openScene("/usr/share/nothing.glb", "x").status().code(), Code::NotFound);
  v1::RenderRequest r = smallRequest("cornell");
  r.mutable_environment()->set_path("/etc/hostname");
  EXPECT_EQ(codeOf(*engine, r), Code::PermissionDenied);
}

TEST(Engine, ResolvedRequestIsCompleteAndReproduces) {
  const auto engine = makeEngine(), other = makeEngine(256ull << 20, {}, 1);
  const RenderResult a = mustRender(*engine, smallRequest("lights8"));
  EXPECT_TRUE(a.reply.resolved().integrator().has_russian_roulette_start());
  EXPECT_EQ(a.reply.resolved().halt().spp(), 4u);
  EXPECT_FALSE(a.reply.resolved().scene_hash().empty());
  const RenderResult b = mustRender(*other, a.reply.resolved());
  EXPECT_EQ(firstDifference(a, b), "") << "one thread and another engine";
  EXPECT_EQ(a.reply.request_hash(), b.reply.request_hash());
}

TEST(Engine, SceneHashGuardsAgainstAChangedScene) {
  const auto engine = makeEngine();
  const RenderResult a = mustRender(*engine, smallRequest("cornell"));
  v1::PatchSceneRequest p;
  p.set_scene("cornell");
  (*p.mutable_materials())[engine->inspectScene("cornell")->material_names(0)].mutable_base_color()->set_x(0.1f);
  ASSERT_TRUE(engine->patchScene(p).ok());
  EXPECT_EQ(codeOf(*engine, a.reply.resolved()), Code::FailedPrecondition);
}

TEST(Engine, RelightIsTheRememberedRequestWithTheMaskReplaced) {
  const auto engine = makeEngine();
  const RenderResult a = mustRender(*engine, smallRequest("cornell"));
  v1::RelightRequest relight;
  relight.set_render_id(a.reply.render_id());
  ASSERT_TRUE(setPath(*relight.mutable_patch(), "environment.constant=1,1,1").ok());
  relight.add_mask("environment");
  const auto request = engine->relightRequest(relight);
  ASSERT_TRUE(request.ok());
  EXPECT_TRUE(request->environment().has_constant());
  EXPECT_EQ(request->width(), 24u);
  relight.set_render_id("r0");
  EXPECT_EQ(engine->relightRequest(relight).status().code(), Code::NotFound);
  relight.set_render_id(a.reply.render_id());
  relight.add_mask("nothing.like.this");
  EXPECT_EQ(engine->relightRequest(relight).status().code(), Code::InvalidArgument);
}

TEST(Engine, TimeHaltGivesAReproducibleSampleCount) {
  const auto engine = makeEngine(), cold = makeEngine();
  v1::RenderRequest r = smallRequest("cornell");
  r.clear_halt();
  r.mutable_halt()->set_time_s(0.05);
  const RenderResult a = mustRender(*engine, r);
  EXPECT_GE(a.reply.resolved().halt().spp(), 1u);
  EXPECT_FALSE(a.reply.resolved().halt().has_time_s());
  EXPECT_EQ(firstDifference(a, mustRender(*cold, a.reply.resolved())), "");
}

TEST(Engine, ErrorHaltIsMeasuredByTheCertificate) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 40, 30);
  r.clear_halt();
  r.mutable_halt()->set_error(0.2);
  r.mutable_halt()->set_spp(4096);
  r.mutable_certificate()->set_pixel_fraction(0.3);
  const RenderResult a = mustRender(*engine, r);
  EXPECT_GT(a.reply.certificate().pixels(), 100u);
  if (a.reply.warnings_size() == 0) { EXPECT_LE(a.reply.certificate().rmse_high(), 0.2); }
}

/// What a request leaves out of the picture does not go away with samples: the render ends and says so.
TEST(Engine, ErrorHaltGivesUpWhereMoreSamplesDoNotHelp) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 24, 16);
  r.mutable_integrator()->set_max_bounces(0);
  r.clear_halt();
  r.mutable_halt()->set_error(0.02);
  const RenderResult a = mustRender(*engine, r);
  EXPECT_GT(a.reply.certificate().rmse_low(), 0.02);
  EXPECT_LE(a.reply.resolved().halt().spp(), 8192u);
  ASSERT_EQ(a.reply.warnings_size(), 1);
  EXPECT_NE(a.reply.warnings(0).find("no longer lower the error"), std::string::npos) << a.reply.warnings(0);
}

/// min_pixels is a floor under pixel_fraction; both are at most the picture.
TEST(Engine, CertificateLooksAtSomeThousandPixelsUnlessAskedForFewer) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("grids", 80, 64, 4);
  r.mutable_certificate()->set_spp(4);
  EXPECT_NEAR(mustRender(*engine, r).reply.certificate().pixels(), 4096, 1);
  r.mutable_certificate()->set_min_pixels(100);
  const auto few = mustRender(*engine, r).reply.certificate();
  EXPECT_NEAR(few.pixels(), 100, 1);
  EXPECT_LT(few.certain_pixels(), 100u);
  EXPECT_GT(few.unseen_area(), 0);
  EXPECT_LE(few.rmse_high_trimmed(), few.rmse_high());
  r.mutable_certificate()->set_pixel_fraction(1);
  const auto all = mustRender(*engine, r).reply.certificate();
  EXPECT_EQ(all.pixels(), 80u * 64u);
  EXPECT_EQ(all.certain_pixels(), 80u * 64u);
  EXPECT_EQ(all.unseen_area(), 0);
}

TEST(Engine, SnapshotsAreTheRendersOfTheirSampleCounts) {
  const auto engine = makeEngine(), cold = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 24, 16, 128);
  r.mutable_certificate();
  std::vector<RenderResult> snapshots;
  RenderControl control;
  control.snapshot = [&](const RenderResult& s) { snapshots.push_back(s); };
  const Result<RenderResult> last = engine->render(r, control);
  ASSERT_TRUE(last.ok());
  ASSERT_EQ(snapshots.size(), 3u);  // 16, 32, 64; then 128 is the reply
  for (const RenderResult& s : snapshots) {
    EXPECT_EQ(firstDifference(s, mustRender(*cold, s.reply.resolved())), "") << s.reply.resolved().halt().spp();
    EXPECT_FALSE(s.reply.has_certificate()) << "costs more than what is only looked at";
  }
  EXPECT_TRUE(last->reply.has_certificate());
  EXPECT_EQ(firstDifference(*last, mustRender(*cold, r)), "");
}

// What takes no samples is whole at once: somebody who looks on gets the reply that he gets otherwise, which says the samples that were asked for.
TEST(Engine, LookingOnChangesNothingOfWhatTakesNoSamples) {
  tests::SceneMaker m;
  m.instance(m.mesh(tests::ground(4.0f), m.material(Vec3(0.5f))));
  LightShape lamp;
  lamp.position = Vec3(0, 2, 0);
  m.light(lamp, Vec3(10.0f));
  m.camera(Vec3(0, 2, 4), Vec3(0.0f), 0.8f);
  const ScenePtr scene = m.finish();
  for (const bool certified : {false, true}) {
    v1::RenderRequest r = smallRequest("made", 24, 16, 128);
    if (certified) {
      for (const char* e : {"shadows.ray_traced.samples=1", "integrator.indirect=false", "certificate.spp=4", "certificate.min_pixels=50"}) set(r, e);
    } else {
      set(r, "outputs=depth");
    }
    RenderControl control;
    control.scene = scene;
    const Result<RenderResult> plain = makeEngine()->render(r, control);
    ASSERT_TRUE(plain.ok()) << plain.status().toString();
    for (const v1::NodeReport& row : plain->reply.plan()) EXPECT_EQ(row.samples(), 0u) << row.node();
    for (const bool ladder : {false, true}) {
      control.ladder = ladder;
      control.snapshot = [](const RenderResult&) { ADD_FAILURE() << "shown what is the reply"; };
      const Result<RenderResult> watched = makeEngine()->render(r, control);
      ASSERT_TRUE(watched.ok()) << watched.status().toString();
      EXPECT_EQ(watched->reply.resolved().halt().spp(), 128u) << ladder;
      EXPECT_EQ(watched->reply.has_certificate(), certified) << ladder;
      EXPECT_EQ(watched->reply.resolved().has_certificate(), certified) << ladder;
      EXPECT_EQ(watched->reply.request_hash(), plain->reply.request_hash()) << ladder;
      EXPECT_EQ(firstDifference(*watched, *plain), "") << ladder;
    }
    control.snapshot = nullptr;
  }
}

// A snapshot says nothing of the certificate that it does not have.
TEST(Engine, WarningsOfACertificateAreWhereItIs) {
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 32);
  for (const char* e : {"filters[0].gaussian.sigma_px=0.8", "certificate.spp=4", "certificate.min_pixels=20"}) set(r, e);
  const auto warned = [](const RenderResult& made) {
    const auto& all = made.reply.warnings();
    return std::any_of(all.begin(), all.end(), [](const std::string& w) { return w.starts_with("request.certificate: compares"); });
  };
  int shown = 0;
  RenderControl control;
  control.snapshot = [&](const RenderResult& s) {
    EXPECT_FALSE(warned(s));
    ++shown;
  };
  const Result<RenderResult> last = makeEngine()->render(r, control);
  ASSERT_TRUE(last.ok()) << last.status().toString();
  EXPECT_EQ(shown, 1);  // 16
  EXPECT_TRUE(warned(*last));
}

TEST(Engine, TheLadderBeginsSmallAndChangesNoBit) {
  const auto engine = makeEngine(), cold = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 320, 240, 4);
  r.mutable_certificate()->set_pixel_fraction(0.01);
  std::vector<RenderResult> snapshots;
  RenderControl control;
  control.ladder = true;
  control.snapshot = [&](const RenderResult& s) { snapshots.push_back(s); };
  const Result<RenderResult> last = engine->render(r, control);
  ASSERT_TRUE(last.ok()) << last.status().toString();
  ASSERT_GE(snapshots.size(), 2u);
  EXPECT_EQ(snapshots[0].images[0].width(), 80);
  EXPECT_EQ(snapshots[0].images[0].height(), 60);
  EXPECT_EQ(snapshots[1].images[0].width(), 320);
  EXPECT_EQ(snapshots[1].reply.resolved().halt().spp(), 1u);
  uint64_t rays = 0;
  for (const RenderResult& s : snapshots) {
    EXPECT_FALSE(s.reply.has_certificate()) << "of the reply alone";
    EXPECT_EQ(firstDifference(s, mustRender(*cold, s.reply.resolved())), "") << s.reply.resolved().width();
    if (s.images[0].width() == 320) rays += s.reply.rays();
  }
  EXPECT_TRUE(last->reply.has_certificate());
  const RenderResult alone = mustRender(*makeEngine(), r);
  EXPECT_EQ(firstDifference(*last, alone), "");
  EXPECT_EQ(rays + last->reply.rays(), alone.reply.rays()) << "traced twice";
  // Whom the small one is no help: small pictures, windows; nobody is shown anything who does not want it.
  for (const char* edit : {"width=64", "window.width=160", "scheduling.ladder=false"}) {
    v1::RenderRequest other = r;
    other.clear_certificate();
    ASSERT_TRUE(setPath(other, edit).ok());
    if (other.has_window()) other.mutable_window()->set_height(120);
    snapshots.clear();
    ASSERT_TRUE(engine->render(other, control).ok()) << edit;
    for (const RenderResult& s : snapshots) EXPECT_EQ(s.images[0].width(), other.has_window() ? 160 : int(other.width())) << edit;
    EXPECT_EQ(snapshots.empty(), other.scheduling().has_ladder()) << edit;
  }
}

TEST(Engine, TheSmallPictureDoesNotWaitForWhatIsPrecomputed) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("fence", 160, 120, 1);
  for (const char* e :
       {"environment.sky.turbidity=3", "environment.transfer.points=4000", "environment.transfer.samples=512", "environment.transfer.bounces=1"})
    ASSERT_TRUE(setPath(r, e).ok()) << e;
  std::vector<RenderResult> snapshots;
  RenderControl control;
  control.ladder = true;
  control.snapshot = [&](const RenderResult& s) { snapshots.push_back(s); };
  for (const bool warm : {false, true}) {
    snapshots.clear();
    ASSERT_TRUE(setPath(r, warm ? "camera.yfov_deg=40" : "camera.yfov_deg=41").ok());  // a picture that is not there yet
    const auto last = engine->render(r, control);
    ASSERT_TRUE(last.ok()) << last.status().toString();
    ASSERT_GE(snapshots.size(), 1u);
    EXPECT_EQ(snapshots[0].images[0].width(), 40);
    EXPECT_EQ(snapshots[0].reply.resolved().environment().has_transfer(), warm) << "once it is there it is used";
    EXPECT_TRUE(last->reply.resolved().environment().has_transfer());
    EXPECT_EQ(firstDifference(snapshots[0], mustRender(*makeEngine(), snapshots[0].reply.resolved())), "");
  }
}

/// Whatever a render showed before its end, and wherever that was: the bits of the same count by itself.
TEST(Engine, FewSamplesAreTheBeginningOfMany) {
  for (const char* technique : {"path_traced", "ray_traced", "axis_aligned"}) {
    const auto warm = makeEngine();
    v1::RenderRequest r = smallRequest("lights8", 21, 19, 1);  // of no group's size
    ASSERT_TRUE(setPath(r, std::string("shadows=") + technique).ok() || setPath(r, std::string("shadows.") + technique + "={}").ok()) << technique;
    for (const uint32_t spp : {1u, 2u, 4u, 8u, 16u, 32u, 48u}) {
      if (kInstrumented && spp > 8) break;
      r.mutable_halt()->set_spp(spp);
      EXPECT_EQ(firstDifference(mustRender(*warm, r), mustRender(*makeEngine(64ull << 20, {}, 1), r)), "") << technique << " " << spp;
    }
  }
}

TEST(Engine, SnapshotsSayTheirNoise) {
  // Scenes and counts were chosen before the first run.
  for (const char* scene : {"cornell", "lights8"}) {
    const auto engine = makeEngine();
    v1::RenderRequest r = smallRequest(scene, 32, 24, 1024);
    const RenderResult truth = mustRender(*engine, r);
    r.mutable_halt()->set_spp(64);
    r.set_seed(7);
    RenderControl control;
    control.ladder = true;
    int compared = 0;
    control.snapshot = [&](const RenderResult& s) {
      if (s.reply.resolved().halt().spp() < 32) return;  // which of the first ones are shown is a matter of time
      double sum = 0;
      const std::span<const float> a = s.images[0].pixels(), b = truth.images[0].pixels();
      for (size_t i = 0; i < a.size(); ++i) sum += (double(a[i]) - b[i]) * (double(a[i]) - b[i]);
      const double error = std::sqrt(sum / double(a.size()));
      EXPECT_GT(s.reply.standard_error(), 0.6 * error) << scene << " " << s.reply.resolved().halt().spp();
      EXPECT_LT(s.reply.standard_error(), 2.5 * error) << scene << " " << s.reply.resolved().halt().spp();
      ++compared;
    };
    ASSERT_TRUE(engine->render(r, control).ok());
    EXPECT_GT(compared, 0) << scene;
  }
  v1::RenderRequest depth = smallRequest("cornell", 32, 24, 16);
  depth.add_outputs("depth");
  EXPECT_EQ(mustRender(*makeEngine(), depth).reply.standard_error(), 0.0);
}

TEST(Engine, TimeThatIsUpDropsWhatIsNotDone) {
  // A picture that takes seconds a sample on any machine, after one that takes none: what was there when the time was up is the answer.
  const auto engine = makeEngine(), cold = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 480, 360, 65536);
  r.mutable_halt()->clear_spp();
  r.mutable_halt()->set_time_s(1e-6);
  const RenderResult first = mustRender(*engine, r);
  EXPECT_EQ(first.reply.resolved().halt().spp(), 1u);
  ASSERT_GE(first.reply.warnings_size(), 1);
  EXPECT_NE(first.reply.warnings(first.reply.warnings_size() - 1).find("request.halt.time_s"), std::string::npos);
  r.mutable_halt()->set_time_s(0.3);
  const RenderResult some = mustRender(*engine, r);
  EXPECT_FALSE(some.reply.resolved().halt().has_time_s());
  EXPECT_EQ(firstDifference(some, mustRender(*cold, some.reply.resolved())), "");
}

// The time that a request gives is not given anew to each run of it, and what an earlier one finished is where the next begins.
TEST(Engine, TimeIsOfAllRunsOfAPreemptedRender) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 32, 24, 16);
  mustRender(*engine, r);
  r.mutable_halt()->clear_spp();
  r.mutable_halt()->set_time_s(20);
  RunSoFar soFar{1e6, 16};
  RenderControl control;
  control.soFar = &soFar;
  const auto result = engine->render(r, control);
  ASSERT_TRUE(result.ok()) << result.status().toString();
  EXPECT_EQ(result->reply.resolved().halt().spp(), 16u);
  EXPECT_EQ(result->reply.rays(), 0u);
  for (const std::string& warning : result->reply.warnings()) EXPECT_EQ(warning.find("time_s"), std::string::npos) << warning;
  EXPECT_GT(soFar.ms, 1e6);
  EXPECT_LT(soFar.ms, 1e6 + 15e3);
  EXPECT_EQ(soFar.spp, 16u);
}

TEST(Engine, PreemptedWorkGoesOnWhereItStopped) {
  const auto engine = makeEngine(), cold = makeEngine();
  v1::RenderRequest r = smallRequest("lights8", 96, 64, asLong(256));
  StopSource source;
  RenderControl control;
  control.stop = source.token();
  int interruptions = 0, attempt = 0;
  // While paths are traced, however long what comes before takes.
  control.progress = [&](const v1::Progress& p) {
    if (attempt < 3 && p.stage() == "path_trace") source.stop(StopReason::Preempted);
  };
  const auto parked = [&]() -> uint64_t {
    for (const auto& holder : engine->memory().holders())
      if (holder->name == "stopped renders") return holder->bytes();
    return UINT64_MAX;
  };
  Result<RenderResult> result = internalError("not run");
  for (; attempt < 40; ++attempt) {
    source.reset();
    result = engine->render(r, control);
    if (result.ok()) break;
    ASSERT_EQ(result.status().code(), Code::Aborted) << result.status().toString();
    ++interruptions;
    EXPECT_GT(parked(), 96u * 64 * 4) << "in the ledger";
  }
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(parked(), 0u);
  EXPECT_GT(interruptions, 0);
  EXPECT_EQ(nodesBy(*result, v1::NodeReport::RUN).at("path_trace").reason(), "resumed");
  EXPECT_EQ(firstDifference(*result, mustRender(*cold, r)), "");
}

// Before the scene is there too: a render that gives way while it loads must not be taken for one that somebody cancelled.
TEST(Engine, WorkThatIsStoppedSaysWhyWhereverItIs) {
  for (const bool loaded : {false, true})
    for (const auto& [reason, code] : {std::pair(StopReason::Cancelled, Code::Cancelled), std::pair(StopReason::Preempted, Code::Aborted),
                                       std::pair(StopReason::Deadline, Code::DeadlineExceeded)}) {
      const auto engine = makeEngine();
      if (loaded) { ASSERT_TRUE(engine->openScene("cornell", "cornell").ok()); }
      StopSource source;
      source.stop(reason);
      RenderControl control;
      control.stop = source.token();
      EXPECT_EQ(engine->render(smallRequest("cornell"), control).status().code(), code) << loaded << " " << int(reason);
    }
}

TEST(Engine, PrunedNodesAreListedWithTheirReason) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell");
  set(r, "integrator.indirect=false");
  const RenderResult a = mustRender(*engine, r);
  const auto pruned = nodesBy(a, v1::NodeReport::PRUNED);
  ASSERT_TRUE(pruned.count("indirect"));
  EXPECT_TRUE(pruned.at("indirect").approximate());
  EXPECT_GT(a.reply.path_classes_missing_size(), 0);
}

TEST(Engine, CertificateNamesWhatItCannotCover) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("spheres", 32, 24, 16);
  for (const char* e : {"lights.p.kind=POINT", "lights.p.position=0,4,0", "lights.p.intensity=10"}) set(r, e);
  r.mutable_certificate();
  r.mutable_certificate()->set_min_pixels(200);
  EXPECT_EQ(mustRender(*engine, r).reply.certificate().not_covered_size(), 0) << "photons are traced for caustics";
  RenderControl control;
  auto smooth = std::make_shared<Scene>(**mediaScene());
  for (Material& m : smooth->materials)
    if (m.bsdf.transmission > 0) m.bsdf.roughness = 0;
  ASSERT_TRUE(smooth->seal().ok());
  control.scene = smooth;
  const RenderResult a = *engine->render(r, control);
  EXPECT_GE(a.reply.certificate().not_covered_size(), 1) << "but not inside scattering volumes";
  EXPECT_GT(a.reply.certificate().unseen_area(), 0);
  EXPECT_LE(a.reply.certificate().rmse_low(), a.reply.certificate().rmse());
  EXPECT_GE(a.reply.certificate().rmse_high(), a.reply.certificate().rmse());
}

}  // namespace
}  // namespace gobo::testing
