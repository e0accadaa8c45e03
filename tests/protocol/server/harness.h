// SPDX-License-Identifier: Apache-2.0
// A whole server inside the test: Unix socket in a temporary folder, everything bounded, gone with the object.
#pragma once

#include <gtest/gtest.h>
#include <stdlib.h>

#include <chrono>
#include <cstring>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include <grpcpp/grpcpp.h>

#include "base/hash.h"
#include "base/image.h"
#include "gobo/v1/service.grpc.pb.h"
#include "server/encode.h"
#include "server/server.h"

namespace gobo {

struct Collected {
  v1::RenderReply reply;
  std::vector<std::string> images;
  int progress = 0, snapshots = 0;
  grpc::Status status;
  std::multimap<std::string, std::string> trailers;
};

class ServerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::temp_directory_path() / "gobo-p-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    folder = pattern;
    std::filesystem::create_directory(folder + "/root");
    std::filesystem::create_directory(folder + "/tmp");
    config.listen = {"unix:" + folder + "/s.sock"};
    config.roots = {folder + "/root"};
    config.tmpFolder = folder + "/tmp";
    config.threads = 2;
    config.storeBytes = 256 << 20;
    config.logLevel = "off";
    setLogLevel(LogLevel::Off);
    configure(config);
    const Status checked = checkConfig(config);
    ASSERT_TRUE(checked.ok()) << checked.toString();
    auto started = Server::start(config, engineOptions(config), true);
    ASSERT_TRUE(started.ok()) << started.status().toString();
    server = std::move(*started);
    channel = grpc::CreateChannel(server->addresses()[0], grpc::InsecureChannelCredentials());
    render = v1::Render::NewStub(channel);
    scenes = v1::Scenes::NewStub(channel);
    admin = v1::Admin::NewStub(channel);
  }
  void TearDown() override {
    if (server) server->shutdown(0);
    server.reset();
    std::filesystem::remove_all(folder);
  }
  virtual void configure(ServerConfig&) {}

  // Every call of the tests is bounded.
  static void bound(grpc::ClientContext& context, int seconds = 60) { context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(seconds)); }

  static v1::RenderRequest small(uint32_t spp = 4, const std::string& scene = "cornell") {
    v1::RenderRequest request;
    request.set_scene(scene);
    request.set_width(64);
    request.set_height(48);
    request.mutable_halt()->set_spp(spp);
    request.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
    request.mutable_integrator()->set_max_bounces(2);
    return request;
  }

  static Collected drain(grpc::ClientContext& context, grpc::ClientReader<v1::RenderEvent>& reader,
                         const std::function<void(const v1::RenderEvent&)>& hook = {}) {
    Collected out;
    v1::RenderEvent event;
    while (reader.Read(&event)) {
      if (hook) hook(event);
      if (event.has_progress()) ++out.progress;
      if (event.has_snapshot() || event.has_reply()) {
        out.snapshots += event.has_snapshot();
        out.reply = event.has_reply() ? event.reply() : event.snapshot();
        out.images.assign(size_t(out.reply.images_size()), "");
      }
      if (event.has_chunk()) {
        std::string& bytes = out.images.at(event.chunk().image());
        EXPECT_EQ(event.chunk().offset(), bytes.size());
        bytes += event.chunk().data();
      }
    }
    out.status = reader.Finish();
    for (const auto& [key, value] : context.GetServerTrailingMetadata())
      out.trailers.emplace(std::string(key.data(), key.size()), std::string(value.data(), value.size()));
    if (out.status.ok())
      for (size_t i = 0; i < out.images.size(); ++i) {
        EXPECT_EQ(out.images[i].size(), out.reply.images(int(i)).bytes());
        EXPECT_EQ(hashBytes(out.images[i].data(), out.images[i].size()).hex(), out.reply.images(int(i)).digest());
      }
    return out;
  }
  Collected renderOnce(const v1::RenderRequest& request) {
    grpc::ClientContext context;
    bound(context);
    auto reader = render->Render(&context, request);
    return drain(context, *reader);
  }
  static Image raw(const Collected& c, size_t i = 0) {
    const v1::ImageDescriptor& d = c.reply.images(int(i));
    Image image(int(d.width()), int(d.height()), d.channels_size());
    EXPECT_EQ(c.images[i].size(), image.data.size() * 4);
    std::memcpy(image.data.data(), c.images[i].data(), std::min(c.images[i].size(), image.data.size() * 4));
    return image;
  }
  /// Polls `condition` for up to `seconds`.
  static bool eventually(const std::function<bool()>& condition, double seconds = 20) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (std::chrono::steady_clock::now() < end) {
      if (condition()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return condition();
  }
  v1::StatusReply status() {
    grpc::ClientContext context;
    bound(context);
    v1::StatusReply reply;
    EXPECT_TRUE(admin->GetStatus(&context, {}, &reply).ok());
    return reply;
  }

  std::string folder;
  ServerConfig config;
  std::unique_ptr<Server> server;
  std::shared_ptr<grpc::Channel> channel;
  std::unique_ptr<v1::Render::Stub> render;
  std::unique_ptr<v1::Scenes::Stub> scenes;
  std::unique_ptr<v1::Admin::Stub> admin;
};

}  // namespace gobo
