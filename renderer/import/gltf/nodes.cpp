// SPDX-License-Identifier: Apache-2.0
// The node tree of the default scene: transforms, instances, cameras, KHR_lights_punctual, and area lights in `extras`:
//   "gobo_light": {"type": "rect"|"disk"|"sphere", "width", "height" (rect, full sizes), "radius", "radiance": [r,g,b] W/(m^2 sr) or
//                  "power_w": [r,g,b] W, "twoSided", "cameraVisible"}, emitting along the node's -Z.
//   of a KHR_lights_punctual light: {"angularSize"} (directional), {"gobo": {"index": texture}} (spot) or {"ies": {"uri" | "bufferView" | "text"}}
//                  (point, spot), either turned by "rotation".
// Units: candela and lux are read as W/sr and W/m^2.
#include <algorithm>
#include <glm/gtc/quaternion.hpp>

#include "import/gltf/origin.h"
#include "import/gltf/texture.h"
#include "import/gltf/unique_names.h"
#include "scene/rig_sample.h"

namespace gobo::gltf {
namespace {

constexpr size_t kMaxInstances = 16u << 20;

class Tree {
 public:
  Tree(Document& d, Scene& scene, Rig& rig, Parts& parts, const std::vector<int>& place)
      : d_(d), scene_(scene), rig_(rig), parts_(parts), textures_(d, scene), nodes_(d.list("nodes")), place_(place) {
    names_.reserve("environment");
  }

  Status read() {
    pose_ = evaluatePose(rig_, {}, 0.0);
    moves_ = d_.list("animations").size() > 0;
    const std::vector<int> drawn = drawnNodes();
    findOrigin(drawn);
    for (const int index : drawn) {
      if (!d_.ok()) break;
      const Cursor node = nodes_.at(size_t(index));
      const Mat4 world(pose_.world[place_[index]]);
      for (int c = 0; c < 4; ++c)
        for (int r = 0; r < 4; ++r)
          if (!std::isfinite(world[c][r])) {
            node.fail("transform overflows");
            return d_.status;
          }
      place(node, index, world);
    }
    return d_.status;
  }

 private:
  /// Parents before children, in the order of the file.
  std::vector<int> drawnNodes() {
    std::vector<int> stack = findRoots(), drawn;  // not recursion: a chain of nodes may be as long as the file
    std::reverse(stack.begin(), stack.end());
    while (!stack.empty() && d_.ok()) {
      drawn.push_back(stack.back());
      const Cursor children = nodes_.at(size_t(stack.back()))["children"];
      stack.pop_back();
      for (size_t k = children.size(); k-- > 0 && d_.ok();) stack.push_back(children.at(k).index("nodes"));
    }
    return drawn;
  }

  /// Where the scene's coordinates begin, and those of meshes that lie far from their own 0 (origin.h).
  void findOrigin(const std::vector<int>& drawn) {
    Box all;
    std::map<const Mesh*, Box> boxes;
    std::set<int> skins;  // seen: many nodes may share one of many joints
    for (const int index : drawn) {
      const Cursor node = nodes_.at(size_t(index));
      const int mesh = node["mesh"].index("meshes"), skin = node["skin"].index("skins");
      if (!d_.ok()) return;
      if (mesh < 0 || node.extension("EXT_mesh_gpu_instancing").exists()) continue;  // its copies may be anywhere
      for (const Part& part : parts_[mesh]) {
        if (skin >= 0 && part.source >= 0 && rig_.sources[part.source].influences > 0) {  // joints alone place it
          if (skins.insert(skin).second)
            for (const int32_t j : rig_.skins[skin].joints) all.add(DVec3(pose_.world[j][3]));
          continue;
        }
        const auto [known, fresh] = boxes.try_emplace(part.mesh.get());
        if (fresh) known->second = boxOf(*part.mesh);
        const Box here = transformed(known->second, pose_.world[place_[index]]);
        if (here.empty()) continue;
        all.add(here.lo);
        all.add(here.hi);
      }
    }
    rig_.origin = scene_.origin = originFor(all);
    if (scene_.origin == DVec3(0.0)) return;
    char text[160];
    std::snprintf(text, sizeof text, "the scene lies %.3g m from the file's origin: its coordinates are relative to %.15g %.15g %.15g",
                  glm::length(scene_.origin), scene_.origin.x, scene_.origin.y, scene_.origin.z);
    d_.warn("/scene", text);
    pose_ = evaluatePose(rig_, {}, 0.0);
    for (std::vector<Part>& mesh : parts_)
      for (Part& part : mesh) centreMesh(part);
  }

