// SPDX-License-Identifier: Apache-2.0
#include "server/admin_service.h"

#include <unistd.h>

#include <fstream>

#include "server/rpc.h"

namespace gobo {
namespace {

uint64_t residentBytes() {
  std::ifstream in("/proc/self/statm");
  uint64_t total = 0, resident = 0;
  in >> total >> resident;
  return resident * uint64_t(::sysconf(_SC_PAGESIZE));
}

}  // namespace

grpc::Status AdminService::GetStatus(grpc::ServerContext*, const v1::StatusRequest*, v1::StatusReply* reply) {
  core_.engine.fillStatus(*reply);
  reply->set_build(buildVersion());
  reply->set_uptime_s(std::chrono::duration<double>(std::chrono::steady_clock::now() - core_.started).count());
  const SchedulerStats jobs = core_.jobs.stats();
  reply->set_running(uint32_t(jobs.running));
  reply->set_queued(uint32_t(jobs.queued));
  reply->set_renders(core_.renders.load());
  reply->set_scenes(core_.engine.listScenes().size());
  reply->set_rss_bytes(residentBytes());
  reply->set_pid(int32_t(::getpid()));
  reply->set_threads(uint32_t(core_.engine.threads()));
  return grpc::Status::OK;
}

grpc::Status AdminService::DropCaches(grpc::ServerContext*, const v1::DropCachesRequest* request, v1::DropCachesReply* reply) {
  const auto held = [&] {
    v1::StatusReply status;
    core_.engine.fillStatus(status);
    return status.store_bytes() + (request->disk() ? status.disk_bytes() : 0);
  };
  const uint64_t before = held();
  core_.engine.dropCaches(request->disk());
  const uint64_t after = held();
  reply->set_bytes(before > after ? before - after : 0);
  logInfo("drop_caches disk=%d bytes=%llu status=OK", int(request->disk()), static_cast<unsigned long long>(reply->bytes()));
  return grpc::Status::OK;
}

grpc::Status AdminService::Shutdown(grpc::ServerContext* context, const v1::ShutdownRequest*, v1::ShutdownReply*) {
  if (!isLocalPeer(*context)) return {grpc::StatusCode::PERMISSION_DENIED, "Shutdown is allowed on the Unix socket only"};
  logInfo("shutdown asked for by a client");
  core_.drain();
  core_.shutdownAsked.store(true);
  return grpc::Status::OK;
}

}  // namespace gobo
