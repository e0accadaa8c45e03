// SPDX-License-Identifier: Apache-2.0
#include "server/random_hex.h"

#include <sys/random.h>

#include <vector>

#include "server/log.h"

namespace gobo {
inline namespace server {

std::optional<std::string> randomHex(size_t bytes) {
  std::vector<unsigned char> raw(bytes);
  if (::getrandom(raw.data(), raw.size(), 0) != ssize_t(raw.size())) return std::nullopt;
  std::string text;
  for (const unsigned char b : raw) text += strf("%02x", b);
  return text;
}

}  // namespace server
}  // namespace gobo
