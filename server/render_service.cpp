// SPDX-License-Identifier: Apache-2.0
#include "server/render_service.h"

#include <algorithm>

#include "plan/outputs.h"
#include "server/blobs_service.h"
#include "server/limits.h"
#include "server/queue_news.h"
#include "server/render_call.h"

namespace gobo {
inline namespace server {
namespace {

constexpr std::chrono::milliseconds kPoll{10};         // how soon a client that has gone is noticed
constexpr std::chrono::milliseconds kProgressGap{50};  // progress messages are thinned to this

// What a finished call leaves in its log line and in the metrics.
void account(Rpc& rpc, RenderCall& call, JobClass jobClass, double totalMs, bool ok) {
  Metrics& m = rpc.core().metrics;
  const MetricLabels labels{{"class", kClassNames[int(jobClass)]}};
  rpc.note("queue_ms", strf("%.1f", call.queueMs()));
  rpc.note("run_ms", strf("%.1f", call.ranMs()));
  if (!ok) return;
  m.observe("gobo_render_queue_seconds", labels, call.queueMs() * 1e-3);
  m.observe("gobo_render_run_seconds", labels, call.ranMs() * 1e-3);
  m.observe("gobo_render_total_seconds", labels, totalMs * 1e-3);
  const v1::RenderReply& reply = call.result().reply;
  rpc.note("render", reply.render_id());
  rpc.note("rays", std::to_string(reply.rays()));
  m.add("gobo_rays_total", {}, double(reply.rays()));
  double memory = 0, disk = 0, misses = 0;
  for (const v1::NodeReport& node : reply.plan()) {
    const double count = std::max(1u, node.count());
    if (node.state() == v1::NodeReport::RUN) misses += count;
    if (node.state() == v1::NodeReport::REUSED) (node.reason().find("disk") == std::string::npos ? memory : disk) += count;
  }
  m.add("gobo_store_hits_total", {{"tier", "memory"}}, memory);
  m.add("gobo_store_hits_total", {{"tier", "disk"}}, disk);
  m.add("gobo_store_misses_total", {}, misses);
}

/// The answer for what its deadline ended.
grpc::Status deadlinePassed(Rpc& rpc, const Deadline& deadline, const Status& status) {
  if (deadline.limit.empty()) return toGrpc(status);
  return rpc.refuse("time", Status(status.code(), status.message() + ": requests may take " + deadline.limit + " s"));
}

}  // namespace

grpc::Status RenderService::run(Rpc& rpc, v1::RenderRequest request, const Deliver& deliver, const Report* report) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point begun = Clock::now();
  grpc::ServerContext& context = rpc.context();
  rpc.note("scene", request.scene());
  ServerCore::Call call(core_);
  if (!call.ok) return rpc.refuseDraining();
  auto resolved = core_.engine.resolve(request, rpc.access());
  if (!resolved.ok()) return toGrpc(resolved.status());
  rpc.note("size", strf("%ux%u", resolved->width(), resolved->height()));
  // Who wants no early pictures has a bar drawn, and looks at none.
  chooseClass(rpc, report != nullptr && resolved->scheduling().ladder(), request, *resolved);
  const JobClass jobClass = jobClassOf(resolved->scheduling().priority());
  rpc.note("class", kClassNames[int(jobClass)]);
  const auto client = rpc.client(request.scheduling().client());
  if (!client.ok()) return rpc.refuse("client", client.status());
  if (*client != rpc.who().name) rpc.note("for", *client);
  const grpc::Status allowed = checkRender(rpc, request, *resolved);
  if (!allowed.ok()) return allowed;
  const auto environment = environmentFile(rpc, request, "request.environment.digest", call.stop.token());
  if (!environment.ok()) return toGrpc(environment.status());

  const Deadline deadline = deadlineFor(rpc, context, resolved->scheduling());
  const auto replaced = [] { return grpc::Status(grpc::StatusCode::CANCELLED, "replaced by a newer request of its session (scheduling.session)"); };
  const std::string& session = request.scheduling().session();
  std::unique_ptr<SharedLimit::Hold> place;
  if (!session.empty() && !(place = core_.edits.take(rpc.who().name, 1)))
    return rpc.refuseFull("sessions", "requests wait for their turn in a session", core_.edits, "", 100);
  QueueNews queueNews;
  Clock::time_point lookedAt = begun;
  bool gone = false;
  const auto tellPlace = [&](const auto& where) {
    if (!report || gone || Clock::now() - lookedAt < kProgressGap) return;
    lookedAt = Clock::now();
    if (const auto progress = queueNews.at(where(), std::chrono::duration<double, std::milli>(lookedAt - begun).count())) gone = !(*report)(*progress);
  };
  Sessions::Turn turn(core_.sessions, rpc.who().name, session);
  const auto endsWait = [&] {
    tellPlace([] { return std::optional<Place>(Place{true, 1, 0}); });  // behind the one that runs
    return gone || context.IsCancelled() || call.stop.token().stopRequested() || (deadline.at && Clock::now() >= *deadline.at);
  };
  switch (turn.begin(endsWait)) {
    case Sessions::Turn::Begin::Now: break;
    case Sessions::Turn::Begin::Replaced: return replaced();
    case Sessions::Turn::Begin::Gone:
      if (core_.cancelledAll()) return rpc.refuseDraining();
      if (deadline.at && Clock::now() >= *deadline.at)
        return deadlinePassed(rpc, deadline, Status(Code::DeadlineExceeded, "the deadline passed while another request of its session ran"));
      return {grpc::StatusCode::CANCELLED, "the client has gone"};
  }
  place.reset();
  // Only what has its turn counts as a render: an edit that waits for the one before it, or takes its place, must not be refused for that one. Given back
  // before the turn is.
  const RenderSlot slot(rpc.who());
  if (!slot.ok)
    return rpc.refuseBusy("renders",
                          strf("renders at once: at most %u (tokens.renders_at_once of \"%s\")", rpc.who().token->rendersAtOnce, rpc.who().name.c_str()), 1000);

  RenderCallOptions options;
  options.client = *client;
  options.payer = rpc.who().name;
  options.owner = rpc.renderOwner();
  options.access = rpc.access();
  options.deadline = deadline.at;
  options.events = report != nullptr;
  options.environmentFile = environment->path;
  const v1::Encoding::Format format = resolved->encoding().format();
  const uint64_t size =
      resolved->has_window() ? uint64_t(resolved->window().width()) * resolved->window().height() : uint64_t(resolved->width()) * resolved->height();
  const uint64_t pixels = size * uint64_t(std::max(1, resolved->outputs_size()));
  // The picture as floats and as it is sent, chunks on their way included. Of mattes, three times as many channels as of others.
  uint64_t pictures = uint64_t(std::max(1, resolved->outputs_size()));
  for (const std::string& output : resolved->outputs())
    if (const OutputInfo* info = findOutput(output); info && info->kind == OutputKind::Matte) pictures += 2;
  options.replyBytes = 32 * size * pictures + 2 * core_.live()->chunkBytes;
  options.encodeMs = core_.encodePace.expectedMs(format, pixels);
  const auto render = std::make_unique<RenderCall>(core_, call.stop, request, options);
  Clock::time_point lastProgress = begun - kProgressGap;
  bool newer = false;
  const auto encodeAndDeliver = [&](RenderResult& result, bool last) -> Status {
    const auto made = Clock::now();
    GOBO_ASSIGN(std::vector<EncodedImage> images, encodeImages(result));
    if (last) core_.encodePace.took(format, pixels, std::chrono::duration<double, std::milli>(Clock::now() - made).count());
    v1::RenderReply reply = result.reply;
    if (!deliver(std::move(reply), std::move(images), last)) gone = true;
    return {};
  };
  for (;;) {
    RenderCall::News news = render->wait(kPoll);
    if (gone || context.IsCancelled()) {
      gone = true;
      render->cancel();
    }
    tellPlace([&] { return render->place(); });
    if (news.progress && report && !gone && Clock::now() - lastProgress >= kProgressGap) {
      lastProgress = Clock::now();
      gone = !(*report)(*news.progress);
    }
    if (news.snapshot && !gone && !newer) {
      const Status status = encodeAndDeliver(*news.snapshot, false);
      if (!status.ok()) return toGrpc(status);
      turn.shown();
    }
    if (turn.over() && !newer) {
      newer = true;
      render->cancel();
    }
    if (news.done) break;
  }
  const Status& status = render->status();
  if (!render->planned() && render->retryAfterMs() == 0 && status.code() != Code::Cancelled && status.code() != Code::DeadlineExceeded) return toGrpc(status);
  account(rpc, *render, jobClass, std::chrono::duration<double, std::milli>(Clock::now() - begun).count(), status.ok());
  if (!status.ok()) {
    if (status.code() == Code::Cancelled && core_.cancelledAll()) return rpc.refuseDraining();
    if (status.code() == Code::Cancelled && newer) return replaced();
    if (status.code() == Code::ResourceExhausted && render->retryAfterMs() > 0) return rpc.refuseBusy("queue", status.message(), render->retryAfterMs());
    if (render->replyRefused())
      return rpc.refuseBusy("reply_bytes",
                            strf("pictures being made or sent hold %llu bytes, %llu of them for \"%s\": at most %llu, half of it for one client "
                                 "(limits.reply_bytes); read the replies that wait",
                                 (unsigned long long)core_.replies.used(), (unsigned long long)core_.replies.usedBy(rpc.who().name), rpc.who().name.c_str(),
                                 (unsigned long long)core_.replies.limit()),
                            1000);
    if (render->runs() == 0 && status.code() == Code::FailedPrecondition) return rpc.refuse("memory", status);
    if (status.code() == Code::DeadlineExceeded) return deadlinePassed(rpc, deadline, status);
    return toGrpc(status);
  }
  core_.renders.fetch_add(1);
  const Status delivered = encodeAndDeliver(render->result(), true);
  if (!delivered.ok()) return toGrpc(delivered);
  return gone ? grpc::Status(grpc::StatusCode::CANCELLED, "the client has gone") : grpc::Status::OK;
}

grpc::Status RenderService::stream(Rpc& rpc, const v1::RenderRequest& request, grpc::ServerWriter<v1::RenderEvent>& writer, bool progressive) {
  const uint64_t chunkBytes = core_.live()->chunkBytes;
  const auto write = [&](const v1::RenderEvent& event) {
    const IdleWatch::Wait wait(core_.idle, rpc.context());
    return writer.Write(event);
  };
  const Deliver deliver = [&](v1::RenderReply&& reply, std::vector<EncodedImage>&& images, bool last) {
    v1::RenderEvent head;
    *(last ? head.mutable_reply() : head.mutable_snapshot()) = std::move(reply);
    if (!write(head)) return false;
    v1::RenderEvent event;  // one message for all chunks: its buffer is reused
    v1::ImageChunk& chunk = *event.mutable_chunk();
    for (size_t i = 0; i < images.size(); ++i) {
      const PictureBytes& bytes = images[i].bytes;
      for (size_t at = 0; at < bytes.size(); at += chunkBytes) {
        const size_t n = std::min<size_t>(chunkBytes, bytes.size() - at);
        chunk.set_image(uint32_t(i));
        chunk.set_offset(at);
        chunk.mutable_data()->assign(reinterpret_cast<const char*>(bytes.data() + at), n);
        if (!write(event)) return false;
      }
    }
    return true;
  };
  const Report report = [&](const v1::Progress& progress) {
    v1::RenderEvent event;
    *event.mutable_progress() = progress;
    return write(event);
  };
  return run(rpc, request, deliver, progressive ? &report : nullptr);
}

grpc::Status RenderService::Render(grpc::ServerContext* context, const v1::RenderRequest* request, grpc::ServerWriter<v1::RenderEvent>* writer) {
  return serve(core_, *context, "render", [&](Rpc& rpc) { return stream(rpc, *request, *writer, false); });
}

grpc::Status RenderService::RenderProgressive(grpc::ServerContext* context, const v1::RenderRequest* request, grpc::ServerWriter<v1::RenderEvent>* writer) {
  return serve(core_, *context, "render_progressive", [&](Rpc& rpc) { return stream(rpc, *request, *writer, true); });
}

grpc::Status RenderService::Relight(grpc::ServerContext* context, const v1::RelightRequest* relight, grpc::ServerWriter<v1::RenderEvent>* writer) {
  return serve(core_, *context, "relight", [&](Rpc& rpc) -> grpc::Status {
    rpc.note("of", relight->render_id());
    auto request = core_.engine.relightRequest(*relight, rpc.who().admin ? std::string() : rpc.renderOwner());
    if (!request.ok()) return toGrpc(request.status());
    // NORMAL is what a render has that named no class: the relight's own default is chosen.
    const bool named = std::any_of(relight->mask().begin(), relight->mask().end(),
                                   [](const std::string& path) { return path == "scheduling" || path == "scheduling.priority"; });
    if (!named && request->scheduling().priority() == v1::Scheduling::NORMAL) request->mutable_scheduling()->clear_priority();
    return stream(rpc, *request, *writer, relight->progressive());
  });
}

grpc::Status RenderService::Plan(grpc::ServerContext* context, const v1::RenderRequest* asked, v1::PlanReply* reply) {
  return serve(core_, *context, "plan", [&](Rpc& rpc) -> grpc::Status {
    rpc.note("scene", asked->scene());
    ServerCore::Call call(core_);
    if (!call.ok) return rpc.refuseDraining();
    auto resolved = core_.engine.resolve(*asked, rpc.access());
    if (!resolved.ok()) return toGrpc(resolved.status());
    v1::RenderRequest request = *asked;
    chooseClass(rpc, false, request, *resolved);
    if (const grpc::Status allowed = checkRender(rpc, request, *resolved); !allowed.ok()) return allowed;
    const StopToken stop = call.stop.token();
    const auto environment = environmentFile(rpc, request, "request.environment.digest", stop);
    if (!environment.ok()) return toGrpc(environment.status());
    const Deadline deadline = deadlineFor(rpc, *context, resolved->scheduling());
    const auto gone = [&] { return stop.stopRequested() || context->IsCancelled() || deadline.passed(); };
    bool full = false;
    const auto place = core_.planning.enter(rpc.who().name, gone, core_.plansFull(full));
    if (!place && full) return rpc.refuseBusy("queue", core_.plansFullText(), ServerCore::kPlanRetryMs);
    if (!place && deadline.passed() && !stop.stopRequested())
      return deadlinePassed(rpc, deadline, Status(Code::DeadlineExceeded, "the deadline passed while it waited to be planned"));
    if (!place) return toGrpc(Status(Code::Cancelled, "cancelled while it waited to be planned"));
    auto planned = core_.engine.plan(request, stop, rpc.access(), environment->path);
    if (!planned.ok()) return toGrpc(planned.status());
    *reply = std::move(*planned);
    return grpc::Status::OK;
  });
}

grpc::Status RenderService::RenderInline(grpc::ServerContext* context, const v1::RenderRequest* request, v1::InlineReply* reply) {
  return serve(core_, *context, "render_inline", [&](Rpc& rpc) { return inlined(rpc, *request, reply); });
}

grpc::Status RenderService::inlined(Rpc& rpc, const v1::RenderRequest& asked, v1::InlineReply* reply) {
  const v1::RenderRequest* request = &asked;
  const uint64_t limit = core_.live()->inlineBytes;
  uint64_t total = 0;
  const Deliver deliver = [&](v1::RenderReply&& rendered, std::vector<EncodedImage>&& images, bool) {
    for (const EncodedImage& image : images) total += image.bytes.size();
    if (total > limit) return true;
    *reply->mutable_reply() = std::move(rendered);
    for (const EncodedImage& image : images) reply->add_images(image.bytes.data(), image.bytes.size());
    return true;
  };
  const auto tooLarge = [&](uint64_t bytes) {
    return rpc.refuse("inline_bytes",
                      {Code::OutOfRange, strf("the pictures have %llu bytes; RenderInline carries at most %llu (limits.inline_bytes): use Render",
                                              (unsigned long long)bytes, (unsigned long long)limit)});
  };
  // Raw pictures have at least one channel: what cannot fit is refused before it is rendered.
  const uint64_t unit = request->encoding().format() == v1::Encoding::RAW_FLOAT ? 4 : request->encoding().format() == v1::Encoding::RAW_HALF ? 2 : 0;
  const uint64_t least = uint64_t(request->width()) * request->height() * uint64_t(std::max(1, request->outputs_size())) * unit;
  if (least > limit) return tooLarge(least);
  const grpc::Status status = run(rpc, *request, deliver, nullptr);
  return status.ok() && total > limit ? tooLarge(total) : status;
}

}  // namespace server
}  // namespace gobo
