// SPDX-License-Identifier: Apache-2.0
// How long a stopped render keeps the cores: from stop() to the return of Engine::render, at random moments of a first
// render of a large scene (acceleration structure build included) and of a second one. Milliseconds: median, 95 %, worst.
// Usage: cancel_bench [--out table.json] [--repeat 40]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>
#include <vector>

#include "base/sobol.h"
#include "measure/report.h"
#include "plan/engine.h"
#include "plan/request.h"

int main(int argc, char** argv) {
  using namespace gobo;
  using Clock = std::chrono::steady_clock;
  const int repeat = std::max(4, std::atoi(argumentOr(argc, argv, "--repeat", "40").c_str()));
  Table t("Cancellation: stop() to return", {"render", "median ms", "p95 ms", "worst ms", "completed first"});
  for (const char* technique : {"path_traced=", "axis_aligned.k=3"}) {
    for (const bool warm : {false, true}) {
      std::vector<double> times;
      int completed = 0;
      auto engine = Engine::create({});
      for (int k = 0; k < repeat; ++k) {
        if (!warm) engine = Engine::create({});
        v1::RenderRequest r;
        for (const std::string& s : {std::string("scene=atrium"), std::string("width=1280"), std::string("height=720"), std::string("halt.spp=1024"), "seed=" + std::to_string(k),
                                     std::string("lights.key.kind=RECT"), std::string("lights.key.position=0,6,0"), std::string("lights.key.direction=0,-1,0"),
                                     std::string("lights.key.intensity=30"), std::string("lights.key.shadow.") + technique})
          (void)setPath(r, s);
        (void)(*engine)->inspectScene("atrium");
        StopSource source;
        RenderControl control;
        control.stop = source.token();
        Clock::time_point stopped;
        std::thread canceller([&] {
          std::this_thread::sleep_for(std::chrono::milliseconds(5 + hash32(uint64_t(k), 7) % 1500));
          stopped = Clock::now();
          source.stop(StopReason::Cancelled);
        });
        const auto result = (*engine)->render(r, control);
        const auto returned = Clock::now();
        canceller.join();
        if (result.ok()) { ++completed; continue; }
        times.push_back(std::chrono::duration<double, std::milli>(returned - stopped).count());
      }
      std::sort(times.begin(), times.end());
      if (times.empty()) continue;
      t.add({std::string(technique) + (warm ? " warm engine" : " new engine"), times[times.size() / 2], times[times.size() * 95 / 100], times.back(), double(completed)});
    }
  }
  std::printf("%s", t.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  return out.empty() || t.write(out).ok() ? 0 : 1;
}
