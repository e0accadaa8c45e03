// SPDX-License-Identifier: Apache-2.0
// Shadows of filtered meshes beside filtered shadows: a scene's casters inflated or smoothed (request.meshes) against the plain shadow under
// shadows.style.inflation or .abstraction (docs/mesh_filters.md). Compared where both pictures show the floor: in shadow is what has less than half of
// the light. "overlap" is the area in both by the area in either, "area" the drawn shadow's by that of the filtered mesh; "plain" is the shadow of
// neither, which is what the style has to beat. Then what the filters themselves cost.
// Arguments: --size WxH (default 480x320) --threads N
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "import/load.h"
#include "plan/engine.h"
#include "request/request.h"
#include "scene/builtin/build.h"
#include "scene/mesh_filters/mesh_filters.h"

using namespace gobo;

namespace {

[[noreturn]] void fail(const Status& status) {
  std::fprintf(stderr, "mesh_filter_bench: %s\n", status.toString().c_str());
  std::exit(1);
}

struct Shadow {
  std::vector<char> floor, dark;
};

/// `light`: whose shadow; ids are those of the picture's lower left corner, which is floor.
Shadow shadowOf(Engine& engine, v1::RenderRequest request, const std::string& light, const std::vector<std::string>& edits) {
  for (const std::string& e : edits)
    if (const Status s = setPath(request, e); !s.ok()) fail(s);
  request.add_outputs("visibility:" + light);
  request.add_outputs("object_id");
  const auto result = engine.render(request);
  if (!result.ok()) fail(result.status());
  const Image &v = result->images[0].image(), &id = result->images[1].image();
  Shadow out;
  const size_t pixels = size_t(v.width) * size_t(v.height);
  const float floor = id.data[(pixels - size_t(v.width)) * size_t(id.channels)];
  for (size_t p = 0; p < pixels; ++p) {
    out.floor.push_back(id.data[p * size_t(id.channels)] == floor);
    out.dark.push_back(v.data[p * size_t(v.channels)] < 0.5f);
  }
  return out;
}

struct Likeness {
  double overlap, area;
};
Likeness compare(const Shadow& truth, const Shadow& other) {
  double both = 0, either = 0, a = 0, b = 0;
  for (size_t p = 0; p < truth.dark.size(); ++p) {
    if (!truth.floor[p] || !other.floor[p]) continue;
    both += truth.dark[p] && other.dark[p];
    either += truth.dark[p] || other.dark[p];
    a += truth.dark[p];
    b += other.dark[p];
  }
  return {both / std::max(either, 1.0), b / std::max(a, 1.0)};
}

struct LitScene {
  const char *name, *light;
  std::vector<std::string> request;
  bool fine;  ///< triangles are smaller than what they show: smoothing takes boxes of eight corners away
};

std::string number(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", v);
  return text;
}

double msOf(const MeshPtr& mesh, const MeshFilter& f, size_t& triangles) {
  double best = 1e300;
  for (int k = 0; k < 3; ++k) {
    const auto start = std::chrono::steady_clock::now();
    const auto made = filterMesh(mesh, f);
    if (!made.ok() || !made->mesh) fail(internalError("a filter made nothing"));
    triangles = made->mesh->triangles();
    best = std::min(best, std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

}  // namespace

int main(int argc, char** argv) {
  int width = 480, height = 320, threads = 2;
  for (int i = 1; i + 1 < argc; i += 2) {
    if (!std::strcmp(argv[i], "--threads")) threads = std::atoi(argv[i + 1]);
    else if (std::strcmp(argv[i], "--size") || std::sscanf(argv[i + 1], "%dx%d", &width, &height) != 2)
      return std::fprintf(stderr, "what is %s?\n", argv[i]), 2;
  }
  EngineOptions options;
  options.loader = inProcessLoader();
  options.threads = threads;
  auto engine = Engine::create(options);
  if (!engine.ok()) fail(engine.status());

  const std::vector<LitScene> scenes{
      {"tentacles",
       "lamp",
       {"lights.lamp.kind=POINT", "lights.lamp.position=2.5,6.5,2.5", "lights.lamp.intensity=60", "lights.lamp.shadow.ray_traced.samples=1"},
       true},
      {"fence", "sun", {"lights.sun.shadow.ray_traced.samples=1"}, false},
      {"spheres",
       "lamp",
       {"lights.lamp.kind=POINT", "lights.lamp.position=-3.5,5,2.5", "lights.lamp.intensity=60", "lights.lamp.shadow.ray_traced.samples=1"},
       true}};
  std::printf("| scene | mesh | style | overlap | area | plain: overlap | area |\n|---|---|---|---|---|---|---|\n");
  for (const LitScene& scene : scenes) {
    v1::RenderRequest base;
    base.set_scene(scene.name);
    base.set_width(uint32_t(width));
    base.set_height(uint32_t(height));
    base.set_view_samples(4);
    base.mutable_halt()->set_spp(1);
    for (const std::string& a : scene.request)
      if (const Status s = setPath(base, a); !s.ok()) fail(s);
    const std::string style = std::string("lights.") + scene.light + ".shadow.style.";
    const Shadow plain = shadowOf(**engine, base, scene.light, {});
    const auto row = [&](const std::vector<std::string>& mesh, const std::string& styled, const std::string& name) {
      std::vector<std::string> edits = mesh;
      edits.push_back("meshes.floor.smooth=0");  // an entry of its own: not the floor
      const Shadow truth = shadowOf(**engine, base, scene.light, edits), drawn = shadowOf(**engine, base, scene.light, {style + styled});
      const Likeness a = compare(truth, drawn), b = compare(truth, plain);
      std::printf("| `%s` | %s | `%s` | %.3f | %.3f | %.3f | %.3f |\n", scene.name, name.c_str(), styled.c_str(), a.overlap, a.area, b.overlap, b.area);
      std::fflush(stdout);
    };
    for (const double by : {0.02, 0.05, 0.1}) row({"meshes.*.inflate=" + number(by)}, "inflation=" + number(by), "inflate " + number(by) + " m");
    if (!scene.fine) continue;
    const std::pair<int, double> smooth[] = {{10, 0.02}, {40, 0.05}, {160, 0.1}};
    for (const char* how : {"LAPLACIAN", "TAUBIN"})
      for (const auto& [passes, sigma] : smooth)
        row({"meshes.*.smooth=" + std::to_string(passes), std::string("meshes.*.smoothing=") + how}, "abstraction=" + number(sigma),
            std::to_string(passes) + " passes, " + how);
  }

  builtin::MeshBuilder b;
  b.sphere(Vec3(0.0f), 1.0f, 1000, 501);
  const MeshPtr ball = b.finish("ball", 0);
  std::printf("\n| filter of a ball of %zu triangles | ms, one thread | triangles |\n|---|---|---|\n", ball->triangles());
  MeshFilter inflate, cluster, smooth;
  inflate.inflate = 0.1;
  cluster.cluster = 0.05;
  smooth.smooth = 10;
  for (const auto& [name, f] : {std::pair("inflate", inflate), std::pair("cluster 0.05 m", cluster), std::pair("smooth 10, TAUBIN", smooth)}) {
    size_t triangles = 0;
    const double ms = msOf(ball, f, triangles);
    std::printf("| %s | %.0f | %zu |\n", name, ms, triangles);
  }
}
