// SPDX-License-Identifier: Apache-2.0
// Precomputed transfer at its limits, and what a map's harmonics take:
//   harmonics  of each map of --env: time of environmentHarmonics (the least of --repeat), 5 bands, by one thread and by --threads; --coefficients PATH
//              writes them, one line a harmonic, three channels
//   maps       a map of --map WIDTH (16384: 16k x 8k, a sky with a sun and 1000 lamps, made here) through harmonics, split and a picture by
//              environment.transfer
//   triangles  a ball of about --triangles (1 000 000) of them, its surface rippled, over the scene's ground, at --points 2000, 64 samples and one bounce: the
//              precompute with its picture, then the picture under a map that is turned
// Fails (status 1) where a picture, a coefficient or a light is not finite. Arguments: --scene NAME --env FILES --map WIDTH (0: none) --triangles N (0: none)
// --points N --repeat N --threads N --coefficients PATH --out PATH
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>

#include "import/load.h"
#include "measure/report.h"
#include "plan/engine.h"
#include "request/request.h"
#include "scene/edit.h"
#include "techniques/transfer/environment_harmonics.h"
#include "techniques/transfer/environment_split.h"

using namespace gobo;

namespace {

[[noreturn]] void fail(const Status& status) {
  std::fprintf(stderr, "transfer_limits_bench: %s\n", status.toString().c_str());
  std::exit(1);
}
double secondsSince(std::chrono::steady_clock::time_point begin) { return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count(); }
template <typename Numbers>
void finite(const Numbers& numbers, const std::string& what) {
  for (const auto v : numbers)
    if (!std::isfinite(v)) fail(Status(Code::Internal, what + " are not finite"));
}

EnvironmentPtr wideMap(int width) {
  const int height = width / 2;
  Image image(width, height, 3);
  for (int y = 0; y < height; ++y) {
    const double theta = (y + 0.5) * std::numbers::pi / height, sky = 0.5 + 0.5 * std::cos(theta);
    for (int x = 0; x < width; ++x) {
      float* p = image.at(x, y);
      p[0] = float(0.4 * sky);
      p[1] = float(0.6 * sky);
      p[2] = float(sky);
    }
  }
  const auto disk = [&](double theta, double phi, double radius, float radiance) {
    const int reach = int(radius * height / std::numbers::pi) + 1, row = int(theta / std::numbers::pi * height), column = int(phi / std::numbers::pi * height);
    for (int y = std::max(row - reach, 0); y <= std::min(row + reach, height - 1); ++y)
      for (int x = -reach; x <= reach; ++x)
        if (x * x + (y - row) * (y - row) <= reach * reach) std::fill_n(image.at((column + x + width) % width, y), 3, radiance);
  };
  disk(0.7, 1.0, 0.27 * std::numbers::pi / 180, 6e4f);  // as large and as bright as half floats and the sun allow
  for (int i = 0; i < 1000; ++i) disk(std::acos(1 - 2 * (i + 0.5) / 1000), std::fmod(i * 2.399963, 2 * std::numbers::pi), 0.001, 200.0f);
  return makeEnvironment("made " + std::to_string(width) + " x " + std::to_string(height), std::move(image));
}

/// Latitude and longitude; about as many triangles as asked for.
std::shared_ptr<Mesh> rippledBall(size_t triangles, int material) {
  const int rows = std::max(2, int(std::sqrt(double(triangles) / 4))), columns = 2 * rows;
  std::vector<Vec3> positions;
  std::vector<uint32_t> indices;
  for (int y = 0; y <= rows; ++y)
    for (int x = 0; x <= columns; ++x) {
      const double theta = y * std::numbers::pi / rows, phi = x * 2 * std::numbers::pi / columns, r = 0.7 + 0.05 * std::sin(20 * theta) * std::sin(20 * phi);
      positions.emplace_back(float(r * std::sin(theta) * std::cos(phi)), float(0.8 + r * std::cos(theta)), float(-r * std::sin(theta) * std::sin(phi)));
      if (x == columns || y == rows) continue;
      const uint32_t a = uint32_t(y * (columns + 1) + x), b = a + uint32_t(columns) + 1;
      if (y > 0) indices.insert(indices.end(), {a, b, a + 1});
      if (y + 1 < rows) indices.insert(indices.end(), {a + 1, b, b + 1});
    }
  auto mesh = std::make_shared<Mesh>();
  mesh->name = "rippled ball";
  mesh->positions = std::move(positions);
  mesh->indices = std::move(indices);
  mesh->material = material;
  sealMesh(*mesh);
  return mesh;
}

class Limits {
 public:
  Limits(const std::string& scene, int threads, int points) {
    EngineOptions options;
    options.loader = inProcessLoader();
    options.threads = threads;
    options.anyPath = true;
    auto engine = Engine::create(options);
    if (!engine.ok()) fail(engine.status());
    engine_ = std::move(*engine);
    auto loaded = engine_->loadScene(scene, true);
    if (!loaded.ok()) fail(loaded.status());
    scene_ = *loaded;
    for (const std::string& e : {"scene=" + scene, std::string("width=160"), std::string("height=120"), std::string("outputs=beauty"),
                                 std::string("halt.spp=1"), "environment.transfer.points=" + std::to_string(points),
                                 std::string("environment.transfer.samples=64"), std::string("environment.transfer.bounces=1")})
      set(e);
  }
  void set(const std::string& text) {
    if (const Status s = setPath(request_, text); !s.ok()) fail(s);
  }
  /// With the scene's own lights off; `ball` may be null. Seconds.
  ScenePtr stage(const EnvironmentPtr& map, const std::shared_ptr<Mesh>& ball) const {
    auto made = editScene(*scene_, [&](Scene& s) -> Status {
      s.environment = map;
      s.lights.clear();
      Light sky;
      sky.name = "environment";
      sky.shape.kind = LightKind::Environment;
      sky.power = Vec3(1.0f);
      s.lights.push_back(sky);
      if (!ball) return {};
      s.meshes.push_back(ball);
      s.instances.push_back({"rippled ball", int(s.meshes.size()) - 1, Mat4(1.0f)});
      return {};
    });
    if (!made.ok()) fail(made.status());
    return *made;
  }
  double render(const ScenePtr& scene) const {
    RenderControl control;
    control.scene = scene;
    const auto begin = std::chrono::steady_clock::now();
    const auto result = engine_->render(request_, control);
    if (!result.ok()) fail(result.status());
    const double seconds = secondsSince(begin);
    const Image& image = result->images[0].image();
    finite(image.data, "a picture's pixels");
    if (*std::max_element(image.data.begin(), image.data.end()) <= 0) fail(Status(Code::Internal, "a picture is black"));
    return seconds;
  }

