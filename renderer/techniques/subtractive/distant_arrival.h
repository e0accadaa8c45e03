// SPDX-License-Identifier: Apache-2.0
// What one light at infinity gives a traced sample, for the nodes that look at such lights one by one and all at once.
#pragma once

#include "techniques/subtractive/samples.h"
#include "techniques/subtractive/samples_node.h"

namespace gobo::subtractive {

/// The sample's frame, made once for all of its lights.
struct SampleFrame {
  Frame frame;
  Vec3 wo;
  explicit SampleFrame(const LitPoint& r) : frame(r.frame()), wo(frame.toLocal(r.wo)) {}
};

/// False: the light is below one of the sample's horizons, or gives it nothing.
inline bool arrives(const DistantLightSample& light, const TracedSample& sample, const SampleFrame& at, Arrivals::Light& out) {
  const LitPoint& r = sample.point;
  if (!(glm::dot(light.direction, r.ng) > 0) || !(glm::dot(light.direction, r.n) > 0)) return false;
  const BsdfValue f = bsdfEval(r.bsdf, at.wo, at.frame.toLocal(light.direction));
  out.lobe[0] = byAlbedo(f.diffuse * light.irradiance, sample.by.diffuse);
  out.lobe[1] = byAlbedo(f.specular * light.irradiance, sample.by.specular);
  return out.lobe[0] != Vec3(0.0f) || out.lobe[1] != Vec3(0.0f);
}

}  // namespace gobo::subtractive
