// SPDX-License-Identifier: Apache-2.0
#include "server/farm/numeric_class.h"

#include "trace/accel.h"

namespace gobo {
inline namespace server {

std::string numericClass() {
  const Result<std::string> kernels = Accel::kernels();
  return "x86-64-v3 embree-" + (kernels.ok() ? *kernels : "unknown");  // without kernels there is no engine
}

}  // namespace server
}  // namespace gobo
