// SPDX-License-Identifier: Apache-2.0
#include "scene/gltf/document.h"

namespace gobo::gltf {

void audit(Document& d) { auditBounds(d); }

}  // namespace gobo::gltf
