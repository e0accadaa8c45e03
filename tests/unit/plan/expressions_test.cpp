// SPDX-License-Identifier: Apache-2.0
// request.expressions: those over time mean the value typed in, those of styles stay, everything else is refused by name; style sheets.
#include <gtest/gtest.h>

#include "gobo/v1/options.pb.h"
#include "request/expressions.h"
#include "request/request.h"
#include "request/style_sheet.h"

namespace gobo {
namespace expressions_test {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;

v1::RenderRequest with(const std::string& path, const std::string& formula, double time = 0) {
  v1::RenderRequest r;
  if (time != 0) r.set_time_s(time);
  (*r.mutable_expressions())[path].set_formula(formula);
  return r;
}

/// Numbers that may vary, by path.
void visitNumbers(const Descriptor& d, const std::string& prefix, const std::function<void(const std::string&, const FieldDescriptor&)>& see) {
  for (int i = 0; i < d.field_count(); ++i) {
    const FieldDescriptor& f = *d.field(i);
    const std::string path = prefix.empty() ? std::string(f.name()) : prefix + "." + std::string(f.name());
    if (prefix.empty() && !mayVary(path)) continue;
    if (f.is_map()) visitNumbers(*f.message_type()->FindFieldByName("value")->message_type(), path + ".key.light", see);
    else if (f.message_type()) {
      if (f.message_type()->full_name() != "gobo.v1.Vector3") visitNumbers(*f.message_type(), path + (f.is_repeated() ? "[0]" : ""), see);
    } else if (isNumeric(&f) && !f.is_repeated()) see(path, f);
  }
}

TEST(Expressions, OverTimeMeanWhatWouldHaveBeenTypedIn) {
  int tried = 0;
  visitNumbers(*v1::RenderRequest::descriptor(), "", [&](const std::string& path, const FieldDescriptor& f) {
    const v1::Number range = f.options().GetExtension(v1::number);
    const double low = (range.has_min() ? range.min() : -3.0) + (range.exclusive_min() ? 1 : 0),
                 high = range.has_max() ? std::min(range.max(), low + 8.0) : low + 8.0;
    v1::RenderRequest typed, asked;
    const size_t dot = path.rfind('.');
    if (path.starts_with("filters") || (path.find("shadow") != std::string::npos && path.find(".map.") == std::string::npos)) {
      ASSERT_TRUE(setPath(typed, path.substr(0, dot) + "=").ok()) << path;
    }
    typed.set_time_s(0.25);
    asked = typed;
    const bool integer = f.cpp_type() != FieldDescriptor::CPPTYPE_DOUBLE && f.cpp_type() != FieldDescriptor::CPPTYPE_FLOAT;
    const double value = low + (high - low) * 0.25;
    char text[160];
    std::snprintf(text, sizeof text, "%s=%.17g", path.c_str(), integer ? std::round(value) : value);
    ASSERT_TRUE(setPath(typed, text).ok()) << path;
    std::snprintf(text, sizeof text, "%.17g + (%.17g - %.17g) * time", low, high, low);
    (*asked.mutable_expressions())[path].set_formula(text);
    const Status s = applyExpressions(asked);
    ASSERT_TRUE(s.ok()) << path << ": " << s.toString();
    EXPECT_TRUE(asked.expressions().empty());
    EXPECT_EQ(messageToJson(asked, false), messageToJson(typed, false)) << path;
    ++tried;
    if (!range.has_max()) return;
    (*asked.mutable_expressions())[path].set_formula("1e30 + time");
    const Status refused = applyExpressions(asked);
    EXPECT_EQ(refused.code(), Code::InvalidArgument) << path;
    EXPECT_NE(refused.message().find("request.expressions." + path + ".formula"), std::string::npos) << refused.toString();
  });
  EXPECT_GT(tried, 100);
}

TEST(Expressions, OfStylesOverTermsStay) {
  for (const char* field : {"inflation", "softness", "brightness", "abstraction"})
    for (const std::string prefix : {"shadows.style.", "lights.a.b.shadow.style."}) {
      v1::RenderRequest r = with(prefix + field, "0.1 * distance + time");
      ASSERT_TRUE(applyExpressions(r).ok()) << prefix << field;
      EXPECT_EQ(r.expressions().size(), 1u);
      EXPECT_TRUE(prefix == "shadows.style." ? r.shadows().has_style() : r.lights().at("a.b").shadow().has_style());
      EXPECT_TRUE(expressionsMove(r));
      const std::string once = r.SerializeAsString();
      ASSERT_TRUE(applyExpressions(r).ok());
      EXPECT_EQ(r.SerializeAsString(), once) << "a resolved request is one";
    }
  v1::RenderRequest still = with("shadows.style.softness", "0.1 * distance");
  ASSERT_TRUE(applyExpressions(still).ok());
  EXPECT_FALSE(expressionsMove(still));
  v1::RenderRequest number = with("shadows.style.softness", "0.1 + time", 2);
  ASSERT_TRUE(applyExpressions(number).ok());
  EXPECT_TRUE(number.expressions().empty());
  EXPECT_EQ(number.shadows().style().softness(), 2.1);
}

TEST(Expressions, WhatCannotBeIsRefusedByName) {
  const auto refused = [](const std::string& path, const std::string& formula, const std::string& location, const std::string& words) {
    v1::RenderRequest r = with(path, formula);
    const Status s = applyExpressions(r);
    ASSERT_EQ(s.code(), Code::InvalidArgument) << path;
    EXPECT_EQ(s.location(), "request.expressions." + path + location) << s.toString();
    EXPECT_NE(s.message().find(words), std::string::npos) << s.toString();
  };
  for (const char* path : {"width", "seed", "halt.spp", "time_s", "window.x", "expressions", ""}) refused(path, "1", "", "only numbers of camera");
  refused("lights.key.intensty", "1", "", "did you mean 'intensity'?");
  refused("lights.key.color", "1", "", "is a vector");
  refused("lights.key.kind", "1", "", "neither a number nor a vector");
  refused("shadows.exponential.c", "1", "", "'exponential' is not what the request chooses");
  refused("lights.key.intensity", "depth", ".formula", "reads depth, which is of a place");
  refused("lights.key.intensity", "object(\"a\")", ".formula", "reads object(\"a\"), which is of a place");
  refused("shadows.style.power", "distance", ".formula", "reads distance, which is of a place");
  refused("shadows.style.abstraction", "edge", ".formula", "reads edge, which abstraction makes");
  refused("lights.key.intensity", "1 - 2", ".formula at time 0.000000", "at least 0");
  refused("lights.key.intensity", "1 / time", ".formula at time 0.000000", "finite");
  refused("lights.key.intensity", "tim", ".formula", "did you mean 'time'?");
  refused("lights.key.intensity", "", ".formula", "is empty");
  v1::RenderRequest crowd;
  for (int k = 0; k < 257; ++k) (*crowd.mutable_expressions())["lights.l" + std::to_string(k) + ".intensity"].set_formula("1");
  EXPECT_EQ(applyExpressions(crowd).location(), "request.expressions");
}

TEST(Expressions, ObjectsAreThoseOfTheScene) {
  Scene scene;
  scene.name = "three";
  for (const char* name : {"ball", "ball#1", "ballast"}) {
    Instance i;
    i.name = name;
    scene.instances.push_back(i);
  }
  v1::RenderRequest r = with("shadows.style.softness", "object(\"ball\")");
  ASSERT_TRUE(applyExpressions(r).ok());
  const auto found = styleFormulas(r, "key", scene);
  ASSERT_TRUE(found.ok());
  ASSERT_EQ(found->all.size(), 1u);
  ASSERT_EQ(found->all[0].second.objects.size(), 1u);
  EXPECT_EQ(found->all[0].second.objects[0].instances, (std::vector<uint32_t>{0, 1})) << "its parts, and nothing that begins like it";
  EXPECT_EQ(found->all[0].second.objects[0].caster, -1);
  v1::RenderRequest casters = with("shadows.style.softness", "caster(\"ballast\") + caster(\"ball\")");
  (*casters.mutable_expressions())["shadows.style.inflation"].set_formula("caster(\"ball#1\")");
  ASSERT_TRUE(applyExpressions(casters).ok());
  const auto cast = styleFormulas(casters, "key", scene);
  ASSERT_TRUE(cast.ok());
  EXPECT_EQ(cast->casters, (std::vector<std::vector<uint32_t>>{{1}, {2}, {0, 1}})) << "of all formulas of a style, which go by field";
  EXPECT_EQ(cast->find(StyleField::Softness)->objects[1].caster, 2);
  EXPECT_TRUE(cast->find(StyleField::Softness)->readsEdges());
  Scene many = scene;
  many.instances.resize(4);
  many.instances[3].name = "four";
  (*casters.mutable_expressions())["shadows.style.brightness"].set_formula("caster(\"four\")");
  EXPECT_NE(styleFormulas(casters, "key", many).status().message().find("at most 3 casters"), std::string::npos);
  EXPECT_EQ(found->all[0].second.low, 0.0) << "range of the field";
  (*r.mutable_lights())["key"].mutable_shadow();
  EXPECT_TRUE(styleFormulas(r, "key", scene)->all.empty()) << "a light with a shadow of its own has not the formulas of all";
  v1::RenderRequest far = with("shadows.style.softness", "object(\"bal\")");
  ASSERT_TRUE(applyExpressions(far).ok());
  const auto none = styleFormulas(far, "key", scene);
  EXPECT_EQ(none.status().location(), "request.expressions.shadows.style.softness.formula");
  EXPECT_NE(none.status().message().find("did you mean 'ball'?"), std::string::npos) << none.status().toString();
}

TEST(StyleSheets, ChangeStylesAndNothingElse) {
  v1::RenderRequest r;
  for (const char* a :
       {"lights.key.intensity=3", "lights.key.shadow.style.brightness=0.5", "shadows.variance=", "shadows.style.softness=1", "shadows.style.inflation=2"})
    ASSERT_TRUE(setPath(r, a).ok());
  const std::string sheet =
      R"({"shadows": {"style": {"softness": 0.1, "layers": [{"softness": 0.3}]}}, "lights": {"key": {"shadow": {"style": {"softness": 0.2}}}},
                              "expressions": {"shadows.style.brightness": {"formula": "0.1*distance"}}})";
  ASSERT_TRUE(applyStyleSheet(r, sheet, "sheet.json").ok());
  EXPECT_EQ(r.shadows().style().softness(), 0.1);
  EXPECT_EQ(r.shadows().style().inflation(), 2.0) << "what a sheet does not say stays";
  EXPECT_EQ(r.shadows().style().layers_size(), 1);
  EXPECT_TRUE(r.shadows().has_variance());
  EXPECT_EQ(r.lights().at("key").intensity(), 3.0);
  EXPECT_EQ(r.lights().at("key").shadow().style().brightness(), 0.5);
  EXPECT_EQ(r.lights().at("key").shadow().style().softness(), 0.2);
  EXPECT_EQ(r.expressions().at("shadows.style.brightness").formula(), "0.1*distance");
  const std::string before = messageToJson(r, false);
  for (const auto& [text, words] : std::vector<std::pair<std::string, std::string>>{
           {R"({"width": 3})", "width is no field of a style"},
           {R"({"shadows": {"variance": {}}})", "shadows.variance is no field of a style"},
           {R"({"lights": {"key": {"intensity": 2}}})", "lights.key.intensity is no field of a style"},
           {R"({"expressions": {"camera.yfov_deg": {"formula": "30"}}})", "expressions.camera.yfov_deg.formula is no field of a style"},
           {R"({"shadows": {"stile": {}}})", "stile"},
           {"{", "JSON"},
       }) {
    const Status s = applyStyleSheet(r, text, "sheet.json");
    EXPECT_EQ(s.code(), Code::InvalidArgument) << text;
    EXPECT_NE(s.message().find(words), std::string::npos) << s.toString();
    EXPECT_EQ(messageToJson(r, false), before) << "nothing half-written";
  }
}

}  // namespace expressions_test
}  // namespace gobo
