// SPDX-License-Identifier: Apache-2.0
// Listening sockets of a HOST:PORT, bound so that a second daemon on the port is an error and not a lottery (no SO_REUSEPORT).
#pragma once

#include <string>
#include <vector>

#include "base/descriptor.h"
#include "base/status.h"
#include "server/config.h"

namespace gobo {
inline namespace server {

struct BoundSockets {
  std::vector<Descriptor> sockets;  ///< non-blocking; one for each address of the name, all with one port
  std::string served;               ///< HOST:PORT with the port that was picked for port 0
};

/// `text`: the address as configured. Errors: Unavailable "cannot listen on ...".
Result<BoundSockets> bindTcp(const std::string& text);

}  // namespace server
}  // namespace gobo
