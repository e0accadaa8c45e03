// SPDX-License-Identifier: Apache-2.0
// sd_notify's protocol without libsystemd: one datagram to $NOTIFY_SOCKET. Does nothing where nobody asked for it.
#pragma once

#include <string>

namespace gobo {
inline namespace server {

/// "READY=1", "RELOADING=1", "STOPPING=1".
void notifyManager(const std::string& state);

}  // namespace server
}  // namespace gobo
