// SPDX-License-Identifier: Apache-2.0
// Certificates of rendered pictures beside their measured error. The reference's parts of every pixel are traced once, enough for
// many independent certificates; the truth is two long independent halves of another seed. Production code chooses the pixels,
// makes the reference and does the statistics.
#pragma once

#include <cmath>

#include "measure/certificate.h"
#include "plan/certify_picture.h"
#include "support/certificate_scenes.h"

namespace gobo::testing {

struct TriedReference {
  std::vector<std::vector<Vec3>> parts;  ///< [4 k + j]: part j of certificate k, for every pixel
  std::vector<Vec3> truth[2];
};

/// `spp` of each of the truth's halves. `accels` and `arena` as for the engine. Aborts on errors.
inline TriedReference traceReference(const ScenePtr& scene, v1::RenderRequest request, int certificates, int spp, AccelCache& accels, const TaskArena& arena) {
  GOBO_CHECK(resolveDefaults(request).ok());
  request.mutable_certificate();
  Result<EffectiveScene> effective = makeEffectiveScene(scene, request, {});
  GOBO_CHECK(effective.ok());
  const int width = int(request.width()), height = int(request.height());
  std::vector<uint32_t> all(size_t(width) * height);
  for (size_t i = 0; i < all.size(); ++i) all[i] = uint32_t(i);
  std::atomic<uint64_t> rays{0};
  TriedReference out;
  ReferenceRecipe recipe = referenceRecipe(*effective, request);
  {
    const ReferenceTracer tracer(*effective, width, height, recipe, accels, arena);
    for (int k = 0; k < certificates * kParts; ++k) out.parts.push_back(*tracer.trace(all, uint32_t(k), 1, rays));
  }
  recipe.seed = 0x7472757468;  // "truth"
  const ReferenceTracer tracer(*effective, width, height, recipe, accels, arena);
  for (int h = 0; h < 2; ++h) out.truth[h] = *tracer.trace(all, uint32_t(h), uint32_t(spp / ReferenceTracer::kBlockSize), rays);
  return out;
}

struct MeasuredError {
  double mse = 0, standardError = 0;  ///< the latter of the truth's noise: <m, D>^2 a pixel, m = (A + B) / 2 - p, D = A - B, exact for Gaussian noise
  double rmse() const { return std::sqrt(std::max(mse, 0.0)); }
};
inline MeasuredError measureError(const Image& picture, const TriedReference& reference) {
  MeasuredError out;
  const double n = double(picture.pixels());
  for (size_t i = 0; i < picture.pixels(); ++i) {
    const DVec3 p(picture.rgb(int(i) % picture.width, int(i) / picture.width)), a = DVec3(reference.truth[0][i]) - p, b = DVec3(reference.truth[1][i]) - p;
    const double noise = (glm::dot(a, a) - glm::dot(b, b)) / 6;
    out.mse += glm::dot(a, b) / 3 / n;
    out.standardError += noise * noise / (n * n);
  }
  out.standardError = std::sqrt(out.standardError);
  return out;
}

/// Certificate k of the picture, as certifyPicture() makes it with another seed.
inline CertificateFigures tryCertificate(const Image& picture, const TriedReference& reference, int k, uint32_t minPixels) {
  v1::CertificateSettings settings;
  settings.set_pixel_fraction(0.01);
  settings.set_min_pixels(minPixels);
  settings.set_seed(uint32_t(1000 + k));
  const CertificateDraw draw = drawCertificate(picture, settings);
  std::vector<PixelEvidence> evidence(draw.pixels.size());
  for (size_t i = 0; i < evidence.size(); ++i) {
    const uint32_t p = draw.pixels[i];
    evidence[i].picture = picture.rgb(int(p) % picture.width, int(p) / picture.width);
    evidence[i].chance = draw.chances[i];
    for (int j = 0; j < kParts; ++j) evidence[i].parts[j] = reference.parts[size_t(k) * kParts + j][p];
  }
  return certify(evidence, picture.pixels());
}

/// How many of a picture's certificates hold.
struct Tally {
  int tried = 0, held = 0, above = 0, below = 0;  ///< above: rmseLow above the error; below: rmseHigh below it
  std::vector<double> halfWidths;                 ///< over the error
  void add(const CertificateFigures& f, double rmse) {
    ++tried;
    above += f.rmseLow > rmse;
    below += f.rmseHigh < rmse;
    held += f.rmseLow <= rmse && rmse <= f.rmseHigh;
    halfWidths.push_back((f.rmseHigh - f.rmseLow) / 2 / rmse);
  }
  void add(const Tally& t) {
    tried += t.tried, held += t.held, above += t.above, below += t.below;
    halfWidths.insert(halfWidths.end(), t.halfWidths.begin(), t.halfWidths.end());
  }
  double share() const { return tried ? double(held) / tried : 0; }
  double halfWidth() const {
    std::vector<double> v = halfWidths;
    if (v.empty()) return 0;
    std::nth_element(v.begin(), v.begin() + v.size() / 2, v.end());
    return v[v.size() / 2];
  }
};

/// Renders that stop on an error as Engine::render does, from pictures of 16, 32, 64, ... samples and one certificate's parts.
struct Halts {
  int stopped = 0, kept = 0;  ///< stopped by the certificate; and the measured error is at most what was asked
};
inline Halts tryHalts(const std::vector<Image>& doublings, const std::vector<MeasuredError>& errors, const TriedReference& reference, int certificates,
                      double asked, uint32_t minPixels) {
  Halts out;
  for (int k = 0; k < certificates; ++k)
    for (size_t i = 0; i < doublings.size(); ++i) {
      if (tryCertificate(doublings[i], reference, k, minPixels).rmseHigh > asked) continue;
      ++out.stopped;
      out.kept += errors[i].rmse() <= asked;
      break;
    }
  return out;
}

}  // namespace gobo::testing
