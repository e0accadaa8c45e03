// SPDX-License-Identifier: Apache-2.0
// Clients that keep what all share: silent uploads, replies that nobody reads, idle connections, dripping HTTP, watches without end, unknown
// fields, files that are only large by name. Each ends or is bounded, and the next client is served meanwhile.
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>

#include <thread>

#include "base/descriptor.h"
#include "gobo/v1/jobs.grpc.pb.h"
#include "harness.h"
#include "http_get.h"
#include "server/listener.h"
#include "support/triangle_glb.h"

namespace gobo::abuse_test {
namespace {

using Clock = std::chrono::steady_clock;
double since(Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); }

Descriptor connectTo(const std::string& address) {
  const size_t colon = address.rfind(':');
  sockaddr_in name{};
  name.sin_family = AF_INET;
  name.sin_port = htons(uint16_t(std::atoi(address.c_str() + colon + 1)));
  name.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  Descriptor fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (::connect(fd.get(), reinterpret_cast<const sockaddr*>(&name), sizeof name) != 0) fd.close();
  return fd;
}

/// The other side has closed within `seconds`.
bool closes(const Descriptor& fd, double seconds) {
  pollfd p{fd.get(), POLLIN, 0};
  char byte;
  for (const auto begun = Clock::now(); since(begun) < seconds;)
    if (::poll(&p, 1, 50) > 0 && ::recv(fd.get(), &byte, 1, MSG_DONTWAIT) <= 0) return true;
  return false;
}

class Abuse : public ServerTest {
 protected:
  void configure(ServerConfig& c) override {
    c.listen.push_back("127.0.0.1:0");
    c.httpListen = "127.0.0.1:0";
    c.clientIdleSeconds = 1;
    c.connectionsPerPeer = 8;
    c.watches = 4;
    c.jobsFolder = folder + "/jobs";
  }
  std::string uploadOnce(grpc::Status& status) {
    grpc::ClientContext context;
    bound(context);
    v1::SceneInfo info;
    auto writer = scenes->Upload(&context, &info);
    const std::string bytes = triangleGlb();
    v1::UploadSceneRequest m;
    m.set_extension(".glb");
    m.set_total_bytes(bytes.size());
    m.set_data(bytes);
    writer->Write(m);
    writer->WritesDone();
    status = writer->Finish();
    return info.id();
  }
};

TEST_F(Abuse, SilentUploadsLoseTheirPlaces) {
  struct Silent {
    grpc::ClientContext context;
    v1::SceneInfo info;
    std::unique_ptr<grpc::ClientWriter<v1::UploadSceneRequest>> writer;
  };
  std::vector<std::unique_ptr<Silent>> silent;
  for (int i = 0; i < 2; ++i) {
    auto s = std::make_unique<Silent>();
    bound(s->context);
    s->writer = scenes->Upload(&s->context, &s->info);
    v1::UploadSceneRequest m;
    m.set_extension(".glb");
    m.set_total_bytes(1000);
    m.set_data("g");
    s->writer->Write(m);
    silent.push_back(std::move(s));
  }
  ASSERT_TRUE(eventually([&] { return server->core().uploads.used() == 2; }));
  grpc::Status status;
  uploadOnce(status);
  EXPECT_EQ(status.error_code(), grpc::RESOURCE_EXHAUSTED) << status.error_message();  // half of four is this client's part
  EXPECT_NE(status.error_message().find("limits.uploads_at_once"), std::string::npos);
  ASSERT_TRUE(eventually([&] { return server->core().uploads.used() == 0; }, 10));
  EXPECT_NE(uploadOnce(status), "") << status.error_message();
  for (auto& s : silent) EXPECT_EQ(s->writer->Finish().error_code(), grpc::CANCELLED);
  EXPECT_EQ(server->core().idle.ended(), 2u);
}

TEST_F(Abuse, RepliesThatNobodyReadsEnd) {
  v1::RenderRequest large = small(1);
  large.set_width(1024);
  large.set_height(1024);
  large.clear_outputs();
  large.add_outputs("depth");
  grpc::ClientContext context;
  bound(context);
  auto reader = render->Render(&context, large);  // 4 MB: more than flow control lets out unread
  ASSERT_TRUE(eventually([&] { return server->core().replies.used() > 0; }));
  EXPECT_TRUE(eventually([&] { return server->core().replies.used() == 0 && server->core().running() == 0; }, 30));
  EXPECT_EQ(server->core().idle.ended(), 1u);
  EXPECT_TRUE(renderOnce(small()).status.ok());
  context.TryCancel();
}

TEST_F(Abuse, PicturesInFlightAreBounded) {
  ServerConfig next = *server->core().live();
  next.replyBytes = 64 << 20;
  next.clientIdleSeconds = 60;
  ASSERT_TRUE(server->reload(next).ok());
  v1::RenderRequest large = small(1);
  large.set_width(640);
  large.set_height(640);
  large.clear_outputs();
  large.add_outputs("depth");  // counts as 32 bytes a pixel and two chunks: 15 MB; half of 64 is this client's
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts;
  std::vector<std::unique_ptr<grpc::ClientReader<v1::RenderEvent>>> readers;
  for (int i = 0; i < 6; ++i) {
    contexts.push_back(std::make_unique<grpc::ClientContext>());
    bound(*contexts.back());
    readers.push_back(render->Render(contexts.back().get(), large));
  }
  EXPECT_TRUE(eventually([&] { return server->core().metrics.value("gobo_refused_total", {{"reason", "reply_bytes"}}) >= 4; }));
  EXPECT_LE(server->core().replies.used(), 32u << 20);
  v1::RenderEvent event;
  for (size_t i = 0; i < readers.size(); ++i)
    while (readers[i]->Read(&event)) {}
  ASSERT_TRUE(eventually([&] { return server->core().replies.used() == 0; }));
  EXPECT_TRUE(renderOnce(large).status.ok());
}

TEST_F(Abuse, SilentConnectionsGiveWay) {
  const std::string address = server->addresses()[1];
  std::vector<Descriptor> silent;
  for (int i = 0; i < 40; ++i) silent.push_back(connectTo(address));
  std::this_thread::sleep_for(std::chrono::milliseconds(1100));
  const auto tcp = grpc::CreateChannel(address, grpc::InsecureChannelCredentials());
  grpc::ClientContext context;
  bound(context, 10);
  context.set_wait_for_ready(true);
  v1::ListScenesReply reply;
  const grpc::Status status = v1::Scenes::NewStub(tcp)->List(&context, {}, &reply);
  EXPECT_TRUE(status.ok()) << status.error_message();
  const auto metrics = test::parseMetrics(test::httpGet(server->httpAddress(), "/metrics").body);
  EXPECT_LE(metrics.at("gobo_connections"), 9);
  EXPECT_GE(metrics.at("gobo_connections_refused_total"), 32);
  EXPECT_GE(metrics.at("gobo_connections_evicted_total"), 1);
  EXPECT_EQ(test::httpGet(server->httpAddress(), "/ready").status, 200);
}

TEST_F(Abuse, DrippingHttpClientsDoNotStopReady) {
  std::vector<Descriptor> slow;
  for (int i = 0; i < 24; ++i) {
    slow.push_back(connectTo(server->httpAddress()));
    ASSERT_EQ(::send(slow.back().get(), "GET /ready", 10, 0), 10);
  }
  for (int i = 0; i < 5; ++i) {
    for (const Descriptor& fd : slow) (void)!::send(fd.get(), "x", 1, MSG_NOSIGNAL);
    const auto begun = Clock::now();
    EXPECT_EQ(test::httpGet(server->httpAddress(), "/ready").status, 200);
    EXPECT_LT(since(begun), 1.5);
  }
}

TEST_F(Abuse, WatchesLeavePlacesForOthers) {
  const auto jobs = v1::Jobs::NewStub(channel);
  v1::JobSpec spec;
  *spec.mutable_request() = small(1 << 16);
  v1::Job job;
  {
    grpc::ClientContext context;
    bound(context);
    ASSERT_TRUE(jobs->Submit(&context, spec, &job).ok());
  }
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts;
  std::vector<std::unique_ptr<grpc::ClientReader<v1::JobEvent>>> watching;
  v1::WatchJobRequest request;
  request.set_id(job.id());
  v1::JobEvent event;
  int refused = 0;
  for (int i = 0; i < 5; ++i) {
    contexts.push_back(std::make_unique<grpc::ClientContext>());
    bound(*contexts.back());
    watching.push_back(jobs->Watch(contexts.back().get(), request));
    if (watching.back()->Read(&event)) continue;
    const grpc::Status status = watching.back()->Finish();
    EXPECT_EQ(status.error_code(), grpc::RESOURCE_EXHAUSTED);
    EXPECT_NE(status.error_message().find("limits.watches"), std::string::npos) << status.error_message();
    watching.pop_back();
    ++refused;
  }
  EXPECT_EQ(refused, 3);
  EXPECT_NE(server->core().watches.take("another", 1), nullptr);
  for (auto& c : contexts) c->TryCancel();
  EXPECT_TRUE(eventually([&] { return server->core().watches.used() == 0; }));
  grpc::ClientContext context;
  bound(context);
  v1::CancelJobRequest cancel;
  cancel.set_id(job.id());
  EXPECT_TRUE(jobs->Cancel(&context, cancel, &job).ok());
}

TEST_F(Abuse, UnknownFieldsAreNotKept) {
  v1::RenderRequest request = small(1);
  request.GetReflection()->MutableUnknownFields(&request)->AddLengthDelimited(30000, std::string(4 << 20, 'x'));
  request.mutable_integrator()->GetReflection()->MutableUnknownFields(request.mutable_integrator())->AddLengthDelimited(30000, std::string(4 << 20, 'x'));
  const auto held = [&] {
    const v1::StatusReply now = status();
    for (const auto& holder : now.memory())
      if (holder.name() == "remembered requests") return holder.bytes();
    return ~uint64_t(0);
  };
  const Collected got = renderOnce(request);
  ASSERT_TRUE(got.status.ok()) << got.status.error_message();
  EXPECT_LT(got.reply.ByteSizeLong(), 1u << 20);  // nor sent back
  EXPECT_GT(held(), 0u);
  EXPECT_LT(held(), 1u << 20);
  const auto jobs = v1::Jobs::NewStub(channel);
  v1::JobSpec spec;
  *spec.mutable_request() = request;
  spec.GetReflection()->MutableUnknownFields(&spec)->AddLengthDelimited(30000, std::string(4 << 20, 'x'));
  grpc::ClientContext context;
  bound(context);
  v1::Job job;
  ASSERT_TRUE(jobs->Submit(&context, spec, &job).ok());
  EXPECT_LT(job.ByteSizeLong(), 1u << 20);
}

TEST_F(Abuse, MessagesAndSpecsAreBounded) {
  v1::RenderRequest request = small(1);
  request.GetReflection()->MutableUnknownFields(&request)->AddLengthDelimited(30000, std::string(20 << 20, 'x'));
  EXPECT_EQ(renderOnce(request).status.error_code(), grpc::RESOURCE_EXHAUSTED);  // limits.request_bytes
  const auto jobs = v1::Jobs::NewStub(channel);
  v1::JobSpec spec;
  *spec.mutable_request() = small(1);
  for (int i = 0; i < 20000; ++i) (*spec.mutable_request()->mutable_lights())["a light of a rather long name, number " + std::to_string(i)].set_intensity(1);
  grpc::ClientContext context;
  bound(context);
  v1::Job job;
  const grpc::Status status = jobs->Submit(&context, spec, &job);
  EXPECT_EQ(status.error_code(), grpc::RESOURCE_EXHAUSTED) << status.error_message();
}

// 300 GB by name, nothing on the disk: neither load nor environment nor job reads it.
TEST_F(Abuse, SparseFilesAreRefusedByTheirSize) {
  for (const char* name : {"/root/huge.glb", "/root/huge.hdr"}) {
    const Descriptor fd(::open((folder + name).c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0600));
    ASSERT_EQ(::ftruncate(fd.get(), 300ll << 30), 0);
  }
  const auto begun = Clock::now();
  v1::OpenSceneRequest open;
  open.set_source(folder + "/root/huge.glb");
  for (int i = 0; i < 2; ++i) {
    grpc::ClientContext context;
    bound(context);
    v1::SceneInfo info;
    const grpc::Status status = scenes->Open(&context, open, &info);
    EXPECT_EQ(status.error_code(), grpc::RESOURCE_EXHAUSTED) << status.error_message();
    EXPECT_NE(status.error_message().find("ingest.input_bytes"), std::string::npos) << status.error_message();
  }
  v1::RenderRequest request = small(1);
  request.mutable_environment()->set_path(folder + "/root/huge.hdr");
  EXPECT_EQ(renderOnce(request).status.error_code(), grpc::RESOURCE_EXHAUSTED);
  const auto jobs = v1::Jobs::NewStub(channel);
  v1::JobSpec spec;
  *spec.mutable_request() = request;
  grpc::ClientContext context;
  bound(context);
  v1::Job job;
  EXPECT_EQ(jobs->Submit(&context, spec, &job).error_code(), grpc::RESOURCE_EXHAUSTED);
  EXPECT_LT(since(begun), 20);
}

// Without a descriptor connections are closed, not left hanging, and accepting goes on when there are some again.
TEST(ListenerTest, GoesOnAfterTheDescriptorsRanOut) {
  const pid_t pid = ::fork();
  if (pid == 0) {
    const rlimit few{64, 64};
    ::setrlimit(RLIMIT_NOFILE, &few);
    Listener listener({1000, 1000});
    const auto address = listener.add("127.0.0.1:0");
    if (!address.ok()) ::_exit(1);
    std::atomic<int> taken{0};
    listener.start([&](int fd, size_t) {
      ++taken;
      ::close(fd);
    });
    const Descriptor early = connectTo(*address), late(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    if (!closes(early, 10) || taken != 1) ::_exit(2);
    std::vector<Descriptor> all;
    for (int fd; (fd = ::open("/dev/null", O_RDONLY)) >= 0;) all.emplace_back(fd);
    sockaddr_in name{};
    name.sin_family = AF_INET;
    name.sin_port = htons(uint16_t(std::atoi(address->c_str() + address->rfind(':') + 1)));
    name.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(late.get(), reinterpret_cast<const sockaddr*>(&name), sizeof name) != 0) ::_exit(3);
    if (!closes(late, 10) || taken != 1) ::_exit(4);
    if (listener.stats().noDescriptor == 0) ::_exit(5);
    all.clear();
    const Descriptor after = connectTo(*address);
    if (!closes(after, 10) || taken != 2) ::_exit(6);
    if (!listener.reachable(0, 5)) ::_exit(7);
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(pid, &status, 0), pid);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

// What /ready stands on: a socket that nobody accepts from is not reachable, although the kernel completes its connections.
TEST(ListenerTest, ReachableMeansAccepted) {
  for (const std::string address :
       {std::string("127.0.0.1:0"), "unix:" + (std::filesystem::temp_directory_path() / ("gobo-l-" + std::to_string(::getpid()))).string()}) {
    Listener listener({10, 10});
    ASSERT_TRUE(listener.add(address).ok());
    EXPECT_FALSE(listener.reachable(0, 0.2)) << address;
    listener.start([](int fd, size_t) { ::close(fd); });
    EXPECT_TRUE(listener.reachable(0, 5)) << address;
    EXPECT_LE(listener.stats().accepted, 1u) << "a probe is nobody's connection; the one that was given up waits in the queue";
    listener.stop();
    if (address.rfind("unix:", 0) == 0) ::unlink(address.c_str() + 5);
  }
}

// Each new one beyond the bound once cost a look at all the others, so that a client who connects in a loop kept everybody from being accepted.
TEST(ListenerBounds, WhatANewConnectionCostsDoesNotGrowWithThoseThatAreOpen) {
  constexpr uint32_t kMost = 400;
  Listener listener({kMost, kMost});
  auto address = listener.add("127.0.0.1:0");
  ASSERT_TRUE(address.ok()) << address.status().toString();
  std::vector<Descriptor> taken;
  std::mutex mutex;
  listener.start([&](int fd, size_t) {
    const std::lock_guard lock(mutex);
    taken.emplace_back(fd);
  });
  const auto accepted = [&](uint64_t n) {
    for (int i = 0; i < 1000 && listener.stats().accepted + listener.stats().refused < n; ++i) ::usleep(10000);
    return listener.stats();
  };
  std::vector<Descriptor> clients;
  for (uint32_t i = 0; i < kMost; ++i) {
    clients.push_back(connectTo(*address));
    if (i < kMost / 2) ASSERT_EQ(::send(clients.back().get(), "x", 1, MSG_NOSIGNAL), 1);  // the older half may not be driven out
  }
  ASSERT_EQ(accepted(kMost).accepted, kMost);
  ::usleep(1200000);  // the others have been silent for long enough
  const uint64_t before = listener.stats().looked;
  const auto begun = Clock::now();
  for (uint32_t i = 0; i < kMost / 2; ++i) clients.push_back(connectTo(*address));
  const ListenerStats after = accepted(kMost + kMost / 2);
  EXPECT_EQ(after.evicted, kMost / 2);
  EXPECT_EQ(after.refused, 0u);
  const double sweeps = since(begun) / 0.05 + 2;
  EXPECT_LT(double(after.looked - before), kMost * (sweeps + 2)) << since(begun) << " s";
  EXPECT_TRUE(listener.reachable(0, 5));
  listener.stop();
}

}  // namespace
}  // namespace gobo::abuse_test
