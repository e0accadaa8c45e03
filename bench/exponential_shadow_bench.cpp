// SPDX-License-Identifier: Apache-2.0
// Do the shared formulas still vectorise? GB/s (CPU clock of one thread, median of 9) of the exp loop (8 bytes an element: one
// read, one written) and of the exponential shadow map's passes, beside the same exp loop over std::exp in the same run, and
// the Vulkan and the EGL device's time for the same work. Exit status 1 if the exp loop is not at least 1.5 times as fast as std::exp's: a loop
// that lost its vectorisation is slower than std::exp, one that has it is 2.4 to 6 times faster.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <vector>

#include "base/sobol.h"
#include "device/egl/egl_device.h"
#include "device/vulkan/vulkan_device.h"
#include "filters/shadow_map/exponential_device.h"
#include "filters/shadow_map/gaussian_kernels.h"
#include "filters/shadow_map/shadow_basis_kernels.h"
#include "filters/shadow_map/shadow_map.h"

using namespace gobo;

namespace {

double cpuClock() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}
double wallClock() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

template <typename Work>
double median(double (*clock)(), const Work& work) {
  std::vector<double> times;
  for (int i = 0; i < 9; ++i) {
    const double begin = clock();
    work();
    times.push_back(clock() - begin);
  }
  std::nth_element(times.begin(), times.begin() + 4, times.end());
  return times[4];
}

}  // namespace

int main() {
  const int side = 1024, repeats = 8, taps = 5;
  const size_t n = size_t(side) * side, samples = n;
  std::vector<float> z(n), e(n), rows(n), positions(3 * samples), V(samples);
  std::vector<uint32_t> instances(samples, 0);
  for (size_t i = 0; i < n; ++i) z[i] = 0.3f + 0.6f * toUnit(hash32(1, i));
  // Receivers as a G-buffer has them: neighbours in the picture are neighbours in the map.
  for (size_t i = 0; i < samples; ++i) {
    positions[3 * i] = float(i % side) / side;
    positions[3 * i + 1] = float(i / side) / side;
    positions[3 * i + 2] = 0.5f + 0.4f * toUnit(hash32(2, i));
  }
  LightFrame frame;
  frame.lo = Vec2(0.0f);
  frame.hi = Vec2(1.0f);
  const auto weights = shadowGaussian(taps / 2);

  // The exp loop in cache-sized pieces (16 KiB), so that memory does not hide arithmetic; then the passes over whole maps.
  constexpr size_t kPiece = 2048;
  const double fast = median(cpuClock, [&] {
    for (int r = 0; r < repeats; ++r)
      for (size_t i = 0; i + kPiece <= n; i += kPiece) encodeExponential(&z[i % 4096], &e[i % 4096], kPiece, 60.0f);
  });
  const double libm = median(cpuClock,
                             [&] {
                               for (size_t i = 0; i + kPiece <= n; i += kPiece)
                                 for (size_t k = 0; k < kPiece; ++k) e[(i + k) % 4096] = std::exp(60.0f * (z[(i + k) % 4096] - 1.0f));
                             }) *
                      repeats;
  const double whole = median(cpuClock, [&] { encodeExponential(z.data(), e.data(), n, 60.0f); });
  std::vector<float> padded(size_t(side) + taps - 1);
  const double filter = median(cpuClock, [&] {
    for (int y = 0; y < side; ++y) {
      std::copy_n(&e[size_t(y) * side], side, padded.begin() + taps / 2);
      filterRow(padded.data(), weights.data(), taps, 1, &rows[size_t(y) * side], side);
    }
  });
  // The lookup node itself, on one thread.
  const auto depth = std::make_shared<Term>("light_depth_map", Domain::LightTexel, Extent{side, side, 1});
  std::copy(z.begin(), z.end(), depth->addPlane<float>("z").begin());
  const auto gbuffer = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{side, side, 1});
  std::copy(positions.begin(), positions.end(), gbuffer->addPlane<float>("P", 3).begin());
  gbuffer->addPlane<uint32_t>("instance");
  TaskArena arena(1);
  const auto run = [&](const NodePtr& node, std::vector<TermPtr> inputs) {
    RunContext ctx;
    ctx.arena = &arena;
    ctx.inputs = std::move(inputs);
    return *runNode(*node, ctx);
  };
  const ShadowBasisPtr basis = makeExponentialBasis(60.0f, false);
  ShadowLookup lookup;
  lookup.frames.face[0] = frame;
  lookup.map.resolution = side;
  const TermPtr map = run(makeShadowEncodeNode(basis, taps / 2, side, 1, false), {depth});
  const NodePtr node = makeShadowLookupNode(basis, lookup);
  const double look = median(wallClock, [&] { run(node, {gbuffer, map}); });
  const double ratio = libm / fast;
  std::printf("exp loop, in cache       %6.1f GB/s  %5.2f ns per element\n", 8e-9 * double(n) * repeats / fast, 1e9 * fast / double(n) / repeats);
  std::printf("the same over std::exp   %6.1f GB/s  %5.2f ns per element  (%.1f times slower)\n", 8e-9 * double(n) * repeats / libm,
              1e9 * libm / double(n) / repeats, ratio);
  std::printf("encode 1024^2            %6.1f GB/s  %5.2f ms\n", 8e-9 * double(n) / whole, 1e3 * whole);
  std::printf("filter rows, 5 taps      %6.1f GB/s  %5.2f ms\n", 8e-9 * double(n) / filter, 1e3 * filter);
  std::printf("lookup, 1 M samples      %6.1f GB/s  %5.2f ms  (20 bytes a sample)\n", 20e-9 * double(samples) / look, 1e3 * look);
  const auto onDevice = [&](const auto& device) {
    if (!device.ok()) {
      std::printf("%s\n", device.status().toString().c_str());
      return;
    }
    ResidentPlanes on(*device);
    const auto result = std::make_shared<Term>("shadow_basis", Domain::LightTexel, Extent{side, side, 1});
    result->addPlane<float>("B");
    const auto encode = [&] { (void)deviceEncode(on, depth, 60.0f, weights, result).ok(); };
    const auto look = [&] { (void)deviceLookup(on, {frame, 60.0f, lookup.map.bias}, result, gbuffer, V, {}).ok(); };
    const auto cold = [&](const auto& work) {  // as when nothing stays between nodes: each call uploads what it reads
      return [&] {
        on.clear();
        work();
      };
    };
    const double encodeCold = median(wallClock, cold(encode)), lookCold = median(wallClock, cold(look));
    encode();
    const double encodeWarm = median(wallClock, encode), lookWarm = median(wallClock, look);
    std::printf("%s: %s, wall clock: encode + filter %.2f ms, its input on the device %.2f; lookup %.2f ms, map and receivers on the device %.2f\n",
                (*device)->kind(), (*device)->name().c_str(), 1e3 * encodeCold, 1e3 * encodeWarm, 1e3 * lookCold, 1e3 * lookWarm);
  };
  onDevice(VulkanDevice::shared());
  onDevice(EglDevice::shared());
  return ratio >= 1.5 ? 0 : 1;
}
