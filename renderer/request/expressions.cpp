// SPDX-License-Identifier: Apache-2.0
#include "request/expressions.h"

#include <algorithm>
#include <cmath>

#include "base/closest.h"
#include "gobo/v1/options.pb.h"
#include "request/request.h"

namespace gobo {

namespace {

constexpr int kMostExpressions = 256;
constexpr std::string_view kStyle = "shadows.style.", kLights = "lights.", kLightStyle = ".shadow.style.";

/// The field of a style that a path ends in, and the light whose it is ("": all lights'). False: it is no such path, or of a field that does not vary from
/// place to place.
bool styleField(std::string_view path, StyleField& field, std::string_view& light) {
  std::string_view last;
  if (path.starts_with(kStyle)) {
    light = {};
    last = path.substr(kStyle.size());
  } else {
    const size_t at = path.rfind(kLightStyle);
    if (!path.starts_with(kLights) || at == std::string_view::npos || at < kLights.size()) return false;
    light = path.substr(kLights.size(), at - kLights.size());
    last = path.substr(at + kLightStyle.size());
  }
  const auto found = std::find(kStyleFields.begin(), kStyleFields.end(), last);
  if (found == kStyleFields.end()) return false;
  field = StyleField(found - kStyleFields.begin());
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
  StyleField styled;
  std::string_view light;
  const bool varies = styleField(path, styled, light);
  if (varies && !light.empty()) (void)(*request.mutable_lights())[std::string(light)].mutable_shadow()->mutable_style();
  auto field = numberField(request, path);
  if (!field.ok()) return invalidArgument(entry + ": " + field.status().message(), entry);
  if (field->width != 1) return invalidArgument(entry + ": is a vector; a formula is one number (request.curves has vectors)", entry);
  GOBO_ASSIGN(const Formula formula, Formula::parse(e.formula(), kStyleNames, place));
  if (varies && styled == StyleField::Abstraction && formula.reads(size_t(StyleName::Edge)))
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

Result<StyleFormulas> styleFormulas(const v1::RenderRequest& request, const std::string& light, const Scene& scene) {
  StyleFormulas out;
  out.time = request.has_time_s() ? request.time_s() : 0.0;
  const auto edit = request.lights().find(light);
  const bool own = edit != request.lights().end() && edit->second.has_shadow();
  const std::string prefix = own ? std::string(kLights) + light + std::string(kLightStyle) : std::string(kStyle);
  for (size_t k = 0; k < kStyleFields.size(); ++k) {
    const auto found = request.expressions().find(prefix + kStyleFields[k]);
    if (found == request.expressions().end()) continue;
    const std::string place = "request.expressions." + found->first + ".formula";
    GOBO_ASSIGN(Formula formula, Formula::parse(found->second.formula(), kStyleNames, place));
    const v1::Number range = v1::ShadowStyle::descriptor()->FindFieldByName(kStyleFields[k])->options().GetExtension(v1::number);
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
    out.all.emplace_back(StyleField(k), std::move(f));
  }
  return out;
}

}  // namespace gobo
