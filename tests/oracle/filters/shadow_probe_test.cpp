// SPDX-License-Identifier: Apache-2.0
// What the probe of shadows.auto says of a picture from a hundred of its pixels, against the same errors over all of them: shadow rays by pixel centres and 256
// places of each pixel, maps as they are made, rays of area lights against a thousand.
#include <gtest/gtest.h>

#include <cmath>

#include "filters/automatic/probe_windows.h"
#include "filters/automatic/shadow_probe.h"
#include "filters/axis_aligned/maps.h"
#include "filters/axis_aligned/technique.h"
#include "filters/shadow_map/techniques.h"
#include "filters/soft_shadow/soft_kernels.h"
#include "filters/soft_shadow/techniques.h"
#include "scene/load.h"
#include "support/run_node.h"
#include "support/shadow_stage.h"
#include "support/stopping.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"
#include "terms/light_points.h"

namespace gobo::test::probe {
namespace {

constexpr int kProbeWidth = 120, kProbeHeight = 90, kProbeSeeds = 24;
/// Rays of the truth of lights of some size: its own noise is small beside the errors of a few rays, and the bounds have slack for it.
uint32_t truthRays() { return testing::thoroughOr(1024u, 256u); }
/// Seeds where each of them makes a map or filters windows.
int dearSeeds() { return testing::thoroughOr(kProbeSeeds, kProbeSeeds / 2); }
/// What a bound written as a number grows by with so many seeds: noise.
double dearNoise() { return std::sqrt(double(kProbeSeeds) / dearSeeds()); }

struct ProbeScene {
  const char* scene;
  const char* light;
};
ScenePtr sceneOf(const ProbeScene& s) {
  auto made = makeBuiltinScene(s.scene);
  GOBO_CHECK(made.ok());
  return *made;
}

v1::ShadowTechnique rays(uint32_t samples) {
  v1::ShadowTechnique t;
  t.mutable_ray_traced()->set_samples(samples);
  return t;
}
v1::ShadowTechnique map(uint32_t resolution, bool soft = false) {
  v1::ShadowTechnique t;
  t.mutable_map()->set_resolution(resolution);
  if (soft) t.mutable_percentage_closer_soft();
  else t.mutable_percentage_closer();
  return t;
}

/// Whether the light can shine on each view sample.
std::vector<char> receivers(const ShadowRun& run, const Scene& scene, int light) {
  const std::vector<int> subset{light};
  const SceneView view(scene, Facet::All, subset);
  const LightPoints points(view, light);
  std::vector<char> out(run.size());
  for (size_t i = 0; i < run.size(); ++i) {
    LightPoint p;
    out[i] = run.surface(i) && points.sample(run.at("P", i), run.at("Ng", i), run.at("Ng", i), Vec2(0.5f), p);
  }
  return out;
}

struct Brute {
  std::vector<float> truth;
  std::vector<char> lit;
  double mse(std::span<const float> V) const {
    double sum = 0, count = 0;
    for (size_t p = 0; p < truth.size(); ++p)
      if (lit[p]) sum += (double(V[p]) - truth[p]) * (double(V[p]) - truth[p]), ++count;
    return sum / count;
  }
};
Brute hardTruth(const ScenePtr& scene, int light) {
  const int places = testing::thoroughOr(16, 8);  // along each side of a pixel
  const size_t side = size_t(places);
  const ShadowRun coarse = runShadow(scene, rays(1), {kProbeWidth, kProbeHeight}, light),
                  fine = runShadow(scene, rays(1), {kProbeWidth * places, kProbeHeight * places}, light);
  Brute b{std::vector<float>(coarse.size(), 1.0f), receivers(coarse, *scene, light)};
  const std::vector<char> lit = receivers(fine, *scene, light);
  for (size_t p = 0; p < b.truth.size(); ++p) {
    double sum = 0, count = 0;
    for (size_t j = 0; j < side; ++j)
      for (size_t i = 0; i < side; ++i) {
        const size_t e = (p / kProbeWidth * side + j) * (kProbeWidth * side) + p % kProbeWidth * side + i;
        if (lit[e]) sum += fine.V()[e], ++count;
      }
    if (count > 0) b.truth[p] = float(sum / count);
  }
  return b;
}

struct Probed {
  std::vector<double> mse, variance, work;
  double share = 0;
};
/// Ray counts, then one map (resolution 0: none).
Probed probed(const ScenePtr& scene, int light, uint64_t seed, const std::vector<uint32_t>& counts, int resolution, int threads = 2) {
  NodeId probe = -1;
  const LightShape& shape = scene->lights[size_t(light)].shape;
  const bool soft = !isDeltaLight(shape);
  const ShadowRun r = runPlanned(
      scene,
      [&](Graph& g, const ShadowInput& in) -> Result<NodeId> {
        ShadowProbeSettings s;
        s.camera = in.camera;
        s.width = in.width;
        s.height = in.height;
        s.judged = 96;
        s.rays = counts;
        s.seed = seed;
        probe = g.add({makeShadowProbeNode(s), {}, {in.light}, "probe", 0, in.scene, false});
        if (!resolution) return probe;
        const auto errors = [&](NodeId visibility) {
          return g.add({makeProbeErrorsNode(in.viewSamples), {probe, visibility}, {}, "errors", 0, nullptr, false});
        };
        if (soft) {
          ShadowInput there = in;
          there.gbuffer = probe;
          GOBO_ASSIGN(const NodeId visibility, planPercentageCloserSoftWork(g, there, map(uint32_t(resolution), true)));
          return errors(visibility);
        }
        MapProbeSettings m;
        Vec3 lo, hi;
        in.scene->bounds(lo, hi);
        const v1::ShadowTechnique t = map(uint32_t(resolution));
        const ShadowMapSettings base = shadowMapSettings(t.map());
        m.map.resolution = resolution;
        GOBO_ASSIGN(m.map.frames, fitLightFrames(shape, lo, hi, resolution, 2));
        m.bias = base.bias;
        m.slopeBias = base.slopeBias;
        return errors(g.add({makeMapProbeNode(m), {probe}, {}, "map", 0, in.scene, false}));
      },
      {kProbeWidth, kProbeHeight, threads}, light);
  GOBO_CHECK(r.ok());
  Probed p;
  const Term& t = *r.terms[size_t(probe)];
  for (size_t k = 0; k < counts.size(); ++k) {
    p.mse.push_back(t.plane<double>("mse")[k]);
    p.variance.push_back(t.plane<double>("variance")[k]);
  }
  p.share = t.plane<double>("share")[0];
  if (resolution) {
    p.mse.push_back(r.terms.back()->plane<double>("mse")[0]);
    p.variance.push_back(r.terms.back()->plane<double>("variance")[0]);
    if (soft) {
      const auto work = r.terms.back()->plane<double>("work");
      p.work.assign(work.begin(), work.end());
    }
  }
  return p;
}

/// Means over seeds against the truth, and how often it lies within two standard errors: less often than a normal distribution's, because few pixels hold most
/// of the error (what is left out then is small, and a probe that has not seen it does not know).
void expectRight(const std::string& what, const std::vector<double>& mse, const std::vector<double>& variance, double truth, double slack) {
  const double n = double(mse.size());
  double mean = 0, squares = 0;
  int within = 0;
  for (size_t i = 0; i < mse.size(); ++i) {
    mean += mse[i] / n;
    squares += mse[i] * mse[i] / n;
    within += std::fabs(mse[i] - truth) <= 2 * std::sqrt(variance[i]) + slack * truth;
  }
  const double error = std::sqrt(std::max(0.0, squares - mean * mean) / (n - 1));
  EXPECT_NEAR(mean, truth, 3.5 * error + slack * truth) << what;
  EXPECT_GE(within, int(0.6 * n)) << what << ": truth " << truth << ", mean " << mean;
}

TEST(ShadowProbe, HardErrorsAreThoseOfThePicture) {
  for (const ProbeScene& s : {ProbeScene{"fence", "sun"}, {"trees", "sun"}, {"lights8", "a"}, {"atrium", "sun"}}) {
    const ScenePtr scene = sceneOf(s);
    const int light = scene->findLight(s.light);
    ASSERT_GE(light, 0);
    const Brute brute = hardTruth(scene, light);
    std::vector<double> mse[2], variance[2];
    double share = 0;
    for (uint64_t seed = 1; seed <= kProbeSeeds; ++seed) {
      const Probed p = probed(scene, light, seed, {1}, 512);
      share += p.share / kProbeSeeds;
      for (size_t k = 0; k < 2; ++k) {
        mse[k].push_back(p.mse[k]);
        variance[k].push_back(p.variance[k]);
      }
    }
    double lit = 0;
    for (const char c : brute.lit) lit += c;
    EXPECT_NEAR(share, lit / double(brute.lit.size()), 0.02) << s.scene;
    // The truth's own 256 places (64) are no infinity; maps by rays through texel centres are scan conversion's but for edges of triangles.
    expectRight(std::string(s.scene) + ", a ray", mse[0], variance[0], brute.mse(runShadow(scene, rays(1), {kProbeWidth, kProbeHeight}, light).V()), 0.03);
    expectRight(std::string(s.scene) + ", a map", mse[1], variance[1], brute.mse(runShadow(scene, map(512), {kProbeWidth, kProbeHeight}, light).V()), 0.08);
  }
}

// A ball that nothing shades, framed alike from afar: origin + t direction is off by what the distance's last place says, hitPosition() is not.
TEST(ShadowProbe, FarCamerasSeeNoAcne) {
  for (const float distance : {3.0f, 30.0f, 300.0f, 3000.0f}) {
    tests::SceneMaker m;
    m.instance(m.mesh(tests::sphere(Vec3(0.1f, 0.2f, -0.3f), 1.0f, 40, false), m.material(Vec3(0.5f))));
    LightShape sun;
    sun.kind = LightKind::Directional;
    sun.axis = -glm::normalize(Vec3(0.3f, 0.5f, 1.0f));
    m.light(sun);
    m.camera(Vec3(0.1f, 0.2f, -0.3f) + distance * glm::normalize(Vec3(0.2f, 0.7f, 1.0f)), Vec3(0.1f, 0.2f, -0.3f), 2 * std::atan(0.7f / distance));
    const ScenePtr scene = m.finish();
    const Probed p = probed(scene, 0, 7, {1}, 0);
    const Brute brute = hardTruth(scene, 0);
    const double error = brute.mse(runShadow(scene, rays(1), {kProbeWidth, kProbeHeight}, 0).V());
    // Where the light leaves the ball a pixel's places may differ; acne is fifty times that.
    EXPECT_LT(error, 1e-4) << distance;
    EXPECT_LT(p.mse[0], 1e-3) << distance;
    EXPECT_GT(p.share, 0.5) << distance;
  }
}

TEST(ShadowProbe, SoftErrorsAreThoseOfThePicture) {
  for (const ProbeScene& s : {ProbeScene{"fence", "key"}, {"spheres", "key"}}) {
    const ScenePtr scene = sceneOf(s);
    const int light = scene->findLight(s.light);
    const ShadowRun truth = runShadow(scene, rays(truthRays()), {kProbeWidth, kProbeHeight}, light);
    const Brute brute{std::vector<float>(truth.V().begin(), truth.V().end()), receivers(truth, *scene, light)};
    std::vector<double> mse[2], variance[2];
    for (uint64_t seed = 1; seed <= kProbeSeeds; ++seed) {
      const Probed p = probed(scene, light, seed, {1, 4}, 0);
      for (size_t k = 0; k < 2; ++k) {
        mse[k].push_back(p.mse[k]);
        variance[k].push_back(p.variance[k]);
      }
    }
    expectRight(std::string(s.scene) + ", 1 ray", mse[0], variance[0], brute.mse(runShadow(scene, rays(1), {kProbeWidth, kProbeHeight}, light).V()), 0.08);
    expectRight(std::string(s.scene) + ", 4 rays", mse[1], variance[1], brute.mse(runShadow(scene, rays(4), {kProbeWidth, kProbeHeight}, light).V()), 0.08);
  }
}

// As many rays as the truth has: they are judged by other sequences than their own, else they would have no error at all.
TEST(ShadowProbeDeathTest, SettingsBeyondItsPacketsAreRefused) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  ShadowProbeSettings s;
  s.viewSamples = 17;
  EXPECT_DEATH(makeShadowProbeNode(s), "viewSamples.*17 vs 16");
  s.viewSamples = 0;
  EXPECT_DEATH(makeShadowProbeNode(s), "viewSamples.*0 vs 0");
  s.viewSamples = 16;
  s.rays.assign(1000, 1);
  EXPECT_DEATH(makeShadowProbeNode(s), "rays.size.*1000");
}

TEST(ShadowProbe, RaysAreNotTheirOwnTruth) {
  const ScenePtr scene = sceneOf({"fence", "key"});
  const Probed p = probed(scene, scene->findLight("key"), 1, {4, ShadowProbeSettings().truthRays}, 0);
  EXPECT_GT(p.mse[1], 0.0);
  EXPECT_LT(p.mse[1], 0.5 * p.mse[0]);
}

// Maps of lights of some size are made, and looked up where the probe looks: what it says of their errors and of what they read is said of those lookups.
TEST(ShadowProbe, SoftMapsErrorsAndWorkAreThoseOfThePicture) {
  constexpr int kTexels = 512;  // wide enough for taps and narrow enough for whole boxes
  for (const ProbeScene& s : {ProbeScene{"fence", "key"}, {"spheres", "key"}, {"lights8", "rim"}}) {
    const ScenePtr scene = sceneOf(s);
    const int light = scene->findLight(s.light);
    ASSERT_GE(light, 0);
    const ShadowRun truth = runShadow(scene, rays(truthRays()), {kProbeWidth, kProbeHeight}, light);
    const Brute brute{std::vector<float>(truth.V().begin(), truth.V().end()), receivers(truth, *scene, light)};
    const ShadowRun whole = runPlanned(
        scene, [&](Graph& g, const ShadowInput& in) { return planPercentageCloserSoftWork(g, in, map(kTexels, true)); }, {kProbeWidth, kProbeHeight}, light);
    const auto done = whole.terms.back()->floats("work");
    constexpr size_t C = SoftWork::kChannels;
    double mean[C] = {}, sum[C] = {}, squares[C] = {};
    for (size_t i = 0; i < done.size(); ++i) mean[i % C] += double(done[i]) / double(done.size() / C);
    std::vector<double> mse, variance;
    for (uint64_t seed = 1; seed <= uint64_t(dearSeeds()); ++seed) {
      const Probed p = probed(scene, light, seed, {1, 4}, kTexels);
      mse.push_back(p.mse.back());
      variance.push_back(p.variance.back());
      ASSERT_EQ(p.work.size(), C);
      for (size_t c = 0; c < C; ++c) sum[c] += p.work[c], squares[c] += p.work[c] * p.work[c];
    }
    expectRight(std::string(s.scene) + ", a soft map", mse, variance, brute.mse(whole.V()), 0.08);
    EXPECT_GT(mean[0] + mean[3], 0.5) << s.scene;
    for (size_t c = 0; c < C; ++c) {
      const double n = double(dearSeeds()), m = sum[c] / n, error = std::sqrt(std::max(0.0, squares[c] / n - m * m) / (n - 1));
      EXPECT_NEAR(m, mean[c], 3.5 * error + 0.02 * mean[c]) << s.scene << " " << c;
      EXPECT_LT(error, (0.25 * mean[c] + 0.05) * dearNoise()) << s.scene << " " << c << ": a bound that says something";
    }
    // To say what it read changes nothing of what it says.
    const ShadowRun plain = runShadow(scene, map(kTexels, true), {kProbeWidth, kProbeHeight}, light);
    EXPECT_TRUE(std::equal(plain.V().begin(), plain.V().end(), whole.V().begin()));
  }
}

// A filter's error by windows about some of the probe's pixels: that of as many rays, times the ratio of both in the windows.
TEST(ShadowProbe, FiltersErrorsAreThoseOfThePicture) {
  constexpr uint32_t kFilterRays = 4;
  for (const ProbeScene& s : {ProbeScene{"fence", "key"}, {"spheres", "key"}, {"lights8", "rim"}}) {
    const ScenePtr scene = sceneOf(s);
    const int light = scene->findLight(s.light);
    ASSERT_GE(light, 0);
    v1::ShadowTechnique filter;
    filter.mutable_axis_aligned()->set_mean_samples(kFilterRays);
    const ShadowRun truth = runShadow(scene, rays(truthRays()), {kProbeWidth, kProbeHeight}, light),
                    whole = runShadow(scene, filter, {kProbeWidth, kProbeHeight}, light);
    const Brute brute{std::vector<float>(truth.V().begin(), truth.V().end()), receivers(truth, *scene, light)};
    const double plain = brute.mse(runShadow(scene, rays(kFilterRays), {kProbeWidth, kProbeHeight}, light).V()), filtered = brute.mse(whole.V());
    std::vector<double> ratios, variances, shares;
    for (uint64_t seed = 1; seed <= uint64_t(dearSeeds()); ++seed) {
      NodeId errors = -1;
      const ShadowRun r = runPlanned(
          scene,
          [&](Graph& g, const ShadowInput& in) -> Result<NodeId> {
            ShadowProbeSettings p;
            p.camera = in.camera;
            p.width = in.width;
            p.height = in.height;
            p.judged = 96;
            p.rays = {kFilterRays};
            p.seed = seed;
            const NodeId probe = g.add({makeShadowProbeNode(p), {}, {in.light}, "probe", 0, in.scene, false});
            ProbeWindowsSettings w;
            w.camera = in.camera;
            w.width = in.width;
            w.height = in.height;
            w.judged = p.judged;
            w.seed = seed;
            ShadowInput there = in;
            there.gbuffer = g.add({makeProbeWindowsNode(w), {probe}, {in.light}, "windows", 0, in.scene, false});
            there.width = there.height = w.side();
            there.viewSamples = w.extent().layers;
            GOBO_ASSIGN(const NodeId visibility, axisAlignedShadowTechnique().plan(g, there, filter));
            GOBO_ASSIGN(const NodeId maps, planShadowFilterMaps(g, visibility));
            return errors = g.add({makeWindowErrorsNode({w, kFilterRays}), {there.gbuffer, visibility, maps}, {}, "errors", 0, nullptr, false});
          },
          {kProbeWidth, kProbeHeight}, light);
      ASSERT_TRUE(r.ok());
      const Term& t = *r.terms[size_t(errors)];
      ratios.push_back(t.plane<double>("ratio")[0]);
      variances.push_back(t.plane<double>("variance")[0]);
      shares.push_back(t.plane<double>("work")[0]);
    }
    ASSERT_LT(filtered, plain) << s.scene;
    expectRight(std::string(s.scene) + ", filter over rays", ratios, variances, filtered / plain, 0.25);
    double share = 0, lit = 0;
    for (const double x : shares) share += x / double(dearSeeds());
    const auto omega = whole.term("shadow_predicted_width")->floats("Omega");
    for (const float o : omega) lit += o > 0.0f;
    EXPECT_NEAR(share, lit / double(omega.size()), 0.15 * dearNoise() * lit / double(omega.size())) << s.scene;
  }
}

// The truth's halves are independent: an error is the product of what is off each of them, not the square of what is off one.
TEST(ShadowProbe, ErrorsAreProductsOverBothHalvesOfTheTruth) {
  const Extent two{2, 1, 1};
  auto probe = std::make_shared<Term>("shadow_probe", Domain::Table, two), visibility = std::make_shared<Term>("visibility", Domain::Table, two);
  const auto put = [&](Term& t, const char* name, auto x, auto y) {
    using T = decltype(x);
    t.addRaw(name, formatOf<T>(), 1);
    t.writable<T>(name)[0] = x;
    t.writable<T>(name)[1] = y;
  };
  put(*probe, "a", 0.5f, 0.25f);
  put(*probe, "b", 0.25f, 0.75f);
  put(*probe, "lit", 1.0f, 1.0f);
  put(*probe, "weight", 0.25, 0.75);
  put(*probe, "stratum", 0u, 0u);
  put(*probe, "share", 0.5, 0.0);
  put(*visibility, "V", 1.0f, 0.5f);
  AccelCache accels;
  const TaskArena arena(1);
  RunContext ctx;
  ctx.inputs = {probe, visibility};
  ctx.arena = &arena;
  ctx.accels = &accels;
  const auto errors = runNode(*makeProbeErrorsNode(1), ctx);
  ASSERT_TRUE(errors.ok()) << errors.status().toString();
  EXPECT_NEAR((*errors)->plane<double>("mse")[0], (0.25 * 0.5 * 0.75 + 0.75 * 0.25 * -0.25) / 0.5, 1e-12);
}

TEST(ShadowProbe, IsTheSameForAnyNumberOfThreads) {
  for (const ProbeScene& s : {ProbeScene{"fence", "sun"}, {"fence", "key"}}) {
    const ScenePtr scene = sceneOf(s);
    const int light = scene->findLight(s.light);
    const Probed one = probed(scene, light, 5, {1}, 256, 1), many = probed(scene, light, 5, {1}, 256, 7);
    EXPECT_EQ(one.mse, many.mse);
    EXPECT_EQ(one.variance, many.variance);
    EXPECT_EQ(one.share, many.share);
  }
}

TEST(ShadowProbe, StopsWhereverItIsAsked) {
  const ScenePtr scene = sceneOf({"fence", "sun"});
  const int light = scene->findLight("sun");
  ShadowProbeSettings s;
  s.camera = scene->cameras[0];
  s.width = kProbeWidth;
  s.height = kProbeHeight;
  s.rays = {1};
  const NodePtr node = makeShadowProbeNode(s);
  AccelCache accels;
  const TaskArena arena(1);
  const auto run = [&](const StopToken& stop) {
    const std::vector<int> lights{light};
    const SceneView view(*scene, node->traits().facets, lights);
    RunContext ctx;
    ctx.scene = &view;
    ctx.arena = &arena;
    ctx.accels = &accels;
    ctx.stop = stop;
    return runNode(*node, ctx);
  };
  ASSERT_TRUE(run({}).ok());
  const int polls = tests::pollsOf([&](const StopToken& stop) { (void)run(stop); });
  EXPECT_GE(polls, 8) << "looks at two levels, then pixels";
  for (int n = 1; n <= polls; n += std::max(1, polls / 12)) {
    const auto r = run(tests::stopAt(n));
    ASSERT_FALSE(r.ok()) << n;
    EXPECT_EQ(r.status().code(), Code::Cancelled) << n;
  }
}

}  // namespace
}  // namespace gobo::test::probe
