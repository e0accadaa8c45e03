// SPDX-License-Identifier: Apache-2.0
// Many lights at one point, light by light: against the materials' own evaluation, dense quadrature over lights of some size, and closed forms.
#include "terms/light_list.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <random>

#include "lamp_stage.h"
#include "scene/builtin/build.h"
#include "scene/light_axes.h"
#include "trace/distant_light.h"

namespace gobo::subtractive_test {
namespace {

struct Draws {
  std::mt19937 engine;
  explicit Draws(uint32_t seed) : engine(seed) {}
  float in(float lo, float hi) { return std::uniform_real_distribution<float>(lo, hi)(engine); }
  Vec3 up(float least) {
    const float z = in(least, 1.0f), phi = in(0.0f, 6.2831853f), r = std::sqrt(1.0f - z * z);
    return Vec3(r * std::cos(phi), r * std::sin(phi), z);
  }
  BsdfParams material(int kind) {
    BsdfParams p;
    p.albedo = Vec3(in(0, 1), in(0, 1), in(0, 1));
    p.roughness = in(0.15f, 1.0f);
    p.ior = in(1.2f, 2.5f);
    p.specular = kind == 0 ? 0.0f : in(0.2f, 1.0f);
    p.metallic = kind == 2 ? 1.0f : kind == 3 ? in(0, 1) : 0.0f;
    return p;
  }
};

TEST(BsdfLook, IsTheMaterialsOwnEvaluationAtEveryDirection) {
  Draws draw(3);
  double worst = 0;
  int folded = 0;
  for (int trial = 0; trial < 600; ++trial) {
    BsdfParams p = draw.material(trial % 4);
    const Vec3 wo = draw.up(0.02f);
    if (trial % 3 == 0) p.facing = glm::normalize(Vec3(draw.in(-0.5f, 0.5f), draw.in(-0.5f, 0.5f), 1.0f));
    ASSERT_TRUE(BsdfLook::covers(p));
    const BsdfLook look(p, wo);
    ASSERT_EQ(look.lambert(), trial % 4 == 0);
    BsdfLook::Directions in;
    BsdfLook::Lobes out;
    const size_t n = 24;
    for (size_t k = 0; k < n; ++k) {
      Vec3 w = draw.up(k % 5 == 0 ? -1.0f : 0.0f);
      if (k % 3 == 1) w = glm::normalize(Vec3(-wo.x, -wo.y, wo.z) + 0.2f * w);  // the highlight
      in.x[k] = w.x, in.y[k] = w.y, in.z[k] = w.z;
    }
    look.at(in, n, out);
    for (size_t k = 0; k < n; ++k) {
      const Vec3 w(in.x[k], in.y[k], in.z[k]);
      const BsdfValue f = bsdfEval(p, wo, w);
      const Vec3 diffuse = look.albedo * out.diffuse[k];
      const Vec3 specular = look.lambert() ? Vec3(0.0f) : look.facets * out.facets[k] + look.grazing * out.grazing[k] + look.bounced * out.bounced[k];
      if (p.facing != Vec3(0, 0, 1) && !look.lambert()) {
        if (std::abs(glm::dot(w, p.facing)) < 1e-4f) continue;  // a jump
        folded += glm::dot(w, p.facing) > 0 && (w - 2.0f * glm::dot(w, p.facing) * p.facing).z > 0 && w.z > 0;
      }
      for (int c = 0; c < 3; ++c) {
        worst = std::max(worst, std::abs(double(diffuse[c]) - double(f.diffuse[c])) / (double(f.diffuse[c]) + 1e-6));
        worst = std::max(worst, std::abs(double(specular[c]) - double(f.specular[c])) / (double(f.specular[c]) + 1e-6));
      }
    }
  }
  EXPECT_LT(worst, 2e-5);
  EXPECT_GT(folded, 20);
}

TEST(BsdfLook, CoversNothingThatItDoesNotHave) {
  const auto with = [](auto&& change) {
    BsdfParams p;
    change(p);
    return BsdfLook::covers(p);
  };
  EXPECT_TRUE(with([](BsdfParams&) {}));
  EXPECT_FALSE(with([](BsdfParams& p) { p.roughness = 0.01f; }));
  EXPECT_TRUE(with([](BsdfParams& p) { p.roughness = 0.0f, p.specular = 0.0f; })) << "Lambert has none";
  EXPECT_FALSE(with([](BsdfParams& p) { p.transmission = 0.5f; }));
  EXPECT_FALSE(with([](BsdfParams& p) { p.clearcoat = 0.5f; }));
  EXPECT_FALSE(with([](BsdfParams& p) { p.sheenColor = Vec3(0.1f); }));
  EXPECT_FALSE(with([](BsdfParams& p) { p.anisotropy = 0.5f; }));
  EXPECT_FALSE(with([](BsdfParams& p) { p.iridescence = 0.5f; }));
  EXPECT_FALSE(with([](BsdfParams& p) { p.diffuseTransmission = 0.5f; }));
}

/// Lists over lights that stand alone in a scene.
struct Listed {
  Listed(const std::vector<Light>& lamps, int samples = 32) : Listed(withLamps(floorScene([](SceneMaker&, int) {}), lamps), samples) {}
  Listed(const ScenePtr& lit, int samples) : scene(lit) {
    for (size_t l = 0; l < scene->lights.size(); ++l) {
      subset.push_back(int(l));
      asked.push_back({int(l), scene->lights[l].power});
    }
    view = std::make_unique<SceneView>(*scene, Facet::LightShape | Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage | Facet::Emission, subset);
    sampler = LightSampler::build(*view);
    list = std::make_unique<LightList>(*view, *sampler, asked, samples, 9);
  }
  ScenePtr scene;
  std::vector<int> subset;
  std::vector<SceneLight> asked;
  std::unique_ptr<SceneView> view;
  std::shared_ptr<const LightSampler> sampler;
  std::unique_ptr<LightList> list;
};

BsdfValue of(const LightList& list, const LightList::Values& v, int light) {
  BsdfValue out;
  for (size_t place = 0; place < list.places(); ++place)
    if (list.light(place) == light)
      for (int c = 0; c < 3; ++c) {
        out.diffuse[c] = v.diffuse[c][place];
        if (v.glossy) out.specular[c] = v.specular[c][place];
      }
  return out;
}

/// By many points of a light of some size.
BsdfValue dense(const LitPoint& p, const LightShape& s, const int kRings = 48, const int kSpokes = 64) {
  const Frame frame = p.frame();
  const Vec3 wo = frame.toLocal(p.wo);
  DVec3 sum[2] = {DVec3(0.0), DVec3(0.0)};
  const BsdfLook look(p.bsdf, wo);  // BsdfLook.IsTheMaterialsOwnEvaluationAtEveryDirection
  BsdfLook::Directions in;
  BsdfLook::Lobes lobes;
  double weights[BsdfLook::kMost];
  size_t held = 0;
  const auto flush = [&] {
    const size_t count = held;
    for (; held % 8; ++held) in.x[held] = in.y[held] = 0.0f, in.z[held] = 1.0f;
    look.at(in, held, lobes);
    for (size_t k = 0; k < count; ++k) {
      sum[0] += DVec3(look.albedo * lobes.diffuse[k]) * weights[k];
      if (!look.lambert()) sum[1] += DVec3(look.facets * lobes.facets[k] + look.grazing * lobes.grazing[k] + look.bounced * lobes.bounced[k]) * weights[k];
    }
    held = 0;
  };
  const auto add = [&](const DVec3& w, double weight) {
    const Vec3 wi(w);
    if (!(glm::dot(wi, p.n) > 0) || !(glm::dot(wi, p.ng) > 0)) return;
    const Vec3 local = frame.toLocal(wi);
    in.x[held] = local.x, in.y[held] = local.y, in.z[held] = local.z;
    weights[held] = weight;
    if (++held == BsdfLook::kMost) flush();
  };
  const bool square = s.skyRectangle != Vec2(0.0f), sun = s.kind == LightKind::Directional && !square;
  const Frame sky = square ? mapFrame(s) : Frame(Vec3(0, 0, 1));
  const double irradiance = square ? DistantLight(s).irradiance() : 0.0;
  const DVec3 d = sun || square ? -DVec3(s.axis) : DVec3(s.position) - DVec3(p.p);
  const double sine = sun ? std::sin(0.5 * double(s.angularSize)) : double(s.radius) / glm::length(d), drop = 1.0 - std::sqrt(1.0 - sine * sine);
  const Vec3 centre(glm::normalize(d));
  const Frame f(s.kind == LightKind::Disk ? s.axis : centre);
  for (int i = 0; i < kRings; ++i)
    for (int k = 0; k < kSpokes; ++k) {
      const double r2 = (i + 0.5) / kRings, phi = 2.0 * std::numbers::pi * (k + 0.5) / kSpokes;
      if (square) {
        const double x = s.skyRectangle.x * ((i + 0.5) / kRings - 0.5), y = s.skyRectangle.y * ((k + 0.5) / kSpokes - 0.5),
                     c = 1.0 / std::sqrt(1.0 + x * x + y * y);
        add((d + DVec3(sky.x) * x + DVec3(sky.y) * y) * c, double(s.skyRectangle.x) * s.skyRectangle.y * c * c * c / irradiance / (kRings * kSpokes));
        continue;
      }
      if (s.kind == LightKind::Sphere || sun) {
        const double fall = r2 * drop, side = std::sqrt(fall * (2.0 - fall));
        add(DVec3(f.x) * (side * std::cos(phi)) + DVec3(f.y) * (side * std::sin(phi)) + DVec3(f.z) * (1.0 - fall),
            2.0 * std::numbers::pi * drop / (kRings * kSpokes) * (sun ? 1.0 / (std::numbers::pi * sine * sine) : 1.0));
        continue;
      }
      const double area = s.kind == LightKind::Disk ? std::numbers::pi * double(s.radius) * s.radius : 4.0 * glm::length(DVec3(s.u)) * glm::length(DVec3(s.v));
      const DVec3 to = s.kind == LightKind::Disk ? d + (DVec3(f.x) * std::cos(phi) + DVec3(f.y) * std::sin(phi)) * (double(s.radius) * std::sqrt(r2))
                                                 : d + DVec3(s.u) * (2.0 * (i + 0.5) / kRings - 1.0) + DVec3(s.v) * (2.0 * (k + 0.5) / kSpokes - 1.0);
      const double distance = glm::length(to), cosine = -glm::dot(to, DVec3(s.axis)) / distance;
      const double facing = s.twoSided ? std::abs(cosine) : std::max(cosine, 0.0);
      add(to / distance, area * facing / (distance * distance * kRings * kSpokes));
    }
  flush();
  return {Vec3(sum[0]), Vec3(sum[1])};
}

LitPoint pointOf(Draws& draw, int material) {
  LitPoint p;
  p.p = Vec3(0.3f, -0.2f, 0.1f);
  p.n = p.ng = glm::normalize(Vec3(0.1f, 1.0f, -0.2f));
  if (material % 5 == 4) p.ng = glm::normalize(p.n + Vec3(draw.in(-0.2f, 0.2f), 0, draw.in(-0.2f, 0.2f)));
  const Frame frame(p.ng);
  do p.wo = frame.toWorld(draw.up(0.05f));
  while (!(glm::dot(p.wo, p.n) > 0.05f));
  p.bsdf = draw.material(material % 4);
  if (!p.lambert() && p.n != p.ng) p.bsdf.facing = p.frame().toLocal(p.ng);
  return p;
}

constexpr LightKind kKinds[] = {LightKind::Sphere, LightKind::Directional, LightKind::Disk, LightKind::Rect};
/// One of these kinds by turns, in every third trial in the mirror's direction, else no lower above p's horizon than by this cosine; its half angle is 10 to a
/// power between lo and hi, about.
Light lampSeen(Draws& draw, int trial, const LitPoint& p, float lowest, float lo, float hi) {
  const LightKind kind = kKinds[trial % 4];
  Vec3 way = Frame(p.n).toWorld(draw.up(lowest));
  if (trial % 3 == 0) way = glm::normalize(glm::reflect(-p.wo, p.n) + 0.2f * way);
  const float distance = draw.in(0.5f, 8.0f), size = std::pow(10.0f, draw.in(lo, hi));
  Light l = lamp(kind, p.p + way * distance, Vec3(1.0f), kind == LightKind::Directional ? -way : -way + 0.8f * draw.up(-1.0f));
  l.shape.radius = 0.9f * size * distance;
  l.shape.u *= 2.0f * l.shape.radius;
  l.shape.v *= 2.0f * l.shape.radius;
  l.shape.angularSize = kind == LightKind::Directional ? size : 0.0f;
  l.shape.twoSided = trial % 8 == 7;
  if (trial % 16 == 15) l.shape.axis = -l.shape.axis;  // from behind
  return l;
}

// The bound that light_list.h states, of each lobe of each light for which no samples are drawn.
TEST(LightList, LightsOfSomeSizeAreTheirMeanWithinTheStatedBound) {
  Draws draw(11);
  LightList::Ways ways;
  double worst[2] = {0, 0};
  for (int trial = 0; trial < 1500; ++trial) {
    const LightKind kind = kKinds[trial % 4];
    const LitPoint p = pointOf(draw, trial / 4);
    const Light l = lampSeen(draw, trial, p, 0.02f, -2.8f, -0.3f);
    const Listed one({l});
    const LightList::Ways w = one.list->ways(p, 5);
    ASSERT_EQ(w.one + w.seven + w.many + w.dense + w.closed + w.sampled, 1u);
    ways.one += w.one, ways.seven += w.seven, ways.many += w.many, ways.dense += w.dense, ways.closed += w.closed, ways.sampled += w.sampled;
    if (w.sampled || w.dense) continue;  // those below
    LightList::Values v;
    one.list->at(p, 5, v);
    const BsdfValue got = of(*one.list, v, 0), truth = dense(p, l.shape);
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < 2; ++k) {
        const double a = k == 0 ? double(got.diffuse[c]) : double(got.specular[c]), b = k == 0 ? double(truth.diffuse[c]) : double(truth.specular[c]);
        const double error = std::abs(a - b) / (b + 1e-9);
        if (!w.closed) worst[k] = std::max(worst[k], error);
        // Of a closed form: what midpoints of a rectangle that the horizon cuts are off.
        ASSERT_LT(error, w.closed ? 0.005 : 0.002) << "light " << int(kind) << " lobe " << k << " of " << trial << ", " << w.one << w.seven << w.many
                                                   << w.closed;
      }
  }
  EXPECT_GT(ways.one, 200u);
  EXPECT_GT(ways.seven, 100u);
  EXPECT_GT(ways.many, 50u);
  EXPECT_GT(ways.closed, 20u);
  EXPECT_GT(ways.dense, 50u);
  RecordProperty("worst_diffuse", std::to_string(worst[0]));
  RecordProperty("worst_specular", std::to_string(worst[1]));
}

// The same of lights that are large against the lobe, near, or cut by a horizon, whose error also falls to a tenth of what 32 samples have.
TEST(LightList, LargeLightsOverGlossAreTheirMeanWithinTheStatedBound) {
  Draws draw(23);
  struct Errors {
    double worst = 0, sum = 0, sampled = 0;
    int count = 0;
  } whole, cut;
  int left = 0;
  for (int trial = 0; trial < 900; ++trial) {
    const LightKind kind = kKinds[trial % 4];
    LitPoint p = pointOf(draw, trial / 4);
    p.bsdf.specular = std::max(p.bsdf.specular, 0.2f);  // none is Lambert
    if (p.n != p.ng) p.bsdf.facing = p.frame().toLocal(p.ng);
    const Light l = lampSeen(draw, trial, p, -0.1f, -1.3f, kind == LightKind::Directional ? 0.0f : 0.2f);
    const float distance = glm::length(l.shape.position - p.p);
    const Listed one({l});
    const LightList::Ways w = one.list->ways(p, 5);
    left += int(w.sampled);
    if (!w.dense) continue;
    LightList::Values v;
    const BsdfValue got = one.list->only(p, 5, v), truth = dense(p, l.shape, 400, 400),
                    drawn = UnoccludedLight(*one.sampler, one.view->lightShape(0), 0, 32, 9).lobes(p, 5);
    const DVec3 centre = glm::normalize(kind == LightKind::Directional ? -DVec3(l.shape.axis) : DVec3(l.shape.position) - DVec3(p.p));
    const double sine = kind == LightKind::Directional ? std::sin(0.5 * double(l.shape.angularSize))
                        : kind == LightKind::Rect      ? std::hypot(glm::length(DVec3(l.shape.u)), glm::length(DVec3(l.shape.v))) / double(distance)
                                                       : double(l.shape.radius) / double(distance);
    const bool plain = p.n == p.ng && glm::dot(centre, DVec3(p.n)) > sine && (kind < LightKind::Rect || std::abs(glm::dot(centre, DVec3(l.shape.axis))) > sine);
    Errors& e = plain ? whole : cut;
    for (int k = 0; k < 2; ++k) {
      const double a = double((k == 0 ? got.diffuse : got.specular).y), b = double((k == 0 ? truth.diffuse : truth.specular).y),
                   d = double((k == 0 ? drawn.diffuse : drawn.specular).y);
      if (!(b > 1e-4)) continue;
      e.worst = std::max(e.worst, std::abs(a - b) / b);
      e.sum += sqr((a - b) / b);
      e.sampled += sqr((d - b) / b);
      ++e.count;
    }
  }
  std::printf("whole: %d, worst %.4f, RMS %.4f, of 32 samples %.4f; cut: %d, worst %.4f, RMS %.4f, of 32 samples %.4f; %d left to samples\n", whole.count,
              whole.worst, std::sqrt(whole.sum / whole.count), std::sqrt(whole.sampled / whole.count), cut.count, cut.worst, std::sqrt(cut.sum / cut.count),
              std::sqrt(cut.sampled / cut.count), left);
  EXPECT_GT(whole.count, 200);
  EXPECT_GT(cut.count, 200);
  EXPECT_LT(whole.worst, 0.01);
  EXPECT_LT(cut.sum / cut.count, sqr(0.002));
  EXPECT_LT(whole.sum, 0.01 * whole.sampled);
  EXPECT_LT(cut.sum, 0.01 * cut.sampled);
}

/// A rectangle's two triangles, the mesh light of a scene of its own.
ScenePtr meshOf(const LightShape& s) {
  SceneMaker m;
  const int shining = m.material(Vec3(0.0f), [&](Material& x) {
    x.emission.radiance = Vec3(1.0f);
    x.coverage.doubleSided = s.twoSided;
  });
  Vec3 u = 2.0f * s.u, v = 2.0f * s.v;
  if (glm::dot(glm::cross(u, v), s.axis) < 0) std::swap(u, v);
  m.instance(m.mesh(tests::quad(s.position - s.u - s.v, u, v), shining));
  m.camera(Vec3(0, 6, 0.001f), Vec3(0, 0, 0), 0.7f);
  return m.finish();
}

// A mesh light is the sum of its triangles: those of a rectangle give what the rectangle does, exactly to Lambert surfaces.
TEST(LightList, MeshLightsOfFewTrianglesAreTheirMeanWithinTheStatedBound) {
  Draws draw(31);
  double sum[2] = {0, 0}, sampled = 0;
  int counts[2] = {0, 0}, lambert = 0, left = 0;
  LightList::Ways ways;
  for (int trial = 0; trial < 600; ++trial) {
    LitPoint p = pointOf(draw, trial);
    Vec3 way = Frame(p.n).toWorld(draw.up(-0.1f));
    if (trial % 3 == 0) way = glm::normalize(glm::reflect(-p.wo, p.n) + 0.2f * way);  // in the highlight
    const float distance = draw.in(0.5f, 8.0f), size = std::pow(10.0f, draw.in(-2.5f, 0.2f));
    Light l = lamp(LightKind::Rect, p.p + way * distance, Vec3(1.0f), -way + 0.8f * draw.up(-1.0f));
    l.shape.u *= 2.0f * size * distance;
    l.shape.v *= 2.0f * size * distance;
    l.shape.twoSided = trial % 8 == 7;
    const bool behind = trial % 8 == 3;
    if (behind) l.shape.axis = -l.shape.axis;
    const Listed rect({l}), mesh(meshOf(l.shape), 32);
    ASSERT_EQ(mesh.asked.size(), 1u);
    const LightList::Ways w = mesh.list->ways(p, 5);
    ASSERT_EQ(w.one + w.seven + w.many + w.dense + w.closed + w.sampled, 1u);
    ways.one += w.one, ways.many += w.many, ways.dense += w.dense, ways.closed += w.closed;
    left += int(w.sampled);
    if (w.sampled) continue;
    LightList::Values v;
    const BsdfValue got = mesh.list->only(p, 5, v);
    if (behind) {
      ASSERT_EQ(got.diffuse + got.specular, Vec3(0.0f)) << trial;
      continue;
    }
    if (w.closed) {
      const BsdfValue exact = UnoccludedLight(*rect.sampler, rect.view->lightShape(0), 0, 32, 9).lobes(p, 5);
      ASSERT_NEAR(got.diffuse.y, exact.diffuse.y, 1e-5f * exact.diffuse.y + 1e-9f) << trial;
      ++lambert;
      continue;
    }
    const BsdfValue truth = dense(p, l.shape, 300, 300), drawn = UnoccludedLight(*mesh.sampler, mesh.view->lightShape(0), 0, 32, 9).lobes(p, 5);
    const bool plain = p.n == p.ng && w.dense == 0;
    for (int k = 0; k < 2; ++k) {
      const double a = double((k == 0 ? got.diffuse : got.specular).y), b = double((k == 0 ? truth.diffuse : truth.specular).y),
                   d = double((k == 0 ? drawn.diffuse : drawn.specular).y);
      if (!(b > 1e-4)) continue;
      if (plain) { ASSERT_NEAR(a, b, 0.002 * b) << trial; }
      sum[plain ? 0 : 1] += sqr((a - b) / b);
      sampled += sqr((d - b) / b);
      ++counts[plain ? 0 : 1];
    }
  }
  std::printf("mesh lights: %d within %.5f RMS by up to 16 points, %d within %.5f by more, 32 samples %.4f, %d left to them\n", counts[0],
              std::sqrt(sum[0] / counts[0]), counts[1], std::sqrt(sum[1] / counts[1]), std::sqrt(sampled / (counts[0] + counts[1])), left);
  EXPECT_GT(counts[0], 40);
  EXPECT_GT(counts[1], 100);
  EXPECT_GT(lambert, 50);
  EXPECT_LT(sum[1], 0.005 * 0.005 * counts[1]);
  EXPECT_LT(sum[0] + sum[1], 0.01 * sampled);
}

// Triangles of any light that cannot be summed as they are, or are too many, are drawn from: by material, by count, and by what all of them would ask for.
TEST(LightList, OtherMeshLightsAreDrawnFrom) {
  const auto strip = [](int quads, const std::function<void(Material&)>& edit) {
    SceneMaker m;
    auto white = std::make_shared<Texture>();
    white->width = white->height = 1;
    white->texels8 = {255, 255, 255, 255};
    sealTexture(*white);
    m.scene.textures.push_back(white);
    Mesh mesh;
    for (int k = 0; k < quads; ++k) {
      const Mesh one = tests::quad(Vec3(float(k) - 0.5f * float(quads), 1, -0.5f), Vec3(0.9f, 0, 0), Vec3(0, 0, 1));
      for (const uint32_t i : one.indices) mesh.indices.push_back(i + uint32_t(mesh.positions.size()));
      mesh.positions.insert(mesh.positions.end(), one.positions.begin(), one.positions.end());
    }
    mesh.indices.insert(mesh.indices.end(), {0, 1, 1});  // without area
    m.instance(m.mesh(std::move(mesh), m.material(Vec3(0.0f), [&](Material& x) {
      x.emission.radiance = Vec3(1.0f);
      edit(x);
    })));
    m.camera(Vec3(0, 6, 0.001f), Vec3(0, 0, 0), 0.7f);
    return std::make_unique<Listed>(m.finish(), 32);
  };
  const auto facets = [](const Listed& l) { return UnoccludedLight(*l.sampler, l.view->lightShape(0), 0, 32, 9).facets().size(); };
  const auto none = [](Material&) {};
  EXPECT_EQ(facets(*strip(1, none)), 2u);
  EXPECT_EQ(facets(*strip(15, none)), 30u);
  EXPECT_EQ(facets(*strip(16, none)), 0u);  // 33 with the one that has no area
  EXPECT_EQ(facets(*strip(1, [](Material& x) { x.emission.texture.texture = 0; })), 0u);
  EXPECT_EQ(facets(*strip(1, [](Material& x) { x.coverage.mode = AlphaMode::Mask; })), 0u);
  EXPECT_EQ(facets(*strip(1, [](Material& x) { x.coverage.mode = AlphaMode::Blend; })), 0u);

  LitPoint p;
  p.p = Vec3(0.0f);
  p.n = p.ng = Vec3(0, 1, 0);
  p.wo = glm::normalize(Vec3(0.6f, 1, 0.1f));
  p.bsdf.albedo = Vec3(0.5f);
  p.bsdf.specular = 1.0f;
  p.bsdf.roughness = 0.45f;
  const auto two = [](Material& x) { x.coverage.doubleSided = true; };
  // A surface that shines is in its own horizon, whatever is rounded: nothing of it is on itself, at any lobe.
  const auto lit = strip(2, two);
  Draws draw(43);
  LightList::Values v;
  for (const bool gloss : {false, true})
    for (int k = 0; k < 200; ++k) {
      LitPoint on = p;
      on.p = Vec3(draw.in(-0.8f, 0.8f), std::nextafter(1.0f, k % 3 == 0 ? 0.0f : 2.0f), draw.in(-0.4f, 0.4f));
      on.n = on.ng = glm::normalize(Vec3(draw.in(-1e-7f, 1e-7f), 1.0f, draw.in(-1e-7f, 1e-7f)));
      on.bsdf.specular = gloss ? 1.0f : 0.0f;
      const BsdfValue f = lit->list->only(on, 5, v);
      ASSERT_EQ(f.diffuse, Vec3(0.0f)) << k;
      ASSERT_EQ(f.specular, Vec3(0.0f)) << k;
    }
  EXPECT_EQ(strip(1, two)->list->ways(p, 5).dense, 1u);
  EXPECT_EQ(strip(15, two)->list->ways(p, 5).sampled, 1u);
}

// Of lights that stand for an environment: diffuse lobes have their centres, glossy ones all of them.
TEST(LightList, RectanglesAtInfinityAreTheirMeanToGlossWithinTheStatedBound) {
  Draws draw(37);
  double sum = 0, sampled = 0;
  int count = 0, left = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const LitPoint p = pointOf(draw, trial);
    Vec3 way = Frame(p.n).toWorld(draw.up(-0.1f));
    if (trial % 3 == 0) way = glm::normalize(glm::reflect(-p.wo, p.n) + 0.2f * way);                             // in the highlight
    if (trial % 20 == 4) way = glm::normalize(glm::normalize(p.n - p.ng * glm::dot(p.n, p.ng)) - 0.01f * p.ng);  // centre below the triangle alone
    Light l = lamp(LightKind::Directional, Vec3(0.0f), Vec3(1.0f), -way);
    l.shape.skyRectangle = Vec2(std::pow(10.0f, draw.in(-2.0f, 0.0f)), std::pow(10.0f, draw.in(-2.0f, 0.0f)));
    const Listed one({l});
    const LightShape& shape = one.view->lightShape(0);
    const LightList::Ways w = one.list->ways(p, 5);
    ASSERT_EQ(w.one + w.seven + w.many + w.dense + w.closed + w.sampled, 1u);
    left += int(w.sampled);
    LightList::Values v;
    const UnoccludedLight own(*one.sampler, shape, 0, 32, 9);
    const BsdfValue got = one.list->only(p, 5, v), drawn = own.lobes(p, 5);
    for (int c = 0; c < 3; ++c) ASSERT_NEAR(got.diffuse[c], drawn.diffuse[c], 2e-5f * drawn.diffuse[c] + 1e-9f) << trial;
    if (w.sampled || w.closed) continue;
    const double a = double(got.specular.y), b = double(dense(p, shape, 300, 300).specular.y), d = double(drawn.specular.y);
    if (!(b > 1e-4)) continue;
    sum += sqr((a - b) / b);
    sampled += sqr((d - b) / b);
    ++count;
  }
  std::printf("rectangles at infinity: %d within %.5f RMS, 32 samples %.4f, %d left to them\n", count, std::sqrt(sum / count), std::sqrt(sampled / count),
              left);
  EXPECT_GT(count, 100);
  EXPECT_LT(sum, 0.005 * 0.005 * count);
  EXPECT_LT(sum, 0.01 * sampled);
}

