// SPDX-License-Identifier: Apache-2.0
#include "base/color_config.h"

#include "base/shared_object.h"

namespace gobo {
inline namespace base {

Result<std::shared_ptr<const ColorConfig>> openColorConfig(const std::string& file, const std::string& workingSpace) {
  GOBO_ASSIGN(const void* const symbol, sharedSymbol("libgobo_color.so", "gobo_color", "OpenColorIO"));
  return static_cast<const ColorModule*>(symbol)->open(file, workingSpace);
}

}  // namespace base
}  // namespace gobo
