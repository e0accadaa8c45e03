// SPDX-License-Identifier: Apache-2.0
// Session: the CLI's connection: a daemon over its socket, or with --local the same services inside this process over an
// in-process channel. Also Ctrl-C (cancels the running call) and the exit codes. One thread but for the signal thread.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "base/status.h"
#include "gobo/v1/farm.grpc.pb.h"
#include "gobo/v1/jobs.grpc.pb.h"
#include "gobo/v1/service.grpc.pb.h"
#include "server/server.h"

namespace gobo::cli {

enum Exit : int { kOk = 0, kFailure = 1, kUsage = 2, kNotFound = 3, kUnreachable = 4, kStopped = 5, kBusy = 6 };
extern const char* const kExitHelp;
/// 6 only for what may pass: RESOURCE_EXHAUSTED that is a limit of the request itself is 2.
int exitCodeOf(const Status& status);
/// Prints "gobo: MESSAGE" with a hint where one helps; returns the exit code.
int complain(const Status& status);

struct SessionOptions {
  std::string server;  ///< empty: $GOBO_SERVER, else the default socket
  bool local = false;
  std::vector<std::string> roots;  ///< of --local, on top of any path
  std::string cache;
  int threads = 0;
  std::string ocio;           ///< of --local; empty: $OCIO
  double timeoutSeconds = 0;  ///< of each call; 0: none
  double uploadMiB = 512;     ///< most that is sent for one scene without being asked for
  std::string tokenFile;      ///< first line: bearer token; empty: $GOBO_TOKEN
  bool tls = false;           ///< with the system's certificates unless `ca` names others
  std::string ca, cert, key;  ///< PEM files; any of them switches TLS on
};

class Session {
 public:
  static Result<std::unique_ptr<Session>> open(const SessionOptions& options);
  bool local() const { return server_ != nullptr; }
  const SessionOptions& options() const { return options_; }
  v1::Scenes::Stub& scenes() { return *scenes_; }
  v1::Render::Stub& render() { return *render_; }
  v1::Blobs::Stub& blobs() { return *blobs_; }
  v1::Admin::Stub& admin() { return *admin_; }
  v1::Jobs::Stub& jobs() { return *jobs_; }
  v1::Farm::Stub& farm() { return *farm_; }
  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }
  const std::string& address() const { return address_; }  ///< as the user has it; "this process"
  const std::string& token() const { return token_; }      ///< empty: none
  /// gRPC's status as ours; "cannot reach" with the address when there is no connection.
  Status statusOf(const grpc::Status& status) const;

  /// The context of one call: has the timeout, and Ctrl-C cancels it while it lives.
  class Call {
   public:
    explicit Call(const Session& session);
    ~Call();
    Call(const Call&) = delete;
    Call& operator=(const Call&) = delete;
    grpc::ClientContext context;
  };

 private:
  SessionOptions options_;
  std::string address_, token_;
  std::unique_ptr<Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::Scenes::Stub> scenes_;
  std::unique_ptr<v1::Render::Stub> render_;
  std::unique_ptr<v1::Blobs::Stub> blobs_;
  std::unique_ptr<v1::Admin::Stub> admin_;
  std::unique_ptr<v1::Jobs::Stub> jobs_;
  std::unique_ptr<v1::Farm::Stub> farm_;
};

/// Starts the thread that turns SIGINT and SIGTERM into cancellation; call first in main. A second signal leaves at once, and ends the
/// children (regress/child.h).
void watchInterrupts();
bool interrupted();
/// While one lives the first interrupt does not end the program between two calls: the next call is cancelled, and what is half done cleans up after itself.
struct Unfinished {
  Unfinished();
  ~Unfinished();
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;
};

/// The id of the scene that the user means by `source`: a file here is opened by the server, or sent with the files that it names when the server
/// cannot open it and they are small enough (says so on stderr); anything else is taken as an id or built-in name.
Result<std::string> ensureScene(Session& session, const std::string& source);
Result<v1::SceneInfo> openScene(Session& session, const std::string& source, const std::string& name);

}  // namespace gobo::cli
