// SPDX-License-Identifier: Apache-2.0
// The sources of shadow visibility against geometry that can be worked out by hand: a floor, cards above it, one light.
#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "filters/axis_aligned/sample_count.h"
#include "filters/axis_aligned/technique.h"
#include "filters/multiple_axis_aligned/technique.h"
#include "filters/ray_traced/technique.h"
#include "filters/sheared/technique.h"
#include "support/thorough.h"
#include "terms/light_points.h"
#include "terms/shadow_slopes.h"
#include "terms/visibility.h"
#include "trace/accel.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

/// Floor y = 0 (half side 50) and horizontal cards, everything times `scale`.
struct Card {
  float x0, x1, z0, z1, y;
};
MeshPtr quads(const std::vector<Card>& cards, float scale) {
  auto m = std::make_shared<Mesh>();
  for (const Card& c : cards) {
    const auto base = uint32_t(m->positions.size());
    for (const Vec3& p : {Vec3(c.x0, c.y, c.z0), Vec3(c.x1, c.y, c.z0), Vec3(c.x1, c.y, c.z1), Vec3(c.x0, c.y, c.z1)}) m->positions.push_back(p * scale);
    for (uint32_t i : {0, 2, 1, 0, 3, 2}) m->indices.push_back(base + i);
  }
  sealMesh(*m);
  return m;
}
ScenePtr stage(const std::vector<Card>& cards, LightShape shape, float scale = 1) {
  auto s = std::make_shared<Scene>();
  s->materials.emplace_back();
  s->meshes = {quads({{-50, 50, -50, 50, 0}}, scale)};
  s->instances = {{"floor", 0, Mat4(1)}};
  if (!cards.empty()) {
    s->meshes.push_back(quads(cards, scale));
    s->instances.push_back({"cards", 1, Mat4(1)});
  }
  shape.position *= scale;
  shape.u *= scale;
  shape.v *= scale;
  shape.radius *= scale;
  Light light;
  light.name = "key";
  light.shape = shape;
  s->lights = {light};
  const Status sealed = s->seal();
  GOBO_CHECK(sealed.ok());
  return s;
}
LightShape rectAbove(float half = 0.5f, float height = 10) {
  LightShape l;
  l.kind = LightKind::Rect;
  l.position = Vec3(0, height, 0);
  l.u = Vec3(half, 0, 0);
  l.v = Vec3(0, 0, half);
  return l;
}
/// Floor pixels around the origin seen straight down.
PlaneView floorView(int width, int height, float pixel) {
  PlaneView v;
  v.width = width;
  v.height = height;
  v.du = Vec3(pixel, 0, 0);
  v.dv = Vec3(0, 0, pixel);
  v.origin = Vec3(-0.5f * pixel * float(width - 1), 0, -0.5f * pixel * float(height - 1));
  v.normal = Vec3(0, 1, 0);
  return v;
}

/// Runs every node of a graph in order; keeps all terms and counts rays.
struct GraphRun {
  std::vector<TermPtr> terms;
  std::vector<uint64_t> rays;
};
class GivenTerm final : public Node {
 public:
  explicit GivenTerm(TermPtr t) : term_(std::move(t)) {}
  std::string type() const override { return "given"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(term_->content()); }
  Result<TermShape> infer(std::span<const TermShape>) const override { return shapeOf(*term_); }
  Result<TermPtr> run(const RunContext&) const override { return term_; }

