// SPDX-License-Identifier: Apache-2.0
#include "server/auth.h"

#include <algorithm>

#include <openssl/crypto.h>

#include "server/encode.h"
#include "server/rpc.h"

namespace gobo {
inline namespace server {

namespace {
constexpr size_t kBearer = 7;  // of "Bearer "

bool isBearer(const std::string& value) {
  std::string scheme = value.substr(0, kBearer);
  std::transform(scheme.begin(), scheme.end(), scheme.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return scheme == "bearer " && value.size() > kBearer && value.size() <= 4096;
}
}  // namespace

double Principal::takeRequest(double now) const {
  if (!token || token->requestsPerSecond <= 0) return 0;
  const double burst = token->burst;
  const std::lock_guard lock(use->mutex);
  if (use->available < 0) use->available = burst;
  else use->available += std::max(0.0, now - use->at) * token->requestsPerSecond;
  use->available = std::min(use->available, burst);
  use->at = now;
  if (use->available >= 1) {
    use->available -= 1;
    return 0;
  }
  return (1 - use->available) / token->requestsPerSecond;
}

RenderSlot::RenderSlot(const Principal& who) {
  if (!who.token) return;
  use_ = who.use;
  const uint32_t before = use_->renders.fetch_add(1);
  ok = who.token->rendersAtOnce == 0 || before < who.token->rendersAtOnce;
}

RenderSlot::~RenderSlot() {
  if (use_) use_->renders.fetch_sub(1);
}

void TokenBook::reload(const std::vector<TokenConfig>& tokens, bool always) {
  const std::lock_guard lock(mutex_);
  entries_.clear();
  std::map<std::string, std::shared_ptr<TokenUse>> uses;
  for (const TokenConfig& t : tokens) {
    std::shared_ptr<TokenUse>& use = uses[t.name];
    const auto old = uses_.find(t.name);
    use = old == uses_.end() ? std::make_shared<TokenUse>() : old->second;
    entries_.push_back({t.sha256, std::make_shared<TokenConfig>(t), use});
  }
  uses_ = std::move(uses);
  always_ = always;
}

grpc::Status TokenBook::identify(const grpc::ServerContext& context, Principal& who) const {
  who = {};
  who.local = isLocalPeer(context);
  const bool inProcess = peerOf(context).rfind("inproc", 0) == 0;
  const auto [first, last] = context.client_metadata().equal_range("authorization");
  const auto refuse = [](const char* why) { return grpc::Status(grpc::StatusCode::UNAUTHENTICATED, why); };
  if (first == last) {
    {
      const std::lock_guard lock(mutex_);
      const bool needed = !inProcess && !entries_.empty() && (always_ || !who.local);
      if (needed) return refuse("authorization: none was sent; this server wants \"authorization: Bearer TOKEN\" metadata");
    }
    who.name = inProcess ? "local" : clientName(context, "");
    who.admin = who.worker = true;  // of a daemon without tokens, or its own user; Shutdown asks for `local` as well
    return grpc::Status::OK;
  }
  if (std::next(first) != last) return refuse("authorization: sent more than once");
  const std::string value(first->second.data(), first->second.size());
  if (!isBearer(value)) return refuse("authorization: must be \"Bearer TOKEN\"");
  const std::lock_guard lock(mutex_);
  const Entry* found = find(value);
  if (!found) return refuse("authorization: the token is not known to this server");
  who.name = found->config->name;
  who.admin = found->config->admin;
  who.worker = who.admin || found->config->worker;
  who.token = found->config;
  who.use = found->use;
  return grpc::Status::OK;
}

const TokenBook::Entry* TokenBook::find(const std::string& authorization) const {
  const std::string digest = sha256Hex(authorization.data() + kBearer, authorization.size() - kBearer);
  const Entry* found = nullptr;
  // Every entry is compared, whole, whichever matches: the time says nothing about the tokens there are.
  for (const Entry& e : entries_)
    if (CRYPTO_memcmp(digest.data(), e.digest.data(), digest.size()) == 0) found = &e;
  return found;
}

std::string TokenBook::nameOf(const std::string& authorization) const {
  if (!isBearer(authorization)) return {};
  const std::lock_guard lock(mutex_);
  const Entry* found = find(authorization);
  return found ? found->config->name : std::string();
}

bool TokenBook::isName(const std::string& name) const {
  const std::lock_guard lock(mutex_);
  return uses_.count(name) != 0;
}

size_t TokenBook::count() const {
  const std::lock_guard lock(mutex_);
  return entries_.size();
}

}  // namespace server
}  // namespace gobo
