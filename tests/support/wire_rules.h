// SPDX-License-Identifier: Apache-2.0
// The rules of wire compatibility between two releases of the schema, over their descriptors: what a client of one release and a server of
// the other need to understand each other, in both directions, in binary and in JSON (so names count as well). Each break is a sentence that
// begins with the full name of what broke the rule.
#pragma once

#include <google/protobuf/descriptor.pb.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "gobo/v1/options.pb.h"

namespace gobo::testing {

namespace wire_rules {

using namespace google::protobuf;

/// Everything of a set by its full name.
struct Names {
  std::map<std::string, const DescriptorProto*> messages;
  std::map<std::string, const EnumDescriptorProto*> enums;
  std::map<std::string, const ServiceDescriptorProto*> services;
  std::map<std::string, const FieldDescriptorProto*> extensions;

  explicit Names(const FileDescriptorSet& set) {
    for (const FileDescriptorProto& f : set.file()) {
      if (f.package() == "google.protobuf") continue;
      const std::string prefix = f.package() + ".";
      for (const auto& m : f.message_type()) add(prefix, m);
      for (const auto& e : f.enum_type()) enums[prefix + e.name()] = &e;
      for (const auto& s : f.service()) services[prefix + s.name()] = &s;
      for (const auto& x : f.extension()) extensions[prefix + x.name()] = &x;
    }
  }