// What is seen from behind or from inside, or of a material that has no fast way: the house's own bits. A ball that is near or cut: by far more points.
TEST(LightList, WhatHasNoBoundIsTheHousesLight) {
  Draws draw(4);
  LitPoint glossy = pointOf(draw, 1), glass = glossy;
  glass.bsdf.transmission = 0.6f;
  const Vec3 aside = glm::normalize(glm::cross(glossy.n, Vec3(0, 0, 1)));
  Light inside = lamp(LightKind::Sphere, glossy.p, Vec3(2.0f)), cut = lamp(LightKind::Sphere, glossy.p + aside, Vec3(2.0f)),
        behind = lamp(LightKind::Disk, glossy.p + glossy.n, Vec3(2.0f), glossy.n), away = lamp(LightKind::Point, glossy.p + 2.0f * glossy.n, Vec3(2.0f)),
        within = away, near = lamp(LightKind::Sphere, glossy.p + 0.5f * glossy.n, Vec3(2.0f));
  away.shape.range = 1.5f;
  within.shape.range = 3.0f;
  const Listed all({inside, cut, behind, away, within, near});
  for (const LitPoint& p : {glossy, glass}) {
    LightList::Values v;
    all.list->at(p, 3, v);
    for (int l = 0; l < 6; ++l) {
      const bool dense = p.bsdf.transmission == 0.0f && (l == 1 || l == 5);
      const BsdfValue own = UnoccludedLight(*all.sampler, all.view->lightShape(l), l, dense ? 1 << 15 : 32, 9).lobes(p, 3), got = of(*all.list, v, l);
      for (int c = 0; c < 3; ++c) {
        ASSERT_NEAR(got.diffuse[c], 2.0f * own.diffuse[c], (dense ? 0.01f : 2e-6f) * own.diffuse[c]) << l;
        ASSERT_NEAR(got.specular[c], 2.0f * own.specular[c], (dense ? 0.01f : 4e-6f) * own.specular[c]) << l;
      }
      const bool dark = l == 0 || l == 2 || l == 3;
      ASSERT_EQ(got.sum() == Vec3(0.0f), dark) << l;
    }
  }
}

