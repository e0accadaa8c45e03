// SPDX-License-Identifier: Apache-2.0
#include "plan/certify_picture.h"

#include <chrono>

#include "base/sobol.h"
#include "measure/certificate.h"
#include "plan/caustic_plan.h"
#include "plan/planner.h"
#include "trace/path_tracer.h"
#include "trace/photon_tracer.h"

namespace gobo {

Result<v1::Certificate> certifyPicture(const Image& beauty, const EffectiveScene& effective, const v1::RenderRequest& request,
                                       AccelCache& accels, const TaskArena& arena, const StopToken& stop) {
  const auto start = std::chrono::steady_clock::now();
  const v1::CertificateSettings& c = request.certificate();
  const Scene& scene = *effective.scene;
  std::vector<int> lights(scene.lights.size());
  PathTracerSettings s;
  s.camera = effective.camera;
  s.width = beauty.width;
  s.height = beauty.height;
  s.maxBounces = int(request.integrator().max_bounces());
  s.rouletteStart = int(request.integrator().russian_roulette_start());
  s.seed = hash64(0x63657274u, c.seed());          // "cert": never the samples that made the picture
  s.groups = 1;
  for (size_t i = 0; i < lights.size(); ++i) {
    lights[i] = int(i);
    s.groupOf.push_back(0);
    s.nominal.push_back(effective.gains[i] * nominalScalar(scene.lights[i]));
  }
  s.unlit = true;
  const SceneView view(scene, kPathTracerFacets, lights);
  const auto tracer = PathTracer::create(view, accels.get(view, arena), s);
  const uint32_t blocksPerHalf = std::max<uint32_t>(1, (c.spp() + 2 * s.blockSize - 1) / (2 * s.blockSize));

  const std::vector<uint32_t> pixels = certificatePixels(beauty.width, beauty.height, c.pixel_fraction(), c.seed());
  std::vector<PixelEvidence> evidence(pixels.size());
  std::atomic<uint64_t> rays{0};
  // Caustics, when the picture has them: photons of other seeds, a seed for each half. The bias of the radius is in both.
  const CausticPlan caustics = causticPlan(scene, materialKinds(scene), request.integrator());
  std::vector<DVec3> casts[2] = {std::vector<DVec3>(pixels.size(), DVec3(0.0)), std::vector<DVec3>(pixels.size(), DVec3(0.0))};
  for (int half = 0; half < 2 && caustics.photons > 0; ++half) {
    CausticSettings photons;
    photons.path = s;
    photons.path.seed = hash64(s.seed, uint64_t(half));
    photons.photons = caustics.photons;
    photons.radius = caustics.radius;
    const auto from = CausticTracer::create(view, accels.get(view, arena), photons);
    for (uint32_t pass = 0; pass < blocksPerHalf; ++pass) {
      uint64_t emitted = 0;
      const auto map = from->emitPass(pass, arena, emitted, stop);
      if (!map) return Status(Code::Cancelled, "stopped");
      rays += emitted;
      arena.parallelFor(pixels.size(), 8, [&](size_t begin, size_t end) {
        uint64_t count = 0, dropped = 0;
        for (size_t i = begin; i < end; ++i)
          from->traceBlock(int(pixels[i] % beauty.width), int(pixels[i] / beauty.width), pass, *map, &casts[half][i].x, count, dropped);
        rays += count;
      }, stop);
    }
  }
  const bool complete = arena.parallelFor(pixels.size(), 8, [&](size_t begin, size_t end) {
    uint64_t count = 0, dropped = 0;
    for (size_t i = begin; i < end; ++i) {
      const int x = int(pixels[i] % beauty.width), y = int(pixels[i] / beauty.width);
      double half[2][3] = {};
      for (uint32_t b = 0; b < 2 * blocksPerHalf; ++b) {
        if (stop.stopRequested()) return;
        tracer->traceBlock(x, y, (b & 1) * kBlocksPerStream + b / 2, half[b & 1], count, dropped);
      }
      for (int h = 0; h < 2; ++h)
        for (int c = 0; c < 3; ++c) half[h][c] += casts[h][i][c];
      const double scale = 1.0 / (double(blocksPerHalf) * s.blockSize);
      evidence[i] = {beauty.rgb(x, y), Vec3(half[0][0] * scale, half[0][1] * scale, half[0][2] * scale), Vec3(half[1][0] * scale, half[1][1] * scale, half[1][2] * scale)};
    }
    rays += count;
  }, stop);
  if (!complete || stop.stopRequested()) return Status(Code::Cancelled, "stopped");

  const CertificateFigures f = certify(evidence, c.seed());
  v1::Certificate out;
  out.set_rmse(f.rmse);
  out.set_rmse_low(f.rmseLow);
  out.set_rmse_high(f.rmseHigh);
  out.set_rel_mse(f.relMse);
  out.set_rel_mse_low(f.relMseLow);
  out.set_rel_mse_high(f.relMseHigh);
  out.set_standard_error(f.rmseStandardError);
  out.set_pixels(uint32_t(pixels.size()));
  out.set_spp(2 * blocksPerHalf * uint32_t(s.blockSize));
  out.set_unseen_area(f.unseenArea);
  for (const std::string& missing : classesNotCovered(scene, caustics.photons > 0)) out.add_not_covered(missing);
  out.set_rays(rays.load());
  out.set_ms(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
  return out;
}

}  // namespace gobo
