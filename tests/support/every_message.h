// SPDX-License-Identifier: Apache-2.0
// Messages with every field set, made from the descriptors, so that a new field cannot be forgotten; and the kinds of messages there are,
// found from the services' methods. Works with generated messages and with those of a pool that was read from a file.
#pragma once

#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/dynamic_message.h>
#include <google/protobuf/message.h>
#include <google/protobuf/text_format.h>
#include <google/protobuf/unknown_field_set.h>

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "gobo/v1/jobs.pb.h"
#include "gobo/v1/service.pb.h"

namespace gobo::testing {

using MessageType = google::protobuf::Descriptor;  // gobo has a Descriptor, which is of a file
using google::protobuf::DescriptorPool;
using google::protobuf::DynamicMessageFactory;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptorSet;
using google::protobuf::Message;
using google::protobuf::OneofDescriptor;
using google::protobuf::Reflection;

/// The schema of this build, with the files it imports first.
inline FileDescriptorSet schemaOfToday() {
  FileDescriptorSet set;
  std::set<std::string> done;
  const std::function<void(const google::protobuf::FileDescriptor&)> add = [&](const google::protobuf::FileDescriptor& f) {
    if (!done.insert(f.name()).second) return;
    for (int i = 0; i < f.dependency_count(); ++i) add(*f.dependency(i));
    f.CopyTo(set.add_file());
  };
  add(*v1::PlanReply::descriptor()->file());
  add(*v1::Job::descriptor()->file());
  return set;
}

/// A schema that came from a file, and messages of it.
class Schema {
 public:
  explicit Schema(const FileDescriptorSet& set) : set(set), factory_(&pool_) {
    for (const auto& f : set.file())
      if (!pool_.BuildFile(f)) broken = f.name();
    factory_.SetDelegateToGeneratedFactory(false);
  }
  std::unique_ptr<Message> make(const std::string& type) {
    const MessageType* d = pool_.FindMessageTypeByName(type);
    return d ? std::unique_ptr<Message>(factory_.GetPrototype(d)->New()) : nullptr;
  }
  const DescriptorPool& pool() const { return pool_; }
  const FileDescriptorSet set;
  std::string broken;  ///< the file that could not be built; empty: none

