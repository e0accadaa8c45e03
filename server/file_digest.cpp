// SPDX-License-Identifier: Apache-2.0
#include "server/file_digest.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <vector>

#include "server/encode.h"

namespace gobo {
inline namespace server {

Result<std::string> fileDigest(int fd, const std::string& name, const DigestLimit& limit, const StopToken& stop) {
  const auto tooLarge = [&](uint64_t bytes) {
    return Status(Code::ResourceExhausted, "file has " + std::to_string(bytes) + " bytes: at most " + std::to_string(limit.bytes) + " (" + limit.key + ")",
                  name);
  };
  struct stat info {};
  if (::fstat(fd, &info) == 0 && uint64_t(info.st_size) > limit.bytes) return tooLarge(uint64_t(info.st_size));
  Sha256 sha;
  std::vector<uint8_t> slice(1 << 20);
  for (uint64_t total = 0;;) {
    if (stop.stopRequested()) return Status(Code::Cancelled, "the load was cancelled", name);
    const ssize_t n = ::read(fd, slice.data(), slice.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return Status(Code::Unavailable, std::string("cannot read file: ") + std::strerror(errno), name);
    if (n == 0) return sha.hex();
    total += uint64_t(n);
    if (total > limit.bytes) return tooLarge(total);
    sha.add(slice.data(), size_t(n));
  }
}

}  // namespace server
}  // namespace gobo
