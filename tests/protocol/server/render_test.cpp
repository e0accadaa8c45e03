// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <thread>

#include "base/image_io.h"
#include "harness.h"
#include "request/request.h"

namespace gobo {
namespace {

class RenderProtocol : public ServerTest {};

TEST_F(RenderProtocol, RawPictureIsFiniteAndLit) {
  const Collected got = renderOnce(small());
  ASSERT_TRUE(got.status.ok()) << got.status.error_message();
  ASSERT_EQ(got.images.size(), 1u);
  const Image image = raw(got);
  EXPECT_EQ(image.width, 64);
  EXPECT_EQ(image.height, 48);
  double sum = 0;
  for (const float v : image.data) {
    ASSERT_TRUE(std::isfinite(v));
    sum += v;
  }
  EXPECT_GT(sum, 0);
  EXPECT_FALSE(got.reply.render_id().empty());
  EXPECT_FALSE(got.reply.request_hash().empty());
  EXPECT_GT(got.reply.plan_size(), 0);
  EXPECT_GT(got.reply.total_ms(), 0);
  EXPECT_EQ(got.reply.resolved().integrator().russian_roulette_start(), 3u);  // a default of the schema, filled in
}

TEST_F(RenderProtocol, ResolvedRequestGivesTheSameBitsAfterTheCachesAreGone) {
  const Collected first = renderOnce(small());
  ASSERT_TRUE(first.status.ok()) << first.status.error_message();
  grpc::ClientContext context;
  bound(context);
  v1::DropCachesReply dropped;
  ASSERT_TRUE(admin->DropCaches(&context, {}, &dropped).ok());
  const Collected second = renderOnce(first.reply.resolved());
  ASSERT_TRUE(second.status.ok()) << second.status.error_message();
  EXPECT_EQ(first.images, second.images);
  EXPECT_EQ(first.reply.request_hash(), second.reply.request_hash());
}

TEST_F(RenderProtocol, EveryFormatDecodesToTheSamePicture) {
  v1::RenderRequest request = small();
  request.mutable_tone_map()->set_curve(v1::ToneMap::LINEAR);
  const Image truth = raw(renderOnce(request));
  const auto decoded = [&](v1::Encoding::Format format, const char* name) {
    request.mutable_encoding()->set_format(format);
    const Collected got = renderOnce(request);
    EXPECT_TRUE(got.status.ok()) << got.status.error_message();
    auto image = readImageFromMemory(reinterpret_cast<const uint8_t*>(got.images.at(0).data()), got.images.at(0).size(), name);
    EXPECT_TRUE(image.ok()) << image.status().toString();
    return *image;
  };
  const Image exr = decoded(v1::Encoding::EXR, "x.exr");
  ASSERT_EQ(exr.pixels(), truth.pixels());
  for (int y = 0; y < truth.height; ++y)
    for (int x = 0; x < truth.width; ++x) ASSERT_EQ(exr.rgb(x, y), truth.rgb(x, y)) << x << "," << y;
  const Image png = decoded(v1::Encoding::PNG, "x.png");
  const auto srgb = [](float v) {
    v = std::min(std::max(v, 0.0f), 1.0f);
    return v <= 0.0031308f ? 12.92f * v : 1.055f * std::pow(v, 1 / 2.4f) - 0.055f;
  };
  for (int y = 0; y < truth.height; ++y)
    for (int x = 0; x < truth.width; ++x)
      for (int c = 0; c < 3; ++c) ASSERT_NEAR(png.at(x, y)[c], srgb(truth.at(x, y)[c]), 0.51 / 255 + 1e-4) << x << "," << y;
}

TEST_F(RenderProtocol, SeveralOutputsArriveInOrder) {
  v1::RenderRequest request = small();
  for (const char* name : {"depth", "beauty", "normal", "albedo"}) request.add_outputs(name);
  const Collected got = renderOnce(request);
  ASSERT_TRUE(got.status.ok()) << got.status.error_message();
  ASSERT_EQ(got.reply.images_size(), 4);
  EXPECT_EQ(got.reply.images(0).output(), "depth");
  EXPECT_EQ(got.reply.images(2).output(), "normal");
  const Image normal = raw(got, 2);
  ASSERT_EQ(normal.channels, 3);
}

TEST_F(RenderProtocol, PicturesLargerThanAChunkComeInSeveral) {
  v1::RenderRequest request = small(1);
  request.set_width(700);
  request.set_height(200);
  grpc::ClientContext context;
  bound(context);
  auto reader = render->Render(&context, request);
  int chunks = 0;
  const Collected got = drain(context, *reader, [&](const v1::RenderEvent& e) {
    chunks += e.has_chunk();
    if (e.has_chunk()) { EXPECT_LE(e.chunk().data().size(), 1u << 20); }
  });
  ASSERT_TRUE(got.status.ok()) << got.status.error_message();
  EXPECT_EQ(chunks, int((got.images[0].size() + (1 << 20) - 1) >> 20));
  EXPECT_GT(chunks, 1);
}

TEST_F(RenderProtocol, InlineIsTheSamePicture) {
  const Collected streamed = renderOnce(small());
  grpc::ClientContext context;
  bound(context);
  v1::InlineReply reply;
  const grpc::Status status = render->RenderInline(&context, small(), &reply);
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(reply.images_size(), 1);
  EXPECT_EQ(reply.images(0), streamed.images[0]);
}

TEST_F(RenderProtocol, APlanRunsNothing) {
  grpc::ClientContext context;
  bound(context);
  v1::PlanReply reply;
  const grpc::Status status = render->Plan(&context, small(), &reply);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_GT(reply.rays(), 0u);
  EXPECT_GT(reply.pinned_bytes(), 0u);
  const Collected done = renderOnce(small());
  EXPECT_EQ(reply.plan_size(), done.reply.plan_size());
  v1::RenderRequest wrong = small();
  wrong.set_width(0);
  grpc::ClientContext second;
  bound(second);
  EXPECT_EQ(render->Plan(&second, wrong, &reply).error_code(), renderOnce(wrong).status.error_code());
}

TEST_F(RenderProtocol, RelightDoublesWhatItsGainDoubles) {
  const Collected first = renderOnce(small(16));
  ASSERT_TRUE(first.status.ok()) << first.status.error_message();
  v1::RelightRequest relight;
  relight.set_render_id(first.reply.render_id());
  ASSERT_TRUE(setPath(*relight.mutable_patch(), "lights.light.gain=2,2,2").ok());
  relight.add_mask("lights.light.gain");
  grpc::ClientContext context;
  bound(context);
  auto reader = render->Relight(&context, relight);
  const Collected second = drain(context, *reader);
  ASSERT_TRUE(second.status.ok()) << second.status.error_message();
  const Image a = raw(first), b = raw(second);
  double most = 0;
  for (size_t i = 0; i < a.data.size(); ++i) most = std::max(most, double(std::abs(b.data[i] - 2 * a.data[i])) / (1e-3 + std::abs(a.data[i])));
  EXPECT_LT(most, 1e-4);  // cornell has one light, so all of the picture scales
}

TEST_F(RenderProtocol, ProgressiveShowsPicturesOnTheWayToTheSameAnswer) {
  const Collected direct = renderOnce(small(64));
  v1::DropCachesReply dropped;
  {
    grpc::ClientContext context;
    bound(context);
    ASSERT_TRUE(admin->DropCaches(&context, {}, &dropped).ok());
  }
  grpc::ClientContext context;
  bound(context);
  auto reader = render->RenderProgressive(&context, small(64));
  bool replied = false;
  const Collected got = drain(context, *reader, [&](const v1::RenderEvent& e) {
    EXPECT_FALSE(replied && (e.has_snapshot() || e.has_progress() || e.has_reply())) << "nothing but chunks may follow the reply";
    replied |= e.has_reply();
  });
  ASSERT_TRUE(got.status.ok()) << got.status.error_message();
  EXPECT_TRUE(replied);
  EXPECT_GE(got.snapshots, 1);
  EXPECT_EQ(got.images, direct.images);
}

TEST_F(RenderProtocol, TwoClientsInParallelGetWhatTheyWouldGetAlone) {
  v1::RenderRequest a = small(8), b = small(8);
  b.set_seed(99);
  b.mutable_scheduling()->set_client("other");
  const Collected aloneA = renderOnce(a), aloneB = renderOnce(b);
  ASSERT_TRUE(aloneA.status.ok()) << aloneA.status.error_message();
  ASSERT_NE(aloneA.images, aloneB.images);
  v1::DropCachesReply dropped;
  grpc::ClientContext context;
  bound(context);
  ASSERT_TRUE(admin->DropCaches(&context, {}, &dropped).ok());
  Collected togetherA, togetherB;
  std::thread other([&] { togetherB = renderOnce(b); });
  togetherA = renderOnce(a);
  other.join();
  EXPECT_EQ(togetherA.images, aloneA.images);
  EXPECT_EQ(togetherB.images, aloneB.images);
}

TEST_F(RenderProtocol, TheInProcessChannelIsTheSameServer) {
  const Collected socket = renderOnce(small());
  auto local = v1::Render::NewStub(server->inProcessChannel());
  grpc::ClientContext context;
  bound(context);
  auto reader = local->Render(&context, small());
  const Collected got = drain(context, *reader);
  ASSERT_TRUE(got.status.ok()) << got.status.error_message();
  EXPECT_EQ(got.images, socket.images);
}

}  // namespace
}  // namespace gobo
