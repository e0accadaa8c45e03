// SPDX-License-Identifier: Apache-2.0
// Who waits for whom, and what he is told: small renders beside a big one, places in queues, default classes, bounds and deadlines of sessions.
#include <thread>

#include "gobo/v1/jobs.grpc.pb.h"
#include "harness.h"
#include "server/core.h"

namespace gobo {
namespace {

class QueueProtocol : public ServerTest {
 protected:
  /// A render that runs until it is cancelled.
  class Endless {
   public:
    Endless(QueueProtocol& test, v1::RenderRequest request, bool progressive = false) {
      request.mutable_halt()->set_spp(1 << 18);
      request.set_width(320);
      request.set_height(240);
      bound(context);
      thread_ = std::thread([this, &test, request, progressive] {
        auto reader = progressive ? test.render->RenderProgressive(&context, request) : test.render->Render(&context, request);
        v1::RenderEvent event;
        while (reader->Read(&event)) {}
        status = reader->Finish();
        over = true;
      });
    }
    ~Endless() { end(); }
    void end() {
      context.TryCancel();
      if (thread_.joinable()) thread_.join();
    }
    grpc::ClientContext context;
    grpc::Status status;
    std::atomic<bool> over{false};

   private:
    std::thread thread_;
  };
  bool runs(JobClass c, size_t running = 1, size_t queued = 0) {
    return eventually([&] {
      const auto stats = server->core().jobs.stats().classes[size_t(c)];
      return stats.running == running && stats.queued == queued;
    });
  }
  Collected progressive(const v1::RenderRequest& request, const std::function<void(const v1::RenderEvent&)>& hook = {}) {
    grpc::ClientContext context;
    bound(context);
    auto reader = render->RenderProgressive(&context, request);
    return drain(context, *reader, hook);
  }
  static v1::RenderRequest with(v1::RenderRequest request, v1::Scheduling::Class c) {
    request.mutable_scheduling()->set_priority(c);
    return request;
  }
  static v1::RenderRequest of(v1::RenderRequest request, const char* output) {
    request.add_outputs(output);
    return request;
  }
};

TEST_F(QueueProtocol, SmallPicturesAreMadeBesideOneThatNeverEnds) {
  for (const auto c : {v1::Scheduling::INTERACTIVE, v1::Scheduling::NORMAL, v1::Scheduling::BATCH}) {
    Endless big(*this, with(small(), c));
    ASSERT_TRUE(runs(c == v1::Scheduling::INTERACTIVE ? JobClass::Interactive : c == v1::Scheduling::NORMAL ? JobClass::Normal : JobClass::Batch));
    const Collected depth = renderOnce(of(small(), "depth"));
    ASSERT_TRUE(depth.status.ok()) << depth.status.error_message();
    EXPECT_FALSE(big.over) << int(c);
    EXPECT_EQ(
        server->core().jobs.stats().classes[0].preempted + server->core().jobs.stats().classes[1].preempted + server->core().jobs.stats().classes[2].preempted,
        0u);
    big.end();
    ASSERT_TRUE(eventually([&] { return server->core().jobs.stats().running == 0; }));
    // Beside another one or alone: the same bits.
    v1::DropCachesReply dropped;
    grpc::ClientContext context;
    bound(context);
    ASSERT_TRUE(admin->DropCaches(&context, {}, &dropped).ok());
    EXPECT_EQ(depth.images, renderOnce(of(small(), "depth")).images);
  }
}

TEST_F(QueueProtocol, WhoWaitsIsToldHisPlaceAndThatTheWaitIsOver) {
  auto big = std::make_unique<Endless>(*this, with(small(), v1::Scheduling::INTERACTIVE));
  ASSERT_TRUE(runs(JobClass::Interactive));
  // The earliest deadline goes first, and those of gRPC are rounded on their way: of two alike either may be the earlier one.
  v1::RenderRequest sooner = with(small(), v1::Scheduling::INTERACTIVE);
  sooner.mutable_scheduling()->set_deadline_ms(30000);
  Endless before(*this, sooner);
  ASSERT_TRUE(runs(JobClass::Interactive, 1, 1));
  v1::RenderRequest request = small(4096);
  request.set_width(160);
  request.mutable_halt()->clear_spp();
  request.mutable_halt()->set_time_s(0.3);  // not small: nobody knows what it takes
  std::vector<uint32_t> places;
  bool ran = false;
  size_t after = 0;
  const Collected got = progressive(request, [&](const v1::RenderEvent& event) {
    if (!event.has_progress()) return;
    const v1::Progress& p = event.progress();
    if (p.queued()) {
      EXPECT_FALSE(ran);
      if (places.empty() || places.back() != p.position()) places.push_back(p.position());
      if (places == std::vector<uint32_t>{1} && big) {
        big->end();
        big.reset();
      } else if (places == std::vector<uint32_t>{1, 0}) {
        before.context.TryCancel();
      }
    } else {
      ran = true;
      ++after;
    }
  });
  ASSERT_TRUE(got.status.ok()) << got.status.error_message();
  EXPECT_EQ(places, (std::vector<uint32_t>{1, 0}));
  EXPECT_GE(after, 1u) << "the wait's end is told";
}

TEST_F(QueueProtocol, TheRestOfARenderIsExpected) {
  v1::RenderRequest request = small(128);
  request.set_width(256);
  request.set_height(192);
  size_t expected = 0;
  const Collected got = progressive(request, [&](const v1::RenderEvent& event) {
    if (event.has_progress() && event.progress().eta_ms() > 0) ++expected;
    if (event.has_progress()) { EXPECT_TRUE(std::isfinite(event.progress().eta_ms()) && event.progress().eta_ms() >= 0); }
  });
  ASSERT_TRUE(got.status.ok());
  EXPECT_GT(expected, 0u);
}

TEST_F(QueueProtocol, TheClassOfWhoNamesNone) {
  using S = v1::Scheduling;
  const auto classOf = [](const Collected& c) { return c.reply.resolved().scheduling().priority(); };
  EXPECT_EQ(classOf(renderOnce(small())), S::NORMAL);
  EXPECT_EQ(classOf(progressive(small())), S::INTERACTIVE);
  EXPECT_EQ(classOf(progressive(with(small(), S::BATCH))), S::BATCH);
  v1::RenderRequest bar = small();
  bar.mutable_scheduling()->set_ladder(false);
  EXPECT_EQ(classOf(progressive(bar)), S::NORMAL);
  for (const char* output : {"albedo", "normal", "position", "depth", "alpha", "object_id", "material_id", "motion"}) {
    EXPECT_EQ(classOf(renderOnce(of(small(), output))), S::INTERACTIVE) << output;
    EXPECT_EQ(classOf(renderOnce(with(of(small(), output), S::NORMAL))), S::NORMAL) << output;
    EXPECT_EQ(classOf(renderOnce(of(of(small(), output), "beauty"))), S::NORMAL) << output;
  }
  for (const char* output : {"sample_count", "visibility:light", "unoccluded:light", "group:light"})
    EXPECT_EQ(classOf(renderOnce(of(small(), output))), S::NORMAL) << output;

  grpc::ClientContext context;
  bound(context);
  v1::PlanReply plan;
  ASSERT_TRUE(render->Plan(&context, of(small(), "depth"), &plan).ok());
  EXPECT_EQ(plan.resolved().scheduling().priority(), S::INTERACTIVE);
}

TEST_F(QueueProtocol, TheClassOfARelight) {
  using S = v1::Scheduling;
  const auto relit = [&](S::Class first, bool progressive, std::optional<S::Class> named) {
    const Collected base = renderOnce(first == S::CLASS_UNSPECIFIED ? small() : with(small(), first));
    v1::RelightRequest request;
    request.set_render_id(base.reply.render_id());
    request.set_progressive(progressive);
    if (named) {
      request.mutable_patch()->mutable_scheduling()->set_priority(*named);
      request.add_mask("scheduling.priority");
    }
    grpc::ClientContext context;
    bound(context);
    auto reader = render->Relight(&context, request);
    return drain(context, *reader).reply.resolved().scheduling().priority();
  };
  EXPECT_EQ(relit(S::CLASS_UNSPECIFIED, false, {}), S::NORMAL);
  EXPECT_EQ(relit(S::CLASS_UNSPECIFIED, true, {}), S::INTERACTIVE);
  EXPECT_EQ(relit(S::BATCH, true, {}), S::BATCH);
  EXPECT_EQ(relit(S::CLASS_UNSPECIFIED, true, S::NORMAL), S::NORMAL);
}

class SessionProtocol : public QueueProtocol {
 protected:
  static v1::RenderRequest in(const char* session, v1::RenderRequest request = small()) {
    request.mutable_scheduling()->set_session(session);
    return request;
  }
  SharedLimit& edits() { return server->core().edits; }
};

TEST_F(SessionProtocol, WhoWaitsHoldsAPlaceUntilItsTurn) {
  Endless running(*this, in("s"));
  ASSERT_TRUE(runs(JobClass::Interactive));
  EXPECT_EQ(edits().used(), 0u) << "it has had its turn";
  Endless waiting(*this, in("s"));
  ASSERT_TRUE(eventually([&] { return edits().used() == 1; }));
  running.end();
  ASSERT_TRUE(eventually([&] { return edits().used() == 0; }));
  ASSERT_TRUE(runs(JobClass::Interactive)) << "the second one, whose place another may have now";
}

TEST_F(SessionProtocol, PlacesAreBoundedAndHalfOfThemForOne) {
  const std::string me = "unix";
  for (const bool mine : {true, false}) {
    // Of one client's half, or of all, every place but the last is taken.
    std::vector<std::unique_ptr<SharedLimit::Hold>> held;
    const auto holdOne = [&](const std::string& who) {
      held.push_back(edits().take(who, 1));
      ASSERT_TRUE(held.back());
    };
    for (uint64_t i = 0; i < Sessions::kWaiting / 2; ++i) holdOne(mine ? me : "a");
    if (!mine)
      for (uint64_t i = 0; i < Sessions::kWaiting / 2; ++i) holdOne("b");
    const Collected refused = renderOnce(in("s"));
    EXPECT_EQ(refused.status.error_code(), grpc::RESOURCE_EXHAUSTED);
    EXPECT_NE(refused.status.error_message().find("wait for their turn in a session"), std::string::npos) << refused.status.error_message();
    EXPECT_NE(refused.status.error_message().find("at most 64, half of it for one client"), std::string::npos) << refused.status.error_message();
    EXPECT_EQ(refused.trailers.count("retry-after-ms"), 1u);
    EXPECT_TRUE(renderOnce(small()).status.ok()) << "who is in no session needs no place";
    held.pop_back();
    EXPECT_TRUE(renderOnce(in("s")).status.ok());
  }
}

TEST_F(SessionProtocol, ADeadlineEndsTheWait) {
  Endless running(*this, in("s"));  // shows nothing before its end, so it is not ended for another
  ASSERT_TRUE(runs(JobClass::Interactive));
  v1::RenderRequest late = in("s");
  late.mutable_scheduling()->set_deadline_ms(100);
  const Collected got = renderOnce(late);
  EXPECT_EQ(got.status.error_code(), grpc::DEADLINE_EXCEEDED);
  EXPECT_NE(got.status.error_message().find("while another request of its session ran"), std::string::npos) << got.status.error_message();
  EXPECT_FALSE(running.over);
  EXPECT_EQ(edits().used(), 0u);
}

TEST_F(SessionProtocol, WhoWaitsInASessionIsToldSo) {
  Endless running(*this, in("s"));
  ASSERT_TRUE(runs(JobClass::Interactive));
  bool told = false;
  const Collected got = progressive(in("s"), [&](const v1::RenderEvent& event) {
    if (!event.has_progress() || !event.progress().queued()) return;
    told = true;
    running.context.TryCancel();
  });
  EXPECT_TRUE(got.status.ok()) << got.status.error_message();
  EXPECT_TRUE(told);
}

// What waits to be planned is bounded, of whatever call it is: each holds a thread, and status must get through.
class PlansProtocol : public QueueProtocol {
 protected:
  using Call = std::function<grpc::Status(grpc::ClientContext&)>;
  void configure(ServerConfig& c) override {
    c.queuedInteractive = 2;
    c.queuedNormal = 4;
    c.queuedBatch = 2;  // 8 together, of which one caller may have 6
    c.jobsFolder = folder + "/jobs";
    c.jobsWorkers = 0;
    for (const char* name : {"a", "b", "c", "d"}) {
      TokenConfig t;
      t.name = name;
      const std::string secret = std::string("secret-") + name;
      t.sha256 = sha256Hex(secret.data(), secret.size());
      c.tokens.push_back(t);
    }
  }
  void SetUp() override {
    QueueProtocol::SetUp();
    jobs = v1::Jobs::NewStub(channel);
  }
  void TearDown() override {
    waiting.clear();
    held.reset();
    QueueProtocol::TearDown();
  }
  /// A call on a thread of its own.
  class Waiting {
   public:
    Waiting(const std::string& who, const Call& call) {
      sign(context_, who);
      thread_ = std::thread([this, call] { status = call(context_); });
    }
    ~Waiting() {
      context_.TryCancel();
      join();
    }
    void join() {
      if (thread_.joinable()) thread_.join();
    }
    grpc::Status status;

