// SPDX-License-Identifier: Apache-2.0
// request.camera.shutter_s: a picture is the mean of the pictures of its slices, to the bit; a thing that moves evenly leaves a ramp; what does not move is as
// it was; what is of one moment is refused by name.
#include <gtest/gtest.h>

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <span>

#include "request/shutter.h"
#include "support/animated_scene.h"
#include "support/engines.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"
#include "trace/sample_passes.h"

namespace gobo::testing::shutter_test {
namespace {

/// An engine that has the scene of support/animated_scene.h as "moving".
std::unique_ptr<Engine> engineWithMoving(const char* name, int threads = 2) {
  static std::map<std::string, std::string> files;
  std::string& file = files[name];
  if (file.empty()) file = writeAnimatedScene(std::string("shutter-") + name);
  auto engine = makeEngine(256ull << 20, {}, threads);
  const auto opened = engine->openScene(file, "moving");
  EXPECT_TRUE(opened.ok()) << opened.status().toString();
  return engine;
}

v1::RenderRequest request(const std::vector<std::string>& edits, int spp = 16, const char* scene = "moving", int width = 24, int height = 18) {
  v1::RenderRequest r = smallRequest(scene, width, height, spp);
  for (const std::string& e : edits) set(r, e);
  return r;
}

/// A square of side^2 points whose morph target lifts one half of it; the weight goes from 0 to 1 in a second.
std::string writeMorphedScene(const std::string& name, int side) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::temp_directory_path() / ("gobo-morphed-" + name + "-" + std::to_string(::getpid()));
  fs::create_directories(folder);
  std::vector<float> points, normals, lifts;
  std::vector<uint32_t> corners;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      points.insert(points.end(), {2.0f * float(x) / float(side - 1) - 1.0f, 0.0f, 2.0f * float(y) / float(side - 1) - 1.0f});
      normals.insert(normals.end(), {0.0f, 1.0f, 0.0f});
      lifts.insert(lifts.end(), {0.0f, x < side / 2 ? 0.5f : 0.0f, 0.0f});
      const uint32_t at = uint32_t(y * side + x), below = at + uint32_t(side);
      if (x + 1 < side && y + 1 < side) corners.insert(corners.end(), {at, below, at + 1, at + 1, below, below + 1});
    }
  const float key[] = {0, 1, 0, 1};
  std::ofstream bin(folder / "data.bin", std::ios::binary);
  const auto write = [&](const auto& v) {
    bin.write(reinterpret_cast<const char*>(std::data(v)), std::streamsize(std::size(v) * sizeof(v[0])));
    return std::size(v) * sizeof(v[0]);
  };
  std::string views, accessors;
  size_t at = 0;
  const auto add = [&](size_t bytes, const std::string& accessor) {
    const std::string view = std::to_string(std::count(views.begin(), views.end(), '{'));
    views += (views.empty() ? "" : ",") + ("{\"buffer\":0,\"byteOffset\":" + std::to_string(at)) + ",\"byteLength\":" + std::to_string(bytes) + "}";
    accessors += (accessors.empty() ? "" : ",") + ("{\"bufferView\":" + view) + "," + accessor + "}";
    at += bytes;
  };
  const std::string vec3 = "\"componentType\":5126,\"type\":\"VEC3\",\"count\":" + std::to_string(side * side);
  add(write(points), vec3 + ",\"min\":[-1,0,-1],\"max\":[1,0,1]");
  add(write(normals), vec3);
  add(write(lifts), vec3 + ",\"min\":[0,0,0],\"max\":[0,0.5,0]");
  add(write(corners), "\"componentType\":5125,\"type\":\"SCALAR\",\"count\":" + std::to_string(corners.size()));
  add(write(key) / 2, "\"componentType\":5126,\"type\":\"SCALAR\",\"count\":2,\"min\":[0],\"max\":[1]");
  add(8, "\"componentType\":5126,\"type\":\"SCALAR\",\"count\":2");
  const fs::path file = folder / "morphed.gltf";
  std::ofstream(file) << R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0,1]}],"nodes":[{"mesh":0},{"camera":0,"translation":[0,0.6,4]}],
    "cameras":[{"type":"perspective","perspective":{"yfov":0.7,"znear":0.1}}],"meshes":[{"weights":[0],"primitives":[{"attributes":{"POSITION":0,"NORMAL":1},
    "indices":3,"targets":[{"POSITION":2,"NORMAL":2}]}]}],"animations":[{"samplers":[{"input":4,"output":5}],"channels":[{"sampler":0,"target":{"node":0,"path":"weights"}}]}],
    "accessors":[)" << accessors
                      << "],\"bufferViews\":[" << views << "],\"buffers\":[{\"uri\":\"data.bin\",\"byteLength\":" << at << "}]}";
  return file.string();
}

const char* const kOutputs = "outputs=beauty,emission,direct,indirect,diffuse,specular,albedo,alpha,sample_count,group:lamp";

/// The mean of what the slices are without a shutter, which an engine of its own renders one by one.
std::vector<std::vector<float>> meanOfMoments(const v1::RenderRequest& r, uint32_t slices, uint32_t samples, const char* name) {
  const auto engine = engineWithMoving(name);
  std::vector<std::vector<double>> sums;
  for (uint32_t k = 0; k < slices; ++k) {
    v1::RenderRequest moment = r;
    moment.mutable_camera()->clear_shutter_s();
    moment.mutable_camera()->clear_shutter_slices();
    moment.set_time_s(r.time_s() + (k + 0.5) / slices * r.camera().shutter_s());
    moment.set_seed(sliceSeed(r.seed(), k, slices));
    moment.mutable_halt()->set_spp(samples);
    const RenderResult one = mustRender(*engine, moment);
    sums.resize(one.images.size());
    for (size_t i = 0; i < one.images.size(); ++i) {
      const auto pixels = one.images[i].pixels();
      sums[i].resize(pixels.size(), 0.0);
      for (size_t p = 0; p < pixels.size(); ++p) sums[i][p] += double(pixels[p]);
    }
  }
  std::vector<std::vector<float>> out;
  for (int i = 0; i < int(sums.size()); ++i) {
    const double share = r.outputs_size() > i && r.outputs(i) == "sample_count" ? 1.0 : 1.0 / slices;
    out.emplace_back();
    for (const double v : sums[size_t(i)]) out.back().push_back(float(v * share));
  }
  return out;
}

