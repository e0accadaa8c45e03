// SPDX-License-Identifier: Apache-2.0
// What Admin says of the term store: which terms a TermSelector means, and pages of them. Pure.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "base/status.h"
#include "gobo/v1/service.pb.h"
#include "plan/term_note.h"

namespace gobo {
inline namespace server {

using TermFilter = std::function<bool(const StoredTerm&)>;

/// Errors: InvalidArgument with the field (behind `where`, such as "request.which"): nothing is given, or more than a name or 1000 digests can be.
Result<TermFilter> filterOf(const v1::TermSelector& which, const std::string& where);
/// '*' in `pattern` stands for any letters, none too. Time of the product of both lengths at most.
bool matches(const std::string& pattern, const std::string& text);
/// The page of `rows` (by key) that `request` asks for into terms, next_page_token and, on the first page, totals. Rows of at most half a MiB.
/// Without `whole` the totals alone. Errors: InvalidArgument.
Status listInto(const std::vector<StoredTerm>& rows, const v1::ListTermsRequest& request, bool whole, v1::ListTermsReply& reply);

}  // namespace server
}  // namespace gobo
