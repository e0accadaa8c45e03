// SPDX-License-Identifier: Apache-2.0
// The same bits as before: requests over all of the schema (tests/data/replies/requests.txt), each with what it gave when it was recorded
// (recorded.txt). Pictures that differ under unchanged keys mean that a cache would serve the old ones: whatever node changed needs a new
// version(). Pictures that differ under other keys are a decision: record them, and say why in docs/changed_pictures.md.
//
//   GOBO_RECORD=1 test_render_replies    writes recorded.txt; refuses pictures that changed under the keys that they had
//
// Bits depend on the processor (support/arithmetic.h); where they were recorded on another kind, means are compared.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <map>
#include <set>
#include <sstream>

#include "base/image_io.h"
#include "filters/shadow_technique.h"
#include "fuzz/properties.h"
#include "plan/outputs.h"
#include "support/animated_scene.h"
#include "support/arithmetic.h"
#include "support/engines.h"

namespace gobo::testing {
namespace {

namespace fs = std::filesystem;
const char* const kRequests = "tests/data/replies/requests.txt";  // tests run in the project's folder
const char* const kRecorded = "tests/data/replies/recorded.txt";

/// A line: its name, then assignments to a small request, then perhaps "relight" and those of a relight of it.
struct Case {
  std::string name;
  std::vector<std::string> render, relight;
};

std::vector<Case> readCases() {
  std::vector<Case> cases;
  std::ifstream in(kRequests);
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    Case c;
    if (!(words >> c.name) || c.name[0] == '#') continue;
    bool relight = false;
    for (std::string word; words >> word;) {
      if (word == "relight") relight = true;
      else (relight ? c.relight : c.render).push_back(word);
    }
    cases.push_back(std::move(c));
  }
  return cases;
}

struct Picture {
  std::string digest;
  double mean = 0;
};
struct Recorded {
  std::string keys;
  std::map<std::string, Picture> pictures;
};  ///< keys: of all the plan's nodes

Picture picture(const Image& image) {
  Hasher h("picture");
  h.add(image.width).add(image.height).add(image.channels).addArray(image.data);
  double sum = 0;
  size_t finite = 0;
  for (const float v : image.data)
    if (std::isfinite(v)) {
      sum += double(v);
      ++finite;
    }
  return {h.digest().hex(), finite ? sum / double(finite) : 0.0};
}

struct Replies : ::testing::Test {
  std::string folder, animated;
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "gobo-replies-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    folder = pattern;
    animated = writeAnimatedScene("replies");
    std::ofstream(folder + "/rich.gltf", std::ios::binary) << fuzz::richGltf();
    Image sky(32, 16, 3);
    for (size_t i = 0; i < sky.data.size(); ++i) sky.data[i] = i / 3 == 75 ? 400.0f : 0.1f + float(i * 7919 % 251) / 250.0f;  // one bright spot
    const auto bytes = *encodeExr(sky);
    std::ofstream(folder + "/sky.exr", std::ios::binary).write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
  }
  void TearDown() override {
    fs::remove_all(folder);
    fs::remove_all(fs::path(animated).parent_path());
  }

  v1::RenderRequest request(const Case& c) const {
    v1::RenderRequest r = smallRequest("cornell");
    for (std::string a : c.render) {
      if (const size_t at = a.find("SKY"); at != std::string::npos) a.replace(at, 3, folder + "/sky.exr");
      set(r, a);
    }
    return r;
  }
  std::unique_ptr<Engine> engine() const {
    auto e = makeEngine();
    EXPECT_TRUE(e->openScene(folder + "/rich.gltf", "rich").ok());
    EXPECT_TRUE(e->openScene(animated, "animated").ok());
    return e;
  }
};

