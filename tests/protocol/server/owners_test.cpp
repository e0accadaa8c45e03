// SPDX-License-Identifier: Apache-2.0
// Whose scenes are: what one token opened, another neither sees, renders, patches, replaces nor unloads, unless it is shared; built-ins are
// everybody's and nobody's to change.
#include <fstream>

#include "gobo/v1/jobs.grpc.pb.h"
#include "harness.h"
#include "support/triangle_glb.h"

namespace gobo::owners_test {
namespace {

class Owners : public ServerTest {
 protected:
  void configure(ServerConfig& c) override {
    c.jobsFolder = folder + "/jobs";
    for (const char* name : {"alice", "bob", "carol", "root"}) {
      TokenConfig t;
      t.name = name;
      const std::string secret = std::string("secret-") + name;
      t.sha256 = sha256Hex(secret.data(), secret.size());
      t.admin = t.name == "root";
      t.roots = std::vector<std::string>{folder + "/root"};
      c.tokens.push_back(t);
    }
  }
  void sign(grpc::ClientContext& context, const std::string& name) {
    bound(context);
    if (!name.empty()) context.AddMetadata("authorization", "Bearer secret-" + name);
  }
  template <typename Request, typename Reply>
  grpc::Status call(const std::string& who, grpc::Status (v1::Scenes::Stub::*method)(grpc::ClientContext*, const Request&, Reply*), const Request& request,
                    Reply& reply) {
    grpc::ClientContext context;
    sign(context, who);
    return (scenes.get()->*method)(&context, request, &reply);
  }
  v1::SceneInfo upload(const std::string& who, const std::string& name, const std::vector<std::string>& share = {}, grpc::StatusCode expected = grpc::OK) {
    grpc::ClientContext context;
    sign(context, who);
    v1::SceneInfo info;
    auto writer = scenes->Upload(&context, &info);
    const std::string bytes = triangleGlb();
    v1::UploadSceneRequest m;
    m.set_name(name);
    m.set_extension(".glb");
    m.set_total_bytes(bytes.size());
    m.set_data(bytes);
    for (const std::string& s : share) m.add_share(s);
    writer->Write(m);
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    EXPECT_EQ(status.error_code(), expected) << who << ": " << status.error_message();
    return info;
  }
  grpc::StatusCode renders(const std::string& who, const std::string& scene) {
    grpc::ClientContext context;
    sign(context, who);
    auto reader = render->Render(&context, small(1, scene));
    return drain(context, *reader).status.error_code();
  }
  grpc::StatusCode unloads(const std::string& who, const std::string& scene) {
    v1::UnloadSceneRequest request;
    request.set_scene(scene);
    v1::UnloadSceneReply reply;
    return call(who, &v1::Scenes::Stub::Unload, request, reply).error_code();
  }
  grpc::StatusCode patches(const std::string& who, const std::string& scene) {
    v1::PatchSceneRequest request;
    request.set_scene(scene);
    v1::SceneInfo info;
    return call(who, &v1::Scenes::Stub::Patch, request, info).error_code();
  }
  grpc::StatusCode inspects(const std::string& who, const std::string& scene) {
    v1::InspectSceneRequest request;
    request.set_scene(scene);
    v1::SceneInfo info;
    return call(who, &v1::Scenes::Stub::Inspect, request, info).error_code();
  }
  grpc::StatusCode submits(const std::string& who, const std::string& scene) {
    grpc::ClientContext context;
    sign(context, who);
    v1::JobSpec spec;
    *spec.mutable_request() = small(1, scene);
    v1::Job job;
    return v1::Jobs::NewStub(channel)->Submit(&context, spec, &job).error_code();
  }
  bool lists(const std::string& who, const std::string& scene) {
    v1::ListScenesReply reply;
    EXPECT_TRUE(call(who, &v1::Scenes::Stub::List, v1::ListScenesRequest(), reply).ok());
    return std::any_of(reply.scenes().begin(), reply.scenes().end(), [&](const v1::SceneInfo& s) { return s.id() == scene; });
  }
};

// Every call that names a scene, for each relation of the caller to it.
TEST_F(Owners, TableOfWhoMayWhat) {
  struct Row {
    const char* who;
    grpc::StatusCode use, change;
  };
  const auto expect = [&](const std::string& scene, const std::vector<Row>& rows) {
    for (const Row& row : rows) {
      SCOPED_TRACE(std::string(row.who) + " and " + scene);
      EXPECT_EQ(lists(row.who, scene), row.use == grpc::OK);
      EXPECT_EQ(inspects(row.who, scene), row.use);
      EXPECT_EQ(renders(row.who, scene), row.use);
      EXPECT_EQ(submits(row.who, scene), row.use);
      EXPECT_EQ(patches(row.who, scene), row.change);
      if (row.change != grpc::OK) { EXPECT_EQ(unloads(row.who, scene), row.change); }
    }
  };
  EXPECT_EQ(upload("alice", "hers").owner(), "alice");
  upload("alice", "lent", {"bob"});
  upload("alice", "open", {"*"});
  upload("", "nobodys");
  expect("hers", {{"alice", grpc::OK, grpc::OK}, {"bob", grpc::NOT_FOUND, grpc::NOT_FOUND}, {"root", grpc::OK, grpc::OK}, {"", grpc::OK, grpc::OK}});
  expect("lent", {{"bob", grpc::OK, grpc::PERMISSION_DENIED}, {"carol", grpc::NOT_FOUND, grpc::NOT_FOUND}, {"alice", grpc::OK, grpc::OK}});
  expect("open", {{"bob", grpc::OK, grpc::PERMISSION_DENIED}, {"carol", grpc::OK, grpc::PERMISSION_DENIED}});
  expect("nobodys", {{"bob", grpc::OK, grpc::PERMISSION_DENIED}, {"root", grpc::OK, grpc::OK}});
  EXPECT_EQ(unloads("root", "nobodys"), grpc::OK);
  EXPECT_EQ(unloads("alice", "hers"), grpc::OK);
}

TEST_F(Owners, NamesAreNotTakenOver) {
  upload("alice", "shot", {"bob"});
  upload("bob", "shot", {}, grpc::PERMISSION_DENIED);
  upload("bob", "cornell", {}, grpc::PERMISSION_DENIED);  // a built-in's name, loaded or not
  EXPECT_EQ(upload("alice", "shot").owner(), "alice");    // her own may be replaced
  // Names made from the source: another's is passed by.
  v1::OpenSceneRequest open;
  {
    std::ofstream(folder + "/root/car.glb", std::ios::binary) << triangleGlb();
    open.set_source(folder + "/root/car.glb");
  }
  v1::SceneInfo hers, his, again;
  ASSERT_TRUE(call("alice", &v1::Scenes::Stub::Open, open, hers).ok());
  ASSERT_TRUE(call("bob", &v1::Scenes::Stub::Open, open, his).ok());
  ASSERT_TRUE(call("alice", &v1::Scenes::Stub::Open, open, again).ok());
  EXPECT_EQ(hers.id(), "car");
  EXPECT_EQ(his.id(), "car-2");
  EXPECT_EQ(again.id(), "car");
}

TEST_F(Owners, BuiltInsAreEverybodysAndACopyIsOnesOwn) {
  v1::OpenSceneRequest open;
  open.set_source("cornell");
  v1::SceneInfo info;
  ASSERT_TRUE(call("alice", &v1::Scenes::Stub::Open, open, info).ok());
  EXPECT_EQ(info.owner(), "");
  EXPECT_EQ(patches("alice", "cornell"), grpc::PERMISSION_DENIED);
  EXPECT_EQ(unloads("alice", "cornell"), grpc::PERMISSION_DENIED);
  EXPECT_EQ(renders("bob", "cornell"), grpc::OK);
  open.set_name("my-cornell");
  ASSERT_TRUE(call("alice", &v1::Scenes::Stub::Open, open, info).ok());
  EXPECT_EQ(info.owner(), "alice");
  EXPECT_EQ(patches("alice", "my-cornell"), grpc::OK);
  EXPECT_EQ(renders("bob", "my-cornell"), grpc::NOT_FOUND);
}

// The answer to a path outside the token's roots is the same whether a file is there or not.
TEST_F(Owners, SubmitTellsNothingOfFilesOutsideTheRoots) {
  std::ofstream(folder + "/secret.hdr") << "there";
  const auto submit = [&](const std::string& path) {
    grpc::ClientContext context;
    sign(context, "alice");
    v1::JobSpec spec;
    *spec.mutable_request() = small(1);
    spec.mutable_request()->mutable_environment()->set_path(path);
    v1::Job job;
    const grpc::Status status = v1::Jobs::NewStub(channel)->Submit(&context, spec, &job);
    EXPECT_EQ(status.error_code(), grpc::PERMISSION_DENIED);
    std::string message = status.error_message();
    if (const size_t at = message.find(path); at != std::string::npos) message.erase(at, path.size());
    return message;
  };
  EXPECT_EQ(submit(folder + "/secret.hdr"), submit(folder + "/absent.hdr"));
}

}  // namespace
}  // namespace gobo::owners_test
