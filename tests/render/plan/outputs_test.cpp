// SPDX-License-Identifier: Apache-2.0
// Outputs through the engine: parts add up to their wholes, variance is the variance, and what is not asked for costs nothing.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "plan/outputs.h"
#include "support/engines.h"
#include "support/thorough.h"

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

std::vector<float> values(const RenderResult& r, const std::string& output) { return pictures(r)[output].data; }

const std::initializer_list<const char*> kParts = {"beauty",   "emission",       "direct",          "indirect",         "diffuse",
                                                   "specular", "direct_diffuse", "direct_specular", "indirect_diffuse", "indirect_specular"};

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
  for (const char* e :
       {"lights.key.kind=RECT", "lights.key.position=0.5,3,1", "lights.key.direction=0,-1,-0.2", "lights.key.width=0.5", "lights.key.height=0.5",
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
  r.mutable_environment()->clear_extract_lights();
  set(r, "environment.area_lights=3");
  expectSums(mustRender(*engine, r), "environment as area lights");
}

// Pixels' variance against the scatter of the beauty over independent seeds, each pixel in units of what other seeds (the pilot) say its
// variance is (at least the median), so that the edges of the lamp are not the whole sum; pixels of far more are left out. The pilot alone
// decides, so that nothing is selected by what is tested. Pixels are independent: their scatter gives the error of the ratio.
TEST(Outputs, VarianceIsTheVarianceOverSeeds) {
  for (const int spp : {128, 256}) {
    if (spp == 256 && !thorough()) continue;
    const auto engine = makeEngine();
    const int pilot = 16, seeds = 32;
    v1::RenderRequest r = smallRequest("cornell", 24, 20, spp);
    set(r, "integrator.max_bounces=1");
    ask(r, {"beauty", "variance"});
    const size_t n = 24 * 20 * 3;
    std::vector<double> scale(n, 0.0), estimate(n, 0.0), sum(n, 0.0), squares(n, 0.0);
    for (int s = 0; s < pilot + seeds; ++s) {
      r.set_seed(uint64_t(1000 + s));
      const RenderResult result = mustRender(*engine, r);
      const std::vector<float> beauty = values(result, "beauty"), variance = values(result, "variance");
      ASSERT_EQ(variance.size(), n);
      for (size_t i = 0; i < n; ++i) {
        ASSERT_GE(variance[i], 0.0f);
        if (s < pilot) {
          scale[i] += variance[i] / pilot;
          continue;
        }
        estimate[i] += variance[i] / seeds;
        sum[i] += beauty[i];
        squares[i] += double(beauty[i]) * beauty[i];
      }
    }
    std::vector<double> sorted;
    for (const double v : scale)
      if (v > 1e-12) sorted.push_back(v);
    ASSERT_GT(sorted.size(), n / 2);
    std::nth_element(sorted.begin(), sorted.begin() + ptrdiff_t(sorted.size() / 2), sorted.end());
    const double median = sorted[sorted.size() / 2];
    std::vector<double> difference;  // a pixel's own, in units of its variance
    double total = 0, ratio = 0;
    for (size_t p = 0; p < n; p += 3) {
      double d = 0;
      int channels = 0;
      for (size_t i = p; i < p + 3; ++i) {
        if (!(scale[i] > 1e-12) || scale[i] > 10 * median) continue;
        scale[i] = std::max(scale[i], median);
        const double truth = (squares[i] - sum[i] * sum[i] / seeds) / (seeds - 1);
        d += (estimate[i] - truth) / scale[i];
        ratio += truth / scale[i];
        total += 1;
        ++channels;
      }
      if (channels) difference.push_back(d / channels);
    }
    double mean = 0, error = 0;
    for (const double d : difference) mean += d / double(difference.size());
    for (const double d : difference) error += (d - mean) * (d - mean);
    error = std::sqrt(error) / double(difference.size());
    std::printf("%d spp: (variance output - scatter over %d seeds) / variance = %.3f +- %.3f over %zu pixels\n", spp, seeds, mean, error, difference.size());
    EXPECT_GT(difference.size(), 300u);
    EXPECT_LT(error, 0.06) << "too coarse to say anything";
    EXPECT_NEAR(mean, 0.0, 4.0 * error);
    EXPECT_GT(ratio / total, 0.25) << "the pilot's scale means nothing";
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
  for (const float v : values(four, "sample_count")) EXPECT_EQ(v, 64.0f);
  set(r, "halt.spp=16");
  for (const float v : values(mustRender(*engine, r), "variance")) EXPECT_EQ(v, -1.0f);
  set(r, "halt.spp=128");
  EXPECT_EQ(mustRender(*engine, r).reply.warnings_size(), 0);
  set(r, "shadows.ray_traced.samples=4");
  const RenderResult part = mustRender(*engine, r);
  ASSERT_EQ(part.reply.warnings_size(), 1);
  EXPECT_NE(part.reply.warnings(0).find("without direct:light"), std::string::npos) << part.reply.warnings(0);
}

TEST(Outputs, ExtendingWithStreamsEqualsScratch) {
  v1::RenderRequest r = smallRequest("cornell", 12, 8, 176);
  ask(r, {"beauty", "variance", "sample_count"});
  const RenderResult scratch = mustRender(*makeEngine(256ull << 20, {}, 1), r);
  const auto warm = makeEngine();
  set(r, "halt.spp=48");
  mustRender(*warm, r);
  set(r, "halt.spp=176");
  const RenderResult extended = mustRender(*warm, r);
  EXPECT_NE(nodesBy(extended, v1::NodeReport::RUN).at("path_trace").reason().find("extended"), std::string::npos);
  EXPECT_EQ(firstDifference(extended, scratch), "");
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
  for (const float v : values(mustRender(*engine, r), "motion")) EXPECT_EQ(v, 0.0f);
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

/// A G-buffer holds what its request needs: whatever was asked for before and beside, the picture is the same.
TEST(Outputs, OfFirstHitsAreTheSameWhateverIsAskedForBesideThem) {
  v1::RenderRequest r = smallRequest("spheres", 21, 13, 1);
  std::map<std::string, RenderResult> alone;
  for (const OutputInfo& o : outputTable())
    if (showsFirstHits(o)) {
      set(r, (std::string("outputs=") + o.name).c_str());
      alone.emplace(o.name, mustRender(*makeEngine(0), r));
    }
  ASSERT_GE(alone.size(), 9u);
  const auto warm = makeEngine();
  for (const auto& [first, one] : alone)
    for (const auto& [second, two] : alone) {
      set(r, ("outputs=" + first + "," + second).c_str());
      const RenderResult both = mustRender(*warm, r);
      ASSERT_EQ(both.images.size(), 2u);
      EXPECT_EQ(both.images[0].image().data, one.images[0].image().data) << first << " beside " << second;
      EXPECT_EQ(both.images[1].image().data, two.images[0].image().data) << second << " beside " << first;
      set(r, ("outputs=" + first).c_str());
      EXPECT_EQ(mustRender(*warm, r).images[0].image().data, one.images[0].image().data) << first << " after " << second;
    }
  const auto bytes = [&](const char* outputs) {
    set(r, (std::string("outputs=") + outputs).c_str());
    return nodesBy(mustRender(*makeEngine(0), r), v1::NodeReport::RUN).at("gbuffer").bytes();
  };
  EXPECT_LT(3 * bytes("depth,object_id,material_id,alpha"), bytes("normal")) << "what nobody asked for is not made";
  EXPECT_LT(2 * bytes("z_depth,position,depth"), bytes("normal"));
}

// ---- pictures of shadow maps -----------------------------------------------------------------------------------------------------

v1::RenderRequest spotRequest(std::initializer_list<const char*> edits) {
  v1::RenderRequest r = smallRequest("spheres", 24, 16, 16);
  for (const char* e : {"lights.key.kind=SPOT", "lights.key.position=0.5,3,1", "lights.key.direction=0,-1,-0.2", "lights.key.outer_deg=50",
                        "lights.key.intensity=9", "view_samples=4"})
    set(r, e);
  for (const char* e : edits) set(r, e);
  return r;
}

TEST(ShadowPictures, ConvolutionBasisIsSinesAndCosinesOfOneDepth) {
  const auto engine = makeEngine();
  v1::RenderRequest r = spotRequest({"shadows.convolution.order=3", "shadows.map.resolution=16", "shadows.map.blur=0", "outputs=shadow_basis:key"});
  const RenderResult result = mustRender(*engine, r);
  ASSERT_EQ(result.images.size(), 1u);
  const Image basis = result.images[0].image();
  ASSERT_EQ(basis.width, 48) << "six images in three columns";
  ASSERT_EQ(basis.height, 32);
  ASSERT_EQ(basis.channels, 1);
  EXPECT_EQ(nodesBy(result, v1::NodeReport::RUN).count("visibility:key"), 0u) << "a picture of the map looks nothing up";
  EXPECT_EQ(nodesBy(result, v1::NodeReport::RUN).count("gbuffer"), 0u);
  set(r, "shadows.percentage_closer.taps=2");
  const RenderResult shown = mustRender(*engine, r);
  const Image depth = shown.images[0].image();
  ASSERT_EQ(depth.width, 16);
  ASSERT_EQ(depth.height, 16);
  EXPECT_EQ(nodesBy(shown, v1::NodeReport::REUSED).count("light_depth_map:key"), 1u);
  // Unfiltered, the images are sin and cos of c_k z of the same texel's z, c_k = (2 k - 1) pi / P with the period P = 1 + 1 / M
  // (formulas/convolution_shadow_map.glsl.h).
  const double period = 1.0 + 1.0 / 3.0;
  double nearest = 1, farthest = 0;
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x) {
      const double z = depth.at(x, y)[0];
      ASSERT_GE(z, 0.0);
      ASSERT_LE(z, 1.0);
      nearest = std::min(nearest, z), farthest = std::max(farthest, z);
      std::vector<double> values, wanted;
      for (int image = 0; image < 6; ++image) values.push_back(2.0 * basis.at(16 * (image % 3) + x, 16 * (image / 3) + y)[0] - 1.0);
      for (int k = 1; k <= 3; ++k) {
        wanted.push_back(std::sin((2 * k - 1) * M_PI / period * z));
        wanted.push_back(std::cos((2 * k - 1) * M_PI / period * z));
      }
      std::sort(values.begin(), values.end());
      std::sort(wanted.begin(), wanted.end());
      for (int i = 0; i < 6; ++i) ASSERT_NEAR(values[i], wanted[i], 2e-5) << x << "," << y;  // float sine of up to 5 pi, and 1/2 + v / 2 rounded
    }
  EXPECT_LT(nearest, farthest - 0.05) << "an even map says nothing";
}

TEST(ShadowPictures, MosaicsHaveTheirMapsSizes) {
  const auto engine = makeEngine();
  const auto size = [&](std::initializer_list<const char*> edits) {
    v1::RenderRequest r = spotRequest(edits);
    set(r, "outputs=beauty,shadow_basis:key");
    const RenderResult result = mustRender(*engine, r);
    if (result.images.size() != 2) return std::string("none");
    const Image& picture = result.images[1].image();
    EXPECT_EQ(result.images[0].width(), 24);
    for (const float v : picture.data) EXPECT_TRUE(std::isfinite(v));
    return std::to_string(picture.width) + "x" + std::to_string(picture.height);
  };
  EXPECT_EQ(size({"shadows.convolution.order=4", "shadows.map.resolution=8"}), "24x24") << "eight images and an empty one";
  EXPECT_EQ(size({"shadows.convolution.order=2", "shadows.convolution.bytes=true", "shadows.map.resolution=8"}), "16x16");
  EXPECT_EQ(size({"shadows.variance.min_variance=0", "shadows.map.resolution=8"}), "16x8");
  EXPECT_EQ(size({"shadows.moment.bleeding_reduction=0", "shadows.map.resolution=8"}), "16x16");
  EXPECT_EQ(size({"shadows.exponential.c=80", "shadows.map.resolution=8"}), "8x8");
  EXPECT_EQ(size({"shadows.shadow_map=", "shadows.map.resolution=8"}), "8x8");
  EXPECT_EQ(size({"shadows.shadow_map=", "shadows.map.resolution=8", "lights.key.kind=POINT"}), "24x16") << "six faces";
  EXPECT_EQ(size({"shadows.variance.min_variance=0", "shadows.map.resolution=8", "shadows.map.lookup=TRILINEAR"}), "16x8") << "the map, not its chain";
}

TEST(ShadowPictures, ByteImagesAreTheFloatOnesRounded) {
  const auto engine = makeEngine();
  v1::RenderRequest r = spotRequest({"shadows.convolution.order=2", "shadows.map.resolution=16", "outputs=shadow_basis:key"});
  const Image whole = mustRender(*engine, r).images.at(0).image();
  set(r, "shadows.convolution.bytes=true");
  const Image bytes = mustRender(*engine, r).images.at(0).image();
  ASSERT_EQ(bytes.data.size(), whole.data.size());
  double largest = 0;
  for (size_t i = 0; i < bytes.data.size(); ++i) largest = std::max(largest, double(std::fabs(bytes.data[i] - whole.data[i])));
  EXPECT_GT(largest, 0.0);
  EXPECT_LE(largest, 1.01 * 0.25 / 127.0 + 0.25 / 127.0) << "half a step of 1/127 in [-1, 1], for the texel and for what is filtered";
}

TEST(ShadowPictures, FlagsAreWhatTheClassificationFound) {
  const auto engine = makeEngine();
  const auto flags = [&](const char* classification, const char* epsilon) {
    v1::RenderRequest r = spotRequest({"shadows.exponential.c=40", "shadows.map.resolution=256", "shadows.map.blur=2", "outputs=shadow_flags:key,alpha"});
    set(r, std::string("shadows.exponential.classification=") + classification);
    set(r, std::string("shadows.exponential.epsilon=") + epsilon);
    return pictures(mustRender(*engine, r));
  };
  for (const char* classification : {"THRESHOLD", "Z_MAX"}) {
    auto tight = flags(classification, "0.05"), loose = flags(classification, "1");
    const Image &some = tight["shadow_flags:key"], &fewer = loose["shadow_flags:key"], &alpha = tight["alpha"];
    ASSERT_EQ(some.width, 24) << classification;
    ASSERT_EQ(some.height, 16);
    size_t marked = 0, kept = 0, whole = 0;
    for (size_t i = 0; i < some.data.size(); ++i) {
      const float v = some.data[i];
      ASSERT_GE(v, 0.0f);
      ASSERT_LE(v, 1.0f);
      if (alpha.data[i] == 0.0f) { ASSERT_EQ(v, 0.0f) << "nothing is seen there"; }
      if (alpha.data[i] == 1.0f) { ASSERT_EQ(v * 4, std::round(v * 4)) << "a share of four samples"; }
      ASSERT_LE(fewer.data[i], v) << classification << ": a larger margin flags no more";
      marked += v > 0;
      kept += fewer.data[i] > 0;
      whole += v == 1.0f;
    }
    std::printf("%s: %zu of %zu pixels flagged, %zu wholly; margin 1: %zu\n", classification, marked, some.data.size(), whole, kept);
    EXPECT_GT(marked, 5u) << classification;
    EXPECT_LT(marked, some.data.size() / 2) << classification;
    EXPECT_LT(kept, marked) << classification;
  }
}

TEST(ShadowPictures, RaysAndWidthsAreThoseOfTheFilter) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("grids", 48, 40, 1);
  for (const char* a : {"shadows.axis_aligned.mean_samples=32", "view_samples=1", "outputs=shadow_rays:key,shadow_width:key,visibility:key,alpha"}) set(r, a);
  auto of = [&](std::initializer_list<const char*> edits) {
    v1::RenderRequest e = r;
    for (const char* a : edits) set(e, a);
    return pictures(mustRender(*engine, e));
  };
  auto usual = of({}), narrow = of({"shadows.axis_aligned.k=6"}), plain = of({"shadows.axis_aligned.radius_px=0"});
  double sum = 0;
  size_t many = 0;
  for (size_t i = 0; i < usual["alpha"].data.size(); ++i) {
    const float rays = usual["shadow_rays:key"].data[i], width = usual["shadow_width:key"].data[i];
    if (usual["alpha"].data[i] == 0.0f) {
      ASSERT_EQ(rays, 0.0f);
      ASSERT_EQ(width, 0.0f);
      continue;
    }
    ASSERT_TRUE(rays == 4.0f || rays == 32.0f) << rays;
    many += rays == 32.0f;
    ASSERT_NEAR(narrow["shadow_width:key"].data[i], 0.5f * width, 1e-5f * width);  // width is 3/k of what was predicted
    ASSERT_EQ(narrow["shadow_rays:key"].data[i], rays);
    ASSERT_EQ(plain["shadow_width:key"].data[i], 0.0f) << "nothing is filtered";
    sum += rays;
  }
  EXPECT_GT(many, 100u);
  EXPECT_GT(sum, 0.0);
}

TEST(ShadowPictures, WhatCannotBeShownIsRefusedByName) {
  const auto engine = makeEngine();
  const auto refused = [&](std::initializer_list<const char*> edits, Code code, std::initializer_list<const char*> words) {
    const Status s = engine->render(spotRequest(edits)).status();
    EXPECT_EQ(s.code(), code) << s.toString();
    EXPECT_NE(s.toString().find("request.outputs"), std::string::npos) << s.toString();
    for (const char* word : words) EXPECT_NE(s.toString().find(word), std::string::npos) << word << " in: " << s.toString();
  };
  refused({"outputs=shadow_basis:key"}, Code::InvalidArgument, {"shadow_basis:key", "no map"});  // path traced
  refused({"outputs=shadow_basis:key", "shadows.ray_traced.samples=1"}, Code::InvalidArgument, {"shadow_basis:key", "no map"});
  refused({"outputs=shadow_flags:key"}, Code::InvalidArgument, {"shadow_flags:key", "classification"});
  refused({"outputs=shadow_flags:key", "shadows.exponential.c=80"}, Code::InvalidArgument, {"shadow_flags:key", "classification"});
  refused({"outputs=shadow_flags:key", "shadows.variance.min_variance=0"}, Code::InvalidArgument, {"shadow_flags:key", "classification"});
  for (const char* output : {"outputs=shadow_rays:key", "outputs=shadow_width:key"}) refused({output}, Code::InvalidArgument, {output + 8, "axis_aligned"});
  refused({"outputs=shadow_flags:nonesuch", "shadows.exponential.classification=Z_MAX"}, Code::NotFound, {"nonesuch"});
  refused({"outputs=shadow_basis"}, Code::InvalidArgument, {"shadow_basis:LIGHT"});
  refused({"outputs=beauty,shadow_basis:key", "shadows.exponential.c=80", "encoding.layers=true"}, Code::InvalidArgument,
          {"shadow_basis:key", "beauty", "layers"});
  v1::RenderRequest alone = spotRequest({"outputs=shadow_basis:key", "shadows.exponential.c=80", "encoding.layers=true", "shadows.map.resolution=8"});
  EXPECT_TRUE(engine->render(alone).ok()) << "one picture has one size";
}

}  // namespace
}  // namespace gobo::testing
