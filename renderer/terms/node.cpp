// SPDX-License-Identifier: Apache-2.0
#include "terms/node.h"

#include "trace/accel.h"

namespace gobo {

Result<AccelPtr> RunContext::accel() const {
  AccelPtr made = accels->get(*scene, *arena, stop);
  if (!made) return Status(Code::Cancelled, "stopped");
  return made;
}

}  // namespace gobo
