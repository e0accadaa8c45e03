// SPDX-License-Identifier: Apache-2.0
#include "server/bound_socket.h"

#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

namespace gobo {
inline namespace server {
namespace {

Status cannot(const std::string& address) {
  return {Code::Unavailable, "cannot listen on " + address + ": " + std::strerror(errno) + ": in use or not permitted"};
}

struct Resolved {
  addrinfo* list = nullptr;
  ~Resolved() {
    if (list) ::freeaddrinfo(list);
  }
};

}  // namespace

Result<BoundSockets> bindTcp(const std::string& text) {
  GOBO_ASSIGN(const Address address, parseAddress(text));
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  Resolved found;
  if (const int error = ::getaddrinfo(address.host.c_str(), address.port.c_str(), &hints, &found.list); error != 0)
    return Status(Code::Unavailable, "cannot listen on " + text + ": " + ::gai_strerror(error));
  BoundSockets bound;
  int port = std::atoi(address.port.c_str());
  bool some = false;
  for (const addrinfo* a = found.list; a; a = a->ai_next) {
    sockaddr_storage name{};
    std::memcpy(&name, a->ai_addr, a->ai_addrlen);
    in_port_t& number = a->ai_family == AF_INET6 ? reinterpret_cast<sockaddr_in6&>(name).sin6_port : reinterpret_cast<sockaddr_in&>(name).sin_port;
    number = htons(uint16_t(port));  // the one that the first address was given, for port 0
    Descriptor fd(::socket(a->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    if (!fd && errno == EAFNOSUPPORT) continue;  // a name with an address of a family that this machine has not
    const int yes = 1;
    if (fd) ::setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (fd && a->ai_family == AF_INET6 && found.list->ai_next) ::setsockopt(fd.get(), IPPROTO_IPV6, IPV6_V6ONLY, &yes, sizeof yes);
    if (!fd || ::bind(fd.get(), reinterpret_cast<const sockaddr*>(&name), a->ai_addrlen) != 0) {
      if (errno == EADDRNOTAVAIL && (some || a->ai_next)) continue;
      return cannot(text);
    }
    if (::listen(fd.get(), 512) != 0) return cannot(text);
    socklen_t size = sizeof name;
    ::getsockname(fd.get(), reinterpret_cast<sockaddr*>(&name), &size);
    port = ntohs(number);
    some = true;
    bound.sockets.push_back(std::move(fd));
  }
  if (!some) return cannot(text);
  bound.served = text.substr(0, text.rfind(':') + 1) + std::to_string(port);
  return bound;
}

}  // namespace server
}  // namespace gobo
