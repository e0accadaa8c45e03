// SPDX-License-Identifier: Apache-2.0
// Peak resident memory of a render, by scene, each in a process of its own; and of 1000 lights, path traced and folded one by one.
// Usage: memory_bench [--out table.json]
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <string>
#include <vector>

#include "measure/report.h"
#include "plan/engine.h"
#include "request/request.h"

namespace {

using namespace gobo;

/// Renders in a child process; peak RSS in MiB, or -1.
double peakOf(const std::vector<std::string>& sets, double* seconds) {
  int pipes[2];
  if (pipe(pipes) != 0) return -1;
  const pid_t child = fork();
  if (child == 0) {
    v1::RenderRequest r;
    for (const auto& s : sets) (void)setPath(r, s);
    auto engine = Engine::create({});
    const auto result = (*engine)->render(r);
    const double s = result.ok() ? result->reply.total_ms() * 1e-3 : -1;
    if (write(pipes[1], &s, sizeof s) != sizeof s) _exit(1);
    _exit(result.ok() ? 0 : 1);
  }
  close(pipes[1]);
  if (read(pipes[0], seconds, sizeof *seconds) != sizeof *seconds) *seconds = -1;
  close(pipes[0]);
  int status = 0;
  rusage usage{};
  wait4(child, &status, 0, &usage);
  return status == 0 ? double(usage.ru_maxrss) / 1024.0 : -1;
}

}  // namespace

int main(int argc, char** argv) {
  Table t("Peak memory", {"render", "peak MiB", "seconds"});
  const auto row = [&](const std::string& name, const std::vector<std::string>& sets) {
    double seconds = 0;
    const double peak = peakOf(sets, &seconds);
    t.add({name, peak, seconds});
    std::fprintf(stderr, "%s: %.0f MiB, %.1f s\n", name.c_str(), peak, seconds);
  };
  for (const char* scene : {"cornell", "grids", "fence", "tentacles", "spheres", "trees", "atrium"})
    row(std::string(scene) + " 640x480, 16 spp", {std::string("scene=") + scene, "halt.spp=16"});
  row("lamps (1000 lights) 1280x720, path traced", {"scene=lamps", "width=1280", "height=720", "halt.spp=4"});
  row("lamps (1000 lights) 320x180, ray-traced visibility folded", {"scene=lamps", "width=320", "height=180", "halt.spp=1", "view_samples=1",
                                                                    "integrator.indirect=false", "integrator.max_groups=1", "shadows.ray_traced.samples=1"});
  std::printf("%s", t.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  return out.empty() || t.write(out).ok() ? 0 : 1;
}
