// SPDX-License-Identifier: Apache-2.0
// Clients of other releases against this server, over a socket. A client of a past release is its recorded schema (messages made from it at
// run time, bytes on the wire) with the render requests that were recorded then; a later one sends fields and enum values that this build does not
// know. RELEASE/render_requests.bin: what a client sent; RELEASE/progressive.bin: what this server's forerunner streamed.
#include <google/protobuf/util/message_differencer.h>
#include <grpcpp/impl/codegen/client_unary_call.h>
#include <grpcpp/support/byte_buffer.h>

#include "protocol/server/harness.h"
#include "request/request.h"
#include "support/every_message.h"
#include "support/releases.h"

namespace gobo::old_client_test {
namespace {

using namespace testing;  // gobo's

using google::protobuf::util::MessageDifferencer;

grpc::ByteBuffer bufferOf(const std::string& bytes) {
  const grpc::Slice slice(bytes);
  return grpc::ByteBuffer(&slice, 1);
}
std::string bytesOf(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  std::string out;
  if (buffer.Valid() && buffer.Dump(&slices).ok())
    for (const grpc::Slice& s : slices) out.append(reinterpret_cast<const char*>(s.begin()), s.size());
  return out;
}

/// Accessors by name, as a program has them that was made from another schema.
const FieldDescriptor& fieldOf(const Message& m, const std::string& name) {
  const FieldDescriptor* f = m.GetDescriptor()->FindFieldByName(name);
  if (!f) throw std::runtime_error(m.GetDescriptor()->full_name() + " has no field " + name);
  return *f;
}
const Message& part(const Message& m, const std::string& name) { return m.GetReflection()->GetMessage(m, &fieldOf(m, name)); }
bool has(const Message& m, const std::string& name) { return m.GetReflection()->HasField(m, &fieldOf(m, name)); }
uint64_t number(const Message& m, const std::string& name) {
  const FieldDescriptor& f = fieldOf(m, name);
  return f.cpp_type() == FieldDescriptor::CPPTYPE_UINT32 ? m.GetReflection()->GetUInt32(m, &f) : m.GetReflection()->GetUInt64(m, &f);
}
std::string text(const Message& m, const std::string& name) { return m.GetReflection()->GetString(m, &fieldOf(m, name)); }

/// Pictures of a stream of render events, checked as a client does.
struct Pictures {
  std::vector<std::string> bytes, digests;
  int replies = 0;
  void take(const Message& event) {
    for (const char* name : {"snapshot", "reply"})
      if (has(event, name)) {
        const Message& reply = part(event, name);
        const FieldDescriptor& images = fieldOf(reply, "images");
        bytes.clear();
        digests.clear();
        for (int i = 0; i < reply.GetReflection()->FieldSize(reply, &images); ++i) {
          digests.push_back(text(reply.GetReflection()->GetRepeatedMessage(reply, &images, i), "digest"));
          bytes.emplace_back();
        }
        replies += name == std::string("reply");
      }
    if (has(event, "chunk")) {
      const Message& chunk = part(event, "chunk");
      const size_t image = size_t(number(chunk, "image"));
      ASSERT_LT(image, bytes.size());
      EXPECT_EQ(number(chunk, "offset"), bytes[image].size());
      bytes[image] += text(chunk, "data");
    }
  }
  void expectWhole() const {
    EXPECT_EQ(replies, 1);
    ASSERT_FALSE(bytes.empty());
    for (size_t i = 0; i < bytes.size(); ++i) EXPECT_EQ(hashBytes(bytes[i].data(), bytes[i].size()).hex(), digests[i]);
  }
};

struct OldClient : ServerTest {
  grpc::Status unary(const char* method, const Message& request, Message& reply) {
    const grpc::internal::RpcMethod rpc(method, grpc::internal::RpcMethod::NORMAL_RPC);
    grpc::ClientContext context;
    bound(context);
    grpc::ByteBuffer answer;
    const grpc::Status status = grpc::internal::BlockingUnaryCall<grpc::ByteBuffer, grpc::ByteBuffer, grpc::ByteBuffer, grpc::ByteBuffer>(
        channel.get(), rpc, &context, bufferOf(request.SerializeAsString()), &answer);
    if (status.ok()) { EXPECT_TRUE(reply.ParseFromString(bytesOf(answer))); }
    return status;
  }
  grpc::Status stream(const char* method, const Message& request, Message& event, const std::function<void(const std::string&)>& each) {
    const grpc::internal::RpcMethod rpc(method, grpc::internal::RpcMethod::SERVER_STREAMING);
    grpc::ClientContext context;
    bound(context);
    const std::unique_ptr<grpc::ClientReader<grpc::ByteBuffer>> reader(
        grpc::internal::ClientReaderFactory<grpc::ByteBuffer>::Create(channel.get(), rpc, &context, bufferOf(request.SerializeAsString())));
    grpc::ByteBuffer answer;
    while (reader->Read(&answer)) {
      const std::string bytes = bytesOf(answer);
      EXPECT_TRUE(event.ParseFromString(bytes));
      each(bytes);
    }
    return reader->Finish();
  }
};

/// The requests of tests/data/replies that need no file.
std::vector<v1::RenderRequest> requestsToRecord() {
  std::vector<v1::RenderRequest> out;
  std::ifstream in("tests/data/replies/requests.txt");
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#' || line.find("SKY") != std::string::npos || line.find("=rich") != std::string::npos ||
        line.find("=animated") != std::string::npos)
      continue;
    std::istringstream words(line);
    std::string name;
    words >> name;
    v1::RenderRequest r;
    for (const char* a : {"scene=cornell", "width=24", "height=16", "halt.spp=4", "encoding.format=RAW_FLOAT"}) EXPECT_TRUE(setPath(r, a).ok());
    for (std::string word; words >> word && word != "relight";) EXPECT_TRUE(setPath(r, word).ok()) << word;
    out.push_back(r);
  }
  return out;
}

