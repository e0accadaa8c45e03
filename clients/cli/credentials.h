// SPDX-License-Identifier: Apache-2.0
// What the CLI shows a daemon beyond loopback: TLS files and the bearer token. The token comes from a file or the environment,
// never from the command line, where other users could read it.
#pragma once

#include <memory>
#include <string>

#include <grpcpp/grpcpp.h>

#include "base/status.h"

namespace gobo::cli {

struct CredentialOptions {
  bool tls = false;                  ///< also on by any file below, or $GOBO_TLS_CA
  std::string ca, cert, key;         ///< PEM files; empty ca: $GOBO_TLS_CA, else the system's authorities
  std::string tokenFile;             ///< else $GOBO_TOKEN_FILE, else the token itself from $GOBO_TOKEN
};

/// For a TCP address; Unix sockets are always plain. Errors: NotFound for a file that cannot be read.
Result<std::shared_ptr<grpc::ChannelCredentials>> channelCredentials(const CredentialOptions& options, bool isUnix);
/// The token without white space around it; empty: none.
Result<std::string> bearerToken(const CredentialOptions& options);

}  // namespace gobo::cli
