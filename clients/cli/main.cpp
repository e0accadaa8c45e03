// SPDX-License-Identifier: Apache-2.0
// gobo: the command line client of gobod. `gobo man` and docs/protocol.md describe commands, exit codes and --set.
#include <cstdio>
#include <cstring>

#include "command_line.h"

int main(int argc, char** argv) {
  using namespace gobo::cli;
  if (argc > 1 && std::strcmp(argv[1], "__complete") == 0) {  // asked by the scripts of `gobo completion`
    for (const std::string& line : complete({argv + 2, argv + argc})) std::printf("%s\n", line.c_str());
    return kOk;
  }
  CommandLine line;
  try {
    line.app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (const std::string text = line.mistyped(e); !text.empty()) {
      std::fprintf(stderr, "gobo: %s\n", text.c_str());
      return kUsage;
    }
    return line.app.exit(e) == 0 ? kOk : kUsage;
  }
  watchInterrupts();
  return line.run();
}
