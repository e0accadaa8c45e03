// SPDX-License-Identifier: Apache-2.0
// FarmCalls: a coordinator that renders nothing itself, over a real server and socket; workers with engines and folders of their own, or played by the test.
#pragma once

#include <fstream>

#include "gobo/v1/farm.grpc.pb.h"
#include "gobo/v1/jobs.grpc.pb.h"
#include "protocol/server/harness.h"
#include "server/farm/farm_worker.h"
#include "server/farm/numeric_class.h"
#include "server/jobs/durable_jobs.h"
#include "server/log.h"

namespace gobo::farm_service_test {

namespace fs = std::filesystem;

/// What `gobod --worker` has.
struct WorkerHere {
  std::unique_ptr<Engine> engine;
  JobRunner runner{SchedulerOptions()};
  std::unique_ptr<farm::FarmWorker> worker;
  WorkerHere(const std::string& coordinator, const std::string& folder, const std::string& name, uint32_t frames = 1) {
    fs::create_directories(folder);
    ServerConfig c;
    c.farmCoordinator = coordinator;
    c.farmName = name;
    c.farmFolder = folder + "/cache";
    c.jobsWorkers = frames;
    c.tmpFolder = folder;
    EngineOptions o;
    o.threads = 1;
    o.storeBytes = 128 << 20;
    engine = std::move(*Engine::create(o));  // no loader: a worker parses no files
    auto started = farm::FarmWorker::start(*engine, runner, c);
    EXPECT_TRUE(started.ok()) << started.status().toString();
    if (started.ok()) worker = std::move(*started);
  }
};

inline size_t filesUnder(const std::string& folder) {
  std::error_code error;
  size_t n = 0;
  for (fs::recursive_directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) n += it->is_regular_file();
  return n;
}

struct FarmCalls : ServerTest {
  std::unique_ptr<v1::Jobs::Stub> jobs;
  std::unique_ptr<v1::Farm::Stub> farm;
  std::vector<std::unique_ptr<WorkerHere>> workers;

