// SPDX-License-Identifier: Apache-2.0
// Whose a loaded scene is and who may do what with it. A scene belongs to the token that opened it; one without an owner (built-ins,
// callers without a token) is there for everybody, and changed by nobody who shows a token without the admin right. A scene may be shared
// with named tokens or with everybody ("*"): they use it, its owner changes it.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

namespace gobo {
inline namespace plan {

/// Who asks. The default may do everything: callers without a token, in this process.
struct SceneAccess {
  std::string caller;  ///< the token's name; empty: none
  bool all = true;     ///< the admin right, or no token

  bool uses(const std::string& owner, const std::vector<std::string>& share) const {
    if (all || owner.empty() || owner == caller) return true;
    return std::any_of(share.begin(), share.end(), [&](const std::string& s) { return s == "*" || s == caller; });
  }
  bool changes(const std::string& owner) const { return all || (!owner.empty() && owner == caller); }
};

}  // namespace plan
}  // namespace gobo