  void centreMesh(Part& part) {
    RigSource* const source = part.source < 0 ? nullptr : &rig_.sources[part.source];
    if (source && source->influences > 0) return;  // its joints' matrices take positions as they are
    const Vec3 centre(originFor(boxOf(*part.mesh)));
    if (centre == Vec3(0.0f) || !d_.account(part.mesh->positions.size() * sizeof(Vec3), d_.list("meshes"))) return;
    auto moved = std::make_shared<Mesh>(*part.mesh);
    for (Vec3& p : moved->positions) p -= centre;  // exact: they are near each other, in proportion to what they are
    sealMesh(*moved);
    if (part.sceneMesh >= 0) scene_.meshes[part.sceneMesh] = moved;
    if (source) rig_.meshes[source->mesh] = moved;
    part.mesh = std::move(moved);
    part.centre = DVec3(centre);
  }

  std::vector<int> findRoots() {
    std::vector<int> roots;
    const Cursor scenes = d_.list("scenes");
    if (scenes.size() > 0) {
      const int chosen = d_.root()["scene"].index("scenes");
      const Cursor list = scenes.at(size_t(chosen < 0 ? 0 : chosen))["nodes"];
      std::set<int> seen;
      for (size_t i = 0; i < list.size() && d_.ok(); ++i) {
        const int node = list.at(i).index("nodes");
        if (node < 0) continue;
        if (rig_.nodes[place_[node]].parent >= 0) d_.warn(list.at(i).pointer, "node is not a root; it is shown with its ancestors' transforms");
        if (!seen.insert(node).second) {
          list.at(i).fail("node " + std::to_string(node) + " is reached twice");
          return {};
        }
        roots.push_back(node);
      }
      // A listed node below another listed one would be drawn twice.
      std::vector<char> listed(rig_.nodes.size(), 0), below(rig_.nodes.size(), 0);
      for (const int r : roots) listed[place_[r]] = 1;
      for (size_t i = 0; i < rig_.nodes.size(); ++i)
        if (const int p = rig_.nodes[i].parent; p >= 0) below[i] = listed[p] || below[p];
      std::vector<int> kept;
      for (const int r : roots)
        if (!below[place_[r]]) kept.push_back(r);
      return kept;
    }
    for (size_t i = 0; i < nodes_.size(); ++i)
      if (rig_.nodes[place_[i]].parent < 0) roots.push_back(int(i));
    return roots;
  }

  void follow(RigKind kind, size_t object, int node, const Mat4& local = Mat4(1.0f)) {
    RigFollower f;
    f.kind = kind;
    f.object = int(object);
    f.node = place_[node];
    f.local = local;
    rig_.followers.push_back(f);
  }

  void place(const Cursor& node, int index, const Mat4& world) {
    const std::string name = node["name"].text();
    const std::string base = name.empty() ? "node" + std::to_string(index) : name;
    const int mesh = node["mesh"].index("meshes"), camera = node["camera"].index("cameras");
    if (mesh >= 0 && d_.ok()) placeMesh(node, index, base, mesh, world);
    Mat4 frame(1.0f);
    const Cursor punctual = node.extension("KHR_lights_punctual")["light"], measured = node.extension("EXT_lights_ies"), area = goboLight(node);
    if (!d_.ok() || (camera < 0 && !punctual.exists() && !measured.exists() && !area.exists())) return;
    const bool oriented = rigidFrame(world, frame, Vec3(pose_.facing[place_[index]]));
    if (!oriented) frame = turnedFrame(pose_, place_[index]);
    if (camera >= 0 && !oriented && !moves_) d_.warn(node.pointer, "camera without an orientation is left out");
    else if (camera >= 0 && d_.ok()) {
      addCamera(d_.item("cameras", camera), name, frame);
      follow(RigKind::Camera, scene_.cameras.size() - 1, index);
    }
    const int light = punctual.indexInto(d_.root().extension("KHR_lights_punctual")["lights"]);
    if (light >= 0 && d_.ok()) {
      addPunctual(d_.root().extension("KHR_lights_punctual")["lights"].at(size_t(light)), name, light);
      follow(RigKind::Light, scene_.lights.size() - 1, index);
    }
    if (measured.exists() && d_.ok()) {
      follow(RigKind::Light, scene_.lights.size(), index);
      addMeasured(measured, base);
    }
    if (area.exists() && d_.ok()) {
      follow(RigKind::Light, scene_.lights.size(), index);
      addArea(area, base, world, rig_.followers.back());
    }
  }

