// SPDX-License-Identifier: Apache-2.0
// The metrics and the health report of one daemon. Other parts (durable jobs) add theirs with core.metrics.counter/histogram/
// collect and core.addHealth; names start with "gobo_". docs/operations.md lists them all. Thread-safe.
#pragma once

#include <cstdint>
#include <string>

namespace gobo {
inline namespace server {

class ServerCore;

/// Declares counters and histograms, registers the gauges. Called once, by the core's constructor.
void declareServerMetrics(ServerCore& core);

struct HealthReport {
  bool ready = false;  ///< false while the server drains
  std::string json;    ///< status, build, uptime_s, ready_workers, total_workers, workers[], queues{}, store{}, draining
};
HealthReport healthReport(ServerCore& core);

uint64_t residentBytes();
/// Descriptors that this process has open.
uint32_t openFiles();

}  // namespace server
}  // namespace gobo
