// SPDX-License-Identifier: Apache-2.0
// Hard cases through the whole engine: scale, distance, contact, extreme lights, materials and maps. Every output is finite.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>

#include "base/image_io.h"
#include "support/engines.h"

namespace gobo::testing {
namespace {

void expectFinite(const RenderResult& r, const std::string& what) {
  for (const auto& image : r.images)
    for (float v : image.image().data) ASSERT_TRUE(std::isfinite(v)) << what << ": " << image.output;
}

double mean(const Image& image) {
  double sum = 0;
  for (float v : image.data) sum += v;
  return sum / double(image.data.size());
}

/// The techniques that read shadow maps, and exponents and orders at the ends of their ranges.
const std::vector<const char*> kMapTechniques{"shadow_map=",
                                              "percentage_closer.taps=4",
                                              "variance.min_variance=0",
                                              "convolution.order=1",
                                              "convolution.order=32",
                                              "exponential.c=80",
                                              "exponential.c=2000",
                                              "exponential.classification=Z_MAX",
                                              "exponential_variance.c_positive=42",
                                              "moment.bleeding_reduction=0.1"};

std::vector<const char*> withMaps(std::vector<const char*> techniques) {
  techniques.insert(techniques.end(), kMapTechniques.begin(), kMapTechniques.end());
  return techniques;
}

/// The cornell box with every technique at once, everything scaled by s.
v1::RenderRequest scaledRequest(double s, const char* technique) {
  v1::RenderRequest r = smallRequest("scaled", 24, 18, 16);
  const auto n = [&](double v) { return std::to_string(v * s * 1e6) + "e-6"; };
  set(r, "lights.key.kind=RECT");
  set(r, "lights.key.position=" + n(0.2) + "," + n(1.6) + "," + n(0.1));
  set(r, "lights.key.direction=0,-1,0");
  set(r, "lights.key.width=" + n(0.3));
  set(r, "lights.key.height=" + n(0.3));
  set(r, "lights.key.intensity=5");
  set(r, std::string("lights.key.shadow.") + technique);
  set(r, "lights.key.shadow.map.resolution=256");
  return r;
}

TEST(Stability, SceneScaleGivesTheSamePicture) {
  for (const char* technique : withMaps({"path_traced=", "ray_traced.samples=16", "axis_aligned.k=3"})) {
    std::map<double, RenderResult> results;
    for (double s : {1e-4, 1.0, 1e4}) {
      const auto engine = makeEngine();
      ASSERT_TRUE(engine->openScene("cornell", "scaled").ok());
      const auto info = *engine->inspectScene("scaled");
      // Scale by instance transforms; the camera moves by the request.
      v1::PatchSceneRequest p;
      p.set_scene("scaled");
      for (const auto& name : info.instance_names()) {
        auto& m = (*p.mutable_instances())[name];
        for (int k = 0; k < 16; ++k) m.add_matrix(k % 5 == 0 ? (k == 15 ? 1.0f : float(s)) : 0.0f);
      }
      const auto patched = engine->patchScene(p);
      ASSERT_TRUE(patched.ok()) << patched.status().toString();
      v1::RenderRequest r = scaledRequest(s, technique);
      const auto at = [&](double v) { return std::to_string(v * s * 1e6) + "e-6"; };
      set(r, "camera.position=" + at(0) + "," + at(1) + "," + at(3.2));
      set(r, "camera.look_at=" + at(0) + "," + at(1) + "," + at(0));
      results[s] = mustRender(*engine, r);
      expectFinite(results[s], technique);
    }
    const Image& one = results[1.0].images[0].image();
    ASSERT_GT(mean(one), 1e-3) << technique;
    for (double s : {1e-4, 1e4}) {
      const Image& other = results[s].images[0].image();
      double squared = 0;
      int outliers = 0;
      for (size_t i = 0; i < one.data.size(); ++i) {
        const double d = double(one.data[i]) - other.data[i];
        // A path that grazes an edge may round to the other side: such pixels are counted, the rest must agree to 1e-4.
        if (std::fabs(d) > 1e-4 * std::max(1.0, double(one.data[i]))) ++outliers;
        else squared += d * d;
      }
      EXPECT_LE(outliers, int(one.data.size()) / 50) << technique << " scale " << s;
      EXPECT_NEAR(mean(other), mean(one), 2e-3 * mean(one)) << technique << " scale " << s;
    }
  }
}

TEST(Stability, CameraFarOut) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 16);
  set(r, "camera.position=0,1,100000");
  set(r, "camera.look_at=0,1,0");
  set(r, "camera.yfov_deg=0.01");  // the smallest that requests may ask for: 17 m at this distance
  set(r, "outputs=beauty,depth,normal,position,albedo");
  const RenderResult far = mustRender(*engine, r);
  ASSERT_EQ(far.images.size(), 5u);
  expectFinite(far, "far camera");
  EXPECT_GT(mean(far.images[0].image()), 1e-4);
}

