// SPDX-License-Identifier: Apache-2.0
// Relighting costs what changed: every field of the request, and every facet of the scene, is edited once; exactly the
// nodes that depend on it run again. A field of the schema without a row here fails the test.
#include <gtest/gtest.h>

#include <google/protobuf/descriptor.h>

#include <set>
#include <sstream>

#include "filters/shadow_technique.h"
#include "support/animated_scene.h"
#include "support/engines.h"

namespace gobo::testing {
namespace {

using Labels = std::set<std::string>;

/// One room, four kinds of light path: a filtered area light, a hard ray-traced one, a path-traced emissive mesh, an environment.
v1::RenderRequest baseRequest() {
  v1::RenderRequest r = smallRequest("cornell", 20, 16, 8);
  for (const char* a : {"lights.key.kind=RECT", "lights.key.position=0.3,1.7,0.2", "lights.key.direction=0,-1,0", "lights.key.width=0.3",
                        "lights.key.height=0.3", "lights.key.intensity=4", "lights.key.shadow.axis_aligned.k=3", "lights.spot.kind=SPOT",
                        "lights.spot.position=-0.5,1.6,0.5", "lights.spot.direction=0.2,-1,-0.2", "lights.spot.outer_deg=40", "lights.spot.intensity=3",
                        "lights.spot.shadow.ray_traced.samples=4", "environment.constant=0.2,0.2,0.3"})
    set(r, a);
  return r;
}

Labels ran(const RenderResult& r) {
  Labels out;
  for (const auto& n : r.reply.plan())
    if (n.state() == v1::NodeReport::RUN) out.insert(n.node());
  return out;
}

Labels all(const RenderResult& r) {
  Labels out;
  for (const auto& n : r.reply.plan())
    if (n.state() != v1::NodeReport::PRUNED) out.insert(n.node());
  return out;
}

Labels operator+(Labels a, const Labels& b) {
  a.insert(b.begin(), b.end());
  return a;
}

std::string text(const Labels& l) {
  std::string s;
  for (const auto& x : l) s += x + " ";
  return s;
}

// Node groups of baseRequest().
const Labels kBeauty{"beauty"};
const Labels kTraced{"indirect", "indirect:mean", "direct", "direct:mean", "emission", "emission:mean"};  // what follows the light set
const Labels kIndirect{"indirect", "indirect:mean"};
const Labels kOfMap = kIndirect + Labels{"direct", "direct:mean"};  // emission is of meshes: no map is among its lights
const Labels kKeyFilter{"axis_aligned_filter:key", "direct:key"};
const Labels kKeyRays =
    kKeyFilter + Labels{"shadow_slopes:key", "shadow_penumbra:key", "shadow_penumbra_count:key", "shadow_predicted_width:key", "shadow_adaptive:key"};
const Labels kKey = kKeyRays + Labels{"unoccluded:key"};
const Labels kSpot{"visibility:spot", "unoccluded:spot", "direct:spot"};
// What takes the map off where the background is another: camera rays, no light traced again.
const Labels kSeen{"environment seen", "direct without environment seen", "direct:mean"};
const Labels kView = Labels{"gbuffer", "surface"} + kKey + kSpot;

struct Row {
  std::vector<std::string> edits;
  Labels expected;
};

// Field path (map keys as '*') -> the edit and what must run. Empty expectation: nothing, or the composite alone.
const std::map<std::string, Row>& rows() {
  static const Labels everything = kView + kTraced + kBeauty;
  static const std::map<std::string, Row> table{
      {"camera.name", {{"camera.name=front"}, {}}},  // the same camera by name
      {"camera.position", {{"camera.position=0,1,3.4"}, everything}},
      {"camera.look_at", {{"camera.look_at=0,0.9,0"}, everything}},
      {"camera.up", {{"camera.up=0.1,1,0"}, everything}},
      {"camera.yfov_deg", {{"camera.yfov_deg=33"}, everything}},
      {"camera.orthographic_height", {{"camera.orthographic_height=2"}, everything}},
      {"camera.cull_back_faces", {{"camera.cull_back_faces=true"}, everything}},
      {"camera.focal_x", {{"camera.focal_x=30"}, everything}},
      {"camera.focal_y", {{"camera.focal_y=31"}, everything}},
      {"camera.center_x", {{"camera.center_x=9"}, everything}},
      {"camera.center_y", {{"camera.center_y=9"}, everything}},
      {"camera.clip_near", {{"camera.clip_near=1"}, everything}},
      {"camera.clip_far", {{"camera.clip_far=4"}, everything}},
      {"camera.panorama", {{"camera.panorama=true"}, everything}},
      {"width", {{"width=22"}, everything}},
      {"height", {{"height=18"}, everything}},
      {"outputs", {{"outputs=beauty,alpha"}, {"alpha"}}},
      // Filters look so far around that the part comes from the whole: Window has smaller ones.
      {"window.x", {{"window.x=3", "window.width=9", "window.height=7"}, {"crop:beauty"}}},
      {"window.y", {{"window.y=3", "window.width=9", "window.height=7"}, {"crop:beauty"}}},
      {"window.width", {{"window.width=9", "window.height=7"}, {"crop:beauty"}}},
      {"window.height", {{"window.width=9", "window.height=8"}, {"crop:beauty"}}},
      {"motion_step_s", {{"motion_step_s=0.02"}, {}}},  // of motion alone; what it re-runs there: Outputs.MotionStep
      {"halt.spp", {{"halt.spp=32"}, kTraced + kBeauty}},
      {"seed", {{"seed=5"}, kKey + kTraced + kBeauty}},
      {"view_samples", {{"view_samples=3"}, kView + kBeauty}},
      {"integrator.max_bounces", {{"integrator.max_bounces=3"}, kIndirect + kBeauty}},
      {"integrator.indirect", {{"integrator.indirect=false"}, kBeauty}},
      {"integrator.light_selection", {{"integrator.light_selection=POWER"}, kTraced + kBeauty}},
      {"integrator.sampler", {{"integrator.sampler=HALTON"}, kTraced + kBeauty}},
      {"integrator.russian_roulette_start", {{"integrator.russian_roulette_start=1"}, kTraced + kBeauty}},
      {"integrator.at_view_samples", {{"integrator.at_view_samples=true"}, kTraced + kBeauty}},
      {"integrator.caustic_photons", {{"integrator.caustic_photons=1000"}, {}}},  // no mirror and no glass here: Rerun.Caustics has some
      {"integrator.caustic_radius", {{"integrator.caustic_radius=0.01"}, {}}},
      {"lights.*.kind", {{"lights.spot.kind=POINT"}, kSpot + kIndirect + kBeauty}},
      {"lights.*.color", {{"lights.key.color=1,0.2,0.1"}, kBeauty}},
      {"lights.*.intensity", {{"lights.key.intensity=6"}, kBeauty}},
      {"lights.*.position", {{"lights.spot.position=-0.4,1.6,0.5"}, kSpot + kIndirect + kBeauty}},
      {"lights.*.direction", {{"lights.spot.direction=0,-1,0"}, kSpot + kIndirect + kBeauty}},
      {"lights.*.width", {{"lights.key.width=0.4"}, kKey + Labels{"emission", "emission:mean"} + kIndirect + kBeauty}},
      {"lights.*.height", {{"lights.key.height=0.4"}, kKey + Labels{"emission", "emission:mean"} + kIndirect + kBeauty}},
      {"lights.*.radius", {{"lights.spot.radius=0.7"}, kSpot + kIndirect + kBeauty}},
      {"lights.*.angular_size_deg", {{"lights.spot.angular_size_deg=2"}, kSpot + kIndirect + kBeauty}},  // of what it is for: SoftSunRequests
      {"lights.*.profile", {{"lights.spot.profile=BLINDS"}, kSpot + kIndirect + kBeauty}},
      {"lights.*.profile_rotation_deg", {{"lights.spot.profile_rotation_deg=20"}, {}}},  // of lamps that have a profile: LightProfileRequests
      {"lights.*.inner_deg", {{"lights.spot.inner_deg=10"}, kSpot + kIndirect + kBeauty}},
      {"lights.*.outer_deg", {{"lights.spot.outer_deg=30"}, kSpot + kIndirect + kBeauty}},
      {"lights.*.enabled", {{"lights.key.enabled=false"}, kBeauty}},
      {"lights.*.gain", {{"lights.spot.gain=2,2,1"}, kBeauty}},
      {"environment.path", {{"environment.path=none"}, kOfMap + kBeauty}},
      {"environment.sky.sun_direction", {{"environment.sky.sun_direction=0,1,1"}, kOfMap + kBeauty}},
      {"environment.sky.turbidity", {{"environment.sky.turbidity=4"}, kOfMap + kBeauty}},
      {"environment.sky.sun_scale", {{"environment.sky.sun_scale=2"}, kOfMap + kBeauty}},
      {"environment.constant", {{"environment.constant=0.4,0.2,0.1"}, kOfMap + kBeauty}},
      {"environment.gain", {{"environment.gain=2,1,1"}, kBeauty}},
      {"environment.background", {{"environment.background=COLOR"}, kSeen + kBeauty}},
      {"environment.background_color",
       {{"environment.background=COLOR", "environment.background_color=0.1,0.2,0.3"}, kSeen + Labels{"background", "background:mean"} + kBeauty}},
      {"environment.background_blur_deg",
       {{"environment.background=BLURRED", "environment.background_blur_deg=30"}, kSeen + Labels{"background", "background:mean"} + kBeauty}},
      {"photometric", {{"photometric=true"}, {}}},  // of lights of scene files: Photometric
      {"tone_map.exposure", {{"tone_map.exposure=2"}, {}}},
      {"tone_map.curve", {{"tone_map.curve=LINEAR"}, {}}},
      {"tone_map.auto_exposure", {{"tone_map.auto_exposure=false"}, {}}},
      {"environment.default", {{"environment.default=NONE"}, {}}},  // there is light
  };
  return table;
}

/// Fields whose effect is tested elsewhere: by name, with where.
const std::map<std::string, std::string>& elsewhere() {
  static const std::map<std::string, std::string> table{
      {"scene", "another scene is another set of keys: ColdWarm"},
      {"halt.time_s", "Engine.TimeHaltGivesAReproducibleSampleCount"},
      {"halt.error", "Engine.ErrorHaltIsMeasuredByTheCertificate"},
      {"environment.rotation_deg", "Rerun.EnvironmentRotationAndExtraction"},
      {"environment.extract_lights", "Rerun.EnvironmentRotationAndExtraction"},
      {"environment.extract_by", "Rerun.EnvironmentRotationAndExtraction"},
      {"environment.area_lights", "Rerun.EnvironmentAsAreaLights"},
      {"environment.area_lights_if_worth", "AreaLightsWorth.AnEditRunsWhatItChanges"},
      {"environment.transfer", "Rerun.EnvironmentByTransfer"},
      {"environment.subtractive", "Subtractive.AnEditRunsWhatItChanges"},
      {"filters", "Filters.EachIsItsNodeBehindTheBeauty and Filters.AChainIsAppliedInItsOrder"},
      {"denoise", "Rerun.NoiseIsTakenOutOfWhatIsThere and Rerun.OutliersAreRejectedOfWhatIsThere"},
      {"camera.f_number", "Rerun.ALensIsTracedAgainAndAPinholeIsNot"},
      {"camera.lens_radius", "Rerun.ALensIsTracedAgainAndAPinholeIsNot"},
      {"camera.focus_distance", "Rerun.ALensIsTracedAgainAndAPinholeIsNot"},
      {"camera.sensor_height_mm", "Rerun.ALensIsTracedAgainAndAPinholeIsNot"},
      {"camera.shutter_s", "Rerun.AShutterIsTheSlicesThatItHas"},
      {"camera.shutter_slices", "Rerun.AShutterIsTheSlicesThatItHas"},
      {"environment.digest", "Blobs.AnEnvironmentByDigestIsTheFileOnDisk: what the same file runs by its path"},
      {"integrator.max_groups", "Rerun.ClustersAndDifferences"},
      {"encoding", "not in the hash"},
      {"certificate", "not in the hash"},
      {"scheduling", "not in the hash"},
      {"scene_hash", "not in the hash"},
      {"time_s", "Rerun.AnimationsAndVariants"},
      {"animation", "Rerun.AnimationsAndVariants"},
      {"variant", "Rerun.AnimationsAndVariants"},
      {"curves", "Rerun.CurvesAreTheirValues"},
      {"expressions", "Rerun.FormulasOfStylesReRunWhatReadsThem; those over time are numbers: Expressions.OverTimeMeanWhatWouldHaveBeenTypedIn"},
      {"shadows", "Rerun.FilterParameters, Rerun.EachShadowMapFieldReRunsOnlyWhatLiesBehindIt and SubtractiveLightRequests.AnEditRunsWhatItChanges"},
      {"meshes", "MeshEdits.AnEditRunsWhatDependsOnShapes"},
      {"lights.*.shadow", "Rerun.FilterParameters and Rerun.EachShadowMapFieldReRunsOnlyWhatLiesBehindIt"},
  };
  return table;
}

void leafPaths(const google::protobuf::Descriptor* d, const std::string& prefix, std::vector<std::string>& out) {
  for (int i = 0; i < d->field_count(); ++i) {
    const auto* f = d->field(i);
    const std::string path = prefix.empty() ? f->name() : prefix + "." + f->name();
    if (elsewhere().count(path)) {
      out.push_back(path);
      continue;
    }
    if (f->is_map()) leafPaths(f->message_type()->FindFieldByName("value")->message_type(), path + ".*", out);
    else if (f->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_MESSAGE && f->message_type()->name() != "Vector3")
      leafPaths(f->message_type(), path, out);
    else out.push_back(path);
  }
}

TEST(Rerun, EveryRequestFieldHasARow) {
  std::vector<std::string> paths;
  leafPaths(v1::RenderRequest::descriptor(), "", paths);
  for (const std::string& p : paths) EXPECT_TRUE(rows().count(p) || elsewhere().count(p)) << p << " has no row";
  for (const auto& [p, row] : rows()) EXPECT_NE(std::find(paths.begin(), paths.end(), p), paths.end()) << p << " is not a field any more";
}

TEST(Rerun, EachRequestFieldReRunsExactlyWhatItShould) {
  for (const auto& [path, row] : rows()) {
    const auto engine = makeEngine();
    v1::RenderRequest r = baseRequest();
    const RenderResult first = mustRender(*engine, r);
    if (path.rfind("environment.sky", 0) == 0 || path == "environment.path") r.mutable_environment()->clear_constant();
    for (const std::string& e : row.edits) set(r, e);
    EXPECT_EQ(text(ran(mustRender(*engine, r))), text(row.expected)) << path;
  }
}

TEST(Rerun, ALensIsTracedAgainAndAPinholeIsNot) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 20, 16, 4);
  set(r, "outputs=beauty,depth");
  const std::string everything = text(ran(mustRender(*engine, r)));
  for (const char* nothing : {"camera.focus_distance=2", "camera.sensor_height_mm=24", "camera.lens_radius=0"}) {
    v1::RenderRequest same = r;
    set(same, nothing);
    EXPECT_EQ(text(ran(mustRender(*engine, same))), "") << nothing;
  }
  for (const char* edit : {"camera.focus_distance=2", "camera.f_number=0.5", "camera.focus_distance=3", "camera.f_number=0.4", "camera.sensor_height_mm=36"}) {
    set(r, edit);
    const bool open = r.camera().has_f_number();
    EXPECT_EQ(text(ran(mustRender(*engine, r))), open ? everything : "") << edit;
  }
  v1::RenderRequest radius = r;
  radius.mutable_camera()->clear_f_number();
  for (const char* edit : {"camera.lens_radius=0.3", "camera.lens_radius=0.2"}) {
    set(radius, edit);
    EXPECT_EQ(text(ran(mustRender(*engine, radius))), everything) << edit;
  }
}

