// SPDX-License-Identifier: Apache-2.0
// Precomputed transfer against closed forms, and whole pictures of it against path tracing.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "base/sobol.h"
#include "plan/engine.h"
#include "support/engines.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"
#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/receiver_mesh.h"
#include "terms/surface_reader.h"

namespace gobo::transfer::transfer_test {
namespace {

using tests::SceneMaker;

/// Nodes of a scene, run by hand.
struct Stage {
  ScenePtr scene;
  TransferSettings s;
  TaskArena arena{2};
  AccelCache accels;
  std::vector<int> none;
  TermPtr points, direct;

  Stage(ScenePtr made, uint32_t wanted, int bands = 5) : scene(std::move(made)) {
    s.points = wanted;
    s.bands = bands;
    s.size = uint32_t(ReceiverMesh(SceneView(*scene, ReceiverMesh::kFacets, none), wanted).size());
    points = run(makeTransferPointsNode(s), {});
  }
  TermPtr run(const NodePtr& node, std::vector<TermPtr> inputs) {
    RunCounters counters;
    RunContext ctx;
    ctx.arena = &arena;
    ctx.accels = &accels;
    ctx.counters = &counters;
    ctx.inputs = std::move(inputs);
    const SceneView view(*scene, node->traits().facets, none);
    ctx.scene = &view;
    std::vector<TermShape> shapes;
    for (const TermPtr& t : ctx.inputs) shapes.push_back(shapeOf(*t));
    const auto shape = node->infer(shapes);
    EXPECT_TRUE(shape.ok()) << shape.status().toString();
    auto result = runNode(*node, *shape, ctx);
    EXPECT_TRUE(result.ok()) << result.status().toString();
    return *result;
  }
  void trace(uint32_t blocks) {
    for (uint32_t b = 0; b < blocks; ++b) direct = run(makeDirectTransferNode(s, b), b == 0 ? std::vector{points} : std::vector{points, direct});
  }
  double at(size_t point, int harmonic) const { return direct->floats("transfer")[point * size_t(s.harmonics()) + size_t(harmonic)]; }
  DVec3 vector(const char* plane, size_t i) const {
    const auto v = points->floats(plane);
    return {v[3 * i], v[3 * i + 1], v[3 * i + 2]};
  }
};

TEST(TransferPoints, PlacesAreWhereTheirPointsAre) {
  SceneMaker m;
  m.instance(m.mesh(tests::sphere(Vec3(0.2f, 0, 0), 1.0f, 12, true), m.material(Vec3(0.5f))), tests::scaling(Vec3(1, 2, -1)));
  const int single = m.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; });
  m.instance(m.mesh(tests::ground(3.0f), single));
  m.instance(m.mesh(tests::box(Vec3(-1), Vec3(1)), single), tests::translate(Vec3(0, 5, 0)));  // closed: its front alone
  const ScenePtr scene = m.finish();
  for (const uint32_t wanted : {200u, 3000u}) {
    const std::vector<int> none;
    const SceneView view(*scene, ReceiverMesh::kFacets, none);
    const ReceiverMesh mesh(view, wanted);
    EXPECT_LT(mesh.size(), std::max(wanted, 1400u));
    const ReceiverMesh::Points points = mesh.points(view);
    for (uint32_t instance = 0; instance < 3; ++instance) {
      const Mesh& of = *scene->meshes[size_t(scene->instances[instance].mesh)];
      for (uint32_t t = 0; t < of.triangles(); ++t)
        for (uint32_t k = 0; k < 40; ++k) {
          const Vec2 q = SobolSampler(t, k).next2D();
          const float r = std::sqrt(q.x), u = k == 0 ? 0.0f : k == 1 ? 1.0f : r * (1 - q.y), v = k == 0 ? 1.0f : k == 1 ? 0.0f : r * q.y;
          for (const bool front : {true, false}) {
            Between at;
            ASSERT_EQ(mesh.locate(instance, t, u, v, front, at), front || instance < 2);
            if (!front && instance == 2) continue;
            Vec3 place(0.0f), mean(0.0f);
            float sum = 0, cell = 0;
            const Mat4& world = scene->instances[instance].toWorld;
            const float w[3] = {1 - u - v, u, v};
            for (size_t c = 0; c < 3; ++c) place += w[c] * Vec3(world * Vec4(of.positions[of.indices[3 * t + c]], 1));
            for (size_t c = 0; c < kCorners; ++c) {
              ASSERT_LT(at.point[c], mesh.size());
              EXPECT_GE(at.weight[c], -1e-6f);
              mean += at.weight[c] * points.position[at.point[c]];
              sum += at.weight[c];
              cell = std::max(cell, points.cell[at.point[c]]);
              EXPECT_EQ(points.instance[at.point[c]], instance);
            }
            EXPECT_NEAR(sum, 1.0f, 1e-5f);
            EXPECT_LT(glm::length(mean - place), instance == 1 ? 0.1f * cell : std::max(0.1f * cell, mesh.spacing()));  // thinned: within a spacing
            const Vec3 out = instance == 2 ? place - Vec3(0, 5, 0) : instance == 1 ? Vec3(0, 1, 0) : Vec3((place.x - 0.2f), place.y / 4, place.z);
            EXPECT_EQ(glm::dot(points.normal[at.point[0]], out) > 0, front);
          }
        }
    }
  }
}

