// SPDX-License-Identifier: Apache-2.0
// Who waits for whom, and what he is told: small renders beside a big one, places in queues, default classes, bounds and deadlines of sessions.
#include <thread>

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

}  // namespace
}  // namespace gobo
