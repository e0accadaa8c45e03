// SPDX-License-Identifier: Apache-2.0
#include "trace/accel.h"

#include <unistd.h>

#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <future>
#include <limits>
#include <random>
#include <thread>

#include "support/tiny_scenes.h"
#include "terms/hit_place.h"
#include "trace/accel_impl.h"

namespace gobo::accel_test {
namespace {

using namespace tests;

constexpr Facet kGeometry = kAccelFacets;
const std::vector<int> kNoLights;

AccelPtr buildAccel(const Scene& scene, int threads = 2) {
  TaskArena arena(threads);
  return Accel::build(SceneView(scene, kGeometry, kNoLights), arena);
}
Vec3 randomDirection(std::mt19937& g) {
  std::normal_distribution<float> n;
  return glm::normalize(Vec3(n(g), n(g), n(g)));
}
ScenePtr withCamera(SceneMaker& m) {
  m.camera(Vec3(0, 0, 5), Vec3(0.0f));
  return m.finish();
}

// Moeller-Trumbore in double over every triangle: what Embree must agree with.
double nearest(const Scene& s, const Ray& ray, uint32_t& instance, uint32_t& primitive, DVec3& normal) {
  double best = 1e300;
  for (size_t i = 0; i < s.instances.size(); ++i) {
    const Mesh& m = *s.meshes[s.instances[i].mesh];
    const glm::dmat4 w(s.instances[i].toWorld);
    const double flip = glm::determinant(glm::dmat3(w)) < 0 ? -1 : 1;
    for (size_t t = 0; t < m.triangles(); ++t) {
      DVec3 v[3];
      for (int c = 0; c < 3; ++c) v[c] = DVec3(w * glm::dvec4(DVec3(m.positions[m.indices[3 * t + c]]), 1.0));
      const DVec3 e1 = v[1] - v[0], e2 = v[2] - v[0], d(ray.direction), p = glm::cross(d, e2);
      const double det = glm::dot(e1, p);
      if (det == 0) continue;
      const DVec3 o = DVec3(ray.origin) - v[0], q = glm::cross(o, e1);
      const double u = glm::dot(o, p) / det, k = glm::dot(d, q) / det, at = glm::dot(e2, q) / det;
      if (u < 0 || k < 0 || u + k > 1 || at <= ray.tmin || at >= best) continue;
      best = at;
      instance = uint32_t(i);
      primitive = uint32_t(t);
      normal = glm::normalize(glm::cross(e1, e2)) * flip;
    }
  }
  return best;
}

void compareWithBruteForce(const Scene& scene, float radius, int rays, unsigned seed) {
  const AccelPtr accel = buildAccel(scene);
  std::mt19937 g(seed);
  int hits = 0, edges = 0;
  for (int i = 0; i < rays; ++i) {
    const Vec3 origin = randomDirection(g) * radius;
    const Ray ray{origin, glm::normalize(2.5f * randomDirection(g) - origin)};
    uint32_t instance = 0, primitive = 0;
    DVec3 normal(0.0);
    const double t = nearest(scene, ray, instance, primitive, normal);
    Hit hit;
    const bool found = accel->intersect(ray, hit);
    EXPECT_EQ(accel->occluded(ray), found);
    if (found != (t < 1e299)) {
      ++edges;
      continue;
    }
    if (!found) continue;
    ++hits;
    EXPECT_NEAR(hit.t, t, 1e-4 * t + 1e-4);
    if (hit.instance != instance || hit.primitive != primitive) {
      ++edges;
      continue;
    }
    EXPECT_GT(glm::dot(DVec3(hit.Ng), normal), 0.9999) << "instance " << instance;
  }
  EXPECT_GT(hits, rays / 20);
  EXPECT_LE(edges, rays / 500);  // rays along an edge may differ between float and double
}

TEST(Accel, AgreesWithBruteForceOverMovedScaledAndMirroredInstances) {
  SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  const int ball = m.mesh(sphere(Vec3(0.0f), 1.0f, 6, false), grey), cube = m.mesh(box(Vec3(-1.0f), Vec3(1.0f)), grey);
  m.instance(ball, translate(Vec3(2, 0, 0)) * scaling(Vec3(0.5f, 1.5f, 1.0f)));
  m.instance(cube, translate(Vec3(-2, 0.5f, 0)) * scaling(Vec3(-1.0f, 0.7f, 0.4f)));
  m.instance(ball, translate(Vec3(0, -2, 1)) * scaling(Vec3(0.3f, -0.3f, 0.6f)));
  const ScenePtr scene = withCamera(m);
  compareWithBruteForce(*scene, 5.0f, 4000, 1);
}

TEST(Accel, SharedBigMeshesAreInstancedAndReportSceneIndices) {
  SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  const int cube = m.mesh(box(Vec3(-0.4f), Vec3(0.4f)), grey);
  const int ball = m.mesh(sphere(Vec3(0.0f), 1.0f, 240, false), grey);  // 229 k triangles
  m.instance(cube);
  m.instance(ball, translate(Vec3(3, 0, 0)));
  m.instance(ball, translate(Vec3(-3, 0, 0)) * scaling(Vec3(-1.0f, 1.0f, 0.5f)));
  const ScenePtr scene = withCamera(m);
  const AccelPtr accel = buildAccel(*scene);
  EXPECT_TRUE(accel->impl().instances[0].world);
  EXPECT_FALSE(accel->impl().instances[1].world);
  std::mt19937 g(3);
  for (int i = 0; i < 2000; ++i) {
    const int which = i % 3;
    const Vec3 centre = which == 0 ? Vec3(0.0f) : Vec3(which == 1 ? 3.0f : -3.0f, 0, 0);
    const Vec3 d = randomDirection(g);
    Hit hit;
    ASSERT_TRUE(accel->intersect({centre, d}, hit));
    EXPECT_EQ(hit.instance, uint32_t(which));
    EXPECT_NEAR(glm::length(hit.Ng), 1.0f, 1e-5f);
    EXPECT_GT(glm::dot(hit.Ng, d), 0.0f);  // outside, also of the mirrored one
    if (which == 1) { EXPECT_NEAR(hit.t, 1.0f, 2e-4f); }
    if (which == 2) {  // half as deep in z: an ellipsoid
      const Vec3 p = d * hit.t / Vec3(1, 1, 0.5f);
      EXPECT_NEAR(glm::length(p), 1.0f, 2e-4f);
      EXPECT_GT(glm::dot(hit.Ng, glm::normalize(p / Vec3(1, 1, 0.5f))), 0.999f);
    }
  }
}

TEST(Accel, ClosedMeshIsWatertight) {
  SceneMaker m;
  m.instance(m.mesh(sphere(Vec3(0.3f, -0.1f, 0.2f), 1.0f, 160, false), m.material(Vec3(0.5f))));  // 102 k triangles
  const ScenePtr scene = withCamera(m);
  const AccelPtr accel = buildAccel(*scene);
  std::mt19937 g(11);
  const Mesh& mesh = *scene->meshes[0];
  std::uniform_real_distribution<float> u;
  int escaped = 0;
  for (int i = 0; i < 1'000'000; ++i) {
    Vec3 d = randomDirection(g);
    const Vec3 o = Vec3(0.3f, -0.1f, 0.2f) + 0.3f * randomDirection(g);
    if (i % 2) {  // every other ray aims at a point on an edge, the hard case
      const uint32_t* tri = &mesh.indices[3 * (g() % mesh.triangles())];
      const float along = 0.05f + 0.9f * u(g);                            // not at the vertices: there Embree's edge tests, each right to rounding, may all
      const Vec3 a = mesh.positions[tri[0]], b = mesh.positions[tri[1]];  // say "outside" (1 of 100 rays aimed at one to the last bit)
      d = glm::normalize(a + along * (b - a) - o);
    }
    Hit hit;
    escaped += !accel->intersect({o, d}, hit);
  }
  EXPECT_EQ(escaped, 0);
}

std::shared_ptr<Texture> checker() {  // left half clear, right half solid
  auto t = std::make_shared<Texture>();
  t->name = "alpha";
  t->width = 2;
  t->height = 1;
  t->nearest = true;
  t->texels8 = {255, 255, 255, 0, 255, 255, 255, 255};
  sealTexture(*t);
  return t;
}

// Embree's assertions end the process for such rays; here they meet nothing, get no light, and their neighbours in a packet do not notice.
TEST(Accel, RaysThatAreNotFiniteMeetNothing) {
  SceneMaker m;
  m.instance(m.mesh(quad(Vec3(-1, -1, 0), Vec3(2, 0, 0), Vec3(0, 2, 0)), m.material(Vec3(0.5f))));
  const ScenePtr scene = withCamera(m);
  const AccelPtr accel = buildAccel(*scene);
  const float bad[] = {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()};
  for (int number = 0; number < 8; ++number)
    for (const float value : bad) {
      if (number >= 6 && !std::isnan(value)) continue;  // an end may be infinite
      std::array<Ray, 16> rays;
      for (size_t i = 0; i < 16; ++i) {
        rays[i] = Ray{Vec3(0.05f * float(i), 0, 1), Vec3(0, 0, -1)};
        if (i % 2 == 0) continue;
        if (number < 3) rays[i].origin[number] = value;
        else if (number < 6) rays[i].direction[number - 3] = value;
        else (number == 6 ? rays[i].tmin : rays[i].tmax) = value;
      }
      std::array<Hit, 16> hits;
      accel->intersect16(rays.data(), 16, hits.data());
      const uint32_t blocked = accel->occluded16(rays.data(), 16);
      for (size_t i = 0; i < 16; ++i) {
        Hit one;
        EXPECT_EQ(accel->intersect(rays[i], one), i % 2 == 0) << number << " " << value;
        EXPECT_EQ(hits[i].instance == kNoHit, i % 2 == 1) << number << " " << value << " lane " << i;
        EXPECT_TRUE(blocked >> i & 1u);
        EXPECT_TRUE(accel->occluded(rays[i]));
      }
    }
}

TEST(Accel, MaskedTexelsLetRaysThrough) {
  SceneMaker m;
  m.scene.textures.push_back(checker());
  const int leaf = m.material(Vec3(0.5f), [](Material& x) {
    x.coverage.mode = AlphaMode::Mask;
    x.coverage.texture.texture = 0;
  });
  m.instance(m.mesh(quad(Vec3(-1, -1, 0), Vec3(2, 0, 0), Vec3(0, 2, 0)), leaf));
  m.instance(m.mesh(quad(Vec3(-1, -1, -1), Vec3(2, 0, 0), Vec3(0, 2, 0)), m.material(Vec3(0.5f))));
  const ScenePtr scene = withCamera(m);
  const AccelPtr accel = buildAccel(*scene);
  std::mt19937 g(5);
  std::uniform_real_distribution<float> u(-0.99f, 0.99f);
  for (int i = 0; i < 2000; ++i) {
    const Ray ray{Vec3(u(g), u(g), 1), Vec3(0, 0, -1)};
    Hit hit;
    ASSERT_TRUE(accel->intersect(ray, hit));
    EXPECT_EQ(hit.instance, ray.origin.x < 0 ? 1u : 0u) << ray.origin.x;
    EXPECT_EQ(accel->occluded({ray.origin, ray.direction, 0.0f, 1.5f}), ray.origin.x >= 0);
  }
}

TEST(Accel, BlendPassesWithProbabilityOneMinusAlphaAndAnswersTheSameTwice) {
  SceneMaker m;
  const int glass = m.material(Vec3(0.5f), [](Material& x) {
    x.coverage.mode = AlphaMode::Blend;
    x.coverage.factor = 0.3f;
  });
  m.instance(m.mesh(quad(Vec3(-1, -1, 0), Vec3(2, 0, 0), Vec3(0, 2, 0)), glass));
  const ScenePtr scene = withCamera(m);
  const AccelPtr accel = buildAccel(*scene);
  std::mt19937 g(6);
  std::uniform_real_distribution<float> u(-0.99f, 0.99f);
  const int n = 100'000;
  int hits = 0;
  for (int i = 0; i < n; ++i) {
    const Ray ray{Vec3(u(g), u(g), 1), Vec3(0, 0, -1)};
    Hit hit;
    const bool found = accel->intersect(ray, hit);
    hits += found;
    ASSERT_EQ(found, accel->occluded(ray));
  }
  EXPECT_NEAR(double(hits) / n, 0.3, 4.5 * std::sqrt(0.3 * 0.7 / n));
}

TEST(Accel, CoincidentSurfacesGiveTheSameHitWhateverTheThreads) {
  SceneMaker m;
  const int a = m.material(Vec3(0.2f)), b = m.material(Vec3(0.8f));
  Mesh plane;  // big enough for Embree's parallel builder
  for (int i = 0; i < 60; ++i)
    for (int j = 0; j < 60; ++j) {
      const Mesh q = quad(Vec3(i * 0.1f - 3, j * 0.1f - 3, 0), Vec3(0.1f, 0, 0), Vec3(0, 0.1f, 0));
      const uint32_t base = uint32_t(plane.positions.size());
      plane.positions.insert(plane.positions.end(), q.positions.begin(), q.positions.end());
      for (uint32_t k : q.indices) plane.indices.push_back(base + k);
    }
  m.instance(m.mesh(plane, a));
  m.instance(m.mesh(plane, b));
  const ScenePtr scene = withCamera(m);
  const AccelPtr one = buildAccel(*scene, 1), two = buildAccel(*scene, 2);
  std::mt19937 g(8);
  for (int i = 0; i < 20'000; ++i) {
    const Ray ray{Vec3(0, 0, 3), glm::normalize(Vec3(0, 0, -1) + 0.5f * randomDirection(g))};
    Hit x, y;
    ASSERT_EQ(one->intersect(ray, x), two->intersect(ray, y));
    ASSERT_EQ(x.instance, y.instance);
    ASSERT_EQ(x.primitive, y.primitive);
    ASSERT_EQ(x.t, y.t);
  }
}

TEST(Accel, EmptySceneHasNoHits) {
  SceneMaker m;
  const ScenePtr scene = withCamera(m);
  const AccelPtr accel = buildAccel(*scene);
  Hit hit;
  EXPECT_FALSE(accel->intersect({Vec3(0.0f), Vec3(0, 0, 1)}, hit));
  EXPECT_FALSE(hit.valid());
  EXPECT_FALSE(accel->occluded({Vec3(0.0f), Vec3(0, 0, 1)}));
}

TEST(AccelCache, ConcurrentAsksBuildOnceAndSizeIsBounded) {
  std::vector<ScenePtr> scenes;
  for (int i = 0; i < 3; ++i) {
    SceneMaker m;
    m.instance(m.mesh(sphere(Vec3(float(i), 0, 0), 1.0f, 50, false), m.material(Vec3(0.5f))));
    scenes.push_back(withCamera(m));
  }
  TaskArena arena(2);
  const size_t one = Accel::build(SceneView(*scenes[0], kGeometry, kNoLights), arena)->bytes();
  AccelCache cache(2 * one + one / 2);
  std::vector<AccelPtr> got(8);
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) threads.emplace_back([&, i] { got[i] = cache.get(SceneView(*scenes[0], kGeometry, kNoLights), arena); });
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(cache.builds(), 1u);
  for (const AccelPtr& p : got) EXPECT_EQ(p, got[0]);
  cache.get(SceneView(*scenes[1], kGeometry, kNoLights), arena);
  cache.get(SceneView(*scenes[2], kGeometry, kNoLights), arena);
  EXPECT_LE(cache.bytes(), 2 * one + one / 2);
  cache.get(SceneView(*scenes[2], kGeometry, kNoLights), arena);
  EXPECT_EQ(cache.builds(), 3u);  // the latest is kept
  cache.get(SceneView(*scenes[0], kGeometry, kNoLights), arena);
  EXPECT_EQ(cache.builds(), 4u);  // the oldest went
}

ScenePtr oneBall() {
  SceneMaker m;
  m.instance(m.mesh(sphere(Vec3(0.0f), 1.0f, 20, false), m.material(Vec3(0.5f))));
  return withCamera(m);
}

TEST(AccelCache, ABuildThatThrowsIsTriedAgain) {
  const ScenePtr scene = oneBall();
  const SceneView view(*scene, kGeometry, kNoLights);
  TaskArena arena(1);
  std::atomic<int> builds{0};
  AccelCache cache(1ull << 30, [&](const SceneView& v, const TaskArena& a, const StopToken& s) {
    if (builds++ == 0) throw std::bad_alloc();
    return Accel::build(v, a, s);
  });
  EXPECT_THROW(cache.get(view, arena), std::bad_alloc);
  EXPECT_EQ(cache.bytes(), 0u);
  const AccelPtr made = cache.get(view, arena);
  ASSERT_NE(made, nullptr);
  EXPECT_EQ(cache.get(view, arena), made);
  EXPECT_EQ(builds, 2);
}

TEST(AccelCache, WhoWaitsForABuildThatThrowsIsTold) {
  const ScenePtr scene = oneBall();
  const SceneView view(*scene, kGeometry, kNoLights);
  TaskArena arena(1);
  std::promise<void> building, go;
  AccelCache cache(1ull << 30, [&](const SceneView&, const TaskArena&, const StopToken&) -> AccelPtr {
    building.set_value();
    go.get_future().wait();
    throw std::bad_alloc();
  });
  std::thread builder([&] { EXPECT_THROW(cache.get(view, arena), std::bad_alloc); });
  building.get_future().wait();
  StopSource second;
  std::thread stopped([&] { EXPECT_EQ(cache.get(view, arena, second.token()), nullptr) << "its own stop ends the wait"; });
  second.stop(StopReason::Cancelled);
  stopped.join();
  go.set_value();
  builder.join();
  EXPECT_EQ(cache.builds(), 1u);
}

TEST(AccelCache, AStoppedBuildLeavesNothingBehind) {
  const ScenePtr scene = oneBall();
  const SceneView view(*scene, kGeometry, kNoLights);
  TaskArena arena(2);
  // Ended at its first poll, its second, and so on, until one is not ended.
  int n = 1;
  for (AccelPtr made; !made; ++n) {
    AccelCache cache;
    StopSource stop;
    stop.stopAtPoll(n);
    made = cache.get(view, arena, stop.token());
    EXPECT_EQ(cache.bytes() > 0, made != nullptr) << n;
    ASSERT_NE(cache.get(view, arena), nullptr) << n;
    EXPECT_EQ(cache.builds(), made ? 1u : 2u) << n;
  }
  EXPECT_GT(n, 3) << "a build polls";
}

/// Convex bodies and planes whose insides nothing may see from outside, at three scales each: as they are, tilted, moved far off, stretched, and more than
/// Accel copies, which Embree transforms by itself.
std::vector<std::pair<std::string, ScenePtr>> convexScenes() {
  std::vector<std::pair<std::string, ScenePtr>> out;
  const Vec3 axis = glm::normalize(Vec3(0.3f, 0.9f, -0.2f)), across = glm::normalize(glm::cross(axis, Vec3(0, 0, 1)));
  const Mat4 turned(Vec4(across, 0), Vec4(axis, 0), Vec4(glm::cross(across, axis), 0), Vec4(0, 0, 0, 1));
  for (const float scale : {1e-4f, 1.0f, 1e4f}) {
    const auto add = [&](const std::string& name, const Mesh& mesh, const std::vector<Mat4>& at) {
      SceneMaker m;
      const int made = m.mesh(mesh, m.material(Vec3(0.5f)));
      for (const Mat4& toWorld : at) m.instance(made, toWorld);
      out.emplace_back(name + " at " + std::to_string(scale), withCamera(m));
    };
    const Mesh ball = sphere(Vec3(0.0f), scale, 20, false), wide = ground(2000 * scale);
    add("ball", ball, {translate(Vec3(2 * scale, 0, 0))});
    add("far ball", ball, {translate(scale * Vec3(700, -300, 90)) * turned});
    add("stretched ball", ball, {turned * scaling(Vec3(40, 0.5f, 3))});
    add("plane", wide, {Mat4(1.0f)});
    add("low plane", wide, {translate(Vec3(0, -0.3f * scale, 0))});
    add("tilted plane", wide, {translate(scale * Vec3(3, 5, -8)) * turned});
    const Mesh dense = sphere(Vec3(0.0f), scale, 240, false);
    add("instances", dense, {translate(scale * Vec3(70, -3, 9)) * turned, translate(scale * Vec3(-400, 60, 2)) * turned * scaling(Vec3(9, 0.2f, 2))});
  }
  return out;
}

/// Fills what the next calls will take for their stack.
[[gnu::noinline]] void soilStack(unsigned char with) {
  unsigned char stack[1 << 17];
  std::memset(stack, with, sizeof stack);
  asm volatile("" : : "r"(stack) : "memory");  // it is written, though nobody reads it
}

// Whatever earlier calls have left on the stack, packets end, and see the same (embree.h). Without an end the alarm ends the program.
TEST(Accel, PacketsEndWhateverLiesOnTheStack) {
  ::alarm(300);
  for (const auto& [name, scene] : convexScenes()) {
    SCOPED_TRACE(name);
    const AccelPtr accel = buildAccel(*scene);
    std::mt19937 g(12);
    for (int i = 0; i < 20; ++i) {
      Ray rays[16];
      const Vec3 middle(scene->instances[g() % scene->instances.size()].toWorld[3]), reach = accel->reach();
      for (Ray& ray : rays) {
        const Vec3 from = randomDirection(g);
        ray = {middle + from * std::max({reach.x, reach.y, reach.z}), glm::normalize(-from + 0.3f * randomDirection(g))};
      }
      const int count = 1 + int(g() % 16);
      uint32_t clean[3] = {};
      for (const unsigned char with : {0x00, 0xff, 0xa5}) {
        uint32_t seen[3] = {};
        soilStack(with);
        seen[2] = accel->occluded16(rays, count);
        for (const bool coherent : {false, true}) {
          alignas(64) RTCRayHit16 r;
          alignas(64) int valid[16];
          for (int k = 0; k < 16; ++k) {
            const Ray& ray = rays[std::min(k, count - 1)];
            valid[k] = k < count ? -1 : 0;
            for (const auto& [to, x] : {std::pair(r.ray.org_x, ray.origin.x),
                                        {r.ray.org_y, ray.origin.y},
                                        {r.ray.org_z, ray.origin.z},
                                        {r.ray.dir_x, ray.direction.x},
                                        {r.ray.dir_y, ray.direction.y},
                                        {r.ray.dir_z, ray.direction.z},
                                        {r.ray.tnear, ray.tmin},
                                        {r.ray.tfar, ray.tmax},
                                        {r.ray.time, 0.0f}})
              to[k] = x;
            r.ray.mask[k] = ~0u;
            r.ray.id[k] = r.ray.flags[k] = 0;
            r.hit.geomID[k] = r.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
          }
          embree::Context context;
          embree::initContext(context);
          soilStack(with);
          embree::intersect16(valid, accel->impl().scene, context, r, coherent);
          for (int k = 0; k < count; ++k) seen[coherent] |= uint32_t(r.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID) << k;
        }
        for (int k = 0; k < 3; ++k) {
          if (with == 0) clean[k] = seen[k];
          EXPECT_EQ(seen[k], clean[k]) << k << " " << int(with);
        }
      }
    }
  }
  ::alarm(0);
}

TEST(OffsetOrigin, LeavesTheSurfaceOnTheAskedSideAtEveryScale) {
  std::mt19937 g(9);
  for (const auto& [name, scene] : convexScenes()) {
    SCOPED_TRACE(name);
    const AccelPtr accel = buildAccel(*scene);
    const Vec3 reach = accel->reach();
    const float most = std::max({reach.x, reach.y, reach.z});
    std::uniform_int_distribution<size_t> which(0, scene->instances.size() - 1);
    int hits = 0, seen = 0, past = 0;
    for (int i = 0; i < 20'000; ++i) {
      // Towards a point of a triangle, most of them near its middle, from a place above it: small bodies are met from afar and near.
      const Instance& instance = scene->instances[which(g)];
      const Mesh& mesh = *scene->meshes[size_t(instance.mesh)];
      const size_t t = g() % mesh.triangles();
      std::uniform_real_distribution<float> unit(0.0f, 1.0f);
      const float a = unit(g), b = unit(g) * (1 - a);
      Vec3 v[3];
      for (size_t c = 0; c < 3; ++c) v[c] = Vec3(instance.toWorld * Vec4(mesh.positions[mesh.indices[3 * t + c]], 1.0f));
      const Vec3 target = v[0] * (1 - a - b) + v[1] * a + v[2] * b;
      Vec3 n = glm::cross(v[1] - v[0], v[2] - v[0]);
      if (!(glm::dot(n, n) > 0)) continue;  // at the poles
      n = glm::normalize(n);
      Vec3 from = randomDirection(g);
      if (glm::dot(from, n) < 0) from = -from;
      const Ray in{target + from * (most * std::pow(10.0f, -4 * unit(g))), -from};
      Hit hit;
      if (!accel->intersect(in, hit) || glm::dot(hit.Ng, from) <= 0) continue;
      ++hits;
      const Vec3 p = terms::hitPosition(*accel, hit);
      Vec3 out = randomDirection(g);
      if (i % 4 == 0) out = glm::normalize(out - hit.Ng * (glm::dot(out, hit.Ng) * (1 - 1e-4f)));  // along the surface
      if (glm::dot(out, hit.Ng) < 0) out = -out;
      const Vec3 origin = offsetOrigin(p, hit.Ng, accel->reach(hit.instance));
      const Ray leaving{origin, out};
      if (accel->occluded(leaving) || accel->occluded16(&leaving, 1)) ++seen;
      EXPECT_LE(glm::length(origin - p), 1.5e-6f * most);
      if (glm::dot(out, hit.Ng) > 0.1f && !accel->occluded({origin, -out})) ++past;  // by a rim of the flat ones
    }
    EXPECT_EQ(seen, 0) << "of " << hits;
    EXPECT_LT(past, hits / 100);
    EXPECT_GT(hits, 5'000);
  }
}

// The bound of the point's rounding is of all axes that the normal has a part of, and planes along one have some in addition.
TEST(OffsetOrigin, MovesByTheRoundingOfEveryAxis) {
  const Vec3 diagonal = glm::normalize(Vec3(1.0f)), up(0, 1, 0);
  EXPECT_NEAR(glm::length(offsetOrigin(Vec3(0.0f), diagonal, Vec3(1.0f))), 6e-7f * std::sqrt(3.0f) + 3e-7f, 1e-9f);
  EXPECT_NEAR(glm::length(offsetOrigin(Vec3(0.0f), up, Vec3(100, 1, 2))), 6e-7f + 3e-5f, 1e-8f);
  EXPECT_NEAR(glm::length(offsetOrigin(Vec3(0.0f), -up, Vec3(1, 100, 2))), 6e-5f + 3e-5f, 1e-8f);
}

// A sheet that lies on a floor of kilometres is in the way of what is below it.
TEST(OffsetOrigin, PassesNoSheetOfAWideScene) {
  SceneMaker m;
  const int white = m.material(Vec3(0.5f));
  m.instance(m.mesh(ground(4000), white));
  m.instance(m.mesh(ground(1, 0.01f), white));
  const ScenePtr scene = withCamera(m);
  const AccelPtr accel = buildAccel(*scene);
  std::mt19937 g(4);
  std::uniform_real_distribution<float> within(-0.9f, 0.9f);
  for (int i = 0; i < 1000; ++i) {
    const Vec3 origin = offsetOrigin(Vec3(within(g), 0, within(g)), Vec3(0, 1, 0), accel->reach());
    EXPECT_TRUE(accel->occluded({origin, glm::normalize(Vec3(within(g), 100, within(g)))}));
  }
}

}  // namespace
}  // namespace gobo::accel_test