// A rail 2 mm behind boards with gaps between them: points behind a board have no say in what is seen between two; the corner of three walls keeps its own.
TEST(TransferPoints, InAGapHaveNoWeight) {
  SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  m.instance(m.mesh(tests::quad(Vec3(-2, 0, 0), Vec3(4, 0, 0), Vec3(0, 0.1f, 0)), grey));  // faces +z
  for (int i = -4; i <= 4; ++i) m.instance(m.mesh(tests::box(Vec3(0.4f * float(i) - 0.1f, -0.5f, 0.002f), Vec3(0.4f * float(i) + 0.1f, 0.6f, 0.03f)), grey));
  Stage t(m.finish(), 8000, 2);
  const auto usable = t.points->plane<uint8_t>("usable");
  int covered = 0, open = 0;
  for (size_t i = 0; i < usable.size(); ++i) {
    const DVec3 p = t.vector("position", i), n = t.vector("normal", i);
    if (!(n.z > 0.9 && std::fabs(p.z) < 1e-3) || std::fabs(p.x) > 1.6) continue;
    const double x = std::fabs(p.x - 0.4 * std::round(p.x / 0.4));  // from the middle of the board
    covered += x < 0.08;
    open += x > 0.12;
    if (x < 0.08) {
      EXPECT_FALSE(usable[i]) << p.x;
    } else if (x > 0.12) {
      EXPECT_TRUE(usable[i]) << p.x;
    }
  }
  EXPECT_GT(covered, 20);
  EXPECT_GT(open, 20);

  SceneMaker room;
  room.instance(room.mesh(tests::box(Vec3(-1), Vec3(1), true), room.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; })));
  Stage r(room.finish(), 1000, 2);
  for (const uint8_t u : r.points->plane<uint8_t>("usable")) EXPECT_TRUE(u);

  // What a floor has inside of a box sees the box's back faces, far away.
  SceneMaker buried;
  const int solid = buried.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; });
  buried.instance(buried.mesh(tests::ground(4.0f), solid));
  buried.instance(buried.mesh(tests::box(Vec3(-2, -1, -2), Vec3(2, 3, 2)), solid));
  Stage b(buried.finish(), 2000, 2);
  int inside = 0;
  for (size_t i = 0; i < b.s.size; ++i) {
    const DVec3 p = b.vector("position", i), n = b.vector("normal", i);
    if (!(n.y > 0.9 && std::fabs(p.y) < 1e-3)) continue;
    const double x = std::max(std::fabs(p.x), std::fabs(p.z));
    if (x < 1.9 || x > 2.1) { EXPECT_EQ(b.points->plane<uint8_t>("usable")[i] != 0, x > 2) << p.x << " " << p.z; }
    inside += x < 1.9;
  }
  EXPECT_GT(inside, 20);
}

TEST(DirectTransfer, OfAnOpenPlaneIsTheCosinesOwn) {
  SceneMaker m;
  m.instance(m.mesh(tests::ground(2.0f), m.material(Vec3(0.5f))), tests::translate(Vec3(0, 1, 0)));
  Stage stage(m.finish(), 200, 7);
  stage.trace(64);
  std::vector<double> Y(49);
  double worst = 0;
  for (size_t i = 0; i < stage.s.size; i += 7) {
    harmonics(stage.vector("normal", i), 7, Y.data());
    for (int l = 0; l < 7; ++l)
      for (int k = l * l; k < (l + 1) * (l + 1); ++k) worst = std::max(worst, std::fabs(stage.at(i, k) - cosineCoefficient(l) * Y[size_t(k)]));
  }
  EXPECT_LT(worst, 4e-3);  // 4096 directions
}

TEST(DirectTransfer, AtTheFootOfAWallIsHalf) {
  SceneMaker m;
  const int white = m.material(Vec3(0.5f), [](Material& x) { x.coverage.doubleSided = false; });
  m.instance(m.mesh(tests::ground(1.0f), white));
  m.instance(m.mesh(tests::quad(Vec3(-10, -1, -1), Vec3(20, 0, 0), Vec3(0, 10, 0)), white));
  Stage stage(m.finish(), 4000);
  stage.trace(16);
  int found = 0;
  for (size_t i = 0; i < stage.s.size; ++i) {
    const DVec3 p = stage.vector("position", i), n = stage.vector("normal", i);
    if (n.y < 0.5 || p.z > -0.9 || std::fabs(p.x) > 0.5) continue;
    EXPECT_NEAR(stage.at(i, 0) * std::sqrt(4 * std::numbers::pi), std::numbers::pi / 2, 0.08) << p.z;  // half of the open plane's pi
    ++found;
  }
  EXPECT_GT(found, 0);
}

