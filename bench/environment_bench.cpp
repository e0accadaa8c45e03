// SPDX-License-Identifier: Apache-2.0
// An environment map as N area lights against path tracing it: direct light of a scene under a map, RMSE (by the picture's mean) against
// a path-traced reference and CPU time, for N lights with a shadow technique and for path tracing at several sample counts; then the time
// that path tracing takes to the lights' error (its squared error falls as 1 / samples), and the ratio. RMSE is the root of the mean of
// (x - a)(x - b) over pixels and channels, a and b the reference's halves: free of its noise. All at the same view samples. Each figure
// is from an engine that has the scene and its acceleration structure but no term: G-buffer, surface and fit are in the lights' time.
// Last what environment.area_lights_if_worth says of each count of lights, by its look at a small picture.
// The CPU clock, because cores may be shared.
// With --exhaustive also every texel of the map by N x N directions each (techniques/transfer/exhaustive_light.h), which has no noise: a small map and picture.
// The scene's own lights are off then and there is one view sample a pixel.
// Arguments: --scene NAME|FILE --env FILE|sky --set assignments of the request, separated by spaces --technique ASSIGNMENT below `shadows.`
//            --size WxH --lights N,N,... --extract-by WAY,WAY,... (also as many directional lights, environment.extract_by) --spp N,N,... --exhaustive N,N,...
//            --reference N (each half) --threads N --out PATH --pictures PREFIX (writes .exr)
#include <sys/resource.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "base/image_io.h"
#include "import/load.h"
#include "measure/report.h"
#include "nodes_by_hand.h"
#include "plan/engine.h"
#include "request/request.h"
#include "techniques/transfer/exhaustive_light.h"
#include "terms/gbuffer.h"

using namespace gobo;

namespace {

double cpu() {
  rusage u;
  getrusage(RUSAGE_SELF, &u);
  return double(u.ru_utime.tv_sec + u.ru_stime.tv_sec) + 1e-6 * double(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

[[noreturn]] void fail(const Status& status) {
  std::fprintf(stderr, "environment_bench: %s\n", status.toString().c_str());
  std::exit(1);
}

struct Run {
  Image image;
  double seconds = 0, fit = 0;
  std::string worth;  ///< what a look said of area lights
};

class Bench {
 public:
  Bench(v1::RenderRequest request, int threads, std::string pictures) : request_(std::move(request)), threads_(threads), pictures_(std::move(pictures)) {}

  Run render(const std::vector<std::string>& edits, const std::string& name) const {
    EngineOptions options;
    options.loader = inProcessLoader();
    options.threads = threads_;
    options.anyPath = true;
    auto engine = Engine::create(options);
    if (!engine.ok()) fail(engine.status());
    if (auto opened = (*engine)->openScene(request_.scene(), request_.scene()); !opened.ok()) fail(opened.status());
    v1::RenderRequest warm = request_, r = request_;
    for (const std::string& e : edits)
      if (const Status s = setPath(r, e); !s.ok()) fail(s);
    warm.set_width(1);
    warm.set_height(1);
    warm.mutable_halt()->set_spp(1);
    warm.mutable_shadows()->mutable_path_traced();
    if (auto first = (*engine)->render(warm); !first.ok()) fail(first.status());
    const double start = cpu();
    auto result = (*engine)->render(r);
    Run run;
    run.seconds = cpu() - start;
    if (!result.ok()) fail(result.status());
    run.image = result->images[0].image();
    for (const auto& n : result->reply.plan())
      if (n.node() == "area_lights" || n.node() == "extract_lights") run.fit = n.ms() * 1e-3;
      else if (n.node() == "path tracing of the environment map" || n.node() == "area lights of the environment map") run.worth = n.reason();
    keep(run.image, name);
    return run;
  }

  /// Lights of the scene that are not its map are taken out of the request.
  void mapAlone() {
    const ScenePtr scene = load();
    for (const Light& light : scene->lights)
      if (light.shape.kind != LightKind::Environment)
        if (const Status s = setPath(request_, "lights." + light.name + ".enabled=false"); !s.ok()) fail(s);
  }
  Run exhaustive(const Environment& map, int across) const {
    NodesByHand run(load(), threads_);
    GBufferSettings view;
    view.camera = run.scene().cameras[0];
    view.width = int(request_.width());
    view.height = int(request_.height());
    view.viewSamples = 1;
    const AccelPtr accel = run.accel();
    const double start = cpu();
    const auto sky = transfer::ExhaustiveSky::of(map, across);
    if (!sky.ok()) fail(sky.status());
    const TermPtr g = run(makeGBufferNode(view), {});
    auto picture = transfer::exhaustivePicture(*sky, run.view(transfer::kExhaustiveFacets), accel, *g, view.camera, run.arena());
    Run out;
    out.image = std::move(picture.diffuse);
    for (size_t i = 0; i < out.image.data.size(); ++i) out.image.data[i] += picture.specular.data[i];
    out.seconds = cpu() - start;
    keep(out.image, "exhaustive_" + std::to_string(across));
    return out;
  }

 private:
  ScenePtr load() const {
    EngineOptions options;
    options.loader = inProcessLoader();
    options.threads = threads_;
    options.anyPath = true;
    auto engine = Engine::create(options);
    if (!engine.ok()) fail(engine.status());
    if (auto opened = (*engine)->openScene(request_.scene(), request_.scene()); !opened.ok()) fail(opened.status());
    auto scene = (*engine)->loadScene(request_.scene(), true);
    if (!scene.ok()) fail(scene.status());
    return *scene;
  }
  void keep(const Image& image, const std::string& name) const {
    if (pictures_.empty()) return;
    const auto bytes = encodeExr(image);
    if (!bytes.ok()) fail(bytes.status());
    if (const Status s = writeFileAtomic(pictures_ + name + ".exr", bytes->data(), bytes->size()); !s.ok()) fail(s);
  }
  v1::RenderRequest request_;
  int threads_;
  std::string pictures_;
};

double relativeError(const Image& x, const Image& a, const Image& b) {
  double error = 0, mean = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    error += (double(x.data[i]) - a.data[i]) * (double(x.data[i]) - b.data[i]);
    mean += 0.5 * (double(a.data[i]) + b.data[i]);
  }
  return std::sqrt(std::max(error, 0.0) * double(a.data.size())) / mean;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string environment = argumentOr(argc, argv, "--env", "sky"), technique = argumentOr(argc, argv, "--technique", "percentage_closer=");
  const std::string scene = argumentOr(argc, argv, "--scene", "trees");
  int width = 0, height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "320x240").c_str(), "%dx%d", &width, &height);
  const std::string reference = argumentOr(argc, argv, "--reference", "1024");
  if (width < 1 || height < 1 || std::atoi(reference.c_str()) < 1) fail(invalidArgument("--size and --reference must be positive"));
  v1::RenderRequest request;
  for (const std::string& e : {"scene=" + scene, "width=" + std::to_string(width), "height=" + std::to_string(height), std::string("outputs=direct"),
                               std::string("integrator.max_bounces=0"), std::string("integrator.at_view_samples=true"),
                               environment == "sky" ? std::string("environment.sky.turbidity=3") : "environment.path=" + environment})
    if (const Status s = setPath(request, e); !s.ok()) fail(s);
  for (const std::string& e : partsOf(argumentOr(argc, argv, "--set", ""), ' '))
    if (const Status s = setPath(request, e); !s.ok()) fail(s);
  const std::vector<std::string> exhaustive = partsOf(argumentOr(argc, argv, "--exhaustive", ""), ',');
  EnvironmentPtr map;
  if (!exhaustive.empty()) {
    if (environment == "sky") fail(invalidArgument("--exhaustive takes a map: --env FILE"));
    auto loaded = loadEnvironment(environment);
    if (!loaded.ok()) fail(loaded.status());
    map = *loaded;
    if (const Status s = setPath(request, "view_samples=1"); !s.ok()) fail(s);
  }
  Bench bench(request, std::atoi(argumentOr(argc, argv, "--threads", "2").c_str()), argumentOr(argc, argv, "--pictures", ""));
  if (map) bench.mapAlone();

