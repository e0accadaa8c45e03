// SPDX-License-Identifier: Apache-2.0
#include "plan/engine.h"

namespace gobo::inline plan {

std::string buildVersion() { return GOBO_BUILD; }

}  // namespace gobo::inline plan
