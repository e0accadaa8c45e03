// SPDX-License-Identifier: Apache-2.0
// gobo cache: what the server's term store holds, and what is to stay in it.
#include <algorithm>
#include <cstdio>
#include <ctime>

#include "commands.h"
#include "report.h"
#include "request/request.h"

namespace gobo::cli {

namespace {

using Count = unsigned long long;

void choose(v1::TermSelector& which, const CacheCommand& c) {
  which.set_type(c.type);
  which.set_scene(c.scene);
  for (const std::string& key : c.keys) which.add_key(key);
}
bool chosen(const CacheCommand& c) { return !c.type.empty() || !c.scene.empty() || !c.keys.empty(); }

Status needChoice(const CacheCommand& c, const char* what) {
  if (chosen(c)) return {};
  return invalidArgument("cache " + std::string(what) + ": which terms? Name digests, --type or --scene ('*' is every type; `gobo cache list` shows them)");
}

/// All pages, with the first one's totals; without `rows` the totals alone.
Result<v1::ListTermsReply> listed(Session& session, const CacheCommand& c, bool rows) {
  v1::ListTermsRequest request;
  if (chosen(c)) choose(*request.mutable_which(), c);
  request.set_pinned(c.pinned);
  v1::ListTermsReply all;
  for (bool first = true;; first = false) {
    request.set_page_size(rows ? 1000 : 1);
    v1::ListTermsReply page;
    Session::Call call(session);
    GOBO_TRY(session.statusOf(session.admin().ListTerms(&call.context, request, &page)));
    if (first) all = page;
    else all.mutable_terms()->MergeFrom(page.terms());
    if (page.next_page_token().empty() || !rows) break;
    request.set_page_token(page.next_page_token());
  }
  all.clear_next_page_token();
  if (!rows) all.clear_terms();
  return all;
}

std::string ageText(double usedSeconds) {
  const double s = double(std::time(nullptr)) - usedSeconds;
  char text[40];
  if (usedSeconds <= 0) return "-";
  if (s < 100) std::snprintf(text, sizeof text, "%.0f s ago", std::max(s, 0.0));
  else if (s < 6000) std::snprintf(text, sizeof text, "%.0f min ago", s / 60);
  else if (s < 48 * 3600) std::snprintf(text, sizeof text, "%.0f h ago", s / 3600);
  else std::snprintf(text, sizeof text, "%.0f days ago", s / 86400);
  return text;
}

std::string sizeText(uint64_t bytes) { return bytes ? bytesText(bytes) : "-"; }

void printRows(const v1::ListTermsReply& reply) {
  std::vector<std::vector<std::string>> rows;
  for (const v1::TermInfo& t : reply.terms()) {
    char cost[32];
    std::snprintf(cost, sizeof cost, "%.1f", t.cost_ms());
    rows.push_back({t.key().substr(0, 12), t.type().empty() ? "?" : escaped(t.type()), escaped(t.scene()), sizeText(t.bytes()), sizeText(t.disk_bytes()),
                    ageText(t.used_s()), cost, t.pinned() ? "yes" : "-", escaped(t.label())});
  }
  if (!rows.empty())
    printTable({"digest", "type", "scene", "memory", "disk", "used", "ms", "pinned", "label"}, rows,
               {false, false, false, true, true, true, true, false, false});
}

void printTotals(const v1::ListTermsReply& reply) {
  std::vector<std::vector<std::string>> rows;
  v1::TermTotal all;
  for (const v1::TermTotal& t : reply.totals()) {
    rows.push_back({t.type().empty() ? "?" : escaped(t.type()), std::to_string(t.terms()), sizeText(t.bytes()), sizeText(t.disk_bytes()),
                    t.pinned() ? std::to_string(t.pinned()) : "-"});
    all.set_terms(all.terms() + t.terms());
    all.set_bytes(all.bytes() + t.bytes());
    all.set_disk_bytes(all.disk_bytes() + t.disk_bytes());
    all.set_pinned(all.pinned() + t.pinned());
  }
  rows.push_back({"all", std::to_string(all.terms()), sizeText(all.bytes()), sizeText(all.disk_bytes()), all.pinned() ? std::to_string(all.pinned()) : "-"});
  printTable({"type", "terms", "memory", "disk", "pinned"}, rows, {false, true, true, true, true});
  std::printf("memory holds at most %s, %s of it are pinned\n", bytesText(reply.limit()).c_str(), bytesText(reply.pinned_bytes()).c_str());
  if (reply.disk_limit() > 0)
    std::printf("the disk holds at most %s, %s of it are pinned\n", bytesText(reply.disk_limit()).c_str(), bytesText(reply.pinned_disk_bytes()).c_str());
  else std::printf("there is no disk cache\n");
}

Status list(Session& session, const CacheCommand& c) {
  GOBO_ASSIGN(v1::ListTermsReply reply, listed(session, c, true));
  if (reply.totals_only()) {
    return Status(Code::PermissionDenied,
                  "cache list: rows name others' scenes and lights: the server shows them to the admin right; `gobo cache size` has totals");
  }
  auto& terms = *reply.mutable_terms();
  std::stable_sort(terms.begin(), terms.end(), [&](const v1::TermInfo& a, const v1::TermInfo& b) {
    if (c.sort == "bytes") return std::max(a.bytes(), a.disk_bytes()) > std::max(b.bytes(), b.disk_bytes());
    if (c.sort == "cost") return a.cost_ms() > b.cost_ms();
    return a.used_s() > b.used_s();
  });
  const int held = terms.size();
  if (uint32_t(held) > c.limit) terms.DeleteSubrange(int(c.limit), held - int(c.limit));
  if (c.json) {
    std::printf("%s\n", messageToJson(reply, true).c_str());
    return {};
  }
  printRows(reply);
  if (terms.size() < held) std::printf("%d of %d terms are shown: --limit\n", terms.size(), held);
  if (terms.empty()) std::printf("no term %s\n", chosen(c) || c.pinned ? "is like that" : "is kept");
  return {};
}

Status size(Session& session, const CacheCommand& c) {
  GOBO_ASSIGN(const v1::ListTermsReply reply, listed(session, c, false));
  if (c.json) std::printf("%s\n", messageToJson(reply, true).c_str());
  else printTotals(reply);
  return {};
}

Status evict(Session& session, const CacheCommand& c) {
  GOBO_TRY(needChoice(c, "evict"));
  v1::DropCachesRequest request;
  choose(*request.mutable_which(), c);
  request.set_disk(!c.memory);
  request.set_pinned(c.pinned);
  v1::DropCachesReply reply;
  Session::Call call(session);
  GOBO_TRY(session.statusOf(session.admin().DropCaches(&call.context, request, &reply)));
  if (c.json) std::printf("%s\n", messageToJson(reply, true).c_str());
  else
    std::printf("evicted %llu terms, %s%s\n", Count(reply.terms()), bytesText(reply.bytes()).c_str(),
                reply.terms() == 0 && !c.pinned ? " (pinned ones stay unless --pinned is given)" : "");
  return {};
}

Status pin(Session& session, const CacheCommand& c, bool unpin) {
  GOBO_TRY(needChoice(c, unpin ? "unpin" : "pin"));
  v1::PinTermsRequest request;
  choose(*request.mutable_which(), c);
  request.set_unpin(unpin);
  v1::PinTermsReply reply;
  Session::Call call(session);
  GOBO_TRY(session.statusOf(session.admin().PinTerms(&call.context, request, &reply)));
  if (c.json) {
    std::printf("%s\n", messageToJson(reply, true).c_str());
    return {};
  }
  std::printf("%s %llu terms, %s\n", unpin ? "unpinned" : "pinned", Count(reply.terms()), bytesText(reply.bytes()).c_str());
  if (!unpin && reply.memory_only() > 0) std::printf("%llu of them are in memory alone: they and their pins end with the daemon\n", Count(reply.memory_only()));
  return {};
}

}  // namespace

int runCache(const SessionOptions& options, CacheAct act, const CacheCommand& command) {
  if (options.local && options.cache.empty()) return complain(invalidArgument("cache --local: there is nothing to look at without --cache FOLDER"));
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  Status status;
  switch (act) {
    case CacheAct::List: status = list(**session, command); break;
    case CacheAct::Size: status = size(**session, command); break;
    case CacheAct::Evict: status = evict(**session, command); break;
    case CacheAct::Pin: status = pin(**session, command, false); break;
    case CacheAct::Unpin: status = pin(**session, command, true); break;
  }
  return status.ok() ? kOk : complain(status);
}

}  // namespace gobo::cli
