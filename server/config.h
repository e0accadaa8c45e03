// SPDX-License-Identifier: Apache-2.0
// The daemon's configuration: a TOML file (configs/gobod.toml documents every key), overridden by flags of the command line.
// Unknown keys, wrong types and values out of range are errors that name file:line and key; nothing is guessed.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "server/log.h"

namespace gobo {
inline namespace server {

/// One [[tokens]] table. Zero and empty mean: no bound of the token's own.
struct TokenConfig {
  std::string name;                  ///< also the client of the fair share
  std::string sha256;                ///< of the token's bytes, 64 lower-case hex digits; the token is never stored
  std::vector<std::string> classes;  ///< of "interactive", "normal", "batch"
  double requestsPerSecond = 0;      ///< of any kind; up to `burst` at once
  uint32_t burst = 10;
  uint32_t rendersAtOnce = 0;  ///< queued ones included, but for those that wait for their turn in a session
  uint64_t maxPixels = 0;      ///< width x height
  uint32_t maxSpp = 0;
  double maxSeconds = 0;                          ///< of one request, from its arrival
  uint64_t uploadBytes = 0;                       ///< of one upload, below limits.upload_bytes
  std::optional<std::vector<std::string>> roots;  ///< if given: the only folders whose files it may name
  bool admin = false;                             ///< DropCaches, rows of ListTerms, PinTerms, Shutdown; workers' calls too
  bool worker = false;                            ///< the calls of a farm's workers (docs/farm.md)
  bool operator==(const TokenConfig&) const = default;
};

struct TlsConfig {
  std::string cert, key;           ///< PEM files: chain, then its private key; empty: TCP in plain text
  std::string clientCa;            ///< PEM file; empty: clients show no certificate
  bool requireClientCert = false;  ///< mutual TLS: no connection without a certificate signed by clientCa
  bool on() const { return !cert.empty(); }
  bool operator==(const TlsConfig&) const = default;
};

struct ServerConfig {
  std::string file;                  ///< that it was read from; empty: none
  std::vector<std::string> listen;   ///< "unix:PATH" or "HOST:PORT"; the default socket if empty
  bool allowRemote = false;          ///< TCP addresses that are not loopback even without TLS and tokens
  bool reflection = false;           ///< gRPC server reflection
  uint32_t socketMode = 0600;        ///< of Unix sockets
  std::string requireToken = "tcp";  ///< "tcp": on TCP, once there are tokens; "always": on Unix sockets too
  TlsConfig tls;
  std::vector<TokenConfig> tokens;
  std::string httpListen;  ///< HOST:PORT of /metrics, /health, /ready; empty: none
  bool httpAllowRemote = false;
  std::string webListen;              ///< HOST:PORT of the viewer and the calls over HTTP (server/door); empty: none
  std::vector<std::string> webHosts;  ///< names by which browsers may reach it beside its own, for a proxy in front of it

  // [color]: docs/color.md
  std::string colorOcio;          ///< OpenColorIO config; empty: $OCIO, none without it; "none": none
  std::string colorWorkingSpace;  ///< colour space of it that takes linear Rec. 709; empty: found

  std::string logLevel = "info";
  std::string logFormat = "text";

  int threads = 0;  ///< of the task arena; 0: all
  uint64_t storeBytes = 4ull << 30;
  std::string cacheFolder;  ///< disk tier; empty: none
  uint64_t diskBytes = 16ull << 30;
  std::vector<std::string> roots;
  uint32_t keepRenders = 1024;
  uint64_t keepRendersBytes = 64ull << 20;  ///< of the requests behind them
  uint64_t memoryBytes = 0;                 ///< of everything together; 0: three quarters of the machine's memory
  uint64_t sceneBytes = 0;                  ///< loaded scenes; 0: a quarter of the machine's memory
  uint64_t environmentBytes = 2ull << 30;   ///< environment maps in memory
  uint64_t accelBytes = 4ull << 30;         ///< ray tracing structures kept between renders

  uint32_t rpcThreads = 640;  ///< concurrent calls, waiting renders included; one more is refused
  uint32_t streamsPerConnection = 64;
  uint64_t messageBytes = 64ull << 20;
  uint64_t rpcMemoryBytes = 1ull << 30;  ///< gRPC resource quota
  uint64_t uploadBytes = 1ull << 30;     ///< a scene in Upload
  uint32_t uploadsAtOnce = 4;            ///< of which one client may have half
  uint64_t requestBytes = 16ull << 20;   ///< one message from a client
  uint32_t watches = 64;                 ///< Jobs.Watch and Jobs.Fetch at once, of which one client may have half
  uint64_t replyBytes = 2ull << 30;      ///< pictures that are being made or sent, of which one client may have half
  double clientIdleSeconds = 30;         ///< a client that neither sends nor takes for that long loses its call
  uint32_t connections = 1024, connectionsPerPeer = 256;
  uint64_t chunkBytes = 1ull << 20;
  uint64_t inlineBytes = 48ull << 20;
  uint32_t loadsAtOnce = 2;          ///< scenes being loaded or patched; more wait
  double requestSeconds = 0;         ///< a render may take, from its arrival; 0: any time
  uint64_t imageBytes = 8ull << 30;  ///< pictures of one reply as floats, bound from width, height and outputs
  std::string tmpFolder;             ///< uploads; $TMPDIR or /tmp if empty

  std::string blobsFolder;           ///< files that clients put; "blobs" under cacheFolder if empty, without one in tmpFolder until the daemon ends
  uint64_t blobsBytes = 8ull << 30;  ///< of which one client may have half

  // [ingest]: docs/ingest.md
  std::string ingestProgram;      ///< gobo-ingest; empty: beside gobod
  std::string ingestCacheFolder;  ///< blobs; empty: "ingest" under cacheFolder, none without one
  uint64_t ingestCacheBytes = 8ull << 30;
  std::string ingestVerify = "changed";  ///< "changed" or "always"
  uint64_t ingestMemoryBytes = 4ull << 30, ingestBlobBytes = 2ull << 30, ingestTextureBytes = 1ull << 30, ingestInputBytes = 4ull << 30;
  uint32_t ingestCpuSeconds = 300, ingestAtOnce = 2;
  double ingestWallSeconds = 600;

  uint32_t running = 1;                                                    ///< renders at once: each uses the whole arena
  uint32_t queuedInteractive = 64, queuedNormal = 128, queuedBatch = 128;  ///< more are refused with a retry hint
  uint32_t queuedPerClient = 128;
  double ageingNormal = 10, ageingBatch = 30;  ///< seconds until a waiting class is given a turn
  uint64_t pinnedBytes = 0;                    ///< bound on the sum over running renders; 0: half of the machine's memory
  double drainSeconds = 30;                    ///< after SIGTERM, before running renders are cancelled

  std::string jobsFolder;     ///< durable jobs; empty: none
  std::string jobsOutFolder;  ///< below which jobs may have their files written (JobSpec.out); empty: none
  std::string jobsStore;      ///< connection URI of a PostgreSQL database, shared by the daemons of a farm; empty: jobs.sqlite in the folder
  uint32_t jobsWorkers = 1;   ///< frames that are rendered, or wait for a slot, at once
  double jobsLeaseSeconds = 30, jobsCheckpointSeconds = 30;
  uint64_t jobsKeepBytes = 64ull << 30;  ///< results of jobs that are over
  double jobsKeepDays = 30;

  // [farm]: docs/farm.md
  uint32_t farmWorkers = 64;              ///< that may attend at once
  std::string farmCoordinator;            ///< address of the daemon whose frames this one renders; empty: none, it serves its own
  std::string farmName;                   ///< of this worker; the host's if empty
  std::string farmFolder;                 ///< scenes, maps, pictures on their way; a new one in tmpFolder if empty, removed at the end
  uint64_t farmCacheBytes = 16ull << 30;  ///< of scenes and maps that are kept there
  bool farmTls = false;                   ///< of the way to the coordinator, also with one of the files
  std::string farmCa, farmCert, farmKey, farmTokenFile;
  bool operator==(const ServerConfig&) const = default;
};

/// "unix:/tmp/gobo-UID.sock".
std::string defaultAddress();
/// Reads `path` over the defaults. Relative folders in the file are relative to the file's folder.
/// Errors: InvalidArgument "FILE:LINE: key ...", NotFound if the file cannot be read.
Status readConfig(const std::string& path, ServerConfig& config);
/// Every key that a file may hold, "limits.upload_bytes"; those of a [[tokens]] table as "tokens.name".
std::vector<std::string> configKeys();
/// Ranges, addresses (beyond loopback only with TLS and tokens, or allow_remote), tokens, folders. Fills in the default listen address and tmp folder.
Status checkConfig(ServerConfig& config);
/// Limits against each other, of a checked configuration or of one that a reload would make of two. Errors: InvalidArgument naming the keys.
Status checkRelations(const ServerConfig& config);
/// Calls that may wait at once, each in a thread of limits.rpc_threads: running and queued renders, watches, uploads, loads.
uint64_t callsThatMayWait(const ServerConfig& config);
/// What differs between the running configuration and a new one but is fixed until a restart: keys, "scheduler.running".
std::vector<std::string> fixedKeysThatDiffer(const ServerConfig& running, const ServerConfig& next);
/// `running` with what may change at run time taken from `next`: tokens, TLS files, roots, log, [limits] but for gRPC's own, drain_s.
ServerConfig reloaded(const ServerConfig& running, const ServerConfig& next);
/// The value of "4GiB", "64 MiB", "1000".
Result<uint64_t> parseBytes(const std::string& text);

struct Address {
  bool isUnix = false;
  std::string path;  ///< of the socket
  std::string host, port;
};
/// Errors: InvalidArgument that quotes the address.
Result<Address> parseAddress(const std::string& text);
/// 127.0.0.0/8, ::1, localhost.
bool isLoopback(const std::string& host);

}  // namespace server
}  // namespace gobo