TEST(Rerun, AShutterIsTheSlicesThatItHas) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 20, 16, 8);
  for (const char* a : {"curves.camera.yfov_deg.time_s=0,1", "curves.camera.yfov_deg.value=30,50"}) set(r, a);
  mustRender(*engine, r);
  const auto slices = [](int n) {
    Labels out{"shutter"};
    for (int k = 1; k <= n; ++k)
      for (const char* node : {"path_trace", "path_trace:mean", "beauty"}) out.insert(std::string(node) + ":slice " + std::to_string(k));
    return out;
  };
  set(r, "camera.shutter_s=0");
  EXPECT_EQ(text(ran(mustRender(*engine, r))), "");
  for (const auto& [edit, n] : {std::pair("camera.shutter_slices=2", 0), std::pair("camera.shutter_s=0.5", 2), std::pair("camera.shutter_s=0.25", 2),
                                std::pair("camera.shutter_slices=4", 4), std::pair("camera.shutter_slices=3", 3), std::pair("seed=2", 3)}) {
    set(r, edit);
    EXPECT_EQ(text(ran(mustRender(*engine, r))), n ? text(slices(n)) : "") << edit;
    EXPECT_EQ(text(ran(mustRender(*engine, r))), "") << edit << " again";
  }
}

TEST(Rerun, TheSameRequestRunsNothing) {
  const auto engine = makeEngine();
  const RenderResult first = mustRender(*engine, baseRequest());
  EXPECT_EQ(ran(first), all(first)) << "the first render of an empty store runs every node";
  EXPECT_EQ(text(ran(mustRender(*engine, baseRequest()))), "");
}

