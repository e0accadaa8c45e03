// SPDX-License-Identifier: Apache-2.0
// Bad input: the right code, and a message that names the field and the value.
#include <fstream>
#include <limits>

#include "harness.h"

namespace gobo {
namespace {

class Errors : public ServerTest {
 protected:
  void expect(const v1::RenderRequest& request, grpc::StatusCode code, const std::vector<std::string>& words) {
    const Collected got = renderOnce(request);
    EXPECT_EQ(got.status.error_code(), code) << got.status.error_message();
    EXPECT_TRUE(got.images.empty());
    for (const std::string& word : words) EXPECT_NE(got.status.error_message().find(word), std::string::npos) << word << " in: " << got.status.error_message();
  }
};

TEST_F(Errors, UnknownScene) { expect(small(4, "no-such-scene"), grpc::NOT_FOUND, {"no-such-scene", "scene"}); }
TEST_F(Errors, EmptyScene) { expect(small(4, ""), grpc::INVALID_ARGUMENT, {"scene"}); }

TEST_F(Errors, WidthZero) {
  v1::RenderRequest request = small();
  request.set_width(0);
  expect(request, grpc::INVALID_ARGUMENT, {"width", "0"});
}

TEST_F(Errors, WidthTooLarge) {
  v1::RenderRequest request = small();
  request.set_width(70000);
  expect(request, grpc::INVALID_ARGUMENT, {"width", "70000"});
}

TEST_F(Errors, UnknownOutput) {
  v1::RenderRequest request = small();
  request.add_outputs("beautty");
  expect(request, grpc::INVALID_ARGUMENT, {"output", "beautty"});
}

TEST_F(Errors, NumbersThatAreNone) {
  v1::RenderRequest request = small();
  request.mutable_tone_map()->set_exposure(std::numeric_limits<double>::quiet_NaN());
  expect(request, grpc::INVALID_ARGUMENT, {"tone_map.exposure", "nan"});
  request = small();
  (*request.mutable_lights())["light"].mutable_gain()->set_x(std::numeric_limits<float>::quiet_NaN());
  expect(request, grpc::INVALID_ARGUMENT, {"light", "gain"});
  request = small();
  request.mutable_halt()->set_time_s(std::numeric_limits<double>::infinity());
  expect(request, grpc::INVALID_ARGUMENT, {"halt.time_s", "inf"});
}

TEST_F(Errors, UnknownLight) {
  v1::RenderRequest request = small();
  (*request.mutable_lights())["no-such-light"].set_intensity(3);
  const Collected got = renderOnce(request);
  EXPECT_TRUE(got.status.error_code() == grpc::INVALID_ARGUMENT || got.status.error_code() == grpc::NOT_FOUND) << got.status.error_code();
  EXPECT_NE(got.status.error_message().find("no-such-light"), std::string::npos) << got.status.error_message();
}

TEST_F(Errors, UnknownCamera) {
  v1::RenderRequest request = small();
  request.mutable_camera()->set_name("behind");
  const Collected got = renderOnce(request);
  EXPECT_TRUE(got.status.error_code() == grpc::INVALID_ARGUMENT || got.status.error_code() == grpc::NOT_FOUND) << got.status.error_code();
  EXPECT_NE(got.status.error_message().find("behind"), std::string::npos) << got.status.error_message();
}

TEST_F(Errors, EnvironmentOutsideTheRoots) {
  std::ofstream(folder + "/secret.hdr") << "x";
  v1::RenderRequest request = small();
  request.mutable_environment()->set_path(folder + "/secret.hdr");
  expect(request, grpc::PERMISSION_DENIED, {"secret.hdr"});
  request.mutable_environment()->set_path(folder + "/root/../secret.hdr");
  expect(request, grpc::PERMISSION_DENIED, {"secret.hdr"});
  std::filesystem::create_symlink(folder + "/secret.hdr", folder + "/root/link.hdr");
  request.mutable_environment()->set_path(folder + "/root/link.hdr");
  expect(request, grpc::PERMISSION_DENIED, {"link.hdr"});
}

TEST_F(Errors, SceneOutsideTheRoots) {
  std::ofstream(folder + "/secret.glb") << "x";
  for (const std::string& path : {folder + "/secret.glb", std::string("/etc/passwd")}) {
    grpc::ClientContext context;
    bound(context);
    v1::OpenSceneRequest request;
    request.set_source(path);
    v1::SceneInfo info;
    const grpc::Status status = scenes->Open(&context, request, &info);
    EXPECT_EQ(status.error_code(), grpc::PERMISSION_DENIED) << status.error_message();
    EXPECT_NE(status.error_message().find(path), std::string::npos) << status.error_message();
  }
}

TEST_F(Errors, RelightOfNothing) {
  v1::RelightRequest relight;
  relight.set_render_id("r-none");
  grpc::ClientContext context;
  bound(context);
  auto reader = render->Relight(&context, relight);
  const Collected got = drain(context, *reader);
  EXPECT_EQ(got.status.error_code(), grpc::NOT_FOUND);
  EXPECT_NE(got.status.error_message().find("r-none"), std::string::npos);
}

TEST_F(Errors, RelightMaskThatNamesNoField) {
  const Collected first = renderOnce(small());
  v1::RelightRequest relight;
  relight.set_render_id(first.reply.render_id());
  relight.add_mask("lights.light.colour");
  grpc::ClientContext context;
  bound(context);
  auto reader = render->Relight(&context, relight);
  const Collected got = drain(context, *reader);
  EXPECT_EQ(got.status.error_code(), grpc::INVALID_ARGUMENT);
  EXPECT_NE(got.status.error_message().find("colour"), std::string::npos) << got.status.error_message();
}

TEST_F(Errors, InlineRefusesWhatDoesNotFitBeforeItRenders) {
  v1::RenderRequest request = small(1);
  request.set_width(8000);
  request.set_height(8000);
  grpc::ClientContext context;
  bound(context);
  v1::InlineReply reply;
  const grpc::Status status = render->RenderInline(&context, request, &reply);
  EXPECT_EQ(status.error_code(), grpc::OUT_OF_RANGE) << status.error_message();
  EXPECT_NE(status.error_message().find("Render"), std::string::npos);
}

TEST_F(Errors, TheServerLivesOn) {
  expect(small(4, "x"), grpc::NOT_FOUND, {});
  EXPECT_TRUE(renderOnce(small()).status.ok());
}

}  // namespace
}  // namespace gobo
