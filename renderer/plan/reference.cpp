// SPDX-License-Identifier: Apache-2.0
#include "plan/reference.h"

#include <algorithm>
#include <numeric>

#include "base/sobol.h"
#include "techniques/caustics/caustic_plan.h"
#include "trace/photon_tracer.h"

namespace gobo {
inline namespace plan {

namespace {

/// Photons of all punctual lights together and pass, where the request names no number.
constexpr uint32_t kPhotons = 1u << 16;

std::vector<int> everyLight(const Scene& scene) {
  std::vector<int> lights(scene.lights.size());
  std::iota(lights.begin(), lights.end(), 0);
  return lights;
}

}  // namespace

ReferenceRecipe referenceRecipe(const EffectiveScene& effective, const v1::RenderRequest& request) {
  const Scene& scene = *effective.scene;
  ReferenceRecipe recipe;
  recipe.seed = hash64(0x63657274u, request.certificate().seed());  // "cert": never the samples that made the picture
  v1::Integrator everything = request.integrator();
  everything.set_indirect(true);
  everything.set_max_bounces(uint32_t(recipe.maxBounces));
  if (everything.caustic_photons() == 0) {
    const auto punctual = uint32_t(std::count_if(scene.lights.begin(), scene.lights.end(), [](const Light& l) { return isDeltaLight(l.shape); }));
    everything.set_caustic_photons(std::max<uint32_t>(kPhotons / std::max<uint32_t>(punctual, 1), 256));
  }
  const CausticPlan caustics = causticPlan(scene, materialKinds(scene), everything);
  recipe.photons = caustics.photons;
  recipe.radius = caustics.radius;
  return recipe;
}

ReferenceTracer::ReferenceTracer(const EffectiveScene& effective, int width, int height, const ReferenceRecipe& recipe, AccelCache& accels,
                                 const TaskArena& arena, const StopToken& stop)
    : recipe_(recipe), lights_(everyLight(*effective.scene)), view_(*effective.scene, kPathTracerFacets, lights_), accels_(accels), arena_(arena) {
  settings_.camera = effective.camera;
  settings_.width = width;
  settings_.height = height;
  settings_.maxBounces = recipe.maxBounces;
  settings_.blockSize = kBlockSize;
  settings_.seed = recipe.seed;
  settings_.groups = 1;
  settings_.unlit = true;
  settings_.groupOf.assign(lights_.size(), 0);
  for (size_t i = 0; i < lights_.size(); ++i) settings_.nominal.push_back(effective.gains[i] * nominalScalar(effective.scene->lights[i]));
  if (AccelPtr accel = accels.get(view_, arena, stop)) tracer_ = PathTracer::create(view_, std::move(accel), settings_, stop);
  const Background& b = effective.background;
  const auto seenAlone = [&](const Scene& scene, int light, const Vec3& nominal, std::vector<int>& lights, std::optional<SceneView>& view) {
    PathTracerSettings s = settings_;
    s.cover = PathClass::Emission;
    s.maxBounces = 0;
    s.unlit = false;
    s.groupOf = {0};
    s.nominal = {nominal};
    lights = {light};
    view.emplace(scene, kPathTracerFacets, lights);
    AccelPtr accel = accels.get(*view, arena, stop);
    return accel ? PathTracer::create(*view, std::move(accel), s, stop) : nullptr;
  };
  if (b.hidden >= 0 && tracer_) {
    hidden_ = seenAlone(*effective.scene, b.hidden, settings_.nominal[size_t(b.hidden)], hiddenLights_, hiddenView_);
    if (!hidden_) tracer_ = nullptr;
  }
  if (b.scene && b.weight != Vec3(0.0f) && tracer_) {
    shown_ = seenAlone(*b.scene, b.light, b.weight, shownLights_, shownView_);
    if (!shown_) tracer_ = nullptr;
  }
}

void ReferenceTracer::addBlock(int x, int y, uint32_t block, DVec3& sum, uint64_t& rays, uint64_t& dropped) const {
  if (!hidden_ && !shown_) return tracer_->traceBlock(x, y, block, &sum.x, rays, dropped);
  DVec3 all(0.0), hidden(0.0);
  tracer_->traceBlock(x, y, block, &all.x, rays, dropped);
  if (hidden_) hidden_->traceBlock(x, y, block, &hidden.x, rays, dropped);
  sum += glm::max(all - hidden, DVec3(0.0));
  if (shown_) shown_->traceBlock(x, y, block, &sum.x, rays, dropped);
}

Result<std::vector<Vec3>> ReferenceTracer::trace(const std::vector<uint32_t>& pixels, uint32_t stream, uint32_t blocks, std::atomic<uint64_t>& rays,
                                                 const StopToken& stop) const {
  const uint32_t width = uint32_t(settings_.width);
  std::vector<DVec3> sums(pixels.size(), DVec3(0.0));
  const Status stopped(Code::Cancelled, "stopped");
  if (!tracer_) return stopped;
  if (recipe_.photons > 0) {
    CausticSettings photons;
    photons.path = settings_;
    photons.path.seed = hash64(settings_.seed, stream);
    photons.photons = recipe_.photons;
    photons.radius = recipe_.radius;
    AccelPtr accel = accels_.get(view_, arena_, stop);
    const auto caustics = accel ? CausticTracer::create(view_, std::move(accel), photons, stop) : nullptr;
    if (!caustics) return stopped;
    for (uint32_t pass = 0; pass < blocks; ++pass) {
      uint64_t emitted = 0;
      const auto map = caustics->emitPass(pass, arena_, emitted, stop);
      if (!map) return stopped;
      rays += emitted;
      const SampleRun run{pass / kBlocksPerStream, pass % kBlocksPerStream * uint32_t(kBlockSize), uint32_t(kBlockSize)};
      arena_.parallelFor(
          pixels.size(), 8,
          [&](size_t begin, size_t end) {
            uint64_t count = 0, dropped = 0;
            for (size_t i = begin; i < end; ++i) caustics->traceSamples(int(pixels[i] % width), int(pixels[i] / width), run, *map, &sums[i].x, count, dropped);
            rays += count;
          },
          stop);
    }
  }
  std::vector<Vec3> means(pixels.size());
  const bool complete = arena_.parallelFor(
      pixels.size(), 8,
      [&](size_t begin, size_t end) {
        uint64_t count = 0, dropped = 0;
        for (size_t i = begin; i < end; ++i) {
          if (stop.stopRequested()) return;
          for (uint32_t b = 0; b < blocks; ++b)
            addBlock(int(pixels[i] % width), int(pixels[i] / width), stream * kBlocksPerStream + b, sums[i], count, dropped);
          means[i] = Vec3(sums[i] / (double(blocks) * kBlockSize));
        }
        rays += count;
      },
      stop);
  if (!complete || stop.stopRequested()) return stopped;
  return means;
}

}  // namespace plan
}  // namespace gobo
