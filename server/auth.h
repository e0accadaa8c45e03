// SPDX-License-Identifier: Apache-2.0
// Who calls: bearer tokens ("authorization: Bearer TOKEN" metadata), known by the SHA-256 of their bytes only and compared in
// constant time. Callers without a token: the local user on the Unix socket or in this process, the peer's host on TCP while
// no tokens are configured. What a token has used (rate, running renders) lives by its name and survives a reload. Thread-safe.
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "server/config.h"

namespace gobo {
inline namespace server {

/// What one token has used.
struct TokenUse {
  std::mutex mutex;
  double available = -1;  ///< requests in the bucket; negative: fresh, hence full
  double at = 0;          ///< seconds of JobRunner::now() at which `available` held
  std::atomic<uint32_t> renders{0};
};

struct Principal {
  std::string name;    ///< of the token; else "unix", "local", or the peer's host
  bool local = false;  ///< Unix socket or this process
  bool admin = false, worker = false;
  std::shared_ptr<const TokenConfig> token;  ///< null: none was shown, and none is needed here
  std::shared_ptr<TokenUse> use;             ///< with a token
  /// Takes one request out of the bucket. 0: taken; else seconds until there is one.
  double takeRequest(double now) const;
};

/// One of the token's concurrent renders, given back with the object. `ok`: there was one left.
class RenderSlot {
 public:
  explicit RenderSlot(const Principal& who);
  ~RenderSlot();
  RenderSlot(const RenderSlot&) = delete;
  RenderSlot& operator=(const RenderSlot&) = delete;
  bool ok = true;

 private:
  std::shared_ptr<TokenUse> use_;
};

class TokenBook {
 public:
  /// `always`: callers of the Unix socket need a token as well.
  void reload(const std::vector<TokenConfig>& tokens, bool always);
  /// UNAUTHENTICATED when a token is missing, malformed or unknown; the text never holds what was sent.
  grpc::Status identify(const grpc::ServerContext& context, Principal& who) const;
  /// The name of the token in "Bearer TOKEN"; empty: none of this book's.
  std::string nameOf(const std::string& authorization) const;
  /// The token of that name is somebody's.
  bool isName(const std::string& name) const;
  size_t count() const;

 private:
  struct Entry;
  const Entry* find(const std::string& authorization) const;  // with mutex_
  struct Entry {
    std::string digest;
    std::shared_ptr<const TokenConfig> config;
    std::shared_ptr<TokenUse> use;
  };
  mutable std::mutex mutex_;
  std::vector<Entry> entries_;
  std::map<std::string, std::shared_ptr<TokenUse>> uses_;
  bool always_ = false;
};

}  // namespace server
}  // namespace gobo
