// SPDX-License-Identifier: Apache-2.0
// A whole daemon inside the process: no socket, a temporary folder that goes with it, jobs, and three tokens of which one has the admin right. All bounds are
// small. One thread makes and ends it; calls may come from any.
#pragma once

#include <memory>
#include <string>

#include "server/server.h"

namespace gobo::fuzz {

constexpr const char* kClients[] = {"alice", "bob", "root"};  ///< the last one with the admin right
constexpr const char* kStranger = "mallory";                  ///< shows a token that nobody has

class SmallDaemon {
 public:
  SmallDaemon();
  ~SmallDaemon();
  SmallDaemon(const SmallDaemon&) = delete;
  SmallDaemon& operator=(const SmallDaemon&) = delete;

  Server& server() { return *server_; }
  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }
  const std::string& root() const { return root_; }  ///< of its files: tri.glb, rich.gltf
  static std::string tokenOf(const std::string& client) { return "secret-of-" + client; }

 private:
  std::string folder_, root_;
  std::unique_ptr<Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
};

}  // namespace gobo::fuzz
