// SPDX-License-Identifier: Apache-2.0
#include "server/farm/messages.h"

namespace gobo::farm {

v1::FarmLease toMessage(const Lease& lease) {
  v1::FarmLease m;
  m.set_job(lease.task.job);
  m.set_index(lease.task.index);
  m.set_token(lease.token);
  m.set_frame(lease.frame);
  m.set_progress(lease.progress);
  return m;
}

Lease fromMessage(const v1::FarmLease& m) {
  Lease lease;
  lease.task = {m.job(), m.index()};
  lease.token = m.token();
  lease.frame = m.frame();
  lease.progress = m.progress();
  return lease;
}

v1::CheckpointInfo toMessage(const CheckpointRow& row) {
  v1::CheckpointInfo m;
  m.set_recipe(row.recipe);
  m.set_digest(row.digest);
  m.set_blocks(row.blocks);
  m.set_bytes(row.bytes);
  return m;
}

CheckpointRow fromMessage(const v1::CheckpointInfo& m) { return {m.recipe(), m.digest(), m.blocks(), m.bytes()}; }

Status fromGrpc(const grpc::Status& status) { return status.ok() ? Status() : Status(Code(int(status.error_code())), status.error_message()); }

bool isDigest(const std::string& text, size_t digits) { return text.size() == digits && text.find_first_not_of("0123456789abcdef") == std::string::npos; }

}  // namespace gobo::farm
