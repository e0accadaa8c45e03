// SPDX-License-Identifier: Apache-2.0
// /metrics, /health and /ready, and loads that can be cancelled.
#include <thread>

#include <grpcpp/generic/generic_stub.h>
#include <nlohmann/json.hpp>

#include "harness.h"
#include "http_get.h"
#include "server/load_gate.h"

namespace gobo {
namespace {

using test::httpGet;
using test::parseMetrics;

class Http : public ServerTest {
 protected:
  void configure(ServerConfig& c) override {
    c.httpListen = "127.0.0.1:0";
    c.queuedNormal = 1;
  }
  std::map<std::string, double> metrics() {
    const auto got = httpGet(server->httpAddress(), "/metrics");
    EXPECT_EQ(got.status, 200);
    EXPECT_NE(got.head.find("text/plain; version=0.0.4"), std::string::npos) << got.head;
    return parseMetrics(got.body);
  }
};

TEST_F(Http, MetricsCountWhatHappened) {
  auto before = metrics();
  EXPECT_EQ(before["gobo_rays_total"], 0);
  const Collected first = renderOnce(small()), again = renderOnce(small());
  ASSERT_TRUE(first.status.ok() && again.status.ok());
  EXPECT_EQ(renderOnce(small(4, "no-such-scene")).status.error_code(), grpc::NOT_FOUND);
  // The client has its answer a moment before the server has counted it.
  ASSERT_TRUE(eventually([&] { return metrics()["gobo_request_seconds_count{method=\"render\"}"] == 3; }));
  auto m = metrics();
  EXPECT_EQ(m["gobo_requests_total{method=\"render\",code=\"OK\"}"], 2);
  EXPECT_EQ(m["gobo_requests_total{method=\"render\",code=\"NOT_FOUND\"}"], 1);
  for (const char* what : {"queue", "run", "total"}) {
    EXPECT_EQ(m["gobo_render_" + std::string(what) + "_seconds_count{class=\"normal\"}"], 2) << what;
    EXPECT_EQ(m["gobo_render_" + std::string(what) + "_seconds_bucket{class=\"normal\",le=\"+Inf\"}"], 2) << what;
  }
  EXPECT_GE(m["gobo_render_total_seconds_sum{class=\"normal\"}"], m["gobo_render_run_seconds_sum{class=\"normal\"}"]);
  EXPECT_EQ(m["gobo_rays_total"], double(first.reply.rays() + again.reply.rays()));
  EXPECT_GT(m["gobo_store_misses_total"], 0);
  EXPECT_GT(m["gobo_store_hits_total{tier=\"memory\"}"], 0) << "the second one found the first one's terms";
  EXPECT_EQ(m["gobo_renders_done_total{class=\"normal\"}"], 2);
  EXPECT_EQ(m["gobo_renders_running{class=\"normal\"}"], 0);
  EXPECT_EQ(m["gobo_scenes"], 1);
  EXPECT_EQ(m["gobo_workers"], 1);
  EXPECT_GT(m["gobo_store_bytes"], 0);
  EXPECT_GT(m["gobo_resident_bytes"], 1 << 20);
  EXPECT_GT(m["gobo_open_fds"], 3);
}

TEST_F(Http, RunningQueuedAndRefusedShow) {
  v1::RenderRequest endless = small(1 << 20);
  grpc::ClientContext a, b;
  auto first = render->Render(&a, endless);
  ASSERT_TRUE(eventually([&] { return metrics()["gobo_renders_running{class=\"normal\"}"] == 1; }));
  auto second = render->Render(&b, endless);
  ASSERT_TRUE(eventually([&] { return metrics()["gobo_renders_queued{class=\"normal\"}"] == 1; }));
  const Collected third = renderOnce(endless);
  EXPECT_NE(third.status.error_message().find("at most 1 (scheduler.queued_normal)"), std::string::npos) << third.status.error_message();
  EXPECT_EQ(metrics()["gobo_refused_total{reason=\"queue\"}"], 1);
  EXPECT_EQ(metrics()["gobo_workers_busy"], 1);
  const auto health = nlohmann::json::parse(httpGet(server->httpAddress(), "/health").body);
  EXPECT_EQ(health["workers"][0]["state"], "busy");
  EXPECT_EQ(health["workers"][0]["class"], "normal");
  EXPECT_EQ(health["queues"]["normal"]["queued"], 1);
  v1::RenderRequest urgent = small();
  urgent.mutable_halt()->clear_spp();
  urgent.mutable_halt()->set_time_s(0.05);  // a small one would run beside
  urgent.mutable_scheduling()->set_priority(v1::Scheduling::INTERACTIVE);
  EXPECT_TRUE(renderOnce(urgent).status.ok());
  EXPECT_EQ(metrics()["gobo_preemptions_total{class=\"normal\"}"], 1);
  a.TryCancel();
  b.TryCancel();
  drain(a, *first);
  drain(b, *second);
}

TEST_F(Http, HealthAndReadyFlipBeforeTheServerGoes) {
  auto got = httpGet(server->httpAddress(), "/health");
  EXPECT_EQ(got.status, 200);
  const auto health = nlohmann::json::parse(got.body);
  EXPECT_EQ(health["status"], "serving");
  EXPECT_EQ(health["renderer_initialized"], true);
  EXPECT_EQ(health["ready_workers"], 1);
  EXPECT_EQ(health["total_workers"], 1);
  EXPECT_EQ(health["workers"][0]["state"], "idle");
  EXPECT_FALSE(health["build"].get<std::string>().empty());
  EXPECT_EQ(httpGet(server->httpAddress(), "/ready").status, 200);
  server->core().drain();
  got = httpGet(server->httpAddress(), "/health");
  EXPECT_EQ(got.status, 503);
  EXPECT_EQ(nlohmann::json::parse(got.body)["status"], "draining");
  EXPECT_EQ(nlohmann::json::parse(got.body)["ready_workers"], 0);
  EXPECT_EQ(httpGet(server->httpAddress(), "/ready").status, 503);
  EXPECT_EQ(metrics()["gobo_draining"], 1);
  const Collected refused = renderOnce(small());
  EXPECT_EQ(refused.status.error_code(), grpc::UNAVAILABLE);
  EXPECT_NE(refused.status.error_message().find("retry after"), std::string::npos) << refused.status.error_message();
  EXPECT_EQ(refused.trailers.count("retry-after-ms"), 1u);
}

// grpc.health.v1 by hand: HealthCheckRequest{service = 1}, HealthCheckResponse{status = 1}; 1 SERVING, 2 NOT_SERVING.
TEST_F(Http, TheHealthServiceFlipsWithTheDrain) {
  const auto check = [&](const std::string& service) {
    grpc::GenericStub stub(channel);
    grpc::ClientContext context;
    bound(context);
    grpc::CompletionQueue queue;
    grpc::Slice slice(service.empty() ? std::string() : std::string("\x0a") + char(service.size()) + service);
    grpc::ByteBuffer request(&slice, 1), response;
    auto call = stub.PrepareUnaryCall(&context, "/grpc.health.v1.Health/Check", request, &queue);
    call->StartCall();
    grpc::Status status;
    call->Finish(&response, &status, nullptr);
    void* tag;
    bool ok;
    queue.Next(&tag, &ok);
    std::vector<grpc::Slice> slices;
    std::string text;
    if (status.ok() && response.Dump(&slices).ok())
      for (const auto& s : slices) text.append(reinterpret_cast<const char*>(s.begin()), s.size());
    return text.size() == 2 && text[0] == 8 ? int(text[1]) : -1;
  };
  for (const char* service : {"", "gobo.v1.Render", "gobo.v1.Scenes", "gobo.v1.Admin"}) EXPECT_EQ(check(service), 1) << service;
  grpc::ClientContext context;
  bound(context);
  v1::ShutdownReply reply;
  ASSERT_TRUE(admin->Shutdown(&context, {}, &reply).ok());  // before anybody calls Server::shutdown
  for (const char* service : {"", "gobo.v1.Render", "gobo.v1.Scenes", "gobo.v1.Admin"}) EXPECT_EQ(check(service), 2) << service;
}

TEST_F(Http, OtherPathsAndMethodsAreNotServed) {
  EXPECT_EQ(httpGet(server->httpAddress(), "/").status, 404);
  EXPECT_EQ(httpGet(server->httpAddress(), "/../../etc/passwd").status, 404);
  EXPECT_EQ(httpGet(server->httpAddress(), "/metrics", "DELETE").status, 405);
}

TEST_F(Http, AnAddressThatIsTakenFailsTheStart) {
  ServerConfig other = config;
  other.listen = {"unix:" + folder + "/other.sock"};
  other.httpListen = server->httpAddress();
  const auto started = Server::start(other, engineOptions(other), true);
  EXPECT_EQ(started.status().code(), Code::Unavailable);
  EXPECT_NE(started.status().message().find("http.listen"), std::string::npos) << started.status().message();
}

TEST_F(Http, StatusHasDevicesAndFacts) {
  v1::StatusReply s;
  ASSERT_TRUE(eventually([&] {
    s = status();
    return s.devices_size() == 3 && s.devices(2).find("being looked for") == std::string::npos;
  }));
  EXPECT_EQ(s.devices(0).rfind("cpu: ", 0), 0u) << s.devices(0);
  EXPECT_NE(s.devices(0).find("avx2"), std::string::npos) << s.devices(0);
  EXPECT_EQ(s.devices(1).rfind("vulkan: ", 0), 0u);
  EXPECT_EQ(s.devices(2).rfind("egl: ", 0), 0u);
  EXPECT_EQ(s.workers(), 1u);
  EXPECT_GT(s.open_fds(), 3u);
  EXPECT_FALSE(s.draining());
}

// A load waits for its place; its client leaves; the load never runs and the place is free.
TEST_F(Http, AClientThatLeavesTakesItsLoadAlong) {
  LoadGate& gate = server->core().loads;
  gate.setLimit(1);
  std::atomic<bool> release{false};
  std::thread holder([&] {
    const Status held = gate.run(
        "someone",
        [&](const StopToken&) -> Status {
          while (!release) std::this_thread::sleep_for(std::chrono::milliseconds(1));
          return {};
        },
        [] { return false; });
    EXPECT_TRUE(held.ok());
  });
  ASSERT_TRUE(eventually([&] { return gate.running() == 1; }));
  grpc::ClientContext context;
  v1::OpenSceneRequest request;
  request.set_source("spheres");
  v1::SceneInfo info;
  grpc::Status opened;
  std::thread opener([&] { opened = scenes->Open(&context, request, &info); });
  ASSERT_TRUE(eventually([&] { return gate.waiting() == 1; }));
  context.TryCancel();
  opener.join();
  EXPECT_EQ(opened.error_code(), grpc::CANCELLED);
  EXPECT_TRUE(eventually([&] { return gate.waiting() == 0 && server->core().running() == 0; }));
  release = true;
  holder.join();
  EXPECT_EQ(status().scenes(), 0u);
}

}  // namespace
}  // namespace gobo
