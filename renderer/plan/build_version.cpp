// SPDX-License-Identifier: Apache-2.0
#include "plan/engine.h"

namespace gobo {
inline namespace plan {

std::string buildVersion() { return GOBO_BUILD; }

}  // namespace plan
}  // namespace gobo
