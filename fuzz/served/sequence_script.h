// SPDX-License-Identifier: Apache-2.0
// The calls that bytes stand for, and the texts in their requests: ids that are the caller's, another's, everybody's or nobody's. Pure but for what has been
// learned.
#pragma once

#include <mutex>
#include <string>
#include <vector>

#include "fuzz/properties.h"
#include "fuzz/served/generic_call.h"

namespace gobo::fuzz {

struct ScriptedCall {
  std::string client;
  const google::protobuf::MethodDescriptor* method = nullptr;
  bool beside = false;  ///< at the same time as those before it
  uint8_t how = 0;
  Bytes edits;

  int cancelAfter() const { return how % 4 == 3 ? (how >> 2) % 4 : -1; }
  int messages() const { return method->client_streaming() ? 1 + (how >> 4) % 3 : 1; }
  bool compared() const { return (how & 0x80) != 0; }
};

constexpr size_t kMostCalls = 32;
std::vector<ScriptedCall> script(Bytes bytes);

/// The name of a scene that nobody but this client may know: it starts with privatePrefix(client).
std::string privatePrefix(const std::string& client);

/// Render ids that came in replies, by who got them. Thread-safe.
class LearnedIds {
 public:
  void add(const std::string& client, const std::string& renderId);
  std::string any(uint32_t value) const;
  /// Who got it; empty: nobody.
  std::string ownerOf(const std::string& renderId) const;
  /// Of others than this client.
  std::vector<std::string> othersThan(const std::string& client) const;

 private:
  mutable std::mutex mutex_;
  std::vector<std::pair<std::string, std::string>> ids_;
};

/// The requests of a call: what usually works, then its edits, everything tiny. `root`: the daemon's files.
std::vector<MessagePtr> requestsOf(const ScriptedCall& call, const std::string& root, const LearnedIds& learned);

}  // namespace gobo::fuzz
