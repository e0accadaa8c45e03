// SPDX-License-Identifier: Apache-2.0
// SHA-256 of a file of any size: its size is looked at before a byte is read (a sparse file of hundreds of gigabytes costs nothing to
// make), and a stop token between slices.
#pragma once

#include <cstdint>
#include <string>

#include "base/status.h"
#include "base/stop.h"

namespace gobo {
inline namespace server {

struct DigestLimit {
  uint64_t bytes = UINT64_MAX;
  const char* key = "";
};  ///< key: of the configuration, for the error

/// 64 hex digits, of what is between the descriptor's position and its end. `name` places errors: ResourceExhausted above the limit, also
/// when the file grows beyond it; Cancelled; Unavailable.
Result<std::string> fileDigest(int fd, const std::string& name, const DigestLimit& limit, const StopToken& stop);

}  // namespace server
}  // namespace gobo