 private:
  TermPtr term_;
};
GraphRun runGraph(const Graph& graph, int threads = 2) {
  static AccelCache accels;
  const TaskArena arena(threads);
  GraphRun out;
  for (NodeId id = 0; id < graph.size(); ++id) {
    const GraphNode& n = graph.at(id);
    RunContext ctx;
    std::optional<SceneView> view;
    if (n.scene) view.emplace(*n.scene, n.node->traits().facets, n.lights);
    RunCounters counters;
    ctx.scene = view ? &*view : nullptr;
    for (NodeId i : n.inputs) ctx.inputs.push_back(out.terms[i]);
    ctx.arena = &arena;
    ctx.accels = &accels;
    ctx.counters = &counters;
    auto r = runNode(*n.node, ctx);
    if (!r.ok()) std::cerr << r.status().toString() << std::endl;
    GOBO_CHECK(r.ok());
    out.terms.push_back(*r);
    out.rays.push_back(counters.rays);
  }
  return out;
}
struct Planned {
  Graph graph;
  NodeId result;
  ShadowInput input;
};
Planned planned(const ScenePtr& scene, const PlaneView& view, const v1::ShadowTechnique& technique) {
  Planned p;
  p.input.scene = scene;
  p.input.width = view.width;
  p.input.height = view.height;
  p.input.viewSamples = view.layers;
  p.input.gbuffer = p.graph.add({std::make_shared<GivenTerm>(planeGBuffer(view)), {}, {}, "gbuffer", 0, nullptr, false});
  auto r = findShadowTechnique(technique.technique_case())->plan(p.graph, p.input, technique);
  GOBO_CHECK(r.ok());
  p.result = *r;
  return p;
}
v1::ShadowTechnique rayTraced(uint32_t samples) {
  v1::ShadowTechnique t;
  t.mutable_ray_traced()->set_samples(samples);
  return t;
}
/// Axis-aligned filtering as its source has it.
v1::ShadowTechnique published() {
  v1::ShadowTechnique t;
  auto& m = *t.mutable_axis_aligned();
  m.set_pilot(9);
  m.set_rate(v1::AxisAlignedShadow::EQUATION);
  m.set_width(v1::AxisAlignedShadow::BAND_LIMIT);
  m.set_kernel(v1::AxisAlignedShadow::GAUSSIAN);
  return t;
}
v1::ShadowTechnique filtered() {
  v1::ShadowTechnique t;
  t.mutable_axis_aligned();
  return t;
}
TermPtr visibility(const ScenePtr& scene, const PlaneView& view, const v1::ShadowTechnique& t) {
  const Planned p = planned(scene, view, t);
  return runGraph(p.graph).terms[p.result];
}

// --- the ray-traced reference ----------------------------------------------------------------------------------------------------

TEST(ShadowRays, PointLightGivesTheHardShadowOfACard) {
  LightShape point;
  point.position = Vec3(0, 10, 0);
  const auto scene = stage({{-1, 1, -2, 2, 5}}, point);  // its shadow on the floor is twice as large
  const PlaneView view = floorView(61, 61, 0.2f);
  const auto V = visibility(scene, view, rayTraced(16));
  for (int z = 0; z < 61; ++z)
    for (int x = 0; x < 61; ++x) {
      const float px = 0.2f * float(x - 30), pz = 0.2f * float(z - 30);
      if (std::fabs(std::fabs(px) - 2) < 0.01f || std::fabs(std::fabs(pz) - 4) < 0.01f) continue;  // on the edge itself
      ASSERT_EQ(V->floats("V")[z * 61 + x], std::fabs(px) < 2 && std::fabs(pz) < 4 ? 0.0f : 1.0f) << px << " " << pz;
    }
}

TEST(ShadowRays, RectangleAndHalfPlaneGiveALinearRamp) {
  // Card over x > 0 at half height: at x the light's part left of -x is... seen through x_card = x/2 + y/2 < 0, y < -x: V = (0.5 - x) / 1.
  const auto scene = stage({{0, 40, -40, 40, 5}}, rectAbove(0.5f, 10));
  const PlaneView view = floorView(41, 3, 0.05f);
  const auto V = visibility(scene, view, rayTraced(1024));
  for (int x = 0; x < 41; ++x) {
    const float px = 0.05f * float(x - 20);
    // The light's weights vary by (1 + (1.5/10)^2)^-2 over it: under 4 %, and antisymmetric errors stay below 4e-3.
    EXPECT_NEAR(V->floats("V")[41 + x], clamp01(0.5f - px), 5e-3) << px;
  }
}

TEST(ShadowRays, SphereDiskAndMeshLightsGiveHalfUnderACentredEdge) {
  LightShape disk = rectAbove(), sphere = rectAbove();
  disk.kind = LightKind::Disk;
  sphere.kind = LightKind::Sphere;
  disk.radius = sphere.radius = 0.7f;
  const PlaneView view = floorView(1, 1, 0.1f);
  for (const LightShape& l : {disk, sphere}) EXPECT_NEAR(visibility(stage({{0, 40, -40, 40, 5}}, l), view, rayTraced(1024))->floats("V")[0], 0.5f, 2e-3);
  // A mesh light: an emissive card at y = 10 of two triangles, half of it hidden.
  auto s = std::make_shared<Scene>(*stage({{0, 40, -40, 40, 5}}, disk));
  s->lights.clear();
  s->materials.emplace_back();
  s->materials[1].emission.radiance = Vec3(1);
  auto lamp = std::make_shared<Mesh>(*quads({{-0.5f, 0.5f, -0.5f, 0.5f, 10}}, 1));
  lamp->material = 1;
  s->meshes.push_back(lamp);
  s->instances.push_back({"lamp", 2, Mat4(1)});
  const Status sealed = s->seal();
  ASSERT_TRUE(sealed.ok()) << sealed.toString();
  ASSERT_EQ(s->lights.size(), 1u);
  EXPECT_NEAR(visibility(s, view, rayTraced(1024))->floats("V")[0], 0.5f, 5e-3);  // and the lamp itself shadows nothing
}

