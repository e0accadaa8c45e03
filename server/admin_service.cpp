// SPDX-License-Identifier: Apache-2.0
#include "server/admin_service.h"

#include <unistd.h>

#include "plan/store.h"
#include "server/serve.h"
#include "server/server_metrics.h"
#include "server/term_selection.h"

namespace gobo {
inline namespace server {

/// How long the first status waits for drivers, and for the layers of the sandbox, to be found; the next one has them.
static constexpr double kProbeSeconds = 0.25;

grpc::Status AdminService::GetStatus(grpc::ServerContext* context, const v1::StatusRequest*, v1::StatusReply* reply) {
  return serve(core_, *context, "status", [&](Rpc& rpc) -> grpc::Status {
    rpc.quiet();
    fill(*reply);
    // Names of tokens are for who may see everybody's scenes.
    if (!rpc.access().all)
      for (v1::MemoryHolder& holder : *reply->mutable_memory()) {
        const auto mine = holder.callers().find(rpc.access().caller);
        const uint64_t bytes = mine == holder.callers().end() ? 0 : mine->second;
        holder.clear_callers();
        if (bytes) (*holder.mutable_callers())[rpc.access().caller] = bytes;
      }
    return grpc::Status::OK;
  });
}

void AdminService::fill(v1::StatusReply& status) {
  v1::StatusReply* reply = &status;
  core_.engine.fillStatus(*reply);
  reply->set_build(buildVersion());
  reply->set_uptime_s(std::chrono::duration<double>(std::chrono::steady_clock::now() - core_.started).count());
  const SchedulerStats jobs = core_.jobs.stats();
  reply->set_running(uint32_t(jobs.running));
  reply->set_queued(uint32_t(jobs.queued));
  reply->set_renders(core_.renders.load());
  reply->set_rss_bytes(residentBytes());
  reply->set_pid(int32_t(::getpid()));
  reply->set_threads(uint32_t(core_.engine.threads()));
  reply->set_draining(core_.draining());
  reply->set_workers(uint32_t(core_.jobs.workers().size()));
  reply->set_pinned_bytes(jobs.pinnedBytes);
  reply->set_open_fds(openFiles());
  reply->set_loads(core_.loads.running() + uint32_t(core_.uploads.used()));
  for (const std::string& device : core_.devices.list(kProbeSeconds)) reply->add_devices(device);
  const ingest::Layers layers = core_.sandbox.layers(kProbeSeconds);
  reply->mutable_sandbox()->Assign(layers.active.begin(), layers.active.end());
  reply->mutable_sandbox_missing()->Assign(layers.missing.begin(), layers.missing.end());
}

grpc::Status AdminService::DropCaches(grpc::ServerContext* context, const v1::DropCachesRequest* request, v1::DropCachesReply* reply) {
  return serve(core_, *context, "drop_caches", [&](Rpc& rpc) -> grpc::Status {
    const grpc::Status allowed = rpc.needAdmin("DropCaches");
    if (!allowed.ok()) return allowed;
    if (request->has_which()) {
      const auto filter = filterOf(request->which(), "request.which");
      if (!filter.ok()) return toGrpc(filter.status());
      for (const StoredTerm& row : core_.engine.terms().evict(*filter, request->disk(), request->pinned())) {
        reply->set_bytes(reply->bytes() + row.bytes + row.diskBytes);
        reply->set_terms(reply->terms() + 1);
      }
    } else {
      reply->set_bytes(drop(request->disk(), request->pinned()));
    }
    rpc.note("disk", request->disk() ? "true" : "false");
    rpc.note("bytes", std::to_string(reply->bytes()));
    return grpc::Status::OK;
  });
}

grpc::Status AdminService::ListTerms(grpc::ServerContext* context, const v1::ListTermsRequest* request, v1::ListTermsReply* reply) {
  return serve(core_, *context, "list_terms", [&](Rpc& rpc) -> grpc::Status {
    rpc.quiet();
    TermFilter filter = [](const StoredTerm&) { return true; };
    if (request->has_which()) {
      auto asked = filterOf(request->which(), "request.which");
      if (!asked.ok()) return toGrpc(asked.status());
      filter = std::move(*asked);
    }
    TermStore& store = core_.engine.terms();
    std::vector<StoredTerm> rows = store.list();
    std::erase_if(rows, [&](const StoredTerm& row) { return (request->pinned() && !row.pinned) || !filter(row); });
    // Labels have names of lights in them, and scenes are somebody's. Totals of a chosen scene or digest would tell whether there is such a one.
    const bool whole = rpc.who().admin;
    if (!whole && request->has_which()) return rpc.needAdmin("ListTerms with `which`");
    if (const Status listed = listInto(rows, *request, whole, *reply); !listed.ok()) return toGrpc(listed);
    reply->set_limit(store.maxBytes());
    reply->set_disk_limit(store.maxDiskBytes());
    reply->set_pinned_bytes(store.pinnedBytes());
    reply->set_pinned_disk_bytes(store.pinnedDiskBytes());
    return grpc::Status::OK;
  });
}

grpc::Status AdminService::PinTerms(grpc::ServerContext* context, const v1::PinTermsRequest* request, v1::PinTermsReply* reply) {
  return serve(core_, *context, "pin_terms", [&](Rpc& rpc) -> grpc::Status {
    const grpc::Status allowed = rpc.needAdmin("PinTerms");
    if (!allowed.ok()) return allowed;
    const auto filter = filterOf(request->which(), "request.which");
    if (!filter.ok()) return toGrpc(filter.status());
    TermStore& store = core_.engine.terms();
    const auto changed = request->unpin() ? store.unpin(*filter) : store.pin(*filter);
    if (!changed.ok()) return toGrpc(changed.status());
    for (const StoredTerm& row : *changed) {
      reply->set_terms(reply->terms() + 1);
      reply->set_bytes(reply->bytes() + std::max(row.bytes, row.diskBytes));
      reply->set_memory_only(reply->memory_only() + (row.diskBytes == 0));
    }
    rpc.note("pinned", request->unpin() ? "no longer" : "now");
    rpc.note("terms", std::to_string(reply->terms()));
    return grpc::Status::OK;
  });
}

uint64_t AdminService::drop(bool disk, bool pinned) {
  const auto held = [&] {
    v1::StatusReply status;
    core_.engine.fillStatus(status);
    return status.store_bytes() + (disk ? status.disk_bytes() : 0);
  };
  const uint64_t before = held();
  core_.engine.dropCaches(disk, pinned);
  const uint64_t after = held();
  return before > after ? before - after : 0;
}

grpc::Status AdminService::Shutdown(grpc::ServerContext* context, const v1::ShutdownRequest*, v1::ShutdownReply*) {
  return serve(core_, *context, "shutdown", [&](Rpc& rpc) -> grpc::Status {
    const grpc::Status allowed = rpc.needAdmin("Shutdown");
    if (!allowed.ok()) return allowed;
    if (!rpc.who().local && !rpc.who().token)
      return rpc.refuse("admin", {Code::PermissionDenied, "Shutdown is allowed on the Unix socket, or with a token that has admin = true"});
    core_.drain();
    core_.shutdownAsked.store(true);
    return grpc::Status::OK;
  });
}

}  // namespace server
}  // namespace gobo
