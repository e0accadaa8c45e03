// SPDX-License-Identifier: Apache-2.0
// Mattes against ids of a much finer picture; names' ids against published ones.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <map>
#include <set>

#include "support/run_node.h"
#include "support/tiny_scenes.h"
#include "terms/cryptomatte.h"
#include "terms/ids.h"

namespace gobo::cryptomatte_test {
namespace {

using namespace tests;

constexpr int kW = 24, kH = 18;

TEST(Cryptomatte, IdsArePublishedOnesAndOrdinaryFloats) {
  // From manifests of the specification and its sample pictures; the last one's hash has an exponent of all ones, 7f8e5296.
  const std::pair<const char*, uint32_t> published[] = {{"bunny", 0x13851a76},
                                                        {"default", 0x42c9679f},
                                                        {"bush", 0xf763d090},
                                                        {"flowerA.flowerA_petal1.:2261", 0x00af91ae},
                                                        {"flowerA.flowerA_petal1.:1065", 0x7f0e5296}};
  for (const auto& [name, id] : published) EXPECT_EQ(cryptomatteId(name), id) << name;
  EXPECT_EQ(cryptomatteId("object365"), 0x00e4028fu) << "of 0064028f, which is denormal";
  EXPECT_EQ(cryptomatteId("object1221"), 0xff506e74u) << "of ffd06e74, which is no number";
  EXPECT_EQ(cryptomatteHex(0x00e4028f), "00e4028f");
  int extreme = 0;
  for (int i = 0; i < 20000; ++i) {
    const uint32_t id = cryptomatteId("object" + std::to_string(i)), exponent = id >> 23 & 255;
    ASSERT_TRUE(std::isnormal(std::bit_cast<float>(id))) << i;
    extreme += exponent == 1 || exponent == 254;
  }
  EXPECT_NEAR(extreme, 20000 * 4 / 256, 80) << "two exponents hold what four had";
}

struct Shot {
  ScenePtr scene;
  std::vector<uint32_t> objects, materials;
};

std::vector<uint32_t> idsOf(const Scene& scene, bool materials) {
  std::vector<uint32_t> ids;
  for (const Instance& i : scene.instances)
    ids.push_back(cryptomatteId(materials ? scene.materials[size_t(scene.meshes[size_t(i.mesh)]->material)].name : i.name));
  return ids;
}

/// A floor, two balls of one mesh, a box in front, and nothing above.
Shot shot() {
  SceneMaker m;
  const int a = m.material(Vec3(0.5f)), b = m.material(Vec3(0.2f)), c = m.material(Vec3(0.8f));
  m.instance(m.mesh(quad(Vec3(-1, -0.4f, -1), Vec3(2, 0, 0), Vec3(0, 0, -2)), b));
  const int ball = m.mesh(sphere(Vec3(0.0f), 0.4f, 12, true), c);
  m.instance(ball, translate(Vec3(-0.5f, 0, -1.5f)));
  m.instance(ball, translate(Vec3(0.3f, 0.1f, -1.2f)));
  m.instance(m.mesh(box(Vec3(-0.1f, -0.4f, -1.1f), Vec3(0.1f, 0.3f, -0.9f)), a));
  m.camera(Vec3(0, 0.3f, 2), Vec3(0, 0, -1), 0.7f);
  Shot s;
  s.scene = m.finish();
  s.objects = idsOf(*s.scene, false);
  s.materials = idsOf(*s.scene, true);
  return s;
}

CryptomatteSettings settingsOf(const Shot& s, int samples) {
  CryptomatteSettings k;
  k.view = {s.scene->cameras[0], kW, kH, 1};
  k.samples = samples;
  k.seed = 7;
  k.objects = s.objects;
  k.materials = s.materials;
  return k;
}

/// Coverage by id. Checks order, and that what follows the last one is empty.
std::map<uint32_t, double> matteAt(std::span<const float> ranks, size_t pixel) {
  std::map<uint32_t, double> out;
  float before = 2.0f;
  uint32_t idBefore = 0;
  for (int k = 0; k < kCryptomatteRanks; ++k) {
    const uint32_t id = std::bit_cast<uint32_t>(ranks[pixel * kCryptomatteChannels + size_t(2 * k)]);
    const float coverage = ranks[pixel * kCryptomatteChannels + size_t(2 * k + 1)];
    EXPECT_TRUE(coverage < before || (coverage == before && (id > idBefore || coverage == 0.0f))) << "pixel " << pixel << " rank " << k;
    EXPECT_EQ(id != 0, coverage > 0.0f);
    if (id) { EXPECT_TRUE(out.emplace(id, coverage).second) << "an id twice"; }
    before = coverage;
    idBefore = id;
  }
  return out;
}

TEST(Cryptomatte, CoverageIsTheShareOfAMuchFinerPicture) {
  const Shot s = shot();
  const TaskArena arena(2);
  NodeRunner run(*s.scene, arena);
  constexpr int kFine = 32, kSamples = 64;
  const TermPtr matte = run(makeCryptomatteNode(settingsOf(s, kSamples)), {});
  const GBufferSettings fine{s.scene->cameras[0], kW * kFine, kH * kFine, 1};
  const TermPtr g = run(makeGBufferNode(fine), {});
  for (const bool materials : {false, true}) {
    const TermPtr ids = run(makeIdNode(materials ? IdKind::Material : IdKind::Object, fine.width, fine.height), {g});
    const auto numbers = ids->floats("id"), ranks = matte->floats(materials ? "material" : "object");
    std::set<uint32_t> seen;
    double sum = 0;
    int mixed = 0;
    for (int y = 0; y < kH; ++y)
      for (int x = 0; x < kW; ++x) {
        std::map<uint32_t, double> truth;
        for (int j = 0; j < kFine; ++j)
          for (int i = 0; i < kFine; ++i) {
            const float n = numbers[size_t(y * kFine + j) * size_t(fine.width) + size_t(x * kFine + i)];
            if (n >= 0) truth[cryptomatteId((materials ? s.scene->materials[size_t(n)].name : s.scene->instances[size_t(n)].name))] += 1.0 / (kFine * kFine);
          }
        std::map<uint32_t, double> found = matteAt(ranks, size_t(y) * kW + size_t(x));
        for (const auto& [id, share] : found) {
          EXPECT_NEAR(share * kSamples, std::round(share * kSamples), 1e-4) << "a share of the rays";
          truth.emplace(id, 0.0);
          seen.insert(id);
        }
        for (const auto& [id, p] : truth) {  // five standard errors of independent rays, and what a corner smaller than a fine pixel may hide
          ASSERT_NEAR(found[id], p, 5 * std::sqrt(p * (1 - p) / kSamples) + 1.0 / kSamples) << x << "," << y << " id " << cryptomatteHex(id);
          sum += found[id] - p;
          mixed += p > 0.01 && p < 0.99;
        }
      }
    EXPECT_EQ(seen.size(), materials ? 3u : 4u) << "all must be in view for the test to say anything";
    EXPECT_GT(mixed, 50);
    EXPECT_LT(std::abs(sum / (kW * kH)), 1e-3) << "no bias: " << sum;
  }
}

TEST(Cryptomatte, OfAnyRaysAndOnePlaneAlone) {
  const Shot s = shot();
  const TaskArena arena(2);
  NodeRunner run(*s.scene, arena);
  for (const int samples : {1, 2, 16, 22, 100, 256}) {
    CryptomatteSettings k = settingsOf(s, samples);
    const TermPtr both = run(makeCryptomatteNode(k), {});
    k.materials.clear();
    const TermPtr objects = run(makeCryptomatteNode(k), {});
    EXPECT_EQ(objects->planes().size(), 1u);
    EXPECT_TRUE(std::ranges::equal(objects->floats("object"), both->floats("object"))) << samples;
    k.materials = k.objects;
    k.objects.clear();
    EXPECT_TRUE(std::ranges::equal(run(makeCryptomatteNode(k), {})->floats("material"), both->floats("object"))) << samples;
    for (size_t p = 0; p < size_t(kW) * kH; ++p) {
      double sum = 0;
      for (const auto& [id, share] : matteAt(both->floats("object"), p)) sum += share;
      ASSERT_LE(sum, 1.0 + 1e-6);
    }
  }
}

/// Slices that share a sequence are together what one picture of all their samples is.
TEST(Cryptomatte, SharesOfASequenceAreTogetherTheWhole) {
  const Shot s = shot();
  const TaskArena arena(2);
  NodeRunner run(*s.scene, arena);
  constexpr int kSlices = 4, kEach = 32;
  const TermPtr whole = run(makeCryptomatteNode(settingsOf(s, kSlices * kEach)), {});
  std::vector<std::map<uint32_t, double>> sums(size_t(kW) * kH);
  for (uint32_t k = 0; k < kSlices; ++k) {
    CryptomatteSettings part = settingsOf(s, kEach);
    part.share = {k, kSlices};
    const TermPtr slice = run(makeCryptomatteNode(part), {});
    for (size_t p = 0; p < sums.size(); ++p)
      for (const auto& [id, share] : matteAt(slice->floats("object"), p)) sums[p][id] += share / kSlices;
  }
  int moved = 0;
  for (size_t p = 0; p < sums.size(); ++p) {
    const auto all = matteAt(whole->floats("object"), p);
    for (const auto& [id, share] : all) {
      EXPECT_NEAR(sums[p][id], share, 1.01 / (kSlices * kEach)) << p;  // a ray along an edge, beside others in its packet
      moved += std::abs(sums[p][id] - share) > 1e-6;
    }
  }
  EXPECT_LE(moved, 4);
}

TEST(Cryptomatte, EqualNamesAreOneIdAndTheLeastOfManyAreLeftOut) {
  SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  // Bars across one pixel's width: 10 of them, the k-th k + 1 parts of 55 wide.
  float left = -1.0f;
  for (int k = 0; k < 10; ++k) {
    const float wide = 2.0f * float(k + 1) / 55.0f;
    m.instance(m.mesh(quad(Vec3(left, -1, 0), Vec3(wide, 0, 0), Vec3(0, 2, 0)), grey));
    left += wide;
  }
  m.camera(Vec3(0, 0, 4), Vec3(0.0f), 0.5f);
  m.scene.cameras[0].perspective = false;
  m.scene.cameras[0].yheight = 2.0f;
  const ScenePtr scene = m.finish();
  const TaskArena arena(1);
  NodeRunner run(*scene, arena);
  CryptomatteSettings k;
  k.view = {scene->cameras[0], 1, 1, 1};
  k.samples = 256;
  for (int i = 0; i < 10; ++i) k.objects.push_back(cryptomatteId("bar" + std::to_string(i)));
  const auto found = matteAt(run(makeCryptomatteNode(k), {})->floats("object"), 0);
  ASSERT_EQ(found.size(), 6u);
  double sum = 0;
  for (int i = 4; i < 10; ++i) {
    ASSERT_TRUE(found.count(k.objects[size_t(i)])) << i;
    EXPECT_NEAR(found.at(k.objects[size_t(i)]), (i + 1) / 55.0, 0.02);
    sum += found.at(k.objects[size_t(i)]);
  }
  EXPECT_NEAR(sum, 45.0 / 55.0, 0.02) << "what has no rank is in none";
  k.materials.assign(10, cryptomatteId("grey"));
  const auto one = matteAt(run(makeCryptomatteNode(k), {})->floats("material"), 0);
  ASSERT_EQ(one.size(), 1u);
  EXPECT_EQ(one.begin()->second, 1.0);
}

TEST(Cryptomatte, IdsOfAnotherSceneAreAnError) {
  const Shot s = shot();
  CryptomatteSettings k = settingsOf(s, 16);
  k.objects.pop_back();
  const NodePtr node = makeCryptomatteNode(k);
  const TaskArena arena(1);
  AccelCache accels;
  const std::vector<int> none;
  const SceneView view(*s.scene, node->traits().facets, none);
  RunContext ctx;
  ctx.scene = &view;
  ctx.arena = &arena;
  ctx.accels = &accels;
  EXPECT_EQ(runNode(*node, ctx).status().code(), Code::Internal);
}

Hash128 keyOf(const CryptomatteSettings& s) {
  Hasher h("key");
  makeCryptomatteNode(s)->hashParameters(h);
  return h.digest();
}

TEST(Cryptomatte, KeyHasAllThatTheResultHangsOn) {
  const Shot s = shot();
  const CryptomatteSettings base = settingsOf(s, 64);
  std::set<Hash128> keys{keyOf(base)};
  const auto differs = [&](const std::function<void(CryptomatteSettings&)>& change, const char* what) {
    CryptomatteSettings k = base;
    change(k);
    EXPECT_TRUE(keys.insert(keyOf(k)).second) << what;
  };
  for (const int samples : {16, 32}) differs([samples](auto& k) { k.samples = samples; }, "samples");
  differs([](auto& k) { k.share = {0, 4}; }, "share.of");
  differs([](auto& k) { k.share = {1, 4}; }, "share.index");
  differs([](auto& k) { k.viewSamples = 4; }, "viewSamples");
  differs([](auto& k) { k.sampler = SamplerKind::Halton; }, "sampler");
  differs([](auto& k) { k.seed = 8; }, "seed");
  differs([](auto& k) { k.objects[1] ^= 1; }, "objects");
  differs([](auto& k) { k.materials[1] ^= 1; }, "materials");
  differs([](auto& k) { k.objects.clear(); }, "no objects");
  differs([](auto& k) { k.materials.clear(); }, "no materials");
  for (const bool materials : {false, true})
    differs(
        [materials](auto& k) {
          (materials ? k.materials : k.objects).clear();
          (materials ? k.ofMaterials : k.ofObjects) = true;
        },
        "asked for, and there are none");
  differs([](auto& k) { std::swap(k.objects, k.materials); }, "which is which");
  differs([](auto& k) { k.view.width = 23; }, "width");
  differs([](auto& k) { k.view.camera.yfov = 0.6f; }, "camera");
  differs([](auto& k) { k.view.camera.optics.lensRadius = 0.1f; }, "lens");
  differs([](auto& k) { k.view.place = {3, 2, 50, 40}; }, "place");
  CryptomatteSettings same = base;
  same.view.viewSamples = 9;
  same.view.part = GBufferPart::Hits;
  EXPECT_EQ(keyOf(same), keyOf(base)) << "what beauty's view samples are does not matter";
  same.ofObjects = same.ofMaterials = true;
  EXPECT_EQ(keyOf(same), keyOf(base)) << "where there are ids they were asked for";
}

}  // namespace
}  // namespace gobo::cryptomatte_test
