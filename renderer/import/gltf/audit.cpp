// SPDX-License-Identifier: Apache-2.0
// Rules of the format beyond its structure (schema.h), for what the readers pass over: extensions, cameras, pictures, nodes, skins,
// animations. What is harmless becomes a warning with its place; the two that leave a camera without meaning are refused.
// rules.cpp names the rule behind each code of the Khronos validator. O(document).
#include "import/gltf/audit.h"

#include <algorithm>
#include <cmath>

#include "import/gltf/container.h"

namespace gobo::gltf {
namespace {

using namespace audits;

class Auditor {
 public:
  explicit Auditor(Document& d) : d_(d), j_(d.json) {}

  void run() {
    extensions();
    each(j_, "cameras", [&](const Json& c, const std::string& at) { camera(c, at); });
    lights();
    for (size_t i = 0; i < d_.images.size(); ++i) image(i);
    each(j_, "textures", [&](const Json& t, const std::string& at) { texture(t, at); });
    each(j_, "nodes", [&](const Json& n, const std::string& at) { node(n, at); });
    each(j_, "skins", [&](const Json& s, const std::string& at) { skin(s, at); });
    scenes();
    each(j_, "animations", [&](const Json& a, const std::string& at) { animation(a, at); });
  }

 private:
  void fail(const std::string& at, const std::string& why) {
    if (d_.ok()) d_.status = invalidArgument(why, d_.path + "#" + at);
  }

  void extensions() {
    const Json &used = get(j_, "extensionsUsed"), &required = get(j_, "extensionsRequired");
    const auto lists = [](const Json& list, const Json& name) { return list.is_array() && std::find(list.begin(), list.end(), name) != list.end(); };
    for (size_t i = 0; i < length(required); ++i)
      if (!lists(used, required[i]))
        d_.warn(place("/extensionsRequired", i), "extension " + shown(required[i]) + " is required but not listed in extensionsUsed");
    for (size_t i = 0; i < length(used); ++i)
      if (used[i] == "KHR_mesh_quantization" && !lists(required, used[i])) d_.warn(place("/extensionsUsed", i), "KHR_mesh_quantization must be required too");
  }

  void camera(const Json& c, const std::string& at) {
    const Json& kind = get(c, "type");
    if ((kind == "perspective" || kind == "orthographic") && get(c, kind.get_ref<const std::string&>().c_str()).is_null())
      fail(at, kind.get<std::string>() + " is missing");
    for (const char* name : {"perspective", "orthographic"}) {
      const Json& lens = get(c, name);
      const std::string here = at + "/" + name;
      if (const Json& far = get(lens, "zfar"); far.is_number() && number(far, 0) <= number(get(lens, "znear"), 0))
        d_.warn(here, "zfar is not beyond znear (neither clips here)");
      for (const char* key : {"xmag", "ymag"})
        if (get(lens, key).is_number() && get(lens, key) == 0) fail(here + "/" + key, std::string(key) + " is 0");
    }
  }

  void lights() {
    const Json& list = get(get(get(j_, "extensions"), "KHR_lights_punctual"), "lights");
    for (size_t i = 0; i < length(list); ++i) {
      const std::string at = place("/extensions/KHR_lights_punctual/lights", i);
      if (get(list[i], "type") != "spot") continue;
      const Json& spot = get(list[i], "spot");
      if (spot.is_null()) {
        d_.warn(at + "/spot", "spot is missing; its defaults count");
        continue;
      }
      const double inner = number(get(spot, "innerConeAngle"), 0), outer = number(get(spot, "outerConeAngle"), 0.25 * kPi);
      if (inner > outer) fail(at + "/spot/innerConeAngle", "inner cone of " + std::to_string(inner) + " is wider than the outer of " + std::to_string(outer));
      else if (inner == outer) d_.warn(at + "/spot", "inner and outer cone are the same");
    }
  }

