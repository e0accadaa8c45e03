// SPDX-License-Identifier: Apache-2.0
// Outputs through the engine: parts add up to their wholes, variance is the variance, and what is not asked for costs nothing.
#include <gtest/gtest.h>

#include <cmath>

#include "support/engines.h"

namespace gobo::testing {
namespace {

void ask(v1::RenderRequest& r, std::initializer_list<const char*> outputs) {
  r.clear_outputs();
  for (const char* o : outputs) r.add_outputs(o);
}

std::map<std::string, Image> pictures(const RenderResult& r) {
  std::map<std::string, Image> out;
  for (const RenderedImage& i : r.images) out[i.output] = i.image();
  return out;
}

const std::initializer_list<const char*> kParts = {"beauty", "emission", "direct", "indirect", "diffuse", "specular",
                                                  "direct_diffuse", "direct_specular", "indirect_diffuse", "indirect_specular"};

void expectSums(const RenderResult& result, const std::string& what) {
  auto p = pictures(result);
  ASSERT_EQ(p.size(), kParts.size()) << what;
  double diffuse = 0, specular = 0;
  for (size_t i = 0; i < p["beauty"].data.size(); ++i) {
    const auto v = [&](const char* name) { return double(p[name].data[i]); };
    const double rounding = 2e-6 * (1e-3 + std::fabs(v("beauty")));
    ASSERT_NEAR(v("emission") + v("direct") + v("indirect"), v("beauty"), rounding) << what << " " << i;
    ASSERT_NEAR(v("diffuse") + v("specular"), v("beauty") - v("emission"), rounding) << what << " " << i;
    ASSERT_NEAR(v("direct_diffuse") + v("direct_specular"), v("direct"), rounding) << what << " " << i;
    ASSERT_NEAR(v("indirect_diffuse") + v("indirect_specular"), v("indirect"), rounding) << what << " " << i;
    ASSERT_NEAR(v("direct_diffuse") + v("indirect_diffuse"), v("diffuse"), rounding) << what << " " << i;
    diffuse += v("diffuse");
    specular += v("specular");
  }
  EXPECT_GT(diffuse, 0.0) << what;
  EXPECT_GT(specular, 0.0) << what << ": without gloss the sums say nothing";
}

TEST(Outputs, PartsAddUpWhenAllIsPathTraced) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("spheres", 24, 16, 16);
  set(r, "environment.constant=0.3,0.4,0.5");
  ask(r, kParts);
  expectSums(mustRender(*engine, r), "spheres");
  set(r, "integrator.indirect=false");
  expectSums(mustRender(*engine, r), "direct only");
}

TEST(Outputs, PartsAddUpWithVisibilityTechniquesGainsAndClusters) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("spheres", 24, 16, 16);
  for (const char* e : {"lights.key.kind=RECT", "lights.key.position=0.5,3,1", "lights.key.direction=0,-1,-0.2", "lights.key.width=0.5", "lights.key.height=0.5",
                        "lights.key.intensity=9", "lights.key.shadow.axis_aligned.k=3", "lights.p.kind=POINT", "lights.p.position=-1,2,2", "lights.p.intensity=5",
                        "lights.p.shadow.ray_traced.samples=1", "lights.p.gain=1,0.5,0.2", "environment.sky.turbidity=3"})
    set(r, e);
  ask(r, kParts);
  expectSums(mustRender(*engine, r), "techniques");
  set(r, "integrator.max_groups=1");
  expectSums(mustRender(*engine, r), "one cluster");
  set(r, "integrator.max_groups=16");
  set(r, "environment.extract_lights=3");
  expectSums(mustRender(*engine, r), "extracted environment");
}

// Pixels' variance against the scatter of the beauty over independent seeds. Both are sums over the picture; the error of the first
// comes from its own scatter over seeds, that of the second from the pixels (neighbours are independent).
TEST(Outputs, VarianceIsTheVarianceOverSeeds) {
  for (const int spp : {128, 256}) {
    const auto engine = makeEngine();
    const int seeds = 32;
    v1::RenderRequest r = smallRequest("cornell", 16, 12, spp);
    ask(r, {"beauty", "variance"});
    std::vector<double> sum, squares, estimates;
    for (int s = 0; s < seeds; ++s) {
      r.set_seed(uint64_t(1000 + s));
      auto p = pictures(mustRender(*engine, r));
      const Image &beauty = p["beauty"], &variance = p["variance"];
      sum.resize(beauty.data.size());
      squares.resize(beauty.data.size());
      double total = 0;
      for (size_t i = 0; i < beauty.data.size(); ++i) {
        ASSERT_GE(variance.data[i], 0.0f);
        total += variance.data[i];
        sum[i] += beauty.data[i];
        squares[i] += double(beauty.data[i]) * beauty.data[i];
      }
      estimates.push_back(total);
    }
    double estimate = 0, scatter = 0, truth = 0, truthScatter = 0;
    for (const double e : estimates) estimate += e / seeds;
    for (const double e : estimates) scatter += (e - estimate) * (e - estimate) / (double(seeds) * (seeds - 1));
    for (size_t p = 0; p < sum.size(); p += 3) {       // channels of a pixel are not independent: one term a pixel
      double v = 0;
      for (size_t i = p; i < p + 3; ++i) v += (squares[i] - sum[i] * sum[i] / seeds) / (seeds - 1);
      truth += v;
      truthScatter += v * v * 2.0 / (seeds - 1) * 2.0; // chi-square, doubled for tails heavier than normal
    }
    const double sigma = std::sqrt(scatter + truthScatter);
    RecordProperty("ratio_" + std::to_string(spp), std::to_string(estimate / truth));
    std::printf("%d spp: variance output / scatter over %d seeds = %.3f +- %.3f\n", spp, seeds, estimate / truth, sigma / truth);
    EXPECT_LT(sigma, 0.15 * truth) << "too coarse to say anything";
    EXPECT_NEAR(estimate, truth, 4.0 * sigma);
  }
}

