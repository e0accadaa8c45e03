// SPDX-License-Identifier: Apache-2.0
// Light from a ceiling whose reflectance is a wave, on a floor one metre below: a wave of Omega rad/m arrives with Omega z K_1(Omega z) of its contrast, the
// transfer function of the kernel z^2 / (pi (z^2 + r^2)^2). The oracle of indirect light and of its axis-aligned filter (Wang, UCB/EECS-2013-118, chapter 4).
#include <gtest/gtest.h>

#include <cmath>

#include "scene/builtin/build.h"
#include "support/engines.h"
#include "support/thorough.h"

namespace gobo::indirect_modulation_test {
namespace {

constexpr float kReach = 80.0f;  // of the ceiling: what lies beyond brings 2e-4

/// A low sun lights the ceiling from below; the shadow of the floor, 4 m wide, lies some 20 m away.
ScenePtr planes(double omega) {
  builtin::SceneBuilder b("planes");
  const int white = b.material("white", Vec3(0.8f)), wave = b.material("wave", Vec3(1.0f));
  b.at(wave).albedo.texture =
      b.texture("wave", 512, 1, false, [](float u, float) { return Vec4(Vec3(float(0.5 + 0.5 * std::cos(2 * M_PI * double(u)))), 1.0f); });
  builtin::MeshBuilder m;
  m.quad(Vec3(-2, 0, 2), Vec3(4, 0, 0), Vec3(0, 0, -4));
  b.add("floor", m, white);
  const float periods = std::floor(float(2 * kReach * omega / (2 * M_PI)) / 2.0f) * 2.0f, reach = float(M_PI * periods / omega);
  m.quad(Vec3(-reach, 1, -reach), Vec3(2 * reach, 0, 0), Vec3(0, 0, 2 * reach), 1, 1, Vec2(periods, 1));
  b.add("ceiling", m, wave);
  b.sun("low", Vec3(0.2f, -0.05f, 1.0f), Vec3(100.0f));
  b.camera("down", Vec3(0, 0.95f, 0), Vec3(0, 0, -1e-4f), 90.0f);
  auto scene = b.finish();
  EXPECT_TRUE(scene.ok()) << scene.status().toString();
  return *scene;
}

/// Least-squares contrast of a picture of 1 + contrast cos(omega x) times a known mean; `noise`: RMS of what is neither. Without the margin, where filters see
/// one side only.
constexpr int kMargin = 24;
struct Wave {
  double contrast = 0, noise = 0;
};
Wave waveOf(const Image& image, double omega, double mean) {
  double sum = 0, squares = 0, rest = 0;
  const auto column = [&](int x) {
    const double half = 0.95 * (double(image.width) / image.height), at = (2 * (x + 0.5) / image.width - 1) * half;
    return std::cos(omega * at);
  };
  for (int y = kMargin; y < image.height - kMargin; ++y)
    for (int x = kMargin; x < image.width - kMargin; ++x) {
      const double c = column(x), v = image.data[size_t(3 * (y * image.width + x))] / mean - 1;
      sum += v * c;
      squares += c * c;
    }
  const double contrast = sum / squares;
  for (int y = kMargin; y < image.height - kMargin; ++y)
    for (int x = kMargin; x < image.width - kMargin; ++x) rest += std::pow(image.data[size_t(3 * (y * image.width + x))] / mean - 1 - contrast * column(x), 2);
  return {contrast, std::sqrt(rest / (double(image.width - 2 * kMargin) * (image.height - 2 * kMargin)))};
}

TEST(IndirectModulation, AWaveArrivesByItsTransferFunctionTracedAndFiltered) {
  for (const double omega : {0.5, 1.0, 2.0}) {
    if (omega == 1.0 && !testing::thorough()) continue;  // lies between the others
    const auto engine = testing::makeEngine();
    RenderControl control;
    control.scene = planes(omega);
    v1::RenderRequest r = testing::smallRequest("planes", 128, 88, 256);
    for (const char* e : {"outputs=indirect", "integrator.max_bounces=1"}) testing::set(r, e);
    const auto traced = engine->render(r, control);
    ASSERT_TRUE(traced.ok()) << traced.status().toString();
    const double sine = 0.05 / std::sqrt(0.2 * 0.2 + 0.05 * 0.05 + 1.0), mean = 0.8 * 0.5 * 100.0 * sine / M_PI,
                 expected = omega * std::cyl_bessel_k(1.0, omega);
    const Wave plain = waveOf(traced->images.at(0).image(), omega, mean);
    EXPECT_NEAR(plain.contrast, expected, 0.005 * expected) << omega;
    // Filtered, the wave loses by the width of least error: less than the noise that goes, and with 16 times the samples about 16^(-1/3) of it.
    double lost[2];
    for (const int k : {0, 1}) {
      r.clear_denoise();
      r.mutable_halt()->set_spp(k == 0 ? 16 : 256);
      const Wave noisy = k == 1 ? plain : waveOf(engine->render(r, control)->images.at(0).image(), omega, mean);  // of 256 samples there is one already
      testing::set(r, "denoise=axis_aligned");
      const auto smooth = engine->render(r, control);
      ASSERT_TRUE(smooth.ok()) << smooth.status().toString();
      const Wave filtered = waveOf(smooth->images.at(0).image(), omega, mean);
      lost[k] = std::abs(filtered.contrast - expected);
      EXPECT_LT(lost[k], 0.75 * noisy.noise) << omega;
      EXPECT_LT(filtered.noise, 0.4 * noisy.noise) << omega;
    }
    EXPECT_LT(lost[1], 0.6 * lost[0] + 0.003) << omega;
  }
}

}  // namespace
}  // namespace gobo::indirect_modulation_test
