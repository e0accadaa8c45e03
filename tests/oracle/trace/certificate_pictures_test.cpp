// SPDX-License-Identifier: Apache-2.0
// Certificates of rendered pictures against their measured error: that intervals hold it, that a bound asked for is kept, and
// that a certificate with a wrong reference (the picture's own samples, a part used twice, bounces or caustics left out) is
// caught by that comparison. bench/certificate_bench --real is the same on more scenes and pictures.
#include <gtest/gtest.h>

#include <optional>

#include "support/certificate_tries.h"
#include "support/engines.h"
#include "support/thorough.h"

namespace gobo::testing {
namespace {

/// One picture with everything that certifying it again needs.
struct Certified {
  std::unique_ptr<Engine> engine = makeEngine();
  TaskArena arena{2};
  AccelCache accels;
  v1::RenderRequest request;
  EffectiveScene effective;
  Image image;
  TriedReference reference;
  MeasuredError error;

  /// `close`: the picture is nearer to the truth than the latter is known. `known`: the truth of another picture of the same view.
  Certified(const ScenePtr& scene, const std::string& name, int size, int spp, const std::vector<std::string>& assignments, int truthSpp, bool close = false,
            const TriedReference* known = nullptr) {
    request = triedPicture(name, size, spp, assignments).request;
    RenderControl control;
    control.scene = scene;
    const Result<RenderResult> r = engine->render(request, control);
    GOBO_CHECK(r.ok());
    image = r->images[0].image();
    request = r->reply.resolved();
    request.mutable_certificate();
    GOBO_CHECK(resolveDefaults(request).ok());
    effective = *makeEffectiveScene(scene, request, {});
    reference = known ? *known : traceReference(scene, request, 0, truthSpp, accels, arena);
    error = measureError(image, reference);
    if (!close) { EXPECT_LT(error.standardError, 0.1 * error.mse) << "the truth is too noisy to tell"; }
  }
  ReferenceRecipe recipe() const { return referenceRecipe(effective, request); }
  v1::Certificate certify(const ReferenceRecipe& recipe) { return *certifyAgainst(recipe, image, effective, request, accels, arena, {}); }
  v1::Certificate certify() { return *certifyPicture(image, effective, request, accels, arena, {}); }
};

ScenePtr builtinScene(const std::string& name) { return *makeEngine()->loadScene(name, true); }

::testing::AssertionResult holds(const v1::Certificate& c, double rmse) {
  if (c.rmse_low() <= rmse && rmse <= c.rmse_high()) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << "measured " << rmse << ", certified " << c.rmse_low() << " .. " << c.rmse() << " .. " << c.rmse_high();
}

/// Scenes that the method was not tuned on, chosen before their results were seen. All seeds are fixed.
TEST(CertificatePictures, IntervalsHoldTheMeasuredErrorAndBoundsAreKept) {
  Tally all;
  Halts halts;
  const int certificates = 8, size = 40;
  const uint32_t pixels = 400;
  for (const std::string name : {"grids", "lights8"}) {
    const auto engine = makeEngine();
    TaskArena arena(2);
    AccelCache accels;
    const ScenePtr scene = *openTried(*engine, name, "");
    const std::vector<TriedPicture> pictures = triedPictures(*scene, size);
    const TriedReference reference = traceReference(scene, pictures[0].request, certificates, thoroughOr(512, 256), accels, arena);
    std::vector<Image> doublings;
    std::vector<MeasuredError> errors;
    const auto render = [&](const v1::RenderRequest& request) {
      RenderControl control;
      control.scene = scene;
      return engine->render(request, control)->images[0].image();
    };
    for (size_t i : {0, 2, 4, 7}) {
      const Image image = render(pictures[i].request);
      const MeasuredError error = measureError(image, reference);
      EXPECT_LT(error.standardError, thoroughOr(0.2, 0.2 * std::sqrt(2.0)) * error.mse) << name << ", " << pictures[i].name;  // noise of half the samples
      Tally tally;
      for (int k = 0; k < certificates; ++k) tally.add(tryCertificate(image, reference, k, pixels), error.rmse());
      EXPECT_GE(tally.held, certificates - 2) << name << ", " << pictures[i].name << ": low above " << tally.above << ", high below " << tally.below;
      all.add(tally);
    }
    for (int spp = 16; spp <= 256; spp *= 2) {
      doublings.push_back(render(triedPicture(name, size, spp, {}).request));
      errors.push_back(measureError(doublings.back(), reference));
    }
    for (const double factor : {0.7, 1.0, 1.6}) {
      const Halts h = tryHalts(doublings, errors, reference, certificates, factor * errors[2].rmse(), pixels);
      halts.stopped += h.stopped, halts.kept += h.kept;
    }
  }
  EXPECT_GE(all.share(), 0.93);
  EXPECT_LT(all.halfWidth(), 0.5);
  EXPECT_GE(halts.stopped, 16);
  EXPECT_GE(halts.kept, 0.95 * halts.stopped) << halts.kept << " of " << halts.stopped;
}

/// Whatever the request leaves out of the picture is an error of it.
TEST(CertificatePictures, TruthIsFullTransportWhateverTheRequestLeavesOut) {
  const ScenePtr scene = builtinScene("cornell");
  std::vector<double> rmse;
  std::optional<TriedReference> truth;  // one for all: whatever is left out
  for (const char* left : {"integrator.max_bounces=0", "integrator.max_bounces=1", "integrator.indirect=false"}) {
    Certified c(scene, "cornell", 32, 64, {left}, 512, false, truth ? &*truth : nullptr);
    if (!truth) truth = c.reference;
    const v1::Certificate certificate = c.certify();
    EXPECT_TRUE(holds(certificate, c.error.rmse())) << left;
    rmse.push_back(certificate.rmse());
    EXPECT_EQ(c.recipe().maxBounces, 64) << left;
  }
  EXPECT_GT(rmse[0], 1.2 * rmse[1]);
  EXPECT_NEAR(rmse[0], rmse[2], 0.05 * rmse[0]) << "the same picture, asked for in two ways";
  // The guard of this test: a reference with the picture's own limit calls it exact but for noise.
  Certified c(scene, "cornell", 32, 256, {"integrator.max_bounces=0"}, 512, false, &*truth);
  ReferenceRecipe wrong = c.recipe();
  wrong.maxBounces = 0;
  EXPECT_TRUE(holds(c.certify(), c.error.rmse()));
  EXPECT_LT(c.certify(wrong).rmse_high(), 0.8 * c.error.rmse());
}

TEST(CertificateMutations, ThePicturesOwnSamplesAsReferenceAreNoticed) {
  Certified c(builtinScene("grids"), "grids", 48, 16, {}, thoroughOr(512, 128));
  EXPECT_TRUE(holds(c.certify(), c.error.rmse()));
  EXPECT_NE(c.recipe().seed, c.request.seed());
  ReferenceRecipe own = c.recipe();
  own.seed = c.request.seed();
  EXPECT_LT(c.certify(own).rmse_high(), c.error.rmse()) << "one of four parts is the picture: optimistic";
}

TEST(CertificateMutations, APartUsedTwiceIsNoticed) {
  Certified c(builtinScene("grids"), "grids", 48, 256, {}, 1024);
  EXPECT_TRUE(holds(c.certify(), c.error.rmse()));
  for (const std::array<uint32_t, kParts> streams : {std::array<uint32_t, kParts>{0, 0, 1, 1}, {0, 1, 2, 2}}) {
    ReferenceRecipe twice = c.recipe();
    twice.streams = streams;
    EXPECT_GT(c.certify(twice).rmse_low(), c.error.rmse()) << "the reference's noise counts as the picture's error";
  }
}

/// A glass ball between a point light and a floor: all light below it comes as a caustic.
ScenePtr ballScene() {
  builtin::SceneBuilder b("ball");
  const int floor = b.material("floor", Vec3(0.7f)), clear = b.material("clear", Vec3(1.0f), 0.0f, 0.0f, 1.0f);
  b.at(clear).bsdf.transmission = 1.0f, b.at(clear).bsdf.thickness = 1.0f;
  builtin::MeshBuilder ground, ball;
  ground.quad(Vec3(-2, 0, 2), Vec3(4, 0, 0), Vec3(0, 0, -4));
  ball.sphere(Vec3(0, 0.8f, 0), 0.5f, 48, 24);
  b.add("ground", ground, floor, false);
  b.add("ball", ball, clear);
  b.point("lamp", Vec3(0.6f, 3.0f, 0.3f), Vec3(20.0f));
  b.camera("front", Vec3(0, 2.2f, 3.0f), Vec3(0, 0.2f, 0), 45.0f);
  return *b.finish();
}

TEST(CertificateMutations, AReferenceWithoutCausticsIsNoticed) {
  Certified without(ballScene(), "ball", 24, 32, {"integrator.caustic_radius=0.01"}, 64);
  EXPECT_GT(without.recipe().photons, 0u) << "the scene has caustics, whether or not the request asks for them";
  EXPECT_TRUE(holds(without.certify(), without.error.rmse()));
  ReferenceRecipe blind = without.recipe();
  blind.photons = 0;
  EXPECT_LT(without.certify(blind).rmse_high(), 0.5 * without.error.rmse()) << "what neither has is no error";

  Certified with(ballScene(), "ball", 24, 32, {"integrator.caustic_radius=0.01", "integrator.caustic_photons=65536"}, 64, true);
  const double most = std::sqrt(std::max(with.error.mse, 0.0) + 3 * with.error.standardError);  // nearly exact: the truth cannot tell how nearly
  EXPECT_LT(most, 0.5 * without.error.rmse());
  EXPECT_LT(with.certify().rmse_low(), most);
  EXPECT_GT(with.certify(blind).rmse_low(), most) << "what the picture has is no error";
}

}  // namespace
}  // namespace gobo::testing
