// SPDX-License-Identifier: Apache-2.0
// One call of any method of any service by its descriptor, with messages made by reflection: a method that the schema gains is called without a word
// here. Any thread.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <grpcpp/grpcpp.h>

namespace gobo::fuzz {

using MessagePtr = std::unique_ptr<google::protobuf::Message>;

struct CallOptions {
  std::string token;     ///< shown as the bearer; empty: none
  double seconds = 60;   ///< until the call's deadline
  int cancelAfter = -1;  ///< replies after which the client cancels; negative: never
};

struct CallAnswer {
  grpc::Status status;
  std::vector<MessagePtr> replies;
  double seconds = 0;
  bool cancelled = false;  ///< by the client, before the end was known
};

/// Every method of gobo.v1's services in the order of the schema.
const std::vector<const google::protobuf::MethodDescriptor*>& everyMethod();

MessagePtr newMessage(const google::protobuf::Descriptor& type);
CallAnswer callMethod(const std::shared_ptr<grpc::Channel>& channel, const google::protobuf::MethodDescriptor& method, const std::vector<MessagePtr>& requests,
                      const CallOptions& options);

}  // namespace gobo::fuzz
