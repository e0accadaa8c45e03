// SPDX-License-Identifier: Apache-2.0
// Filterable shadow maps planned over the built-in "trees" scene, node by node: failures of the exponential map, the choice of its filtering,
// what the plan shares, and what it refuses.
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "filters/shadow_map/techniques.h"
#include "scene/load.h"
#include "terms/gbuffer.h"
#include "trace/accel.h"
#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;
using Exponential = v1::ExponentialShadow;
using Plan = Result<NodeId> (*)(Graph&, const ShadowInput&, const v1::ShadowTechnique&);

/// The scene's first directional light, seen from its first camera; terms stay between techniques.
class Stage {
 public:
  Stage() {
    auto made = makeBuiltinScene("trees");
    GOBO_CHECK(made.ok());
    input.scene = *made;
    for (size_t i = 0; i < input.scene->lights.size(); ++i)
      if (input.scene->lights[i].shape.kind == LightKind::Directional) input.light = int(i);
    input.camera = input.scene->cameras[0];
    input.width = 240;
    input.height = 160;
    GraphNode g;
    g.node = makeGBufferNode({input.camera, input.width, input.height, 1});
    g.scene = input.scene;
    input.gbuffer = graph.add(std::move(g));
  }
  Result<NodeId> plan(Plan planner, const v1::ShadowTechnique& t) { return planner(graph, input, t); }
  TermPtr run(Plan planner, const v1::ShadowTechnique& t) {
    const auto id = plan(planner, t);
    EXPECT_TRUE(id.ok()) << id.status().toString();
    if (!id.ok()) return nullptr;
    TaskArena arena(2);
    for (NodeId i = 0; i <= *id; ++i) {
      if (terms.count(i)) continue;
      const GraphNode& n = graph.at(i);
      RunContext ctx;
      ctx.arena = &arena;
      ctx.counters = &counters;
      for (NodeId k : n.inputs) ctx.inputs.push_back(terms[k]);
      std::unique_ptr<SceneView> view;
      if (n.node->traits().facets != Facet::None) {
        view = std::make_unique<SceneView>(*n.scene, n.node->traits().facets, n.lights);
        ctx.scene = view.get();
        ctx.accels = &accels;
      }
      auto term = runNode(*n.node, ctx);
      EXPECT_TRUE(term.ok()) << n.label << ": " << term.status().toString();
      if (!term.ok()) return nullptr;
      terms[i] = *term;
    }
    return terms[*id];
  }
  Graph graph;
  ShadowInput input;
  AccelCache accels;
  RunCounters counters;
  std::map<NodeId, TermPtr> terms;
};

v1::ShadowTechnique exponential(uint32_t resolution, uint32_t blur, Exponential::Classification how) {
  v1::ShadowTechnique t;
  t.mutable_map()->set_resolution(resolution);
  t.mutable_map()->set_blur(blur);
  t.mutable_exponential()->set_classification(how);
  return t;
}

// Tables round moments to 1/32767, which the default bias does not cover: what lies well behind the only depth there is was lit, some of it wholly.
TEST(ShadowScene, MomentsFromTablesLeaveAnUmbraOfOneDepthDark) {
  constexpr int side = 16;
  Stage stage;
  v1::ShadowTechnique t;
  t.mutable_moment();
  t.mutable_map()->set_resolution(side);
  t.mutable_map()->set_lookup(v1::ShadowMapSettings::SUMMED_AREA);
  const auto id = stage.plan(planMomentShadow, t);
  ASSERT_TRUE(id.ok()) << id.status().toString();
  const GraphNode& lookup = stage.graph.at(*id);
  const GraphNode& table = stage.graph.at(lookup.inputs.at(1));
  const GraphNode& encode = stage.graph.at(table.inputs.at(0));
  const auto fitted = fitShadowMap(stage.input, t, 2);
  ASSERT_TRUE(fitted.ok());
  const LightFrame& f = fitted->frames.face[0];
  const auto at = [&](double u, double d) {
    return f.origin + f.right * float(f.lo.x + u * (f.hi.x - f.lo.x)) + f.up * float(f.lo.y + 0.4 * (f.hi.y - f.lo.y)) +
           f.forward * float(f.near + d * (f.far - f.near));
  };
  for (int i = 0; i < 300; ++i) {
    const double z = 0.002 + 0.94 * i / 300;
    std::vector<Vec3> points;
    for (const double u : {0.3, 0.62})
      for (const double d : {0.05, -0.001}) points.push_back(at(u, z + d));
    const TermPtr sums = runNode(table.node, {runNode(encode.node, {depthMap(side, [&](int, int) { return float(z); })})});
    const std::vector<float> V = values(runNode(lookup.node, {receivers(points, -f.forward), sums}), "V");
    for (size_t k = 0; k < V.size(); k += 2) {
      EXPECT_LT(V[k], 0.01f) << "behind " << z;
      EXPECT_GT(V[k + 1], 0.99f) << "before " << z;
    }
  }
}