TEST(ShadowRays, WhereTheLightCannotShineVisibilityIsOneAndCostsNoRay) {
  const std::vector<Card> card{{-1, 1, -1, 1, 5}};
  PlaneView view = floorView(5, 5, 0.1f);
  auto check = [&](const LightShape& l, const PlaneView& v, const char* what) {
    const Planned p = planned(stage(card, l), v, rayTraced(4));
    const GraphRun r = runGraph(p.graph);
    for (float x : r.terms[p.result]->floats("V")) EXPECT_EQ(x, 1.0f) << what;
    EXPECT_EQ(r.rays[p.result], 0u) << what;
  };
  PlaneView down = view;
  down.normal = Vec3(0, -1, 0);
  check(rectAbove(), down, "surface turned away");
  LightShape up = rectAbove();
  up.axis = Vec3(0, 1, 0);
  check(up, view, "light turned away");
  LightShape spot;
  spot.kind = LightKind::Spot;
  spot.position = Vec3(0, 10, 0);
  spot.axis = Vec3(1, 0, 0);
  check(spot, view, "outside the cone");
  LightShape near;
  near.position = Vec3(0, 10, 0);
  near.range = 5;
  check(near, view, "out of range");
  LightShape sphere = rectAbove();
  sphere.kind = LightKind::Sphere;
  sphere.radius = 11;
  check(sphere, view, "inside a sphere");
  LightShape lit = rectAbove();  // and the same card does shade when the light can shine
  EXPECT_EQ(visibility(stage(card, lit), view, rayTraced(4))->floats("V")[12], 0.0f);
}

TEST(ShadowRays, ShadingNormalAboveASurfaceThatFacesAwayIsInItsOwnShadow) {
  const PlaneView view = floorView(3, 3, 0.1f);
  const auto g = planeGBuffer(view);
  auto Ng = g->writable<float>("Ng");
  for (int e = 0; e < 9; ++e) Ng[3 * e + 1] = -1;
  const auto scene = stage({}, rectAbove());
  Graph graph;
  const NodeId gb = graph.add({std::make_shared<GivenTerm>(g), {}, {}, "gbuffer", 0, nullptr, false});
  const NodeId v = graph.add({makeVisibilityNode({16, 0, {3, 3, 1}}), {gb}, {0}, "v", 0, scene, false});
  const GraphRun r = runGraph(graph);
  for (float x : r.terms[v]->floats("V")) EXPECT_EQ(x, 0.0f);
}

// --- pilot, rates and the whole technique -------------------------------------------------------------------------------------------

TEST(AxisAlignedSources, PilotFindsBothLayersOfOccluders) {
  // Cards at heights 5 and 8 under a light at 10: slopes t/(T-t) = 1 and 4 in the umbra of both, whatever the ray's slant.
  const auto scene = stage({{-3, 3, -3, 3, 5}, {-2, 2, -2, 2, 8}}, rectAbove());
  const PlaneView view = floorView(5, 5, 0.1f);
  Graph graph;
  const NodeId gb = graph.add({std::make_shared<GivenTerm>(planeGBuffer(view)), {}, {}, "gbuffer", 0, nullptr, false});
  const NodeId s = graph.add({makeShadowSlopesNode({9, 16, true, 7, {5, 5, 1}}), {gb}, {0}, "s", 0, scene, false});
  const GraphRun r = runGraph(graph);
  for (int e = 0; e < 25; ++e) {
    EXPECT_NEAR(r.terms[s]->floats("sMin")[e], 1, 1e-4);
    EXPECT_NEAR(r.terms[s]->floats("sMax")[e], 4, 4e-3);
    EXPECT_EQ(r.terms[s]->floats("sumV")[e], 0.0f);
    EXPECT_GT(r.terms[s]->floats("sumW")[e], 0.0f);
  }
  EXPECT_EQ(r.rays[s], 25u * 18u);  // forward and back
  const NodeId near = graph.add({makeShadowSlopesNode({9, 16, false, 7, {5, 5, 1}}), {gb}, {0}, "near", 0, scene, false});
  const GraphRun one = runGraph(graph);
  for (int e = 0; e < 25; ++e) {
    EXPECT_EQ(one.terms[near]->floats("sMin")[e], r.terms[s]->floats("sMin")[e]);
    EXPECT_NEAR(one.terms[near]->floats("sMax")[e], one.terms[near]->floats("sMin")[e], 1e-5);
  }
  EXPECT_EQ(one.rays[near], 25u * 9u);  // forward alone
}

