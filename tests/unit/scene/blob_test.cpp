// SPDX-License-Identifier: Apache-2.0
// A blob read back is the scene that was written, whatever is in it; a blob that something has changed is refused or does no
// harm; a foreign blob is not believed.
#include "scene/blob.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <limits>

#include "import/load.h"
#include "scene/blob_codec.h"
#include "scene/mipmap.h"
#include "support/blob_bytes.h"
#include "support/instrumented.h"

namespace gobo {
namespace {

namespace fs = std::filesystem;

/// One of everything: two meshes, a texture, every kind of reference, an environment, a rig and variants.
Scene smallScene() {
  Scene s;
  s.name = "small";
  auto t = std::make_shared<Texture>();
  t->name = "picture";
  t->width = 3;
  t->height = 2;
  t->srgb = true;
  t->wrapV = Wrap::Mirror;
  std::vector<uint8_t> texels;
  for (int i = 0; i < 24; ++i) texels.push_back(uint8_t(i * 10));
  t->texels8 = texels;
  sealTexture(*t);
  s.textures.push_back(t);
  for (int k = 0; k < 2; ++k) {
    auto m = std::make_shared<Mesh>();
    m->name = "mesh" + std::to_string(k);
    m->indices = {0, 1, 2};
    m->positions = {Vec3(0, 0, k), Vec3(1, 0, k), Vec3(0, 1, k)};
    if (k == 0) {
      m->normals.assign(3, Vec3(0, 0, 1));
      m->uv[1] = {Vec2(0), Vec2(1, 0), Vec2(0, 1)};
      m->colours.assign(3, Vec4(0.5f));
      m->tangents.assign(3, Vec4(1, 0, 0, 1));
    }
    m->material = k;
    sealMesh(*m);
    s.meshes.push_back(m);
    s.instances.push_back({"node" + std::to_string(k), k, Mat4(1.0f)});
  }
  s.materials.resize(2);
  s.materials[0].name = "paint";
  s.materials[0].albedo.texture = {0, 1, Vec2(0.1f, 0.2f), Vec2(3), 0.5f};
  s.materials[0].coverage.mode = AlphaMode::Mask;
  s.materials[1].emission.radiance = Vec3(1, 2, 3);
  Light l;
  l.name = "lamp";
  l.shape.kind = LightKind::Spot;
  s.lights.push_back(l);
  Image sky(4, 2, 3);
  for (size_t i = 0; i < sky.data.size(); ++i) sky.data[i] = float(i);
  s.environment = makeEnvironment("sky", sky);
  s.variants.names = {"red"};
  s.variants.uses = {{0, 1, 0}};
  s.warnings = {"one", ""};
  auto rig = std::make_shared<Rig>();
  rig->nodes.resize(2);
  rig->nodes[1].parent = 0;
  rig->followers.push_back({RigKind::Instance, 1, 1, Mat4(1.0f), Vec2(0.5f), 0.5f});
  RigAnimation a;
  a.name = "turn";
  a.end = 1;
  a.samplers.push_back({RigInterpolation::Linear, {0.0f, 1.0f}, {0, 0, 0, 1, 1, 1}});
  a.channels.push_back({1, RigPath::Translation, 0});
  rig->animations.push_back(a);
  EXPECT_TRUE(sealRig(*rig, s).ok());
  s.rig = rig;
  EXPECT_TRUE(s.seal().ok());
  return s;
}

void expectSame(const Scene& a, const Scene& b) {
  EXPECT_EQ(a.hash(), b.hash());
  EXPECT_EQ(a.warnings, b.warnings);
  EXPECT_EQ(a.name, b.name);
  ASSERT_EQ(a.meshes.size(), b.meshes.size());
  for (size_t i = 0; i < a.meshes.size(); ++i) {
    EXPECT_EQ(a.meshes[i]->name, b.meshes[i]->name);
    EXPECT_EQ(a.meshes[i]->indices, b.meshes[i]->indices);
    EXPECT_EQ(a.meshes[i]->positions, b.meshes[i]->positions);
    EXPECT_EQ(a.meshes[i]->normals, b.meshes[i]->normals);
    EXPECT_EQ(a.meshes[i]->uv, b.meshes[i]->uv);
  }
  ASSERT_EQ(a.textures.size(), b.textures.size());
  for (size_t i = 0; i < a.textures.size(); ++i) {
    EXPECT_EQ(a.textures[i]->content, b.textures[i]->content);
    EXPECT_EQ(a.textures[i]->texels8, b.textures[i]->texels8);
    for (int k = 0; k < 64; ++k) EXPECT_EQ(a.textures[i]->sample(Vec2(0.37f * k, 0.61f * k)), b.textures[i]->sample(Vec2(0.37f * k, 0.61f * k)));
  }
  ASSERT_EQ(a.environment != nullptr, b.environment != nullptr);
  if (a.environment) {
    EXPECT_EQ(a.environment->texels, b.environment->texels);
    EXPECT_EQ(a.environment->name, b.environment->name);
  }
  ASSERT_EQ(a.rig != nullptr, b.rig != nullptr);
  if (a.rig) { EXPECT_EQ(a.rig->content, b.rig->content); }
}

TEST(Blob, FieldListsAreComplete) { EXPECT_EQ(blob::forgottenFields(), ""); }

TEST(Blob, RoundTripIsTheScene) {
  const Scene s = smallScene();
  for (const BlobTrust trust : {BlobTrust::Foreign, BlobTrust::Own}) {
    const auto back = blobOf(s).scene(trust);
    ASSERT_TRUE(back.ok()) << back.status().toString();
    expectSame(s, **back);
    EXPECT_EQ((*back)->variants.names, s.variants.names);
    EXPECT_EQ((*back)->rig->animations[0].name, "turn");
    EXPECT_EQ(blobOf(**back).bytes, blobOf(s).bytes);  // every field is there: written again, it is the same file
  }
}

TEST(Blob, RoundTripOfBuiltinScenes) {
  for (const char* name : {"cornell", "furnace", "fence", "spheres", "lights8"}) {
    const auto scene = makeBuiltinScene(name);
    ASSERT_TRUE(scene.ok());
    const auto back = blobOf(**scene).scene(BlobTrust::Foreign);
    ASSERT_TRUE(back.ok()) << name << " " << back.status().toString();
    expectSame(**scene, **back);
  }
}

TEST(Blob, RoundTripOfFiles) {
  if (!fs::exists("../shared/data/derived/sponza.glb")) GTEST_SKIP() << "../shared/data is absent";
  for (const char* file : {"derived/sponza.glb", "derived/cornell_dragon.glb", "gltf/khronos/DamagedHelmet/glTF-Binary/DamagedHelmet.glb"}) {
    if (!fs::exists("../shared/data/" + std::string(file))) continue;
    const auto scene = loadGltf("../shared/data/" + std::string(file));
    ASSERT_TRUE(scene.ok()) << scene.status().toString();
    const auto back = blobOf(**scene).scene(BlobTrust::Foreign);
    ASSERT_TRUE(back.ok()) << file << " " << back.status().toString();
    expectSame(**scene, **back);
  }
}

TEST(Blob, ArraysLookAtTheMappingAndKeepIt) {
  auto [owner, view] = blobOf(smallScene()).aligned();
  std::weak_ptr<const void> alive = owner;
  auto scene = readSceneBlob(owner, view, BlobTrust::Own);
  ASSERT_TRUE(scene.ok());
  const auto inside = [&](const void* p) { return p >= view.data() && p < view.data() + view.size() && reinterpret_cast<uintptr_t>(p) % 64 == 0; };
  EXPECT_TRUE(inside((*scene)->meshes[0]->positions.begin()));
  EXPECT_TRUE(inside((*scene)->textures[0]->texels8.begin()));
  EXPECT_TRUE(inside((*scene)->environment->texels.begin()));
  owner.reset();
  EXPECT_FALSE(alive.expired());
  *scene = nullptr;
  EXPECT_TRUE(alive.expired());
}

TEST(Blob, TruncationIsRefusedEverywhere) {
  const BlobBytes whole = blobOf(smallScene());
  for (size_t n = 0; n < whole.bytes.size(); ++n) {
    BlobBytes cut{{whole.bytes.begin(), whole.bytes.begin() + std::ptrdiff_t(n)}};
    ASSERT_FALSE(cut.scene(BlobTrust::Own).ok()) << n;
    if (n < kBlobHeaderBytes) continue;
    const uint64_t total = n;  // and with a header that agrees with the new length
    std::memcpy(cut.bytes.data() + 24, &total, 8);
    cut.mend();
    ASSERT_FALSE(cut.scene(BlobTrust::Foreign).ok()) << n;
  }
}

/// Reads everything that a renderer could: a wrong pointer or size shows under the sanitizers, and by a crash mostly.
float touch(const Scene& s) {
  float sum = 0;
  for (const MeshPtr& m : s.meshes)
    for (const uint32_t i : m->indices) sum += m->positions[i].x + (m->uv[1].empty() ? 0.0f : m->uv[1][i].x);
  for (const auto& t : s.textures)
    for (int k = 0; k < t->levels; ++k) sum += t->sampleLevel(Vec2(0.9f, 0.8f), k).x + t->sampleLevel(Vec2(7.1f, -3.0f), k).y;
  if (s.environment) sum += s.environment->eval(Vec3(0, 1, 0)).x;
  for (const Instance& i : s.instances) sum += float(s.meshes[i.mesh]->triangles());
  return sum;
}

TEST(Blob, EveryDamagedByteIsRefusedOrHarmless) {
  const BlobBytes whole = blobOf(smallScene());
  size_t refused = 0, harmless = 0;
  float sum = 0;
  for (size_t i = 0; i < whole.bytes.size(); ++i) {
    BlobBytes b = whole;
    b.bytes[i] ^= 0x40;
    if (i < kBlobHeaderBytes + b.at<uint64_t>(80)) { ASSERT_FALSE(b.scene(BlobTrust::Own).ok()) << "byte " << i; }  // digests of header and records
    size_t way = i;  // each byte in one way of three where code is slow
    for (const uint8_t flip : {0x01, 0x80, 0xff}) {
      if (testing::kInstrumented && way++ % 3) continue;
      b = whole;
      b.bytes[i] ^= flip;
      b.mend();  // as a hostile writer would
      for (const BlobTrust trust : {BlobTrust::Foreign, BlobTrust::Own}) {
        const auto scene = b.scene(trust);
        if (scene.ok()) {
          ++harmless;
          sum += touch(**scene);
        } else {
          ++refused;
          EXPECT_FALSE(scene.status().message().empty());
        }
      }
    }
    // Counts and offsets of eight bytes at their extremes.
    for (const uint64_t wild : {~0ull, 1ull << 63, 1ull << 31, (1ull << 62) + 64}) {
      if (i + 8 > whole.bytes.size()) break;
      if (testing::kInstrumented && way++ % 4) continue;
      b = whole;
      std::memcpy(b.bytes.data() + i, &wild, 8);
      b.mend();
      const auto scene = b.scene(BlobTrust::Foreign);
      if (scene.ok()) {
        ++harmless;
        sum += touch(**scene);
      } else ++refused;
    }
  }
  std::cout << whole.bytes.size() << " bytes: " << refused << " refused, " << harmless << " harmless (" << (sum == sum) << ")\n";
  EXPECT_GT(refused, harmless);
}

TEST(Blob, ForeignArraysAreNotBelieved) {
  const BlobBytes whole = blobOf(smallScene());
  const size_t arrays = size_t(whole.at<uint64_t>(88));
  size_t caught = 0, padding = 0;
  for (size_t i = arrays; i < whole.bytes.size(); ++i) {
    BlobBytes b = whole;
    b.bytes[i] ^= 0x04;
    b.mend();
    b.scene(BlobTrust::Foreign).ok() ? ++padding : ++caught;
  }
  // Arrays: 2 x (12 + 36) + 36 + 24 + 48 + 48 of meshes, 24 texels, 96 of the map, 8 + 24 of the rig; equal arrays are written once.
  EXPECT_GE(caught, 300u);
  Scene s = smallScene();
  auto mesh = std::make_shared<Mesh>(*s.meshes[0]);
  mesh->normals[1].y = std::numeric_limits<float>::quiet_NaN();
  sealMesh(*mesh);
  s.meshes[0] = mesh;
  ASSERT_TRUE(s.seal().ok());
  const auto refused = blobOf(s).scene(BlobTrust::Foreign);  // seal() does not look at normals: the blob check must
  ASSERT_FALSE(refused.ok());
  EXPECT_NE(refused.status().message().find("not finite"), std::string::npos) << refused.status().toString();
  // What a texture says of its own texels: a mirror that calls itself rough would be named nowhere.
  Scene lying = smallScene();
  auto texture = std::make_shared<Texture>(*lying.textures[0]);
  texture->lowest.y += 0.25f;
  lying.textures[0] = texture;
  ASSERT_TRUE(lying.seal().ok());
  const auto caughtLying = blobOf(lying).scene(BlobTrust::Foreign);
  ASSERT_FALSE(caughtLying.ok());
  EXPECT_NE(caughtLying.status().message().find("lowest"), std::string::npos) << caughtLying.status().toString();
}

// Posing writes as many normals as there are vertices: a rig's arrays that are shorter would be written beyond their end.
TEST(Blob, AForeignRigWithArraysOfOtherLengthsIsRefused) {
  Scene s = smallScene();
  const auto read = [&](const std::function<void(Mesh&)>& spoil) {
    auto mesh = std::make_shared<Mesh>(*s.meshes[0]);
    auto rig = std::make_shared<Rig>(*s.rig);
    rig->meshes = {mesh};
    rig->sources.resize(1);
    rig->deformed.resize(1);
    EXPECT_TRUE(sealRig(*rig, s).ok());
    spoil(*mesh);
    sealMesh(*mesh);
    s.rig = rig;
    EXPECT_TRUE(s.seal().ok());
    return blobOf(s).scene(BlobTrust::Foreign).status();
  };
  EXPECT_TRUE(read([](Mesh&) {}).ok()) << read([](Mesh&) {}).toString();
  for (const size_t n : {1, 4}) {  // of three vertices
    for (const Status& status : {read([&](Mesh& m) { m.normals = Array<Vec3>(n, Vec3(0, 0, 1)); }), read([&](Mesh& m) { m.uv[3] = Array<Vec2>(n); })}) {
      EXPECT_EQ(status.code(), Code::DataLoss) << n;
      EXPECT_NE(status.message().find("vertex arrays of different lengths"), std::string::npos) << status.toString();
    }
  }
}

TEST(Blob, EveryDamagedByteOfTheArraysIsFound) {
  const BlobBytes whole = blobOf(smallScene());
  const auto check = [](const BlobBytes& b, const StopToken& stop = {}) {
    const auto [owner, view] = b.aligned();
    return checkBlobArrays(view, stop);
  };
  EXPECT_TRUE(check(whole).ok()) << check(whole).toString();
  for (size_t i = size_t(whole.at<uint64_t>(88)); i < whole.bytes.size(); ++i) {
    BlobBytes b = whole;
    b.bytes[i] ^= uint8_t(1 << i % 8);
    ASSERT_EQ(check(b).code(), Code::DataLoss) << "byte " << i;
    ASSERT_FALSE(b.scene(BlobTrust::Foreign).ok()) << "byte " << i;
  }
  // Several slices, the last one short; and the stop token is looked at before each.
  Environment map;
  map.width = 1024;
  map.height = 1000;
  map.texels.assign(size_t(map.width) * size_t(map.height), Vec3(0.25f));
  map.content = environmentDigest(map);
  BlobBytes large = blobOf(map);
  ASSERT_GT(large.bytes.size(), size_t(11) << 20);
  ASSERT_TRUE(check(large).ok());
  for (const size_t at : {size_t(4) << 20, (size_t(8) << 20) + 500, large.bytes.size() - 1}) {
    large.bytes[at] ^= 0x10;
    EXPECT_EQ(check(large).code(), Code::DataLoss) << at;
    large.bytes[at] ^= 0x10;
  }
  for (int n = 1; n <= 3; ++n) {
    StopSource stop;
    stop.stopAtPoll(n);
    EXPECT_EQ(check(large, stop.token()).code(), Code::Cancelled) << n;
  }
}

TEST(Blob, KeyVersionAndFormatAreChecked) {
  const Scene s = smallScene();
  BlobBytes b = blobOf(s);
  BlobKey key{}, other{};
  key[3] = 7;
  const auto header = withBlobKey(b.bytes, key);
  std::copy(header.begin(), header.end(), b.bytes.begin());
  auto [owner, view] = b.aligned();
  EXPECT_TRUE(readSceneBlob(owner, view, BlobTrust::Own, &key).ok());
  EXPECT_NE(readSceneBlob(owner, view, BlobTrust::Own, &other).status().message().find("something else"), std::string::npos);
  EXPECT_NE(readEnvironmentBlob(owner, view, BlobTrust::Own).status().message().find("kind"), std::string::npos);
  for (const auto& [at, text] : {std::pair<size_t, const char*>{0, "no scene blob"}, {8, "version"}, {12, "byte order"}, {32, "other fields"}}) {
    BlobBytes c = b;
    c.bytes[at] ^= 1;
    c.mend();
    EXPECT_NE(c.scene(BlobTrust::Own).status().message().find(text), std::string::npos) << c.scene(BlobTrust::Own).status().toString();
  }
}

TEST(Blob, EnvironmentRoundTrip) {
  const EnvironmentPtr map = skyEnvironment({}, 64);
  auto [owner, view] = blobOf(*map).aligned();
  const auto back = readEnvironmentBlob(owner, view, BlobTrust::Foreign);
  ASSERT_TRUE(back.ok()) << back.status().toString();
  EXPECT_EQ((*back)->content, map->content);
  EXPECT_EQ((*back)->texels, map->texels);
  BlobBytes negative = blobOf(*map);
  negative.bytes[negative.bytes.size() - 60] ^= 0x80;
  auto [owner2, view2] = negative.aligned();
  EXPECT_FALSE(readEnvironmentBlob(owner2, view2, BlobTrust::Foreign).ok());
}

}  // namespace
}  // namespace gobo
