// SPDX-License-Identifier: Apache-2.0
// Every kind of folder that may be found where files are believed, and what is said of it.
#include "base/own_folder.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>

namespace gobo::own_folder_test {
namespace {

namespace fs = std::filesystem;
constexpr uid_t kOther = 4711;

struct OwnFolder : ::testing::Test {
  std::string root;
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "gobo-own-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    root = pattern;
  }
  void TearDown() override { fs::remove_all(root); }
  std::string make(const std::string& name, mode_t mode, uid_t user = uid_t(-1), gid_t group = gid_t(-1)) const {
    const std::string path = root + "/" + name;
    ::mkdir(path.c_str(), 0700);
    if (::chown(path.c_str(), user, group) != 0) ADD_FAILURE() << "chown " << path;
    ::chmod(path.c_str(), mode);
    return path;
  }
};

TEST_F(OwnFolder, TableOfKinds) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can make folders of others";
  struct Case {
    const char* name;
    std::function<std::string()> make;
    const char* problem;
    const char* remedy;
  };  // problem null: trusted
  const auto link = [&](const std::string& to, const std::string& name, uid_t user) {
    const std::string path = root + "/" + name;
    ::symlink(to.c_str(), path.c_str());
    if (::lchown(path.c_str(), user, gid_t(-1)) != 0) ADD_FAILURE() << "lchown " << path;
    return path;
  };
  const std::vector<Case> cases = {
      {"0700", [&] { return make("a", 0700); }, nullptr, ""},
      {"0755", [&] { return make("b", 0755); }, nullptr, ""},
      {"0750 of a group", [&] { return make("c", 0750, 0, kOther); }, nullptr, ""},
      {"0777", [&] { return make("d", 0777); }, "others may write to it (mode 0777)", "chmod 0700"},
      {"0770", [&] { return make("e", 0770); }, "others may write to it (mode 0770)", "chmod 0700"},
      {"sticky 1777", [&] { return make("f", 01777); }, "others may write to it (mode 1777)", "chmod 0700"},
      {"another's", [&] { return make("g", 0700, kOther); }, "belongs to user 4711", "chown 0"},
      {"another's, 0777", [&] { return make("h", 0777, kOther); }, "belongs to user 4711", "chown 0"},
      {"own link to own", [&] { return link(make("i", 0700), "i-link", 0); }, nullptr, ""},
      {"own link to another's", [&] { return link(make("j", 0755, kOther), "j-link", 0); }, "belongs to user 4711", "chown"},
      {"another's link to own", [&] { return link(make("k", 0700), "k-link", kOther); }, "is a link of user 4711", "name the folder itself"},
      {"relative link",
       [&] {
         make("l", 0700);
         return link("l", "l-link", 0);
       },
       nullptr, ""},
      {"link that ends nowhere", [&] { return link("nowhere", "m-link", 0); }, "cannot make the folder", ""},
      {"links in a circle",
       [&] {
         link("n2", "n1", 0);
         return link("n1", "n2", 0);
       },
       "cannot make the folder", ""},
      {"under 0777",
       [&] {
         make("o", 0777);
         return make("o/x", 0700);
       },
       "which holds it", "chmod o-w"},
      {"under sticky 1777",
       [&] {
         make("p", 01777);
         return make("p/x", 0700);
       },
       nullptr, ""},
      {"under 0770 of a group",
       [&] {
         make("q", 0770, 0, kOther);
         return make("q/x", 0700);
       },
       "which holds it", "chmod g-w"},
      {"under 0770 of its own group",
       [&] {
         make("r", 0770);
         return make("r/x", 0700);
       },
       nullptr, ""},
      {"link to under 0777",
       [&] {
         make("s", 0777);
         return link(make("s/x", 0700), "s-link", 0);
       },
       "which holds it", "chmod o-w"},
      {"another's link in the middle",
       [&] {
         make("t", 0755);
         make("t/x", 0700);
         return link(root + "/t", "t-link", kOther) + "/x";
       },
       "is a link of user 4711", ""},
      {"a file",
       [&] {
         std::ofstream(root + "/u") << "x";
         return root + "/u";
       },
       "is not a folder", "name another"},
      {"under a file",
       [&] {
         std::ofstream(root + "/v") << "x";
         return root + "/v/x";
       },
       "cannot make the folder", ""},
      {"not there", [&] { return root + "/w/x/y"; }, nullptr, ""},
      {"with dots",
       [&] {
         make("z", 0700);
         return root + "/./z/../z/";
       },
       nullptr, ""},
  };
  for (const Case& c : cases) {
    const std::string path = c.make();
    const Status s = makeOwnFolder(path, "blob cache");
    if (!c.problem) {
      EXPECT_TRUE(s.ok()) << c.name << ": " << s.toString();
      continue;
    }
    EXPECT_NE(s.message().find(c.problem), std::string::npos) << c.name << ": " << s.toString();
    EXPECT_NE(s.message().find(c.remedy), std::string::npos) << c.name << ": " << s.toString();
    EXPECT_NE(s.message().find("blob cache"), std::string::npos) << s.toString();
    EXPECT_FALSE(s.location().empty()) << c.name;
    if (std::string(c.problem).rfind("cannot", 0) != 0) EXPECT_EQ(s.code(), Code::FailedPrecondition) << c.name << ": " << s.toString();
    else EXPECT_NE(s.code(), Code::FailedPrecondition) << c.name << ": " << s.toString();
  }
}

TEST_F(OwnFolder, IsMadeForThisUserAlone) {
  const mode_t before = ::umask(0);
  const Status s = makeOwnFolder(root + "/a/b", "cache");
  ::umask(before);
  ASSERT_TRUE(s.ok()) << s.toString();
  struct stat info {};
  ASSERT_EQ(::stat((root + "/a/b").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 07777, 0700u);
  ASSERT_EQ(::stat((root + "/a").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 07777, 0755u);
}

TEST_F(OwnFolder, AFileSystemThatTakesNoneIsNotATrustedFolderNorADistrustedOne) {
  const Status s = makeOwnFolder("/proc/gobo-cache", "cache");
  EXPECT_FALSE(s.ok());
  EXPECT_NE(s.code(), Code::FailedPrecondition);
  EXPECT_EQ(s.location(), "/proc/gobo-cache");
}

}  // namespace
}  // namespace gobo::own_folder_test
