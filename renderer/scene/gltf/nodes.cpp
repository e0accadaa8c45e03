// SPDX-License-Identifier: Apache-2.0
// The node tree of the default scene: transforms, instances, cameras, KHR_lights_punctual, and area lights in `extras`:
//   "gobo_light": {"type": "rect"|"disk"|"sphere", "width", "height" (rect, full sizes), "radius", "power": [r,g,b] radiance,
//                  "twoSided", "cameraVisible"}, emitting along the node's -Z.
// Units: candela and lux are read as W/sr and W/m^2.
#include <glm/gtc/quaternion.hpp>

#include "scene/gltf/document.h"

namespace gobo::gltf {
namespace {

constexpr size_t kMaxInstances = 16u << 20;

class Tree {
 public:
  Tree(Document& d, Scene& scene, const std::vector<std::vector<int>>& parts)
      : d_(d), scene_(scene), parts_(parts), nodes_(d.list("nodes")), visited_(nodes_.size(), 0) { names_.insert("environment"); }

  Status read() {
    struct Item { int node; Mat4 parent; };
    std::vector<Item> stack;  // not recursion: a chain of nodes may be as long as the file
    const std::vector<int> roots = findRoots();
    for (auto r = roots.rbegin(); r != roots.rend(); ++r) stack.push_back({*r, Mat4(1.0f)});
    while (!stack.empty() && d_.ok()) {
      const Item item = stack.back();
      stack.pop_back();
      const Cursor node = nodes_.at(size_t(item.node));
      if (visited_[item.node]++) {
        node.fail("node " + std::to_string(item.node) + " is reached twice: the nodes form a cycle or share a child");
        break;
      }
      const Mat4 world = item.parent * localTransform(node);
      for (int c = 0; c < 4; ++c)
        for (int r = 0; r < 4; ++r) if (!std::isfinite(world[c][r])) { node.fail("transform overflows"); return d_.status; }
      place(node, item.node, world);
      const Cursor children = node["children"];
      for (size_t k = children.size(); k-- > 0 && d_.ok();) stack.push_back({children.at(k).index("nodes"), world});
    }
    return d_.status;
  }

 private:
  std::vector<int> findRoots() {
    std::vector<int> roots;
    const Cursor scenes = d_.list("scenes");
    if (scenes.size() > 0) {
      const int chosen = d_.root()["scene"].index("scenes");
      const Cursor list = scenes.at(size_t(chosen < 0 ? 0 : chosen))["nodes"];
      for (size_t i = 0; i < list.size() && d_.ok(); ++i) roots.push_back(list.at(i).index("nodes"));
      return roots;
    }
    std::vector<char> child(nodes_.size(), 0);
    for (size_t i = 0; i < nodes_.size() && d_.ok(); ++i) {
      const Cursor children = nodes_.at(i)["children"];
      for (size_t k = 0; k < children.size() && d_.ok(); ++k) child[size_t(std::max(0, children.at(k).index("nodes")))] = 1;
    }
    for (size_t i = 0; i < child.size(); ++i) if (!child[i]) roots.push_back(int(i));
    if (roots.empty() && !child.empty()) nodes_.fail("every node is a child: the nodes form a cycle");
    return roots;
  }

  Mat4 localTransform(const Cursor& node) {
    const Cursor matrix = node["matrix"];
    if (matrix.exists()) {
      Mat4 m(1.0f);
      if (matrix.size() != 16) { matrix.fail("is not an array of 16 numbers"); return m; }
      for (size_t i = 0; i < 16; ++i) m[int(i / 4)][int(i % 4)] = float(matrix.at(i).number(0.0));
      if (m[0][3] != 0.0f || m[1][3] != 0.0f || m[2][3] != 0.0f || m[3][3] != 1.0f) matrix.fail("last row is not 0 0 0 1");
      return m;
    }
    const Vec3 t = node["translation"].vector(Vec3(0.0f)), s = node["scale"].vector(Vec3(1.0f));
    const Vec4 q = node["rotation"].vector(Vec4(0, 0, 0, 1));
    const float length = glm::length(q);
    if (!(length > 1e-6f) || !std::isfinite(length)) { node["rotation"].fail("quaternion has no length"); return Mat4(1.0f); }
    Mat4 m = glm::mat4_cast(glm::quat(q.w / length, q.x / length, q.y / length, q.z / length));
    for (int c = 0; c < 3; ++c) m[c] *= s[c];
    m[3] = Vec4(t, 1.0f);
    return m;
  }

  std::string unique(const std::string& wanted) {
    std::string name = wanted;
    for (int& k = next_[wanted]; !names_.insert(name).second;) { k = std::max(k + 1, 2); name = wanted + "#" + std::to_string(k); }
    return name;
  }

  /// Unit axes of a transform, its scale dropped, right-handed. False when two axes coincide or one has no length.
  static bool rigid(const Mat4& m, Mat4& out) {
    const Vec3 z = glm::normalize(Vec3(m[2])), x = glm::normalize(glm::cross(Vec3(m[1]), z));
    out = Mat4(Vec4(x, 0), Vec4(glm::cross(z, x), 0), Vec4(z, 0), m[3]);
    return isFinite(z) && isFinite(x);
  }

