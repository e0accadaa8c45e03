// SPDX-License-Identifier: Apache-2.0
#include "request/styles.h"

namespace gobo {
inline namespace request {

namespace {

constexpr int kLeastCurve = 2, kMostCurve = 256;

/// What ranges of single fields cannot say.
Status checkCurve(const v1::ShadowStyle& style, const std::string& place) {
  const int values = style.curve_size(), least = style.transition() == v1::ShadowStyle::CURVE ? kLeastCurve : 0;
  if (values >= least && values <= kMostCurve) return {};
  const std::string field = place + ".curve";
  return invalidArgument(field + ": has " + std::to_string(values) + (values == 1 ? " value" : " values") + "; transition CURVE needs " +
                             std::to_string(kLeastCurve) + " to " + std::to_string(kMostCurve),
                         field);
}

/// What is of the world, or behind what is seen, under a metric that is not.
Status checkMetric(const v1::ShadowStyle& style, const std::string& place) {
  const auto refused = [&](const char* name, const std::string& value, const char* why) {
    return invalidArgument(
        place + "." + name + " = " + value + ": metric " + v1::ShadowStyle::Metric_Name(style.metric()) + " " + why + "; must be 0, or another metric",
        place + "." + name);
  };
  const bool screen = style.metric() == v1::ShadowStyle::SCREEN;
  if (style.hidden_layers() > 0 && (screen || style.metric() == v1::ShadowStyle::SURFACE))
    return refused("hidden_layers", std::to_string(style.hidden_layers()), "goes along what is seen");
  if (!screen) return {};
  if (style.elongation() > 0.0) return refused("elongation", std::to_string(style.elongation()), "has no lengths of the scene");
  if (style.target() > 0.0) return refused("target", std::to_string(style.target()), "has no shapes of the scene");
  if (style.keep() > 0.0) return refused("keep", std::to_string(style.keep()), "has no widths of the scene");
  return {};
}

Status ofTechnique(v1::ShadowTechnique& shadow, const v1::ShadowTechnique* common, const std::string& field) {
  if (!shadow.has_style()) return {};
  GOBO_TRY(checkCurve(shadow.style(), field + ".style"));
  if (shadow.has_path_traced())
    return invalidArgument(field + ".style: " + field + ".path_traced has no visibility that it could be a style of; name another technique, or none",
                           field + ".style");
  GOBO_TRY(checkMetric(shadow.style(), field + ".style"));
  if (shadow.technique_case() != v1::ShadowTechnique::TECHNIQUE_NOT_SET) return {};
  if (!common || common->technique_case() == v1::ShadowTechnique::TECHNIQUE_NOT_SET || common->has_path_traced()) {
    shadow.mutable_ray_traced();
    return {};
  }
  v1::ShadowTechnique whole = *common;
  whole.clear_style();
  whole.MergeFrom(shadow);
  shadow = whole;
  return {};
}

}  // namespace

Status resolveStyles(v1::RenderRequest& request) {
  if (request.has_shadows()) GOBO_TRY(ofTechnique(*request.mutable_shadows(), nullptr, "request.shadows"));
  for (auto& [name, light] : *request.mutable_lights())
    if (light.has_shadow())
      GOBO_TRY(ofTechnique(*light.mutable_shadow(), request.has_shadows() ? &request.shadows() : nullptr, "request.lights." + name + ".shadow"));
  return {};
}

}  // namespace request
}  // namespace gobo
