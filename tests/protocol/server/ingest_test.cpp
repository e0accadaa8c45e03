// SPDX-License-Identifier: Apache-2.0
// The attack list, through the daemon's front door: every file that is meant to hurt is answered with an error that names
// file, place and value (or is loaded with a warning), in bounded time, and the daemon goes on serving.
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>

#include "harness.h"
#include "support/instrumented.h"
#include "support/readers_left.h"
#include "support/small_gltf.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;
const std::string kCorrupt = "../shared/data/images/oiio-corrupt/";

class IngestProtocol : public ServerTest {
 protected:
  void configure(ServerConfig& c) override {
    c.ingestCacheFolder = folder + "/blobs";
    c.ingestWallSeconds = 60;
    c.ingestMemoryBytes = 2ull << 30;
  }
  std::string put(const std::string& name, const std::string& text) {
    std::ofstream(folder + "/root/" + name, std::ios::binary) << text;
    return folder + "/root/" + name;
  }
  grpc::Status open(const std::string& path, v1::SceneInfo* info = nullptr) {
    grpc::ClientContext context;
    bound(context);
    v1::OpenSceneRequest request;
    request.set_source(path);
    request.set_name("attack");
    v1::SceneInfo ignored;
    return scenes->Open(&context, request, info ? info : &ignored);
  }
  /// Refused with all of `texts` in the message, and the daemon is as before: it answers, and no reader is left over.
  void refused(const std::string& what, const std::string& path, grpc::StatusCode code, const std::vector<std::string>& texts) {
    const auto start = std::chrono::steady_clock::now();
    v1::SceneInfo info;
    const grpc::Status s = open(path, &info);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::string shown = s.error_message();
    for (size_t at; (at = shown.find(folder)) != std::string::npos;) shown.replace(at, folder.size(), "");
    std::cout << "  " << what << ": " << shown << "\n";
    EXPECT_EQ(s.error_code(), code) << what << ": " << s.error_message() << (info.warnings_size() ? info.warnings(0) : "");
    for (const std::string& t : texts) EXPECT_NE(s.error_message().find(t), std::string::npos) << what << ": " << s.error_message() << " lacks " << t;
    EXPECT_LT(seconds, 60) << what;
    alive(what);
  }
  void alive(const std::string& what) {
    EXPECT_GT(status().uptime_s(), 0.0) << what;
    EXPECT_TRUE(noReaderIsLeft()) << what;
  }
  std::string with(const std::string& from, const std::string& to) {
    std::string s = smallGltf("");
    const size_t at = s.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return s.replace(at, from.size(), to);
  }
};

TEST_F(IngestProtocol, PathsThatLeadOutside) {
  std::ofstream(folder + "/secret.png") << smallPng(1, 2, 3);
  const std::string quoted = "attack.gltf#/images/0/uri";
  for (const auto& [uri, why] : {std::pair<const char*, const char*>{"../secret.png", "leaves the folder"},
                                 {"%2e%2e/secret.png", "leaves the folder"},
                                 {"sub/../../secret.png", "leaves the folder"},
                                 {"..\\\\secret.png", "leaves the folder"},
                                 {"/etc/passwd", "is absolute"},
                                 {"~/.ssh/id_rsa", "is absolute"},
                                 {"file:///etc/passwd", "has a scheme"},
                                 {"http://127.0.0.1/x.png", "has a scheme"},
                                 {"gopher:x", "has a scheme"},
                                 {"a%00.png", "zero byte"},
                                 {"$(touch /tmp/owned)/../../x", "leaves the folder"}})
    refused(uri, put("attack.gltf", smallGltf(uri)), grpc::INVALID_ARGUMENT, {quoted, why});
  // Symbolic links inside the folder that lead out of it.
  fs::create_symlink(folder + "/secret.png", folder + "/root/link.png");
  refused("link to a file outside", put("attack.gltf", smallGltf("link.png")), grpc::INVALID_ARGUMENT, {"leaves the folder", quoted});
  fs::create_directory_symlink(folder, folder + "/root/up");
  refused("link to a folder outside", put("attack.gltf", smallGltf("up/secret.png")), grpc::INVALID_ARGUMENT, {"leaves the folder", quoted});
  fs::create_symlink("/etc/passwd", folder + "/root/passwd.glb");
  refused("scene that is a link outside", folder + "/root/passwd.glb", grpc::PERMISSION_DENIED, {"not under an allowed root"});
  // A URI that a shell would run is a file name like any other: missing, so the picture is left out.
  v1::SceneInfo info;
  ASSERT_TRUE(open(put("attack.gltf", smallGltf("$(touch owned)`id`.png")), &info).ok());
  ASSERT_EQ(info.warnings_size(), 1) << info.ShortDebugString();
  EXPECT_NE(info.warnings(0).find("does not exist beside the glTF"), std::string::npos) << info.warnings(0);
  EXPECT_FALSE(fs::exists("owned") || fs::exists(folder + "/root/owned"));
}

