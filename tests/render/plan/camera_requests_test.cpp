// SPDX-License-Identifier: Apache-2.0
// Requests with intrinsics, clipping planes and panoramas: every picture and every output sees what the camera sees, and what cannot be is refused by name.
#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "base/sobol.h"
#include "plan/ladder.h"
#include "plan/outputs.h"
#include "support/engines.h"

namespace gobo::testing::camera_requests_test {
namespace {

v1::RenderRequest request(std::initializer_list<std::string> edits, const char* scene = "cornell", int width = 40, int height = 30, int spp = 16) {
  v1::RenderRequest r = smallRequest(scene, width, height, spp);
  for (const std::string& e : edits) set(r, e);
  return r;
}

double largestDifference(const Image& a, const Image& b) {
  double most = 0;
  for (size_t i = 0; i < a.data.size(); ++i) most = std::max(most, std::fabs(double(a.data[i]) - double(b.data[i])));
  return most;
}

TEST(CameraRequests, IntrinsicsOfAnAngleAreItsPicture) {
  const auto engine = makeEngine();
  v1::RenderRequest angle = request({"camera.yfov_deg=40", "outputs=beauty,position,motion,z_depth"}), focal = angle;
  focal.mutable_camera()->clear_yfov_deg();
  const double f = 15.0 / std::tan(20.0 * M_PI / 180.0);
  focal.mutable_camera()->set_focal_y(f);
  const RenderResult a = mustRender(*engine, angle), b = mustRender(*engine, focal);
  EXPECT_LT(largestDifference(a.images[1].image(), b.images[1].image()), 1e-4);
  double sum = 0;
  for (size_t i = 0; i < a.images[0].image().data.size(); ++i) sum += std::fabs(a.images[0].image().data[i] - b.images[0].image().data[i]);
  EXPECT_LT(sum / double(a.images[0].image().data.size()), 1e-3);  // a ray that is rounded may pass the other side of an edge
  // All four, square pixels and the middle: the same bits as by default.
  v1::RenderRequest all = focal;
  all.mutable_camera()->set_focal_x(f);
  all.mutable_camera()->set_center_x(20.0);
  all.mutable_camera()->set_center_y(15.0);
  EXPECT_EQ(firstDifference(b, mustRender(*engine, all)), "");
}

TEST(CameraRequests, APrincipalPointMovesThePictureByWholePixels) {
  const auto engine = makeEngine();
  v1::RenderRequest middle = request({"camera.focal_x=45", "outputs=position"}), moved = middle;
  moved.mutable_camera()->set_center_x(20.0 + 3.0);
  moved.mutable_camera()->set_center_y(15.0 - 2.0);
  const RenderResult at = mustRender(*engine, middle), by = mustRender(*engine, moved);
  const Image &a = at.images[0].image(), &b = by.images[0].image();
  int compared = 0;
  for (int y = 5; y < 25; ++y)
    for (int x = 5; x < 35; ++x) {
      const Vec3 p = a.rgb(x, y), q = b.rgb(x + 3, y - 2);  // the point that was at x is 3 pixels further right, 2 further up
      if (glm::length(p - q) < 1e-3f) ++compared;
    }
  EXPECT_GT(compared, 20 * 30 * 9 / 10);  // but at edges, where rounding decides
}

TEST(CameraRequests, PixelsThatAreNotSquareStretchIt) {
  const auto engine = makeEngine();
  const RenderResult square = mustRender(*engine, request({"camera.focal_x=45", "camera.focal_y=45", "outputs=position"}, "cornell", 40, 30));
  const RenderResult tall = mustRender(*engine, request({"camera.focal_x=45", "camera.focal_y=90", "outputs=position"}, "cornell", 40, 60));
  int same = 0;
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x) {
      const Vec3 p = 0.5f * (tall.images[0].image().rgb(x, 2 * y) + tall.images[0].image().rgb(x, 2 * y + 1));
      same += glm::length(p - square.images[0].image().rgb(x, y)) < 0.05f;
    }
  EXPECT_GT(same, 40 * 30 * 8 / 10);
}

TEST(CameraRequests, ThePlanesCutWhatTheCameraSeesAndNotTheLight) {
  const auto engine = makeEngine();
  const std::string at = "camera.position=0,1,3.4", to = "camera.look_at=0,1,0";
  v1::RenderRequest open = request({at, to, "outputs=z_depth,alpha,beauty,direct", "environment.constant=0.5,0.25,1"});
  const RenderResult all = mustRender(*engine, open);
  float lo = 1e30f, hi = 0;
  for (const float z : all.images[0].image().data) lo = z > 0 ? std::min(lo, z) : lo, hi = std::max(hi, z);
  ASSERT_LT(lo, hi);
  const float mid = 0.5f * (lo + hi);

  // Pixels all of whose neighbours lie in a range: no edge is near.
  const auto within = [&](int x, int y, float from, float to) {
    for (int v = std::max(y - 1, 0); v <= std::min(y + 1, 29); ++v)
      for (int u = std::max(x - 1, 0); u <= std::min(x + 1, 39); ++u)
        if (const float z = all.images[0].image().at(u, v)[0]; !(z >= from && z <= to) || all.images[1].image().at(u, v)[0] != 1.0f) return false;
    return true;
  };

  // Beyond everything and before everything: the same bits.
  v1::RenderRequest loose = open;
  loose.mutable_camera()->set_clip_near(0.0);
  loose.mutable_camera()->set_clip_far(100.0);
  EXPECT_EQ(firstDifference(all, mustRender(*engine, loose)), "");

  // The far half is gone: there the environment is seen; what is left has the bits that it had, its light comes from behind the plane as well.
  v1::RenderRequest near = open;
  near.mutable_camera()->set_clip_far(mid);
  const RenderResult front = mustRender(*engine, near);
  int gone = 0, kept = 0;
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x) {
      const float z = front.images[0].image().at(x, y)[0];
      EXPECT_LE(z, mid * 1.00001f);
      if (within(x, y, mid + 0.1f, 1e9f)) {
        EXPECT_EQ(front.images[1].image().at(x, y)[0], 0.0f) << x << "," << y;
        const Vec3 seen = front.images[2].image().rgb(x, y);
        if (glm::length(seen - Vec3(0.5f, 0.25f, 1.0f)) < 1e-5f) ++gone;
      } else if (within(x, y, 0.0f, mid - 0.1f)) {
        EXPECT_EQ(front.images[2].image().rgb(x, y), all.images[2].image().rgb(x, y)) << x << "," << y;
        ++kept;
      }
    }
  EXPECT_GT(gone, 50);
  EXPECT_GT(kept, 50);

