// SPDX-License-Identifier: Apache-2.0
// request.expressions: numbers of a request by formulas (docs/expressions.md). One that reads nothing but `time` means its value at request.time_s typed in, as
// a curve does (request/curves.h); one of a style of shadows may read terms too, stays in the resolved request, and is evaluated at every view sample
// (filters/stylised/style_parameters.h).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/status.h"
#include "filters/stylised/style_formulas.h"
#include "gobo/v1/render.pb.h"
#include "scene/scene.h"

namespace gobo {
inline namespace request {

/// Whether a field at this path may have a curve or an expression: of camera, lights, environment, shadows, tone_map, integrator, meshes, filters.
bool mayVary(std::string_view path);

/// Puts the values of those that read `time` alone into their fields and takes them out; checks the rest. Curves have been applied before.
/// Errors: InvalidArgument at request.expressions.PATH(.formula): a path that has none, a formula that does not parse or reads terms where there are none, a
/// value that is not finite or out of the field's range.
Status applyExpressions(v1::RenderRequest& request);

/// Whether what any of them says depends on time.
bool expressionsMove(const v1::RenderRequest& request);

/// Formulas of the style of `light`'s shadow in a resolved request: those of lights.LIGHT.shadow.style where the light has a shadow of its own, else of
/// shadows.style. `scene`: whose objects they name. Errors: InvalidArgument: an object that is not in the scene.
Result<StyleFormulas> styleFormulas(const v1::RenderRequest& request, const std::string& light, const Scene& scene);

}  // namespace request
}  // namespace gobo
