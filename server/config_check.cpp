// SPDX-License-Identifier: Apache-2.0
#include "server/config_check.h"

#include <algorithm>
#include <filesystem>
#include <set>

namespace gobo {
inline namespace server {

namespace fs = std::filesystem;

Status checkToken(const TokenConfig& t) {
  const auto bad = [](const char* key, const std::string& value, const char* must) {
    return invalidArgument(std::string("tokens.") + key + " = \"" + escaped(value.substr(0, 80)) + "\": must be " + must);
  };
  const char* letters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
  if (t.name.empty() || t.name.size() > 64 || t.name.find_first_not_of(letters) != std::string::npos)
    return bad("name", t.name, "1 to 64 letters, digits, dots, dashes or underscores");
  if (t.name == "unix" || t.name == "local") return bad("name", t.name, "another name: this one is the local user's");
  if (t.sha256.size() != 64 || t.sha256.find_first_not_of("0123456789abcdef") != std::string::npos)
    return bad("sha256", t.sha256, "the token's SHA-256 as 64 lower-case hex digits (printf %s TOKEN | sha256sum)");
  for (const std::string& c : t.classes)
    if (c != "interactive" && c != "normal" && c != "batch") return bad("classes", c, "interactive, normal or batch");
  return {};
}

Status checkSecurity(const ServerConfig& c) {
  for (const std::string& text : c.listen) {
    GOBO_ASSIGN(const Address address, parseAddress(text));
    if (address.isUnix || isLoopback(address.host) || c.allowRemote || (c.tls.on() && !c.tokens.empty())) continue;
    return {Code::PermissionDenied, "listen = \"" + escaped(text) +
                                        "\": not a loopback address. It needs [tls] cert and key and at least one "
                                        "[[tokens]] table; or set allow_remote = true if the network in front of it protects it"};
  }
  if (c.tls.cert.empty() != c.tls.key.empty())
    return invalidArgument("tls.cert = \"" + escaped(c.tls.cert) + "\", tls.key = \"" + escaped(c.tls.key) + "\": both or none must be given");
  if (!c.tls.on() && !c.tls.clientCa.empty()) return invalidArgument("tls.client_ca = \"" + escaped(c.tls.clientCa) + "\": needs tls.cert and tls.key");
  if (c.tls.requireClientCert && c.tls.clientCa.empty()) return invalidArgument("tls.require_client_cert = true: needs tls.client_ca");
  std::set<std::string> names, digests;
  for (const TokenConfig& t : c.tokens) {
    GOBO_TRY(checkToken(t));
    if (!names.insert(t.name).second) return invalidArgument("tokens.name = \"" + t.name + "\": given twice");
    if (!digests.insert(t.sha256).second) return invalidArgument("tokens.sha256 of \"" + t.name + "\": another token has the same");
    for (const std::string& root : t.roots.value_or(std::vector<std::string>())) {
      std::error_code error;
      if (!fs::is_directory(root, error)) return notFound("tokens.roots of \"" + t.name + "\": \"" + escaped(root) + "\" is not a folder");
    }
  }
  if (c.requireToken != "tcp" && c.requireToken != "always")
    return invalidArgument("auth.require_token = \"" + escaped(c.requireToken) + "\": must be tcp or always");
  if (c.requireToken == "always" && c.tokens.empty()) return invalidArgument("auth.require_token = \"always\": nobody could call, as there are no [[tokens]]");
  if (c.socketMode > 0777) return invalidArgument("socket_mode: must be at most 0777");
  if (!c.httpListen.empty()) {
    GOBO_ASSIGN(const Address address, parseAddress(c.httpListen));
    if (address.isUnix) return invalidArgument("http.listen = \"" + escaped(c.httpListen) + "\": must be HOST:PORT");
    if (!isLoopback(address.host) && !c.httpAllowRemote)
      return {Code::PermissionDenied, "http.listen = \"" + escaped(c.httpListen) +
                                          "\": not a loopback address, and metrics are served to anybody who "
                                          "asks; set http.allow_remote = true if the network in front of it protects it"};
  }
  if (!c.webListen.empty()) {
    GOBO_ASSIGN(const Address address, parseAddress(c.webListen));
    if (address.isUnix) return invalidArgument("web.listen = \"" + escaped(c.webListen) + "\": must be HOST:PORT");
    if (!isLoopback(address.host) && !(c.tls.on() && !c.tokens.empty()))
      return {Code::PermissionDenied, "web.listen = \"" + escaped(c.webListen) +
                                          "\": not a loopback address. It needs [tls] cert and key and at least one [[tokens]] table; or let it listen "
                                          "on loopback behind a proxy whose name is in web.hosts"};
    if (c.tls.requireClientCert)
      return invalidArgument("web.listen = \"" + escaped(c.webListen) + "\": tls.require_client_cert = true is not kept there: browsers show no certificate");
  }
  return {};
}

std::vector<std::string> fixedKeysThatDiffer(const ServerConfig& a, const ServerConfig& b) {
  std::vector<std::string> keys;
  const auto differ = [&](const char* key, bool is) {
    if (is) keys.push_back(key);
  };
  differ("listen", a.listen != b.listen);
  differ("allow_remote", a.allowRemote != b.allowRemote);
  differ("reflection", a.reflection != b.reflection);
  differ("socket_mode", a.socketMode != b.socketMode);
  differ("tls (on or off, client_ca given or not, require_client_cert)",
         a.tls.on() != b.tls.on() || a.tls.requireClientCert != b.tls.requireClientCert || a.tls.clientCa.empty() != b.tls.clientCa.empty());
  differ("http.listen", a.httpListen != b.httpListen);
  differ("http.allow_remote", a.httpAllowRemote != b.httpAllowRemote);
  differ("web.listen", a.webListen != b.webListen);
  differ("web.hosts", a.webHosts != b.webHosts);
  differ("color.ocio", a.colorOcio != b.colorOcio);
  differ("color.working_space", a.colorWorkingSpace != b.colorWorkingSpace);
  differ("engine.threads", a.threads != b.threads);
  differ("engine.store_bytes", a.storeBytes != b.storeBytes);
  differ("engine.cache_folder", a.cacheFolder != b.cacheFolder);
  differ("engine.disk_bytes", a.diskBytes != b.diskBytes);
  differ("engine.keep_renders", a.keepRenders != b.keepRenders);
  differ("engine.keep_renders_bytes", a.keepRendersBytes != b.keepRendersBytes);
  differ("engine.memory_bytes", a.memoryBytes != b.memoryBytes);
  differ("engine.scene_bytes", a.sceneBytes != b.sceneBytes);
  differ("engine.environment_bytes", a.environmentBytes != b.environmentBytes);
  differ("engine.accel_bytes", a.accelBytes != b.accelBytes);
  differ("blobs.folder", a.blobsFolder != b.blobsFolder);
  differ("blobs.bytes", a.blobsBytes != b.blobsBytes);
  differ("ingest.program", a.ingestProgram != b.ingestProgram);
  differ("ingest.cache_folder", a.ingestCacheFolder != b.ingestCacheFolder);
  differ("ingest.cache_bytes", a.ingestCacheBytes != b.ingestCacheBytes);
  differ("ingest.verify", a.ingestVerify != b.ingestVerify);
  differ("ingest.memory_bytes", a.ingestMemoryBytes != b.ingestMemoryBytes);
  differ("ingest.blob_bytes", a.ingestBlobBytes != b.ingestBlobBytes);
  differ("ingest.texture_bytes", a.ingestTextureBytes != b.ingestTextureBytes);
  differ("ingest.input_bytes", a.ingestInputBytes != b.ingestInputBytes);
  differ("ingest.cpu_s", a.ingestCpuSeconds != b.ingestCpuSeconds);
  differ("ingest.wall_s", a.ingestWallSeconds != b.ingestWallSeconds);
  differ("ingest.at_once", a.ingestAtOnce != b.ingestAtOnce);
  differ("jobs.folder", a.jobsFolder != b.jobsFolder);
  differ("jobs.store", a.jobsStore != b.jobsStore);
  differ("jobs.out_folder", a.jobsOutFolder != b.jobsOutFolder);
  differ("jobs.workers", a.jobsWorkers != b.jobsWorkers);
  differ("jobs.lease_s", a.jobsLeaseSeconds != b.jobsLeaseSeconds);
  differ("jobs.checkpoint_s", a.jobsCheckpointSeconds != b.jobsCheckpointSeconds);
  differ("jobs.keep_bytes", a.jobsKeepBytes != b.jobsKeepBytes);
  differ("jobs.keep_days", a.jobsKeepDays != b.jobsKeepDays);
  differ("farm.workers", a.farmWorkers != b.farmWorkers);
  differ("farm.coordinator", a.farmCoordinator != b.farmCoordinator);
  differ("farm.name", a.farmName != b.farmName);
  differ("farm.folder", a.farmFolder != b.farmFolder);
  differ("farm.cache_bytes", a.farmCacheBytes != b.farmCacheBytes);
  differ("farm (tls, ca, cert, key, token_file)",
         a.farmTls != b.farmTls || a.farmCa != b.farmCa || a.farmCert != b.farmCert || a.farmKey != b.farmKey || a.farmTokenFile != b.farmTokenFile);
  differ("limits.request_bytes", a.requestBytes != b.requestBytes);
  differ("limits.connections", a.connections != b.connections);
  differ("limits.connections_per_peer", a.connectionsPerPeer != b.connectionsPerPeer);
  differ("limits.rpc_threads", a.rpcThreads != b.rpcThreads);
  differ("limits.streams_per_connection", a.streamsPerConnection != b.streamsPerConnection);
  differ("limits.message_bytes", a.messageBytes != b.messageBytes);
  differ("limits.rpc_memory_bytes", a.rpcMemoryBytes != b.rpcMemoryBytes);
  differ("limits.tmp_folder", a.tmpFolder != b.tmpFolder);
  differ("scheduler.running", a.running != b.running);
  differ("scheduler.queued_interactive", a.queuedInteractive != b.queuedInteractive);
  differ("scheduler.queued_normal", a.queuedNormal != b.queuedNormal);
  differ("scheduler.queued_batch", a.queuedBatch != b.queuedBatch);
  differ("scheduler.queued_per_client", a.queuedPerClient != b.queuedPerClient);
  differ("scheduler.ageing_normal_s", a.ageingNormal != b.ageingNormal);
  differ("scheduler.ageing_batch_s", a.ageingBatch != b.ageingBatch);
  differ("scheduler.pinned_bytes", a.pinnedBytes != b.pinnedBytes);
  return keys;
}

ServerConfig reloaded(const ServerConfig& running, const ServerConfig& next) {
  ServerConfig c = running;
  c.file = next.file;
  c.requireToken = next.requireToken;
  c.tokens = next.tokens;
  c.tls.cert = next.tls.cert;
  c.tls.key = next.tls.key;
  c.tls.clientCa = next.tls.clientCa;
  if (running.tls.on() != next.tls.on()) c.tls = running.tls;
  c.roots = next.roots;
  c.logLevel = next.logLevel;
  c.logFormat = next.logFormat;
  c.uploadBytes = next.uploadBytes;
  c.uploadsAtOnce = next.uploadsAtOnce;
  c.watches = next.watches;
  c.replyBytes = next.replyBytes;
  c.clientIdleSeconds = next.clientIdleSeconds;
  c.loadsAtOnce = next.loadsAtOnce;
  c.requestSeconds = next.requestSeconds;
  c.chunkBytes = next.chunkBytes;
  c.inlineBytes = next.inlineBytes;
  c.imageBytes = next.imageBytes;
  c.drainSeconds = next.drainSeconds;
  return c;
}

}  // namespace server
}  // namespace gobo