  // The near half is gone: the camera sees through it, light does not.
  v1::RenderRequest behind = open;
  behind.mutable_camera()->set_clip_near(mid);
  const RenderResult back = mustRender(*engine, behind);
  int same = 0;
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x) {
      const float z = back.images[0].image().at(x, y)[0], before = all.images[0].image().at(x, y)[0];
      if (z > 0.0f) EXPECT_GE(z, mid * 0.99999f);
      if (within(x, y, mid + 0.1f, 1e9f)) {
        EXPECT_NEAR(z, before, 1e-4f);
        same += glm::length(back.images[2].image().rgb(x, y) - all.images[2].image().rgb(x, y)) < 0.02f;
      }
    }
  EXPECT_GT(same, 50);
}

TEST(CameraRequests, DepthAlongTheAxisIsTheDistanceTimesTheCosine) {
  const auto engine = makeEngine();
  for (const char* kind : {"camera.yfov_deg=60", "camera.orthographic_height=2", "camera.panorama=true"}) {
    v1::RenderRequest r = request({"camera.position=0.1,1,0.6", "camera.look_at=0,0.9,-0.5", kind, "outputs=depth,z_depth,position"});
    r.set_view_samples(1);
    const RenderResult made = mustRender(*engine, r);
    const Vec3 eye(0.1f, 1.0f, 0.6f), axis = glm::normalize(Vec3(0, 0.9f, -0.5f) - eye);
    const bool panorama = r.camera().panorama(), flat = r.camera().has_orthographic_height();
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < 40; ++x) {
        const float depth = made.images[0].image().at(x, y)[0], z = made.images[1].image().at(x, y)[0];
        if (depth == 0.0f) {
          EXPECT_EQ(z, 0.0f);
          continue;
        }
        const Vec3 p = made.images[2].image().rgb(x, y);
        EXPECT_NEAR(z, panorama || flat ? depth : glm::dot(p - eye, axis), 1e-4f) << kind << " " << x << "," << y;
      }
  }
}

