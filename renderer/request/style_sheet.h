// SPDX-License-Identifier: Apache-2.0
// Style sheets: styles of shadows in a file of their own, to be shared between requests. JSON of a RenderRequest that sets shadows.style,
// lights.NAME.shadow.style and expressions of fields of these, and nothing else.
#pragma once

#include <string>

#include "base/status.h"
#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace request {

/// Puts what the sheet says over what `request` says. `source`: its name in errors. Errors: InvalidArgument: no JSON of a request, or a field that is no
/// style's.
Status applyStyleSheet(v1::RenderRequest& request, const std::string& json, const std::string& source);

}  // namespace request
}  // namespace gobo