TEST(AxisAlignedSources, ContactAndOccluderAtTheLightStayFinite) {
  // A card a hair above the floor, and another a hair below the light.
  for (const auto& [y, way] : {std::pair(1e-3f, published()), std::pair(9.9995f, published()), std::pair(1e-3f, filtered()), std::pair(9.9995f, filtered())}) {
    const auto scene = stage({{0, 40, -40, 40, y}}, rectAbove());
    const PlaneView view = floorView(33, 9, 0.02f);
    v1::ShadowTechnique t = way;
    t.mutable_axis_aligned()->set_max_samples(64);
    const Planned p = planned(scene, view, t);
    const GraphRun r = runGraph(p.graph);
    for (const TermPtr& term : r.terms)
      for (const Plane& plane : term->planes())
        if (plane.format == Format::F32) {
          for (float v : term->floats(plane.name)) ASSERT_TRUE(std::isfinite(v)) << term->type() << "." << plane.name << " y=" << y;
        }
    for (float v : r.terms[p.result]->floats("V")) ASSERT_TRUE(v >= 0 && v <= 1);
  }
}

TEST(AxisAlignedSources, DilationReachesPixelsWithoutAnOccluderButNotOtherInstances) {
  const Extent e{32, 1, 1};
  auto slopes = std::make_shared<Term>("shadow_slopes", Domain::ViewSample, e);
  auto sMax = slopes->addPlane<float>("sMax"), sMin = slopes->addPlane<float>("sMin");
  auto occluded = slopes->addPlane<uint8_t>("occluded");
  sMax[10] = 3;
  sMin[10] = 2;
  sMax[12] = 5;
  sMin[12] = 1;
  occluded[10] = occluded[12] = 1;
  PlaneView view;
  view.width = 32;
  view.height = 1;
  auto g = planeGBuffer(view);
  g->writable<uint32_t>("instance")[14] = 1;
  const auto d = runFilter(makeShadowSlopeDilation(4, e), {slopes, g});
  EXPECT_EQ(d->floats("sMin")[10], 2.0f);  // own slopes are kept
  EXPECT_EQ(d->floats("sMin")[11], 1.0f);  // both neighbours
  EXPECT_EQ(d->floats("sMax")[11], 5.0f);
  EXPECT_EQ(d->floats("sMin")[6], 2.0f);  // only the first is within 4
  EXPECT_EQ(d->floats("sMin")[5], 0.0f);
  EXPECT_EQ(d->floats("sMin")[14], 0.0f);  // another instance
  EXPECT_EQ(d->floats("sMin")[16], 1.0f);
}

TEST(AxisAlignedSources, MuIsSolvedForTheMeanSampleCount) {
  const auto scene = stage({{-1, 1, -1, 1, 4}, {-.3f, .3f, -3, 3, 7}}, rectAbove(1));
  const PlaneView view = floorView(48, 48, 0.1f);
  for (double mean : {12.0, 20.0, 40.0}) {
    v1::ShadowTechnique t = published();
    t.mutable_axis_aligned()->set_mean_samples(mean);
    const Planned p = planned(scene, view, t);
    const GraphRun r = runGraph(p.graph);
    for (NodeId id = 0; id < p.graph.size(); ++id) {
      if (p.graph.at(id).node->type() != "shadow_sample_count") continue;
      double sum = 0;
      for (uint32_t n : r.terms[id]->plane<uint32_t>("n")) {
        sum += n;
        EXPECT_TRUE(n >= 9 && n <= 256);
      }
      EXPECT_NEAR(sum / (48.0 * 48.0) / mean, 1, 0.05);  // occluders along the floor: slopes are all alike, and counts step together
    }
  }
}

