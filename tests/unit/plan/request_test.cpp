// SPDX-License-Identifier: Apache-2.0
#include "request/request.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace gobo {
namespace {

TEST(Request, DefaultsComeFromTheSchema) {
  v1::RenderRequest r;
  r.mutable_integrator();
  ASSERT_TRUE(resolveDefaults(r).ok());
  EXPECT_EQ(r.width(), 640u);
  EXPECT_EQ(r.integrator().max_bounces(), 8u);
  EXPECT_TRUE(r.integrator().indirect());
  EXPECT_EQ(r.integrator().light_selection(), v1::Integrator::TREE);
  EXPECT_EQ(r.integrator().sampler(), v1::Integrator::SOBOL);
  EXPECT_FALSE(r.has_environment());  // absent sub-messages stay absent
}

TEST(Request, RangeErrorsNameFieldAndValue) {
  v1::RenderRequest r;
  r.mutable_integrator()->set_max_bounces(900);
  const Status s = resolveDefaults(r);
  ASSERT_EQ(s.code(), Code::InvalidArgument);
  EXPECT_EQ(s.location(), "request.integrator.max_bounces");
  EXPECT_NE(s.message().find("900"), std::string::npos);
  EXPECT_NE(s.message().find("at most 64"), std::string::npos);

  v1::RenderRequest n;
  (*n.mutable_lights())["key"].set_intensity(std::nan(""));
  EXPECT_EQ(resolveDefaults(n).location(), "request.lights.key.intensity");
  v1::RenderRequest z;
  z.mutable_halt()->set_time_s(0);
  EXPECT_NE(resolveDefaults(z).message().find("greater than 0"), std::string::npos);
}

TEST(Request, HashIgnoresOrderAndPresentationOnly) {
  v1::RenderRequest a, b;
  ASSERT_TRUE(setPath(a, "lights.x.intensity=2").ok());
  ASSERT_TRUE(setPath(a, "lights.y.intensity=3").ok());
  ASSERT_TRUE(setPath(b, "lights.y.intensity=3").ok());
  ASSERT_TRUE(setPath(b, "lights.x.intensity=2").ok());
  EXPECT_EQ(messageHash(a), messageHash(b));
  ASSERT_TRUE(setPath(b, "encoding.format=png").ok());
  ASSERT_TRUE(setPath(b, "scheduling.client=somebody").ok());
  EXPECT_EQ(messageHash(a), messageHash(b));
  ASSERT_TRUE(setPath(b, "seed=1").ok());
  EXPECT_NE(messageHash(a), messageHash(b));
}

TEST(Request, PathsSetEveryKindOfField) {
  v1::RenderRequest r;
  for (const char* good : {"width=320", "lights.key.color=1,0.5,0.25", "lights.a.b.intensity=2", "shadows.axis_aligned.mu=2", "outputs=beauty,depth",
                           "integrator.light_selection=uniform", "integrator.sampler=halton", "shadows.path_traced=", "lights.key.enabled=false",
                           "camera.name=front", "lights.key.gain=2"})
    EXPECT_TRUE(setPath(r, good).ok()) << good << ": " << setPath(r, good).toString();
  EXPECT_EQ(r.lights().at("key").color().y(), 0.5f);
  EXPECT_EQ(r.lights().at("a.b").intensity(), 2);
  EXPECT_EQ(r.lights().at("key").gain().z(), 2.0f);
  EXPECT_EQ(r.outputs_size(), 2);
  EXPECT_TRUE(r.shadows().has_path_traced());
}

TEST(Request, BadPathsSayWhatThereIs) {
  v1::RenderRequest r;
  for (const char* bad : {"nothing=1", "width=abc", "width=-3", "width=99999999999", "lights.key=3", "lights.key.colour=1", "lights.key.color=1,2",
                          "integrator.light_selection=best", "integrator.sampler=lattice", "integrator.indirect=maybe", "noequals", "=4", "width.x=3"}) {
    const Status s = setPath(r, bad);
    EXPECT_EQ(s.code(), Code::InvalidArgument) << bad;
    EXPECT_FALSE(s.message().empty());
  }
  EXPECT_NE(setPath(r, "integrator.bounces=1").message().find("max_bounces"), std::string::npos);
}

TEST(RequestElements, PathsNameElementsOfListsAndTheSizeAppends) {
  v1::RenderRequest r;
  for (const char* good : {"filters[0]=bloom", "filters[0].bloom.gain=0.3", "filters[1].sharpen.amount=2", "filters[1].term=direct",
                           "filters[0].bloom.gain=0.5", "shadows.style.layers[0].inflation=0.1", "lights.a.b.shadow.style.layers[0].weight=2",
                           "outputs[0]=beauty", "outputs[1]=depth", "outputs[0]=direct", "curves.seed.value[0]=4", "curves.seed.value[0]=3", "filters[2]="})
    EXPECT_TRUE(setPath(r, good).ok()) << good << ": " << setPath(r, good).toString();
  ASSERT_EQ(r.filters_size(), 3);
  EXPECT_EQ(r.filters(0).bloom().gain(), 0.5);
  EXPECT_EQ(r.filters(1).sharpen().amount(), 2.0);
  EXPECT_EQ(r.filters(1).term(), "direct");
  EXPECT_EQ(r.filters(2).filter_case(), v1::PictureFilter::FILTER_NOT_SET);
  EXPECT_EQ(r.shadows().style().layers(0).inflation(), 0.1);
  EXPECT_EQ(r.lights().at("a.b").shadow().style().layers(0).weight(), 2.0);
  ASSERT_EQ(r.outputs_size(), 2);
  EXPECT_EQ(r.outputs(0), "direct");
  EXPECT_EQ(r.curves().at("seed").value(0), 3.0);
  EXPECT_EQ(r.curves().at("seed").value_size(), 1);
}

TEST(RequestElements, ErrorsSayWhatTheListHas) {
  v1::RenderRequest r;
  ASSERT_TRUE(setPath(r, "filters[0]=bloom").ok());
  const std::vector<std::pair<const char*, const char*>> bad = {
      {"filters[2].bloom.gain=1", "it has element [0], and [1] appends"},
      {"filters[-1].bloom.gain=1", "filters[0]"},
      {"filters[].bloom.gain=1", "filters[0]"},
      {"filters[0.bloom.gain=1", "filters[0]"},
      {"filters[0]x.bloom.gain=1", "filters[0]"},
      {"filters[4096].bloom.gain=1", "less than 4096"},
      {"filters[18446744073709551616].bloom.gain=1", "less than 4096"},
      {"filters.bloom.gain=1", "filters[0].bloom"},
      {"filters=bloom", "filters[0]"},
      {"filters[0]=blooom", "bloom"},
      {"filters[0].bloom.gian=1", "gain"},
      {"filters[0].bloom[0].gain=1", "no list"},
      {"width[0]=1", "no list"},
      {"lights[0].gain=1", "no list"},
      {"outputs[1]=beauty", "it is empty"},
      {"outputs[0].x=beauty", "no fields"},
      {"nothing[0]=1", "no field 'nothing'"},
  };
  for (const auto& [assignment, says] : bad) {
    v1::RenderRequest copy = r;
    const Status s = setPath(copy, assignment);
    EXPECT_EQ(s.code(), Code::InvalidArgument) << assignment;
    EXPECT_NE(s.toString().find(says), std::string::npos) << assignment << ": " << s.toString();
  }
  EXPECT_EQ(numberField(r, "filters[0].bloom.gain").ok(), true);
  EXPECT_EQ(numberField(r, "filters[0].sharpen.amount").status().code(), Code::InvalidArgument) << "not what the request chooses";
  EXPECT_EQ(numberField(r, "filters[1].bloom.gain").status().code(), Code::InvalidArgument) << "a curve makes no filter";
  EXPECT_EQ(numberField(r, "outputs[0]").status().code(), Code::InvalidArgument);
  EXPECT_EQ(r.filters_size(), 1);
}

TEST(RequestElements, MasksReplaceElementsAndTheirFields) {
  v1::RenderRequest base, patch;
  for (const char* a : {"filters[0].bloom.gain=0.1", "filters[0].bloom.threshold=2", "filters[1].sharpen.amount=2", "outputs=beauty,depth"})
    ASSERT_TRUE(setPath(base, a).ok());
  // A patch may begin with the second element; the one before it is empty and not in the mask.
  for (const char* a : {"filters[1].gaussian.sigma_px=3", "outputs[1]=normal"})
    ASSERT_EQ(setPatchPath(patch, a).ok(), std::string(a) != "outputs[1]=normal") << a;
  ASSERT_EQ(patch.filters_size(), 2);
  ASSERT_TRUE(applyMask(base, patch, {"filters[1].gaussian.sigma_px"}).ok());
  EXPECT_EQ(base.filters(0).bloom().gain(), 0.1);
  ASSERT_TRUE(base.filters(1).has_gaussian());  // another choice takes the place of the one that there was
  EXPECT_EQ(base.filters(1).gaussian().sigma_px(), 3.0);
  patch.Clear();
  ASSERT_TRUE(setPatchPath(patch, "filters[0].bloom.gain=0.7").ok());
  ASSERT_TRUE(applyMask(base, patch, {"filters[0].bloom.gain", "filters[0].bloom.threshold"}).ok());
  EXPECT_EQ(base.filters(0).bloom().gain(), 0.7);
  EXPECT_FALSE(base.filters(0).bloom().has_threshold());  // named, absent in the patch: cleared
  // A whole element: replaced, appended, taken out.
  patch.Clear();
  for (const char* a : {"filters[2]=median", "outputs=direct"}) ASSERT_TRUE(setPatchPath(patch, a).ok()) << a;
  ASSERT_TRUE(applyMask(base, patch, {"filters[2]", "outputs[0]"}).ok());
  ASSERT_EQ(base.filters_size(), 3);
  EXPECT_TRUE(base.filters(2).has_median());
  EXPECT_EQ(base.outputs(0), "direct");
  EXPECT_EQ(base.outputs(1), "depth");
  patch.Clear();
  ASSERT_TRUE(applyMask(base, patch, {"filters[0]"}).ok());
  ASSERT_EQ(base.filters_size(), 2);
  EXPECT_TRUE(base.filters(0).has_gaussian());
  EXPECT_TRUE(base.filters(1).has_median());
  // Beyond the list: an error that says what there is.
  ASSERT_TRUE(setPatchPath(patch, "filters[5].bloom.gain=1").ok());
  const Status s = applyMask(base, patch, {"filters[5].bloom.gain"});
  EXPECT_EQ(s.code(), Code::InvalidArgument);
  EXPECT_NE(s.toString().find("[0] to [1], and [2] appends"), std::string::npos) << s.toString();
}

TEST(Request, MaskReplacesNamedFieldsOnly) {
  v1::RenderRequest base, patch;
  for (const char* a : {"lights.key.color=1,1,1", "lights.key.intensity=5", "seed=3", "tone_map.exposure=1"}) ASSERT_TRUE(setPath(base, a).ok());
  for (const char* a : {"lights.key.color=1,0,0", "seed=9", "width=77", "environment.constant=1"}) ASSERT_TRUE(setPath(patch, a).ok());
  ASSERT_TRUE(applyMask(base, patch, {"lights.key.color", "tone_map.exposure", "environment"}).ok());
  EXPECT_EQ(base.lights().at("key").color().y(), 0.0f);
  EXPECT_EQ(base.lights().at("key").intensity(), 5);  // not named
  EXPECT_EQ(base.seed(), 3u);                         // not named
  EXPECT_FALSE(base.tone_map().has_exposure());       // named, absent in the patch: cleared
  EXPECT_EQ(base.environment().constant().x(), 1.0f);
  EXPECT_EQ(applyMask(base, patch, {"lights.key.size"}).code(), Code::InvalidArgument);
}

/// What a relight takes back: entries that the mask names and the patch lacks, their keys' dots included.
TEST(Request, MaskTakesBackEntriesWhoseKeysHaveDots) {
  v1::RenderRequest base, patch;
  for (const char* a : {"lights.Light.001.intensity=5", "lights.Light.002.intensity=6", "lights.light.intensity=7"}) ASSERT_TRUE(setPath(base, a).ok()) << a;
  (*base.mutable_curves())["lights.key.intensity"].add_value(1);
  (*base.mutable_expressions())["shadows.style.softness"].set_formula("time");
  const Status undone = applyMask(base, patch, {"lights.Light.001", "curves.lights.key.intensity", "expressions.shadows.style.softness"});
  ASSERT_TRUE(undone.ok()) << undone.toString();
  EXPECT_EQ(base.lights().count("Light.001"), 0u);
  EXPECT_EQ(base.lights().at("Light.002").intensity(), 6);
  EXPECT_EQ(base.lights().at("light").intensity(), 7);
  EXPECT_TRUE(base.curves().empty());
  EXPECT_TRUE(base.expressions().empty());
  // In the patch: the whole entry, also where the base has none.
  for (const char* a : {"lights.Light.001.gain=2", "lights.Light.002.gain=3"}) ASSERT_TRUE(setPath(patch, a).ok()) << a;
  ASSERT_TRUE(applyMask(base, patch, {"lights.Light.001", "lights.Light.002"}).ok());
  EXPECT_EQ(base.lights().at("Light.001").gain().x(), 2.0f);
  EXPECT_EQ(base.lights().at("Light.002").gain().x(), 3.0f);
  EXPECT_FALSE(base.lights().at("Light.002").has_intensity());
  // Shorter readings win, and a wrong field of a light stays one.
  (*base.mutable_lights())["light.intensity"].set_intensity(9);
  ASSERT_TRUE(applyMask(base, v1::RenderRequest(), {"lights.light.intensity"}).ok());
  EXPECT_FALSE(base.lights().at("light").has_intensity());
  EXPECT_EQ(base.lights().at("light.intensity").intensity(), 9);
  EXPECT_EQ(applyMask(base, patch, {"lights.light.colour"}).code(), Code::InvalidArgument);
  EXPECT_EQ(applyMask(base, patch, {"seed.x"}).code(), Code::InvalidArgument);
}

TEST(Request, SetPathsListLeaves) {
  v1::RenderRequest r;
  for (const char* a : {"lights.key.color=1,1,1", "halt.spp=4", "shadows.axis_aligned.k=2"}) ASSERT_TRUE(setPath(r, a).ok());
  const auto paths = setPaths(r);
  for (const char* p : {"lights.key.color", "halt.spp", "shadows.axis_aligned.k"}) EXPECT_NE(std::find(paths.begin(), paths.end(), p), paths.end()) << p;
  EXPECT_EQ(paths.size(), 3u);
}

TEST(Request, JsonRoundTripAndUnknownField) {
  v1::RenderRequest r, back;
  for (const char* a : {"scene=cornell", "lights.key.color=1,0.5,0", "halt.spp=4"}) ASSERT_TRUE(setPath(r, a).ok());
  ASSERT_TRUE(messageFromJson(messageToJson(r, true), back, "test").ok());
  EXPECT_EQ(messageHash(r), messageHash(back));
  const Status s = messageFromJson(R"({"scene":"cornell","bounces":3})", back, "req.json");
  EXPECT_EQ(s.code(), Code::InvalidArgument);
  EXPECT_NE(s.message().find("bounces"), std::string::npos);
  EXPECT_EQ(s.location(), "req.json");
}

}  // namespace
}  // namespace gobo
