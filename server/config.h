// SPDX-License-Identifier: Apache-2.0
// The daemon's configuration: a TOML file (configs/gobod.toml documents every key), overridden by flags of the command line.
// Unknown keys, wrong types and values out of range are errors that name file:line and key; nothing is guessed.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"
#include "server/log.h"

namespace gobo {

struct ServerConfig {
  std::vector<std::string> listen;            ///< "unix:PATH" or "HOST:PORT"; the default socket if empty
  bool allowRemote = false;                   ///< needed for any TCP address that is not loopback
  bool reflection = false;                    ///< gRPC server reflection

  std::string logLevel = "info";

  int threads = 0;                            ///< of the task arena; 0: all
  uint64_t storeBytes = 4ull << 30;
  std::string cacheFolder;                    ///< disk tier; empty: none
  uint64_t diskBytes = 16ull << 30;
  std::vector<std::string> roots;
  uint32_t keepRenders = 1024;

  uint32_t rpcThreads = 400;                  ///< concurrent calls, waiting renders included; one more is refused
  uint32_t streamsPerConnection = 64;
  uint64_t messageBytes = 64ull << 20;
  uint64_t rpcMemoryBytes = 1ull << 30;       ///< gRPC resource quota
  uint64_t uploadBytes = 1ull << 30;          ///< a scene in Upload
  uint32_t uploadsAtOnce = 4;
  uint64_t chunkBytes = 1ull << 20;
  uint64_t inlineBytes = 48ull << 20;
  uint64_t imageBytes = 8ull << 30;           ///< pictures of one reply as floats, bound from width, height and outputs
  std::string tmpFolder;                      ///< uploads; $TMPDIR or /tmp if empty

  // [ingest]: docs/ingest.md
  bool ingestSandbox = true;                  ///< false: files are parsed in this process; loopback and Unix sockets only
  std::string ingestProgram;                  ///< gobo-ingest; empty: beside gobod
  std::string ingestCacheFolder;              ///< blobs; empty: "ingest" under cacheFolder, none without one
  uint64_t ingestCacheBytes = 8ull << 30;
  std::string ingestVerify = "changed";       ///< "changed" or "always"
  uint64_t ingestMemoryBytes = 4ull << 30, ingestBlobBytes = 8ull << 30, ingestTextureBytes = 4ull << 30, ingestInputBytes = 4ull << 30;
  uint32_t ingestCpuSeconds = 300, ingestAtOnce = 2;
  double ingestWallSeconds = 600;

  uint32_t running = 1;                       ///< renders at once: each uses the whole arena
  uint32_t queuedInteractive = 64, queuedNormal = 128, queuedBatch = 128;   ///< more are refused with a retry hint
  uint32_t queuedPerClient = 128;
  double ageingNormal = 10, ageingBatch = 30; ///< seconds until a waiting class is given a turn
  uint64_t pinnedBytes = 0;                   ///< bound on the sum over running renders; 0: half of the machine's memory
  double drainSeconds = 30;                   ///< after SIGTERM, before running renders are cancelled
};

/// "unix:/tmp/gobo-UID.sock".
std::string defaultAddress();
/// Reads `path` over the defaults. Relative folders in the file are relative to the file's folder.
/// Errors: InvalidArgument "FILE:LINE: key ...", NotFound if the file cannot be read.
Status readConfig(const std::string& path, ServerConfig& config);
/// Ranges, addresses (loopback unless allow_remote), folders. Fills in the default listen address and tmp folder.
Status checkConfig(ServerConfig& config);
/// The value of "4GiB", "64 MiB", "1000".
Result<uint64_t> parseBytes(const std::string& text);

struct Address {
  bool isUnix = false;
  std::string path;              ///< of the socket
  std::string host, port;
};
/// Errors: InvalidArgument that quotes the address.
Result<Address> parseAddress(const std::string& text);
/// 127.0.0.0/8, ::1, localhost.
bool isLoopback(const std::string& host);

}  // namespace gobo
