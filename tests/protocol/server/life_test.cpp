// SPDX-License-Identifier: Apache-2.0
// Cancellation, deadlines, a full queue, health, sockets and shutdown. Limits on time are generous: they tell a server that
// reacts from one that does not, nothing finer.
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <fstream>
#include <thread>

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/byte_buffer.h>

#include "harness.h"

namespace gobo {
namespace {

class Life : public ServerTest {
 protected:
  void configure(ServerConfig& c) override {
    c.running = 1;
    c.queuedNormal = 1;
    c.listen.push_back("127.0.0.1:0");
  }
  // Takes minutes if nobody stops it.
  static v1::RenderRequest endless() {
    v1::RenderRequest request = small(1 << 20);
    request.set_width(256);
    request.set_height(256);
    return request;
  }
  struct Running {
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReader<v1::RenderEvent>> reader;
    Collected result;
    std::thread thread;
    Running(v1::Render::Stub& stub, const v1::RenderRequest& request, int seconds = 60) {
      bound(context, seconds);
      reader = stub.Render(&context, request);
      thread = std::thread([this] { result = drain(context, *reader); });
    }
    void join() {
      if (thread.joinable()) thread.join();
    }
    ~Running() {
      context.TryCancel();
      join();
    }
  };
};

TEST_F(Life, ACancelledRenderFreesTheServer) {
  Running running(*render, endless());
  ASSERT_TRUE(eventually([&] { return status().running() == 1; }));
  running.context.TryCancel();
  running.join();
  EXPECT_EQ(running.result.status.error_code(), grpc::CANCELLED);
  EXPECT_TRUE(eventually([&] { return server->core().running() == 0 && status().running() == 0; }));
  EXPECT_TRUE(renderOnce(small(1)).status.ok());
}

TEST_F(Life, AClientThatVanishesFreesTheServer) {
  {
    auto other = grpc::CreateCustomChannel(server->addresses()[0], grpc::InsecureChannelCredentials(), [] {
      grpc::ChannelArguments a;
      a.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
      return a;
    }());
    auto stub = v1::Render::NewStub(other);
    Running running(*stub, endless());
    ASSERT_TRUE(eventually([&] { return status().running() == 1; }));
  }
  EXPECT_TRUE(eventually([&] { return server->core().running() == 0; }));
}

TEST_F(Life, DeadlinesOfRequestAndCall) {
  v1::RenderRequest request = endless();
  request.mutable_scheduling()->set_deadline_ms(100);
  Collected got = renderOnce(request);
  EXPECT_EQ(got.status.error_code(), grpc::DEADLINE_EXCEEDED) << got.status.error_message();
  Running running(*render, endless(), 1);
  running.join();
  EXPECT_EQ(running.result.status.error_code(), grpc::DEADLINE_EXCEEDED);
  EXPECT_TRUE(eventually([&] { return server->core().running() == 0; }));
}

TEST_F(Life, AFullQueueRefusesWithAHint) {
  Running first(*render, endless());
  ASSERT_TRUE(eventually([&] { return status().running() == 1; }));
  Running second(*render, endless());
  ASSERT_TRUE(eventually([&] { return status().queued() == 1; }));
  const Collected third = renderOnce(endless());
  EXPECT_EQ(third.status.error_code(), grpc::RESOURCE_EXHAUSTED) << third.status.error_message();
  EXPECT_NE(third.status.error_message().find("retry after"), std::string::npos) << third.status.error_message();
  const auto hint = third.trailers.find("retry-after-ms");
  ASSERT_NE(hint, third.trailers.end());
  EXPECT_GT(std::atol(hint->second.c_str()), 0);
  // One that waits is cancelled where it waits.
  second.context.TryCancel();
  second.join();
  EXPECT_TRUE(eventually([&] { return status().queued() == 0; }));
  EXPECT_EQ(status().running(), 1u);
}

// grpc.health.v1 by hand: HealthCheckRequest{service = 1}, HealthCheckResponse{status = 1}.
TEST_F(Life, HealthServiceAnswers) {
  for (const std::string& name : {std::string(), std::string("gobo.v1.Render")}) {
    grpc::GenericStub stub(channel);
    grpc::ClientContext context;
    bound(context);
    grpc::CompletionQueue queue;
    std::string body;
    if (!name.empty()) body = std::string("\x0a") + char(name.size()) + name;
    grpc::Slice slice(body);
    grpc::ByteBuffer request(&slice, 1), response;
    auto call = stub.PrepareUnaryCall(&context, "/grpc.health.v1.Health/Check", request, &queue);
    call->StartCall();
    grpc::Status status;
    call->Finish(&response, &status, nullptr);
    void* tag;
    bool ok;
    ASSERT_TRUE(queue.Next(&tag, &ok));
    ASSERT_TRUE(status.ok()) << status.error_message();
    std::vector<grpc::Slice> slices;
    ASSERT_TRUE(response.Dump(&slices).ok());
    std::string text;
    for (const auto& s : slices) text.append(reinterpret_cast<const char*>(s.begin()), s.size());
    EXPECT_EQ(text, std::string("\x08\x01")) << "SERVING";
  }
}

TEST_F(Life, ReflectionIsOffUnlessAskedFor) {
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  bound(context);
  grpc::CompletionQueue queue;
  grpc::Slice slice(std::string{});
  grpc::ByteBuffer request(&slice, 1), response;
  auto call = stub.PrepareUnaryCall(&context, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", request, &queue);
  call->StartCall();
  grpc::Status status;
  call->Finish(&response, &status, nullptr);
  void* tag;
  bool ok;
  ASSERT_TRUE(queue.Next(&tag, &ok));
  EXPECT_EQ(status.error_code(), grpc::UNIMPLEMENTED);
}

TEST_F(Life, StatusTellsWhatRuns) {
  ASSERT_TRUE(renderOnce(small()).status.ok());
  const v1::StatusReply s = status();
  EXPECT_EQ(s.pid(), ::getpid());
  EXPECT_EQ(s.renders(), 1u);
  EXPECT_EQ(s.scenes(), 1u);
  EXPECT_EQ(s.threads(), 2u);
  EXPECT_GT(s.rss_bytes(), 1u << 20);
  EXPECT_EQ(s.store_limit(), 256u << 20);
  EXPECT_FALSE(s.build().empty());
}

TEST_F(Life, ShutdownIsForTheUnixSocketOnly) {
  auto tcp = v1::Admin::NewStub(grpc::CreateChannel(server->addresses()[1], grpc::InsecureChannelCredentials()));
  v1::ShutdownReply reply;
  {
    grpc::ClientContext context;
    bound(context);
    EXPECT_EQ(tcp->Shutdown(&context, {}, &reply).error_code(), grpc::PERMISSION_DENIED);
    EXPECT_FALSE(server->core().shutdownAsked.load());
  }
  grpc::ClientContext context;
  bound(context);
  EXPECT_TRUE(admin->Shutdown(&context, {}, &reply).ok());
  EXPECT_TRUE(server->core().shutdownAsked.load());
  const Collected refused = renderOnce(small());
  EXPECT_EQ(refused.status.error_code(), grpc::UNAVAILABLE);
}

TEST_F(Life, DrainLetsRunningRendersFinish) {
  Running running(*render, small(256));
  ASSERT_TRUE(eventually([&] { return server->core().running() == 1; }));
  server->shutdown(60);
  running.join();
  EXPECT_TRUE(running.result.status.ok()) << running.result.status.error_message();
  EXPECT_FALSE(std::filesystem::exists(folder + "/s.sock"));
}

TEST_F(Life, DrainThatTakesTooLongCancels) {
  Running running(*render, endless());
  ASSERT_TRUE(eventually([&] { return status().running() == 1; }));
  server->shutdown(0.05);
  running.join();
  EXPECT_EQ(running.result.status.error_code(), grpc::UNAVAILABLE) << running.result.status.error_message();
}

TEST_F(Life, SocketIsPrivateAndNotTakenFromALiveServer) {
  struct stat info {};
  ASSERT_EQ(::stat((folder + "/s.sock").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0600u);
  auto second = Server::start(config, engineOptions(config), true);
  EXPECT_EQ(second.status().code(), Code::Unavailable) << second.status().toString();
  EXPECT_TRUE(renderOnce(small(1)).status.ok());  // the first one is unharmed
}

TEST(Socket, StaleOnesGoAndOtherFilesStay) {
  std::string folder = (std::filesystem::temp_directory_path() / "gobo-sock-XXXXXX").string();
  ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  const std::string path = folder + "/x.sock";
  EXPECT_TRUE(claimSocketPath(path).ok());
  const int fd = ::socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
  ASSERT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(::listen(fd, 1), 0);
  EXPECT_EQ(claimSocketPath(path).code(), Code::Unavailable);
  EXPECT_TRUE(std::filesystem::exists(path));
  ::close(fd);  // as after kill -9
  EXPECT_TRUE(claimSocketPath(path).ok());
  EXPECT_FALSE(std::filesystem::exists(path));
  std::ofstream(path) << "mine";
  EXPECT_EQ(claimSocketPath(path).code(), Code::Unavailable);
  EXPECT_TRUE(std::filesystem::exists(path));
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace gobo
