// SPDX-License-Identifier: Apache-2.0
// Subtractive shadows of a scene's lights: their unshadowed light in full detail, and the samples whose shadows stand for it. Lights of any kind but an
// environment, together in one pass: nothing is held for a single one. Receivers as everywhere here (receiver.h).
#pragma once

#include <vector>

#include "techniques/subtractive/receiver.h"
#include "terms/light_list.h"

namespace gobo::subtractive {

struct SceneLightsSettings {
  GBufferSettings view;
  std::vector<SceneLight> lights;  ///< the node's subset holds all of them
  int samples = 32;                ///< a light and view sample, where unshadowed light has neither closed form nor rule (terms/light_list.h)
  uint64_t seed = 0;               ///< nothing depends on it where all of them are points and directions
};

/// Term "unshadowed_lights", domain ViewSample: "diffuse", "specular" f32x3, radiance, >= 0: the sum over the lights of what "direct_unoccluded" has of each
/// lobe: to 1e-5 of points, spots and directions; of lights of some size within 0.2 % of the truth, by quadrature where it has `samples` samples
/// (light_list.h, which says where samples are left). Sums in double. Inputs: G-buffer, surface. A sample of which the sum is not finite is counted in
/// "dropped" and is 0. Cost: 2 ns a light and view sample over Lambert surfaces, 6 over what shines; 0.3 us a sample where samples are left.
/// About 300 bytes of memory a light.
NodePtr makeUnshadowedLightsNode(const SceneLightsSettings& settings);

/// Term "subtractive_light_samples", with the planes of "subtractive_samples" (samples.h). Inputs: G-buffer, surface.
/// At each traced sample the `most` lights that give it most unshadowed light (luminance of both lobes; of equal ones the first) have a shadow ray each, and
/// the others are seen as much as these on the mean, by luminance, lobe by lobe: the samples' unshadowed light is that of all lights, so the forms differ only
/// by what resampling does. With no more than `most` lights, all have rays and at r = 1 the result is their shadowed light. More rays are a longer list that
/// begins with the same lights (nested). Choosing by sample, not for the picture: of lamps that fall with the distance none is strong everywhere, and what
/// changes from one to the next sample is the weakest light of a list, no more than 1 / `most` of what there is.
/// Lights of some size have hard shadows from one point, which differs from sample to sample: the i-th light has the i-th point of the view sample's Owen-
/// scrambled sequence, so that lights of one sample are spread over each other's strata. A mesh light counts by area. A point that cannot shine on the sample:
/// seen, as in terms/visibility.h.
/// Cost: for each traced sample what unshadowed_lights takes, 10 ns a light to choose, and `most` rays.
struct LightSamplesSettings {
  SceneLightsSettings from;
  Resampling resampling;
  int most = 40;
};
NodePtr makeLightSamplesNode(const LightSamplesSettings& settings);

}  // namespace gobo::subtractive
