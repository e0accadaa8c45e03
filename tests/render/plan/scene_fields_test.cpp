// SPDX-License-Identifier: Apache-2.0
// Two scenes that differ in one field alone, for every field there is: rendered in one engine and in two, by every technique and with
// every output of the registries, the pictures are the same bit for bit. A node whose key lacks something that it reads fails here.
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "filters/shadow_technique.h"
#include "plan/outputs.h"
#include "scene/edit.h"
#include "support/engines.h"
#include "support/every_field.h"
#include "support/thorough.h"

namespace gobo::testing {
namespace {

std::shared_ptr<Texture> pattern(const char* name, int seed) {
  auto t = std::make_shared<Texture>();
  t->name = name;
  t->width = t->height = 4;
  for (int i = 0; i < 64; ++i) t->texels8.push_back(uint8_t((i * 37 + seed * 91 + (i % 4 == 3 ? (i / 4 + i / 16) % 2 * 200 : 40)) % 256));
  sealTexture(*t);
  return t;
}

/// A square with every array, centre `at`, half edges u and v.
MeshPtr square(const char* name, int material, const Vec3& at, const Vec3& u, const Vec3& v) {
  auto m = std::make_shared<Mesh>();
  m->name = name;
  m->material = material;
  m->positions = {at - u - v, at + u - v, at + u + v, at - u + v};
  m->indices = {0, 1, 2, 0, 2, 3};
  m->normals.assign(4, glm::normalize(glm::cross(u, v)));
  m->tangents.assign(4, Vec4(glm::normalize(u), 1.0f));
  m->uv[0] = {Vec2(0, 0), Vec2(1, 0), Vec2(1, 1), Vec2(0, 1)};
  m->uv[1] = {Vec2(0.1f, 0.3f), Vec2(1.3f, 0), Vec2(0.9f, 2), Vec2(0, 0.8f)};
  m->colours = {Vec4(1), Vec4(0.9f, 1, 1, 0.9f), Vec4(1, 0.8f, 1, 1), Vec4(1, 1, 0.7f, 0.8f)};
  sealMesh(*m);
  return m;
}

const char* kindOf(LightKind k) { return k == LightKind::Spot ? "spot" : k == LightKind::Rect ? "rect" : k == LightKind::Sphere ? "sphere" : "directional"; }

/// A floor under a masked card and a blended sheet, a lamp with a texture, a box of every lobe, a screen from behind; for each technique a light that it
/// supports, and one light of every kind that is path traced.
ScenePtr stage() {
  auto s = std::make_shared<Scene>();
  s->name = "stage";
  s->textures = {pattern("dots", 1), pattern("lines", 2)};
  s->materials.resize(6);
  const char* names[] = {"floor", "card", "sheet", "glow", "rich", "screen"};
  for (int i = 0; i < 6; ++i) s->materials[size_t(i)].name = names[i];
  s->materials[0].albedo.texture.texture = 1;
  s->materials[1].coverage = {AlphaMode::Mask, 0.4f, 0.9f, {.texture = 0}, true};
  s->materials[2].coverage = {AlphaMode::Blend, 0.5f, 0.6f, {.texture = 1}, true};
  s->materials[3].emission = {Vec3(2.0f), {.texture = 1}};
  s->materials[5].coverage.doubleSided = false;
  Bsdf& b = s->materials[4].bsdf;
  b.roughness = 0.4f;
  b.metallic = 0.3f;
  b.transmission = 0.3f;
  b.clearcoat = 0.5f;
  b.sheenColor = Vec3(0.3f);
  b.iridescence = 0.4f;
  b.anisotropy = 0.5f;
  b.diffuseTransmission = 0.2f;
  b.normal.texture = 0;
  s->meshes = {square("floor", 0, Vec3(0), Vec3(2, 0, 0), Vec3(0, 0, -2)),
               square("card", 1, Vec3(-0.4f, 0.8f, 0), Vec3(0.6f, 0, 0), Vec3(0, 0.1f, -0.6f)),
               square("sheet", 2, Vec3(0.6f, 0.6f, 0.2f), Vec3(0.5f, 0, 0), Vec3(0, 0, -0.5f)),
               square("lamp", 3, Vec3(-1.2f, 1.2f, -0.8f), Vec3(0.3f, 0, 0), Vec3(0, 0, 0.3f)),
               square("panel", 4, Vec3(0.8f, 0.5f, -1), Vec3(0.6f, 0, 0), Vec3(0, 0.5f, 0.2f)),
               square("screen", 5, Vec3(-0.3f, 0.4f, 0.8f), Vec3(0, 0.3f, 0.1f), Vec3(0.4f, 0, 0))};
  for (int i = 0; i < 6; ++i) s->instances.push_back({s->meshes[size_t(i)]->name, i, Mat4(1.0f)});
  s->environment = skyEnvironment({}, 16);
  for (const float edge : {0.2f, 0.6f}) {  // tables: any kind of light may have one
    auto p = std::make_shared<LightProfile>();
    p->kind = ProfileKind::Photometry;
    p->width = 3;
    p->height = 2;
    p->values = {Vec3(1.0f), Vec3(0.9f), Vec3(1.0f), Vec3(edge), Vec3(0.5f), Vec3(edge)};
    p->vertical = {0.0f, 2.0f};
    p->horizontal = {0.0f, 2.0f, 2.0f * kPi};
    EXPECT_TRUE(sealProfile(*p).ok());
    s->profiles.push_back(std::move(p));
  }
  const auto place = [&](const std::string& name, LightKind kind, int n) {
    Light l;
    l.name = name;
    l.shape.kind = kind;
    l.shape.position = Vec3(0.3f * float(n % 5) - 0.6f, 2.2f, 0.25f * float(n % 4) - 0.3f);
    l.shape.axis = glm::normalize(Vec3(0.1f * float(n % 3) - 0.1f, -1.0f, 0.05f));
    const Frame f(l.shape.axis);
    l.shape.u = 0.25f * f.x;
    l.shape.v = 0.2f * f.y;
    l.shape.radius = 0.2f;
    if (kind == LightKind::Spot) l.shape.profile = n % 2;
    l.power = Vec3(1.0f + 0.1f * float(n), 1.0f, 0.8f);
    s->lights.push_back(l);
  };
  int n = 0;
  for (const LightKind kind : {LightKind::Spot, LightKind::Rect, LightKind::Sphere, LightKind::Directional}) place(kindOf(kind), kind, n++);
  for (const ShadowTechniqueEntry& t : shadowTechniques()) place(t.name, t.supports(LightKind::Rect) ? LightKind::Rect : LightKind::Spot, n++);
  place("subtractive", LightKind::Rect, n++);
  Camera c;
  c.name = "eye";
  c.toWorld = Mat4(Vec4(1, 0, 0, 0), Vec4(0, 0.8f, -0.6f, 0), Vec4(0, 0.6f, 0.8f, 0), Vec4(0, 2.4f, 3.4f, 1));
  c.yfov = 0.9f;
  c.cullBackFaces = true;  // of the screen, whose back it sees
  s->cameras = {c};
  const Status sealed = s->seal();
  EXPECT_TRUE(sealed.ok()) << sealed.toString();
  return s;
}

v1::RenderRequest requestFor(const Scene& scene) {
  v1::RenderRequest r = smallRequest("stage", 6, 5, 1);
  r.set_view_samples(1);
  r.mutable_integrator()->set_max_bounces(1);
  r.mutable_integrator()->set_max_groups(16);
  for (const ShadowTechniqueEntry& t : shadowTechniques()) {
    v1::ShadowTechnique& technique = *(*r.mutable_lights())[t.name].mutable_shadow();
    technique.GetReflection()->MutableMessage(&technique, technique.GetDescriptor()->FindFieldByNumber(t.key));
    if (t.usesMap || technique.has_auto_()) technique.mutable_map()->set_resolution(8);
    if (technique.has_auto_()) technique.mutable_auto_()->set_error(0.3);
    if (technique.has_ray_traced()) technique.mutable_ray_traced()->set_samples(2);
  }
  (*r.mutable_lights())["subtractive"].mutable_shadow()->mutable_subtractive()->set_resolution(2);
  v1::PictureFilter& stage = *r.add_filters();  // for its output
  stage.set_term("emission");
  stage.mutable_gaussian()->set_sigma_px(0.8);
  for (const OutputInfo& o : outputTable()) {
    if (!o.perLight) {
      r.add_outputs(std::string(o.name) + (o.perFilter ? ":0" : ""));
      continue;
    }
    if (std::set<std::string>{"shadow_flags", "shadow_basis", "shadow_rays", "shadow_width", "shadow_distance"}.count(o.name))
      continue;  // parts of what visibility is made from
    for (const Light& l : scene.lights)
      if (l.shape.kind != LightKind::Environment) r.add_outputs(std::string(o.name) + ":" + l.name);
  }
  return r;
}

Result<RenderResult> renderScene(Engine& engine, const v1::RenderRequest& request, const ScenePtr& scene) {
  RenderControl control;
  control.scene = scene;
  return engine.render(request, control);
}

/// All of them, or a share that has each field of some thing and some field of each thing.
std::vector<FieldChange> changesOf(const Scene& scene) {
  const std::vector<FieldChange> all = everyFieldChange(scene);
  std::map<std::string, std::vector<size_t>> kinds;
  for (size_t k = 0; k < all.size(); ++k) {  // "lights.rect.radius": of lights the radius, and of rect something
    const std::string& name = all[k].name;
    const size_t thing = name.find('.'), field = name.find('.', thing + 1);
    if (field == std::string::npos) {
      kinds[name].push_back(k);
      continue;
    }
    kinds["field " + name.substr(0, thing) + name.substr(field)].push_back(k);
    kinds["thing " + name.substr(0, field)].push_back(k);
  }
  std::set<size_t> kept;
  size_t n = 0;
  for (const auto& [kind, of] : kinds) kept.insert(of[7 * n++ % of.size()]);  // of another thing each time: the first of a field is often not seen
  std::vector<FieldChange> some;
  for (size_t k = 0; k < all.size(); ++k)
    if (kept.count(k) || inSweep(k, 5)) some.push_back(all[k]);
  return some;
}

TEST(SceneFields, AChangeOfOneFieldNeverGetsAnothersTerms) {
  const ScenePtr base = stage();
  const v1::RenderRequest request = requestFor(*base);
  const auto warm = makeEngine();
  const Result<RenderResult> first = renderScene(*warm, request, base);
  ASSERT_TRUE(first.ok()) << first.status().toString();
  int reused = 0, different = 0, tried = 0;
  for (const FieldChange& change : changesOf(*base)) {
    const auto next = editScene(*base, [&](Scene& s) -> Status {
      change.apply(s);
      return {};
    });
    ASSERT_TRUE(next.ok()) << change.name << ": " << next.status().toString();
    const Result<RenderResult> here = renderScene(*warm, request, *next), fresh = renderScene(*makeEngine(), request, *next);
    ASSERT_EQ(here.ok(), fresh.ok()) << change.name << ": " << here.status().toString() << " / " << fresh.status().toString();
    if (!here.ok()) {
      ADD_FAILURE() << change.name << ": " << here.status().toString();
      continue;
    }
    EXPECT_EQ(firstDifference(*here, *fresh), "") << change.name;
    ++tried;
    reused += int(nodesBy(*here, v1::NodeReport::REUSED).size());
    different += !firstDifference(*here, *first).empty();
  }
  EXPECT_GT(tried, thoroughOr(200, 80));
  EXPECT_GT(reused, 10 * tried) << "nothing is reused: the test says nothing";
  EXPECT_GT(different, tried / 2) << "most changes are invisible: the test says little";
  std::cout << tried << " changes, " << different << " of them visible, " << reused << " nodes reused\n";
}

}  // namespace
}  // namespace gobo::testing
