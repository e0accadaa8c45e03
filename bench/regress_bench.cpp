// SPDX-License-Identifier: Apache-2.0
// How often the test behind `gobo regress` (measure/change.h) is wrong: false alarms over pairs of renders that differ in their seeds alone, and changes of a
// known size that it finds, with the seeds of the reference and with others. Renders are in parts of --spp samples; pairs of a scene share a pool of renders,
// so that its runs are as many draws of pairs, not as many renders. RMSE: between the means of parts, of the first pair. Arguments: --scenes NAME,NAME,...
// --size WxH --spp N (each part) --parts N --pool N (renders) --runs N (pairs) --changes N (pairs of each; 0: none)
//            --out FILE (.csv, .json, .md)
#include <cstdio>
#include <cstdlib>
#include <random>

#include "import/load.h"
#include "measure/change.h"
#include "measure/metrics.h"
#include "measure/report.h"
#include "plan/engine.h"
#include "request/request.h"

using namespace gobo;

namespace {

[[noreturn]] void stop(const Status& status) {
  std::fprintf(stderr, "regress_bench: %s\n", status.toString().c_str());
  std::exit(1);
}

/// What a change takes: a path of the request, or another scene.
struct Change {
  std::string name, set;
  std::shared_ptr<const Scene> scene;
};

std::shared_ptr<const Scene> sealed(Scene scene) {
  if (const Status s = scene.seal(); !s.ok()) stop(s);
  return std::make_shared<const Scene>(std::move(scene));
}

/// One light, one material and one object of the scene: the first lamp, the material of the object, an object that is neither lamp nor room.
std::vector<Change> changesOf(const std::shared_ptr<const Scene>& scene, const std::string& name, int width) {
  const std::string object = name == "cornell"   ? "short"
                             : name == "lights8" ? "small-block"
                             : name == "atrium"  ? "column-lower0"
                                                 : scene->instances.back().name;
  const int at = scene->findInstance(object);
  if (at < 0) stop(notFound("no object \"" + object + "\" in " + name));
  const std::string light = scene->lights.front().name;
  std::vector<Change> out;
  out.push_back({"light '" + light + "' 1 % brighter", "lights." + light + ".gain=1.01,1.01,1.01", nullptr});
  out.push_back({"light '" + light + "' 2 % redder", "lights." + light + ".gain=1.02,1,1", nullptr});
  Scene painted = *scene;
  const int material = scene->meshes[size_t(scene->instances[size_t(at)].mesh)]->material;
  painted.materials[size_t(material)].albedo.factor *= 0.99f;
  out.push_back({"material '" + painted.materials[size_t(material)].name + "' 1 % darker", "", sealed(std::move(painted))});
  out.push_back({"camera one pixel aside", "camera.center_x=" + std::to_string(width / 2 + 1), nullptr});
  Scene robbed = *scene;
  robbed.instances.erase(robbed.instances.begin() + at);
  for (Light& l : robbed.lights)
    if (l.shape.kind == LightKind::Mesh && int(l.shape.instance) > at) --l.shape.instance;
  out.push_back({"object '" + object + "' missing", "", sealed(std::move(robbed))});
  return out;
}

struct Settings {
  int width = 96, height = 72, spp = 8, parts = 8, pool = 100, runs = 1000, changes = 100;
};

std::vector<Image> renderParts(Engine& engine, const std::string& scene, const Settings& s, const Change& change, int group) {
  std::vector<Image> parts;
  for (int k = 0; k < s.parts; ++k) {
    v1::RenderRequest r;
    r.set_scene(scene);
    r.set_width(uint32_t(s.width));
    r.set_height(uint32_t(s.height));
    r.mutable_halt()->set_spp(uint32_t(s.spp));
    r.set_seed(uint64_t(group) * uint64_t(s.parts) + uint64_t(k));
    if (!change.set.empty())
      if (const Status status = setPath(r, change.set); !status.ok()) stop(status);
    RenderControl control;
    control.scene = change.scene;
    auto result = engine.render(r, control);
    if (!result.ok()) stop(result.status());
    parts.push_back(result->images[0].image());
  }
  return parts;
}

struct Count {
  int runs = 0, found = 0;
  double weakest = 1e9, strongest = -1e9;
  void add(const ChangeFigures& f) {
    ++runs;
    found += f.changed;
    weakest = std::min(weakest, f.excess);
    strongest = std::max(strongest, f.excess);
  }
};

ChangeFigures figures(const std::vector<Image>& a, const std::vector<Image>& b) {
  auto f = findChange(a, b);
  if (!f.ok()) stop(f.status());
  return std::move(*f);
}

double rmse(const std::vector<Image>& a, const std::vector<Image>& b) {
  const auto e = compareImages(meanOf(b), meanOf(a), std::vector<uint8_t>(a[0].pixels(), 1));
  return e.ok() ? e->rmse : 0;
}

}  // namespace

