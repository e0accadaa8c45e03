// SPDX-License-Identifier: Apache-2.0
// request.window: the bits of a part are those of the whole, for every technique and output; what is of whole pictures is refused.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <set>

#include "support/planned_nodes.h"
#include "support/run_node.h"
#include "support/thorough.h"
#include "terms/gbuffer.h"
#include "terms/hidden_surface.h"

namespace gobo::testing {
namespace {

constexpr int kWidth = 41, kHeight = 31;

void setWindow(v1::RenderRequest& r, const std::array<int, 4>& w) {
  r.mutable_window()->set_x(uint32_t(w[0]));
  r.mutable_window()->set_y(uint32_t(w[1]));
  r.mutable_window()->set_width(uint32_t(w[2]));
  r.mutable_window()->set_height(uint32_t(w[3]));
}

/// Where the part is not what the whole has there; empty: nowhere.
std::string difference(const RenderResult& whole, const RenderResult& part, const std::array<int, 4>& w) {
  if (whole.images.size() != part.images.size()) return "another number of pictures";
  for (size_t k = 0; k < whole.images.size(); ++k) {
    const Image &a = whole.images[k].image(), &b = part.images[k].image();
    const std::string& name = whole.images[k].output;
    if (name.rfind("shadow_basis", 0) == 0) {  // a mosaic of maps, which are not of the view
      if (a.data != b.data) return name;
      continue;
    }
    if (b.width != w[2] || b.height != w[3] || a.channels != b.channels) return name + " has another size";
    for (int y = 0; y < b.height; ++y)
      for (int x = 0; x < b.width; ++x)
        if (std::memcmp(a.at(x + w[0], y + w[1]), b.at(x, y), sizeof(float) * size_t(a.channels)) != 0)
          return name + " at " + std::to_string(x) + "," + std::to_string(y) + ": " + std::to_string(a.at(x + w[0], y + w[1])[0]) + " became " +
                 std::to_string(b.at(x, y)[0]);
  }
  return {};
}

TEST(Window, HasTheBitsOfTheWholeWithEveryTechniqueAndOutput) {
  int windows = 0;
  size_t requests = 0;
  const auto engine = makeEngine(), other = makeEngine(256ull << 20, {}, 1);
  for (auto [name, request] : requestsWithAllNodes(kWidth, kHeight)) {
    if (ofPlansAlone(request.scene())) request.set_scene("cornell");
    request.clear_window();
    if (request.shadows().axis_aligned().rate() == v1::AxisAlignedShadow::EQUATION && request.shadows().axis_aligned().mean_samples() > 0.0)
      continue;  // of a whole picture
    const v1::OutlierRejection& outliers = request.denoise().outliers();
    if (outliers.has_path_density() || (outliers.has_reweighting() && outliers.white() == 0)) continue;  // likewise
    if (name == "filters of whole pictures") continue;
    SCOPED_TRACE(name);
    const RenderResult whole = mustRender(*engine, request);
    const std::vector<std::array<int, 4>> places{{13, 9, 17, 11}, {0, 0, kWidth, kHeight}, {0, 20, 5, 11}, {40, 0, 1, 31}, {23, 30, 1, 1}};
    const size_t second = 1 + requests++ % 4;  // beside the middle: all the others, or one in turn
    for (size_t k = 0; k < places.size(); ++k) {
      if (!thorough() && k != 0 && k != second) continue;
      const std::array<int, 4>& w = places[k];
      v1::RenderRequest part = request;
      setWindow(part, w);
      EXPECT_EQ(difference(whole, mustRender(*other, part), w), "") << w[0] << "," << w[1] << " " << w[2] << " x " << w[3];
      ++windows;
    }
  }
  EXPECT_GT(windows, 50);
}

/// A floor and four rugs of two triangles each, all at its very height, seen obliquely: which of them a ray meets depends on the rays that go with it.
/// `roofed`: there is a sheet above them that the camera sees first.
ScenePtr rugs(bool roofed) {
  builtin::SceneBuilder b("rugs");
  const auto add = [&](const std::string& name, const Vec3& albedo, const Vec3& corner, const Vec3& eu, const Vec3& ev) {
    builtin::MeshBuilder m;
    m.quad(corner, eu, ev);
    b.add(name, m, b.material(name, albedo), false);
  };
  add("floor", Vec3(0.5f), Vec3(-3, 0, 3), Vec3(6, 0, 0), Vec3(0, 0, -6));
  const Vec3 colours[] = {Vec3(0.8f, 0.1f, 0.1f), Vec3(0.1f, 0.7f, 0.2f), Vec3(0.1f, 0.2f, 0.8f), Vec3(0.8f, 0.7f, 0.1f)};
  for (int k = 0; k < 4; ++k) {
    const float turn = 0.37f * float(k), c = std::cos(turn), s = std::sin(turn);
    add("rug " + std::to_string(k), colours[k], Vec3(-1.7f + 0.23f * float(k), 0, 1.3f - 0.11f * float(k)), Vec3(2.6f * c, 0, 0.9f * s),
        Vec3(0.5f * s, 0, -2.3f));
  }
  if (roofed) add("roof", Vec3(0.4f), Vec3(-3, 0.6f, 3.5f), Vec3(6, 0, 0), Vec3(0, 0, -7));
  b.rect("key", Vec3(-1.2f, 3, 1), Vec3(0.0f), 0.4f, 0.4f, Vec3(24, 22, 18));
  b.camera("front", Vec3(0.6f, 1.3f, 4.2f), Vec3(0.0f), 40.0f);
  return *b.finish();
}

TEST(Window, RaysHaveTheCompanyThatTheyHaveInTheWhole) {
  const auto engine = makeEngine(), other = makeEngine(256ull << 20, {}, 1);
  RenderControl control;
  control.scene = rugs(false);
  const auto render = [&](Engine& e, const v1::RenderRequest& r) {
    Result<RenderResult> made = e.render(r, control);
    EXPECT_TRUE(made.ok()) << made.status().toString();
    return made.ok() ? std::move(*made) : RenderResult{};
  };
  for (const uint32_t viewSamples : {1u, 4u})
    for (const bool filtered : {false, true}) {
      v1::RenderRequest r = smallRequest("cornell", kWidth, kHeight);
      r.set_view_samples(viewSamples);
      for (const char* a : {"shadows.ray_traced.samples=2", "outputs=object_id,albedo,beauty"}) set(r, a);
      if (filtered) set(r, "filters[0].median.radius_px=3");
      const RenderResult whole = render(*engine, r);
      ASSERT_EQ(whole.images.size(), 3u);
      const Image& objects = whole.images[0].image();
      EXPECT_GE((std::set<float>(objects.data.begin(), objects.data.end()).size()), 5u) << "not every rug is seen: the picture decides little";
      // The last one begins at multiples of 4, and with its halo of 3 it does not.
      for (const std::array<int, 4>& w : std::vector<std::array<int, 4>>{{13, 9, 17, 11}, {1, 0, 30, 20}, {16, 12, 13, 9}}) {
        setWindow(r, w);
        EXPECT_EQ(difference(whole, render(*other, r), w), "")
            << w[0] << "," << w[1] << " " << w[2] << " x " << w[3] << ", " << viewSamples << " view samples" << (filtered ? ", filtered" : "");
      }
    }
}

/// The first plane that has other bits in `around`, a view with `guard` pixels more on each side.
std::string guardedDifference(const Term& plain, const Term& around, int guard) {
  const Extent e = plain.extent(), f = around.extent();
  for (size_t k = 0; k < plain.planes().size(); ++k) {
    const Plane &a = plain.planes()[k], &b = around.planes().at(k);
    const size_t bytes = a.bytes.size() / e.elements();
    for (size_t i = 0; i < e.elements(); ++i) {
      const size_t row = i / size_t(e.width), x = i % size_t(e.width) + size_t(guard), y = row % size_t(e.height) + size_t(guard);
      const size_t j = (row / size_t(e.height) * size_t(f.height) + y) * size_t(f.width) + x;
      if (std::memcmp(a.bytes.data() + bytes * i, b.bytes.data() + bytes * j, bytes) != 0) return plain.type() + "." + a.name + " of " + std::to_string(i);
    }
  }
  return {};
}

// A style's guard band is the other view that is not the film.
TEST(Window, AGuardBandChangesNoSurfaceOfThePicture) {
  const TaskArena arena(2);
  for (const bool roofed : {false, true}) {
    const ScenePtr scene = rugs(roofed);
    tests::NodeRunner run(*scene, arena);
    const GBufferSettings view{scene->cameras[0], kWidth, kHeight, 2};
    const TermPtr seen = run(makeGBufferNode(view), {}), behind = run(makeHiddenSurfaceNode(view), {seen});
    const auto instances = (roofed ? behind : seen)->plane<uint32_t>("instance");
    EXPECT_GE((std::set<uint32_t>(instances.begin(), instances.end()).size()), 5u) << "not every rug counts";
    for (const int guard : {1, 3, 6}) {
      SCOPED_TRACE(std::to_string(guard) + (roofed ? ", roofed" : ""));
      GBufferSettings wide = view;
      wide.width += 2 * guard;
      wide.height += 2 * guard;
      wide.place = {-guard, -guard, kWidth, kHeight};
      const TermPtr around = run(makeGBufferNode(wide), {});
      EXPECT_EQ(guardedDifference(*seen, *around, guard), "");
      EXPECT_EQ(guardedDifference(*behind, *run(makeHiddenSurfaceNode(wide), {around}), guard), "");
    }
  }
}

TEST(Window, AMapOfItsSizeStaysWhole) {
  v1::RenderRequest r = withLamp(48, 48, LightKind::Spot);
  for (const char* a : {"shadows.axis_aligned.radius_px=2", "shadows.axis_aligned.dilate_px=1", "lights.lamp.shadow.exponential.c=40",
                        "lights.lamp.shadow.map.resolution=24", "outputs=beauty,shadow_basis:lamp"})
    set(r, a);
  const auto engine = makeEngine();
  const RenderResult whole = mustRender(*engine, r);
  ASSERT_EQ(whole.images[1].image().width, 24);
  for (int side = 14; side <= 24; ++side) {  // one of them has the map's size with its halo
    const std::array<int, 4> w{12, 12, side, side};
    setWindow(r, w);
    EXPECT_EQ(difference(whole, mustRender(*engine, r), w), "") << side;
  }
}

TEST(Window, IsMadeInTheBytesOfThePart) {
  const auto engine = makeEngine();
  v1::RenderRequest r = withLamp(2048, 2048, LightKind::Spot);
  set(r, "shadows.ray_traced.samples=1");
  const auto whole = engine->prepare(r, nullptr);
  setWindow(r, {100, 100, 64, 64});
  const auto part = engine->prepare(r, nullptr);
  ASSERT_TRUE(whole.ok() && part.ok());
  EXPECT_LT(part->pinnedBytes * 100, whole->pinnedBytes);
  r.set_width(16384);
  r.set_height(16384);
  r.set_view_samples(16);  // more than a picture may have
  EXPECT_TRUE(engine->render(r).ok());
  r.clear_window();
  EXPECT_FALSE(engine->render(r).ok());
}

TEST(Window, WhatIsOfWholePicturesIsRefusedByName) {
  const auto engine = makeEngine();
  const auto refused = [&](std::initializer_list<const char*> edits, const std::string& location, const std::string& text) {
    v1::RenderRequest r = withLamp(32, 24, LightKind::Rect);
    for (const char* e : edits) set(r, e);
    const auto made = engine->render(r);
    ASSERT_FALSE(made.ok()) << text;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument);
    EXPECT_EQ(made.status().location(), location) << made.status().toString();
    EXPECT_NE(made.status().message().find(text), std::string::npos) << made.status().toString();
  };
  refused({"window.x=1"}, "request.window.width", "0 pixels from 1");
  refused({"window.width=8"}, "request.window.height", "0 pixels from 0");
  refused({"window.x=30", "window.width=3", "window.height=2"}, "request.window.width", "3 pixels from 30");
  refused({"window.y=24", "window.width=3", "window.height=1"}, "request.window.height", "1 pixels from 24");
  refused({"window.width=3", "window.height=2", "certificate.pixel_fraction=1"}, "request.certificate", "whole picture");
  refused({"window.width=3", "window.height=2", "halt.error=0.1"}, "request.halt.error", "whole picture");
  refused({"window.width=3", "window.height=2", "shadows.axis_aligned.mean_samples=12", "shadows.axis_aligned.rate=EQUATION"}, "request.window",
          "shadow_mu:lamp reads a whole picture");
}

}  // namespace
}  // namespace gobo::testing
