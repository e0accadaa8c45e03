// SPDX-License-Identifier: Apache-2.0
// A frame that crashes the daemon is not started for ever: the next daemon sets it aside with the reason and renders the rest. The crash is
// a signal sent from outside while the frame is rendered, which is what a fault of the renderer looks like to the process.
#include <gtest/gtest.h>
#include <signal.h>

#include "daemon.h"

namespace gobo::crash_test {
namespace {

using test::Daemon;

v1::JobSpec spec(const std::string& key, uint32_t spp) {
  v1::JobSpec s;
  s.set_key(key);
  v1::RenderRequest& r = *s.mutable_request();
  r.set_scene("cornell");
  r.set_width(32);
  r.set_height(32);
  r.mutable_halt()->set_spp(spp);
  r.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
  return s;
}

v1::Job call(const Daemon& daemon, const std::function<grpc::Status(v1::Jobs::Stub&, grpc::ClientContext&, v1::Job&)>& what) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(30));
  v1::Job job;
  const auto stub = v1::Jobs::NewStub(daemon.channel());
  const grpc::Status status = what(*stub, context, job);
  EXPECT_TRUE(status.ok()) << status.error_message();
  return job;
}

v1::Job get(const Daemon& daemon, const std::string& id) {
  return call(daemon, [&](v1::Jobs::Stub& stub, grpc::ClientContext& context, v1::Job& job) {
    v1::GetJobRequest request;
    request.set_id(id);
    return stub.Get(&context, request, &job);
  });
}

v1::Job submit(const Daemon& daemon, const v1::JobSpec& spec) {
  return call(daemon, [&](v1::Jobs::Stub& stub, grpc::ClientContext& context, v1::Job& job) { return stub.Submit(&context, spec, &job); });
}

bool eventually(const std::function<bool()>& what) {
  for (int i = 0; i < 1200; ++i) {
    if (what()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return false;
}

uint32_t samplesOf(const Daemon& daemon, const std::string& id) {
  const v1::Job job = get(daemon, id);
  return job.frames_size() == 1 ? job.frames(0).spp() : 0;
}
/// Not merely claimed, with what its last checkpoint has: samples were added.
bool rendering(const Daemon& daemon, const std::string& id, uint32_t before) {
  const v1::Job job = get(daemon, id);
  return job.frames_size() == 1 && job.frames(0).state() == v1::Frame::RUNNING && job.frames(0).spp() > before;
}

TEST(Crash, SetsTheFrameAsideAndAKillDoesNot) {
  test::TemporaryFolder folder;
  Daemon daemon(folder.path, 1);
  ASSERT_TRUE(daemon.start());
  const std::string culprit = submit(daemon, spec("culprit", 60000)).id();
  const std::string after = submit(daemon, spec("after", 16)).id();
  ASSERT_TRUE(eventually([&] { return rendering(daemon, culprit, 0); }));
  const int killed = daemon.kill(SIGKILL);
  ASSERT_TRUE(WIFSIGNALED(killed) && WTERMSIG(killed) == SIGKILL);
  ASSERT_TRUE(daemon.start());
  const uint32_t before = samplesOf(daemon, culprit);
  ASSERT_TRUE(eventually([&] { return rendering(daemon, culprit, before); })) << "a kill from outside says nothing of the frame";
  const int crashed = daemon.kill(SIGSEGV);
  ASSERT_TRUE(WIFSIGNALED(crashed) && WTERMSIG(crashed) == SIGSEGV);
  ASSERT_TRUE(daemon.start());
  const v1::Job job = get(daemon, culprit);
  EXPECT_EQ(job.state(), v1::Job::FAILED);
  ASSERT_EQ(job.frames_size(), 1);
  EXPECT_NE(job.frames(0).error().message().find("SIGSEGV"), std::string::npos) << job.frames(0).error().message();
  EXPECT_TRUE(eventually([&] { return get(daemon, after).state() == v1::Job::DONE; }));
  daemon.kill(SIGTERM);
}

}  // namespace
}  // namespace gobo::crash_test
