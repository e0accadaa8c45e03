// SPDX-License-Identifier: Apache-2.0
// Files that clients put: whole or not at all, gone on with at every offset, each owner's his own, bounded, and nothing that is damaged is ever given out.
#include "server/file_store.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cctype>
#include <filesystem>
#include <fstream>
#include <map>
#include <thread>

#include "server/scratch.h"

namespace gobo::file_store_test {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kLeast = 64 << 10;  // that any file is charged

class Files : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "gobo-files-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    top = pattern;
    open();
  }
  void TearDown() override {
    store.reset();
    fs::remove_all(top);
  }
  void open() {
    store.reset();
    auto opened = FileStore::open(options());
    ASSERT_TRUE(opened.ok()) << opened.status().toString();
    store = *opened;
  }
  FileStoreOptions options() const { return {top + "/blobs", top, bytes, partSeconds}; }
  static std::string hash(const std::string& data) { return sha256Hex(data.data(), data.size()); }
  Status put(const std::string& data, const std::string& owner = "", uint64_t from = 0) {
    auto writer = store->begin(owner, hash(data), data.size(), from);
    if (!writer.ok()) return writer.status();
    GOBO_TRY((*writer)->add(data.substr(from)));
    return (*writer)->finish();
  }
  /// Sends the bytes up to `to` and breaks off.
  void part(const std::string& data, uint64_t from, uint64_t to, const std::string& owner = "") {
    auto writer = store->begin(owner, hash(data), data.size(), from);
    ASSERT_TRUE(writer.ok()) << writer.status().toString();
    ASSERT_TRUE((*writer)->add(data.substr(from, to - from)).ok());
  }
  bool has(const std::string& data, const std::string& owner = "") { return store->received(owner, hash(data), data.size()) == data.size(); }
  std::string read(const std::string& data, const std::string& owner = "") {
    auto tree = store->tree(owner, {{"a.bin", hash(data)}}, "field");
    if (!tree.ok()) return tree.status().toString();
    std::ifstream in((*tree)->path("a.bin"), std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  /// The one file on disk whose name begins with the data's digest.
  fs::path onDisk(const std::string& data) const {
    for (const auto& e : fs::recursive_directory_iterator(top))
      if (e.path().filename().string().rfind(hash(data), 0) == 0) return e.path();
    return {};
  }
  std::string top;
  uint64_t bytes = 64 << 20;
  double partSeconds = 86400;
  std::shared_ptr<FileStore> store;
};

TEST_F(Files, WhatIsPutIsThereForItsOwnerAloneAndAfterARestart) {
  EXPECT_FALSE(has("abcdef", "alice"));
  ASSERT_TRUE(put("abcdef", "alice").ok());
  for (int i = 0; i < 2; ++i) {
    EXPECT_TRUE(has("abcdef", "alice"));
    EXPECT_EQ(read("abcdef", "alice"), "abcdef");
    for (const char* other : {"", "bob", "Alice"}) {
      EXPECT_FALSE(has("abcdef", other));
      EXPECT_NE(read("abcdef", other).find("no such file of this caller's"), std::string::npos);
    }
    open();
  }
  EXPECT_EQ(store->received("alice", hash("abcdef"), 5), 0u) << "a file of another size is none";
  struct stat info {};
  ASSERT_EQ(::stat(onDisk("abcdef").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 077, 0u);
}

TEST_F(Files, BreaksOffAndGoesOnAtEveryOffset) {
  const std::string data = "0123456789abcdef";
  for (uint64_t cut = 0; cut <= data.size(); ++cut)
    for (const bool restart : {false, true}) {
      const std::string mine = data + std::to_string(cut) + (restart ? "r" : "");
      part(mine, 0, cut);
      if (restart) open();
      EXPECT_EQ(store->received("", hash(mine), mine.size()), cut);
      EXPECT_EQ(read(mine).find(mine), std::string::npos) << "half a file is given out";
      const auto beyond = store->begin("", hash(mine), mine.size(), cut + 1);
      EXPECT_EQ(beyond.status().code(), Code::OutOfRange);
      for (uint64_t from = cut; from-- > 0;) {  // some of it again
        part(mine, from, cut);
        EXPECT_EQ(store->received("", hash(mine), mine.size()), cut);
      }
      ASSERT_TRUE(put(mine, "", cut).ok());
      EXPECT_EQ(read(mine), mine);
    }
  EXPECT_EQ(store->stats().parts, 0u);
}

TEST_F(Files, IsSaidToBeThereOnlyOnceItCanBeOpened) {
  const std::string data(1000, 'x');
  {
    auto writer = store->begin("", hash(data), data.size(), 0);
    ASSERT_TRUE(writer.ok());
    ASSERT_TRUE((*writer)->add(data).ok());
    EXPECT_EQ(store->received("", hash(data), data.size()), 999u) << "not checked yet";
  }
  EXPECT_EQ(store->received("", hash(data), data.size()), 999u) << "broken off before its end";
  ASSERT_TRUE(put(data, "", 999).ok());
  EXPECT_TRUE(has(data));
  EXPECT_EQ(read(data), data);
}

TEST_F(Files, WrongBytesAreNeverKept) {
  const std::string data = "abcdef";
  {
    auto writer = store->begin("", hash(data), 6, 0);
    ASSERT_TRUE((*writer)->add("abcdeX").ok());
    const Status status = (*writer)->finish();
    EXPECT_EQ(status.code(), Code::InvalidArgument);
    EXPECT_NE(status.message().find(hash("abcdeX")), std::string::npos) << status.message();
  }
  EXPECT_EQ(store->received("", hash(data), 6), 0u);
  {  // the first half of another call
    part(data, 0, 3);
    std::ofstream(onDisk(data), std::ios::in | std::ios::out) << "X";
    const Status status = put(data, "", 3);
    EXPECT_EQ(status.code(), Code::InvalidArgument);
    EXPECT_NE(status.message().find("put it from 0"), std::string::npos) << status.message();
    EXPECT_EQ(store->received("", hash(data), 6), 0u);
  }
  {
    auto writer = store->begin("", hash(data), 6, 0);
    EXPECT_EQ((*writer)->add("abcdefg").code(), Code::InvalidArgument);
  }
  {
    auto writer = store->begin("", hash(data), 6, 0);
    ASSERT_TRUE((*writer)->add("abc").ok());
    const Status status = (*writer)->finish();
    EXPECT_EQ(status.code(), Code::InvalidArgument);
    EXPECT_NE(status.message().find("3 of put.blob.bytes = 6"), std::string::npos) << status.message();
  }
  EXPECT_EQ(store->received("", hash(data), 6), 3u) << "what arrived stays";
  EXPECT_EQ(store->begin("", hash(data), 0, 0).status().code(), Code::InvalidArgument);
  EXPECT_EQ(store->begin("", "abc", 6, 0).status().code(), Code::InvalidArgument);
  ASSERT_TRUE(put(data).ok());
  EXPECT_EQ(store->begin("", hash(data), 7, 0).status().code(), Code::InvalidArgument);
  auto again = store->begin("", hash(data), 6, 6);
  ASSERT_TRUE(again.ok());
  EXPECT_TRUE((*again)->there());
  EXPECT_TRUE((*again)->add("abc").ok()) << "who sends it all the same is let";
  EXPECT_TRUE((*again)->add("def").ok());
  EXPECT_EQ((*again)->add("g").code(), Code::InvalidArgument) << "but not for ever";
  EXPECT_TRUE((*again)->finish().ok());
}

TEST_F(Files, DamageIsFoundWhenAFileIsFirstUsedAndItCanBePutAgain) {
  for (const char* how : {"byte", "short", "gone"}) {
    const std::string data = std::string("data of ") + how;
    ASSERT_TRUE(put(data).ok());
    const fs::path file = onDisk(data);
    if (how == std::string("byte")) std::ofstream(file, std::ios::in | std::ios::out) << "D";
    if (how == std::string("short")) fs::resize_file(file, 3);
    if (how == std::string("gone")) fs::remove(file);
    open();
    EXPECT_NE(read(data).find("put it first"), std::string::npos) << how << ": " << read(data);
    EXPECT_FALSE(has(data)) << how;
    ASSERT_TRUE(put(data).ok()) << how;
    EXPECT_EQ(read(data), data);
  }
  EXPECT_EQ(store->stats().damaged, 0u) << "of this start";
}

TEST_F(Files, OneAtATimeAndTheOtherIsTold) {
  const std::string data = "abcdef";
  auto first = store->begin("", hash(data), 6, 0);
  ASSERT_TRUE(first.ok());
  EXPECT_EQ(store->begin("", hash(data), 6, 0).status().code(), Code::Aborted);
  EXPECT_TRUE(store->begin("bob", hash(data), 6, 0).ok()) << "another owner's is another file";
  ASSERT_TRUE((*first)->add("abc").ok());
  first->reset();
  EXPECT_TRUE(put(data, "", 3).ok());
  // Many at once: each file is whole at the end.
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < 20; ++i) {
        const std::string mine = "file " + std::to_string((i + t) % 20);
        while (put(mine).code() == Code::Aborted) std::this_thread::yield();
      }
    });
  for (std::thread& t : threads) t.join();
  for (int i = 0; i < 20; ++i) EXPECT_EQ(read("file " + std::to_string(i)), "file " + std::to_string(i));
}

