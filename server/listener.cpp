// SPDX-License-Identifier: Apache-2.0
#include "server/listener.h"

#include <fcntl.h>
#include <linux/tcp.h>  // glibc's has an older tcp_info
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "server/bound_socket.h"
#include "server/config.h"
#include "server/log.h"

namespace gobo {
inline namespace server {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::seconds kSilent{1};  // a client speaks first: one that has said nothing for so long may have to go

Status cannot(const std::string& address) { return {Code::Unavailable, "cannot listen on " + address + ": " + std::strerror(errno)}; }

/// "127.0.0.1:4711", the abstract name of a Unix client, or "" for one without.
std::string nameOf(const sockaddr_storage& a, socklen_t size, bool withPort) {
  if (a.ss_family == AF_UNIX) {
    constexpr socklen_t head = offsetof(sockaddr_un, sun_path);
    return size > head ? "unix:" + std::string(reinterpret_cast<const sockaddr_un&>(a).sun_path, size - head) : std::string();
  }
  char host[NI_MAXHOST], port[NI_MAXSERV];
  if (::getnameinfo(reinterpret_cast<const sockaddr*>(&a), size, host, sizeof host, port, sizeof port, NI_NUMERICHOST | NI_NUMERICSERV) != 0) return "?";
  return withPort ? std::string(host) + ":" + port : host;
}

uint64_t inodeOf(int fd) {
  struct stat info {};
  return ::fstat(fd, &info) == 0 && S_ISSOCK(info.st_mode) ? info.st_ino : 0;
}

/// Nothing has arrived on it yet. False where that cannot be told.
bool silent(int fd) {
  tcp_info info{};
  socklen_t size = sizeof info;
  return ::getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &size) == 0 && size >= offsetof(tcp_info, tcpi_bytes_received) + sizeof info.tcpi_bytes_received &&
         info.tcpi_bytes_received == 0;
}

}  // namespace

Result<std::string> Listener::add(const std::string& text) {
  GOBO_ASSIGN(const Address address, parseAddress(text));
  const size_t index = added_++;
  if (address.isUnix) {
    sockaddr_un name{};
    name.sun_family = AF_UNIX;
    std::copy(address.path.begin(), address.path.end(), name.sun_path);
    Descriptor fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    const mode_t mask = ::umask(0177);  // born with mode 0600: no moment at which others could connect
    const bool bound = fd && ::bind(fd.get(), reinterpret_cast<const sockaddr*>(&name), sizeof name) == 0;
    ::umask(mask);
    if (!bound || ::listen(fd.get(), 512) != 0) return cannot(text);
    sockets_.push_back({std::move(fd), index, true});
    return text;
  }
  GOBO_ASSIGN(BoundSockets bound, bindTcp(text));
  for (Descriptor& fd : bound.sockets) sockets_.push_back({std::move(fd), index, false});
  return bound.served;
}

