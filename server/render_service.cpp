// SPDX-License-Identifier: Apache-2.0
#include "server/render_service.h"

#include <algorithm>

#include "server/render_call.h"
#include "server/rpc.h"

namespace gobo {
namespace {

constexpr std::chrono::milliseconds kPoll{10};           // how soon a client that has gone is noticed
constexpr std::chrono::milliseconds kProgressGap{50};    // progress messages are thinned to this

void logRender(const char* method, const v1::RenderRequest& request, const std::string& client, const RenderCall* call,
               double ms, const grpc::Status& status) {
  const bool ok = status.ok() && call;
  const v1::RenderReply* reply = ok ? &const_cast<RenderCall*>(call)->result().reply : nullptr;
  logInfo("%s id=%s scene=%s size=%ux%u client=%s ms=%.1f queue_ms=%.1f rays=%llu status=%s%s%s", method,
          reply ? reply->render_id().c_str() : "-", request.scene().c_str(), request.width(), request.height(), client.c_str(), ms,
          call ? call->queueMs() : 0.0, static_cast<unsigned long long>(reply ? reply->rays() : 0),
          codeName(Code(int(status.error_code()))), status.ok() ? "" : " ", status.error_message().c_str());
}

}  // namespace

grpc::Status RenderService::run(grpc::ServerContext& context, const char* method, const v1::RenderRequest& request,
                                const Deliver& deliver, const Report* report) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point begun = Clock::now();
  const std::string client = clientName(context, request.scheduling().client());
  std::unique_ptr<RenderCall> render;
  const auto finish = [&](grpc::Status status) {
    logRender(method, request, client, render.get(), std::chrono::duration<double, std::milli>(Clock::now() - begun).count(), status);
    return status;
  };
  ServerCore::Call call(core_);
  if (!call.ok) return finish(drainingStatus());
  auto resolved = core_.engine.resolve(request);
  if (!resolved.ok()) return finish(toGrpc(resolved.status()));
  const uint64_t outputs = uint64_t(std::max(1, resolved->outputs_size()));
  const uint64_t bytes = uint64_t(resolved->width()) * resolved->height() * outputs * 16;
  if (bytes > core_.config.imageBytes)
    return finish(toGrpc(invalidArgument(strf("width x height x outputs = %u x %u x %llu needs %llu bytes: at most %llu (limits.image_bytes)",
        resolved->width(), resolved->height(), (unsigned long long)outputs, (unsigned long long)bytes,
        (unsigned long long)core_.config.imageBytes), "request.width")));
  auto pinned = core_.engine.pinnedBytes(request);
  if (!pinned.ok()) return finish(toGrpc(pinned.status()));

  RenderCallOptions options;
  options.client = client;
  options.deadline = deadlineOf(context, resolved->scheduling());
  options.events = report != nullptr;
  render = std::make_unique<RenderCall>(core_, call.stop, request, *pinned, options);
  Clock::time_point lastProgress = begun - kProgressGap;
  bool gone = false;
  const auto encodeAndDeliver = [&](RenderResult& result, bool last) -> Status {
    GOBO_ASSIGN(std::vector<EncodedImage> images, encodeImages(result));
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
    if (news.progress && report && !gone && Clock::now() - lastProgress >= kProgressGap) {
      lastProgress = Clock::now();
      gone = !(*report)(*news.progress);
    }
    if (news.snapshot && !gone) {
      const Status status = encodeAndDeliver(*news.snapshot, false);
      if (!status.ok()) return finish(toGrpc(status));
    }
    if (news.done) break;
  }
  const Status& status = render->status();
  if (!status.ok()) {
    if (status.code() == Code::Cancelled && core_.cancelledAll()) return finish(drainingStatus());
    if (status.code() == Code::ResourceExhausted && render->retryAfterMs() > 0)
      return finish(busy(context, status.message(), render->retryAfterMs()));
    return finish(toGrpc(status));
  }
  core_.renders.fetch_add(1);
  const Status delivered = encodeAndDeliver(render->result(), true);
  if (!delivered.ok()) return finish(toGrpc(delivered));
  return finish(gone ? grpc::Status(grpc::StatusCode::CANCELLED, "the client has gone") : grpc::Status::OK);
}

