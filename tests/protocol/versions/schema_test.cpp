// SPDX-License-Identifier: Apache-2.0
// Today's schema against that of every release, by the rules of support/wire_rules.h; and the rules themselves against schemas with one
// break each, since a rule that finds nothing would pass for ever.
//
//   GOBO_RECORD=1 test_protocol_versions    records this release (docs/versions.md)
#include <functional>

#include "support/every_message.h"
#include "support/releases.h"
#include "support/wire_rules.h"

namespace gobo::schema_test {
namespace {

using namespace testing;  // gobo's

using namespace google::protobuf;

std::string listed() { return readAll("docs/changed_pictures.md"); }

/// Before all tests, since those that record more go through the schemas of all releases.
struct RecordSchema : ::testing::Environment {
  void SetUp() override {
    if (!recording()) return;
    const FileDescriptorSet today = schemaOfToday();
    // A recording of this version may be replaced by one that has more; what would break it needs another version.
    if (std::filesystem::exists(releaseFile(thisRelease(), "schema.bin")))
      for (const std::string& b : wireBreaks(recordedSchema(thisRelease()), today, listed())) FAIL() << thisRelease() << " was recorded, and " << b;
    writeAll(releaseFile(thisRelease(), "schema.bin"), today.SerializeAsString());
  }
};
const ::testing::Environment* const recorder = ::testing::AddGlobalTestEnvironment(new RecordSchema);

TEST(Schema, IsUnderstoodByEveryRelease) {
  ASSERT_NE(recorder, nullptr);
  const FileDescriptorSet today = schemaOfToday();
  for (const std::string& release : releases())
    for (const std::string& b : wireBreaks(recordedSchema(release), today, listed())) ADD_FAILURE() << "release " << release << ": " << b;
}

TEST(Schema, OfThisReleaseIsRecorded) {
  const auto all = releases();
  EXPECT_NE(std::find(all.begin(), all.end(), thisRelease()), all.end()) << "record release " << thisRelease() << " (docs/versions.md)";
}

DescriptorProto& message(FileDescriptorSet& set, const std::string& name) {
  for (auto& f : *set.mutable_file())
    for (auto& m : *f.mutable_message_type())
      if (m.name() == name) return m;
  throw std::runtime_error("no message " + name);
}
FieldDescriptorProto& field(DescriptorProto& m, const std::string& name) {
  for (auto& f : *m.mutable_field())
    if (f.name() == name) return f;
  throw std::runtime_error("no field " + name);
}
void removeField(DescriptorProto& m, const std::string& name) {
  for (int i = 0; i < m.field_size(); ++i)
    if (m.field(i).name() == name) {
      m.mutable_field()->DeleteSubrange(i, 1);
      return;
    }
}
void reserve(DescriptorProto& m, int number, const std::string& name) {
  auto* range = m.add_reserved_range();
  range->set_start(number);
  range->set_end(number + 1);
  if (!name.empty()) m.add_reserved_name(name);
}
EnumDescriptorProto& kinds(FileDescriptorSet& set) { return *message(set, "LightEdit").mutable_enum_type(0); }
ServiceDescriptorProto& service(FileDescriptorSet& set, const std::string& name) {
  for (auto& f : *set.mutable_file())
    for (auto& s : *f.mutable_service())
      if (s.name() == name) return s;
  throw std::runtime_error("no service " + name);
}
MethodDescriptorProto& method(FileDescriptorSet& set, const std::string& name) {
  for (auto& m : *service(set, "Render").mutable_method())
    if (m.name() == name) return m;
  throw std::runtime_error("no method " + name);
}
v1::Number& number(FileDescriptorSet& set, const std::string& m, const std::string& f) {
  return *field(message(set, m), f).mutable_options()->MutableExtension(v1::number);
}

TEST(WireRules, EachBreakIsFoundAndNamed) {
  struct Change {
    const char* finds;
    std::function<void(FileDescriptorSet&)> apply;
  };
  const std::vector<Change> changes = {
      {"gobo.v1.Halt.spp: was ", [](auto& s) { field(message(s, "Halt"), "spp").set_type(FieldDescriptorProto::TYPE_SINT32); }},
      {"gobo.v1.Halt.spp: was ", [](auto& s) { field(message(s, "Halt"), "spp").set_label(FieldDescriptorProto::LABEL_REPEATED); }},
      {"gobo.v1.LightEdit.color: was ", [](auto& s) { field(message(s, "LightEdit"), "color").set_type_name(".gobo.v1.ToneMap"); }},
      {"gobo.v1.Halt.spp: number 1 is now called samples", [](auto& s) { field(message(s, "Halt"), "spp").set_name("samples"); }},
      {"gobo.v1.Halt.spp: number was 1 and is 11", [](auto& s) { field(message(s, "Halt"), "spp").set_number(11); }},
      {"gobo.v1.Halt.error: was removed", [](auto& s) { removeField(message(s, "Halt"), "error"); }},
      {"gobo.v1.Halt.error: was removed",
       [](auto& s) {
         removeField(message(s, "Halt"), "error");
         reserve(message(s, "Halt"), 3, "");
       }},
      {"gobo.v1.RenderEvent.chunk: oneof was 'event' and is ''", [](auto& s) { field(message(s, "RenderEvent"), "chunk").clear_oneof_index(); }},
      {"gobo.v1.Halt: the message is gone", [](auto& s) { message(s, "Halt").set_name("Until"); }},
      {"gobo.v1.LightEdit.Kind: the enum is gone", [](auto& s) { kinds(s).set_name("Sort"); }},
      {"gobo.v1.LightEdit.Kind.SPHERE: was removed", [](auto& s) { kinds(s).mutable_value()->RemoveLast(); }},
      {"gobo.v1.LightEdit.Kind.SPHERE: was removed, or renumbered", [](auto& s) { kinds(s).mutable_value()->rbegin()->set_number(60); }},
      {"gobo.v1.LightEdit.Kind.SPHERE: number 6 is now called BALL", [](auto& s) { kinds(s).mutable_value()->rbegin()->set_name("BALL"); }},
      {"gobo.v1.Render: the service is gone", [](auto& s) { service(s, "Render").set_name("Draw"); }},
      {"gobo.v1.Render.Plan: the method is gone", [](auto& s) { method(s, "Plan").set_name("Sketch"); }},
      {"gobo.v1.Render.Plan: takes or returns", [](auto& s) { method(s, "Plan").set_input_type(".gobo.v1.RelightRequest"); }},
      {"gobo.v1.Render.Plan: takes or returns", [](auto& s) { method(s, "Plan").set_output_type(".gobo.v1.InlineReply"); }},
      {"gobo.v1.Render.Plan: takes or returns", [](auto& s) { method(s, "Plan").set_server_streaming(true); }},
      {"gobo.v1.Render.Plan: takes or returns", [](auto& s) { method(s, "Plan").set_client_streaming(true); }},
      {"gobo.v1.RenderRequest.width: default was 640", [](auto& s) { number(s, "RenderRequest", "width").set_default_(641); }},
      {"gobo.v1.RenderRequest.width: default was 640", [](auto& s) { number(s, "RenderRequest", "width").clear_default_(); }},
      {"gobo.v1.RenderRequest.width: smallest value was 1", [](auto& s) { number(s, "RenderRequest", "width").set_min(2); }},
      {"gobo.v1.RenderRequest.width: smallest value was 1", [](auto& s) { number(s, "RenderRequest", "width").set_exclusive_min(true); }},
      {"gobo.v1.RenderRequest.width: largest value was 16384", [](auto& s) { number(s, "RenderRequest", "width").set_max(16383); }},
      {"gobo.v1.ToneMap.curve: default was 'FILMIC'",
       [](auto& s) { field(message(s, "ToneMap"), "curve").mutable_options()->SetExtension(v1::text_default, "ACES"); }},
      {"gobo.v1.Integrator.indirect: default was true",
       [](auto& s) { field(message(s, "Integrator"), "indirect").mutable_options()->SetExtension(v1::bool_default, false); }},
      {"gobo.v1.RenderRequest.seed: not_in_hash",
       [](auto& s) { field(message(s, "RenderRequest"), "seed").mutable_options()->SetExtension(v1::not_in_hash, true); }},
      {"gobo.v1.unit: the option is gone",
       [](auto& s) {
         for (auto& f : *s.mutable_file())
           for (auto& x : *f.mutable_extension())
             if (x.name() == "unit") x.set_number(50099);
       }},
  };
  const FileDescriptorSet today = schemaOfToday();
  for (const Change& c : changes) {
    FileDescriptorSet other = today;
    c.apply(other);
    const auto breaks = wireBreaks(today, other, "");
    ASSERT_EQ(breaks.size(), 1u) << c.finds << (breaks.empty() ? "" : breaks[0]);
    EXPECT_EQ(breaks[0].rfind(c.finds, 0), 0u) << breaks[0];
  }
}

TEST(WireRules, WhatBreaksNothingIsLeftAlone) {
  const FileDescriptorSet today = schemaOfToday();
  EXPECT_TRUE(wireBreaks(today, today, "").empty());
  FileDescriptorSet other = today;
  removeField(message(other, "Halt"), "error");
  reserve(message(other, "Halt"), 3, "error");
  auto* added = message(other, "Halt").add_field();
  added->set_name("later");
  added->set_number(40);
  added->set_type(FieldDescriptorProto::TYPE_STRING);
  added->set_label(FieldDescriptorProto::LABEL_OPTIONAL);
  auto* value = kinds(other).add_value();
  value->set_name("TUBE");
  value->set_number(7);
  *service(other, "Render").add_method() = method(other, "Plan");
  service(other, "Render").mutable_method()->rbegin()->set_name("Sketch");
  number(other, "RenderRequest", "width").set_max(32768);
  field(message(other, "Halt"), "spp").mutable_options()->SetExtension(v1::help, "another sentence");
  for (const std::string& b : wireBreaks(today, other, "")) ADD_FAILURE() << b;
  number(other, "RenderRequest", "width").set_default_(1000);
  EXPECT_EQ(wireBreaks(today, other, "").size(), 1u);
  EXPECT_TRUE(wireBreaks(today, other, "| 0.2 | all | `gobo.v1.RenderRequest.width` | |").empty()) << "the default is listed";
}

}  // namespace
}  // namespace gobo::schema_test