TEST(Rerun, FilterParameters) {
  const auto engine = makeEngine();
  v1::RenderRequest r = baseRequest();
  mustRender(*engine, r);
  const std::map<std::string, Labels> edits{
      {"k=2.5", kKeyFilter + kBeauty},
      {"radius_px=7", kKeyFilter + kBeauty},
      {"beta_threshold=0.3", kKeyFilter + kBeauty},
      {"angle_deg=40", kKeyFilter + kBeauty},
      {"dilate_px=4", kKeyFilter + kBeauty + Labels{"shadow_penumbra:key", "shadow_penumbra_count:key", "shadow_predicted_width:key", "shadow_adaptive:key"}},
      {"mu=2", kKeyFilter + kBeauty + Labels{"shadow_mu:key", "shadow_predicted_width:key"}},
      {"kernel=GAUSSIAN", kKeyFilter + kBeauty + Labels{"shadow_predicted_width:key"}},
      {"width=BAND_LIMIT", kKeyFilter + kBeauty + Labels{"shadow_slope_dilation:key", "shadow_sample_count:key"}},
      {"adaptive=false", kKeyFilter + kBeauty + Labels{"shadow_sample_count:key", "shadow_adaptive:key", "shadow_predicted_width:key"}},
      {"mean_samples=8", kKeyRays + kBeauty},
      {"mean_samples=12", kKeyFilter + kBeauty + Labels{"shadow_penumbra_count:key", "shadow_predicted_width:key", "shadow_adaptive:key"}},
      {"pilot=16", kKeyRays + kBeauty},
  };
  for (const auto& [edit, expected] : edits) {
    v1::RenderRequest e = r;
    set(e, "lights.key.shadow.axis_aligned." + edit);
    EXPECT_EQ(text(ran(mustRender(*engine, e))), text(expected)) << edit;
  }
  // The published rates and widths.
  v1::RenderRequest published = r;
  for (const char* a : {"rate=EQUATION", "width=BAND_LIMIT", "kernel=GAUSSIAN"}) set(published, std::string("lights.key.shadow.axis_aligned.") + a);
  mustRender(*engine, published);
  const std::map<std::string, Labels> ofPublished{
      {"k=2.5", kKeyFilter + kBeauty},
      {"dilate_px=4", kKeyFilter + kBeauty + Labels{"shadow_slope_dilation:key", "shadow_sample_count:key", "shadow_adaptive:key"}},
      {"max_samples=250", kKeyFilter + kBeauty + Labels{"shadow_sample_count:key", "shadow_adaptive:key"}},
      {"mu=3", kKeyFilter + kBeauty + Labels{"shadow_mu:key", "shadow_sample_count:key", "shadow_adaptive:key"}},
  };
  for (const auto& [edit, expected] : ofPublished) {
    v1::RenderRequest e = published;
    set(e, "lights.key.shadow.axis_aligned." + edit);
    EXPECT_EQ(text(ran(mustRender(*engine, e))), text(expected)) << edit;
  }
  set(r, "lights.spot.shadow.ray_traced.samples=9");  // one ray is enough for a spot whatever is asked: the visibility is the same term
  EXPECT_EQ(text(ran(mustRender(*engine, r))), "");
}