TEST(Stability, ExtremeLightsStayFinite) {
  const std::vector<std::vector<std::string>> cases{
      {"lights.x.kind=POINT", "lights.x.position=0,0.000001,0", "lights.x.intensity=1000000"},
      {"lights.x.kind=SPHERE", "lights.x.position=0,0.5,0.9", "lights.x.radius=0.000001", "lights.x.intensity=1000000000000"},
      {"lights.x.kind=RECT", "lights.x.position=0,0.000001,0.5", "lights.x.width=0.5", "lights.x.height=0.5", "lights.x.direction=0,-1,0",
       "lights.x.intensity=1000000"},
      {"lights.x.kind=RECT", "lights.x.position=0,1,0.9", "lights.x.width=0.000001", "lights.x.height=1000", "lights.x.intensity=1000"},
      {"lights.x.kind=SPOT", "lights.x.position=0,1,0.9", "lights.x.outer_deg=0.001", "lights.x.inner_deg=0", "lights.x.intensity=1000000"},
      {"lights.x.kind=DISK", "lights.x.position=0,1,0.9", "lights.x.radius=1000000", "lights.x.intensity=1"},
      {"lights.x.kind=DIRECTIONAL", "lights.x.direction=0,-1,0", "lights.x.intensity=1000000000000"},
      {"lights.x.kind=DIRECTIONAL", "lights.x.direction=0,-1,0", "lights.x.angular_size_deg=0.0001", "lights.x.intensity=1000000000000"},
      {"lights.x.kind=DIRECTIONAL", "lights.x.direction=0,-0.1,-1", "lights.x.angular_size_deg=90", "lights.x.intensity=1"},
      {"lights.x.kind=SPOT", "lights.x.direction=0,1,0", "lights.x.outer_deg=90", "lights.x.profile=LEAVES", "lights.x.intensity=1000000000000"},
      {"lights.x.kind=SPOT", "lights.x.direction=0,-1,0", "lights.x.outer_deg=0.001", "lights.x.profile=WINDOW", "lights.x.profile_rotation_deg=36000"},
  };
  for (const char* technique : withMaps({"path_traced=", "ray_traced.samples=4", "axis_aligned.k=3"})) {
    for (const auto& edits : cases) {
      const auto engine = makeEngine();
      v1::RenderRequest r = smallRequest("cornell", 12, 9, 4);
      for (const auto& e : edits) set(r, e);
      set(r, std::string("lights.x.shadow.") + technique);
      set(r, "lights.x.shadow.map.resolution=64");
      expectFinite(mustRender(*engine, r), edits[0] + " " + technique);
    }
  }
}

TEST(Stability, ContactAndOccluderOnTheLight) {
  const auto engine = makeEngine();
  // The light lies in the ceiling's plane and touches the tall block's side: slopes of 0 and infinity in one picture.
  v1::RenderRequest r = smallRequest("cornell", 24, 18, 4);
  for (const char* e : {"lights.x.kind=RECT", "lights.x.position=0,0.6,0", "lights.x.width=1.2", "lights.x.height=1.2", "lights.x.direction=0,-1,0",
                        "lights.x.intensity=2", "lights.x.shadow.axis_aligned.k=3", "outputs=beauty,visibility:x"})
    set(r, e);
  const RenderResult result = mustRender(*engine, r);
  expectFinite(result, "contact");
  for (float v : result.images[1].image().data) {
    EXPECT_GE(v, 0.0f);
    EXPECT_LE(v, 1.0f);
  }
}

TEST(Stability, OneTexelSunAndDamagedMap) {
  const auto folder = std::filesystem::temp_directory_path() / ("gobo-stability-" + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  Image sun(64, 32, 3);
  for (float& v : sun.data) v = 0.01f;
  for (int c = 0; c < 3; ++c) sun.at(20, 6)[c] = 1e4f;  // 10^6 : 1
  Image damaged = sun;
  damaged.at(3, 3)[0] = NAN;
  damaged.at(4, 3)[1] = INFINITY;
  damaged.at(5, 3)[2] = -1.0f;
  const auto write = [&](const Image& image, const char* name) {
    const auto bytes = encodeExr(image);
    ASSERT_TRUE(bytes.ok());
    ASSERT_TRUE(writeFileAtomic((folder / name).string(), bytes->data(), bytes->size()).ok());
  };
  write(sun, "sun.exr");
  write(damaged, "damaged.exr");
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("spheres", 32, 24, 64);
  r.mutable_environment()->set_path((folder / "sun.exr").string());
  set(r, "integrator.max_bounces=0");
  const RenderResult a = mustRender(*engine, r);
  set(r, "seed=9");
  const RenderResult b = mustRender(*engine, r);
  expectFinite(a, "sun");
  // Exact sampling of the map: two seeds agree closely though one texel holds nearly all the light.
  EXPECT_NEAR(mean(a.images[0].image()), mean(b.images[0].image()), 0.03 * mean(b.images[0].image()));
  r.mutable_environment()->set_path((folder / "damaged.exr").string());
  const RenderResult repaired = mustRender(*engine, r);
  expectFinite(repaired, "damaged map");
  EXPECT_NEAR(mean(repaired.images[0].image()), mean(b.images[0].image()), 0.03 * mean(b.images[0].image()));
  std::filesystem::remove_all(folder);
}

TEST(Stability, RoughnessAndIorExtremes) {
  for (double roughness : {0.0, 0.02, 1.0}) {
    for (double metallic : {0.0, 1.0}) {
      const auto engine = makeEngine();
      ASSERT_TRUE(engine->openScene("cornell", "c").ok());
      const auto info = *engine->inspectScene("c");
      v1::PatchSceneRequest p;
      p.set_scene("c");
      for (const auto& name : info.material_names()) {
        (*p.mutable_materials())[name].set_roughness(roughness);
        (*p.mutable_materials())[name].set_metallic(metallic);
      }
      ASSERT_TRUE(engine->patchScene(p).ok());
      v1::RenderRequest r = smallRequest("c", 12, 9, 16);
      set(r, "outputs=beauty,direct,indirect");
      expectFinite(mustRender(*engine, r), "roughness " + std::to_string(roughness));
    }
  }
}

}  // namespace
}  // namespace gobo::testing