/// Fields of `asked` that `got` has otherwise.
void expectAsAsked(const Message& asked, const Message& got, const std::string& path) {
  std::vector<const FieldDescriptor*> fields;
  asked.GetReflection()->ListFields(asked, &fields);
  for (const FieldDescriptor* f : fields) {
    const std::string here = path + "." + f->name();
    if (here == "request.halt.spp") continue;  // the samples that are realised: whole blocks
    if (here == "request.curves") continue;    // their values are in the fields that they name
    if (f->is_map() || f->is_repeated()) {
      EXPECT_EQ(asked.GetReflection()->FieldSize(asked, f), got.GetReflection()->FieldSize(got, f)) << here;
    } else if (f->message_type()) {
      ASSERT_TRUE(got.GetReflection()->HasField(got, f)) << here;
      expectAsAsked(asked.GetReflection()->GetMessage(asked, f), got.GetReflection()->GetMessage(got, f), here);
    } else {
      std::string a, b;
      google::protobuf::TextFormat::PrintFieldValueToString(asked, f, -1, &a);
      google::protobuf::TextFormat::PrintFieldValueToString(got, f, -1, &b);
      EXPECT_EQ(a, b) << here;
    }
  }
}

TEST_F(OldClient, OfEveryReleaseIsServed) {
  if (recording()) {
    std::vector<std::string> bytes, events;
    for (const v1::RenderRequest& r : requestsToRecord()) bytes.push_back(r.SerializeAsString());
    writeAll(releaseFile(thisRelease(), "render_requests.bin"), packed(bytes));
    v1::RenderRequest r = small(32);
    r.set_width(12);
    r.set_height(8);
    v1::RenderEvent event;
    ASSERT_TRUE(stream("/gobo.v1.Render/RenderProgressive", r, event, [&](const std::string& b) { events.push_back(b); }).ok());
    writeAll(releaseFile(thisRelease(), "progressive.bin"), packed(events));
  }
  for (const std::string& release : releases()) {
    Schema then(recordedSchema(release));
    const auto requests = unpacked(readAll(releaseFile(release, "render_requests.bin")));
    EXPECT_GE(requests.size(), 30u);
    size_t rendered = 0;
    for (size_t i = 0; i < requests.size(); ++i) {
      SCOPED_TRACE(release + " request " + std::to_string(i));
      const auto request = then.make("gobo.v1.RenderRequest"), plan = then.make("gobo.v1.PlanReply"), event = then.make("gobo.v1.RenderEvent");
      ASSERT_TRUE(request->ParseFromString(requests[i]));
      const grpc::Status planned = unary("/gobo.v1.Render/Plan", *request, *plan);
      ASSERT_TRUE(planned.ok()) << planned.error_message() << "\n" << textOf(*request);
      expectAsAsked(*request, part(*plan, "resolved"), "request");
      EXPECT_GT(number(*plan, "pinned_bytes"), 0u);
      if (i % 8 != 0) continue;
      Pictures pictures;
      const grpc::Status status = stream("/gobo.v1.Render/RenderProgressive", *request, *event, [&](const std::string&) { pictures.take(*event); });
      ASSERT_TRUE(status.ok()) << status.error_message();
      pictures.expectWhole();
      ++rendered;
    }
    EXPECT_GE(rendered, 4u);
  }
}