TEST(Rerun, EachStyleFieldReRunsItsStageAndWhatLiesBehindIt) {
  const Labels shade{"direct:spot", "beauty"}, transfer = shade + Labels{"style_transfer:spot"}, drawn = shade + Labels{"style_pattern:spot"};
  const Labels blurred = transfer + Labels{"style_abstraction:spot"}, distance = blurred + Labels{"style_distance:spot"};
  const Labels drawnOut = blurred + Labels{"style_elongation:spot"}, target = blurred + Labels{"style_target:spot"};
  struct Row {
    std::string edit;
    Labels expected;
    std::string before;
  };
  const std::map<std::string, Row> table{
      {"inflation", {"=0.1", transfer, ""}},
      {"softness", {"=0.3", transfer, ""}},
      {"brightness", {"=0.25", transfer, ""}},
      {"abstraction", {"=0.2", blurred, ""}},
      {"power", {"=4", distance, ""}},
      {"norm", {"=PUBLISHED", distance, ""}},
      {"angle_deg", {"=40", distance, ""}},
      {"transition", {"=QUINTIC", transfer, ""}},
      {"steps", {"=7", transfer, "transition=STAIRCASE"}},
      {"layers", {"[0].inflation=0.3", transfer, "layers[0].weight=0.5"}},
      {"pattern", {"=STIPPLING", drawn, "pattern=HATCHING"}},
      {"pattern_px", {"=5", drawn, "pattern=HATCHING"}},
      {"pattern_deg", {"=10", drawn, "pattern=HATCHING"}},
      {"samples", {"=20", distance, ""}},
      {"curve", {"[1]=0.5", transfer, "transition=CURVE curve=0,1,0.25"}},
      {"elongation", {"=0.3", drawnOut, "elongation=0.2"}},
      {"target", {"=0.6", target, "target=0.5"}},
      {"angularity", {"=0.5", target, "target=0.5"}},
      {"keep", {"=0.4", transfer + Labels{"style_keep:spot"}, "keep=0.2 inflation=-0.1"}},
      {"metric", {"=SCREEN", distance, ""}},
  };
  const std::set<std::string> other{"levels", "guard_px", "metric", "hidden_layers"};  // StyleLevelsOfPlans.*, StylesAround.*, StylesMetric.*
  const auto* d = v1::ShadowStyle::descriptor();
  for (int i = 0; i < d->field_count(); ++i) {
    if (other.count(std::string(d->field(i)->name()))) continue;
    const auto row = table.find(std::string(d->field(i)->name()));
    ASSERT_NE(row, table.end()) << d->field(i)->name() << " has no row";
    const auto engine = makeEngine();
    v1::RenderRequest r = baseRequest();
    const std::string style = "lights.spot.shadow.style.";
    set(r, style + "abstraction=0.1");
    set(r, style + "softness=0.2");
    std::istringstream before(row->second.before);
    for (std::string edit; before >> edit;) set(r, style + edit);
    const Labels first = ran(mustRender(*engine, r));
    EXPECT_TRUE(first.count("style_distance:spot") && first.count("visibility:spot"));
    EXPECT_FALSE(first.count("style_distance:key"));
    set(r, style + row->first + row->second.edit);
    EXPECT_EQ(text(ran(mustRender(*engine, r))), text(row->second.expected)) << row->first;
  }
}

TEST(Rerun, FormulasOfStylesReRunWhatReadsThem) {
  const Labels shade{"direct:spot", "beauty"}, transfer = shade + Labels{"style_transfer:spot", "style_parameters:spot"};
  const auto engine = makeEngine();
  v1::RenderRequest r = baseRequest();
  const std::string style = "lights.spot.shadow.style.", formula = "expressions." + style;
  set(r, style + "abstraction=0.1");
  set(r, style + "softness=0.2");
  mustRender(*engine, r);
  const auto edited = [&](const std::string& edit, const Labels& expected) {
    set(r, edit);
    EXPECT_EQ(text(ran(mustRender(*engine, r))), text(expected)) << edit;
  };
  edited(formula + "softness.formula=0.1 + 0.01*depth", transfer);
  edited(formula + "softness.formula=0.1 + 0.02*depth", transfer);
  edited(formula + "softness.formula=0.1 + 0.02*abs(edge)", transfer);
  edited(formula + "softness.formula=0.1 + 0.02*distance", transfer + Labels{"occluder_distance:spot", "style_occluder:spot"});
  edited(formula + "inflation.formula=0.01*distance", transfer);
  edited(style + "brightness=0.3", shade + Labels{"style_transfer:spot"});
  edited(style + "softness=0.7", {});  // the formula's
  edited("time_s=3", {});              // nothing moves, and no formula reads it
  edited(formula + "inflation.formula=0.01*distance + 0.1*time", transfer);
  edited("time_s=4", transfer);
  edited(formula + "abstraction.formula=0.1 + 0.05*distance", transfer + Labels{"style_abstraction:spot"});
  const Labels layered = shade + Labels{"style_transfer:spot"}, ofLayer = layered + Labels{"style_parameters of layer 0:spot"};
  edited(style + "layers[0].inflation=0.1", layered);
  edited(formula + "layers[0].softness.formula=0.15 + 0.02*depth", ofLayer);
  edited(formula + "layers[0].softness.formula=0.15 + 0.03*depth", ofLayer);
  edited(style + "layers[0].softness=0.4", {});
}

// Shadow maps: what a slider re-runs, by field of the message. `before` is set first; the edit is then the only change.
struct ShadowRow {
  std::vector<std::string> before;
  std::string edit;
  Labels expected;
  std::string light = "spot";
};
const std::map<std::string, ShadowRow>& shadowRows() {
  static const Labels lookup{"visibility:spot", "direct:spot", "beauty"};
  static const Labels soft{"visibility:key", "direct:key", "beauty"}, softMap{"exponential_variance_soft_map:key", "shadow_mipmap:key"};
  static const Labels depth{"light_depth_map:spot"}, bounds{"depth_bounds:spot"};
  static const auto basis = [](const char* name) { return lookup + Labels{std::string(name) + "_map:spot"}; };
  static const std::map<std::string, ShadowRow> table{
      {"map.resolution", {{"exponential.c=60"}, "map.resolution=96", depth + basis("exponential")}},
      {"map.fit", {{"exponential.c=60"}, "map.fit=CAMERA", depth + basis("exponential")}},
      {"map.bias", {{"exponential.c=60"}, "map.bias=0.001", lookup}},
      {"map.slope_bias", {{"percentage_closer.taps=4"}, "map.slope_bias=2", lookup}},
      {"map.blur", {{"exponential.c=60"}, "map.blur=3", basis("exponential")}},
      {"map.lookup", {{"exponential.c=60"}, "map.lookup=TRILINEAR", lookup + Labels{"shadow_mipmap:spot"}}},
      {"map.anisotropy", {{"exponential.c=60", "map.lookup=ANISOTROPIC"}, "map.anisotropy=4", lookup}},
      {"percentage_closer.taps", {{"percentage_closer.pattern=REGULAR"}, "percentage_closer.taps=8", lookup + bounds}},
      {"percentage_closer.pattern", {{"percentage_closer.taps=4"}, "percentage_closer.pattern=POISSON", lookup + bounds}},
      {"percentage_closer.skip", {{"percentage_closer.taps=12"}, "percentage_closer.skip=false", lookup}},  // without the pyramid: the same bits
      {"variance.bleeding_reduction", {{"variance.min_variance=1e-6"}, "variance.bleeding_reduction=0.4", lookup}},
      {"variance.min_variance", {{"variance.bleeding_reduction=0.1"}, "variance.min_variance=1e-5", lookup}},
      {"convolution.order", {{"convolution.attenuation=0"}, "convolution.order=8", basis("convolution")}},
      {"convolution.attenuation", {{"convolution.order=8"}, "convolution.attenuation=1", lookup}},
      {"convolution.correction", {{"convolution.order=8"}, "convolution.correction=SCALING", lookup}},
      {"convolution.bytes", {{"convolution.order=8"}, "convolution.bytes=true", basis("convolution")}},
      {"exponential.c", {{"exponential.filtering=LOGARITHMIC"}, "exponential.c=200", basis("exponential_logarithmic")}},
      {"exponential.filtering", {{"exponential.c=60"}, "exponential.filtering=LOGARITHMIC", basis("exponential_logarithmic")}},
      {"exponential.classification", {{"exponential.c=60"}, "exponential.classification=THRESHOLD", lookup + bounds}},
      {"exponential.epsilon", {{"exponential.classification=THRESHOLD"}, "exponential.epsilon=0.2", lookup}},
      {"exponential.fallback_kernel", {{"exponential.classification=THRESHOLD"}, "exponential.fallback_kernel=false", lookup}},
      {"exponential_variance.c_positive", {{"exponential_variance.c_negative=5"}, "exponential_variance.c_positive=20", basis("exponential_variance")}},
      {"exponential_variance.c_negative", {{"exponential_variance.c_positive=20"}, "exponential_variance.c_negative=5", basis("exponential_variance")}},
      {"exponential_variance.bleeding_reduction", {{"exponential_variance.c_positive=20"}, "exponential_variance.bleeding_reduction=0.3", lookup}},
      {"exponential_variance.min_variance", {{"exponential_variance.c_positive=20"}, "exponential_variance.min_variance=1e-4", lookup}},
      {"moment.moment_bias", {{"moment.bleeding_reduction=0.1"}, "moment.moment_bias=1e-4", lookup}},
      {"percentage_closer_soft.search_taps", {{"percentage_closer_soft.filter_taps=32"}, "percentage_closer_soft.search_taps=9", soft, "key"}},
      {"percentage_closer_soft.filter_taps", {{"percentage_closer_soft.search_taps=9"}, "percentage_closer_soft.filter_taps=32", soft, "key"}},
      {"percentage_closer_soft.dense", {{"percentage_closer_soft.search_taps=9"}, "percentage_closer_soft.dense=true", soft, "key"}},
      {"percentage_closer_soft.skip", {{"percentage_closer_soft.search_taps=9"}, "percentage_closer_soft.skip=false", {}, "key"}},  // the result is the same
      {"convolution_soft.order",
       {{"convolution_soft.sharpening=0"}, "convolution_soft.order=2", soft + Labels{"convolution_soft_map:key", "shadow_summed_area:key"}, "key"}},
      {"convolution_soft.correction", {{"convolution_soft.order=2"}, "convolution_soft.correction=OFFSET", soft, "key"}},
      {"convolution_soft.sharpening", {{"convolution_soft.order=2"}, "convolution_soft.sharpening=10", soft, "key"}},
      {"convolution_soft.sharpening_extent",
       {{"convolution_soft.order=2", "convolution_soft.sharpening=10"}, "convolution_soft.sharpening_extent=5", soft, "key"}},
      {"convolution_soft.search", {{"convolution_soft.order=2"}, "convolution_soft.search=NEAR_PLANE", soft, "key"}},
      {"variance_soft.min_variance", {{"variance_soft.subdivide=true"}, "variance_soft.min_variance=1e-5", soft, "key"}},
      {"variance_soft.subdivide", {{"variance_soft.min_variance=1e-5"}, "variance_soft.subdivide=false", soft, "key"}},
      {"exponential_variance_soft.search_taps", {{"exponential_variance_soft.c_positive=10"}, "exponential_variance_soft.search_taps=9", soft, "key"}},
      {"exponential_variance_soft.c_positive", {{"exponential_variance_soft.search_taps=9"}, "exponential_variance_soft.c_positive=10", soft + softMap, "key"}},
      {"exponential_variance_soft.c_negative", {{"exponential_variance_soft.search_taps=9"}, "exponential_variance_soft.c_negative=10", soft + softMap, "key"}},
      {"exponential_variance_soft.bleeding_reduction",
       {{"exponential_variance_soft.search_taps=9"}, "exponential_variance_soft.bleeding_reduction=0.3", soft, "key"}},
      {"moment.bleeding_reduction", {{"moment.moment_bias=1e-5"}, "moment.bleeding_reduction=0.2", lookup}},
  };
  return table;
}
const std::map<std::string, std::string>& shadowElsewhere() {
  static const std::map<std::string, std::string> table{
      {"exponential.device", "another numeric class: ExponentialShadowScene.OnlyWhatChangedIsANewNode"},
  };
  return table;
}

