// SPDX-License-Identifier: Apache-2.0
// Checks, digest and size of a rig: after sealRig every index is in range, so that posing needs no checks of its own.
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "base/check.h"
#include "scene/coordinates.h"
#include "scene/scene.h"

namespace gobo {
inline namespace scene {
namespace {

template <typename T>
struct IsArray : std::false_type {};
template <typename T>
struct IsArray<Array<T>> : std::true_type {};
template <typename T>
struct IsVector : std::false_type {};
template <typename T>
struct IsVector<std::vector<T>> : std::true_type {};

template <typename Field>
void addField(Hasher& h, const Field& f) {
  if constexpr (std::is_same_v<Field, MeshPtr>) h.add(f->topologyHash).add(f->positionsHash).add(f->shadingHash);
  else if constexpr (std::is_same_v<Field, std::string>) h.add(f);
  else if constexpr (IsArray<Field>::value) h.addArray(f);
  else if constexpr (IsVector<Field>::value) {
    h.add(uint64_t(f.size()));
    for (const auto& item : f) addField(h, item);
  } else if constexpr (std::is_arithmetic_v<Field> || std::is_enum_v<Field>) h.add(f);
  else if constexpr (requires { f.length(); }) h.addPod(f);
  else visitFields(f, [&](const char*, const auto& field) { addField(h, field); });
}

template <typename Field>
size_t fieldBytes(const Field& f) {
  size_t n = 0;
  if constexpr (IsArray<Field>::value) n = f.size() * sizeof(typename Field::value_type);
  else if constexpr (std::is_same_v<Field, MeshPtr>) n = f->positions.size() * sizeof(Vec3) * 2;
  else if constexpr (IsVector<Field>::value)
    for (const auto& item : f) n += fieldBytes(item);
  else if constexpr (requires { visitFields(f, [](const char*, const auto&) {}); })
    visitFields(f, [&](const char*, const auto& field) { n += fieldBytes(field); });
  return n;
}

template <typename T>
bool fits(const Array<T>& values, size_t n) {
  return values.empty() || values.size() == n;
}

bool inRange(int i, size_t n) { return i >= 0 && size_t(i) < n; }

bool allFinite(std::span<const float> values) {
  for (const float v : values)
    if (!std::isfinite(v)) return false;
  return true;
}
template <typename V>
bool allFinite(const V& v) requires requires {
  v.length();
}
{ return allFinite(std::span<const float>(&v[0], size_t(v.length()))); }
// Doubles that floats hold: poses are told in them.
bool allFinite(const DVec3& v) {
  for (int c = 0; c < 3; ++c)
    if (!(std::fabs(v[c]) <= double(std::numeric_limits<float>::max()))) return false;
  return true;
}
bool allFinite(const DMat4& m) {
  for (int c = 0; c < 4; ++c)
    if (!allFinite(DVec3(m[c])) || !(std::fabs(m[c][3]) <= 1.0)) return false;  // 0 0 0 1
  return true;
}
bool allFinite(const Mat4& m) { return allFinite(std::span<const float>(&m[0][0], 16)); }

class Checker {
 public:
  Checker(const Rig& rig, const Scene& scene) : rig_(rig), scene_(scene) {}

  Status run() {
    if (!isCoordinate(rig_.origin)) return fail("origin", 0, "is not finite or beyond 1e9");
    for (size_t i = 0; i < rig_.nodes.size(); ++i) {
      const RigNode& n = rig_.nodes[i];
      if (n.parent < -1 || n.parent >= int(i)) return fail("nodes", i, "parent is not before its child");
      if (!allFinite(n.translation) || !allFinite(n.scale) || !allFinite(n.rotation) || !allFinite(n.matrix))
        return fail("nodes", i, "transform is not finite");
      if (!(glm::length(n.rotation) > 1e-6f)) return fail("nodes", i, "rotation has no length");
    }
    for (size_t i = 0; i < rig_.skins.size(); ++i) {
      const RigSkin& s = rig_.skins[i];
      if (s.joints.empty() || s.joints.size() != s.inverseBind.size()) return fail("skins", i, "joints and matrices differ in number");
      for (const int32_t j : s.joints)
        if (!inRange(j, rig_.nodes.size())) return fail("skins", i, "joint is out of range");
      for (const Mat4& m : s.inverseBind)
        if (!allFinite(m)) return fail("skins", i, "matrix is not finite");
    }
    for (size_t i = 0; i < rig_.meshes.size(); ++i)
      if (!rig_.meshes[i]) return fail("meshes", i, "mesh is null");
    GOBO_TRY(sources());
    for (size_t i = 0; i < rig_.deformed.size(); ++i) GOBO_TRY(deformed(i));
    for (size_t i = 0; i < rig_.followers.size(); ++i) {
      const RigFollower& f = rig_.followers[i];
      const size_t n = f.kind == RigKind::Instance ? scene_.instances.size() : f.kind == RigKind::Camera ? scene_.cameras.size() : scene_.lights.size();
      if (f.kind > RigKind::Light || !inRange(f.object, n) || !inRange(f.node, rig_.nodes.size()))
        return fail("followers", i, "object or node is out of range");
      if (!allFinite(f.local) || !allFinite(f.half) || !std::isfinite(f.radius)) return fail("followers", i, "a number is not finite");
    }
    return animations();
  }

 private:
  Status fail(const char* list, size_t i, const char* what) const { return invalidArgument(what, scene_.name + "#/rig/" + list + "/" + std::to_string(i)); }

  Status sources() {
    for (size_t i = 0; i < rig_.sources.size(); ++i) {
      const RigSource& s = rig_.sources[i];
      if (!inRange(s.mesh, rig_.meshes.size())) return fail("sources", i, "mesh is out of range");
      const Mesh& mesh = *rig_.meshes[s.mesh];
      const size_t n = mesh.positions.size();
      if (!fits(mesh.normals, n) || !fits(mesh.tangents, n) || !fits(mesh.colours, n) ||
          !std::all_of(mesh.uv.begin(), mesh.uv.end(), [&](const Array<Vec2>& set) { return fits(set, n); }))
        return fail("sources", i, "vertex arrays of different lengths");
      if (std::any_of(mesh.indices.begin(), mesh.indices.end(), [&](uint32_t k) { return k >= n; })) return fail("sources", i, "an index is out of range");
      if (s.influences < 0 || s.influences > 1024 || s.joints.size() != n * size_t(s.influences) || s.weights.size() != s.joints.size())
        return fail("sources", i, "joints and weights do not fit the vertices");
      if (!allFinite(std::span<const float>(s.weights))) return fail("sources", i, "a weight is not finite");
      for (const RigTarget& t : s.targets) {
        if (!fits(t.positions, n) || !fits(t.normals, n) || !fits(t.tangents, n) || !fits(t.colours, n))
          return fail("sources", i, "a target does not fit the vertices");
        for (const Array<Vec2>& set : t.uv)
          if (!fits(set, n)) return fail("sources", i, "a target does not fit the vertices");
      }
      uint16_t most = 0;
      for (const uint16_t j : s.joints) most = std::max(most, j);
      mostJoint_.push_back(most);
    }
    return {};
  }

  Status deformed(size_t i) {
    const RigDeformed& d = rig_.deformed[i];
    if (!inRange(d.mesh, scene_.meshes.size()) || !inRange(d.source, rig_.sources.size()) || !inRange(d.node, rig_.nodes.size()))
      return fail("deformed", i, "mesh, source or node is out of range");
    const RigSource& s = rig_.sources[d.source];
    if (d.skin < -1 || d.skin >= int(rig_.skins.size())) return fail("deformed", i, "skin is out of range");
    if (d.skin >= 0 && (s.influences == 0 || mostJoint_[d.source] >= rig_.skins[d.skin].joints.size()))
      return fail("deformed", i, "a joint of the mesh is not in the skin");
    if (d.weights.size() != s.targets.size() || !allFinite(std::span<const float>(d.weights))) return fail("deformed", i, "weights do not fit the targets");
    return {};
  }

  Status animations() const {
    std::set<std::string_view> names;
    std::vector<size_t> targets(rig_.nodes.size(), 0);
    for (const RigDeformed& d : rig_.deformed) targets[d.node] = std::max(targets[d.node], d.weights.size());
    for (size_t i = 0; i < rig_.animations.size(); ++i) {
      const RigAnimation& a = rig_.animations[i];
      if (!names.insert(a.name).second) return fail("animations", i, "duplicate name");
      if (!std::isfinite(a.start) || !std::isfinite(a.end)) return fail("animations", i, "range is not finite");
      for (const RigSampler& s : a.samplers) {
        if (s.times.empty() || s.interpolation > RigInterpolation::CubicSpline) return fail("animations", i, "sampler without keys");
        for (size_t k = 0; k < s.times.size(); ++k)
          if (!std::isfinite(s.times[k]) || (k && s.times[k] <= s.times[k - 1])) return fail("animations", i, "key times do not increase");
        if (!allFinite(std::span<const float>(s.values))) return fail("animations", i, "a value is not finite");
      }
      for (const RigChannel& c : a.channels) {
        if (!inRange(c.node, rig_.nodes.size()) || !inRange(c.sampler, a.samplers.size()) || c.path > RigPath::Weights)
          return fail("animations", i, "channel is out of range");
        const RigSampler& s = a.samplers[c.sampler];
        const size_t width = c.path == RigPath::Weights ? targets[c.node] : c.path == RigPath::Rotation ? 4 : 3;
        const size_t per = s.interpolation == RigInterpolation::CubicSpline ? 3 : 1;
        if (s.values.size() != s.times.size() * width * per) return fail("animations", i, "values do not fit the keys");
      }
    }
    return {};
  }

  const Rig& rig_;
  const Scene& scene_;
  std::vector<size_t> mostJoint_;
};

}  // namespace

Status sealRig(Rig& rig, const Scene& scene) {
  GOBO_TRY(Checker(rig, scene).run());
  Hasher h("rig");
  addField(h, rig);
  rig.content = h.digest();
  return {};
}

size_t rigBytes(const Rig& rig) { return sizeof(Rig) + fieldBytes(rig) + rig.nodes.size() * sizeof(RigNode); }

}  // namespace scene
}  // namespace gobo