std::string differenceTo(const RenderResult& r, const std::vector<std::vector<float>>& expected) {
  if (r.images.size() != expected.size()) return "another number of pictures";
  for (size_t i = 0; i < expected.size(); ++i) {
    const auto pixels = r.images[i].pixels();
    if (pixels.size() != expected[i].size()) return r.images[i].output + " has another size";
    for (size_t p = 0; p < pixels.size(); ++p)
      if (std::memcmp(&pixels[p], &expected[i][p], sizeof(float)) != 0)
        return r.images[i].output + "[" + std::to_string(p) + "]: " + std::to_string(pixels[p]) + " instead of " + std::to_string(expected[i][p]);
  }
  return {};
}

/// Where no path is traced: light by shadow techniques.
const char* const kUntraced = "integrator.indirect=false";

TEST(Shutter, IsTheMeanOfThePicturesOfItsSlices) {
  const std::vector<std::vector<std::string>> cases{
      {"time_s=0.1", "shadows.ray_traced.samples=2", kUntraced, kOutputs},
      {"animation=lamp", "time_s=0.3", "shadows.ray_traced.samples=1", kUntraced, kOutputs, "seed=7"},
      {"animation=dolly", "shadows.ray_traced.samples=1", kUntraced, "variant=red", "outputs=beauty,alpha", "integrator.max_groups=1"},
      {"animation=*", "time_s=-0.2", "lights.lamp.shadow.moment.bleeding_reduction=0.1", "lights.lamp.shadow.map.resolution=32",
       "lights.still.shadow.ray_traced.samples=2", kUntraced, "outputs=beauty,direct,group:lamp"},
      {"animation=lamp", "lights.area.kind=RECT", "lights.area.position=0,2,0.5", "lights.area.direction=0,-1,0", "lights.area.shadow.axis_aligned.k=3",
       "shadows.ray_traced.samples=1", kUntraced, "outputs=direct,specular"},
      {"environment.sky.turbidity=3", "environment.extract_lights=4", "shadows.ray_traced.samples=1", kUntraced, "lights.still.gain=0,2,1", "outputs=direct"},
      // What is in the camera's first look alone, through a lens and clipped.
      {"animation=*", "camera.lens_radius=0.05", "camera.focus_distance=3.5", "camera.clip_near=3.6", "outputs=albedo,alpha"},
  };
  for (const auto& edits : cases) {
    v1::RenderRequest r = request(edits);
    set(r, "camera.shutter_s=0.7");
    set(r, "camera.shutter_slices=4");
    SCOPED_TRACE(messageToJson(r, false));
    const RenderResult blurred = mustRender(*engineWithMoving("mean"), r);
    EXPECT_EQ(differenceTo(blurred, meanOfMoments(r, 4, 4, "mean")), "");
  }
}

double rmsBetween(std::span<const float> a, std::span<const float> b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += std::pow(double(a[i]) - double(b[i]), 2);
  return std::sqrt(sum / double(a.size()));
}

TEST(Shutter, TracedLightIsTheMeanOfItsMomentsWithinItsNoise) {
  for (const std::vector<std::string>& edits : std::vector<std::vector<std::string>>{
           {"animation=*", "environment.constant=0.2,0.3,0.5", "outputs=beauty,indirect"},
           {"animation=lamp", "camera.lens_radius=0.05", "camera.focus_distance=3.5", "environment.background=BLURRED", "environment.sky.turbidity=3",
            "outputs=beauty,indirect"},
       }) {
    v1::RenderRequest r = request(edits, 256);
    set(r, "camera.shutter_s=0.9");
    set(r, "camera.shutter_slices=4");
    set(r, "integrator.sampler=INDEPENDENT");
    v1::RenderRequest reseeded = r;
    reseeded.set_seed(1);
    const auto engine = engineWithMoving("traced");
    const RenderResult one = mustRender(*engine, r), other = mustRender(*engine, reseeded);
    const auto mean = meanOfMoments(r, 4, 64, "traced");
    for (size_t i = 0; i < 2; ++i) {
      const double noise = rmsBetween(one.images[i].pixels(), other.images[i].pixels());
      EXPECT_GT(noise, 0.0);
      EXPECT_NEAR(rmsBetween(one.images[i].pixels(), mean[i]) / noise, 1.0, 0.2) << one.images[i].output;
    }
  }
}

TEST(Shutter, MeshesThatDeformAreTheMeanOfTheirPoses) {
  const std::string file = writeMorphedScene("small", 5);
  const auto render = [&](const v1::RenderRequest& r) {
    const auto engine = makeEngine();
    const auto opened = engine->openScene(file, "moving");
    EXPECT_TRUE(opened.ok()) << opened.status().toString();
    const auto prepared = engine->prepare(r);
    EXPECT_TRUE(prepared.ok()) << prepared.status().toString();
    return std::pair(mustRender(*engine, r), prepared.ok() ? prepared->pinnedBytes : 0);
  };
  v1::RenderRequest r = request({"camera.shutter_s=0.9", "camera.shutter_slices=2", "outputs=alpha,albedo", "environment.constant=1,1,1"}, 8);
  const auto [blurred, bytes] = render(r);
  std::vector<double> sum(blurred.images[0].pixels().size());
  for (uint32_t k = 0; k < 2; ++k) {
    v1::RenderRequest moment = r;
    moment.mutable_camera()->Clear();
    moment.set_time_s(0.225 + 0.45 * k);
    moment.set_seed(sliceSeed(0, k, 2));
    moment.mutable_halt()->set_spp(4);
    const RenderResult one = render(moment).first;
    for (size_t p = 0; p < sum.size(); ++p) sum[p] += double(one.images[0].pixels()[p]);
  }
  for (size_t p = 0; p < sum.size(); ++p) EXPECT_EQ(blurred.images[0].pixels()[p], float(sum[p] * 0.5));
  // Both poses are there while it renders.
  v1::RenderRequest rigid = r;
  rigid.mutable_camera()->set_shutter_slices(4);
  const uint64_t of4 = render(rigid).second;
  EXPECT_GT(of4, bytes + 2 * 25 * 2 * sizeof(Vec3));
}

TEST(Shutter, PosesThatWouldNotFitAreRefusedBeforeTheyAreMade) {
  const std::string file = writeMorphedScene("large", 450);  // 4.9 MB a pose
  const auto engine = makeEngine();
  const auto opened = engine->openScene(file, "moving");
  ASSERT_TRUE(opened.ok()) << opened.status().toString();
  v1::RenderRequest r = request({"camera.shutter_s=1", "camera.shutter_slices=256"}, 256, "moving", 8, 6);
  const auto many = engine->prepare(r);
  ASSERT_FALSE(many.ok());
  EXPECT_EQ(many.status().code(), Code::ResourceExhausted);
  EXPECT_EQ(many.status().location(), "request.camera.shutter_slices") << many.status().toString();
  EXPECT_NE(many.status().message().find("MiB; must be at most 1024"), std::string::npos) << many.status().toString();
  r.mutable_camera()->set_shutter_slices(2);
  EXPECT_TRUE(engine->prepare(r).ok());
  std::filesystem::remove_all(std::filesystem::path(file).parent_path());
}

