// SPDX-License-Identifier: Apache-2.0
#include "server/config.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <fstream>

#include "server/machine_memory.h"

namespace gobo::config_test {
namespace {

namespace fs = std::filesystem;

class ConfigFile : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "gobo-config-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    folder = pattern;
  }
  void TearDown() override { fs::remove_all(folder); }
  Status read(const std::string& text) {
    file = (folder / "g.toml").string();
    std::ofstream(file) << text;
    return readConfig(file, config);
  }
  fs::path folder;
  std::string file;
  ServerConfig config;
};

TEST_F(ConfigFile, ReadsEveryKindOfValue) {
  const Status status = read(
      "listen = [\"unix:a.sock\", \"127.0.0.1:0\"]\nreflection = true\n[engine]\nthreads = 3\nstore_bytes = \"2GiB\"\n"
      "roots = [\"scenes\", \"/abs\"]\n[limits]\nupload_bytes = 1000\n[scheduler]\ndrain_s = 2\n");
  ASSERT_TRUE(status.ok()) << status.toString();
  EXPECT_EQ(config.listen, (std::vector<std::string>{"unix:" + (folder / "a.sock").string(), "127.0.0.1:0"}));
  EXPECT_TRUE(config.reflection);
  EXPECT_EQ(config.threads, 3);
  EXPECT_EQ(config.storeBytes, 2ull << 30);
  EXPECT_EQ(config.roots, (std::vector<std::string>{(folder / "scenes").string(), "/abs"}));
  EXPECT_EQ(config.uploadBytes, 1000u);
  EXPECT_DOUBLE_EQ(config.drainSeconds, 2);
}

TEST_F(ConfigFile, ErrorsNameFileLineKeyAndValue) {
  const struct {
    const char* text;
    const char* line;
    const char* words;
  } cases[] = {
      {"reflection = false\nthreds = 4\n", ":2: ", "unknown key \"threds\""},
      {"[engine]\n\nthredas = 4\n", ":3: ", "unknown key \"engine.thredas\""},
      {"[engin]\nthreads = 4\n", ":1: ", "unknown key \"engin\""},
      {"[engine]\nthreads = \"4\"\n", ":2: ", "engine.threads = '4': must be an integer"},
      {"[engine]\nthreads = 2.5\n", ":2: ", "engine.threads = 2.5: must be an integer"},
      {"[engine]\nthreads = -1\n", ":2: ", "engine.threads = -1: must be in 0..1024"},
      {"[engine]\nstore_bytes = \"4Gib\"\n", ":2: ", "is not a size"},
      {"[engine]\nroots = \"scenes\"\n", ":2: ", "engine.roots = 'scenes': must be an array of strings"},
      {"[engine]\nroots = [1]\n", ":2: ", "must be an array of strings"},
      {"reflection = 1\n", ":1: ", "reflection = 1: must be true or false"},
      {"engine = 3\n", ":1: ", "engine = 3: must be a table"},
      {"[scheduler]\ndrain_s = nan\n", ":2: ", "scheduler.drain_s = nan: must be in"},
      {"a = = 1\n", ":1: ", ""},
  };
  for (const auto& c : cases) {
    const Status status = read(c.text);
    EXPECT_EQ(status.code(), Code::InvalidArgument) << c.text;
    EXPECT_EQ(status.message().rfind(file + c.line, 0), 0u) << status.message();
    EXPECT_NE(status.message().find(c.words), std::string::npos) << status.message();
  }
  EXPECT_EQ(readConfig((folder / "none.toml").string(), config).code(), Code::NotFound);
}

TEST_F(ConfigFile, TheShippedFileHoldsTheDefaults) {
  ASSERT_TRUE(readConfig("configs/gobod.toml", config).ok()) << readConfig("configs/gobod.toml", config).toString();
  const ServerConfig d;
  EXPECT_EQ(config.listen, d.listen);
  EXPECT_EQ(config.threads, d.threads);
  EXPECT_EQ(config.storeBytes, d.storeBytes);
  EXPECT_EQ(config.diskBytes, d.diskBytes);
  EXPECT_EQ(config.keepRenders, d.keepRenders);
  EXPECT_EQ(config.rpcThreads, d.rpcThreads);
  EXPECT_EQ(config.streamsPerConnection, d.streamsPerConnection);
  EXPECT_EQ(config.messageBytes, d.messageBytes);
  EXPECT_EQ(config.rpcMemoryBytes, d.rpcMemoryBytes);
  EXPECT_EQ(config.uploadBytes, d.uploadBytes);
  EXPECT_EQ(config.uploadsAtOnce, d.uploadsAtOnce);
  EXPECT_EQ(config.chunkBytes, d.chunkBytes);
  EXPECT_EQ(config.inlineBytes, d.inlineBytes);
  EXPECT_EQ(config.imageBytes, d.imageBytes);
  EXPECT_EQ(config.running, d.running);
  EXPECT_EQ(config.queuedInteractive, d.queuedInteractive);
  EXPECT_EQ(config.queuedNormal, d.queuedNormal);
  EXPECT_EQ(config.queuedBatch, d.queuedBatch);
  EXPECT_DOUBLE_EQ(config.ageingNormal, d.ageingNormal);
  EXPECT_DOUBLE_EQ(config.ageingBatch, d.ageingBatch);
  EXPECT_EQ(config.queuedPerClient, d.queuedPerClient);
  EXPECT_EQ(config.pinnedBytes, d.pinnedBytes);
  EXPECT_DOUBLE_EQ(config.drainSeconds, d.drainSeconds);
  EXPECT_TRUE(checkConfig(config).ok());
}

