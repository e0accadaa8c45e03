// SPDX-License-Identifier: Apache-2.0
// gobo(1): commands and options from the parser, request fields from the schema's options.
#include <google/protobuf/descriptor.h>

#include <sstream>

#include "command_line.h"
#include "gobo/v1/options.pb.h"

namespace gobo::cli {

namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;

std::string troff(std::string text) {
  // The page is made at build time: the builder's user number must not stay in it.
  const std::string mine = defaultAddress().substr(5);
  for (size_t at = text.find(mine); at != std::string::npos; at = text.find(mine)) text.replace(at, mine.size(), "/tmp/gobo-UID.sock");
  std::string out;
  bool lineStart = true;
  for (const char c : text) {
    if (lineStart && (c == '.' || c == '\'')) out += "\\&";
    if (c == '\\') out += "\\e";
    else if (c == '-') out += "\\-";
    else out += c;
    lineStart = c == '\n';
  }
  return out;
}

std::string numberText(double v) {
  std::ostringstream text;
  text.precision(12);
  text << v;
  return text.str();
}

std::string typeText(const FieldDescriptor* f) {
  std::string type;
  switch (f->cpp_type()) {
    case FieldDescriptor::CPPTYPE_STRING: type = "text"; break;
    case FieldDescriptor::CPPTYPE_BOOL: type = "true|false"; break;
    case FieldDescriptor::CPPTYPE_ENUM: type = choices(f->enum_type()); break;
    case FieldDescriptor::CPPTYPE_MESSAGE: type = f->message_type()->name() == "Vector3" ? "X,Y,Z" : "(empty)"; break;
    case FieldDescriptor::CPPTYPE_FLOAT:
    case FieldDescriptor::CPPTYPE_DOUBLE: type = "number"; break;
    default: type = "integer";
  }
  return f->is_repeated() ? type + ",..." : type;
}

std::string fieldText(const FieldDescriptor* f) {
  const auto& o = f->options();
  std::string text = o.GetExtension(v1::help);
  const auto add = [&](const std::string& part) { text += (text.empty() ? "" : "; ") + part; };
  const v1::Number n = o.GetExtension(v1::number);
  if (n.has_default_()) add("default " + numberText(n.default_()));
  if (!o.GetExtension(v1::text_default).empty()) add("default " + o.GetExtension(v1::text_default));
  if (f->cpp_type() == FieldDescriptor::CPPTYPE_BOOL) add(std::string("default ") + (o.GetExtension(v1::bool_default) ? "true" : "false"));
  if (n.has_min()) add((n.exclusive_min() ? "above " : "at least ") + numberText(n.min()));
  if (n.has_max()) add("at most " + numberText(n.max()));
  if (!o.GetExtension(v1::unit).empty()) add("in " + o.GetExtension(v1::unit));
  return text;
}

void collect(const Descriptor* d, const std::string& prefix, std::vector<FieldHelp>& out) {
  for (int i = 0; i < d->field_count(); ++i) {
    const FieldDescriptor* f = d->field(i);
    const std::string path = prefix + f->name();
    if (f->is_map()) {
      collect(f->message_type()->FindFieldByName("value")->message_type(), path + ".NAME.", out);
    } else if (f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE && f->message_type()->name() != "Vector3" && f->message_type()->field_count() > 0) {
      // A technique has the same fields wherever it stands: they are listed once.
      if (f->message_type()->name() == "ShadowTechnique" && path != "shadows")
        out.push_back({path + ".TECHNIQUE", "group", fieldText(f) + " (fields as under shadows)"});
      else collect(f->message_type(), path + ".", out);
    } else {
      out.push_back({path, typeText(f), fieldText(f)});
    }
  }
}

void options(std::ostream& out, const CLI::App& app) {
  for (const CLI::Option* o : app.get_options()) {
    if (o->get_group().empty()) continue;
    out << ".TP\n";
    if (o->nonpositional()) {
      std::string names;
      for (const std::string& n : o->get_snames()) names += (names.empty() ? "" : ", ") + std::string("\\fB\\-") + troff(n) + "\\fR";
      for (const std::string& n : o->get_lnames()) names += (names.empty() ? "" : ", ") + std::string("\\fB\\-\\-") + troff(n) + "\\fR";
      out << names << (o->get_items_expected_max() > 0 ? " \\fI" + troff(o->get_type_name()) + "\\fR" : "") << "\n";
    } else {
      out << "\\fI" << troff(o->get_single_name()) << "\\fR\n";
    }
    out << troff(o->get_description()) << "\n";
  }
}

std::string synopsis(const CLI::App& app) {
  std::string text;
  for (const CLI::Option* o : app.get_options())
    if (!o->nonpositional()) {
      const std::string name = "\\fI" + troff(o->get_single_name()) + "\\fR" + (o->get_items_expected_max() > 1 ? " ..." : "");
      text += o->get_required() ? " " + name : " [" + name + "]";
    }
  return text;
}

void command(std::ostream& out, const CLI::App& app, const std::string& prefix) {
  const std::string name = prefix + app.get_name();
  const auto subs = app.get_subcommands([](const CLI::App*) { return true; });
  if (subs.empty()) {
    out << ".SS \"" << troff(name) << "\"\n\\fBgobo " << troff(name) << "\\fR" << synopsis(app) << " [options]\n.PP\n" << troff(app.get_description()) << ".\n";
    options(out, app);
  }
  for (const CLI::App* sub : subs) command(out, *sub, name + " ");
}

}  // namespace

