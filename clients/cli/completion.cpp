// SPDX-License-Identifier: Apache-2.0
// Shell completion. The scripts only pass the words on; what fits is worked out here, from the same CLI::App that parses.
#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "command_line.h"
#include "gobo/v1/options.pb.h"
#include "request/request.h"
#include "scene/load.h"

namespace gobo::cli {

namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;

constexpr double kPatienceSeconds = 0.3;

// The words so far, read the way the parser will read them.
struct Context {
  const CLI::App* app;
  std::vector<std::string> positionals;       // of `app`
  const CLI::Option* pending = nullptr;       // its value is being typed
  std::map<std::string, std::string> values;  // by long name
};

const CLI::Option* findOption(const CLI::App* app, const std::string& word) {
  for (; app; app = app->get_parent())
    for (const CLI::Option* o : app->get_options())
      if (o->nonpositional() && o->check_name(word)) return o;
  return nullptr;
}

const CLI::App* findCommand(const CLI::App* app, const std::string& word) {
  for (const CLI::App* sub : app->get_subcommands([](const CLI::App*) { return true; }))
    if (sub->get_name() == word) return sub;
  return nullptr;
}

bool takesValue(const CLI::Option* o) { return o->get_items_expected_max() > 0; }

Context read(const CLI::App& root, const std::vector<std::string>& words) {
  Context c{&root, {}, nullptr, {}};
  for (size_t i = 0; i + 1 < words.size(); ++i) {
    const std::string& word = words[i];
    if (c.pending) {
      c.values[c.pending->get_lnames().empty() ? "" : c.pending->get_lnames()[0]] = word;
      c.pending = nullptr;
    } else if (word.size() > 1 && word[0] == '-') {
      const CLI::Option* o = findOption(c.app, word);
      if (o && takesValue(o)) c.pending = o;
    } else if (const CLI::App* sub = c.positionals.empty() ? findCommand(c.app, word) : nullptr) {
      c.app = sub;
    } else {
      c.positionals.push_back(word);
    }
  }
  return c;
}

class Candidates {
 public:
  explicit Candidates(std::string typed) : typed_(std::move(typed)) {}
  void add(const std::string& word, std::string about = "") {
    if (word.rfind(typed_, 0) != 0 || word.find_first_of("\n\t") != std::string::npos) return;
    for (char& c : about)
      if (c == '\n' || c == '\t') c = ' ';
    lines.push_back(about.empty() ? word : word + "\t" + about);
  }
  void ask(const char* what) { lines.push_back(what); }
  const std::string& typed() const { return typed_; }
  std::vector<std::string> lines;

 private:
  std::string typed_;
};

std::string helpOf(const FieldDescriptor* f) { return f->options().GetExtension(v1::help); }

// Names out of the schema's help of `outputs`: "beauty, albedo, ..., visibility:LIGHT; ...".
std::vector<std::string> outputNames() {
  const std::string help = helpOf(v1::RenderRequest::descriptor()->FindFieldByName("outputs"));
  const std::string list = help.substr(0, help.find(';'));
  std::vector<std::string> names;
  for (size_t begin = 0; begin < list.size();) {
    const size_t end = std::min(list.find(", ", begin), list.size());
    names.push_back(list.substr(begin, end - begin));
    begin = end + 2;
  }
  return names;
}

// The server's side of completion; asked only when a candidate needs it.
class Server {
 public:
  explicit Server(const Context& c) {
    SessionOptions options;
    const auto value = [&](const char* name) {
      const auto it = c.values.find(name);
      return it == c.values.end() ? std::string() : it->second;
    };
    options.server = value("server");
    options.tokenFile = value("token-file");
    options.ca = value("ca");
    options.cert = value("cert");
    options.key = value("key");
    options.timeoutSeconds = kPatienceSeconds;
    auto session = Session::open(options);
    if (session.ok()) session_ = std::move(*session);
  }
  v1::ListScenesReply scenes() {
    v1::ListScenesReply reply;
    if (!session_) return reply;
    Session::Call call(*session_);
    (void)session_->scenes().List(&call.context, {}, &reply);
    return reply;
  }
  v1::SceneInfo inspect(const std::string& scene) {
    v1::SceneInfo info;
    if (!session_ || scene.empty()) return info;
    Session::Call call(*session_);
    v1::InspectSceneRequest request;
    request.set_scene(scene);
    (void)session_->scenes().Inspect(&call.context, request, &info);
    return info;
  }
  v1::ListJobsReply jobs() {
    v1::ListJobsReply reply;
    if (!session_) return reply;
    Session::Call call(*session_);
    (void)session_->jobs().List(&call.context, {}, &reply);
    return reply;
  }