  void configure(ServerConfig& c) override {
    c.jobsFolder = folder + "/jobs";
    c.jobsWorkers = 0;
    c.jobsLeaseSeconds = 20;
    c.jobsCheckpointSeconds = 0.05;
    c.farmWorkers = 4;
    c.jobsOutFolder = folder + "/shots";
    fs::create_directories(c.jobsOutFolder);
    TokenConfig plain, worker;
    const auto secret = [](const std::string& text) { return sha256Hex(text.data(), text.size()); };
    plain.name = "plain";
    plain.sha256 = secret("secret-plain");
    worker.name = "worker";
    worker.sha256 = secret("secret-worker");
    worker.worker = true;
    c.tokens = {plain, worker};
  }
  void SetUp() override {
    ServerTest::SetUp();
    connect();
  }
  void connect() {
    grpc::ChannelArguments own;
    own.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    channel = grpc::CreateCustomChannel(server->addresses()[0], grpc::InsecureChannelCredentials(), own);
    jobs = v1::Jobs::NewStub(channel);
    farm = v1::Farm::NewStub(channel);
  }
  /// The coordinator, with `config` as it is now. Of the stubs jobs, farm and render are there again.
  void restart() {
    channel.reset(), jobs.reset(), farm.reset(), render.reset(), scenes.reset(), admin.reset();
    server->shutdown(0);
    server.reset();
    auto started = Server::start(config, engineOptions(config), true);
    ASSERT_TRUE(started.ok()) << started.status().toString();
    server = std::move(*started);
    connect();
    render = v1::Render::NewStub(channel);
  }
  void TearDown() override {
    workers.clear();
    ServerTest::TearDown();
  }
  void hire(int n, uint32_t frames = 1) {
    for (int i = 0; i < n; ++i)
      workers.push_back(
          std::make_unique<WorkerHere>(config.listen[0], folder + "/w" + std::to_string(workers.size()), "w" + std::to_string(workers.size()), frames));
  }
  static v1::JobSpec spec(uint32_t spp, int frames, uint64_t seed = 0) {
    v1::JobSpec s;
    *s.mutable_request() = small(spp);
    s.mutable_request()->set_width(24);
    s.mutable_request()->set_height(16);
    s.mutable_request()->set_seed(seed);
    s.mutable_frames()->set_first(1);
    s.mutable_frames()->set_last(frames);
    return s;
  }
  v1::Job submit(const v1::JobSpec& s) {
    grpc::ClientContext context;
    bound(context);
    v1::Job job;
    const grpc::Status status = jobs->Submit(&context, s, &job);
    EXPECT_TRUE(status.ok()) << status.error_message();
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
  v1::Job over(const std::string& id, double seconds = 60) {
    v1::Job job;
    EXPECT_TRUE(eventually([&] { return job = get(id), jobIsOver(job.state()); }, seconds)) << job.ShortDebugString();
    return job;
  }
  std::string resultBytes(const std::string& id, const v1::Frame& frame, int file = 0) {
    std::ifstream in(folder + "/jobs/results/" + id.substr(2) + "/" + frame.files(file).sha256(), std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  /// The frames have the bits of this daemon's own renders.
  void sameBits(const v1::Job& job) {
    EXPECT_EQ(job.state(), v1::Job::DONE) << job.ShortDebugString();
    for (const v1::Frame& frame : job.frames()) {
      v1::RenderRequest request = job.spec().request();
      if (job.spec().frames().has_fps()) request.set_time_s(double(frame.frame()) / job.spec().frames().fps());
      const Collected whole = renderOnce(request);
      ASSERT_TRUE(whole.status.ok()) << whole.status.error_message();
      ASSERT_EQ(frame.files_size(), int(whole.images.size()));
      for (int i = 0; i < frame.files_size(); ++i) EXPECT_TRUE(resultBytes(job.id(), frame, i) == whole.images[size_t(i)]) << frame.ShortDebugString();
    }
  }
  std::vector<v1::Worker> list() {
    grpc::ClientContext context;
    bound(context);
    v1::WorkersReply reply;
    EXPECT_TRUE(farm->Workers(&context, {}, &reply).ok());
    return {reply.workers().begin(), reply.workers().end()};
  }
  /// A worker played by the test: attends until it goes.
  struct Played {
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReader<v1::FarmNews>> reader;
    std::string id;
    explicit Played(v1::Farm::Stub& stub, const std::string& name = "played") {
      v1::AttendRequest r;
      r.mutable_worker()->set_name(name);
      r.mutable_worker()->set_build(buildVersion());
      r.mutable_worker()->set_numeric_class(gobo::numericClass());
      bound(context);
      reader = stub.Attend(&context, r);
      v1::FarmNews news;
      if (reader->Read(&news)) id = news.worker();
    }
    ~Played() {
      context.TryCancel();
      (void)reader->Finish();
    }
  };
  v1::ClaimReply claim(const std::string& worker) {
    grpc::ClientContext context;
    bound(context);
    v1::ClaimRequest r;
    r.set_worker(worker);
    v1::ClaimReply reply;
    const grpc::Status status = farm->Claim(&context, r, &reply);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return reply;
  }
  template <typename Request, typename Reply>
  grpc::Status call(grpc::Status (v1::Farm::Stub::*method)(grpc::ClientContext*, const Request&, Reply*), const Request& request, Reply* reply) {
    grpc::ClientContext context;
    bound(context);
    return (farm.get()->*method)(&context, request, reply);
  }
  grpc::Status put(const v1::PutFarmFileRequest::Begin& begin, const std::string& data) {
    grpc::ClientContext context;
    bound(context);
    v1::FarmAck ack;
    auto writer = farm->Put(&context, &ack);
    v1::PutFarmFileRequest message;
    *message.mutable_begin() = begin;
    writer->Write(message);
    message.set_data(data);
    writer->Write(message);
    writer->WritesDone();
    return writer->Finish();
  }
};

}  // namespace gobo::farm_service_test
