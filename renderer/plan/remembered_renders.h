// SPDX-License-Identifier: Apache-2.0
// RememberedRenders: what each reply's render id stands for. An id is a handle of one reply, 128 random bits: it says nothing about
// the request (that is request_hash), equal requests get different ids, and nobody finds another caller's by guessing.
// The request is the reply's own: resolved, with the samples that were realised. Bounded in number and bytes: beyond either the least
// recently used of whichever owner has most goes, so nobody drives out another's. Thread-safe.
#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace plan {

class RememberedRenders {
 public:
  explicit RememberedRenders(size_t keep, uint64_t bytes = UINT64_MAX) : keep_(keep), bytes_(bytes) {}
  /// The new reply's id. `owner`: who may relight from it besides those who may everything; may be empty (nobody's in particular).
  std::string add(const v1::RenderRequest& request, const std::string& owner);
  /// `caller` empty: may use every id. Otherwise another owner's id is unknown to it, like one that never was. The id counts as used.
  std::optional<v1::RenderRequest> find(const std::string& id, const std::string& caller);
  size_t keep() const { return keep_; }
  uint64_t bytes() const;
  uint64_t limit() const { return bytes_; }
  std::map<std::string, uint64_t> bytesOfOwners() const;

 private:
  struct Entry {
    v1::RenderRequest request;
    std::string owner;
    uint64_t bytes = 0;
  };
  struct Held {
    std::list<std::string> order;
    uint64_t bytes = 0;
  };  ///< of one owner; least recently used first
  const size_t keep_;
  const uint64_t bytes_;
  mutable std::mutex mutex_;
  std::map<std::string, Entry> entries_;
  std::map<std::string, Held> owners_;
  uint64_t held_ = 0;
};

}  // namespace plan
}  // namespace gobo
