// SPDX-License-Identifier: Apache-2.0
// Cost of the tracer's inner pieces in ns a call, on one thread: Sobol draws, BSDF, every light kind. Best of five rounds,
// so that a busy machine shows the code and not its neighbours. Prints a table.
#include <chrono>
#include <cstdio>
#include <functional>
#include <numeric>

#include "base/sobol.h"
#include "scene/scene.h"
#include "trace/bsdf.h"
#include "trace/light_sampling.h"

namespace gobo {
namespace {

volatile float gSink;

void report(const char* name, const std::function<float(int)>& body) {
  using Clock = std::chrono::steady_clock;
  const int n = 100000;
  double best = 1e30;
  for (int round = 0; round < 5; ++round) {
    float sum = 0;
    const auto start = Clock::now();
    for (int i = 0; i < n; ++i) sum += body(i);
    gSink = sum;
    best = std::min(best, std::chrono::duration<double, std::nano>(Clock::now() - start).count() / n);
  }
  std::printf("%-34s %8.1f ns\n", name, best);
}

Vec2 square(int i) { return Vec2(toUnit(hash32(1, uint64_t(i))), toUnit(hash32(2, uint64_t(i)))); }

LightShape shape(LightKind kind) {
  LightShape s;
  s.kind = kind;
  s.position = Vec3(0, 2, 0);
  return s;
}

void run() {
  report("loop and two hashes (subtract)", [](int i) { return square(i).x; });
  report("sobol 1D", [](int i) {
    SobolSampler s(5, uint32_t(i));
    return s.next1D();
  });
  report("sobol 2D", [](int i) {
    SobolSampler s(5, uint32_t(i));
    return s.next2D().x;
  });

  BsdfParams lambert, plastic, glass, metal;
  lambert.specular = 0;
  plastic.roughness = 0.4f;
  glass.transmission = 1;
  glass.roughness = 0.3f;
  metal.metallic = 1;
  metal.roughness = 0.4f;
  BsdfParams coated = metal, cloth = plastic, filmed = metal, thin = glass;
  coated.clearcoat = 1;
  cloth.sheenColor = Vec3(0.5f);
  cloth.sheenRoughness = 0.5f;
  filmed.iridescence = 1;
  filmed.iridescenceThickness = 400;
  thin.thin = true;
  const Vec3 wo = glm::normalize(Vec3(0.3f, 0.2f, 0.8f));
  const struct {
    const char* name;
    const BsdfParams& p;
  } surfaces[] = {{"lambert", lambert},     {"plastic", plastic}, {"rough glass", glass},    {"metal", metal},
                  {"coated metal", coated}, {"sheen", cloth},     {"film on metal", filmed}, {"thin glass", thin}};
  for (const auto& s : surfaces) {
    const std::string n = s.name;
    report((n + " eval").c_str(), [&](int i) { return bsdfEval(s.p, wo, glm::normalize(Vec3(square(i), 0.5f))).sum().x; });
    report((n + " pdf").c_str(), [&](int i) { return bsdfPdf(s.p, wo, glm::normalize(Vec3(square(i), 0.5f))); });
    report((n + " sample").c_str(), [&](int i) {
      BsdfSample out;
      return bsdfSample(s.p, wo, toUnit(hash32(3, uint64_t(i))), square(i), out) ? out.weight.x : 0.0f;
    });
  }

  Scene scene;
  const LightKind kinds[] = {LightKind::Point, LightKind::Spot,   LightKind::Directional, LightKind::Rect,
                             LightKind::Disk,  LightKind::Sphere, LightKind::Environment};
  const char* names[] = {"point", "spot", "directional", "rect", "disk", "sphere", "environment 1024x512"};
  for (size_t k = 0; k < 7; ++k) {
    Light light;
    light.name = names[k];
    light.shape = shape(kinds[k]);
    scene.lights.push_back(light);
  }
  Image map(1024, 512, 3);
  for (size_t i = 0; i < map.data.size(); ++i) map.data[i] = toUnit(hash32(9, i));
  scene.environment = makeEnvironment("noise", std::move(map));
  for (int i = 0; i < 1000; ++i) {
    Light light;
    light.name = "ball" + std::to_string(i);
    light.shape = shape(LightKind::Sphere);
    light.shape.position = Vec3(square(3 * i), toUnit(hash32(4, uint64_t(i)))) * 20.0f - 10.0f;
    light.shape.radius = 0.1f;
    scene.lights.push_back(light);
  }
  const Status status = scene.seal();
  if (!status.ok()) {
    std::fprintf(stderr, "%s\n", status.toString().c_str());
    return;
  }
  std::vector<int> subset(scene.lights.size());
  std::iota(subset.begin(), subset.end(), 0);
  const auto sampler = LightSampler::build(SceneView(scene, Facet::LightShape | Facet::Environment, subset));
  for (int k = 0; k < 7; ++k) {
    report((std::string(names[k]) + " sample").c_str(), [&](int i) {
      LightSample out;
      return sampler->sample(k, Vec3(0.1f, 0, 0.2f), square(i), out) ? out.pdf : 0.0f;
    });
    if (k >= 3)
      report((std::string(names[k]) + " pdf").c_str(),
             [&](int i) { return sampler->pdf(k, Vec3(0.1f, 0, 0.2f), glm::normalize(Vec3(square(i), 1.0f)), 2.0f, 0); });
  }
  report("1000 area lights, one ray", [&](int i) {
    float t = 0;
    Vec3 n;
    return float(sampler->intersectAreaLights({Vec3(0), glm::normalize(Vec3(square(i) - 0.5f, 0.3f))}, t, n));
  });
}

}  // namespace
}  // namespace gobo

int main() { gobo::run(); }
