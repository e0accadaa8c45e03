// SPDX-License-Identifier: Apache-2.0
// Jobs whose pictures go through a view: their config is part of what was asked for.
#include "gobo/v1/jobs.grpc.pb.h"
#include "protocol/server/harness.h"
#include "server/jobs/durable_jobs.h"
#include "support/color_configs.h"

namespace gobo {
namespace {

struct ColorJobs : ServerTest {
  std::unique_ptr<v1::Jobs::Stub> jobs;
  void configure(ServerConfig& c) override {
    c.jobsFolder = folder + "/jobs";
    c.jobsCheckpointSeconds = 0.1;
    c.colorOcio = test::writeColorConfig(folder);
  }
  void SetUp() override {
    ServerTest::SetUp();
    jobs = v1::Jobs::NewStub(channel);
  }
  v1::Job submit(uint32_t spp, const std::string& view = "Log", uint32_t tile = 0) {
    v1::JobSpec s;
    if (tile) s.set_tile_px(tile);
    *s.mutable_request() = small(spp);
    s.mutable_request()->mutable_encoding()->set_format(v1::Encoding::PNG);
    s.mutable_request()->mutable_encoding()->set_view(view);
    grpc::ClientContext context;
    bound(context);
    v1::Job job;
    const grpc::Status status = jobs->Submit(&context, s, &job);
    EXPECT_TRUE(status.ok() || view != "Log") << status.error_message();
    message = status.error_message();
    return job;
  }
  v1::Job get(const std::string& id) {
    grpc::ClientContext context;
    bound(context);
    v1::GetJobRequest r;
    r.set_id(id);
    v1::Job job;
    EXPECT_TRUE(jobs->Get(&context, r, &job).ok());
    return job;
  }
  /// `betweenTheTwo` happens while no daemon runs: one that runs may notice a changed config by itself, and fail the frame before it is stopped.
  void restart(const std::function<void()>& betweenTheTwo = [] {}) {
    jobs.reset();
    server->shutdown(0);
    server.reset();
    betweenTheTwo();
    auto again = Server::start(config, engineOptions(config), true);
    ASSERT_TRUE(again.ok()) << again.status().toString();
    server = std::move(*again);
    channel = server->inProcessChannel();
    jobs = v1::Jobs::NewStub(channel);
  }
  std::string message;
};

TEST_F(ColorJobs, AFrameIsThePictureOfARender) {
  submit(4, "Flim");
  EXPECT_NE(message.find("Flim"), std::string::npos) << "told when it is submitted: " << message;
  const v1::Job job = submit(4);
  EXPECT_EQ(job.spec().request().encoding().display(), "Monitor");
  EXPECT_EQ(job.spec().request().encoding().ocio_hash().size(), 32u);
  ASSERT_TRUE(eventually([&] { return get(job.id()).state() == v1::Job::DONE; }));
  v1::RenderRequest same = job.spec().request();
  same.clear_scheduling();
  const Collected picture = renderOnce(same);
  ASSERT_TRUE(picture.status.ok()) << picture.status.error_message();
  const v1::Job done = get(job.id());
  ASSERT_EQ(done.frames_size(), 1);
  EXPECT_EQ(done.frames(0).files(0).sha256(), sha256Hex(picture.images[0].data(), picture.images[0].size()));
}

TEST_F(ColorJobs, AFrameInPartsIsTheSamePicture) {
  const v1::Job whole = submit(4), split = submit(4, "Log", 16);
  for (const v1::Job& job : {whole, split}) ASSERT_TRUE(eventually([&] { return get(job.id()).state() == v1::Job::DONE; })) << get(job.id()).DebugString();
  EXPECT_GT(get(split.id()).frames(0).parts(), 1u);
  EXPECT_EQ(get(split.id()).frames(0).files(0).sha256(), get(whole.id()).frames(0).files(0).sha256());
}

TEST_F(ColorJobs, AnotherConfigAfterARestartFailsTheRestAndSaysWhy) {
  const v1::Job job = submit(1 << 20);
  ASSERT_TRUE(eventually([&] { return get(job.id()).state() == v1::Job::RUNNING; }));
  restart();
  ASSERT_TRUE(eventually([&] { return get(job.id()).state() == v1::Job::RUNNING; })) << "the same config: it goes on";
  restart([&] {
    test::ColorConfigParts other;
    other.lutTop = 0.25f;
    test::writeColorConfig(folder, other);
  });
  ASSERT_TRUE(eventually([&] { return get(job.id()).state() == v1::Job::FAILED; }));
  const std::string text = get(job.id()).DebugString();
  EXPECT_NE(text.find("request.encoding.ocio_hash"), std::string::npos) << text;
  EXPECT_NE(text.find(job.spec().request().encoding().ocio_hash()), std::string::npos) << text;
}

}  // namespace
}  // namespace gobo