TEST(CameraRequests, APanoramaOfAConstantEnvironmentIsConstant) {
  const auto engine = makeEngine();
  const RenderResult r = mustRender(*engine, request({"camera.panorama=true", "camera.clip_far=0.001", "environment.constant=0.5,0.25,1"}));
  for (size_t i = 0; i < r.images[0].image().pixels(); ++i) {
    EXPECT_EQ(r.images[0].image().data[3 * i], 0.5f);
    EXPECT_EQ(r.images[0].image().data[3 * i + 2], 1.0f);
  }
}

TEST(CameraRequests, APanoramaSeesWhatPinholesSee) {
  // A narrow pinhole along the ray of a panorama's pixel, path traced and by shadow technique: the same radiance up to noise and what a pixel covers.
  const auto engine = makeEngine();
  const int W = 64, H = 32;
  for (const char* technique : {"shadows.ray_traced.samples=16", "integrator.light_selection=TREE"}) {
    v1::RenderRequest around = request(
        {"camera.position=0.1,1.1,0.2", "camera.look_at=0.1,1.1,-1", "camera.panorama=true", technique, "integrator.max_bounces=0", "outputs=direct,position"},
        "cornell", W, H, 256);
    const RenderResult all = mustRender(*engine, around);
    int compared = 0, agree = 0;
    for (int k = 0; k < 24; ++k) {
      const int x = int(hash64(1, k) % uint64_t(W)), y = 4 + int(hash64(2, k) % uint64_t(H - 8));
      const Vec3 p = all.images[1].image().rgb(x, y);
      if (glm::length(p) < 1e-3f) continue;
      v1::RenderRequest one = around;
      one.mutable_camera()->clear_panorama();
      one.mutable_camera()->set_yfov_deg(180.0 / H);
      one.mutable_camera()->mutable_look_at()->set_x(p.x);
      one.mutable_camera()->mutable_look_at()->set_y(p.y);
      one.mutable_camera()->mutable_look_at()->set_z(p.z);
      one.set_width(1);
      one.set_height(1);
      const RenderResult narrow = mustRender(*engine, one);
      const float a = luminance(all.images[0].image().rgb(x, y)), b = luminance(narrow.images[0].image().rgb(0, 0));
      ++compared;
      agree += std::fabs(a - b) < 0.1f * std::max(a, b) + 0.01f;
    }
    EXPECT_GT(compared, 12);
    EXPECT_GE(agree, compared * 3 / 4) << technique;  // others lie at edges
  }
}