 private:
  std::shared_ptr<Engine> engine_;
  ScenePtr scene_;
  v1::RenderRequest request_;
};

double harmonicsSeconds(const Environment& map, int threads, int repeat, std::vector<double>& coefficients) {
  const TaskArena arena(threads);
  double least = 1e30;
  for (int k = 0; k < repeat; ++k) {
    const auto begin = std::chrono::steady_clock::now();
    coefficients = transfer::environmentHarmonics(map, 5, arena);
    least = std::min(least, secondsSince(begin));
  }
  finite(coefficients, "harmonics");
  return least;
}

}  // namespace

int main(int argc, char** argv) {
  const auto number = [&](const char* flag, const char* fallback) { return std::atoi(argumentOr(argc, argv, flag, fallback).c_str()); };
  const int threads = number("--threads", "2"), repeat = std::max(number("--repeat", "21"), 1), width = number("--map", "16384"),
            triangles = number("--triangles", "1000000");
  Table table("Precomputed transfer at its limits", {"what", "step", "seconds"});
  const std::string coefficients = argumentOr(argc, argv, "--coefficients", "");
  std::FILE* to = coefficients.empty() ? nullptr : std::fopen(coefficients.c_str(), "w");
  for (const std::string& file : partsOf(argumentOr(argc, argv, "--env", ""), ',')) {
    auto map = loadEnvironment(file);
    if (!map.ok()) fail(map.status());
    std::vector<double> c;
    for (const int n : {1, threads}) table.add({file, "harmonics, threads: " + std::to_string(n), harmonicsSeconds(**map, n, repeat, c)});
    for (size_t h = 0; to && h < c.size(); h += 3) std::fprintf(to, "%.12g %.12g %.12g\n", c[h], c[h + 1], c[h + 2]);
  }
  if (to) std::fclose(to);
  Limits limits(argumentOr(argc, argv, "--scene", "fence"), threads, number("--points", "2000"));
  if (width > 0) {
    auto begin = std::chrono::steady_clock::now();
    const EnvironmentPtr map = wideMap(width);
    table.add({map->name, "made", secondsSince(begin)});
    const TaskArena arena(threads);
    begin = std::chrono::steady_clock::now();
    std::vector<double> c = transfer::environmentHarmonics(*map, 5, arena);
    finite(c, "harmonics");
    table.add({map->name, "harmonics", secondsSince(begin)});
    begin = std::chrono::steady_clock::now();
    const transfer::EnvironmentSplit split = transfer::splitEnvironment(*map, 5, 16, 0.02, arena);
    finite(split.rest, "what lights leave");
    if (split.lights.empty()) fail(Status(Code::Internal, "the sun was not found"));
    for (const transfer::SkyDisk& light : split.lights) finite(std::vector<double>{light.flux.x, light.flux.y, light.flux.z, light.radius}, "lights");
    table.add({map->name, "split, lights: " + std::to_string(split.lights.size()), secondsSince(begin)});
    table.add({map->name, "first picture, precompute and analysis", limits.render(limits.stage(map, nullptr))});
  }
  if (triangles > 0) {
    const auto begin = std::chrono::steady_clock::now();
    const auto ball = rippledBall(size_t(triangles), 0);
    const ScenePtr scene = limits.stage(wideMap(512), ball);
    const std::string name = std::to_string(ball->triangles()) + " triangles more";
    table.add({name, "made", secondsSince(begin)});
    table.add({name, "first picture, tree and precompute", limits.render(scene)});
    limits.set("environment.rotation_deg=40");
    table.add({name, "turned", limits.render(scene)});
  }
  std::printf("%s", table.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  if (out.empty()) return 0;
  if (const Status s = table.write(out); !s.ok()) fail(s);
  return 0;
}