// A spherical cavity: the form factor between any two places of it is the same. With an opening of area fraction a under radiance 1 direct irradiance is
// pi a everywhere, and each bounce multiplies by q = rho (1 - a).
TEST(BouncedTransfer, InASphereIsAGeometricSeries) {
  const int n = 48;
  Mesh open = tests::sphere(Vec3(0.0f), 1.0f, n, true);
  for (Vec3& normal : open.normals) normal = -normal;
  std::vector<uint32_t> kept;
  double area = 0, removed = 0;
  for (size_t t = 0; t < open.triangles(); ++t) {
    const Vec3 a = open.positions[open.indices[3 * t]], b = open.positions[open.indices[3 * t + 1]], c = open.positions[open.indices[3 * t + 2]];
    const double own = 0.5 * double(glm::length(glm::cross(b - a, c - a)));
    area += own;
    if ((a.y + b.y + c.y) / 3 > 0.7f) {
      removed += own;
      continue;
    }
    for (const size_t k : {0u, 2u, 1u}) kept.push_back(open.indices[3 * t + k]);  // inwards
  }
  open.indices = Array<uint32_t>(kept);
  const double a = removed / area, rho = 0.6, q = rho * (1 - a);
  SceneMaker m;
  m.instance(m.mesh(std::move(open), m.material(Vec3(float(rho), 0.3f, 0.0f), [](Material& x) { x.coverage.doubleSided = false; })));
  Stage stage(m.finish(), 200);
  stage.trace(4);
  std::vector<size_t> within;  // the outer side has points too
  for (size_t i = 0; i < stage.s.size; ++i)
    if (glm::dot(stage.vector("position", i), stage.vector("normal", i)) < 0) within.push_back(i);
  ASSERT_EQ(2 * within.size(), size_t(stage.s.size));
  const TermPtr albedo = stage.run(makePointAlbedoNode(stage.s), {stage.points});
  TermPtr before = stage.direct;
  const double one = std::sqrt(4 * std::numbers::pi);
  double expected = 0;
  for (uint32_t b = 0; b < 4; ++b) {
    before = stage.run(makeBouncedTransferNode(stage.s, b, 256), {stage.points, albedo, before});
    expected += std::numbers::pi * a * std::pow(q, b + 1);
    double mean[3] = {}, rest = 0;
    const size_t harmonicCount = size_t(stage.s.harmonics());
    for (const size_t i : within)
      for (size_t c = 0; c < 3; ++c) mean[c] += double(before->floats("sum")[(3 * i + c) * harmonicCount]) * one / double(within.size());
    rest = mean[2];
    EXPECT_NEAR(mean[0] / expected, 1.0, 0.012) << b;
    EXPECT_EQ(rest, 0.0);
    EXPECT_NEAR(mean[1] / (std::numbers::pi * a *
                           [&] {
                             double sum = 0;
                             for (uint32_t k = 0; k <= b; ++k) sum += std::pow(0.3 * (1 - a), k + 1);
                             return sum;
                           }()),
                1.0, 0.015);
  }
}

// A lid that has both sides, over a floor: what bounces down from it is what its dark underside has, not what the sky gives to its top.
TEST(BouncedTransfer, IsOfTheSideThatIsSeen) {
  SceneMaker m;
  const int white = m.material(Vec3(0.9f));
  m.instance(m.mesh(tests::ground(3.0f), m.material(Vec3(0.0f), [](Material& x) { x.coverage.doubleSided = false; })));
  m.instance(m.mesh(tests::ground(3.0f, 0.6f), white));
  Stage stage(m.finish(), 3000, 2);
  stage.trace(4);
  const TermPtr bounced =
      stage.run(makeBouncedTransferNode(stage.s, 0, 256), {stage.points, stage.run(makePointAlbedoNode(stage.s), {stage.points}), stage.direct});
  const double open = 0.9 * std::numbers::pi / std::sqrt(4 * std::numbers::pi);  // of a floor that sees nothing but a lid in the open
  int found = 0;
  for (size_t i = 0; i < stage.s.size; ++i) {
    const DVec3 p = stage.vector("position", i), n = stage.vector("normal", i);
    if (p.y > 0.3 || n.y < 0.5 || std::hypot(p.x, p.z) > 1.0) continue;
    EXPECT_LT(double(bounced->floats("sum")[3 * i * size_t(stage.s.harmonics())]), 0.15 * open);
    ++found;
  }
  EXPECT_GT(found, 10);
}