TEST(CameraRequests, WhatCannotBeIsRefusedByName) {
  const auto engine = makeEngine();
  const auto refused = [&](std::initializer_list<std::string> edits, const std::string& location, const std::string& text) {
    const auto made = engine->render(request(edits));
    ASSERT_FALSE(made.ok()) << text;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument);
    EXPECT_EQ(made.status().location(), location) << made.status().toString();
    EXPECT_NE(made.status().message().find(text), std::string::npos) << made.status().toString();
  };
  for (const char* field : {"focal_x", "focal_y", "center_x", "center_y"}) {
    refused({"camera.orthographic_height=2", std::string("camera.") + field + "=10"}, std::string("request.camera.") + field, "orthographic");
    refused({"camera.panorama=true", std::string("camera.") + field + "=10"}, std::string("request.camera.") + field, "panorama");
  }
  refused({"camera.panorama=true", "camera.orthographic_height=2"}, "request.camera.orthographic_height", "panorama");
  refused({"camera.clip_near=2", "camera.clip_far=1"}, "request.camera.clip_far", "must lie behind clip_near = 2");
  refused({"camera.clip_near=2", "camera.clip_far=2"}, "request.camera.clip_far", "must lie behind");
  refused({"camera.f_number=2", "camera.lens_radius=0.1", "camera.focus_distance=1"}, "request.camera.lens_radius", "give one of them");
  refused({"camera.f_number=2"}, "request.camera.focus_distance", "is needed with request.camera.f_number");
  refused({"camera.lens_radius=2"}, "request.camera.focus_distance", "is needed with request.camera.lens_radius");
  refused({"camera.f_number=2", "camera.focus_distance=1", "camera.orthographic_height=2"}, "request.camera.f_number", "an orthographic camera");
  refused({"camera.f_number=2", "camera.focus_distance=1", "camera.panorama=true"}, "request.camera.f_number", "a panorama");
  refused({"camera.lens_radius=2", "camera.focus_distance=1", "camera.panorama=true"}, "request.camera.lens_radius", "a panorama");
  refused({"camera.lens_radius=1000", "camera.focus_distance=0.01"}, "request.camera.lens_radius", "more than 10000 times as wide");
}

TEST(CameraRequests, AnFNumberIsALensOfItsRadius) {
  const auto engine = makeEngine();
  // Sharp at 3.2 m: 24 mm of film blur next to nothing, a sensor of 6 m does.
  const double f = 0.012 / std::tan(20.0 * M_PI / 180.0);
  for (const double sensor : {24.0, 6000.0}) {
    v1::RenderRequest number = request({"camera.yfov_deg=40", "camera.focus_distance=3.2"}), radius = number;
    number.mutable_camera()->set_f_number(1.6);
    if (sensor != 24.0) number.mutable_camera()->set_sensor_height_mm(sensor);
    radius.mutable_camera()->set_lens_radius(f * (sensor / 24.0) / 1.6 / 2.0);
    const RenderResult a = mustRender(*engine, number), b = mustRender(*engine, radius);
    double sum = 0;
    for (size_t i = 0; i < a.images[0].image().data.size(); ++i) sum += std::fabs(double(a.images[0].image().data[i]) - double(b.images[0].image().data[i]));
    EXPECT_LT(sum / double(a.images[0].image().data.size()), 1e-3) << sensor;  // a ray that is rounded may pass the other side of an edge
    if (sensor != 24.0)
      EXPECT_GT(largestDifference(a.images[0].image(), mustRender(*engine, request({"camera.yfov_deg=40"})).images[0].image()), 1e-3) << sensor;
  }
}

TEST(CameraRequests, WhatIsLookedAtIsSharp) {
  const auto engine = makeEngine();
  v1::RenderRequest by = request({"camera.position=0.3,1.2,3.3", "camera.look_at=-0.2,0.7,-0.3", "camera.lens_radius=0.2", "outputs=beauty,position"}),
                    said = by;
  said.mutable_camera()->set_focus_distance(glm::length(glm::dvec3(0.5, 0.5, 3.6)));
  const RenderResult a = mustRender(*engine, by), b = mustRender(*engine, said);
  EXPECT_LT(largestDifference(a.images[1].image(), b.images[1].image()), 0.05);
  v1::RenderRequest elsewhere = by;
  elsewhere.mutable_camera()->set_focus_distance(1.0);
  EXPECT_GT(largestDifference(a.images[1].image(), mustRender(*engine, elsewhere).images[1].image()), 0.05);
  // None, or one of no size: the pinhole's bits.
  v1::RenderRequest tiny = by;
  tiny.mutable_camera()->set_lens_radius(1e-42);
  tiny.mutable_camera()->set_focus_distance(1e-46);
  v1::RenderRequest closed = by, pinhole = by;
  closed.mutable_camera()->set_lens_radius(0.0);
  pinhole.mutable_camera()->clear_lens_radius();
  EXPECT_EQ(firstDifference(mustRender(*engine, closed), mustRender(*engine, pinhole)), "");
  EXPECT_EQ(firstDifference(mustRender(*engine, tiny), mustRender(*engine, pinhole)), "");
}