TEST(AxisAlignedSources, EditsRerunOnlyWhatTheyTouch) {
  const auto scene = stage({{-1, 1, -1, 1, 4}}, rectAbove());
  const PlaneView view = floorView(8, 8, 0.1f);
  v1::ShadowTechnique base = filtered();
  auto types = [&](const std::function<void(v1::AxisAlignedShadow&)>& edit) {
    Planned p = planned(scene, view, base);
    const int before = p.graph.size();
    v1::ShadowTechnique t = base;
    edit(*t.mutable_axis_aligned());
    GOBO_CHECK(axisAlignedShadowTechnique().plan(p.graph, p.input, t).ok());
    std::string added;
    for (NodeId id = before; id < p.graph.size(); ++id) added += p.graph.at(id).node->type() + " ";
    return added;
  };
  EXPECT_EQ(types([](auto& m) { m.set_k(2); }), "axis_aligned_filter ");
  EXPECT_EQ(types([](auto& m) {
              m.set_radius_px(8);
              m.set_angle_deg(5);
              m.set_beta_threshold(0.1);
            }),
            "axis_aligned_filter ");
  EXPECT_EQ(types([](auto& m) { m.set_mu(2); }), "shadow_mu shadow_predicted_width axis_aligned_filter ");
  EXPECT_EQ(types([](auto& m) { m.set_width(v1::AxisAlignedShadow::BAND_LIMIT); }), "shadow_slope_dilation shadow_sample_count axis_aligned_filter ");
  base = published();
  EXPECT_EQ(types([](auto& m) { m.set_k(2); }), "axis_aligned_filter ");
  EXPECT_EQ(types([](auto& m) { m.set_mu(2); }), "shadow_mu shadow_sample_count shadow_adaptive axis_aligned_filter ");
  base = filtered();
  EXPECT_EQ(types([](auto& m) { m.set_k(3); }), "");  // the default said aloud is the same node
}

TEST(AxisAlignedSources, SceneScaleChangesNothing) {
  const std::vector<Card> cards{{-1, 1, -1, 1, 4}, {0.5f, 2, -2, 0, 7}};
  for (const v1::ShadowTechnique& t : {filtered(), published()}) {
    std::vector<TermPtr> counts, results;
    for (float scale : {1.0f, 1.0f / 1024, 1024.0f}) {  // powers of two: the same digits, so the same rays to the bit
      PlaneView view = floorView(40, 40, 0.1f * scale);
      const Planned p = planned(stage(cards, rectAbove(), scale), view, t);
      const GraphRun r = runGraph(p.graph);
      for (NodeId id = 0; id < p.graph.size(); ++id)
        if (p.graph.at(id).node->type() == (t.axis_aligned().pilot() ? "shadow_sample_count" : "shadow_penumbra_count")) counts.push_back(r.terms[id]);
      results.push_back(r.terms[p.result]);
    }
    for (size_t k = 1; k < results.size(); ++k) {
      int different = 0;
      double worst = 0;
      for (int e = 0; e < 1600; ++e) {
        different += counts[0]->plane<uint32_t>("n")[e] != counts[k]->plane<uint32_t>("n")[e];
        worst = std::max(worst, double(std::fabs(results[0]->floats("V")[e] - results[k]->floats("V")[e])));
      }
      EXPECT_EQ(different, 0);
      EXPECT_LT(worst, 1e-5);
    }
  }
}

TEST(AxisAlignedSources, RaysGoWhereTheShadowChanges) {
  // A card far from the picture's ends: pilots alone where neighbours see the whole light or none of it, 32 rays along the edges between.
  const auto scene = stage({{-3, 3, -40, 40, 2}}, rectAbove(0.5f, 10));
  const PlaneView view = floorView(120, 12, 0.1f);
  v1::ShadowTechnique t = filtered();
  t.mutable_axis_aligned()->set_mean_samples(32);
  t.mutable_axis_aligned()->set_dilate_px(3);
  const Planned p = planned(scene, view, t);
  const GraphRun r = runGraph(p.graph);
  const auto truth = visibility(scene, view, rayTraced(256));
  TermPtr counts;
  for (NodeId id = 0; id < p.graph.size(); ++id)
    if (p.graph.at(id).node->type() == "shadow_penumbra_count") counts = r.terms[id];
  ASSERT_TRUE(counts);
  int few = 0, inside = 0, missed = 0;
  for (size_t e = 0; e < 120 * 12; ++e) {
    const uint32_t n = counts->plane<uint32_t>("n")[e];
    ASSERT_TRUE(n == 4 || n == 32);
    few += n == 4;
    const float v = truth->floats("V")[e];
    inside += v > 0.05f && v < 0.95f;
    missed += n == 4 && v > 0.05f && v < 0.95f;
  }
  EXPECT_GT(few, 900);  // the card's edges are 1.25 m and 0.25 m penumbras apart in 12 m of floor
  EXPECT_GT(inside, 40);
  EXPECT_EQ(missed, 0);
}