TEST(Rerun, EveryShadowMapFieldHasARow) {
  std::set<std::string> fields;
  const auto collect = [&](const std::string& prefix, const google::protobuf::Descriptor* d) {
    for (int i = 0; i < d->field_count(); ++i) fields.insert(prefix + "." + d->field(i)->name());
  };
  collect("map", v1::ShadowMapSettings::descriptor());
  for (const ShadowTechniqueEntry& e : shadowTechniques())
    if (e.usesMap) {
      const auto* field = v1::ShadowTechnique::descriptor()->FindFieldByNumber(int(e.key));
      collect(field->name(), field->message_type());
    }
  for (const std::string& f : fields) EXPECT_TRUE(shadowRows().count(f) || shadowElsewhere().count(f)) << f << " has no row";
  for (const auto& [f, row] : shadowRows()) EXPECT_TRUE(fields.count(f)) << f << " is not a field of a map technique any more";
}

TEST(Rerun, EachShadowMapFieldReRunsOnlyWhatLiesBehindIt) {
  for (const auto& [field, row] : shadowRows()) {
    const auto engine = makeEngine();
    v1::RenderRequest r = baseRequest();
    const std::string shadow = "lights." + row.light + ".shadow.";
    (*r.mutable_lights())[row.light].clear_shadow();
    set(r, shadow + "map.resolution=160");
    set(r, "camera.yfov_deg=12");  // sees less than the room: the camera's fit is another window
    for (const std::string& e : row.before) set(r, shadow + e);
    const Labels first = ran(mustRender(*engine, r));
    EXPECT_TRUE(first.count("light_depth_map:" + row.light)) << field;
    set(r, shadow + row.edit);
    EXPECT_EQ(text(ran(mustRender(*engine, r))), text(row.expected)) << field;
  }
}

TEST(Rerun, EachSceneFacetReRunsExactlyWhatReadsIt) {
  const auto edit = [](const std::function<void(v1::PatchSceneRequest&, const v1::SceneInfo&)>& fill) {
    const auto engine = makeEngine();
    const v1::RenderRequest r = baseRequest();
    mustRender(*engine, r);
    v1::PatchSceneRequest p;
    p.set_scene("cornell");
    fill(p, *engine->inspectScene("cornell"));
    EXPECT_TRUE(engine->patchScene(p).ok());
    return ran(mustRender(*engine, r));
  };
  const auto colour = edit([](auto& p, const auto& info) { (*p.mutable_materials())[info.material_names(0)].mutable_base_color()->set_x(0.3f); });
  EXPECT_EQ(text(colour), text(Labels{"surface", "unoccluded:key", "unoccluded:spot", "direct:key", "direct:spot"} + kTraced + kBeauty))
      << "albedo: no G-buffer, no visibility";
  const auto rough = edit([](auto& p, const auto& info) { (*p.mutable_materials())[info.material_names(0)].set_roughness(0.3); });
  EXPECT_EQ(text(rough), text(kTraced + Labels{"surface"} +
                              (rough.count("beauty") ? Labels{"unoccluded:key", "unoccluded:spot", "direct:key", "direct:spot", "beauty"} : Labels{})))
      << "bsdf";
  const auto move = edit([](auto& p, const auto& info) {
    auto& m = (*p.mutable_instances())[info.instance_names(info.instance_names_size() - 1)];
    for (int k = 0; k < 16; ++k) m.add_matrix(k % 5 == 0 ? 1.0f : 0.0f);
    m.set_matrix(12, 0.05f);
  });
  EXPECT_EQ(text(move), text(kView + kTraced + kBeauty)) << "pose: everything";
}

