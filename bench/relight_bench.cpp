// SPDX-License-Identifier: Apache-2.0
// What a relight costs: a colour edit of 8 relight groups at 1280x720 against one memory pass over the same terms with the
// same threads. Also how long the first render took, for scale. Median of --repeat edits, each to new colours.
// Usage: relight_bench [--out table.json] [--size 1280x720] [--spp 16] [--repeat 31]
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "base/task_arena.h"
#include "measure/report.h"
#include "plan/engine.h"
#include "request/request.h"

namespace {

using namespace gobo;
using Clock = std::chrono::steady_clock;
double msSince(Clock::time_point t) { return std::chrono::duration<double, std::milli>(Clock::now() - t).count(); }
double median(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  return v[v.size() / 2];
}

/// The floor: read `planes` RGB float planes of n pixels once, write one.
double memoryPass(const TaskArena& arena, size_t pixels, int planes, int repeat) {
  std::vector<std::vector<float>> in(size_t(planes), std::vector<float>(pixels * 3, 0.5f));
  std::vector<float> out(pixels * 3);
  std::vector<double> times;
  for (int k = 0; k < repeat; ++k) {
    const auto begun = Clock::now();
    arena.parallelFor(pixels * 3, 1 << 15, [&](size_t b, size_t e) {
      constexpr size_t kRun = 1024;
      for (size_t r = b; r < e; r += kRun) {
        float sum[kRun] = {};
        const size_t n = std::min(kRun, e - r);
        for (const auto& plane : in)
          for (size_t i = 0; i < n; ++i) sum[i] += plane[r + i];
        std::copy(sum, sum + n, out.begin() + ptrdiff_t(r));
      }
    });
    times.push_back(msSince(begun));
  }
  return median(times) + (out[0] < 0 ? 1 : 0);
}

}  // namespace

int main(int argc, char** argv) {
  const int repeat = std::max(1, std::atoi(argumentOr(argc, argv, "--repeat", "31").c_str()));
  unsigned width = 1280, height = 720;
  std::sscanf(argumentOr(argc, argv, "--size", "1280x720").c_str(), "%ux%u", &width, &height);
  auto engine = Engine::create({});
  v1::RenderRequest r;
  r.set_scene("lights8");
  r.set_width(width);
  r.set_height(height);
  r.mutable_halt()->set_spp(uint32_t(std::max(1, std::atoi(argumentOr(argc, argv, "--spp", "16").c_str()))));
  const auto first = (*engine)->render(r);
  if (!first.ok()) {
    std::fprintf(stderr, "relight_bench: %s\n", first.status().toString().c_str());
    return 1;
  }
  const auto info = *(*engine)->inspectScene("lights8");
  std::vector<double> edit, composite;
  for (int k = 0; k < repeat; ++k) {
    for (const auto& light : info.lights()) {
      const std::string gain = std::to_string(0.5 + 0.01 * k) + ",1," + std::to_string(1.5 - 0.01 * k);
      (void)setPath(r, "lights." + light.name() + ".gain=" + gain);
    }
    const auto begun = Clock::now();
    const auto result = (*engine)->render(r);
    edit.push_back(msSince(begun));
    for (const auto& n : result->reply.plan())
      if (n.node() == "beauty") composite.push_back(n.ms());
  }
  const TaskArena arena((*engine)->threads());
  const double floor = memoryPass(arena, size_t(width) * height, info.lights_size(), repeat);
  Table t("Relight: colours of " + std::to_string(info.lights_size()) + " groups", {"what", "ms", "of the memory pass"});
  t.note("size", std::to_string(width) + "x" + std::to_string(height));
  t.note("threads", double((*engine)->threads()));
  t.note("first render ms", first->reply.total_ms());
  t.add({std::string("one memory pass over the same terms"), floor, 1.0});
  t.add({std::string("composite node"), median(composite), median(composite) / floor});
  t.add({std::string("whole request: resolve, plan, keys, composite, finite check"), median(edit), median(edit) / floor});
  std::printf("%s", t.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  return out.empty() || t.write(out).ok() ? 0 : 1;
}
