// SPDX-License-Identifier: Apache-2.0
// What those who stand for the environment, or show it, ask of scene and request.
#pragma once

#include "gobo/v1/render.pb.h"
#include "scene/scene.h"
#include "terms/extract_lights.h"

namespace gobo {
inline namespace request {

/// Index of the light that is the scene's environment; -1: it has none.
inline int environmentLight(const Scene& scene) {
  for (size_t l = 0; l < scene.lights.size(); ++l)
    if (scene.lights[l].shape.kind == LightKind::Environment) return int(l);
  return -1;
}

inline ExtractBy extractBy(const v1::EnvironmentSettings& sky) {
  switch (sky.extract_by()) {
    case v1::EnvironmentSettings::STRUCTURED: return ExtractBy::Structured;
    case v1::EnvironmentSettings::WAVELET: return ExtractBy::Wavelet;
    default: return ExtractBy::MedianCut;
  }
}

}  // namespace request
}  // namespace gobo