TEST(ShadowScene, FailuresAreAFewPercentAndGrowWithTheKernel) {
  // Thesis, table 7.2: 3.0 / 6.1 / 7.9 / 9.3 % by Z-Max, 2.8 / 4.9 / 6.1 / 7.1 % by threshold for kernels of 1, 3, 5, 7 texels on a garden scene of
  // its own. Here crowns of single leaves fill 40 % of what the camera sees, and a texel of the 80 m wide map is the size of a leaf: 13 to
  // 31 %, growing with the kernel, all of it crowns and trunks. Flagged pixels are percentage-closer's, bit for bit; the bare ground has none.
  Stage stage;
  double last[2] = {0, 0};
  for (uint32_t blur : {0u, 1u, 2u, 3u}) {
    v1::ShadowTechnique pcf;
    pcf.mutable_map()->set_resolution(1024);
    pcf.mutable_map()->set_blur(blur);
    pcf.mutable_percentage_closer()->set_pattern(v1::PercentageCloserShadow::GAUSSIAN);
    const TermPtr comparison = stage.run(planPercentageCloser, pcf);
    double share[2];
    for (int k = 0; k < 2; ++k) {
      const TermPtr t = stage.run(planExponentialShadow, exponential(1024, blur, k ? Exponential::THRESHOLD : Exponential::Z_MAX));
      ASSERT_TRUE(t && comparison);
      const auto V = t->floats("V"), flags = t->floats("flags"), W = comparison->floats("V");
      const auto instance = stage.terms[stage.input.gbuffer]->plane<uint32_t>("instance");
      const auto P = stage.terms[stage.input.gbuffer]->floats("P");
      size_t flagged = 0, surfaces = 0, ground = 0;
      for (size_t i = 0; i < V.size(); ++i) {
        surfaces += instance[i] != ~0u;
        flagged += flags[i] == 1.0f;
        ground += flags[i] == 1.0f && P[3 * i + 1] < 0.05f;
        if (flags[i] == 1.0f) { ASSERT_EQ(V[i], W[i]); }
      }
      EXPECT_LT(double(ground), 0.005 * double(surfaces)) << "the ground is a slanted plane with nothing behind it";
      share[k] = 100.0 * double(flagged) / double(surfaces);
      EXPECT_GT(share[k], last[k]) << "blur " << blur;
      last[k] = share[k];
    }
    std::cout << "kernel " << 2 * blur + 1 << ": Z-Max " << share[0] << " %, threshold " << share[1] << " % of surface pixels" << std::endl;
    if (blur) { EXPECT_LE(share[1], share[0]); }
    EXPECT_GT(share[1], 2.0);
    EXPECT_LT(share[0], 40.0);
  }
}

TEST(ShadowScene, ExponentsAbove80FilterLogarithmically) {
  Stage stage;
  const auto label = [&](double c, Exponential::Filtering filtering) {
    v1::ShadowTechnique t = exponential(64, 1, Exponential::OFF);
    t.mutable_exponential()->set_c(c);
    t.mutable_exponential()->set_filtering(filtering);
    const auto id = stage.plan(planExponentialShadow, t);
    if (!id.ok()) return id.status().location();
    return stage.graph.at(stage.graph.at(*id).inputs[1]).label.substr(0, stage.graph.at(stage.graph.at(*id).inputs[1]).label.find(':'));
  };
  EXPECT_EQ(label(80, Exponential::AUTO), "exponential_map");
  EXPECT_EQ(label(80.5, Exponential::AUTO), "exponential_logarithmic_map");
  EXPECT_EQ(label(2000, Exponential::AUTO), "exponential_logarithmic_map");
  EXPECT_EQ(label(20, Exponential::LOGARITHMIC), "exponential_logarithmic_map");
  EXPECT_EQ(label(80, Exponential::LINEAR), "exponential_map");
  EXPECT_EQ(label(80.5, Exponential::LINEAR), "shadows.exponential.c");  // refused by name
  // Both give one picture where both go.
  v1::ShadowTechnique t = exponential(256, 1, Exponential::OFF);
  const TermPtr linear = stage.run(planExponentialShadow, t);
  t.mutable_exponential()->set_filtering(Exponential::LOGARITHMIC);
  const TermPtr logarithmic = stage.run(planExponentialShadow, t);
  ASSERT_TRUE(linear && logarithmic);
  const auto a = linear->floats("V"), b = logarithmic->floats("V");
  for (size_t i = 0; i < a.size(); ++i) ASSERT_NEAR(a[i], b[i], 5e-5);
}

