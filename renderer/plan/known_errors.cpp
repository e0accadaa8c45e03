// SPDX-License-Identifier: Apache-2.0
#include "plan/known_errors.h"

#include <algorithm>
#include <cmath>

#include "request/request.h"

namespace gobo {
inline namespace plan {

namespace {

/// What decides how noisy a pixel is, and how far from the truth: neither how many samples it gets nor what becomes of it afterwards. Sizes change how much
/// of the picture is edges, which is little beside what samples change.
Hash128 pictureKey(const v1::RenderRequest& resolved) {
  v1::RenderRequest r = resolved;
  r.clear_halt();
  r.clear_seed();
  r.clear_width();
  r.clear_height();
  r.clear_window();
  r.clear_tone_map();
  r.clear_encoding();
  r.clear_scheduling();
  r.clear_certificate();
  r.clear_outputs();  // the beauty's error is meant
  return Hasher("picture").add(messageHash(r)).add(r.scene_hash()).digest();
}
Hash128 sceneKey(const v1::RenderRequest& resolved) { return Hasher("scene").add(resolved.scene_hash()).digest(); }

std::string samplesText(double samples) { return samples == 1 ? "one sample" : std::to_string(uint64_t(samples)) + " samples"; }

}  // namespace

void KnownErrors::add(const v1::RenderReply& reply) {
  const v1::RenderRequest& request = reply.resolved();
  const double samples = request.halt().spp();
  const bool noise = reply.standard_error() > 0 && std::isfinite(reply.standard_error()),
             certified = reply.has_certificate() && std::isfinite(reply.certificate().rmse());
  if (samples < 1 || !(noise || certified)) return;
  const Hash128 key = pictureKey(request);
  std::lock_guard lock(mutex_);
  if (noise) {
    const double variance = reply.standard_error() * reply.standard_error() * samples;
    for (const Hash128& k : {sceneKey(request), key}) {
      Picture& p = pictures_.touch(k);
      p.variance = variance;
      p.noiseAt = uint32_t(samples);
    }
  }
  if (!certified) return;
  std::vector<Measured>& known = pictures_.touch(key).certificates;
  std::erase_if(known, [&](const Measured& m) { return m.samples == samples; });
  known.push_back({samples, reply.certificate().rmse() * reply.certificate().rmse()});
  if (known.size() > 2) known.erase(known.begin());
}

ExpectedError KnownErrors::at(const v1::RenderRequest& resolved, uint32_t spp, bool onlyNoise) const {
  const double n = std::max(spp, 1u);
  const Hash128 key = pictureKey(resolved);
  ExpectedError e;
  std::lock_guard lock(mutex_);
  const Picture* const picture = pictures_.find(key);
  if (!picture) {
    const Picture* const scene = pictures_.find(sceneKey(resolved));
    if (!scene) return e;
    e.standardError = std::sqrt(scene->variance / n);
    e.from = "snapshots of another picture of this scene, " + samplesText(scene->noiseAt);
    return e;
  }
  const Picture& p = *picture;
  double variance = p.variance;
  if (variance > 0) e.from = "snapshots of this picture, " + samplesText(p.noiseAt);
  if (!p.certificates.empty()) {
    const auto fewer = [](const Measured& a, const Measured& b) { return a.samples < b.samples; };
    const Measured &few = *std::min_element(p.certificates.begin(), p.certificates.end(), fewer),
                   &many = *std::max_element(p.certificates.begin(), p.certificates.end(), fewer);
    std::string counts = samplesText(many.samples);
    double stays = 0;  // b^2
    if (onlyNoise) {
      variance = many.meanSquare * many.samples;
    } else if (p.certificates.size() == 2) {
      const double v = (few.meanSquare - many.meanSquare) / (1 / few.samples - 1 / many.samples);
      variance = std::clamp(v, 0.0, many.meanSquare * many.samples);  // neither noise nor the rest is negative
      stays = many.meanSquare - variance / many.samples;
      counts = std::to_string(uint64_t(few.samples)) + " and " + samplesText(many.samples);
    } else {
      variance = std::min(variance, many.meanSquare * many.samples);
      stays = many.meanSquare - variance / many.samples;
    }
    e.rmse = std::sqrt(stays + variance / n);
    e.from = "certificates of this picture, " + counts;
  }
  e.standardError = std::sqrt(variance / n);
  return e;
}

}  // namespace plan
}  // namespace gobo
