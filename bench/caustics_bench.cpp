// SPDX-License-Identifier: Apache-2.0
// Caustics of a point light (builtin scene "spheres"): error of 1, 4, 16, 64 passes against 256 passes of another seed, and their
// cost. Expected: RMSE ~ passes^(-1/3) (alpha 2/3: bias and noise fall alike). Usage: caustics_bench [--out table.json] [--png picture.png WIDTH HEIGHT SPP]
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "base/image_io.h"
#include "measure/report.h"
#include "plan/engine.h"
#include "request/request.h"

namespace {

using namespace gobo;

v1::RenderRequest causticRequest(int width, int height, int spp, int seed, const char* output) {
  v1::RenderRequest r;
  r.set_scene("spheres");
  r.set_width(uint32_t(width));
  r.set_height(uint32_t(height));
  r.mutable_halt()->set_spp(uint32_t(spp));
  r.set_seed(uint64_t(seed));
  r.add_outputs(output);
  for (const char* s : {"lights.lamp.kind=POINT", "lights.lamp.position=0,6,2", "lights.lamp.intensity=150", "integrator.caustic_photons=20000"})
    (void)setPath(r, s);
  return r;
}

/// Caustics alone: the indirect light of the lamp's group with them less without them.
std::vector<double> caustics(Engine& engine, v1::RenderRequest r, double* ms) {
  const auto with = engine.render(r);
  r.mutable_integrator()->set_caustic_photons(0);
  const auto without = engine.render(r);
  std::vector<double> out;
  if (!with.ok() || !without.ok()) {
    std::fprintf(stderr, "%s\n", (with.ok() ? without : with).status().toString().c_str());
    std::exit(1);
  }
  const auto a = with->images[0].pixels(), b = without->images[0].pixels();
  for (size_t i = 0; i < a.size(); ++i) out.push_back(double(a[i]) - double(b[i]));
  for (const auto& n : with->reply.plan())
    if (n.node() == "caustics") *ms = n.ms();
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  std::string png;
  int width = 256, height = 192, spp = 64;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--png") && i + 4 < argc) {
      png = argv[++i];
      width = std::atoi(argv[++i]);
      height = std::atoi(argv[++i]);
      spp = std::atoi(argv[++i]);
    }
  }
  auto engine = Engine::create({});
  if (!png.empty()) {
    for (const bool on : {true, false}) {
      v1::RenderRequest r = causticRequest(width, height, spp, 1, "beauty");
      for (const char* e : {"integrator.caustic_photons=200000", "integrator.caustic_radius=0.0015"}) (void)setPath(r, e);  // sharp enough to look at
      if (!on) r.mutable_integrator()->set_caustic_photons(0);
      const auto result = (*engine)->render(r);
      if (!result.ok()) {
        std::fprintf(stderr, "%s\n", result.status().toString().c_str());
        return 1;
      }
      for (const auto& n : result->reply.plan())
        std::fprintf(stderr, "%s: %.0f ms, %llu rays; %s\n", n.node().c_str(), n.ms(), (unsigned long long)n.rays(), n.reason().c_str());
      Image image = result->images[0].image();
      for (float& v : image.data) v = v / (1.0f + v);
      const auto bytes = encodePng(image);
      if (!bytes.ok() || !writeFileAtomic(on ? png : png + ".without.png", bytes->data(), bytes->size()).ok()) {
        std::fprintf(stderr, "no picture written\n");
        return 1;
      }
    }
    return 0;
  }
  Table t("Caustics by passes: spheres 48x36, point light, 20 000 photons a pass", {"passes", "RMSE", "RMSE x passes^(1/3)", "seconds"});
  double ms = 0;
  const std::vector<double> truth = caustics(**engine, causticRequest(48, 36, 256 * 16, 99, "indirect"), &ms);
  for (int passes : {1, 4, 16, 64}) {
    auto fresh = Engine::create({});
    const std::vector<double> image = caustics(**fresh, causticRequest(48, 36, passes * 16, 7, "indirect"), &ms);
    double sum = 0;
    for (size_t i = 0; i < truth.size(); ++i) sum += (image[i] - truth[i]) * (image[i] - truth[i]);
    const double rmse = std::sqrt(sum / double(truth.size()));
    t.add({double(passes), rmse, rmse * std::cbrt(double(passes)), ms * 1e-3});
    std::fprintf(stderr, "%d passes: RMSE %.5f, x passes^(1/3) %.5f, %.2f s\n", passes, rmse, rmse * std::cbrt(double(passes)), ms * 1e-3);
  }
  std::printf("%s", t.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  return out.empty() || t.write(out).ok() ? 0 : 1;
}
