// SPDX-License-Identifier: Apache-2.0
// Our path tracer against Cycles: the pictures of ../shared/data/derived/reference (SOURCES.md there says how each was made).
#include <filesystem>

#include "agreement.h"
#include "base/image_io.h"
#include "support/engines.h"

namespace gobo::testing {
namespace {

const std::string kData = "../shared/data/";
constexpr int kSeeds = 8, kSamples = 16;             // per seed: one block

struct Peer {
  const char* scene; const char* camera; const char* reference;
  int samples;                                       // of the reference
  int bounces;                                       // Cycles' max_bounces = scattering events after the first = ours
  std::vector<std::string> settings;
};

v1::RenderRequest requestFor(const Peer& p, int seed, int spp = kSamples) {
  v1::RenderRequest r;
  r.set_scene("peer");
  r.mutable_camera()->set_name(p.camera);
  r.set_width(320);
  r.set_height(240);
  r.set_seed(uint64_t(seed));
  r.mutable_halt()->set_spp(uint32_t(spp));
  r.mutable_integrator()->set_max_bounces(uint32_t(p.bounces));
  for (const std::string& s : p.settings) set(r, s);
  return r;
}

std::unique_ptr<Engine> engineFor(const Peer& p) {
  auto engine = makeEngine();
  const auto info = engine->openScene(kData + "derived/" + p.scene + ".glb", "peer");
  EXPECT_TRUE(info.ok()) << info.status().toString();
  return engine;
}

std::vector<Image> renderSeeds(Engine& engine, const Peer& p, int seeds = kSeeds) {
  std::vector<Image> out;
  for (int s = 0; s < seeds; ++s) {
    RenderResult r = mustRender(engine, requestFor(p, 101 + s));
    if (r.images.empty()) return {};
    out.push_back(std::move(r.images[0].image));
  }
  return out;
}

bool present(const Peer& p) { return std::filesystem::exists(kData + "derived/reference/" + p.reference) && std::filesystem::exists(kData + "derived/" + p.scene + ".glb"); }

#define NEEDS(peer) \
  if (!present(peer)) GTEST_SKIP() << "needs " << kData << "derived/" << (peer).scene << ".glb and reference/" << (peer).reference

Image reference(const Peer& p) {
  auto image = readImage(kData + "derived/reference/" + p.reference);
  EXPECT_TRUE(image.ok()) << image.status().toString();
  return image.ok() ? *image : Image();
}

const Peer kCornellDirect{"cornell_dragon", "front", "cornell_dragon_front_direct_4096spp.exr", 4096, 0, {}};
const Peer kCornell{"cornell_dragon", "front", "cornell_dragon_front_8b_4096spp.exr", 4096, 8, {}};
const Peer kSponza{"sponza", "atrium", "sponza_atrium_sun_4b_2048spp.exr", 2048, 4, {"environment.constant=0.6,0.75,1"}};
const Peer kTeapot{"teapot_table", "main", "teapot_table_main_venice_4b_2048spp.exr", 2048, 4, {"environment.path=" + kData + "hdr/polyhaven/venice.hdr"}};

Agreement agreementOf(const Peer& p) {
  auto engine = engineFor(p);
  const std::vector<Image> ours = renderSeeds(*engine, p);
  const Image theirs = reference(p);
  if (ours.empty() || theirs.width != 320 || theirs.height != 240) { ADD_FAILURE() << "no pictures"; return {}; }
  const Agreement a = compareWithPeer(ours, theirs, double(kSeeds) * kSamples / p.samples, 2e-3);
  std::printf("%s: %s\n", p.reference, describe(a).c_str());
  if (const char* folder = std::getenv("GOBO_PEERS_OUT")) {             // for looking at a difference
    Image mean(320, 240, 3), map(320, 240, 3);
    mean.names = map.names = {"R", "G", "B"};
    for (const Image& o : ours)
      for (size_t i = 0; i < 76800; ++i)
        for (int c = 0; c < 3; ++c) mean.data[3 * i + c] += o.data[i * o.channels + c] / float(ours.size());
    for (size_t i = 0; i < 76800; ++i) map.data[3 * i] = a.bad[i];
    for (const auto& [name, image] : {std::pair{"ours", &mean}, {"bad", &map}}) {
      const auto bytes = encodeExr(*image);
      (void)writeFileAtomic(std::string(folder) + "/" + p.scene + std::to_string(p.bounces) + "_" + name + ".exr", bytes->data(), bytes->size());
    }
  }
  return a;
}

void expectMeans(const Agreement& a, double most) {
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(a.ratio[c], 1.0, most) << "channel " << c;
}

TEST(Cycles, CornellDragonDirect) {
  NEEDS(kCornellDirect);
  const Agreement a = agreementOf(kCornellDirect);
  expectMeans(a, 0.01);
  EXPECT_EQ(a.badPixels, 0u);
}

TEST(Cycles, CornellDragonEightBounces) {
  NEEDS(kCornell);
  const Agreement a = agreementOf(kCornell);
  expectMeans(a, 0.01);
  EXPECT_EQ(a.badPixels, 0u);
}

TEST(Cycles, SponzaSunAndSky) {
  NEEDS(kSponza);
  const Agreement a = agreementOf(kSponza);
  expectMeans(a, 0.01);
  EXPECT_EQ(a.badPixels, 0u);
}

TEST(Cycles, TeapotInVenice) {
  NEEDS(kTeapot);
  const Agreement a = agreementOf(kTeapot);
  expectMeans(a, 0.01);
  EXPECT_EQ(a.badPixels, 0u);
}

}  // namespace
}  // namespace gobo::testing