TEST_F(IngestProtocol, SpecialFiles) {
  ASSERT_EQ(::mkfifo((folder + "/root/pipe.glb").c_str(), 0600), 0);
  refused("FIFO as a scene", folder + "/root/pipe.glb", grpc::INVALID_ARGUMENT, {"not a regular file", "pipe.glb"});
  ASSERT_EQ(::mkfifo((folder + "/root/pipe.png").c_str(), 0600), 0);
  refused("FIFO as a picture", put("attack.gltf", smallGltf("pipe.png")), grpc::INVALID_ARGUMENT, {"not a regular file", "/images/0/uri"});
  fs::create_directory(folder + "/root/folder.gltf");
  refused("folder as a scene", folder + "/root/folder.gltf", grpc::INVALID_ARGUMENT, {"not a regular file"});
  refused("empty file", put("attack.glb", ""), grpc::INVALID_ARGUMENT, {"attack.glb"});
}

TEST_F(IngestProtocol, CountsAndCycles) {
  refused("2^31 vertices", put("attack.gltf", with("\"count\":4,\"type\":\"VEC3\"", "\"count\":2147483648,\"type\":\"VEC3\"")), grpc::INVALID_ARGUMENT,
          {"attack.gltf#/accessors/0"});
  refused("2^63 vertices", put("attack.gltf", with("\"count\":4,\"type\":\"VEC3\"", "\"count\":9223372036854775807,\"type\":\"VEC3\"")), grpc::INVALID_ARGUMENT,
          {"attack.gltf#/accessors/0"});
  refused("1e300 vertices", put("attack.gltf", with("\"count\":4,\"type\":\"VEC3\"", "\"count\":1e300,\"type\":\"VEC3\"")), grpc::INVALID_ARGUMENT,
          {"attack.gltf#/accessors/0/count"});
  refused("offset that wraps", put("attack.gltf", with("\"byteOffset\":48", "\"byteOffset\":4294967248")), grpc::INVALID_ARGUMENT, {"attack.gltf#/"});
  refused("index beyond the vertices", put("attack.gltf", with("\"bufferView\":2,\"componentType\":5123", "\"bufferView\":0,\"componentType\":5123")),
          grpc::INVALID_ARGUMENT, {"attack.gltf#/"});
  refused("buffer of 2^40 bytes", put("attack.gltf", with("\"byteLength\":92,", "\"byteLength\":1099511627776,")), grpc::INVALID_ARGUMENT,
          {"attack.gltf#/buffers"});
  refused("node that is its own child", put("attack.gltf", with("\"name\":\"quad\"", "\"name\":\"quad\",\"children\":[0]")), grpc::INVALID_ARGUMENT,
          {"cycle", "attack.gltf#/nodes/0"});
  refused("two nodes that hold each other", put("attack.gltf", with("\"mesh\":0,\"name\":\"quad\"", "\"mesh\":0,\"children\":[1]},{\"children\":[0]")),
          grpc::INVALID_ARGUMENT, {"attack.gltf#/nodes"});
  refused("brackets a million deep", put("attack.gltf", std::string(1 << 20, '[')), grpc::INVALID_ARGUMENT, {"nested", "attack.gltf"});
  std::string glb("glTF\2\0\0\0\xff\xff\xff\xff\xff\xff\xff\xffJSON", 20);
  refused("GLB longer than its file", put("attack.glb", glb), grpc::INVALID_ARGUMENT, {"GLB", "attack.glb"});
  refused("required extension from nowhere", put("attack.gltf", smallGltf("", R"("extensionsRequired":["EVIL_ext"])")), grpc::INVALID_ARGUMENT,
          {"EVIL_ext", "/extensionsRequired/0"});
}