TEST(CameraRequests, ViewSamplesLookThroughTheLensThatPathsOfViewSamplesLookThrough) {
  const auto engine = makeEngine();
  for (const char* window : {"", "window.x=7", "halton"}) {
    v1::RenderRequest r = request({"camera.lens_radius=0.3", "camera.focus_distance=2", "integrator.at_view_samples=true", "view_samples=8",
                                   "environment.background=TRANSPARENT", "environment.constant=1,1,1", "camera.clip_far=3.3", "outputs=beauty,alpha"});
    if (*window == 'h') set(r, "integrator.sampler=HALTON");
    if (*window == 'w')
      for (const char* e : {"window.x=7", "window.y=4", "window.width=20", "window.height=17"}) set(r, e);
    const RenderResult made = mustRender(*engine, r);
    const Image &beauty = made.images[0].image(), &alpha = made.images[1].image();
    ASSERT_EQ(beauty.channels, 4);
    int partly = 0;
    for (size_t i = 0; i < alpha.data.size(); ++i) {
      EXPECT_NEAR(beauty.data[4 * i + 3], alpha.data[i], 1e-6f) << i;
      partly += alpha.data[i] > 0.0f && alpha.data[i] < 1.0f;
    }
    EXPECT_GT(partly, 50);
  }
}

