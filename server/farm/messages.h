// SPDX-License-Identifier: Apache-2.0
// Leases and checkpoints as messages of farm.proto, and back; statuses of gRPC as Gobo's.
#pragma once

#include <grpcpp/grpcpp.h>

#include "gobo/v1/farm.pb.h"
#include "server/jobs/task_store.h"

namespace gobo::farm {

v1::FarmLease toMessage(const Lease& lease);
Lease fromMessage(const v1::FarmLease& message);
v1::CheckpointInfo toMessage(const CheckpointRow& row);
CheckpointRow fromMessage(const v1::CheckpointInfo& message);
/// The code's numbers are gRPC's.
Status fromGrpc(const grpc::Status& status);
/// Lower-case hex digits, so many: what may become part of a file's name.
bool isDigest(const std::string& text, size_t digits);

inline constexpr size_t kSha256Digits = 64, kXxh128Digits = 32;
inline constexpr size_t kChunkBytes = 1 << 20;

}  // namespace gobo::farm
