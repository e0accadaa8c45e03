// SPDX-License-Identifier: Apache-2.0
// Direct light of every extension by terms (front: direct_unoccluded with nothing in the way; behind: traced) against direct
// light by the path tracer, pixel by pixel: standard scores of the difference.
#include <gtest/gtest.h>

#include <cmath>

#include "support/run_node.h"
#include "support/tiny_scenes.h"
#include "terms/direct_unoccluded.h"
#include "terms/gbuffer.h"
#include "terms/surface.h"

namespace gobo {
namespace {

using namespace tests;

constexpr int kSize = 8, kBlocks = 24;

struct Pixel {
  DVec3 mean{0.0}, error{0.0};
};

std::vector<Pixel> traced(const Traced& t) {
  const auto tracer = t.tracer();
  std::vector<Pixel> out;
  for (int p = 0; p < kSize * kSize; ++p) {
    DVec3 s(0.0), q(0.0);
    uint64_t rays = 0, dropped = 0;
    for (int b = 0; b < kBlocks; ++b) {
      double sum[3] = {};
      tracer->traceBlock(p % kSize, p / kSize, uint32_t(b) * kBlocksPerStream, sum, rays, dropped);
      const DVec3 v = DVec3(sum[0], sum[1], sum[2]) / double(t.settings.blockSize);
      s += v / double(kBlocks);
      q += v * v / double(kBlocks);
    }
    EXPECT_EQ(dropped, 0u);
    out.push_back({s, glm::sqrt(glm::max(q - s * s, DVec3(0.0)) / double(kBlocks - 1))});
  }
  return out;
}

std::vector<DVec3> byTerms(const Traced& t) {
  GBufferSettings view;
  view.camera = t.settings.camera;
  view.width = view.height = kSize;
  view.viewSamples = 1;
  NodeRunner run(*t.scene, t.arena);
  const TermPtr g = run(makeGBufferNode(view), {}, {}), surface = run(makeSurfaceNode(view), {g}, {});
  std::vector<DVec3> sum(kSize * kSize, DVec3(0.0));
  for (size_t l = 0; l < t.scene->lights.size(); ++l) {
    DirectUnoccludedSettings s;
    s.view = view;
    s.light = int(l);
    s.nominal = t.settings.nominal[l];
    s.samples = 1024;
    s.extended = true;
    const TermPtr L = run(makeDirectUnoccludedNode(s), {g, surface}, {int(l)});
    for (size_t p = 0; p < sum.size(); ++p)
      for (int c = 0; c < 3; ++c) sum[p][c] += L->floats("L")[3 * p + size_t(c)];
  }
  return sum;
}

class ExtendedDirect : public ::testing::TestWithParam<std::pair<const char*, std::function<void(Bsdf&)>>> {};

TEST_P(ExtendedDirect, TermsEqualThePathTracerPixelByPixel) {
  SceneMaker m;
  auto bumps = std::make_shared<Texture>();  // two tilted normals, for maps
  bumps->name = "bumps";
  bumps->width = 2;
  bumps->height = 1;
  bumps->nearest = true;
  bumps->texels8 = {150, 128, 250, 255, 128, 100, 250, 255};
  sealTexture(*bumps);
  m.scene.textures.push_back(bumps);
  m.instance(m.mesh(quad(Vec3(-2, 0, 2), Vec3(4, 0, 0), Vec3(0, 0, -4)), m.material(Vec3(0.7f, 0.5f, 0.3f), [&](Material& x) {
    x.bsdf = {};
    x.bsdf.roughness = 0.5f;
    GetParam().second(x.bsdf);
  })));
  for (const float side : {1.0f, -1.0f}) {
    LightShape s;
    s.kind = LightKind::Rect;
    s.position = Vec3(0.6f, 1.5f * side, -0.8f);
    s.axis = Vec3(0, -side, 0);
    s.u = Vec3(0.5f, 0, 0);
    s.v = Vec3(0, 0, 0.4f);
    m.light(s, Vec3(4, 5, 6));
    LightShape p;
    p.position = Vec3(-0.8f, side, 0.3f);
    m.light(p, Vec3(2, 1, 3));
  }
  m.camera(Vec3(0, 1.2f, 3), Vec3(0, 0, 0.2f), 0.7f);
  Traced t(m.finish(), kSize, kSize);
  t.settings.viewSamples = 1;
  t.settings.cover = PathClass::Direct;
  const std::vector<Pixel> truth = traced(t);
  t.settings.behindOnly = true;
  const std::vector<Pixel> behind = traced(t);
  const std::vector<DVec3> front = byTerms(t);
  double squares = 0, total = 0, through = 0;
  int n = 0;
  for (size_t p = 0; p < truth.size(); ++p)
    for (int c = 0; c < 3; ++c) {
      const double mean = truth[p].mean[c], difference = front[p][c] + behind[p].mean[c] - mean;
      const double sigma = std::hypot(std::hypot(truth[p].error[c], behind[p].error[c]), 5e-3 * mean + 1e-7);  // the terms' own points: half a percent
      const double z = difference / sigma;
      EXPECT_LT(std::fabs(z), 6.5) << GetParam().first << " pixel " << p << " channel " << c << ": " << front[p][c] << " + " << behind[p].mean[c] << " for "
                                   << mean;
      squares += z * z;
      total += mean;
      through += behind[p].mean[c];
      ++n;
    }
  EXPECT_LT(std::sqrt(squares / n), 1.35) << GetParam().first;
  EXPECT_GT(total / n, 1e-2) << GetParam().first;
  if (std::string(GetParam().first).find("transmission") != std::string::npos) EXPECT_GT(through / n, 1e-3);
  else EXPECT_EQ(through, 0.0);
}

INSTANTIATE_TEST_SUITE_P(Extensions, ExtendedDirect,
                         ::testing::Values(std::pair{"specular_colour", std::function<void(Bsdf&)>([](Bsdf& b) { b.specularColor = Vec3(1.0f, 0.3f, 2.0f); })},
                                           std::pair{"clearcoat", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.clearcoat = 0.8f;
                                                       b.clearcoatRoughness = 0.4f;
                                                       b.normal.texture = 0;
                                                     })},
                                           std::pair{"clearcoat_normal", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.clearcoat = 1;
                                                       b.clearcoatRoughness = 0.3f;
                                                       b.clearcoatNormal.texture = 0;
                                                     })},
                                           std::pair{"sheen", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.sheenColor = Vec3(0.8f, 0.5f, 0.9f);
                                                       b.sheenRoughness = 0.4f;
                                                     })},
                                           std::pair{"anisotropy", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.metallic = 1;
                                                       b.anisotropy = 0.8f;
                                                       b.anisotropyRotation = 0.6f;
                                                     })},
                                           std::pair{"iridescence", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.metallic = 0.5f;
                                                       b.iridescence = 1;
                                                     })},
                                           std::pair{"thin_transmission", std::function<void(Bsdf&)>([](Bsdf& b) { b.transmission = 0.8f; })},
                                           std::pair{"rough_solid_transmission", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.transmission = 1;
                                                       b.thickness = 1;
                                                     })},
                                           std::pair{"dispersive_transmission", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.transmission = 1;
                                                       b.thickness = 1;
                                                       b.dispersion = 6;
                                                     })},
                                           std::pair{"diffuse_transmission", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.diffuseTransmission = 0.6f;
                                                       b.diffuseTransmissionColor = Vec3(0.9f, 0.2f, 0.5f);
                                                     })},
                                           std::pair{"diffuse_transmission_of_a_volume", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.diffuseTransmission = 0.6f;
                                                       b.thickness = 1;
                                                     })},
                                           std::pair{"coat_on_sheen_on_thin_transmission", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.transmission = 0.7f;
                                                       b.clearcoat = 0.5f;
                                                       b.clearcoatRoughness = 0.5f;
                                                       b.sheenColor = Vec3(0.3f);
                                                       b.sheenRoughness = 0.6f;
                                                     })},
                                           std::pair{"steeply_mapped_metal", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.metallic = 1;
                                                       b.normal.texture = 0;
                                                       b.normalScale = 8;
                                                     })},
                                           std::pair{"steeply_mapped_brushed_metal", std::function<void(Bsdf&)>([](Bsdf& b) {
                                                       b.metallic = 1;
                                                       b.anisotropy = 0.6f;
                                                       b.normal.texture = 0;
                                                       b.normalScale = 8;
                                                     })},
                                           std::pair{"plain", std::function<void(Bsdf&)>([](Bsdf&) {})}),
                         [](const auto& info) { return info.param.first; });

}  // namespace
}  // namespace gobo
