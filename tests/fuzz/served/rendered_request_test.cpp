// SPDX-License-Identifier: Apache-2.0
// Requests made out of bytes are rendered (fuzz/served/rendered_request.h): a fixed stream of inputs, and that they reach what they are for.
#include <gtest/gtest.h>

#include <chrono>
#include <set>
#include <sstream>

#include "base/sobol.h"
#include "fuzz/served/message_edits.h"
#include "fuzz/served/rendered_request.h"
#include "fuzz/served/tiny_request.h"

namespace gobo::fuzz::rendered_request_test {
namespace {

constexpr uint64_t kInputs = 250;

std::vector<uint8_t> input(uint64_t k) {
  uint64_t state = k;
  std::vector<uint8_t> out(2 + kEditBytes * (k % 12));
  for (uint8_t& b : out) b = uint8_t((state = hash64(state, 0x66757a7a)) >> 40);
  out[1] = uint8_t(k % 12);
  return out;
}

TEST(RenderedRequest, FiniteTheSameAgainOrAFieldsName) {
  std::set<std::string> nodes, refusals;
  uint64_t pictures = 0;
  const auto begun = std::chrono::steady_clock::now();
  for (uint64_t k = 0; k < kInputs; ++k) {
    const Outcome out = tryRenderedRequest(input(k));
    EXPECT_EQ(out.broken, "") << "input " << k;
    pictures += out.accepted;
    std::istringstream lines(out.said);
    for (std::string line; std::getline(lines, line);) (out.accepted ? nodes : refusals).insert(line);
  }
  std::printf("%llu inputs in %.1f s: %llu with pictures of %zu kinds of node, %zu refusals\n", (unsigned long long)kInputs,
              std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count(), (unsigned long long)pictures, nodes.size(), refusals.size());
  EXPECT_GT(pictures, kInputs / 3);
  EXPECT_GT(refusals.size(), 10u);
  EXPECT_GT(nodes.size(), 30u);
}

/// Fields of the message and of all that it may hold.
size_t countFields(const google::protobuf::Descriptor& d, std::set<const google::protobuf::Descriptor*>& seen) {
  if (!seen.insert(&d).second) return 0;
  size_t n = 0;
  for (int i = 0; i < d.field_count(); ++i) n += 1 + (d.field(i)->message_type() ? countFields(*d.field(i)->message_type(), seen) : 0);
  return n;
}
void collectFields(const google::protobuf::Message& m, std::set<const google::protobuf::FieldDescriptor*>& out) {
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  const auto& r = *m.GetReflection();
  r.ListFields(m, &fields);
  for (const auto* f : fields) {
    out.insert(f);
    if (f->cpp_type() != google::protobuf::FieldDescriptor::CPPTYPE_MESSAGE) continue;
    for (int k = 0; k < (f->is_repeated() ? r.FieldSize(m, f) : 1); ++k)
      collectFields(f->is_repeated() ? r.GetRepeatedMessage(m, f, k) : r.GetMessage(m, f), out);
  }
}

TEST(RenderedRequest, EditsReachEveryFieldOfTheSchema) {
  std::set<const google::protobuf::FieldDescriptor*> reached;
  const Texts texts = [](const google::protobuf::FieldDescriptor& field, uint32_t value) { return requestText(field.name(), value, nullptr); };
  uint64_t state = 1;
  for (int k = 0; k < 9000; ++k) {
    v1::RenderRequest request;
    std::vector<uint8_t> edits(20 * kEditBytes);
    for (uint8_t& b : edits) b = uint8_t((state = hash64(state, 7)) >> 40);
    editMessage(request, edits, texts);
    collectFields(request, reached);
  }
  std::set<const google::protobuf::Descriptor*> seen;
  EXPECT_EQ(reached.size(), countFields(*v1::RenderRequest::descriptor(), seen));
  EXPECT_GT(reached.size(), 150u);
}

// Whatever is asked for costs milliseconds: every count that has a range is bounded, where it is set, where its default is too large, and in a light's own
// shadow.
TEST(RenderedRequest, CountsAreBounded) {
  v1::RenderRequest r;
  r.mutable_shadows()->mutable_ray_traced()->set_samples(4096);
  (*r.mutable_lights())["a"].mutable_shadow()->mutable_convolution()->set_order(3);
  r.mutable_halt()->set_error(0.1);
  r.set_height(0);  // the schema refuses it: stays
  makeTiny(r);
  EXPECT_EQ(r.width(), 16u);
  EXPECT_EQ(r.height(), 0u);
  EXPECT_EQ(r.halt().spp(), 4u);
  EXPECT_EQ(r.shadows().ray_traced().samples(), 16u);
  EXPECT_EQ(r.lights().at("a").shadow().map().resolution(), 32u);
  EXPECT_EQ(r.lights().at("a").shadow().convolution().order(), 3u);
  EXPECT_EQ(r.certificate().min_pixels(), 64u);
}

}  // namespace
}  // namespace gobo::fuzz::rendered_request_test
