// SPDX-License-Identifier: Apache-2.0
// Every field of a scene belongs to the facets that its page names: a mutation changes exactly their digests.
#include <gtest/gtest.h>

#include <functional>
#include <set>

#include "scene/edit.h"
#include "scene/load.h"

namespace gobo {
namespace {

std::shared_ptr<Mesh> triangleMesh(int material) {
  auto m = std::make_shared<Mesh>();
  m->positions = {Vec3(0), Vec3(1, 0, 0), Vec3(0, 1, 0)};
  m->normals.assign(3, Vec3(0, 0, 1));
  m->uv[0].assign(3, Vec2(0.5f));
  m->indices = {0, 1, 2};
  m->material = material;
  sealMesh(*m);
  return m;
}

std::shared_ptr<Texture> texture(uint8_t value) {
  auto t = std::make_shared<Texture>();
  t->width = t->height = 1;
  t->texels8.assign(4, value);
  sealTexture(*t);
  return t;
}

LightProfilePtr profile(float last) {
  auto p = std::make_shared<LightProfile>();
  p->kind = ProfileKind::Photometry;
  p->width = 1;
  p->height = 2;
  p->values = {Vec3(1.0f), Vec3(last)};
  p->vertical = {0.0f, 1.0f};
  p->horizontal = {0.0f};
  EXPECT_TRUE(sealProfile(*p).ok());
  return p;
}

/// Lights: 0 lamp (Mesh light of instance 1, textured emission), 1 point, 2 rect, 3 environment.
ScenePtr base() {
  auto s = std::make_shared<Scene>();
  s->name = "base";
  s->textures = {texture(10), texture(20)};
  s->materials.resize(2);
  s->materials[0].name = "wall";
  s->materials[1].name = "glow";
  s->materials[1].emission.radiance = Vec3(2.0f);
  s->materials[1].emission.texture.texture = 0;
  s->meshes = {triangleMesh(0), triangleMesh(1)};
  s->instances = {{"wall", 0, Mat4(1.0f)}, {"lamp", 1, Mat4(1.0f)}};
  s->environment = constantEnvironment(Vec3(1.0f));
  s->profiles = {profile(0.5f)};
  Light mesh, point, rect;
  mesh.name = "lamp";
  mesh.shape.kind = LightKind::Mesh;
  mesh.shape.instance = 1;
  point.name = "point";
  rect.name = "rect";
  rect.shape.kind = LightKind::Rect;
  s->lights = {mesh, point, rect};
  EXPECT_TRUE(s->seal().ok());
  EXPECT_EQ(s->lights.size(), 4u);
  return s;
}

const std::vector<int> kNoLights;

std::set<std::string> changed(const Scene& a, const Scene& b, const std::vector<int>& lights) {
  std::set<std::string> names;
  for (uint32_t bit = 1; bit < uint32_t(Facet::All); bit <<= 1)
    if (a.facetHash(Facet(bit), lights) != b.facetHash(Facet(bit), lights)) names.insert(facetName(Facet(bit)));
  return names;
}

using Names = std::set<std::string>;
struct Mutation {
  const char* what;
  std::function<void(Scene&)> edit;
  Names all, pointOnly;
};

void remesh(Scene& s, int i, const std::function<void(Mesh&)>& edit) {
  auto copy = std::make_shared<Mesh>(*s.meshes[i]);
  edit(*copy);
  sealMesh(*copy);
  s.meshes[i] = copy;
}

TEST(FacetHash, EachFieldChangesExactlyItsFacets) {
  const Names none, shape{"light-shape"}, power{"light-power"};
  // `all`: with every light in the subset; `pointOnly`: with light 1 alone.
  const Mutation mutations[] = {
      {"indices", [](Scene& s) { remesh(s, 0, [](Mesh& m) {
                                   m.indices = {1, 2, 0};
                                 }); }, {"topology"}, {"topology"}},
      {"mesh material",
       [](Scene& s) {
         s.materials.push_back({});
         remesh(s, 0, [](Mesh& m) { m.material = 2; });
       },
       {"topology", "coverage", "albedo", "bsdf", "emission"},
       {"topology", "coverage", "albedo", "bsdf", "emission"}},
      {"instance mesh", [](Scene& s) { s.instances[0].mesh = 1; }, {"topology"}, {"topology"}},
      {"lamp indices", [](Scene& s) { remesh(s, 1, [](Mesh& m) {
                                        m.indices = {1, 2, 0};
                                      }); }, {"topology", "light-shape"}, {"topology"}},
      {"positions", [](Scene& s) { remesh(s, 0, [](Mesh& m) { m.positions[0].x = 0.1f; }); }, {"pose"}, {"pose"}},
      {"lamp positions", [](Scene& s) { remesh(s, 1, [](Mesh& m) { m.positions[0].x = 0.1f; }); }, {"pose", "light-shape"}, {"pose"}},
      {"wall transform", [](Scene& s) { s.instances[0].toWorld[3].x = 1; }, {"pose"}, {"pose"}},
      {"lamp transform", [](Scene& s) { s.instances[1].toWorld[3].x = 1; }, {"pose", "light-shape"}, {"pose"}},
      {"normals", [](Scene& s) { remesh(s, 0, [](Mesh& m) { m.normals[0] = Vec3(0, 1, 0); }); }, {"shading"}, {"shading"}},
      {"tangents", [](Scene& s) { remesh(s, 0, [](Mesh& m) { m.tangents.assign(3, Vec4(1)); }); }, {"shading"}, {"shading"}},
      {"uv0", [](Scene& s) { remesh(s, 0, [](Mesh& m) { m.uv[0][1].x = 0.25f; }); }, {"shading"}, {"shading"}},
      {"uv3", [](Scene& s) { remesh(s, 0, [](Mesh& m) { m.uv[3].assign(3, Vec2(0)); }); }, {"shading"}, {"shading"}},
      {"colours", [](Scene& s) { remesh(s, 0, [](Mesh& m) { m.colours.assign(3, Vec4(1)); }); }, {"shading"}, {"shading"}},
      {"lamp uv0", [](Scene& s) { remesh(s, 1, [](Mesh& m) { m.uv[0][1].x = 0.25f; }); }, {"shading", "light-shape"}, {"shading"}},
      {"alpha mode", [](Scene& s) { s.materials[0].coverage.mode = AlphaMode::Mask; }, {"coverage"}, {"coverage"}},
      {"cutoff", [](Scene& s) { s.materials[0].coverage.cutoff = 0.4f; }, {"coverage"}, {"coverage"}},
      {"alpha factor", [](Scene& s) { s.materials[0].coverage.factor = 0.4f; }, {"coverage"}, {"coverage"}},
      {"double sided", [](Scene& s) { s.materials[0].coverage.doubleSided = false; }, {"coverage"}, {"coverage"}},
      {"alpha texture", [](Scene& s) { s.materials[0].coverage.texture.texture = 1; }, {"coverage"}, {"coverage"}},
      {"albedo", [](Scene& s) { s.materials[0].albedo.factor.y = 0.5f; }, {"albedo"}, {"albedo"}},
      {"albedo texture", [](Scene& s) { s.materials[0].albedo.texture.texture = 1; }, {"albedo"}, {"albedo"}},
      {"metallic", [](Scene& s) { s.materials[0].bsdf.metallic = 0.5f; }, {"bsdf"}, {"bsdf"}},
      {"roughness", [](Scene& s) { s.materials[0].bsdf.roughness = 0.5f; }, {"bsdf"}, {"bsdf"}},
      {"mr texture", [](Scene& s) { s.materials[0].bsdf.metallicRoughness.texture = 1; }, {"bsdf"}, {"bsdf"}},
      {"specular", [](Scene& s) { s.materials[0].bsdf.specular = 0.5f; }, {"bsdf"}, {"bsdf"}},
      {"ior", [](Scene& s) { s.materials[0].bsdf.ior = 1.3f; }, {"bsdf"}, {"bsdf"}},
      {"transmission", [](Scene& s) { s.materials[0].bsdf.transmission = 1.0f; }, {"bsdf"}, {"bsdf"}},
      {"normal map", [](Scene& s) { s.materials[0].bsdf.normal.texture = 1; }, {"bsdf"}, {"bsdf"}},
      {"normal scale", [](Scene& s) { s.materials[0].bsdf.normalScale = 2.0f; }, {"bsdf"}, {"bsdf"}},
      {"emission strength", [](Scene& s) { s.materials[1].emission.radiance = Vec3(5.0f); }, none, none},
      {"wall emits", [](Scene& s) { s.materials[0].emission.radiance = Vec3(5.0f); }, {"emission"}, {"emission"}},
      {"emission texture", [](Scene& s) { s.materials[1].emission.texture.texture = 1; }, {"emission", "light-shape"}, {"emission"}},
      {"emission texture offset", [](Scene& s) { s.materials[1].emission.texture.offset.x = 0.5f; }, {"emission", "light-shape"}, {"emission"}},
      {"texture content", [](Scene& s) { s.textures[0] = texture(99); }, {"emission", "light-shape"}, {"emission"}},
      {"unused texture", [](Scene& s) { s.textures[1] = texture(99); }, none, none},
      {"kind", [](Scene& s) { s.lights[1].shape.kind = LightKind::Spot; }, shape, shape},
      {"position", [](Scene& s) { s.lights[1].shape.position.y = 1; }, shape, shape},
      {"axis", [](Scene& s) { s.lights[1].shape.axis = Vec3(1, 0, 0); }, shape, shape},
      {"u", [](Scene& s) { s.lights[2].shape.u *= 2.0f; }, shape, none},
      {"v", [](Scene& s) { s.lights[2].shape.v *= 2.0f; }, shape, none},
      {"radius", [](Scene& s) { s.lights[1].shape.radius = 2; }, shape, shape},
      {"angular size", [](Scene& s) { s.lights[1].shape.angularSize = 0.1f; }, shape, shape},
      {"sky rectangle", [](Scene& s) { s.lights[1].shape.skyRectangle = Vec2(0.1f); }, shape, shape},
      {"profile", [](Scene& s) { s.lights[1].shape.profile = 0; }, shape, shape},
      {"profile of a rect", [](Scene& s) { s.lights[2].shape.profile = 0; }, none, none},
      {"unused profile", [](Scene& s) { s.profiles.pop_back(); }, none, none},
      {"rotation of no profile", [](Scene& s) { s.lights[1].shape.profileRotation = 1; }, none, none},
      {"inner", [](Scene& s) { s.lights[1].shape.cosInner = 0.9f; }, shape, shape},
      {"outer", [](Scene& s) { s.lights[1].shape.cosOuter = 0.5f; }, shape, shape},
      {"range", [](Scene& s) { s.lights[1].shape.range = 5; }, shape, shape},
      {"two sided", [](Scene& s) { s.lights[2].shape.twoSided = true; }, shape, none},
      {"camera visible", [](Scene& s) { s.lights[2].cameraVisible = false; }, shape, none},
      {"point power", [](Scene& s) { s.lights[1].power.z = 3; }, power, power},
      {"rect power", [](Scene& s) { s.lights[2].power.z = 3; }, power, none},
      {"lamp power", [](Scene& s) { s.lights[0].power.z = 3; }, power, none},
      {"colour of a known intensity", [](Scene& s) { s.lights[1].intensity = 2, s.lights[1].color.y = 0.5f; }, none, none},
      {"environment scale", [](Scene& s) { s.lights[3].power.z = 3; }, power, none},
      {"map", [](Scene& s) { s.environment = constantEnvironment(Vec3(2.0f)); }, {"environment"}, {"environment"}},
      {"rotation",
       [](Scene& s) {
         auto e = std::make_shared<Environment>(*s.environment);
         e->rotation = 1;
         s.environment = e;
       },
       {"environment"},
       {"environment"}},
      {"camera pose", [](Scene& s) { s.cameras[0].toWorld[3].x += 1; }, {"cameras"}, {"cameras"}},
      {"yfov", [](Scene& s) { s.cameras[0].yfov = 0.5f; }, {"cameras"}, {"cameras"}},
      {"yheight", [](Scene& s) { s.cameras[0].yheight = 0.5f; }, {"cameras"}, {"cameras"}},
      {"perspective", [](Scene& s) { s.cameras[0].perspective = false; }, {"cameras"}, {"cameras"}},
      {"centre", [](Scene& s) { s.cameras[0].centre.x = 0.5f; }, {"cameras"}, {"cameras"}},
      {"light name", [](Scene& s) { s.lights[1].name = "renamed"; }, none, none},
  };
  const ScenePtr a = base();
  std::set<std::string> roots = {a->hash().hex()};
  for (const Mutation& m : mutations) {
    const auto b = editScene(*a, [&](Scene& s) -> Status {
      m.edit(s);
      return {};
    });
    ASSERT_TRUE(b.ok()) << m.what << ": " << b.status().toString();
    EXPECT_EQ(changed(*a, **b, {0, 1, 2, 3}), m.all) << m.what;
    EXPECT_EQ(changed(*a, **b, {1}), m.pointOnly) << m.what;
    static const std::set<std::string> kInvisible{"emission strength", "unused texture", "profile of a rect", "unused profile", "rotation of no profile"};
    const bool invisible = kInvisible.count(m.what) > 0;
    EXPECT_EQ(roots.insert((*b)->hash().hex()).second, !invisible) << m.what;
  }
}

TEST(FacetHash, DependsOnContentNotOnWhoMadeIt) {
  const ScenePtr a = base(), b = base();
  EXPECT_EQ(a->hash(), b->hash());
  EXPECT_EQ(a->facetHash(Facet::All, {0, 1, 2, 3}), b->facetHash(Facet::All, {0, 1, 2, 3}));
  EXPECT_NE(a->facetHash(Facet::LightShape, {0}), a->facetHash(Facet::LightShape, {1}));
  EXPECT_NE(a->facetHash(Facet::LightShape, {1}), a->facetHash(Facet::LightPower, {1}));
}

TEST(FacetHash, ProfilesCountByContentAndRotation) {
  const auto with = [](const std::vector<LightProfilePtr>& profiles, int index, float rotation) {
    return *editScene(*base(), [&](Scene& s) -> Status {
      s.profiles = profiles;
      s.lights[1].shape.profile = index;
      s.lights[1].shape.profileRotation = rotation;
      return {};
    });
  };
  const ScenePtr a = with({profile(0.5f)}, 0, 0.0f);
  EXPECT_EQ(a->hash(), with({profile(0.1f), profile(0.5f)}, 1, 0.0f)->hash()) << "the index is not content";
  for (const ScenePtr& other : {with({profile(0.4f)}, 0, 0.0f), with({profile(0.5f)}, 0, 0.1f)}) {
    EXPECT_EQ(changed(*a, *other, {1}), std::set<std::string>{"light-shape"});
    EXPECT_NE(a->hash(), other->hash());
  }
}

TEST(FacetHash, TextureIndexIsNotContent) {
  const ScenePtr a = base();
  const auto b = editScene(*a, [&](Scene& s) -> Status {
    s.textures.insert(s.textures.begin(), texture(77));
    s.materials[1].emission.texture.texture = 1;
    return {};
  });
  EXPECT_EQ(a->hash(), (*b)->hash());
}

TEST(FacetHash, TheEnvironmentIsSeenAmongTheLightsAlone) {
  const ScenePtr a = base();
  const auto turned = editScene(*a, [](Scene& s) -> Status {
    auto e = std::make_shared<Environment>(*s.environment);
    e->rotation = 1;
    s.environment = e;
    return {};
  });
  const Facet paths = Facet::Topology | Facet::LightShape | Facet::Environment;
  EXPECT_EQ(a->facetHash(paths, {0, 1, 2}), (*turned)->facetHash(paths, {0, 1, 2}));
  EXPECT_NE(a->facetHash(paths, {1, 3}), (*turned)->facetHash(paths, {1, 3}));
  EXPECT_NE(a->facetHash(Facet::Environment, {}), (*turned)->facetHash(Facet::Environment, {}));
}

TEST(SceneViewDeathTest, ReadingUndeclaredFacetsNamesThem) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const ScenePtr s = base();
  const std::vector<int> lights = {1};
  const SceneView view(*s, Facet::Topology | Facet::LightShape, lights);
  EXPECT_DEATH(view.albedo(0), "albedo");
  EXPECT_DEATH(view.instances(), "pose");
  EXPECT_DEATH(view.lightShape(2), "rect");
  EXPECT_DEATH(view.lightPower(1), "light-power");
  EXPECT_DEATH(SceneView(*s, Facet::LightShape | Facet::Environment, lights).environment(), "light-shape subset");
  EXPECT_EQ(view.lightShape(1).kind, LightKind::Point);
}

}  // namespace
}  // namespace gobo