  /// The scene mesh that shows a part at a node: its own when the node deforms it, else shared.
  int sceneMesh(const Cursor& node, int index, Part& part, int skin) {
    const bool morphs = part.source >= 0 && !rig_.sources[part.source].targets.empty(),
               skinned = skin >= 0 && part.source >= 0 && rig_.sources[part.source].influences > 0;
    if (!morphs && !skinned && part.sceneMesh >= 0) return part.sceneMesh;
    const int made = int(scene_.meshes.size());
    scene_.meshes.push_back(part.mesh);
    for (VariantUse use : part.variants) {
      use.mesh = made;
      scene_.variants.uses.push_back(use);
    }
    if (!morphs && !skinned) return part.sceneMesh = made;
    // What its pose costs, in memory and (targets, influences) in time: many nodes may deform one mesh.
    const RigSource& source = rig_.sources[part.source];
    if (!d_.account(part.mesh->positions.size() * (48 + 16 * source.targets.size() + 16 * size_t(source.influences)), node)) return made;
    if (skinned)
      for (const uint16_t j : std::as_const(rig_.sources[part.source].joints))
        if (j >= rig_.skins[skin].joints.size()) {
          node["mesh"].fail("joint " + std::to_string(j) + " of its JOINTS is out of range: skin " + std::to_string(skin) + " has " +
                            std::to_string(rig_.skins[skin].joints.size()));
          return made;
        }
    RigDeformed r;
    r.mesh = made;
    r.source = part.source;
    r.node = place_[index];
    r.skin = skinned ? skin : -1;
    const size_t targets = rig_.sources[part.source].targets.size();
    const Cursor own = node["weights"];
    if (own.exists() && own.size() != targets) d_.warn(own.pointer, std::to_string(own.size()) + " weights for " + std::to_string(targets) + " morph targets");
    std::vector<float> weights(targets, 0.0f);
    for (size_t t = 0; t < targets; ++t) {
      if (own.exists()) weights[t] = float(own.at(t).number(0.0));
      else if (t < part.weights.size()) weights[t] = part.weights[t];
    }
    r.weights = std::move(weights);
    rig_.deformed.push_back(std::move(r));
    return made;
  }

  void placeMesh(const Cursor& node, int index, const std::string& base, int mesh, const Mat4& world) {
    const int skin = node["skin"].index("skins");
    const Cursor instancing = node.extension("EXT_mesh_gpu_instancing");
    std::vector<Mat4> copies{Mat4(1.0f)};
    if (instancing.exists() && d_.ok()) readInstancing(instancing, copies);
    if (!d_.ok()) return;
    bool unskinned = false;
    for (Part& part : parts_[mesh]) {
      const bool skinned = skin >= 0 && part.source >= 0 && rig_.sources[part.source].influences > 0;
      unskinned = unskinned || (skin >= 0 && !skinned);
      if (Mat4 solid; !skinned && !moves_ && !solidTransform(world, solid)) {
        d_.warn(node.pointer, "node whose scale makes it a line or a point is not drawn");
        return;
      }
      const int shown = sceneMesh(node, index, part, skin);
      if (skinned) {
        scene_.instances.push_back({names_.take(base), shown, Mat4(1.0f)});
        continue;
      }  // joints alone place a skinned mesh
      if (!d_.account(copies.size() * (sizeof(Instance) + sizeof(RigFollower) + 64), node)) return;
      for (const Mat4& local : copies) {
        scene_.instances.push_back({names_.take(base), shown, world});
        DMat4 placed(local);
        placed[3] = placed * glm::dvec4(part.centre, 1.0);
        follow(RigKind::Instance, scene_.instances.size() - 1, index, Mat4(placed));
      }
      if (scene_.instances.size() > kMaxInstances) {
        node.fail("more than " + std::to_string(kMaxInstances) + " instances");
        return;
      }
    }
    if (unskinned) d_.warn(node.pointer + "/skin", "a primitive of the mesh has no joints and weights; it is not skinned");
  }