  const Run a = bench.render({"shadows.path_traced=", "halt.spp=" + reference, "seed=1001"}, "reference_a");
  const Run b = bench.render({"shadows.path_traced=", "halt.spp=" + reference, "seed=1002"}, "reference_b");
  Table table("Environment as area lights", {"method", "count", "RMSE / mean", "CPU s", "of it the fit", "path tracing to that error, s", "times faster"});
  table.note("scene", scene);
  table.note("map", environment);
  table.note("technique", technique);
  table.note("pixels", double(width) * height);
  table.note("reference samples a pixel, each of two halves", reference);
  double secondsPerVariance = 0;  // path tracing: time = this / error^2
  for (const std::string& spp : partsOf(argumentOr(argc, argv, "--spp", "4,16,64,256"), ',')) {
    const Run r = bench.render({"shadows.path_traced=", "halt.spp=" + spp, "seed=7"}, "traced_" + spp);
    const double error = relativeError(r.image, a.image, b.image);
    secondsPerVariance = r.seconds * error * error;  // of the largest count, where what is done once weighs least
    table.add({std::string("path traced"), std::atof(spp.c_str()), error, r.seconds, 0.0, r.seconds, 1.0});
  }
  for (const std::string& n : exhaustive) {
    const Run r = bench.exhaustive(*map, std::atoi(n.c_str()));
    const double error = relativeError(r.image, a.image, b.image), traced = secondsPerVariance / (error * error);
    table.add({std::string("exhaustive"), std::atof(n.c_str()), error, r.seconds, 0.0, traced, traced / r.seconds});
  }
  std::string looks;
  const std::string lights = argumentOr(argc, argv, "--lights", "10,20,30,45,60,100");
  for (const std::string& n : partsOf(lights, ',')) {
    const Run r = bench.render({"shadows." + technique, "environment.area_lights=" + n, "halt.spp=1"}, "lights_" + n);
    const double error = relativeError(r.image, a.image, b.image), traced = secondsPerVariance / (error * error);
    table.add({std::string("area lights"), std::atof(n.c_str()), error, r.seconds, r.fit, traced, traced / r.seconds});
    const Run weighed =
        bench.render({"shadows." + technique, "environment.area_lights=" + n, "environment.area_lights_if_worth=true", "halt.spp=1"}, "weighed_" + n);
    looks += n + " area lights: " + weighed.worth + "\n";
  }
  for (const std::string& by : partsOf(argumentOr(argc, argv, "--extract-by", ""), ','))
    for (const std::string& n : partsOf(lights, ',')) {
      const Run r = bench.render({"shadows." + technique, "environment.extract_lights=" + n, "environment.extract_by=" + by, "halt.spp=1"}, by + "_" + n);
      const double error = relativeError(r.image, a.image, b.image), traced = secondsPerVariance / (error * error);
      table.add({by, std::atof(n.c_str()), error, r.seconds, r.fit, traced, traced / r.seconds});
    }
  std::printf("%s%s", table.text().c_str(), looks.c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  if (out.empty()) return 0;
  if (const Status s = table.write(out); !s.ok()) fail(s);
  return 0;
}
