// SPDX-License-Identifier: Apache-2.0
#include "server/server.h"

#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include <grpc/grpc.h>
#include <grpc/support/log.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/impl/server_builder_option.h>
#include <grpcpp/impl/server_builder_plugin.h>
#include <grpcpp/resource_quota.h>

#include "plan/display_transforms.h"
#include "server/admin_service.h"
#include "server/blobs_service.h"
#include "server/config_check.h"
#include "server/farm/farm_service.h"
#include "server/farm/farm_worker.h"
#include "server/file_store.h"
#include "server/ingest_loader.h"
#include "server/jobs/jobs_service.h"
#include "server/render_service.h"
#include "server/scenes_service.h"

namespace gobo {
inline namespace server {

struct Server::Services {
  explicit Services(ServerCore& core) : scenes(core), render(core), blobs(core), admin(core), jobs(core), farm(core) {}
  ScenesService scenes;
  RenderService render;
  BlobsService blobs;
  AdminService admin;
  JobsService jobs;
  farm::FarmService farm;
};

namespace {

/// Descriptors that files, pipes to readers and gRPC itself need beside connections.
constexpr uint64_t kOtherDescriptors = 256;

uint32_t connectionsFor(const ServerConfig& config) {
  rlimit files{};
  if (::getrlimit(RLIMIT_NOFILE, &files) != 0) return config.connections;
  const uint64_t most = files.rlim_cur > 2 * kOtherDescriptors ? uint64_t(files.rlim_cur) - kOtherDescriptors : uint64_t(files.rlim_cur) / 2;
  if (most >= config.connections) return config.connections;
  logWarn("limits.connections = %u: %llu are taken, as this process may have %llu descriptors (LimitNOFILE, ulimit -n)", config.connections,
          (unsigned long long)most, (unsigned long long)files.rlim_cur);
  return uint32_t(most);
}

const char* const kServiceNames[] = {"gobo.v1.Scenes", "gobo.v1.Render", "gobo.v1.Blobs", "gobo.v1.Admin", "gobo.v1.Jobs", "gobo.v1.Farm"};

// Linking gRPC's reflection library installs it in every server; this takes it out again unless it is asked for.
class NoReflection final : public grpc::ServerBuilderOption {
 public:
  void UpdateArguments(grpc::ChannelArguments*) override {}
  void UpdatePlugins(std::vector<std::unique_ptr<grpc::ServerBuilderPlugin>>* plugins) override {
    std::erase_if(*plugins, [](const auto& plugin) { return plugin->name() == "proto_server_reflection"; });
  }
};

}  // namespace

std::shared_ptr<DisplayTransforms> displayTransforms(const ServerConfig& config) {
  DisplayTransforms::Options options;
  if (config.colorOcio != "none") options.file = config.colorOcio;
  options.workingSpace = config.colorWorkingSpace;
  options.say = [](const std::string& line) { logWarn("%s", line.c_str()); };
  return std::make_shared<DisplayTransforms>(std::move(options));
}

EngineOptions engineOptions(const ServerConfig& config) {
  EngineOptions options;
  options.threads = config.threads;
  options.storeBytes = config.storeBytes;
  options.cacheFolder = config.cacheFolder;
  options.say = [](const std::string& line) { logWarn("%s", line.c_str()); };
  options.diskBytes = config.diskBytes;
  options.roots = config.roots;
  options.keepRenders = config.keepRenders;
  options.keepRendersBytes = config.keepRendersBytes;
  if (config.sceneBytes) options.sceneBytes = config.sceneBytes;
  options.environmentBytes = config.environmentBytes;
  options.accelBytes = config.accelBytes;
  if (config.memoryBytes) options.memoryBytes = config.memoryBytes;
  options.displays = displayTransforms(config);
  return options;
}

Result<std::shared_ptr<SceneLoader>> sceneLoader(const ServerConfig& c) {
  IngestOptions o;
  o.program = c.ingestProgram;
  o.cacheFolder = c.ingestCacheFolder;
  o.cacheBytes = c.ingestCacheBytes;
  o.verifyAlways = c.ingestVerify == "always";
  o.memoryBytes = c.ingestMemoryBytes;
  o.blobBytes = c.ingestBlobBytes;
  o.textureBytes = c.ingestTextureBytes;
  o.inputBytes = c.ingestInputBytes;
  o.cpuSeconds = c.ingestCpuSeconds;
  o.wallSeconds = c.ingestWallSeconds;
  o.atOnce = c.ingestAtOnce;
  return childLoader(o);
}

static Result<std::shared_ptr<FileStore>> fileStore(const ServerConfig& c) {
  FileStoreOptions options{c.blobsFolder, c.tmpFolder, c.blobsBytes};
  auto store = FileStore::open(options);
  if (store.ok() || store.status().code() == Code::FailedPrecondition) return store;  // not: whose files cannot be believed
  logWarn("%s; what clients put is kept in %s until the end (blobs.folder)", store.status().toString().c_str(), c.tmpFolder.c_str());
  options.folder.clear();
  return FileStore::open(options);
}

Result<std::unique_ptr<Server>> Server::start(const ServerConfig& config, const EngineOptions& wanted, bool sockets) {
  // gRPC stays up until the process ends: its own tear-down waits for a client's poller, for up to 10 s (1.51).
  // Its own messages (failed handshakes, mostly) become lines of our log.
  static const bool kept =
      (gpr_set_log_function([](gpr_log_func_args* args) {
         logEvent(args->severity == GPR_LOG_SEVERITY_ERROR ? LogLevel::Warn : LogLevel::Debug, "grpc", {{"message", args->message ? args->message : ""}});
       }),
       grpc_init(), true);
  (void)kept;
  std::unique_ptr<Server> self(new Server());
  EngineOptions options = wanted;
  if (!options.loader) { GOBO_ASSIGN(options.loader, sceneLoader(config)); }
  if (sockets && options.displays) GOBO_TRY(options.displays->load());  // a daemon says now what it cannot read; a client when something wants it
  auto engine = Engine::create(options);
  if (!engine.ok() && !options.cacheFolder.empty() && engine.status().code() != Code::FailedPrecondition) {  // not: whose terms cannot be believed
    logWarn("%s; terms are kept in memory only (engine.cache_folder)", engine.status().toString().c_str());
    options.cacheFolder.clear();
    engine = Engine::create(options);
  }
  if (!engine.ok()) return engine.status();
  self->engine_ = std::move(*engine);
  self->core_ = std::make_unique<ServerCore>(*self->engine_, config);
  GOBO_ASSIGN(self->core_->files, fileStore(config));
  if (!config.jobsFolder.empty()) {
    GOBO_ASSIGN(self->jobs_, DurableJobs::start(*self->engine_, self->core_->jobs, config));
    self->core_->durable = self->jobs_.get();
  }
  self->services_ = std::make_unique<Services>(*self->core_);

  grpc::EnableDefaultHealthCheckService(true);
  grpc::ServerBuilder builder;
  grpc::ResourceQuota quota("gobod");
  quota.Resize(config.rpcMemoryBytes);
  // Beside the handlers gRPC needs a few pollers of its own; without a free thread a call is refused (RESOURCE_EXHAUSTED).
  quota.SetMaxThreads(int(config.rpcThreads) + 4);
  builder.SetResourceQuota(quota);
  builder.SetSyncServerOption(grpc::ServerBuilder::NUM_CQS, 1);
  builder.SetSyncServerOption(grpc::ServerBuilder::MIN_POLLERS, 1);
  builder.SetSyncServerOption(grpc::ServerBuilder::MAX_POLLERS, 2);
  builder.SetMaxReceiveMessageSize(int(std::min<uint64_t>({config.requestBytes, config.messageBytes, INT32_MAX})));
  builder.SetMaxSendMessageSize(int(std::min<uint64_t>(config.messageBytes, INT32_MAX)));
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, int(config.streamsPerConnection));
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, 30000);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 10000);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 10000);
  builder.AddChannelArgument(GRPC_ARG_MAX_METADATA_SIZE, 16384);
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, 10000);  // of TLS and HTTP/2 together
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS, 600000);      // clients connect again by themselves
  if (!config.reflection) builder.SetOption(std::make_unique<NoReflection>());
  builder.RegisterService(&self->services_->scenes);
  builder.RegisterService(&self->services_->render);
  builder.RegisterService(&self->services_->blobs);
  builder.RegisterService(&self->services_->admin);
  builder.RegisterService(&self->services_->jobs);
  builder.RegisterService(&self->services_->farm);

  if (sockets && config.tls.on()) {
    GOBO_ASSIGN(TlsFiles files, readTls(config.tls));
    self->tls_ = std::make_shared<TlsSource>(std::move(files), config.tls.requireClientCert);
    self->core_->metrics.collect([tls = self->tls_](MetricsWriter& out) {
      out.family("gobo_tls_expires_seconds", "gauge", "Unix time at which the server's certificate ends.");
      out.sample("gobo_tls_expires_seconds", {}, double(tls->expires()));
    });
  }
  std::vector<bool> isUnix;
  if (sockets) {
    self->listener_ = std::make_unique<Listener>(ListenerLimits{connectionsFor(config), config.connectionsPerPeer});
    for (const std::string& text : config.listen) {
      GOBO_ASSIGN(const Address address, parseAddress(text));
      isUnix.push_back(address.isUnix);
      if (address.isUnix) {
        GOBO_ASSIGN(SocketLock lock, SocketLock::take(address.path));
        self->locks_.push_back(std::move(lock));
        GOBO_TRY(claimSocketPath(address.path));
      }
      GOBO_ASSIGN(const std::string served, self->listener_->add(text));
      if (address.isUnix) self->socketFiles_.push_back(address.path);
      self->addresses_.push_back(served);
    }
  }
  using Acceptor = grpc::experimental::ExternalConnectionAcceptor;
  using FromFd = grpc::ServerBuilder::experimental_type::ExternalConnectionType;
  const auto acceptor = [&](std::shared_ptr<grpc::ServerCredentials> credentials) {
    return std::shared_ptr<Acceptor>(builder.experimental().AddExternalConnectionAcceptor(FromFd::FROM_FD, std::move(credentials)));
  };
  const std::shared_ptr<Acceptor> plain = sockets ? acceptor(grpc::InsecureServerCredentials()) : nullptr;
  const std::shared_ptr<Acceptor> secure = sockets && self->tls_ ? acceptor(self->tls_->credentials()) : plain;
  self->server_ = builder.BuildAndStart();
  if (!self->server_) return Status(Code::Unavailable, "cannot start the gRPC server");
  for (const std::string& path : self->socketFiles_)
    if (::chmod(path.c_str(), mode_t(config.socketMode)) != 0) return Status(Code::Unavailable, "chmod \"" + path + "\": " + std::strerror(errno));
  if (self->listener_) {
    self->listener_->start([plain, secure, isUnix](int fd, size_t socket) {
      Acceptor::NewConnectionParameters connection;
      connection.fd = fd;
      (isUnix[socket] ? plain : secure)->HandleNewConnection(&connection);
    });
    self->core_->reachable = [listener = self->listener_.get(), n = config.listen.size()](double seconds) {
      for (size_t i = 0; i < n; ++i)
        if (!listener->reachable(i, seconds)) return false;
      return true;
    };
    self->core_->metrics.collect([listener = self->listener_.get()](MetricsWriter& out) {
      const ListenerStats s = listener->stats();
      const auto one = [&](const char* name, const char* type, const char* help, double value) {
        out.family(name, type, help);
        out.sample(name, {}, value);
      };
      one("gobo_connections", "gauge", "Open connections.", s.open);
      one("gobo_connections_total", "counter", "Connections that were taken.", double(s.accepted));
      one("gobo_connections_refused_total", "counter", "Connections closed at once (limits.connections, connections_per_peer).", double(s.refused));
      one("gobo_connections_evicted_total", "counter", "Connections that never sent a byte and had to go for others.", double(s.evicted));
      one("gobo_descriptors_missing_total", "counter", "Connections closed because the process had no descriptor left.", double(s.noDescriptor));
    });
  }
  if (sockets && !config.httpListen.empty()) { GOBO_ASSIGN(self->http_, HttpEndpoint::start(*self->core_, config.httpListen)); }
  if (sockets && !config.webListen.empty()) {
    DoorOptions door;
    door.listen = config.webListen;
    door.channel = self->inProcessChannel();
    door.tellsPeer = true;
    door.hosts = config.webHosts;
    door.requestBytes = config.requestBytes;
    door.sceneBytes = [core = self->core_.get()] { return core->live()->uploadBytes; };
    door.nameOf = [core = self->core_.get()](const std::string& authorization) { return core->tokens.nameOf(authorization); };
    if (config.tls.on()) {
      GOBO_ASSIGN(TlsFiles files, readTls(config.tls));
      door.cert = files.cert;
      door.key = files.key;
    }
    auto opened = Door::start(std::move(door));
    if (!opened.ok()) return Status(opened.status().code(), "web.listen: " + opened.status().message());
    self->door_ = std::move(*opened);
  }
  if (!config.farmCoordinator.empty()) { GOBO_ASSIGN(self->worker_, farm::FarmWorker::start(*self->engine_, self->core_->jobs, config)); }
  self->setServing(true);
  self->core_->onDrain = [raw = self.get()] { raw->setServing(false); };
  return self;
}

