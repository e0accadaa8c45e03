// SPDX-License-Identifier: Apache-2.0
// request.denoise, whatever the filter: what it traces, what it leaves alone, what it takes out. Filters are drawn from the schema's choice.
#include <gtest/gtest.h>

#include <cmath>

#include "support/engines.h"
#include "support/thorough.h"
#include "trace/sample_passes.h"

namespace gobo {
namespace denoise_test {

using testing::firstDifference;
using testing::makeEngine;
using testing::mustRender;
using testing::nodesBy;
using testing::set;
using testing::smallRequest;

std::vector<std::string> filters() {
  std::vector<std::string> names;
  const auto* d = v1::Denoise::descriptor();
  for (int i = 0; i < d->field_count(); ++i)
    if (d->field(i)->real_containing_oneof()) names.push_back(d->field(i)->name());
  return names;
}

const Image& beauty(const RenderResult& r) { return r.images.at(0).image(); }

double rmse(const Image& a, const Image& b) {
  double sum = 0;
  for (size_t i = 0; i < a.data.size(); ++i) sum += (double(a.data[i]) - b.data[i]) * (double(a.data[i]) - b.data[i]);
  return std::sqrt(sum / double(a.data.size()));
}

/// Root of the mean relative squared error: absolute errors are mostly those of the brightest pixels, along lamps.
double relative(const Image& a, const Image& truth) {
  double sum = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    const double d = double(a.data[i]) - truth.data[i];
    sum += d * d / (double(truth.data[i]) * truth.data[i] + 1e-2);
  }
  return std::sqrt(sum / double(a.data.size()));
}

uint64_t pathRays(const RenderResult& r) {
  uint64_t rays = 0;
  for (const auto& [label, row] : nodesBy(r, v1::NodeReport::RUN)) rays += label == "gbuffer" ? 0 : row.rays();
  return rays;
}

// A filter of no width gives back the mean of both halves, whatever their counts: the picture itself.
TEST(Denoise, HalvesMakeUpThePicture) {
  for (const char* scene : {"cornell", "lights8", "spheres"})
    for (const int spp : {1, 2, 8, 16, 48}) {
      const auto engine = makeEngine();
      v1::RenderRequest r = smallRequest(scene, 24, 16, spp);
      const RenderResult plain = mustRender(*engine, r);
      set(r, "denoise.joint_bilateral.radius_px=0");
      const RenderResult same = mustRender(*engine, r);
      ASSERT_EQ(beauty(plain).data.size(), beauty(same).data.size());
      for (size_t i = 0; i < beauty(plain).data.size(); ++i)
        ASSERT_NEAR(beauty(plain).data[i], beauty(same).data[i], 1e-4f * (std::abs(beauty(plain).data[i]) + 1e-3f)) << scene << " " << spp << " at " << i;
    }
}

// The first half is traced first and the whole goes on from it, so that a picture without noise takes the rays of one with it.
TEST(Denoise, TracesNoSampleMore) {
  for (const int spp : {1, 2, 16, 48}) {
    v1::RenderRequest r = smallRequest("lights8", 24, 16, spp);
    for (const char* o : {"beauty", "direct", "indirect"}) r.add_outputs(o);  // the split that denoising needs
    const uint64_t plain = pathRays(mustRender(*makeEngine(), r));
    set(r, "denoise.joint_bilateral.radius_px=3");
    EXPECT_EQ(pathRays(mustRender(*makeEngine(), r)), plain) << spp;
  }
}

TEST(Denoise, EveryFilterTakesNoiseOut) {
  for (const char* scene : {"cornell", "spheres"}) {
    const auto engine = makeEngine();
    v1::RenderRequest r = smallRequest(scene, 80, 60, testing::thoroughOr(512, 256));  // at most an eighth of the noise of 4
    const RenderResult truth = mustRender(*engine, r);
    r.mutable_halt()->set_spp(4);
    const double plain = relative(beauty(mustRender(*engine, r)), beauty(truth));
    double best = plain;
    std::map<std::string, double> errors;
    for (const std::string& filter : filters()) {
      r.mutable_denoise()->Clear();
      set(r, "denoise=" + filter);
      errors[filter] = relative(beauty(mustRender(*engine, r)), beauty(truth));
      EXPECT_LT(errors[filter], plain) << scene << " " << filter;
      if (filter != "auto" && filter != "axis_aligned") best = std::min(best, errors[filter]);
    }
    EXPECT_LT(errors["auto"], 1.2 * best) << scene;  // what it picks from, and not by much worse
    EXPECT_LT(errors["auto"], 0.7 * plain) << scene;
  }
}

// Light that techniques bring, and lamps that the camera sees, pass as they are.
TEST(Denoise, LeavesAloneWhatIsNotPathTraced) {
  for (const std::string& filter : filters()) {
    const auto engine = makeEngine();
    v1::RenderRequest r = smallRequest("cornell", 24, 16, 4);
    for (const char* e : {"integrator.indirect=false", "shadows.ray_traced.samples=2", "outputs=beauty"}) set(r, e);
    r.add_outputs("emission");
    const RenderResult plain = mustRender(*engine, r);
    set(r, "denoise=" + filter);
    EXPECT_EQ(firstDifference(plain, mustRender(*engine, r)), "") << filter;
  }
}

// Indirect light alone, each lobe by itself; what is direct keeps its noise to the bit, and no sample is traced more than for telling them apart.
TEST(Denoise, AxisAlignedFiltersIndirectLightByLobe) {
  for (const char* scene : {"spheres", "cornell"}) {
    v1::RenderRequest r = smallRequest(scene, 64, 48, testing::thoroughOr(1024, 512));
    for (const char* o : {"beauty", "direct", "emission", "indirect", "indirect_diffuse", "indirect_specular"}) r.add_outputs(o);
    const auto engine = makeEngine();
    const RenderResult truth = mustRender(*engine, r);
    r.mutable_halt()->set_spp(16);
    const RenderResult plain = mustRender(*makeEngine(), r);
    set(r, "denoise.axis_aligned.direct=NONE");
    const RenderResult smooth = mustRender(*makeEngine(), r);
    EXPECT_EQ(pathRays(smooth), pathRays(plain)) << scene;
    const auto error = [&](const RenderResult& of, size_t k) { return relative(of.images[k].image(), truth.images[k].image()); };
    EXPECT_EQ(plain.images[1].image().data, smooth.images[1].image().data) << scene;
    EXPECT_EQ(plain.images[2].image().data, smooth.images[2].image().data) << scene;
    EXPECT_LT(error(smooth, 3), 0.7 * error(plain, 3)) << scene;
    EXPECT_LT(error(smooth, 4), 0.5 * error(plain, 4)) << scene;
    const auto by = nodesBy(smooth, v1::NodeReport::RUN);
    EXPECT_TRUE(by.count("beauty:diffuse by axis_aligned"));
    const bool glossy = std::string(scene) == "spheres";  // no surface of cornell has a specular lobe
    EXPECT_EQ(by.count("beauty:specular by axis_aligned"), glossy ? 1u : 0u);
    EXPECT_LE(error(smooth, 5), 0.9 * error(plain, 5));  // cornell: 0
    // Parts are whole: the outputs add up.
    const auto &all = smooth.images[3].image().data, &diffuse = smooth.images[4].image().data, &specular = smooth.images[5].image().data;
    for (size_t i = 0; i < all.size(); ++i) ASSERT_NEAR(all[i], diffuse[i] + specular[i], 1e-4f * (1 + std::abs(all[i])));
  }
}

// Path-traced direct light beside axis-aligned filtering: less noise where there is some, the sampled bits' own error where there is none to speak of.
TEST(Denoise, AxisAlignedHasAFilterForDirectLightBesideIt) {
  for (const char* scene : {"lights8", "cornell"}) {
    v1::RenderRequest r = smallRequest(scene, 48, 36, testing::thoroughOr(512, 256));
    for (const char* o : {"beauty", "direct", "emission", "indirect"}) r.add_outputs(o);
    const RenderResult truth = mustRender(*makeEngine(), r);
    r.mutable_halt()->set_spp(4);
    const RenderResult plain = mustRender(*makeEngine(), r);
    set(r, "denoise.axis_aligned.direct=NONE");
    const RenderResult without = mustRender(*makeEngine(), r);
    set(r, "denoise.axis_aligned.direct=AUTOMATIC");
    const RenderResult smooth = mustRender(*makeEngine(), r);
    EXPECT_EQ(pathRays(smooth), pathRays(plain)) << scene;
    const auto error = [&](const RenderResult& of, size_t k) { return relative(of.images[k].image(), truth.images[k].image()); };
    EXPECT_LT(relative(plain.images[1].image(), without.images[1].image()), 1e-6) << scene;  // summed by lobe
    EXPECT_LT(error(smooth, 1), (scene[0] == 'l' ? 0.7 : 1.02) * error(plain, 1)) << scene;
    EXPECT_EQ(plain.images[2].image().data, smooth.images[2].image().data) << scene;    // lamps
    EXPECT_EQ(without.images[3].image().data, smooth.images[3].image().data) << scene;  // indirect light by itself
    EXPECT_LE(error(smooth, 0), 1.01 * error(without, 0)) << scene;
    for (size_t i = 0; i < truth.images[0].image().data.size(); ++i) {
      const float whole = smooth.images[0].image().data[i];
      ASSERT_NEAR(whole, smooth.images[1].image().data[i] + smooth.images[2].image().data[i] + smooth.images[3].image().data[i], 1e-3f * (1 + std::abs(whole)));
    }
  }
  // Light of a shadow technique has no noise that it knows of; a window of no width changes nothing.
  v1::RenderRequest r = smallRequest("lights8", 40, 30, 4);
  set(r, "outputs=direct");
  set(r, "shadows.ray_traced.samples=1");
  const RenderResult plain = mustRender(*makeEngine(), r);
  set(r, "denoise=axis_aligned");
  EXPECT_EQ(plain.images[0].image().data, mustRender(*makeEngine(), r).images[0].image().data);
  v1::RenderRequest closed = smallRequest("lights8", 40, 30, 4);
  const RenderResult noisy = mustRender(*makeEngine(), closed);
  set(closed, "denoise.axis_aligned.radius_px=0");
  const RenderResult same = mustRender(*makeEngine(), closed);
  for (size_t i = 0; i < noisy.images[0].image().data.size(); ++i)
    ASSERT_NEAR(noisy.images[0].image().data[i], same.images[0].image().data[i], 1e-4f * (1 + std::abs(noisy.images[0].image().data[i])));
}

TEST(Denoise, EveryOutputOfLightIsDenoised) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 24, 16, 4);
  for (const char* o : {"beauty", "emission", "direct", "indirect", "diffuse", "group:light", "albedo"}) r.add_outputs(o);
  const RenderResult plain = mustRender(*engine, r);
  set(r, "denoise.joint_bilateral.radius_px=4");
  const RenderResult smooth = mustRender(*engine, r);
  for (size_t i = 0; i < plain.images.size(); ++i) {
    const bool noisy = plain.images[i].output != "albedo" && plain.images[i].output != "emission";
    EXPECT_EQ(plain.images[i].image().data != smooth.images[i].image().data, noisy) << plain.images[i].output;
  }
}