// Materials out of range are Lambert to the material's own evaluation, and so here.
TEST(LightList, GlossThatIsNoNumberIsLambert) {
  Draws draw(6);
  const Listed all({lamp(LightKind::Point, Vec3(1, 2, 1), Vec3(2.0f)), lamp(LightKind::Sphere, Vec3(-1, 3, 1), Vec3(2.0f))});
  for (const float bad : {std::nanf(""), -0.5f}) {
    LitPoint p = pointOf(draw, 0), lambert = p;
    p.bsdf.specular = p.bsdf.metallic = bad;
    LightList::Values v, w;
    all.list->at(p, 0, v);
    all.list->at(lambert, 0, w);
    for (int l = 0; l < 2; ++l) EXPECT_EQ(of(*all.list, v, l).sum(), of(*all.list, w, l).sum());
    EXPECT_FALSE(v.glossy);
  }
}

TEST(LightList, ADisksFormFactorIsItsClosedForm) {
  const DVec3 p(0.2, -0.3, 0.1), n(0, 1, 0);
  for (const double r : {0.1, 1.0, 5.0}) EXPECT_NEAR(diskFormFactor(p, n, p + 2.0 * n, -n, r), r * r / (4.0 + r * r), 1e-12) << r;
  Draws draw(8);
  for (int trial = 0; trial < 40; ++trial) {
    const DVec3 centre = p + DVec3(draw.in(-1, 1), draw.in(1.0f, 2.0f), draw.in(-1, 1));
    const DVec3 axis = glm::normalize(p - centre + 0.7 * DVec3(draw.in(-1, 1), draw.in(-1, 1), draw.in(-1, 1)));
    const double radius = double(draw.in(0.05f, 0.9f));
    const Frame f{Vec3(axis)};
    double sum = 0;
    bool above = true;
    constexpr int kRings = 200, kSpokes = 128;
    for (int i = 0; i < kRings; ++i)
      for (int k = 0; k < kSpokes; ++k) {
        const double s = radius * std::sqrt((i + 0.5) / kRings), phi = 2.0 * std::numbers::pi * k / kSpokes;
        const DVec3 d = centre - p + DVec3(f.x) * (s * std::cos(phi)) + DVec3(f.y) * (s * std::sin(phi));
        const double d2 = glm::dot(d, d), back = -glm::dot(d, axis);
        above = above && glm::dot(d, n) > 0 && back > 0;
        sum += glm::dot(d, n) * back / (d2 * d2) * radius * radius / (kRings * kSpokes);
      }
    if (above) { EXPECT_NEAR(diskFormFactor(p, n, centre, axis, radius), sum, 2e-4 * sum) << trial; }
  }
  EXPECT_EQ(diskFormFactor(p, n, p + 2.0 * n, n, 1.0), 0.0) << "from behind";
}