TEST_F(Files, BoundedAndTheLeastRecentlyUsedOfWhoHasMostGoes) {
  bytes = 8 * kLeast;  // one owner: four files
  open();
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(put("a" + std::to_string(i), "alice").ok());
  EXPECT_TRUE(has("a0", "alice"));  // used: the next one to go is a1
  ASSERT_TRUE(put("a4", "alice").ok());
  EXPECT_FALSE(has("a1", "alice"));
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(put("b" + std::to_string(i), "bob").ok());
  for (const char* a : {"a0", "a2", "a3", "a4"}) EXPECT_TRUE(has(a, "alice")) << a << ": bob's took their place";
  ASSERT_TRUE(put("c", "carol").ok());  // full: one of those that have most
  EXPECT_EQ(store->stats().files, 8u);
  EXPECT_TRUE(has("c", "carol"));
  const auto tooLarge = store->begin("alice", hash("x"), 4 * kLeast + 1, 0);
  EXPECT_EQ(tooLarge.status().code(), Code::ResourceExhausted);
  EXPECT_NE(tooLarge.status().message().find("blobs.bytes"), std::string::npos) << tooLarge.status().message();
}

TEST_F(Files, WhatIsHeldOrOnItsWayStays) {
  bytes = 4 * kLeast;
  open();
  ASSERT_TRUE(put("held").ok());
  auto tree = store->tree("", {{"a.bin", hash("held")}}, "field");
  ASSERT_TRUE(tree.ok());
  auto writer = store->begin("", hash("on its way"), 10, 0);
  ASSERT_TRUE(writer.ok());
  const Status none = put("more");
  EXPECT_EQ(none.code(), Code::ResourceExhausted);
  EXPECT_NE(none.message().find("in use or on their way"), std::string::npos) << none.message();
  writer->reset();
  EXPECT_TRUE(put("more").ok());
  EXPECT_TRUE(has("held"));
  EXPECT_TRUE(has("more"));  // "held" was used before it
  tree->reset();
  EXPECT_TRUE(put("most").ok());
  EXPECT_FALSE(has("held"));
}