// Rungs of a progressive render are denoised; the last one is the unary picture, bit for bit.
TEST(Denoise, TheLadderEndsWithTheSameBits) {
  v1::RenderRequest r = smallRequest("cornell", 24, 16, 32);
  for (const std::string& filter : filters()) {
    r.mutable_denoise()->Clear();
    set(r, "denoise=" + filter);
    const RenderResult whole = mustRender(*makeEngine(), r);
    const auto engine = makeEngine();
    for (const int spp : {1, 2, 8, 16}) {
      v1::RenderRequest rung = r;
      rung.mutable_halt()->set_spp(spp);
      mustRender(*engine, rung);
    }
    EXPECT_EQ(firstDifference(whole, mustRender(*engine, r)), "") << filter;
  }
}

TEST(Denoise, ThreadsChangeNoBit) {
  for (const std::string& filter : filters()) {
    v1::RenderRequest r = smallRequest("lights8", 40, 30, 4);
    set(r, "denoise=" + filter);
    EXPECT_EQ(firstDifference(mustRender(*makeEngine(256ull << 20, {}, 1), r), mustRender(*makeEngine(256ull << 20, {}, 3), r)), "") << filter;
  }
}

// An empty choice is the automatic one, and the reply says so.
TEST(Denoise, OfNothingIsAutomatic) {
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 4);
  r.mutable_denoise();
  const RenderResult reply = mustRender(*makeEngine(), r);
  EXPECT_TRUE(reply.reply.resolved().denoise().has_auto_());
  bool said = false;
  for (const auto& row : reply.reply.plan()) said = said || (row.approximate() && row.reason().find("noise") != std::string::npos);
  EXPECT_TRUE(said);
}

