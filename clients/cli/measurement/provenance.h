// SPDX-License-Identifier: Apache-2.0
// Where figures come from: the machine, and the command that can be typed elsewhere. Any thread.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace gobo::cli {

struct Machine {
  std::string cpu;  ///< "AMD EPYC 7763 64-Core Processor"; empty: not known
  int cores = 0;    ///< physical ones; 0: not known
  int logicalCores = 0;
};
/// `cpuinfo` as Linux has it in /proc/cpuinfo.
Machine machineOf(const std::string& cpuinfo);
/// Of this machine. Nothing known where /proc/cpuinfo cannot be read.
Machine thisMachine();

/// One option or argument of a command line: its type as help names it ("FILE", "PATH=VALUE"), its name ("--csv"; empty for an argument), its value
/// (`hasValue` false: a flag).
struct CommandWord {
  std::string type, name, value;
  bool hasValue = true;
};
/// The command as a POSIX shell reads it, with folders of this machine left out: files and scenes become their names, and so do values of PATH=VALUE that begin
/// with '/', "./", "../" or '~'. Words that a shell would change are quoted.
std::string commandText(const std::string& program, const std::vector<CommandWord>& words);
/// A value that begins with '/', "./", "../" or '~' without its folders; of PATH=VALUE the value is meant. Other text as it is.
std::string withoutFolders(const std::string& text);
/// What is behind the last '/' of a path; other text as it is.
std::string fileName(const std::string& path);

}  // namespace gobo::cli