TEST(Rerun, EnvironmentRotationAndExtraction) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 4);
  set(r, "environment.sky.turbidity=3");
  set(r, "environment.extract_lights=3");
  const RenderResult first = mustRender(*engine, r);
  EXPECT_TRUE(ran(first).count("visibility:environment/2"));
  set(r, "environment.gain=2,2,2");
  set(r, "tone_map.exposure=1");
  EXPECT_EQ(text(ran(mustRender(*engine, r))), "beauty ") << "exposure and gain re-key nothing behind the expander";
  set(r, "environment.rotation_deg=40");
  const Labels turned = ran(mustRender(*engine, r));
  EXPECT_TRUE(turned.count("visibility:environment/0"));
  EXPECT_FALSE(turned.count("gbuffer"));
  set(r, "environment.extract_by=MEDIAN_CUT");
  EXPECT_EQ(text(ran(mustRender(*engine, r))), "") << "the default";
  for (const char* by : {"STRUCTURED", "WAVELET"}) {
    set(r, std::string("environment.extract_by=") + by);
    const Labels found = ran(mustRender(*engine, r));
    for (const char* node : {"extract_lights", "direct:environment", "beauty"}) EXPECT_TRUE(found.count(node)) << by << " " << node;
    EXPECT_FALSE(found.count("gbuffer")) << by;
    EXPECT_FALSE(found.count("indirect")) << by;
    set(r, "environment.extract_lights=5");
    const Labels more = ran(mustRender(*engine, r));
    for (const char* node : {"visibility:environment/0", "visibility:environment/1", "visibility:environment/2"})
      EXPECT_FALSE(more.count(node)) << by << ": nested";
    for (const char* node : {"visibility:environment/3", "visibility:environment/4", "direct:environment"}) EXPECT_TRUE(more.count(node)) << by << " " << node;
    set(r, "environment.extract_lights=3");
  }
}

TEST(Rerun, EnvironmentAsAreaLights) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 4);
  set(r, "environment.sky.turbidity=3");
  set(r, "environment.area_lights=3");  // of which the fit uses two: the rest is smooth
  set(r, "shadows.ray_traced.samples=4");
  set(r, "lights.light.shadow.path_traced=");
  const Labels first = ran(mustRender(*engine, r));
  for (const char* node : {"area_lights", "visibility:environment/1", "unoccluded:environment/1", "ambient:environment", "direct:environment"})
    EXPECT_TRUE(first.count(node)) << node;
  set(r, "environment.gain=2,2,2");
  EXPECT_EQ(text(ran(mustRender(*engine, r))), "beauty ");
  set(r, "shadows.ray_traced.samples=9");  // soft shadows: the lights have a size
  EXPECT_EQ(text(ran(mustRender(*engine, r))), "beauty direct:environment visibility:environment/0 visibility:environment/1 ");
  set(r, "environment.rotation_deg=40");
  const Labels turned = ran(mustRender(*engine, r));
  for (const char* node : {"visibility:environment/0", "unoccluded:environment/0", "ambient:environment"}) EXPECT_TRUE(turned.count(node)) << node;
  for (const char* node : {"gbuffer", "surface"}) EXPECT_FALSE(turned.count(node)) << node;
  set(r, "environment.area_lights=4");
  EXPECT_TRUE(ran(mustRender(*engine, r)).count("area_lights"));
}

// Colours and filters trace nothing; every parameter of a filter runs that filter and what reads it.
TEST(Rerun, NoiseIsTakenOutOfWhatIsThere) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 4);
  for (const char* o : {"beauty", "indirect"}) r.add_outputs(o);
  mustRender(*engine, r);
  r.mutable_outputs()->RemoveLast();
  set(r, "denoise.joint_bilateral.radius_px=2");
  const auto traced = nodesBy(mustRender(*engine, r), v1::NodeReport::RUN);
  EXPECT_FALSE(traced.count("path_trace"));  // of 4 samples: there; the first two were not asked for before
  EXPECT_TRUE(traced.count("path_trace of 2 samples"));
  const std::string behind = "beauty beauty by joint_bilateral ";
  const std::vector<std::pair<std::string, std::string>> edits = {
      {"denoise.joint_bilateral.radius_px=3", behind},
      {"denoise.joint_bilateral.albedo=0.2", behind},
      {"denoise.joint_bilateral.normal_deg=20", behind},
      {"denoise.joint_bilateral.plane_px=3", behind},
      {"lights.light.gain=2,1,1", "beauty beauty by joint_bilateral beauty in halves beauty traced beauty traced of 2 samples "},
      {"denoise=wavelet", "beauty beauty by wavelet "}};
  for (const auto& [edit, expected] : edits) {
    if (edit == "denoise=wavelet") r.clear_denoise();
    set(r, edit);
    EXPECT_EQ(text(ran(mustRender(*engine, r))), expected) << edit;
  }
  for (const auto& [filter, fields] :
       std::map<std::string, std::vector<std::string>>{{"wavelet", {"levels=2", "luminance=3", "normal_power=32", "plane_px=2"}},
                                                       {"non_local_means", {"radius_px=3", "patch_px=2", "damping=0.7", "features=0.5"}},
                                                       {"first_order", {"radius_px=3", "patch_px=2", "damping=0.7"}}}) {
    r.clear_denoise();
    set(r, "denoise=" + filter);
    mustRender(*engine, r);
    for (const std::string& field : fields) {
      set(r, "denoise." + filter + "." + field);
      EXPECT_EQ(text(ran(mustRender(*engine, r))), "beauty beauty by " + filter + " ") << filter << " " << field;
    }
  }
  r.clear_denoise();
  set(r, "denoise=axis_aligned");
  mustRender(*engine, r);
  for (const std::string field : {"scale=2", "radius_px=9", "width_threshold=0.5", "angle_deg=30"}) {
    set(r, "denoise.axis_aligned." + field);
    EXPECT_EQ(text(ran(mustRender(*engine, r))), "beauty beauty:diffuse along edges beauty:diffuse by axis_aligned ") << field;
  }
  r.clear_denoise();
  set(r, "denoise=auto");
  mustRender(*engine, r);
  set(r, "denoise.auto.fast=true");
  EXPECT_EQ(text(ran(mustRender(*engine, r))), "beauty beauty:diffuse along edges beauty:diffuse by non_local_means beauty:diffuse selected ");
}

// Settings of a rejection are behind the samples; gains are in them.
TEST(Rerun, OutliersAreRejectedOfWhatIsThere) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 16);
  set(r, "denoise.outliers=path_density");
  EXPECT_EQ(text(ran(mustRender(*engine, r))),
            "beauty beauty indirect without outliers beauty samples of indirect direct direct:mean light that is not judged ");
  const std::string behind = "beauty beauty indirect without outliers ";
  for (const auto& [method, fields] :
       std::map<std::string, std::vector<std::string>>{{"path_density", {"neighbours=5", "soft=1.5", "hard=2.5", "color=10", "spread_px=4", "most_spread=2"}},
                                                       {"reweighting", {"base=4", "enough=3"}},
                                                       {"median_of_means", {"buckets=5"}},
                                                       {"trimmed", {"share=0.2"}}}) {
    r.clear_denoise();
    set(r, "denoise.outliers=" + method);
    mustRender(*engine, r);
    for (const std::string& field : fields) {
      set(r, "denoise.outliers." + method + "." + field);
      EXPECT_EQ(text(ran(mustRender(*engine, r))), behind) << method << " " << field;
    }
  }
  set(r, "denoise.outliers.white=2");
  EXPECT_EQ(text(ran(mustRender(*engine, r))), "") << "nothing to those that see no colours";
  r.clear_denoise();
  set(r, "denoise.outliers=path_density");
  mustRender(*engine, r);
  set(r, "denoise.outliers.white=2");
  EXPECT_EQ(text(ran(mustRender(*engine, r))), behind);
  set(r, "lights.light.gain=2,1,1");
  EXPECT_EQ(text(ran(mustRender(*engine, r))), behind + "beauty samples of indirect ");
  set(r, "denoise.outliers.judged=APART");
  EXPECT_EQ(text(ran(mustRender(*engine, r))), "beauty beauty direct without outliers beauty samples of direct ");
  set(r, "halt.spp=32");
  std::set<std::string> extended;
  const RenderResult longer = mustRender(*engine, r);
  for (const auto& row : longer.reply.plan())
    if (row.reason().find("extended from 16 samples") != std::string::npos) extended.insert(row.node());
  EXPECT_EQ(text(extended), "beauty samples of direct beauty samples of indirect direct ");
}