TEST(Shutter, CurvesMoveOverIt) {
  v1::RenderRequest r = request({"time_s=0.2", "camera.shutter_s=0.6", "camera.shutter_slices=3", "outputs=direct,alpha", "environment.extract_lights=2",
                                 "shadows.ray_traced.samples=1", kUntraced},
                                6);
  v1::Curve& x = (*r.mutable_curves())["camera.position"];
  for (const double t : {0.0, 1.0}) x.add_time_s(t);
  for (const double v : {0.0, 1.0, 4.0, 0.4, 1.2, 3.5}) x.add_value(v);
  v1::Curve& gain = (*r.mutable_curves())["lights.lamp.gain"];
  for (const double t : {0.0, 1.0}) gain.add_time_s(t);
  for (const double v : {0.0, 1.0, 1.0, 2.0, 0.5, 1.0}) gain.add_value(v);
  v1::Curve& turbidity = (*r.mutable_curves())["environment.sky.turbidity"];
  for (const double t : {0.0, 0.5, 0.6}) turbidity.add_time_s(t);
  for (const double v : {2.0, 2.0, 8.0}) turbidity.add_value(v);
  v1::Curve& exposure = (*r.mutable_curves())["tone_map.exposure"];  // of what is shown: at the opening
  for (const double t : {0.0, 1.0}) exposure.add_time_s(t);
  for (const double v : {0.0, 2.0}) exposure.add_value(v);
  const auto engine = engineWithMoving("curves");
  const RenderResult blurred = mustRender(*engine, r);
  EXPECT_EQ(differenceTo(blurred, meanOfMoments(r, 3, 2, "curves")), "");
  EXPECT_EQ(blurred.reply.resolved().curves_size(), 3);
  EXPECT_NEAR(blurred.reply.resolved().tone_map().exposure(), 0.4, 1e-12);
  // Sent again, the reply's request is the same picture; a relight of what a curve says replaces the curve.
  const RenderResult again = mustRender(*engineWithMoving("curves"), blurred.reply.resolved());
  EXPECT_EQ(firstDifference(blurred, again), "");
  EXPECT_EQ(again.reply.request_hash(), blurred.reply.request_hash());
  v1::RelightRequest relight;
  relight.set_render_id(blurred.reply.render_id());
  relight.add_mask("lights.lamp.gain");
  set(*relight.mutable_patch(), "lights.lamp.gain=1,0,0");
  const auto asked = engine->relightRequest(relight);
  ASSERT_TRUE(asked.ok());
  EXPECT_EQ(asked->curves_size(), 2);
  EXPECT_TRUE(asked->curves().count("camera.position"));
  set(r, "lights.lamp.gain=1,0,0");
  r.mutable_curves()->erase("lights.lamp.gain");
  EXPECT_EQ(firstDifference(mustRender(*engine, *asked), mustRender(*engineWithMoving("curves"), r)), "");
  // Of a scene without an animation curves alone move.
  v1::RenderRequest still = request({"camera.shutter_s=1", "camera.shutter_slices=2"}, 2, "cornell");
  EXPECT_EQ(engine->resolve(still)->camera().shutter_slices(), 1u);
  v1::Curve& yfov = (*still.mutable_curves())["camera.yfov_deg"];
  for (const double t : {0.0, 1.0}) yfov.add_time_s(t);
  for (const double v : {30.0, 50.0}) yfov.add_value(v);
  EXPECT_EQ(engine->resolve(still)->camera().shutter_slices(), 2u);
}

/// By column: what the board leaves of its slide, and what it should. It is 0.6 wide and slides 0.6 in a second: each place is covered for a time that grows
/// evenly over 24 pixels and falls as evenly over the next 24.
struct Ramp {
  std::vector<double> made, ofSlices, ofMotion;
};

Ramp rampOf(int slices, bool perspective) {
  v1::RenderRequest r = request({"camera.position=0,3,0", "camera.look_at=0,0,0", "camera.up=0,0,-1", "environment.background=TRANSPARENT",
                                 "environment.constant=1,1,1", "camera.clip_far=2.8", "camera.shutter_s=1", "camera.shutter_slices=" + std::to_string(slices)},
                                32 * slices, "moving", 80, 16);
  // The board lies 2.5 below: 16 rows of 0.025, and it is more than those high.
  if (perspective) set(r, "camera.focal_x=100");
  else set(r, "camera.orthographic_height=0.4");
  const RenderResult result = mustRender(*engineWithMoving("ramp"), r);
  const Image& image = result.images[0].image();
  EXPECT_EQ(image.channels, 4);
  Ramp ramp;
  for (int x = 0; x < image.width; ++x) {
    const double from = (x - 40) * 0.025, middle = from + 0.0125;
    double mean = 0, covered = 0;
    for (int y = 0; y < image.height; ++y) mean += double(image.at(x, y)[3]) / image.height;
    for (int k = 0; k < slices; ++k) {
      const double at = 0.6 * (k + 0.5) / slices;
      covered += std::max(0.0, std::min(from + 0.025, at + 0.3) - std::max(from, at - 0.3)) / 0.025 / slices;
    }
    ramp.made.push_back(mean);
    ramp.ofSlices.push_back(covered);
    ramp.ofMotion.push_back(std::max(0.0, std::min((middle + 0.3) / 0.6, 1 - (middle - 0.3) / 0.6)));
  }
  return ramp;
}

TEST(Shutter, WhatMovesEvenlyLeavesARampOfCoverage) {
  for (const bool perspective : {false, true}) {
    double before = 1;
    for (const int slices : {1, 2, 4, 8, 16, 64}) {
      if (slices == 64 && perspective && !thorough()) continue;  // as many samples as twice all the others
      const Ramp ramp = rampOf(slices, perspective);
      double sum = 0, most = 0, noise = 0;
      for (size_t x = 0; x < ramp.made.size(); ++x) {
        noise = std::max(noise, std::fabs(ramp.made[x] - ramp.ofSlices[x]));
        most = std::max(most, std::fabs(ramp.made[x] - ramp.ofMotion[x]));
        sum += std::pow(ramp.made[x] - ramp.ofMotion[x], 2) / 48;  // columns that the board comes to
      }
      EXPECT_LT(noise, 0.01) << slices << " slices";
      EXPECT_LT(most, 0.5 / slices + 0.01) << slices << " slices: half a step";
      EXPECT_LT(std::sqrt(sum), 1.02 / (slices * std::sqrt(12.0)) + 0.002) << slices << " slices: steps of 1 / slices";
      EXPECT_LT(std::sqrt(sum), 0.6 * before) << slices << " slices";
      std::printf("%2d slices, %s: error of the ramp %.4f at most, rms %.4f; of the slices %.4f at most\n", slices,
                  perspective ? "perspective " : "orthographic", most, std::sqrt(sum), noise);
      before = std::sqrt(sum);
    }
  }
}

