// SPDX-License-Identifier: Apache-2.0
// Passes of filterable shadow maps on one thread: GB/s of encode with a 5 x 5 pre-filter, mip chain, summed-area table (bytes read and written
// once), and ns a view sample of lookups (1 M samples, neighbours in the picture are neighbours in the map), for every basis on a 1024^2
// map of boxes over a floor. CPU clock of one thread, median of 5. Optional argument: side of the map.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <optional>

#include "base/sobol.h"
#include "filters/shadow_map/shadow_map.h"

using namespace gobo;

namespace {

using Settings = v1::ShadowMapSettings;

double cpuClock() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

TermPtr run(const NodePtr& node, std::vector<TermPtr> inputs) {
  static TaskArena arena(1);
  RunContext ctx;
  ctx.arena = &arena;
  ctx.inputs = std::move(inputs);
  return *runNode(*node, ctx);
}

/// The node's term and the median of its seconds.
struct Timed {
  TermPtr term;
  double seconds;
};
Timed timed(const NodePtr& node, const std::vector<TermPtr>& inputs) {
  Timed t;
  std::vector<double> times;
  for (int i = 0; i < 5; ++i) {
    t.term = nullptr;
    const double begin = cpuClock();
    t.term = run(node, inputs);
    times.push_back(cpuClock() - begin);
  }
  std::nth_element(times.begin(), times.begin() + 2, times.end());
  t.seconds = times[2];
  return t;
}

struct Family {
  const char* name;
  ShadowBasisPtr basis;
  bool bytes = false;
};

}  // namespace