TEST_F(Files, ASetThatCannotBeThereAtOnceIsRefused) {
  bytes = 8 * kLeast;  // one owner: four files
  open();
  const auto fits = [&](const std::string& owner, const std::vector<std::string>& files) {
    std::map<std::string, uint64_t> set;
    for (const std::string& data : files) set[hash(data)] = data.size();
    const Status status = store->fitTogether(owner, set);
    if (!status.ok()) {
      EXPECT_EQ(status.code(), Code::ResourceExhausted);
      EXPECT_NE(status.message().find("blobs.bytes = " + std::to_string(bytes)), std::string::npos) << status.message();
    }
    return status.ok();
  };
  EXPECT_TRUE(fits("alice", {"0", "1", "2", "3"}));
  EXPECT_FALSE(fits("alice", {"0", "1", "2", "3", "4"}));
  EXPECT_FALSE(fits("alice", {"0", "1", std::string(2 * kLeast + 1, 'x')})) << "what is larger counts as what it is";
  EXPECT_FALSE(store->fitTogether("alice", {{hash("0"), UINT64_MAX}, {hash("1"), UINT64_MAX}}).ok());
  std::string upper = hash("0");
  for (char& c : upper) c = char(std::toupper(c));
  EXPECT_TRUE(store->fitTogether("alice", {{hash("0"), 2 * kLeast + 1}, {upper, 2 * kLeast + 1}}).ok()) << "one file";
  // What may go does not count; what is in use, or on its way, does, and once.
  ASSERT_TRUE(put("held", "alice").ok());
  EXPECT_TRUE(fits("alice", {"0", "1", "2", "3"}));
  auto tree = store->tree("alice", {{"a.bin", hash("held")}}, "field");
  ASSERT_TRUE(tree.ok());
  EXPECT_FALSE(fits("alice", {"0", "1", "2", "3"}));
  EXPECT_TRUE(fits("alice", {"0", "1", "2", "held"}));
  {
    auto writer = store->begin("alice", hash("on its way"), 10, 0);
    ASSERT_TRUE(writer.ok());
    EXPECT_FALSE(fits("alice", {"0", "1", "2"}));
    EXPECT_TRUE(fits("alice", {"0", "1", "on its way"}));
  }
  EXPECT_TRUE(fits("alice", {"0", "1", "2"}));
  EXPECT_TRUE(fits("bob", {"0", "1", "2", "3"})) << "another's half is his own";
  // ... as far as all together leave it.
  std::vector<std::shared_ptr<const FileTree>> others;
  for (int i = 0; i < 6; ++i) {
    const std::string data = std::to_string(i), owner = i < 3 ? "bob" : "carol";
    ASSERT_TRUE(put(data, owner).ok());
    others.push_back(*store->tree(owner, {{"a.bin", hash(data)}}, "field"));
  }
  EXPECT_TRUE(fits("dave", {"x"}));
  EXPECT_FALSE(fits("dave", {"x", "y"}));
}