// A list of more lights begins with those of a shorter one; of equal ones the first. What is not in it is in the rest.
TEST(LightList, ChosenLightsAreTheStrongestAndNested) {
  Draws draw(2);
  std::vector<Light> lamps = manyLamps(37);
  lamps.push_back(lamps[4]);                                             // as strong as another one
  lamps.push_back(lamp(LightKind::Point, Vec3(0, -9, 0), Vec3(50.0f)));  // below
  lamps.push_back(lamp(LightKind::Point, Vec3(0, 2, 0), Vec3(0.0f)));    // off
  for (const Light& l : lampsOfSize()) lamps.push_back(l);
  const Listed all(lamps);
  for (int trial = 0; trial < 12; ++trial) {
    LitPoint p = pointOf(draw, trial);
    LightList::Values v;
    all.list->at(p, size_t(trial), v);
    std::vector<std::pair<float, int>> given;  // negative, so that the strongest come first
    DVec3 total[2] = {DVec3(0.0), DVec3(0.0)};
    for (int l = 0; l < int(lamps.size()); ++l) {
      const BsdfValue f = of(*all.list, v, l);
      const float g = luminance(f.diffuse) + luminance(f.specular);
      if (g > 0) given.push_back({-g, l});
      total[0] += DVec3(f.diffuse), total[1] += DVec3(f.specular);
    }
    std::sort(given.begin(), given.end());
    ASSERT_GT(given.size(), 10u);
    std::vector<int> before;
    LightList::Choice choice;
    for (size_t most = 0; most <= given.size() + 2; ++most) {
      all.list->choose(v, most, choice);
      std::vector<int> now;
      DVec3 sum[2] = {choice.rest[0], choice.rest[1]};
      for (const auto& c : choice.chosen) {
        now.push_back(c.light);
        const BsdfValue f = of(*all.list, v, c.light);
        sum[0] += DVec3(f.diffuse), sum[1] += DVec3(f.specular);
      }
      ASSERT_EQ(now.size(), std::min(most, given.size()));
      ASSERT_TRUE(std::is_sorted(now.begin(), now.end()));
      std::vector<int> expected;
      for (size_t k = 0; k < now.size(); ++k) expected.push_back(given[k].second);
      std::sort(expected.begin(), expected.end());
      ASSERT_EQ(now, expected) << most;
      ASSERT_TRUE(std::includes(now.begin(), now.end(), before.begin(), before.end())) << "nested";
      for (int k = 0; k < 2; ++k)
        for (int c = 0; c < 3; ++c) ASSERT_NEAR(sum[k][c], total[k][c], 1e-9 * (1.0 + total[k][c]));
      before = now;
    }
  }
  LightList::Values odd;
  LightList::Choice choice;
  for (int c = 0; c < 3; ++c) odd.diffuse[c].assign(all.list->places(), 0.0f);
  for (int c = 0; c < 3; ++c) odd.diffuse[c][3] = std::numeric_limits<float>::infinity(), odd.diffuse[c][5] = std::nanf(""), odd.diffuse[c][6] = 1.0f;
  all.list->choose(odd, 1, choice);
  ASSERT_EQ(choice.chosen.size(), 1u);
  EXPECT_EQ(choice.chosen[0].place, 3u);
  EXPECT_EQ(choice.rest[0], DVec3(1.0)) << "NaN is nobody's";
}

