// SPDX-License-Identifier: Apache-2.0
// What the tests of every ComputeDevice share.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <limits>
#include <vector>

#include "device/compute_device.h"
#include "formulas/exponential_shadow_map.glsl.h"
#include "formulas/tone_map.glsl.h"

namespace gobo::computetest {

/// `add` is the device's form of add_index.comp; `count` must outlive the dispatch.
inline ComputeDispatch addIndex(const ComputeKernel& add, const ComputeBufferPtr& buffer, const uint32_t& count) {
  ComputeDispatch d{&add, {buffer}, {reinterpret_cast<const uint8_t*>(&count), 4}, {}};
  setLinearGroups(d, count, 64);
  return d;
}

/// `probe` is the device's form of formula_probe.comp: every shared formula gives the C++ value within 1e-6, and a finite one.
inline void expectCppFormulas(ComputeDevice& device, const ComputeKernel& probe) {
  using namespace gobo::formulas;
  std::vector<float> x;
  for (float a = 1e-30f; a < 1e30f; a *= 1.7f) x.insert(x.end(), {a, -a});
  for (int i = -4000; i <= 4000; ++i) x.insert(x.end(), {float(i) * 0.03f, float(i) * 0.00025f});
  const float inf = std::numeric_limits<float>::infinity();
  x.insert(x.end(), {0.0f, inf, -inf, std::numeric_limits<float>::quiet_NaN()});
  const uint32_t count = uint32_t(x.size());
  auto in = device.upload(std::span<const float>(x));
  auto out = device.buffer(size_t(count) * 10 * 4);
  ASSERT_TRUE(in.ok() && out.ok());
  ComputeDispatch d{&probe, {*in, *out}, {reinterpret_cast<const uint8_t*>(&count), 4}, {}};
  setLinearGroups(d, count, 64);
  const Status status = device.run({&d, 1});
  ASSERT_TRUE(status.ok()) << status.toString();
  std::vector<float> y(size_t(count) * 10);
  ASSERT_TRUE(device.download(**out, y.data(), y.size() * 4).ok());
  float (*const functions[])(float) = {fastExp,
                                       fastExp2,
                                       fastLog,
                                       fastSin,
                                       fastCos,
                                       toneMapFilmic,
                                       toneMapReinhard,
                                       [](float v) { return esmEncode(v, 80.0f); },
                                       [](float v) { return esmReceiver(v - 0.001f, 80.0f); },
                                       [](float v) { return esmVisibility(esmEncode(0.5f, 80.0f), esmReceiver(v, 80.0f), true); }};
  for (int f = 0; f < 10; ++f) {
    double worst = 0;
    for (uint32_t i = 0; i < count; ++i) {
      const float a = functions[f](x[i]), b = y[size_t(f) * count + i];
      ASSERT_TRUE(std::isfinite(b)) << f << " at " << x[i];
      worst = std::max(worst, std::fabs(double(a) - b) / std::max(1e-30 + std::fabs(double(a)), f == 3 || f == 4 ? 1.0 : 0.0));
    }
    std::cout << "formula " << f << ": largest relative difference C++ against device " << worst << std::endl;
    EXPECT_LE(worst, 1e-6) << f;
  }
}

}  // namespace gobo::computetest
