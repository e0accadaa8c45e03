// SPDX-License-Identifier: Apache-2.0
#include "server/upload.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <memory>

namespace gobo::upload_test {
namespace {

namespace fs = std::filesystem;

class Upload : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "gobo-upload-test-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    tmp = pattern;
  }
  void TearDown() override { fs::remove_all(tmp); }
  static v1::UploadSceneRequest first(uint64_t total, const std::string& sha = "") {
    v1::UploadSceneRequest m;
    m.set_extension(".glb");
    m.set_total_bytes(total);
    m.set_sha256(sha);
    return m;
  }
  bool empty() const { return fs::directory_iterator(tmp) == fs::directory_iterator(); }
  std::string tmp;
};

TEST_F(Upload, WholeFileThenNothingIsLeft) {
  {
    UploadFile file;
    ASSERT_TRUE(file.begin(tmp, first(6, sha256Hex("abcdef", 6)), 100).ok());
    ASSERT_TRUE(file.add("abc").ok());
    ASSERT_TRUE(file.add("").ok());
    ASSERT_TRUE(file.add("def").ok());
    ASSERT_TRUE(file.finish().ok());
    std::ifstream in(file.path());
    std::string text;
    in >> text;
    EXPECT_EQ(text, "abcdef");
    EXPECT_EQ(fs::path(file.path()).extension(), ".glb");
    struct stat info {};
    ASSERT_EQ(::stat(fs::path(file.path()).parent_path().c_str(), &info), 0);
    EXPECT_EQ(info.st_mode & 0777, 0700u);
  }
  EXPECT_TRUE(empty());
}

TEST_F(Upload, WrongBytesAreRefused) {
  {
    UploadFile file;
    ASSERT_TRUE(file.begin(tmp, first(3, sha256Hex("abc", 3)), 100).ok());
    ASSERT_TRUE(file.add("abd").ok());
    const Status status = file.finish();
    EXPECT_EQ(status.code(), Code::InvalidArgument);
    EXPECT_NE(status.message().find(sha256Hex("abd", 3)), std::string::npos);
  }
  {
    UploadFile file;
    ASSERT_TRUE(file.begin(tmp, first(3), 100).ok());
    EXPECT_EQ(file.add("abcd").code(), Code::InvalidArgument);
  }
  {
    UploadFile file;
    ASSERT_TRUE(file.begin(tmp, first(3), 100).ok());
    ASSERT_TRUE(file.add("ab").ok());
    EXPECT_EQ(file.finish().code(), Code::InvalidArgument);
  }
  EXPECT_TRUE(empty());
}

TEST_F(Upload, FirstMessageIsChecked) {
  const auto code = [&](const v1::UploadSceneRequest& m) { return UploadFile().begin(tmp, m, 100).code(); };
  EXPECT_EQ(code(first(101)), Code::ResourceExhausted);
  EXPECT_EQ(code(first(0)), Code::InvalidArgument);
  EXPECT_EQ(code(first(5, "xyz")), Code::InvalidArgument);
  v1::UploadSceneRequest m = first(5);
  m.set_extension("/../../etc/x.glb");
  EXPECT_EQ(code(m), Code::InvalidArgument);
  m.set_extension(".exe");
  EXPECT_EQ(code(m), Code::InvalidArgument);
  m.set_extension(".GLB");
  EXPECT_EQ(code(m), Code::Ok);
  EXPECT_TRUE(empty());
}

TEST_F(Upload, LeftoversOfDeadProcessesGoAway) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ASSERT_EQ(::waitpid(child, nullptr, 0), child);  // now nobody has this id
  fs::create_directory(tmp + "/gobo-upload-" + std::to_string(child) + "-aaaaaa");
  fs::create_directory(tmp + "/gobo-worker-" + std::to_string(child) + "-cccccc");
  fs::create_directory(tmp + "/gobo-upload-" + std::to_string(::getpid()) + "-bbbbbb");
  fs::create_directory(tmp + "/other");
  removeStaleUploads(tmp);
  EXPECT_FALSE(fs::exists(tmp + "/gobo-upload-" + std::to_string(child) + "-aaaaaa"));
  EXPECT_FALSE(fs::exists(tmp + "/gobo-worker-" + std::to_string(child) + "-cccccc"));
  EXPECT_TRUE(fs::exists(tmp + "/gobo-upload-" + std::to_string(::getpid()) + "-bbbbbb"));
  EXPECT_TRUE(fs::exists(tmp + "/other"));
}

}  // namespace
}  // namespace gobo::upload_test