TEST(CameraRequests, ALensIsTheMeanOfThePinholesInIt) {
  // Pinholes all over the lens, each with its window shifted so that they agree in the plane of focus: the same picture, whatever brings the light.
  const auto engine = makeEngine();
  constexpr int kWidth = 24, kHeight = 18, kPinholes = 32, kSpp = 16;
  constexpr int kSharp = 8;  // what differs by a lens is more than their noise; were it noise alone, `off` would be 0.63 of it
  constexpr double kFocal = 26.0;
  struct Case {
    const char* scene;
    Vec3 at, forward;
    double radius, focus;
    std::vector<const char*> edits, outputs;
    bool caustics = false;  // of indirect light what photons bring, which has little noise, alone
  };
  const Case cases[] = {{"cornell",
                         Vec3(0, 1, 3.0f),
                         Vec3(0, 0, -1),
                         0.25,
                         2.1,
                         {"environment.sky.turbidity=3", "environment.background=BLURRED", "camera.clip_near=0.5"},
                         {"beauty", "emission"}},
                        {"spheres",
                         Vec3(1.0f, 4.2f, 6.6f),
                         Vec3(-1.0f, -4.05f, -6.95f),
                         0.6,
                         5.0,
                         {"lights.lamp.kind=POINT", "lights.lamp.position=0,6,2", "lights.lamp.intensity=200", "integrator.caustic_photons=20000",
                          "integrator.caustic_radius=0.005", "environment.path=none", "integrator.max_bounces=5"},
                         {"direct_diffuse", "indirect_diffuse"},
                         true}};
  for (const Case& k : cases) {
    const auto pictures = [&](const v1::RenderRequest& r) {
      const RenderResult made = mustRender(*engine, r);
      std::vector<Image> images;
      for (const auto& i : made.images) images.push_back(i.image());
      if (!k.caustics) return images;
      v1::RenderRequest without = r;
      set(without, "integrator.caustic_photons=0");
      const Image rest = mustRender(*engine, without).images[1].image();
      for (size_t c = 0; c < rest.data.size(); ++c) images[1].data[c] -= rest.data[c];
      return images;
    };
    const auto place = [](v1::Vector3* v, const Vec3& p) { v->set_x(p.x), v->set_y(p.y), v->set_z(p.z); };
    v1::RenderRequest open = smallRequest(k.scene, kWidth, kHeight, kSpp);
    for (const char* e : k.edits) set(open, e);
    open.mutable_camera()->set_focal_x(kFocal);
    place(open.mutable_camera()->mutable_position(), k.at);
    place(open.mutable_camera()->mutable_look_at(), k.at + k.forward);
    for (const char* o : k.outputs) open.add_outputs(o);
    v1::RenderRequest hole = open, middle = open;
    open.mutable_camera()->set_lens_radius(k.radius);
    open.mutable_camera()->set_focus_distance(k.focus);
    const Vec3 right = glm::normalize(glm::cross(k.forward, Vec3(0, 1, 0))), up = glm::normalize(glm::cross(right, k.forward));
    std::vector<std::vector<double>> lens(k.outputs.size()), sharp = lens, mean = lens;
    const auto add = [&](std::vector<std::vector<double>>& sums, v1::RenderRequest& r, int seed, int of) {
      r.set_seed(uint64_t(seed));
      const std::vector<Image> images = pictures(r);
      for (size_t o = 0; o < sums.size(); ++o) {
        sums[o].resize(images[o].data.size(), 0.0);
        for (size_t c = 0; c < sums[o].size(); ++c) sums[o][c] += double(images[o].data[c]) / of;
      }
    };
    for (int i = 0; i < kPinholes; ++i) {
      const double r = k.radius * std::sqrt((i + 0.5) / kPinholes), phi = i * 2.399963229728653;  // a sunflower's seeds
      const double x = r * std::cos(phi), y = r * std::sin(phi);
      const Vec3 at = k.at + right * float(x) + up * float(y);
      place(hole.mutable_camera()->mutable_position(), at);
      place(hole.mutable_camera()->mutable_look_at(), at + k.forward);
      hole.mutable_camera()->set_center_x(kWidth / 2.0 + x * kFocal / k.focus);
      hole.mutable_camera()->set_center_y(kHeight / 2.0 - y * kFocal / k.focus);
      add(mean, hole, 100 + i, kPinholes);
      add(lens, open, 200 + i, kPinholes);
      if (i < kSharp) add(sharp, middle, 300 + i, kSharp);
    }
    for (size_t o = 0; o < k.outputs.size(); ++o) {
      double off = 0, offSharp = 0, all = 0;
      for (size_t c = 0; c < mean[o].size(); ++c) {
        off += std::fabs(lens[o][c] - mean[o][c]);
        offSharp += std::fabs(sharp[o][c] - mean[o][c]);
        all += mean[o][c];
      }
      EXPECT_LT(off, 0.15 * all) << k.scene << " " << k.outputs[o];
      EXPECT_LT(off, 0.45 * offSharp) << k.scene << " " << k.outputs[o];  // the test could tell
    }
  }
}

TEST(CameraRequests, WhatAPinholeDoesNotReadIsSaidAndChangesNothing) {
  const auto engine = makeEngine();
  const RenderResult plain = mustRender(*engine, request({}));
  for (const std::string field : {"focus_distance", "sensor_height_mm"}) {
    const RenderResult with = mustRender(*engine, request({"camera." + field + "=2"}));
    EXPECT_EQ(firstDifference(plain, with), "");
    ASSERT_EQ(with.reply.warnings_size(), 1) << field;
    EXPECT_NE(with.reply.warnings(0).find("request.camera." + field + ": changes nothing of a pinhole"), std::string::npos) << with.reply.warnings(0);
  }
  const RenderResult both = mustRender(*engine, request({"camera.lens_radius=0.1", "camera.focus_distance=2", "camera.sensor_height_mm=24"}));
  ASSERT_EQ(both.reply.warnings_size(), 1);
  EXPECT_NE(both.reply.warnings(0).find("sensor_height_mm: is for f_number"), std::string::npos) << both.reply.warnings(0);
}

