// SPDX-License-Identifier: Apache-2.0
// What a suite's file may say, and what each mistake is told.
#include "regress/suite.h"

#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>

namespace gobo::cli {
namespace {

namespace fs = std::filesystem;

class SuiteFile : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(::testing::TempDir()) / ("suite-" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  Result<Suite> read(const std::string& text) {
    std::ofstream(path()) << text;
    return readSuite(path());
  }
  std::string path() const { return (folder_ / "s.toml").string(); }
  /// The message without the folder.
  std::string said(const std::string& text) {
    const Status status = read(text).status();
    EXPECT_EQ(status.code(), Code::InvalidArgument) << text;
    std::string message = status.message();
    for (size_t at; (at = message.find(folder_.string() + "/")) != std::string::npos;) message.erase(at, folder_.string().size() + 1);
    return message;
  }
  fs::path folder_;
};

const std::string kCase = "[[case]]\nname = \"a\"\nscene = \"cornell\"\n";

TEST_F(SuiteFile, EveryKey) {
  std::ofstream(folder_ / "x.glb") << "here";
  const auto suite = read(
      "[suite]\nname = \"night\"\nreferences = \"refs\"\n"
      "[[case]]\nname = \"a\"\nscene = \"x.glb\"\nsize = \"64x48\"\nspp = 4\nseed = 3\nparts = 12\ntolerance = 0.01\noutput = \"direct\"\n"
      "max_time = 2\nmax_rays = 1.1\nset = [\"integrator.max_bounces=2\", \"lights.key.gain=1,1,0.5\"]\n" +
      std::string("[[case]]\nname = \"b\"\nscene = \"cornell\"\n"));
  ASSERT_TRUE(suite.ok()) << suite.status().toString();
  EXPECT_EQ(suite->name, "night");
  EXPECT_EQ(suite->references, (folder_ / "refs").string());
  ASSERT_EQ(suite->cases.size(), 2u);
  const RegressCase& a = suite->cases[0];
  EXPECT_EQ(a.scene, (folder_ / "x.glb").string());
  EXPECT_EQ(a.request.width(), 64u);
  EXPECT_EQ(a.request.height(), 48u);
  EXPECT_EQ(a.request.halt().spp(), 4u);
  EXPECT_EQ(a.request.integrator().max_bounces(), 2u);
  EXPECT_FLOAT_EQ(a.request.lights().at("key").gain().z(), 0.5f);
  EXPECT_EQ(a.request.outputs(0), "direct");
  EXPECT_EQ(a.seed, 3u);
  EXPECT_EQ(a.parts, 12u);
  EXPECT_EQ(a.tolerance, 0.01);
  EXPECT_EQ(a.maxTime, 2);
  EXPECT_EQ(a.maxRays, 1.1);
  EXPECT_EQ(a.line, 4);
  EXPECT_EQ(suite->cases[1].parts, 8u);
  EXPECT_EQ(suite->cases[1].request.outputs(0), "beauty");
}

TEST_F(SuiteFile, NamesOfItsOwn) {
  const auto suite = read(kCase);
  ASSERT_TRUE(suite.ok());
  EXPECT_EQ(suite->name, "s");
  EXPECT_EQ(suite->references, (folder_ / "references").string());
}

TEST_F(SuiteFile, EnvironmentsAreRelativeToTheSuite) {
  fs::create_directories(folder_ / "maps");
  std::ofstream(folder_ / "maps" / "sky.hdr") << "here";
  const auto under = [](const std::string& name, const std::string& map) {
    return "[[case]]\nname = \"" + name + "\"\nscene = \"cornell\"\nset = [\"environment.path=" + map + "\"]\n";
  };
  const auto suite = read(under("a", "maps/sky.hdr") + under("b", "none") + under("c", "/far/away.hdr"));
  ASSERT_TRUE(suite.ok()) << suite.status().toString();
  EXPECT_EQ(suite->cases[0].environment, (folder_ / "maps" / "sky.hdr").string());
  EXPECT_EQ(suite->cases[0].request.environment().path(), "maps/sky.hdr");
  EXPECT_EQ(suite->cases[1].environment, "");
  EXPECT_EQ(suite->cases[1].request.environment().path(), "none");
  EXPECT_EQ(suite->cases[2].environment, "");  // perhaps the server's
  const std::string absent = said(kCase + "set = [\"environment.path=nonesuch.hdr\"]\n");
  EXPECT_EQ(absent.substr(0, 10), "s.toml:4: ");
  EXPECT_NE(absent.find("environment.path: no such file: \"nonesuch.hdr\""), std::string::npos) << absent;
}

TEST_F(SuiteFile, Mistakes) {
  EXPECT_EQ(said("[[case]]\nname = \"x\"\nscene = \"cornell\"\nsize = \"8192x4096\"\n"),
            "s.toml:4: [[case]] size = '8192x4096': times 8 parts must be at most 67108864 pixels: that many are compared at once");
  EXPECT_EQ(said(""), "s.toml: names nothing to render: it has no [[case]]");
  EXPECT_EQ(said("[suite]\nname = \"x\"\n"), "s.toml: names nothing to render: it has no [[case]]");
  EXPECT_EQ(said("case = []\n"), "s.toml:1: suite case = []: must be tables, [[case]]");
  EXPECT_EQ(said("[suite]\nnmae = \"x\"\n" + kCase), "s.toml:2: [suite]: unknown key \"nmae\" = 'x'; did you mean 'name'?");
  EXPECT_EQ(said("colour = 3\n" + kCase), "s.toml:1: suite: unknown key \"colour\" = 3");
  EXPECT_EQ(said(kCase + "sp = 4\n").substr(0, 44), "s.toml:4: [[case]]: unknown key \"sp\" = 4; di");
  EXPECT_EQ(said("[[case]]\nscene = \"cornell\"\n"), "s.toml:1: [[case]]: name is missing");
  EXPECT_EQ(said("[[case]]\nname = \"a\"\n"), "s.toml:1: [[case]]: scene is missing");
  EXPECT_EQ(said("[[case]]\nname = \"../a\"\nscene = \"cornell\"\n").substr(0, 37), "s.toml:2: [[case]] name = '../a': mus");
  EXPECT_EQ(said("[[case]]\nname = \"a\"\nscene = \"none.glb\"\n"), "s.toml:3: [[case]] scene = 'none.glb': no such file: \"none.glb\"");
  EXPECT_EQ(said(kCase + "size = \"64\"\n").substr(0, 33), "s.toml:4: [[case]] size = '64': m");
  EXPECT_EQ(said(kCase + "size = \"0x4\"\n").substr(0, 34), "s.toml:4: [[case]] size = '0x4': m");
  EXPECT_EQ(said(kCase + "spp = 0\n"), "s.toml:4: [[case]] spp = 0: must be in 1..1048576");
  EXPECT_EQ(said(kCase + "spp = \"4\"\n"), "s.toml:4: [[case]] spp = '4': must be an integer");
  EXPECT_EQ(said(kCase + "parts = 4\n"), "s.toml:4: [[case]] parts = 4: must be 1 (a picture without noise) or 8 to 16");
  EXPECT_EQ(said(kCase + "tolerance = nan\n"), "s.toml:4: [[case]] tolerance = nan: must be in 0..1");
  EXPECT_EQ(said(kCase + "set = \"a=1\"\n"), "s.toml:4: [[case]] set = 'a=1': must be an array of strings");
  EXPECT_EQ(said(kCase + "set = [\"halt.spp=4\"]\n").substr(0, 78), "s.toml:4: [[case]] set = [ 'halt.spp=4' ]: \"halt.spp=4\": halt is the case's ow");
  EXPECT_NE(said(kCase + "set = [\"integrator.max_bonces=4\"]\n").find("max_bonces"), std::string::npos);
  EXPECT_EQ(said(kCase + kCase), "s.toml:5: [[case]] name = 'a': the case of line 1 has this name");
  EXPECT_EQ(said(kCase + "spp = \n").substr(0, 9), "s.toml:4:");
  EXPECT_EQ(readSuite((folder_ / "none.toml").string()).status().code(), Code::NotFound);
}

TEST_F(SuiteFile, Ranges) {
  EXPECT_TRUE(read(kCase + "spp = 1048576\nseed = 72057594037927936\nparts = 16\ntolerance = 1\nmax_time = 0\nmax_rays = 1e6\nsize = \"16384x1\"\n").ok());
  EXPECT_EQ(said(kCase + "spp = 1048577\n"), "s.toml:4: [[case]] spp = 1048577: must be in 1..1048576");
  EXPECT_EQ(said(kCase + "seed = 72057594037927937\n"), "s.toml:4: [[case]] seed = 72057594037927937: must be in 0..72057594037927936");
  EXPECT_EQ(said(kCase + "seed = -1\n"), "s.toml:4: [[case]] seed = -1: must be in 0..72057594037927936");
  EXPECT_EQ(said(kCase + "parts = 17\n"), "s.toml:4: [[case]] parts = 17: must be in 1..16");
  EXPECT_EQ(said(kCase + "tolerance = -0.5\n"), "s.toml:4: [[case]] tolerance = -0.5: must be in 0..1");
  EXPECT_EQ(said(kCase + "tolerance = 1.5\n"), "s.toml:4: [[case]] tolerance = 1.5: must be in 0..1");
  EXPECT_EQ(said(kCase + "max_time = 1e7\n").substr(0, 31), "s.toml:4: [[case]] max_time = 1");
  for (const char* size : {"16385x1", "1x16385", "0x1", "1x0", "1x1x1", "4294967320x18", "-1x4"})
    EXPECT_NE(said(kCase + "size = \"" + size + "\"\n").find("must be WIDTHxHEIGHT"), std::string::npos) << size;
  EXPECT_EQ(said(kCase + "output = \"\"\n"), "s.toml:4: [[case]] output = '': must not be empty");
  EXPECT_NE(said(kCase + "set = [\"seed=4\"]\n").find("seed is the case's own"), std::string::npos);
}

TEST_F(SuiteFile, NamesThatAreFiles) {
  const auto named = [&](const std::string& name) { return "[[case]]\nname = \"" + name + "\"\nscene = \"cornell\"\n"; };
  EXPECT_TRUE(read(named(std::string(100, 'a'))).ok());
  EXPECT_TRUE(read(named("a-B_9.x")).ok());
  for (const std::string& name : {std::string(101, 'a'), std::string(".a"), std::string("a b"), std::string("a/b")})
    EXPECT_NE(said(named(name)).find("and name a file"), std::string::npos) << name;
}

}  // namespace
}  // namespace gobo::cli
