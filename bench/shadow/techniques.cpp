// SPDX-License-Identifier: Apache-2.0
#include "shadow/techniques.h"

namespace gobo::shadowbench {

using Map = v1::ShadowMapSettings;
using T = v1::ShadowTechnique;

T shadowMap(int resolution, int blur) {
  T t;
  t.mutable_map()->set_resolution(uint32_t(resolution));
  t.mutable_map()->set_blur(uint32_t(blur));
  return t;
}
T convolution(int order, int resolution, int blur, bool bytes) {
  T t = shadowMap(resolution, blur);
  t.mutable_convolution()->set_order(uint32_t(order));
  t.mutable_convolution()->set_bytes(bytes);
  return t;
}
T exponential(double c, int resolution, int blur, bool threshold) {
  T t = shadowMap(resolution, blur);
  t.mutable_exponential()->set_c(c);
  if (threshold) t.mutable_exponential()->set_classification(v1::ExponentialShadow::THRESHOLD);
  return t;
}
T variance(int resolution, int blur, double bleedingReduction) {
  T t = shadowMap(resolution, blur);
  t.mutable_variance();
  if (bleedingReduction >= 0) t.mutable_variance()->set_bleeding_reduction(bleedingReduction);
  return t;
}
T percentageCloser(int resolution, int blur, bool skip) {
  T t = shadowMap(resolution, blur);
  t.mutable_percentage_closer()->set_pattern(v1::PercentageCloserShadow::GAUSSIAN);
  t.mutable_percentage_closer()->set_skip(skip);
  return t;
}
T percentageCloserTaps(int resolution, int taps) {
  T t = shadowMap(resolution, 1);
  t.mutable_percentage_closer()->set_pattern(v1::PercentageCloserShadow::REGULAR);
  t.mutable_percentage_closer()->set_taps(uint32_t(taps));
  return t;
}
T rayTraced(int samples) {
  T t;
  t.mutable_ray_traced()->set_samples(uint32_t(samples));
  return t;
}
T axisAligned(int samples) {
  T t;
  t.mutable_axis_aligned()->set_mean_samples(samples);
  return t;
}
T publishedAxisAligned(int meanSamples) {
  T t = axisAligned(meanSamples);
  auto& m = *t.mutable_axis_aligned();
  m.set_pilot(9);
  m.set_rate(v1::AxisAlignedShadow::EQUATION);
  m.set_width(v1::AxisAlignedShadow::BAND_LIMIT);
  m.set_kernel(v1::AxisAlignedShadow::GAUSSIAN);
  return t;
}
T convolutionSoft(int order, int resolution, Map::Lookup lookup) {
  T t = shadowMap(resolution, 0);
  t.mutable_convolution_soft()->set_order(uint32_t(order));
  t.mutable_map()->set_lookup(lookup);
  return t;
}
T percentageCloserSoft(int resolution, int search, int filter) {
  T t = shadowMap(resolution, 0);
  if (search > 0) {
    t.mutable_percentage_closer_soft()->set_search_taps(uint32_t(search));
    t.mutable_percentage_closer_soft()->set_filter_taps(uint32_t(filter));
  } else {
    t.mutable_percentage_closer_soft()->set_dense(true);
  }
  return t;
}

namespace {

std::string at(int resolution, int blur) { return "S=" + std::to_string(resolution) + (blur >= 0 ? " blur=" + std::to_string(blur) : ""); }

/// Default parameters over resolutions at blur 1, and over blurs at 1024.
template <typename Make>
void overMaps(std::vector<Setting>& list, const std::string& family, const std::string& parameter, bool quick, Make make) {
  for (int s : {256, 512, 1024, 2048})
    if (!quick || s == 1024) list.push_back({family, parameter + at(s, 1), make(s, 1)});
  for (int b : {0, 2, 3})
    if (!quick || b == 3) list.push_back({family, parameter + at(1024, b), make(1024, b)});
}

}  // namespace

std::vector<Setting> hardSettings(bool quick) {
  std::vector<Setting> list;
  for (int s : {256, 512, 1024, 2048}) {
    T t = shadowMap(s, 0);
    t.mutable_shadow_map();
    if (!quick || s == 1024) list.push_back({"shadow_map", at(s, -1), t});
  }
  overMaps(list, "percentage_closer", "gauss ", quick, [](int s, int b) { return percentageCloser(s, b); });
  for (int size : {256, 512, 1024, 2048, 4096})
    for (const bool footprint : {false, true}) {  // the default, and the kernel of the pixel's footprint
      if (quick && size != 1024 && size != 2048) continue;
      T t = percentageCloserTaps(size, 2);
      if (footprint) t.mutable_percentage_closer()->set_pattern(v1::PercentageCloserShadow::FOOTPRINT);
      list.push_back({"percentage_closer", (footprint ? "footprint " : "taps=2^2 ") + at(size, -1), t});
    }
  for (int n : {4, 6, 8}) list.push_back({"percentage_closer", "taps=" + std::to_string(n) + "^2 " + at(1024, -1), percentageCloserTaps(1024, n)});
  list.push_back({"percentage_closer", "gauss no skip " + at(1024, 3), percentageCloser(1024, 3, false)});
  overMaps(list, "variance", "", quick, [](int s, int b) { return variance(s, b); });
  overMaps(list, "convolution", "M=16 ", quick, [](int s, int b) { return convolution(16, s, b); });
  for (int s : {512, 1024, 2048})
    if (!quick) list.push_back({"convolution", "M=16 bytes " + at(s, 1), convolution(16, s, 1, true)});
  for (int m : {1, 2, 4, 8}) {
    list.push_back({"convolution", "M=" + std::to_string(m) + " " + at(1024, 1), convolution(m, 1024, 1)});
    if (!quick) list.push_back({"convolution", "M=" + std::to_string(m) + " bytes " + at(1024, 1), convolution(m, 1024, 1, true)});
  }
  overMaps(list, "exponential", "c=80 ", quick, [](int s, int b) { return exponential(80, s, b); });
  overMaps(list, "exponential", "c=80 threshold ", quick, [](int s, int b) { return exponential(80, s, b, true); });
  for (double c : {20.0, 40.0}) list.push_back({"exponential", "c=" + std::to_string(int(c)) + " " + at(1024, 1), exponential(c, 1024, 1)});
  for (double c : {200.0, 500.0})
    for (bool threshold : {false, true})
      list.push_back({"exponential", "log c=" + std::to_string(int(c)) + (threshold ? " threshold " : " ") + at(1024, 1), exponential(c, 1024, 1, threshold)});
  overMaps(list, "exp_variance", "", quick, [](int s, int b) {
    T t = shadowMap(s, b);
    t.mutable_exponential_variance();
    return t;
  });
  overMaps(list, "moment", "", quick, [](int s, int b) {
    T t = shadowMap(s, b);
    t.mutable_moment();
    return t;
  });
  for (int n : {1, 4, 16, 64})
    if (!quick || n <= 16) {
      Setting s{"rays", "n=" + std::to_string(n), rayTraced(1)};
      s.viewSamples = n;
      list.push_back(s);
    }
  return list;
}

std::vector<Setting> softSettings(bool quick) {
  std::vector<Setting> list;
  const auto over = [&](const std::string& family, const std::string& parameter, auto make) {
    for (int s : {256, 512, 1024})
      if (!quick || s == 512) list.push_back({family, parameter + at(s, -1), make(s)});
  };
  for (int size : {256, 512, 1024, 2048}) list.push_back({"pcss", "32+64 " + at(size, -1), percentageCloserSoft(size, 32, 64)});
  for (int size : {512, 1024, 2048})
    if (!quick || size < 2048) list.push_back({"pcss", "dense " + at(size, -1), percentageCloserSoft(size, 0, 0)});
  for (int n : {8, 16, 128}) list.push_back({"pcss", std::to_string(n) + "+" + std::to_string(2 * n) + " " + at(512, -1), percentageCloserSoft(512, n, 2 * n)});
  for (int m : {4, 8, 16}) {
    over("cssm", "mip M=" + std::to_string(m) + " ", [&](int s) { return convolutionSoft(m, s, Map::TRILINEAR); });
    over("cssm", "sat M=" + std::to_string(m) + " ", [&](int s) { return convolutionSoft(m, s, Map::SUMMED_AREA); });
  }
  over("variance_soft", "", [](int s) {
    T t = shadowMap(s, 0);
    t.mutable_variance_soft();
    return t;
  });
  over("evsm_soft", "", [](int s) {
    T t = shadowMap(s, 0);
    t.mutable_exponential_variance_soft();
    return t;
  });
  for (int n : {1, 4, 9, 16, 64}) list.push_back({"rays", "n=" + std::to_string(n), rayTraced(n)});
  for (int n : {1, 4, 9, 16})
    for (int radius : {2, 4, -1}) {
      if (quick && radius != 4) continue;
      Setting s{"bilateral", "n=" + std::to_string(n) + (radius < 0 ? " a-trous" : " " + std::to_string(2 * radius + 1) + "^2"), rayTraced(n)};
      s.bilateral = radius;
      list.push_back(s);
    }
  for (int n : {4, 8, 16, 32, 64}) {
    Setting s{"axis_aligned", "n=" + std::to_string(n), {}};
    s.technique = axisAligned(n);
    list.push_back(s);
  }
  Setting s{"axis_aligned", "published", {}};
  s.technique = publishedAxisAligned(0);
  list.push_back(s);
  return list;
}

}  // namespace gobo::shadowbench
