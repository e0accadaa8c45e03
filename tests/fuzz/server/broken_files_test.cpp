// SPDX-License-Identifier: Apache-2.0
// Every broken file of ../shared/data through the daemon's loader and its sandboxed child: answered within the limits of CPU time
// and memory, by an error that blames the file and says where (the same as without a sandbox), or loaded with the fault named in
// a warning; and the loader is as before: no child, no descriptor left, the next good file loads. Every second file; all of them, each
// printed, with GOBO_FUZZ_TABLE=1.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "base/utf8.h"
#include "import/load.h"
#include "server/ingest_child.h"
#include "server/ingest_loader.h"
#include "server/log.h"
#include "support/readers_left.h"
#include "support/small_gltf.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;
const fs::path kData = "../shared/data";

class BrokenFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    setLogLevel(LogLevel::Off);
    std::string pattern = (fs::temp_directory_path() / "gobo-broken-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    folder = pattern;
    ASSERT_FALSE(findIngestProgram().empty()) << "gobo-ingest is not built";
    IngestOptions o;
    o.memoryBytes = 1ull << 30;
    o.cpuSeconds = 10;
    auto made = childLoader(o);
    ASSERT_TRUE(made.ok()) << made.status().toString();
    loader = *made;
    good = put("good.gltf", smallGltf(""));
    expectAlive("before");
    descriptors = countDescriptors();
  }
  void TearDown() override {
    if (loader) expectAlive("the end");
    EXPECT_EQ(countDescriptors(), descriptors);
    fs::remove_all(folder);
    std::cout << answered << " files: " << refused << " refused, " << warned << " loaded with a warning, " << loaded << " loaded without one, " << limited
              << " of the refusals by a limit; slowest answer " << int(slowest * 1000) << " ms (" << slowestFile << ")\n";
  }
  std::string put(const std::string& name, const std::string& text) {
    std::ofstream(folder + "/" + name, std::ios::binary) << text;
    return folder + "/" + name;
  }
  static size_t countDescriptors() { return size_t(std::distance(fs::directory_iterator("/proc/self/fd"), {})); }
  void expectAlive(const std::string& after) {
    const auto scene = loader->scene(good, {});
    EXPECT_TRUE(scene.ok()) << "after " << after << ": " << scene.status().toString();
  }
  static std::vector<fs::path> filesOf(const fs::path& root, const std::vector<std::string>& extensions) {
    std::vector<fs::path> out;
    for (const auto& e : fs::recursive_directory_iterator(root))
      if (e.is_regular_file() && (extensions.empty() || std::count(extensions.begin(), extensions.end(), e.path().extension().string())))
        out.push_back(e.path());
    std::sort(out.begin(), out.end());
    if (std::getenv("GOBO_FUZZ_TABLE")) return out;
    std::vector<fs::path> some;  // every second file in the ordinary run
    for (size_t i = 0; i < out.size(); i += 2) some.push_back(out[i]);
    return some;
  }
  template <typename Load>
  auto timed(const std::string& file, Load&& load) {
    const auto start = std::chrono::steady_clock::now();
    auto result = load();
    const double s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (s > slowest) {
      slowest = s;
      slowestFile = file;
    }
    ++answered;
    EXPECT_TRUE(noReaderIsLeft()) << file;
    if (answered % 50 == 0) expectAlive(file);
    return result;
  }
  void checkError(const Status& s, const std::string& file) {
    ++refused;
    const bool limit = s.code() == Code::ResourceExhausted;
    limited += limit;
    EXPECT_TRUE(s.code() != Code::Internal && s.code() != Code::Unknown && s.code() != Code::DataLoss) << s.toString();
    EXPECT_EQ(s.message().find("ingest.cpu_s"), std::string::npos) << s.toString();
    EXPECT_EQ(s.location().compare(0, file.size(), file), 0) << s.toString();
    EXPECT_FALSE(s.message().empty());
    EXPECT_TRUE(isUtf8(s.message()) && isUtf8(s.location()));
    row(file, s.toString());
  }
  static void row(const std::string& file, const std::string& said) {
    if (std::getenv("GOBO_FUZZ_TABLE")) std::cout << "| " << file << " | " << said.substr(0, 200) << " |" << std::endl;
  }
  void scene(const std::string& file) {
    const auto got = timed(file, [&] { return loader->scene(file, {}); });
    const auto direct = loadGltf(file);
    ASSERT_EQ(got.ok(), direct.ok()) << file << ": " << (got.ok() ? direct.status() : got.status()).toString();
    if (!got.ok()) {
      checkError(got.status(), file);
      EXPECT_EQ(got.status().toString(), direct.status().toString());
      return;
    }
    EXPECT_EQ(got->scene->hash(), (*direct)->hash()) << file;
    EXPECT_EQ(got->scene->warnings, (*direct)->warnings) << file;
    ++(got->scene->warnings.empty() ? loaded : warned);
    row(file, got->scene->warnings.empty() ? "loaded" : "warning: " + got->scene->warnings[0]);
  }
  void picture(const fs::path& file) {
    const auto map = timed(file, [&] { return loader->environment(file.string(), {}); });
    if (map.ok()) {
      ++loaded;
      row(file, "environment");
    } else checkError(map.status(), file.string());
    const std::string name = "picture" + file.extension().string();
    fs::copy_file(file, folder + "/" + name, fs::copy_options::overwrite_existing);
    ::chmod((folder + "/" + name).c_str(), 0600);
    const auto textured = timed(file, [&] { return loader->scene(put("textured.gltf", smallGltf(name)), {}); });
    if (!textured.ok()) {  // only a limit may cost the scene; a bad picture costs itself
      EXPECT_EQ(textured.status().code(), Code::ResourceExhausted) << file << ": " << textured.status().toString();
      ++refused;
      ++limited;
      return;
    }
    const auto& warnings = textured->scene->warnings;
    if (textured->scene->textures.empty()) { EXPECT_FALSE(warnings.empty()) << file << " is left out without a word"; }
    if (!map.ok()) { EXPECT_FALSE(warnings.empty() && !textured->scene->textures.empty()) << file << " is no environment, but a texture without a warning"; }
    ++(warnings.empty() ? loaded : warned);
    if (!warnings.empty()) { EXPECT_NE(warnings[0].find("/images/0"), std::string::npos) << warnings[0]; }
  }
  std::string folder, good, slowestFile;
  std::shared_ptr<SceneLoader> loader;
  size_t descriptors = 0, answered = 0, refused = 0, warned = 0, loaded = 0, limited = 0;
  double slowest = 0;
};

