// SPDX-License-Identifier: Apache-2.0
// Which terms a TermSelector means, and pages of a list.
#include "server/term_selection.h"

#include <gtest/gtest.h>

namespace gobo::term_selection_test {
namespace {

TEST(TermSelection, StarsStandForLetters) {
  EXPECT_TRUE(matches("direct_transfer", "direct_transfer"));
  EXPECT_TRUE(matches("*transfer*", "direct_transfer"));
  EXPECT_TRUE(matches("*transfer*", "transfer_points"));
  EXPECT_TRUE(matches("d*t_t*r", "direct_transfer"));
  EXPECT_TRUE(matches("*", ""));
  EXPECT_TRUE(matches("", ""));
  EXPECT_FALSE(matches("", "a"));
  EXPECT_FALSE(matches("direct", "direct_transfer"));
  EXPECT_FALSE(matches("transfer*", "direct_transfer"));
  EXPECT_FALSE(matches("*points", "transfer_points_"));
  EXPECT_FALSE(matches("a*b*c", "acb"));
  EXPECT_FALSE(matches(std::string(900, '*') + "b", std::string(100000, 'a'))) << "and in no long time";
}

StoredTerm term(int i, const std::string& type, const std::string& scene) {
  StoredTerm row;
  row.key = Hasher("term selection").add(i).digest();
  row.type = type;
  row.note.scene = scene;
  row.bytes = 10;
  row.diskBytes = i % 2 ? 7 : 0;
  row.pinned = i % 3 == 0;
  return row;
}

TEST(TermSelection, AllThatIsGivenHolds) {
  v1::TermSelector which;
  EXPECT_EQ(filterOf(which, "request.which").status().code(), Code::InvalidArgument);
  which.set_type("di*");
  EXPECT_TRUE((*filterOf(which, ""))(term(1, "direct", "a")));
  EXPECT_FALSE((*filterOf(which, ""))(term(1, "bounced", "a")));
  which.set_scene("b");
  EXPECT_FALSE((*filterOf(which, ""))(term(1, "direct", "a")));
  which.set_scene("a");
  which.add_key(term(2, "", "").key.hex().substr(0, 6));
  EXPECT_FALSE((*filterOf(which, ""))(term(1, "direct", "a")));
  std::string upper = term(1, "", "").key.hex();
  for (char& c : upper) c = char(std::toupper(c));
  which.add_key(upper);
  EXPECT_TRUE((*filterOf(which, ""))(term(1, "direct", "a")));
  for (const std::string& bad : {std::string("12345"), std::string("nothex"), std::string(33, 'a')}) {
    v1::TermSelector wrong;
    wrong.add_key(bad);
    const auto filter = filterOf(wrong, "request.which");
    EXPECT_EQ(filter.status().code(), Code::InvalidArgument);
    EXPECT_NE(filter.status().message().find("request.which.key[0] = '" + bad), std::string::npos) << filter.status().toString();
  }
  v1::TermSelector many;
  for (int i = 0; i < 1001; ++i) many.add_key("abcdef");
  EXPECT_FALSE(filterOf(many, "").ok());
  v1::TermSelector longName;
  longName.set_type(std::string(1001, 'x'));
  EXPECT_FALSE(filterOf(longName, "").ok());
}

TEST(TermSelection, PagesHaveEveryRowOnceAndTotalsOnTheFirst) {
  std::vector<StoredTerm> rows;
  for (int i = 0; i < 25; ++i) rows.push_back(term(i, i % 4 ? "a" : "b", "s"));
  std::sort(rows.begin(), rows.end(), [](const StoredTerm& x, const StoredTerm& y) { return x.key < y.key; });
  v1::ListTermsRequest request;
  request.set_page_size(10);
  std::vector<std::string> seen;
  for (int page = 0; page < 3; ++page) {
    v1::ListTermsReply reply;
    ASSERT_TRUE(listInto(rows, request, true, reply).ok());
    EXPECT_EQ(reply.terms_size(), page == 2 ? 5 : 10);
    for (const v1::TermInfo& t : reply.terms()) seen.push_back(t.key());
    EXPECT_EQ(reply.next_page_token().empty(), page == 2);
    EXPECT_EQ(reply.totals_size(), page == 0 ? 2 : 0);
    if (page == 0) {
      EXPECT_EQ(reply.totals(0).type(), "a");
      EXPECT_EQ(reply.totals(0).terms() + reply.totals(1).terms(), 25u);
      EXPECT_EQ(reply.totals(0).bytes() + reply.totals(1).bytes(), 250u);
      EXPECT_EQ(reply.totals(0).disk_bytes() + reply.totals(1).disk_bytes(), 12u * 7);
      EXPECT_EQ(reply.totals(0).pinned() + reply.totals(1).pinned(), 9u);
    }
    request.set_page_token(reply.next_page_token());
  }
  ASSERT_EQ(seen.size(), 25u);
  for (size_t i = 0; i < rows.size(); ++i) EXPECT_EQ(seen[i], rows[i].key.hex());
  request.clear_page_token();
  v1::ListTermsReply totals;
  ASSERT_TRUE(listInto(rows, request, false, totals).ok());
  EXPECT_EQ(totals.terms_size(), 0);
  EXPECT_EQ(totals.totals_size(), 2);
  EXPECT_TRUE(totals.totals_only());
  EXPECT_TRUE(totals.next_page_token().empty());
  request.set_page_size(1001);
  EXPECT_EQ(listInto(rows, request, true, totals).code(), Code::InvalidArgument);
  request.set_page_size(0);
  request.set_page_token("xyz");
  EXPECT_EQ(listInto(rows, request, true, totals).code(), Code::InvalidArgument);
}

TEST(TermSelection, PagesAreBoundedInBytes) {
  std::vector<StoredTerm> rows;
  for (int i = 0; i < 200; ++i) {
    rows.push_back(term(i, "a", "s"));
    rows.back().note.label = std::string(20000, 'x');
  }
  std::sort(rows.begin(), rows.end(), [](const StoredTerm& x, const StoredTerm& y) { return x.key < y.key; });
  v1::ListTermsReply reply;
  ASSERT_TRUE(listInto(rows, {}, true, reply).ok());
  EXPECT_LT(reply.ByteSizeLong(), 600u << 10);
  EXPECT_FALSE(reply.next_page_token().empty());
}

}  // namespace
}  // namespace gobo::term_selection_test