grpc::Status RenderService::stream(grpc::ServerContext& context, const char* method, const v1::RenderRequest& request,
                                   grpc::ServerWriter<v1::RenderEvent>& writer, bool progressive) {
  const Deliver deliver = [&](v1::RenderReply&& reply, std::vector<EncodedImage>&& images, bool last) {
    v1::RenderEvent head;
    *(last ? head.mutable_reply() : head.mutable_snapshot()) = std::move(reply);
    if (!writer.Write(head)) return false;
    v1::RenderEvent event;   // one message for all chunks: its buffer is reused
    v1::ImageChunk& chunk = *event.mutable_chunk();
    for (size_t i = 0; i < images.size(); ++i) {
      const std::vector<uint8_t>& bytes = images[i].bytes;
      for (size_t at = 0; at < bytes.size(); at += core_.config.chunkBytes) {
        const size_t n = std::min<size_t>(core_.config.chunkBytes, bytes.size() - at);
        chunk.set_image(uint32_t(i));
        chunk.set_offset(at);
        chunk.mutable_data()->assign(reinterpret_cast<const char*>(bytes.data() + at), n);
        if (!writer.Write(event)) return false;
      }
    }
    return true;
  };
  const Report report = [&](const v1::Progress& progress) {
    v1::RenderEvent event;
    *event.mutable_progress() = progress;
    return writer.Write(event);
  };
  return run(context, method, request, deliver, progressive ? &report : nullptr);
}

grpc::Status RenderService::Render(grpc::ServerContext* context, const v1::RenderRequest* request,
                                   grpc::ServerWriter<v1::RenderEvent>* writer) {
  return stream(*context, "render", *request, *writer, false);
}

grpc::Status RenderService::RenderProgressive(grpc::ServerContext* context, const v1::RenderRequest* request,
                                              grpc::ServerWriter<v1::RenderEvent>* writer) {
  return stream(*context, "render_progressive", *request, *writer, true);
}

grpc::Status RenderService::Relight(grpc::ServerContext* context, const v1::RelightRequest* relight,
                                    grpc::ServerWriter<v1::RenderEvent>* writer) {
  auto request = core_.engine.relightRequest(*relight);
  if (!request.ok()) {
    logInfo("relight id=%s status=%s %s", relight->render_id().c_str(), codeName(request.status().code()), request.status().message().c_str());
    return toGrpc(request.status());
  }
  return stream(*context, "relight", *request, *writer, false);
}

grpc::Status RenderService::RenderInline(grpc::ServerContext* context, const v1::RenderRequest* request, v1::InlineReply* reply) {
  const uint64_t limit = core_.config.inlineBytes;
  uint64_t total = 0;
  const Deliver deliver = [&](v1::RenderReply&& rendered, std::vector<EncodedImage>&& images, bool) {
    for (const EncodedImage& image : images) total += image.bytes.size();
    if (total > limit) return true;
    *reply->mutable_reply() = std::move(rendered);
    for (const EncodedImage& image : images) reply->add_images(image.bytes.data(), image.bytes.size());
    return true;
  };
  const auto tooLarge = [&](uint64_t bytes) {
    return toGrpc({Code::OutOfRange, strf("the pictures have %llu bytes; RenderInline carries at most %llu: use Render",
                                          (unsigned long long)bytes, (unsigned long long)limit)});
  };
  // Raw pictures have at least one channel: what cannot fit is refused before it is rendered.
  const uint64_t unit = request->encoding().format() == v1::Encoding::RAW_FLOAT ? 4 : request->encoding().format() == v1::Encoding::RAW_HALF ? 2 : 0;
  const uint64_t least = uint64_t(request->width()) * request->height() * uint64_t(std::max(1, request->outputs_size())) * unit;
  if (least > limit) return tooLarge(least);
  const grpc::Status status = run(*context, "render_inline", *request, deliver, nullptr);
  return status.ok() && total > limit ? tooLarge(total) : status;
}

}  // namespace gobo