  void image(size_t i) {
    const Json& image = get(j_, "images")[i];
    const std::string at = place("/images", i);
    const bool view = !get(image, "bufferView").is_null();
    if (view && !get(item(get(j_, "bufferViews"), get(image, "bufferView")), "byteStride").is_null())
      d_.warn(at + "/bufferView", "pictures may not be strided");
    const std::vector<uint8_t>& bytes = d_.images[i].bytes;
    if (bytes.empty()) return;
    const std::string kind = pictureKind(bytes), here = at + (view ? "/bufferView" : "/uri"),
                      stated = get(image, "mimeType").is_string() ? get(image, "mimeType").get<std::string>() : "";
    if (kind.empty()) {
      d_.warnOnce(at, "is no picture of a known kind");
      return;
    }
    if (!stated.empty() && stated != kind) d_.warn(here, "is of kind " + kind + " but mimeType says " + stated);
    const Json& uri = get(image, "uri");
    if (uri.is_string() && isDataUri(uri.get_ref<const std::string&>())) {
      const std::string& text = uri.get_ref<const std::string&>();
      const std::string said = text.substr(5, std::min(text.find_first_of(";,", 5), text.size()) - 5);
      if (said != kind) d_.warn(at + "/uri", "\"" + said.substr(0, 60) + "\" is what the data URI says, but the picture is of kind " + kind);
    }
    if (!allowed(kind)) d_.warn(here, "\"" + kind + "\" is not a kind of picture that the format allows");
  }
  static bool allowed(const std::string& kind) { return kind == "image/png" || kind == "image/jpeg" || kind == "image/webp" || kind == "image/ktx2"; }

  void texture(const Json& t, const std::string& at) {
    const Json& source = get(t, "source");
    const Json& image = item(get(j_, "images"), source);
    if (image.is_null()) return;
    const Json& stated = get(image, "mimeType");
    const std::string kind = stated.is_string() ? stated.get<std::string>() : pictureKind(d_.images[size_t(number(source, 0))].bytes);
    if (!kind.empty() && kind != "image/png" && kind != "image/jpeg")
      d_.warn(at + "/source", "is of kind " + kind.substr(0, 60) + ", which needs an extension of the texture");
  }

  void node(const Json& n, const std::string& at) {
    const Json &mesh = item(get(j_, "meshes"), get(n, "mesh")), &first = get(mesh, "primitives");
    const bool joints = first.is_array() && !first.empty() && !get(get(first[0], "attributes"), "JOINTS_0").is_null();
    if (get(n, "skin").is_null() && joints) d_.warn(at, "mesh has joints but the node has no skin; it is shown as it is");
    if (const size_t weights = length(get(n, "weights")), targets = first.is_array() && !first.empty() ? length(get(first[0], "targets")) : 0;
        weights > 0 && weights != targets)
      d_.warnOnce(at + "/weights", std::to_string(weights) + " weights for " + std::to_string(targets) + " morph targets");
    const Json& m = get(n, "matrix");
    if (length(m) != 16) return;
    // Columns at right angles: else no translation, rotation and scale make this matrix.
    double c[3][3];
    for (size_t i = 0; i < 3; ++i)
      for (size_t k = 0; k < 3; ++k) c[i][k] = m[i * 4 + k].get<double>();
    const auto dot = [&](int a, int b) { return c[a][0] * c[b][0] + c[a][1] * c[b][1] + c[a][2] * c[b][2]; };
    for (const auto& [a, b] : {std::pair{0, 1}, {0, 2}, {1, 2}})
      if (std::fabs(dot(a, b)) > 1e-3 * std::sqrt(dot(a, a) * dot(b, b))) {
        d_.warn(at + "/matrix", "shears, which no translation, rotation and scale make; it is used as it is");
        return;
      }
  }