// A single-sided lid that faces up, over a floor: what bounces down from its back is what a lid of both sides sends, and most of it came from below.
TEST(BouncedTransfer, ALidsBackReflectsAsItsFrontDoes) {
  std::vector<float> sums[2];
  for (const bool both : {false, true}) {
    SceneMaker m;
    m.instance(m.mesh(tests::ground(0.5f), m.material(Vec3(0.0f), [](Material& x) { x.coverage.doubleSided = false; })));
    m.instance(m.mesh(tests::ground(3.0f, 0.6f), m.material(Vec3(0.9f), [&](Material& x) { x.coverage.doubleSided = both; })));
    Stage stage(m.finish(), 3000, 2);
    stage.trace(4);
    const TermPtr bounced =
        stage.run(makeBouncedTransferNode(stage.s, 0, 256), {stage.points, stage.run(makePointAlbedoNode(stage.s), {stage.points}), stage.direct});
    const auto sum = bounced->floats("sum");
    sums[both].assign(sum.begin(), sum.end());
    const size_t n = size_t(stage.s.harmonics());
    int found = 0;
    for (size_t i = 0; i < stage.s.size; ++i) {
      const DVec3 p = stage.vector("position", i), normal = stage.vector("normal", i);
      if (p.y > 0.3 || normal.y < 0.5) continue;
      // Under a uniform map of radiance 1: of 0.9 pi at most what the floor leaves of the lid's own light.
      const double uniform = double(sum[3 * i * n]) * std::sqrt(4 * std::numbers::pi);
      EXPECT_GT(uniform, 0.4 * std::numbers::pi) << p.x << " " << p.z;
      EXPECT_LT(uniform, 0.9 * std::numbers::pi);
      EXPECT_LT(double(sum[3 * i * n + 2]), -0.1) << "a harmonic that is positive above";
      ++found;
    }
    EXPECT_GT(found, 4);
  }
  EXPECT_EQ(sums[0], sums[1]);
}

/// What a place sees of an open sky through no gap at all.
TEST(DirectTransfer, AClosedRoomIsDark) {
  SceneMaker m;
  for (const bool both : {false, true}) {
    SceneMaker one;
    one.instance(one.mesh(tests::box(Vec3(-1), Vec3(1, 2, 3), true), one.material(Vec3(0.5f), [&](Material& x) { x.coverage.doubleSided = both; })));
    Stage stage(one.finish(), 3000);
    stage.trace(4);
    double inside = 0;
    for (size_t i = 0; i < stage.s.size; ++i) {
      const DVec3 p = stage.vector("position", i), n = stage.vector("normal", i);
      if (glm::dot(n, DVec3(0, 0.5, 1) - p) < 0) continue;  // the outer side
      for (int k = 0; k < stage.s.harmonics(); ++k) inside = std::max(inside, std::fabs(stage.at(i, k)));
    }
    EXPECT_EQ(inside, 0.0);
  }
}

TEST(DirectTransfer, BlocksGoOnToTheSameMean) {
  SceneMaker m;
  m.instance(m.mesh(tests::box(Vec3(-1), Vec3(1)), m.material(Vec3(0.5f))));
  m.instance(m.mesh(tests::ground(3, -1), m.material(Vec3(0.5f))));
  Stage stage(m.finish(), 400);
  stage.trace(8);
  // Halves agree, and the error of their difference falls as it should: 512 against 4096 directions
  const TermPtr few = stage.direct;
  stage.trace(64);
  double difference = 0, size = 0;
  for (size_t i = 0; i < few->floats("transfer").size(); ++i) {
    difference += std::pow(double(few->floats("transfer")[i]) - double(stage.direct->floats("transfer")[i]), 2);
    size += std::pow(double(stage.direct->floats("transfer")[i]), 2);
  }
  EXPECT_LT(std::sqrt(difference / size), 0.02);
}

// Pictures

/// Boxes on a floor, under an environment of low order.
ScenePtr yard(float albedo, EnvironmentPtr map, bool glossy = false) {
  SceneMaker m;
  const int grey = m.material(Vec3(albedo)), red = m.material(Vec3(albedo, 0.3f * albedo, 0.2f * albedo), [&](Material&x) {
    if (glossy) x.bsdf.specular = 1.0f, x.bsdf.roughness = 0.5f;
  });
  m.instance(m.mesh(tests::ground(4.0f), grey));
  m.instance(m.mesh(tests::box(Vec3(-1, 0, -1), Vec3(0, 1.5f, 0)), red));
  m.instance(m.mesh(tests::sphere(Vec3(0.8f, 0.6f, 0.5f), 0.6f, 24, true), grey));
  m.environment(std::move(map));
  m.camera(Vec3(2.5f, 2.5f, 4.0f), Vec3(0, 0.5f, 0), 0.8f);
  return m.finish();
}

