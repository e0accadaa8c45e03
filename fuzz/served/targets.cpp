// SPDX-License-Identifier: Apache-2.0
#include "fuzz/targets.h"

#include "fuzz/served/rendered_request.h"
#include "fuzz/served/sequence.h"

namespace gobo::fuzz {

std::span<const Target> servedTargets() {
  static const Target table[] = {{kServedNames[0], tryRenderedRequest, 2 << 10, "", true}, {kServedNames[1], trySequence, 2 << 10, "", true}};
  return table;
}

}  // namespace gobo::fuzz
