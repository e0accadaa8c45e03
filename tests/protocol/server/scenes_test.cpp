// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "harness.h"
#include "support/triangle_glb.h"

namespace gobo {
namespace {

class ScenesProtocol : public ServerTest {
 protected:
  void configure(ServerConfig& c) override { c.uploadBytes = 1 << 20; }
  grpc::Status upload(const std::string& bytes, v1::UploadSceneRequest first, v1::SceneInfo* info, size_t piece = 100) {
    grpc::ClientContext context;
    bound(context);
    auto writer = scenes->Upload(&context, info);
    first.set_data(bytes.substr(0, piece));
    bool open = writer->Write(first);
    for (size_t at = piece; open && at < bytes.size(); at += piece) {
      v1::UploadSceneRequest next;
      next.set_data(bytes.substr(at, piece));
      open = writer->Write(next);
    }
    writer->WritesDone();
    return writer->Finish();
  }
  static v1::UploadSceneRequest first(const std::string& bytes, const std::string& name) {
    v1::UploadSceneRequest m;
    m.set_name(name);
    m.set_extension(".glb");
    m.set_total_bytes(bytes.size());
    m.set_sha256(sha256Hex(bytes.data(), bytes.size()));
    return m;
  }
  bool tmpEmpty() const { return std::filesystem::directory_iterator(folder + "/tmp") == std::filesystem::directory_iterator(); }
};

TEST_F(ScenesProtocol, OpenListInspectUnload) {
  v1::SceneInfo info;
  {
    grpc::ClientContext context;
    bound(context);
    v1::OpenSceneRequest request;
    request.set_source("cornell");
    request.set_name("box");
    const grpc::Status status = scenes->Open(&context, request, &info);
    ASSERT_TRUE(status.ok()) << status.error_message();
  }
  EXPECT_EQ(info.id(), "box");
  EXPECT_GT(info.triangles(), 0u);
  ASSERT_GT(info.lights_size(), 0);
  EXPECT_GT(info.cameras_size(), 0);
  EXPECT_FALSE(info.hash().empty());
  {
    grpc::ClientContext context;
    bound(context);
    v1::ListScenesReply list;
    ASSERT_TRUE(scenes->List(&context, {}, &list).ok());
    ASSERT_EQ(list.scenes_size(), 1);
    EXPECT_EQ(list.scenes(0).hash(), info.hash());
    EXPECT_NE(std::find(list.builtin().begin(), list.builtin().end(), "cornell"), list.builtin().end());
  }
  {
    grpc::ClientContext context;
    bound(context);
    v1::InspectSceneRequest request;
    request.set_scene("box");
    v1::SceneInfo again;
    ASSERT_TRUE(scenes->Inspect(&context, request, &again).ok());
    EXPECT_EQ(again.hash(), info.hash());
  }
  v1::UnloadSceneRequest unload;
  unload.set_scene("box");
  v1::UnloadSceneReply nothing;
  {
    grpc::ClientContext context;
    bound(context);
    ASSERT_TRUE(scenes->Unload(&context, unload, &nothing).ok());
  }
  {
    grpc::ClientContext context;
    bound(context);
    EXPECT_EQ(scenes->Unload(&context, unload, &nothing).error_code(), grpc::NOT_FOUND);
  }
}

TEST_F(ScenesProtocol, UploadRoundTrip) {
  const std::string glb = triangleGlb();
  v1::SceneInfo info;
  const grpc::Status status = upload(glb, first(glb, "tri"), &info);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(info.id(), "tri");
  EXPECT_EQ(info.triangles(), 1u);
  EXPECT_TRUE(tmpEmpty());
  v1::RenderRequest request = small(1, "tri");
  request.mutable_camera()->mutable_position()->set_z(3);
  request.mutable_camera()->mutable_look_at()->set_x(0.3f);
  const Collected got = renderOnce(request);
  EXPECT_TRUE(got.status.ok()) << got.status.error_message();
}

TEST_F(ScenesProtocol, UploadThatIsDamagedOrTooLargeLeavesNothing) {
  const std::string glb = triangleGlb();
  v1::SceneInfo info;
  v1::UploadSceneRequest wrong = first(glb, "a");
  wrong.set_sha256(std::string(64, '0'));
  grpc::Status status = upload(glb, wrong, &info);
  EXPECT_EQ(status.error_code(), grpc::INVALID_ARGUMENT);
  EXPECT_NE(status.error_message().find("sha256"), std::string::npos) << status.error_message();

  v1::UploadSceneRequest big = first(glb, "b");
  big.set_total_bytes((1 << 20) + 1);
  status = upload(glb, big, &info);
  EXPECT_EQ(status.error_code(), grpc::RESOURCE_EXHAUSTED);
  EXPECT_NE(status.error_message().find("1048577"), std::string::npos) << status.error_message();

  v1::UploadSceneRequest lies = first(glb, "c");
  lies.set_total_bytes(10);
  lies.clear_sha256();
  EXPECT_EQ(upload(glb, lies, &info).error_code(), grpc::INVALID_ARGUMENT);
  lies.set_total_bytes(glb.size() + 10);
  EXPECT_EQ(upload(glb, lies, &info).error_code(), grpc::INVALID_ARGUMENT);

  std::string broken = glb;
  broken[30] = '\0';
  status = upload(broken, first(broken, "d"), &info);
  EXPECT_FALSE(status.ok());
  EXPECT_NE(status.error_code(), grpc::INTERNAL) << status.error_message();

  EXPECT_TRUE(tmpEmpty());
  EXPECT_EQ(server->core().engine.listScenes().size(), 0u);
}

TEST_F(ScenesProtocol, UploadCutOffHalfWayLeavesNothing) {
  const std::string glb = triangleGlb();
  {
    grpc::ClientContext context;
    bound(context);
    v1::SceneInfo info;
    auto writer = scenes->Upload(&context, &info);
    v1::UploadSceneRequest m = first(glb, "half");
    m.set_data(glb.substr(0, 50));
    ASSERT_TRUE(writer->Write(m));
    ASSERT_TRUE(eventually([&] { return !tmpEmpty(); }));
    context.TryCancel();
    EXPECT_EQ(writer->Finish().error_code(), grpc::CANCELLED);
  }
  EXPECT_TRUE(eventually([&] { return tmpEmpty(); }));
  EXPECT_EQ(server->core().engine.listScenes().size(), 0u);
}

}  // namespace
}  // namespace gobo
