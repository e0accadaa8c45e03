// SPDX-License-Identifier: Apache-2.0
// The daemon has no parser of scenes in it: whatever a client sends or names is parsed by gobo-ingest, in its sandbox. Read from the program's
// dynamic section, so that a library which something pulls in one day is seen.
#include <gtest/gtest.h>

#include <cstdio>
#include <set>
#include <string>

namespace gobo {
namespace {

std::set<std::string> neededBy(const std::string& program) {
  std::set<std::string> names;
  FILE* out = ::popen(("readelf -d '" + program + "'").c_str(), "r");
  EXPECT_NE(out, nullptr);
  char line[512];
  while (out && std::fgets(line, sizeof line, out)) {
    const std::string text = line;
    const size_t open = text.find('['), dot = text.find(".so", open);
    if (text.find("(NEEDED)") != std::string::npos && dot != std::string::npos) names.insert(text.substr(open + 1, dot - open - 1));
  }
  if (out) ::pclose(out);
  return names;
}

TEST(Parsers, OfScenesAreNotInTheDaemon) {
  const auto daemon = neededBy(GOBOD_PATH);
  ASSERT_TRUE(daemon.count("libgrpc++") && daemon.count("libembree3")) << "the list was not read";
  for (const char* library : {"libtinygltf", "libdraco", "libmeshoptimizer", "libOpenImageIO"}) EXPECT_FALSE(daemon.count(library)) << library;
}

}  // namespace
}  // namespace gobo
