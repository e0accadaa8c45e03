// SPDX-License-Identifier: Apache-2.0
#include "server/term_selection.h"

#include <algorithm>
#include <map>

namespace gobo {
inline namespace server {

namespace {

constexpr uint32_t kPage = 200, kMostPage = 1000;
constexpr size_t kPageBytes = 512 << 10, kMostName = 1000, kFewestDigits = 6, kDigits = 32;
constexpr int kMostKeys = 1000;

bool isDigits(const std::string& text) { return text.find_first_not_of("0123456789abcdef") == std::string::npos; }

std::string lower(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'F') c = char(c - 'A' + 'a');
  return text;
}

}  // namespace

bool matches(const std::string& pattern, const std::string& text) {
  size_t p = 0, t = 0, star = std::string::npos, from = 0;  // after the last star, and where its letters end
  while (t < text.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = ++p;
      from = t;
    } else if (p < pattern.size() && pattern[p] == text[t]) {
      ++p, ++t;
    } else if (star != std::string::npos) {
      p = star;
      t = ++from;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', p) == std::string::npos;
}

Result<TermFilter> filterOf(const v1::TermSelector& which, const std::string& where) {
  if (which.type().empty() && which.scene().empty() && which.key().empty()) return invalidArgument(where + ": give type, scene or key", where);
  for (const auto& [field, text] : {std::pair("type", &which.type()), std::pair("scene", &which.scene())})
    if (text->size() > kMostName)
      return invalidArgument(where + "." + field + ": has " + std::to_string(text->size()) + " letters, at most " + std::to_string(kMostName),
                             where + "." + field);
  if (which.key_size() > kMostKeys)
    return invalidArgument(where + ".key: " + std::to_string(which.key_size()) + " of them, at most " + std::to_string(kMostKeys), where + ".key");
  std::vector<std::string> keys;
  for (int i = 0; i < which.key_size(); ++i) {
    keys.push_back(lower(which.key(i)));
    if (keys.back().size() < kFewestDigits || keys.back().size() > kDigits || !isDigits(keys.back()))
      return invalidArgument(where + ".key[" + std::to_string(i) + "] = '" + which.key(i).substr(0, 80) + "': must be 6 to 32 hex digits", where + ".key");
  }
  std::sort(keys.begin(), keys.end());
  return TermFilter([type = which.type(), scene = which.scene(), keys](const StoredTerm& row) {
    if (!type.empty() && !matches(type, row.type)) return false;
    if (!scene.empty() && scene != row.note.scene) return false;
    if (keys.empty()) return true;
    const std::string key = row.key.hex();
    return std::any_of(keys.begin(), keys.end(), [&](const std::string& k) { return key.compare(0, k.size(), k) == 0; });
  });
}

Status listInto(const std::vector<StoredTerm>& rows, const v1::ListTermsRequest& request, bool whole, v1::ListTermsReply& reply) {
  if (request.page_size() > kMostPage)
    return invalidArgument("request.page_size = " + std::to_string(request.page_size()) + ": at most " + std::to_string(kMostPage), "request.page_size");
  const std::string& token = request.page_token();
  if (!token.empty() && (token.size() != kDigits || !isDigits(token)))
    return invalidArgument("request.page_token = '" + token.substr(0, 80) + "': is no next_page_token", "request.page_token");
  const Hash128 after = Hash128::fromHex(token);
  const uint32_t most = request.page_size() == 0 ? kPage : request.page_size();
  std::map<std::string, v1::TermTotal> totals;
  size_t bytes = 0;
  bool full = false;
  reply.set_totals_only(!whole);
  for (const StoredTerm& row : rows) {
    if (token.empty()) {
      v1::TermTotal& total = totals[row.type];
      total.set_type(row.type);
      total.set_terms(total.terms() + 1);
      total.set_bytes(total.bytes() + row.bytes);
      total.set_disk_bytes(total.disk_bytes() + row.diskBytes);
      total.set_pinned(total.pinned() + row.pinned);
    }
    if (!whole || full || (!token.empty() && row.key <= after)) continue;
    if (uint32_t(reply.terms_size()) == most || bytes > kPageBytes) {
      full = true;
      reply.set_next_page_token(reply.terms().rbegin()->key());
      continue;
    }
    v1::TermInfo& out = *reply.add_terms();
    out.set_key(row.key.hex());
    out.set_type(row.type);
    out.set_label(row.note.label);
    out.set_scene(row.note.scene);
    out.set_bytes(row.bytes);
    out.set_disk_bytes(row.diskBytes);
    out.set_used_s(double(row.used) * 1e-6);
    out.set_cost_ms(row.note.ms);
    out.set_pinned(row.pinned);
    bytes += out.ByteSizeLong();
  }
  for (auto& [type, total] : totals) *reply.add_totals() = std::move(total);
  return {};
}

}  // namespace server
}  // namespace gobo
