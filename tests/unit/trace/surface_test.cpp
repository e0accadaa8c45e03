// SPDX-License-Identifier: Apache-2.0
// What a hit reads: every texture by its channel, the frame of anisotropy, the coat's normal.
#include "trace/surface.h"

#include "support/tiny_scenes.h"
#include "trace/texture_lookup.h"

namespace gobo {
namespace {

using namespace tests;

struct Look {
  SceneMaker maker;
  TextureRef texel(int r, int g, int b, int a, bool srgb = false) {
    auto t = std::make_shared<Texture>();
    t->name = "t" + std::to_string(maker.scene.textures.size());
    t->width = t->height = 1;
    t->srgb = srgb;
    t->texels8 = {uint8_t(r), uint8_t(g), uint8_t(b), uint8_t(a)};
    sealTexture(*t);
    maker.scene.textures.push_back(t);
    TextureRef ref;
    ref.texture = int(maker.scene.textures.size()) - 1;
    return ref;
  }
  /// Of the middle of a quad in the plane y = 0: tangent +x, texture "up" +z (v runs to -z, and pictures are upside down).
  Surface at(const Bsdf& bsdf, const Vec3& d = Vec3(0, -1, 0), bool mirrored = false) { return of(ground(1.0f), bsdf, d, mirrored); }
  Surface of(const Mesh& mesh, const Bsdf& bsdf, const Vec3& d, bool mirrored) {
    maker.instance(maker.mesh(mesh, maker.material(Vec3(0.5f), [&](Material& x) { x.bsdf = bsdf; })), mirrored ? scaling(Vec3(-1, 1, 1)) : Mat4(1.0f));
    maker.camera(Vec3(0, 1, 0), Vec3(0.0f));
    scene = maker.finish();
    const std::vector<int> none;
    const SceneView view(*scene, Facet::All, none);
    accel = Accel::build(view, arena);
    table.build(view, *accel);
    Surface s;
    table.interact(uint32_t(scene->instances.size()) - 1, 0, 0.25f, 0.25f, Vec3(0, 1, 0), d, s);
    return s;
  }
  ScenePtr scene;
  TaskArena arena{1};
  AccelPtr accel;
  SurfaceTable table;
};

TEST(Surface, EveryTextureScalesItsFactorByItsChannel) {
  Look l;
  const float t[4] = {51 / 255.0f, 102 / 255.0f, 153 / 255.0f, 204 / 255.0f};
  const auto map = [&] { return l.texel(51, 102, 153, 204); };
  Bsdf b;
  b.metallic = b.roughness = 0.5f;
  b.metallicRoughness = map();
  b.specular = 0.5f;
  b.specularTexture = map();
  b.specularColor = Vec3(2.0f, 1.0f, 0.5f);
  b.specularColorTexture = map();
  b.transmission = 0.5f;
  b.transmissionTexture = map();
  b.diffuseTransmission = 0.25f;
  b.diffuseTransmissionTexture = map();
  b.diffuseTransmissionColor = Vec3(0.5f);
  b.diffuseTransmissionColorTexture = map();
  b.clearcoat = 0.5f;
  b.clearcoatTexture = map();
  b.clearcoatRoughness = 0.5f;
  b.clearcoatRoughnessTexture = map();
  b.sheenColor = Vec3(0.5f);
  b.sheenColorTexture = map();
  b.sheenRoughness = 0.5f;
  b.sheenRoughnessTexture = map();
  b.anisotropy = 0.5f;
  b.anisotropyTexture = map();
  b.iridescence = 0.5f;
  b.iridescenceTexture = map();
  b.iridescenceThicknessTexture = map();
  const BsdfParams p = l.at(b).bsdf;
  EXPECT_NEAR(p.metallic, 0.5f * t[2], 1e-6);
  EXPECT_NEAR(p.roughness, 0.5f * t[1], 1e-6);
  EXPECT_NEAR(p.specular, 0.5f * t[3], 1e-6);
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(p.specularColor[c], b.specularColor[c] * t[c], 1e-6);
    EXPECT_NEAR(p.diffuseTransmissionColor[c], 0.5f * t[c], 1e-6);
    EXPECT_NEAR(p.sheenColor[c], 0.5f * t[c], 1e-6);
  }
  EXPECT_NEAR(p.transmission, 0.5f * t[0], 1e-6);
  EXPECT_NEAR(p.diffuseTransmission, 0.25f * t[3], 1e-6);
  EXPECT_NEAR(p.clearcoat, 0.5f * t[0], 1e-6);
  EXPECT_NEAR(p.clearcoatRoughness, 0.5f * t[1], 1e-6);
  EXPECT_NEAR(p.sheenRoughness, 0.5f * t[3], 1e-6);
  EXPECT_NEAR(p.anisotropy, 0.5f * t[2], 1e-6);
  EXPECT_NEAR(p.iridescence, 0.5f * t[0], 1e-6);
  EXPECT_NEAR(p.iridescenceThickness, 100.0f + 300.0f * t[1], 1e-3);
  EXPECT_TRUE(p.thin);
}

TEST(Surface, ThicknessMakesAVolume) {
  Look l;
  Bsdf b;
  b.transmission = 1;
  b.thickness = 0.1f;
  b.attenuationDistance = 2;
  b.attenuationColor = Vec3(0.5f);
  const Surface s = l.at(b);
  EXPECT_FALSE(s.bsdf.thin);
  ASSERT_EQ(s.material->interior, 0);
  EXPECT_NEAR(l.table.interiors()[0].sigma.x, std::log(2.0f) / 2.0f, 1e-6);
  Look other;
  b.transmission = 0;  // nothing gets in
  EXPECT_EQ(other.at(b).material->interior, -1);
}

TEST(Surface, AnisotropyTurnsTheFrame) {
  struct Case {
    float rotation;
    int r, g;
    bool texture, mirrored;
    Vec3 x;
  };
  for (const Case& c : {Case{0, 0, 0, false, false, Vec3(1, 0, 0)}, Case{kPi / 2, 0, 0, false, false, Vec3(0, 0, 1)},
                        Case{0, 128, 255, true, false, Vec3(0, 0, 1)}, Case{kPi / 4, 255, 255, true, false, Vec3(0, 0, 1)},
                        Case{kPi / 4, 0, 0, false, false, glm::normalize(Vec3(1, 0, 1))}, Case{kPi / 4, 0, 0, false, true, glm::normalize(Vec3(-1, 0, 1))}}) {
    Look l;
    Bsdf b;
    b.metallic = 1;
    b.anisotropy = 1;
    b.anisotropyRotation = c.rotation;
    if (c.texture) b.anisotropyTexture = l.texel(c.r, c.g, 255, 255);
    const Surface s = l.at(b, Vec3(0, -1, 0), c.mirrored);
    ASSERT_TRUE(s.hasTangent);
    const Frame f = s.frame();
    EXPECT_NEAR(std::fabs(glm::dot(f.x, c.x)), 1.0f, 1e-4) << f.x.x << " " << f.x.z;
    EXPECT_NEAR(glm::dot(f.x, f.y), 0.0f, 1e-6);
    EXPECT_NEAR(glm::dot(f.y, f.z), 0.0f, 1e-6);
    EXPECT_NEAR(glm::dot(glm::cross(f.x, f.y), f.z), 1.0f, 1e-5);
  }
  Look plain;
  EXPECT_FALSE(plain.at(Bsdf{}).hasTangent);
}

// Tangents that are made are those of the coordinates that the map is looked up at, as if the mesh had those.
TEST(Surface, MadeTangentsTurnWithTheTexture) {
  struct Case {
    float rotation;
    Vec2 scale;
  };
  for (const Case& c : {Case{kPi / 2, Vec2(1.0f)}, Case{0, Vec2(-1, 1)}, Case{0, Vec2(2, -3)}, Case{2.3f, Vec2(-0.5f, 1.5f)}})
    for (const bool mirrored : {false, true}) {
      const auto look = [&](bool baked) {
        Look l;
        TextureRef turned;
        turned.rotation = c.rotation;
        turned.scale = c.scale;
        turned.offset = Vec2(0.3f, -0.2f);
        const auto map = [&](int red, int green, int blue) {
          TextureRef ref = l.texel(red, green, blue, 255);
          if (baked) return ref;
          ref.rotation = turned.rotation;
          ref.scale = turned.scale;
          ref.offset = turned.offset;
          return ref;
        };
        Mesh mesh = ground(1.0f);
        if (baked)
          for (Vec2& t : mesh.uv[0]) t = transformUv(turned, t);
        Bsdf b;
        b.metallic = 1;
        b.anisotropy = 1;
        b.normal = map(200, 170, 220);
        b.anisotropyTexture = map(255, 180, 255);
        return l.of(mesh, b, Vec3(0, -1, 0), mirrored);
      };
      const Surface own = look(false), truth = look(true);
      ASSERT_TRUE(own.hasTangent && truth.hasTangent);
      EXPECT_LT(truth.n.y, 0.95f);
      EXPECT_LT(glm::length(own.n - truth.n), 1e-5f) << c.rotation << " " << c.scale.x << " " << c.scale.y << " " << mirrored;
      EXPECT_LT(glm::length(own.frame().x - truth.frame().x), 1e-4f) << c.rotation << " " << c.scale.x << " " << c.scale.y << " " << mirrored;
      if (c.rotation == kPi / 2) { EXPECT_LT(own.n.z, -0.3f) << "the picture's u runs along v, which is -z"; }
    }
}

TEST(Surface, TheCoatLiesOverTheBumpsOfTheBase) {
  const Vec3 up(0, 1, 0);
  Bsdf b;
  b.clearcoat = 1;
  Look l;
  b.normal = l.texel(200, 128, 220, 255);
  Surface s = l.at(b);
  EXPECT_LT(s.n.y, 0.95f);
  EXPECT_NEAR(glm::dot(s.frame().toWorld(s.bsdf.clearcoatNormal), up), 1.0f, 1e-5);
  Look other;
  b.normal = {};
  b.clearcoatNormal = other.texel(200, 128, 220, 255);
  s = other.at(b);
  EXPECT_EQ(s.n, up);
  const Vec3 coat = s.frame().toWorld(s.bsdf.clearcoatNormal);
  EXPECT_NEAR(coat.y, glm::normalize(Vec3(2 * 200 / 255.0f - 1, 0, 2 * 220 / 255.0f - 1)).z, 5e-3);
  EXPECT_GT(coat.x, 0.3f);
}

}  // namespace
}  // namespace gobo
