// SPDX-License-Identifier: Apache-2.0
// Messages between releases without a connection. Recorded ones, one file a kind with every field set, must be today's messages with the same
// values; today's, and those of a schema that has a new field in each message and a new value in each enum, must be read by the schema of
// every release, which keeps what it knows. RELEASE/messages/KIND.bin has the bytes, KIND.txt what they say.
#include <google/protobuf/util/message_differencer.h>

#include "support/every_message.h"
#include "support/releases.h"

namespace gobo::release_messages_test {
namespace {

using namespace testing;  // gobo's

using google::protobuf::util::MessageDifferencer;

const char* const kNext = "--------\n";  // between the texts of two messages of a file

std::string fileOf(const std::string& release, const std::string& kind, const char* ending) { return releaseFile(release, "messages/" + kind + ending); }

TEST(Messages, OfEveryReleaseSayTheSameToday) {
  if (recording()) {
    for (const std::string& kind : messageKinds(schemaOfToday())) {
      std::vector<std::string> bytes;
      std::string text;
      for (const auto& m : everyFieldSet(*makeGenerated(kind))) {
        bytes.push_back(m->SerializeAsString());
        text += textOf(*m) + kNext;
      }
      writeAll(fileOf(thisRelease(), kind, ".bin"), packed(bytes));
      writeAll(fileOf(thisRelease(), kind, ".txt"), text);
    }
  }
  size_t messages = 0;
  for (const std::string& release : releases()) {
    const auto kinds = messageKinds(recordedSchema(release));
    EXPECT_GE(kinds.size(), 30u) << release;
    for (const std::string& kind : kinds) {
      SCOPED_TRACE(release + " " + kind);
      std::string text;
      const auto today = makeGenerated(kind);
      ASSERT_NE(today, nullptr) << "the kind is gone";
      const auto recorded = unpacked(readAll(fileOf(release, kind, ".bin")));
      ASSERT_FALSE(recorded.empty());
      for (const std::string& bytes : recorded) {
        const std::unique_ptr<Message> m(today->New()), again(today->New());
        ASSERT_TRUE(m->ParseFromString(bytes));
        EXPECT_EQ(unknownIn(*m), "");
        text += textOf(*m) + kNext;
        ASSERT_TRUE(again->ParseFromString(m->SerializeAsString()));
        EXPECT_TRUE(MessageDifferencer::Equals(*m, *again));
        ++messages;
      }
      EXPECT_EQ(text, readAll(fileOf(release, kind, ".txt")));
    }
  }
  EXPECT_GE(messages, 60u);
}

/// Names of all fields that are set, at any depth.
void collectSet(Message& m, std::set<std::string>& seen) {
  eachMessage(m, [&](Message& inner) {
    std::vector<const FieldDescriptor*> fields;
    inner.GetReflection()->ListFields(inner, &fields);
    for (const FieldDescriptor* f : fields) seen.insert(f->full_name());
  });
}
void expectSet(const MessageType& d, const std::set<std::string>& seen, std::set<const MessageType*>& done) {
  if (!done.insert(&d).second) return;
  for (int i = 0; i < d.field_count(); ++i) {
    EXPECT_TRUE(seen.count(d.field(i)->full_name())) << d.field(i)->full_name() << " is set in no recorded message";
    if (d.field(i)->message_type()) expectSet(*d.field(i)->message_type(), seen, done);
  }
}

TEST(Messages, RecordedOnesHaveEveryFieldOfTheirRelease) {
  for (const std::string& release : releases()) {
    Schema then(recordedSchema(release));
    ASSERT_EQ(then.broken, "");
    for (const std::string& kind : messageKinds(then.set)) {
      SCOPED_TRACE(release + " " + kind);
      std::set<std::string> seen;
      std::set<const MessageType*> done;
      for (const std::string& bytes : unpacked(readAll(fileOf(release, kind, ".bin")))) {
        const auto m = then.make(kind);
        ASSERT_TRUE(m->ParseFromString(bytes));
        collectSet(*m, seen);
      }
      expectSet(*then.pool().FindMessageTypeByName(kind), seen, done);
    }
  }
}

/// The schema of a later release: a new field in every message, a new value in every enum.
FileDescriptorSet later() {
  FileDescriptorSet set = schemaOfToday();
  const std::function<void(google::protobuf::EnumDescriptorProto&)> more = [](auto& e) {
    auto* v = e.add_value();
    v->set_name("LATER_" + e.name());
    v->set_number(4000);
  };
  const std::function<void(google::protobuf::DescriptorProto&)> extend = [&](google::protobuf::DescriptorProto& m) {
    if (m.options().map_entry()) return;
    for (auto& inner : *m.mutable_nested_type()) extend(inner);
    for (auto& e : *m.mutable_enum_type()) more(e);
    auto* f = m.add_field();
    f->set_name("of_a_later_release");
    f->set_number(18000);
    f->set_type(google::protobuf::FieldDescriptorProto::TYPE_STRING);
    f->set_label(google::protobuf::FieldDescriptorProto::LABEL_OPTIONAL);
  };
  for (auto& f : *set.mutable_file()) {
    if (f.package() == "google.protobuf") continue;
    for (auto& m : *f.mutable_message_type()) extend(m);
    for (auto& e : *f.mutable_enum_type()) more(e);
  }
  return set;
}

/// Clears what `d` does not know.
void prune(Message& m, const MessageType& d) {
  std::vector<const FieldDescriptor*> fields;
  const Reflection& r = *m.GetReflection();
  r.MutableUnknownFields(&m)->Clear();
  r.ListFields(m, &fields);
  for (const FieldDescriptor* f : fields) {
    const FieldDescriptor* known = d.FindFieldByNumber(f->number());
    if (!known) r.ClearField(&m, f);
    else if (f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      if (!f->is_repeated()) prune(*r.MutableMessage(&m, f), *known->message_type());
      else
        for (int i = 0; i < r.FieldSize(m, f); ++i) prune(*r.MutableRepeatedMessage(&m, f, i), *known->message_type());
    }
  }
}

/// `bytes` of the type `kind`, written under `writer`, as `reader` has them: parsed, what it does not know dropped, and read by the writer again.
void expectKept(Schema& writer, const std::string& kind, const Message& written, const Message& readerEmpty) {
  const std::unique_ptr<Message> read(readerEmpty.New());
  ASSERT_TRUE(read->ParseFromString(written.SerializeAsString()));
  eachMessage(*read, [](Message& m) { m.GetReflection()->MutableUnknownFields(&m)->Clear(); });
  const auto back = writer.make(kind), expected = writer.make(kind);
  ASSERT_TRUE(back->ParseFromString(read->SerializeAsString()));
  expected->CopyFrom(written);
  prune(*expected, *readerEmpty.GetDescriptor());
  EXPECT_EQ(textOf(*back), textOf(*expected));
}

TEST(Messages, OfALaterReleaseAreReadByThisOneAndThoseBefore) {
  Schema next(later());
  ASSERT_EQ(next.broken, "");
  size_t unknown = 0, values = 0;
  std::vector<std::unique_ptr<Schema>> before;
  for (const std::string& release : releases()) before.push_back(std::make_unique<Schema>(recordedSchema(release)));
  ASSERT_FALSE(before.empty());
  for (const std::string& kind : messageKinds(next.set)) {
    SCOPED_TRACE(kind);
    for (const auto& m : everyFieldSet(*next.make(kind))) {
      // Every enum takes its new value.
      eachMessage(*m, [&](Message& inner) {
        std::vector<const FieldDescriptor*> fields;
        const Reflection& r = *inner.GetReflection();
        r.ListFields(inner, &fields);
        for (const FieldDescriptor* f : fields)
          if (f->enum_type() && f->is_repeated()) r.SetRepeatedEnumValue(&inner, f, 0, 4000), ++values;
          else if (f->enum_type()) r.SetEnumValue(&inner, f, 4000), ++values;
      });
      const auto today = makeGenerated(kind);
      const std::unique_ptr<Message> read(today->New());
      ASSERT_TRUE(read->ParseFromString(m->SerializeAsString()));
      unknown += !unknownIn(*read).empty();
      expectKept(next, kind, *m, *today);
      for (const auto& then : before)
        if (const auto old = then->make(kind)) expectKept(next, kind, *m, *old);  // a kind that it does not have is of a method that it does not call
    }
  }
  EXPECT_GE(unknown, 60u);
  EXPECT_GE(values, 40u);
}

TEST(Messages, OfTodayAreReadByEveryRelease) {
  Schema today(schemaOfToday());
  ASSERT_EQ(today.broken, "");
  for (const std::string& release : releases()) {
    Schema then(recordedSchema(release));
    for (const std::string& kind : messageKinds(then.set)) {
      SCOPED_TRACE(release + " " + kind);
      for (const auto& m : everyFieldSet(*today.make(kind))) expectKept(today, kind, *m, *then.make(kind));
    }
  }
}

}  // namespace
}  // namespace gobo::release_messages_test
