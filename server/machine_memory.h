// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace gobo {
inline namespace server {

/// Bytes that this process may have: the machine's, or the least memory.max (cgroup v2) of the groups that it is in. `root`: where /proc
/// and /sys are looked for.
uint64_t machineMemory(const std::string& root = "");

}  // namespace server
}  // namespace gobo
