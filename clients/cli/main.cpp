// SPDX-License-Identifier: Apache-2.0
// gobo: the command line client of gobod. `gobo man` and docs/protocol.md describe commands, exit codes and --set.
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iostream>

#include "command_line.h"

/// The exit code once all that was said is written: a full disk must not look like a success.
static int finished(int code) {
  const bool earlier = std::ferror(stdout);
  errno = 0;
  const bool written = std::fflush(stdout) == 0 && !earlier;
  if (written && std::cout.flush()) return code;
  if (earlier && ::write(STDOUT_FILENO, "\n", 1) == 1) errno = 0;  // why it failed then: what follows most likely fails alike
  std::fprintf(stderr, "gobo: cannot write to standard output%s%s\n", errno ? ": " : "", errno ? std::strerror(errno) : "");
  return code == gobo::cli::kOk ? int(gobo::cli::kFailure) : code;
}

int main(int argc, char** argv) {
  using namespace gobo::cli;
  if (argc > 1 && std::strcmp(argv[1], "__complete") == 0) {  // asked by the scripts of `gobo completion`
    for (const std::string& line : complete({argv + 2, argv + argc})) std::printf("%s\n", line.c_str());
    return finished(kOk);
  }
  CommandLine line;
  try {
    line.app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    if (const std::string text = line.mistyped(e); !text.empty()) {
      std::fprintf(stderr, "gobo: %s\n", text.c_str());
      return kUsage;
    }
    return finished(line.app.exit(e) == 0 ? kOk : kUsage);
  }
  watchInterrupts();
  return finished(line.run());
}