TEST(ShadowScene, SlidersBehindTheFilterKeepTheMap) {
  // One depth map for the whole family; one basis for everything that changes only the lookup.
  Stage stage;
  v1::ShadowTechnique t;
  t.mutable_map()->set_resolution(64);
  t.mutable_convolution()->set_order(8);
  ASSERT_TRUE(stage.plan(planConvolutionShadow, t).ok());
  const int first = stage.graph.size();  // G-buffer, depth map, basis, lookup
  EXPECT_EQ(first, 4);
  t.mutable_convolution()->set_attenuation(1);
  ASSERT_TRUE(stage.plan(planConvolutionShadow, t).ok());
  EXPECT_EQ(stage.graph.size(), first + 1);
  t.mutable_map()->set_bias(0.01);
  ASSERT_TRUE(stage.plan(planConvolutionShadow, t).ok());
  EXPECT_EQ(stage.graph.size(), first + 2);
  t.mutable_convolution()->set_order(9);
  ASSERT_TRUE(stage.plan(planConvolutionShadow, t).ok());
  EXPECT_EQ(stage.graph.size(), first + 4);  // new images, same depth
  v1::ShadowTechnique v;
  v.mutable_map()->set_resolution(64);
  v.mutable_variance();
  ASSERT_TRUE(stage.plan(planVarianceShadow, v).ok());
  EXPECT_EQ(stage.graph.size(), first + 6);
  v.mutable_moment();
  ASSERT_TRUE(stage.plan(planMomentShadow, v).ok());
  EXPECT_EQ(stage.graph.size(), first + 8);
}

TEST(ShadowScene, RefusalsNameFieldAndValue) {
  Stage stage;
  const auto refused = [&](Plan planner, v1::ShadowTechnique t, const char* field, const char* value) {
    t.mutable_map()->set_resolution(t.map().has_resolution() ? t.map().resolution() : 64);
    const auto id = stage.plan(planner, t);
    ASSERT_FALSE(id.ok()) << field;
    EXPECT_EQ(id.status().code(), Code::InvalidArgument);
    EXPECT_EQ(id.status().location(), field);
    EXPECT_NE(id.status().toString().find(value), std::string::npos) << id.status().toString();
  };
  v1::ShadowTechnique t;
  t.mutable_map()->set_lookup(v1::ShadowMapSettings::SUMMED_AREA);
  t.mutable_exponential();
  refused(planExponentialShadow, t, "shadows.map.lookup", "SUMMED_AREA");
  t.mutable_exponential_variance();
  refused(planExponentialVarianceShadow, t, "shadows.map.lookup", "SUMMED_AREA");
  t.mutable_convolution()->set_bytes(true);
  refused(planConvolutionShadow, t, "shadows.convolution.bytes", "bytes");
  t = {};
  t.mutable_convolution()->set_order(33);
  refused(planConvolutionShadow, t, "shadows.convolution.order", "33");
  t.mutable_convolution()->set_order(0);
  refused(planConvolutionShadow, t, "shadows.convolution.order", "0");
  t.mutable_exponential_variance()->set_c_positive(43);
  refused(planExponentialVarianceShadow, t, "shadows.exponential_variance.c_positive", "43");
  t.mutable_percentage_closer()->set_taps(17);
  refused(planPercentageCloser, t, "shadows.percentage_closer.taps", "17");
  t.mutable_variance();
  for (const auto& [set, field, value] : std::vector<std::tuple<std::function<void(v1::ShadowMapSettings&)>, const char*, const char*>>{
           {[](auto& m) { m.set_resolution(0); }, "shadows.map.resolution", "0"},
           {[](auto& m) { m.set_resolution(8193); }, "shadows.map.resolution", "8193"},
           {[](auto& m) { m.set_blur(65); }, "shadows.map.blur", "65"},
           {[](auto& m) { m.set_bias(1.5); }, "shadows.map.bias", "1.5"},
           {[](auto& m) { m.set_slope_bias(-1); }, "shadows.map.slope_bias", "-1"}}) {
    v1::ShadowTechnique bad = t;
    set(*bad.mutable_map());
    refused(planVarianceShadow, bad, field, value);
  }
  v1::ShadowTechnique sum = t;
  sum.mutable_map()->set_lookup(v1::ShadowMapSettings::SUMMED_AREA);
  EXPECT_TRUE(stage.plan(planVarianceShadow, sum).ok());
  sum.mutable_moment();
  EXPECT_TRUE(stage.plan(planMomentShadow, sum).ok());
  sum.mutable_convolution();
  EXPECT_TRUE(stage.plan(planConvolutionShadow, sum).ok());
}