 private:
  DescriptorPool pool_;
  DynamicMessageFactory factory_;
};

inline std::unique_ptr<Message> makeGenerated(const std::string& type) {
  const MessageType* d = DescriptorPool::generated_pool()->FindMessageTypeByName(type);
  return d ? std::unique_ptr<Message>(google::protobuf::MessageFactory::generated_factory()->GetPrototype(d)->New()) : nullptr;
}

/// Full names of what the methods of gobo's services take and return.
inline std::vector<std::string> messageKinds(const FileDescriptorSet& set) {
  std::set<std::string> kinds;
  for (const auto& f : set.file())
    for (const auto& s : f.service())
      for (const auto& m : s.method()) {
        kinds.insert(m.input_type().substr(1));
        kinds.insert(m.output_type().substr(1));
      }
  return {kinds.begin(), kinds.end()};
}

namespace every_message {

/// Alternatives of the message's own oneof; 1 without.
inline int ownAlternatives(const MessageType& d) {
  int most = 1;
  for (int i = 0; i < d.real_oneof_decl_count(); ++i) most = std::max(most, d.oneof_decl(i)->field_count());
  return most;
}

/// So many messages are needed to show each alternative of it and, with each, all those below.
inline int alternatives(const MessageType& d, std::set<const MessageType*> seen = {}) {
  if (!seen.insert(&d).second) return 1;
  int below = 1;
  for (int i = 0; i < d.field_count(); ++i)
    if (d.field(i)->message_type()) below = std::max(below, alternatives(*d.field(i)->message_type(), seen));
  return ownAlternatives(d) * below;
}

inline uint32_t seedOf(const std::string& text, int variant) {
  uint32_t h = 2166136261u + uint32_t(variant);
  for (const char c : text) h = (h ^ uint8_t(c)) * 16777619u;
  return h;
}

inline void fill(Message& m, int variant, bool whole);

inline void fillField(Message& m, const FieldDescriptor& f, int variant, bool whole) {
  const Reflection& r = *m.GetReflection();
  const uint32_t seed = seedOf(f.full_name(), variant) % 1000003 + 1;  // never the default
  const int times = f.is_map() ? 1 : f.is_repeated() ? 2 : 1;
  for (int i = 0; i < times; ++i) {
    const uint32_t v = seed + uint32_t(i);
    const std::string text = f.name() + "-" + std::to_string(v) + (i ? "-\u00e4" : "");
#define GOBO_PUT(Kind, value) f.is_repeated() ? r.Add##Kind(&m, &f, value) : r.Set##Kind(&m, &f, value)
    switch (f.cpp_type()) {
      case FieldDescriptor::CPPTYPE_INT32: GOBO_PUT(Int32, -int32_t(v)); break;
      case FieldDescriptor::CPPTYPE_INT64: GOBO_PUT(Int64, -int64_t(v) << 33); break;
      case FieldDescriptor::CPPTYPE_UINT32: GOBO_PUT(UInt32, v << 11); break;
      case FieldDescriptor::CPPTYPE_UINT64: GOBO_PUT(UInt64, uint64_t(v) << 40); break;
      case FieldDescriptor::CPPTYPE_DOUBLE: GOBO_PUT(Double, v / 7.0); break;
      case FieldDescriptor::CPPTYPE_FLOAT: GOBO_PUT(Float, float(v) / 7.0f); break;
      case FieldDescriptor::CPPTYPE_BOOL: GOBO_PUT(Bool, i == 0); break;
      case FieldDescriptor::CPPTYPE_STRING: GOBO_PUT(String, f.type() == FieldDescriptor::TYPE_BYTES ? std::string("\0\xff\x80", 3) + text : text); break;
      case FieldDescriptor::CPPTYPE_ENUM: {
        const EnumDescriptor& e = *f.enum_type();
        const int value = e.value(e.value_count() > 1 ? 1 + int(v) % (e.value_count() - 1) : 0)->number();
        GOBO_PUT(EnumValue, value);
        break;
      }
      case FieldDescriptor::CPPTYPE_MESSAGE: fill(f.is_repeated() ? *r.AddMessage(&m, &f) : *r.MutableMessage(&m, &f), variant, whole); break;
    }
#undef GOBO_PUT
  }
}

/// `whole`: every field; otherwise what leads to alternatives of a oneof, and all of those that lead no further, which makes files small.
inline void fill(Message& m, int variant, bool whole) {
  const MessageType& d = *m.GetDescriptor();
  const int own = ownAlternatives(d);
  for (int i = 0; i < d.field_count(); ++i) {
    const FieldDescriptor& f = *d.field(i);
    const OneofDescriptor* oneof = f.real_containing_oneof();
    if (oneof && f.index_in_oneof() != variant % own) continue;
    const bool further = f.message_type() && alternatives(*f.message_type()) > 1;
    if (whole || oneof || further || d.options().map_entry()) fillField(m, f, variant / own, whole || (oneof && !further));
  }
}

}  // namespace every_message

/// Messages of the type of `empty` that have, together, every field and every alternative set.
inline std::vector<std::unique_ptr<Message>> everyFieldSet(const Message& empty) {
  std::vector<std::unique_ptr<Message>> out;
  const int variants = every_message::alternatives(*empty.GetDescriptor());
  for (int v = 0; v < variants; ++v) {
    out.emplace_back(empty.New());
    every_message::fill(*out.back(), v, v < every_message::ownAlternatives(*empty.GetDescriptor()));
  }
  return out;
}

/// Calls `f` for the message and every one inside it.
inline void eachMessage(Message& m, const std::function<void(Message&)>& f) {
  f(m);
  std::vector<const FieldDescriptor*> fields;
  const Reflection& r = *m.GetReflection();
  r.ListFields(m, &fields);
  for (const FieldDescriptor* field : fields) {
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) continue;
    if (!field->is_repeated()) eachMessage(*r.MutableMessage(&m, field), f);
    else
      for (int i = 0; i < r.FieldSize(m, field); ++i) eachMessage(*r.MutableRepeatedMessage(&m, field, i), f);
  }
}

/// Path-less names of the messages that hold fields unknown to their schema.
inline std::string unknownIn(Message& m) {
  std::string out;
  eachMessage(m, [&](Message& inner) {
    const auto& unknown = inner.GetReflection()->GetUnknownFields(inner);
    if (!unknown.empty()) out += inner.GetDescriptor()->full_name() + " has unknown field " + std::to_string(unknown.field(0).number()) + "; ";
  });
  return out;
}

inline std::string textOf(const Message& m) {
  std::string out;
  google::protobuf::TextFormat::Printer printer;
  printer.SetUseShortRepeatedPrimitives(false);
  printer.PrintToString(m, &out);
  return out;
}

}  // namespace gobo::testing
