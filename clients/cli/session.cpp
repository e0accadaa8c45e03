// SPDX-License-Identifier: Apache-2.0
#include "session.h"

#include "blobs.h"
#include "import/load.h"
#include "regress/child.h"

#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <set>
#include <thread>

#include <grpc/grpc.h>

#include "base/image_io.h"
#include "base/utf8.h"
#include "server/dial.h"
#include "server/encode.h"

namespace gobo::cli {

namespace fs = std::filesystem;

const char* const kExitHelp =
    "Exit codes: 0 ok; 1 failure; 2 usage or bad request; 3 not found; 4 cannot reach the server; 5 cancelled or deadline; "
    "6 busy (try again later).";

int exitCodeOf(const Status& status) {
  switch (status.code()) {
    case Code::Ok: return kOk;
    case Code::InvalidArgument:
    case Code::OutOfRange:
    case Code::PermissionDenied:
    case Code::Unauthenticated:
    case Code::AlreadyExists:
    case Code::Unimplemented:
    case Code::FailedPrecondition: return kUsage;
    case Code::NotFound: return kNotFound;
    case Code::Unavailable: return kUnreachable;
    case Code::Cancelled:
    case Code::DeadlineExceeded: return kStopped;
    case Code::ResourceExhausted: {
      const bool passing = status.message().find("retry after") != std::string::npos || status.message().find("Threadpool") != std::string::npos;
      return passing ? kBusy : kUsage;
    }
    default: return kFailure;
  }
}

namespace {

/// The system's words for a path that is not there, with the path.
Status namingFile(const Status& status) {
  const bool missing = status.code() == Code::NotFound && status.message().find("No such file or directory") != std::string::npos;
  if (!missing || status.location().empty()) return status;
  return notFound("no such file: \"" + status.location() + "\"");
}

/// The path that a server cannot open, out of what it says of it; empty: it speaks of something else.
std::string cannotOpen(const std::string& message) {
  const auto between = [&](const std::string& before, const std::string& after) -> std::string {
    const size_t end = message.rfind(after);
    if (message.rfind(before, 0) != 0 || end == std::string::npos || end < before.size()) return {};
    return message.substr(before.size(), end - before.size());
  };
  for (const auto& [before, after] :
       {std::pair("'", "' is not under an allowed root"), std::pair("no file '", "'"), std::pair("cannot open '", "': No such file")})
    if (std::string path = between(before, after); !path.empty()) return path;
  return {};
}

}  // namespace

int complain(const Status& said) {
  const Status status = namingFile(said);
  std::fprintf(stderr, "gobo: %s: %s%s%s%s\n", codeName(status.code()), escaped(status.message()).c_str(), status.location().empty() ? "" : " (at ",
               escaped(status.location()).c_str(), status.location().empty() ? "" : ")");
  return exitCodeOf(status);
}

namespace {

std::mutex callsMutex;
std::set<grpc::ClientContext*> calls;
bool interruptSeen = false;
int unfinished = 0;

}  // namespace

Unfinished::Unfinished() {
  const std::lock_guard lock(callsMutex);
  ++unfinished;
}
Unfinished::~Unfinished() {
  const std::lock_guard lock(callsMutex);
  --unfinished;
}

void watchInterrupts() {
  static sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::thread([] {
    for (;;) {
      int which = 0;
      if (sigwait(&signals, &which) != 0) continue;
      const std::lock_guard lock(callsMutex);
      // Nothing to cancel, or asked twice: leave. Output files are written by rename, so nothing half-written stays under its name.
      if (interruptSeen || (calls.empty() && unfinished == 0)) {
        endChildren();
        ::_exit(kStopped);
      }
      interruptSeen = true;
      for (grpc::ClientContext* context : calls) context->TryCancel();
    }
  }).detach();
}

bool interrupted() {
  const std::lock_guard lock(callsMutex);
  return interruptSeen;
}

Session::Call::Call(const Session& session) {
  constexpr double kMost = 1e8;  // over three years: none, which the clock's arithmetic could not hold
  if (session.options_.timeoutSeconds > 0 && session.options_.timeoutSeconds < kMost)
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::microseconds(int64_t(session.options_.timeoutSeconds * 1e6)));
  if (!session.token_.empty()) context.AddMetadata("authorization", "Bearer " + session.token_);
  const std::lock_guard lock(callsMutex);
  calls.insert(&context);
  if (interruptSeen) context.TryCancel();
}