TEST_F(Files, OldPartsGo) {
  partSeconds = 0;
  open();
  part("abcdef", 0, 3);
  EXPECT_EQ(store->stats().parts, 1u);
  ::usleep(1000);
  store->sweep();
  EXPECT_EQ(store->stats().parts, 0u);
  EXPECT_TRUE(onDisk("abcdef").empty());
}

TEST_F(Files, TreesHaveTheNamesAndGoWithTheirLastUser) {
  ASSERT_TRUE(put("one").ok());
  ASSERT_TRUE(put("two").ok());
  const std::map<std::string, std::string> files{{"scene.gltf", hash("one")}, {"textures/deep/b.png", hash("two")}, {"again.bin", hash("two")}};
  auto tree = store->tree("", files, "open.files");
  ASSERT_TRUE(tree.ok()) << tree.status().toString();
  auto same = store->tree("", files, "open.files");
  EXPECT_EQ((*same)->folder(), (*tree)->folder());
  for (const auto& [name, digest] : files) EXPECT_TRUE(fs::exists((*tree)->path(name))) << name;
  const Status said = withoutFolder(Status(Code::DataLoss, "in " + (*tree)->path("a.bin") + " and " + (*tree)->path("b"), (*tree)->path("scene.gltf") + "#/x"),
                                    (*tree)->folder());
  EXPECT_EQ(said.toString(), Status(Code::DataLoss, "in a.bin and b", "scene.gltf#/x").toString());
  const std::string folder = (*tree)->folder();
  tree->reset();
  EXPECT_TRUE(fs::exists(folder));
  same->reset();
  EXPECT_FALSE(fs::exists(folder));
  auto missing = files;
  missing["c.bin"] = hash("three");
  const Status none = store->tree("", missing, "open.files").status();
  EXPECT_EQ(none.code(), Code::NotFound);
  EXPECT_NE(none.message().find("open.files[\"c.bin\"] = " + hash("three")), std::string::npos) << none.message();
}

// An error must fit into what clients take of metadata: gRPC's give up at 8 KB.
TEST_F(Files, AnErrorNamesAsManyAsFit) {
  std::map<std::string, std::string> many, long_;
  for (int i = 10; i < 60; ++i) {
    many[std::to_string(i) + ".bin"] = hash("none");
    long_[std::to_string(i) + std::string(240, '\x01') + ".bin"] = hash("none");
  }
  const std::string named = store->tree("", many, "open.files").status().message();
  EXPECT_NE(named.find("50 of 50 files"), std::string::npos) << named;
  EXPECT_NE(named.find("\"10.bin\"] = " + hash("none")), std::string::npos);
  EXPECT_NE(named.find("\"29.bin\"]"), std::string::npos);
  EXPECT_EQ(named.find("\"30.bin\"]"), std::string::npos);
  EXPECT_TRUE(named.ends_with(", ...")) << named;
  const std::string bounded = store->tree("", long_, "open.files").status().message();
  EXPECT_NE(bounded.find("[\"10"), std::string::npos);
  EXPECT_LT(bounded.size(), 3500u);
  EXPECT_TRUE(bounded.ends_with(", ..."));
}