Recorded record(Engine& engine, const Case& c, const v1::RenderRequest& request) {
  RenderResult result = mustRender(engine, request);
  if (!c.relight.empty()) {
    v1::RelightRequest relight;
    relight.set_render_id(result.reply.render_id());
    for (const std::string& a : c.relight) {
      set(*relight.mutable_patch(), a);
      relight.add_mask(a.substr(0, a.find('=')));
    }
    const auto means = engine.relightRequest(relight);
    EXPECT_TRUE(means.ok()) << means.status().toString();
    if (means.ok()) result = mustRender(engine, *means);
  }
  Recorded out;
  std::set<std::string> keys;
  for (const v1::NodeReport& n : result.reply.plan())
    if (!n.key().empty()) keys.insert(n.node() + " " + n.key());
  Hasher h("keys");
  for (const std::string& k : keys) h.add(k);
  out.keys = h.digest().hex();
  for (const RenderedImage& i : result.images) {
    out.pictures[i.output] = picture(i.image());
    if (i.output == "beauty") out.pictures["display"] = picture(toneMapped(i.image(), result.reply.resolved().tone_map()));
  }
  if (result.reply.has_certificate()) {
    const v1::Certificate& s = result.reply.certificate();
    Image numbers(4, 1, 1);
    numbers.data = {float(s.rmse()), float(s.rmse_low()), float(s.rmse_high()), float(s.pixels())};
    out.pictures["certificate"] = picture(numbers);
  }
  return out;
}

struct Record {
  std::string arithmetic;
  std::map<std::string, Recorded> cases;
};

Record readRecord() {
  Record out;
  std::ifstream in(kRecorded);
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::string name, keys, output;
    Picture p;
    if (!(words >> name) || name[0] == '#') continue;
    if (name == "arithmetic") {
      words >> out.arithmetic;
      continue;
    }
    words >> keys;
    Recorded& r = out.cases[name];
    r.keys = keys;
    while (words >> output >> p.digest >> p.mean) r.pictures[output] = p;
  }
  return out;
}

void write(const Record& record) {
  std::ofstream out(kRecorded);
  out << "# What the requests beside this file gave: name, digest of the plan's keys; each output with its digest and its mean. Made by tests/render/replies.\n"
      << "arithmetic " << record.arithmetic << "\n";
  for (const auto& [name, r] : record.cases) {
    out << name << " " << r.keys;
    for (const auto& [output, p] : r.pictures) out << " " << output << " " << p.digest << " " << std::setprecision(6) << p.mean;
    out << "\n";
  }
}

TEST_F(Replies, AreWhatTheyWere) {
  const bool recording = std::getenv("GOBO_RECORD") != nullptr;
  ASSERT_GT(readCases().size(), 50u) << kRequests << " is not here: tests run in the project's folder";
  const Record before = readRecord();
  Record now{arithmeticOfThisMachine().hex(), {}};
  const bool comparable = before.arithmetic == now.arithmetic;
  const auto e = engine();
  size_t pictures = 0, moved = 0, rekeyed = 0;
  for (const Case& c : readCases()) {
    SCOPED_TRACE(c.name);
    ASSERT_FALSE(now.cases.count(c.name)) << "two requests of this name";
    const Recorded r = record(*e, c, request(c));
    now.cases[c.name] = r;
    const auto was = before.cases.find(c.name);
    if (was == before.cases.end()) {
      EXPECT_TRUE(recording) << "was never recorded: GOBO_RECORD=1";
      continue;
    }
    const bool sameKeys = was->second.keys == r.keys;
    rekeyed += !sameKeys;
    for (const auto& [output, p] : r.pictures) {
      const auto old = was->second.pictures.find(output);
      if (old == was->second.pictures.end()) {
        EXPECT_TRUE(recording) << output << " was never recorded";
        continue;
      }
      ++pictures;
      // Other arithmetic moves single samples; these pictures have some thousands.
      EXPECT_TRUE(recording || std::abs(p.mean - old->second.mean) <= 0.02 * std::abs(old->second.mean) + 1e-5)
          << output << ": mean " << p.mean << ", recorded " << old->second.mean;
      if (!comparable || p.digest == old->second.digest) continue;
      ++moved;
      EXPECT_FALSE(sameKeys) << output
                             << " changed under the keys that it had: a store would go on serving the old one. Which node changed? Raise its version().";
      EXPECT_TRUE(recording || sameKeys) << output << " changed, with its keys: record it and say why in docs/changed_pictures.md";
    }
  }
  for (const auto& [name, r] : before.cases) EXPECT_TRUE(recording || now.cases.count(name)) << name << " is no longer asked";
  std::cout << now.cases.size() << " requests, " << pictures << " pictures, " << moved << " changed, " << rekeyed << " requests with other keys"
            << (comparable ? "" : "; recorded on other arithmetic: means were compared, not bits") << "\n";
  if (recording && !HasFailure()) write(now);
}

