// SPDX-License-Identifier: Apache-2.0
// OpenGL compute through surfaceless EGL on whatever driver the machine has (llvmpipe in CI): transfers, order of dispatches,
// threads, errors, and the shared formulas giving the C++ values.
#include <gtest/gtest.h>

#include <EGL/egl.h>
#include <GL/glcorearb.h>

#include <cstdlib>
#include <numeric>
#include <thread>

#include "device/egl/egl_device.h"
#include "device/egl/egl_result.h"
#include "unit/device/compute_cases.h"

namespace egl_device_test {
namespace {

using namespace gobo;
using computetest::expectCppFormulas;

constexpr char kProbeText[] =
#include "shaders/formula_probe.glsl.inc"
    ;
constexpr char kAddText[] =
#include "shaders/add_index.glsl.inc"
    ;
const ComputeKernel kProbe{"formula_probe", {}, 2, 4, kProbeText};
const ComputeKernel kAdd{"add_index", {}, 1, 4, kAddText};

std::shared_ptr<EglDevice> device() {
  const auto made = EglDevice::shared();
  EXPECT_TRUE(made.ok()) << made.status().toString();
  return made.ok() ? *made : nullptr;
}

ComputeDispatch addIndex(const ComputeBufferPtr& buffer, const uint32_t& count) { return computetest::addIndex(kAdd, buffer, count); }

TEST(EglDevice, NamesItselfAndItsNumericClass) {
  ASSERT_TRUE(device());
  std::cout << "device: " << device()->name() << ", " << device()->numericClass() << ", buffers up to " << device()->maxBufferBytes() << std::endl;
  EXPECT_FALSE(device()->name().empty());
  EXPECT_STREQ(device()->kind(), "egl");
  EXPECT_EQ(device()->numericClass().rfind("glsl-f32/" + keyWord(device()->name()), 0), 0u);
  EXPECT_EQ(device()->numericClass().find(' '), std::string::npos);
  EXPECT_GE(device()->maxBufferBytes(), uint64_t(1) << 24);  // what OpenGL 4.5 promises
}

TEST(EglDevice, BytesSurviveTheTrip) {
  ASSERT_TRUE(device());
  std::vector<uint32_t> sent(100003), back(sent.size());
  std::iota(sent.begin(), sent.end(), 7u);
  auto buffer = device()->upload(std::span<const uint32_t>(sent));
  ASSERT_TRUE(buffer.ok()) << buffer.status().toString();
  ASSERT_TRUE(device()->download(**buffer, back.data(), back.size() * 4).ok());
  EXPECT_EQ(sent, back);
  auto empty = device()->upload(std::span<const uint32_t>());
  ASSERT_TRUE(empty.ok()) << empty.status().toString();
  EXPECT_TRUE(device()->download(**empty, nullptr, 0).ok());
}

TEST(EglDevice, DispatchesRunInOrderAndSeeEarlierWrites) {
  // x[i] = 3 x[i] + i with counts that differ: a reordering, a missing barrier or push constants of another dispatch show.
  ASSERT_TRUE(device());
  const uint32_t count = 5000;
  std::vector<uint32_t> expected(count, 1), got(count), counts(150);
  auto buffer = device()->upload(std::span<const uint32_t>(expected));
  ASSERT_TRUE(buffer.ok());
  std::vector<ComputeDispatch> dispatches;
  for (uint32_t k = 0; k < 150; ++k) {
    counts[k] = count - 13 * k;
    dispatches.push_back(addIndex(*buffer, counts[k]));
    for (uint32_t i = 0; i < counts[k]; ++i) expected[i] = 3 * expected[i] + i;
  }
  std::vector<double> seconds;
  const Status status = device()->run(dispatches, &seconds);
  ASSERT_TRUE(status.ok()) << status.toString();
  ASSERT_TRUE(device()->download(**buffer, got.data(), count * 4).ok());
  EXPECT_EQ(expected, got);
  ASSERT_EQ(seconds.size(), 150u);
  for (double s : seconds) EXPECT_TRUE(s >= 0.0 && s < 60.0) << s;
}

TEST(EglDevice, MoreGroupsThanOneDimensionHolds) {
  ASSERT_TRUE(device());
  const uint32_t count = 65535 * 64 + 77;
  std::vector<uint32_t> got(count, 0);
  auto buffer = device()->upload(std::span<const uint32_t>(got));
  ASSERT_TRUE(buffer.ok());
  const ComputeDispatch add = addIndex(*buffer, count);
  EXPECT_EQ(add.groups[1], 2u);
  ASSERT_TRUE(device()->run({&add, 1}).ok());
  ASSERT_TRUE(device()->download(**buffer, got.data(), size_t(count) * 4).ok());
  uint32_t wrong = 0;
  for (uint32_t i = 0; i < count; ++i) wrong += got[i] != i;
  EXPECT_EQ(wrong, 0u);
}

TEST(EglDevice, ThreadsShareIt) {
  // A second device in the same process must not be disturbed either: contexts are per device, the display is not.
  auto other = EglDevice::create({});
  ASSERT_TRUE(other.ok()) << other.status().toString();
  ASSERT_TRUE(device());
  std::vector<std::thread> threads;
  std::vector<int> good(4, 0);
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([t, &good, &other] {
      const std::shared_ptr<EglDevice> mine = t & 1 ? *other : device();
      const uint32_t count = 1000 + uint32_t(t);
      for (int k = 0; k < 20; ++k) {
        std::vector<uint32_t> x(count, uint32_t(k)), back(count);
        auto buffer = mine->upload(std::span<const uint32_t>(x));
        if (!buffer.ok()) return;
        const ComputeDispatch d = addIndex(*buffer, count);
        if (!mine->run({&d, 1}).ok() || !mine->download(**buffer, back.data(), count * 4).ok()) return;
        for (uint32_t i = 0; i < count; ++i)
          if (back[i] != 3 * uint32_t(k) + i) return;
      }
      good[t] = 1;
    });
  for (auto& t : threads) t.join();
  EXPECT_EQ(good, std::vector<int>(4, 1));
}

TEST(EglDevice, DevicesEndWithoutHarmToOthers) {
  // A buffer keeps its device alive; the end of one device leaves others, of the same display, working.
  std::vector<uint32_t> x(100, 5), back(100);
  auto made = EglDevice::create({});
  ASSERT_TRUE(made.ok()) << made.status().toString();
  auto buffer = (*made)->upload(std::span<const uint32_t>(x));
  ASSERT_TRUE(buffer.ok());
  std::weak_ptr<EglDevice> watch = *made;
  made = Status(Code::Unknown, "");
  EXPECT_FALSE(watch.expired());
  buffer = Status(Code::Unknown, "");
  EXPECT_TRUE(watch.expired());
  ASSERT_TRUE(device());
  auto again = device()->upload(std::span<const uint32_t>(x));
  ASSERT_TRUE(again.ok()) << again.status().toString();
  ASSERT_TRUE(device()->download(**again, back.data(), 400).ok());
  EXPECT_EQ(x, back);
  EXPECT_EQ(eglGetCurrentContext(), EGL_NO_CONTEXT);  // no call leaves a context on its thread
}

TEST(EglDevice, FormulasGiveTheCppValues) {
  ASSERT_TRUE(device());
  expectCppFormulas(*device(), kProbe);
}

TEST(EglDevice, ErrorsNameTheirCause) {
  ASSERT_TRUE(device());
  const auto big = device()->buffer(size_t(1) << 62);
  ASSERT_FALSE(big.ok());
  EXPECT_EQ(big.status().code(), Code::ResourceExhausted);
  EXPECT_NE(big.status().message().find(device()->name()), std::string::npos) << big.status().message();
  for (const char* name : {"no such platform", "999"}) {
    const auto unknown = EglDevice::create({name});
    ASSERT_FALSE(unknown.ok());
    EXPECT_EQ(unknown.status().code(), Code::Unavailable);
    EXPECT_NE(unknown.status().message().find(name), std::string::npos) << unknown.status().message();
  }
}

TEST(EglDevice, BrokenKernelsNameThemselvesAndHarmNothing) {
  ASSERT_TRUE(device());
  std::vector<uint32_t> x(64, 5), back(64);
  auto buffer = device()->upload(std::span<const uint32_t>(x));
  ASSERT_TRUE(buffer.ok());
  const uint32_t count = 64;
  static constexpr char kNoCompile[] = "#version 450\nlayout(local_size_x = 64) in;\nvoid main() { nonsense = 1; }\n";
  static constexpr char kNoLink[] = "#version 450\nlayout(local_size_x = 64) in;\nvoid missing();\nvoid main() { missing(); }\n";
  for (const auto& [text, call] : {std::pair{kNoCompile, "glCompileShader"}, {kNoLink, "glLinkProgram"}}) {
    const ComputeKernel broken{"broken_kernel", {}, 1, 0, text};
    // The good dispatch before it must not run: a list runs as a whole or, of what fails beforehand, not at all.
    const ComputeDispatch both[] = {addIndex(*buffer, count), {&broken, {*buffer}, {}, {1, 1, 1}}};
    const Status status = device()->run(both);
    EXPECT_EQ(status.code(), Code::Internal);
    EXPECT_NE(status.message().find("broken_kernel"), std::string::npos) << status.toString();
    EXPECT_NE(status.message().find(call), std::string::npos) << status.toString();
  }
  ASSERT_TRUE(device()->download(**buffer, back.data(), 256).ok());
  EXPECT_EQ(x, back);
}

TEST(EglDevice, ErrorCodesHaveTheirNames) {
  EXPECT_TRUE(eglStatus(EGL_SUCCESS, "eglInitialize").ok());
  EXPECT_EQ(eglStatus(EGL_BAD_MATCH, "eglCreateContext").toString(), Status(Code::Internal, "eglCreateContext: EGL_BAD_MATCH").toString());
  EXPECT_EQ(eglStatus(EGL_BAD_ALLOC, "eglCreateContext").code(), Code::ResourceExhausted);
  EXPECT_EQ(eglStatus(EGL_CONTEXT_LOST, "eglMakeCurrent").code(), Code::Unavailable);
  EXPECT_EQ(eglErrorName(0x1234), "EGL error 0x1234");
  EXPECT_TRUE(glStatus(GL_NO_ERROR, "glFinish").ok());
  EXPECT_EQ(glStatus(GL_INVALID_VALUE, "glFinish").toString(), Status(Code::Internal, "glFinish: GL_INVALID_VALUE").toString());
  EXPECT_EQ(glStatus(GL_OUT_OF_MEMORY, "glNamedBufferStorage").code(), Code::ResourceExhausted);
  EXPECT_EQ(glStatus(GL_CONTEXT_LOST, "glFinish").code(), Code::Unavailable);
  EXPECT_EQ(glErrorName(0x9999), "GL error 0x9999");
}

/// In a process of its own, since libEGL reads its list of drivers once: makes a device, prints why not, exits with the code.
void createAndExit(const char* variable, const char* value) {
  setenv(variable, value, 1);
  const auto made = EglDevice::create({});
  std::cerr << made.status().toString() << std::endl;
  std::exit(int(made.status().code()));
}

TEST(EglDeviceDeathTest, MachineWithoutDriversIsUnavailable) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(createAndExit("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent/vendor.json"), testing::ExitedWithCode(int(Code::Unavailable)), "no EGL device");
}

TEST(EglDeviceDeathTest, TooOldAnOpenGlIsUnavailable) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  constexpr int kNotMesa = 99;  // no other driver can be told to be old
  const auto olden = [] {
    setenv("MESA_GL_VERSION_OVERRIDE", "3.3", 1);
    const auto made = EglDevice::create({});
    std::cerr << made.status().toString() << std::endl;
    std::exit(made.ok() && (*made)->name().find("llvmpipe") == std::string::npos ? kNotMesa : int(made.status().code()));
  };
  const auto expected = [](int status) { return testing::ExitedWithCode(int(Code::Unavailable))(status) || testing::ExitedWithCode(kNotMesa)(status); };
  EXPECT_EXIT(olden(), expected, "eglCreateContext.*EGL_BAD_MATCH|OK");
}

TEST(EglDeviceDeathTest, BuffersOfAnotherDeviceAreRefused) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto misuse = [](bool run) {
    auto other = EglDevice::create({});
    auto buffer = (*other)->buffer(256);
    const uint32_t count = 64;
    const ComputeDispatch add = addIndex(*buffer, count);
    (void)(run ? device()->run({&add, 1}) : device()->upload(**buffer, &count, 4)).ok();
  };
  EXPECT_DEATH(misuse(true), "of\\(\\*this\\)");
  EXPECT_DEATH(misuse(false), "of\\(\\*this\\)");
}

}  // namespace
}  // namespace egl_device_test