TEST_F(Files, NamesAreThoseOfATree) {
  const std::string d = hash("x");
  EXPECT_TRUE(checkFileNames({{"a.gltf", d}, {"b/c.bin", d}}, "a.gltf").ok());
  EXPECT_TRUE(checkFileNames({{"A.GLB", d}}, "A.GLB").ok());
  std::string deep;
  for (int i = 0; i < 16; ++i) deep += "d/";
  for (const std::string& bad : {std::string(""), std::string("/etc/passwd"), std::string("../up"), std::string("b/../../up"), std::string("./b"),
                                 std::string("b//c"), std::string("b/"), std::string("."), std::string("a.gltf/b"), std::string("b\0c", 3),
                                 std::string(1100, 'x'), std::string(256, 'x'), deep + "x", std::string("http://host/x")})
    EXPECT_EQ(checkFileNames({{"a.gltf", d}, {bad, d}}, "a.gltf").code(), Code::InvalidArgument) << bad;
  for (const auto& [files, source] : std::vector<std::pair<std::map<std::string, std::string>, std::string>>{
           {{{"a.gltf", d}}, "b.gltf"}, {{{"a.txt", d}}, "a.txt"}, {{{"a.gltf", "12"}}, "a.gltf"}, {{{"a.gltf", std::string(64, 'g')}}, "a.gltf"}})
    EXPECT_EQ(checkFileNames(files, source).code(), Code::InvalidArgument) << source;
}

TEST_F(Files, AnEnvironmentIsKnownByItsFirstBytes) {
  const std::string hdr = "#?RADIANCE\nrest", exr = std::string("\x76\x2f\x31\x01", 4) + "rest", other = "\x89PNG rest";
  std::string path;
  for (const auto& [data, extension] : std::map<std::string, std::string>{{hdr, ".hdr"}, {exr, ".exr"}}) {
    ASSERT_TRUE(put(data).ok());
    const auto held = store->environment("", hash(data), "request.environment.digest", path);
    ASSERT_TRUE(held.ok()) << held.status().toString();
    EXPECT_EQ(fs::path(path).extension(), extension);
  }
  ASSERT_TRUE(put(other).ok());
  for (const auto& [digest, code] :
       std::map<std::string, Code>{{hash(other), Code::InvalidArgument}, {"12", Code::InvalidArgument}, {hash("no"), Code::NotFound}}) {
    const Status status = store->environment("", digest, "request.environment.digest", path).status();
    EXPECT_EQ(status.code(), code) << digest;
    EXPECT_NE(status.message().find("request.environment.digest = "), std::string::npos) << status.message();
  }
}

TEST_F(Files, AFolderIsOneDaemonsAndNobodyElses) {
  EXPECT_EQ(FileStore::open(options()).status().code(), Code::Unavailable);
  fs::create_directory(top + "/open");
  fs::permissions(top + "/open", fs::perms::all);
  EXPECT_EQ(FileStore::open({top + "/open", top, bytes, partSeconds}).status().code(), Code::FailedPrecondition);
}

TEST_F(Files, WithoutAFolderTheyGoWithTheStore) {
  store = *FileStore::open({"", top, bytes, partSeconds});
  EXPECT_FALSE(fs::exists(store->folder()));
  ASSERT_TRUE(put("abcdef").ok());
  EXPECT_EQ(read("abcdef"), "abcdef");
  const std::string folder = store->folder();
  EXPECT_EQ(fs::path(folder).parent_path(), top);
  EXPECT_TRUE(fs::exists(folder));
  store.reset();
  EXPECT_FALSE(fs::exists(folder));
}

TEST_F(Files, AFullDiskLosesNothing) {
  const std::string data(100000, 'x');
  ASSERT_TRUE(put("small").ok());
  part(data, 0, 1000);
  {  // what a process may write to one file in place of what a disk holds
    rlimit old{}, little{};
    ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old), 0);
    little = old;
    little.rlim_cur = 5000;
    const auto before = ::signal(SIGXFSZ, SIG_IGN);
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &little), 0);
    const Status full = put(data, "", 1000);
    ::setrlimit(RLIMIT_FSIZE, &old);
    ::signal(SIGXFSZ, before);
    EXPECT_EQ(full.code(), Code::ResourceExhausted) << full.toString();
  }
  const uint64_t there = store->received("", hash(data), data.size());
  EXPECT_GE(there, 1000u);
  EXPECT_LE(there, 5000u);
  EXPECT_EQ(read("small"), "small");
  EXPECT_TRUE(put(data, "", there).ok());
  EXPECT_EQ(read(data), data);
}

