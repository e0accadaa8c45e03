// SPDX-License-Identifier: Apache-2.0
// Making scenes, poses, maps and textures looks at the stop token all along and says Cancelled at whichever poll it fires.
#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "base/image_io.h"
#include "import/load.h"
#include "scene/edit.h"
#include "scene/environment_cube.h"
#include "scene/mipmap.h"
#include "support/small_gltf.h"
#include "support/stopping.h"
#include "support/thorough.h"

namespace gobo::tests {
namespace {

/// make(token) gives a Status; Ok without a stop, Cancelled at any poll: at `places` of them.
template <typename Make>
void expectCancelledAnywhere(const char* what, int least, const Make& make, int places = 7) {
  const int polls = pollsOf([&](const StopToken& s) {
    const Status made = make(s);
    ASSERT_TRUE(made.ok()) << what << ": " << made.toString();
  });
  EXPECT_GE(polls, least) << what;
  for (int k = 1; k <= polls; k += 1 + polls / places) EXPECT_EQ(make(stopAt(k)).code(), Code::Cancelled) << what << ", poll " << k << " of " << polls;
  EXPECT_EQ(make(stopAt(polls)).code(), Code::Cancelled) << what << ", the last of " << polls;
  EXPECT_EQ(make(stoppedAlready()).code(), Code::Cancelled) << what;
}
Status orCancelled(bool made) { return made ? Status() : Status(Code::Cancelled, "stopped"); }

TEST(Stops, BuiltInScenesWithTextures) {
  for (const char* name : {"atrium", "trees"})  // rows of textures: 512 and more
    expectCancelledAnywhere(
        name, 500, [&](const StopToken& s) { return makeBuiltinScene(name, s).status(); }, testing::thoroughOr(7, 3));
  for (const std::string& name : builtinSceneNames()) EXPECT_EQ(makeBuiltinScene(name, stoppedAlready()).status().code(), Code::Cancelled) << name;
}

TEST(Stops, Skies) {
  expectCancelledAnywhere("sky", 32 + 64 + 64,
                          [](const StopToken& s) { return orCancelled(skyEnvironment({}, 128, s) != nullptr); });  // rows, rings of the sun, rows
}

Image ramp(int width, int height) {
  Image image(width, height, 3);
  for (size_t i = 0; i < image.data.size(); ++i) image.data[i] = float(i % 251) / 251.0f;
  return image;
}

TEST(Stops, EnvironmentsFromFiles) {
  const auto exr = *encodeExr(ramp(512, 256)), png = *encodePng(ramp(512, 256));
  expectCancelledAnywhere("EXR", 256 / 64 + 256, [&](const StopToken& s) { return readEnvironment(exr.data(), exr.size(), "a.exr", s).status(); });
  expectCancelledAnywhere("PNG", 256 / 64 + 1 + 256, [&](const StopToken& s) { return readEnvironment(png.data(), png.size(), "a.png", s).status(); });
  const auto cross = *encodeExr(ramp(256, 192));  // a cube of faces 64 wide becomes 256 x 128
  expectCancelledAnywhere("cube", 192 / 64 + 128 + 128, [&](const StopToken& s) { return readEnvironment(cross.data(), cross.size(), "a.exr", s).status(); });
  // In pieces or at once: the same picture.
  const Image whole = ramp(300, 131);
  const auto bytes = *encodeExr(whole);
  EXPECT_EQ(readImageFromMemory(bytes.data(), bytes.size(), "a.exr")->data, whole.data);
}

TEST(Stops, TexturesAndTheirMipLevels) {
  Texture t;
  t.width = t.height = 64;
  t.texels8 = std::vector<uint8_t>(64 * 64 * 4, 90);
  sealTexture(t);
  EXPECT_GE(pollsOf([&](const StopToken& s) { (void)mipmapped(t, true, 0, kTextureTile, s); }),
            64 + 2 * 32);  // rows of level 0, and of level 1 made and stored

  namespace fs = std::filesystem;
  const fs::path folder = fs::temp_directory_path() / ("gobo-stops-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const auto png = *encodePng(ramp(256, 128));
  std::ofstream(folder / "a.png", std::ios::binary).write(reinterpret_cast<const char*>(png.data()), std::streamsize(png.size()));
  std::ofstream(folder / "a.gltf") << smallGltf("a.png");
  expectCancelledAnywhere("glTF", 128 + 2 * 64 + 8, [&](const StopToken& s) {
    LoadOptions options;
    options.stop = s;
    return loadGltf((folder / "a.gltf").string(), options).status();
  });
  fs::remove_all(folder);
}

/// A strip of `n` vertices with a morph target, on one joint that an animation moves.
ScenePtr walker(int n) {
  auto s = std::make_shared<Scene>();
  s->name = "walker";
  s->materials.push_back({});
  s->materials[0].name = "skin";
  auto mesh = std::make_shared<Mesh>();
  mesh->name = "strip";
  std::vector<Vec3> p, normals, delta;
  std::vector<uint32_t> corners;
  for (int i = 0; i < n; ++i) {
    p.push_back(Vec3(float(i / 2) * 0.01f, float(i % 2), 0));
    normals.push_back(Vec3(0, 0, 1));
    delta.push_back(Vec3(0, 0, float(i % 5) * 0.1f));
    if (i >= 2)
      for (int k : {i - 2, i - 1, i}) corners.push_back(uint32_t(k));
  }
  mesh->positions = p;
  mesh->normals = normals;
  mesh->indices = corners;
  sealMesh(*mesh);
  s->meshes = {mesh};
  s->instances = {{"strip", 0, Mat4(1.0f)}};
  auto rig = std::make_shared<Rig>();
  rig->nodes.resize(1);
  rig->meshes = {mesh};
  rig->skins = {{Array<int32_t>{0}, Array<Mat4>(1, Mat4(1.0f))}};
  RigSource source;
  source.influences = 4;
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < 4; ++k) {
      source.joints.push_back(0);
      source.weights.push_back(k == 0 ? 1.0f : 0.0f);
    }
  source.targets.resize(1);
  source.targets[0].positions = delta;
  rig->sources = {source};
  RigDeformed deformed;
  deformed.skin = 0;
  deformed.weights = {0.0f};
  rig->deformed = {deformed};
  RigSampler sampler;
  sampler.times = Array<float>{0.0f, 1.0f};
  sampler.values = Array<float>{0.0f, 1.0f};
  RigChannel weights;
  weights.sampler = 0;
  weights.node = 0;
  weights.path = RigPath::Weights;
  RigAnimation walk;
  walk.name = "walk";
  walk.end = 1.0f;
  walk.samplers = {sampler};
  walk.channels = {weights};
  rig->animations = {walk};
  EXPECT_TRUE(sealRig(*rig, *s).ok()) << sealRig(*rig, *s).toString();
  s->rig = rig;
  EXPECT_TRUE(s->seal().ok());
  return s;
}

TEST(Stops, Poses) {
  constexpr int vertices = 40'000;
  const ScenePtr rest = walker(vertices);
  Hash128 hash;
  expectCancelledAnywhere("pose", 2 * vertices / 4096, [&](const StopToken& s) {  // morphed, then skinned
    const auto posed = posedScene(rest, "walk", 0.5, s);
    if (posed.ok()) hash = (*posed)->hash();
    return posed.status();
  });
  EXPECT_EQ((*posedScene(rest, "walk", 0.5))->hash(), hash);
  EXPECT_NE(hash, rest->hash());
  Scene copy = *rest;
  EXPECT_EQ(applyRestPose(*rest->rig, copy, stoppedAlready()).code(), Code::Cancelled);
}

}  // namespace
}  // namespace gobo::tests
