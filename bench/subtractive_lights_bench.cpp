// SPDX-License-Identifier: Apache-2.0
// Subtractive shadows of a scene's lights (shadows.subtractive) against the same number of lights added up: the strongest by their unshadowed light in the
// picture, each with a hard shadow and scaled together to the light of all. Direct light alone, against path-traced halves (direct_light.h). All lights of a kind
// that subtractive shadows do; an environment is taken out.
// Arguments: --scene NAME|FILE --added N (the scene's own lights off, N points of as many colours and strengths anywhere over it instead) --set assignments, separated by spaces --size WxH --lights N,N,... --resolutions R,R,...
//            --forms F,F,... --reference N (samples of each half) --threads N --out PATH --pictures PREFIX
#include <numeric>

#include "base/sobol.h"
#include "direct_light.h"

using namespace gobo;
using namespace gobo::bench;

namespace {

/// Over the scene's box, from a quarter of its height to once more of it; none alike.
std::vector<std::string> addLamps(v1::RenderRequest& request, const Scene& scene, int count) {
  Vec3 lo, hi;
  scene.bounds(lo, hi);
  const auto apply = [&](const std::string& edit) {
    if (const Status s = setPath(request, edit); !s.ok()) fail(s);
  };
  const auto three = [](const Vec3& v) { return std::to_string(v.x) + "," + std::to_string(v.y) + "," + std::to_string(v.z); };
  apply("integrator.max_groups=1024");
  for (const Light& l : scene.lights)
    if (l.shape.kind != LightKind::Environment) apply("lights." + l.name + ".enabled=false");
  std::vector<std::string> names;
  for (int i = 0; i < count; ++i) {
    const auto random = [&](uint64_t k) { return toUnit(hash32(hash64(77, uint64_t(i)), k)); };
    const std::string name = "added" + std::to_string(i), light = "lights." + name;
    const Vec3 share(random(0), 0.25f + 1.75f * random(1), random(2));
    apply(light + ".kind=POINT");
    apply(light + ".position=" + three(lo + (hi - lo) * share));
    apply(light + ".color=" + three(Vec3(0.3f) + 0.7f * Vec3(random(3), random(4), random(5))));
    apply(light + ".intensity=" + std::to_string(0.2f + 2.0f * random(6) * random(6)));
    names.push_back(name);
  }
  return names;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string scene = argumentOr(argc, argv, "--scene", "lamps"), reference = argumentOr(argc, argv, "--reference", "256");
  int width = 0, height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "120x90").c_str(), "%dx%d", &width, &height);
  const int added = std::atoi(argumentOr(argc, argv, "--added", "0").c_str());
  if (width < 1 || height < 1 || added < 0 || std::atoi(reference.c_str()) < 1) fail(invalidArgument("--size, --added and --reference must be positive (--added: or 0)"));
  v1::RenderRequest request;
  for (const std::string& e : {"scene=" + scene, "width=" + std::to_string(width), "height=" + std::to_string(height), std::string("outputs=direct"),
                               std::string("integrator.max_bounces=0"), std::string("integrator.at_view_samples=true"),
                               std::string("environment.path=none")})
    if (const Status s = setPath(request, e); !s.ok()) fail(s);
  for (const std::string& e : partsOf(argumentOr(argc, argv, "--set", ""), ' '))
    if (const Status s = setPath(request, e); !s.ok()) fail(s);
  const int threads = std::atoi(argumentOr(argc, argv, "--threads", "2").c_str());
  const std::string pictures = argumentOr(argc, argv, "--pictures", "");
  const ScenePtr loaded = Bench(request, threads, "").scene();
  std::vector<std::string> lights;
  if (added == 0) {
    for (const Light& l : loaded->lights)
      if (l.shape.kind != LightKind::Environment) lights.push_back(l.name);
  } else {
    lights = addLamps(request, *loaded, added);
  }
  const Bench bench(request, threads, pictures);
  const Run a = bench.render({"halt.spp=" + reference, "seed=1001"}, "reference_a"), b = bench.render({"halt.spp=" + reference, "seed=1002"}, "reference_b");
  const Run albedo = bench.render({"halt.spp=1", "outputs=albedo"}, "albedo");
  const Errors errors(a.image, b.image, albedo.image);

  // Unshadowed light of each in the picture.
  std::vector<double> given(lights.size(), 0.0);
  {
    std::vector<std::string> edits{"halt.spp=1"};
    std::string outputs = "outputs=";
    for (const std::string& l : lights) outputs += "unoccluded:" + l + ",";
    outputs.pop_back();
    edits.push_back(outputs);
    const std::vector<Image> images = bench.images(edits);
    for (size_t i = 0; i < lights.size(); ++i)
      for (const float v : images[i].data) given[i] += double(v);
  }
  std::vector<size_t> order(lights.size());
  std::iota(order.begin(), order.end(), size_t(0));
  std::stable_sort(order.begin(), order.end(), [&](size_t x, size_t y) { return given[x] > given[y]; });
  const double sum = std::accumulate(given.begin(), given.end(), 0.0);

  Table table("Subtractive shadows of lights", {"method", "lights", "r", "RMSE / mean", "dark", "displayed", "CPU s", "Mrays"});
  table.note("scene", scene);
  table.note("lights", double(lights.size()));
  table.note("pixels", double(width) * height);
  table.note("reference samples a pixel, each of two halves", reference);
  const auto row = [&](const std::string& method, const std::string& n, const std::string& r, const Run& run) {
    table.add({method, n, r, errors.relative(run.image), errors.dark(run.image), errors.displayed(run.image), run.seconds, 1e-6 * run.rays});
  };
  row("all, one ray each", std::to_string(lights.size()), "1", bench.render({"halt.spp=1", "shadows.ray_traced.samples=1"}, "all"));
  for (const std::string& n : partsOf(argumentOr(argc, argv, "--lights", "15,40,100"), ',')) {
    const size_t kept = std::min(size_t(std::max(std::atoi(n.c_str()), 1)), lights.size());
    double part = 0;
    for (size_t k = 0; k < kept; ++k) part += given[order[k]];
    const std::string gain = std::to_string(part > 0 ? sum / part : 1.0);
    std::vector<std::string> edits{"halt.spp=1", "shadows.ray_traced.samples=1", "integrator.max_groups=1024"};  // each a group: gains
    for (size_t k = 0; k < lights.size(); ++k)
      edits.push_back("lights." + lights[order[k]] + (k < kept ? ".gain=" + gain + "," + gain + "," + gain : std::string(".enabled=false")));
    row("additive", n, "1", bench.render(edits, "additive_" + n));
    for (const std::string& r : partsOf(argumentOr(argc, argv, "--resolutions", "1,4,16"), ','))
      for (const std::string& form : partsOf(argumentOr(argc, argv, "--forms", "RATIO,DIFFERENCE"), ','))
        row(form, n, r,
            bench.render({"halt.spp=1", "shadows.subtractive.lights=" + n, "shadows.subtractive.resolution=" + r, "shadows.subtractive.form=" + form},
                         form + "_" + n + "_" + r));
  }
  std::printf("%s", table.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  if (out.empty()) return 0;
  if (const Status s = table.write(out); !s.ok()) fail(s);
  return 0;
}
