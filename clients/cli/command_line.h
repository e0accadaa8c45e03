// SPDX-License-Identifier: Apache-2.0
// CommandLine: every command, option and argument of gobo, declared once. Parsing, --help, the man page (manual.cpp) and shell
// completion (completion.cpp) are all made from `app`, so none of them can go stale. The type name of an option says what its
// value is ("SCENE", "FILE", "A|B|C", ...): it is shown by help and picks the completion.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "commands.h"

namespace gobo::cli {

class CommandLine {
 public:
  CommandLine();
  CommandLine(const CommandLine&) = delete;
  CommandLine& operator=(const CommandLine&) = delete;
  /// Runs the command that was parsed; exit code.
  int run();
  /// What to say of a command or an option that nobody knows: the name that was probably meant. Empty for other errors.
  std::string mistyped(const CLI::ParseError& error) const;

  CLI::App app;
  SessionOptions session;
  bool json = false, version = false;

 private:
  CLI::App* command(CLI::App& parent, const std::string& name, const std::string& help, std::function<int()> run);
  void addSession();
  void addRendering();
  void addScenes();
  void addServer();
  void addCache();
  void addJobs();
  void addMeasure();
  void addTools();
  void addRegress();

  std::vector<std::pair<CLI::App*, std::function<int()>>> commands_;
  RenderCommand render_;
  PrecomputeCommand precompute_;
  RelightCommand relight_;
  CompareCommand compare_;
  MeasureCommand measure_;
  OcclusionCommand occlusion_;
  EnvironmentCommand environment_;
  DemoCommand demo_;
  RegressCommand regress_;
  BisectCommand bisect_;
  ViewCommand view_;
  CacheCommand cache_;
  JobSubmitCommand submit_;
  JobFetchCommand fetch_;
  std::string source_, name_, scene_, shell_, job_;
  std::vector<std::string> jobs_, states_, seriesNames_, sweeps_, withs_;
  JobLogCommand log_;
  std::string after_;
  bool none_ = false;
  std::string jobPriority_;
  bool disk_ = false;
};

/// What the shell should offer for `words` (the last one is being typed, perhaps empty): "candidate\tdescription" lines, or
/// ":file" and ":dir", which ask the shell for names of its own. Asks the server for at most 0.3 s; never fails.
std::vector<std::string> complete(const std::vector<std::string>& words);
/// A script for bash, zsh or fish that asks `gobo __complete`. Errors: InvalidArgument for other shells.
Result<std::string> completionScript(const std::string& shell);
/// gobo(1) as troff: commands and options from `app`, request fields from the schema.
std::string manual(const CLI::App& app);

/// Help of a field of the request, from the schema ("lights.*.intensity" style names are made by the callers).
struct FieldHelp {
  std::string path, type, text;
};
std::vector<FieldHelp> requestFields();
/// "A|B|C": names of an enum of the schema without the unspecified one.
std::string choices(const google::protobuf::EnumDescriptor* type);

}  // namespace gobo::cli