  void place(const Cursor& node, int index, const Mat4& world) {
    const std::string name = node["name"].text();
    const std::string base = name.empty() ? "node" + std::to_string(index) : name;
    const int mesh = node["mesh"].index("meshes"), camera = node["camera"].index("cameras");
    if (node["skin"].exists()) d_.warn(node.pointer + "/skin", "skins are ignored; the rest pose is shown");
    if (node.extension("EXT_mesh_gpu_instancing").exists()) d_.warn(node.pointer, "EXT_mesh_gpu_instancing is ignored: one instance is shown");
    if (mesh >= 0 && d_.ok()) {
      if (std::fabs(glm::determinant(Mat3(world))) > 0.0f) {
        for (const int part : parts_[mesh]) scene_.instances.push_back({unique(base), part, world});
        if (scene_.instances.size() > kMaxInstances) node.fail("more than " + std::to_string(kMaxInstances) + " instances");
      } else d_.warn(node.pointer, "node with a flat or zero scale is not drawn");
    }
    Mat4 frame(1.0f);
    const Cursor punctual = node.extension("KHR_lights_punctual")["light"], area = node["extras"].json && node["extras"].json->is_object() ? node["extras"]["gobo_light"] : Cursor{&d_, nullptr, ""};
    if (camera < 0 && !punctual.exists() && !area.exists()) return;
    if (!rigid(world, frame)) { d_.warn(node.pointer, "camera or light without an orientation is left out"); return; }
    if (camera >= 0 && d_.ok()) addCamera(d_.item("cameras", camera), name, frame);
    const int light = punctual.indexInto(d_.root().extension("KHR_lights_punctual")["lights"]);
    if (light >= 0 && d_.ok()) addPunctual(d_.root().extension("KHR_lights_punctual")["lights"].at(size_t(light)), name, light, frame);
    if (area.exists() && d_.ok()) addArea(area, base, world, frame);
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
    c.name = wanted;
    for (int k = 2; !cameraNames_.insert(c.name).second; ++k) c.name = wanted + "#" + std::to_string(k);
    scene_.cameras.push_back(std::move(c));
  }

  void addPunctual(const Cursor& at, const std::string& nodeName, int index, const Mat4& frame) {
    Light l;
    const std::string type = at["type"].text();
    l.shape.position = Vec3(frame[3]);
    l.shape.axis = -Vec3(frame[2]);
    l.power = glm::max(at["color"].vector(Vec3(1.0f)), Vec3(0.0f)) * float(at["intensity"].number(1.0, 0.0, 1e30));
    l.shape.range = float(at["range"].number(0.0, 0.0, 3e38));
    if (type == "point") l.shape.kind = LightKind::Point;
    else if (type == "directional") l.shape.kind = LightKind::Directional;
    else if (type == "spot") {
      l.shape.kind = LightKind::Spot;
      const double inner = at["spot"]["innerConeAngle"].number(0.0, 0.0, kPi), outer = at["spot"]["outerConeAngle"].number(0.25 * kPi, 0.0, kPi);
      if (inner > outer) at["spot"]["innerConeAngle"].fail("inner cone is wider than the outer");
      l.shape.cosInner = float(std::cos(inner));
      l.shape.cosOuter = float(std::cos(outer));
    } else at["type"].fail("\"" + type + "\" is not point, spot or directional");
    l.name = unique(!nodeName.empty() ? nodeName : at["name"].text("light" + std::to_string(index)));
    scene_.lights.push_back(std::move(l));
  }

  void addArea(const Cursor& at, const std::string& name, const Mat4& world, const Mat4& frame) {
    Light l;
    const std::string type = at["type"].text();
    LightShape& s = l.shape;
    s.position = Vec3(frame[3]);
    s.axis = -Vec3(frame[2]);
    const Vec3 scale(glm::length(Vec3(world[0])), glm::length(Vec3(world[1])), glm::length(Vec3(world[2])));
    if (type == "rect") {
      s.kind = LightKind::Rect;
      s.u = Vec3(frame[0]) * (0.5f * scale.x * float(at["width"].number(1.0, 1e-9, 1e9)));
      s.v = Vec3(frame[1]) * (0.5f * scale.y * float(at["height"].number(1.0, 1e-9, 1e9)));
    } else if (type == "disk" || type == "sphere") {
      s.kind = type == "disk" ? LightKind::Disk : LightKind::Sphere;
      s.radius = scale.x * float(at["radius"].number(0.5, 1e-9, 1e9));
    } else at["type"].fail("\"" + type + "\" is not rect, disk or sphere");
    s.twoSided = at["twoSided"].boolean(false);
    l.cameraVisible = at["cameraVisible"].boolean(true);
    l.power = at["power"].vector(Vec3(1.0f));
    if (glm::any(glm::lessThan(l.power, Vec3(0.0f)))) at["power"].fail("power is negative");
    l.name = unique(name);
    scene_.lights.push_back(std::move(l));
  }

  Document& d_;
  Scene& scene_;
  const std::vector<std::vector<int>>& parts_;
  Cursor nodes_;
  std::vector<char> visited_;
  std::set<std::string> names_, cameraNames_;  // instances and lights share names: a Mesh light is named after its instance
  std::map<std::string, int> next_;
};

}  // namespace

Status readNodes(Document& d, Scene& scene, const std::vector<std::vector<int>>& parts) { return Tree(d, scene, parts).read(); }

}  // namespace gobo::gltf
