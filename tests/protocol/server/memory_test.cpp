// SPDX-License-Identifier: Apache-2.0
// SECURITY.md: memory is bounded, kind by kind. What `status` says is held stays within what is configured, through loads, renders by several ways of
// shadowing, environments and a refused load, and each of the kinds really held something.
#include <fstream>
#include <set>

#include "harness.h"
#include "support/triangle_glb.h"

namespace gobo::memory_test {
namespace {

class Memory : public ServerTest {
 protected:
  void configure(ServerConfig& c) override {
    c.storeBytes = 4 << 20;
    c.sceneBytes = 64 << 20;
    c.environmentBytes = 16 << 20;
    c.accelBytes = 64 << 20;
    c.pinnedBytes = 256 << 20;
    c.keepRendersBytes = 1 << 20;
    c.replyBytes = 64 << 20;
  }
  /// Largest value of each holder so far; fails where one, or all together, are beyond their bounds.
  void look(const std::string& when) {
    const v1::StatusReply s = status();
    uint64_t held = 0, bound = 0;
    for (const v1::MemoryHolder& h : s.memory()) {
      EXPECT_GT(h.limit(), 0u) << h.name();
      EXPECT_LE(h.bytes(), h.limit()) << h.name() << ", " << when;
      held += h.bytes();
      bound += h.limit();
      most[h.name()] = std::max(most[h.name()], h.bytes());
    }
    EXPECT_LE(held, bound) << when;
    largest = std::max(largest, held);
  }
  std::map<std::string, uint64_t> most;
  uint64_t largest = 0;
};

TEST_F(Memory, StaysWithinWhatIsConfigured) {
  std::ofstream(folder + "/root/t.glb", std::ios::binary) << triangleGlb();
  look("at first");
  uint64_t pictures = 0;
  for (int i = 0; i < 24; ++i) {
    v1::RenderRequest r;
    r.set_scene(i % 2 ? "cornell" : "fence");
    r.set_width(160);
    r.set_height(120);
    r.set_seed(uint64_t(i));       // no term serves two
    r.mutable_halt()->set_spp(1);  // pictures and terms are as large
    r.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
    switch (i % 4) {
      case 0: r.mutable_shadows()->mutable_ray_traced(); break;
      case 1: r.mutable_shadows()->mutable_variance(); break;
      case 2: r.mutable_environment()->mutable_sky()->set_turbidity(2 + 0.25 * i); break;
      default: break;
    }
    const Collected c = renderOnce(r);
    ASSERT_TRUE(c.status.ok()) << c.status.error_message();
    for (const std::string& image : c.images) pictures += image.size();
    look("render " + std::to_string(i));
  }
  for (int i = 0; i < 8; ++i) {
    grpc::ClientContext context;
    bound(context);
    v1::OpenSceneRequest request;
    request.set_source(i == 7 ? folder + "/root/none.glb" : folder + "/root/t.glb");
    request.set_name("s" + std::to_string(i));
    v1::SceneInfo info;
    EXPECT_EQ(scenes->Open(&context, request, &info).ok(), i != 7);
    look("load " + std::to_string(i));
  }
  for (const char* kind : {"terms", "scenes", "ray tracing", "remembered requests"}) EXPECT_GT(most[kind], 0u) << kind;
  for (const auto& [name, bytes] : most) std::printf("%-28s %.2f MiB at most\n", name.c_str(), double(bytes) / (1 << 20));
  EXPECT_GT(pictures, config.storeBytes) << "terms would fit without their bound";
  EXPECT_GT(most["terms"], config.storeBytes / 2);
}

// tests/unit/plan/engine_memory_test.cpp: that caches keep to it.
TEST_F(Memory, EverythingTogetherHasALimit) {
  const v1::StatusReply before = status();
  EXPECT_EQ(before.memory_limit(), config.memoryBytes);
  EXPECT_GE(before.memory_limit(), config.pinnedBytes + config.replyBytes + config.keepRendersBytes);
  const Collected c = renderOnce(small());
  ASSERT_TRUE(c.status.ok()) << c.status.error_message();
  const v1::StatusReply after = status();
  std::set<std::string> holders;
  for (const v1::MemoryHolder& h : after.memory()) {
    holders.insert(h.name());
    uint64_t sum = 0;
    for (const auto& [caller, bytes] : h.callers()) sum += bytes;
    if (h.name() == "scenes") EXPECT_EQ(sum, h.bytes());
    if (h.name() == "stopped renders") { EXPECT_EQ(h.limit(), config.storeBytes / 2); }
  }
  EXPECT_EQ(holders.size(), 9u);
}

// A window costs a reply of its own size, whatever it is a window of: beside others that are being sent there is room for it.
TEST_F(Memory, AWindowIsCountedAsItself) {
  const auto others = server->core().replies.take("others", config.replyBytes / 2);
  ASSERT_TRUE(others);
  v1::RenderRequest r = small(1);
  r.set_width(1200);
  r.set_height(1000);
  EXPECT_EQ(renderOnce(r).status.error_code(), grpc::RESOURCE_EXHAUSTED) << "the whole picture";
  r.mutable_window()->set_x(600);
  r.mutable_window()->set_y(400);
  r.mutable_window()->set_width(16);
  r.mutable_window()->set_height(16);
  const Collected c = renderOnce(r);
  EXPECT_TRUE(c.status.ok()) << c.status.error_message();
}

}  // namespace
}  // namespace gobo::memory_test