TEST_F(IngestProtocol, PicturesThatExplode) {
  if (!fs::exists(kCorrupt)) GTEST_SKIP() << "../shared/data/images is absent";
  size_t bombs = 0;
  for (const auto& e : fs::recursive_directory_iterator(kCorrupt)) {
    if (!e.is_regular_file() || e.path().extension() == ".tsv") continue;
    const std::string name = e.path().filename().string();
    fs::copy_file(e.path(), folder + "/root/" + name);
    ::chmod((folder + "/root/" + name).c_str(), 0600);
    // As a texture: the scene loads; a picture that cannot be read is left out with the reason.
    v1::SceneInfo info;
    const grpc::Status s = open(put("attack.gltf", smallGltf(name)), &info);
    EXPECT_TRUE(s.ok()) << name << ": " << s.error_message();
    std::cout << "  texture " << name << ": " << (info.warnings_size() ? info.warnings(0) : "loaded") << "\n";
    if (name.rfind("bomb", 0) == 0) {
      ++bombs;
      ASSERT_GE(info.warnings_size(), 1) << name;
      EXPECT_NE(info.warnings(0).find(name), std::string::npos);
      EXPECT_EQ(info.textures(), 0u);
    }
    // As an environment map: an error that names it, or a picture.
    v1::RenderRequest request = small(1);
    request.mutable_environment()->set_path(folder + "/root/" + name);
    const Collected c = renderOnce(request);
    std::cout << "  environment " << name << ": " << (c.status.ok() ? "rendered" : c.status.error_message()) << "\n";
    if (name.rfind("bomb", 0) == 0) { EXPECT_FALSE(c.status.ok()) << name; }
    if (!c.status.ok()) { EXPECT_NE(c.status.error_message().find(name), std::string::npos) << c.status.error_message(); }
    alive(name);
  }
  EXPECT_EQ(bombs, 4u);
}

TEST_F(IngestProtocol, SecondOpenIsMapped) {
  const std::string path = put("scene.gltf", smallGltf("paint.png"));
  put("paint.png", smallPng(9, 99, 199));
  v1::SceneInfo first, second;
  ASSERT_TRUE(open(path, &first).ok());
  ASSERT_TRUE(open(path, &second).ok());
  EXPECT_FALSE(first.blob_cached());
  EXPECT_TRUE(second.blob_cached());
  EXPECT_EQ(first.hash(), second.hash());
  EXPECT_EQ(first.blob_bytes(), second.blob_bytes());
  EXPECT_GT(first.ingest_ms(), 0.0);
  EXPECT_EQ(second.ingest_ms(), 0.0);
}

class IngestLimits : public IngestProtocol {
 protected:
  void configure(ServerConfig& c) override {
    IngestProtocol::configure(c);
    c.ingestMemoryBytes = 256ull << 20;
    c.ingestTextureBytes = 1 << 20;
    c.ingestInputBytes = 1 << 20;
  }
};

TEST_F(IngestLimits, AreNamed) {
  // 64 MP of one colour: a few hundred KB of PNG would be 1 GB of floats.
  Image big(8192, 8192, 1);
  const auto png = encodePng(big);
  ASSERT_TRUE(png.ok());
  put("big.png", std::string(png->begin(), png->end()));
  if (!gobo::testing::kInstrumented)  // whose shadow memory rules out the limit
    refused("picture above the memory limit", put("attack.gltf", smallGltf("big.png")), grpc::RESOURCE_EXHAUSTED, {"ingest.memory_bytes", "attack.gltf"});
  put("huge.bin", std::string(2 << 20, 'x'));
  refused("files above the input limit", put("attack.gltf", smallGltf("huge.bin")), grpc::RESOURCE_EXHAUSTED, {"huge.bin", "ingest.input_bytes"});
  Image wide(1024, 512, 3);
  for (size_t i = 0; i < wide.data.size(); ++i) wide.data[i] = float(i % 7) / 7;
  const auto kept = encodePng(wide);
  put("wide.png", std::string(kept->begin(), kept->end()));
  v1::SceneInfo info;
  const grpc::Status opened = open(put("attack.gltf", smallGltf("wide.png")), &info);
  ASSERT_TRUE(opened.ok()) << opened.error_message();
  ASSERT_EQ(info.warnings_size(), 1);
  EXPECT_NE(info.warnings(0).find("\"wide.png\" is kept at 512 x 256 of 1024 x 512"), std::string::npos) << info.warnings(0);
}

}  // namespace
}  // namespace gobo