 private:
  void add(const std::string& prefix, const DescriptorProto& m) {
    messages[prefix + m.name()] = &m;
    for (const auto& inner : m.nested_type()) add(prefix + m.name() + ".", inner);
    for (const auto& e : m.enum_type()) enums[prefix + m.name() + "." + e.name()] = &e;
  }
};

/// The oneof that a field is in; empty for fields of none and for the synthetic ones of `optional`.
inline std::string oneofOf(const DescriptorProto& m, const FieldDescriptorProto& f) {
  return f.has_oneof_index() && !f.proto3_optional() ? m.oneof_decl(f.oneof_index()).name() : "";
}

inline std::string typeOf(const FieldDescriptorProto& f) {
  std::string text = FieldDescriptorProto::Label_Name(f.label()) + " " + FieldDescriptorProto::Type_Name(f.type());
  if (f.proto3_optional()) text += " with presence";
  return f.type_name().empty() ? text : text + " " + f.type_name();
}

/// Empty when equal; `listed`: names of fields whose default may differ.
inline void compareOptions(const std::string& name, const FieldOptions& was, const FieldOptions& is, const std::string& listed, std::vector<std::string>& out) {
  const v1::Number &a = was.GetExtension(v1::number), &b = is.GetExtension(v1::number);
  const auto text = [](bool has, double v) { return has ? std::to_string(v) : std::string("none"); };
  const auto changed = [&](const std::string& before, const std::string& now) {
    if (before != now && listed.find("`" + name + "`") == std::string::npos)
      out.push_back(name + ": default was " + before + " and is " + now + ", which docs/changed_pictures.md does not list as `" + name + "`");
  };
  if (a.has_default_() != b.has_default_() || a.default_() != b.default_()) changed(text(a.has_default_(), a.default_()), text(b.has_default_(), b.default_()));
  changed("'" + was.GetExtension(v1::text_default) + "'", "'" + is.GetExtension(v1::text_default) + "'");
  changed(was.GetExtension(v1::bool_default) ? "true" : "false", is.GetExtension(v1::bool_default) ? "true" : "false");
  if (b.has_min() && (!a.has_min() || b.min() > a.min() || (b.exclusive_min() && !a.exclusive_min() && b.min() == a.min())))
    out.push_back(name + ": smallest value was " + text(a.has_min(), a.min()) + " and is " + text(true, b.min()) + (b.exclusive_min() ? ", exclusive" : ""));
  if (b.has_max() && (!a.has_max() || b.max() < a.max()))
    out.push_back(name + ": largest value was " + text(a.has_max(), a.max()) + " and is " + text(true, b.max()));
  if (was.GetExtension(v1::not_in_hash) != is.GetExtension(v1::not_in_hash)) out.push_back(name + ": not_in_hash changed");
}

template <typename Proto>
bool reserves(const Proto& p, int number, const std::string& name, bool inclusiveEnd) {
  const bool byNumber = std::any_of(p.reserved_range().begin(), p.reserved_range().end(),
                                    [&](const auto& r) { return number >= r.start() && (inclusiveEnd ? number <= r.end() : number < r.end()); });
  return byNumber && std::find(p.reserved_name().begin(), p.reserved_name().end(), name) != p.reserved_name().end();
}

inline void compareMessages(const std::string& name, const DescriptorProto& was, const DescriptorProto& is, const std::string& listed,
                            std::vector<std::string>& out) {
  for (const FieldDescriptorProto& f : was.field()) {
    const std::string field = name + "." + f.name();
    const auto now = std::find_if(is.field().begin(), is.field().end(), [&](const auto& g) { return g.number() == f.number(); });
    if (now == is.field().end()) {
      const auto moved = std::find_if(is.field().begin(), is.field().end(), [&](const auto& g) { return g.name() == f.name(); });
      if (moved != is.field().end()) out.push_back(field + ": number was " + std::to_string(f.number()) + " and is " + std::to_string(moved->number()));
      else if (!reserves(is, f.number(), f.name(), false))
        out.push_back(field + ": was removed without `reserved " + std::to_string(f.number()) + "; reserved \"" + f.name() + "\"`");
      continue;
    }
    if (now->name() != f.name()) out.push_back(field + ": number " + std::to_string(f.number()) + " is now called " + now->name());
    if (typeOf(*now) != typeOf(f)) out.push_back(field + ": was " + typeOf(f) + " and is " + typeOf(*now));
    if (oneofOf(is, *now) != oneofOf(was, f)) out.push_back(field + ": oneof was '" + oneofOf(was, f) + "' and is '" + oneofOf(is, *now) + "'");
    if (now->name() == f.name()) compareOptions(field, f.options(), now->options(), listed, out);
  }
}

}  // namespace wire_rules

/// What a client or server of `before` would not understand of `now`, or the other way round. `listed`: the text of docs/changed_pictures.md.
inline std::vector<std::string> wireBreaks(const google::protobuf::FileDescriptorSet& before, const google::protobuf::FileDescriptorSet& now,
                                           const std::string& listed) {
  using namespace wire_rules;
  std::vector<std::string> out;
  const Names was(before), is(now);
  for (const auto& [name, m] : was.messages) {
    if (const auto it = is.messages.find(name); it != is.messages.end()) compareMessages(name, *m, *it->second, listed, out);
    else out.push_back(name + ": the message is gone");
  }
  for (const auto& [name, e] : was.enums) {
    const auto it = is.enums.find(name);
    if (it == is.enums.end()) {
      out.push_back(name + ": the enum is gone");
      continue;
    }
    for (const EnumValueDescriptorProto& v : e->value()) {
      const auto& values = it->second->value();
      const auto at = std::find_if(values.begin(), values.end(), [&](const auto& w) { return w.number() == v.number(); });
      if (at != values.end() && at->name() != v.name())
        out.push_back(name + "." + v.name() + ": number " + std::to_string(v.number()) + " is now called " + at->name());
      if (at == values.end() && !reserves(*it->second, v.number(), v.name(), true))
        out.push_back(name + "." + v.name() + ": was removed, or renumbered, without `reserved " + std::to_string(v.number()) + "; reserved \"" + v.name() +
                      "\"`");
    }
  }
  for (const auto& [name, s] : was.services) {
    const auto it = is.services.find(name);
    if (it == is.services.end()) {
      out.push_back(name + ": the service is gone");
      continue;
    }
    for (const MethodDescriptorProto& m : s->method()) {
      const auto& methods = it->second->method();
      const auto at = std::find_if(methods.begin(), methods.end(), [&](const auto& w) { return w.name() == m.name(); });
      if (at == methods.end()) out.push_back(name + "." + m.name() + ": the method is gone");
      else if (at->input_type() != m.input_type() || at->output_type() != m.output_type() || at->client_streaming() != m.client_streaming() ||
               at->server_streaming() != m.server_streaming())
        out.push_back(name + "." + m.name() + ": takes or returns another type, or streams otherwise");
    }
  }
  for (const auto& [name, x] : was.extensions) {
    const auto it = is.extensions.find(name);
    if (it == is.extensions.end() || it->second->number() != x->number() || typeOf(*it->second) != typeOf(*x))
      out.push_back(name + ": the option is gone, or of another number or type");
  }
  return out;
}

}  // namespace gobo::testing