TEST(CameraRequests, ALensNeedsPathTracedLight) {
  const auto engine = makeEngine();
  const auto refused = [&](std::initializer_list<std::string> edits, const std::string& location, const std::string& text) {
    v1::RenderRequest r = request({"camera.lens_radius=0.1", "camera.focus_distance=3"});
    for (const std::string& e : edits) set(r, e);
    const auto made = engine->render(r);
    ASSERT_FALSE(made.ok()) << text;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument);
    EXPECT_EQ(made.status().location(), location) << made.status().toString();
    EXPECT_NE(made.status().message().find(text), std::string::npos) << made.status().toString();
  };
  // Every shadow technique that the schema has, but the automatic choice, for which path tracing is all that is left.
  const auto* descriptor = v1::ShadowTechnique::descriptor();
  int tried = 0;
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const std::string name = descriptor->field(i)->name();
    if (!descriptor->field(i)->real_containing_oneof() || name == "path_traced" || name == "auto") continue;
    refused({"shadows." + name + "="}, "request.camera.lens_radius", name == "subtractive" ? "subtractive_lights" : "direct_visibility");
    ++tried;
  }
  EXPECT_GT(tried, 5);
  refused({"environment.constant=1,1,1", "environment.transfer.bands=3"}, "request.camera.lens_radius", "a lens needs path-traced light");
  refused({"environment.sky.turbidity=3", "environment.area_lights=4", "shadows.ray_traced.samples=1"}, "request.camera.lens_radius",
          "a lens needs path-traced light");
  for (const OutputInfo& o : outputTable())
    if (o.perLight && std::string(o.name) != "group") refused({std::string("outputs=") + o.name + ":lamp"}, "request.outputs", "request.camera has a lens");
  const RenderResult automatic = mustRender(*engine, request({"camera.lens_radius=0.1", "camera.focus_distance=3", "shadows.auto="}));
  EXPECT_EQ(firstDifference(automatic, mustRender(*engine, request({"camera.lens_radius=0.1", "camera.focus_distance=3"}))), "");
}

