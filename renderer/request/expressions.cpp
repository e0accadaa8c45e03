// SPDX-License-Identifier: Apache-2.0
#include "request/expressions.h"

#include <algorithm>
#include <cmath>

#include "base/closest.h"
#include "gobo/v1/options.pb.h"
#include "request/request.h"

namespace gobo {
inline namespace request {

namespace {

constexpr int kMostExpressions = 256;
constexpr std::string_view kStyle = "shadows.style.", kLights = "lights.", kLightStyle = ".shadow.style.", kLayers = "layers[";

/// A number of a style that may vary from place to place.
struct StyledNumber {
  std::string_view light;  ///< whose style; "": all lights'
  int layer = -1;          ///< -1: the style's own
  StyleField field = StyleField::Inflation;
};

/// "layers[K]." taken off `text`. False: it begins otherwise. Indices are as they are counted: [01] is none.
bool styleLayerOf(std::string_view& text, int& layer) {
  if (!text.starts_with(kLayers)) return false;
  const size_t end = text.find("].");
  if (end == std::string_view::npos) return false;
  const std::string_view digits = text.substr(kLayers.size(), end - kLayers.size());
  if (digits.empty() || digits.size() > 6 || (digits.size() > 1 && digits[0] == '0') || digits.find_first_not_of("0123456789") != std::string_view::npos)
    return false;
  layer = std::stoi(std::string(digits));
  text.remove_prefix(end + 2);
  return true;
}

/// What a path ends in. False: it is no such path, or of a field that does not vary from place to place.
bool styledNumber(std::string_view path, StyledNumber& out) {
  std::string_view last;
  if (path.starts_with(kStyle)) {
    last = path.substr(kStyle.size());
  } else {
    const size_t at = path.rfind(kLightStyle);
    if (!path.starts_with(kLights) || at == std::string_view::npos || at < kLights.size()) return false;
    out.light = path.substr(kLights.size(), at - kLights.size());
    last = path.substr(at + kLightStyle.size());
  }
  const bool ofLayer = styleLayerOf(last, out.layer);
  const auto end = kStyleFields.begin() + ptrdiff_t(ofLayer ? kLayerFields : kStyleFields.size());
  const auto found = std::find(kStyleFields.begin(), end, last);
  if (found == end) return false;
  out.field = StyleField(found - kStyleFields.begin());
  return true;
}

Status unchanging(const Formula& f, const std::string& path, const std::string& place) {
  std::string read = f.objects().empty() ? "" : (f.objects()[0].caster ? "caster(\"" : "object(\"") + f.objects()[0].name + "\")";
  for (size_t k = 1; k < kStyleNames.size() && read.empty(); ++k)
    if (f.reads(k)) read = kStyleNames[k];
  if (read.empty()) return {};
  return invalidArgument(place + ": reads " + read + ", which is of a place: " + path + " is one number for all of them (those of shadows.style vary)", place);
}

Status applyExpression(v1::RenderRequest& request, const std::string& path, const v1::Expression& e, double time) {
  const std::string entry = "request.expressions." + path, place = entry + ".formula";
  if (!mayVary(path))
    return invalidArgument(entry + ": only numbers of camera, lights, environment, shadows, tone_map, integrator, meshes and filters have expressions", entry);
  StyledNumber styled;
  const bool varies = styledNumber(path, styled);
  if (varies && !styled.light.empty()) (void)(*request.mutable_lights())[std::string(styled.light)].mutable_shadow()->mutable_style();
  auto field = numberField(request, path);
  if (!field.ok()) return invalidArgument(entry + ": " + field.status().message(), entry);
  if (field->width != 1) return invalidArgument(entry + ": is a vector; a formula is one number (request.curves has vectors)", entry);
  GOBO_ASSIGN(const Formula formula, Formula::parse(e.formula(), kStyleNames, place));
  if (varies && styled.field == StyleField::Abstraction && formula.reads(size_t(StyleName::Edge)))
    return invalidArgument(place + ": reads edge, which abstraction makes", place);
  if (varies && !unchanging(formula, path, place).ok()) {
    const double none = 0;  // what the field itself says is not asked; a style must be there
    setNumberField(*field, &none);
    (*request.mutable_expressions())[path] = e;
    return {};
  }
  GOBO_TRY(unchanging(formula, path, place));
  Formula::Evaluator evaluator(formula);
  evaluator.name(size_t(StyleName::Time)) = time;
  const double value = evaluator();
  GOBO_TRY(checkNumberField(*field, &value, place + " at time " + std::to_string(time)));
  setNumberField(*field, &value);
  return {};
}

}  // namespace

bool mayVary(std::string_view path) {
  const std::string_view root = path.substr(0, path.find_first_of(".["));
  constexpr std::string_view roots[] = {"camera", "lights", "environment", "shadows", "tone_map", "integrator", "meshes", "filters"};
  return std::find(std::begin(roots), std::end(roots), root) != std::end(roots);
}

Status applyExpressions(v1::RenderRequest& request) {
  if (request.expressions().empty()) return {};
  if (request.expressions_size() > kMostExpressions)
    return invalidArgument("request.expressions: " + std::to_string(request.expressions_size()) + " expressions, at most " + std::to_string(kMostExpressions),
                           "request.expressions");
  const double time = request.has_time_s() ? request.time_s() : 0.0;
  std::vector<std::pair<std::string, v1::Expression>> all(request.expressions().begin(), request.expressions().end());
  std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.first < b.first; });  // the first error is always the same one
  request.clear_expressions();
  for (const auto& [path, expression] : all) GOBO_TRY(applyExpression(request, path, expression, time));
  return {};
}