 private:
  std::unique_ptr<Session> session_;
};

std::string sceneOf(const Context& c) { return c.positionals.empty() ? "" : c.positionals[0]; }

void offerScenes(const Context& c, Candidates& out, bool all) {
  if (all)
    for (const std::string& name : builtinSceneNames()) out.add(name, "built-in");
  const v1::ListScenesReply loaded = Server(c).scenes();
  for (const v1::SceneInfo& s : loaded.scenes()) {
    const auto builtin = builtinSceneNames();
    if (!all || std::find(builtin.begin(), builtin.end(), s.id()) == builtin.end()) out.add(s.id(), s.source());
  }
  if (all) out.ask(":file");
}

// Lists hold commas: what is before the last one stays.
void offerOutputs(const Context& c, Candidates& out) {
  const size_t comma = out.typed().rfind(',');
  const std::string before = comma == std::string::npos ? "" : out.typed().substr(0, comma + 1);
  const std::string last = out.typed().substr(before.size());
  v1::SceneInfo info;
  if (last.find(':') != std::string::npos) info = Server(c).inspect(sceneOf(c));
  for (const std::string& name : outputNames()) {
    const size_t colon = name.find(':');
    if (colon == std::string::npos) {
      out.add(before + name);
      continue;
    }
    const std::string kind = name.substr(0, colon + 1);
    if (last.rfind(kind, 0) != 0) out.add(before + kind, "of one light");
    for (const v1::LightInfo& light : info.lights()) out.add(before + kind + light.name(), light.kind());
  }
}

// "lights.key.color=": one level at a time; groups end with a dot, fields with "=".
void offerPaths(const Context& c, Candidates& out) {
  const size_t equals = out.typed().find('=');
  std::string path = out.typed().substr(0, equals), before;
  const Descriptor* d = v1::RenderRequest::descriptor();
  for (size_t dot = path.find('.'); dot != std::string::npos; dot = path.find('.')) {
    const FieldDescriptor* f = d->FindFieldByName(path.substr(0, dot));
    if (!f || f->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) return;
    before += path.substr(0, dot + 1);
    path.erase(0, dot + 1);
    d = f->message_type();
    if (!f->is_map()) continue;
    d = d->FindFieldByName("value")->message_type();
    const size_t end = path.find('.');
    if (end == std::string::npos) {
      const v1::SceneInfo info = Server(c).inspect(sceneOf(c));
      for (const v1::LightInfo& light : info.lights()) out.add(before + light.name() + ".", light.kind());
      return;
    }
    before += path.substr(0, end + 1);
    path.erase(0, end + 1);
  }
  for (int i = 0; i < d->field_count(); ++i) {
    const FieldDescriptor* f = d->field(i);
    const bool group =
        f->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE && f->message_type()->full_name() != "gobo.v1.Vector3" && f->message_type()->field_count() > 0;
    if (equals == std::string::npos) {
      out.add(before + f->name() + (group ? "." : "="), helpOf(f));
    } else if (f->name() == path) {
      if (f->cpp_type() == FieldDescriptor::CPPTYPE_ENUM)
        for (int v = 0; v < f->enum_type()->value_count(); ++v)
          if (f->enum_type()->value(v)->number()) out.add(before + path + "=" + f->enum_type()->value(v)->name());
      if (f->cpp_type() == FieldDescriptor::CPPTYPE_BOOL)
        for (const char* word : {"true", "false"}) out.add(before + path + "=" + word);
    }
  }
}

void offerLights(const Context& c, Candidates& out) {
  const v1::SceneInfo info = Server(c).inspect(sceneOf(c));
  for (const v1::LightInfo& light : info.lights()) out.add(light.name(), light.kind());
}

// "exponential.c=80,map.blur=2;moment": what is before the last ';' or ',' stays.
void offerTechniques(Candidates& out) {
  const size_t mark = out.typed().find_last_of(";,");
  const std::string before = mark == std::string::npos ? "" : out.typed().substr(0, mark + 1);
  std::string last = out.typed().substr(before.size()), group;
  const Descriptor* d = v1::ShadowTechnique::descriptor();
  if (const size_t dot = last.find('.'); dot != std::string::npos) {
    const FieldDescriptor* f = d->FindFieldByName(last.substr(0, dot));
    if (!f) return;
    group = last.substr(0, dot + 1);
    d = f->message_type();
    last.erase(0, dot + 1);
  }
  const size_t equals = last.find('=');
  for (int i = 0; i < d->field_count(); ++i) {
    const FieldDescriptor* f = d->field(i);
    if (equals == std::string::npos) {
      if (group.empty()) out.add(before + f->name());
      out.add(before + group + f->name() + (group.empty() ? "." : "="), helpOf(f));
    } else if (f->name() == last.substr(0, equals) && f->cpp_type() == FieldDescriptor::CPPTYPE_ENUM) {
      for (int v = 0; v < f->enum_type()->value_count(); ++v)
        if (f->enum_type()->value(v)->number()) out.add(before + group + f->name() + "=" + f->enum_type()->value(v)->name());
    }
  }
}

// Candidates for a value by its type name in command_line.cpp.
void offerValue(const std::string& type, const Context& c, Candidates& out) {
  if (type == "SCENE") offerScenes(c, out, true);
  else if (type == "LOADED") offerScenes(c, out, false);
  else if (type == "OUTPUTS" || type == "OUTPUT") offerOutputs(c, out);
  else if (type == "LIGHT") offerLights(c, out);
  else if (type == "TECHNIQUES") offerTechniques(out);
  else if (type == "PATH=VALUE" || type == "PATH=VALUES") offerPaths(c, out);
  else if (type == "FILE" || type == "ADDRESS") out.ask(":file");
  else if (type == "FOLDER") out.ask(":dir");
  else if (type == "CAMERA") {
    const v1::SceneInfo info = Server(c).inspect(sceneOf(c));
    for (const std::string& name : info.cameras()) out.add(name);
  } else if (type == "JOB") {
    const v1::ListJobsReply list = Server(c).jobs();
    for (const v1::Job& job : list.jobs()) out.add(job.id(), v1::Job::State_Name(job.state()) + " " + job.spec().name());
  } else if (type.find('|') != std::string::npos) {
    for (size_t begin = 0; begin <= type.size();) {
      const size_t end = std::min(type.find('|', begin), type.size());
      out.add(type.substr(begin, end - begin));
      begin = end + 1;
    }
  }
}

constexpr const char* kBash = R"(# bash completion of gobo; made by `gobo completion bash`
_gobo() {
  local line=${COMP_LINE:0:COMP_POINT} cur prefix= candidate
  local -a words
  read -ra words <<< "$line"
  [[ $line == *[[:space:]] ]] && words+=("")
  cur=${words[-1]}
  # readline takes = and : as ends of words: what is before the last of them is on the line already
  [[ $cur == *[=:]* && $COMP_WORDBREAKS == *[=:]* ]] && prefix=${cur%"${cur##*[=:]}"}
  COMPREPLY=()
  while IFS=$'\t' read -r candidate _; do
    case $candidate in
      :file) compopt -o filenames 2>/dev/null; while read -r candidate; do COMPREPLY+=("$candidate"); done < <(compgen -f -- "$cur") ;;
      :dir) compopt -o filenames 2>/dev/null; while read -r candidate; do COMPREPLY+=("$candidate"); done < <(compgen -d -- "$cur") ;;
      *) COMPREPLY+=("${candidate#"$prefix"}") ;;
    esac
  done < <("${words[0]}" __complete "${words[@]:1}" 2>/dev/null)
  [[ ${#COMPREPLY[@]} == 1 && ${COMPREPLY[0]} == *[=.:] ]] && compopt -o nospace 2>/dev/null
  return 0
}
complete -F _gobo gobo
)";

constexpr const char* kZsh = R"(#compdef gobo
# zsh completion of gobo; made by `gobo completion zsh`
_gobo() {
  local line word
  local -a open whole
  for line in "${(@f)$(${words[1]} __complete "${(@)words[2,CURRENT]}" 2>/dev/null)}"; do
    word=${line%%$'\t'*}
    case $word in
      '') ;;
      :file) _files ;;
      :dir) _files -/ ;;
      *[=.:]) open+=("$word") ;;
      *) whole+=("$word") ;;
    esac
  done
  (( $#open )) && compadd -S '' -a open
  (( $#whole )) && compadd -a whole
}
if [[ $zsh_eval_context[-1] == loadautofunc ]]; then _gobo "$@"; else compdef _gobo gobo; fi
)";

constexpr const char* kFish = R"(# fish completion of gobo; made by `gobo completion fish`
function __gobo_complete
    set -l words (commandline -opc)
    set -l current (commandline -ct)
    for line in ($words[1] __complete $words[2..-1] "$current" 2>/dev/null)
        switch $line
            case ':file'
                __fish_complete_path "$current"
            case ':dir'
                __fish_complete_directories "$current"
            case '*'
                echo $line
        end
    end
end
complete -c gobo -f -a '(__gobo_complete)'
)";

}  // namespace