TEST(AxisAlignedSources, UnshadowedIsExactlyOneAndUmbraExactlyZero) {
  v1::ShadowTechnique t;
  t.mutable_axis_aligned();
  const PlaneView view = floorView(24, 24, 0.05f);
  const auto open = visibility(stage({}, rectAbove()), view, t), shut = visibility(stage({{-20, 20, -20, 20, 5}}, rectAbove()), view, t);
  for (float v : open->floats("V")) ASSERT_EQ(v, 1.0f);
  for (float v : shut->floats("V")) ASSERT_EQ(v, 0.0f);
}

TEST(AxisAlignedSources, FilteredPenumbraIsCloserToTheRampThanTheRaysAre) {
  const auto scene = stage({{0, 40, -40, 40, 5}}, rectAbove(0.5f, 10));
  const PlaneView view = floorView(96, 48, 0.02f);
  auto error = [&](int radius) {
    v1::ShadowTechnique t;
    t.mutable_axis_aligned()->set_radius_px(uint32_t(radius));
    const auto V = visibility(scene, view, t);
    double sum = 0;
    for (int e = 0; e < 96 * 48; ++e) sum += sqr(V->floats("V")[e] - clamp01(0.5f - 0.02f * (float(e % 96) - 47.5f)));
    return std::sqrt(sum / (96 * 48));
  };
  const double noisy = error(0), smooth = error(32);
  EXPECT_LT(smooth, 0.01);
  EXPECT_LT(smooth, 0.25 * noisy);
}

TEST(AxisAlignedConvergence, PredictedWidthsLeaveNoFloor) {
  // A card's edge and a strip above it: errors fall on as rays are added, for every kind of light.
  LightShape disk = rectAbove(), sphere = rectAbove();
  disk.kind = LightKind::Disk;
  sphere.kind = LightKind::Sphere;
  disk.radius = sphere.radius = 0.6f;
  const PlaneView view = floorView(96, 48, 0.04f);
  // Rows differ by little but noise: the truth is of every third.
  const int every = testing::thoroughOr(1, 3);
  PlaneView rows = view;
  rows.height = view.height / every;
  rows.origin += float(every / 2) * view.dv;
  rows.dv *= float(every);
  for (const LightShape& light : {rectAbove(0.5f, 10), disk, sphere}) {
    const auto scene = stage({{0, 40, -40, 40, 5}, {-0.4f, -0.2f, -40, 40, 3}}, light);
    const auto truth = visibility(scene, rows, rayTraced(4096));
    std::vector<double> errors;
    for (uint32_t n : {4u, 16u, 64u, 256u}) {
      v1::ShadowTechnique t = filtered();
      t.mutable_axis_aligned()->set_mean_samples(n);
      const auto V = visibility(scene, view, t);
      double sum = 0;
      for (int y = 0; y < rows.height; ++y)
        for (int x = 0; x < 96; ++x) sum += sqr(V->floats("V")[size_t((every * y + every / 2) * 96 + x)] - truth->floats("V")[size_t(y * 96 + x)]);
      errors.push_back(std::sqrt(sum / (96 * rows.height)));
    }
    for (size_t i = 1; i < errors.size(); ++i) EXPECT_LT(errors[i], 0.75 * errors[i - 1]) << int(light.kind) << " " << i << ": " << errors[i];
    EXPECT_LT(errors[3], 0.003) << int(light.kind);
  }
}

TEST(AxisAlignedConvergence, MemoryDoesNotGrowWithRays) {
  const auto scene = stage({{0, 40, -40, 40, 5}}, rectAbove(0.5f, 10));
  auto bytes = [&](double n) {
    v1::ShadowTechnique t = filtered();
    t.mutable_axis_aligned()->set_mean_samples(n);
    const GraphRun r = runGraph(planned(scene, floorView(32, 16, 0.04f), t).graph);
    size_t sum = 0;
    for (const TermPtr& term : r.terms) sum += term->bytes();
    return sum;
  };
  EXPECT_EQ(bytes(512), bytes(8));
}

