// SPDX-License-Identifier: Apache-2.0
// What the protocol costs: a 640 x 480 raw float picture that the store already holds, from call to last byte checked, over a
// Unix socket, loopback TCP and the in-process channel, beside the engine called directly. Warm renders, median of N.
// Usage: socket_bench [--out table.json] [--spp 4] [--repeat 40]
#include <stdlib.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>

#include "measure/report.h"
#include "server/encode.h"
#include "server/server.h"

#include "gobo/v1/service.grpc.pb.h"

namespace {

using namespace gobo;
using Clock = std::chrono::steady_clock;
double msSince(Clock::time_point t) { return std::chrono::duration<double, std::milli>(Clock::now() - t).count(); }
double median(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  return v[v.size() / 2];
}

struct Timing {
  double wall = 0, server = 0, bytes = 0;
};

// One call; wall time to the last byte, optionally with the client's own digest check.
Timing once(v1::Render::Stub& stub, const v1::RenderRequest& request) {
  const auto begun = Clock::now();
  grpc::ClientContext context;
  auto reader = stub.Render(&context, request);
  v1::RenderEvent event;
  Timing t;
  std::string bytes;
  while (reader->Read(&event)) {
    if (event.has_reply()) {
      t.server = event.reply().total_ms();
      bytes.reserve(event.reply().images(0).bytes());
    }
    if (event.has_chunk()) bytes += event.chunk().data();
  }
  const grpc::Status status = reader->Finish();
  t.wall = msSince(begun);
  t.bytes = double(bytes.size());
  if (!status.ok()) {
    std::fprintf(stderr, "socket_bench: %s\n", status.error_message().c_str());
    std::exit(1);
  }
  return t;
}

}  // namespace

int main(int argc, char** argv) {
  const int repeat = std::max(1, std::atoi(argumentOr(argc, argv, "--repeat", "40").c_str()));
  std::string folder = (std::filesystem::temp_directory_path() / "gobo-bench-XXXXXX").string();
  if (!::mkdtemp(folder.data())) return 1;
  setLogLevel(LogLevel::Off);
  ServerConfig config;
  config.listen = {"unix:" + folder + "/s.sock", "127.0.0.1:0"};
  if (!checkConfig(config).ok()) return 1;
  auto server = Server::start(config, engineOptions(config), true);
  if (!server.ok()) {
    std::fprintf(stderr, "socket_bench: %s\n", server.status().toString().c_str());
    return 1;
  }
  v1::RenderRequest request;
  request.set_scene("cornell");
  request.set_width(640);
  request.set_height(480);
  request.mutable_halt()->set_spp(uint32_t(std::max(1, std::atoi(argumentOr(argc, argv, "--spp", "4").c_str()))));
  request.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);

  Table table("socket", {"path", "wall ms", "server ms", "overhead ms", "MB/s of overhead"});
  std::vector<double> engineMs, encodeMs;
  for (int i = 0; i < repeat + 1; ++i) {  // the first fills the store
    const auto begun = Clock::now();
    auto result = (*server)->core().engine.render(request);
    if (!result.ok()) {
      std::fprintf(stderr, "socket_bench: %s\n", result.status().toString().c_str());
      return 1;
    }
    const double rendered = msSince(begun);
    const auto encodeBegun = Clock::now();
    auto images = encodeImages(*result);
    if (!images.ok()) return 1;
    if (i == 0) continue;
    engineMs.push_back(rendered);
    encodeMs.push_back(msSince(encodeBegun));
  }
  table.add({std::string("engine, no server"), median(engineMs), median(engineMs), 0.0, 0.0});
  table.add({std::string("encode + digest "), median(encodeMs), 0.0, median(encodeMs), 640.0 * 480 * 12 / 1e3 / median(encodeMs)});
  const std::vector<std::pair<std::string, std::shared_ptr<grpc::Channel>>> paths = {
      {"unix socket", grpc::CreateChannel((*server)->addresses()[0], grpc::InsecureChannelCredentials())},
      {"loopback TCP", grpc::CreateChannel((*server)->addresses()[1], grpc::InsecureChannelCredentials())},
      {"in process", (*server)->inProcessChannel()}};
  for (const auto& [name, channel] : paths) {
    auto stub = v1::Render::NewStub(channel);
    once(*stub, request);
    std::vector<double> wall, inside, over;
    double bytes = 0;
    for (int i = 0; i < repeat; ++i) {
      const Timing t = once(*stub, request);
      wall.push_back(t.wall);
      inside.push_back(t.server);
      over.push_back(t.wall - t.server);
      bytes = t.bytes;
    }
    table.add({name, median(wall), median(inside), median(over), bytes / 1e3 / median(over)});
  }
  table.note("picture", std::string("640 x 480 x 3 raw float, warm store; overhead = wall - server, encoding and digest included"));
  table.note("repeat", double(repeat));
  std::printf("%s", table.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  if (!out.empty() && !table.write(out).ok()) return 1;
  (*server)->shutdown(0);
  std::filesystem::remove_all(folder);
  return 0;
}