// What the builtin hall costs: over its glossy floor hardly any of 333 balls needs samples.
TEST(LightList, OfThousandLampsHardlyAnyIsSampled) {
  const auto scene = builtin::lamps({});
  ASSERT_TRUE(scene.ok());
  const Listed all((*scene)->lights);
  LitPoint p;
  p.n = p.ng = Vec3(0, 1, 0);
  p.bsdf.roughness = 0.35f;
  p.bsdf.specular = 0.6f;
  LightList::Ways ways;
  for (int i = 0; i < 200; ++i) {
    p.p = Vec3(-5.0f + 10.0f * float(i % 10) / 9.0f, 0.0f, -13.0f + 26.0f * float(i / 10) / 19.0f);
    p.wo = glm::normalize(Vec3(0.9f, 1.7f, 12.6f) - p.p);
    const LightList::Ways w = all.list->ways(p, size_t(i));
    ways.one += w.one, ways.seven += w.seven, ways.many += w.many, ways.sampled += w.sampled;
  }
  EXPECT_EQ(ways.one + ways.seven + ways.many + ways.sampled, 200u * 333u);
  EXPECT_LT(ways.sampled, 200u * 333u / 100u);
  EXPECT_GT(ways.one, 200u * 333u * 3u / 4u);
}

}  // namespace
}  // namespace gobo::subtractive_test
