// SPDX-License-Identifier: Apache-2.0
// One change for every field of a scene, made from the field lists (scene/fields.h) so that a new field cannot be forgotten.
#pragma once

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include "scene/fields.h"
#include "scene/scene.h"

namespace gobo::testing {

struct FieldChange {
  std::string name;
  std::function<void(Scene&)> apply;
};

namespace every_field {

inline void change(float& v) { v = 0.7f * v + 0.17f; }
inline void change(bool& v) { v = !v; }
inline void change(int& v) { v = (v + 1) % 2; }  // a texture, a set of texture coordinates or a profile: scenes have two
inline void change(uint32_t&) {}                 // a mesh light's instance: changed with the instance below
inline void change(AlphaMode& v) { v = AlphaMode((int(v) + 1) % 3); }
inline void change(LightKind& v) {
  v = v == LightKind::Spot                                  ? LightKind::Point
      : v == LightKind::Rect                                ? LightKind::Disk
      : v == LightKind::Mesh || v == LightKind::Environment ? v
                                                            : LightKind::Spot;
}
inline void change(Mat4& v) { v[3].x += 0.07f; }
template <int N>
void change(glm::vec<N, float>& v) {
  for (int i = 0; i < N; ++i) change(v[i]);
}

/// Names of the fields of S, in order.
template <typename S>
std::vector<std::string> names(S s) {
  std::vector<std::string> out;
  visitFields(s, [&](const char* name, auto&) { out.emplace_back(name); });
  return out;
}

/// Applies `f` to the field of that name.
template <typename S, typename F>
void at(S& s, const std::string& wanted, F&& f) {
  visitFields(s, [&](const char* name, auto& field) {
    if (wanted == name) f(field);
  });
}

/// Adds one change for each field of the struct that `get` finds in a scene; texture references field by field.
template <typename S, typename Get>
void add(const std::string& prefix, const S& example, Get get, std::vector<FieldChange>& out) {
  S copy = example;
  visitFields(copy, [&](const char* name, auto& field) {
    using Field = std::remove_cvref_t<decltype(field)>;
    const std::string key = name;
    if constexpr (std::is_same_v<Field, TextureRef>) {
      for (const std::string& part : names(TextureRef())) {
        if (!field.valid() && part != "texture") continue;  // nothing is looked up
        out.push_back({prefix + key + "." + part, [=](Scene& s) {
                         at(get(s), key, [&](auto& ref) {
                           if constexpr (std::is_same_v<std::remove_cvref_t<decltype(ref)>, TextureRef>) at(ref, part, [](auto& f) { change(f); });
                         });
                       }});
      }
    } else {
      out.push_back({prefix + key, [=](Scene& s) {
                       at(get(s), key, [](auto& f) {
                         if constexpr (!std::is_same_v<std::remove_cvref_t<decltype(f)>, TextureRef>) change(f);
                       });
                     }});
    }
  });
}

inline void remesh(Scene& s, size_t i, const std::function<void(Mesh&)>& edit) {
  auto copy = std::make_shared<Mesh>(*s.meshes[i]);
  edit(*copy);
  sealMesh(*copy);
  s.meshes[i] = copy;
}

inline void retexture(Scene& s, size_t i, const std::function<void(Texture&)>& edit) {
  auto copy = std::make_shared<Texture>(*s.textures[i]);
  edit(*copy);
  sealTexture(*copy);
  s.textures[i] = copy;
}

}  // namespace every_field

/// `s` has two textures, two profiles or none, meshes with every array, and a material whose texture references of interest are set.
inline std::vector<FieldChange> everyFieldChange(const Scene& s) {
  using namespace every_field;
  std::vector<FieldChange> out;
  for (size_t m = 0; m < s.materials.size(); ++m) {
    const std::string p = "materials." + s.materials[m].name + ".";
    add(
        p + "coverage.", s.materials[m].coverage, [m](Scene& t) -> Coverage& { return t.materials[m].coverage; }, out);
    add(
        p + "albedo.", s.materials[m].albedo, [m](Scene& t) -> Albedo& { return t.materials[m].albedo; }, out);
    add(
        p + "emission.", s.materials[m].emission, [m](Scene& t) -> Emission& { return t.materials[m].emission; }, out);
    if (s.materials[m].name == "rich")
      add(
          p + "bsdf.", s.materials[m].bsdf, [m](Scene& t) -> Bsdf& { return t.materials[m].bsdf; }, out);
  }
  for (size_t m = 0; m < s.meshes.size(); ++m) {
    const std::string p = "meshes." + s.meshes[m]->name + ".";
    const auto array = [&](const char* name, std::function<void(Mesh&)> edit) { out.push_back({p + name, [=](Scene& t) { remesh(t, m, edit); }}); };
    array("indices", [](Mesh& k) {
      std::vector<uint32_t> i(k.indices.begin(), k.indices.end());
      std::swap(i[0], i[2]);
      std::swap(i[0], i[1]);
      k.indices = i;
    });
    array("positions", [](Mesh& k) {
      std::vector<Vec3> v(k.positions.begin(), k.positions.end());
      v[2] *= 0.8f;
      k.positions = v;
    });
    array("normals", [](Mesh& k) {
      std::vector<Vec3> v(k.normals.begin(), k.normals.end());
      v[0] = glm::normalize(v[0] + Vec3(0.2f, 0.1f, 0.0f));
      k.normals = v;
    });
    array("tangents", [](Mesh& k) {
      std::vector<Vec4> v(k.tangents.begin(), k.tangents.end());
      for (Vec4& t : v) t.w = -t.w;
      k.tangents = v;
    });
    array("colours", [](Mesh& k) {
      std::vector<Vec4> v(k.colours.begin(), k.colours.end());
      for (Vec4& c : v) c = Vec4(0.5f, 0.7f, 0.2f, 0.3f);
      k.colours = v;
    });
    for (int set = 0; set < 2; ++set)
      array(set ? "uv1" : "uv0", [set](Mesh& k) {
        std::vector<Vec2> v(k.uv[set].begin(), k.uv[set].end());
        for (Vec2& t : v) t = Vec2(t.y + 0.5f, t.x);
        k.uv[set] = v;
      });
    array("material", [](Mesh& k) { k.material = k.material == 0 ? 4 : 0; });
  }
  for (size_t i = 0; i < s.instances.size(); ++i) {
    out.push_back({"instances." + s.instances[i].name + ".toWorld", [i](Scene& t) { t.instances[i].toWorld[3].y += 0.05f; }});
    out.push_back({"instances." + s.instances[i].name + ".mesh", [i](Scene& t) { t.instances[i].mesh = t.instances[i].mesh == 3 ? 3 : 4; }});
  }
  for (size_t t = 0; t < s.textures.size(); ++t) {
    const std::string p = "textures." + s.textures[t]->name + ".";
    out.push_back({p + "texels", [t](Scene& k) {
                     retexture(k, t, [](Texture& x) {
                       std::vector<uint8_t> v(x.texels8.begin(), x.texels8.end());
                       std::rotate(v.begin(), v.begin() + 4, v.end());
                       x.texels8 = v;
                     });
                   }});
    out.push_back({p + "srgb", [t](Scene& k) { retexture(k, t, [](Texture& x) { x.srgb = !x.srgb; }); }});
    out.push_back({p + "nearest", [t](Scene& k) { retexture(k, t, [](Texture& x) { x.nearest = !x.nearest; }); }});
    out.push_back({p + "wrapU", [t](Scene& k) { retexture(k, t, [](Texture& x) { x.wrapU = Wrap::Mirror; }); }});
    out.push_back({p + "wrapV", [t](Scene& k) { retexture(k, t, [](Texture& x) { x.wrapV = Wrap::Clamp; }); }});
  }
  for (size_t i = 0; i < s.profiles.size(); ++i)
    out.push_back({"profiles." + std::to_string(i) + ".values", [i](Scene& k) {
                     auto copy = std::make_shared<LightProfile>(*k.profiles[i]);
                     copy->values[0] *= 0.7f;
                     (void)sealProfile(*copy);
                     k.profiles[i] = std::move(copy);
                   }});
  for (size_t l = 0; l < s.lights.size(); ++l) {
    const std::string p = "lights." + s.lights[l].name + ".";
    const LightKind kind = s.lights[l].shape.kind;
    if (kind != LightKind::Mesh && kind != LightKind::Environment) {
      add(
          p, s.lights[l].shape, [l](Scene& t) -> LightShape& { return t.lights[l].shape; }, out);
      out.push_back({p + "cameraVisible", [l](Scene& t) { t.lights[l].cameraVisible = !t.lights[l].cameraVisible; }});
    }
    out.push_back({p + "power", [l](Scene& t) { change(t.lights[l].power); }});
  }
  out.push_back({"environment.texels", [](Scene& t) { t.environment = constantEnvironment(Vec3(0.1f, 0.2f, 0.1f)); }});
  out.push_back({"environment.rotation", [](Scene& t) {
                   auto e = std::make_shared<Environment>(*t.environment);
                   e->rotation = 1.0f;
                   t.environment = e;
                 }});
  add(
      "camera.", s.cameras[0], [](Scene& t) -> Camera& { return t.cameras[0]; }, out);
  // Directions are unit and a rectangle's half edges perpendicular: the rule above bends them, so they are set right again.
  for (FieldChange& c : out)
    c.apply = [apply = c.apply](Scene& t) {
      apply(t);
      for (Light& l : t.lights) {
        l.shape.axis = glm::normalize(l.shape.axis);
        if (l.shape.kind == LightKind::Rect || l.shape.kind == LightKind::Disk) {
          const Frame f(l.shape.axis);
          l.shape.u = f.x * glm::length(l.shape.u);
          l.shape.v = f.y * glm::length(l.shape.v);
        }
      }
    };
  return out;
}

}  // namespace gobo::testing