void Listener::start(Take take) {
  take_ = std::move(take);
  reserve_ = Descriptor(::open("/dev/null", O_RDONLY | O_CLOEXEC));
  wake_ = Descriptor(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  thread_ = std::thread([this] { loop(); });
}

void Listener::stop() {
  if (!thread_.joinable()) return;
  stopping_.store(true);
  const uint64_t one = 1;
  (void)!::write(wake_.get(), &one, sizeof one);
  thread_.join();
  sockets_.clear();
}

void Listener::loop() {
  std::vector<pollfd> wait;
  for (const Socket& s : sockets_) wait.push_back({s.fd.get(), POLLIN, 0});
  wait.push_back({wake_.get(), POLLIN, 0});
  while (!stopping_.load()) {
    const int ready = ::poll(wait.data(), nfds_t(wait.size()), 1000);
    if (ready <= 0) {
      const std::lock_guard lock(mutex_);
      forgetClosed();
      continue;
    }
    for (size_t i = 0; i < sockets_.size(); ++i)
      if (wait[i].revents) accept(sockets_[i]);
  }
}

void Listener::forgetClosed() {
  stats_.looked += peers_.size();
  std::erase_if(peers_, [&](const Peer& p) {
    if (inodeOf(p.fd) == p.inode) return false;
    if (--ofPeer_[p.address] == 0) ofPeer_.erase(p.address);
    return true;
  });
  stats_.open = uint32_t(peers_.size());
  forgotten_ = Clock::now();
}

void Listener::forgetClosed(std::chrono::milliseconds age) {
  if (Clock::now() - forgotten_ >= age) forgetClosed();
}

// Between the look at the inode and shutdown() the descriptor could in theory become another connection, which then loses its place:
// its client connects again.
bool Listener::evictSilent(const std::string* address) {
  const auto before = Clock::now() - kSilent;
  for (Peer& p : peers_) {
    if (p.since > before) return false;  // oldest first
    if (p.spoke || (address && p.address != *address)) continue;
    ++stats_.looked;
    if (inodeOf(p.fd) != p.inode) continue;
    if (!silent(p.fd)) {
      p.spoke = true;
      continue;
    }
    ::shutdown(p.fd, SHUT_RDWR);
    if (--ofPeer_[p.address] == 0) ofPeer_.erase(p.address);
    peers_.erase(peers_.begin() + (&p - peers_.data()));
    ++stats_.evicted;
    return true;
  }
  return false;
}

// Who connects again and again must not make each connection cost a look at all that are open: what was closed is looked for at most
// every kOften, and once more, after kAtMost, before anybody is refused.
bool Listener::makeRoom(const std::string& address) {
  constexpr std::chrono::milliseconds kOften{50}, kAtMost{5};
  const auto full = [&] {
    const auto mine = ofPeer_.find(address);
    return !address.empty() && mine != ofPeer_.end() && mine->second >= limits_.mostOfPeer;
  };
  const auto whole = [&] { return peers_.size() >= limits_.most; };
  if (whole() || full()) forgetClosed(kOften);
  if (full() && !evictSilent(&address)) {
    forgetClosed(kAtMost);
    if (full()) return false;
  }
  if (!whole() || evictSilent(nullptr)) return true;
  forgetClosed(kAtMost);
  return !whole();
}

void Listener::accept(Socket& from) {
  for (int n = 0; n < 64; ++n) {  // then the other sockets have their turn
    sockaddr_storage name{};
    socklen_t size = sizeof name;
    Descriptor fd(::accept4(from.fd.get(), reinterpret_cast<sockaddr*>(&name), &size, SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (!fd) {
      if (errno == EMFILE || errno == ENFILE) {
        const std::lock_guard lock(mutex_);
        ++stats_.noDescriptor;
        forgetClosed();
        (void)evictSilent(nullptr);
        // The reserve takes the connection off the queue: its client hears a close instead of nothing.
        reserve_.close();
        Descriptor refused(::accept4(from.fd.get(), nullptr, nullptr, SOCK_CLOEXEC));
        refused.close();
        reserve_ = Descriptor(::open("/dev/null", O_RDONLY | O_CLOEXEC));
        ::usleep(1000);  // a process without descriptors must not spin
      } else if (errno != EINTR && errno != ECONNABORTED) {
        return;  // EAGAIN; what else there is poll() will tell again
      }
      continue;
    }
    const std::string whole = nameOf(name, size, true), address = from.isUnix ? std::string() : nameOf(name, size, false);
    {
      const std::lock_guard lock(mutex_);
      if (probes_.erase(whole)) {  // of reachable(): it has shown what it came for
        probed_.notify_all();
        continue;
      }
      if (!makeRoom(address)) {
        ++stats_.refused;
        continue;
      }
      ++stats_.accepted;
      ++ofPeer_[address];
      peers_.push_back({fd.get(), inodeOf(fd.get()), address, Clock::now()});
      stats_.open = uint32_t(peers_.size());
    }
    const int yes = 1;
    if (!from.isUnix) ::setsockopt(fd.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    take_(fd.release(), from.index);
  }
}

ListenerStats Listener::stats() const {
  const std::lock_guard lock(mutex_);
  return stats_;
}

bool Listener::reachable(size_t index, double seconds) {
  const auto at = std::find_if(sockets_.begin(), sockets_.end(), [&](const Socket& s) { return s.index == index; });
  if (at == sockets_.end()) return false;
  sockaddr_storage there{}, here{};
  socklen_t size = sizeof there, mine = sizeof here;
  if (::getsockname(at->fd.get(), reinterpret_cast<sockaddr*>(&there), &size) != 0) return false;
  const Descriptor fd(::socket(there.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (!fd) return false;  // no descriptor: a client would not get one either
  here.ss_family = there.ss_family;
  if (at->isUnix) {
    if (::bind(fd.get(), reinterpret_cast<const sockaddr*>(&here), sizeof(sa_family_t)) != 0) return false;  // an abstract name of its own
  } else {
    // Listening on every address: it is reached through loopback.
    sockaddr_in& v4 = reinterpret_cast<sockaddr_in&>(there);
    sockaddr_in6& v6 = reinterpret_cast<sockaddr_in6&>(there);
    if (there.ss_family == AF_INET && v4.sin_addr.s_addr == htonl(INADDR_ANY)) v4.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (there.ss_family == AF_INET6 && IN6_IS_ADDR_UNSPECIFIED(&v6.sin6_addr)) v6.sin6_addr = in6addr_loopback;
    sockaddr_storage from = there;
    (there.ss_family == AF_INET ? reinterpret_cast<sockaddr_in&>(from).sin_port : reinterpret_cast<sockaddr_in6&>(from).sin6_port) = 0;
    // Bound first, so that its name is known before it is accepted. An address of this machine can be bound to.
    if (::bind(fd.get(), reinterpret_cast<const sockaddr*>(&from), there.ss_family == AF_INET ? sizeof(sockaddr_in) : sizeof(sockaddr_in6)) != 0) return false;
  }
  if (::getsockname(fd.get(), reinterpret_cast<sockaddr*>(&here), &mine) != 0) return false;
  const std::string name = nameOf(here, mine, true);
  std::unique_lock lock(mutex_);
  probes_.insert(name);
  lock.unlock();
  const bool connecting = ::connect(fd.get(), reinterpret_cast<const sockaddr*>(&there), size) == 0 || errno == EINPROGRESS;
  lock.lock();
  const bool accepted = connecting && probed_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return !probes_.count(name); });
  probes_.erase(name);
  return accepted;
}

}  // namespace server
}  // namespace gobo
