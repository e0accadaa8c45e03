// SPDX-License-Identifier: Apache-2.0
// Encode and lookup give the same visibility on the cpu and on the Vulkan and EGL devices (lavapipe, llvmpipe in CI), within 1e-4.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "device/egl/egl_device.h"
#include "device/vulkan/vulkan_device.h"
#include "unit/filters/shadow_map_cases.h"

namespace {

using namespace gobo;
using namespace gobo::shadowtest;

double worstDifference(const TermPtr& a, const TermPtr& b, const char* plane, bool relative) {
  const auto x = a->floats(plane), y = b->floats(plane);
  EXPECT_EQ(x.size(), y.size());
  double worst = 0;
  for (size_t i = 0; i < x.size(); ++i) {
    EXPECT_TRUE(std::isfinite(x[i]) && std::isfinite(y[i]));
    worst = std::max(worst, std::fabs(double(x[i]) - double(y[i])) / (relative ? double(x[i]) : 1.0));
  }
  return worst;
}

enum class Kind { Vulkan, Egl };

class ExponentialShadowDevices : public testing::TestWithParam<Kind> {
 protected:
  template <typename T>
  static ComputeDevicePtr made(const Result<std::shared_ptr<T>>& device) {
    EXPECT_TRUE(device.ok()) << device.status().toString();
    return device.ok() ? ComputeDevicePtr(*device) : nullptr;
  }
  static ComputeDevicePtr device() { return GetParam() == Kind::Vulkan ? made(VulkanDevice::shared()) : made(EglDevice::shared()); }
};

INSTANTIATE_TEST_SUITE_P(All, ExponentialShadowDevices, testing::Values(Kind::Vulkan, Kind::Egl),
                         [](const auto& info) { return info.param == Kind::Vulkan ? "Vulkan" : "Egl"; });

TEST_P(ExponentialShadowDevices, AgreesWithTheCpu) {
  const ComputeDevicePtr device = this->device();
  ASSERT_TRUE(device);
  // A perspective and an orthographic light over bumpy depth with hard steps and damaged texels; receivers in and out of the map.
  LightShape spot;
  spot.kind = LightKind::Spot;
  spot.position = Vec3(0.3f, 4.0f, 0.2f);
  spot.axis = glm::normalize(Vec3(0.1f, -1.0f, 0.05f));
  spot.cosOuter = std::cos(0.6f);
  LightShape sun;
  sun.kind = LightKind::Directional;
  sun.axis = glm::normalize(Vec3(-0.3f, -1.0f, 0.2f));
  std::vector<Vec3> points;
  for (int i = 0; i < 60000; ++i) points.push_back(Vec3(random01(1, i), random01(2, i), random01(3, i)) * 5.0f - Vec3(2.5f, 2.0f, 2.5f));
  points[17].x = std::numeric_limits<float>::quiet_NaN();
  points[18].z = std::numeric_limits<float>::infinity();
  const TermPtr g = receivers(points);
  double worstE = 0, worstV = 0;
  uint32_t penumbra = 0;
  for (const LightShape& light : {spot, sun})
    for (const auto& [size, blur, c] : {std::tuple{64, 2, 60.0f}, {256, 5, 80.0f}, {33, 40, 80.0f}, {100, 0, 20.0f}, {1, 3, 60.0f}}) {
      auto frame = fitLightFrame(light, Vec3(-2, -1, -2), Vec3(2, 1, 2), size, blur + 1);
      ASSERT_TRUE(frame.ok()) << frame.status().toString();
      const int n = size;
      const TermPtr depth = depthMap(n, n, [&](int x, int y) {
        if (x == n / 3 && y == n / 2) return std::numeric_limits<float>::quiet_NaN();
        const float wave = 0.5f + 0.3f * std::sin(9.0f * float(x) / float(n)) * std::cos(7.0f * float(y) / float(n));
        return random01(9, uint64_t(y / 4 * 100 + x / 4)) < 0.2f ? 1.0f : wave + 0.02f * random01(10, uint64_t(y * 999 + x));
      });
      const TermPtr a = encode(depth, c, blur), b = encode(depth, c, blur, 2, device);
      ASSERT_TRUE(a && b);
      worstE = std::max(worstE, worstDifference(a, b, "B", true));
      const ExponentialCase l{*frame, c, 0.001f};
      const TermPtr V = lookup(g, a, l), W = lookup(g, b, l, 2, device);
      ASSERT_TRUE(V && W);
      worstV = std::max(worstV, worstDifference(V, W, "V", false));
      for (float v : V->floats("V")) penumbra += v > 0.05f && v < 0.95f;
    }
  std::cout << "device: " << device->name() << "; cpu against " << device->kind() << ": E relative " << worstE << ", V " << worstV << "; partly lit receivers "
            << penumbra << std::endl;
  EXPECT_GT(penumbra, 10000u);  // the comparison covers more than 0 and 1
  EXPECT_LE(worstE, 1e-5);
  EXPECT_LE(worstV, 1e-4);
}

TEST_P(ExponentialShadowDevices, HasItsOwnKeys) {
  const ComputeDevicePtr device = this->device();
  ASSERT_TRUE(device);
  const ShadowBasisPtr basis = makeExponentialBasis(60, false);
  const NodePtr cpu = makeShadowEncodeNode(basis, 2, 64, 1, false), gpu = makeShadowEncodeNode(basis, 2, 64, 1, false, device);
  EXPECT_NE(cpu->numericClass(), gpu->numericClass());
  EXPECT_EQ(cpu->device(), "cpu");
  EXPECT_EQ(gpu->device(), std::string(device->kind()) + ": " + device->name());
}

TEST(ExponentialShadowDeviceKeys, VulkanAndEglDiffer) {
  const auto vulkan = VulkanDevice::shared();
  const auto egl = EglDevice::shared();
  ASSERT_TRUE(vulkan.ok() && egl.ok());
  EXPECT_NE((*vulkan)->numericClass(), (*egl)->numericClass());
}

TEST_P(ExponentialShadowDevices, DegenerateMaps) {
  const ComputeDevicePtr device = this->device();
  ASSERT_TRUE(device);
  const TermPtr g = receivers({{0.5f, 0.5f, 0.9f}, {-0.5f, 0.5f, 0.9f}});
  const ExponentialCase l{unitFrame(), 60.0f, 0.0f};
  const TermPtr one = lookup(g, encode(depthMap(1, 1, [](int, int) { return 0.2f; }), 60.0f, 64, 2, device), l, 2, device);
  EXPECT_NEAR(one->floats("V")[0], std::exp(-60.0 * 0.7), 1e-6);
  EXPECT_EQ(one->floats("V")[1], 1.0f);
  const TermPtr none = lookup(g, encode(depthMap(0, 0, [](int, int) { return 0.0f; }), 60.0f, 2, 2, device), l, 2, device);
  EXPECT_EQ(none->floats("V")[0], 1.0f);
}

}  // namespace