  /// EXT_mesh_gpu_instancing: translation * rotation * scale of each instance, applied before the node's transform.
  void readInstancing(const Cursor& at, std::vector<Mat4>& copies) {
    const Cursor attributes = at["attributes"];
    const int t = attributes["TRANSLATION"].index("accessors"), r = attributes["ROTATION"].index("accessors"), s = attributes["SCALE"].index("accessors");
    if (!d_.ok()) return;
    if (t < 0 && r < 0 && s < 0) {
      d_.warn(at.pointer, "instancing without TRANSLATION, ROTATION or SCALE: one instance is shown");
      return;
    }
    std::vector<float> ts, rs, ss;
    if ((t >= 0 && !readFloats(d_, t, 3, ts)) || (r >= 0 && !readFloats(d_, r, 4, rs)) || (s >= 0 && !readFloats(d_, s, 3, ss))) return;
    const size_t n = t >= 0 ? ts.size() / 3 : r >= 0 ? rs.size() / 4 : ss.size() / 3;
    if ((r >= 0 && rs.size() != n * 4) || (s >= 0 && ss.size() != n * 3)) {
      attributes.fail("instance attributes differ in number");
      return;
    }
    if (n > kMaxInstances || !d_.account(n * sizeof(Mat4), at)) {
      at.fail("more than " + std::to_string(kMaxInstances) + " instances");
      return;
    }
    copies.assign(n, Mat4(1.0f));
    size_t bad = 0;
    for (size_t i = 0; i < n; ++i) {
      glm::dquat q(1, 0, 0, 0);
      if (r >= 0) q = glm::dquat(rs[i * 4 + 3], rs[i * 4], rs[i * 4 + 1], rs[i * 4 + 2]);
      const double length = glm::length(q);
      Mat4 m(glm::mat4_cast(length > 1e-6 ? q / length : glm::dquat(1, 0, 0, 0)));
      if (s >= 0)
        for (int c = 0; c < 3; ++c) m[c] *= ss[i * 3 + size_t(c)];
      if (t >= 0) m[3] = Vec4(ts[i * 3], ts[i * 3 + 1], ts[i * 3 + 2], 1.0f);
      bool finite = true;
      for (int c = 0; c < 16; ++c) finite = finite && std::isfinite(m[c / 4][c % 4]);
      if (finite) copies[i] = m;
      else ++bad;
    }
    if (bad) d_.warn(attributes.pointer, std::to_string(bad) + " instance transforms are not finite and stand at the node");
  }

  void addCamera(const Cursor& at, const std::string& nodeName, const Mat4& frame) {
    Camera c;
    c.toWorld = frame;
    const std::string type = at["type"].text(), wanted = !nodeName.empty() ? nodeName : at["name"].text("camera");
    if (type == "perspective") {
      if (!at[type.c_str()]["yfov"].exists()) at["perspective"]["yfov"].fail("yfov is missing");
      c.yfov = float(at["perspective"]["yfov"].number(0.8, 1e-5, 3.14159));
    } else if (type == "orthographic") {
      c.perspective = false;
      c.yheight = 2.0f * std::fabs(float(at["orthographic"]["ymag"].number(1.0, -1e12, 1e12)));
      if (!(c.yheight > 0.0f)) at["orthographic"]["ymag"].fail("ymag is 0");
    } else at["type"].fail("\"" + type + "\" is not perspective or orthographic");
    c.name = cameraNames_.take(wanted);
    scene_.cameras.push_back(std::move(c));
  }

