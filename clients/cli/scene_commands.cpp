// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "commands.h"
#include "report.h"
#include "request/request.h"

namespace gobo::cli {
namespace {

// One unary call: prints the reply as JSON or through `print`.
template <typename Reply, typename Invoke, typename Print>
int unary(const SessionOptions& options, bool json, const Invoke& invoke, const Print& print) {
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  Reply reply;
  Status status;
  {
    Session::Call call(**session);
    status = (*session)->statusOf(invoke(**session, call.context, reply));
  }
  if (!status.ok()) return complain(status);
  if (json) std::printf("%s\n", messageToJson(reply, true).c_str());
  else print(reply);
  return kOk;
}

}  // namespace

int runScenes(const SessionOptions& options, bool json) {
  return unary<v1::ListScenesReply>(
      options, json, [](Session& s, grpc::ClientContext& context, v1::ListScenesReply& reply) { return s.scenes().List(&context, {}, &reply); },
      [](const v1::ListScenesReply& reply) {
        std::vector<std::vector<std::string>> rows;
        for (const v1::SceneInfo& i : reply.scenes())
          rows.push_back({escaped(i.id()), std::to_string(i.triangles()), std::to_string(i.lights_size()), bytesText(i.bytes()), escaped(i.source())});
        if (rows.empty()) std::printf("no scene is loaded\n");
        else printTable({"scene", "triangles", "lights", "bytes", "source"}, rows, {false, true, true, true, false});
        std::printf("built-in:");
        for (const std::string& name : reply.builtin()) std::printf(" %s", name.c_str());
        std::printf("\n");
      });
}

int runLoad(const SessionOptions& options, const std::string& source, const std::string& name, bool json) {
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  auto info = openScene(**session, source, name);
  if (!info.ok()) return complain(info.status());
  if (json) std::printf("%s\n", messageToJson(*info, true).c_str());
  else printScene(*info);
  return kOk;
}

int runInspect(const SessionOptions& options, const std::string& scene, bool json) {
  if (options.local) return runLoad(options, scene, "", json);  // nothing is loaded yet in this process
  return unary<v1::SceneInfo>(
      options, json,
      [&](Session& s, grpc::ClientContext& context, v1::SceneInfo& reply) {
        v1::InspectSceneRequest request;
        request.set_scene(scene);
        return s.scenes().Inspect(&context, request, &reply);
      },
      [](const v1::SceneInfo& reply) { printScene(reply); });
}

int runUnload(const SessionOptions& options, const std::string& scene) {
  return unary<v1::UnloadSceneReply>(
      options, false,
      [&](Session& s, grpc::ClientContext& context, v1::UnloadSceneReply& reply) {
        v1::UnloadSceneRequest request;
        request.set_scene(scene);
        return s.scenes().Unload(&context, request, &reply);
      },
      [&](const v1::UnloadSceneReply&) { std::printf("unloaded %s\n", escaped(scene).c_str()); });
}

int runWorkers(const SessionOptions& options, bool json) {
  return unary<v1::WorkersReply>(
      options, json, [](Session& s, grpc::ClientContext& context, v1::WorkersReply& reply) { return s.farm().Workers(&context, {}, &reply); },
      [](const v1::WorkersReply& reply) {
        std::vector<std::vector<std::string>> rows;
        for (const v1::Worker& w : reply.workers()) {
          std::string frames;
          for (const std::string& frame : w.frames()) frames += (frames.empty() ? "" : " ") + escaped(frame);
          rows.push_back({escaped(w.info().name()), w.attending() ? "attends" : "gone", std::to_string(w.info().threads()), std::to_string(w.done()),
                          std::to_string(w.failed()), escaped(w.peer()), frames});
        }
        if (rows.empty()) std::printf("no workers; gobod --worker ADDRESS is one (docs/farm.md)\n");
        else printTable({"worker", "state", "threads", "done", "failed", "from", "frames"}, rows, {false, false, true, true, true, false, false});
      });
}

int runStatus(const SessionOptions& options, bool json) {
  return unary<v1::StatusReply>(
      options, json, [](Session& s, grpc::ClientContext& context, v1::StatusReply& reply) { return s.admin().GetStatus(&context, {}, &reply); },
      [](const v1::StatusReply& reply) { printStatus(reply); });
}

int runDropCaches(const SessionOptions& options, bool disk) {
  return unary<v1::DropCachesReply>(
      options, false,
      [&](Session& s, grpc::ClientContext& context, v1::DropCachesReply& reply) {
        v1::DropCachesRequest request;
        request.set_disk(disk);
        return s.admin().DropCaches(&context, request, &reply);
      },
      [](const v1::DropCachesReply& reply) { std::printf("dropped %s\n", bytesText(reply.bytes()).c_str()); });
}

int runShutdown(const SessionOptions& options) {
  return unary<v1::ShutdownReply>(
      options, false, [](Session& s, grpc::ClientContext& context, v1::ShutdownReply& reply) { return s.admin().Shutdown(&context, {}, &reply); },
      [](const v1::ShutdownReply&) { std::printf("the server is draining\n"); });
}

}  // namespace gobo::cli
