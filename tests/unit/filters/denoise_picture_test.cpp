// SPDX-License-Identifier: Apache-2.0
// What denoisers are given, and how one of several is chosen.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "filters/denoise/axis_aligned/axis_aligned.h"
#include "filters/denoise/denoise_node.h"
#include "filters/denoise/features.h"
#include "filters/denoise/noisy_picture.h"
#include "filters/denoise/select/select.h"
#include "filters/denoise/similar.h"
#include "noisy_pictures.h"
#include "terms/node.h"

namespace gobo {
namespace denoise_picture_test {

using tests::flatFeatures;
using tests::gaussian;
using tests::picture;

TermPtr run(const NodePtr& node, std::vector<TermPtr> inputs, int threads = 2) {
  const TaskArena arena(threads);
  RunContext c;
  c.inputs = std::move(inputs);
  c.arena = &arena;
  Result<TermPtr> r = runNode(*node, c);
  EXPECT_TRUE(r.ok()) << r.status().toString();
  return r.ok() ? *r : nullptr;
}

// Variance of the mean of n samples from unequal halves, against the known one, over 4000 pixels: the smoothed number is right in the mean to 3 %.
TEST(NoisyPicture, VarianceOfTheMeanFromHalvesOfAnyCounts) {
  const int width = 80, height = 50;
  for (const auto& [first, samples] : {std::pair<uint32_t, uint32_t>{1, 2}, {8, 16}, {32, 48}, {16, 64}}) {
    const double sigma = 0.3, n = samples, m = first;
    const auto part =
        picture(width, height, [&](int x, int y, int c) { return float(1 + sigma / std::sqrt(m) * gaussian(uint64_t(y * width + x), 7 + uint64_t(c))); });
    const auto half = part->floats("rgb");
    const auto whole = picture(width, height, [&](int x, int y, int c) {
      const double rest = 1 + sigma / std::sqrt(n - m) * gaussian(uint64_t(y * width + x), 70 + uint64_t(c));
      return float((m * half[size_t(3 * (y * width + x) + c)] + (n - m) * rest) / n);
    });
    const auto features = flatFeatures(width, height, 0.46f);  // and 0.04: light is twice the radiance
    const TermPtr noisy = run(denoise::makeNoisyPictureNode(width, height, samples, first), {features, part, whole});
    double mean = 0, least = 1e9, most = 0;
    for (const float v : noisy->floats("variance")) {
      mean += v;
      least = std::min(least, double(v));
      most = std::max(most, double(v));
    }
    const double expected = 4 * sigma * sigma / n;
    EXPECT_NEAR(mean / double(noisy->floats("variance").size()), expected, 0.03 * expected) << first << " of " << samples;
    EXPECT_GT(least, 0.2 * expected);
    EXPECT_LT(most, 4 * expected);
    for (size_t i = 0; i < half.size(); i += 997) {
      EXPECT_NEAR(noisy->floats("a")[i], 2 * half[i], 1e-5);
      EXPECT_NEAR(m * noisy->floats("a")[i] + (n - m) * noisy->floats("b")[i], n * noisy->floats("mean")[i], 1e-3);
    }
  }
}

// One sample a pixel: the scatter of like pixels. A step of light between two surfaces is not noise.
TEST(NoisyPicture, OneSampleHasTheVarianceOfLikePixels) {
  const int width = 40, height = 40;
  const auto features = flatFeatures(width, height, 0.96f);
  const auto normal = features->writable<float>("normal");
  for (int y = 0; y < height; ++y)
    for (int x = width / 2; x < width; ++x) {
      normal[size_t(3 * (y * width + x) + 2)] = 0;
      normal[size_t(3 * (y * width + x))] = 1;
    }
  const auto lit =
      picture(width, height, [&](int x, int y, int c) { return float((x < width / 2 ? 1 : 5) + 0.1 * gaussian(uint64_t(y * width + x), uint64_t(c))); });
  const TermPtr noisy = run(denoise::makeNoisyPictureNode(width, height, 1, 0), {features, lit});
  double mean = 0;
  for (const float v : noisy->floats("variance")) {
    EXPECT_LT(v, 0.05f);
    mean += v;
  }
  EXPECT_NEAR(mean / double(noisy->floats("variance").size()), 0.01, 0.001);
}

TEST(NoisyPicture, HugeAndEmptyStayFinite) {
  for (const auto& [width, height] : {std::pair{1, 1}, {3, 1}, {2, 5}}) {
    const auto features = flatFeatures(width, height, 0.0f);
    features->writable<float>("coverage")[0] = 0;
    features->writable<float>("footprint")[0] = 0;
    for (const float value : {0.0f, 3e38f, -3e38f, 1e-38f}) {
      const auto part = picture(width, height, [&](int x, int, int) { return x % 2 ? value : 0.0f; });
      const auto whole = picture(width, height, [&](int, int, int) { return value; });
      const TermPtr noisy = run(denoise::makeNoisyPictureNode(width, height, 16, 8), {features, part, whole});
      for (const char* plane : {"mean", "a", "b", "variance"})
        for (const float v : noisy->floats(plane)) EXPECT_TRUE(std::isfinite(v)) << plane << " of " << value;
    }
  }
}

// Means over view samples that hit; light is divided by albedo and 0.04 of what they cover.
TEST(DenoiseFeatures, AreMeansOfWhatIsHit) {
  auto seen = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{2, 1, 2}),
       surface = std::make_shared<Term>("surface", Domain::ViewSample, Extent{2, 1, 2});
  const auto place = seen->addPlane<float>("P", 3), depth = seen->addPlane<float>("depth"), footprint = seen->addPlane<float>("footprint");
  seen->addPlane<float>("N", 3);
  const auto albedo = surface->addPlane<float>("albedo", 3), normal = surface->addPlane<float>("N", 3);
  surface->addPlane<float>("material", 5), surface->addPlane<uint8_t>("flags");
  const float inf = std::numeric_limits<float>::infinity();
  // Pixel 0: one of two samples hits; pixel 1: none. Elements are layer by layer.
  depth[0] = 4, depth[1] = inf, depth[2] = inf, depth[3] = inf;
  place[2] = -4, footprint[0] = 0.5f, normal[2] = 1;
  for (size_t c = 0; c < 3; ++c) albedo[c] = 0.6f;
  const TermPtr f = run(denoise::makeFeaturesNode(2, 1, 2), {seen, surface});
  EXPECT_FLOAT_EQ(f->floats("albedo")[0], 0.3f);
  EXPECT_FLOAT_EQ(f->floats("normal")[2], 0.5f);
  EXPECT_FLOAT_EQ(f->floats("position")[2], -4.0f);
  EXPECT_FLOAT_EQ(f->floats("depth")[0], 4.0f);
  EXPECT_FLOAT_EQ(f->floats("footprint")[0], 0.5f);
  EXPECT_FLOAT_EQ(f->floats("coverage")[0], 0.5f);
  EXPECT_FLOAT_EQ(f->floats("modulation")[0], 0.32f);
  for (const char* plane : {"albedo", "normal", "position"}) EXPECT_EQ(f->floats(plane)[3], 0.0f) << plane;
  for (const char* plane : {"depth", "footprint", "coverage"}) EXPECT_EQ(f->floats(plane)[1], 0.0f) << plane;
  EXPECT_EQ(f->floats("modulation")[3], 1.0f);
}

TEST(Similar, KnowsPlanesNormalsAndAlbedo) {
  const auto t = flatFeatures(4, 1);
  const auto position = t->writable<float>("position"), normal = t->writable<float>("normal"), albedo = t->writable<float>("albedo");
  position[3 * 1 + 2] = 3;                         // off the plane by three pixels
  normal[3 * 2] = 0.6f, normal[3 * 2 + 2] = 0.8f;  // turned by 36.9 degrees
  position[3 * 2] = 0;                             // at the same place
  albedo[3 * 3 + 1] = 0.8f;
  const denoise::Features f = denoise::featuresOf(*t);
  EXPECT_EQ(denoise::similarity(f, 0, 0, {10, 10, 10}), 1.0f);
  EXPECT_NEAR(denoise::similarity(f, 0, 1, {0, 0, 0.1f}), std::exp(-0.1f * 9), 1e-6);
  EXPECT_NEAR(denoise::similarity(f, 0, 3, {2, 0, 0}), std::exp(-2 * 0.09f), 1e-6);
  position[3 * 2 + 1] = 0, position[3 * 2 + 2] = 0;
  EXPECT_NEAR(denoise::similarity(f, 0, 2, {0, 3, 0}), std::exp(-3 * 2 * 0.2f), 1e-5);
  for (const size_t p : {0, 2})  // mean normals of curved surfaces are shorter: their directions count
    for (size_t c = 0; c < 3; ++c) normal[3 * p + c] *= 0.5f;
  EXPECT_EQ(denoise::similarity(f, 0, 0, {0, 10, 0}), 1.0f);
  EXPECT_NEAR(denoise::similarity(f, 0, 2, {0, 3, 0}), std::exp(-3 * 2 * 0.2f), 1e-5);
  for (size_t p = 0; p < 4; ++p)
    for (size_t q = 0; q < 4; ++q) EXPECT_EQ(denoise::similarity(f, p, q, {1, 2, 3}), denoise::similarity(f, q, p, {1, 2, 3}));
  t->writable<float>("coverage")[1] = 0;
  EXPECT_EQ(denoise::similarity(f, 0, 1, {0, 0, 0}), 0.0f);  // the sky and a wall have nothing in common
}

/// A candidate: halves that are the truth plus a bias and noise of their own.
std::shared_ptr<Term> candidate(int width, int height, const std::function<double(int x)>& bias, double sigma, uint64_t seed) {
  auto t = std::make_shared<Term>("denoised", Domain::Pixel, Extent{width, height, 1});
  const auto rgb = t->addPlane<float>("rgb", 3), a = t->addPlane<float>("a", 3), b = t->addPlane<float>("b", 3);
  for (size_t i = 0; i < rgb.size(); ++i) {
    const double truth = 1 + bias(int(i / 3) % width);
    a[i] = float(truth + sigma * gaussian(i, seed));
    b[i] = float(truth + sigma * gaussian(i, seed + 1));
    rgb[i] = 0.5f * (a[i] + b[i]);
  }
  return t;
}

/// The noisy picture as a term, with the variance of its mean.
std::shared_ptr<Term> noisyTerm(int width, int height, double sigma) {
  const auto c = candidate(
      width, height, [](int) { return 0.0; }, sigma, 100);
  auto t = std::make_shared<Term>("noisy_picture", Domain::Pixel, Extent{width, height, 1});
  for (const auto& [to, from] : {std::pair{"mean", "rgb"}, {"a", "a"}, {"b", "b"}})
    std::copy_n(c->floats(from).begin(), c->floats(from).size(), t->addPlane<float>(to, 3).begin());
  for (float& v : t->addPlane<float>("variance", 3)) v = float(sigma * sigma / 2);
  return t;
}

double choiceOf(const Term& t, int which, int x0, int x1) {
  const auto choice = t.floats("choice");
  const size_t planes = size_t(t.channels("choice"));
  double sum = 0;
  int count = 0;
  for (size_t p = 0; p < choice.size() / planes; ++p)
    if (const int x = int(p) % t.extent().width; x >= x0 && x < x1) {
      sum += choice[planes * p + size_t(which)];
      ++count;
    }
  return sum / count;
}

// A filter that knows nothing of the light of single pixels runs on the mean alone, but where a choice is made by its halves: each has to be its own then.
TEST(DenoiseNode, HalvesAreFilteredWhereTheyAreJudged) {
  const int width = 12, height = 8;
  v1::AxisAlignedDenoise settings;  // without curvature light stays as it is
  settings.set_radius_px(4);
  const auto filter = denoise::makeAxisAligned(settings);
  ASSERT_FALSE(filter->looksAtHalves());
  const auto features = flatFeatures(width, height), noisy = noisyTerm(width, height, 0.5);
  const auto judged = denoise::makeDenoiseNode(filter, width, height, 4, 2, true), alone = denoise::makeDenoiseNode(filter, width, height, 4, 2, false);
  const TermPtr apart = run(judged, {features, noisy}), mean = run(alone, {features, noisy});
  const auto same = [](std::span<const float> x, std::span<const float> y) { return std::equal(x.begin(), x.end(), y.begin(), y.end()); };
  EXPECT_TRUE(same(apart->floats("a"), noisy->floats("a")));
  EXPECT_TRUE(same(apart->floats("b"), noisy->floats("b")));
  EXPECT_TRUE(same(mean->floats("a"), noisy->floats("mean")));
  EXPECT_TRUE(same(mean->floats("b"), noisy->floats("mean")));
  Hasher h, g;
  judged->hashParameters(h);
  alone->hashParameters(g);
  EXPECT_NE(h.digest(), g.digest());
}

// A smooth filter that is wrong by a step on the right half, a weaker one that is right everywhere: each is chosen where it errs less, and the noisy
// picture where both are wrong.
TEST(Select, TakesWhatErrsLeast) {
  const int width = 120, height = 60;
  const auto noisy = noisyTerm(width, height, 0.2);  // of a half; 0.14 of the mean
  const auto smooth = candidate(
      width, height, [](int x) { return x < 60   ? 0.0
                                        : x < 90 ? 0.15
                                                 : 0.3; }, 0.01, 1);
  const auto weak = candidate(
      width, height, [](int x) { return x < 90 ? 0.0 : 0.4; }, 0.1, 3);
  const TermPtr out = run(denoise::makeSelectNode(width, height, 2, 0.5f), {noisy, smooth, weak});
  EXPECT_GT(choiceOf(*out, 1, 0, 50), 0.95);
  EXPECT_GT(choiceOf(*out, 2, 68, 82), 0.9);
  EXPECT_GT(choiceOf(*out, 0, 98, 120), 0.9);
  const auto rgb = out->floats("rgb");
  for (size_t i = 0; i < rgb.size(); ++i) {
    const float lo = std::min({noisy->floats("mean")[i], smooth->floats("rgb")[i], weak->floats("rgb")[i]});
    const float hi = std::max({noisy->floats("mean")[i], smooth->floats("rgb")[i], weak->floats("rgb")[i]});
    EXPECT_GE(rgb[i], lo - 1e-5f);
    EXPECT_LE(rgb[i], hi + 1e-5f);
  }
}

// The error of the mean of both halves counts, not that of one: a filter with little bias and much noise of its own loses less by it.
TEST(Select, JudgesTheMeanOfBothHalves) {
  const int width = 100, height = 100;
  const auto noisy = noisyTerm(width, height, 0.5);
  const auto biased = candidate(
      width, height, [](int) { return 0.085; }, 0.0, 1);  // error 0.085 of a half and of the mean
  const auto spread = candidate(
      width, height, [](int) { return 0.0; }, 0.1, 3);  // 0.1 of a half, 0.071 of the mean
  const TermPtr out = run(denoise::makeSelectNode(width, height, 2, 0.5f), {noisy, biased, spread});
  EXPECT_GT(choiceOf(*out, 2, 0, width), 0.6);
}

// Pixels that a kind of light never reaches, metal under diffuse light, know nothing of filters: that one spills a thousandth of its neighbours' light into
// them must not keep the noise of all pixels around.
TEST(Select, PixelsWithoutLightDoNotDecideForOthers) {
  const int width = 90, height = 40;
  const auto noisy = noisyTerm(width, height, 0.5);
  const auto good = candidate(
      width, height, [](int) { return 0.0; }, 0.05, 1);
  for (const char* plane : {"mean", "a", "b", "variance"}) {
    const auto values = noisy->writable<float>(plane);
    for (size_t i = 0; i < values.size(); ++i)
      if (int(i / 3) % width % 3 == 0) values[i] = 0.0f;
  }
  for (const char* plane : {"rgb", "a", "b"}) {
    const auto values = good->writable<float>(plane);
    for (size_t i = 0; i < values.size(); ++i)
      if (int(i / 3) % width % 3 == 0) values[i] = 1e-3f;
  }
  const TermPtr out = run(denoise::makeSelectNode(width, height, 1, 0.5f), {noisy, good});
  EXPECT_GT(choiceOf(*out, 1, 0, width), 0.95);
}

TEST(Select, OfPartsThatAreNoLongerThanTheirWindows) {
  for (const auto& [width, height] : {std::pair{1, 1}, {2, 3}, {7, 2}}) {
    const auto noisy = noisyTerm(width, height, 0.2);
    const auto other = candidate(
        width, height, [](int) { return 1e18; }, 0.0, 1);
    const TermPtr out = run(denoise::makeSelectNode(width, height, 1, 0.5f), {noisy, other});
    for (size_t i = 0; i < out->floats("rgb").size(); ++i) EXPECT_NEAR(out->floats("rgb")[i], noisy->floats("mean")[i], 1e-5f);
  }
}

}  // namespace denoise_picture_test
}  // namespace gobo
