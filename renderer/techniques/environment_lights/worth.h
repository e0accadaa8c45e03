// SPDX-License-Identifier: Apache-2.0
// Whether area lights that stand for an environment (environment.area_lights) are worth it: whether path tracing the map alone would take half as long again,
// or longer, to their error.
//
// A look at a small picture of the same view and view samples, some 1000 pixels of direct light by the lights (x) and twice by path tracing at 128 samples
// (a and b). The lights' squared error is the mean of (x - a)(x - b), free of the noise of a and b, and a standard error of that more; path tracing's is half
// the mean of (a - b)^2, a standard error of that less, and falls as 1 / samples. Times are what the nodes of the full picture say that they cost (Node::cost),
// the same on every machine, so that a request chooses the same everywhere and the choice, like all terms, does not depend on load. Costs: 10^5 to 10^6 rays,
// once for a view and map. Failure cases: highlights smaller than the look's pixels; a moving camera or map may cross the line between two pictures.
#pragma once

#include <string>

#include "technique/plan_context.h"

namespace gobo {
inline namespace techniques {

struct LightsWorth {
  bool lights = true;  ///< take them
  std::string why;     ///< for the reply's plan
};

/// What a look found.
struct LookedAt {
  double mean = 0;                         ///< of the picture
  double error2 = 0, doubt = 0;            ///< the lights' mean squared error, and the standard error of that
  double variance = 0, varianceDoubt = 0;  ///< of one path-traced sample, mean over the picture
  double samples = 0;                      ///< path tracing's in the time of the lights
};
/// The choice, in words. Of a black picture: the lights, which were asked for.
LightsWorth worthBy(const LookedAt& seen, const std::string& lights);

/// Claims nothing. While bounding: the lights, and bytes for the map reserved. Errors: of the nodes; Cancelled.
Result<LightsWorth> worthOfAreaLights(PlanContext& context, int map);

}  // namespace techniques
}  // namespace gobo