int main(int argc, char** argv) {
  const int side = argc > 1 ? std::atoi(argv[1]) : 1024, blur = 2, picture = 1024;
  if (side < 16 || side > 8192) {
    std::fprintf(stderr, "the map's side must be in 16 .. 8192\n");
    return 2;
  }
  const auto depth = std::make_shared<Term>("light_depth_map", Domain::LightTexel, Extent{side, side, 1});
  const auto z = depth->addPlane<float>("z");
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const uint64_t cell = uint64_t(y * 16 / side * 16 + x * 16 / side);
      z[size_t(y) * size_t(side) + size_t(x)] = toUnit(hash32(1, cell)) < 0.4f ? 0.2f + 0.5f * toUnit(hash32(2, cell)) : 0.9f;
    }
  // The surfaces that the map shows, from a camera turned by 30 degrees; half of the picture minified four times.
  const auto gbuffer = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{picture, picture, 1});
  const auto P = gbuffer->addPlane<float>("P", 3), Ng = gbuffer->addPlane<float>("Ng", 3);
  const auto footprint = gbuffer->addPlane<float>("footprint");
  gbuffer->addPlane<uint32_t>("instance");
  for (int y = 0; y < picture; ++y)
    for (int x = 0; x < picture; ++x) {
      const size_t i = size_t(y) * picture + size_t(x);
      const float a = (float(x) + 0.5f) / picture - 0.5f, b = (float(y) + 0.5f) / picture - 0.5f;
      const float u = std::clamp(0.5f + 0.866f * a - 0.5f * b, 0.0f, 1.0f), v = std::clamp(0.5f + 0.5f * a + 0.866f * b, 0.0f, 1.0f);
      P[3 * i] = u;
      P[3 * i + 1] = v;
      P[3 * i + 2] = 0.9f;
      Ng[3 * i + 2] = -1.0f;
      footprint[i] = (y < picture / 2 ? 1.0f : 4.0f) / float(side);
    }
  const size_t samples = size_t(picture) * picture, texels = size_t(side) * size_t(side);
  const auto convolution = [](uint32_t order) {
    v1::ConvolutionShadow m;
    m.set_order(order);
    return makeConvolutionBasis(m);
  };
  const std::vector<Family> families{{"exponential", makeExponentialBasis(80, false)},
                                     {"exponential, logarithmic", makeExponentialBasis(300, true)},
                                     {"variance", makeVarianceBasis({})},
                                     {"exponential variance", makeExponentialVarianceBasis(40, 10, 1e-6f, 0.1f)},
                                     {"moment", makeMomentBasis({})},
                                     {"convolution 4", convolution(4)},
                                     {"convolution 16", convolution(16)},
                                     {"convolution 16, bytes", convolution(16), true}};
  const Timed bounds = timed(makeDepthBoundsNode(side, 1), {depth});
  std::printf("%d^2 map, %d x %d pre-filter, 1 M view samples, one thread\n", side, 2 * blur + 1, 2 * blur + 1);
  std::printf("%-26s %22s %22s %22s %12s %12s %12s %12s\n", "", "encode + filter", "mip chain", "summed area", "bilinear", "trilinear", "anisotropic",
              "summed area");
  std::printf("%-26s %13s %8s %13s %8s %13s %8s %12s %12s %12s %12s\n", "", "ms", "GB/s", "ms", "GB/s", "ms", "GB/s", "ns/sample", "ns/sample", "ns/sample",
              "ns/sample");
  for (const Family& f : families) {
    const double texel = double(f.basis->channels()) * (f.bytes ? 1 : 4);
    const Timed map = timed(makeShadowEncodeNode(f.basis, blur, side, 1, f.bytes), {depth});
    const Timed chain = timed(makeShadowMipmapNode(f.basis, side, 1, f.bytes), {map.term});
    std::optional<Timed> table;
    if (f.basis->bounded() && !f.bytes) table = timed(makeShadowSummedAreaNode(f.basis, side, 1), {map.term});
    const auto gbs = [&](double bytes, double s) { return 1e-9 * bytes * double(texels) / s; };
    std::printf("%-26s %13.2f %8.2f %13.2f %8.2f ", f.name, 1e3 * map.seconds, gbs(4 + texel, map.seconds), 1e3 * chain.seconds,
                gbs(texel * 7 / 3, chain.seconds));
    if (table) std::printf("%13.2f %8.2f", 1e3 * table->seconds, gbs(2 * texel, table->seconds));
    else std::printf("%13s %8s", "-", "-");
    ShadowLookup l;
    l.frames.face[0].lo = Vec2(0.0f);
    l.map.resolution = side;
    l.map.blur = blur;
    l.view = {Vec3(0, 0.6f, -0.8f), false};
    for (const auto lookup : {Settings::BILINEAR, Settings::TRILINEAR, Settings::ANISOTROPIC, Settings::SUMMED_AREA}) {
      if (lookup == Settings::SUMMED_AREA && !table) {
        std::printf(" %12s", "-");
        continue;
      }
      l.map.lookup = lookup;
      const Timed t = timed(makeShadowLookupNode(f.basis, l), {gbuffer, lookup == Settings::BILINEAR      ? map.term
                                                                        : lookup == Settings::SUMMED_AREA ? table->term
                                                                                                          : chain.term});
      std::printf(" %12.1f", 1e9 * t.seconds / double(samples));
    }
    std::printf("\n");
    std::fflush(stdout);
  }
  std::printf("depth bounds: %.2f ms, %.2f GB/s\n", 1e3 * bounds.seconds, 1e-9 * double(texels) * (4 + 8 * 4 / 3.0) / bounds.seconds);
  for (int classified = 1; classified <= 2; ++classified) {
    ShadowLookup l;
    l.frames.face[0].lo = Vec2(0.0f);
    l.map.resolution = side;
    l.map.blur = blur;
    l.classification = classified == 1 ? v1::ExponentialShadow::THRESHOLD : v1::ExponentialShadow::Z_MAX;
    const TermPtr map = run(makeShadowEncodeNode(families[0].basis, blur, side, 1, false), {depth});
    const Timed t = timed(makeShadowLookupNode(families[0].basis, l), {gbuffer, map, bounds.term});
    std::printf("exponential, %s with fallback: %.1f ns/sample\n", classified == 1 ? "threshold" : "Z-Max", 1e9 * t.seconds / double(samples));
  }
  for (const auto& [name, pattern, size] : {std::tuple{"gaussian 5 x 5", v1::PercentageCloserShadow::GAUSSIAN, blur},
                                            {"regular 2 x 2", v1::PercentageCloserShadow::REGULAR, 2},
                                            {"regular 8 x 8", v1::PercentageCloserShadow::REGULAR, 8},
                                            {"poisson 16", v1::PercentageCloserShadow::POISSON, 4}})
    for (bool skip : {true, false}) {
      PercentageCloserLookup l;
      l.frames.face[0].lo = Vec2(0.0f);
      l.map.resolution = side;
      l.pattern = pattern;
      l.skip = skip;
      (pattern == v1::PercentageCloserShadow::GAUSSIAN ? l.map.blur : l.taps) = size;
      const Timed t = timed(makePercentageCloserNode(l), {gbuffer, bounds.term});
      std::printf("percentage-closer %-15s %s: %6.1f ns/sample\n", name, skip ? "skipping   " : "every kernel", 1e9 * t.seconds / double(samples));
    }
  return 0;
}