   private:
    grpc::ClientContext context_;
    std::thread thread_;
  };
  static void sign(grpc::ClientContext& context, const std::string& who) {
    bound(context);
    context.AddMetadata("authorization", "Bearer secret-" + who);
  }
  FairGate& planning() { return server->core().planning; }
  /// One plan at a time, and that one is never made: whoever comes waits.
  void hold() {
    planning().setLimits({1, 1});
    auto place = planning().enter("nobody", [] { return false; });
    ASSERT_TRUE(place);
    held.emplace(std::move(*place));
  }
  void wait(const std::string& who, const Call& call, size_t calls) {
    const size_t before = waiting.size();
    for (size_t i = 0; i < calls; ++i) waiting.push_back(std::make_unique<Waiting>(who, call));
    ASSERT_TRUE(eventually([&] { return planning().waiting() == before + calls; })) << who << ": " << planning().waiting() << " wait";
  }
  void refused(const std::string& who, const Call& call) {
    grpc::ClientContext context, fourth;
    sign(context, who);
    const grpc::Status status = call(context);
    EXPECT_EQ(status.error_code(), grpc::RESOURCE_EXHAUSTED) << who << ": " << status.error_message();
    EXPECT_NE(status.error_message().find("wait to be planned: at most 8, those in the queues included, and 6 of one caller"), std::string::npos)
        << status.error_message();
    EXPECT_EQ(context.GetServerTrailingMetadata().count("retry-after-ms"), 1u);
    sign(fourth, "d");
    v1::StatusReply reply;
    EXPECT_TRUE(admin->GetStatus(&fourth, {}, &reply).ok());
  }
  Call plan() {
    return [this](grpc::ClientContext& context) {
      v1::PlanReply reply;
      return render->Plan(&context, small(), &reply);
    };
  }
  Call submission() {
    return [this](grpc::ClientContext& context) {
      v1::JobSpec spec;
      *spec.mutable_request() = small();
      v1::Job job;
      return jobs->Submit(&context, spec, &job);
    };
  }
  Call picture() {
    return [this](grpc::ClientContext& context) {
      const auto reader = render->Render(&context, small());
      v1::RenderEvent event;
      while (reader->Read(&event)) {}
      return reader->Finish();
    };
  }
  void boundsOneCaller(const Call& call) {
    hold();
    wait("a", call, 6);
    refused("a", call);
    wait("b", call, 1);  // another one still finds a place
    held.reset();
    for (const auto& w : waiting) {
      w->join();
      EXPECT_TRUE(w->status.ok()) << w->status.error_message();
    }
  }
  std::unique_ptr<v1::Jobs::Stub> jobs;
  std::vector<std::unique_ptr<Waiting>> waiting;
  std::optional<FairGate::Place> held;
};

TEST_F(PlansProtocol, OneCallersPlansAreBounded) { boundsOneCaller(plan()); }
TEST_F(PlansProtocol, OneCallersSubmissionsAreBounded) { boundsOneCaller(submission()); }

TEST_F(PlansProtocol, AllCallersTogetherAreBoundedWithWhatIsInTheQueues) {
  Endless running(*this, small());
  ASSERT_TRUE(runs(JobClass::Normal));
  Endless queued(*this, small());
  ASSERT_TRUE(runs(JobClass::Normal, 1, 1));
  hold();
  wait("a", picture(), 3);
  wait("b", picture(), 3);
  wait("c", picture(), 1);
  for (const char* who : {"a", "b", "c"}) refused(who, picture());
  refused("c", plan());
  refused("c", submission());
}

TEST_F(PlansProtocol, ADeadlineEndsAPlansWait) {
  hold();
  v1::RenderRequest late = small();
  late.mutable_scheduling()->set_deadline_ms(50);
  grpc::ClientContext context;
  bound(context);
  v1::PlanReply reply;
  const grpc::Status status = render->Plan(&context, late, &reply);
  EXPECT_EQ(status.error_code(), grpc::DEADLINE_EXCEEDED) << status.error_message();
  EXPECT_NE(status.error_message().find("waited to be planned"), std::string::npos) << status.error_message();
  EXPECT_EQ(planning().waiting(), 0u);
}

class OneWaits : public PlansProtocol {
 protected:
  void configure(ServerConfig& c) override {
    PlansProtocol::configure(c);
    c.queuedInteractive = c.queuedBatch = 0;
    c.queuedNormal = 1;
  }
};

// A full queue is no reason to refuse what need not wait for anything.
TEST_F(OneWaits, WhoFindsAPlaceIsPlanned) {
  Endless running(*this, small());
  ASSERT_TRUE(runs(JobClass::Normal));
  Endless queued(*this, small());
  ASSERT_TRUE(runs(JobClass::Normal, 1, 1));
  for (const Call& call : {plan(), submission()}) {
    grpc::ClientContext context;
    sign(context, "a");
    const grpc::Status status = call(context);
    EXPECT_TRUE(status.ok()) << status.error_message();
  }
}

}  // namespace
}  // namespace gobo
