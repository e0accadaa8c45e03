// SPDX-License-Identifier: Apache-2.0
#include "plan/engine.h"

namespace gobo {

std::string buildVersion() { return GOBO_BUILD; }

}  // namespace gobo
