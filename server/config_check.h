// SPDX-License-Identifier: Apache-2.0
// The parts of checkConfig that decide who may reach the daemon. Pure functions of the configuration.
#pragma once

#include "server/config.h"

namespace gobo {
inline namespace server {

/// One token by itself: name, digest, classes. Errors: InvalidArgument "tokens.KEY = VALUE: must be ...".
Status checkToken(const TokenConfig& token);
/// Addresses, TLS, tokens together. Errors: PermissionDenied for an address that would be open to the network, InvalidArgument.
Status checkSecurity(const ServerConfig& config);

}  // namespace server
}  // namespace gobo