std::vector<std::string> complete(const std::vector<std::string>& given) {
  const std::vector<std::string> words = given.empty() ? std::vector<std::string>{""} : given;
  const CommandLine line;
  const Context c = read(line.app, words);
  const std::string& typed = words.back();
  if (c.pending) {
    Candidates out(typed);
    offerValue(c.pending->get_type_name(), c, out);
    return out.lines;
  }
  if (const size_t equals = typed.find('='); typed.rfind("--", 0) == 0 && equals != std::string::npos) {  // --camera=fr
    const CLI::Option* o = findOption(c.app, typed.substr(0, equals));
    if (!o) return {};
    Candidates value(typed.substr(equals + 1));
    offerValue(o->get_type_name(), c, value);
    for (std::string& l : value.lines)
      if (l[0] != ':') l = typed.substr(0, equals + 1) + l;
    return value.lines;
  }
  Candidates out(typed);
  if (!typed.empty() && typed[0] == '-') {
    for (const CLI::App* app = c.app; app; app = app->get_parent())
      for (const CLI::Option* o : app->get_options())
        for (const std::string& name : o->get_lnames()) out.add("--" + name, o->get_description());
    return out.lines;
  }
  if (c.positionals.empty())
    for (const CLI::App* sub : c.app->get_subcommands([](const CLI::App*) { return true; })) out.add(sub->get_name(), sub->get_description());
  size_t index = 0;
  for (const CLI::Option* o : c.app->get_options()) {
    if (o->nonpositional()) continue;
    const bool many = o->get_items_expected_max() > 1;
    if (index++ == c.positionals.size() || (many && index <= c.positionals.size())) offerValue(o->get_type_name(), c, out);
  }
  return out.lines;
}

Result<std::string> completionScript(const std::string& shell) {
  if (shell == "bash") return std::string(kBash);
  if (shell == "zsh") return std::string(kZsh);
  if (shell == "fish") return std::string(kFish);
  return invalidArgument("completion " + shell + ": must be bash, zsh or fish");
}

}  // namespace gobo::cli