TEST(Outputs, VarianceFollowsGains) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 12, 8, 128);
  ask(r, {"variance"});
  const Image before = pictures(mustRender(*engine, r))["variance"];
  set(r, "lights.light.gain=2,2,2");
  const RenderResult twice = mustRender(*engine, r);
  EXPECT_EQ(nodesBy(twice, v1::NodeReport::RUN).size(), 1u) << "a gain runs the variance node alone";
  const Image after = pictures(twice)["variance"];
  for (size_t i = 0; i < before.data.size(); ++i) EXPECT_NEAR(after.data[i], 4.0f * before.data[i], 1e-5f * after.data[i]);
}

TEST(Outputs, FewBlocksWarnAndOneIsUnknown) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 8, 6, 64);
  ask(r, {"variance", "sample_count"});
  const RenderResult four = mustRender(*engine, r);
  ASSERT_EQ(four.reply.warnings_size(), 1);
  EXPECT_NE(four.reply.warnings(0).find("4 independent blocks"), std::string::npos) << four.reply.warnings(0);
  for (const float v : pictures(four)["sample_count"].data) EXPECT_EQ(v, 64.0f);
  set(r, "halt.spp=16");
  for (const float v : pictures(mustRender(*engine, r))["variance"].data) EXPECT_EQ(v, -1.0f);
  set(r, "halt.spp=128");
  EXPECT_EQ(mustRender(*engine, r).reply.warnings_size(), 0);
  set(r, "shadows.ray_traced.samples=4");
  const RenderResult part = mustRender(*engine, r);
  ASSERT_EQ(part.reply.warnings_size(), 1);
  EXPECT_NE(part.reply.warnings(0).find("without direct:light"), std::string::npos) << part.reply.warnings(0);
}

TEST(Outputs, ExtendingWithStreamsEqualsScratch) {
  const auto warm = makeEngine(), cold = makeEngine(256ull << 20, {}, 1);
  v1::RenderRequest r = smallRequest("cornell", 12, 8, 48);
  ask(r, {"beauty", "variance", "sample_count"});
  mustRender(*warm, r);
  set(r, "halt.spp=176");
  const RenderResult extended = mustRender(*warm, r);
  EXPECT_NE(nodesBy(extended, v1::NodeReport::RUN).at("path_trace").reason().find("extended"), std::string::npos);
  EXPECT_EQ(firstDifference(extended, mustRender(*cold, r)), "");
}

TEST(Outputs, WhatIsNotAskedForCostsNothing) {
  const auto plain = makeEngine(), full = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 16);
  const RenderResult beauty = mustRender(*plain, r);
  EXPECT_EQ(beauty.reply.plan_size(), 3) << "path_trace, its mean, beauty";
  EXPECT_TRUE(beauty.tables.empty());
  const uint64_t bytes = nodesBy(beauty, v1::NodeReport::RUN).at("path_trace").bytes();
  ask(r, {"beauty", "variance", "diffuse", "object_id", "material_id", "motion"});
  const RenderResult all = mustRender(*full, r);
  EXPECT_GT(nodesBy(all, v1::NodeReport::RUN).at("path_trace").bytes(), 5 * bytes);
  EXPECT_EQ(all.tables.size(), 2u);
  ask(r, {"object_id"});
  const RenderResult ids = mustRender(*makeEngine(), r);
  for (const auto& n : ids.reply.plan()) EXPECT_EQ(n.node().find("path_trace"), std::string::npos) << n.node();
}

TEST(Outputs, MotionStepAndRest) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("spheres", 16, 12, 16);
  ask(r, {"motion"});
  for (const float v : pictures(mustRender(*engine, r))["motion"].data) EXPECT_EQ(v, 0.0f);
  set(r, "motion_step_s=0.5");
  EXPECT_TRUE(nodesBy(mustRender(*engine, r), v1::NodeReport::RUN).empty()) << "the earlier moment is the same: nothing runs";
  set(r, "motion_step_s=0");
  EXPECT_EQ(engine->render(r).status().code(), Code::InvalidArgument);
}

TEST(Outputs, UnknownOnesAndBadEncodingsAreRefusedByName) {
  const auto engine = makeEngine();
  const auto refused = [&](std::initializer_list<const char*> edits, const char* word) {
    v1::RenderRequest r = smallRequest("cornell", 8, 6, 16);
    for (const char* e : edits) set(r, e);
    const Status s = engine->render(r).status();
    EXPECT_EQ(s.code(), Code::InvalidArgument) << word;
    EXPECT_NE(s.toString().find(word), std::string::npos) << s.toString();
  };
  refused({"outputs=object"}, "object_id");
  refused({"outputs=motion:light"}, "motion:light");
  refused({"encoding.layers=true", "encoding.format=PNG"}, "encoding.layers");
  refused({"encoding.png_bits=12"}, "encoding.png_bits");
  refused({"encoding.dwa_level=0"}, "dwa_level");
}

}  // namespace
}  // namespace gobo::testing
