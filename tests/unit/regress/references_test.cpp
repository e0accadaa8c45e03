// SPDX-License-Identifier: Apache-2.0
// Accepted pictures and the record of a run: what is kept comes back, what is damaged is told.
#include "regress/references.h"

#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>

#include "regress/page.h"
#include "regress/record.h"

namespace gobo::cli {
namespace {

namespace fs = std::filesystem;

struct Folder {
  fs::path path = fs::path(::testing::TempDir()) / ("references-" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
  Folder() { fs::remove_all(path); }
  ~Folder() { fs::remove_all(path); }
};

std::vector<Image> parts(float value) {
  std::vector<Image> out(8, Image(5, 3, 3));
  for (size_t k = 0; k < out.size(); ++k)
    for (size_t i = 0; i < out[k].data.size(); ++i) out[k].data[i] = value * float(k + 1) + 1e-7f * float(i);
  return out;
}

RenderFacts facts() {
  RenderFacts f;
  f.output = "beauty", f.width = 5, f.height = 3, f.spp = 4, f.parts = 8, f.seed = 2, f.rays = 99, f.ms = 12.5;
  f.request = "{\"width\":5}", f.sceneHash = "abc", f.build = "1", f.nodes = {"path_trace", "beauty"};
  return f;
}

TEST(References, WhatWasAcceptedComesBackBitByBit) {
  const Folder folder;
  References references(folder.path.string());
  EXPECT_TRUE(references.accepted()->empty());
  const auto first = encodeParts(parts(0.25f)), second = encodeParts(parts(0.5f));
  ASSERT_TRUE(references.accept({"a", "", "Ada", "be\"gin\n", "2026-01-01T00:00:00Z", facts()}, *first).ok());
  ASSERT_TRUE(references.accept({"b", "", "Bo", "too", "2026-01-02T00:00:00Z", facts()}, *first).ok());
  ASSERT_TRUE(references.accept({"a", "", "Cy", "brighter", "2026-01-03T00:00:00Z", facts()}, *second).ok());
  const auto now = references.accepted();
  ASSERT_TRUE(now.ok()) << now.status().toString();
  ASSERT_EQ(now->size(), 2u);
  EXPECT_EQ(now->at("a").by, "Cy");
  EXPECT_EQ(now->at("b").why, "too");
  EXPECT_EQ(now->at("a").facts.nodes, facts().nodes);
  EXPECT_EQ(now->at("a").facts.rays, 99u);
  const auto log = references.log();
  ASSERT_EQ(log->size(), 3u);
  EXPECT_EQ((*log)[0].why, "be\"gin\n");
  EXPECT_EQ((*log)[0].digest, (*log)[1].digest);  // the same bytes are one file
  EXPECT_NE((*log)[0].digest, (*log)[2].digest);
  const auto back = references.parts(now->at("a"));
  ASSERT_TRUE(back.ok()) << back.status().toString();
  ASSERT_EQ(back->size(), 8u);
  for (size_t k = 0; k < 8; ++k) EXPECT_EQ((*back)[k].data, parts(0.5f)[k].data) << k;
  for (const auto& file : fs::recursive_directory_iterator(folder.path))  // nothing temporary stays
    EXPECT_TRUE(file.is_directory() || file.path().extension() == ".exr" || file.path().extension() == ".jsonl" || file.path().filename() == ".lock")
        << file.path();
}

TEST(References, DamageIsTold) {
  const Folder folder;
  References references(folder.path.string());
  ASSERT_TRUE(references.accept({"a", "", "Ada", "why", "2026-01-01T00:00:00Z", facts()}, *encodeParts(parts(1))).ok());
  const Accepted a = references.accepted()->at("a");
  {
    std::fstream file(references.objectPath(a.digest), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(-1, std::ios::end);
    file.put('\x7f');
  }
  EXPECT_EQ(references.parts(a).status().code(), Code::DataLoss);
  // The same picture accepted again mends it.
  ASSERT_TRUE(references.accept({"a", "", "Ada", "mended", "2026-01-02T00:00:00Z", facts()}, *encodeParts(parts(1))).ok());
  EXPECT_TRUE(references.parts(a).ok());
  fs::remove(references.objectPath(a.digest));
  EXPECT_EQ(references.parts(a).status().code(), Code::NotFound);
  std::ofstream(references.logPath(), std::ios::app) << "{\"case\": \"b\"}\n";
  const Status status = references.accepted().status();
  EXPECT_EQ(status.code(), Code::InvalidArgument);
  EXPECT_NE(status.message().find("accepted.jsonl:3: "), std::string::npos) << status.message();
}

TEST(References, ADigestNamesNoOtherFolder) {
  const Folder folder;
  References references(folder.path.string());
  ASSERT_TRUE(references.accept({"a", "", "Ada", "why", "2026-01-01T00:00:00Z", facts()}, *encodeParts(parts(1))).ok());
  std::ifstream in(references.logPath());
  std::string line;
  std::getline(in, line);
  const std::string digest = references.accepted()->at("a").digest;
  line.replace(line.find(digest), 64, "../../../../etc/passwd");
  std::ofstream(references.logPath()) << line << "\n";
  EXPECT_NE(references.accepted().status().message().find("is no SHA-256"), std::string::npos);
  line.replace(line.find("../../../../etc/passwd"), 22, digest.substr(0, 63));
  std::ofstream(references.logPath()) << line << "\n";
  EXPECT_NE(references.accepted().status().message().find("is no SHA-256"), std::string::npos);
}

TEST(References, ALogWithoutItsLastLineFeedIsGoneOn) {  // an editor's, or a merge's
  const Folder folder;
  References references(folder.path.string());
  ASSERT_TRUE(references.accept({"a", "", "Ada", "why", "2026-01-01T00:00:00Z", facts()}, *encodeParts(parts(1))).ok());
  fs::resize_file(references.logPath(), fs::file_size(references.logPath()) - 1);
  ASSERT_TRUE(references.accept({"b", "", "Bo", "why", "2026-01-02T00:00:00Z", facts()}, *encodeParts(parts(2))).ok());
  const auto log = references.log();
  ASSERT_TRUE(log.ok()) << log.status().toString();
  EXPECT_EQ(log->size(), 2u);
}

TEST(Plan, Difference) {
  EXPECT_EQ(planDifference({"a", "b"}, {"b", "c"}), (std::vector<std::string>{"+ c", "- a"}));
  EXPECT_TRUE(planDifference({"a"}, {"a"}).empty());
}

RunRecord run(std::vector<CaseStatus> statuses) {
  RunRecord r{"s<1>", "2026-01-01T00:00:00Z", "1", {}};
  for (const CaseStatus s : statuses) {
    CaseRecord c;
    c.name = "case" + std::to_string(r.cases.size());
    c.status = s;
    c.message = "a & \"b\"";
    c.excess = 7.5;
    c.rmse = 0.125;
    c.plan = {"+ x"};
    c.facts = facts();
    r.cases.push_back(c);
  }
  return r;
}

TEST(Record, JsonAndBack) {
  const RunRecord before = run({CaseStatus::Noise, CaseStatus::Changed, CaseStatus::Failed});
  const auto after = runFromJson(runToJson(before), "f");
  ASSERT_TRUE(after.ok()) << after.status().toString();
  EXPECT_EQ(runToJson(*after), runToJson(before));
  EXPECT_EQ(after->cases[1].status, CaseStatus::Changed);
  EXPECT_EQ(runFromJson("{}", "f.json").status().message().substr(0, 29), "f.json: is no record of a run");
  const auto history = readHistory(historyLine(before) + "broken\n" + historyLine(before));
  ASSERT_EQ(history.size(), 2u);
  EXPECT_EQ(history[1].cases[1].status, "changed");
  EXPECT_EQ(history[1].cases[1].rmse, 0.125);
}

TEST(Record, ExitCodes) {
  EXPECT_EQ(exitCodeOf(run({CaseStatus::Same, CaseStatus::Noise})), 0);
  EXPECT_EQ(exitCodeOf(run({CaseStatus::Missing, CaseStatus::Changed})), 1);
  EXPECT_EQ(exitCodeOf(run({CaseStatus::Slower})), 1);
  EXPECT_EQ(exitCodeOf(run({CaseStatus::Missing, CaseStatus::Same})), 3);
  RunRecord failed = run({CaseStatus::Changed, CaseStatus::Failed});
  failed.cases[1].exitCode = 2;
  EXPECT_EQ(exitCodeOf(failed), 2);
  RunRecord two = run({CaseStatus::Missing, CaseStatus::Failed, CaseStatus::Failed});
  two.cases[1].exitCode = 2, two.cases[2].exitCode = 3;
  EXPECT_EQ(exitCodeOf(two), 2);  // the first of them
  two.cases[1].exitCode = 0;
  EXPECT_EQ(exitCodeOf(two), 1);  // a record of an earlier build, without one: not a pass
}

TEST(Record, JUnit) {
  const std::string xml =
      junitXml(run({CaseStatus::Same, CaseStatus::Noise, CaseStatus::Changed, CaseStatus::Slower, CaseStatus::Missing, CaseStatus::Failed}));
  EXPECT_NE(xml.find("<testsuite name=\"s&lt;1&gt;\" tests=\"6\" failures=\"2\" errors=\"2\""), std::string::npos) << xml;
  EXPECT_NE(xml.find("<failure type=\"changed\" message=\"a &amp; &quot;b&quot;\"/>"), std::string::npos) << xml;
  EXPECT_NE(xml.find("<error type=\"missing\""), std::string::npos);
}

TEST(Page, HoldsItsPicturesAndNothingThatRuns) {
  RunRecord r = run({CaseStatus::Changed, CaseStatus::Missing});
  r.cases[0].why = "<script>alert(1)</script>";
  r.cases[0].referenceDigest = std::string(64, 'a');
  const std::string page =
      reportPage(r, {{"t1", "1", {{"case0", "same", 0, 0, 10, 5}}}, {"t2", "1", {{"case0", "changed", 7, 0.1, 20, 5}}}}, [](const std::string& name) {
        return name == "case0" ? CasePictures{{1, 2, 3}, {4, 5}, {6}} : CasePictures{{}, {4, 5}, {}};
      });
  for (const char* data : {"base64,AQID\"", "base64,BAU=\"", "base64,Bg==\""}) EXPECT_NE(page.find(data), std::string::npos) << data;
  EXPECT_EQ(page.find("<script>alert"), std::string::npos);
  EXPECT_NE(page.find("&lt;script&gt;alert"), std::string::npos);
  EXPECT_NE(page.find("<polyline"), std::string::npos);
  for (const char* outside : {"http://", "https://", " src=\"/", "url("}) EXPECT_EQ(page.find(outside), std::string::npos) << outside;
}

TEST(Page, EvidenceIsRedWhereThereIsSome) {
  Image grey(2, 1, 3);
  for (float& v : grey.data) v = 0.5f;
  const Image out = evidencePicture(grey, {0.0f, 20.0f});
  EXPECT_EQ(out.rgb(0, 0).x, out.rgb(0, 0).y);
  EXPECT_GT(out.rgb(1, 0).x, 0.5f);
  EXPECT_LT(out.rgb(1, 0).z, out.rgb(1, 0).x);
}

}  // namespace
}  // namespace gobo::cli
