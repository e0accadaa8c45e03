// SPDX-License-Identifier: Apache-2.0
// Ambient light against a sum over the sphere of the map that its coefficients describe, seen through Environment::eval, which owns what a
// turned map is.
#include "filters/ambient_light.h"

#include <gtest/gtest.h>

#include <cmath>

#include "scene/environment.h"
#include "terms/surface.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

/// Y_lm in the order of formulas/harmonics.glsl.h, written out again.
std::array<double, 9> basis(const DVec3& d) {
  return {0.28209479177387814,
          0.4886025119029199 * d.y,
          0.4886025119029199 * d.z,
          0.4886025119029199 * d.x,
          1.0925484305920792 * d.x * d.y,
          1.0925484305920792 * d.y * d.z,
          0.31539156525252005 * (3 * d.z * d.z - 1),
          1.0925484305920792 * d.x * d.z,
          0.5462742152960396 * (d.x * d.x - d.y * d.y)};
}

TEST(AmbientLight, IsTheSumOverTheTurnedMap) {
  AmbientLightSettings s;
  s.rotation = 0.7f;
  s.width = 6;
  s.height = 4;
  s.viewSamples = 2;
  for (int k = 0; k < 9; ++k)
    for (int c = 0; c < 3; ++c) s.radiance[size_t(k)][c] = (toUnit(hash32(3, uint64_t(3 * k + c))) - 0.5f) * 0.4f;
  for (int c = 0; c < 3; ++c) s.radiance[0][c] = 5.0f + float(c);  // positive everywhere
  const int width = 512, height = 256;
  Image image(width, height, 3);
  Environment unturned;
  unturned.width = width;
  unturned.height = height;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const auto b = basis(DVec3(unturned.toDirection(Vec2((x + 0.5f) / width, (y + 0.5f) / height))));
      for (int c = 0; c < 3; ++c) {
        double l = 0;
        for (int k = 0; k < 9; ++k) l += b[size_t(k)] * double(s.radiance[size_t(k)][c]);
        image.data[(size_t(y) * width + x) * 3 + c] = float(l);
      }
    }
  auto turned = std::make_shared<Environment>(*makeEnvironment("harmonics", std::move(image)));
  turned->rotation = s.rotation;

  PlaneView view;
  view.width = s.width;
  view.height = s.height;
  view.layers = s.viewSamples;
  const auto g = planeGBuffer(view);
  const Extent e{s.width, s.height, s.viewSamples};
  auto surface = std::make_shared<Term>("surface", Domain::ViewSample, e);
  auto albedo = surface->addPlane<float>("albedo", 3), material = surface->addPlane<float>("material", 5), N = surface->addPlane<float>("N", 3);
  auto flags = surface->addPlane<uint8_t>("flags");
  auto random = [n = 0u]() mutable { return toUnit(hash32(9, uint64_t(n++))); };
  for (size_t i = 0; i < e.elements(); ++i) {
    const Vec3 n = glm::normalize(Vec3(random() - 0.5f, random() - 0.5f, random() - 0.5f));
    for (int c = 0; c < 3; ++c) {
      N[3 * i + c] = n[c];
      albedo[3 * i + c] = 0.2f + 0.6f * random();
    }
    material[5 * i] = i % 3 == 0 ? 0.25f : 0.0f;
    material[5 * i + 4] = i % 4 == 0 ? 0.5f : 0.0f;
  }
  g->writable<uint32_t>("instance")[1] = ~0u;
  flags[2] = kSurfaceUnlit;
  const auto out = runFilter(makeAmbientLightNode(s), {g, surface});
  const auto rgb = out->floats("rgb");
  const size_t pixels = size_t(s.width) * size_t(s.height);
  const int rings = 96;
  for (size_t p = 0; p < pixels; ++p) {
    DVec3 expected(0.0);
    for (size_t layer = 0; layer < 2; ++layer) {
      const size_t i = layer * pixels + p;
      if (i == 1 || i == 2) continue;
      const DVec3 n(N[3 * i], N[3 * i + 1], N[3 * i + 2]);
      DVec3 irradiance(0.0);
      for (int a = 0; a < rings; ++a)
        for (int b = 0; b < 2 * rings; ++b) {
          const double z = 1 - 2 * (a + 0.5) / rings, phi = M_PI * (b + 0.5) / rings, r = std::sqrt(1 - z * z);
          const DVec3 w(r * std::cos(phi), z, r * std::sin(phi));
          irradiance += DVec3(turned->eval(Vec3(w))) * std::max(glm::dot(w, n), 0.0) * (4 * M_PI / (2.0 * rings * rings));
        }
      const double kept = (1.0 - double(material[5 * i])) * (1.0 - double(material[5 * i + 4])) / M_PI / 2;
      for (int c = 0; c < 3; ++c) expected[c] += kept * double(albedo[3 * i + c]) * irradiance[c];
    }
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(rgb[3 * p + c], expected[c], 2e-3 * expected[c] + 1e-9) << "pixel " << p << " channel " << c;
  }
}

TEST(AmbientLight, CoefficientsAndTurnAreInTheKey) {
  const auto key = [](const AmbientLightSettings& s) {
    Hasher h("parameters");
    makeAmbientLightNode(s)->hashParameters(h);
    return h.digest().hex();
  };
  AmbientLightSettings base;
  for (int k = 0; k < 9; ++k) {
    AmbientLightSettings other = base;
    other.radiance[size_t(k)].z = 1.0f;
    EXPECT_NE(key(base), key(other)) << k;
  }
  AmbientLightSettings turned = base;
  turned.rotation = 1.0f;
  EXPECT_NE(key(base), key(turned));
}

}  // namespace
}  // namespace gobo