  const std::vector<int64_t>& parents() {
    const Json& nodes = get(j_, "nodes");
    if (!parent_.empty() || nodes.empty()) return parent_;
    parent_.assign(nodes.size(), -1);
    for (size_t i = 0; i < nodes.size(); ++i)
      for (const Json& c : get(nodes[i], "children"))
        if (!item(nodes, c).is_null()) parent_[size_t(number(c, 0))] = int64_t(i);
    return parent_;
  }
  /// The joints of a skin must hang on one root, below its skeleton node.
  void skin(const Json& s, const std::string& at) {
    const Json &nodes = get(j_, "nodes"), &joints = get(s, "joints"), &skeleton = get(s, "skeleton");
    if (!nodes.is_array() || !joints.is_array()) return;
    parents();
    int64_t root = -1;
    bool common = true, below = true;
    size_t steps = 0;
    for (const Json& j : joints) {
      if (item(nodes, j).is_null()) {
        d_.warn(at + "/joints", "index " + j.dump() + " is out of range");
        return;
      }
      int64_t k = j.get<int64_t>();
      bool passed = skeleton.is_null() || item(nodes, skeleton).is_null();
      for (; k >= 0 && steps < 10'000'000; ++steps) {
        passed = passed || k == skeleton.get<int64_t>();
        if (parent_[size_t(k)] < 0) break;
        k = parent_[size_t(k)];
      }
      common = common && (root < 0 || root == k);
      root = k;
      below = below && passed;
    }
    if (!common) d_.warn(at + "/joints", "joints have no common root");
    if (!below) d_.warn(at + "/skeleton", "is not an ancestor of all joints (and is not used)");
  }

  /// The roots of each node's tree against the scenes: a skinned node needs its joints in the scene that shows it.
  void scenes() {
    const Json &nodes = get(j_, "nodes"), &list = get(j_, "scenes");
    if (length(get(j_, "skins")) == 0 || parents().empty()) return;
    size_t work = 0;  // chains of nodes may be as long as the file
    const auto rootOf = [&](size_t k) {
      for (; parent_[k] >= 0 && work < 10'000'000; ++work) k = size_t(parent_[k]);
      return k;
    };
    for (size_t s = 0; s < length(list); ++s) {
      std::set<size_t> roots;
      for (const Json& r : get(list[s], "nodes")) roots.insert(size_t(number(r, 0)));
      for (size_t i = 0; i < nodes.size() && work < 10'000'000; ++i, ++work) {
        const Json& joints = get(item(get(j_, "skins"), get(nodes[i], "skin")), "joints");
        if (length(joints) == 0 || !roots.count(rootOf(i))) continue;
        const size_t joint = rootOf(size_t(number(joints[0], 0)));
        if (joint < parent_.size() && !roots.count(joint))
          d_.warn(place("/nodes", i) + "/skin", "scene " + std::to_string(s) + " shows the node but not the joints of its skin");
      }
    }
  }

  void strided(const Json& accessor, const std::string& at, const char* what) {
    const Json& view = item(get(j_, "bufferViews"), get(item(get(j_, "accessors"), accessor), "bufferView"));
    if (!get(view, "byteStride").is_null()) d_.warn(at, std::string(what) + " may not be strided");
  }

  void animation(const Json& a, const std::string& at) {
    const Json& samplers = get(a, "samplers");
    for (size_t i = 0; i < length(samplers); ++i) {
      const std::string here = place(at + "/samplers", i);
      const Json& input = item(get(j_, "accessors"), get(samplers[i], "input"));
      if (get(input, "min").is_null() || get(input, "max").is_null()) d_.warn(here + "/input", "min or max of the key times is missing");
      if (get(samplers[i], "interpolation") == "CUBICSPLINE" && number(get(input, "count"), 2) < 2)
        d_.warn(here + "/input", "a cubic spline needs two keys; one value is shown");
      strided(get(samplers[i], "input"), here + "/input", "key times");
      strided(get(samplers[i], "output"), here + "/output", "animation values");
    }
  }

  Document& d_;
  const Json& j_;
  std::vector<int64_t> parent_;
};

}  // namespace

void audit(Document& d) {
  if (!d.ok()) return;
  Auditor(d).run();
  if (!d.ok()) return;
  audits::auditMeshes(d);
  audits::auditUsage(d);
  auditBounds(d);
}

}  // namespace gobo::gltf