// The automatic choice looks at how light bends where the sums for it fit, by the size of the whole picture, and does without for samples that outliers were
// taken from.
TEST(Denoise, AutomaticDoesWithoutBendingWhereItWouldNotFit) {
  const auto engine = makeEngine();
  const auto holds = [&](const v1::RenderRequest& r, const char* label) {
    const auto planned = engine->plan(r);
    EXPECT_TRUE(planned.ok()) << planned.status().toString();
    bool found = false;
    if (planned.ok())
      for (const auto& row : planned->plan()) found = found || row.node().find(label) != std::string::npos;
    return found;
  };
  const auto bends = [&](const v1::RenderRequest& r) { return holds(r, ":diffuse by axis_aligned"); };
  v1::RenderRequest r = smallRequest("cornell", 2000, 2000, 4);  // one group: 252 bytes a pixel, 0.94 GiB
  set(r, "denoise=auto");
  EXPECT_TRUE(bends(r));
  r.set_width(2400);
  EXPECT_FALSE(bends(r));
  set(r, "window.width=64");
  set(r, "window.height=64");
  EXPECT_FALSE(bends(r));
  set(r, "denoise=axis_aligned");
  EXPECT_TRUE(bends(r));
  r = smallRequest("cornell", 64, 64, 4);
  set(r, "denoise=auto");
  EXPECT_TRUE(bends(r));
  set(r, "denoise.outliers=reweighting");
  EXPECT_FALSE(bends(r));
  EXPECT_TRUE(holds(r, "beauty by first_order"));  // as one kind of light, indirect light among it
}