uint64_t heldBy(Engine& engine, const std::string& name) {
  v1::StatusReply status;
  engine.fillStatus(status);
  for (const v1::MemoryHolder& h : status.memory())
    if (h.name() == name) return h.bytes();
  ADD_FAILURE() << "no holder '" << name << "'";
  return 0;
}

TEST_F(Replies, ArePreparedWithoutWorkAndHoldNoMoreThanThatSaid) {
  const auto e = engine();
  double most = 0, sum = 0;
  for (const Case& c : readCases()) {
    SCOPED_TRACE(c.name);
    e->dropCaches(true);
    const v1::RenderRequest r = request(c);
    const uint64_t rays = heldBy(*e, "ray tracing");
    const auto prepared = e->prepare(r);
    ASSERT_TRUE(prepared.ok()) << prepared.status().toString();
    EXPECT_EQ(heldBy(*e, "terms"), 0u) << "a node ran before anybody was admitted";
    EXPECT_EQ(heldBy(*e, "ray tracing"), rays) << "something was made to trace rays in before anybody was admitted";
    const auto result = e->run(*prepared);
    ASSERT_TRUE(result.ok()) << result.status().toString();
    EXPECT_LE(result->reply.peak_bytes(), prepared->pinnedBytes);
    const double used = double(result->reply.peak_bytes()) / double(std::max<uint64_t>(1, prepared->pinnedBytes));
    most = std::max(most, used);
    sum += used;
    const auto again = e->run(*prepared);  // warm
    ASSERT_TRUE(again.ok()) << again.status().toString();
    EXPECT_LE(again->reply.peak_bytes(), prepared->pinnedBytes);
    EXPECT_EQ(firstDifference(*result, *again), "");
  }
  std::cout << "held at most, as a share of what was admitted: mean " << sum / double(readCases().size()) << ", largest " << most << "\n";
}

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

void collect(const Message& m, std::set<std::string>& seen) {
  std::vector<const FieldDescriptor*> set;
  m.GetReflection()->ListFields(m, &set);
  for (const FieldDescriptor* f : set) {
    seen.insert(f->full_name());
    if (f->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) continue;
    if (!f->is_repeated()) collect(m.GetReflection()->GetMessage(m, f), seen);
    else
      for (int i = 0; i < m.GetReflection()->FieldSize(m, f); ++i) collect(m.GetReflection()->GetRepeatedMessage(m, f, i), seen);
  }
}

/// Of everything that a request may hold, but the settings of techniques: each of those is changed alone by TechniqueFields.
void expectSeen(const google::protobuf::Descriptor& type, const std::set<std::string>& seen, std::set<std::string>& done) {
  if (!done.insert(type.full_name()).second) return;
  for (int i = 0; i < type.field_count(); ++i) {
    const FieldDescriptor* f = type.field(i);
    // Nothing that a picture's bits depend on, or the clock; or of a file that a client put, which has the bits of the same file by its path (Blobs.*).
    static const std::set<std::string> left = {"gobo.v1.RenderRequest.encoding", "gobo.v1.RenderRequest.scheduling", "gobo.v1.RenderRequest.scene_hash",
                                               "gobo.v1.EnvironmentSettings.digest", "gobo.v1.Halt.time_s"};
    if (left.count(f->full_name())) continue;
    EXPECT_TRUE(seen.count(f->full_name())) << f->full_name() << " is set by no recorded request (" << kRequests << ")";
    if (f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE && (f->message_type()->name() == "ShadowTechnique" || type.name() != "ShadowTechnique"))
      expectSeen(*f->message_type(), seen, done);
  }
}

TEST_F(Replies, CoverEveryFieldTechniqueAndOutput) {
  std::set<std::string> seen, outputs, done;
  const auto cases = readCases();
  for (const Case& c : cases) {
    v1::RenderRequest r = request(c);
    for (const std::string& o : r.outputs()) outputs.insert(o.substr(0, o.find(':')));
    collect(r, seen);
    v1::RenderRequest patch;
    for (const std::string& a : c.relight) set(patch, a);
    collect(patch, seen);
  }
  EXPECT_GE(cases.size(), 60u);
  for (const OutputInfo& o : outputTable()) EXPECT_TRUE(outputs.count(o.name)) << "no recorded request asks for " << o.name;
  expectSeen(*v1::RenderRequest::descriptor(), seen, done);
}

}  // namespace
}  // namespace gobo::testing
