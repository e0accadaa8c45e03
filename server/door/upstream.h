// SPDX-License-Identifier: Apache-2.0
// One call of the gRPC channel behind the door, made on the connection's thread, which meanwhile looks whether its client is still there.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include <grpcpp/grpcpp.h>

#include "gobo/v1/service.grpc.pb.h"

namespace gobo {
inline namespace door {

/// How a wait for the channel's next event ended.
enum class Upstream { Event, Ended, Quiet };

/// A context with its queue. Once `gone` says so the call is cancelled; waits go on until the channel has said its last word.
class UpstreamCall {
 public:
  explicit UpstreamCall(std::function<bool()> gone) : gone_(std::move(gone)) {}
  UpstreamCall(const UpstreamCall&) = delete;
  UpstreamCall& operator=(const UpstreamCall&) = delete;

  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  /// Until the one operation that is under way ends, or `quietSeconds` have passed.
  Upstream wait(double quietSeconds = 1e9);
  void cancel();
  bool cancelled() const { return cancelled_; }

 private:
  std::function<bool()> gone_;
  bool cancelled_ = false;
};

/// reader(context, queue) starts a unary call.
template <typename Reply, typename Start>
grpc::Status callOnce(UpstreamCall& call, Start&& start, Reply& reply) {
  auto reader = start(&call.context, &call.queue);
  grpc::Status status;
  reader->Finish(&reply, &status, nullptr);
  return call.wait() == Upstream::Ended ? grpc::Status(grpc::StatusCode::INTERNAL, "the channel ended without an answer") : status;
}

/// The events of a rendering call as bytes: frames (door.h), or with `frames` false the bytes of the pictures alone.
class RenderStream {
 public:
  using Reader = std::unique_ptr<grpc::ClientAsyncReader<v1::RenderEvent>>;
  using Start = std::function<Reader(grpc::ClientContext*, grpc::CompletionQueue*)>;
  RenderStream(std::function<bool()> gone, bool frames);
  ~RenderStream();

  grpc::ClientContext& context() { return call_.context; }
  /// Starts the call and waits for its first event; the status of a call that ended before it.
  grpc::Status begin(const Start& start);
  /// The reply's head; of a call without frames it is the first event.
  const v1::RenderReply& head() const { return head_; }
  /// Up to `most` bytes, 0: the stream is over; -1: the client has gone, or the call ended within a picture.
  ssize_t read(char* to, size_t most);

 private:
  void step(double quietSeconds);
  void take();
  void frame(const std::string& json);

  UpstreamCall call_;
  const bool frames_;
  Reader reader_;
  v1::RenderEvent event_;
  v1::RenderReply head_;
  std::string pending_;  // bytes to be read next, from at_
  size_t at_ = 0;
  uint64_t left_ = 0;  // bytes of the announced picture that have not come: nothing else may stand between them
  bool reading_ = false, over_ = false;
  grpc::Status status_;
};

/// The body of an HTTP request on its way into Blobs.Put, piece by piece: no more of it than one message is held.
class PutStream {
 public:
  explicit PutStream(std::function<bool()> gone) : call_(std::move(gone)) {}
  ~PutStream();  ///< one that was not finished is cancelled: what arrived of it stays
  grpc::ClientContext& context() { return call_.context; }
  void begin(v1::Blobs::Stub& stub, const v1::BlobDigest& blob, uint64_t offset);
  /// What comes after a refusal is dropped; finish() tells it.
  void add(const char* data, size_t bytes);
  grpc::Status finish(v1::PutBlobReply& reply);
  const UpstreamCall& call() const { return call_; }

 private:
  void write();
  void end();
  static constexpr size_t kMessage = 256 << 10;

  UpstreamCall call_;
  std::unique_ptr<grpc::ClientAsyncWriter<v1::PutBlobRequest>> writer_;
  v1::PutBlobRequest message_;
  v1::PutBlobReply reply_;
  bool sent_ = false, over_ = false;  // the first message; the call has ended
  grpc::Status status_;
};

/// {"code":"NOT_FOUND","message":"..."}
std::string errorJson(const grpc::Status& status);
int httpStatusOf(grpc::StatusCode code);
/// What a call that was refused said of when to come again, ms; 0: nothing.
long retryMsOf(const grpc::ClientContext& context);
/// The same for Retry-After: 0 stays 0, anything else is a second at least.
long wholeSeconds(long ms);

}  // namespace door
}  // namespace gobo