EnvironmentPtr gradient() {
  Image image(64, 32, 3);
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 64; ++x) {
      const double theta = (y + 0.5) * std::numbers::pi / 32, phi = (x + 0.5) * 2 * std::numbers::pi / 64 - std::numbers::pi;
      const double side = std::sin(theta) * std::cos(phi), up = std::cos(theta);
      for (int k = 0; k < 3; ++k) image.data[3 * size_t(y * 64 + x) + size_t(k)] = float(1.0 + 0.6 * side * (k == 0 ? 1 : 0.5) + 0.3 * up + 0.2 * side * up);
    }
  return makeEnvironment("gradient", std::move(image));
}

v1::RenderRequest requestOf(int spp) {
  v1::RenderRequest r = testing::smallRequest("yard", 48, 32, spp);
  r.set_view_samples(4);
  r.mutable_integrator()->set_max_bounces(3);
  return r;
}
RenderResult pictureOf(Engine& engine, const ScenePtr& scene, const v1::RenderRequest& request) {
  RenderControl control;
  control.scene = scene;
  auto result = engine.render(request, control);
  EXPECT_TRUE(result.ok()) << result.status().toString();
  return result.ok() ? std::move(*result) : RenderResult{};
}
double meanOf(const Image& a) {
  double sum = 0;
  for (const float v : a.data) sum += double(v);
  return sum / double(a.data.size());
}
double relativeRmse(const Image& a, const Image& truth) {
  double sum = 0;
  for (size_t i = 0; i < a.data.size(); ++i) sum += std::pow(double(a.data[i]) - double(truth.data[i]), 2);
  return std::sqrt(sum / double(a.data.size())) / meanOf(truth);
}

TEST(TransferPictures, AreThoseOfThePathTracerUnderASmoothSky) {
  const auto engine = testing::makeEngine();  // one for both: what does not depend on materials is traced once
  for (const bool glossy : {false, true}) {
    const ScenePtr scene = yard(0.7f, gradient(), glossy);
    v1::RenderRequest r = requestOf(256);
    const RenderResult truth = pictureOf(*engine, scene, r);
    testing::set(r, "environment.transfer.samples=1024");
    testing::set(r, "environment.transfer.points=8000");
    const RenderResult fast = pictureOf(*engine, scene, r);
    EXPECT_NEAR(meanOf(fast.images[0].image()) / meanOf(truth.images[0].image()), 1.0, 0.01) << glossy;
    EXPECT_LT(relativeRmse(fast.images[0].image(), truth.images[0].image()), 0.05) << glossy;
  }
}