/// Curves and formulas move the camera: `motion` is from where the picture of the earlier moment has a place to where the one of this moment has it.
TEST(CameraRequests, MotionIsThatOfTheCameraThatFlies) {
  const auto flown = [](const char* outputs, std::optional<double> time) {
    v1::RenderRequest r = request({std::string("outputs=") + outputs, "view_samples=1", "motion_step_s=0.5", "curves.camera.position.time_s=0,1",
                                   "curves.camera.position.value=0,1,3.4,0.3,1.2,3", "expressions.camera.yfov_deg.formula=40 - 4 * time",
                                   "curves.lights.light.gain.time_s=0,1", "curves.lights.light.gain.value=1,1,1,2,2,2"});
    if (time) r.set_time_s(*time);
    return r;
  };
  const auto film = [](const RenderResult& picture, const Vec3& p) {
    const Vec4 n = picture.matrices.at("worldToNDC") * Vec4(p, 1.0f);
    return Vec2(n.x / n.w * 40, n.y / n.w * 30);
  };
  const auto engine = makeEngine();
  for (const std::optional<double> time : {std::optional<double>(0.5), {1.2}, {0.2}, {-2.0}, {}}) {  // before the first key formulas alone move it
    SCOPED_TRACE(time.value_or(0));
    const RenderResult made = mustRender(*engine, flown("position,motion", time));
    const RenderResult now = mustRender(*engine, flown("position", time)), before = mustRender(*engine, flown("position", time.value_or(0) - 0.5));
    const Image &position = made.images[0].image(), &motion = made.images[1].image();
    EXPECT_EQ(position.data, now.images[0].image().data);
    int compared = 0;
    float most = 0;
    for (int y = 0; y < 30; ++y)
      for (int x = 0; x < 40; ++x) {
        const Vec3 p = position.rgb(x, y);
        if (p == Vec3(0.0f)) continue;  // nothing is there
        const Vec2 moved = film(now, p) - film(before, p);
        ASSERT_NEAR(motion.at(x, y)[0], moved.x, 5e-3f) << x << "," << y;
        ASSERT_NEAR(motion.at(x, y)[1], moved.y, 5e-3f) << x << "," << y;
        most = std::max(most, glm::length(moved));
        ++compared;
      }
    EXPECT_GT(compared, 500);
    EXPECT_GT(most, 0.5f);
    // What moves the camera is in the reply's request, which is the same picture again; what lamps do has no past.
    const v1::RenderRequest& resolved = made.reply.resolved();
    EXPECT_EQ(resolved.curves_size(), 1);
    EXPECT_EQ(resolved.expressions_size(), 1);
    const RenderResult again = mustRender(*makeEngine(), resolved);
    EXPECT_EQ(firstDifference(made, again), "");
    EXPECT_EQ(again.reply.request_hash(), made.reply.request_hash());
    EXPECT_EQ(now.reply.resolved().curves_size() + now.reply.resolved().expressions_size(), 0) << "where no output asks for it";
  }
  // A relight of what a curve says replaces the curve.
  v1::RelightRequest relight;
  relight.set_render_id(mustRender(*engine, flown("motion", 0.5)).reply.render_id());
  relight.add_mask("camera.position");
  set(*relight.mutable_patch(), "camera.position=0,1,3");
  const auto asked = engine->relightRequest(relight);
  ASSERT_TRUE(asked.ok()) << asked.status().toString();
  EXPECT_EQ(asked->curves_size(), 0);
  EXPECT_EQ(asked->expressions_size(), 1);
  v1::RenderRequest typed = flown("motion", 0.5);
  typed.mutable_curves()->erase("camera.position");
  set(typed, "camera.position=0,1,3");
  EXPECT_EQ(firstDifference(mustRender(*engine, *asked), mustRender(*makeEngine(), typed)), "");
}

/// The first frame has a past that a formula may know nothing of.
TEST(CameraRequests, AFormulaWithoutAValueBeforeIsAtRest) {
  const v1::RenderRequest r = request({"outputs=motion", "time_s=0", "expressions.camera.yfov_deg.formula=30 + 9 * sqrt(time)"});
  const RenderResult made = mustRender(*makeEngine(), r);
  for (const float v : made.images[0].pixels()) ASSERT_EQ(v, 0.0f);
  ASSERT_EQ(made.reply.warnings_size(), 1);
  EXPECT_TRUE(made.reply.warnings(0).starts_with("motion: what request.expressions move counts as at rest: request.expressions.camera.yfov_deg.formula"))
      << made.reply.warnings(0);
}

TEST(CameraRequests, TheSmallPictureOfTheLadderHasTheCameraOfTheLargeOne) {
  const auto engine = makeEngine();
  v1::RenderRequest r = request({"camera.focal_x=300", "camera.center_x=290", "camera.center_y=100", "outputs=position"}, "cornell", 400, 300);
  const auto resolved = engine->resolve(r);
  ASSERT_TRUE(resolved.ok());
  const auto rung = smallRung(*resolved);
  ASSERT_TRUE(rung);
  const RenderResult large = mustRender(*engine, r), small = mustRender(*engine, *rung);
  int same = 0;
  for (int y = 0; y < 75; ++y)
    for (int x = 0; x < 100; ++x) {
      const Vec3 p = small.images[0].image().rgb(x, y);
      float least = 1e30f;
      for (int k = 0; k < 16; ++k) least = std::min(least, glm::length(p - large.images[0].image().rgb(4 * x + k % 4, 4 * y + k / 4)));
      same += least < 0.05f;
    }
  EXPECT_GT(same, 7500 * 9 / 10);
}

}  // namespace
}  // namespace gobo::testing::camera_requests_test
