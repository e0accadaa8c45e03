// SPDX-License-Identifier: Apache-2.0
#include "plan/certify_picture.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "measure/certificate.h"
#include "measure/certificate_pixels.h"
#include "plan/planner.h"
#include "request/material_kinds.h"

namespace gobo {
inline namespace plan {

CertificateDraw drawCertificate(const Image& beauty, const v1::CertificateSettings& settings, const StopToken& stop) {
  const double all = double(beauty.width) * beauty.height;
  const double wanted = std::min(all, std::max(std::round(settings.pixel_fraction() * all), double(std::max(settings.min_pixels(), 1u))));
  CertificateDraw draw;
  std::vector<float> rgb;
  rgb.reserve(size_t(beauty.width) * beauty.height * 3);
  for (int y = 0; y < beauty.height && !stop.stopRequested(); ++y)
    for (int x = 0; x < beauty.width; ++x) {
      const Vec3 p = beauty.rgb(x, y);
      for (int c = 0; c < 3; ++c) rgb.push_back(p[c]);
    }
  if (stop.stopRequested()) return draw;
  const std::vector<float> forecast = forecastError(rgb, beauty.width, beauty.height, stop);
  if (stop.stopRequested()) return draw;
  const std::vector<float> chances = drawingChances(forecast, wanted, stop);
  draw.pixels = drawPixels(beauty.width, beauty.height, chances, settings.seed(), stop);
  for (uint32_t p : draw.pixels) draw.chances.push_back(double(chances[p]));
  return draw;
}

Result<v1::Certificate> certifyPicture(const Image& beauty, const EffectiveScene& effective, const v1::RenderRequest& request, AccelCache& accels,
                                       const TaskArena& arena, const StopToken& stop) {
  return certifyAgainst(referenceRecipe(effective, request), beauty, effective, request, accels, arena, stop);
}

Result<v1::Certificate> certifyAgainst(const ReferenceRecipe& recipe, const Image& beauty, const EffectiveScene& effective, const v1::RenderRequest& request,
                                       AccelCache& accels, const TaskArena& arena, const StopToken& stop) {
  const auto start = std::chrono::steady_clock::now();
  const CertificateDraw draw = drawCertificate(beauty, request.certificate(), stop);
  if (stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  std::vector<PixelEvidence> evidence(draw.pixels.size());
  std::atomic<uint64_t> rays{0};
  const ReferenceTracer reference(effective, beauty.width, beauty.height, recipe, accels, arena, stop);
  const uint32_t blocks =
      std::max<uint32_t>(1, (request.certificate().spp() + kParts * ReferenceTracer::kBlockSize - 1) / (kParts * ReferenceTracer::kBlockSize));
  for (int k = 0; k < kParts; ++k) {
    GOBO_ASSIGN(const std::vector<Vec3> part, reference.trace(draw.pixels, recipe.streams[k], blocks, rays, stop));
    for (size_t i = 0; i < evidence.size(); ++i) evidence[i].parts[k] = part[i];
  }
  for (size_t i = 0; i < evidence.size(); ++i) {
    evidence[i].picture = beauty.rgb(int(draw.pixels[i] % uint32_t(beauty.width)), int(draw.pixels[i] / uint32_t(beauty.width)));
    evidence[i].chance = draw.chances[i];
  }

  const CertificateFigures f = certify(evidence, uint64_t(beauty.width) * uint64_t(beauty.height));
  v1::Certificate out;
  out.set_rmse(f.rmse);
  out.set_rmse_low(f.rmseLow);
  out.set_rmse_high(f.rmseHigh);
  out.set_rmse_high_trimmed(f.rmseHighTrimmed);
  out.set_rel_mse(f.relMse);
  out.set_rel_mse_low(f.relMseLow);
  out.set_rel_mse_high(f.relMseHigh);
  out.set_standard_error(f.rmseStandardError);
  out.set_pixels(uint32_t(draw.pixels.size()));
  out.set_certain_pixels(uint32_t(f.certain));
  out.set_spp(kParts * blocks * uint32_t(ReferenceTracer::kBlockSize));
  out.set_unseen_area(f.unseenArea);
  for (const std::string& missing : classesNotCovered(*effective.scene, recipe.photons > 0)) out.add_not_covered(missing);
  out.set_rays(rays.load());
  out.set_ms(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
  return out;
}

}  // namespace plan
}  // namespace gobo
