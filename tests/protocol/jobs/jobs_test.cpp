// SPDX-License-Identifier: Apache-2.0
// gobo.v1.Jobs over a real server and socket.
#include <thread>

#include "gobo/v1/jobs.grpc.pb.h"
#include "protocol/server/harness.h"
#include "server/jobs/durable_jobs.h"
#include "support/triangle_glb.h"

namespace gobo {
namespace {

struct JobsTest : ServerTest {
  std::unique_ptr<v1::Jobs::Stub> jobs;
  void configure(ServerConfig& c) override {
    c.jobsFolder = folder + "/jobs";
    c.jobsCheckpointSeconds = 0.1;
  }
  void SetUp() override {
    ServerTest::SetUp();
    jobs = v1::Jobs::NewStub(channel);
  }
  v1::JobSpec spec(uint32_t spp = 4, int frames = 1) {
    v1::JobSpec s;
    s.set_name("shot");
    *s.mutable_request() = small(spp);
    s.mutable_frames()->set_first(1);
    s.mutable_frames()->set_last(frames);
    return s;
  }
  v1::Job submit(const v1::JobSpec& s, grpc::StatusCode expected = grpc::OK) {
    grpc::ClientContext context;
    bound(context);
    v1::Job job;
    const grpc::Status status = jobs->Submit(&context, s, &job);
    EXPECT_EQ(status.error_code(), expected) << status.error_message();
    message = status.error_message();
    return job;
  }
  template <typename Request, typename Reply>
  grpc::Status call(grpc::Status (v1::Jobs::Stub::*method)(grpc::ClientContext*, const Request&, Reply*), const Request& request, Reply& reply) {
    grpc::ClientContext context;
    bound(context);
    return (jobs.get()->*method)(&context, request, &reply);
  }
  /// As scene "mine".
  void uploadTriangle() {
    const std::string bytes = triangleGlb();
    grpc::ClientContext context;
    bound(context);
    v1::SceneInfo info;
    auto writer = scenes->Upload(&context, &info);
    v1::UploadSceneRequest u;
    u.set_name("mine");
    u.set_extension(".GLB");
    u.set_total_bytes(bytes.size());
    u.set_data(bytes);
    writer->Write(u);
    writer->WritesDone();
    ASSERT_TRUE(writer->Finish().ok());
  }
  v1::Job get(const std::string& id) {
    v1::GetJobRequest r;
    r.set_id(id);
    v1::Job job;
    EXPECT_TRUE(call(&v1::Jobs::Stub::Get, r, job).ok());
    return job;
  }
  std::vector<v1::JobEvent> watch(const std::string& id, grpc::Status& status) {
    grpc::ClientContext context;
    bound(context);
    v1::WatchJobRequest r;
    r.set_id(id);
    auto reader = jobs->Watch(&context, r);
    std::vector<v1::JobEvent> events;
    v1::JobEvent e;
    while (reader->Read(&e)) events.push_back(e);
    status = reader->Finish();
    return events;
  }
  struct Fetched {
    std::vector<v1::FetchedFile> files;
    std::vector<std::string> bytes;
    grpc::Status status;
  };
  Fetched fetch(const v1::FetchRequest& r) {
    grpc::ClientContext context;
    bound(context);
    auto reader = jobs->Fetch(&context, r);
    Fetched out;
    v1::FetchReply reply;
    while (reader->Read(&reply)) {
      if (reply.has_file()) {
        out.files.push_back(reply.file());
        out.bytes.emplace_back();
      } else {
        EXPECT_EQ(reply.chunk().offset(), out.files.back().offset() + out.bytes.back().size());
        out.bytes.back() += reply.chunk().data();
      }
    }
    out.status = reader->Finish();
    return out;
  }
  std::string message;
};

TEST_F(JobsTest, RetryAndPrioritize) {
  v1::JobSpec s = spec(1 << 20);
  const v1::Job job = submit(s);
  v1::PrioritizeJobRequest p;
  p.set_id(job.id());
  p.set_priority(v1::JobSpec::HIGH);
  v1::Job reply;
  ASSERT_TRUE(call(&v1::Jobs::Stub::Prioritize, p, reply).ok());
  EXPECT_EQ(reply.spec().priority(), v1::JobSpec::HIGH);
  p.set_priority(v1::JobSpec::PRIORITY_UNSPECIFIED);
  EXPECT_EQ(call(&v1::Jobs::Stub::Prioritize, p, reply).error_code(), grpc::INVALID_ARGUMENT);
  p.set_priority(v1::JobSpec::Priority(7));
  EXPECT_EQ(call(&v1::Jobs::Stub::Prioritize, p, reply).error_code(), grpc::INVALID_ARGUMENT);
  v1::CancelJobRequest cancel;
  cancel.set_id(job.id());
  ASSERT_TRUE(call(&v1::Jobs::Stub::Cancel, cancel, reply).ok());
  v1::RetryJobRequest retry;
  retry.set_id(job.id());
  ASSERT_TRUE(call(&v1::Jobs::Stub::Retry, retry, reply).ok());
  EXPECT_TRUE(reply.state() == v1::Job::QUEUED || reply.state() == v1::Job::RUNNING);
  EXPECT_TRUE(eventually([&] { return get(job.id()).state() == v1::Job::RUNNING; }));
  ASSERT_TRUE(call(&v1::Jobs::Stub::Cancel, cancel, reply).ok());
  retry.set_id("j-99");
  EXPECT_EQ(call(&v1::Jobs::Stub::Retry, retry, reply).error_code(), grpc::NOT_FOUND);
}

TEST_F(JobsTest, SubmitWatchFetchDelete) {
  v1::JobSpec s = spec(16, 3);
  s.mutable_request()->add_outputs("beauty");
  s.mutable_request()->add_outputs("depth");
  const v1::Job job = submit(s);
  EXPECT_EQ(job.frames_total(), 3u);
  EXPECT_EQ(job.spec().max_attempts(), 3u);
  EXPECT_EQ(job.spec().priority(), v1::JobSpec::MEDIUM);
  EXPECT_FALSE(job.scene_hash().empty());
  grpc::Status status;
  const auto events = watch(job.id(), status);
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_GE(events.size(), 1u);
  EXPECT_EQ(events.front().job().frames_size(), 3);
  EXPECT_EQ(events.front().job().spec().name(), "shot");
  EXPECT_EQ(events.back().job().state(), v1::Job::DONE) << events.back().ShortDebugString();
  EXPECT_EQ(events.back().job().progress(), 1);
  std::map<int64_t, v1::Frame::State> last;
  for (const auto& f : events.front().job().frames()) last[f.frame()] = f.state();
  for (const auto& e : events)
    if (e.has_frame()) last[e.frame().frame()] = e.frame().state();
  for (int64_t f = 1; f <= 3; ++f) EXPECT_EQ(last[f], v1::Frame::DONE) << f;

  const Collected direct = renderOnce(s.request());
  v1::FetchRequest r;
  r.set_id(job.id());
  const Fetched all = fetch(r);
  ASSERT_TRUE(all.status.ok()) << all.status.error_message();
  ASSERT_EQ(all.files.size(), 6u);
  for (size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(all.files[i].frame(), int64_t(i / 2 + 1));
    EXPECT_EQ(all.files[i].file().output(), i % 2 ? "depth" : "beauty");
    EXPECT_EQ(sha256Hex(all.bytes[i].data(), all.bytes[i].size()), all.files[i].file().sha256());
    EXPECT_EQ(all.bytes[i], direct.images[i % 2]);
  }
  EXPECT_EQ(all.files[0].file().name(), "shot.0001.beauty.raw");
  // One output of one frame, from the middle on.
  r.add_frames(2);
  r.add_outputs("depth");
  r.set_offset(1000);
  const Fetched part = fetch(r);
  ASSERT_EQ(part.files.size(), 1u);
  EXPECT_EQ(part.files[0].offset(), 1000u);
  EXPECT_EQ(part.bytes[0], direct.images[1].substr(1000));
  r.set_offset(1u << 30);
  EXPECT_EQ(fetch(r).status.error_code(), grpc::OUT_OF_RANGE);
  r.add_frames(9);
  EXPECT_EQ(fetch(r).status.error_code(), grpc::INVALID_ARGUMENT);

  v1::DeleteJobRequest d;
  d.set_id(job.id());
  v1::DeleteJobReply deleted;
  EXPECT_TRUE(call(&v1::Jobs::Stub::Delete, d, deleted).ok());
  EXPECT_EQ(fetch(r).status.error_code(), grpc::NOT_FOUND);
  EXPECT_TRUE(std::filesystem::is_empty(folder + "/jobs/results"));
}

TEST_F(JobsTest, TheSameKeyIsTheSameJob) {
  v1::JobSpec s = spec();
  s.set_key("render-42");
  const std::string id = submit(s).id();
  EXPECT_EQ(submit(s).id(), id);
  s.mutable_request()->set_seed(5);
  submit(s, grpc::ALREADY_EXISTS);
  EXPECT_NE(message.find(id), std::string::npos) << message;
}

TEST_F(JobsTest, FaultsAreToldAtSubmission) {
  v1::JobSpec s = spec();
  s.mutable_request()->set_scene("nowhere");
  submit(s, grpc::NOT_FOUND);
  s = spec();
  s.mutable_request()->add_outputs("no such output");
  submit(s, grpc::INVALID_ARGUMENT);
  s = spec();
  s.mutable_request()->mutable_environment()->set_path("/etc/passwd");
  submit(s, grpc::PERMISSION_DENIED);
  v1::GetJobRequest r;
  v1::Job job;
  for (const char* id : {"j-12345", "", "x"}) {
    r.set_id(id);
    EXPECT_EQ(call(&v1::Jobs::Stub::Get, r, job).error_code(), grpc::NOT_FOUND) << id;
  }
}

TEST_F(JobsTest, PauseResumeCancelAndList) {
  v1::JobSpec s = spec(1 << 20, 2);  // takes minutes unless it is stopped
  s.set_client("me");
  const std::string id = submit(s).id();
  ASSERT_TRUE(eventually([&] { return get(id).state() == v1::Job::RUNNING; }));
  v1::Job job;
  v1::PauseJobRequest p;
  p.set_id(id);
  ASSERT_TRUE(call(&v1::Jobs::Stub::Pause, p, job).ok());
  EXPECT_EQ(job.state(), v1::Job::PAUSED);
  ASSERT_TRUE(eventually([&] { return get(id).frames(0).state() == v1::Frame::QUEUED && status().running() == 0; }));
  EXPECT_EQ(get(id).state(), v1::Job::PAUSED);
  // The one behind it is not held up.
  const std::string other = submit(spec()).id();
  ASSERT_TRUE(eventually([&] { return get(other).state() == v1::Job::DONE; }));
  v1::DeleteJobRequest d;
  d.set_id(id);
  v1::DeleteJobReply deleted;
  EXPECT_EQ(call(&v1::Jobs::Stub::Delete, d, deleted).error_code(), grpc::FAILED_PRECONDITION);
  v1::ResumeJobRequest r;
  r.set_id(id);
  ASSERT_TRUE(call(&v1::Jobs::Stub::Resume, r, job).ok());
  ASSERT_TRUE(eventually([&] { return get(id).state() == v1::Job::RUNNING; }));
  std::vector<v1::JobEvent> events;
  grpc::Status watched;
  std::thread watcher([&] { events = watch(id, watched); });
  v1::CancelJobRequest c;
  c.set_id(id);
  ASSERT_TRUE(call(&v1::Jobs::Stub::Cancel, c, job).ok());
  watcher.join();
  EXPECT_TRUE(watched.ok());
  EXPECT_EQ(events.back().job().state(), v1::Job::CANCELLED);
  EXPECT_TRUE(eventually([&] { return status().running() == 0; }));
  ASSERT_TRUE(call(&v1::Jobs::Stub::Cancel, c, job).ok());  // again: as it is
  EXPECT_EQ(job.state(), v1::Job::CANCELLED);

  v1::ListJobsRequest l;
  v1::ListJobsReply list;
  l.set_page_size(1);
  ASSERT_TRUE(call(&v1::Jobs::Stub::List, l, list).ok());
  ASSERT_EQ(list.jobs_size(), 1);
  EXPECT_EQ(list.jobs(0).id(), other);
  EXPECT_EQ(list.jobs(0).frames_size(), 0);
  l.set_page_token(list.next_page_token());
  ASSERT_TRUE(call(&v1::Jobs::Stub::List, l, list).ok());
  ASSERT_EQ(list.jobs_size(), 1);
  EXPECT_EQ(list.jobs(0).id(), id);
  EXPECT_TRUE(list.next_page_token().empty());
  l.Clear();
  l.add_states(v1::Job::CANCELLED);
  l.set_client("me");
  ASSERT_TRUE(call(&v1::Jobs::Stub::List, l, list).ok());
  EXPECT_EQ(list.jobs_size(), 1);
}

TEST_F(JobsTest, InteractiveRendersGoBeforeJobs) {
  const std::string id = submit(spec(1 << 20)).id();
  ASSERT_TRUE(eventually([&] { return status().running() == 1; }));
  v1::RenderRequest request = small(4);
  request.mutable_scheduling()->set_priority(v1::Scheduling::INTERACTIVE);
  EXPECT_TRUE(renderOnce(request).status.ok());
  EXPECT_EQ(get(id).state(), v1::Job::RUNNING);
  EXPECT_TRUE(eventually([&] { return status().running() == 1; }));  // and goes on
}

TEST_F(JobsTest, AShutdownReleasesAndTheNextServerGoesOn) {
  const v1::JobSpec s = spec(1024, 2);
  const std::string id = submit(s).id();
  ASSERT_TRUE(eventually([&] { return get(id).frames(0).spp() > 0; }));
  server->shutdown(0);
  server.reset();
  auto started = Server::start(config, engineOptions(config), true);
  ASSERT_TRUE(started.ok()) << started.status().toString();
  server = std::move(*started);
  channel = grpc::CreateChannel(server->addresses()[0], grpc::InsecureChannelCredentials());
  jobs = v1::Jobs::NewStub(channel);
  render = v1::Render::NewStub(channel);
  v1::FetchRequest r;
  r.set_id(id);
  r.set_follow(true);
  const Fetched got = fetch(r);  // waits for the frames
  ASSERT_TRUE(got.status.ok()) << got.status.error_message();
  ASSERT_EQ(got.bytes.size(), 2u);
  EXPECT_EQ(got.bytes[0], renderOnce(s.request()).images[0]);
}

TEST_F(JobsTest, ARetryNeedsTheUploadAgain) {
  uploadTriangle();
  v1::JobSpec s = spec(4);
  s.mutable_request()->set_scene("mine");
  const std::string done = submit(s).id();
  ASSERT_TRUE(eventually([&] { return jobIsOver(get(done).state()); }));
  s.mutable_request()->mutable_halt()->set_spp(1 << 20);
  const std::string cancelled = submit(s).id();
  v1::CancelJobRequest c;
  c.set_id(cancelled);
  v1::Job job;
  ASSERT_TRUE(call(&v1::Jobs::Stub::Cancel, c, job).ok());
  std::filesystem::remove_all(folder + "/jobs/scenes");
  v1::RetryJobRequest retry;
  retry.set_id(cancelled);
  const grpc::Status gone = call(&v1::Jobs::Stub::Retry, retry, job);
  EXPECT_EQ(gone.error_code(), grpc::FAILED_PRECONDITION);
  EXPECT_NE(gone.error_message().find("upload it and submit the job again"), std::string::npos) << gone.error_message();
  EXPECT_EQ(get(cancelled).state(), v1::Job::CANCELLED);
  retry.set_id(done);
  EXPECT_TRUE(call(&v1::Jobs::Stub::Retry, retry, job).ok()) << "nothing of it is left to render";
  EXPECT_EQ(job.state(), v1::Job::DONE);
}

TEST_F(JobsTest, AnUploadedSceneOutlivesTheServer) {
  uploadTriangle();
  v1::JobSpec s = spec(16);
  s.mutable_request()->set_scene("mine");
  s.mutable_request()->mutable_environment()->mutable_constant()->set_x(1);
  const std::string blocker = submit(spec(1 << 20)).id(), id = submit(s).id();
  const Collected direct = renderOnce(s.request());
  ASSERT_TRUE(direct.status.ok()) << direct.status.error_message();
  server->shutdown(0);
  server.reset();
  server = std::move(*Server::start(config, engineOptions(config), true));
  channel = grpc::CreateChannel(server->addresses()[0], grpc::InsecureChannelCredentials());
  jobs = v1::Jobs::NewStub(channel);
  v1::CancelJobRequest c;
  c.set_id(blocker);
  v1::Job job;
  ASSERT_TRUE(call(&v1::Jobs::Stub::Cancel, c, job).ok());
  ASSERT_TRUE(eventually([&] { return jobIsOver(get(id).state()); }));
  v1::FetchRequest r;
  r.set_id(id);
  const Fetched got = fetch(r);
  ASSERT_EQ(got.bytes.size(), 1u) << get(id).error().message();
  EXPECT_EQ(got.bytes[0], direct.images[0]);
}

struct JobsOff : ServerTest {};

TEST_F(JobsOff, SayHowToSwitchThemOn) {
  auto jobs = v1::Jobs::NewStub(channel);
  grpc::ClientContext a, b;
  bound(a);
  bound(b);
  v1::Job job;
  v1::JobSpec spec;
  *spec.mutable_request() = small();
  grpc::Status status = jobs->Submit(&a, spec, &job);
  EXPECT_EQ(status.error_code(), grpc::FAILED_PRECONDITION);
  EXPECT_NE(status.error_message().find("[jobs]"), std::string::npos) << status.error_message();
  v1::ListJobsReply list;
  EXPECT_EQ(jobs->List(&b, {}, &list).error_code(), grpc::FAILED_PRECONDITION);
}

}  // namespace
}  // namespace gobo
