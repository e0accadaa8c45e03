// SPDX-License-Identifier: Apache-2.0
#include "fuzz/served/generic_call.h"

#include <chrono>

#include <grpcpp/generic/generic_stub.h>

#include "gobo/v1/jobs.pb.h"
#include "gobo/v1/service.pb.h"

namespace gobo::fuzz {

const std::vector<const google::protobuf::MethodDescriptor*>& everyMethod() {
  static const auto methods = [] {
    std::vector<const google::protobuf::MethodDescriptor*> out;
    for (const auto* file : {v1::StatusRequest::descriptor()->file(), v1::JobSpec::descriptor()->file()})
      for (int s = 0; s < file->service_count(); ++s)
        for (int m = 0; m < file->service(s)->method_count(); ++m) out.push_back(file->service(s)->method(m));
    return out;
  }();
  return methods;
}

MessagePtr newMessage(const google::protobuf::Descriptor& type) {
  return MessagePtr(google::protobuf::MessageFactory::generated_factory()->GetPrototype(&type)->New());
}

CallAnswer callMethod(const std::shared_ptr<grpc::Channel>& channel, const google::protobuf::MethodDescriptor& method, const std::vector<MessagePtr>& requests,
                      const CallOptions& options) {
  using Clock = std::chrono::steady_clock;
  const auto begun = Clock::now();
  CallAnswer out;
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::microseconds(int64_t(options.seconds * 1e6)));
  if (!options.token.empty()) context.AddMetadata("authorization", "Bearer " + options.token);
  grpc::CompletionQueue queue;
  const auto done = [&] {  // of the one operation that is under way
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  const auto cancel = [&] {
    out.cancelled = true;
    context.TryCancel();
  };
  grpc::GenericStub stub(channel);
  const auto call = stub.PrepareCall(&context, "/" + method.service()->full_name() + "/" + method.name(), &queue);
  call->StartCall(nullptr);
  bool open = done();
  if (open && options.cancelAfter == 0) cancel();
  for (size_t i = 0; open && i < requests.size(); ++i) {
    grpc::Slice slice(requests[i]->SerializeAsString());
    call->Write(grpc::ByteBuffer(&slice, 1), nullptr);
    open = done();
  }
  if (open) {
    call->WritesDone(nullptr);
    open = done();
  }
  for (grpc::ByteBuffer buffer;; buffer.Clear()) {
    call->Read(&buffer, nullptr);
    if (!done()) break;
    std::vector<grpc::Slice> slices;
    std::string bytes;
    if (!buffer.Dump(&slices).ok()) break;
    for (const grpc::Slice& s : slices) bytes.append(reinterpret_cast<const char*>(s.begin()), s.size());
    MessagePtr reply = newMessage(*method.output_type());
    if (!reply->ParseFromString(bytes)) {
      out.status = grpc::Status(grpc::INTERNAL, "a reply is no " + method.output_type()->full_name());
      return out;
    }
    out.replies.push_back(std::move(reply));
    if (int(out.replies.size()) == options.cancelAfter) cancel();
  }
  call->Finish(&out.status, nullptr);
  done();
  out.seconds = std::chrono::duration<double>(Clock::now() - begun).count();
  return out;
}

}  // namespace gobo::fuzz
