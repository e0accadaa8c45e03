// SPDX-License-Identifier: Apache-2.0
#include "fuzz/targets.h"

namespace gobo::fuzz {

std::span<const Target> readerTargets() {
  static const Target table[] = {{"gltf", tryGltf, 24 << 10, "gltf"},
                                 {"image", tryImage, 8 << 10, "image"},
                                 {"blob", tryBlob, 8 << 10, ""},
                                 {"request_json", tryRequestText, 4 << 10, "request"},
                                 {"request_proto", tryRequestBytes, 4 << 10, "request"}};
  return table;
}

}  // namespace gobo::fuzz
