// SPDX-License-Identifier: Apache-2.0
// Clients made out of bytes on a whole daemon (fuzz/served/sequence.h): a fixed stream of inputs, one in which every method of the schema is answered with OK,
// and that the codes are those of docs/protocol.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "base/sobol.h"
#include "fuzz/served/generic_call.h"
#include "fuzz/served/sequence.h"

namespace gobo::fuzz::sequence_test {
namespace {

constexpr uint8_t kAlice = 0, kBob = 3, kRoot = 6, kBeside = 0x20;
constexpr uint8_t kItsOwn = 0x20;    // `how`: texts of the caller's own scene, its last job, its last picture
constexpr uint8_t kCompared = 0xa0;  // the same, and the picture against a fresh engine's

std::vector<uint8_t> input(uint64_t k) {
  uint64_t state = k;
  std::vector<uint8_t> out(60 + 20 * (k % 12));
  for (uint8_t& b : out) b = uint8_t((state = hash64(state, 0x73657121)) >> 40);
  return out;
}

/// Four bytes of a call by the method's name.
void add(std::vector<uint8_t>& out, uint8_t who, const std::string& method, uint8_t how = kItsOwn) {
  const auto& all = everyMethod();
  const auto at = std::find_if(all.begin(), all.end(), [&](const auto* m) { return m->service()->name() + "." + m->name() == method; });
  ASSERT_NE(at, all.end()) << method;
  out.insert(out.end(), {who, uint8_t(at - all.begin()), how, 0});
}

/// Codes by service and method.
using Answers = std::map<std::string, std::set<int>>;
void addAnswers(const Outcome& out, Answers& answers) {
  std::istringstream lines(out.said);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string method;
    int code = -1;
    words >> method >> code;
    answers[method].insert(code);
  }
}

TEST(Sequence, AnyOrderOfAnyCalls) {
  constexpr uint64_t kInputs = 30;
  Answers answers;
  const auto begun = std::chrono::steady_clock::now();
  for (uint64_t k = 0; k < kInputs; ++k) {
    const Outcome out = trySequence(input(k));
    EXPECT_EQ(out.broken, "") << "input " << k;
    addAnswers(out, answers);
  }
  std::printf("%llu inputs in %.1f s\n", (unsigned long long)kInputs, std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count());
  for (const auto* method : everyMethod())
    EXPECT_FALSE(answers[method->service()->name() + "." + method->name()].empty()) << method->full_name() << " was never called";
}

// A method that the schema gains is called by the streams above; here it must be put where it can succeed.
TEST(Sequence, EveryMethodCanSucceed) {
  std::vector<uint8_t> bytes;
  for (const char* method : {"Scenes.Open", "Scenes.Upload", "Scenes.Inspect", "Scenes.Patch", "Scenes.List", "Blobs.Put", "Blobs.Missing"})
    add(bytes, kAlice, method);
  for (const char* method : {"Render.Render", "Render.RenderProgressive", "Render.RenderInline", "Render.Relight", "Render.Plan"})
    add(bytes, kAlice, method, kCompared);
  for (const char* method : {"Jobs.Submit", "Jobs.Get", "Jobs.List", "Jobs.Pause", "Jobs.Resume", "Jobs.Prioritize", "Jobs.Depend", "Jobs.Log", "Jobs.Cancel",
                             "Jobs.Retry", "Jobs.Cancel", "Jobs.Watch", "Jobs.Fetch", "Jobs.Delete"})
    add(bytes, kAlice, method);
  for (const char* method : {"Scenes.Unload"}) add(bytes, kAlice, method);
  for (const char* method : {"Admin.ListTerms", "Admin.PinTerms", "Admin.DropCaches", "Admin.GetStatus", "Admin.Shutdown"}) add(bytes, kRoot, method);
  const Outcome out = trySequence(bytes);
  EXPECT_EQ(out.broken, "");
  Answers answers;
  addAnswers(out, answers);
  for (const auto* method : everyMethod())
    EXPECT_EQ(answers[method->service()->name() + "." + method->name()], std::set<int>{0}) << method->full_name() << "\n" << out.said;
}

TEST(Sequence, WhatIsAnothersIsNotThere) {
  std::vector<uint8_t> bytes;
  add(bytes, kAlice, "Scenes.Open");
  add(bytes, kAlice, "Render.Render");
  add(bytes, kAlice, "Jobs.Submit");
  for (const char* method : {"Render.Relight", "Jobs.Get", "Jobs.Depend", "Jobs.Log", "Jobs.Watch", "Jobs.Fetch"}) add(bytes, kBob, method);
  add(bytes, kBob, "Scenes.Inspect", 0x50);  // a scene of alice's, by its name
  for (int i = 0; i < 4; ++i) add(bytes, uint8_t((i % 2 ? kBob : kAlice) | kBeside), "Render.RenderProgressive", 0x10);
  const Outcome out = trySequence(bytes);
  EXPECT_EQ(out.broken, "");
  Answers answers;
  addAnswers(out, answers);
  for (const char* method : {"Render.Relight", "Jobs.Get", "Jobs.Depend", "Jobs.Log", "Jobs.Watch", "Jobs.Fetch", "Scenes.Inspect"})
    EXPECT_EQ(answers[method], std::set<int>{grpc::NOT_FOUND}) << method << "\n" << out.said;
  EXPECT_EQ(answers["Render.RenderProgressive"], std::set<int>{0});
}

TEST(Sequence, CodesAreThoseOfTheProtocol) {
  std::ifstream in("docs/protocol.md");
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  const size_t from = text.find("## Errors"), to = text.find("\n## ", from + 1);
  ASSERT_NE(to, std::string::npos);
  const std::string errors = text.substr(from, to - from);
  const std::map<grpc::StatusCode, const char*> names{{grpc::INVALID_ARGUMENT, "INVALID_ARGUMENT"},
                                                      {grpc::OUT_OF_RANGE, "OUT_OF_RANGE"},
                                                      {grpc::UNAUTHENTICATED, "UNAUTHENTICATED"},
                                                      {grpc::PERMISSION_DENIED, "PERMISSION_DENIED"},
                                                      {grpc::FAILED_PRECONDITION, "FAILED_PRECONDITION"},
                                                      {grpc::NOT_FOUND, "NOT_FOUND"},
                                                      {grpc::ALREADY_EXISTS, "ALREADY_EXISTS"},
                                                      {grpc::UNIMPLEMENTED, "UNIMPLEMENTED"},
                                                      {grpc::UNAVAILABLE, "UNAVAILABLE"},
                                                      {grpc::CANCELLED, "CANCELLED"},
                                                      {grpc::DEADLINE_EXCEEDED, "DEADLINE_EXCEEDED"},
                                                      {grpc::RESOURCE_EXHAUSTED, "RESOURCE_EXHAUSTED"}};
  EXPECT_EQ(documentedCodes().size(), names.size() + 1);
  for (const grpc::StatusCode code : documentedCodes()) {
    if (code == grpc::OK) continue;
    ASSERT_TRUE(names.count(code)) << int(code);
    EXPECT_NE(errors.find("`" + std::string(names.at(code)) + "`"), std::string::npos) << names.at(code) << " is not in docs/protocol.md, \"Errors\"";
  }
}

}  // namespace
}  // namespace gobo::fuzz::sequence_test
