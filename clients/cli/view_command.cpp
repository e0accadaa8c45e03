// SPDX-License-Identifier: Apache-2.0
// gobo view: the viewer in a browser, in front of whatever renders: the daemon, or this process where there is none.
#include <cstdio>
#include <thread>

#include "base/status.h"
#include "commands.h"
#include "server/door/door.h"
#include "server/random_hex.h"

namespace gobo::cli {

namespace {

/// As URLSearchParams of the page reads it.
std::string inFragment(const std::string& text) {
  std::string out;
  for (const unsigned char c : text) {
    char escape[4];
    std::snprintf(escape, sizeof escape, "%%%02X", unsigned(c));
    const bool plain = (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '-' || c == '_' || c == '.' || c == '~';
    out += plain ? std::string(1, char(c)) : std::string(escape);
  }
  return out;
}

bool answers(Session& session) {
  Session::Call call(session);
  call.context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(2));
  v1::StatusReply reply;
  return session.admin().GetStatus(&call.context, {}, &reply).error_code() != grpc::StatusCode::UNAVAILABLE;
}

Result<std::unique_ptr<Session>> findServer(SessionOptions options) {
  const char* env = std::getenv("GOBO_SERVER");
  const bool named = !options.server.empty() || (env && *env);
  if (!options.local && !named) {
    auto session = Session::open(options);
    if (session.ok() && answers(**session)) return session;
    options.local = true;
  }
  return Session::open(options);
}

/// That the page will find the scene: it stays open, so that nothing would end where there is none.
Status checkScene(Session& session, const std::string& id) {
  v1::InspectSceneRequest request;
  request.set_scene(id);
  v1::SceneInfo info;
  Status known;
  {
    Session::Call call(session);
    known = session.statusOf(session.scenes().Inspect(&call.context, request, &info));
  }
  if (known.code() != Code::NotFound) return known;
  return openScene(session, id, "").ok() ? Status() : known;  // a built-in one that was unloaded comes back, as it does for the page
}

}  // namespace

int runView(const SessionOptions& options, const ViewCommand& command) {
  auto opened = findServer(options);
  if (!opened.ok()) return complain(opened.status());
  Session& session = **opened;
  std::string id;
  if (!command.scene.empty()) {
    auto scene = ensureScene(session, command.scene);
    if (!scene.ok()) return complain(scene.status());
    id = *scene;
    if (const Status there = checkScene(session, id); !there.ok()) return complain(there);
  }
  // Whoever may read this terminal may look; other users of this machine may not.
  const auto secret = randomHex(16);
  if (!secret) return complain(Status(Code::Unavailable, "the kernel gives no random bytes for the page's token"));
  DoorOptions door;
  door.listen = command.listen;
  door.channel = session.channel();
  door.secret = *secret;
  if (!session.token().empty()) door.authorization = "Bearer " + session.token();
  if (const auto address = parseAddress(door.listen); address.ok() && !address->isUnix && !isLoopback(address->host))
    return complain(invalidArgument("--listen " + command.listen + ": must be a loopback address; for others there is gobod --web with TLS and tokens"));
  auto started = Door::start(std::move(door));
  if (!started.ok()) return complain(started.status());
  std::string fragment = "token=" + *secret;
  if (!id.empty()) fragment += "&scene=" + inFragment(id);
  std::printf("http://%s/#%s\n", (*started)->address().c_str(), fragment.c_str());
  std::fflush(stdout);
  std::fprintf(stderr, "%s; Ctrl-C ends it\n", session.local() ? "rendering in this process (no daemon is running)" : "rendering in the daemon");
  const Session::Call until(session);  // Ctrl-C ends the wait, not the process
  while (!interrupted()) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  return kOk;
}

}  // namespace gobo::cli
