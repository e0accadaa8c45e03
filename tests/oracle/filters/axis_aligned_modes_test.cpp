// SPDX-License-Identifier: Apache-2.0
// The literal modes of axis-aligned filtering, each against what it says: closed forms for light profiles, impulse responses and steps for the filter's.
#include <gtest/gtest.h>

#include <cmath>

#include "filters/axis_aligned/literal.h"
#include "filters/axis_aligned/sample_count.h"
#include "support/shadow_stage.h"
#include "support/tiny_scenes.h"
#include "unit/filters/synthetic.h"

namespace gobo::test {
namespace {

AxisAlignedModes modesOf(const char* words, AxisAlignedModes base = {}) {
  const auto m = axisAlignedModes(words, base);
  EXPECT_TRUE(m.ok()) << m.status().toString();
  return m.ok() ? *m : base;
}

// --- names -----------------------------------------------------------------------------------------------------------------------

TEST(AxisAlignedModes, NamesSetWhatTheySay) {
  EXPECT_TRUE(modesOf("beta=code").codeBeta);
  EXPECT_FALSE(modesOf("beta=code,beta=report_corrected").codeBeta);
  EXPECT_TRUE(modesOf("n=eq3.5").printedRate);
  EXPECT_FALSE(modesOf("n=eq3.5,n=capped").printedRate);
  EXPECT_EQ(modesOf("thresholds=report").thresholds, AxisAlignedThresholds::Report);
  EXPECT_EQ(modesOf("thresholds=code").thresholds, AxisAlignedThresholds::Code);
  EXPECT_EQ(modesOf("thresholds=code,thresholds=scale_free").thresholds, AxisAlignedThresholds::ScaleFree);
  EXPECT_EQ(modesOf("distance=light_plane").distance, AxisAlignedDistance::LightPlane);
  EXPECT_EQ(modesOf("distance=world").distance, AxisAlignedDistance::World);
  EXPECT_EQ(modesOf("distance=world,distance=ours").distance, AxisAlignedDistance::Line);
  EXPECT_TRUE(modesOf("filter=full2d").full2d);
  EXPECT_FALSE(modesOf("filter=full2d,filter=separable").full2d);
  EXPECT_EQ(modesOf("light=gaussian_truncated").profile.shape, ShadowLightProfile::GaussianTruncated);
  EXPECT_EQ(modesOf("light=gaussian").profile.shape, ShadowLightProfile::Gaussian);
  EXPECT_EQ(modesOf("light=gaussian,light=uniform").profile.shape, ShadowLightProfile::Uniform);
  EXPECT_TRUE(modesOf("shade=centre").profile.flat);
  EXPECT_FALSE(modesOf("shade=centre,shade=ratio").profile.flat);
  const AxisAlignedModes several = modesOf("beta=code,distance=world,light=gaussian");
  EXPECT_TRUE(several.codeBeta && several.distance == AxisAlignedDistance::World && several.profile.shape == ShadowLightProfile::Gaussian);
  AxisAlignedModes base;
  base.k = 2;
  base.full2d = true;
  EXPECT_EQ(modesOf("", base).k, 2.0f);
  EXPECT_TRUE(modesOf("beta=code", base).full2d) << "what is not named stays";
  for (const char* bad : {"beta=cod", "gamma=1", "beta", "beta=", "distance=light_plane,n", "n=capped,,"}) {
    const auto m = axisAlignedModes(bad);
    ASSERT_FALSE(m.ok()) << bad;
    EXPECT_EQ(m.status().code(), Code::InvalidArgument);
  }
  EXPECT_NE(axisAlignedModes("n=capped,beta=cod").status().toString().find("beta=cod"), std::string::npos);
}

// --- the light -------------------------------------------------------------------------------------------------------------------

constexpr int kWide = 96;
/// A floor, half a card over x > 0 at half the height of a square light of half side `half`; the camera looks at 2 m of floor from below the card.
ScenePtr rampStage(float half = 0.5f, float height = 10.0f, LightKind kind = LightKind::Rect, int rows = 1) {
  tests::SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  m.instance(m.mesh(tests::ground(40.0f), grey));
  m.instance(m.mesh(tests::quad(Vec3(0, 0.5f * height, 40), Vec3(40, 0, 0), Vec3(0, 0, -80)), grey));
  LightShape l;
  l.kind = kind;
  l.position = Vec3(0, height, 0);
  l.u = Vec3(half, 0, 0);
  l.v = Vec3(0, 0, half);
  l.radius = half;
  m.light(l);
  Camera c;
  c.perspective = false;
  c.yheight = 2.0f * float(rows) / kWide;
  c.toWorld = Mat4(Vec4(1, 0, 0, 0), Vec4(0, 0, -1, 0), Vec4(0, 1, 0, 0), Vec4(0, 0.3f * height, 0, 1));
  m.scene.cameras.assign(1, c);
  return m.finish();
}
ShadowRun runModes(const ScenePtr& scene, const AxisAlignedModes& modes, const ShadowPicture& picture = {kWide, 1, 2}) {
  return runPlanned(
      scene, [&](Graph& g, const ShadowInput& i) { return planAxisAlignedModes(g, i, modes); }, picture);
}
double normal(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

TEST(AxisAlignedModes, LightsHaveTheirClosedForms) {
  // At x the light is seen where its own place is below -x: uniform a ramp, Gaussians of sigma = half a side Phi(-x / sigma), cut at one sigma or not.
  const ScenePtr scene = rampStage();
  const struct {
    const char* words;
    std::function<double(double)> seen;
  } cases[] = {{"light=uniform", [](double t) { return std::clamp(0.5 - 0.5 * t, 0.0, 1.0); }},
               {"light=gaussian", [](double t) { return normal(-t); }},
               {"light=gaussian_truncated", [](double t) { return std::clamp((normal(-t) - normal(-1)) / (normal(1) - normal(-1)), 0.0, 1.0); }}};
  for (const auto& c : cases) {
    AxisAlignedModes m = modesOf("shade=centre");
    m.uniform = 1024;
    m.radiusPx = 0;
    const ShadowRun r = runModes(scene, modesOf(c.words, m));
    ASSERT_TRUE(r.ok()) << r.status.toString();
    double worst = 0;
    for (size_t i = 0; i < r.size(); ++i) worst = std::max(worst, std::fabs(double(r.V()[i]) - c.seen(double(r.at("P", i).x) / 0.5)));
    std::printf("%s: largest error %.4f\n", c.words, worst);
    EXPECT_LT(worst, 0.01) << c.words;  // they are 0.08 and more apart
  }
}

TEST(AxisAlignedModes, FilteredGaussiansWidenAsTheyShould) {
  // Phi(x / (sigma s sqrt(1 + 1/k^2))): sigma, width and filter together.
  AxisAlignedModes m = modesOf("light=gaussian,shade=centre");
  m.uniform = 256;
  m.k = 2;
  m.radiusPx = 64;
  const ShadowRun r = runModes(rampStage(0.2f, 10, LightKind::Rect, 24), m, {kWide, 24, 2});
  ASSERT_TRUE(r.ok());
  double bias = 0, unfiltered = 0;
  for (int x = 20; x < kWide - 20; ++x) {
    double mean = 0;
    for (int y = 0; y < 24; ++y) mean += r.V()[size_t(y) * kWide + size_t(x)] / 24.0;
    const double t = double(r.at("P", size_t(x)).x) / 0.2;
    bias = std::max(bias, std::fabs(mean - normal(-t / std::sqrt(1.25))));
    unfiltered = std::max(unfiltered, std::fabs(mean - normal(-t)));
  }
  std::printf("from the widened edge %.4f, from the edge itself %.4f\n", bias, unfiltered);
  EXPECT_LT(bias, 0.008);
  EXPECT_GT(unfiltered, 0.015);
}

TEST(AxisAlignedModes, SigmaIsHalfASideOfGaussians) {
  LightShape l;
  l.kind = LightKind::Rect;
  l.u = Vec3(0.4f, 0, 0);
  l.v = Vec3(0, 0, 0.9f);
  EXPECT_NEAR(sigmaOf(l, modesOf("light=uniform")), std::sqrt(0.36 / 3), 1e-6);
  for (const char* words : {"light=gaussian", "light=gaussian_truncated"}) EXPECT_NEAR(sigmaOf(l, modesOf(words)), 0.6, 1e-6) << words;
}

TEST(AxisAlignedModes, RatioWeighsTheLightAndCentreDoesNot) {
  // 1 m below a light of 2 x 2 m the far side sends less: the ramp is bent, as ray_traced has it.
  const ScenePtr scene = rampStage(1.0f, 1.0f);
  AxisAlignedModes m;
  m.uniform = 1024;
  m.radiusPx = 0;
  const ShadowRun flat = runModes(scene, modesOf("shade=centre", m)), ratio = runModes(scene, modesOf("shade=ratio", m)),
                  rays = runShadow(scene, rayTraced(1024), {kWide, 1, 2});
  double ramp = 0, bent = 0, same = 0;
  for (size_t i = 0; i < flat.size(); ++i) {
    const double truth = std::clamp(0.5 - 0.5 * double(flat.at("P", i).x), 0.0, 1.0);
    ramp = std::max(ramp, std::fabs(flat.V()[i] - truth));
    bent = std::max(bent, std::fabs(ratio.V()[i] - truth));
    same = std::max(same, std::fabs(double(ratio.V()[i]) - rays.V()[i]));
  }
  EXPECT_LT(ramp, 5e-3);
  EXPECT_GT(bent, 0.05);
  EXPECT_LT(same, 5e-3);
}

TEST(AxisAlignedModes, GaussiansAreForRectangles) {
  for (const char* words : {"light=gaussian", "light=gaussian_truncated"}) {
    const ShadowRun r = runModes(rampStage(0.5f, 10, LightKind::Disk), modesOf(words));
    ASSERT_FALSE(r.ok());
    EXPECT_EQ(r.status.code(), Code::InvalidArgument);
    EXPECT_NE(r.status.toString().find("l0"), std::string::npos);
  }
  EXPECT_TRUE(runModes(rampStage(0.5f, 10, LightKind::Disk), {}).ok());
  EXPECT_FALSE(runModes(rampStage(0.5f, 10, LightKind::Point), {}).ok());
}

// --- rates -----------------------------------------------------------------------------------------------------------------------

uint32_t countOf(bool printed, bool distant, float pixel) {
  const Extent e{1, 1, 1};
  const auto slopes = std::make_shared<Term>("shadow_slope_dilation", Domain::ViewSample, e);
  slopes->addPlane<float>("sMax")[0] = 1.0f;
  slopes->addPlane<float>("sMin")[0] = 10.0f / 9.9f - 1.0f;
  PlaneView view;
  view.width = view.height = 1;
  view.du = Vec3(pixel, 0, 0);
  ShadowRateSettings rate;
  rate.maxSamples = 1u << 30;
  rate.printed = printed;
  rate.distant = distant;
  return runFilter(makeShadowSampleCount(rate, e), {slopes, planeGBuffer(view), runFilter(makeShadowMu(1, 0, rate), {})})->plane<uint32_t>("n")[0];
}
TEST(AxisAlignedModes, PrintedRatesHaveNoCap) {
  // The golden row 10, 5, 9.9 of the digest; of a light at infinity the same with 1 + s = 1: 4 (1 + z1/z2)^2 (d/(sigma z2) + 1)^2, and its cap 4 (1 + d W)^2 (1
  // + sigma z1 W)^2.
  EXPECT_NEAR(countOf(true, false, 0.01f) / 156816.0, 1, 1e-3);
  EXPECT_NEAR(countOf(false, false, 0.01f) / 40787.8, 1, 1e-3);
  const double z2 = 10.0 / 9.9 - 1, d = 0.02, W = std::min(1 / z2, 1 / d);  // the pixel holds less than the light lets through
  EXPECT_NEAR(countOf(true, true, float(d)) / (4 * std::pow(1 + 1 / z2, 2) * std::pow(d / z2 + 1, 2)), 1, 1e-3);
  EXPECT_NEAR(countOf(false, true, float(d)) / (4 * std::pow(1 + d * W, 2) * std::pow(1 + W, 2)), 1, 1e-3);
}

// --- the filter ------------------------------------------------------------------------------------------------------------------

TermPtr evenOmega(const Extent& e, float omega) {
  return floatTerm(e, "Omega", [=](int, int, int) { return omega; });
}

TEST(AxisAlignedModes, CodeCutsAtTheBandLimit) {
  // Weights e^-(3 r^2 Omega^2) as far as r Omega = 1, nothing beyond; and that is what beta=code plans.
  PlaneView view;
  view.width = 65;
  view.height = 1;
  const Extent e{65, 1, 1};
  AxisAlignedFilterSettings s = axisAlignedSettings(32);
  s.k = s.cut = std::sqrt(6.0f);
  const double omega = 1 / (7.5 * 0.1);  // cut between the seventh and the eighth pixel
  const auto in = floatTerm(e, "V", [](int x, int, int) { return x == 32 ? 1.0f : 0.0f; });
  const auto out = runFilter(axisAligned(s), {in, planeGBuffer(view), evenOmega(e, float(omega))});
  double norm = 0;
  for (int i = -7; i <= 7; ++i) norm += std::exp(-3 * sqr(float(0.1 * i * omega)));
  for (int i = -16; i <= 16; ++i)
    EXPECT_NEAR(out->floats("V")[size_t(32 + i)], std::abs(i) <= 7 ? std::exp(-3 * sqr(float(0.1 * i * omega))) / norm : 0.0, 1e-5) << i;
  const ShadowRun code = runModes(rampStage(), modesOf("beta=code")), report = runModes(rampStage(), modesOf("beta=report_corrected"));
  const auto& a = settingsOfAxisAlignedFilter(*code.graph.at(code.visibility).node);
  EXPECT_FLOAT_EQ(a.k, std::sqrt(6.0f));
  EXPECT_FLOAT_EQ(a.cut, std::sqrt(6.0f));
  const auto& b = settingsOfAxisAlignedFilter(*report.graph.at(report.visibility).node);
  EXPECT_EQ(b.k, 3.0f);
  EXPECT_EQ(b.cut, 0.0f);
}

TEST(AxisAlignedModes, WordsReachTheFilterAndTheRates) {
  const auto plannedBy = [](const char* words) {
    const ShadowRun r = runModes(rampStage(), modesOf(words), {8, 2, 1});
    return settingsOfAxisAlignedFilter(*r.graph.at(r.visibility).node);
  };
  EXPECT_EQ(plannedBy("distance=world").distance, AxisAlignedDistance::World);
  EXPECT_EQ(plannedBy("thresholds=code").thresholds, AxisAlignedThresholds::Code);
  EXPECT_TRUE(plannedBy("filter=full2d").exact2d);
  EXPECT_FALSE(plannedBy("").exact2d || plannedBy("").literal());
  // Rates: a light of 0.1 m halfway up, where pixels are as wide as its penumbra: more than the cap lets through.
  const auto counts = [](const char* words) {
    AxisAlignedModes m = modesOf(words);
    m.maxSamples = 4096;
    m.dilatePx = 16;
    const ShadowRun r = runModes(rampStage(0.05f), m);
    double sum = 0;
    for (const uint32_t n : r.term("shadow_sample_count")->plane<uint32_t>("n")) sum += n;
    return sum;
  };
  EXPECT_GT(counts("n=eq3.5"), 1.2 * counts("n=capped"));
}

/// Mean leak of a step across the middle column.
double leakOf(const TermPtr& g, const TermPtr& omega, const AxisAlignedFilterSettings& s) {
  const auto e = g->extent();
  const auto in = floatTerm(e, "V", [](int x, int, int) { return x < 32 ? 0.0f : 1.0f; });
  const auto out = runFilter(axisAligned(s), {in, g, omega});
  double sum = 0;
  for (size_t i = 0; i < e.elements(); ++i) sum += std::fabs(out->floats("V")[i] - in->floats("V")[i]);
  return sum / double(e.elements());
}
/// PlaneView with the half beyond the step lowered by `down` metres, or its normals turned by `angle`.
TermPtr steppedGBuffer(float down, float angle) {
  const PlaneView view;
  auto g = planeGBuffer(view);
  auto P = g->writable<float>("P"), N = g->writable<float>("N");
  for (size_t i = 0; i < size_t(view.width) * view.height; ++i)
    if (i % 64 >= 32) {
      P[3 * i + 2] -= down;
      N[3 * i] = std::sin(angle);
      N[3 * i + 2] = std::cos(angle);
    }
  return g;
}
TermPtr twoOmegas(float left, float right) {
  return floatTerm({64, 64, 1}, "Omega", [=](int x, int, int) { return x < 32 ? left : right; });
}

TEST(AxisAlignedModes, ReportComparesWidthsAlone) {
  AxisAlignedFilterSettings ours = axisAlignedSettings(32), report = ours;
  report.distance = ours.distance = AxisAlignedDistance::LightPlane;  // so that a step down is no step to the side
  report.thresholds = AxisAlignedThresholds::Report;
  const TermPtr even = twoOmegas(0.833f, 0.833f);
  EXPECT_EQ(leakOf(steppedGBuffer(3, 0), even, ours), 0.0);
  EXPECT_GT(leakOf(steppedGBuffer(3, 0), even, report), 0.02);
  EXPECT_EQ(leakOf(steppedGBuffer(0, 0.8f), even, ours), 0.0);
  EXPECT_GT(leakOf(steppedGBuffer(0, 0.8f), even, report), 0.02);
  report.betaThreshold = ours.betaThreshold = 0.5f;
  for (const auto& s : {ours, report}) {
    EXPECT_EQ(leakOf(steppedGBuffer(0, 0), twoOmegas(0.8f, 1.7f), s), 0.0);
    EXPECT_GT(leakOf(steppedGBuffer(0, 0), twoOmegas(0.8f, 1.5f), s), 0.02);
  }
}

TEST(AxisAlignedModes, CodeThresholdsAreAbsolute) {
  AxisAlignedFilterSettings s = axisAlignedSettings(32);
  s.distance = AxisAlignedDistance::LightPlane;
  s.thresholds = AxisAlignedThresholds::Code;
  const TermPtr flat = steppedGBuffer(0, 0);
  EXPECT_GT(leakOf(flat, twoOmegas(0.5f, 10.4f), s), 0.005);  // 21 times as wide, and 9.9 rad/m apart
  EXPECT_EQ(leakOf(flat, twoOmegas(0.5f, 10.6f), s), 0.0);
  const TermPtr even = twoOmegas(0.833f, 0.833f);
  EXPECT_GT(leakOf(steppedGBuffer(3.0f, 0), even, s), 0.02);  // 9 m^2 down: more than 6 beta, and less than 10 m^2
  EXPECT_EQ(leakOf(steppedGBuffer(3.2f, 0), even, s), 0.0);
  EXPECT_EQ(leakOf(steppedGBuffer(0, 0.4f), even, s), 0.0);
  EXPECT_GT(leakOf(steppedGBuffer(0, 0.3f), even, s), 0.02);
  // Holes stay holes where what is compared is not beta.
  auto hole = planeGBuffer(PlaneView{});
  auto id = hole->writable<uint32_t>("instance");
  for (size_t i = 0; i < 64 * 64; ++i)
    if (i % 64 >= 32) id[i] = ~0u;
  EXPECT_EQ(leakOf(hole, even, s), 0.0);
}

double differenceOf(const TermPtr& a, const TermPtr& b) {
  double worst = 0;
  for (size_t i = 0; i < a->extent().elements(); ++i) worst = std::max(worst, double(std::fabs(a->floats("V")[i] - b->floats("V")[i])));
  return worst;
}

TEST(AxisAlignedModes, DistancesAreThoseTheyName) {
  // A receiver tilted by 40 degrees and its pixels' places in the light's plane and along itself, on flat floors.
  PlaneView shadow, tilted, along;
  const float c = std::cos(0.7f);
  tilted.du = Vec3(0.1f, 0, 0.1f * std::tan(0.7f));
  tilted.normal = shadow.normal;  // as if flat: normals are not the subject
  along.du = Vec3(0.1f / c, 0, 0);
  const Extent e{64, 64, 1};
  const TermPtr noise = noiseTerm(e, "V", 31), omega = evenOmega(e, 1 / (3 * 0.2f));
  AxisAlignedFilterSettings s = axisAlignedSettings(20);
  s.light.centre = Vec3(3, 3, 10);  // near: lines to it are not upright
  const auto by = [&](AxisAlignedDistance d, const PlaneView& v) {
    s.distance = d;
    return runFilter(axisAligned(s), {noise, planeGBuffer(v), omega});
  };
  using D = AxisAlignedDistance;
  EXPECT_LT(differenceOf(by(D::LightPlane, tilted), by(D::LightPlane, shadow)), 1e-3);
  EXPECT_LT(differenceOf(by(D::World, tilted), by(D::World, along)), 1e-3);
  EXPECT_GT(differenceOf(by(D::World, tilted), by(D::LightPlane, tilted)), 0.02);
  EXPECT_GT(differenceOf(by(D::Line, tilted), by(D::LightPlane, tilted)), 0.02);
  EXPECT_GT(differenceOf(by(D::Line, tilted), by(D::World, tilted)), 0.02);
  EXPECT_LT(differenceOf(by(D::Line, shadow), by(D::LightPlane, shadow)), 1e-3) << "parallel to the light all are one";
  EXPECT_LT(differenceOf(by(D::World, shadow), by(D::LightPlane, shadow)), 1e-3);
}

TEST(AxisAlignedModes, EveryModeIsInTheKeys) {
  const auto digest = [](const std::function<void(AxisAlignedFilterSettings&)>& edit) {
    AxisAlignedFilterSettings s = axisAlignedSettings(12);
    edit(s);
    Hasher h;
    axisAligned(s)->hashParameters(h);
    return h.digest().hex();
  };
  std::vector<std::string> filters{digest([](auto&) {})};
  filters.push_back(digest([](auto& s) { s.distance = AxisAlignedDistance::LightPlane; }));
  filters.push_back(digest([](auto& s) { s.distance = AxisAlignedDistance::World; }));
  filters.push_back(digest([](auto& s) { s.thresholds = AxisAlignedThresholds::Report; }));
  filters.push_back(digest([](auto& s) { s.thresholds = AxisAlignedThresholds::Code; }));
  filters.push_back(digest([](auto& s) { s.cut = 2.0f; }));
  filters.push_back(digest([](auto& s) { s.cut = 2.5f; }));
  const auto sources = [](const char* words) {
    const ShadowRun r = runModes(rampStage(), modesOf(words), {4, 2, 1});
    std::string all;
    for (NodeId id = 0; id < r.graph.size(); ++id) {
      if (r.graph.at(id).node->type() == "gbuffer") continue;
      Hasher h;
      r.graph.at(id).node->hashParameters(h);
      all += r.graph.at(id).node->type() + h.digest().hex() + " ";
    }
    return all;
  };
  std::vector<std::string> plans;
  for (const char* words : {"", "beta=code", "n=eq3.5", "thresholds=report", "thresholds=code", "distance=light_plane", "distance=world", "filter=full2d",
                            "light=gaussian", "light=gaussian_truncated", "shade=centre"})
    plans.push_back(sources(words));
  for (const auto* list : {&filters, &plans})
    for (size_t i = 0; i < list->size(); ++i)
      for (size_t j = 0; j < i; ++j) EXPECT_NE((*list)[i], (*list)[j]) << i << " " << j;
  const std::string gaussian = sources("light=gaussian"), base = sources("");
  for (const char* node : {"shadow_slopes", "shadow_adaptive"})
    EXPECT_NE(gaussian.substr(gaussian.find(node), 48), base.substr(base.find(node), 48)) << node << ": of each source, not of what follows alone";
}

}  // namespace
}  // namespace gobo::test