TEST_F(OldClient, StreamsOfEveryReleaseAreReadByTheClientOfThisOne) {
  for (const std::string& release : releases()) {
    SCOPED_TRACE(release);
    Pictures pictures;
    int snapshots = 0;
    for (const std::string& bytes : unpacked(readAll(releaseFile(release, "progressive.bin")))) {
      v1::RenderEvent event;
      ASSERT_TRUE(event.ParseFromString(bytes));
      EXPECT_EQ(unknownIn(event), "");
      snapshots += event.has_snapshot();
      pictures.take(event);
      if (event.has_reply()) { EXPECT_EQ(event.reply().resolved().scene(), "cornell"); }
    }
    pictures.expectWhole();
    EXPECT_GE(snapshots, 1);
  }
}

TEST_F(OldClient, FieldsOfALaterOneAreDroppedAtEveryLevel) {
  v1::RenderRequest plain = small(16);
  plain.mutable_environment()->mutable_constant()->set_x(0.2f);
  (*plain.mutable_lights())["bulb"].set_kind(v1::LightEdit::POINT);
  (*plain.mutable_lights())["bulb"].mutable_position()->set_y(1);
  plain.mutable_shadows()->mutable_path_traced();
  v1::RenderRequest more = plain;
  size_t marked = 0;
  eachMessage(more, [&](Message& m) {
    if (m.GetDescriptor()->options().map_entry()) return;
    m.GetReflection()->MutableUnknownFields(&m)->AddLengthDelimited(18000, "of a later release");
    m.GetReflection()->MutableUnknownFields(&m)->AddVarint(18001, 7);
    ++marked;
  });
  EXPECT_GE(marked, 8u);
  const Collected a = renderOnce(plain), b = renderOnce(more);
  ASSERT_TRUE(a.status.ok()) << a.status.error_message();
  ASSERT_TRUE(b.status.ok()) << b.status.error_message();
  EXPECT_EQ(a.reply.request_hash(), b.reply.request_hash());
  EXPECT_EQ(a.images, b.images);
  v1::RenderReply reply = b.reply;
  EXPECT_EQ(unknownIn(reply), "");
}

TEST_F(OldClient, EnumValuesOfALaterOneAreRefusedByName) {
  const std::vector<std::pair<const char*, std::function<void(v1::RenderRequest&)>>> changes = {
      {"request.tone_map.curve = 4000", [](auto& r) { r.mutable_tone_map()->set_curve(v1::ToneMap::Curve(4000)); }},
      {"request.encoding.format = 4000", [](auto& r) { r.mutable_encoding()->set_format(v1::Encoding::Format(4000)); }},
      {"request.integrator.light_selection = 4000", [](auto& r) { r.mutable_integrator()->set_light_selection(v1::Integrator::LightSelection(4000)); }},
      {"request.integrator.sampler = 4000", [](auto& r) { r.mutable_integrator()->set_sampler(v1::Integrator::Sampler(4000)); }},
      {"request.lights.bulb.kind = 4000", [](auto& r) { (*r.mutable_lights())["bulb"].set_kind(v1::LightEdit::Kind(4000)); }},
      {"request.scheduling.priority = 4000", [](auto& r) { r.mutable_scheduling()->set_priority(v1::Scheduling::Class(4000)); }},
  };
  for (const auto& [field, change] : changes) {
    v1::RenderRequest r = small(1);
    change(r);
    const Collected got = renderOnce(r);
    EXPECT_EQ(got.status.error_code(), grpc::INVALID_ARGUMENT) << field << ": " << got.status.error_message();
    EXPECT_NE(got.status.error_message().find(field), std::string::npos) << got.status.error_message();
  }
}

TEST_F(OldClient, AMethodOfALaterOneIsUnimplemented) {
  v1::RenderRequest r = small(1);
  v1::PlanReply reply;
  EXPECT_EQ(unary("/gobo.v1.Render/OfALaterRelease", r, reply).error_code(), grpc::UNIMPLEMENTED);
}

}  // namespace
}  // namespace gobo::old_client_test
