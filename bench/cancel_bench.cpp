// SPDX-License-Identifier: Apache-2.0
// How long a stopped request keeps the cores: from stop() to the return, at random moments, in milliseconds: median, 95 %, worst. Rows: every
// shadow technique of the registry, everything that can stand for an environment, caustics, a certificate, each by a new engine (acceleration
// structures, probes and fits included) and by one that has them; admission's planning; loads of files in this process.
// --polls looks for what random moments rarely hit: the longest processor time of one thread between two polls, over one whole run of
// each row at one sample a pixel. Processor time, so that other work on the machine does not count.
// Usage: cancel_bench [--out table.json] [--repeat 40] [--only TEXT] [--size 1280x720] [--load FILE.glb] [--environment FILE.hdr] [--polls yes]
#include <pthread.h>
#include <time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <thread>
#include <vector>

#include "base/sobol.h"
#include "filters/shadow_technique.h"
#include "import/load.h"
#include "measure/report.h"
#include "plan/engine.h"
#include "request/request.h"

namespace {

using namespace gobo;
using Clock = std::chrono::steady_clock;

struct Case {
  std::string name;
  std::vector<std::string> sets;
  v1::ShadowTechnique::TechniqueCase technique = v1::ShadowTechnique::TECHNIQUE_NOT_SET;
  bool area = true;
};

v1::RenderRequest requestOf(const Case& c, const std::string& size, int k) {
  v1::RenderRequest r;
  std::vector<std::string> sets{"scene=atrium",
                                "width=" + size.substr(0, size.find('x')),
                                "height=" + size.substr(size.find('x') + 1),
                                "halt.spp=1024",
                                "seed=" + std::to_string(k),
                                std::string("lights.key.kind=") + (c.area ? "RECT" : "SPOT"),
                                "lights.key.position=0,6,0",
                                "lights.key.direction=0,-1,0",
                                "lights.key.intensity=30"};
  sets.insert(sets.end(), c.sets.begin(), c.sets.end());
  for (const std::string& s : sets)
    if (const Status set = setPath(r, s); !set.ok()) std::fprintf(stderr, "%s: %s\n", s.c_str(), set.toString().c_str());
  if (c.technique != v1::ShadowTechnique::TECHNIQUE_NOT_SET) {
    v1::ShadowTechnique& t = *(*r.mutable_lights())["key"].mutable_shadow();
    t.GetReflection()->MutableMessage(&t, t.GetDescriptor()->FindFieldByNumber(c.technique));
  }
  return r;
}

struct Times {
  std::vector<double> ms;
  int completed = 0;
  void run(int k, const std::function<Status(StopToken)>& work) {
    StopSource source;
    Clock::time_point stopped;
    std::thread canceller([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(5 + hash32(uint64_t(k), 7) % 1500));
      stopped = Clock::now();
      source.stop(StopReason::Cancelled);
    });
    const Status status = work(source.token());
    const auto returned = Clock::now();
    canceller.join();
    if (status.ok()) ++completed;
    else ms.push_back(std::chrono::duration<double, std::milli>(returned - stopped).count());
  }
  void row(Table& t, const std::string& name) {
    std::sort(ms.begin(), ms.end());
    if (ms.empty()) t.add({name, 0.0, 0.0, 0.0, double(completed)});
    else t.add({name, ms[ms.size() / 2], ms[ms.size() * 95 / 100], ms.back(), double(completed)});
  }
};

/// Watches the calling thread, which does all the work.
struct Gap {
  double ms = 0;
  int at = 0, polls = 0;
  Status status;
  explicit Gap(const std::function<Status(StopToken)>& work) {
    constexpr int many = 1 << 30;
    StopSource source;
    source.stopAtPoll(many);
    clockid_t clock;
    ::pthread_getcpuclockid(::pthread_self(), &clock);
    const auto now = [clock] {
      timespec t;
      ::clock_gettime(clock, &t);
      return double(t.tv_sec) * 1e3 + double(t.tv_nsec) * 1e-6;
    };
    std::atomic<bool> done{false};
    std::thread watcher([&] {
      double since = now();
      for (int last = many;; std::this_thread::sleep_for(std::chrono::microseconds(200))) {
        const bool over = done.load();
        const int left = source.pollsLeft();
        const double t = now();
        if (t - since > ms) {
          ms = t - since;
          at = many - last;
        }
        if (left != last) {
          since = t;
          last = left;
        }
        if (over) break;
      }
    });
    status = work(source.token());
    done = true;
    watcher.join();
    polls = many - source.pollsLeft();
  }
};