void Server::setServing(bool serving) {
  auto* health = server_ ? server_->GetHealthCheckService() : nullptr;
  if (!health) return;
  health->SetServingStatus(serving);
  for (const char* name : kServiceNames) health->SetServingStatus(name, serving);
}

Result<std::vector<std::string>> Server::reload(const ServerConfig& next) {
  const ServerConfig running = *core_->live();
  const ServerConfig config = reloaded(running, next);
  const auto failed = [&](const Status& status) {
    core_->metrics.add("gobo_reloads_total", {{"result", "failed"}});
    return status;
  };
  // What was refused at the start stays refused: the addresses are those of the start.
  if (Status safe = checkSecurity(config); !safe.ok()) return failed(safe);
  GOBO_ASSIGN(const LogLevel level, parseLogLevel(config.logLevel));
  GOBO_ASSIGN(const LogFormat format, parseLogFormat(config.logFormat));
  if (const Status fits = checkRelations(config); !fits.ok())  // the file agrees with itself, but what of it waits for a restart is as at the start
    return failed(Status(fits.code(), fits.message() + "; keys that a reload does not change are as at the start"));
  if (tls_) {
    auto files = readTls(config.tls);
    if (!files.ok()) return failed(files.status());
    if (door_)
      if (Status renewed = door_->setCertificate(files->cert, files->key); !renewed.ok())
        return failed(Status(renewed.code(), "web.listen: " + renewed.message()));
    tls_->set(std::move(*files));
  }
  core_->engine.setRoots(config.roots);
  setLogLevel(level);
  setLogFormat(format);
  core_->setLive(config);
  core_->metrics.add("gobo_reloads_total", {{"result", "ok"}});
  return fixedKeysThatDiffer(core_->config, next);
}

std::shared_ptr<grpc::Channel> Server::inProcessChannel() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);
  return server_->InProcessChannel(arguments);
}

void Server::shutdown(double drainSeconds) {
  if (!server_) return;
  core_->drain();  // health says so first
  if (worker_) worker_->stop();
  if (jobs_) jobs_->stop();  // their frames go on after the next start: nobody needs to wait for them
  if (!core_->waitIdle(drainSeconds)) {
    logWarn("%zu calls still run after %.1f s: cancelling them", core_->running(), drainSeconds);
    core_->cancelAll();
    core_->waitIdle(10);
  }
  door_.reset();
  http_.reset();
  core_->reachable = nullptr;
  if (listener_) listener_->stop();
  server_->Shutdown(std::chrono::system_clock::now() + std::chrono::milliseconds(500));
  server_->Wait();
  server_.reset();
  for (const std::string& path : socketFiles_) ::unlink(path.c_str());
  socketFiles_.clear();
  locks_.clear();
}

Server::Server() = default;
Server::~Server() { shutdown(0); }

}  // namespace server
}  // namespace gobo