TEST_F(BrokenFiles, Gltf) {
  if (!fs::exists(kData / "gltf")) GTEST_SKIP() << "../shared/data/gltf is absent";
  size_t scenes = 0;
  for (const fs::path& file : filesOf(kData / "gltf/invalid", {".gltf", ".glb"})) {
    scene(file.string());
    ++scenes;
  }
  for (const fs::path& file : filesOf(kData / "gltf/validator-corpus", {".gltf", ".glb"})) {
    std::ifstream in(file.string() + ".report.json");
    const auto report = nlohmann::json::parse(in, nullptr, false);
    if (!report.is_discarded() && report["issues"].value("numErrors", 1) == 0) continue;
    scene(file.string());
    ++scenes;
  }
  EXPECT_GT(scenes, 20u);
  EXPECT_GT(refused, 8u);
}

TEST_F(BrokenFiles, Pictures) {
  if (!fs::exists(kData / "exr/damaged")) GTEST_SKIP() << "../shared/data/exr is absent";
  for (const char* corpus : {"exr/damaged", "images/oiio-corrupt"})
    for (const fs::path& file : filesOf(kData / corpus, {}))
      if (file.extension() != ".tsv" && file.extension() != ".rst" && file.extension() != ".md" && file.filename() != "LICENSE") picture(file);
  EXPECT_GT(refused, 8u);
}

}  // namespace
}  // namespace gobo