/// One whole run of every row, one sample a pixel, one thread.
int longestGaps(const std::vector<Case>& cases, const std::string& only, const std::string& size, const std::string& load, const std::string& out) {
  EngineOptions options;
  options.loader = inProcessLoader();
  options.anyPath = true;
  options.threads = 1;
  Table t("Longest time without a poll", {"work", "ms", "after poll", "polls"});
  const auto row = [&](const std::string& name, const std::function<Status(StopToken)>& work) {
    const Gap gap(work);
    if (!gap.status.ok()) std::fprintf(stderr, "%s: %s\n", name.c_str(), gap.status.toString().c_str());
    t.add({name, gap.ms, double(gap.at), double(gap.polls)});
  };
  for (const Case& c : cases) {
    if (c.name.find(only) == std::string::npos) continue;
    const auto engine = *Engine::create(options);
    v1::RenderRequest request = requestOf(c, size, 0);
    request.mutable_halt()->set_spp(1);
    if (request.has_certificate()) {
      request.mutable_certificate()->set_spp(4);
      request.mutable_certificate()->set_pixel_fraction(0.01);
    }
    row(c.name + ", admission", [&](StopToken stop) { return engine->prepare(request, nullptr, stop).status(); });  // makes the scene
    row(c.name, [&](StopToken stop) {
      RenderControl control;
      control.stop = stop;
      return engine->render(request, control).status();
    });
  }
  if (!load.empty())
    row("load of " + load.substr(load.find_last_of('/') + 1), [&](StopToken stop) { return (*Engine::create(options))->openScene(load, "s", stop).status(); });
  std::printf("%s", t.text().c_str());
  return out.empty() || t.write(out).ok() ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  const int repeat = std::max(4, std::atoi(argumentOr(argc, argv, "--repeat", "40").c_str()));
  const std::string only = argumentOr(argc, argv, "--only", ""), size = argumentOr(argc, argv, "--size", "1280x720");
  const std::string load = argumentOr(argc, argv, "--load", ""), map = argumentOr(argc, argv, "--environment", "");
  std::vector<Case> cases{{"path_traced", {"lights.key.shadow.path_traced="}}};
  for (const ShadowTechniqueEntry& t : shadowTechniques()) cases.push_back({t.name, {}, t.key, t.supports(LightKind::Rect)});
  for (const char* as : {"area_lights=45", "extract_lights=64", "gain=1,1,1"})
    cases.push_back(
        {std::string("environment ") + as, {map.empty() ? "environment.sky.turbidity=3" : "environment.path=" + map, std::string("environment.") + as}});
  cases.push_back({"caustics", {"lights.key.kind=POINT", "integrator.caustic_photons=100000"}});
  cases.push_back({"certificate", {"halt.spp=1", "certificate.pixel_fraction=0.2", "certificate.spp=256"}});

  if (argumentOr(argc, argv, "--polls", "") == "yes") return longestGaps(cases, only, size, load, argumentOr(argc, argv, "--out", ""));
  EngineOptions options;
  options.loader = inProcessLoader();
  options.anyPath = true;
  Table t("Cancellation: stop() to return", {"work", "median ms", "p95 ms", "worst ms", "completed first"});
  for (const Case& c : cases) {
    if (c.name.find(only) == std::string::npos) continue;
    for (const bool warm : {false, true}) {
      Times times;
      auto engine = Engine::create(options);
      for (int k = 0; k < repeat; ++k) {
        if (!warm) engine = Engine::create(options);
        (void)(*engine)->inspectScene("atrium");
        times.run(k, [&](StopToken stop) {
          RenderControl control;
          control.stop = stop;
          return (*engine)->render(requestOf(c, size, k), control).status();
        });
      }
      times.row(t, c.name + (warm ? ", warm engine" : ", new engine"));
    }
    Times planning;
    for (int k = 0; k < repeat; ++k) {
      auto engine = Engine::create(options);
      (void)(*engine)->inspectScene("atrium");
      planning.run(k, [&](StopToken stop) { return (*engine)->prepare(requestOf(c, size, k), nullptr, stop).status(); });
    }
    if (!planning.ms.empty()) planning.row(t, c.name + ", admission");
  }
  if (!load.empty()) {
    Times times;
    for (int k = 0; k < repeat; ++k) times.run(k, [&](StopToken stop) { return (*Engine::create(options))->openScene(load, "s", stop).status(); });
    times.row(t, "load of " + load.substr(load.find_last_of('/') + 1));
  }
  std::printf("%s", t.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  return out.empty() || t.write(out).ok() ? 0 : 1;
}
