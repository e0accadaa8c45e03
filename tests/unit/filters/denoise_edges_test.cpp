// SPDX-License-Identifier: Apache-2.0
// Pixels that surfaces share: which they are, and that each view sample takes the light of the surface that it is on.
#include <gtest/gtest.h>

#include <limits>

#include "filters/denoise/features.h"
#include "filters/denoise/view_sample_edges.h"
#include "terms/term.h"

namespace gobo {
namespace denoise_edges_test {

constexpr int kW = 12, kH = 8, kS = 4;

TermPtr run(const NodePtr& node, std::vector<TermPtr> inputs) {
  const TaskArena arena(2);
  RunContext c;
  c.inputs = std::move(inputs);
  c.arena = &arena;
  Result<TermPtr> r = runNode(*node, c);
  EXPECT_TRUE(r.ok()) << r.status().toString();
  return r.ok() ? *r : nullptr;
}

/// View samples of a white wall 2 m behind a dark metal one whose edge runs through the samples of column 5: three of its four see the wall in front.
struct Edge {
  std::shared_ptr<Term> seen = std::make_shared<Term>("gbuffer", Domain::ViewSample, Extent{kW, kH, kS});
  std::shared_ptr<Term> surface = std::make_shared<Term>("surface", Domain::ViewSample, Extent{kW, kH, kS});
  std::shared_ptr<Term> light = std::make_shared<Term>("denoised", Domain::Pixel, Extent{kW, kH, 1});
  std::span<float> P, N, depth, footprint, albedo, material, facing, rgb;
  std::span<uint8_t> flags;
  Edge() {
    P = seen->addPlane<float>("P", 3), N = seen->addPlane<float>("N", 3), depth = seen->addPlane<float>("depth"),
    footprint = seen->addPlane<float>("footprint");
    albedo = surface->addPlane<float>("albedo", 3), material = surface->addPlane<float>("material", 5), facing = surface->addPlane<float>("N", 3);
    flags = surface->addPlane<uint8_t>("flags");
    rgb = light->addPlane<float>("rgb", 3);
    for (int s = 0; s < kS; ++s)
      for (int y = 0; y < kH; ++y)
        for (int x = 0; x < kW; ++x) {
          const size_t p = size_t(y * kW + x), i = size_t(s) * kW * kH + p;
          const bool front = x < 5 || (x == 5 && s < 3);
          P[3 * i] = float(x) + 0.25f * float(s), P[3 * i + 1] = float(y), P[3 * i + 2] = front ? 0.0f : -200.0f;
          N[3 * i + 2] = facing[3 * i + 2] = 1;
          depth[i] = front ? 10 : 210, footprint[i] = 1;
          for (size_t c = 0; c < 3; ++c) albedo[3 * i + c] = front ? 0.2f : 0.9f;
          material[5 * i] = front ? 1.0f : 0.0f, material[5 * i + 1] = 0.5f, material[5 * i + 2] = 1;
          for (size_t c = 0; c < 3; ++c) rgb[3 * p + c] = x < 5 ? 2.0f : x == 5 ? 77.0f : 6.0f;
        }
  }
  TermPtr features(LobePart lobe) const { return run(denoise::makeFeaturesNode(kW, kH, kS, lobe), {seen, surface}); }
  TermPtr edges(LobePart lobe) const { return run(denoise::makeViewSampleEdgesNode(kW, kH, kS, lobe), {features(lobe), light, seen, surface}); }
};

TEST(DenoiseEdges, FeaturesSayWhereOneSurfaceIs) {
  Edge e;
  e.depth[3] = std::numeric_limits<float>::infinity();                                                             // column 3, row 0: a sample misses
  for (int s = 0; s < 2; ++s) e.N[3 * (size_t(s) * kW * kH + 8) + 2] = 0, e.N[3 * (size_t(s) * kW * kH + 8)] = 1;  // column 8, row 0: two face elsewhere
  for (int s = 0; s < kS; ++s) e.P[3 * (size_t(s) * kW * kH + 9) + 2] += 0.8f * float(s);  // column 9, row 0: no plane within a pixel's width
  const TermPtr f = e.features(LobePart::Both);
  for (int y = 0; y < kH; ++y)
    for (int x = 0; x < kW; ++x) {
      const bool even = x != 5 && !(y == 0 && (x == 3 || x == 8)) && !(y == 0 && x == 9);
      EXPECT_EQ(f->floats("even")[size_t(y * kW + x)], even ? 1.0f : 0.0f) << x << ", " << y;
    }
  EXPECT_FALSE(f->hasPlane("alpha"));
}

TEST(DenoiseEdges, ModulationIsThatOfTheLobe) {
  const Edge e;
  const TermPtr both = e.features(LobePart::Both), diffuse = e.features(LobePart::Diffuse), specular = e.features(LobePart::Specular);
  const auto at = [](const TermPtr& t, const char* plane, int x) { return t->floats(plane)[size_t(x) * (t->channels(plane) == 3 ? 3 : 1)]; };
  EXPECT_FLOAT_EQ(at(both, "modulation", 2), 0.24f);
  EXPECT_FLOAT_EQ(at(diffuse, "modulation", 2), 0.04f);  // metal
  EXPECT_FLOAT_EQ(at(specular, "modulation", 2), 0.24f);
  EXPECT_FLOAT_EQ(at(diffuse, "modulation", 9), 0.94f);
  EXPECT_FLOAT_EQ(at(specular, "modulation", 9), 0.08f);
  EXPECT_FLOAT_EQ(at(specular, "alpha", 9), 0.25f);
  const Vec3 glass = denoise::modulationOf(LobePart::Specular, Vec3(0.5f), std::array<float, 5>{0, 0, 1, 1.5f, 1}.data());
  EXPECT_FLOAT_EQ(glass.x, 0.58f);
}

TEST(DenoiseEdges, SamplesTakeTheLightOfTheirSurface) {
  const Edge e;
  const TermPtr out = e.edges(LobePart::Diffuse);
  const float front = 0.04f, back = 0.94f;  // modulation
  for (int y = 0; y < kH; ++y)
    for (int x = 0; x < kW; ++x) {
      const float v = out->floats("rgb")[3 * size_t(y * kW + x)];
      EXPECT_NEAR(v, x < 5 ? 2.0f : x > 5 ? 6.0f : (3 * front * 2.0f + back * 6.0f) / (3 * front + back), x == 5 ? 1e-5f : 0.0f);
    }
}

// Light of a pixel that several surfaces share is nobody's, wherever their mean lies; a sample that misses has none.
TEST(DenoiseEdges, MixedPixelsAndMissesGiveNothing) {
  Edge e;
  const size_t pixels = kW * kH, mixed = 3 * kW + 4, missed = 4 * kW + 5;
  for (size_t s = 0; s < kS; ++s) e.P[3 * (s * pixels + mixed) + 2] = s % 2 ? 50.0f : -50.0f;  // slats about the front wall's plane
  for (size_t c = 0; c < 3; ++c) e.rgb[3 * mixed + c] = 77.0f;
  e.depth[missed] = std::numeric_limits<float>::infinity();
  const TermPtr out = e.edges(LobePart::Diffuse);
  const float front = 0.04f, back = 0.94f;
  EXPECT_NEAR(out->floats("rgb")[3 * (mixed + 1)], (3 * front * 2.0f + back * 6.0f) / (3 * front + back), 1e-5f);
  EXPECT_NEAR(out->floats("rgb")[3 * missed], (2 * front * 2.0f + back * 6.0f) / (2 * front + back), 1e-5f);
}

// Where no pixel shows a sample's surface whole, those that are like the pixel are averaged.
TEST(DenoiseEdges, ThinThingsTakeThoseThatAreAlike) {
  Edge e;
  for (int s = 0; s < kS; ++s)
    for (int y = 0; y < kH; ++y)
      for (int x = 0; x < kW; ++x) {
        const size_t i = size_t(s) * kW * kH + size_t(y * kW + x);
        e.P[3 * i + 2] = s < 2 ? 0.0f : -200.0f;  // slats everywhere
        for (size_t c = 0; c < 3; ++c) e.rgb[3 * size_t(y * kW + x) + c] = (x + y) % 2 ? 1.0f : 3.0f;
      }
  const TermPtr out = e.edges(LobePart::Diffuse);
  for (int y = 3; y < kH - 3; ++y)
    for (int x = 3; x < kW - 3; ++x) EXPECT_NEAR(out->floats("rgb")[3 * size_t(y * kW + x)], 2.0f, 0.1f);
  // Nothing hit: as it was.
  for (float& d : e.depth) d = std::numeric_limits<float>::infinity();
  const TermPtr empty = e.edges(LobePart::Diffuse);
  for (size_t i = 0; i < e.rgb.size(); ++i) EXPECT_EQ(empty->floats("rgb")[i], e.rgb[i]);
}

}  // namespace denoise_edges_test
}  // namespace gobo
