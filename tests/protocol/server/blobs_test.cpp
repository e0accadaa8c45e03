// SPDX-License-Identifier: Apache-2.0
// Blobs over the wire: puts that break off and go on, every refusal with its code, other tokens' files that are not there, scenes and environments by digest
// against the same files on disk, and what a restart leaves.
#include <cstring>
#include <fstream>
#include <thread>

#include "gobo/v1/jobs.grpc.pb.h"
#include "harness.h"
#include "support/triangle_glb.h"

namespace gobo {
namespace {

std::string hashOf(const std::string& data) { return sha256Hex(data.data(), data.size()); }

/// A sky of 4 x 2 texels.
std::string skyFile(uint8_t red) {
  std::string out = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n";
  for (int i = 0; i < 8; ++i) out += {char(red), char(100 + 10 * i), char(50), char(129)};
  return out;
}

/// The triangle as a .gltf and the buffer that it names.
struct SideScene {
  std::string gltf, bin;
  SideScene() {
    const std::string glb = triangleGlb();
    uint32_t json = 0;
    std::memcpy(&json, glb.data() + 12, 4);
    gltf = glb.substr(20, json);
    bin = glb.substr(20 + json + 8);
    const std::string plain = "\"buffers\":[{\"byteLength\":36";
    gltf.replace(gltf.find(plain), plain.size(), plain + ",\"uri\":\"data/tri%20a.bin\"");
  }
};

class Blobs : public ServerTest {
 protected:
  void configure(ServerConfig& c) override {
    c.listen.push_back("127.0.0.1:0");
    c.blobsFolder = folder + "/blobs";
    c.ingestCacheFolder = folder + "/ingest";
    c.blobsBytes = 4 << 20;
    c.uploadBytes = 1 << 20;
    c.jobsFolder = folder + "/jobs";
    for (const char* name : {"alice", "bob"}) {
      TokenConfig t;
      t.name = name;
      const std::string secret = std::string("secret-") + name;
      t.sha256 = hashOf(secret);
      if (t.name == "bob") t.uploadBytes = 1000;
      c.tokens.push_back(t);
    }
  }
  void SetUp() override {
    ServerTest::SetUp();
    connect();
  }
  void connect() {
    tcp = grpc::CreateChannel(server->addresses()[1], grpc::InsecureChannelCredentials());
    channel = grpc::CreateChannel(server->addresses()[0], grpc::InsecureChannelCredentials());
    render = v1::Render::NewStub(channel);
    scenes = v1::Scenes::NewStub(channel);
  }
  void restart() {
    server->shutdown(0);
    server.reset();
    auto started = Server::start(config, engineOptions(config), true);
    ASSERT_TRUE(started.ok()) << started.status().toString();
    server = std::move(*started);
    connect();
  }
  std::shared_ptr<grpc::Channel> of(const std::string& who) { return who.empty() ? channel : tcp; }
  static void sign(grpc::ClientContext& context, const std::string& who) {
    bound(context);
    context.set_wait_for_ready(true);
    if (!who.empty()) context.AddMetadata("authorization", "Bearer secret-" + who);
  }
  static v1::PutBlobRequest first(const std::string& data, uint64_t offset = 0) {
    v1::PutBlobRequest m;
    m.mutable_blob()->set_sha256(hashOf(data));
    m.mutable_blob()->set_bytes(data.size());
    m.set_offset(offset);
    return m;
  }
  grpc::Status put(v1::PutBlobRequest head, const std::string& data, const std::string& who = "", size_t piece = 7) {
    grpc::ClientContext context;
    sign(context, who);
    auto stub = v1::Blobs::NewStub(of(who));
    v1::PutBlobReply reply;
    auto writer = stub->Put(&context, &reply);
    head.set_data(data.substr(0, piece));
    bool open = writer->Write(head);
    for (size_t at = piece; open && at < data.size(); at += piece) {
      v1::PutBlobRequest next;
      next.set_data(data.substr(at, piece));
      open = writer->Write(next);
    }
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    if (status.ok()) { EXPECT_EQ(reply.received(), head.blob().bytes()); }
    return status;
  }
  grpc::Status put(const std::string& data, const std::string& who = "") { return put(first(data), data, who, 1 << 16); }
  /// Sends so many bytes and goes away.
  void breakOff(const std::string& data, size_t bytes, const std::string& who = "") {
    grpc::ClientContext context;
    sign(context, who);
    auto stub = v1::Blobs::NewStub(of(who));
    v1::PutBlobReply reply;
    auto writer = stub->Put(&context, &reply);
    v1::PutBlobRequest head = first(data);
    head.set_data(data.substr(0, bytes));
    writer->Write(head);
    EXPECT_TRUE(eventually([&] { return server->core().uploads.used() == 1 && has(data, who) == bytes; }));
    context.TryCancel();
    writer->Finish();
    EXPECT_TRUE(eventually([&] { return server->core().uploads.used() == 0; }));
  }
  grpc::Status missing(const v1::MissingBlobsRequest& request, v1::MissingBlobsReply& reply, const std::string& who) {
    grpc::ClientContext context;
    sign(context, who);
    return v1::Blobs::NewStub(of(who))->Missing(&context, request, &reply);
  }
  uint64_t has(const std::string& data, const std::string& who = "") {
    v1::MissingBlobsRequest request;
    *request.add_blobs() = first(data).blob();
    v1::MissingBlobsReply reply;
    EXPECT_TRUE(missing(request, reply, who).ok());
    return reply.missing_size() ? reply.missing(0).received() : data.size();
  }
  grpc::Status open(const v1::OpenSceneRequest& request, v1::SceneInfo& info, const std::string& who = "") {
    grpc::ClientContext context;
    sign(context, who);
    return v1::Scenes::NewStub(of(who))->Open(&context, request, &info);
  }
  Collected renderAs(const v1::RenderRequest& request, const std::string& who = "") {
    grpc::ClientContext context;
    sign(context, who);
    auto stub = v1::Render::NewStub(of(who));
    auto reader = stub->Render(&context, request);
    return drain(context, *reader);
  }
  static v1::RenderRequest lit(const std::string& digest, const std::string& scene = "cornell") {
    v1::RenderRequest request = small(4, scene);
    request.mutable_environment()->set_digest(digest);
    return request;
  }
  static void refused(const grpc::Status& status, grpc::StatusCode code, const std::vector<std::string>& words) {
    EXPECT_EQ(status.error_code(), code) << status.error_message();
    for (const std::string& w : words) EXPECT_NE(status.error_message().find(w), std::string::npos) << w << " in: " << status.error_message();
  }
  std::shared_ptr<grpc::Channel> tcp;
};

TEST_F(Blobs, PutOnceAndGoneOnWithAfterABreakAndARestart) {
  const std::string data(300000, 'd');
  EXPECT_EQ(has(data), 0u);
  breakOff(data, 1234);
  EXPECT_EQ(has(data), 1234u);
  restart();
  EXPECT_EQ(has(data), 1234u);
  const grpc::Status rest = put(first(data, 1234), data.substr(1234), "", 1 << 16);
  ASSERT_TRUE(rest.ok()) << rest.error_message();
  EXPECT_EQ(has(data), data.size());
  const double before = server->core().metrics.value("gobo_blob_put_bytes_total", {});
  for (const size_t piece : {data.size(), size_t(1000)}) EXPECT_TRUE(put(first(data), data, "", piece).ok()) << "what is there may be sent again, and need not";
  EXPECT_TRUE(put(first(data, data.size()), "").ok());
  EXPECT_EQ(server->core().metrics.value("gobo_blob_put_bytes_total", {}), before);
  restart();
  EXPECT_EQ(has(data), data.size());
}

TEST_F(Blobs, EveryRefusalHasItsCode) {
  const std::string data = "some bytes";
  v1::PutBlobRequest head = first(data);
  head.mutable_blob()->set_sha256("12");
  refused(put(head, data), grpc::INVALID_ARGUMENT, {"put.blob.sha256 = \"12\"", "64 hex digits"});
  head = first(data);
  head.mutable_blob()->set_bytes(0);
  refused(put(head, data), grpc::INVALID_ARGUMENT, {"put.blob.bytes = 0"});
  refused(put(first(data, 1), data), grpc::OUT_OF_RANGE, {"put.offset = 1", "0 bytes are there"});
  refused(put(first(data), data + "more"), grpc::INVALID_ARGUMENT, {"put.data", "put.blob.bytes = 10"});
  refused(put(first(data), data.substr(0, 9)), grpc::INVALID_ARGUMENT, {"put.data", "9 of put.blob.bytes = 10"});
  EXPECT_EQ(has(data), 9u);
  refused(put(first(data), "Some bytes"), grpc::INVALID_ARGUMENT, {"put.blob.sha256 = " + hashOf(data), hashOf("Some bytes")});
  EXPECT_EQ(has(data), 0u);
  head = first(data);
  head.mutable_blob()->set_bytes((1 << 20) + 1);
  refused(put(head, ""), grpc::RESOURCE_EXHAUSTED, {"put.blob.bytes = 1048577", "limits.upload_bytes"});
  head.mutable_blob()->set_bytes(1001);
  refused(put(head, "", "bob"), grpc::RESOURCE_EXHAUSTED, {"1001", "tokens.upload_bytes"});
  {
    grpc::ClientContext context;
    sign(context, "");
    v1::PutBlobReply reply;
    auto stub = v1::Blobs::NewStub(channel);
    auto writer = stub->Put(&context, &reply);
    writer->WritesDone();
    refused(writer->Finish(), grpc::INVALID_ARGUMENT, {"put.blob"});
  }
  v1::MissingBlobsReply reply;
  v1::MissingBlobsRequest request;
  request.add_blobs()->set_sha256("x");
  refused(missing(request, reply, ""), grpc::INVALID_ARGUMENT, {"missing.blobs[0].sha256 = \"x\""});
  request.mutable_blobs(0)->set_sha256(hashOf(data));
  refused(missing(request, reply, ""), grpc::INVALID_ARGUMENT, {"missing.blobs[0].bytes = 0"});
  request.mutable_blobs(0)->set_bytes(data.size());
  *request.add_blobs() = first(data).blob();
  request.mutable_blobs(1)->set_sha256(std::string(64, '7'));
  request.mutable_blobs(1)->set_bytes(1ull << 50);  // before anything is sent of either
  refused(missing(request, reply, ""), grpc::RESOURCE_EXHAUSTED, {"missing.blobs[1].bytes = 1125899906842624: uploads are limited to"});
  request.clear_blobs();
  for (int i = 0; i < 10002; ++i) *request.add_blobs() = first(data).blob();
  refused(missing(request, reply, ""), grpc::INVALID_ARGUMENT, {"missing.blobs: 10002"});
  request.clear_blobs();
  for (const char digit : {'1', '2', '3'}) {
    request.add_blobs()->set_sha256(std::string(64, digit));
    request.mutable_blobs(request.blobs_size() - 1)->set_bytes(1 << 20);
  }
  refused(missing(request, reply, ""), grpc::RESOURCE_EXHAUSTED, {"the 3 files have 3145728 bytes together", "blobs.bytes = 4194304", "missing.blobs"});
  refused(renderAs(lit("12")).status, grpc::INVALID_ARGUMENT, {"request.environment.digest = \"12\""});
  refused(renderAs(lit(hashOf(data))).status, grpc::NOT_FOUND, {"request.environment.digest = " + hashOf(data), "Blobs.Put"});
  ASSERT_TRUE(put(data).ok());
  refused(renderAs(lit(hashOf(data))).status, grpc::INVALID_ARGUMENT, {"request.environment.digest", "no .hdr and no .exr"});
  v1::RenderRequest both = lit(hashOf(data));
  both.mutable_environment()->mutable_constant()->set_x(1);
  ASSERT_TRUE(put(skyFile(1)).ok());
  both.mutable_environment()->set_digest(hashOf(skyFile(1)));
  refused(renderAs(both).status, grpc::INVALID_ARGUMENT, {"exclude each other"});
  const std::string broken = "#?RADIANCE\n and nothing of the kind";
  ASSERT_TRUE(put(broken).ok());
  const Collected unread = renderAs(lit(hashOf(broken)));
  EXPECT_FALSE(unread.status.ok());
  EXPECT_NE(unread.status.error_message().find("request.environment.digest"), std::string::npos) << unread.status.error_message();
  EXPECT_EQ(unread.status.error_message().find(folder), std::string::npos)
      << unread.status.error_message() << ": where the server keeps it is nobody's business";
}

TEST_F(Blobs, TwoPutsOfOneFileAreOneAndAHint) {
  const std::string data = "abcdef";
  grpc::ClientContext context;
  sign(context, "");
  v1::PutBlobReply reply;
  auto stub = v1::Blobs::NewStub(channel);
  auto writer = stub->Put(&context, &reply);
  v1::PutBlobRequest head = first(data);
  head.set_data("abc");
  writer->Write(head);
  ASSERT_TRUE(eventually([&] { return server->core().metrics.value("gobo_blob_put_bytes_total", {}) == 3; }));
  refused(put(data), grpc::RESOURCE_EXHAUSTED, {"another call puts this file", "retry after"});
  EXPECT_EQ(server->core().metrics.value("gobo_refused_total", {{"reason", "blobs"}}), 1);
  v1::PutBlobRequest rest;
  rest.set_data("def");
  writer->Write(rest);
  writer->WritesDone();
  EXPECT_TRUE(writer->Finish().ok());
  EXPECT_EQ(has(data), 6u);
}

TEST_F(Blobs, ASilentClientLosesItsCallAndWhatItSentStays) {
  ServerConfig next = config;
  next.clientIdleSeconds = 0.2;
  ASSERT_TRUE(server->reload(next).ok());
  grpc::ClientContext context;
  sign(context, "");
  v1::PutBlobReply reply;
  auto stub = v1::Blobs::NewStub(channel);
  auto writer = stub->Put(&context, &reply);
  v1::PutBlobRequest head = first("abcdef");
  head.set_data("abc");
  writer->Write(head);
  refused(writer->Finish(), grpc::CANCELLED, {});
  EXPECT_EQ(has("abcdef"), 3u);
}

TEST_F(Blobs, ADigestOfAnothersFileIsWorthNothing) {
  const std::string sky = skyFile(77);
  const SideScene side;
  for (const std::string& data : {sky, side.gltf, side.bin}) ASSERT_TRUE(put(data, "alice").ok());
  v1::OpenSceneRequest request;
  request.set_source("a.gltf");
  request.set_name("mine");
  (*request.mutable_files())["a.gltf"] = hashOf(side.gltf);
  (*request.mutable_files())["data/tri a.bin"] = hashOf(side.bin);
  for (const std::string who : {"bob", ""}) {
    EXPECT_EQ(has(sky, who), 0u) << who;
    const Collected got = renderAs(lit(hashOf(sky)), who);
    const Collected never = renderAs(lit(hashOf("never put")), who);
    EXPECT_EQ(got.status.error_code(), grpc::NOT_FOUND) << who;
    std::string same = never.status.error_message();
    same.replace(same.find(hashOf("never put")), 64, hashOf(sky));
    EXPECT_EQ(got.status.error_message(), same) << "an answer tells that somebody has it";
    v1::SceneInfo info;
    EXPECT_EQ(open(request, info, who).error_code(), grpc::NOT_FOUND) << who;
  }
  // Also where its map is in memory already.
  ASSERT_TRUE(renderAs(lit(hashOf(sky)), "alice").status.ok());
  EXPECT_EQ(renderAs(lit(hashOf(sky)), "bob").status.error_code(), grpc::NOT_FOUND);
  v1::SceneInfo info;
  EXPECT_TRUE(open(request, info, "alice").ok());
  EXPECT_EQ(info.owner(), "alice");
}

TEST_F(Blobs, AnEnvironmentByDigestIsTheFileOnDisk) {
  const std::string sky = skyFile(99);
  ASSERT_TRUE(put(sky).ok());
  std::ofstream(folder + "/root/sky.hdr", std::ios::binary) << sky;
  v1::RenderRequest byPath = small();
  byPath.mutable_environment()->set_path(folder + "/root/sky.hdr");
  std::string upper = hashOf(sky);
  for (char& c : upper) c = char(std::toupper(c));
  const Collected path = renderAs(byPath), digest = renderAs(lit(hashOf(sky))), upperCase = renderAs(lit(upper));
  ASSERT_TRUE(path.status.ok()) << path.status.error_message();
  ASSERT_TRUE(digest.status.ok()) << digest.status.error_message();
  ASSERT_TRUE(upperCase.status.ok()) << upperCase.status.error_message();
  EXPECT_EQ(path.images, digest.images);
  EXPECT_EQ(path.images, upperCase.images);
  for (const auto& node : digest.reply.plan()) EXPECT_NE(node.state(), v1::NodeReport::RUN) << node.node() << " was made for the path already";
  // Relight, plan.
  v1::RelightRequest relight;
  relight.set_render_id(digest.reply.render_id());
  relight.mutable_patch()->mutable_environment()->set_rotation_deg(90);
  relight.add_mask("environment.rotation_deg");
  grpc::ClientContext context;
  sign(context, "");
  auto reader = render->Relight(&context, relight);
  const Collected turned = drain(context, *reader);
  ASSERT_TRUE(turned.status.ok()) << turned.status.error_message();
  EXPECT_NE(turned.images, digest.images);
  grpc::ClientContext planning;
  sign(planning, "");
  v1::PlanReply plan;
  EXPECT_TRUE(render->Plan(&planning, lit(hashOf(sky)), &plan).ok());
  // Nothing of it depends on what is in memory: a daemon that begins gives the same.
  restart();
  const Collected cold = renderAs(lit(hashOf(sky)));
  ASSERT_TRUE(cold.status.ok()) << cold.status.error_message();
  EXPECT_EQ(cold.images, digest.images);
}

TEST_F(Blobs, ASceneByDigestIsTheSceneOnDisk) {
  const SideScene side;
  std::filesystem::create_directory(folder + "/root/data");
  std::ofstream(folder + "/root/tri.gltf", std::ios::binary) << side.gltf;
  std::ofstream(folder + "/root/data/tri a.bin", std::ios::binary) << side.bin;
  v1::OpenSceneRequest disk, files;
  disk.set_source(folder + "/root/tri.gltf");
  disk.set_name("disk");
  files.set_source("tri.gltf");
  (*files.mutable_files())["tri.gltf"] = hashOf(side.gltf);
  v1::SceneInfo onDisk, put1, put2;
  ASSERT_TRUE(open(disk, onDisk).ok());
  ASSERT_TRUE(put(side.gltf).ok());
  // Its buffer lies on this disk where the server may read it, and is read from what was put all the same: or not at all.
  refused(open(files, put1), grpc::NOT_FOUND, {"data/tri a.bin", "beside the glTF"});
  (*files.mutable_files())["data/tri a.bin"] = hashOf(side.bin);
  refused(open(files, put1), grpc::NOT_FOUND, {"open.files[\"data/tri a.bin\"] = " + hashOf(side.bin)});
  ASSERT_TRUE(put(side.bin).ok());
  const grpc::Status opened = open(files, put1);
  ASSERT_TRUE(opened.ok()) << opened.error_message();
  EXPECT_EQ(put1.hash(), onDisk.hash());
  EXPECT_EQ(put1.source().rfind("blobs:", 0), 0u);
  EXPECT_EQ(put1.id(), "tri");
  ASSERT_TRUE(open(files, put2).ok());
  EXPECT_EQ(put2.id(), "tri") << "the same files are the same scene";
  v1::OpenSceneRequest wrong = files;
  wrong.set_source("../tri.gltf");
  refused(open(wrong, put2), grpc::INVALID_ARGUMENT, {"open.source"});
  wrong = files;
  (*wrong.mutable_files())["../up.bin"] = hashOf(side.bin);
  refused(open(wrong, put2), grpc::INVALID_ARGUMENT, {"open.files[\"../up.bin\"]"});
  // While it is loaded its files stay, whatever comes.
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(put("filler " + std::to_string(i)).ok());
  EXPECT_EQ(has(side.bin), side.bin.size());
  v1::UnloadSceneRequest unload;
  unload.set_scene("tri");
  grpc::ClientContext context;
  sign(context, "");
  v1::UnloadSceneReply nothing;
  ASSERT_TRUE(scenes->Unload(&context, unload, &nothing).ok());
  for (int i = 100; i < 200; ++i) ASSERT_TRUE(put("filler " + std::to_string(i)).ok());
  EXPECT_EQ(has(side.bin), 0u) << "the bound is kept by what was used longest ago";
}

TEST_F(Blobs, AJobHasItsFilesAfterARestartThoughTheyAreGone) {
  const SideScene side;
  const std::string sky = skyFile(55);
  for (const std::string& data : {side.gltf, side.bin, sky}) ASSERT_TRUE(put(data, "alice").ok());
  v1::OpenSceneRequest request;
  request.set_source("tri.gltf");
  request.set_name("job-scene");
  (*request.mutable_files())["tri.gltf"] = hashOf(side.gltf);
  (*request.mutable_files())["data/tri a.bin"] = hashOf(side.bin);
  v1::SceneInfo info;
  ASSERT_TRUE(open(request, info, "alice").ok());
  v1::JobSpec spec;
  *spec.mutable_request() = lit(hashOf(sky), "job-scene");
  spec.mutable_request()->mutable_camera()->mutable_position()->set_z(3);
  spec.mutable_request()->mutable_camera()->mutable_look_at()->set_x(0.3f);
  spec.mutable_frames()->set_last(40);
  spec.mutable_request()->mutable_halt()->set_spp(64);
  v1::Job job;
  {
    grpc::ClientContext context;
    sign(context, "bob");
    refused(v1::Jobs::NewStub(tcp)->Submit(&context, spec, &job), grpc::NOT_FOUND, {});
  }
  {
    grpc::ClientContext context;
    sign(context, "alice");
    const grpc::Status status = v1::Jobs::NewStub(tcp)->Submit(&context, spec, &job);
    ASSERT_TRUE(status.ok()) << status.error_message();
  }
  server->shutdown(0);
  server.reset();
  std::filesystem::remove_all(folder + "/blobs");
  std::filesystem::remove_all(folder + "/ingest");
  auto started = Server::start(config, engineOptions(config), true);
  ASSERT_TRUE(started.ok()) << started.status().toString();
  server = std::move(*started);
  connect();
  v1::Job now;
  ASSERT_TRUE(eventually(
      [&] {
        grpc::ClientContext context;
        sign(context, "alice");
        v1::GetJobRequest get;
        get.set_id(job.id());
        EXPECT_TRUE(v1::Jobs::NewStub(tcp)->Get(&context, get, &now).ok());
        return now.state() == v1::Job::DONE || now.state() == v1::Job::FAILED;
      },
      60));
  EXPECT_EQ(now.state(), v1::Job::DONE) << now.error().message();
}

TEST_F(Blobs, DamageOnDiskIsAMissingFileNotAPicture) {
  const std::string sky = skyFile(33);
  ASSERT_TRUE(put(sky).ok());
  server->shutdown(0);
  server.reset();
  for (const auto& e : std::filesystem::recursive_directory_iterator(folder + "/blobs"))
    if (e.path().filename() == hashOf(sky)) {
      std::fstream file(e.path(), std::ios::in | std::ios::out | std::ios::binary);
      file.seekp(-3, std::ios::end);
      file << 'X';
    }
  auto started = Server::start(config, engineOptions(config), true);
  ASSERT_TRUE(started.ok());
  server = std::move(*started);
  connect();
  refused(renderAs(lit(hashOf(sky))).status, grpc::NOT_FOUND, {"put it first"});
  EXPECT_EQ(has(sky), 0u);
  ASSERT_TRUE(put(sky).ok());
  EXPECT_TRUE(renderAs(lit(hashOf(sky))).status.ok());
}

}  // namespace
}  // namespace gobo