TEST(AxisAlignedSources, SameBitsForAnyNumberOfThreads) {
  const auto scene = stage({{-1, 1, -1, 1, 4}}, rectAbove());
  v1::ShadowTechnique t;
  t.mutable_axis_aligned();
  const Planned p = planned(scene, floorView(40, 24, 0.1f), t);
  EXPECT_EQ(runGraph(p.graph, 1).terms[p.result]->content(), runGraph(p.graph, 7).terms[p.result]->content());
}

/// As planned(), of what is not in the schema.
template <typename Settings>
Planned plannedBeside(const ScenePtr& scene, const PlaneView& view, Result<NodeId> (*plan)(Graph&, const ShadowInput&, const Settings&),
                      const Settings& settings) {
  Planned p;
  p.input.scene = scene;
  p.input.width = view.width;
  p.input.height = view.height;
  p.input.viewSamples = view.layers;
  p.input.gbuffer = p.graph.add({std::make_shared<GivenTerm>(planeGBuffer(view)), {}, {}, "gbuffer", 0, nullptr, false});
  const auto r = plan(p.graph, p.input, settings);
  GOBO_CHECK(r.ok());
  p.result = *r;
  return p;
}
uint64_t sumOf(const std::vector<uint64_t>& rays) {
  uint64_t sum = 0;
  for (uint64_t r : rays) sum += r;
  return sum;
}

TEST(LightSamples, OneBandIsAxisAlignedFilteringWithTheSameRays) {
  const auto scene = stage({{0, 40, -40, 40, 5}, {-0.4f, -0.2f, -40, 40, 3}}, rectAbove(0.5f, 10));
  const PlaneView view = floorView(48, 32, 0.04f);
  for (const uint32_t n : {4u, 9u, 16u}) {
    v1::ShadowTechnique t;
    t.mutable_axis_aligned()->set_mean_samples(n);
    const Planned one = planned(scene, view, t);
    const Planned band = plannedBeside<MultipleAxisAlignedSettings>(scene, view, planMultipleAxisAligned, {n, 4, 10, 32, {{0.0f}}, {1.0f}});
    const GraphRun a = runGraph(one.graph), b = runGraph(band.graph);
    const auto V = a.terms[size_t(one.result)]->floats("V"), W = b.terms[size_t(band.result)]->floats("V");
    for (size_t e = 0; e < V.size(); ++e) ASSERT_NEAR(V[e], W[e], 2e-6) << n << " " << e;  // pilots hand on their sums in float
    EXPECT_EQ(sumOf(a.rays), sumOf(b.rays));                                               // the pilot's rays are not traced again
  }
}

TEST(LightSamples, MemoryOfBandsDoesNotGrowWithRays) {
  const auto scene = stage({{0, 40, -40, 40, 5}}, rectAbove(0.5f, 10));
  auto bytes = [&](uint32_t n) {
    size_t sum = 0;
    for (const TermPtr& term : runGraph(plannedBeside<MultipleAxisAlignedSettings>(scene, floorView(32, 16, 0.04f), planMultipleAxisAligned, {n}).graph).terms)
      sum += term->bytes();
    return sum;
  };
  EXPECT_EQ(bytes(64), bytes(8));
}

TEST(LightSamples, ShearedIsCloserToTheRampOfOneEdge) {
  // One card, one slope: what a shear is for. The ramp is exact: the card's plane is parallel to the light's.
  const auto scene = stage({{0, 40, -40, 40, 5}}, rectAbove(0.5f, 10));
  const PlaneView view = floorView(96, 64, 0.02f);
  auto error = [&](const Planned& p, int threads = 2) {
    const auto V = runGraph(p.graph, threads).terms[size_t(p.result)];
    double sum = 0;
    for (int y = 20; y < 44; ++y)
      for (int x = 24; x < 72; ++x) sum += sqr(V->floats("V")[y * 96 + x] - clamp01(0.5f - 0.02f * (float(x) - 47.5f)));
    return std::sqrt(sum / (24 * 48));
  };
  v1::ShadowTechnique t;
  t.mutable_axis_aligned()->set_mean_samples(4);
  ShearedShadowSettings s;
  s.samples = 4;
  const Planned sheared = plannedBeside<ShearedShadowSettings>(scene, view, planShearedShadow, s);
  const double straight = error(planned(scene, view, t)), shorn = error(sheared);
  RecordProperty("axis_aligned", std::to_string(straight));
  RecordProperty("sheared", std::to_string(shorn));
  EXPECT_LT(shorn, 0.01);
  EXPECT_EQ(shorn, error(sheared, 7));
}

