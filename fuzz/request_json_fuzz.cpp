// SPDX-License-Identifier: Apache-2.0
#include "fuzz/properties.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  gobo::fuzz::demand(gobo::fuzz::tryRequestText({data, size}));
  return 0;
}
