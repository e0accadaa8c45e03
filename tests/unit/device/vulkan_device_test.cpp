// SPDX-License-Identifier: Apache-2.0
// The Vulkan runtime on whatever device the machine has (lavapipe in CI): transfers, order of dispatches, errors, and the
// shared formulas giving the C++ values.
#include <gtest/gtest.h>

#include <cstdlib>
#include <numeric>
#include <thread>

#include "device/vulkan/vulkan_device.h"
#include "unit/device/compute_cases.h"

namespace vulkan_device_test {
namespace {

using namespace gobo;
using computetest::expectCppFormulas;

constexpr uint32_t kProbeCode[] =
#include "shaders/formula_probe.inc"
    ;
constexpr uint32_t kAddCode[] =
#include "shaders/add_index.inc"
    ;
const ComputeKernel kProbe{"formula_probe", kProbeCode, 2, 4};
const ComputeKernel kAdd{"add_index", kAddCode, 1, 4};

std::shared_ptr<VulkanDevice> device() {
  static const auto made = VulkanDevice::create({.device = VulkanDevice::Options::fromEnvironment().device, .validation = true, .staging = false});
  EXPECT_TRUE(made.ok()) << made.status().toString();
  return made.ok() ? *made : nullptr;
}

ComputeDispatch addIndex(const ComputeBufferPtr& buffer, const uint32_t& count) { return computetest::addIndex(kAdd, buffer, count); }

TEST(VulkanDevice, NamesItselfAndItsNumericClass) {
  ASSERT_TRUE(device());
  RecordProperty("device", device()->name());
  std::cout << "device: " << device()->name() << ", " << device()->numericClass() << ", buffers up to " << device()->maxBufferBytes() << std::endl;
  EXPECT_FALSE(device()->name().empty());
  EXPECT_EQ(device()->numericClass().rfind("spirv-f32/", 0), 0u);
  EXPECT_EQ(device()->numericClass().find(' '), std::string::npos);
}

TEST(VulkanDevice, BytesSurviveTheTrip) {
  // Mapped memory, and the staging copies of devices whose memory the host cannot map.
  for (bool staging : {false, true}) {
    auto made = VulkanDevice::create({.device = VulkanDevice::Options::fromEnvironment().device, .validation = true, .staging = staging});
    ASSERT_TRUE(made.ok()) << made.status().toString();
    std::vector<uint32_t> sent(100003), back(sent.size());
    std::iota(sent.begin(), sent.end(), 7u);
    auto buffer = (*made)->upload(std::span<const uint32_t>(sent));
    ASSERT_TRUE(buffer.ok()) << buffer.status().toString();
    ASSERT_TRUE((*made)->download(**buffer, back.data(), back.size() * 4).ok());
    EXPECT_EQ(sent, back);
    const uint32_t count = uint32_t(sent.size());
    const ComputeDispatch add = addIndex(*buffer, count);
    const Status status = (*made)->run({&add, 1});
    ASSERT_TRUE(status.ok()) << status.toString();
    ASSERT_TRUE((*made)->download(**buffer, back.data(), back.size() * 4).ok());
    for (uint32_t i = 0; i < count; ++i) ASSERT_EQ(back[i], 3 * sent[i] + i);
  }
}

TEST(VulkanDevice, StagedTransfersGoPieceByPieceAndMemoryIsUsedAgain) {
  // As on GPUs: transfers of several pieces with a rest, and buffers of many sizes whose memory was another's before; nothing of that shows.
  auto made = VulkanDevice::create({.device = VulkanDevice::Options::fromEnvironment().device, .validation = true, .staging = true});
  ASSERT_TRUE(made.ok()) << made.status().toString();
  std::vector<size_t> counts{(size_t(40) << 18) + 3};  // 40 MiB and 12 bytes
  for (size_t n : {1, 63, 64, 65, 1000, 1023, 1024, 1025, 1200, 5000, 4999, 1, 1000}) counts.push_back(n);
  ComputeBufferPtr alive;
  for (size_t round = 0; round < counts.size(); ++round) {
    const uint32_t count = uint32_t(counts[round]);
    std::vector<uint32_t> sent(count), back(count);
    std::iota(sent.begin(), sent.end(), uint32_t(round) * 77u);
    auto buffer = (*made)->upload(std::span<const uint32_t>(sent));
    ASSERT_TRUE(buffer.ok()) << buffer.status().toString();
    EXPECT_EQ((*buffer)->bytes(), sent.size() * 4);
    const ComputeDispatch add = addIndex(*buffer, count);
    ASSERT_TRUE((*made)->run({&add, 1}).ok());
    ASSERT_TRUE((*made)->download(**buffer, back.data(), back.size() * 4).ok());
    uint32_t wrong = 0;
    for (uint32_t i = 0; i < count; ++i) wrong += back[i] != 3 * sent[i] + i;
    EXPECT_EQ(wrong, 0u) << count;
    if (round % 3 == 0) alive = *buffer;  // the one before goes
  }
  // More than what is kept, all at once and again.
  for (int again = 0; again < 2; ++again) {
    std::vector<ComputeBufferPtr> many;
    for (int i = 0; i < 10; ++i) {
      auto buffer = (*made)->buffer(size_t(33) << 20);
      ASSERT_TRUE(buffer.ok()) << buffer.status().toString();
      many.push_back(*buffer);
    }
  }
}

TEST(VulkanDevice, DispatchesRunInOrderAndSeeEarlierWrites) {
  // 150 dispatches (more than one submission) of x[i] = 3 x[i] + i: any reordering or missing barrier shows.
  ASSERT_TRUE(device());
  const uint32_t count = 5000;
  std::vector<uint32_t> expected(count, 1), got(count);
  auto buffer = device()->upload(std::span<const uint32_t>(expected));
  ASSERT_TRUE(buffer.ok());
  std::vector<ComputeDispatch> dispatches(150, addIndex(*buffer, count));
  for (int k = 0; k < 150; ++k)
    for (uint32_t i = 0; i < count; ++i) expected[i] = 3 * expected[i] + i;
  std::vector<double> seconds;
  const Status status = device()->run(dispatches, &seconds);
  ASSERT_TRUE(status.ok()) << status.toString();
  ASSERT_TRUE(device()->download(**buffer, got.data(), count * 4).ok());
  EXPECT_EQ(expected, got);
  ASSERT_EQ(seconds.size(), 150u);
  for (double s : seconds) EXPECT_TRUE(s >= 0.0 && s < 60.0) << s;
}

TEST(VulkanDevice, MoreGroupsThanOneDimensionHolds) {
  ASSERT_TRUE(device());
  ComputeDispatch d;
  setLinearGroups(d, size_t(65535) * 64 + 1, 64);
  EXPECT_EQ(d.groups[1], 2u);
  EXPECT_GE(size_t(d.groups[0]) * d.groups[1], size_t(65536));
  const uint32_t count = 65535 * 64 + 77;
  std::vector<uint32_t> got(count, 0);
  auto buffer = device()->upload(std::span<const uint32_t>(got));
  ASSERT_TRUE(buffer.ok());
  const ComputeDispatch add = addIndex(*buffer, count);
  ASSERT_TRUE(device()->run({&add, 1}).ok());
  ASSERT_TRUE(device()->download(**buffer, got.data(), size_t(count) * 4).ok());
  uint32_t wrong = 0;
  for (uint32_t i = 0; i < count; ++i) wrong += got[i] != i;
  EXPECT_EQ(wrong, 0u);
}

TEST(VulkanDevice, ThreadsShareIt) {
  ASSERT_TRUE(device());
  std::vector<std::thread> threads;
  std::vector<int> good(4, 0);
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([t, &good] {
      const uint32_t count = 1000 + uint32_t(t);
      for (int k = 0; k < 20; ++k) {
        std::vector<uint32_t> x(count, uint32_t(k)), back(count);
        auto buffer = device()->upload(std::span<const uint32_t>(x));
        if (!buffer.ok()) return;
        const ComputeDispatch d = addIndex(*buffer, count);
        if (!device()->run({&d, 1}).ok() || !device()->download(**buffer, back.data(), count * 4).ok()) return;
        for (uint32_t i = 0; i < count; ++i)
          if (back[i] != 3 * uint32_t(k) + i) return;
      }
      good[t] = 1;
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(good, std::vector<int>(4, 1));
}

TEST(VulkanDevice, FormulasGiveTheCppValues) {
  ASSERT_TRUE(device());
  expectCppFormulas(*device(), kProbe);
}

TEST(VulkanDevice, ErrorsNameTheirCause) {
  ASSERT_TRUE(device());
  const auto big = device()->buffer(size_t(1) << 62);
  ASSERT_FALSE(big.ok());
  EXPECT_EQ(big.status().code(), Code::ResourceExhausted);
  const auto unknown = VulkanDevice::create({.device = "no such device", .validation = false, .staging = false});
  ASSERT_FALSE(unknown.ok());
  EXPECT_EQ(unknown.status().code(), Code::Unavailable);
  EXPECT_NE(unknown.status().message().find(device()->name()), std::string::npos) << unknown.status().message();
  const auto byName = VulkanDevice::create({.device = device()->name().substr(0, 5), .validation = false, .staging = false});
  EXPECT_TRUE(byName.ok()) << byName.status().toString();
}

TEST(VulkanDevice, MachineWithoutDriversIsUnavailable) {
  ASSERT_TRUE(device());  // the process's own device is made before the drivers are hidden
  setenv("VK_DRIVER_FILES", "/nonexistent/driver.json", 1);
  setenv("VK_ICD_FILENAMES", "/nonexistent/driver.json", 1);
  const auto none = VulkanDevice::create({});
  unsetenv("VK_DRIVER_FILES");
  unsetenv("VK_ICD_FILENAMES");
  ASSERT_FALSE(none.ok());
  EXPECT_EQ(none.status().code(), Code::Unavailable);
  EXPECT_NE(none.status().message().find("no Vulkan device"), std::string::npos) << none.status().message();
}

TEST(VulkanDevice, ValidationLayerReportsMisuse) {
  // A push constant range smaller than the shader's block is a fault that only the layer sees.
  ASSERT_TRUE(device());
  static const std::vector<uint32_t> copy(std::begin(kAddCode), std::end(kAddCode));  // its own address: its own pipeline
  const ComputeKernel wrong{"add_index_without_push", copy, 1, 0};
  auto buffer = device()->buffer(256);
  ASSERT_TRUE(buffer.ok());
  const ComputeDispatch d{&wrong, {*buffer}, {}, {1, 1, 1}};
  const Status status = device()->run({&d, 1});
  EXPECT_EQ(status.code(), Code::Internal);
  EXPECT_NE(status.message().find("validation"), std::string::npos) << status.toString();
}

}  // namespace
}  // namespace vulkan_device_test
