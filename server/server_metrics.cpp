// SPDX-License-Identifier: Apache-2.0
#include "server/server_metrics.h"

#include <dirent.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>

#include "server/core.h"
#include "server/file_store.h"
#include "server/log.h"

namespace gobo {
inline namespace server {
namespace {

using Clock = std::chrono::steady_clock;

double uptime(const ServerCore& core) { return std::chrono::duration<double>(Clock::now() - core.started).count(); }

void gauges(ServerCore& core, MetricsWriter& out) {
  const auto one = [&](const char* name, const char* type, const char* help, double value) {
    out.family(name, type, help);
    out.sample(name, {}, value);
  };
  v1::StatusReply s;
  core.engine.fillStatus(s);
  const SchedulerStats jobs = core.jobs.stats();
  const std::vector<WorkerState> workers = core.jobs.workers();
  out.family("gobo_build_info", "gauge", "Always 1; the label is the version.");
  out.sample("gobo_build_info", {{"build", buildVersion()}}, 1);
  one("gobo_uptime_seconds", "gauge", "Since the start.", uptime(core));
  one("gobo_draining", "gauge", "1 once no new work is taken.", core.draining());
  one("gobo_workers", "gauge", "Renders that can run at once.", double(workers.size()));
  one("gobo_workers_busy", "gauge", "Workers that render.", double(std::count_if(workers.begin(), workers.end(), [](const WorkerState& w) { return w.busy; })));
  const auto perClass = [&](const char* name, const char* type, const char* help, auto value) {
    out.family(name, type, help);
    for (int c = 0; c < kJobClasses; ++c) out.sample(name, {{"class", kClassNames[c]}}, double(value(jobs.classes[size_t(c)])));
  };
  perClass("gobo_renders_running", "gauge", "Renders in a worker.", [](const auto& c) { return c.running; });
  perClass("gobo_renders_queued", "gauge", "Renders that wait.", [](const auto& c) { return c.queued; });
  perClass("gobo_renders_submitted_total", "counter", "Renders that were taken into the queue.", [](const auto& c) { return c.submitted; });
  perClass("gobo_renders_done_total", "counter", "Renders that ended with a picture.", [](const auto& c) { return c.done; });
  perClass("gobo_renders_failed_total", "counter", "Renders that ended with an error.", [](const auto& c) { return c.failed; });
  perClass("gobo_renders_cancelled_total", "counter", "Renders that their caller or a shutdown cancelled.", [](const auto& c) { return c.cancelled; });
  perClass("gobo_renders_expired_total", "counter", "Renders whose deadline passed.", [](const auto& c) { return c.expired; });
  perClass("gobo_preemptions_total", "counter", "Times a running render gave way to a higher class.", [](const auto& c) { return c.preempted; });
  perClass("gobo_run_seconds_total", "counter", "Worker time, preempted runs included.", [](const auto& c) { return c.runSeconds; });
  one("gobo_pinned_bytes", "gauge", "Bound of the bytes that running renders hold.", double(jobs.pinnedBytes));
  one("gobo_pinned_limit_bytes", "gauge", "scheduler.pinned_bytes.", double(core.config.pinnedBytes));
  const auto perHolder = [&](const char* name, const char* help, auto value) {
    out.family(name, "gauge", help);
    for (const v1::MemoryHolder& h : s.memory()) out.sample(name, {{"holder", h.name()}}, double(value(h)));
  };
  perHolder("gobo_memory_bytes", "What holds memory (docs/operations.md, Memory).", [](const auto& h) { return h.bytes(); });
  perHolder("gobo_memory_limit_bytes", "The bound of each holder.", [](const auto& h) { return h.limit(); });
  one("gobo_memory_total_limit_bytes", "gauge", "engine.memory_bytes.", double(s.memory_limit()));
  one("gobo_store_bytes", "gauge", "Terms in memory.", double(s.store_bytes()));
  one("gobo_store_limit_bytes", "gauge", "engine.store_bytes.", double(s.store_limit()));
  one("gobo_store_terms", "gauge", "Terms in memory, number.", double(s.store_terms()));
  one("gobo_disk_bytes", "gauge", "Terms on disk.", double(s.disk_bytes()));
  one("gobo_scenes", "gauge", "Scenes loaded.", double(s.scenes()));
  one("gobo_uploads", "gauge", "Uploads in progress.", double(core.uploads.used()));
  one("gobo_watches", "gauge", "Jobs.Watch and Jobs.Fetch calls.", double(core.watches.used()));
  one("gobo_reply_bytes", "gauge", "Bound of the pictures that are being made or sent.", double(core.replies.used()));
  one("gobo_idle_calls_ended_total", "counter", "Calls ended because their client neither sent nor took anything (limits.client_idle_s).",
      double(core.idle.ended()));
  const FileStore::Stats blobs = core.files ? core.files->stats() : FileStore::Stats{};
  one("gobo_blob_bytes", "gauge", "Bytes of files that clients put.", double(blobs.bytes));
  one("gobo_blob_files", "gauge", "Whole files that clients put.", double(blobs.files));
  one("gobo_blob_parts", "gauge", "Files that have not arrived whole.", double(blobs.parts));
  one("gobo_blob_evicted_total", "counter", "Files that went to make room (blobs.bytes).", double(blobs.evicted));
  one("gobo_blob_damaged_total", "counter", "Files that were damaged on disk and removed.", double(blobs.damaged));
  one("gobo_loads", "gauge", "Scenes being loaded or patched.", double(core.loads.running()));
  one("gobo_loads_waiting", "gauge", "Calls that wait for a load's place.", double(core.loads.waiting()));
  one("gobo_tokens", "gauge", "Tokens configured.", double(core.tokens.count()));
  one("gobo_resident_bytes", "gauge", "Resident memory.", double(residentBytes()));
  one("gobo_open_fds", "gauge", "Open file descriptors.", double(openFiles()));
}

}  // namespace

uint64_t residentBytes() {
  std::ifstream in("/proc/self/statm");
  uint64_t total = 0, resident = 0;
  in >> total >> resident;
  return resident * uint64_t(::sysconf(_SC_PAGESIZE));
}

uint32_t openFiles() {
  DIR* folder = ::opendir("/proc/self/fd");
  if (!folder) return 0;
  uint32_t n = 0;
  while (const dirent* entry = ::readdir(folder)) n += entry->d_name[0] != '.';
  ::closedir(folder);
  return n > 0 ? n - 1 : 0;  // the folder itself was open
}

void declareServerMetrics(ServerCore& core) {
  Metrics& m = core.metrics;
  const std::vector<double> latency{0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60, 300, 1800};
  m.counter("gobo_requests_total", "Calls by method and code.");
  m.counter("gobo_refused_total", "Requests refused by a limit, by reason.");
  m.counter("gobo_rays_total", "Rays of finished renders.");
  m.counter("gobo_store_hits_total", "Nodes of finished renders that the store had, by tier.");
  m.counter("gobo_store_misses_total", "Nodes of finished renders that had to run.");
  m.counter("gobo_upload_bytes_total", "Bytes received by Scenes.Upload.");
  m.counter("gobo_blob_put_bytes_total", "Bytes received by Blobs.Put.");
  m.counter("gobo_reloads_total", "Reloads of the configuration, by result.");
  m.histogram("gobo_request_seconds", "From a call's arrival to its answer, by method.", latency);
  m.histogram("gobo_render_queue_seconds", "Time that finished renders waited, by class.", latency);
  m.histogram("gobo_render_run_seconds", "Time that finished renders ran, by class.", latency);
  m.histogram("gobo_render_total_seconds", "From arrival to the picture, by class.", latency);
  for (const char* name : {"gobo_rays_total", "gobo_store_misses_total", "gobo_upload_bytes_total", "gobo_blob_put_bytes_total"}) m.add(name, {}, 0);
  for (const char* tier : {"memory", "disk"}) m.add("gobo_store_hits_total", {{"tier", tier}}, 0);
  m.collect([&core](MetricsWriter& out) { gauges(core, out); });
}

HealthReport healthReport(ServerCore& core) {
  HealthReport report;
  report.ready = !core.draining();
  v1::StatusReply s;
  core.engine.fillStatus(s);
  const SchedulerStats jobs = core.jobs.stats();
  const std::vector<WorkerState> workers = core.jobs.workers();
  std::string list, queues;
  for (const WorkerState& w : workers) {
    list += (list.empty() ? "" : ",") + std::string("{\"state\":\"") + (w.busy ? "busy" : "idle") + "\",\"seconds\":" + strf("%.3f", w.seconds);
    if (w.busy) list += ",\"class\":\"" + std::string(kClassNames[int(w.jobClass)]) + "\",\"client\":" + jsonString(w.client);
    list += "}";
  }
  for (int c = 0; c < kJobClasses; ++c)
    queues += strf("%s\"%s\":{\"queued\":%zu,\"running\":%zu}", c ? "," : "", kClassNames[c], jobs.classes[size_t(c)].queued, jobs.classes[size_t(c)].running);
  report.json =
      std::string("{\"status\":\"") + (report.ready ? "serving" : "draining") + "\",\"renderer_initialized\":true,\"build\":" + jsonString(buildVersion()) +
      strf(",\"uptime_s\":%.3f,\"ready_workers\":%zu,\"total_workers\":%zu,", uptime(core), report.ready ? workers.size() : size_t(0), workers.size()) +
      "\"workers\":[" + list + "],\"queues\":{" + queues + "}," +
      strf("\"store\":{\"bytes\":%llu,\"limit\":%llu,\"disk_bytes\":%llu},\"rss_bytes\":%llu", (unsigned long long)s.store_bytes(),
           (unsigned long long)s.store_limit(), (unsigned long long)s.disk_bytes(), (unsigned long long)residentBytes()) +
      core.healthExtras() + "}\n";
  return report;
}

}  // namespace server
}  // namespace gobo
