// SPDX-License-Identifier: Apache-2.0
// What a program links it pays for at every start: OpenImageIO's 230 libraries cost 0.4 s of processor.
#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <string>

namespace gobo::start_cost_test {
namespace {

/// Names of the libraries that the program loads when it starts, a line each.
std::string loadedAtStart(const std::filesystem::path& program) {
  std::string text;
  FILE* const pipe = ::popen(("LD_TRACE_LOADED_OBJECTS=1 '" + program.string() + "'").c_str(), "r");
  char line[4096];
  while (pipe && std::fgets(line, sizeof line, pipe)) text += line;
  if (pipe) ::pclose(pipe);
  return text;
}

TEST(StartCost, NoProgramLoadsPictureFormatsThatItMayNotNeed) {
  const std::filesystem::path daemon = GOBOD_PATH, build = daemon.parent_path().parent_path();
  for (const auto& program :
       {daemon, build / "clients/gobo", build / "ingest/gobo-ingest", std::filesystem::path(std::filesystem::read_symlink("/proc/self/exe"))}) {
    const std::string libraries = loadedAtStart(program);
    EXPECT_NE(libraries.find("libc.so"), std::string::npos) << program;
    EXPECT_EQ(libraries.find("OpenImageIO"), std::string::npos) << program;
    EXPECT_EQ(libraries.find("libgdal"), std::string::npos) << program;
  }
}

}  // namespace
}  // namespace gobo::start_cost_test