TEST(Shutter, NoneIsAsItWas) {
  const auto engine = engineWithMoving("none");
  v1::RenderRequest plain = request({"time_s=0.4", "outputs=beauty,depth,motion,variance"});
  const RenderResult moment = mustRender(*engine, plain);
  for (const char* nothing : {"camera.shutter_s=0", "camera.shutter_slices=5"}) {
    v1::RenderRequest same = plain;
    set(same, nothing);
    const RenderResult r = mustRender(*engine, same);
    EXPECT_TRUE(nodesBy(r, v1::NodeReport::RUN).empty()) << nothing;
    EXPECT_EQ(firstDifference(moment, r), "") << nothing;
  }
}

TEST(Shutter, ASceneThatCannotMoveIsPlannedWithoutOne) {
  const auto engine = makeEngine();
  v1::RenderRequest plain = request({"outputs=beauty,depth", "denoise.wavelet.levels=2", "seed=3"}, 16, "cornell"), open = plain;
  set(open, "camera.shutter_s=0.5");
  const RenderResult moment = mustRender(*engine, plain), r = mustRender(*engine, open);
  EXPECT_TRUE(nodesBy(r, v1::NodeReport::RUN).empty());
  EXPECT_EQ(firstDifference(moment, r), "");
  EXPECT_EQ(r.reply.resolved().camera().shutter_slices(), 1u);
  ASSERT_EQ(r.reply.warnings_size(), 1);
  EXPECT_NE(r.reply.warnings(0).find("camera.shutter_s"), std::string::npos);
}

TEST(Shutter, WhatRestsHasTheSamplesOfAMoment) {
  const auto engine = engineWithMoving("rest");
  for (const char* sampler : {"integrator.sampler=SOBOL", "integrator.sampler=HALTON", "integrator.sampler=INDEPENDENT"})
    for (const auto& [slices, spp] : {std::pair("4", 4), std::pair("4", 8), std::pair("16", 64), std::pair("3", 48), std::pair("2", 64)}) {
      v1::RenderRequest r = request({"time_s=4", "outputs=beauty,direct,indirect_diffuse,albedo,alpha,group:lamp", "environment.sky.turbidity=3", sampler,
                                     "environment.background=TRANSPARENT", "camera.lens_radius=0.02", "camera.focus_distance=4"},
                                    spp);
      const RenderResult moment = mustRender(*engine, r);
      set(r, "camera.shutter_s=1");
      set(r, std::string("camera.shutter_slices=") + slices);
      const RenderResult open = mustRender(*engine, r);
      EXPECT_EQ(moment.reply.resolved().halt().spp(), open.reply.resolved().halt().spp());
      for (size_t i = 0; i < open.images.size(); ++i) {
        const auto a = moment.images[i].pixels(), b = open.images[i].pixels();
        int far = 0;
        for (size_t p = 0; p < a.size(); ++p) far += std::fabs(a[p] - b[p]) > 1e-5f * (1.0f + std::fabs(a[p]));
        EXPECT_LE(far, int(a.size() / 200)) << open.images[i].output << ", " << slices << " slices, " << sampler << ": each sample is traced, but for rounding";
      }
    }
}

TEST(Shutter, SlicesShareASequenceToTheLastNumber) {
  for (const uint32_t slices : {1u, 2u, 3u, 16u})
    for (uint32_t passes = 1; passes < 9; ++passes) {
      std::set<uint32_t> all;
      for (uint32_t k = 0; k < slices; ++k)
        for (uint32_t i = 0; i < passes; ++i) {
          const SamplePass pass = samplePass(i);
          const uint32_t first = sharedFirst(pass.block * kBlockSamples + pass.first, pass.count, {k, slices});
          EXPECT_EQ(first % pass.count, 0u) << "an aligned part is a net";
          for (uint32_t n = 0; n < pass.count; ++n) EXPECT_TRUE(all.insert(first + n).second) << "twice";
        }
      EXPECT_EQ(all.size(), size_t(slices) * samplesOf(passes));
      EXPECT_EQ(*all.rbegin() + 1, slices * samplesOf(passes));
    }
}

TEST(Shutter, AreDenoised) {
  v1::RenderRequest r = request({"animation=*", "camera.shutter_s=0.6", "camera.shutter_slices=4", "outputs=beauty,indirect", "environment.sky.turbidity=3"},
                                16, "moving", 48, 36);
  const auto engine = engineWithMoving("denoise");
  v1::RenderRequest many = r;
  many.mutable_halt()->set_spp(thoroughOr(4096u, 1024u));
  many.set_seed(5);
  const RenderResult truth = mustRender(*engine, many), noisy = mustRender(*engine, r);
  for (const char* filter : {"denoise.wavelet.levels=3", "denoise.auto.fast=true", "denoise.auto.fast=false", "denoise.axis_aligned.radius_px=8"}) {
    v1::RenderRequest smooth = r;
    set(smooth, filter);
    const RenderResult made = mustRender(*engine, smooth);
    EXPECT_LT(rmsBetween(made.images[0].pixels(), truth.images[0].pixels()), 0.9 * rmsBetween(noisy.images[0].pixels(), truth.images[0].pixels())) << filter;
    smooth.mutable_window()->set_x(7);
    smooth.mutable_window()->set_y(9);
    smooth.mutable_window()->set_width(20);
    smooth.mutable_window()->set_height(11);
    const RenderResult part = mustRender(*engineWithMoving("denoise"), smooth);
    const Image &a = made.images[0].image(), &b = part.images[0].image();
    int other = 0;
    for (int y = 0; y < b.height; ++y)
      for (int x = 0; x < b.width; ++x) other += std::memcmp(a.at(x + 7, y + 9), b.at(x, y), 3 * sizeof(float)) != 0;
    EXPECT_EQ(other, 0) << filter;
    // The bound of bytes knows the halves, also where time alone ends it.
    smooth.clear_window();
    for (const bool open : {false, true}) {
      smooth.clear_halt();
      if (open) smooth.mutable_halt()->set_time_s(0.1);
      else smooth.mutable_halt()->set_spp(16);
      const auto cold = engineWithMoving("denoise");
      const auto prepared = cold->prepare(smooth);
      ASSERT_TRUE(prepared.ok()) << prepared.status().toString();
      EXPECT_LE(mustRender(*cold, smooth).reply.peak_bytes(), prepared->pinnedBytes) << filter;
    }
  }
}