// A lamp that the floor's horizon cuts, over normals that lean towards it: nothing is in the way of what is above both.
TEST(LightSamples, WhatIsBelowTheSurfaceIsNotTakenOff) {
  LightShape cut = rectAbove();
  cut.position = Vec3(3, 0, 0);
  cut.axis = Vec3(-1, 0, 0);
  cut.u = Vec3(0, 0, 1);
  cut.v = Vec3(0, 1.5f, 0);
  const PlaneView view = floorView(16, 12, 0.02f);
  const TermPtr leaning = [&] {
    const auto g = planeGBuffer(view);
    const auto N = g->writable<float>("N");
    for (size_t e = 0; e < N.size() / 3; ++e) N[3 * e] = std::sin(0.8f), N[3 * e + 1] = std::cos(0.8f);
    return g;
  }();
  const auto seen = [&](const std::function<Result<NodeId>(Graph&, const ShadowInput&)>& plan) {
    Graph graph;
    ShadowInput input;
    input.scene = stage({}, cut);
    input.width = view.width;
    input.height = view.height;
    input.viewSamples = view.layers;
    input.gbuffer = graph.add({std::make_shared<GivenTerm>(leaning), {}, {}, "gbuffer", 0, nullptr, false});
    const auto v = plan(graph, input);
    GOBO_CHECK(v.ok());
    return runGraph(graph).terms[size_t(*v)];
  };
  const TermPtr sheared = seen([](Graph&g, const ShadowInput&in) { return planShearedShadow(g, in, {}); }),
                bands = seen([](Graph&g, const ShadowInput&in) { return planMultipleAxisAligned(g, in, {}); });
  for (const float v : sheared->floats("V")) ASSERT_NEAR(v, 1.0f, 1e-6f);
  for (const float v : bands->floats("V")) ASSERT_NEAR(v, 1.0f, 1e-6f);
}

TEST(LightSamples, OnlyRectanglesAndNoClearSurfaces) {
  LightShape disk = rectAbove();
  disk.kind = LightKind::Disk;
  Graph graph;
  ShadowInput input;
  input.width = input.height = 4;
  input.scene = stage({}, disk);
  EXPECT_EQ(planShearedShadow(graph, input, {}).status().code(), Code::InvalidArgument);
  EXPECT_EQ(planMultipleAxisAligned(graph, input, {}).status().code(), Code::InvalidArgument);
  input.scene = stage({}, rectAbove());
  input.clear = true;
  EXPECT_EQ(planShearedShadow(graph, input, {}).status().code(), Code::InvalidArgument);
}

TEST(ShadowTechniques, SupportWhatTheyClaim) {
  const auto* aaf = findShadowTechnique(v1::ShadowTechnique::kAxisAligned);
  const auto* rays = findShadowTechnique(v1::ShadowTechnique::kRayTraced);
  ASSERT_TRUE(aaf && rays);
  for (LightKind k : {LightKind::Rect, LightKind::Disk, LightKind::Sphere, LightKind::Directional}) EXPECT_TRUE(aaf->supports(k));
  for (LightKind k : {LightKind::Point, LightKind::Spot, LightKind::Mesh, LightKind::Environment}) EXPECT_FALSE(aaf->supports(k));
  LightShape sun;
  sun.kind = LightKind::Directional;
  EXPECT_FALSE(aaf->does(sun));  // a direction
  EXPECT_TRUE(rays->does(sun));
  sun.angularSize = 0.01f;
  EXPECT_TRUE(aaf->does(sun));
  sun.angularSize = 0;
  sun.skyRectangle = Vec2(0.1f);
  EXPECT_TRUE(aaf->does(sun));
  for (LightKind k : {LightKind::Rect, LightKind::Point}) EXPECT_EQ(aaf->does({k}), k == LightKind::Rect);
  EXPECT_TRUE(rays->supports(LightKind::Mesh));
  EXPECT_FALSE(rays->supports(LightKind::Environment));
  EXPECT_EQ(findShadowTechnique(v1::ShadowTechnique::kPathTraced), nullptr);
  LightShape point;
  const auto scene = stage({}, point);
  Graph graph;
  ShadowInput input;
  input.scene = scene;
  input.width = input.height = 4;
  const auto r = aaf->plan(graph, input, {});
  ASSERT_FALSE(r.ok());
  EXPECT_EQ(r.status().code(), Code::InvalidArgument);
}

}  // namespace
}  // namespace gobo
