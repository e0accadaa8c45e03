// SPDX-License-Identifier: Apache-2.0
#include "server/machine_memory.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>

namespace gobo {
inline namespace server {

uint64_t machineMemory(const std::string& root) {
  uint64_t least = uint64_t(::sysconf(_SC_PHYS_PAGES)) * uint64_t(::sysconf(_SC_PAGESIZE));
  std::ifstream groups(root + "/proc/self/cgroup");
  std::string group;
  for (std::string line; std::getline(groups, line);)
    if (line.rfind("0::", 0) == 0) group = line.substr(3);  // version 2; a container sees itself as the root
  for (;;) {
    uint64_t most = 0;
    if (std::ifstream file(root + "/sys/fs/cgroup" + group + "/memory.max"); file >> most) least = std::min(least, most);  // "max": no number
    const size_t up = group.rfind('/');
    if (up == std::string::npos || group.size() <= 1) return least;
    group.resize(up);
  }
}

}  // namespace server
}  // namespace gobo