std::vector<FieldHelp> requestFields() {
  std::vector<FieldHelp> fields;
  collect(v1::RenderRequest::descriptor(), "", fields);
  return fields;
}

std::string manual(const CLI::App& app) {
  std::ostringstream out;
  out << ".\\\" Made by `gobo man` from the command line's own declarations and the protocol's schema.\n"
      << ".TH GOBO 1 \"\" \"gobo " << troff(buildVersion()) << "\" \"Gobo\"\n"
      << ".SH NAME\ngobo \\- " << troff(app.get_description()) << "\n"
      << ".SH SYNOPSIS\n\\fBgobo\\fR [options] \\fIcommand\\fR [options] [arguments]\n"
      << ".SH DESCRIPTION\nRenders and relights glTF scenes through a running\n.BR gobod ,\n"
         "or in its own process with\n.BR \\-\\-local .\n"
         "A scene is a file, the id of a loaded scene, or a built-in name. The request is made from\n.BR \\-\\-request ,\n"
         "then the options, then every\n.B \\-\\-set\nin order; later ones win. Files appear by rename: one that is there is whole.\n"
      << ".SH GLOBAL OPTIONS\nThey may stand before or after the command.\n";
  options(out, app);
  out << ".SH COMMANDS\n";
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; })) command(out, *sub, "");
  out << ".SH REQUEST FIELDS\nPaths of\n.BR \\-\\-set ,\nand the fields of\n.BR \\-\\-request .\n";
  for (const FieldHelp& f : requestFields())
    out << ".TP\n\\fB" << troff(f.path) << "\\fR=\\fI" << troff(f.type) << "\\fR\n" << (f.text.empty() ? "\\&" : troff(f.text)) << "\n";
  out << ".SH ENVIRONMENT\n.TP\n.B GOBO_SERVER\naddress of the server\n.TP\n.B GOBO_TOKEN\nbearer token for it\n"
      << ".SH FILES\n.TP\n.I " << troff(defaultAddress().substr(5)) << "\nsocket of the default server; refused when it belongs to another user\n"
      << ".SH EXIT STATUS\n";
  std::string codes(kExitHelp);
  codes = codes.substr(codes.find(':') + 2);
  for (size_t begin = 0; begin < codes.size();) {
    const size_t end = std::min(codes.find("; ", begin), codes.size());
    const std::string one = codes.substr(begin, end - begin);
    out << ".TP\n.B " << troff(one.substr(0, one.find(' '))) << "\n" << troff(one.substr(one.find(' ') + 1)) << "\n";
    begin = end + 2;
  }
  out << ".SH SEE ALSO\ndocs/protocol.md, docs/operations.md, docs/python.md in the source\n";
  return out.str();
}

}  // namespace gobo::cli
