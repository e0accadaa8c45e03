// SPDX-License-Identifier: Apache-2.0
// Names and secrets that nobody can guess.
#pragma once

#include <optional>
#include <string>

namespace gobo {
inline namespace server {

/// Twice as many lower-case hex digits, from the kernel's generator; nothing if it has none.
std::optional<std::string> randomHex(size_t bytes);

}  // namespace server
}  // namespace gobo
