// SPDX-License-Identifier: Apache-2.0
#include "request/styles.h"

namespace gobo {

namespace {

Status ofTechnique(v1::ShadowTechnique& shadow, const v1::ShadowTechnique* common, const std::string& field) {
  if (!shadow.has_style()) return {};
  if (shadow.has_path_traced())
    return invalidArgument(field + ".style: " + field + ".path_traced has no visibility that it could be a style of; name another technique, or none",
                           field + ".style");
  if (shadow.style().metric() == v1::ShadowStyle::SURFACE && shadow.style().hidden_layers() > 0)
    return invalidArgument(field + ".style.hidden_layers = " + std::to_string(shadow.style().hidden_layers()) +
                               ": metric SURFACE goes along what is seen; must be 0, or another metric",
                           field + ".style.hidden_layers");
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

}  // namespace gobo