TEST(ShadowScene, EveryTechniqueAgreesWithPercentageCloserToItsOwnError) {
  // The whole family on one map with one kernel against its exact target. Leaves shadow each other over less than a hundredth of this scene's
  // depth range, which series of 16 terms and exponents of 80 cannot tell apart: errors are large, and bounds 1.3 times what is measured
  // (printed). A wrong sign, plane or channel is above them.
  Stage stage;
  const auto with = [&](uint32_t blur) {
    v1::ShadowTechnique t;
    t.mutable_map()->set_resolution(1024);
    t.mutable_map()->set_blur(blur);
    return t;
  };
  v1::ShadowTechnique t = with(2);
  t.mutable_percentage_closer()->set_pattern(v1::PercentageCloserShadow::GAUSSIAN);
  const auto exact = stage.run(planPercentageCloser, t)->floats("V");
  const auto rms = [&](Plan planner, const v1::ShadowTechnique& t) {
    const TermPtr term = stage.run(planner, t);
    const auto V = term->floats("V");
    double sum = 0;
    for (size_t i = 0; i < V.size(); ++i) sum += (V[i] - exact[i]) * double(V[i] - exact[i]);
    return std::sqrt(sum / double(V.size()));
  };
  std::map<std::string, double> error;
  t.mutable_convolution()->set_order(4);
  error["convolution 4"] = rms(planConvolutionShadow, t);
  t.mutable_convolution()->set_order(16);
  error["convolution 16"] = rms(planConvolutionShadow, t);
  t.mutable_convolution()->set_bytes(true);
  error["convolution 16, bytes"] = rms(planConvolutionShadow, t);
  t.mutable_convolution()->set_order(32);
  error["convolution 32, bytes"] = rms(planConvolutionShadow, t);
  t.mutable_exponential();
  error["exponential"] = rms(planExponentialShadow, t);
  t.mutable_exponential()->set_classification(Exponential::Z_MAX);
  error["exponential, Z-Max"] = rms(planExponentialShadow, t);
  t.mutable_exponential()->set_c(300);
  error["exponential 300, Z-Max"] = rms(planExponentialShadow, t);
  t.mutable_variance();
  error["variance"] = rms(planVarianceShadow, t);
  t.mutable_exponential_variance();
  error["exponential variance"] = rms(planExponentialVarianceShadow, t);
  t.mutable_moment();
  error["moment"] = rms(planMomentShadow, t);
  for (const auto& [name, e] : error) std::cout << name << ": rms against percentage-closer " << e << std::endl;
  const std::map<std::string, double> bound{{"convolution 4", 0.46},         {"convolution 16", 0.32},
                                            {"convolution 16, bytes", 0.32}, {"convolution 32, bytes", 0.27},
                                            {"exponential", 0.28},           {"exponential, Z-Max", 0.1},
                                            {"exponential 300, Z-Max", 0.1}, {"variance", 0.21},
                                            {"exponential variance", 0.2},   {"moment", 0.15}};
  for (const auto& [name, e] : error) EXPECT_LT(e, bound.at(name)) << name;
  EXPECT_LT(error["convolution 16"], error["convolution 4"]);
  EXPECT_NEAR(error["convolution 16, bytes"], error["convolution 16"], 0.006);
  EXPECT_LT(error["exponential, Z-Max"], 0.5 * error["exponential"]);
  EXPECT_LT(error["moment"], error["variance"]);
}

}  // namespace