/// No descriptor can be had while it lives. Keep it short: the whole process has none.
struct NoDescriptors {
  rlimit old{};
  NoDescriptors() {
    EXPECT_EQ(::getrlimit(RLIMIT_NOFILE, &old), 0);
    const int next = ::open("/dev/null", O_RDONLY | O_CLOEXEC);  // the lowest number that is free
    ::close(next);
    rlimit none = old;
    none.rlim_cur = rlim_t(next);
    EXPECT_EQ(::setrlimit(RLIMIT_NOFILE, &none), 0);
  }
  ~NoDescriptors() { ::setrlimit(RLIMIT_NOFILE, &old); }
};

TEST_F(Files, WithoutDescriptorsNothingIsLost) {
  const std::string data(100000, 'x'), sky = "#?RADIANCE\nrest", small = "small";
  ASSERT_TRUE(put(small).ok());
  ASSERT_TRUE(put(sky).ok());
  part(data, 0, 1000);
  for (const bool checked : {false, true}) {
    if (!checked) open();
    std::string path;
    Status tree, environment, goOn, anew, other;
    {
      const NoDescriptors none;
      tree = store->tree("", {{"a.bin", hash(small)}}, "open.files").status();
      environment = store->environment("", hash(sky), "request.environment.digest", path).status();
      goOn = store->begin("", hash(data), data.size(), 1000).status();
      anew = store->begin("", hash(data), data.size(), 0).status();
      other = store->begin("", hash("other"), 5, 0).status();
    }
    for (const Status& status : {tree, environment, goOn, anew, other}) EXPECT_EQ(status.code(), Code::ResourceExhausted) << status.toString();
    EXPECT_NE(tree.message().find(hash(small)), std::string::npos) << tree.message();
    EXPECT_TRUE(has(small));
    EXPECT_TRUE(has(sky));
    EXPECT_EQ(store->received("", hash(data), data.size()), 1000u);
    EXPECT_EQ(store->stats().parts, 1u) << "nothing of the other one";
    EXPECT_EQ(store->stats().damaged, 0u);
    EXPECT_EQ(read(small), small);
    EXPECT_TRUE(store->environment("", hash(sky), "request.environment.digest", path).ok());
  }
  EXPECT_TRUE(put(data, "", 1000).ok());
  EXPECT_EQ(read(data), data);
}

TEST_F(Files, AllThatAreMissingAreNamedAtOnce) {
  std::map<std::string, std::string> files;
  for (const char* data : {"one", "two", "three"}) {
    ASSERT_TRUE(put(data).ok());
    files[std::string(data) + ".bin"] = hash(data);
  }
  std::ofstream(onDisk("one"), std::ios::in | std::ios::out) << "X";
  std::ofstream(onDisk("three"), std::ios::in | std::ios::out) << "X";
  open();
  const Status status = store->tree("", files, "open.files").status();
  EXPECT_EQ(status.code(), Code::NotFound);
  EXPECT_EQ(status.location(), "open.files");
  EXPECT_NE(status.message().find("2 of 3"), std::string::npos) << status.message();
  for (const char* data : {"one", "three"}) {
    EXPECT_NE(status.message().find("open.files[\"" + std::string(data) + ".bin\"] = " + hash(data)), std::string::npos) << status.message();
    EXPECT_EQ(store->received("", hash(data), std::string(data).size()), 0u) << data;
  }
  EXPECT_EQ(status.message().find(hash("two")), std::string::npos) << status.message();
  EXPECT_TRUE(has("two"));
  EXPECT_EQ(store->stats().damaged, 2u);
  for (int i = 0; i < 30; ++i) files["more" + std::to_string(i)] = hash(std::to_string(i));
  const std::string many = store->tree("", files, "open.files").status().message();
  EXPECT_NE(many.find("32 of 33"), std::string::npos) << many;
  size_t named = 0;
  for (size_t at = 0; (at = many.find("open.files[", at)) != std::string::npos; ++at) ++named;
  EXPECT_EQ(named, 20u) << many;
}

}  // namespace
}  // namespace gobo::file_store_test
