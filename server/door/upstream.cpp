// SPDX-License-Identifier: Apache-2.0
#include "server/door/upstream.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>

#include <nlohmann/json.hpp>

#include "base/status.h"
#include "request/request.h"
#include "server/door/door.h"
#include "server/rpc.h"

namespace gobo {
inline namespace door {

namespace {
constexpr double kQuietSeconds = 5;  // a stream says that it lives at least that often
}

void UpstreamCall::cancel() {
  if (!cancelled_) context.TryCancel();
  cancelled_ = true;
}

Upstream UpstreamCall::wait(double quietSeconds) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point begun = Clock::now();
  for (;;) {
    void* tag = nullptr;
    bool ok = false;
    switch (queue.AsyncNext(&tag, &ok, std::chrono::system_clock::now() + Door::kPoll)) {
      case grpc::CompletionQueue::GOT_EVENT: return ok ? Upstream::Event : Upstream::Ended;
      case grpc::CompletionQueue::SHUTDOWN: return Upstream::Ended;
      case grpc::CompletionQueue::TIMEOUT: break;
    }
    if (!cancelled_ && gone_()) cancel();
    if (!cancelled_ && std::chrono::duration<double>(Clock::now() - begun).count() >= quietSeconds) return Upstream::Quiet;
  }
}

std::string errorJson(const grpc::Status& status) {
  const nlohmann::json error = {{"code", codeName(Code(int(status.error_code())))}, {"message", status.error_message()}};
  return error.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

long retryMsOf(const grpc::ClientContext& context) {
  const auto& trailers = context.GetServerTrailingMetadata();
  const auto at = trailers.find(kRetryAfterKey);
  return at == trailers.end() ? 0 : std::max(1L, std::atol(std::string(at->second.data(), at->second.size()).c_str()));
}

long wholeSeconds(long ms) { return (ms + 999) / 1000; }

int httpStatusOf(grpc::StatusCode code) {
  switch (code) {
    case grpc::StatusCode::OK: return 200;
    case grpc::StatusCode::INVALID_ARGUMENT:
    case grpc::StatusCode::OUT_OF_RANGE:
    case grpc::StatusCode::FAILED_PRECONDITION: return 400;
    case grpc::StatusCode::UNAUTHENTICATED: return 401;
    case grpc::StatusCode::PERMISSION_DENIED: return 403;
    case grpc::StatusCode::NOT_FOUND: return 404;
    case grpc::StatusCode::ALREADY_EXISTS:
    case grpc::StatusCode::ABORTED:
    case grpc::StatusCode::CANCELLED: return 409;
    case grpc::StatusCode::RESOURCE_EXHAUSTED: return 429;
    case grpc::StatusCode::UNIMPLEMENTED: return 501;
    case grpc::StatusCode::UNAVAILABLE: return 503;
    case grpc::StatusCode::DEADLINE_EXCEEDED: return 504;
    default: return 500;
  }
}

RenderStream::RenderStream(std::function<bool()> gone, bool frames) : call_(std::move(gone)), frames_(frames) {}

RenderStream::~RenderStream() {
  if (!reader_ || over_) return;
  call_.cancel();
  while (!over_) step(1e9);
}

grpc::Status RenderStream::begin(const Start& start) {
  reader_ = start(&call_.context, &call_.queue);
  reader_->StartCall(nullptr);
  call_.wait();  // however it ended: Finish has the status
  while (!over_ && pending_.empty() && (frames_ || head_.images_size() == 0)) step(1e9);
  return over_ ? status_ : grpc::Status::OK;
}

// One event more, or the end; nothing after `quietSeconds` of silence.
void RenderStream::step(double quietSeconds) {
  if (!reading_) reader_->Read(&event_, nullptr);
  reading_ = true;
  switch (call_.wait(quietSeconds)) {
    case Upstream::Quiet:
      if (frames_ && left_ == 0) frame("{\"bytes\":0}");
      return;
    case Upstream::Event:
      reading_ = false;
      take();
      return;
    case Upstream::Ended: break;
  }
  reading_ = false;
  reader_->Finish(&status_, nullptr);
  call_.wait();
  over_ = true;
  if (!status_.ok() && frames_ && left_ == 0) frame("{\"bytes\":0,\"error\":" + errorJson(status_) + "}");
}

void RenderStream::take() {
  const auto picture = [&](const char* name, const v1::RenderReply& reply) {
    uint64_t bytes = 0;
    for (const v1::ImageDescriptor& image : reply.images()) bytes += image.bytes();
    if (frames_) frame("{\"bytes\":" + std::to_string(bytes) + ",\"" + name + "\":" + messageToJson(reply, false) + "}");
    head_ = reply;
    left_ = bytes;
  };
  switch (event_.event_case()) {
    case v1::RenderEvent::kProgress:
      if (frames_) frame("{\"bytes\":0,\"progress\":" + messageToJson(event_.progress(), false) + "}");
      break;
    case v1::RenderEvent::kSnapshot: picture("snapshot", event_.snapshot()); break;
    case v1::RenderEvent::kReply: picture("reply", event_.reply()); break;
    case v1::RenderEvent::kChunk:
      // Chunks come in the order of images and offsets.
      pending_ = std::move(*event_.mutable_chunk()->mutable_data());
      at_ = 0;
      left_ -= std::min<uint64_t>(left_, pending_.size());
      break;
    case v1::RenderEvent::EVENT_NOT_SET: break;
  }
}

void RenderStream::frame(const std::string& json) {
  const uint32_t size = uint32_t(json.size());
  pending_.assign({char(size & 255), char(size >> 8 & 255), char(size >> 16 & 255), char(size >> 24 & 255)});
  pending_ += json;
  at_ = 0;
}

ssize_t RenderStream::read(char* to, size_t most) {
  while (at_ == pending_.size()) {
    if (call_.cancelled()) return -1;
    if (over_) return left_ == 0 && (status_.ok() || frames_) ? 0 : -1;
    pending_.clear();
    at_ = 0;
    step(kQuietSeconds);
  }
  if (call_.cancelled()) return -1;
  const size_t n = std::min(most, pending_.size() - at_);
  std::memcpy(to, pending_.data() + at_, n);
  at_ += n;
  return ssize_t(n);
}

PutStream::~PutStream() {
  if (!writer_ || over_) return;
  call_.cancel();
  end();
}

void PutStream::begin(v1::Blobs::Stub& stub, const v1::BlobDigest& blob, uint64_t offset) {
  *message_.mutable_blob() = blob;
  message_.set_offset(offset);
  writer_ = stub.PrepareAsyncPut(&call_.context, &reply_, &call_.queue);
  writer_->StartCall(nullptr);
  call_.wait();  // however it ended: Finish has the status
}

void PutStream::add(const char* data, size_t bytes) {
  if (over_) return;
  message_.mutable_data()->append(data, bytes);
  if (message_.data().size() >= kMessage) write();
}

void PutStream::write() {
  writer_->Write(message_, nullptr);
  sent_ = true;
  message_.Clear();
  if (call_.wait() != Upstream::Event) end();
}

void PutStream::end() {
  writer_->Finish(&status_, nullptr);
  call_.wait();
  over_ = true;
}

grpc::Status PutStream::finish(v1::PutBlobReply& reply) {
  if (!over_ && (!sent_ || !message_.data().empty())) write();
  if (!over_) {
    writer_->WritesDone(nullptr);
    call_.wait();
    end();
  }
  reply = reply_;
  return status_;
}

}  // namespace door
}  // namespace gobo