/// Errors of pictures of `moving` with so many samples, as sampled and filtered.
struct Errors {
  double noisy = 0, filtered = 0;
};
Errors errorsOf(Engine& engine, v1::RenderRequest r, const RenderResult& truth, const std::vector<std::string>& edits) {
  Errors e;
  e.noisy = rmsBetween(mustRender(engine, r).images[0].pixels(), truth.images[0].pixels());
  for (const std::string& a : edits) set(r, a);
  e.filtered = rmsBetween(mustRender(engine, r).images[0].pixels(), truth.images[0].pixels());
  return e;
}

TEST(Shutter, TheMeanOfSlicesIsFilteredAndNotEachSlice) {
  // Filters know what samples there are: those of all slices. One sample a slice, too, where every other slice is a half.
  const auto engine = engineWithMoving("mean");
  v1::RenderRequest r =
      request({"animation=*", "camera.shutter_s=0.6", "outputs=beauty", "environment.sky.turbidity=3"}, thoroughOr(2048, 1024), "moving", 64, 48);
  set(r, "camera.shutter_slices=16");
  const RenderResult truth = mustRender(*engine, r);
  for (const auto& [slices, spp] : {std::pair(16, 16), {16, 64}, {3, 12}, {5, 5}}) {
    v1::RenderRequest few = r;
    few.mutable_camera()->set_shutter_slices(uint32_t(slices));
    few.mutable_halt()->set_spp(uint32_t(spp));
    few.set_seed(3);
    for (const char* filter : {"denoise.wavelet.levels=4", "denoise.non_local_means.radius_px=5", "denoise.auto.fast=true"}) {
      const Errors e = errorsOf(*engine, few, truth, {filter});
      std::printf("%2d slices, %2d samples, %-35s %.4f, as sampled %.4f\n", slices, spp, filter, e.filtered, e.noisy);
      EXPECT_LT(e.filtered, 0.8 * e.noisy) << slices << " " << spp << " " << filter;
    }
  }
  // One filter a picture, whatever the number of slices.
  set(r, "denoise.wavelet.levels=4");
  r.mutable_halt()->set_spp(16);
  const RenderResult made = mustRender(*engine, r);
  int filters = 0;
  for (const auto& n : made.reply.plan()) filters += n.node().find("by wavelet") != std::string::npos ? int(n.count()) : 0;
  EXPECT_EQ(filters, 1);
}

TEST(Shutter, ALensMayOpenBetweenSlices) {
  // Slices of a pinhole among those of a lens: their blur is none.
  const auto engine = engineWithMoving("opens");
  v1::RenderRequest r = request({"animation=*", "camera.shutter_s=1", "camera.shutter_slices=4", "camera.focus_distance=3", "outputs=beauty,direct",
                                 "curves.camera.lens_radius.time_s=0.5,1", "curves.camera.lens_radius.value=0,0.1", "environment.sky.turbidity=3"},
                                8, "moving", 64, 48);
  v1::RenderRequest many = r;
  many.mutable_halt()->set_spp(thoroughOr(2048u, 512u));
  const RenderResult truth = mustRender(*engine, many);
  const Errors e = errorsOf(*engine, r, truth, {"denoise.wavelet.levels=3"});
  EXPECT_LT(e.filtered, 0.8 * e.noisy);
}

/// Of a scene that was made here.
Image made(Engine& engine, const ScenePtr& scene, const v1::RenderRequest& r) {
  RenderControl control;
  control.scene = scene;
  Result<RenderResult> result = engine.render(r, control);
  EXPECT_TRUE(result.ok()) << result.status().toString() << "\n" << messageToJson(r, true);
  return result.ok() ? result->images[0].image() : Image(r.width(), r.height(), 3);
}

// A thing in focus that moves over a background out of focus: where it was in any slice the features are sharp, whatever the others show there.
TEST(Shutter, WhatIsSharpInOneSliceIsNotBlurred) {
  tests::SceneMaker m;
  m.instance(m.mesh(tests::quad(Vec3(-0.3f, -0.3f, -2), Vec3(0.5f, 0, 0), Vec3(0, 0.5f, 0)), m.material(Vec3(0.05f, 0.1f, 0.3f))));
  m.instance(m.mesh(tests::quad(Vec3(-9, -6, -9), Vec3(18, 0, 0), Vec3(0, 12, 0)), m.material(Vec3(0.8f, 0.7f, 0.6f))));
  m.camera(Vec3(0.0f), Vec3(0, 0, -1));
  const ScenePtr scene = m.finish();
  v1::RenderRequest r =
      request({"camera.shutter_s=1", "camera.shutter_slices=8", "camera.lens_radius=0.3", "camera.focus_distance=2", "outputs=beauty",
               "environment.sky.turbidity=3", "environment.background=TRANSPARENT", "integrator.max_bounces=2", "curves.camera.position.time_s=0,1",
               "curves.camera.position.value=0,0,0,0.6,0.2,0", "curves.camera.look_at.time_s=0,1", "curves.camera.look_at.value=0,0,-1,0.6,0.2,-1"},
              8, "by hand", 64, 48);
  const auto engine = makeEngine();
  v1::RenderRequest many = r;
  many.mutable_halt()->set_spp(thoroughOr(4096u, 1024u));
  const Image truth = made(*engine, scene, many), noisy = made(*engine, scene, r);
  // With the mean of the slices' blurs 0.098, 0.133 and 0.096 of the noise are left.
  for (const auto& [filter, left] :
       {std::pair("denoise.wavelet.levels=4", 0.08), {"denoise.first_order.radius_px=5", 0.11}, {"denoise.auto.fast=true", 0.083}}) {
    v1::RenderRequest smooth = r;
    set(smooth, filter);
    const double filtered = rmsBetween(made(*engine, scene, smooth).data, truth.data), sampled = rmsBetween(noisy.data, truth.data);
    std::printf("%-35s %.4f, as sampled %.4f\n", filter, filtered, sampled);
    EXPECT_LT(filtered, left * sampled) << filter;
  }
}

