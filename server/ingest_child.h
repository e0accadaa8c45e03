// SPDX-License-Identifier: Apache-2.0
// Runs a sandboxed reader on one file: starts it (reader_process.h), hands it the bytes it asks for, waits a wall-clock limit, and turns its end into a Status.
// What the child has read is hashed on its way, so a cache key is made of exactly those bytes. Thread-safe: each call is on its own.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "base/stop.h"
#include "ingest/wire.h"
#include "server/reader_process.h"

namespace gobo {
inline namespace server {

/// SHA-256 in hex, "absent" when there is no such file; the file's stamp if that was settled before and the same after.
struct SideFile {
  std::string name, digest, stamp;
};

struct IngestOutcome {
  std::string mainDigest, mainStamp;
  std::vector<SideFile> sides;  ///< in the order of the first ask
  ingest::Done done;
  bool parsing = false;  ///< it began to parse; `place` is what, a JSON pointer or ""
  std::string place;
};

inline constexpr size_t kMaxSideFiles = 10000;

/// gobo-ingest beside the running program, in ../ingest (build tree) or ../libexec/gobo; empty when there is none.
std::string findIngestProgram();

/// The blob is on `output` (from its start) when this returns ok. Errors, all placed at job.path: what the child reports;
/// ResourceExhausted that names the limit and its configuration key; InvalidArgument when it crashed while it parsed the file;
/// Internal when it crashed before, cannot be started, or tried what its sandbox forbids; Cancelled.
Result<IngestOutcome> runIngest(Readers& readers, const ingest::Job& job, int output, double wallSeconds, const StopToken& stop);

}  // namespace server
}  // namespace gobo