bool expressionsMove(const v1::RenderRequest& request) {
  for (const auto& [path, e] : request.expressions()) {
    const Result<Formula> f = Formula::parse(e.formula(), kStyleNames, path);
    if (f.ok() && f->reads(size_t(StyleName::Time))) return true;
  }
  return false;
}

namespace {

/// The formula of one field, with the objects that it names.
Result<StyleFormula> styleFormula(const std::string& path, const v1::Expression& e, const char* field, const google::protobuf::Descriptor* of,
                                  const Scene& scene, StyleFormulas& out) {
  const std::string place = "request.expressions." + path + ".formula";
  GOBO_ASSIGN(Formula formula, Formula::parse(e.formula(), kStyleNames, place));
  const v1::Number range = of->FindFieldByName(field)->options().GetExtension(v1::number);
  StyleFormula f{std::move(formula), range.min(), range.max(), place};
  for (const auto& [object, caster] : f.formula.objects()) {
    StyleFormula::Object found;
    std::vector<uint32_t>& instances = found.instances;
    std::vector<std::string> known;
    for (size_t i = 0; i < scene.instances.size(); ++i) {
      const std::string& name = scene.instances[i].name;
      known.push_back(name);
      if (name == object || (name.starts_with(object) && name[object.size()] == '#')) instances.push_back(uint32_t(i));
    }
    if (instances.empty()) return invalidArgument(place + ": no object '" + object + "' in the scene" + didYouMean(object, known), place);
    if (caster) {
      found.caster = int(std::find(out.casters.begin(), out.casters.end(), instances) - out.casters.begin());
      if (size_t(found.caster) == out.casters.size()) out.casters.push_back(instances);
      if (out.casters.size() > kMostCasters)
        return invalidArgument(
            place + ": caster(\"" + object + "\") is one too many: formulas of one style name at most " + std::to_string(kMostCasters) + " casters", place);
    }
    f.objects.push_back(std::move(found));
  }
  return f;
}

}  // namespace

Result<StyleFormulas> styleFormulas(const v1::RenderRequest& request, const std::string& light, const Scene& scene) {
  StyleFormulas out;
  out.time = request.has_time_s() ? request.time_s() : 0.0;
  const auto edit = request.lights().find(light);
  const bool own = edit != request.lights().end() && edit->second.has_shadow();
  const std::string prefix = own ? std::string(kLights) + light + std::string(kLightStyle) : std::string(kStyle);
  const auto add = [&](const std::string& group, const char* field, const google::protobuf::Descriptor* of, StyleFormulaList& list) -> Status {
    const auto found = request.expressions().find(group + field);
    if (found == request.expressions().end()) return {};
    GOBO_ASSIGN(StyleFormula f, styleFormula(found->first, found->second, field, of, scene, out));
    list.emplace_back(StyleField(std::find(kStyleFields.begin(), kStyleFields.end(), std::string_view(field)) - kStyleFields.begin()), std::move(f));
    return {};
  };
  for (const char* field : kStyleFields) GOBO_TRY(add(prefix, field, v1::ShadowStyle::descriptor(), out.all));
  out.layers.resize(size_t((own ? edit->second.shadow() : request.shadows()).style().layers_size()));
  for (size_t l = 0; l < out.layers.size(); ++l)
    for (size_t k = 0; k < kLayerFields; ++k)
      GOBO_TRY(add(prefix + std::string(kLayers) + std::to_string(l) + "].", kStyleFields[k], v1::ShadowStyleLayer::descriptor(), out.layers[l]));
  return out;
}

}  // namespace request
}  // namespace gobo
