// SPDX-License-Identifier: Apache-2.0
#include "techniques/direct_visibility/visibility.h"

#include <algorithm>
#include <cstdio>

#include "filters/automatic/automatic.h"
#include "filters/crop.h"
#include "filters/parameter.h"
#include "filters/shadow_technique.h"
#include "filters/stylised/style.h"
#include "filters/tinted_visibility.h"
#include "request/expressions.h"
#include "terms/light_list.h"

namespace gobo {
inline namespace techniques {

namespace {

constexpr uint64_t kMostStyled = 1ull << 29;                // view samples, as many as a picture may have
constexpr int kUnoccludedSamples = 32, kSquareSamples = 8;  // the latter for each of many lights at infinity

Result<NodeId> planned(PlanContext& c, const ShadowTechniqueEntry& entry, const ShadowInput& in, const v1::ShadowTechnique& t) {
  GOBO_ASSIGN(const NodeId v, entry.plan(c.graph(), in, t));
  return entry.usesMap ? planTint(c.graph(), in, v) : v;
}

/// What may be chosen that holds most: the plan is only a bound.
Result<NodeId> largest(PlanContext& c, const ShadowInput& in, const AutomaticChoice& choice) {
  uint64_t most = 0;
  const v1::ShadowTechnique* at = nullptr;
  for (const AutomaticCandidate& candidate : choice.candidates) {
    const Graph::Mark mark = c.graph().mark();
    GOBO_TRY(planned(c, *findShadowTechnique(candidate.technique.technique_case()), in, candidate.technique).status());
    uint64_t bytes = 0;
    for (NodeId id = mark.nodes; id < c.graph().size(); ++id) bytes += outputBytes(c.graph().at(id));
    c.graph().rollBack(mark);
    if (!at || bytes > most) most = bytes, at = &candidate.technique;
  }
  GOBO_CHECK(at != nullptr);
  return planned(c, *findShadowTechnique(at->technique_case()), in, *at);
}

/// The choice goes into the plan, each rejected candidate as a pruned row with what it would have cost.
Result<NodeId> automatic(PlanContext& c, const ShadowInput& in, const v1::ShadowTechnique& t) {
  const auto expand = [&](const Graph&, NodeId node) { return c.expand(node); };
  GOBO_ASSIGN(const AutomaticChoice choice, chooseShadow(c.graph(), in, t, expand));
  if (c.bounding()) return largest(c, in, choice);
  const std::string& name = in.scene->lights[size_t(in.light)].name;
  const AutomaticCandidate& chosen = choice.candidates[choice.chosen];
  for (size_t k = 0; k < choice.candidates.size(); ++k) {
    const AutomaticCandidate& candidate = choice.candidates[k];
    char text[160];
    if (candidate.judged)
      std::snprintf(text, sizeof text, "%s: expected error %.4f in %.1f ms", k == choice.chosen ? "auto chose it" : "auto passed it over", candidate.rmse,
                    candidate.ms);
    else std::snprintf(text, sizeof text, "auto passed it over: %.1f ms", candidate.ms);
    if (choice.receivers > 0 || k == choice.chosen) c.prune("auto:" + name + ": " + candidate.text, text);
  }
  const ShadowTechniqueEntry* entry = findShadowTechnique(chosen.technique.technique_case());
  GOBO_CHECK(entry != nullptr);
  return planned(c, *entry, in, chosen.technique);
}

Result<NodeId> plainVisibility(PlanContext& c, const ShadowInput& in, const v1::ShadowTechnique& t) {
  if (t.has_auto_()) return automatic(c, in, t);
  const ShadowTechniqueEntry* entry = findShadowTechnique(t.technique_case());
  GOBO_CHECK(entry != nullptr);
  return planned(c, *entry, in, t);
}

/// What a distance along surfaces does not know of.
void warnOfSurfaceMetric(PlanContext& c, const v1::ShadowStyle& style) {
  if (style.metric() != v1::ShadowStyle::SURFACE) return;
  const auto warn = [&](const std::string& field) { c.warn("shadows.style." + field + ": metric SURFACE has no average; it does not count"); };
  if (numberParameter(style, "power") != numberParameter(v1::ShadowStyle(), "power")) warn("power");
  if (style.norm() == v1::ShadowStyle::PUBLISHED) warn("norm");
  if (style.samples() > 0) warn("samples");
}

/// A style's distances are those to the contour of the whole picture, with `guard` pixels around it, whatever window of it is asked for: they are made there
/// and the window is cut out. What is drawn by chance is drawn by place, so that the picture's own pixels have the visibility that they have without a guard.
/// Pixels outside it, whose places are below 0 or beyond its size, have numbers of some pixel inside (unsigned arithmetic of FilmElements): what is drawn there
/// is of no picture.
Result<NodeId> styledVisibility(PlanContext& c, ShadowInput in, const v1::ShadowTechnique& t, const std::string& edited) {
  GOBO_ASSIGN(const StyleFormulas formulas, styleFormulas(c.request(), edited, *in.scene));
  warnOfSurfaceMetric(c, t.style());
  int guard = int(numberParameter(t.style(), "guard_px"));
  if (guard > 0 && in.camera.optics.panorama) {
    c.warn("shadows.style.guard_px: a panorama has nothing outside it");
    guard = 0;
  }
  const PixelWindow asked{in.place.x + guard, in.place.y + guard, in.width, in.height};
  const bool around = guard > 0 || !in.place.whole();
  if (around) {
    GBufferSettings view = c.view();
    view.width = c.view().filmWidth() + 2 * guard;
    view.height = c.view().filmHeight() + 2 * guard;
    view.place = guard > 0 ? ViewPlace{-guard, -guard, c.view().filmWidth(), c.view().filmHeight()} : ViewPlace{};
    if (const uint64_t samples = uint64_t(view.width) * uint64_t(view.height) * uint64_t(in.viewSamples); samples > kMostStyled) {
      const char* field = guard > 0 ? "request.shadows.style.guard_px" : "request.window";
      return Status(Code::ResourceExhausted,
                    std::string(field) + ": the style of '" + in.scene->lights[size_t(in.light)].name + "' is made of the whole picture" +
                        (guard > 0 ? " with " + std::to_string(guard) + " pixels around it" : "") + ", " + std::to_string(samples) +
                        " view samples; must be at most " + std::to_string(kMostStyled),
                    field);
    }
    in.width = view.width;
    in.height = view.height;
    in.place = view.place;
    in.gbuffer = c.source(makeGBufferNode(view), {}, {}, guard > 0 ? "gbuffer with guard" : "gbuffer of the picture", c.scene());
  }
  GOBO_ASSIGN(const NodeId v, plainVisibility(c, in, t));
  const NodeId styled = planStyle(c.graph(), in, v, t.style(), formulas);
  if (!around) return styled;
  const NodePtr crop = makeCropNode({in.width, in.height, in.viewSamples}, asked.x, asked.y, asked.width, asked.height);
  return addShadowFilter(c.graph(), crop, {styled}, "style_crop", in);
}

/// What subtractive shadows of lights know nothing of; null: nothing.
const char* subtractiveLacks(const PlanContext& c) {
  if (c.kinds().extended) return "coats, sheen, anisotropy, films or thin walls";
  return c.kinds().clear ? "surfaces that light passes straight on" : nullptr;
}

}  // namespace

v1::ShadowTechnique shadowTechniqueOf(PlanContext& c, int light, const ScenePtr& scene, const std::string& name) {
  v1::ShadowTechnique t = c.request().shadows();
  const auto edit = c.request().lights().find(name);
  if (edit != c.request().lights().end() && edit->second.has_shadow()) t = edit->second.shadow();
  const LightKind kind = scene->lights[size_t(light)].shape.kind;
  if (t.has_subtractive() && kind != LightKind::Environment && !c.cameraInVolume()) {
    if (const char* why = subtractiveLacks(c)) {
      c.warn(std::string("shadows.subtractive: the scene has ") + why + ": ray_traced used");
      t.mutable_ray_traced()->set_samples(16);
    } else if (t.has_style() && size_t(light) < c.scene()->lights.size()) {  // those that stand for a map have shadows of their own
      c.warn("light '" + name + "' shares its subtractive shadow with others: it has none for shadows.style");
      t.clear_style();
    }
  }
  const ShadowTechniqueEntry* entry = findShadowTechnique(t.technique_case());
  // Without visibility there is nothing that could have a style.
  const auto traced = [&] {
    if (t.has_style() && kind != LightKind::Environment) c.warn("light '" + name + "' is path traced: it has no shadow for shadows.style");
    t.clear_style();
    t.mutable_path_traced();
    return t;
  };
  const bool seen = entry || t.has_subtractive();  // not path traced
  if (seen && kind == LightKind::Environment) return traced();
  if (seen && c.cameraInVolume()) {
    c.warn("the camera is inside a volume: direct light is path traced");
    return traced();
  }
  if (entry && !entry->does(scene->lights[size_t(light)].shape)) {
    c.warn(std::string(entry->name) + " does not do the kind of light '" + name + "': ray_traced used");
    if (!t.mutable_ray_traced()->has_samples()) t.mutable_ray_traced()->set_samples(16);
  }
  return t;
}

Result<NodeId> planVisibility(PlanContext& c, int light, const ScenePtr& scene, const v1::ShadowTechnique& t, const std::string& edited) {
  ShadowInput in;
  in.scene = scene;
  in.light = light;
  in.gbuffer = c.gbuffer();
  in.camera = c.view().camera;
  in.width = c.view().width;
  in.height = c.view().height;
  in.viewSamples = c.view().viewSamples;
  in.place = c.view().place;
  in.seed = c.request().seed();
  in.clear = c.kinds().clear;
  return t.has_style() ? styledVisibility(c, in, t, edited.empty() ? scene->lights[size_t(light)].name : edited) : plainVisibility(c, in, t);
}

NodeId planUnoccluded(PlanContext& c, int light, const ScenePtr& scene, const Vec3& nominal, bool transient, LobePart lobe) {
  DirectUnoccludedSettings s;
  s.lobe = lobe;
  s.view = c.view();
  s.light = light;
  s.nominal = nominal;
  const LightShape& shape = scene->lights[size_t(light)].shape;
  const bool delta = isDeltaLight(shape);  // evaluated, not sampled: seed and count are no part of its key
  const bool square = shape.kind == LightKind::Directional && shape.skyRectangle != Vec2(0.0f);
  s.samples = square ? kSquareSamples : delta ? 1 : kUnoccludedSamples;
  s.seed = delta ? 0 : c.request().seed();
  s.ruled = LightList::hasRules(shape) ||
            (shape.kind == LightKind::Mesh && scene->meshes[size_t(scene->instances[shape.instance].mesh)]->triangles() <= UnoccludedLight::kMostFacets);
  s.extended = c.kinds().extended;
  return c.source(makeDirectUnoccludedNode(s), {c.gbuffer(), c.surface()}, {light}, withLobe("unoccluded:" + scene->lights[size_t(light)].name, lobe), scene,
                  transient);
}

}  // namespace techniques
}  // namespace gobo