Session::Call::~Call() {
  const std::lock_guard lock(callsMutex);
  calls.erase(&context);
}

Result<std::unique_ptr<Session>> Session::open(const SessionOptions& options) {
  static const bool kept = (grpc_init(), true);  // no tear-down of gRPC, which may take 10 s (server/server.cpp)
  (void)kept;
  std::unique_ptr<Session> self(new Session());
  self->options_ = options;
  if (options.local) {
    ServerConfig config;
    config.threads = options.threads;
    config.cacheFolder = options.cache;
    config.colorOcio = options.ocio;
    config.logLevel = "warn";
    setLogLevel(LogLevel::Warn);
    GOBO_TRY(checkConfig(config));
    config.blobsFolder.clear();  // nobody puts what may be opened; and the folder may be a daemon's
    EngineOptions engine = engineOptions(config);
    engine.roots = options.roots;
    engine.anyPath = true;
    engine.loader = inProcessLoader();  // the caller's own files: no sandbox, no blobs
    GOBO_ASSIGN(self->server_, Server::start(config, engine, false));
    self->address_ = "this process";
    self->channel_ = self->server_->inProcessChannel();
  } else {
    const char* env = std::getenv("GOBO_SERVER");
    const bool named = !options.server.empty() || (env && *env);
    self->address_ = !options.server.empty() ? options.server : named ? env : defaultAddress();
    GOBO_ASSIGN(const Address address, parseAddress(self->address_));
    struct stat info {};
    // The default socket lives in a folder where everybody may write: another user's socket is not our daemon.
    if (!named && address.isUnix && ::lstat(address.path.c_str(), &info) == 0 && info.st_uid != ::getuid() && info.st_uid != 0)
      return Status(Code::PermissionDenied, "\"" + address.path + "\" belongs to another user: name the server with --server");
    const char* token = std::getenv("GOBO_TOKEN");
    GOBO_ASSIGN(Dialled dialled, dial({self->address_, options.tls, options.ca, options.cert, options.key, options.tokenFile, token ? token : "", "--", "-"}));
    self->token_ = std::move(dialled.token);
    self->channel_ = std::move(dialled.channel);
  }
  self->scenes_ = v1::Scenes::NewStub(self->channel_);
  self->render_ = v1::Render::NewStub(self->channel_);
  self->blobs_ = v1::Blobs::NewStub(self->channel_);
  self->admin_ = v1::Admin::NewStub(self->channel_);
  self->jobs_ = v1::Jobs::NewStub(self->channel_);
  self->farm_ = v1::Farm::NewStub(self->channel_);
  return self;
}

Status Session::statusOf(const grpc::Status& status) const {
  if (status.ok()) return {};
  const Code code = Code(int(status.error_code()));
  if (code == Code::Unavailable && !local())
    return {code, "cannot reach gobod at " + address_ + ": " + status.error_message() +
                      "; start it with `gobod --root DIR`, name another with --server or GOBO_SERVER, or use --local"};
  if (code == Code::Cancelled && interrupted()) return {code, "interrupted"};
  if (code == Code::NotFound || code == Code::PermissionDenied) {
    std::error_code error;
    const std::string path = cannotOpen(status.error_message());
    if (!path.empty() && !fs::exists(path, error))
      return notFound("no such file: \"" + path + "\"" + (local() ? "" : ", neither here nor in a folder that the server may read"));
  }
  if (code == Code::Unimplemented && status.error_message().empty()) return {code, "the server does not know this call: it is another version"};
  return {code, status.error_message().empty() ? "no reason was given" : status.error_message()};
}

