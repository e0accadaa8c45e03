// SPDX-License-Identifier: Apache-2.0
// Text that came from outside, on its way into messages: protobuf strings that are not UTF-8 cannot be parsed by the receiver, so one
// bad name would spoil a whole reply. Pure functions, O(bytes).
#pragma once

#include <string>
#include <string_view>

#include "base/status.h"

namespace gobo {
inline namespace base {

/// Well-formed as in RFC 3629: no overlong forms, no surrogates, nothing above U+10FFFF.
bool isUtf8(std::string_view text);
/// Every byte that is not part of a well-formed character becomes "\xNN"; UTF-8 stays as it is.
std::string cleanUtf8(std::string text);
/// The same for message and location.
Status cleanUtf8(const Status& status);

}  // namespace base
}  // namespace gobo
