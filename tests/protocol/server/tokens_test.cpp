// SPDX-License-Identifier: Apache-2.0
// Bearer tokens: who gets in, each limit hit once, names of the fair share, request ids, and what a reload changes.
#include <fstream>
#include <thread>

#include <google/protobuf/any.pb.h>
#include <grpcpp/generic/generic_stub.h>

#include "gobo/v1/service.pb.h"
#include "harness.h"

namespace gobo {
namespace {

class Tokens : public ServerTest {
 protected:
  static TokenConfig token(const std::string& name) {
    TokenConfig t;
    t.name = name;
    const std::string secret = "secret-" + name;
    t.sha256 = sha256Hex(secret.data(), secret.size());
    return t;
  }
  void configure(ServerConfig& c) override {
    std::filesystem::create_directory(folder + "/root/a");
    std::filesystem::create_directory(folder + "/root/b");
    c.listen.push_back("127.0.0.1:0");
    c.running = 1;
    TokenConfig plain = token("plain"), narrow = token("narrow"), slow = token("slow"), admin = token("admin"), one = token("one");
    one.rendersAtOnce = 1;
    narrow.classes = {"batch"};
    narrow.maxPixels = 64 * 48;
    narrow.maxSpp = 16;
    narrow.rendersAtOnce = 1;
    narrow.uploadBytes = 1000;
    narrow.maxSeconds = 4;
    narrow.roots = std::vector<std::string>{folder + "/root/a"};
    slow.requestsPerSecond = 0.001;
    slow.burst = 2;
    admin.admin = true;
    c.tokens = {plain, narrow, slow, admin, one};
  }
  void SetUp() override {
    ServerTest::SetUp();
    tcp = grpc::CreateChannel(server->addresses()[1], grpc::InsecureChannelCredentials());
  }
  struct Answer {
    grpc::Status status;
    std::multimap<std::string, std::string> trailers;
  };
  static void sign(grpc::ClientContext& context, const std::string& name) {
    bound(context);
    context.set_wait_for_ready(true);  // a refused connection is tried again
    if (!name.empty()) context.AddMetadata("authorization", "Bearer secret-" + name);
  }
  Answer list(const std::string& header, const std::shared_ptr<grpc::Channel>& over, const std::string& id = "") {
    grpc::ClientContext context;
    bound(context);
    context.set_wait_for_ready(true);
    if (!header.empty()) context.AddMetadata("authorization", header);
    if (!id.empty()) context.AddMetadata("x-request-id", id);
    v1::ListScenesReply reply;
    Answer a{v1::Scenes::NewStub(over)->List(&context, {}, &reply), {}};
    for (const auto& [k, v] : context.GetServerTrailingMetadata()) a.trailers.emplace(std::string(k.data(), k.size()), std::string(v.data(), v.size()));
    return a;
  }
  Collected renderAs(const std::string& name, const v1::RenderRequest& request) {
    grpc::ClientContext context;
    sign(context, name);
    auto stub = v1::Render::NewStub(tcp);
    auto reader = stub->Render(&context, request);
    return drain(context, *reader);
  }
  static v1::RenderRequest batch(uint32_t spp = 4) {
    v1::RenderRequest request = small(spp);
    request.mutable_scheduling()->set_priority(v1::Scheduling::BATCH);
    return request;
  }
  void refused(const Collected& got, grpc::StatusCode code, const std::string& reason, const std::vector<std::string>& words) {
    EXPECT_EQ(got.status.error_code(), code) << got.status.error_message();
    for (const std::string& w : words) EXPECT_NE(got.status.error_message().find(w), std::string::npos) << w << " in: " << got.status.error_message();
    EXPECT_EQ(server->core().metrics.value("gobo_refused_total", {{"reason", reason}}), 1) << reason;
  }
  std::shared_ptr<grpc::Channel> tcp;
};

TEST_F(Tokens, TcpNeedsOneAndTheUnixSocketDoesNot) {
  EXPECT_TRUE(list("Bearer secret-plain", tcp).status.ok());
  EXPECT_TRUE(list("bearer secret-plain", tcp).status.ok()) << "schemes know no case (RFC 9110)";
  for (const char* header : {"", "Bearer ", "Bearer secret-plai", "Bearer secret-plain ", "Basic c2VjcmV0", "secret-plain"}) {
    const Answer a = list(header, tcp);
    EXPECT_EQ(a.status.error_code(), grpc::UNAUTHENTICATED) << header;
    EXPECT_NE(a.status.error_message().find("authorization"), std::string::npos);
    EXPECT_EQ(a.status.error_message().find("secret"), std::string::npos) << "what was sent is not echoed";
  }
  EXPECT_TRUE(list("", channel).status.ok());
  EXPECT_EQ(list("Bearer wrong", channel).status.error_code(), grpc::UNAUTHENTICATED) << "one that is shown must be right";
}

// Also of services that are added later: a handler without serve() would answer something else.
TEST_F(Tokens, EveryMethodOfTheSchemaWantsOne) {
  const auto* pool = google::protobuf::DescriptorPool::generated_pool();
  int methods = 0;
  for (const char* file : {"gobo/v1/service.proto", "gobo/v1/jobs.proto", "gobo/v1/farm.proto"}) {
    const auto* found = pool->FindFileByName(file);
    if (!found) continue;
    for (int i = 0; i < found->service_count(); ++i)
      for (int k = 0; k < found->service(i)->method_count(); ++k, ++methods) {
        const std::string path = "/" + found->service(i)->full_name() + "/" + found->service(i)->method(k)->name();
        grpc::GenericStub stub(tcp);
        grpc::ClientContext context;
        bound(context);
        grpc::CompletionQueue queue;
        grpc::Slice slice(std::string{});
        grpc::ByteBuffer request(&slice, 1), response;
        auto call = stub.PrepareUnaryCall(&context, path, request, &queue);
        call->StartCall();
        grpc::Status status;
        call->Finish(&response, &status, nullptr);
        void* tag;
        bool ok;
        ASSERT_TRUE(queue.Next(&tag, &ok));
        EXPECT_EQ(status.error_code(), grpc::UNAUTHENTICATED) << path << ": " << status.error_message();
      }
  }
  EXPECT_GE(methods, 37);
}

TEST_F(Tokens, ARenderIdIsItsTokens) {
  const Collected first = renderAs("plain", batch());
  ASSERT_TRUE(first.status.ok()) << first.status.error_message();
  const auto relightAs = [&](const std::string& name, const std::string& id, const std::shared_ptr<grpc::Channel>& over) {
    v1::RelightRequest relight;
    relight.set_render_id(id);
    relight.mutable_patch()->mutable_tone_map()->set_exposure(1);
    relight.add_mask("tone_map.exposure");
    grpc::ClientContext context;
    sign(context, name);
    auto stub = v1::Render::NewStub(over);
    auto reader = stub->Relight(&context, relight);
    return drain(context, *reader);
  };
  EXPECT_TRUE(relightAs("plain", first.reply.render_id(), tcp).status.ok());
  const Collected other = relightAs("narrow", first.reply.render_id(), tcp);
  EXPECT_EQ(other.status.error_code(), grpc::NOT_FOUND);
  EXPECT_TRUE(relightAs("admin", first.reply.render_id(), tcp).status.ok());
  EXPECT_TRUE(relightAs("", first.reply.render_id(), channel).status.ok()) << "the local user, as with jobs";
  const Collected local = renderOnce(batch());
  ASSERT_TRUE(local.status.ok());
  EXPECT_EQ(relightAs("plain", local.reply.render_id(), tcp).status.error_code(), grpc::NOT_FOUND);
}

TEST_F(Tokens, StatusSaysWhatOfTheMemoryIsWhoseToThemAlone) {
  for (const char* name : {"plain", "admin"}) {
    grpc::ClientContext context;
    sign(context, name);
    v1::OpenSceneRequest open;
    open.set_source("cornell");
    open.set_name(std::string("of-") + name);
    v1::SceneInfo info;
    ASSERT_TRUE(v1::Scenes::NewStub(tcp)->Open(&context, open, &info).ok());
  }
  const auto scenesOf = [&](const std::string& name) {
    grpc::ClientContext context;
    sign(context, name);
    v1::StatusReply reply;
    EXPECT_TRUE(v1::Admin::NewStub(tcp)->GetStatus(&context, {}, &reply).ok());
    std::vector<std::string> callers;
    for (const v1::MemoryHolder& holder : reply.memory())
      if (holder.name() == "scenes")
        for (const auto& [caller, bytes] : holder.callers())
          if (bytes > 0) callers.push_back(caller);
    std::sort(callers.begin(), callers.end());
    return callers;
  };
  EXPECT_EQ(scenesOf("plain"), std::vector<std::string>{"plain"});
  EXPECT_EQ(scenesOf("narrow"), std::vector<std::string>{});
  EXPECT_EQ(scenesOf("admin"), (std::vector<std::string>{"admin", "plain"}));
}

TEST_F(Tokens, RequestsPerSecond) {
  EXPECT_TRUE(list("Bearer secret-slow", tcp).status.ok());
  EXPECT_TRUE(list("Bearer secret-slow", tcp).status.ok());
  const Answer third = list("Bearer secret-slow", tcp);
  EXPECT_EQ(third.status.error_code(), grpc::RESOURCE_EXHAUSTED);
  EXPECT_NE(third.status.error_message().find("0.001 (tokens.requests_per_s of \"slow\")"), std::string::npos) << third.status.error_message();
  ASSERT_EQ(third.trailers.count("retry-after-ms"), 1u);
  EXPECT_GT(std::atof(third.trailers.find("retry-after-ms")->second.c_str()), 0.9e6);
  EXPECT_TRUE(list("Bearer secret-plain", tcp).status.ok()) << "another token's bucket is its own";
}

TEST_F(Tokens, LimitsOfARequestNameFieldValueAndLimit) {
  EXPECT_TRUE(renderAs("narrow", batch()).status.ok());
  refused(renderAs("narrow", small()), grpc::PERMISSION_DENIED, "class", {"scheduling.priority = normal", "batch", "tokens.classes"});
  v1::RenderRequest request = batch();
  request.set_width(65);
  refused(renderAs("narrow", request), grpc::INVALID_ARGUMENT, "pixels", {"65 x 48 = 3120", "at most 3072", "tokens.max_pixels", "request.width"});
  refused(renderAs("narrow", batch(17)), grpc::INVALID_ARGUMENT, "spp", {"halt.spp = 17", "at most 16", "tokens.max_spp"});
  request = batch();
  request.mutable_environment()->set_path(folder + "/root/b/x.hdr");
  refused(renderAs("narrow", request), grpc::PERMISSION_DENIED, "root", {"root/b/x.hdr", "tokens.roots", "request.environment.path"});
  EXPECT_TRUE(renderAs("plain", small(17)).status.ok()) << "nothing of it binds another token";
}

TEST_F(Tokens, SamplesAreBoundWhereOnlyTimeIsGiven) {
  v1::RenderRequest request = batch();
  request.mutable_halt()->Clear();
  request.mutable_halt()->set_time_s(30);
  const Collected got = renderAs("narrow", request);
  ASSERT_TRUE(got.status.ok()) << got.status.error_message();
  EXPECT_EQ(got.reply.resolved().halt().spp(), 16u);
}

TEST_F(Tokens, RootsBoundOpenAsWell) {
  for (const auto& [path, code] : std::map<std::string, grpc::StatusCode>{{folder + "/root/a/x.glb", grpc::NOT_FOUND},
                                                                          {folder + "/root/b/x.glb", grpc::PERMISSION_DENIED},
                                                                          {folder + "/root/a/../b/x.glb", grpc::PERMISSION_DENIED}}) {
    grpc::ClientContext context;
    sign(context, "narrow");
    v1::OpenSceneRequest request;
    request.set_source(path);
    v1::SceneInfo info;
    EXPECT_EQ(v1::Scenes::NewStub(tcp)->Open(&context, request, &info).error_code(), code) << path;
  }
}

TEST_F(Tokens, UploadBytes) {
  grpc::ClientContext context;
  sign(context, "narrow");
  v1::SceneInfo info;
  auto stub = v1::Scenes::NewStub(tcp);
  auto writer = stub->Upload(&context, &info);
  v1::UploadSceneRequest first;
  first.set_extension(".glb");
  first.set_total_bytes(1001);
  writer->Write(first);
  writer->WritesDone();
  const grpc::Status status = writer->Finish();
  EXPECT_EQ(status.error_code(), grpc::RESOURCE_EXHAUSTED);
  EXPECT_NE(status.error_message().find("total_bytes = 1001: uploads are limited to 1000 bytes (tokens.upload_bytes)"), std::string::npos)
      << status.error_message();
}

TEST_F(Tokens, RendersAtOnceAndTimePerRequest) {
  v1::RenderRequest request = batch(16);  // holds its place while another one renders
  Collected slow;
  grpc::ClientContext blocker;
  sign(blocker, "plain");
  v1::RenderRequest endless = small(1 << 20);
  auto stub = v1::Render::NewStub(tcp);
  auto reader = stub->Render(&blocker, endless);
  ASSERT_TRUE(eventually([&] { return status().running() == 1; }));
  std::thread waiting([&] { slow = renderAs("narrow", request); });
  ASSERT_TRUE(eventually([&] { return status().queued() == 1; }));
  refused(renderAs("narrow", request), grpc::RESOURCE_EXHAUSTED, "renders", {"renders at once: at most 1", "tokens.renders_at_once", "retry after"});
  waiting.join();
  refused(slow, grpc::DEADLINE_EXCEEDED, "time", {"tokens.max_s of \"narrow\" = 4"});
  blocker.TryCancel();
  drain(blocker, *reader);
  ASSERT_TRUE(eventually([&] { return status().running() == 0; }));
  EXPECT_TRUE(renderAs("narrow", request).status.ok()) << "the place is free again";
}

// Only what has its session's turn is one of the token's renders: the newest edit wins, whatever runs or waits before it.
TEST_F(Tokens, RendersAtOnceLeavesSessionsTheirLatestEdit) {
  const auto stub = v1::Render::NewStub(tcp);
  v1::RenderRequest request = small(1 << 20);
  request.mutable_scheduling()->set_session("s");
  struct Edit {
    grpc::ClientContext context;
    Collected got;
    std::atomic<bool> over{false};
    std::thread thread;
    Edit(v1::Render::Stub& stub, const v1::RenderRequest& request) {
      sign(context, "one");
      thread = std::thread([this, &stub, request] {
        const auto reader = stub.RenderProgressive(&context, request);
        got = drain(context, *reader);
        over = true;
      });
    }
    ~Edit() {
      context.TryCancel();
      thread.join();
    }
  };
  const auto replaced = [](const Edit& e) {
    EXPECT_EQ(e.got.status.error_code(), grpc::CANCELLED) << e.got.status.error_message();
    EXPECT_NE(e.got.status.error_message().find("replaced by a newer request"), std::string::npos) << e.got.status.error_message();
  };
  Edit a(*stub, request);
  ASSERT_TRUE(eventually([&] { return status().running() == 1; }));
  Edit b(*stub, request);
  ASSERT_TRUE(eventually([&] { return server->core().edits.used() == 1 || a.over; })) << "it waits, or has already ended the other one";
  grpc::ClientContext context;
  sign(context, "one");
  bool seen = false;
  const auto reader = stub->RenderProgressive(&context, request);
  drain(context, *reader, [&](const v1::RenderEvent& event) {
    if (!event.has_snapshot() || seen) return;
    seen = true;
    refused(renderAs("one", small()), grpc::RESOURCE_EXHAUSTED, "renders", {"renders at once: at most 1", "tokens.renders_at_once"});
    context.TryCancel();
  });
  EXPECT_TRUE(seen) << "the newest one has pictures";
  ASSERT_TRUE(eventually([&] { return a.over && b.over; }));
  replaced(a);
  replaced(b);
}

TEST_F(Tokens, AdminRight) {
  const auto as = [&](const std::string& name, const std::shared_ptr<grpc::Channel>& over) {
    grpc::ClientContext context;
    sign(context, name);
    v1::DropCachesReply reply;
    return v1::Admin::NewStub(over)->DropCaches(&context, {}, &reply).error_code();
  };
  EXPECT_EQ(as("plain", tcp), grpc::PERMISSION_DENIED);
  EXPECT_EQ(as("plain", channel), grpc::PERMISSION_DENIED) << "who shows a token is that token, on the socket too";
  EXPECT_EQ(as("admin", tcp), grpc::OK);
  EXPECT_EQ(as("", channel), grpc::OK);
  grpc::ClientContext context;
  sign(context, "admin");
  v1::ShutdownReply reply;
  EXPECT_TRUE(v1::Admin::NewStub(tcp)->Shutdown(&context, {}, &reply).ok());
}

TEST_F(Tokens, TermsAreListedWholeAndPinnedWithTheAdminRight) {
  ASSERT_TRUE(renderAs("admin", batch(4)).status.ok());
  const auto list = [&](const std::string& name, const v1::ListTermsRequest& request, v1::ListTermsReply& reply) {
    grpc::ClientContext context;
    sign(context, name);
    return v1::Admin::NewStub(tcp)->ListTerms(&context, request, &reply);
  };
  v1::ListTermsReply whole, totals;
  ASSERT_TRUE(list("admin", {}, whole).ok());
  ASSERT_GT(whole.terms_size(), 0);
  EXPECT_FALSE(whole.totals_only());
  ASSERT_TRUE(list("plain", {}, totals).ok());
  EXPECT_EQ(totals.terms_size(), 0);
  EXPECT_TRUE(totals.totals_only());
  EXPECT_EQ(totals.totals_size(), whole.totals_size());
  v1::ListTermsRequest chosen;
  chosen.mutable_which()->set_scene("cornell");
  EXPECT_EQ(list("plain", chosen, totals).error_code(), grpc::PERMISSION_DENIED) << "it would say whether somebody rendered that scene";
  EXPECT_TRUE(list("admin", chosen, totals).ok());
  v1::PinTermsRequest pin;
  pin.mutable_which()->set_type("*");
  const auto pinAs = [&](const std::string& name, v1::PinTermsReply& reply) {
    grpc::ClientContext context;
    sign(context, name);
    return v1::Admin::NewStub(tcp)->PinTerms(&context, pin, &reply);
  };
  v1::PinTermsReply pinned;
  EXPECT_EQ(pinAs("plain", pinned).error_code(), grpc::PERMISSION_DENIED);
  ASSERT_TRUE(pinAs("admin", pinned).ok());
  EXPECT_EQ(pinned.terms(), uint64_t(whole.terms_size()));
  EXPECT_EQ(pinned.memory_only(), pinned.terms()) << "this server has no disk cache";
  pin.clear_which();
  EXPECT_EQ(pinAs("admin", pinned).error_code(), grpc::INVALID_ARGUMENT);
}

TEST_F(Tokens, TheFairSharesClientIsTheTokensName) {
  const auto names = [&] {
    std::string all;
    for (const WorkerState& w : server->core().jobs.workers()) all += w.client;
    return all;
  };
  const auto runAs = [&](const std::string& name, const std::string& claimed) {
    grpc::ClientContext context;
    sign(context, name);
    v1::RenderRequest request = small(1 << 20);
    if (!claimed.empty()) request.mutable_scheduling()->set_client(claimed);
    auto stub = v1::Render::NewStub(name.empty() ? channel : tcp);
    auto reader = stub->Render(&context, request);
    std::string seen;
    eventually([&] { return !(seen = names()).empty(); }, 5);
    context.TryCancel();
    drain(context, *reader);
    eventually([&] { return names().empty(); });
    return seen;
  };
  EXPECT_EQ(runAs("plain", ""), "plain");
  EXPECT_EQ(runAs("plain", "workstation-7"), "plain") << "inventing names would multiply the share";
  EXPECT_EQ(runAs("", "workstation-7"), "workstation-7");
  v1::RenderRequest request = small();
  request.mutable_scheduling()->set_client("admin");
  refused(renderAs("plain", request), grpc::PERMISSION_DENIED, "client", {"client = \"admin\"", "another's token", "request.scheduling.client"});
  EXPECT_EQ(renderOnce(request).status.error_code(), grpc::PERMISSION_DENIED) << "nor from the socket without a token";
}

TEST_F(Tokens, RequestIdsComeBackInTrailersDetailsAndLogs) {
  std::mutex mutex;
  std::vector<std::string> lines;
  setLogSink([&](const std::string& line) {
    const std::lock_guard lock(mutex);
    lines.push_back(line);
  });
  setLogLevel(LogLevel::Debug);
  setLogFormat(LogFormat::Json);
  const Answer sent = list("Bearer secret-plain", tcp, "job-17:frame.3");
  const Answer odd = list("Bearer secret-plain", tcp, "two words");
  const Answer refusedCall = list("Bearer wrong", tcp, "job-18");
  setLogSink({});
  setLogLevel(LogLevel::Off);
  setLogFormat(LogFormat::Text);
  EXPECT_EQ(sent.trailers.find("x-request-id")->second, "job-17:frame.3");
  EXPECT_EQ(odd.trailers.find("x-request-id")->second.size(), 16u) << "one of the server's own";
  EXPECT_EQ(refusedCall.trailers.find("x-request-id")->second, "job-18");
  // google.rpc.Status by hand: 3 is a list of Any.
  const std::string details = refusedCall.status.error_details();
  const size_t at = details.find("type.googleapis.com/google.rpc.RequestInfo");
  ASSERT_NE(at, std::string::npos);
  EXPECT_NE(details.find("job-18", at), std::string::npos);
  int found = 0;
  for (const std::string& line : lines) found += line.find("\"event\":\"list\",\"request\":\"job-17:frame.3\",\"client\":\"plain\"") != std::string::npos;
  EXPECT_EQ(found, 1);
  for (const std::string& line : lines) EXPECT_EQ(line.find("secret"), std::string::npos) << line;
}

TEST_F(Tokens, ReloadChangesTokensLimitsAndRootsAndNamesWhatItCannot) {
  ServerConfig next = config;
  next.tokens = {token("newcomer")};
  next.roots = {folder + "/root/b"};
  next.imageBytes = 1000;
  next.running = 2;
  next.threads = 1;
  auto fixed = server->reload(next);
  ASSERT_TRUE(fixed.ok()) << fixed.status().toString();
  EXPECT_EQ(*fixed, (std::vector<std::string>{"engine.threads", "scheduler.running"}));
  EXPECT_TRUE(list("Bearer secret-newcomer", tcp).status.ok());
  EXPECT_EQ(list("Bearer secret-plain", tcp).status.error_code(), grpc::UNAUTHENTICATED);
  const Collected big = renderAs("newcomer", small());
  EXPECT_NE(big.status.error_message().find("at most 1000 (limits.image_bytes)"), std::string::npos) << big.status.error_message();
  v1::OpenSceneRequest request;
  v1::SceneInfo info;
  grpc::ClientContext context;
  bound(context);
  request.set_source(folder + "/root/a/x.glb");
  EXPECT_EQ(scenes->Open(&context, request, &info).error_code(), grpc::PERMISSION_DENIED);
  // Taking the last token away would leave TCP open: allowed on loopback, as at a start.
  next.tokens.clear();
  EXPECT_TRUE(server->reload(next).ok());
  EXPECT_TRUE(list("", tcp).status.ok());
}

}  // namespace
}  // namespace gobo