namespace {

Result<v1::SceneInfo> upload(Session& session, const std::string& file, const std::string& name) {
  std::ifstream in(file, std::ios::binary);
  if (!in) return notFound("cannot read \"" + file + "\"");
  const uint64_t total = fs::file_size(file);
  std::string piece(1 << 20, '\0');
  Sha256 sha;
  while (in.read(piece.data(), std::streamsize(piece.size())), in.gcount() > 0) sha.add(piece.data(), size_t(in.gcount()));
  const std::string digest = sha.hex();
  v1::UploadSceneRequest message;
  // The name is made from the content: the same file sent again is found under it instead of being sent.
  message.set_name(name.empty() ? fs::path(file).stem().string() + "-" + digest.substr(0, 12) : name);
  message.set_extension(fs::path(file).extension().string());
  message.set_total_bytes(total);
  message.set_sha256(digest);
  v1::SceneInfo info;
  if (name.empty()) {
    Session::Call call(session);
    v1::InspectSceneRequest inspect;
    inspect.set_scene(message.name());
    if (session.scenes().Inspect(&call.context, inspect, &info).ok()) return info;
  }
  std::fprintf(stderr, "gobo: uploading %s (%.1f MiB)\n", file.c_str(), double(total) / (1 << 20));
  Session::Call call(session);
  auto writer = session.scenes().Upload(&call.context, &info);
  in.clear();
  in.seekg(0);
  bool open = true;
  while (open && (in.read(piece.data(), std::streamsize(piece.size())), in.gcount() > 0)) {
    message.set_data(piece.data(), size_t(in.gcount()));
    open = writer->Write(message);
    message.Clear();
  }
  writer->WritesDone();
  GOBO_TRY(session.statusOf(writer->Finish()));
  return info;
}

}  // namespace

Result<v1::SceneInfo> openScene(Session& session, const std::string& source, const std::string& name) {
  if (!isUtf8(source)) return invalidArgument("the name of the scene is not UTF-8: \"" + cleanUtf8(source) + "\"");
  std::error_code error;
  const bool file = fs::is_regular_file(source, error);
  const std::string absolute = file ? fs::absolute(source).string() : source;
  v1::OpenSceneRequest request;
  request.set_source(isUtf8(absolute) ? absolute : source);
  request.set_name(name);
  v1::SceneInfo info;
  Status status(Code::NotFound, "the name of its folder is not UTF-8");  // no message can hold it, but the files may be sent
  if (isUtf8(absolute) || session.local()) {
    Session::Call call(session);
    status = session.statusOf(session.scenes().Open(&call.context, request, &info));
  }
  if (status.ok()) return info;
  const bool cannotSee = status.code() == Code::PermissionDenied || status.code() == Code::NotFound;
  if (!file || session.local() || !cannotSee) return status;
  GOBO_ASSIGN(const auto files, filesOf(source));
  double mib = 0;
  for (const auto& [part, blob] : files) mib += double(blob.bytes) / (1 << 20);
  if (mib > session.options().uploadMiB)
    return Status(status.code(), status.message() + strf("; not uploaded: %.0f MiB is more than --upload-limit %.0f", mib, session.options().uploadMiB));
  auto opened = openByDigest(session, source, files, name);
  return opened.status().code() == Code::Unimplemented ? upload(session, source, name) : opened;  // a server of before Blobs
}

Result<std::string> ensureScene(Session& session, const std::string& source) {
  std::error_code error;
  if (!fs::is_regular_file(source, error)) {
    if (!isUtf8(source)) return notFound("no such file: \"" + cleanUtf8(source) + "\"");
    const std::string extension = fs::path(source).extension().string();
    if (source.find('/') == std::string::npos && extension != ".gltf" && extension != ".glb") return source;
    // It looks like a file, but may be the id of a scene that the server has.
    v1::InspectSceneRequest ref;
    ref.set_scene(source);
    v1::SceneInfo info;
    Session::Call call(session);
    const Status known = session.statusOf(session.scenes().Inspect(&call.context, ref, &info));
    if (known.code() != Code::NotFound) return source;
    return notFound(fs::is_directory(source, error) ? "\"" + source + "\" is a folder: name the .gltf or .glb file in it" : "no such file: \"" + source + "\"");
  }
  GOBO_ASSIGN(const v1::SceneInfo info, openScene(session, source, ""));
  return info.id();
}

}  // namespace gobo::cli