  void addPunctual(const Cursor& at, const std::string& nodeName, int index) {
    Light l;
    const std::string type = at["type"].text();
    setPower(l, {glm::max(at["color"].vector(Vec3(1.0f)), Vec3(0.0f)), float(at["intensity"].number(1.0, 0.0, 1e30))});
    l.shape.range = float(at["range"].number(0.0, 0.0, 3e38));
    if (type == "point") l.shape.kind = LightKind::Point;
    else if (type == "directional") {
      l.shape.kind = LightKind::Directional;
      const Cursor size = goboLight(at)["angularSize"];
      l.shape.angularSize = float(size.number(0.0, 0.0, 0.5 * kPi));
      if (l.shape.angularSize != 0.0f && l.shape.angularSize < kLeastAngularSize) size.fail("angularSize is below 1.7e-6 radians and not 0");
    } else if (type == "spot") {
      l.shape.kind = LightKind::Spot;
      const double inner = at["spot"]["innerConeAngle"].number(0.0, 0.0, kPi), outer = at["spot"]["outerConeAngle"].number(0.25 * kPi, 0.0, kPi);
      if (inner > outer) at["spot"]["innerConeAngle"].fail("inner cone is wider than the outer");
      l.shape.cosInner = float(std::cos(inner));
      l.shape.cosOuter = float(std::cos(outer));
    } else at["type"].fail("\"" + type + "\" is not point, spot or directional");
    addProfile(at, l);
    l.name = names_.take(!nodeName.empty() ? nodeName : at["name"].text("light" + std::to_string(index)));
    scene_.lights.push_back(std::move(l));
  }

  /// The profile that a light's extras give it. Lights that share a KHR light share it.
  void addProfile(const Cursor& at, Light& l) {
    const Cursor extras = goboLight(at), gobo = extras["gobo"], ies = extras["ies"];
    if (!gobo.exists() && !ies.exists()) return;
    if (gobo.exists() && ies.exists()) ies.fail("the light has a gobo as well; give one");
    if (gobo.exists() && l.shape.kind != LightKind::Spot) gobo.fail("a gobo is projected through the cone of a spot, which the light is not");
    if (ies.exists() && l.shape.kind == LightKind::Directional) ies.fail("photometric data are of point and spot lights");
    const float rotation = float(extras["rotation"].number(0.0, -1e6, 1e6));
    if (!d_.ok()) return;
    const auto [known, fresh] = profiles_.try_emplace(extras.pointer, -1);
    if (fresh && gobo.exists()) {
      auto made = std::make_shared<LightProfile>();
      if (!textures_.picture(gobo, *made)) {
        if (d_.ok()) d_.warn(gobo.pointer, "the light shines without its gobo");
        return;
      }
      if (const Status sealed = sealProfile(*made); !sealed.ok()) {
        gobo.fail("picture \"" + made->name + "\": " + sealed.message());
        return;
      }
      known->second = int(scene_.profiles.size());
      scene_.profiles.push_back(std::move(made));
    } else if (fresh) {
      known->second = int(scene_.profiles.size());
      scene_.profiles.push_back(d_.photometry.at(ies.pointer).profile);
    }
    l.shape.profile = known->second;
    l.shape.profileRotation = known->second < 0 ? 0.0f : rotation;
  }

  /// EXT_lights_ies: a point whose intensity is the file's candela.
  void addMeasured(const Cursor& at, const std::string& name) {
    const Cursor lights = d_.root().extension("EXT_lights_ies")["lights"];
    const int light = at["light"].indexInto(lights);
    Light l;
    const Vec3 color = glm::clamp(at["color"].vector(Vec3(1.0f)), Vec3(0.0f), Vec3(1.0f));
    const float multiplier = float(at["multiplier"].number(1.0, 0.0, 1e18));
    if (light < 0 || !d_.ok()) {
      at["light"].fail("light is missing");
      return;
    }
    const Cursor profile = lights.at(size_t(light));
    const IesPhotometry& data = d_.photometry.at(profile.pointer);
    setPower(l, {color, multiplier * float(data.candela)});
    const auto [known, fresh] = profiles_.try_emplace(profile.pointer, int(scene_.profiles.size()));
    if (fresh) scene_.profiles.push_back(data.profile);
    l.shape.profile = known->second;
    l.name = names_.take(name);
    scene_.lights.push_back(std::move(l));
  }

