// SPDX-License-Identifier: Apache-2.0
// Whose fault the end of the sandboxed reader is, with a program in its place that ends as it is told: the file's while it is parsed,
// the server's before, a limit's where a limit ended it. And real readers that crash, by their probes.
#include "server/ingest_child.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "support/small_gltf.h"

namespace gobo::ingest_child_test {
namespace {

namespace fs = std::filesystem;

/// A program in place of gobo-ingest.
class FakeReader : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "gobo-reader-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    folder = pattern;
  }
  void TearDown() override { fs::remove_all(folder); }
  std::string put(const std::string& name, const std::string& text) {
    std::ofstream(folder + "/" + name, std::ios::binary) << text;
    return folder + "/" + name;
  }
  Status load(const std::string& script) {
    const std::string program = put("reader.sh", "#!/bin/sh\n" + script + "\n");
    ::chmod(program.c_str(), 0700);
    const int out = ::memfd_create("fake", MFD_CLOEXEC);
    const ingest::Job job{ingest::Task::Scene, put("scene.gltf", smallGltf("")), 1 << 20, 1 << 30, 1 << 30, 256ull << 20, 8 << 20, 1};
    const auto result = runIngest(*spawnedReaders(program), job, out, 20, {});
    ::close(out);
    EXPECT_FALSE(result.ok());
    return result.status();
  }
  std::string folder;
};

TEST_F(FakeReader, ACrashIsTheFilesFaultOnlyWhileItIsParsed) {
  const std::string note = "printf '\\007\\012\\000\\000\\000\\000\\000\\000\\000/images/12' >&3; ";
  for (const auto& [signal, name] : {std::pair{"SEGV", "SIGSEGV"}, {"ABRT", "SIGABRT"}, {"BUS", "SIGBUS"}, {"FPE", "SIGFPE"}, {"ILL", "SIGILL"}}) {
    const Status early = load("kill -" + std::string(signal) + " $$");
    EXPECT_EQ(early.code(), Code::Internal) << early.toString();
    EXPECT_NE(early.message().find("before it read the file"), std::string::npos) << early.toString();
    const Status parsing = load(note + "kill -" + signal + " $$");
    EXPECT_EQ(parsing.code(), Code::InvalidArgument) << parsing.toString();
    EXPECT_NE(parsing.message().find(name), std::string::npos) << parsing.toString();
    EXPECT_EQ(parsing.location(), folder + "/scene.gltf#/images/12");
  }
  EXPECT_EQ(load(note + "kill -KILL $$").code(), Code::ResourceExhausted);
  EXPECT_EQ(load(note + "kill -XCPU $$").code(), Code::ResourceExhausted);
  EXPECT_EQ(load(note + "kill -TERM $$").code(), Code::Unavailable);
  EXPECT_EQ(load(note + "exit 7").code(), Code::Internal);
}

TEST_F(FakeReader, OneThatCannotBeStartedIsTheServersFault) {
  const int out = ::memfd_create("fake", MFD_CLOEXEC);
  const ingest::Job job{ingest::Task::Scene, put("scene.gltf", smallGltf("")), 1 << 20, 1 << 30, 1 << 30, 256ull << 20, 8 << 20, 1};
  const auto result = runIngest(*spawnedReaders(folder + "/scene.gltf"), job, out, 20, {});  // exists, is no program
  ::close(out);
  EXPECT_EQ(result.status().code(), Code::Internal) << result.status().toString();
  EXPECT_NE(result.status().message().find("ingest.program"), std::string::npos);
}

}  // namespace
}  // namespace gobo::ingest_child_test
