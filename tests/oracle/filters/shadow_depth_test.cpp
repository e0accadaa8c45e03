// SPDX-License-Identifier: Apache-2.0
// The depth map: against closed forms, rays against scan conversion, and the pyramid of depth bounds against comparing everything.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "base/sobol.h"
#include "filters/shadow_map/depth_bounds.h"
#include "filters/shadow_map/shadow_map.h"
#include "scene/load.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"
#include "trace/accel.h"

namespace gobo::test {
namespace {

constexpr Facet kDepthFacets = Facet::Topology | Facet::Pose | Facet::Coverage;

TermPtr depthMap(const ScenePtr& scene, const LightFrames& frames, int side, DepthMethod method, int threads = 2, uint64_t* rays = nullptr) {
  static AccelCache accels;
  const std::vector<int> none;
  const SceneView view(*scene, kDepthFacets, none);
  const TaskArena arena(threads);
  RunCounters counters;
  RunContext ctx;
  ctx.scene = &view;
  ctx.arena = &arena;
  ctx.accels = &accels;
  ctx.counters = &counters;
  auto term = runNode(*makeLightDepthMapNode(frames, side, method), ctx);
  GOBO_CHECK(term.ok());
  if (rays) *rays = counters.rays;
  return *term;
}

LightShape lightFor(const Scene& scene, LightKind kind) {
  Vec3 lo, hi;
  scene.bounds(lo, hi);
  LightShape l;
  l.kind = kind;
  l.axis = glm::normalize(Vec3(0.35f, -1.0f, 0.25f));
  const bool inside = kind == LightKind::Point || kind == LightKind::Rect;
  l.position = 0.5f * (lo + hi) - l.axis * (inside ? 0.11f : 1.0f) * glm::length(hi - lo);
  l.cosOuter = std::cos(0.6f);
  return l;
}

/// Spheres that share a mesh: few of them copied, many instanced by Embree; turned and mirrored. And a picket of masked cards.
ScenePtr crowd(int copies, bool masked) {
  tests::SceneMaker s;
  const int grey = s.material(Vec3(0.5f));
  const int ball = s.mesh(tests::sphere(Vec3(0.0f), 0.4f, copies > 8 ? 120 : 12, true), grey);
  s.instance(s.mesh(tests::ground(4.0f), grey));
  for (int i = 0; i < copies; ++i) {
    Mat4 m = tests::translate(Vec3(-2.0f + 0.7f * float(i % 7), 0.5f + 0.1f * float(i), -2.0f + 0.9f * float(i / 7)));
    m[0][0] = i % 2 ? -1.0f : 0.7f;
    m[1][0] = 0.2f;
    s.instance(ball, m);
  }
  if (masked) {
    auto holes = std::make_shared<Texture>();
    holes->width = holes->height = 16;
    holes->nearest = true;
    std::vector<float> texels;
    for (int i = 0; i < 256; ++i) texels.insert(texels.end(), {1.0f, 1.0f, 1.0f, (i % 16 / 2 + i / 32) % 2 ? 1.0f : 0.0f});
    holes->texelsF = texels;
    sealTexture(*holes);
    s.scene.textures.push_back(holes);
    const int lace = s.material(Vec3(0.5f), [](Material& m) {
      m.coverage.mode = AlphaMode::Mask;
      m.coverage.texture.texture = 0;
    });
    for (int i = 0; i < 3; ++i) s.instance(s.mesh(tests::quad(Vec3(-2.0f + float(i), 1.2f, 1.5f), Vec3(0.9f, 0.2f, 0), Vec3(0, 0.1f, -2.0f)), lace));
  }
  s.camera(Vec3(0, 5, 9), Vec3(0, 0, 0), 0.8f);
  return s.finish();
}

// Texels whose ray, moved by a thousandth of a texel either way, meets something else lie on a silhouette: which side they fall on is rounding.
bool onSilhouette(const Accel& accel, const LightFrame& f, int side, int x, int y, float depth) {
  for (int k = 0; k < 4; ++k) {
    float start, cosine;
    Hit hit;
    const Ray ray =
        f.ray((float(x) + 0.5f + (k % 2 ? 1e-3f : -1e-3f)) / float(side), (float(y) + 0.5f + (k / 2 ? 1e-3f : -1e-3f)) / float(side), start, cosine);
    const float d = accel.intersect(ray, hit) ? std::clamp((start + hit.t * cosine - f.near) / (f.far - f.near), 0.0f, 1.0f) : 1.0f;
    if (std::fabs(d - depth) > 1e-3f) return true;
  }
  return false;
}

struct Difference {
  int texels = 0, silhouettes = 0, wrong = 0;
  double worst = 0;
};
AccelPtr accelOf(const ScenePtr& scene) {
  const std::vector<int> none;
  return Accel::build(SceneView(*scene, kDepthFacets, none), TaskArena(2));
}
Difference compareMethods(const ScenePtr& scene, const AccelPtr& accel, const LightFrames& frames, int side) {
  const TermPtr rays = depthMap(scene, frames, side, DepthMethod::Rays), raster = depthMap(scene, frames, side, DepthMethod::Raster);
  const auto a = rays->floats("z"), b = raster->floats("z");
  Difference d;
  for (size_t i = 0; i < a.size(); ++i) {
    ++d.texels;
    const double off = std::fabs(double(a[i]) - b[i]);
    if (off <= 1e-5) {
      d.worst = std::max(d.worst, off);
      continue;
    }
    const size_t square = size_t(side) * size_t(side);
    if (onSilhouette(*accel, frames.face[i / square], side, int(i % square % size_t(side)), int(i % square / size_t(side)), a[i])) ++d.silhouettes;
    else ++d.wrong;
  }
  return d;
}

TEST(ShadowDepth, ScanConversionEqualsRays) {
  std::vector<ScenePtr> scenes;
  for (const char* name : {"cornell", "fence", "trees", "lamps"}) scenes.push_back(*makeBuiltinScene(name));
  scenes.push_back(crowd(5, false));
  scenes.push_back(crowd(5, true));
  scenes.push_back(crowd(14, true));  // Embree instances
  const LightKind kinds[] = {LightKind::Directional, LightKind::Spot, LightKind::Rect, LightKind::Point};
  for (size_t i = 0; i < scenes.size(); ++i) {
    const ScenePtr& scene = scenes[i];
    const AccelPtr accel = accelOf(scene);
    for (size_t k = 0; k < 4; ++k)
      for (int side : {61, 256}) {
        const LightKind kind = kinds[k];
        if (kind == LightKind::Point && side > 100) continue;
        if (side > 100 && !testing::thorough() && i % 3 != k) continue;  // every scene by one of the three
        Vec3 lo, hi;
        scene->bounds(lo, hi);
        const LightFrames frames = *fitLightFrames(lightFor(*scene, kind), lo, hi, side, 2);
        const Difference d = compareMethods(scene, accel, frames, side);
        const std::string what = scene->name + " kind " + std::to_string(int(kind)) + " side " + std::to_string(side);
        EXPECT_EQ(d.wrong, 0) << what << ": worst of the rest " << d.worst;
        EXPECT_LE(d.silhouettes, d.texels / 200 + 2) << what;
      }
  }
}

TEST(ShadowDepth, AutomaticTakesOneOfTheTwo) {
  const ScenePtr scene = *makeBuiltinScene("cornell");
  Vec3 lo, hi;
  scene->bounds(lo, hi);
  const LightFrames frames = *fitLightFrames(lightFor(*scene, LightKind::Spot), lo, hi, 128, 2);
  uint64_t rays = 1;  // cornell has 36 triangles: the rasteriser's above 8 texels, rays' below 3 x 3
  EXPECT_EQ(depthMap(scene, frames, 128, DepthMethod::Automatic, 2, &rays)->content(), depthMap(scene, frames, 128, DepthMethod::Raster)->content());
  EXPECT_EQ(rays, 0u);
  const LightFrames coarse = *fitLightFrames(lightFor(*scene, LightKind::Spot), lo, hi, 1, 0);  // more triangles than texels
  EXPECT_EQ(depthMap(scene, coarse, 1, DepthMethod::Automatic, 2, &rays)->content(), depthMap(scene, coarse, 1, DepthMethod::Rays)->content());
  EXPECT_EQ(rays, 1u);
}

TEST(ShadowDepth, ThreadsChangeNoBit) {
  const ScenePtr scene = crowd(14, true);
  Vec3 lo, hi;
  scene->bounds(lo, hi);
  for (LightKind kind : {LightKind::Directional, LightKind::Point}) {
    const LightFrames frames = *fitLightFrames(lightFor(*scene, kind), lo, hi, 200, 2);
    for (DepthMethod method : {DepthMethod::Rays, DepthMethod::Raster}) {
      const TermPtr one = depthMap(scene, frames, 200, method, 1), seven = depthMap(scene, frames, 200, method, 7);
      EXPECT_EQ(one->content(), seven->content()) << int(kind) << " " << int(method);
    }
  }
}

// Planar depth, linear between near and far, at texel centres: z = (t . forward - near) / (far - near) of the plane in double. Bound: float
// positions of 3 m from a light 6 m away, 1e-6 of the range.
TEST(ShadowDepth, ASlantedPlaneHasItsClosedForm) {
  for (double tilt : {0.0, 0.4, 1.1}) {
    tests::SceneMaker s;
    const Vec3 along(float(std::cos(tilt)), float(std::sin(tilt)), 0);
    s.instance(s.mesh(tests::quad(-2.0f * along + Vec3(0, 0, 2), 4.0f * along, Vec3(0, 0, -4)), s.material(Vec3(0.5f))));
    s.camera(Vec3(0, 5, 9), Vec3(0.0f), 0.8f);
    const ScenePtr scene = s.finish();
    Vec3 lo, hi;
    scene->bounds(lo, hi);
    for (LightKind kind : {LightKind::Directional, LightKind::Spot}) {
      LightShape light = lightFor(*scene, kind);
      light.position = Vec3(0.3f, 6.0f, -0.2f);
      const int side = 129;
      const LightFrames frames = *fitLightFrames(light, lo, hi, side, 1);
      const LightFrame& f = frames.face[0];
      const DVec3 n = glm::normalize(glm::cross(DVec3(along), DVec3(0, 0, -1)));
      for (DepthMethod method : {DepthMethod::Rays, DepthMethod::Raster}) {
        const TermPtr map = depthMap(scene, frames, side, method);
        int hits = 0;
        for (int y = 0; y < side; ++y)
          for (int x = 0; x < side; ++x) {
            const double tx = f.lo.x + (double(f.hi.x) - f.lo.x) * (x + 0.5) / side, ty = f.lo.y + (double(f.hi.y) - f.lo.y) * (y + 0.5) / side;
            const DVec3 o = DVec3(f.origin) + (f.perspective ? DVec3(0.0) : DVec3(f.right) * tx + DVec3(f.up) * ty);
            const DVec3 d = DVec3(f.forward) + (f.perspective ? DVec3(f.right) * tx + DVec3(f.up) * ty : DVec3(0.0));
            const double t = -glm::dot(o, n) / glm::dot(d, n);  // the plane holds the origin
            const DVec3 p = o + d * t;
            const double edge = std::max(std::fabs(glm::dot(p, DVec3(along))), std::fabs(p.z));
            const float z = map->floats("z")[size_t(y) * side + size_t(x)];
            if (edge < 1.99) {
              ASSERT_NEAR(z, (t - f.near) / (double(f.far) - f.near), 1e-6) << tilt << " " << int(kind) << " " << int(method) << " at " << x << "," << y;
              ++hits;
            } else if (edge > 2.01) {
              ASSERT_EQ(z, 1.0f);
            }
          }
        EXPECT_GT(hits, 1000);
      }
    }
  }
}

// A surface that passes through the light's own plane, another that touches the light: what lies in front counts, nothing is lost or wild.
TEST(ShadowDepth, GeometryAroundTheLight) {
  tests::SceneMaker s;
  const int grey = s.material(Vec3(0.5f));
  s.instance(s.mesh(tests::box(Vec3(-3, -1, -3), Vec3(3, 4, 3), true), grey));                            // a room around it
  s.instance(s.mesh(tests::quad(Vec3(0.5f, -1, -3), Vec3(0, 5, 0), Vec3(0, 0, 6)), grey));                // a wall beside it, in front and behind
  s.instance(s.mesh(tests::quad(Vec3(-0.2f, 0.999f, -0.2f), Vec3(0.4f, 0, 0), Vec3(0, 0, 0.4f)), grey));  // a hair below it
  s.camera(Vec3(0, 1, 2.5f), Vec3(0.0f), 0.8f);
  const ScenePtr scene = s.finish();
  Vec3 lo, hi;
  scene->bounds(lo, hi);
  for (LightKind kind : {LightKind::Spot, LightKind::Rect, LightKind::Point}) {
    LightShape light = lightFor(*scene, kind);
    light.position = Vec3(0, 1, 0);
    light.axis = glm::normalize(Vec3(0.8f, -0.5f, 0.1f));
    const LightFrames frames = *fitLightFrames(light, lo, hi, 90, 2);
    const Difference d = compareMethods(scene, accelOf(scene), frames, 90);
    EXPECT_EQ(d.wrong, 0) << int(kind);
    EXPECT_LE(d.silhouettes, d.texels / 200 + 2) << int(kind);
    const TermPtr map = depthMap(scene, frames, 90, DepthMethod::Raster);
    for (float z : map->floats("z")) ASSERT_TRUE(z >= 0.0f && z <= 1.0f) << int(kind) << ": " << z;
  }
}

// A range that begins in the middle of the casters, as a camera fit makes it: those in front of it read 0 by either method.
TEST(ShadowDepth, CastersInFrontOfNearReadZero) {
  const ScenePtr scene = crowd(5, true);
  Vec3 lo, hi;
  scene->bounds(lo, hi);
  for (LightKind kind : {LightKind::Directional, LightKind::Spot}) {
    LightFrames frames = *fitLightFrames(lightFor(*scene, kind), lo, hi, 150, 2);
    LightFrame& f = frames.face[0];
    const LightFrame whole = f;
    f.near = 0.5f * (f.near + f.far);
    const Difference d = compareMethods(scene, accelOf(scene), frames, 150);
    EXPECT_EQ(d.wrong, 0) << int(kind);
    LightFrames all = frames;
    all.face[0] = whole;
    const TermPtr fitted = depthMap(scene, frames, 150, DepthMethod::Rays), map = depthMap(scene, all, 150, DepthMethod::Rays);
    int zero = 0;
    for (size_t i = 0; i < 150 * 150; ++i) {
      const float z = map->floats("z")[i];
      ASSERT_NEAR(fitted->floats("z")[i], z == 1.0f ? 1.0f : std::max(0.0f, 2.0f * z - 1.0f), 2e-6f) << int(kind);
      zero += fitted->floats("z")[i] == 0.0f;
    }
    EXPECT_GT(zero, 50);
  }
}

/// Looks down -y on [0, side]^2 metres, a texel a metre; depth is 10 - y over 10 m.
LightFrames graphPaper(int side) {
  LightFrames frames;
  LightFrame& f = frames.face[0];
  f.origin = Vec3(0, 10, 0);
  f.right = Vec3(1, 0, 0);
  f.up = Vec3(0, 0, -1);
  f.forward = Vec3(0, -1, 0);
  f.lo = Vec2(0.0f);
  f.hi = Vec2(float(side));
  f.far = 10.0f;
  return frames;
}
ScenePtr meshScene(Mesh mesh) {
  tests::SceneMaker s;
  s.instance(s.mesh(std::move(mesh), s.material(Vec3(0.5f))));
  s.camera(Vec3(0, 20, 30), Vec3(0.0f), 0.8f);
  return s.finish();
}

// Corners and edges of a crooked sheet exactly on texel centres: every texel of its inside is covered by one triangle or another.
TEST(ShadowDepth, SharedCornersOnTexelCentresLeaveNoGap) {
  constexpr int kSide = 40;
  Mesh m;
  for (int y = 0; y <= 12; ++y)
    for (int x = 0; x <= 12; ++x) {  // whole steps of 1, 2, 3, 4 texels, sheared: crossings are rounded
      const float px = 1.5f + float(x * 3 + (y * 7 % 3) * (x > 0 && x < 12)), pz = -(1.5f + float(y * 3 + (x * 5 % 3) * (y > 0 && y < 12)));
      m.positions.push_back(Vec3(px, 2.0f + 0.37f * float((x * 11 + y * 5) % 7), pz));
    }
  for (uint32_t y = 0; y < 12; ++y)
    for (uint32_t x = 0; x < 12; ++x) {
      const uint32_t a = y * 13 + x, b = a + 1, c = a + 13, d = c + 1;
      if ((x + y) % 2)
        for (uint32_t i : {a, b, c, b, d, c}) m.indices.push_back(i);
      else
        for (uint32_t i : {a, b, d, a, d, c}) m.indices.push_back(i);
    }
  const ScenePtr scene = meshScene(std::move(m));
  const LightFrames frames = graphPaper(kSide);
  const TermPtr map = depthMap(scene, frames, kSide, DepthMethod::Raster);
  for (int y = 1; y <= 37; ++y)
    for (int x = 1; x <= 37; ++x) ASSERT_LT(map->floats("z")[size_t(y) * kSide + size_t(x)], 1.0f) << x << "," << y;
}

// A wall that leans by a ten-millionth of a texel: its depth changes by metres within the rim that coverage allows, and must stay between top and foot.
TEST(ShadowDepth, WallsSeenEdgeOnKeepTheirDepths) {
  constexpr int kSide = 32;
  tests::SceneMaker s;
  const int grey = s.material(Vec3(0.5f));
  for (int k = 1; k < 9; ++k) {
    const float x = 3.0f * float(k) + 0.5f, lean = std::ldexp(1.0f, -25 + k);
    s.instance(s.mesh(tests::quad(Vec3(0, 2, -1), Vec3(0, 6, 0), Vec3(0, 0, -30)), grey), tests::translate(Vec3(x, 0, 0)));
    Mesh leaning = tests::quad(Vec3(0, 2, -1), Vec3(lean, 6, 0), Vec3(0, 0, -30));
    s.instance(s.mesh(leaning, grey), tests::translate(Vec3(x + 1.0f, 0, 0)));
  }
  for (float x : {4.5f, 6.5f})  // half a millionth of a texel beside a centre, leaning away by as much: carried on to the centre, its depth would be -0.4
    s.instance(s.mesh(tests::quad(Vec3(x + std::ldexp(1.0f, -20), 2, -1), Vec3(-std::ldexp(1.0f, -21), 6, 0), Vec3(0, 0, -30)), grey));
  s.camera(Vec3(0, 20, 30), Vec3(0.0f), 0.8f);
  const ScenePtr scene = s.finish();
  for (bool perspective : {false, true}) {
    LightFrames frames = graphPaper(kSide);
    LightFrame& f = frames.face[0];
    if (perspective) {  // above the middle: walls to either side lean in its view, those below it do not
      f.perspective = true;
      f.origin = Vec3(13.5f, 10.0f, -16.0f);
      f.lo = Vec2(-2.0f);
      f.hi = Vec2(2.0f);
    }
    const TermPtr map = depthMap(scene, frames, kSide, DepthMethod::Raster);
    int hits = 0;
    for (float z : map->floats("z")) {
      ASSERT_TRUE((z >= 0.2f - 1e-6f && z <= 0.8f + 1e-6f) || z == 1.0f) << z;
      hits += z < 1.0f;
    }
    EXPECT_GT(hits, 20);
  }
}

// Triangles without area, drawn over a floor, take nothing from it.
TEST(ShadowDepth, TrianglesWithoutAreaHideNothing) {
  constexpr int kSide = 16;
  for (bool perspective : {false, true}) {
    Mesh m = tests::quad(Vec3(-100, 1, 100), Vec3(200, 0, 0), Vec3(0, 0, -200));
    m.uv[0].clear();
    for (int k = 0; k < 3; ++k) m.positions.push_back(Vec3(4.5f, 5, -4.5f));
    for (float y : {4.0f, 5.0f, 4.0f}) m.positions.push_back(Vec3(9.5f, y, -1.5f));
    for (uint32_t i : {4, 5, 6, 7, 8, 9}) m.indices.push_back(i);
    LightFrames frames = graphPaper(kSide);
    LightFrame& f = frames.face[0];
    if (perspective) {
      f.perspective = true;
      f.origin = Vec3(8, 10, -8);
      f.lo = Vec2(-1.0f);
      f.hi = Vec2(1.0f);
    }
    const TermPtr map = depthMap(meshScene(std::move(m)), frames, kSide, DepthMethod::Raster);
    for (size_t i = 0; i < size_t(kSide) * kSide; ++i) ASSERT_NEAR(map->floats("z")[i], 0.9f, 1e-6f) << i;
  }
}

TEST(ShadowDepth, FacesThatSeeNothingCostNoRay) {
  tests::SceneMaker s;
  s.instance(s.mesh(tests::ground(2.0f), s.material(Vec3(0.5f))));
  s.camera(Vec3(0, 2, 5), Vec3(0.0f), 0.8f);
  const ScenePtr scene = s.finish();
  Vec3 lo, hi;
  scene->bounds(lo, hi);
  LightShape point;
  point.position = Vec3(2.0f, 0.5f, 0.0f);  // at the scene's border: +x sees nothing, -y the floor, +y nothing
  const LightFrames frames = *fitLightFrames(point, lo, hi, 40, 1);
  ASSERT_EQ(frames.count, 6);
  EXPECT_FALSE(frames.face[0].sees);
  EXPECT_FALSE(frames.face[2].sees);
  EXPECT_TRUE(frames.face[3].sees);
  uint64_t rays = 0;
  const TermPtr map = depthMap(scene, frames, 40, DepthMethod::Rays, 2, &rays);
  int seeing = 0;
  for (int f = 0; f < 6; ++f) seeing += frames.face[size_t(f)].sees;
  EXPECT_EQ(rays, uint64_t(seeing) * 40 * 40);
  for (size_t i = 0; i < 1600; ++i) ASSERT_EQ(map->floats("z")[i], 1.0f);
  // And nothing was lost: a map that traces every face says the same.
  LightFrames all = frames;
  for (LightFrame& f : all.face) f.sees = true;
  EXPECT_EQ(map->content(), depthMap(scene, all, 40, DepthMethod::Rays)->content());
}

// --- the pyramid of depth bounds: the hierarchical z-buffer (Greene, Kass, Miller 1993) --------------------------------------------------

TermPtr boundsOf(const TermPtr& depth) {
  const TaskArena arena(3);
  RunContext ctx;
  ctx.inputs = {depth};
  ctx.arena = &arena;
  auto r = runNode(*makeDepthBoundsNode(depth->extent().width, depth->extent().layers), ctx);
  GOBO_CHECK(r.ok());
  return *r;
}
std::shared_ptr<Term> emptyDepth(int side, int faces = 1) {
  auto t = std::make_shared<Term>("light_depth_map", Domain::LightTexel, Extent{side, side, faces});
  for (float& z : t->addPlane<float>("z")) z = 1.0f;
  return t;
}
int pick(uint64_t seed, uint64_t i, int n) { return int(hash32(seed, i) % uint32_t(n)); }

TEST(DepthBounds, HoldEveryTexelAndAreExactWhereLevelsFit) {
  for (int side : {1, 2, 3, 37, 64, 100}) {
    auto depth = emptyDepth(side, 2);
    auto z = depth->writable<float>("z");
    for (size_t i = 0; i < z.size(); ++i) z[i] = toUnit(hash32(uint64_t(side), i));
    const TermPtr term = boundsOf(depth);
    const DepthBounds bounds(*term, side);
    const size_t square = size_t(side) * size_t(side);
    for (int face = 0; face < 2; ++face) {
      EXPECT_EQ(0, std::memcmp(bounds.depth(face), &z[size_t(face) * square], square * 4)) << "level 0 is the depth map";
      for (int k = 0; k < 400; ++k) {
        int x0 = pick(1, k, side), x1 = pick(2, k, side), y0 = pick(3, k, side), y1 = pick(4, k, side);
        if (x0 > x1) std::swap(x0, x1);
        if (y0 > y1) std::swap(y0, y1);
        float lo = 2, hi = -1, low, high;
        for (int y = y0; y <= y1; ++y)
          for (int x = x0; x <= x1; ++x) {
            const float v = z[size_t(face) * square + size_t(y) * size_t(side) + size_t(x)];
            lo = std::min(lo, v);
            hi = std::max(hi, v);
          }
        bounds.range(face, x0, y0, x1, y1, low, high);
        ASSERT_TRUE(low <= lo && high >= hi) << side << ": " << x0 << ".." << x1 << " x " << y0 << ".." << y1;
        const bool aligned = (x1 - x0 <= 1 && y1 - y0 <= 1) || (x0 == 0 && y0 == 0 && x1 == side - 1 && y1 == side - 1);
        if (aligned) {
          ASSERT_EQ(low, lo);
          ASSERT_EQ(high, hi);
        }
      }
    }
  }
}

// Rectangles drawn in batches, nearest wins; one that lies behind the pyramid's largest depth of the batch before is not drawn at all. The image is the
// brute-force z-buffer's bit for bit. Front-to-back order culls more than back-to-front, which culls nothing.
TEST(DepthBounds, CullingByThePyramidEqualsTheZBuffer) {
  constexpr int kSide = 90, kBatches = 24, kPerBatch = 25;
  struct Card {
    int x0, y0, x1, y1;
    float depth, slope;
  };
  std::vector<Card> cards;
  for (int i = 0; i < kBatches * kPerBatch; ++i) {
    const int w = 1 + pick(1, i, 50), h = 1 + pick(2, i, 50), x = pick(3, i, kSide), y = pick(4, i, kSide);
    cards.push_back({x, y, std::min(x + w, kSide) - 1, std::min(y + h, kSide) - 1, 0.05f + 0.8f * toUnit(hash32(5, i)), 0.002f * toUnit(hash32(6, i))});
  }
  const auto draw = [](std::span<float> z, const Card& c) {
    for (int y = c.y0; y <= c.y1; ++y)
      for (int x = c.x0; x <= c.x1; ++x) {
        float& at = z[size_t(y) * kSide + size_t(x)];
        at = std::min(at, c.depth + c.slope * float(x - c.x0));
      }
  };
  std::vector<int> culled;
  for (int order = 0; order < 3; ++order) {
    if (order) std::stable_sort(cards.begin(), cards.end(), [&](const Card& a, const Card& b) { return order == 1 ? a.depth < b.depth : a.depth > b.depth; });
    auto brute = emptyDepth(kSide), hierarchical = emptyDepth(kSide);
    int skipped = 0;
    for (int b = 0; b < kBatches; ++b) {
      const TermPtr pyramid = boundsOf(hierarchical);
      const DepthBounds bounds(*pyramid, kSide);
      for (int k = b * kPerBatch; k < (b + 1) * kPerBatch; ++k) {
        draw(brute->writable<float>("z"), cards[size_t(k)]);
        float lo, hi;
        bounds.range(0, cards[size_t(k)].x0, cards[size_t(k)].y0, cards[size_t(k)].x1, cards[size_t(k)].y1, lo, hi);
        if (cards[size_t(k)].depth >= hi) {
          ++skipped;
          continue;
        }
        draw(hierarchical->writable<float>("z"), cards[size_t(k)]);
      }
    }
    EXPECT_EQ(0, std::memcmp(brute->floats("z").data(), hierarchical->floats("z").data(), size_t(kSide) * kSide * 4)) << "order " << order;
    culled.push_back(skipped);
  }
  RecordProperty("culled_random", culled[0]);
  RecordProperty("culled_front_to_back", culled[1]);
  std::printf("culled of %d: random order %d, front to back %d, back to front %d\n", kBatches * kPerBatch, culled[0], culled[1], culled[2]);
  EXPECT_GT(culled[0], kBatches * kPerBatch / 10);
  EXPECT_GT(culled[1], culled[0]);
  EXPECT_EQ(culled[2], 0);
}

}  // namespace
}  // namespace gobo::test
