// SPDX-License-Identifier: Apache-2.0
// integrator.sampler in requests: other numbers, the same pictures; the same bits however a render is divided.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "support/engines.h"
#include "support/thorough.h"

namespace gobo::testing {
namespace {

const char* const kSamplers[] = {"SOBOL", "HALTON", "INDEPENDENT"};

v1::RenderRequest requestOf(const std::string& scene, const char* sampler, int width, int height, int spp) {
  v1::RenderRequest r = smallRequest(scene, width, height, spp);
  set(r, std::string("integrator.sampler=") + sampler);
  return r;
}

/// Mean over the picture and the root of the mean squared difference from another one.
struct Difference {
  double mean[3] = {}, rms = 0;
};
Difference differenceOf(const Image& a, const Image& b) {
  Difference d;
  for (size_t i = 0; i < a.data.size(); ++i) {
    const double x = double(a.data[i]) - double(b.data[i]);
    d.mean[i % 3] += 3 * x / double(a.data.size());
    d.rms += x * x / double(a.data.size());
  }
  d.rms = std::sqrt(d.rms);
  return d;
}

TEST(SamplerRequests, EverySamplerHasTheMeanOfTheReference) {
  const auto engine = makeEngine();
  for (const char* scene : {"cornell", "fence", "lights8", "spheres"}) {
    if (!thorough() && (*scene == 'c' || *scene == 'f')) continue;  // lamps of every kind, and an environment with rare paths, stay
    SCOPED_TRACE(scene);
    v1::RenderRequest truth = smallRequest(scene, 24, 16, 1024);
    truth.set_seed(91);
    const Image reference = mustRender(*engine, truth).images[0].image();
    double light = 0;
    for (const float v : reference.data) light += double(v) / double(reference.data.size());
    double rms[3];
    for (int k = 0; k < 3; ++k) {
      const Difference d = differenceOf(mustRender(*engine, requestOf(scene, kSamplers[k], 24, 16, 256)).images[0].image(), reference);
      rms[k] = d.rms;
      // The mean of 384 pixels, whose errors are independent, with the reference's quarter of the variance.
      for (const double c : d.mean) EXPECT_NEAR(c, 0.0, 4.5 * d.rms * std::sqrt(1.25 * 3 / 384) + 1e-4 * light) << kSamplers[k];
    }
    std::printf("  %s: RMSE of Sobol %.5f, Halton %.5f, independent %.5f, mean %.4f\n", scene, rms[0], rms[1], rms[2], light);
    if (std::string(scene) == "spheres") continue;  // rare paths decide
    EXPECT_LT(rms[0], 0.95 * rms[2]);
    EXPECT_LT(rms[1], 0.95 * rms[2]);
  }
}

TEST(SamplerRequests, HaveTheSameBitsHoweverARenderIsDivided) {
  for (const char* sampler : {"HALTON", "INDEPENDENT"}) {
    SCOPED_TRACE(sampler);
    v1::RenderRequest r = requestOf("cornell", sampler, 21, 13, 48);
    set(r, "outputs=beauty,direct,indirect");
    const RenderResult whole = mustRender(*makeEngine(), r);
    EXPECT_EQ(firstDifference(whole, mustRender(*makeEngine(256ull << 20, {}, 1), r)), "") << "one thread";
    EXPECT_EQ(firstDifference(whole, mustRender(*makeEngine(256ull << 20, {}, 5), r)), "") << "five threads";

    const auto steps = makeEngine();
    for (const int spp : {1, 3, 16, 32}) {
      v1::RenderRequest fewer = r;
      fewer.mutable_halt()->set_spp(spp);
      (void)mustRender(*steps, fewer);
    }
    const RenderResult extended = mustRender(*steps, r);
    EXPECT_NE(nodesBy(extended, v1::NodeReport::RUN).at("path_trace").reason().find("extended from 32 samples"), std::string::npos);
    EXPECT_EQ(firstDifference(whole, extended), "") << "gone on with";

    v1::RenderRequest part = r;
    for (const char* a : {"window.x=5", "window.y=2", "window.width=9", "window.height=10"}) set(part, a);
    const RenderResult window = mustRender(*makeEngine(), part);
    for (size_t k = 0; k < whole.images.size(); ++k)
      for (int y = 0; y < 10; ++y)
        for (int x = 0; x < 9; ++x)
          ASSERT_EQ(std::memcmp(whole.images[k].image().at(x + 5, y + 2), window.images[k].image().at(x, y), 3 * sizeof(float)), 0) << x << "," << y;
  }
}

TEST(SamplerRequests, AreOtherNumbersUnderKeysOfTheirOwn) {
  const auto engine = makeEngine();
  std::vector<RenderResult> all;
  for (const char* sampler : kSamplers) {
    all.push_back(mustRender(*engine, requestOf("cornell", sampler, 16, 12, 8)));
    EXPECT_EQ(nodesBy(all.back(), v1::NodeReport::RUN).count("path_trace"), 1u) << sampler;
    for (size_t k = 0; k + 1 < all.size(); ++k) EXPECT_NE(firstDifference(all[k], all.back()), "") << sampler;
  }
  EXPECT_EQ(firstDifference(all[0], mustRender(*engine, smallRequest("cornell", 16, 12, 8))), "");
}

/// What the camera sees of the map goes by the samples that the map came by: a background of its colour leaves the picture as it is, edges too.
TEST(SamplerRequests, BackgroundsTakeTheSamplersNumbers) {
  for (const char* sampler : kSamplers) {
    const auto engine = makeEngine();
    v1::RenderRequest r = requestOf("spheres", sampler, 24, 16, 8);
    set(r, "environment.constant=0.5,0.6,0.7");
    const Image plain = mustRender(*engine, r).images[0].image();
    set(r, "environment.background=COLOR");
    set(r, "environment.background_color=0.5,0.6,0.7");
    const Image shown = mustRender(*engine, r).images[0].image();
    ASSERT_EQ(plain.data.size(), shown.data.size());
    for (size_t i = 0; i < plain.data.size(); ++i) ASSERT_NEAR(plain.data[i], shown.data[i], 2e-5 * (1.0 + plain.data[i])) << sampler << " " << i;
  }
}

/// Samples that outliers are rejected of are the picture's own.
TEST(SamplerRequests, SamplesOneByOneAreThePicture) {
  for (const char* sampler : kSamplers) {
    const auto engine = makeEngine();
    v1::RenderRequest r = requestOf("cornell", sampler, 16, 12, 16);
    const Image plain = mustRender(*engine, r).images[0].image();
    set(r, "denoise.outliers.trimmed.share=0");
    const Image samples = mustRender(*engine, r).images[0].image();
    ASSERT_EQ(plain.data.size(), samples.data.size());
    for (size_t i = 0; i < plain.data.size(); ++i) ASSERT_NEAR(samples.data[i], plain.data[i], 1e-5 * (1.0 + plain.data[i])) << sampler << " " << i;
  }
}

}  // namespace
}  // namespace gobo::testing
