// SPDX-License-Identifier: Apache-2.0
// Windows of harmonics: flux stays, damping falls with the band, and the least one leaves nothing below 0 where less would.
#include "techniques/transfer/published/windows.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/icosphere.h"

namespace gobo::transfer::published::windows_test {
namespace {

constexpr int kLevel = 5;

/// A sky of radiance 1 and a point-like sun of as much flux, which harmonics ring most about (digest of seed 004, B6).
std::vector<double> sunOf(int bands, const DVec3& sun) {
  std::vector<double> Y(size_t(bands * bands)), out;
  harmonics(sun, bands, Y.data());
  for (size_t h = 0; h < Y.size(); ++h)
    for (const double colour : {1.0, 0.7, 0.2}) out.push_back(colour * 4 * std::numbers::pi * Y[h] + (h == 0 ? std::sqrt(4 * std::numbers::pi) : 0.0));
  return out;
}
double least(const std::vector<double>& coefficients, int bands) {
  double out = 1e300;
  for (const DVec3& v : radianceAtVertices(coefficients, bands, kLevel)) out = std::min({out, v.x, v.y, v.z});
  return out;
}

TEST(PublishedWindows, KeepFluxAndDampHigherBandsMore) {
  for (const Window window : {Window::None, Window::Hann, Window::Lanczos, Window::Least})
    for (int bands = 1; bands <= kMaxBands; ++bands) {
      const std::vector<double> w = windowFactors(window, bands, 0.01);
      ASSERT_EQ(w.size(), size_t(bands));
      EXPECT_EQ(w[0], 1.0);
      for (size_t l = 1; l < w.size(); ++l) {
        EXPECT_GT(w[l], 0.0);
        EXPECT_TRUE(window == Window::None ? w[l] == 1.0 : w[l] < w[l - 1]) << l;
      }
    }
  const std::vector<double> hann = windowFactors(Window::Hann, 4), lanczos = windowFactors(Window::Lanczos, 4), soft = windowFactors(Window::Least, 4, 0.25);
  EXPECT_NEAR(hann[2], 0.5, 1e-15);
  EXPECT_NEAR(hann[1], 0.5 + std::sqrt(0.125), 1e-15);
  EXPECT_NEAR(lanczos[2], 2 / std::numbers::pi, 1e-15);
  EXPECT_NEAR(soft[1], 0.5, 1e-15);  // 1 / (1 + 0.25 * 1 * 4)
  EXPECT_NEAR(soft[2], 0.1, 1e-15);  // 1 / (1 + 0.25 * 4 * 9)
}

// A window is the convolution with a round kernel, so it commutes with the direction: a lobe's factors about its own axis, wherever that is.
TEST(PublishedWindows, ScaleEveryHarmonicOfABandAlike) {
  const DVec3 a = glm::normalize(DVec3(0.3, -0.5, 0.81)), b = glm::normalize(DVec3(-0.7, 0.2, 0.4));
  for (int bands = 1; bands <= kMaxBands; ++bands) {
    const std::vector<double> w = windowFactors(Window::Lanczos, bands);
    double expected = 1;  // of the sky; addition theorem: sum over m of Y(a) Y(b) = (2 l + 1) / (4 pi) P_l(a b)
    for (int l = 0; l < bands; ++l) expected += w[size_t(l)] * (2 * l + 1) * std::legendre(unsigned(l), glm::dot(a, b));
    EXPECT_NEAR(radianceOf(windowed(sunOf(bands, a), w), bands, b).x, expected, 1e-11) << bands;
  }
}

TEST(PublishedWindows, TheLeastDampingLeavesNothingNegative) {
  for (const DVec3& sun : {DVec3(0, 1, 0), glm::normalize(DVec3(1, 1, 1)), glm::normalize(DVec3(-0.2, 0.5, 0.7))})
    for (int bands = 1; bands <= kMaxBands; ++bands) {
      const std::vector<double> c = sunOf(bands, sun);
      const double s = leastDamping(c, bands, kLevel);
      const std::vector<double> damped = windowed(c, windowFactors(Window::Least, bands, s));
      EXPECT_GE(least(damped, bands), -1e-8) << bands;
      for (size_t k = 0; k < 3; ++k) EXPECT_EQ(damped[k], c[k]);
      if (least(c, bands) >= 0) {
        EXPECT_EQ(s, 0.0);
      } else {
        EXPECT_GT(s, 0.0);
        EXPECT_LT(least(windowed(c, windowFactors(Window::Least, bands, 0.99 * s)), bands), 0.0) << bands;  // less will not do
      }
      if (bands >= 3) {  // digest: -0.8 of three bands, -3 of four, -5 of six
        EXPECT_LT(least(c, bands), -0.5) << bands;
      }
      if (bands == 3 || bands == 4 || bands == 6) {  // digest
        EXPECT_NEAR(least(windowed(c, windowFactors(Window::Hann, bands)), bands), 0.6, 0.2) << bands;
      }
    }
}

TEST(PublishedWindows, OfWhatIsNotBelowZeroIsNone) {
  std::vector<double> c(75, 0.0);
  EXPECT_EQ(leastDamping(c, 5, kLevel), 0.0);  // black
  c[0] = c[1] = c[2] = 3.5;
  EXPECT_EQ(leastDamping(c, 5, kLevel), 0.0);
  c[3 * 2] = 1.9;  // 3.5 Y_0 + 1.9 Y_10: sqrt(3) 1.9 < 3.5
  EXPECT_EQ(leastDamping(c, 5, kLevel), 0.0);
  c[3 * 2] = 4.0;  // closed form: 4 sqrt(3) / (1 + 4 s) = 3.5, where a vertex is at the pole or near it
  EXPECT_NEAR(leastDamping(c, 5, kLevel), (4 * std::sqrt(3.0) / 3.5 - 1) / 4, 2e-3);
  c[0] = -1;  // a mean below 0: no window helps
  EXPECT_EQ(leastDamping(c, 5, kLevel), 1e9);
}

}  // namespace
}  // namespace gobo::transfer::published::windows_test
