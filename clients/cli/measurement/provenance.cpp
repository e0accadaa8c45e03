// SPDX-License-Identifier: Apache-2.0
#include "measurement/provenance.h"

#include <algorithm>
#include <fstream>
#include <set>
#include <sstream>

namespace gobo::cli {
namespace {

std::string quoted(const std::string& word) {
  const auto plain = [](unsigned char c) { return std::isalnum(c) || std::string("-_./:=,+@%").find(char(c)) != std::string::npos; };
  if (!word.empty() && std::all_of(word.begin(), word.end(), plain)) return word;
  std::string out = "'";
  for (const char c : word) out += c == '\'' ? "'\\''" : std::string(1, c);
  return out + "'";
}

bool isPath(const std::string& text) { return text.starts_with('/') || text.starts_with('~') || text.starts_with("./") || text.starts_with("../"); }

}  // namespace

Machine machineOf(const std::string& cpuinfo) {
  Machine out;
  std::set<std::pair<std::string, std::string>> cores;
  std::string package, line;
  std::istringstream lines(cpuinfo);
  while (std::getline(lines, line)) {
    const size_t colon = line.find(':');
    if (colon == std::string::npos) continue;
    const std::string key = line.substr(0, line.find_last_not_of(" \t", colon - 1) + 1);
    const size_t begin = line.find_first_not_of(" \t", colon + 1);
    const std::string value = begin == std::string::npos ? "" : line.substr(begin);
    if (key == "processor") ++out.logicalCores;
    else if (key == "model name" && out.cpu.empty()) out.cpu = value;
    else if (key == "physical id") package = value;
    else if (key == "core id") cores.emplace(package, value);
  }
  out.cores = int(cores.size());
  return out;
}

Machine thisMachine() {
  std::ifstream in("/proc/cpuinfo");
  std::ostringstream text;
  text << in.rdbuf();
  return machineOf(text.str());
}

std::string fileName(const std::string& path) {
  const size_t slash = path.find_last_of('/');
  return slash == std::string::npos ? path : path.substr(slash + 1);
}

std::string withoutFolders(const std::string& text) {
  const size_t equals = text.find('='), begin = equals == std::string::npos || isPath(text) ? 0 : equals + 1;
  return isPath(text.substr(begin)) ? text.substr(0, begin) + fileName(text) : text;
}

std::string commandText(const std::string& program, const std::vector<CommandWord>& words) {
  std::string out = program;
  for (const CommandWord& word : words) {
    if (!word.name.empty()) out += " " + word.name;
    const bool file = word.type == "FILE" || word.type == "FOLDER" || word.type == "SCENE";
    if (word.hasValue) out += " " + quoted(file ? fileName(word.value) : withoutFolders(word.value));
  }
  return out;
}

}  // namespace gobo::cli
