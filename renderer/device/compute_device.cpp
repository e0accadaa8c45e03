// SPDX-License-Identifier: Apache-2.0
#include "device/compute_device.h"

#include <algorithm>
#include <cctype>

namespace gobo {
inline namespace device {

void setLinearGroups(ComputeDispatch& dispatch, size_t count, uint32_t local) {
  constexpr size_t kMaxGroups = 65535;  // what every Vulkan and OpenGL device can
  const size_t groups = std::max<size_t>((count + local - 1) / local, 1);
  const size_t rows = (groups + kMaxGroups - 1) / kMaxGroups;
  dispatch.groups[0] = uint32_t((groups + rows - 1) / rows);
  dispatch.groups[1] = uint32_t(rows);
  dispatch.groups[2] = 1;
}

std::string keyWord(const std::string& text) {
  std::string out;
  for (char c : text) {
    if (std::isalnum(static_cast<unsigned char>(c)) || c == '.') out += c;
    else if (!out.empty() && out.back() != '-') out += '-';
  }
  while (!out.empty() && out.back() == '-') out.pop_back();
  return out;
}

}  // namespace device
}  // namespace gobo
