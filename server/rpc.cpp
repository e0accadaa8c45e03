// SPDX-License-Identifier: Apache-2.0
#include "server/rpc.h"

#include <arpa/inet.h>

#include <algorithm>
#include <cmath>

#include "server/log.h"

namespace gobo {
inline namespace server {

namespace {

constexpr size_t kMostOfTrailers = 6000;  // of 8 KiB, which request id, retry info and names of the fields share

/// A text is in the trailers twice: percent-encoded (grpc-message) and as it is (grpc-status-details-bin).
size_t inTrailers(char c) { return c >= 0x20 && c < 0x7f && c != '%' ? 2 : 4; }
std::string fitting(const std::string& text, size_t most) {
  size_t bytes = 0, at = 0;
  while (at < text.size() && (bytes += inTrailers(text[at])) <= most) ++at;
  if (at == text.size()) return text;
  while (at > 0 && (static_cast<unsigned char>(text[at]) & 0xc0) == 0x80) --at;  // characters stay whole
  return text.substr(0, at) + "...";
}

}  // namespace

grpc::Status toGrpc(const Status& status) {
  if (status.ok()) return grpc::Status::OK;
  std::string text = fitting(escaped(status.message()), kMostOfTrailers / 4 * 3);
  if (!status.location().empty()) text += " (at " + fitting(escaped(status.location()), kMostOfTrailers / 4) + ")";
  return {grpc::StatusCode(int(status.code())), text};
}

grpc::Status busy(grpc::ServerContext& context, const std::string& what, double retryAfterMs) {
  const long ms = std::max(1L, std::lround(std::min(std::max(retryAfterMs, 1.0), 3.6e6)));
  context.AddTrailingMetadata(kRetryAfterKey, std::to_string(ms));
  return {grpc::StatusCode::RESOURCE_EXHAUSTED, escaped(what) + "; retry after " + std::to_string(ms) + " ms"};
}

grpc::Status drainingStatus() { return {grpc::StatusCode::UNAVAILABLE, "the server is shutting down"}; }

std::string peerOf(const grpc::ServerContext& context) {
  const std::string peer = context.peer();
  if (peer.rfind("inproc", 0) != 0) return peer;
  const auto at = context.client_metadata().find(kPeerKey);
  return at == context.client_metadata().end() ? peer : std::string(at->second.data(), at->second.size());
}

std::string peerText(const sockaddr& address) {
  char host[INET6_ADDRSTRLEN] = "?";
  const bool six = address.sa_family == AF_INET6;
  uint16_t port = 0;
  if (six) {
    const auto& a = reinterpret_cast<const sockaddr_in6&>(address);
    ::inet_ntop(AF_INET6, &a.sin6_addr, host, sizeof host);
    port = ntohs(a.sin6_port);
  } else if (address.sa_family == AF_INET) {
    const auto& a = reinterpret_cast<const sockaddr_in&>(address);
    ::inet_ntop(AF_INET, &a.sin_addr, host, sizeof host);
    port = ntohs(a.sin_port);
  }
  return std::string("http:") + (six ? "[" : "") + host + (six ? "]:" : ":") + std::to_string(port);
}

bool isLocalPeer(const grpc::ServerContext& context) {
  const std::string peer = peerOf(context);
  return peer.rfind("unix:", 0) == 0 || peer.rfind("inproc", 0) == 0;
}

std::string clientName(const grpc::ServerContext& context, const std::string& named) {
  if (!named.empty()) return named.substr(0, 256);
  const std::string peer = peerOf(context);
  if (peer.rfind("unix:", 0) == 0) return "unix";
  const size_t colon = peer.rfind(':');
  return colon == std::string::npos ? peer : peer.substr(0, colon);
}

std::optional<std::chrono::steady_clock::time_point> deadlineOf(const grpc::ServerContext& context, const v1::Scheduling& scheduling) {
  using Steady = std::chrono::steady_clock;
  using Ms = std::chrono::duration<double, std::milli>;
  double ms = std::numeric_limits<double>::infinity();
  if (scheduling.has_deadline_ms()) ms = scheduling.deadline_ms();
  const auto rpc = context.deadline();  // time_point::max() when the client gave none
  if (rpc < std::chrono::system_clock::time_point::max()) ms = std::min(ms, Ms(rpc - std::chrono::system_clock::now()).count());
  if (ms > 1e11) return std::nullopt;  // over three years: none
  return Steady::now() + std::chrono::duration_cast<Steady::duration>(Ms(std::max(ms, 0.0)));
}

}  // namespace server
}  // namespace gobo
