// SPDX-License-Identifier: Apache-2.0
// JobSpec.out: what patterns mean and which are refused; files appear whole below out_folder and nowhere else.
#include <gtest/gtest.h>

#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <random>
#include <set>
#include <thread>

#include "server/jobs/job_out.h"
#include "server/jobs/job_spec.h"
#include "server/jobs/out_pattern.h"
#include "support/temp_folder.h"

namespace gobo::job_out_test {
namespace {

namespace fs = std::filesystem;

v1::JobSpec specOf(const std::string& out, std::vector<std::string> outputs = {"beauty"}, v1::Encoding::Format format = v1::Encoding::EXR) {
  v1::JobSpec s;
  s.set_name("my shot");
  s.set_out(out);
  for (const std::string& o : outputs) s.mutable_request()->add_outputs(o);
  s.mutable_request()->mutable_encoding()->set_format(format);
  return s;
}
Status checked(const v1::JobSpec& spec, const std::vector<int64_t>& frames = {1}) {
  GOBO_TRY(checkOutPattern(spec.out()));
  return checkOutPaths(spec, frames);
}
void refused(const Status& status, const std::string& why) {
  EXPECT_EQ(status.code(), Code::InvalidArgument) << status.toString();
  EXPECT_EQ(status.location(), "job.out");
  EXPECT_NE(status.message().find(why), std::string::npos) << status.message() << "\nwithout: " << why;
}

TEST(OutPattern, Variables) {
  const v1::JobSpec s = specOf("a/{name}/{job}.{frame:04}.{frame}.{output}.{ext}", {"beauty", "group:key"});
  EXPECT_TRUE(checked(s, {1, 2}).ok());
  EXPECT_EQ(outPath(s, "j-7", 12, "group:key"), "a/my_shot/j-7.0012.12.group_key.exr");
  EXPECT_EQ(outPath(s, "j-7", 123456, "beauty"), "a/my_shot/j-7.123456.123456.beauty.exr");
  EXPECT_EQ(outPath(s, "j-7", -3, "beauty"), "a/my_shot/j-7.-0003.-3.beauty.exr");
  EXPECT_EQ(outPath(specOf("{frame:09}.{ext}", {"beauty"}, v1::Encoding::JPEG), "j-1", 5, "beauty"), "000000005.jpg");
  v1::JobSpec unnamed = specOf("{name}.{ext}", {"beauty"}, v1::Encoding::RAW_HALF);
  unnamed.set_name("");
  unnamed.mutable_request()->set_scene("../up");
  EXPECT_EQ(outPath(unnamed, "j-1", 5, "beauty"), "_._up.raw");
}

TEST(OutPattern, WhatIsRefusedSaysWhy) {
  for (const auto& [pattern, why] : std::initializer_list<std::pair<const char*, const char*>>{{"/abs.exr", "is absolute"},
                                                                                               {"a//b.exr", "empty part"},
                                                                                               {"a/", "empty part"},
                                                                                               {"../x.exr", "part \"..\""},
                                                                                               {"a/../x.exr", "part \"..\""},
                                                                                               {"a/.", "part \".\""},
                                                                                               {"a/./x", "part \".\""},
                                                                                               {"{nme}.exr", "{nme} is none of"},
                                                                                               {"{frame:4}", "{frame:4} is none of"},
                                                                                               {"{frame:00}", "{frame:00} is none of"},
                                                                                               {"{frame:010}", "{frame:010} is none of"},
                                                                                               {"{}", "{} is none of"},
                                                                                               {"{name", "a { without its }"},
                                                                                               {"name}", "a } without its {"},
                                                                                               {"a\nb", "control character"},
                                                                                               {"a\x7f", "control character"}})
    refused(checkOutPattern(pattern), why);
  refused(checkOutPattern(std::string("a\0b", 3)), "control character");
  refused(checkOutPattern(std::string(1001, 'x')), "1001 bytes: at most 1000");
  refused(checkOutPattern(std::string(256, 'x')), "a name of 256 bytes");
  EXPECT_TRUE(checkOutPattern(std::string(255, 'x')).ok());
  for (const char* fine : {"", "x", "..x", "x..", ".x/y", "a b/\xc3\xa4.exr", "...", "{name}{job}"}) EXPECT_TRUE(checkOutPattern(fine).ok()) << fine;
}

TEST(OutPattern, EachFileHasAPathOfItsOwn) {
  refused(checked(specOf("{name}.exr"), {1, 2}), "has no {frame}, and the job has 2 frames");
  EXPECT_TRUE(checked(specOf("{name}.exr")).ok());
  refused(checked(specOf("{name}.{frame}.exr", {"beauty", "depth"}), {1, 2}), "has no {output}, and each frame has 2 files");
  v1::JobSpec layers = specOf("{name}.{frame}.exr", {"beauty", "depth"});
  layers.mutable_request()->mutable_encoding()->set_layers(true);
  EXPECT_TRUE(checked(layers, {1, 2}).ok()) << "one file has them all";
  EXPECT_EQ(outPath(specOf("{output}"), "j-1", 1, "layers"), "layers");
  refused(checked(specOf("{output}", {"group:a", "group_a"})), "two files of the job would both be group_a");
  refused(checked(specOf("{frame}{output}", {"group", "1group"}), {1, 11}), "two files of the job would both be 11group");
  EXPECT_TRUE(checked(specOf("{frame}.{output}", {"group", "1group"}), {1, 11}).ok());
  v1::JobSpec longName = specOf("{name}{name}");
  longName.set_name(std::string(200, 'n'));
  refused(checked(longName), "a name of 400 bytes");
  v1::JobSpec longPath = specOf("{name}/{name}/{name}/{name}/{name}/{name}");
  longPath.set_name(std::string(200, 'n'));
  refused(checked(longPath), "a path of 1205 bytes");
}

TEST(OutPattern, TheExtensionIsThatOfTheEncoding) {
  refused(checked(specOf("x.exr", {"beauty"}, v1::Encoding::PNG)), "ends in .exr, but encoding.format is PNG");
  refused(checked(specOf("x.PNG")), "ends in .png, but encoding.format is EXR");
  refused(checked(specOf("x.tif")), "ends in .tif");
  EXPECT_TRUE(checked(specOf("x.jpeg", {"beauty"}, v1::Encoding::JPEG)).ok());
  EXPECT_TRUE(checked(specOf("x.exr/y", {"beauty"}, v1::Encoding::PNG)).ok()) << "a folder";
  EXPECT_TRUE(checked(specOf("x.final", {"beauty"}, v1::Encoding::PNG)).ok());
}

// No two files of an accepted job share a path, and all stay below the folder: random patterns against a set of the expanded paths. Seed 7.
TEST(OutPattern, AcceptedOnesNeverCollide) {
  std::mt19937 random(7);
  const std::vector<std::string> words{"{name}", "{job}", "{frame}", "{frame:02}", "{output}", "{ext}", "/", "..", ".", "1", "-", "x", "{", "}"};
  int accepted = 0;
  for (int i = 0; i < 4000; ++i) {
    std::string pattern;
    for (uint32_t n = 1 + random() % 6; n > 0; --n) pattern += words[random() % words.size()];
    const v1::JobSpec s = specOf(pattern, {"beauty", "1", "group:1", "-1"});
    const std::vector<int64_t> frames{-11, -1, 0, 1, 11, 100};
    std::set<std::string> paths;
    bool collide = false;
    if (!checkOutPattern(pattern).ok()) continue;
    for (int64_t f : frames)
      for (const std::string& o : s.request().outputs()) {
        const std::string path = outPath(s, "j-9", f, o);
        const fs::path below = fs::path("/out") / path;
        EXPECT_EQ(below.lexically_normal(), below) << path;
        EXPECT_EQ(below.string().rfind("/out/", 0), 0u) << path;
        collide = collide || !paths.insert(path).second;
      }
    if (checkOutPaths(s, frames).ok()) {
      ++accepted;
      EXPECT_FALSE(collide) << pattern;
    } else {
      EXPECT_TRUE(collide) << pattern << " was refused without need";
    }
  }
  EXPECT_GT(accepted, 30);
}

struct Written : ::testing::Test {
  test::TempFolder temp;
  std::string folder = temp.path + "/out";
  JobOut out;
  void SetUp() override {
    fs::create_directory(folder);
    out.open(folder);
  }
  static std::vector<uint8_t> bytes(const std::string& text) { return {text.begin(), text.end()}; }
  static std::string text(const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  size_t entries() const {
    size_t n = 0;
    for ([[maybe_unused]] const auto& e : fs::recursive_directory_iterator(folder)) ++n;
    return n;
  }
};

TEST_F(Written, FoldersAreMadeAndFilesReplaced) {
  ASSERT_TRUE(out.write("a/b/c.exr", bytes("one")).ok());
  EXPECT_EQ(text(folder + "/a/b/c.exr"), "one");
  ASSERT_TRUE(out.write("a/b/c.exr", bytes("two, longer")).ok());
  EXPECT_EQ(text(folder + "/a/b/c.exr"), "two, longer");
  ASSERT_TRUE(out.write("d.exr", bytes("")).ok());
  EXPECT_EQ(entries(), 4u) << "no temp file stays";
}

TEST_F(Written, NothingIsWrittenThroughALink) {
  fs::create_directory(temp.path + "/elsewhere");
  fs::create_directory(folder + "/real");
  fs::create_directory_symlink(temp.path + "/elsewhere", folder + "/link");
  fs::create_directory_symlink("real", folder + "/inner");
  for (const char* path : {"link/x.exr", "link/deep/x.exr", "inner/x.exr"}) {
    const Status status = out.write(path, bytes("x"));
    EXPECT_EQ(status.code(), Code::Unavailable) << path << " " << status.toString();
    EXPECT_NE(status.message().find("is a symbolic link"), std::string::npos) << status.message();
  }
  EXPECT_TRUE(fs::is_empty(temp.path + "/elsewhere"));
  // A link in the file's own place is replaced, not followed.
  std::ofstream(temp.path + "/victim") << "mine";
  fs::create_symlink(temp.path + "/victim", folder + "/real/x.exr");
  ASSERT_TRUE(out.write("real/x.exr", bytes("new")).ok());
  EXPECT_EQ(text(temp.path + "/victim"), "mine");
  EXPECT_FALSE(fs::is_symlink(folder + "/real/x.exr"));
  EXPECT_EQ(text(folder + "/real/x.exr"), "new");
}

TEST_F(Written, FaultsNameThePath) {
  std::ofstream(folder + "/file") << "x";
  Status status = out.write("file/x.exr", bytes("x"));
  EXPECT_FALSE(status.ok());
  EXPECT_NE(status.message().find(folder + "/file"), std::string::npos) << status.message();
  fs::create_directory(folder + "/x.exr");
  status = out.write("x.exr", bytes("x"));
  EXPECT_NE(status.message().find(folder + "/x.exr"), std::string::npos) << status.message();
  EXPECT_NE(status.code(), Code::FailedPrecondition) << "or the report would not be repeated";
  EXPECT_EQ(entries(), 2u);
  out.open(temp.path + "/gone");
  status = out.write("x.exr", bytes("x"));
  EXPECT_NE(status.message().find(temp.path + "/gone"), std::string::npos) << status.message();
  EXPECT_FALSE(fs::exists(temp.path + "/gone")) << "the folder itself is the administrator's to make";
}

TEST_F(Written, AFaultAtAnyStepLeavesTheOldFileOrTheNewOne) {
  ASSERT_TRUE(out.write("a/x.exr", bytes("old")).ok());
  for (const char* at : {"write", "sync", "rename", "sync-folder"}) {
    out.step = [&](const char* step, const std::string&) { return std::string(step) == at ? Status(Code::ResourceExhausted, "disk full") : Status(); };
    EXPECT_EQ(out.write("a/x.exr", bytes("new")).code(), Code::ResourceExhausted);
    EXPECT_EQ(text(folder + "/a/x.exr"), std::string(at) == "sync-folder" ? "new" : "old") << at;
    EXPECT_EQ(entries(), 2u) << at;
  }
}

TEST_F(Written, ReadersNeverSeeHalfAFile) {
  const std::string one(300000, '1'), two(400000, '2');
  ASSERT_TRUE(out.write("x.exr", bytes(one)).ok());
  std::atomic<bool> stop{false};
  std::atomic<int> wrong{0}, reads{0};
  std::thread reader([&] {
    while (!stop) {
      const std::string seen = text(folder + "/x.exr");
      wrong += seen != one && seen != two;
      ++reads;
    }
  });
  for (int i = 0; i < 20 || reads < 20; ++i) ASSERT_TRUE(out.write("x.exr", bytes(i % 2 ? one : two)).ok());
  stop = true;
  reader.join();
  EXPECT_EQ(wrong, 0);
}

}  // namespace
}  // namespace gobo::job_out_test
