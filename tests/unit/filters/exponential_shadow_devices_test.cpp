// SPDX-License-Identifier: Apache-2.0
// Encode and lookup give the same visibility on the cpu and on the Vulkan and EGL devices (lavapipe, llvmpipe in CI), within 1e-4.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "device/egl/egl_device.h"
#include "device/vulkan/vulkan_device.h"
#include "filters/resident_planes.h"
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

class ExponentialShadowDevices : public ::testing::TestWithParam<Kind> {
 protected:
  template <typename T>
  static ComputeDevicePtr made(const Result<std::shared_ptr<T>>& device) {
    EXPECT_TRUE(device.ok()) << device.status().toString();
    return device.ok() ? ComputeDevicePtr(*device) : nullptr;
  }
  static ComputeDevicePtr device() { return GetParam() == Kind::Vulkan ? made(VulkanDevice::shared()) : made(EglDevice::shared()); }
};

INSTANTIATE_TEST_SUITE_P(All, ExponentialShadowDevices, ::testing::Values(Kind::Vulkan, Kind::Egl),
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

std::vector<float> downloaded(ComputeDevice& device, const ComputeBufferPtr& buffer, size_t count) {
  std::vector<float> out(count);
  EXPECT_TRUE(device.download(*buffer, out.data(), count * sizeof(float)).ok());
  return out;
}

std::shared_ptr<Term> numbered(int count, float from) {
  const auto term = std::make_shared<Term>("t", Domain::ViewSample, Extent{count, 1, 1});
  const auto v = term->addPlane<float>("v", 3);
  for (size_t i = 0; i < v.size(); ++i) v[i] = from + float(i);
  return term;
}

TEST_P(ExponentialShadowDevices, AChainOfKernelsUploadsWhatItDoesNotHave) {
  const ComputeDevicePtr device = this->device();
  ASSERT_TRUE(device);
  ResidentPlanes& on = ResidentPlanes::of(device);
  on.clear();
  std::vector<Vec3> points;
  for (int i = 0; i < 5000; ++i) points.push_back(Vec3(random01(1, i), random01(2, i), random01(3, i)));
  const TermPtr g = receivers(points);
  const auto depth = [&](float z) { return depthMap(64, 64, [&](int x, int y) { return z + 0.1f * random01(4, uint64_t(y * 64 + x)); }); };
  const TermPtr first = depth(0.3f), second = depth(0.5f);
  const ExponentialCase l{unitFrame(), 60.0f, 0.001f};
  const uint64_t begin = on.uploaded();
  const TermPtr map = encode(first, 60.0f, 2, 2, device);
  EXPECT_EQ(on.uploaded() - begin, 64u * 64 * 4) << "the depth map";
  const TermPtr V = lookup(g, map, l, 2, device);
  EXPECT_EQ(on.uploaded() - begin, 64u * 64 * 4 + 5000 * 16) << "places and ids; the encoded map was there";
  const TermPtr softer = encode(first, 40.0f, 4, 2, device);
  EXPECT_EQ(on.uploaded() - begin, 64u * 64 * 4 + 5000 * 16) << "other exponents of the same depth";
  const TermPtr moved = lookup(g, encode(second, 60.0f, 2, 2, device), l, 2, device);
  EXPECT_EQ(on.uploaded() - begin, 2 * 64u * 64 * 4 + 5000 * 16) << "a light that moved: its depth alone";
  // Bits do not depend on what was there.
  const auto same = [](const TermPtr& a, const TermPtr& b, const char* plane) { return std::ranges::equal(a->floats(plane), b->floats(plane)); };
  const TermPtr W = lookup(g, map, l, 2, device);
  EXPECT_TRUE(same(V, W, "V"));
  on.clear();
  const TermPtr cold = encode(first, 60.0f, 2, 2, device);
  EXPECT_TRUE(same(map, cold, "B"));
  on.clear();
  EXPECT_TRUE(same(V, lookup(g, cold, l, 2, device), "V"));
  EXPECT_FALSE(same(V, moved, "V"));
}

TEST_P(ExponentialShadowDevices, ResidentPlanesAreTheirTermsAndGoWithThem) {
  const ComputeDevicePtr device = this->device();
  ASSERT_TRUE(device);
  ResidentPlanes on(device, 4000);
  auto a = numbered(100, 0.0f);  // 1200 bytes
  const auto whole = on.get(a, "v", 0, 100);
  ASSERT_TRUE(whole.ok());
  EXPECT_EQ(downloaded(*device, *whole, 300)[299], 299.0f);
  EXPECT_EQ(on.get(a, "v", 0, 100)->get(), whole->get());
  EXPECT_EQ(on.get(a, "v", 0, 60)->get(), whole->get()) << "its beginning";
  EXPECT_EQ(on.uploaded(), 1200u);
  const auto part = on.get(a, "v", 40, 10);
  ASSERT_TRUE(part.ok());
  EXPECT_EQ(downloaded(*device, *part, 30)[0], 120.0f);
  const auto next = on.get(a, "v", 50, 10);
  ASSERT_TRUE(next.ok());
  EXPECT_EQ(downloaded(*device, *next, 30)[0], 150.0f) << "a piece of the same size, elsewhere";
  EXPECT_EQ(on.uploaded(), 1440u);
  EXPECT_EQ(on.bytes(), 1440u);
  // Another term at the same address is another term.
  const Term* const address = a.get();
  a.reset();
  for (int k = 0; k < 64; ++k) {
    const auto b = numbered(100, 1000.0f);
    const auto of = on.get(b, "v", 0, 100);
    ASSERT_TRUE(of.ok());
    EXPECT_EQ(downloaded(*device, *of, 1)[0], 1000.0f) << (b.get() == address ? "where the first one was" : "elsewhere");
    EXPECT_EQ(on.bytes(), 1200u) << "those that are gone hold nothing";
  }
  // Beyond the bound the least recently used goes; what is larger than all of it does not stay.
  const auto x = numbered(100, 1.0f), y = numbered(100, 2.0f), z = numbered(100, 3.0f), w = numbered(100, 4.0f), large = numbered(400, 5.0f);
  for (const auto& t : {x, y, z}) ASSERT_TRUE(on.get(t, "v", 0, 100).ok());
  ASSERT_TRUE(on.get(x, "v", 0, 100).ok());
  ASSERT_TRUE(on.get(w, "v", 0, 100).ok());
  const uint64_t before = on.uploaded();
  ASSERT_TRUE(on.get(x, "v", 0, 100).ok());
  EXPECT_EQ(on.uploaded(), before);
  ASSERT_TRUE(on.get(y, "v", 0, 100).ok());
  EXPECT_EQ(on.uploaded(), before + 1200);
  EXPECT_EQ(on.bytes(), 3600u);
  ASSERT_TRUE(on.get(large, "v", 0, 400).ok());
  EXPECT_EQ(on.bytes(), 3600u);
  // A device that failed may have lost everything.
  EXPECT_FALSE(on.checked(Status(Code::Unavailable, "lost")).ok());
  EXPECT_EQ(on.bytes(), 0u);
}

TEST_P(ExponentialShadowDevices, AdoptedPlanesAreNotUploaded) {
  const ComputeDevicePtr device = this->device();
  ASSERT_TRUE(device);
  ResidentPlanes on(device);
  const auto term = numbered(10, 0.0f);
  const std::vector<float> other(30, 7.0f);
  const auto buffer = device->upload(std::span<const float>(other));
  ASSERT_TRUE(buffer.ok());
  on.adopt(term, "v", *buffer);
  EXPECT_EQ(on.get(term, "v", 0, 10)->get(), buffer->get());
  EXPECT_EQ(on.uploaded(), 0u);
}

}  // namespace
