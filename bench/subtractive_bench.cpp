// SPDX-License-Identifier: Apache-2.0
// Subtractive shadows (environment.subtractive) against the same number of lights added up (environment.extract_lights with hard shadows): direct light of a
// scene under a map alone, error against a path-traced reference at the same view samples. RMSE by the picture's mean, free of the reference's noise: the root
// of the mean of (x - a)(x - b), a and b its halves. "dark": of the quarter of the lit pixels that has the least light for its albedo, by their own mean. CPU
// seconds of an engine that has the scene and its acceleration structure but no term. "displayed": RMSE of 1 - exp(-x / mean), the noise of the halves in it.
// Arguments: --scene NAME|FILE --env FILE|sky --set assignments of the request, separated by spaces --size WxH --lights N,N,... --resolutions R,R,... --forms
// F,F,...
//            --table46: the source's table instead, of --scenes NAME|FILE,... under --maps FILE|sky,... (bright_lights: the first of --bright)
//            --unshadowed WAY (where C comes from) --bright N,N,... (bright_lights) --extract-by WAY --reference N (each half) --threads N --out PATH
//            --pictures PREFIX (writes .exr)
//            --plot PREFIX: PREFIX_lights.png and PREFIX_time.png
#include <algorithm>

#include "measure/plot.h"
#include "subtractive_table.h"

using namespace gobo;
using namespace gobo::bench;

int main(int argc, char** argv) {
  const std::string environment = argumentOr(argc, argv, "--env", "sky"), scene = argumentOr(argc, argv, "--scene", "trees");
  int width = 0, height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "240x180").c_str(), "%dx%d", &width, &height);
  const std::string reference = argumentOr(argc, argv, "--reference", "1024"), way = argumentOr(argc, argv, "--extract-by", "MEDIAN_CUT");
  const std::string unshadowed = argumentOr(argc, argv, "--unshadowed", "PREFILTERED");
  if (width < 1 || height < 1 || std::atoi(reference.c_str()) < 1) fail(invalidArgument("--size and --reference must be positive"));
  const auto made = [&](const std::string& ofScene, const std::string& map) {
    v1::RenderRequest request;
    for (const std::string& e : {"scene=" + ofScene, "width=" + std::to_string(width), "height=" + std::to_string(height), std::string("outputs=direct"),
                                 std::string("integrator.max_bounces=0"), std::string("integrator.at_view_samples=true"),
                                 map == "sky" ? std::string("environment.sky.turbidity=3") : "environment.path=" + map})
      if (const Status s = setPath(request, e); !s.ok()) fail(s);
    for (const std::string& e : partsOf(argumentOr(argc, argv, "--set", ""), ' '))
      if (const Status s = setPath(request, e); !s.ok()) fail(s);
    Bench bench(request, std::atoi(argumentOr(argc, argv, "--threads", "2").c_str()), argumentOr(argc, argv, "--pictures", ""));
    bench.mapAlone();
    return bench;
  };
  for (int i = 1; i < argc; ++i)
    if (std::string(argv[i]) == "--table46") {
      table46(partsOf(argumentOr(argc, argv, "--scenes", scene.c_str()), ','), partsOf(argumentOr(argc, argv, "--maps", environment.c_str()), ','),
              partsOf(argumentOr(argc, argv, "--lights", "15,40,100"), ','), partsOf(argumentOr(argc, argv, "--resolutions", "1,4,16"), ','),
              partsOf(argumentOr(argc, argv, "--bright", "4"), ',').at(0), reference, made);
      return 0;
    }
  const Bench bench = made(scene, environment);

  const Run a = bench.render({"halt.spp=" + reference, "seed=1001"}, "reference_a"), b = bench.render({"halt.spp=" + reference, "seed=1002"}, "reference_b");
  const Run albedo = bench.render({"halt.spp=1", "outputs=albedo"}, "albedo");
  const Errors errors(a.image, b.image, albedo.image);
  Table table("Subtractive shadows", {"method", "lights", "r", "bright", "RMSE / mean", "dark", "displayed", "CPU s", "Mrays"});
  table.note("scene", scene);
  table.note("map", environment);
  table.note("pixels", double(width) * height);
  table.note("reference samples a pixel, each of two halves", reference);
  std::vector<std::pair<PlotSeries, PlotSeries>> drawn;  // against lights, against time
  const auto row = [&](const std::string& method, const std::string& lights, const std::string& r, const std::string& bright, const Run& run) {
    const std::string series = method == "additive" ? method : method + ", r = " + r + ", bright " + bright;
    auto at = std::find_if(drawn.begin(), drawn.end(), [&](const auto& d) { return d.first.name == series; });
    if (at == drawn.end()) at = drawn.insert(at, {PlotSeries{series, {}}, PlotSeries{series, {}}});
    at->first.points.push_back({std::atof(lights.c_str()), errors.relative(run.image)});
    at->second.points.push_back({run.seconds, errors.relative(run.image)});
    table.add({method, lights, r, bright, errors.relative(run.image), errors.dark(run.image), errors.displayed(run.image), run.seconds, 1e-6 * run.rays});
  };
  for (const std::string& n : partsOf(argumentOr(argc, argv, "--lights", "15,20,30,40,50,100"), ',')) {
    const std::string by = "environment.extract_by=" + way;
    row("additive", n, "1", "0", bench.render({by, "environment.extract_lights=" + n, "shadows.ray_traced.samples=1", "halt.spp=1"}, "additive_" + n));
    for (const std::string& bright : partsOf(argumentOr(argc, argv, "--bright", "0"), ','))
      for (const std::string& r : partsOf(argumentOr(argc, argv, "--resolutions", "1,4"), ','))
        for (const std::string& form : partsOf(argumentOr(argc, argv, "--forms", "DIFFERENCE,BETA,RATIO"), ','))
          row(form, n, r, bright,
              bench.render({by, "environment.subtractive.lights=" + n, "environment.subtractive.resolution=" + r, "environment.subtractive.form=" + form,
                            "environment.subtractive.bright_lights=" + bright, "environment.subtractive.unshadowed=" + unshadowed, "halt.spp=1"},
                           form + "_" + n + "_" + r + "_" + bright));
  }
  std::printf("%s", table.text().c_str());
  if (const std::string plot = argumentOr(argc, argv, "--plot", ""); !plot.empty()) {
    Plot byLights{scene + ", " + environment.substr(environment.rfind('/') + 1) + ": direct light", "lights", "RMSE by the mean"};
    Plot byTime{byLights.title, "CPU seconds", "RMSE by the mean"};
    for (auto& [lights, time] : drawn) {
      byLights.series.push_back(std::move(lights));
      byTime.series.push_back(std::move(time));
    }
    if (const Status s = writePlot(byLights, plot + "_lights.png"); !s.ok()) fail(s);
    if (const Status s = writePlot(byTime, plot + "_time.png"); !s.ok()) fail(s);
  }
  const std::string out = argumentOr(argc, argv, "--out", "");
  if (out.empty()) return 0;
  if (const Status s = table.write(out); !s.ok()) fail(s);
  return 0;
}
