// SPDX-License-Identifier: Apache-2.0
#include "scene/studio.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "scene/scene.h"

namespace gobo {
inline namespace scene {

namespace {

constexpr int kWidth = 128, kHeight = 64;
constexpr double kFront = 0.9;  // radiance of a white Lambert surface that faces +Z

struct SoftBox {
  DVec3 towards;
  double cosInner, cosOuter;  // full within, none without
  double radiance;
};
const SoftBox kBoxes[] = {
    {{0.55, 0.60, 0.60}, 0.92, 0.84, 6.0},   // key
    {{-0.80, 0.25, 0.50}, 0.88, 0.76, 1.5},  // fill
    {{-0.15, 0.55, -0.90}, 0.96, 0.90, 5.0}  // rim
};

double smooth(double from, double to, double x) {
  const double t = std::clamp((x - from) / (to - from), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

double radiance(const DVec3& d) {
  double r = 0.15 + 0.30 * smooth(-0.6, 0.8, d.y);
  for (const SoftBox& b : kBoxes) r += b.radiance * smooth(b.cosOuter, b.cosInner, glm::dot(d, glm::normalize(b.towards)));
  return r;
}

EnvironmentPtr bake() {
  Image image(kWidth, kHeight, 3);
  double front = 0.0;  // irradiance
  std::vector<double> values;
  for (int j = 0; j < kHeight; ++j) {
    const double polar = std::numbers::pi * (j + 0.5) / kHeight, y = std::cos(polar), s = std::sin(polar);
    const double solidAngle = 2.0 * std::numbers::pi / kWidth * (std::cos(std::numbers::pi * j / kHeight) - std::cos(std::numbers::pi * (j + 1) / kHeight));
    for (int i = 0; i < kWidth; ++i) {
      const double azimuth = ((i + 0.5) / kWidth - 0.5) * 2.0 * std::numbers::pi;
      const DVec3 d(s * std::cos(azimuth), y, s * std::sin(azimuth));
      values.push_back(radiance(d));
      front += values.back() * std::max(d.z, 0.0) * solidAngle;
    }
  }
  const double scale = kFront * std::numbers::pi / front;
  for (size_t k = 0; k < values.size(); ++k)
    for (size_t c = 0; c < 3; ++c) image.data[k * 3 + c] = float(values[k] * scale);
  return makeEnvironment("studio", std::move(image));
}

}  // namespace

bool hasLamp(const Scene& scene) {
  const auto shines = [&](const Light& light) {
    if (light.shape.kind != LightKind::Mesh) return true;
    const Emission& emission = scene.materials[size_t(scene.meshes[size_t(scene.instances[light.shape.instance].mesh)]->material)].emission;
    return !emission.texture.valid() || maxComponent(emission.radiance) > 1.0f;
  };
  return scene.environment || std::any_of(scene.lights.begin(), scene.lights.end(), shines);
}

EnvironmentPtr studioEnvironment() {
  static const EnvironmentPtr map = bake();
  return map;
}

}  // namespace scene
}  // namespace gobo