// Through a lens there is one more choice, for direct light, where halves judge it; through a pinhole everything is as it was.
TEST(Denoise, AutomaticChoosesByTheLensForDirectLight) {
  const auto engine = makeEngine();
  const auto has = [&](v1::RenderRequest r, const std::string& label) {
    set(r, "denoise=auto");
    const RenderResult result = mustRender(*engine, r);
    for (const auto& n : result.reply.plan())
      if (n.node() == label) return true;
    return false;
  };
  v1::RenderRequest sharp = smallRequest("cornell", 24, 18, 4), open = sharp;
  for (const char* e : {"camera.lens_radius=0.2", "camera.focus_distance=2"}) set(open, e);
  EXPECT_TRUE(has(open, "beauty direct by lens"));
  EXPECT_TRUE(has(open, "features through the lens"));
  EXPECT_FALSE(has(open, "beauty:diffuse by lens"));
  EXPECT_FALSE(has(sharp, "beauty direct by lens"));
  EXPECT_FALSE(has(sharp, "features through the lens"));
  open.mutable_halt()->set_spp(1);
  EXPECT_FALSE(has(open, "beauty direct by lens"));
}

// The certificate is of the picture that is shown.
TEST(Denoise, CertificatesAreOfTheDenoisedPicture) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 48, 36, 2048);
  for (const char* e : {"integrator.max_bounces=16", "seed=5"}) set(r, e);
  const RenderResult truth = mustRender(*engine, r);
  r.mutable_halt()->set_spp(16);
  for (const char* e : {"certificate.pixel_fraction=1", "certificate.spp=256", "denoise=joint_bilateral", "seed=0"}) set(r, e);
  const RenderResult smooth = mustRender(*engine, r);
  const double error = rmse(beauty(smooth), beauty(truth));
  EXPECT_NEAR(smooth.reply.certificate().rmse(), error, 0.1 * error);
  r.clear_denoise();
  EXPECT_GT(std::abs(mustRender(*engine, r).reply.certificate().rmse() - error), 0.2 * error);
}

TEST(Denoise, MistakesAreNamed) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell");
  r.mutable_denoise()->mutable_non_local_means()->set_radius_px(99);
  const auto far = engine->render(r);
  ASSERT_FALSE(far.ok());
  EXPECT_NE(far.status().toString().find("denoise.non_local_means.radius_px = 99"), std::string::npos) << far.status().toString();
  r.clear_denoise();
  EXPECT_FALSE(setPath(r, "denoise=medain").ok());
}

}  // namespace denoise_test
}  // namespace gobo
