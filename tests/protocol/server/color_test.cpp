// SPDX-License-Identifier: Apache-2.0
// Views of an OpenColorIO config over a real server and socket: every call that gives pictures gives the same file, and a daemon whose config is broken does
// not start.
#include <sys/wait.h>

#include <cstdio>

#include "harness.h"
#include "plan/display_transforms.h"
#include "support/color_configs.h"

namespace gobo {
namespace {

struct ColorProtocol : ServerTest {
  void configure(ServerConfig& c) override { c.colorOcio = test::writeColorConfig(folder); }
  static v1::RenderRequest seen(const std::string& view = "Log") {
    v1::RenderRequest r = small(4);
    r.mutable_encoding()->set_format(v1::Encoding::PNG);
    r.mutable_encoding()->set_view(view);
    r.mutable_tone_map()->set_exposure(1);
    return r;
  }
};

TEST_F(ColorProtocol, EveryCallGivesTheSamePicture) {
  const Collected plain = renderOnce(seen());
  ASSERT_TRUE(plain.status.ok()) << plain.status.error_message();
  const v1::Encoding& encoding = plain.reply.resolved().encoding();
  EXPECT_EQ(encoding.display(), "Monitor");
  EXPECT_EQ(encoding.ocio_hash().size(), 32u);
  EXPECT_FALSE(encoding.has_transfer());
  // What it is: the floats of the same render, through the same view.
  v1::RenderRequest floats = seen();
  floats.clear_encoding();
  floats.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
  const Collected linear = renderOnce(floats);
  ASSERT_TRUE(linear.status.ok()) << linear.status.error_message();
  const auto displays = displayTransforms(config);
  const auto processor = displays->processor(encoding);
  ASSERT_TRUE(processor.ok()) << processor.status().toString();
  const auto shown = shownByView(raw(linear), 1, **processor, false);
  ASSERT_TRUE(shown.ok());
  const auto file = encodePng(*shown, {.data = true});
  EXPECT_EQ(plain.images[0], std::string(file->begin(), file->end()));

  grpc::ClientContext progressive;
  bound(progressive);
  auto reader = render->RenderProgressive(&progressive, seen());
  const Collected last = drain(progressive, *reader);
  ASSERT_TRUE(last.status.ok()) << last.status.error_message();
  EXPECT_EQ(last.images, plain.images);

  grpc::ClientContext inlined;
  bound(inlined);
  v1::InlineReply reply;
  ASSERT_TRUE(render->RenderInline(&inlined, seen(), &reply).ok());
  ASSERT_EQ(reply.images_size(), 1);
  EXPECT_EQ(reply.images(0), plain.images[0]);

  // From a picture with a curve to this one, by a relight.
  v1::RenderRequest curve = small(4);
  curve.mutable_encoding()->set_format(v1::Encoding::PNG);
  const Collected before = renderOnce(curve);
  ASSERT_TRUE(before.status.ok());
  EXPECT_NE(before.images, plain.images);
  v1::RelightRequest relight;
  relight.set_render_id(before.reply.render_id());
  relight.mutable_patch()->mutable_encoding()->set_view("Log");
  relight.mutable_patch()->mutable_tone_map()->set_exposure(1);
  relight.add_mask("encoding.view");
  relight.add_mask("tone_map.exposure");
  grpc::ClientContext relit;
  bound(relit);
  auto relighting = render->Relight(&relit, relight);
  const Collected after = drain(relit, *relighting);
  ASSERT_TRUE(after.status.ok()) << after.status.error_message();
  EXPECT_EQ(after.images, plain.images);

  // A part of a picture is that part of it: views look at single pixels.
  v1::RenderRequest part = seen();
  part.mutable_window()->set_x(8);
  part.mutable_window()->set_y(4);
  part.mutable_window()->set_width(20);
  part.mutable_window()->set_height(10);
  const Collected window = renderOnce(part);
  ASSERT_TRUE(window.status.ok()) << window.status.error_message();
  Image cut(20, 10, 3);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 20; ++x) std::copy_n(shown->at(x + 8, y + 4), 3, cut.at(x, y));
  const auto cutFile = encodePng(cut, {.data = true});
  EXPECT_EQ(window.images[0], std::string(cutFile->begin(), cutFile->end()));
}

TEST_F(ColorProtocol, ARefusalComesBeforeTheRender) {
  v1::RenderRequest r = seen("Flim");
  const Collected none = renderOnce(r);
  EXPECT_EQ(none.status.error_code(), grpc::INVALID_ARGUMENT);
  EXPECT_NE(none.status.error_message().find("request.encoding.view = \"Flim\""), std::string::npos) << none.status.error_message();
  EXPECT_NE(none.status.error_message().find("\"Power\""), std::string::npos) << none.status.error_message();
  grpc::ClientContext context;
  bound(context);
  v1::PlanReply plan;
  EXPECT_EQ(render->Plan(&context, r, &plan).error_code(), grpc::INVALID_ARGUMENT);
  EXPECT_EQ(status().renders(), 0u);
}

TEST_F(ColorProtocol, ABrokenConfigIsSaidByACheckAndKeepsADaemonFromStarting) {
  server->shutdown(0);
  server.reset();
  const auto gobod = [&](const std::string& arguments, std::string& said) {
    FILE* pipe =
        ::popen(("timeout 60 " GOBOD_PATH " --config '" + folder + "/g.toml' --listen 'unix:" + folder + "/d.sock' " + arguments + " 2>&1").c_str(), "r");
    said.clear();
    char part[512];
    while (const size_t n = std::fread(part, 1, sizeof part, pipe)) said.append(part, n);
    const int ended = ::pclose(pipe);
    return WIFEXITED(ended) ? WEXITSTATUS(ended) : -1;
  };
  std::string said;
  test::writeText(folder + "/g.toml", "[color]\nocio = \"config.ocio\"\n");  // relative to its folder
  EXPECT_EQ(gobod("--check", said), 0) << said;
  std::filesystem::remove(folder + "/half.spi1d");
  EXPECT_EQ(gobod("--check", said), 2) << said;
  EXPECT_NE(said.find("view \"Half\""), std::string::npos) << said;
  EXPECT_NE(said.find("half.spi1d"), std::string::npos) << said;
  test::writeText(folder + "/config.ocio", "ocio_profile_version: 2\ndisplays: [");
  for (const char* arguments : {"--check", ""}) {
    EXPECT_EQ(gobod(arguments, said), 2) << said;
    EXPECT_NE(said.find("config.ocio"), std::string::npos) << said;
    EXPECT_EQ(said.find("ready"), std::string::npos) << said;
  }
  // The variable, which a key goes before, and "none" before both.
  ::setenv("OCIO", (folder + "/config.ocio").c_str(), 1);
  test::writeText(folder + "/g.toml", "[color]\nocio = \"none\"\n");
  EXPECT_EQ(gobod("--check", said), 0) << said;
  test::writeText(folder + "/g.toml", "");
  EXPECT_EQ(gobod("--check", said), 2) << said;
  test::writeColorConfig(folder);
  EXPECT_EQ(gobod("--check", said), 0) << said;
  test::writeText(folder + "/g.toml", "[color]\nworking_space = \"nowhere\"\n");
  EXPECT_EQ(gobod("--check", said), 2) << said;
  EXPECT_NE(said.find("color.working_space = \"nowhere\""), std::string::npos) << said;
  ::unsetenv("OCIO");
}

}  // namespace
}  // namespace gobo
