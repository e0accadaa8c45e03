// SPDX-License-Identifier: Apache-2.0
#include "server/upload.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <vector>

#include "server/file_store.h"

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

TEST_F(Upload, FoldersOfALivingDaemonStayAndThoseOfADeadOneGoWhateverItsNumber) {
  {
    UploadFile file;
    ASSERT_TRUE(file.begin(tmp, first(6, sha256Hex("abcdef", 6)), 100).ok());
    ASSERT_TRUE(file.add("abc").ok());
    auto worker = ScratchFolder::make(tmp, kWorkerFolder);
    ASSERT_TRUE(worker.ok()) << worker.status().toString();
    // Their copies are what a daemon that was killed leaves: this process has their number, too, and nobody holds their locks.
    const fs::path living[] = {fs::path(file.path()).parent_path(), (*worker)->path()};
    std::vector<fs::path> dead;
    for (const fs::path& folder : living) {
      std::string name = folder.filename().string();
      name.back() = name.back() == '0' ? '1' : '0';
      dead.push_back(fs::path(tmp) / name);
      fs::copy(folder, dead.back(), fs::copy_options::recursive);
      fs::create_directories(dead.back() / "trees/a");
      std::ofstream(dead.back() / "trees/a/b") << "b";
    }
    removeStaleUploads(tmp);
    for (const fs::path& folder : living) EXPECT_TRUE(fs::exists(folder)) << folder;
    for (const fs::path& folder : dead) EXPECT_FALSE(fs::exists(folder)) << folder;
    ASSERT_TRUE(file.add("def").ok());
    EXPECT_TRUE(file.finish().ok());
  }
  EXPECT_TRUE(empty());
}

TEST_F(Upload, FoldersWithoutALockGoIfTheyAreEmptyAndOurs) {
  const std::string digits(32, 'a');
  const auto path = [&](const char* name) { return fs::path(tmp) / (name + digits); };
  fs::create_directory(path("gobo-upload-x"));  // killed before it had its lock
  fs::create_directory(path("gobo-worker-x"));
  std::ofstream(path("gobo-worker-x") / "file") << "of one that may live";
  const char* const others[] = {"gobo-upload-", "gobo-upload-xa", "gobo-upload-x-"};
  for (const char* name : others) fs::create_directory(path(name));
  fs::create_directory_symlink(path("gobo-worker-x"), tmp + "/gobo-upload-x" + std::string(32, 'b'));
  removeStaleUploads(tmp);
  EXPECT_FALSE(fs::exists(path("gobo-upload-x")));
  EXPECT_TRUE(fs::exists(path("gobo-worker-x") / "file"));
  for (const char* name : others) EXPECT_TRUE(fs::exists(path(name))) << name;
  EXPECT_TRUE(fs::exists(tmp + "/gobo-upload-x" + std::string(32, 'b')));
}

TEST_F(Upload, EarlierVersionsLeaveFoldersOfThisOneAlone) {
  const auto folder = ScratchFolder::make(tmp, kUploadFolder);
  ASSERT_TRUE(folder.ok()) << folder.status().toString();
  const std::string name = fs::path((*folder)->path()).filename().string();
  EXPECT_EQ(std::atol(name.c_str() + std::strlen(kUploadFolder)), 0) << name << ": they would take it for the number of a process";
}

TEST_F(Upload, FilesThatWerePutWithoutAFolderStayWhileTheirStoreLives) {
  FileStoreOptions options;
  options.tmpFolder = tmp;
  auto store = FileStore::open(options);
  ASSERT_TRUE(store.ok()) << store.status().toString();
  {
    auto writer = (*store)->begin("", sha256Hex("abcdef", 6), 6, 0);
    ASSERT_TRUE(writer.ok()) << writer.status().toString();
    ASSERT_TRUE((*writer)->add("abcdef").ok() && (*writer)->finish().ok());
  }
  removeStaleUploads(tmp);
  EXPECT_TRUE((*store)->tree("", {{"a.bin", sha256Hex("abcdef", 6)}}, "field").ok());
  store->reset();
  EXPECT_TRUE(empty());
}

TEST_F(Upload, ErrorsNameTheFolder) {
  const auto folder = ScratchFolder::make(tmp + "/none", kUploadFolder);
  ASSERT_FALSE(folder.ok());
  EXPECT_NE(folder.status().message().find("\"" + tmp + "/none\""), std::string::npos) << folder.status().toString();
  UploadFile file;
  const Status status = file.begin(tmp + "/none", first(6), 100);
  EXPECT_EQ(status.code(), Code::Internal);
  EXPECT_NE(status.message().find(tmp + "/none"), std::string::npos) << status.toString();
}

}  // namespace
}  // namespace gobo::upload_test