TEST(Rerun, EnvironmentByTransfer) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 4);
  set(r, "environment.sky.turbidity=3");
  for (const char* e : {"environment.transfer.points=400", "environment.transfer.bands=3", "environment.transfer.samples=128", "environment.transfer.bounces=1",
                        "environment.transfer.lights=4", "environment.transfer.light_share=0.05", "lights.light.shadow.path_traced="})
    set(r, e);
  const std::string light = "beauty environment:bounced environment:direct transfer:light ";
  const Labels first = ran(mustRender(*engine, r));
  for (const char* node : {"transfer points", "transfer:direct", "transfer:albedo", "transfer:bounce 1", "environment:split", "transfer:light",
                           "transfer:places", "environment:direct", "environment:bounced"})
    EXPECT_TRUE(first.count(node)) << node;
  const auto edited = [&](const char* edit) {
    set(r, edit);
    std::string out;
    for (const std::string& label : ran(mustRender(*engine, r)))
      if (label.find(":environment") == std::string::npos && label.find("emission") != 0 && label.find("direct") != 0 && label.find("indirect") != 0)
        out += label + " ";  // but for the sun's own and what is path traced
    return out;
  };
  EXPECT_EQ(edited("environment.gain=2,2,2"), "beauty ");
  EXPECT_EQ(edited("environment.rotation_deg=40"), light);     // the map is split in its own axes
  EXPECT_EQ(edited("environment.transfer.gloss=TRACED"), "");  // nothing here shines
  EXPECT_EQ(edited("environment.transfer.bounces=2"), "beauty environment:bounced environment:direct transfer:bounce 2 transfer:light ");
  EXPECT_EQ(edited("environment.transfer.samples=192"),
            "beauty environment:bounced environment:direct transfer:bounce 1 transfer:bounce 2 transfer:direct transfer:light ");
  EXPECT_EQ(edited("environment.transfer.light_share=0.04"), "environment:split ");  // the same lights: all behind it stays
  EXPECT_EQ(edited("environment.transfer.lights=0").find("transfer:direct"), std::string::npos);
  EXPECT_NE(edited("environment.transfer.bands=4").find("transfer:direct"), std::string::npos);
  EXPECT_NE(edited("environment.transfer.points=300").find("transfer points"), std::string::npos);
  EXPECT_EQ(edited("seed=3").find("environment:split"), std::string::npos);
}

// Direct transfer knows no albedo: paint makes the bounces again and traces nothing else of it.
TEST(Rerun, RecolouringKeepsDirectTransfer) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 4);
  set(r, "environment.constant=0.3,0.3,0.4");
  for (const char* e :
       {"environment.transfer.points=400", "environment.transfer.bands=3", "environment.transfer.samples=128", "environment.transfer.bounces=1"})
    set(r, e);
  mustRender(*engine, r);
  v1::PatchSceneRequest p;
  p.set_scene("cornell");
  (*p.mutable_materials())[engine->inspectScene("cornell")->material_names(0)].mutable_base_color()->set_x(0.3f);
  ASSERT_TRUE(engine->patchScene(p).ok());
  const Labels painted = ran(mustRender(*engine, r));
  for (const char* node : {"transfer:albedo", "transfer:bounce 1", "transfer:light"}) EXPECT_TRUE(painted.count(node)) << text(painted);
  for (const char* node : {"transfer points", "transfer:direct", "transfer:places", "environment:split"}) EXPECT_FALSE(painted.count(node)) << text(painted);
}

TEST(Rerun, AMapThatTurnsTracesNothing) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("lights8", 16, 12, 4);  // lamps of every kind, and a material that shines
  set(r, "environment.constant=0.3,0.3,0.4");
  for (const char* e :
       {"environment.transfer.points=400", "environment.transfer.bands=3", "environment.transfer.samples=128", "environment.transfer.bounces=1"})
    set(r, e);
  const Labels first = ran(mustRender(*engine, r));
  for (const char* node : {"environment:gloss", "environment:direct gloss", "environment:bounced gloss"}) EXPECT_TRUE(first.count(node)) << text(first);
  set(r, "environment.rotation_deg=70");
  const RenderResult turned = mustRender(*engine, r);
  for (const auto& [label, node] : nodesBy(turned, v1::NodeReport::RUN))  // what the camera sees of the map is its rays
    EXPECT_TRUE(node.rays() == 0 || label.find("environment seen") == 0 || label.find("emission") == 0) << label;
  EXPECT_FALSE(ran(turned).count("environment:gloss"));
  EXPECT_TRUE(ran(turned).count("environment:direct gloss"));
  set(r, "environment.transfer.gloss=TRACED");
  const Labels traced = ran(mustRender(*engine, r));
  EXPECT_FALSE(traced.count("environment:direct gloss"));
  EXPECT_TRUE(std::any_of(traced.begin(), traced.end(), [](const std::string& l) { return l.find("specular") != std::string::npos; })) << text(traced);
}

// A new environment takes another place in the light list; what other lights made stays.
TEST(Rerun, ALightsPlaceInTheListIsNoPartOfItsKey) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("fence", 16, 12, 4);
  set(r, "environment.constant=0.1,0.1,0.1");
  for (const char* e :
       {"lights.z.kind=RECT", "lights.z.position=0,3,1", "lights.z.direction=0,-1,0", "lights.z.intensity=5", "lights.z.shadow.axis_aligned.k=3"})
    set(r, e);
  mustRender(*engine, r);
  v1::RenderRequest none = r;
  none.clear_environment();
  const Labels again = ran(mustRender(*engine, none));
  EXPECT_FALSE(again.count("unoccluded:z")) << text(again);
  EXPECT_FALSE(again.count("shadow_slopes:z")) << text(again);
  EXPECT_FALSE(again.count("axis_aligned_filter:z")) << text(again);
  r.mutable_environment()->clear_constant();
  set(r, "environment.sky.turbidity=4");
  EXPECT_FALSE(ran(mustRender(*engine, r)).count("unoccluded:z"));
}

// Frames of a curve are the requests with its values typed in: a light's strength re-runs the composite alone.
TEST(Rerun, CurvesAreTheirValues) {
  const auto engine = makeEngine();
  const auto frame = [](double time) {
    v1::RenderRequest r = smallRequest("cornell", 16, 12, 8);
    r.set_time_s(time);
    v1::Curve& strength = (*r.mutable_curves())["lights.light.gain"];
    for (const double t : {0.0, 2.0}) strength.add_time_s(t);
    for (const double v : {1.0, 1.0, 1.0, 3.0, 2.0, 1.0}) strength.add_value(v);
    return r;
  };
  mustRender(*engine, frame(0));
  for (const double time : {0.5, 1.0, 7.0}) {
    const RenderResult curved = mustRender(*engine, frame(time));
    EXPECT_EQ(ran(curved), kBeauty) << time;
    v1::RenderRequest typed = smallRequest("cornell", 16, 12, 8);
    typed.set_time_s(time);
    const double s = std::min(time / 2, 1.0);
    set(typed, "lights.light.gain=" + std::to_string(1 + 2 * s) + "," + std::to_string(1 + s) + ",1");
    const RenderResult plain = mustRender(*makeEngine(), typed);
    EXPECT_EQ(firstDifference(curved, plain), "") << time;
    EXPECT_EQ(curved.reply.request_hash(), plain.reply.request_hash());
    EXPECT_TRUE(curved.reply.resolved().curves().empty());
  }
}