  void addArea(const Cursor& at, const std::string& name, const Mat4& world, RigFollower& follower) {
    Light l;
    const std::string type = at["type"].text();
    LightShape& s = l.shape;
    if (type == "rect") {
      s.kind = LightKind::Rect;
      follower.half = 0.5f * Vec2(float(at["width"].number(1.0, 1e-9, 1e9)), float(at["height"].number(1.0, 1e-9, 1e9)));
    } else if (type == "disk" || type == "sphere") {
      s.kind = type == "disk" ? LightKind::Disk : LightKind::Sphere;
      follower.radius = float(at["radius"].number(0.5, 1e-9, 1e9));
    } else at["type"].fail("\"" + type + "\" is not rect, disk or sphere");
    s.twoSided = at["twoSided"].boolean(false);
    l.cameraVisible = at["cameraVisible"].boolean(true);
    l.power = areaRadiance(at, type, s.twoSided, follower, world);
    if (d_.ok() && !moves_ && leastSize(type, follower, world) < double(kLeastLampSize))
      d_.warn(at.pointer, "the node's scale leaves the light no size: it gives next to no light");
    l.name = names_.take(name);
    scene_.lights.push_back(std::move(l));
  }

  /// The smaller half side, or the radius, that a node gives an area light.
  static double leastSize(const std::string& type, const RigFollower& follower, const Mat4& world) {
    const double x = glm::length(Vec3(world[0])), y = glm::length(Vec3(world[1]));
    return type == "rect" ? std::min(double(follower.half.x) * x, double(follower.half.y) * y) : double(follower.radius) * x;
  }

  /// `radiance`, or `power_w` spread over the shape at the size that the node gives it at rest: a Lambert emitter of radiance L sends
  /// pi L area from a side. `power` is the first name of radiance.
  Vec3 areaRadiance(const Cursor& at, const std::string& type, bool twoSided, const RigFollower& follower, const Mat4& world) {
    std::string given;
    for (const char* key : {"radiance", "power_w", "power"}) {
      if (!at[key].exists()) continue;
      if (!given.empty()) {
        at[key].fail("the light has \"" + given + "\" as well; give one");
        return Vec3(1.0f);
      }
      given = key;
    }
    if (given.empty()) return Vec3(1.0f);
    const Vec3 value = at[given.c_str()].vector(Vec3(1.0f));
    if (glm::any(glm::lessThan(value, Vec3(0.0f)))) at[given.c_str()].fail(given + " is negative");
    if (given == "power") d_.warn(at.pointer + "/power", "is read as radiance, W/(m^2 sr); write \"radiance\", or \"power_w\" for watts");
    if (given != "power_w") return value;
    const double x = glm::length(Vec3(world[0])), y = glm::length(Vec3(world[1])), r = double(follower.radius) * x;
    const double area = type == "rect" ? 4.0 * double(follower.half.x) * x * double(follower.half.y) * y : (type == "disk" ? 1.0 : 4.0) * kPi * r * r;
    const DVec3 radiance = DVec3(value) / (kPi * area * (twoSided && type != "sphere" ? 2.0 : 1.0));
    // A smaller light than the least is made as large as that, and would have more than its power.
    if (leastSize(type, follower, world) < double(kLeastLampSize) || !glm::all(glm::lessThan(radiance, DVec3(1e30)))) {
      at[given.c_str()].fail("the light is too small for its power");
      return Vec3(1.0f);
    }
    return Vec3(radiance);
  }

  Document& d_;
  Scene& scene_;
  Rig& rig_;
  Parts& parts_;
  Textures textures_;  // of profiles
  Cursor nodes_;
  const std::vector<int>& place_;
  RigPose pose_;
  bool moves_ = false;                   // animations may give a node of scale 0 its size
  UniqueNames names_, cameraNames_;      // instances and lights share names: a Mesh light is named after its instance
  std::map<std::string, int> profiles_;  // by the pointer of what gave it
};

}  // namespace

Status readNodes(Document& d, Scene& scene, Rig& rig, Parts& parts, const std::vector<int>& place) { return Tree(d, scene, rig, parts, place).read(); }

}  // namespace gobo::gltf
