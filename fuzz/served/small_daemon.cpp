// SPDX-License-Identifier: Apache-2.0
#include "fuzz/served/small_daemon.h"
#include "import/load.h"

#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "fuzz/properties.h"
#include "server/encode.h"
#include "server/log.h"
#include "tests/support/triangle_glb.h"

namespace gobo::fuzz {

SmallDaemon::SmallDaemon() {
  setLogLevel(LogLevel::Off);
  folder_ = (std::filesystem::temp_directory_path() / "gobo-fuzz-XXXXXX").string();
  if (!::mkdtemp(folder_.data())) throw std::runtime_error("cannot make " + folder_);
  root_ = folder_ + "/root";
  std::filesystem::create_directory(root_);
  std::filesystem::create_directory(folder_ + "/tmp");
  std::ofstream(root_ + "/tri.glb", std::ios::binary) << triangleGlb();
  std::ofstream(root_ + "/rich.gltf", std::ios::binary) << richGltf();
  ServerConfig c;
  c.listen = {"unix:" + folder_ + "/none.sock"};
  c.roots = {root_};
  c.tmpFolder = folder_ + "/tmp";
  c.jobsFolder = folder_ + "/jobs";
  c.logLevel = "off";
  c.threads = 2;
  c.storeBytes = 8 << 20;
  c.sceneBytes = 16 << 20;
  c.environmentBytes = 16 << 20;
  c.accelBytes = 16 << 20;
  c.pinnedBytes = 64 << 20;
  c.replyBytes = 64 << 20;
  c.keepRendersBytes = 1 << 20;
  c.keepRenders = 16;
  c.uploadBytes = 64 << 10;
  for (const char* client : kClients) {
    TokenConfig t;
    t.name = client;
    const std::string token = tokenOf(client);
    t.sha256 = sha256Hex(token.data(), token.size());
    t.roots = c.roots;
    t.maxPixels = 1024;  // what a relight clears has its default, which is no tiny picture's
    t.maxSpp = 64;
    t.admin = client == *std::rbegin(kClients);
    c.tokens.push_back(t);
  }
  Status status = checkConfig(c);
  if (status.ok()) {
    EngineOptions options = engineOptions(c);
    options.loader = inProcessLoader();  // readers have targets of their own
    auto started = Server::start(c, options, false);
    if (started.ok()) server_ = std::move(*started);
    else status = started.status();
  }
  if (!status.ok()) throw std::runtime_error(status.toString());
  channel_ = server_->inProcessChannel();
}

SmallDaemon::~SmallDaemon() {
  channel_.reset();
  if (server_) server_->shutdown(0);
  server_.reset();
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

}  // namespace gobo::fuzz