TEST(Config, OnlyLoopbackUnlessRemoteIsAllowed) {
  for (const char* address : {"0.0.0.0:50051", "[::]:50051", "192.168.1.4:1", "example.org:80", "127.0.0.1.evil.org:80", "127.0.0.999:1"}) {
    ServerConfig config;
    config.listen = {address};
    const Status refused = checkConfig(config);
    EXPECT_EQ(refused.code(), Code::PermissionDenied) << address;
    EXPECT_NE(refused.message().find(address), std::string::npos);
    config.allowRemote = true;
    EXPECT_TRUE(checkConfig(config).ok()) << address;
  }
  for (const char* address : {"127.0.0.1:0", "127.1.2.3:80", "localhost:65535", "[::1]:9", "unix:/tmp/x"}) {
    ServerConfig config;
    config.listen = {address};
    EXPECT_TRUE(checkConfig(config).ok()) << address;
  }
}

TEST(Config, AddressesThatAreNoneAreRefused) {
  for (const char* address : {"", "unix:", "localhost", ":80", "127.0.0.1:", "127.0.0.1:65536", "127.0.0.1:8x", "127.0.0.1:-1"})
    EXPECT_FALSE(parseAddress(address).ok()) << address;
  EXPECT_FALSE(parseAddress("unix:/" + std::string(200, 'a')).ok());  // sun_path would be cut
}

TEST(Config, Sizes) {
  EXPECT_EQ(*parseBytes("1000"), 1000u);
  EXPECT_EQ(*parseBytes("4GiB"), 4ull << 30);
  EXPECT_EQ(*parseBytes("1.5 KiB"), 1536u);
  EXPECT_EQ(*parseBytes("2MB"), 2000000u);
  for (const char* bad : {"", "GiB", "-1", "1e3", "4 gib", "1.2.3", "99999999999TiB", "0x10"}) EXPECT_FALSE(parseBytes(bad).ok()) << bad;
}

TEST(Config, LimitsThatContradictEachOther) {
  ServerConfig config;
  config.chunkBytes = config.messageBytes;
  const Status status = checkConfig(config);
  EXPECT_EQ(status.code(), Code::InvalidArgument);
  EXPECT_NE(status.message().find("limits.chunk_bytes"), std::string::npos);
  config = {};
  config.queuedBatch = config.rpcThreads;  // waiting renders could take every call
  EXPECT_NE(checkConfig(config).message().find("limits.rpc_threads"), std::string::npos);
  config = {};
  config.roots = {"/no/such/folder"};
  EXPECT_EQ(checkConfig(config).code(), Code::NotFound);
}

// What cannot give way must have its place in the total.
TEST_F(ConfigFile, TheTotalOfMemoryHoldsWhatDoesNotGiveWay) {
  const std::string small =
      "listen = [\"unix:a.sock\"]\n[limits]\nreply_bytes = \"64MiB\"\n[scheduler]\npinned_bytes = \"128MiB\"\n[engine]\nkeep_renders_bytes = \"8MiB\"\n";
  ASSERT_TRUE(read(small + "memory_bytes = \"200MiB\"\n").ok());
  EXPECT_TRUE(checkConfig(config).ok());
  ASSERT_TRUE(read(small + "memory_bytes = \"199MiB\"\n").ok());
  const Status refused = checkConfig(config);
  EXPECT_EQ(refused.code(), Code::InvalidArgument);
  for (const char* words : {"engine.memory_bytes = 208666624", "scheduler.pinned_bytes", "209715200"})
    EXPECT_NE(refused.message().find(words), std::string::npos) << refused.message();
  config = {};
  ASSERT_TRUE(read(small).ok());
  ASSERT_TRUE(checkConfig(config).ok());
  EXPECT_EQ(config.memoryBytes, std::max<uint64_t>(machineMemory() / 4 * 3, 200ull << 20));
}

TEST_F(ConfigFile, AContainersLimitIsTheMachinesMemory) {
  const uint64_t machine = machineMemory((folder / "none").string());
  EXPECT_GT(machine, 1u << 20);
  fs::create_directories(folder / "proc/self");
  fs::create_directories(folder / "sys/fs/cgroup/a/b");
  std::ofstream(folder / "proc/self/cgroup") << "1:name=systemd:/x\n0::/a/b\n";
  std::ofstream(folder / "sys/fs/cgroup/a/b/memory.max") << "max\n";
  EXPECT_EQ(machineMemory(folder.string()), machine);
  std::ofstream(folder / "sys/fs/cgroup/a/memory.max") << "1048576\n";
  EXPECT_EQ(machineMemory(folder.string()), 1048576u);
  std::ofstream(folder / "sys/fs/cgroup/a/b/memory.max") << "524288\n";
  EXPECT_EQ(machineMemory(folder.string()), 524288u);
  std::ofstream(folder / "proc/self/cgroup") << "0::/\n";  // as a container sees itself
  EXPECT_EQ(machineMemory(folder.string()), machine);
  std::ofstream(folder / "sys/fs/cgroup/memory.max") << "4096\n";
  EXPECT_EQ(machineMemory(folder.string()), 4096u);
}

TEST(Log, TextFromClientsStaysOnItsLine) { EXPECT_EQ(escaped("a\nb\x1b[31m"), "a\\x0ab\\x1b[31m"); }
TEST(Log, TextThatWasCutIsStillText) {
  EXPECT_EQ(escaped("\u00e9t\u00e9"), "\u00e9t\u00e9");
  EXPECT_EQ(escaped(std::string("\u00e9t\u00e9").substr(0, 4)), "\u00e9t\\xc3");
}

}  // namespace
}  // namespace gobo::config_test
