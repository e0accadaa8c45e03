// SPDX-License-Identifier: Apache-2.0
#include "server/config.h"

#include <sys/stat.h>
#include <sys/un.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>

#include <toml++/toml.h>

#include "server/config_check.h"
#include "server/jobs/postgres.h"
#include "server/load_gate.h"
#include "server/machine_memory.h"

namespace gobo {
inline namespace server {
namespace {

namespace fs = std::filesystem;

constexpr char kNameLetters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";

using Key = std::function<Status(const toml::node&)>;  // errors hold the reason only; the caller adds file:line and key

std::string shown(const toml::node& node) {
  std::ostringstream out;
  node.visit([&](const auto& n) { out << n; });
  std::string text = out.str();
  return text.size() > 80 ? text.substr(0, 77) + "..." : text;
}

Status wrongType(const char* want, const toml::node& node) { return invalidArgument("= " + shown(node) + ": must be " + want); }

template <typename T>
Key integer(T& target, uint64_t low, uint64_t high) {
  return [&target, low, high](const toml::node& node) -> Status {
    const auto v = node.value_exact<int64_t>();
    if (!v) return wrongType("an integer", node);
    if (*v < 0 || uint64_t(*v) < low || uint64_t(*v) > high)
      return invalidArgument("= " + shown(node) + ": must be in " + std::to_string(low) + ".." + std::to_string(high));
    target = T(*v);
    return {};
  };
}

Key bytes(uint64_t& target) {
  return [&target](const toml::node& node) -> Status {
    if (const auto v = node.value_exact<int64_t>()) {
      if (*v < 0) return invalidArgument("= " + shown(node) + ": must not be negative");
      target = uint64_t(*v);
      return {};
    }
    const auto text = node.value_exact<std::string>();
    if (!text) return wrongType("a size: bytes as an integer, or a string such as \"4GiB\"", node);
    auto parsed = parseBytes(*text);
    if (!parsed.ok()) return invalidArgument("= " + shown(node) + ": " + parsed.status().message());
    target = *parsed;
    return {};
  };
}

Key mode(uint32_t& target) {
  return [&target](const toml::node& node) -> Status {
    const auto v = node.value_exact<std::string>();
    const bool octal = v && !v->empty() && v->size() <= 4 && v->find_first_not_of("01234567") == std::string::npos;
    const uint32_t bits = octal ? uint32_t(std::strtoul(v->c_str(), nullptr, 8)) : 01000u;
    if (bits > 0777) return wrongType("an octal file mode as a string, \"0600\" to \"0777\"", node);
    target = bits;
    return {};
  };
}

Key boolean(bool& target) {
  return [&target](const toml::node& node) -> Status {
    const auto v = node.value_exact<bool>();
    if (!v) return wrongType("true or false", node);
    target = *v;
    return {};
  };
}

Key number(double& target, double low, double high) {
  return [&target, low, high](const toml::node& node) -> Status {
    if (!node.is_number()) return wrongType("a number", node);
    const double v = *node.value<double>();
    if (!(v >= low && v <= high)) return invalidArgument("= " + shown(node) + ": must be in " + strf("%g..%g", low, high));
    target = v;
    return {};
  };
}

using Fix = std::function<std::string(const std::string&)>;

Key text(std::string& target, Fix fix = {}) {
  return [&target, fix](const toml::node& node) -> Status {
    const auto v = node.value_exact<std::string>();
    if (!v) return wrongType("a string", node);
    target = fix ? fix(*v) : *v;
    return {};
  };
}

Key texts(std::vector<std::string>& target, Fix fix = {}) {
  return [&target, fix](const toml::node& node) -> Status {
    const toml::array* array = node.as_array();
    if (!array) return wrongType("an array of strings", node);
    std::vector<std::string> values;
    for (const toml::node& item : *array) {
      const auto v = item.value_exact<std::string>();
      if (!v) return wrongType("an array of strings", node);
      values.push_back(fix ? fix(*v) : *v);
    }
    target = std::move(values);
    return {};
  };
}

Status readTable(const toml::table& table, const std::string& prefix, const std::string& file, const std::map<std::string, Key>& keys);

std::map<std::string, Key> tokenKeys(TokenConfig& t, std::vector<std::string>& roots, const Fix& folder) {
  return {{"tokens.name", text(t.name)},
          {"tokens.sha256", text(t.sha256)},
          {"tokens.classes", texts(t.classes)},
          {"tokens.requests_per_s", number(t.requestsPerSecond, 0, 1e6)},
          {"tokens.burst", integer(t.burst, 1, 1u << 20)},
          {"tokens.renders_at_once", integer(t.rendersAtOnce, 0, 1u << 20)},
          {"tokens.max_pixels", integer(t.maxPixels, 0, 1ull << 40)},
          {"tokens.max_spp", integer(t.maxSpp, 0, 1u << 20)},
          {"tokens.max_s", number(t.maxSeconds, 0, 86400)},
          {"tokens.upload_bytes", bytes(t.uploadBytes)},
          {"tokens.roots", texts(roots, folder)},
          {"tokens.admin", boolean(t.admin)},
          {"tokens.worker", boolean(t.worker)}};
}

Key tokens(std::vector<TokenConfig>& target, const Fix& folder, const std::string& file) {
  return [&target, folder, file](const toml::node& node) -> Status {
    const toml::array* array = node.as_array();
    if (!array || !array->is_array_of_tables()) return wrongType("tables, [[tokens]]", node);
    std::vector<TokenConfig> read;
    for (const toml::node& item : *array) {
      TokenConfig t;
      std::vector<std::string> roots;
      const Status status = readTable(*item.as_table(), "tokens", file, tokenKeys(t, roots, folder));
      if (!status.ok()) return {status.code(), status.message(), file};  // has its own line
      if (item.as_table()->contains("roots")) t.roots = std::move(roots);
      const std::string where = file + ":" + std::to_string(item.source().begin.line) + ": ";
      if (const Status checked = checkToken(t); !checked.ok()) return {checked.code(), where + checked.message(), file};
      read.push_back(std::move(t));
    }
    target = std::move(read);
    return {};
  };
}

std::map<std::string, Key> keysOf(ServerConfig& c, const Fix& folder, const Fix& address, const std::string& file) {
  const uint64_t big = 1u << 20;
  return {
      {"listen", texts(c.listen, address)},
      {"socket_mode", mode(c.socketMode)},
      {"auth.require_token", text(c.requireToken)},
      {"tls.cert", text(c.tls.cert, folder)},
      {"tls.key", text(c.tls.key, folder)},
      {"tls.client_ca", text(c.tls.clientCa, folder)},
      {"tls.require_client_cert", boolean(c.tls.requireClientCert)},
      {"http.listen", text(c.httpListen)},
      {"http.allow_remote", boolean(c.httpAllowRemote)},
      {"web.listen", text(c.webListen)},
      {"web.hosts", texts(c.webHosts)},
      {"color.ocio", text(c.colorOcio, [folder](const std::string& p) { return p == "none" || !folder ? p : folder(p); })},
      {"color.working_space", text(c.colorWorkingSpace)},
      {"log.format", text(c.logFormat)},
      {"limits.loads_at_once", integer(c.loadsAtOnce, 1, 1024)},
      {"limits.request_s", number(c.requestSeconds, 0, 86400)},
      {"tokens", tokens(c.tokens, folder, file)},
      {"allow_remote", boolean(c.allowRemote)},
      {"reflection", boolean(c.reflection)},
      {"log.level", text(c.logLevel)},
      {"engine.threads", integer(c.threads, 0, 1024)},
      {"engine.store_bytes", bytes(c.storeBytes)},
      {"engine.cache_folder", text(c.cacheFolder, folder)},
      {"engine.disk_bytes", bytes(c.diskBytes)},
      {"engine.roots", texts(c.roots, folder)},
      {"engine.keep_renders", integer(c.keepRenders, 1, 1u << 20)},
      {"engine.keep_renders_bytes", bytes(c.keepRendersBytes)},
      {"engine.memory_bytes", bytes(c.memoryBytes)},
      {"engine.scene_bytes", bytes(c.sceneBytes)},
      {"engine.environment_bytes", bytes(c.environmentBytes)},
      {"engine.accel_bytes", bytes(c.accelBytes)},
      {"limits.rpc_threads", integer(c.rpcThreads, 16, 65536)},
      {"limits.streams_per_connection", integer(c.streamsPerConnection, 1, 65536)},
      {"limits.message_bytes", bytes(c.messageBytes)},
      {"limits.rpc_memory_bytes", bytes(c.rpcMemoryBytes)},
      {"limits.upload_bytes", bytes(c.uploadBytes)},
      {"limits.uploads_at_once", integer(c.uploadsAtOnce, 1, 1024)},
      {"limits.request_bytes", bytes(c.requestBytes)},
      {"limits.watches", integer(c.watches, 2, 65536)},
      {"limits.reply_bytes", bytes(c.replyBytes)},
      {"limits.client_idle_s", number(c.clientIdleSeconds, 0.1, 86400)},
      {"limits.connections", integer(c.connections, 2, 1u << 20)},
      {"limits.connections_per_peer", integer(c.connectionsPerPeer, 1, 1u << 20)},
      {"limits.chunk_bytes", bytes(c.chunkBytes)},
      {"limits.inline_bytes", bytes(c.inlineBytes)},
      {"limits.image_bytes", bytes(c.imageBytes)},
      {"limits.tmp_folder", text(c.tmpFolder, folder)},
      {"blobs.folder", text(c.blobsFolder, folder)},
      {"blobs.bytes", bytes(c.blobsBytes)},
      {"ingest.program", text(c.ingestProgram, folder)},
      {"ingest.cache_folder", text(c.ingestCacheFolder, folder)},
      {"ingest.cache_bytes", bytes(c.ingestCacheBytes)},
      {"ingest.verify", text(c.ingestVerify)},
      {"ingest.memory_bytes", bytes(c.ingestMemoryBytes)},
      {"ingest.blob_bytes", bytes(c.ingestBlobBytes)},
      {"ingest.texture_bytes", bytes(c.ingestTextureBytes)},
      {"ingest.input_bytes", bytes(c.ingestInputBytes)},
      {"ingest.cpu_s", integer(c.ingestCpuSeconds, 1, 86400)},
      {"ingest.wall_s", number(c.ingestWallSeconds, 0.1, 86400)},
      {"ingest.at_once", integer(c.ingestAtOnce, 1, 64)},
      {"scheduler.running", integer(c.running, 1, 1024)},
      {"scheduler.queued_interactive", integer(c.queuedInteractive, 0, big)},
      {"scheduler.queued_normal", integer(c.queuedNormal, 0, big)},
      {"scheduler.queued_batch", integer(c.queuedBatch, 0, big)},
      {"scheduler.ageing_normal_s", number(c.ageingNormal, 0, 86400)},
      {"scheduler.ageing_batch_s", number(c.ageingBatch, 0, 86400)},
      {"scheduler.queued_per_client", integer(c.queuedPerClient, 1, big)},
      {"scheduler.pinned_bytes", bytes(c.pinnedBytes)},
      {"scheduler.drain_s", number(c.drainSeconds, 0, 86400)},
      {"jobs.folder", text(c.jobsFolder, folder)},
      {"jobs.store", text(c.jobsStore)},
      {"jobs.out_folder", text(c.jobsOutFolder, folder)},
      {"jobs.workers", integer(c.jobsWorkers, 0, 64)},
      {"jobs.lease_s", number(c.jobsLeaseSeconds, 1, 86400)},
      {"jobs.checkpoint_s", number(c.jobsCheckpointSeconds, 0.05, 86400)},
      {"jobs.keep_bytes", bytes(c.jobsKeepBytes)},
      {"jobs.keep_days", number(c.jobsKeepDays, 0, 36500)},
      {"farm.workers", integer(c.farmWorkers, 0, 1u << 16)},
      {"farm.coordinator", text(c.farmCoordinator, address)},
      {"farm.name", text(c.farmName)},
      {"farm.folder", text(c.farmFolder, folder)},
      {"farm.cache_bytes", bytes(c.farmCacheBytes)},
      {"farm.tls", boolean(c.farmTls)},
      {"farm.ca", text(c.farmCa, folder)},
      {"farm.cert", text(c.farmCert, folder)},
      {"farm.key", text(c.farmKey, folder)},
      {"farm.token_file", text(c.farmTokenFile, folder)},
  };
}

Status readTable(const toml::table& table, const std::string& prefix, const std::string& file, const std::map<std::string, Key>& keys) {
  for (const auto& [name, node] : table) {
    const std::string key = prefix.empty() ? std::string(name.str()) : prefix + "." + std::string(name.str());
    const std::string where = file + ":" + std::to_string(name.source().begin.line) + ": ";
    const auto it = keys.find(key);
    if (it != keys.end()) {
      const Status status = it->second(node);
      if (!status.ok() && !status.location().empty()) return invalidArgument(status.message());  // says its own place
      if (!status.ok()) return invalidArgument(where + key + " " + status.message());
      continue;
    }
    const auto group = keys.lower_bound(key + ".");
    const bool isGroup = group != keys.end() && group->first.compare(0, key.size() + 1, key + ".") == 0;
    if (!isGroup) return invalidArgument(where + "unknown key \"" + escaped(key) + "\"");
    if (!node.is_table()) return invalidArgument(where + key + " = " + shown(node) + ": must be a table, [" + key + "]");
    GOBO_TRY(readTable(*node.as_table(), key, file, keys));
  }
  return {};
}

}  // namespace

std::vector<std::string> configKeys() {
  ServerConfig c;
  TokenConfig t;
  std::vector<std::string> keys;
  for (const auto& [key, reader] : keysOf(c, {}, {}, ""))
    if (key != "tokens") keys.push_back(key);
  std::vector<std::string> roots;
  for (const auto& [key, reader] : tokenKeys(t, roots, {})) keys.push_back(key);
  return keys;
}

std::string defaultAddress() { return "unix:/tmp/gobo-" + std::to_string(::getuid()) + ".sock"; }

Result<uint64_t> parseBytes(const std::string& text) {
  static const std::map<std::string, uint64_t> units = {{"", 1},
                                                        {"B", 1},
                                                        {"KB", 1000},
                                                        {"MB", 1000000},
                                                        {"GB", 1000000000ull},
                                                        {"TB", 1000000000000ull},
                                                        {"KiB", 1ull << 10},
                                                        {"MiB", 1ull << 20},
                                                        {"GiB", 1ull << 30},
                                                        {"TiB", 1ull << 40}};
  size_t used = 0;
  while (used < text.size() && (std::isdigit(static_cast<unsigned char>(text[used])) || text[used] == '.')) ++used;
  size_t unitAt = used;
  while (unitAt < text.size() && text[unitAt] == ' ') ++unitAt;
  const auto unit = units.find(text.substr(unitAt));
  char* end = nullptr;
  const std::string digits = text.substr(0, used);
  const double value = std::strtod(digits.c_str(), &end);
  if (digits.empty() || *end != '\0' || unit == units.end())
    return invalidArgument("\"" + escaped(text) + "\" is not a size such as 1000, \"64MiB\" or \"4GiB\"");
  const double total = value * double(unit->second);
  if (!(total < 9.0e18)) return invalidArgument("\"" + escaped(text) + "\" is too large");
  return uint64_t(std::llround(total));
}

Status readConfig(const std::string& path, ServerConfig& config) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return notFound("cannot read configuration \"" + path + "\"");
  // What cannot be read is no empty file: at a reload that would be the end of every token. A folder opens, and stands where a container's mount found no file.
  std::error_code error;
  if (fs::is_directory(path, error)) return invalidArgument("configuration \"" + path + "\" is a folder: name the file");
  std::string content, piece(size_t(1) << 16, '\0');
  while (in.read(piece.data(), std::streamsize(piece.size())), in.gcount() > 0) content.append(piece, 0, size_t(in.gcount()));
  if (in.bad()) return Status(Code::Unavailable, "cannot read configuration \"" + path + "\"");
  const fs::path base = fs::absolute(path).parent_path();
  const Fix folder = [base](const std::string& p) { return p.empty() || fs::path(p).is_absolute() ? p : (base / p).lexically_normal().string(); };
  const Fix address = [folder](const std::string& a) { return a.rfind("unix:", 0) == 0 ? "unix:" + folder(a.substr(5)) : a; };
  try {
    const toml::table root = toml::parse(content, path);
    config.file = path;
    return readTable(root, "", path, keysOf(config, folder, address, path));
  } catch (const toml::parse_error& e) {
    return invalidArgument(path + ":" + std::to_string(e.source().begin.line) + ": " + std::string(e.description()));
  } catch (const std::exception& e) { return invalidArgument(path + ": " + e.what()); }
}

bool isLoopback(const std::string& host) {
  if (host == "localhost" || host == "::1") return true;
  unsigned a, b, c, d;
  char tail;
  return sscanf(host.c_str(), "%u.%u.%u.%u%c", &a, &b, &c, &d, &tail) == 4 && a == 127 && b < 256 && c < 256 && d < 256;
}

Result<Address> parseAddress(const std::string& text) {
  Address address;
  if (text.rfind("unix:", 0) == 0) {
    address.isUnix = true;
    address.path = text.substr(5);
    if (address.path.empty()) return invalidArgument("address \"unix:\" has no path");
    if (address.path.size() >= sizeof(sockaddr_un{}.sun_path))
      return invalidArgument("address \"" + escaped(text) + "\": a Unix socket path has at most " + std::to_string(sizeof(sockaddr_un{}.sun_path) - 1) +
                             " bytes");
    return address;
  }
  const size_t colon = text.rfind(':');
  if (colon == std::string::npos) return invalidArgument("address \"" + escaped(text) + "\" is neither unix:PATH nor HOST:PORT");
  address.host = text.substr(0, colon);
  address.port = text.substr(colon + 1);
  if (address.host.size() > 2 && address.host.front() == '[' && address.host.back() == ']') address.host = address.host.substr(1, address.host.size() - 2);
  const bool digits = !address.port.empty() && address.port.size() <= 5 && address.port.find_first_not_of("0123456789") == std::string::npos;
  if (address.host.empty() || !digits || std::atoi(address.port.c_str()) > 65535)
    return invalidArgument("address \"" + escaped(text) + "\" is neither unix:PATH nor HOST:PORT");
  return address;
}

uint64_t callsThatMayWait(const ServerConfig& c) {
  return uint64_t(c.running) + c.queuedInteractive + c.queuedNormal + c.queuedBatch + c.watches + c.farmWorkers + c.uploadsAtOnce + c.loadsAtOnce +
         LoadGate::kWaiting + Sessions::kWaiting;
}

/// What caches cannot have of engine.memory_bytes.
static uint64_t bytesThatStay(const ServerConfig& c) { return c.pinnedBytes + c.replyBytes + c.keepRendersBytes; }

static Status atLeast(const char* key, uint64_t value, uint64_t low) {
  if (value >= low) return {};
  return invalidArgument(std::string(key) + " = " + std::to_string(value) + ": must be at least " + std::to_string(low));
}

Status checkRelations(const ServerConfig& c) {
  // A chunk travels in a message with a few fields around it.
  constexpr uint64_t kAround = 65536;
  if (std::max(c.chunkBytes, c.inlineBytes) + kAround > c.messageBytes)
    return invalidArgument("limits.chunk_bytes = " + std::to_string(c.chunkBytes) + " and limits.inline_bytes = " + std::to_string(c.inlineBytes) +
                           " must be at least 64 KiB below limits.message_bytes = " + std::to_string(c.messageBytes));
  // Without spare ones a full queue would lock out status, cancellation and health checks.
  GOBO_TRY(atLeast(
      "limits.rpc_threads (16 more than scheduler.running, the three queues, limits.watches, farm.workers, uploads_at_once, loads_at_once and 96 together)",
      c.rpcThreads, callsThatMayWait(c) + 16));
  // Caches give way to what cannot; so that must have its place.
  if (c.memoryBytes != 0 && c.memoryBytes < bytesThatStay(c))
    return invalidArgument("engine.memory_bytes = " + std::to_string(c.memoryBytes) +
                           ": scheduler.pinned_bytes, limits.reply_bytes and engine.keep_renders_bytes, which do not give way, are " +
                           std::to_string(bytesThatStay(c)) + " together");
  return {};
}

Status checkConfig(ServerConfig& c) {
  // A worker serves nobody but its coordinator, unless it is told to.
  if (c.listen.empty() && c.farmCoordinator.empty()) c.listen.push_back(defaultAddress());
  GOBO_TRY(checkSecurity(c));
  GOBO_TRY(parseLogLevel(c.logLevel).status());
  GOBO_TRY(parseLogFormat(c.logFormat).status());
  GOBO_TRY(atLeast("engine.store_bytes", c.storeBytes, 1ull << 20));
  GOBO_TRY(atLeast("limits.message_bytes", c.messageBytes, 1ull << 20));
  GOBO_TRY(atLeast("limits.rpc_memory_bytes", c.rpcMemoryBytes, 64ull << 20));
  GOBO_TRY(atLeast("limits.chunk_bytes", c.chunkBytes, 4096));
  GOBO_TRY(atLeast("limits.request_bytes", c.requestBytes, 1ull << 20));
  GOBO_TRY(atLeast("limits.reply_bytes", c.replyBytes, 16ull << 20));
  GOBO_TRY(atLeast("engine.keep_renders_bytes", c.keepRendersBytes, 1ull << 20));
  GOBO_TRY(atLeast("engine.environment_bytes", c.environmentBytes, 1ull << 20));
  GOBO_TRY(atLeast("engine.accel_bytes", c.accelBytes, 1ull << 20));
  GOBO_TRY(atLeast("ingest.memory_bytes", c.ingestMemoryBytes, 64ull << 20));
  GOBO_TRY(atLeast("blobs.bytes", c.blobsBytes, 1ull << 20));
  GOBO_TRY(atLeast("ingest.blob_bytes", c.ingestBlobBytes, 1ull << 20));
  if (c.ingestVerify != "changed" && c.ingestVerify != "always")
    return invalidArgument("ingest.verify = \"" + escaped(c.ingestVerify) + "\": must be \"changed\" or \"always\"");
  for (const std::string& text : c.listen) GOBO_TRY(parseAddress(text).status());
  if (!c.jobsStore.empty()) {
    if (const Status uri = checkPostgresUri(c.jobsStore); !uri.ok()) return invalidArgument("jobs.store " + uri.message());  // never with the value
    if (c.jobsFolder.empty()) return invalidArgument("jobs.store is set, but not jobs.folder, which has the results and which the daemons share");
  }
  if (!c.jobsOutFolder.empty()) {
    if (c.jobsFolder.empty()) return invalidArgument("jobs.out_folder is set, but not jobs.folder: files of jobs are written where the jobs are");
    std::error_code missing;
    if (!fs::is_directory(c.jobsOutFolder, missing)) return notFound("jobs.out_folder: \"" + c.jobsOutFolder + "\" is not a folder");
  }
  if (!c.farmCoordinator.empty()) {
    GOBO_TRY(parseAddress(c.farmCoordinator).status().at("farm.coordinator"));
    if (!c.jobsFolder.empty()) return invalidArgument("farm.coordinator and jobs.folder are set: a worker has no queue of its own");
  }
  if (c.farmName.size() > 64 || c.farmName.find_first_not_of(kNameLetters) != std::string::npos)
    return invalidArgument("farm.name = \"" + escaped(c.farmName.substr(0, 80)) + "\": must be at most 64 letters, digits and ._-");
  if (c.ingestCacheFolder.empty() && !c.cacheFolder.empty()) c.ingestCacheFolder = c.cacheFolder + "/ingest";
  if (c.blobsFolder.empty() && !c.cacheFolder.empty()) c.blobsFolder = c.cacheFolder + "/blobs";
  for (const std::string& root : c.roots) {
    std::error_code error;
    if (!fs::is_directory(root, error)) return notFound("engine.roots: \"" + root + "\" is not a folder");
  }
  if (c.tmpFolder.empty()) {
    const char* env = std::getenv("TMPDIR");
    c.tmpFolder = env && *env ? env : "/tmp";
  }
  if (c.colorOcio.empty()) {
    const char* env = std::getenv("OCIO");
    c.colorOcio = env ? env : "";
  }
  std::error_code error;
  if (!fs::is_directory(c.tmpFolder, error)) return notFound("limits.tmp_folder: \"" + c.tmpFolder + "\" is not a folder");
  const uint64_t machine = machineMemory();
  if (c.pinnedBytes == 0) c.pinnedBytes = machine / 2;
  if (c.sceneBytes == 0) c.sceneBytes = machine / 4;
  if (c.memoryBytes == 0) c.memoryBytes = std::max(machine / 4 * 3, bytesThatStay(c));
  return checkRelations(c);
}

}  // namespace server
}  // namespace gobo