/// A sun of 3 degrees over a horizon that is bright on one side: nothing about it is the same after a turn.
EnvironmentPtr sunny() {
  Image image(256, 128, 3);
  const DVec3 sun = glm::normalize(DVec3(0.5, 0.7, 0.5));
  for (int y = 0; y < 128; ++y)
    for (int x = 0; x < 256; ++x) {
      const double theta = (y + 0.5) * std::numbers::pi / 128, phi = (x + 0.5) * std::numbers::pi / 128 - std::numbers::pi;
      const DVec3 d(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
      const double value = 0.5 + 0.45 * d.z + (glm::dot(d, sun) > std::cos(0.026) ? 700.0 : 0.0);
      for (size_t k = 0; k < 3; ++k) image.data[3 * size_t(y * 256 + x) + k] = float(value * (k == 2 ? 0.6 : 1.0));
    }
  return makeEnvironment("sunny", std::move(image));
}

// Everything of the technique at once: a sun of half of the light (counted once), a map that was turned, shining and dull surfaces, one that is unlit, one
// whose back is seen and one whose front is.
TEST(TransferPictures, AreThoseOfThePathTracerUnderATurnedSun) {
  const auto engine = testing::makeEngine();
  for (const bool glossy : {false, true}) {
    SceneMaker m;
    const int grey = m.material(Vec3(0.6f)), red = m.material(Vec3(0.8f, 0.3f, 0.2f), [&](Material&x) {
      if (glossy) x.bsdf.specular = 1.0f, x.bsdf.roughness = 0.4f;
    });
    m.instance(m.mesh(tests::ground(4.0f), grey));
    m.instance(m.mesh(tests::box(Vec3(-1.4f, 0, -1), Vec3(-0.5f, 1.2f, 0)), red));
    m.instance(m.mesh(tests::sphere(Vec3(0.9f, 0.6f, -0.3f), 0.6f, 24, true), red));
    m.instance(m.mesh(tests::quad(Vec3(-1.6f, 0, 1.4f), Vec3(0.8f, 0, 0), Vec3(0, 0.8f, 0)), grey));  // its front to the camera
    m.instance(m.mesh(tests::quad(Vec3(1.6f, 0, 1.4f), Vec3(-0.8f, 0, 0), Vec3(0, 0.8f, 0)), grey));  // its back
    m.instance(
        m.mesh(tests::quad(Vec3(-0.4f, 0.02f, 1.0f), Vec3(0.8f, 0, 0), Vec3(0, 0, -0.6f)), m.material(Vec3(0.5f), [](Material& x) { x.bsdf.unlit = true; })));
    m.environment(sunny());
    m.camera(Vec3(0.3f, 2.8f, 4.5f), Vec3(0, 0.3f, 0), 0.8f);
    const ScenePtr scene = m.finish();
    v1::RenderRequest r = requestOf(512);
    testing::set(r, "environment.rotation_deg=70");
    const RenderResult truth = pictureOf(*engine, scene, r);
    for (const char* e : {"environment.transfer.samples=512", "environment.transfer.points=8000", "shadows.ray_traced.samples=16"}) testing::set(r, e);
    const RenderResult fast = pictureOf(*engine, scene, r);
    const double mean = meanOf(fast.images[0].image()) / meanOf(truth.images[0].image()), rmse = relativeRmse(fast.images[0].image(), truth.images[0].image());
    std::printf("  %s: mean %.3f, RMSE %.3f of the mean\n", glossy ? "shining" : "dull", mean, rmse);
    EXPECT_NEAR(mean, 1.0, 0.015) << glossy;
    EXPECT_LT(rmse, 0.06) << glossy;
    // The reply says how the map was split: one light, of the flux of the texels that are its.
    double sun = 0, all = 0;
    for (int y = 0; y < 128; ++y)
      for (int x = 0; x < 256; ++x) {
        const double flux = double(scene->environment->texels[size_t(y * 256 + x)].x) * std::sin((y + 0.5) * std::numbers::pi / 128);
        all += flux;
        if (flux > 100) sun += flux;
      }
    const std::string reason = testing::nodesBy(fast, v1::NodeReport::RUN).at("environment:direct").reason();
    const size_t at = reason.find("shadows of their own: 1, of ");
    ASSERT_NE(at, std::string::npos) << reason;
    EXPECT_NEAR(std::atof(reason.c_str() + at + 28), 100 * sun / all, 0.5) << reason;
  }
}

/// A dim sky with one texel that is a million times as bright.
EnvironmentPtr oneTexel(int x, int y) {
  Image image(512, 256, 3);
  std::fill(image.data.begin(), image.data.end(), 1e-3f);
  for (size_t k = 0; k < 3; ++k) image.data[3 * size_t(y * 512 + x) + k] = 1e3f;
  return makeEnvironment("one texel", std::move(image));
}

// Maps and meshes that break things: every picture is finite and has the path tracer's mean.
TEST(TransferPictures, OfHardCases) {
  const auto once = [](const Vec3& from, const std::function<void(SceneMaker&)>& fill) {
    return [=](EnvironmentPtr map) {
      SceneMaker m;
      fill(m);
      m.environment(std::move(map));
      m.scene.lights.back().cameraVisible = false;  // surfaces alone make the mean
      m.camera(from, Vec3(0, 0.4f, 0), 0.7f);
      return m.finish();
    };
  };
  const auto folded = [](const std::vector<Vec3>& corners) {  // as they come, three to a triangle
    Mesh mesh;
    mesh.positions = Array<Vec3>(corners);
    std::vector<uint32_t> indices(corners.size());
    for (uint32_t i = 0; i < indices.size(); ++i) indices[i] = i;
    mesh.indices = Array<uint32_t>(indices);
    return mesh;
  };
  const Vec3 above(1.5f, 2.2f, 3.0f);
  const std::vector<std::pair<const char*, std::function<ScenePtr(EnvironmentPtr)>>> scenes{
      {"one triangle", once(above,
                            [&](SceneMaker& m) {
                              m.instance(m.mesh(folded({Vec3(-1, 0, 1), Vec3(1, 0, 1), Vec3(0, 0.8f, -1)}), m.material(Vec3(0.7f))));
                            })},
      {"three sheets on one edge",
       once(above,
            [&](SceneMaker& m) {
              const Vec3 a(0, 0, 1), b(0, 0, -1);
              m.instance(m.mesh(folded({a, b, Vec3(-1.2f, 0.5f, 0), a, b, Vec3(1.2f, 0.4f, 0), a, b, Vec3(0.1f, 1.3f, 0)}), m.material(Vec3(0.7f))));
            })},
      {"triangles without area", once(above,
                                      [&](SceneMaker& m) {
                                        m.instance(m.mesh(folded({Vec3(-2, 0, 2), Vec3(2, 0, 2), Vec3(0, 0, -3), Vec3(0.0f), Vec3(0.0f), Vec3(0.0f),
                                                                  Vec3(0, 0.2f, 0), Vec3(1, 0.2f, 0), Vec3(0.5f, 0.2f, 0)}),
                                                          m.material(Vec3(0.7f))));
                                      })},
      {"shards", once(above,
                      [&](SceneMaker& m) {
                        std::vector<Vec3> corners;
                        for (uint32_t i = 0; i < 400; ++i) {
                          const Vec2 p = SobolSampler(3, i).next2D(), q = SobolSampler(4, i).next2D();
                          const Vec3 at(3 * p.x - 1.5f, q.x, 3 * p.y - 1.5f);
                          for (const Vec3& d : {Vec3(0.1f, 0, 0), Vec3(0, 0.1f * q.y, 0.05f), Vec3(-0.05f, 0.05f, -0.1f)}) corners.push_back(at + d);
                        }
                        m.instance(m.mesh(folded(corners), m.material(Vec3(0.7f))));
                        m.instance(m.mesh(tests::ground(2.0f), m.material(Vec3(0.5f))));
                      })},
      {"a white box from inside",
       once(Vec3(0.9f, 0.5f, 0.9f), [&](SceneMaker& m) { m.instance(m.mesh(tests::box(Vec3(-1), Vec3(1, 2, 1), true), m.material(Vec3(1.0f)))); })},
  };
  Image four(2, 2, 3);
  for (size_t i = 0; i < four.data.size(); ++i) four.data[i] = 0.3f + float(i % 5);
  Image wrong(16, 8, 3);
  for (size_t i = 0; i < wrong.data.size(); ++i) wrong.data[i] = i % 41 == 0 ? std::nanf("") : i % 37 == 0 ? -5.0f : i % 53 == 0 ? INFINITY : 1.0f;
  const std::vector<std::pair<const char*, EnvironmentPtr>> maps{
      {"four texels", makeEnvironment("four", std::move(four))},    {"black", constantEnvironment(Vec3(0.0f))},
      {"repaired", makeEnvironment("wrong", std::move(wrong))},     {"a texel at the zenith", oneTexel(100, 0)},
      {"a texel on the seam and a cube's edge", oneTexel(511, 64)}, {"a texel below", oneTexel(300, 200)}};
  const auto engine = testing::makeEngine();
  for (size_t i = 0; i < scenes.size(); ++i)
    for (size_t k = 0; k < maps.size(); ++k) {
      if (!testing::thorough() && (i + k) % 2 != 0) continue;  // every scene and every map with some of the others
      const auto& [what, make] = scenes[i];
      const auto& [sky, map] = maps[k];
      const ScenePtr scene = make(map);
      v1::RenderRequest r = testing::smallRequest("hard", 24, 18, 256);
      r.mutable_integrator()->set_max_bounces(3);
      r.set_view_samples(4);
      const Image truth = pictureOf(*engine, scene, r).images[0].image();
      testing::set(r, "environment.transfer.points=3000");
      const Image fast = pictureOf(*engine, scene, r).images[0].image();
      for (const float v : fast.data) ASSERT_TRUE(std::isfinite(v) && v >= 0.0f) << what << ", " << sky;
      EXPECT_NEAR(meanOf(fast), meanOf(truth), 0.04 * meanOf(truth) + 2e-5) << what << ", " << sky;
    }
}

// Nothing pops under a map that turns: the total variation of what it gives in steps of a degree is at most half as much again as that of the path tracer,
// whose steps of three degrees and noise (of 4096 samples) are in its favour and against it by a few percent.
TEST(TransferPictures, VaryNoMoreThanThePathTracersWhileAMapTurns) {
  SceneMaker m;
  const int grey = m.material(Vec3(0.6f));
  m.instance(m.mesh(tests::ground(4.0f), grey));
  m.instance(m.mesh(tests::box(Vec3(-1.4f, 0, -1), Vec3(-0.5f, 1.2f, 0)), grey));
  m.instance(m.mesh(tests::sphere(Vec3(0.9f, 0.6f, -0.3f), 0.6f, 24, true), grey));
  m.environment(sunny());
  m.camera(Vec3(0.3f, 2.8f, 4.5f), Vec3(0, 0.3f, 0), 0.6f);
  const ScenePtr scene = m.finish();
  const auto engine = testing::makeEngine();
  const auto variation = [&](v1::RenderRequest r, int step) {
    double sum = 0;
    Image last;
    for (int turn = 0; turn <= testing::thoroughOr(90, 45); turn += step) {
      testing::set(r, "environment.rotation_deg=" + std::to_string(turn));
      Image now = pictureOf(*engine, scene, r).images[0].image();
      if (turn > 0)
        for (size_t i = 0; i < now.data.size(); ++i) sum += std::fabs(double(now.data[i]) - double(last.data[i]));
      last = std::move(now);
    }
    return sum;
  };
  v1::RenderRequest r = testing::smallRequest("yard", 8, 6, 4096);
  r.mutable_integrator()->set_max_bounces(3);
  r.set_view_samples(16);
  const double traced = variation(r, 3);
  for (const char* e : {"halt.spp=64", "environment.transfer.samples=256", "environment.transfer.points=6000"}) testing::set(r, e);
  const double fast = variation(r, 1);
  std::printf("  total variation %.3f of the path tracer's\n", fast / traced);
  EXPECT_LT(fast, 1.5 * traced);
  EXPECT_GT(fast, 0.7 * traced);  // and it does turn
}

TEST(TransferPictures, ANewTurnOrMapTracesNoRay) {
  const ScenePtr scene = yard(0.7f, gradient());
  const auto engine = testing::makeEngine();
  v1::RenderRequest r = requestOf(4);
  testing::set(r, "environment.transfer.bands=4");
  testing::set(r, "environment.transfer.points=1000");
  testing::set(r, "camera.look_at=0,0,0");  // nothing but surfaces: what the camera sees of a map is traced
  testing::set(r, "camera.position=0,6,0.01");
  testing::set(r, "camera.yfov_deg=30");
  pictureOf(*engine, scene, r);
  testing::set(r, "environment.rotation_deg=33");
  const RenderResult turned = pictureOf(*engine, scene, r);
  for (const auto& [label, node] : testing::nodesBy(turned, v1::NodeReport::RUN))
    if (label.find("transfer") != std::string::npos || label.find("environment:") == 0) { EXPECT_EQ(node.rays(), 0u) << label; }
  const auto reused = testing::nodesBy(turned, v1::NodeReport::REUSED);
  EXPECT_TRUE(reused.count("transfer:direct"));
  v1::RenderRequest cold = r;
  EXPECT_EQ(testing::firstDifference(turned, pictureOf(*testing::makeEngine(), scene, cold)), "");
}

/// A sheet from above and from below.
std::array<double, 2> sidesOfASheet(const EnvironmentPtr& map, bool doubleSided) {
  SceneMaker m;
  m.instance(m.mesh(tests::ground(1.0f), m.material(Vec3(0.6f), [&](Material& x) { x.coverage.doubleSided = doubleSided; })));
  m.environment(map);
  m.scene.lights.back().cameraVisible = false;
  const auto engine = testing::makeEngine();
  std::array<double, 2> mean{};
  for (const float side : {1.0f, -1.0f}) {
    m.camera(Vec3(0, 2 * side, 0.01f), Vec3(0.0f), 0.5f);
    v1::RenderRequest r = requestOf(1);
    testing::set(r, "environment.transfer.points=500");
    testing::set(r, "environment.transfer.bands=10");
    mean[side < 0] = meanOf(pictureOf(*engine, m.finish(), r).images[0].image());
  }
  return mean;
}

// A sheet under a bright sky, from below: its underside is as dark as what it looks at; under a uniform one both sides are alike. Whatever doubleSided says.
TEST(TransferPictures, ASheetFromBelowHasItsOwnSidesLight) {
  Image image(64, 32, 3);
  std::fill(image.data.begin(), image.data.begin() + 3 * 64 * 16, 1.0f);
  const EnvironmentPtr above = makeEnvironment("above", std::move(image)), uniform = constantEnvironment(Vec3(1.0f));
  for (const bool doubleSided : {true, false}) {
    const std::array<double, 2> half = sidesOfASheet(above, doubleSided), whole = sidesOfASheet(uniform, doubleSided);
    EXPECT_NEAR(half[0], 0.6, 0.02) << doubleSided;
    EXPECT_LT(half[1], 0.02) << doubleSided;
    EXPECT_NEAR(whole[0], 0.6, 0.005) << doubleSided;
    EXPECT_NEAR(whole[1], whole[0], 1e-3) << doubleSided;
  }
}

// What lies below every normal in view costs no ray, though it is a light of the map.
TEST(TransferPictures, ALightBelowEveryHorizonTracesNothing) {
  SceneMaker m;
  m.instance(m.mesh(tests::ground(4.0f), m.material(Vec3(0.6f))));
  m.environment(oneTexel(300, 200));
  m.camera(Vec3(0, 6, 0.01f), Vec3(0.0f), 0.5f);  // nothing but the ground
  const auto engine = testing::makeEngine();
  v1::RenderRequest r = requestOf(1);
  testing::set(r, "environment.transfer.points=500");
  const RenderResult result = pictureOf(*engine, m.finish(), r);
  const auto ran = testing::nodesBy(result, v1::NodeReport::RUN);
  EXPECT_TRUE(ran.count("visibility:environment/0"));
  for (const auto& [label, node] : ran)
    if (label.rfind("visibility:", 0) == 0) { EXPECT_EQ(node.rays(), 0u) << label; }
}

TEST(TransferPictures, GainsAreGains) {
  const ScenePtr scene = yard(0.5f, gradient());
  const auto engine = testing::makeEngine();
  v1::RenderRequest r = requestOf(1);
  testing::set(r, "environment.transfer.points=500");
  const double one = meanOf(pictureOf(*engine, scene, r).images[0].image());
  testing::set(r, "environment.gain=2,2,2");
  const RenderResult two = pictureOf(*engine, scene, r);
  EXPECT_NEAR(meanOf(two.images[0].image()) / one, 2.0, 1e-5);
  EXPECT_FALSE(testing::nodesBy(two, v1::NodeReport::RUN).count("transfer:light"));
}

}  // namespace
}  // namespace gobo::transfer::transfer_test
