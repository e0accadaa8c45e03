// SPDX-License-Identifier: Apache-2.0
// gobo.v1.Admin: status, caches, shutdown (all but status and totals with the admin right: the local user's, or a token's). Thread-safe.
#pragma once

#include "gobo/v1/service.grpc.pb.h"
#include "server/core.h"

namespace gobo {
inline namespace server {

class AdminService final : public v1::Admin::Service {
 public:
  explicit AdminService(ServerCore& core) : core_(core) {}
  grpc::Status GetStatus(grpc::ServerContext*, const v1::StatusRequest*, v1::StatusReply*) override;
  grpc::Status DropCaches(grpc::ServerContext*, const v1::DropCachesRequest*, v1::DropCachesReply*) override;
  grpc::Status ListTerms(grpc::ServerContext*, const v1::ListTermsRequest*, v1::ListTermsReply*) override;
  grpc::Status PinTerms(grpc::ServerContext*, const v1::PinTermsRequest*, v1::PinTermsReply*) override;
  grpc::Status Shutdown(grpc::ServerContext*, const v1::ShutdownRequest*, v1::ShutdownReply*) override;

 private:
  void fill(v1::StatusReply& status);
  uint64_t drop(bool disk, bool pinned);  // bytes that went
  ServerCore& core_;
};

}  // namespace server
}  // namespace gobo