// A slice of one sample has one of the pixel's view samples: which one takes turns, where photons are gathered as where paths are traced.
TEST(Shutter, CausticsAtViewSamplesTakeTurns) {
  tests::SceneMaker m;
  const int black = m.material(Vec3(0.0f)), white = m.material(Vec3(0.8f));
  for (int k = -32; k < 32; ++k)  // stripes of a third of a pixel
    m.instance(m.mesh(tests::quad(Vec3(float(k) / 24, 0, 2), Vec3(1.0f / 24, 0, 0), Vec3(0, 0, -4)), k % 2 ? black : white));
  m.instance(m.mesh(tests::box(Vec3(-2, 0.6f, -2), Vec3(2, 0.65f, 2)), m.material(Vec3(1.0f), [](Material& pane) {
    pane.bsdf = {};
    pane.bsdf.roughness = 0;
    pane.bsdf.transmission = 1;
    pane.bsdf.thickness = 1;
    pane.bsdf.ior = 1.002f;
  })));
  m.camera(Vec3(0.2f, 1.4f, 2.2f), Vec3(0, 0, 0.1f));
  const ScenePtr scene = m.finish();
  const auto engine = makeEngine();
  const auto picture = [&](int slices) {
    v1::RenderRequest r =
        request({"lights.lamp.kind=SPOT", "lights.lamp.position=0,1.5,0", "lights.lamp.direction=0,-1,0", "lights.lamp.intensity=40",
                 "integrator.at_view_samples=true", "view_samples=4", "integrator.max_bounces=4", "integrator.caustic_radius=0.004", "outputs=beauty"},
                16, "by hand", 24, 18);
    r.mutable_integrator()->set_caustic_photons(uint32_t(800'000 / std::max(slices, 1)));
    if (slices > 0) {
      set(r, "camera.shutter_s=1");
      r.mutable_camera()->set_shutter_slices(uint32_t(slices));
      set(r, "curves.lights.lamp.intensity.time_s=0,1");
      set(r, "curves.lights.lamp.intensity.value=40,40");
    }
    return made(*engine, scene, r);
  };
  const Image still = picture(0);
  const double turns = rmsBetween(picture(4).data, still.data), one = rmsBetween(picture(16).data, still.data);
  std::printf("mean %.3f; apart from the still one: 4 slices %.4f, 16 slices %.4f\n",
              std::accumulate(still.data.begin(), still.data.end(), 0.0) / double(still.data.size()), turns, one);
  EXPECT_GT(turns, 0);
  EXPECT_LT(one, 3 * turns) << "four samples a slice are even between them";
}

TEST(Shutter, WhatRestsIsDenoisedAsAMoment) {
  // Same samples, same features; halves are others, by which variances are.
  const auto engine = engineWithMoving("rest-denoised");
  const v1::RenderRequest rest =
      request({"time_s=4", "outputs=beauty", "environment.sky.turbidity=3", "environment.background=TRANSPARENT"}, 64, "moving", 64, 48);
  v1::RenderRequest many = rest;
  many.mutable_halt()->set_spp(thoroughOr(4096u, 2048u));
  const RenderResult truth = mustRender(*engine, many);
  for (const char* filter : {"denoise.wavelet.levels=4", "denoise.non_local_means.radius_px=5", "denoise.first_order.radius_px=5"}) {
    v1::RenderRequest r = rest;
    const Errors moment = errorsOf(*engine, r, truth, {filter});
    set(r, "camera.shutter_s=1");
    set(r, "camera.shutter_slices=16");
    const Errors open = errorsOf(*engine, r, truth, {filter});
    EXPECT_NEAR(open.noisy, moment.noisy, 1e-3 * moment.noisy) << filter;
    EXPECT_LT(open.filtered, 1.15 * moment.filtered) << filter;
    EXPECT_GT(open.filtered, 0.85 * moment.filtered) << filter;
  }
}

TEST(Shutter, AlphaAndWhatIsNotTracedAreNotFiltered) {
  const auto engine = engineWithMoving("alpha");
  v1::RenderRequest r = request({"animation=*", "camera.shutter_s=0.6", "camera.shutter_slices=5", "outputs=emission,beauty,alpha",
                                 "environment.sky.turbidity=3", "environment.background=TRANSPARENT", "integrator.max_bounces=1"},
                                20, "moving", 40, 30);
  const RenderResult plain = mustRender(*engine, r);
  set(r, "denoise.wavelet.levels=3");
  const RenderResult smooth = mustRender(*engine, r);
  ASSERT_EQ(smooth.images.size(), 3u);
  EXPECT_EQ(std::memcmp(plain.images[0].pixels().data(), smooth.images[0].pixels().data(), plain.images[0].pixels().size_bytes()), 0)
      << "what the camera sees of lights";
  const Image &a = plain.images[1].image(), &b = smooth.images[1].image();
  ASSERT_EQ(a.channels, 4);
  ASSERT_EQ(b.channels, 4);
  EXPECT_EQ(plain.images[1].names(), smooth.images[1].names());
  int other = 0, coloured = 0;  // but for rounding: a mean of alphas is now the alpha of a mean
  for (int y = 0; y < a.height; ++y)
    for (int x = 0; x < a.width; ++x) {
      other += std::fabs(a.at(x, y)[3] - b.at(x, y)[3]) > 1e-6f;
      coloured += a.at(x, y)[0] != b.at(x, y)[0];
    }
  EXPECT_EQ(other, 0);
  EXPECT_GT(coloured, 200) << "the light is filtered";
  // Nothing to filter: black light, and what is not traced as it was.
  set(r, "environment.gain=0");
  for (const char* off : {"lights.lamp.enabled=false", "lights.still.enabled=false"}) set(r, off);
  v1::RenderRequest dark = r;
  dark.clear_denoise();
  const RenderResult black = mustRender(*engine, r), none = mustRender(*engine, dark);
  for (size_t i = 0; i < none.images[1].pixels().size(); ++i) ASSERT_NEAR(black.images[1].pixels()[i], none.images[1].pixels()[i], 1e-6f);
}

TEST(Shutter, SamplesAreSharedOut) {
  const auto engine = engineWithMoving("shares");
  struct Share {
    uint32_t spp, asked, slices, realised;
  };
  for (const Share& s :
       std::vector<Share>{{64, 0, 16, 64}, {100, 0, 16, 128}, {5, 0, 5, 5}, {1, 0, 1, 1}, {24, 3, 3, 24}, {25, 3, 3, 48}, {300, 256, 256, 512}}) {
    v1::RenderRequest r = request({"camera.shutter_s=0.5", "outputs=beauty,sample_count"}, int(s.spp), "moving", 8, 6);
    if (s.asked) r.mutable_camera()->set_shutter_slices(s.asked);
    const RenderResult made = mustRender(*engine, r);
    EXPECT_EQ(shutterSlices(*engine->resolve(r)), s.slices);
    EXPECT_EQ(made.reply.resolved().halt().spp(), s.realised) << s.spp;
    EXPECT_EQ(made.images[1].pixels()[7], float(s.realised)) << s.spp;
    bool warned = false;
    for (const std::string& w : made.reply.warnings()) warned = warned || w.find("there are " + std::to_string(s.slices)) != std::string::npos;
    EXPECT_EQ(warned, s.slices < (s.asked ? s.asked : 16)) << s.spp;
    EXPECT_EQ(made.reply.resolved().camera().shutter_slices(), s.asked ? s.asked : 16u) << "a relight with more samples has them all";
    const RenderResult again = mustRender(*engineWithMoving("shares"), made.reply.resolved());
    EXPECT_EQ(firstDifference(made, again), "") << s.spp;
    EXPECT_EQ(again.reply.request_hash(), made.reply.request_hash());
    EXPECT_EQ(shutterSlices(again.reply.resolved()), s.slices);
  }
  // A moment's picture has the seed of the request; of several slices each has numbers of its own.
  EXPECT_EQ(sliceSeed(9, 0, 1), 9u);
  std::set<uint64_t> seeds;
  for (uint64_t seed : {0, 1, 2, 3})
    for (uint32_t k = 0; k < 256; ++k) seeds.insert(sliceSeed(seed, k, 256));
  EXPECT_EQ(seeds.size(), 4u * 256u);
}

TEST(Shutter, BitsDependOnNothingButTheRequest) {
  const int spp = thoroughOr(80, 40);
  v1::RenderRequest r = request({"animation=*", "camera.shutter_s=0.6", "camera.shutter_slices=5", "outputs=beauty,albedo,alpha,direct",
                                 "lights.area.kind=RECT", "lights.area.position=0,2,0.5", "lights.area.direction=0,-1,0",
                                 "lights.area.shadow.axis_aligned.radius_px=3", "lights.area.shadow.axis_aligned.dilate_px=1"},
                                spp, "moving", 150, 120);
  const RenderResult once = mustRender(*engineWithMoving("bits", 1), r);
  EXPECT_EQ(once.reply.resolved().halt().spp(), uint32_t(spp));
  // Other threads, and by the ladder.
  int snapshots = 0;
  RenderControl watched;
  watched.ladder = true;
  watched.snapshot = [&](const RenderResult& s) {
    EXPECT_EQ(s.reply.resolved().halt().spp() % 5, 0u);
    EXPECT_EQ(s.images[0].width(), snapshots++ == 0 ? 37 : 150);
  };
  const auto engine = engineWithMoving("bits", 3);
  const auto climbed = engine->render(r, watched);
  ASSERT_TRUE(climbed.ok()) << climbed.status().toString();
  EXPECT_GE(snapshots, 2);
  EXPECT_EQ(firstDifference(once, *climbed), "");
  // From a picture of fewer samples.
  const auto warm = engineWithMoving("bits");
  v1::RenderRequest fewer = r;
  fewer.mutable_halt()->set_spp(20);
  mustRender(*warm, fewer);
  const RenderResult extended = mustRender(*warm, r);
  EXPECT_EQ(firstDifference(once, extended), "");
  bool goesOn = false;
  for (const auto& row : extended.reply.plan()) goesOn = goesOn || row.reason() == "extended from 4 samples";
  EXPECT_TRUE(goesOn);
  // A part.
  for (const std::array<int, 4>& w : std::vector<std::array<int, 4>>{{0, 0, 150, 120}, {31, 17, 40, 22}, {149, 119, 1, 1}}) {
    v1::RenderRequest part = r;
    part.mutable_window()->set_x(uint32_t(w[0]));
    part.mutable_window()->set_y(uint32_t(w[1]));
    part.mutable_window()->set_width(uint32_t(w[2]));
    part.mutable_window()->set_height(uint32_t(w[3]));
    const RenderResult piece = mustRender(*engineWithMoving("bits"), part);
    for (size_t i = 0; i < once.images.size(); ++i) {
      const Image &a = once.images[i].image(), &b = piece.images[i].image();
      ASSERT_EQ(b.width, w[2]);
      ASSERT_EQ(b.height, w[3]);
      int other = 0;
      for (int y = 0; y < b.height; ++y)
        for (int x = 0; x < b.width; ++x) other += std::memcmp(a.at(x + w[0], y + w[1]), b.at(x, y), sizeof(float) * size_t(a.channels)) != 0;
      EXPECT_EQ(other, 0) << once.images[i].output << " " << w[2] << " x " << w[3];
    }
  }
}

TEST(Shutter, TimeEndsItAfterWholeRoundsOfSlices) {
  const auto engine = engineWithMoving("time");
  v1::RenderRequest r = request({"camera.shutter_s=0.5", "camera.shutter_slices=3", "halt.time_s=0.2"}, 1, "moving", 48, 36);
  r.mutable_halt()->clear_spp();
  const RenderResult made = mustRender(*engine, r);
  EXPECT_EQ(made.reply.resolved().halt().spp() % 3, 0u);
  EXPECT_GE(made.reply.resolved().halt().spp(), 3u);
  EXPECT_EQ(firstDifference(made, mustRender(*engineWithMoving("time"), made.reply.resolved())), "");
}

TEST(Shutter, ARelightTracesNothingAgain) {
  const auto engine = engineWithMoving("relight");
  v1::RenderRequest r = request({"camera.shutter_s=0.5", "camera.shutter_slices=3"});
  mustRender(*engine, r);
  set(r, "lights.lamp.gain=0,1,2");
  const RenderResult relit = mustRender(*engine, r);
  EXPECT_EQ(relit.reply.rays(), 0u);
  std::set<std::string> ran;
  for (const auto& [label, row] : nodesBy(relit, v1::NodeReport::RUN)) ran.insert(label);
  EXPECT_EQ(ran, (std::set<std::string>{"beauty:slice 1", "beauty:slice 2", "beauty:slice 3", "shutter"}));
  EXPECT_EQ(firstDifference(relit, mustRender(*engineWithMoving("relight"), r)), "");
}

TEST(Shutter, HoldsOneSliceAfterAnother) {
  const auto engine = engineWithMoving("bytes");
  for (const char* shadows : {"shadows=path_traced", "shadows.ray_traced.samples=1"}) {
    v1::RenderRequest r = request({"outputs=beauty,direct,albedo,sample_count", shadows}, 64, "moving", 160, 120);
    const auto moment = engine->prepare(r);
    ASSERT_TRUE(moment.ok()) << moment.status().toString();
    set(r, "camera.shutter_s=0.5");
    uint64_t bytes[2];
    int at = 0;
    for (const char* slices : {"camera.shutter_slices=2", "camera.shutter_slices=64"}) {
      set(r, slices);
      const auto blurred = engine->prepare(r);
      ASSERT_TRUE(blurred.ok()) << blurred.status().toString();
      bytes[at++] = blurred->pinnedBytes;
      const RenderResult made = mustRender(*engineWithMoving("bytes"), r);
      EXPECT_LE(made.reply.peak_bytes() + 160 * 120 * (3 + 3 + 3 + 1) * sizeof(double), blurred->pinnedBytes) << slices << ", with the sums";
      EXPECT_GT(made.reply.peak_bytes() * 2, blurred->pinnedBytes) << slices;
    }
    EXPECT_LT(double(bytes[1]), 1.3 * double(bytes[0])) << "64 slices beside 2; but for small results";
    EXPECT_LT(bytes[1], 3 * moment->pinnedBytes);
  }
}

TEST(Shutter, WhatIsOfOneMomentIsRefusedByName) {
  const auto engine = engineWithMoving("refused");
  const auto refused = [&](std::initializer_list<const char*> edits, const std::string& location, const std::string& text, double shutter = 0.5) {
    v1::RenderRequest r = request({}, 16);
    r.mutable_camera()->set_shutter_s(shutter);
    for (const char* e : edits) set(r, e);
    const auto made = engine->render(r);
    ASSERT_FALSE(made.ok()) << text;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument);
    EXPECT_EQ(made.status().location(), location) << made.status().toString();
    EXPECT_NE(made.status().message().find(text), std::string::npos) << made.status().toString();
    EXPECT_FALSE(engine->prepare(r).ok());
  };
  for (const char* o : {"normal", "position", "depth", "z_depth", "object_id", "material_id", "motion", "variance", "unoccluded:lamp", "visibility:lamp",
                        "filtered:0", "shadow_distance:lamp", "shadow_flags:lamp", "shadow_rays:lamp", "shadow_width:lamp", "shadow_basis:lamp"})
    refused({(std::string("outputs=beauty,") + o).c_str()}, "request.outputs", std::string("shutter_s = 0.5") + std::string("00000: output '") + o + "'");
  refused({"denoise.outliers.trimmed.share=0.1"}, "request.denoise.outliers", "of one moment");
  refused({"certificate.pixel_fraction=0.5"}, "request.certificate", "of one moment");
  refused({"halt.error=0.1"}, "request.halt.error", "give halt.spp or time_s");
  const double none = std::numeric_limits<double>::quiet_NaN(), ever = std::numeric_limits<double>::infinity();
  refused({}, "request.camera.shutter_s", "camera.shutter_s", -0.1);
  refused({}, "request.camera.shutter_s", "camera.shutter_s", none);
  refused({}, "request.camera.shutter_s", "camera.shutter_s", ever);
  refused({}, "request.camera.shutter_s", "camera.shutter_s", 3601);
  refused({"camera.shutter_slices=0"}, "request.camera.shutter_slices", "at least 1");
  refused({"camera.shutter_slices=257"}, "request.camera.shutter_slices", "at most 256");
  refused({"halt.spp=1048576", "camera.shutter_slices=3"}, "request.halt.spp", "make it 1048608, more than 1048576");
}

TEST(Shutter, ACurveThatARelightGivesHolds) {
  const auto engine = engineWithMoving("given");
  const RenderResult first = mustRender(*engine, request({}, 16));
  v1::RelightRequest relight;
  relight.set_render_id(first.reply.render_id());
  (*relight.mutable_patch()->mutable_lights())["lamp"].set_intensity(3);
  (*relight.mutable_patch()->mutable_curves())["lights.lamp.intensity"];
  for (const char* path : {"lights.lamp", "curves"}) relight.add_mask(path);
  const auto made = engine->relightRequest(relight, "");
  ASSERT_TRUE(made.ok()) << made.status().toString();
  EXPECT_EQ(made->curves().count("lights.lamp.intensity"), 1u);
}

TEST(Shutter, WhatARelightSetsInMotionHasSlices) {
  const auto engine = engineWithMoving("set-in-motion");
  const v1::RenderRequest still = request({"camera.shutter_s=1"}, 8, "cornell");
  const RenderResult first = mustRender(*engine, still);
  EXPECT_EQ(first.reply.resolved().camera().shutter_slices(), 1u);
  v1::RelightRequest relight;
  relight.set_render_id(first.reply.render_id());
  relight.add_mask("curves");
  v1::Curve& yfov = (*relight.mutable_patch()->mutable_curves())["camera.yfov_deg"];
  for (const double t : {0.0, 1.0}) yfov.add_time_s(t);
  for (const double v : {30.0, 50.0}) yfov.add_value(v);
  const auto made = engine->relightRequest(relight, "");
  ASSERT_TRUE(made.ok()) << made.status().toString();
  v1::RenderRequest moving = still;
  *moving.mutable_curves() = relight.patch().curves();
  EXPECT_GT(engine->resolve(moving)->camera().shutter_slices(), 1u);
  EXPECT_EQ(firstDifference(mustRender(*engine, *made), mustRender(*engine, moving)), "");
  // One that was asked for stays.
  v1::RenderRequest one = moving;
  set(one, "camera.shutter_slices=1");
  relight.set_render_id(mustRender(*engine, one).reply.render_id());
  EXPECT_EQ(engine->relightRequest(relight, "")->camera().shutter_slices(), 1u);
}

TEST(Shutter, FiltersOfTheMeanAreThoseOfItsOpening) {
  const auto engine = engineWithMoving("filter-moves");
  v1::RenderRequest r = request({"time_s=0.2", "camera.shutter_s=0.6", "camera.shutter_slices=3", "filters[0].gaussian.sigma_px=1", "filters[1].term=direct",
                                 "filters[1].gaussian.sigma_px=1"},
                                6);
  v1::RenderRequest opening = r;
  set(opening, "filters[0].gaussian.sigma_px=1.4");
  for (const char* path : {"filters[0].gaussian.sigma_px", "filters[1].gaussian.sigma_px"}) {
    v1::Curve& sigma = (*r.mutable_curves())[path];
    for (const double t : {0.0, 1.0}) sigma.add_time_s(t);
    for (const double v : {1.0, 3.0}) sigma.add_value(v);
  }
  const auto resolved = engine->resolve(r);
  ASSERT_TRUE(resolved.ok()) << resolved.status().toString();
  for (uint32_t slice = 0; slice < 3; ++slice) {
    const auto at = sliceRequest(*resolved, slice);
    ASSERT_TRUE(at.ok()) << at.status().toString();
    EXPECT_NEAR(at->filters(0).gaussian().sigma_px(), 1.4, 1e-6) << "slice " << slice;
    EXPECT_NEAR(at->filters(1).gaussian().sigma_px(), 1.0 + 2.0 * (0.2 + 0.6 * (slice + 0.5) / 3), 1e-6) << "slice " << slice;
  }
  r.mutable_curves()->erase("filters[1].gaussian.sigma_px");
  EXPECT_EQ(firstDifference(mustRender(*engine, r), mustRender(*engine, opening)), "");
}

}  // namespace
}  // namespace gobo::testing::shutter_test
