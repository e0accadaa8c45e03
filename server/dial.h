// SPDX-License-Identifier: Apache-2.0
// dial(): a channel to a daemon as its callers have it: `gobo --server` and the worker of a farm. TLS, and a token that never travels in the
// clear beyond this machine. Nothing is connected yet when it returns.
#pragma once

#include <memory>
#include <string>

#include <grpcpp/grpcpp.h>

#include "base/status.h"

namespace gobo {
inline namespace server {

struct DialOptions {
  std::string address;       ///< "unix:PATH" or "HOST:PORT"
  bool tls = false;          ///< also when any of the files is named
  std::string ca;            ///< PEM file; the system's if empty
  std::string cert, key;     ///< PEM files: the client's own
  std::string tokenFile;     ///< its first line is the token
  std::string token;         ///< if no file is named
  std::string prefix, fill;  ///< how options are called in errors: prefix + "token" + fill + "file"; "--" and "-", or "farm." and "_"
};

struct Dialled {
  std::shared_ptr<grpc::Channel> channel;
  std::string token;  ///< empty: none
};

/// Errors: InvalidArgument that names the option; NotFound, PermissionDenied of its files.
Result<Dialled> dial(const DialOptions& options);

}  // namespace server
}  // namespace gobo