TEST(Rerun, AnimationsAndVariants) {
  const std::string file = writeAnimatedScene("rerun");
  const auto requests = [&](const std::string& edits) {
    v1::RenderRequest r = smallRequest("moving", 16, 12, 8);
    set(r, "lights.lamp.shadow.ray_traced.samples=1");
    set(r, "lights.still.shadow.ray_traced.samples=1");
    for (size_t from = 0; from < edits.size();) {
      const size_t to = std::min(edits.find(' ', from), edits.size());
      set(r, edits.substr(from, to - from));
      from = to + 1;
    }
    return r;
  };
  // Every edit against an engine that has rendered the rest pose.
  const auto rerun = [&](const std::string& edits) {
    const auto engine = makeEngine();
    EXPECT_TRUE(engine->openScene(file, "moving").ok());
    mustRender(*engine, requests(""));
    const Labels warm = ran(mustRender(*engine, requests(edits)));
    EXPECT_EQ(text(ran(mustRender(*engine, requests(edits)))), "") << edits << ": the same pose runs nothing";
    const auto cold = makeEngine();
    EXPECT_TRUE(cold->openScene(file, "moving").ok());
    EXPECT_EQ(firstDifference(mustRender(*engine, requests(edits)), mustRender(*cold, requests(edits))), "") << edits;
    return warm;
  };
  const Labels lamp{"visibility:lamp", "unoccluded:lamp", "direct:lamp"}, still{"visibility:still", "unoccluded:still", "direct:still"};
  const Labels everything = Labels{"gbuffer", "surface"} + lamp + still + kIndirect + kBeauty;
  EXPECT_EQ(text(rerun("time_s=0.5")), text(everything)) << "the first animation moves a mesh: pose";
  EXPECT_EQ(text(rerun("time_s=0.5 animation=lamp")), text(lamp + kIndirect + kBeauty)) << "light shape";
  EXPECT_EQ(text(rerun("time_s=0.5 animation=dolly")), text(everything)) << "camera";
  EXPECT_EQ(text(rerun("time_s=0 animation=lamp")), "") << "its first key is the rest pose";
  EXPECT_EQ(text(rerun("animation=lamp")), "") << "without a time: the rest pose";
  EXPECT_EQ(text(rerun("variant=grey")), "") << "the variant that the file shows";
  EXPECT_EQ(text(rerun("variant=red")), text(everything)) << "another material: which mesh has which is topology";
  const auto engine = makeEngine();
  ASSERT_TRUE(engine->openScene(file, "moving").ok());
  for (const auto& [edit, names] : {std::pair{"animation=jump", "slide, lamp, dolly"}, std::pair{"variant=blue", "grey, red"}}) {
    const auto r = engine->render(requests(edit));
    ASSERT_FALSE(r.ok());
    EXPECT_EQ(r.status().code(), Code::NotFound);
    EXPECT_NE(r.status().message().find(names), std::string::npos) << r.status().toString();
    EXPECT_EQ(r.status().location(), std::string("request.") + std::string(edit).substr(0, std::string(edit).find('=')));
  }
  const auto info = *engine->inspectScene("moving");
  ASSERT_EQ(info.animations_size(), 3);
  EXPECT_EQ(info.animations(1).name(), "lamp");
  EXPECT_EQ(info.animations(1).duration_s(), 1.0);
  EXPECT_EQ(info.variants_size(), 2);
}

TEST(Rerun, ClustersAndDifferences) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("lights8", 16, 12, 4);
  set(r, "integrator.max_groups=4");
  const RenderResult first = mustRender(*engine, r);
  EXPECT_EQ(text(ran(first)), "beauty path_trace path_trace:mean ");
  // Find a light inside the cluster: editing it traces that light alone.
  const auto info = *engine->inspectScene("lights8");
  int differences = 0, composites = 0;
  for (const auto& light : info.lights()) {
    v1::RenderRequest e = r;
    set(e, "lights." + light.name() + ".gain=2,2,2");
    const Labels again = ran(mustRender(*engine, e));
    if (again == kBeauty) ++composites;
    else if (again == Labels{"beauty", "difference:" + light.name(), "difference:" + light.name() + ":mean"}) ++differences;
    else ADD_FAILURE() << light.name() << ": " << text(again);
  }
  EXPECT_EQ(composites, 3);
  EXPECT_EQ(differences, info.lights_size() - 3);
}

TEST(Rerun, Caustics) {
  const auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("spheres", 12, 8, 16);
  for (const char* a : {"lights.lamp.kind=POINT", "lights.lamp.position=0,6,2", "lights.lamp.intensity=50"}) set(r, a);
  const Labels without = ran(mustRender(*engine, r));
  EXPECT_FALSE(without.count("caustics"));
  const Labels node{"caustics", "caustics:mean"};
  const std::pair<const char*, Labels> edits[] = {{"integrator.caustic_photons=500", node + kBeauty},
                                                  {"integrator.caustic_radius=0.01", node + kBeauty},
                                                  {"lights.lamp.gain=2,1,1", kBeauty},
                                                  {"integrator.light_selection=POWER", Labels{"path_trace", "path_trace:mean"} + kBeauty},
                                                  {"integrator.sampler=INDEPENDENT", Labels{"path_trace", "path_trace:mean"} + kBeauty},
                                                  {"integrator.caustic_photons=0", kBeauty}};
  for (const auto& [edit, expected] : edits) {
    set(r, edit);
    EXPECT_EQ(text(ran(mustRender(*engine, r))), text(expected)) << edit;
  }
}

TEST(Rerun, MoreSamplesExtendAndEqualScratch) {
  const auto warm = makeEngine(), cold = makeEngine();
  v1::RenderRequest r = smallRequest("cornell", 16, 12, 64);
  const auto few = nodesBy(mustRender(*warm, r), v1::NodeReport::RUN);
  set(r, "halt.spp=128");
  const RenderResult extended = mustRender(*warm, r);
  const auto more = nodesBy(extended, v1::NodeReport::RUN);
  const RenderResult scratch = mustRender(*cold, r);
  EXPECT_NE(more.at("path_trace").reason().find("extended from 64 samples"), std::string::npos) << more.at("path_trace").reason();
  const auto whole = nodesBy(scratch, v1::NodeReport::RUN);
  // 64 more samples: about as many rays as the first 64, half of 128 at once.
  EXPECT_NEAR(double(more.at("path_trace").rays()), 0.5 * double(whole.at("path_trace").rays()), 0.05 * double(whole.at("path_trace").rays()));
  EXPECT_EQ(few.at("path_trace").rays() + more.at("path_trace").rays(), whole.at("path_trace").rays());
  EXPECT_EQ(firstDifference(extended, scratch), "");
}

}  // namespace
}  // namespace gobo::testing
