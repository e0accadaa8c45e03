// SPDX-License-Identifier: Apache-2.0
#include "ingest/wire.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace gobo::ingest {
namespace {

struct Out {
  std::vector<uint8_t> bytes;
  template <typename T>
  Out& put(const T& v) {
    const auto* p = reinterpret_cast<const uint8_t*>(&v);
    bytes.insert(bytes.end(), p, p + sizeof v);
    return *this;
  }
  Out& put(const std::vector<std::string>& list) {
    put(uint32_t(list.size()));
    for (const std::string& s : list) put(s);
    return *this;
  }
  Out& put(const std::string& s) {
    put(uint32_t(s.size()));
    bytes.insert(bytes.end(), s.begin(), s.end());
    return *this;
  }
};

struct In {
  const std::vector<uint8_t>& bytes;
  size_t at = 0;
  bool ok = true;
  template <typename T>
  In& get(T& v) {
    if (!ok || bytes.size() - at < sizeof v) {
      ok = false;
      return *this;
    }
    std::memcpy(&v, bytes.data() + at, sizeof v);
    at += sizeof v;
    return *this;
  }
  In& get(std::string& s) {
    uint32_t n = 0;
    get(n);
    if (!ok || bytes.size() - at < n) {
      ok = false;
      return *this;
    }
    s.assign(reinterpret_cast<const char*>(bytes.data()) + at, n);
    at += n;
    return *this;
  }
  In& get(std::vector<std::string>& list) {
    uint32_t n = 0;
    get(n);
    if (n > 64) ok = false;
    list.assign(ok ? n : 0, {});
    for (std::string& s : list) get(s);
    return *this;
  }
  bool whole() const { return ok && at == bytes.size(); }
};

}  // namespace

std::vector<uint8_t> encode(const Job& j) {
  return Out().put(j.task).put(j.path).put(j.maxTriangles).put(j.maxBytes).put(j.textureBytes).put(j.memoryBytes).put(j.blobBytes).put(j.cpuSeconds).bytes;
}
std::vector<uint8_t> encode(const Done& d) { return Out().put(d.parseMs).put(d.textureMs).put(d.layers.active).put(d.layers.missing).bytes; }
std::vector<uint8_t> encode(const Status& s) { return Out().put(uint32_t(s.code())).put(s.message()).put(s.location()).bytes; }

bool decode(const std::vector<uint8_t>& body, Job& j) {
  In in{body};
  in.get(j.task).get(j.path).get(j.maxTriangles).get(j.maxBytes).get(j.textureBytes).get(j.memoryBytes).get(j.blobBytes).get(j.cpuSeconds);
  return in.whole();
}
bool decode(const std::vector<uint8_t>& body, Done& d) { return In{body}.get(d.parseMs).get(d.textureMs).get(d.layers.active).get(d.layers.missing).whole(); }
bool decode(const std::vector<uint8_t>& body, Status& s) {
  uint32_t code = 0;
  std::string message, location;
  if (!In{body}.get(code).get(message).get(location).whole() || code == 0 || code > uint32_t(Code::DataLoss)) return false;
  s = Status(Code(code), message, location);
  return true;
}

bool readAll(int fd, void* to, size_t bytes) {
  auto* p = static_cast<uint8_t*>(to);
  while (bytes > 0) {
    const ssize_t n = ::read(fd, p, bytes);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    p += n;
    bytes -= size_t(n);
  }
  return true;
}

bool writeAll(int fd, const void* from, size_t bytes) {
  const auto* p = static_cast<const uint8_t*>(from);
  while (bytes > 0) {
    const ssize_t n = ::write(fd, p, bytes);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    p += n;
    bytes -= size_t(n);
  }
  return true;
}

bool writeFrame(int fd, Frame type, const void* body, size_t bytes) {
  uint8_t head[9];
  const uint64_t size = bytes;
  head[0] = uint8_t(type);
  std::memcpy(head + 1, &size, 8);
  return writeAll(fd, head, sizeof head) && writeAll(fd, body, bytes);
}

}  // namespace gobo::ingest
