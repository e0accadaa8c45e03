// SPDX-License-Identifier: Apache-2.0
// Jobs.Depend, Jobs.Log and JobSpec.after, JobSpec.out over a real server and socket, by callers with tokens of their own.
#include <fstream>

#include "gobo/v1/jobs.grpc.pb.h"
#include "protocol/server/harness.h"
#include "server/encode.h"
#include "server/jobs/durable_jobs.h"
#include "server/log.h"

namespace gobo::jobs_order_test {
namespace {

struct JobsOrder : ServerTest {
  std::unique_ptr<v1::Jobs::Stub> jobs;
  std::string secret = "secret-alice";  // of the next call
  bool outFolder = true;

  void configure(ServerConfig& c) override {
    c.jobsFolder = folder + "/jobs";
    if (outFolder) {
      c.jobsOutFolder = folder + "/shots";
      std::filesystem::create_directories(c.jobsOutFolder);
    }
    for (const char* name : {"alice", "bob", "root"}) {
      TokenConfig t;
      t.name = name;
      const std::string text = "secret-" + t.name;
      t.sha256 = sha256Hex(text.data(), text.size());
      t.admin = t.name == "root";
      c.tokens.push_back(t);
    }
  }
  void SetUp() override {
    ServerTest::SetUp();
    jobs = v1::Jobs::NewStub(channel);
  }
  template <typename Request, typename Reply>
  grpc::Status call(grpc::Status (v1::Jobs::Stub::*method)(grpc::ClientContext*, const Request&, Reply*), const Request& request, Reply& reply) {
    grpc::ClientContext context;
    bound(context);
    context.AddMetadata("authorization", "Bearer " + secret);
    return (jobs.get()->*method)(&context, request, &reply);
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
    v1::Job job;
    const grpc::Status status = call(&v1::Jobs::Stub::Submit, s, job);
    EXPECT_EQ(status.error_code(), expected) << status.error_message();
    message = status.error_message();
    return job;
  }
  v1::Job get(const std::string& id) {
    v1::GetJobRequest r;
    r.set_id(id);
    v1::Job job;
    EXPECT_TRUE(call(&v1::Jobs::Stub::Get, r, job).ok());
    return job;
  }
  v1::Job depend(const std::string& id, const std::vector<std::string>& after, grpc::StatusCode expected = grpc::OK) {
    v1::DependRequest r;
    r.set_id(id);
    for (const std::string& a : after) r.add_after(a);
    v1::Job job;
    const grpc::Status status = call(&v1::Jobs::Stub::Depend, r, job);
    EXPECT_EQ(status.error_code(), expected) << status.error_message();
    message = status.error_message();
    return job;
  }
  v1::JobLogReply log(const v1::JobLogRequest& r, grpc::StatusCode expected = grpc::OK) {
    v1::JobLogReply reply;
    const grpc::Status status = call(&v1::Jobs::Stub::Log, r, reply);
    EXPECT_EQ(status.error_code(), expected) << status.error_message();
    message = status.error_message();
    return reply;
  }
  void says(const char* text) const { EXPECT_NE(message.find(text), std::string::npos) << message << "\nwithout " << text; }
  bool done(const std::string& id) {
    return eventually([&] { return get(id).state() == v1::Job::DONE; });
  }
  std::string message;
};

TEST_F(JobsOrder, AJobWaitsAndIsLetGo) {
  const std::string slow = submit(spec(1 << 20)).id();
  v1::JobSpec s = spec();
  s.add_after(slow);
  const v1::Job waiting = submit(s);
  ASSERT_EQ(waiting.waits_for_size(), 1);
  EXPECT_EQ(waiting.waits_for(0), slow);
  const std::string third = submit(spec()).id();
  const v1::Job both = depend(waiting.id(), {slow, third});
  EXPECT_EQ(both.waits_for_size(), 2);
  v1::ListJobsReply list;
  ASSERT_TRUE(call(&v1::Jobs::Stub::List, v1::ListJobsRequest(), list).ok());
  EXPECT_EQ(list.jobs(1).waits_for_size(), 2);
  v1::DeleteJobRequest d;
  d.set_id(slow);
  v1::CancelJobRequest c;
  c.set_id(slow);
  v1::Job job;
  ASSERT_TRUE(call(&v1::Jobs::Stub::Cancel, c, job).ok());
  v1::DeleteJobReply deleted;
  const grpc::Status refused = call(&v1::Jobs::Stub::Delete, d, deleted);
  EXPECT_EQ(refused.error_code(), grpc::FAILED_PRECONDITION);
  EXPECT_NE(refused.error_message().find("is waited for by " + waiting.id()), std::string::npos) << refused.error_message();
  ASSERT_TRUE(done(third));
  EXPECT_EQ(get(waiting.id()).state(), v1::Job::QUEUED) << "one of both is cancelled";
  EXPECT_EQ(depend(waiting.id(), {}).waits_for_size(), 0);
  EXPECT_TRUE(done(waiting.id()));
  depend(waiting.id(), {slow}, grpc::FAILED_PRECONDITION);
  depend(waiting.id(), {});
}

TEST_F(JobsOrder, FaultsOfDependenciesNameTheField) {
  const std::string mine = submit(spec(1 << 20)).id();
  v1::JobSpec s = spec();
  s.add_after(mine);
  s.add_after("j-99");
  submit(s, grpc::NOT_FOUND);
  says("job.after[1]: no job 'j-99'");
  s.set_after(1, "soon");
  submit(s, grpc::NOT_FOUND);
  says("job.after[1]: no job 'soon'");
  s.set_after(1, "j-01");
  submit(s, grpc::INVALID_ARGUMENT);
  says("job.after[1]: 'j-01' is there twice");
  s.clear_after();
  for (int i = 0; i < 201; ++i) s.add_after(jobIdText(i + 1));
  submit(s, grpc::INVALID_ARGUMENT);
  says("job.after: 201 jobs, at most 200");
  depend(mine, {mine}, grpc::INVALID_ARGUMENT);
  says((mine + " -> " + mine).c_str());
  depend(mine, {"j-98"}, grpc::NOT_FOUND);
  says("after[0]");
  depend("j-98", {}, grpc::NOT_FOUND);
}

TEST_F(JobsOrder, WhatIsAnothersIsNotThere) {
  const std::string alices = submit(spec(1 << 20)).id();
  secret = "secret-bob";
  v1::JobSpec s = spec(1 << 20);
  s.add_after(alices);
  submit(s, grpc::NOT_FOUND);
  says(("job.after[0]: no job '" + alices + "'").c_str());
  s.clear_after();
  const std::string bobs = submit(s).id();
  depend(bobs, {alices}, grpc::NOT_FOUND);
  depend(alices, {}, grpc::NOT_FOUND);
  v1::JobLogRequest r;
  r.set_id(alices);
  log(r, grpc::NOT_FOUND);
  secret = "secret-root";
  EXPECT_EQ(depend(bobs, {alices}).waits_for_size(), 1);
  EXPECT_GT(log(r).entries_size(), 0);
}

TEST_F(JobsOrder, TheLog) {
  const std::string id = submit(spec(4, 2)).id();
  ASSERT_TRUE(done(id));
  v1::JobLogRequest r;
  r.set_id(id);
  const v1::JobLogReply all = log(r);
  ASSERT_EQ(all.entries_size(), 6) << all.ShortDebugString();
  EXPECT_EQ(all.entries(0).kind(), v1::JobLogEntry::SUBMITTED);
  EXPECT_EQ(all.entries(1).kind(), v1::JobLogEntry::CLAIMED);
  EXPECT_EQ(all.entries(1).frame(), 1);
  EXPECT_FALSE(all.entries(1).holder().empty());
  EXPECT_EQ(get(id).frames(0).holder(), all.entries(1).holder());
  EXPECT_EQ(all.entries(5).kind(), v1::JobLogEntry::ENDED);
  r.add_frames(2);
  EXPECT_EQ(log(r).entries_size(), 2);
  r.set_after(all.entries(3).sequence());
  EXPECT_EQ(log(r).entries_size(), 1);
  r.add_frames(3);
  log(r, grpc::INVALID_ARGUMENT);
  says("the job has no frame 3");
  r.clear_frames();
  r.set_most(10001);
  log(r, grpc::INVALID_ARGUMENT);
  says("most = 10001");
  r.set_most(1);
  EXPECT_EQ(log(r).entries(0).kind(), v1::JobLogEntry::ENDED);
  r.set_id("j-9");
  log(r, grpc::NOT_FOUND);
}

TEST_F(JobsOrder, FilesAreWrittenWhereTheJobSays) {
  v1::JobSpec s = spec(4, 2);
  s.mutable_request()->add_outputs("beauty");
  s.mutable_request()->add_outputs("depth");
  s.set_out("{name}/{output}.{frame:04}.{ext}");
  const v1::Job job = submit(s);
  ASSERT_TRUE(done(job.id()));
  const v1::Job after = get(job.id());
  for (int i = 0; i < 2; ++i)
    for (const v1::FrameFile& f : after.frames(i).files()) {
      std::ifstream in(folder + strf("/shots/shot/%s.%04d.raw", f.output().c_str(), i + 1), std::ios::binary);
      const std::string bytes{std::istreambuf_iterator<char>(in), {}};
      EXPECT_EQ(sha256Hex(bytes.data(), bytes.size()), f.sha256());
    }
  s.set_out("{name}.{frame}.raw");
  submit(s, grpc::INVALID_ARGUMENT);
  says("has no {output}");
  s.set_out("../{name}.{frame}.{output}.raw");
  submit(s, grpc::INVALID_ARGUMENT);
  says("part \"..\"");
}

struct JobsOrderWithoutOut : JobsOrder {
  JobsOrderWithoutOut() { outFolder = false; }
};
TEST_F(JobsOrderWithoutOut, ASpecWithOutIsRefused) {
  v1::JobSpec s = spec();
  s.set_out("x.raw");
  submit(s, grpc::FAILED_PRECONDITION);
  says("set out_folder in its [jobs] section");
}

}  // namespace
}  // namespace gobo::jobs_order_test