int main(int argc, char** argv) {
  Settings s;
  const auto number = [&](const char* flag, int& to) { to = std::atoi(argumentOr(argc, argv, flag, std::to_string(to)).c_str()); };
  if (std::sscanf(argumentOr(argc, argv, "--size", "96x72").c_str(), "%dx%d", &s.width, &s.height) != 2) stop(invalidArgument("--size: WIDTHxHEIGHT"));
  number("--spp", s.spp), number("--parts", s.parts), number("--pool", s.pool), number("--runs", s.runs), number("--changes", s.changes);
  if (s.pool < 2 || s.changes >= s.pool) stop(invalidArgument("--pool: at least 2, and more than --changes"));
  EngineOptions options;
  options.loader = inProcessLoader();
  auto engine = Engine::create(options);
  if (!engine.ok()) stop(engine.status());
  Table table("regress", {"scene", "difference", "seeds", "runs", "called changed", "%", "excess from", "to", "RMSE"});
  for (const std::string& name : partsOf(argumentOr(argc, argv, "--scenes", "cornell"), ',')) {
    auto scene = (*engine)->loadScene(name, true);
    if (!scene.ok()) stop(scene.status());
    const Change none{"none", "", nullptr};
    std::vector<std::vector<Image>> pool;
    for (int g = 0; g < s.pool; ++g) pool.push_back(renderParts(**engine, name, s, none, g));
    const auto add = [&](const std::string& what, const char* seeds, const Count& c, double error) {
      table.add({name, what, std::string(seeds), double(c.runs), double(c.found), c.runs ? 100.0 * c.found / c.runs : 0.0, c.weakest, c.strongest, error});
      std::fprintf(stderr, "%s, %s, seeds %s: %d of %d, excess %.3g to %.3g\n", name.c_str(), what.c_str(), seeds, c.found, c.runs, c.weakest, c.strongest);
    };
    std::mt19937 random(1);
    Count reseeded;
    for (int i = 0; i < s.runs; ++i) {
      const int a = int(random() % uint64_t(s.pool)), b = int((uint64_t(a) + 1 + random() % uint64_t(s.pool - 1)) % uint64_t(s.pool));
      reseeded.add(figures(pool[size_t(a)], pool[size_t(b)]));
    }
    add("none", "others", reseeded, rmse(pool[0], pool[1]));
    if (s.changes == 0) continue;
    for (const Change& change : changesOf(*scene, name, s.width)) {
      Count same, other;
      double sameRmse = 0, otherRmse = 0;
      for (int i = 0; i < s.changes; ++i) {
        const std::vector<Image> now = renderParts(**engine, name, s, change, i);
        same.add(figures(pool[size_t(i)], now));
        other.add(figures(pool[size_t(i) + 1], now));
        if (i == 0) sameRmse = rmse(pool[0], now), otherRmse = rmse(pool[1], now);
      }
      add(change.name, "the same", same, sameRmse);
      add(change.name, "others", other, otherRmse);
    }
  }
  std::printf("%s", table.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  if (!out.empty())
    if (const Status status = table.write(out); !status.ok()) stop(status);
  return 0;
}
