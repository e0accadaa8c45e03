// SPDX-License-Identifier: Apache-2.0
// SharedLimit: an amount of something (bytes, calls) that all clients of the daemon share, of which one client may have only its
// part: what one takes never leaves nothing for the next. Thread-safe.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace gobo {
inline namespace server {

class SharedLimit {
 public:
  /// `part`: of the limit, that one client may have, in (0, 1].
  explicit SharedLimit(uint64_t limit, double part = 0.5) : limit_(limit), part_(part) {}

  /// What was taken, until it goes away; the SharedLimit must outlive it.
  class Hold {
   public:
    ~Hold();
    Hold(const Hold&) = delete;
    Hold& operator=(const Hold&) = delete;

   private:
    friend class SharedLimit;
    Hold(SharedLimit& limit, std::string client, uint64_t amount) : limit_(limit), client_(std::move(client)), amount_(amount) {}
    SharedLimit& limit_;
    const std::string client_;
    const uint64_t amount_;
  };
  /// Null when it would pass the limit, or the client's part of it. The first hold of a client may pass its part, and the very first
  /// hold of all the limit: what is larger than the bound alone would otherwise never be served.
  std::unique_ptr<Hold> take(const std::string& client, uint64_t amount);
  void setLimit(uint64_t limit);
  uint64_t limit() const;
  uint64_t used() const;
  uint64_t usedBy(const std::string& client) const;
  std::map<std::string, uint64_t> clients() const;  ///< what each has

 private:
  mutable std::mutex mutex_;
  uint64_t limit_, used_ = 0;
  const double part_;
  std::map<std::string, uint64_t> clients_;
};

}  // namespace server
}  // namespace gobo
