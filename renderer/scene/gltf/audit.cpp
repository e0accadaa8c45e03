// SPDX-License-Identifier: Apache-2.0
// Faults against the format that harm no picture, so the readers pass over them: each becomes a warning with its place. Works
// on the plain JSON and takes any type anywhere. O(document); attributes and joints are looked up by name and index.
#include "scene/gltf/document.h"

namespace gobo::gltf {
namespace {

const Json kNone;

const Json& get(const Json& object, const char* key) {
  if (!object.is_object()) return kNone;
  const auto it = object.find(key);
  return it == object.end() ? kNone : *it;
}
const Json& item(const Json& list, const Json& index) {
  if (!list.is_array() || !index.is_number_unsigned() || index.get<uint64_t>() >= list.size()) return kNone;
  return list[index.get<size_t>()];
}
double number(const Json& j, double otherwise) { return j.is_number() ? j.get<double>() : otherwise; }
std::string place(const char* list, size_t i) { return std::string("/") + list + "/" + std::to_string(i); }

class Auditor {
 public:
  explicit Auditor(Document& d) : d_(d), j_(d.json) {}

  void run() {
    walk(j_, "", 0);
    root();
    views();
    each("cameras", [&](const Json& c, const std::string& at) { camera(c, at); });
    each("images", [&](const Json& i, const std::string& at) { image(i, at); });
    each("textures", [&](const Json& t, const std::string& at) { reference(t, at, "source", "images"); reference(t, at, "sampler", "samplers"); });
    each("nodes", [&](const Json& n, const std::string& at) { node(n, at); });
    each("skins", [&](const Json& s, const std::string& at) { skin(s, at); });
    each("meshes", [&](const Json& m, const std::string& at) { mesh(m, at); });
    each("animations", [&](const Json& a, const std::string& at) { animation(a, at); });
    each("accessors", [&](const Json& a, const std::string& at) { accessor(a, at); });
  }

 private:
  template <typename F>
  void each(const char* list, F&& f) {
    const Json& items = get(j_, list);
    if (items.is_null()) return;
    if (!items.is_array()) { d_.warn(std::string("/") + list, "is not an array"); return; }
    for (size_t i = 0; i < items.size(); ++i) {
      if (items[i].is_object()) f(items[i], place(list, i));
      else d_.warn(place(list, i), "is not an object");
    }
  }

  void needs(const Json& object, const std::string& at, std::initializer_list<const char*> keys) {
    for (const char* key : keys) if (get(object, key).is_null()) d_.warn(at, std::string(key) + " is missing");
  }
  void reference(const Json& object, const std::string& at, const char* key, const char* list) {
    const Json& index = get(object, key);
    if (!index.is_null() && item(get(j_, list), index).is_null()) d_.warn(at + "/" + key, "index " + index.dump() + " is out of range");
  }

  /// Empty arrays and names that are no text, anywhere outside extras.
  void walk(const Json& j, const std::string& at, int depth) {
    if (depth > 70 || !j.is_structured()) return;
    if (j.is_array()) {
      if (j.empty() && depth) d_.warn(at, "is empty");
      if (!j.empty() && j[0].is_structured()) for (size_t i = 0; i < j.size(); ++i) walk(j[i], at + "/" + std::to_string(i), depth + 1);
      return;
    }
    for (const auto& [key, value] : j.items()) {
      if (key == "extras") continue;
      if (key == "name" && !value.is_string()) d_.warn(at + "/name", "is not a string");
      walk(value, at + "/" + key, depth + 1);
    }
  }

  void root() {
    for (const char* list : {"extensionsUsed", "extensionsRequired"}) {
      std::set<std::string> seen;
      const Json& names = get(j_, list);
      if (!names.is_array()) continue;
      for (size_t i = 0; i < names.size(); ++i) if (names[i].is_string() && !seen.insert(names[i].get<std::string>()).second) d_.warn(place(list, i), "is listed twice");
    }
    if (get(j_, "extensions").is_object())
      for (const auto& [name, value] : get(j_, "extensions").items()) if (!value.is_object()) d_.warn("/extensions/" + name, "is not an object");
    for (const char* list : {"samplers", "scenes", "materials", "buffers"}) each(list, [](const Json&, const std::string&) {});
  }

  void views() {
    each("bufferViews", [&](const Json& v, const std::string& at) {
      needs(v, at, {"buffer", "byteLength"});
      const double stride = number(get(v, "byteStride"), 0);
      if (stride != 0 && (stride < 4 || stride > 252 || std::fmod(stride, 4.0) != 0)) d_.warn(at + "/byteStride", "stride " + get(v, "byteStride").dump() + " is not a multiple of 4 in 4..252");
      if (stride != 0 && number(get(v, "target"), 0) == 34963) d_.warn(at + "/byteStride", "indices may not be strided");
      const Json& buffer = item(get(j_, "buffers"), get(v, "buffer"));
      const double end = number(get(v, "byteOffset"), 0) + number(get(v, "byteLength"), 0), size = number(get(buffer, "byteLength"), end);
      if (end > size) d_.warn(at + "/byteLength", "the view ends at byte " + std::to_string(uint64_t(end)) + " of a buffer of " + std::to_string(uint64_t(size)));
    });
  }

  void camera(const Json& c, const std::string& at) {
    needs(c, at, {"type"});
    if (const Json& kind = get(c, "type"); (kind == "perspective" || kind == "orthographic") && get(c, kind.get_ref<const std::string&>().c_str()).is_null())
      d_.warn(at, kind.get<std::string>() + " is missing");
    for (const char* kind : {"perspective", "orthographic"}) {
      const Json& lens = get(c, kind);
      if (lens.is_null()) continue;
      const std::string place = at + "/" + kind;
      if (kind[0] == 'p') needs(lens, place, {"yfov", "znear"}); else needs(lens, place, {"xmag", "ymag", "zfar", "znear"});
      const Json& far = get(lens, "zfar");
      if (far.is_number() && number(far, 0) <= number(get(lens, "znear"), 0)) d_.warn(place, "zfar is not beyond znear (neither clips here)");
    }
  }

  void image(const Json& i, const std::string& at) {
    const Json& uri = get(i, "uri");
    const bool view = !get(i, "bufferView").is_null();
    if (uri.is_null() == !view) d_.warn(at, uri.is_null() ? "image has neither uri nor bufferView" : "image has both a uri and a bufferView");
    if (view && get(i, "mimeType").is_null()) d_.warn(at + "/bufferView", "mimeType is missing");
    if (!get(item(get(j_, "bufferViews"), get(i, "bufferView")), "byteStride").is_null()) d_.warn(at + "/bufferView", "pictures may not be strided");
    if (!uri.is_string()) return;
    const std::string& text = uri.get_ref<const std::string&>();
    if (text.compare(0, 5, "data:") != 0) return;
    const std::string kind = text.substr(5, std::min(text.find_first_of(";,", 5), text.size()) - 5);
    if (kind != "image/png" && kind != "image/jpeg" && kind != "image/webp" && kind != "image/ktx2") d_.warn(at + "/uri", "\"" + kind.substr(0, 60) + "\" is not a kind of picture that the format allows");
    else if (get(i, "mimeType").is_string() && get(i, "mimeType") != kind) d_.warn(at + "/uri", "is of kind " + kind + " but mimeType says " + get(i, "mimeType").get<std::string>());
  }

  void node(const Json& n, const std::string& at) {
    for (const char* key : {"skin", "weights"}) if (!get(n, key).is_null() && get(n, "mesh").is_null()) d_.warn(at + "/" + key, "needs a mesh");
    reference(n, at, "skin", "skins");
    reference(n, at, "mesh", "meshes");
    reference(n, at, "camera", "cameras");
    const Json& mesh = item(get(j_, "meshes"), get(n, "mesh"));
    const Json& first = get(mesh, "primitives");
    if (get(n, "skin").is_null() && first.is_array() && !first.empty() && !get(get(first[0], "attributes"), "JOINTS_0").is_null())
      d_.warn(at, "mesh has joints but the node has no skin; it is shown as it is");
  }

  /// The joints of a skin must hang on one root, below its skeleton node.
  void skin(const Json& s, const std::string& at) {
    const Json &nodes = get(j_, "nodes"), &joints = get(s, "joints"), &skeleton = get(s, "skeleton");
    if (!nodes.is_array() || !joints.is_array()) return;
    if (parent_.empty()) {
      parent_.assign(nodes.size(), -1);
      for (size_t i = 0; i < nodes.size(); ++i) {
        const Json& children = get(nodes[i], "children");
        if (children.is_array()) for (const Json& c : children) if (!item(nodes, c).is_null()) parent_[c.get<size_t>()] = int64_t(i);
      }
    }
    int64_t root = -1;
    bool common = true, below = true;
    size_t steps = 0;
    for (const Json& j : joints) {
      if (item(nodes, j).is_null()) { d_.warn(at + "/joints", "index " + j.dump() + " is out of range"); return; }
      int64_t k = j.get<int64_t>();
      bool passed = skeleton.is_null() || item(nodes, skeleton).is_null();
      for (; k >= 0 && steps < 10'000'000; ++steps) { passed = passed || k == skeleton.get<int64_t>(); if (parent_[size_t(k)] < 0) break; k = parent_[size_t(k)]; }
      common = common && (root < 0 || root == k);
      root = k;
      below = below && passed;
    }
    if (!common) d_.warn(at + "/joints", "joints have no common root");
    if (!below) d_.warn(at + "/skeleton", "is not an ancestor of all joints (and is not used)");
  }

  static bool indexed(const std::string& name, const char* semantic, size_t& index) {
    const std::string head = std::string(semantic) + "_";
    if (name.compare(0, head.size(), head) != 0) return false;
    const std::string digits = name.substr(head.size());
    if (digits.empty() || digits.size() > 3 || (digits.size() > 1 && digits[0] == '0')) return false;
    for (const char c : digits) if (c < '0' || c > '9') return false;
    index = size_t(std::stoi(digits));
    return true;
  }

  void attributes(const Json& list, const Json* base, const std::string& at) {
    if (!list.is_object()) return;
    std::map<std::string, std::set<size_t>> sets;
    for (const auto& [name, accessor] : list.items()) {
      size_t index = 0;
      bool known = name == "POSITION" || name == "NORMAL" || name == "TANGENT" || (!name.empty() && name[0] == '_');
      for (const char* semantic : {"TEXCOORD", "COLOR", "JOINTS", "WEIGHTS"}) if (indexed(name, semantic, index)) { known = true; sets[semantic].insert(index); }
      const std::string here = at + "/" + name;
      if (!known) d_.warn(here, "is no attribute of the format");
      else if (base && get(*base, name.c_str()).is_null()) d_.warn(here, "moves an attribute that the primitive does not have");
      if (!base && number(get(item(get(j_, "accessors"), accessor), "componentType"), 0) == 5125) d_.warn(here, "attributes may not be of 32-bit unsigned integers");
    }
    if (base) return;
    for (const auto& [semantic, indices] : sets) if (*indices.rbegin() + 1 != indices.size()) d_.warn(at, semantic + " sets are not numbered 0, 1, ...");
  }

  /// Highest texture coordinate set that a material asks for, or -1.
  int64_t setsOf(const Json& j, int depth) {
    int64_t most = -1;
    if (depth > 8 || !j.is_object()) return most;
    for (const auto& [key, value] : j.items()) {
      if (key == "extras" || !value.is_object()) continue;
      if (get(value, "index").is_number() && key.size() > 7 && key.compare(key.size() - 7, 7, "Texture") == 0) {
        const Json& moved = get(get(get(value, "extensions"), "KHR_texture_transform"), "texCoord");
        most = std::max(most, int64_t(number(moved, number(get(value, "texCoord"), 0))));
      }
      most = std::max(most, setsOf(value, depth + 1));
    }
    return most;
  }

  void mesh(const Json& m, const std::string& at) {
    const Json& primitives = get(m, "primitives");
    if (!primitives.is_array()) return;
    size_t targets = 0;
    for (size_t k = 0; k < primitives.size(); ++k) {
      const Json& p = primitives[k];
      const std::string here = at + "/primitives/" + std::to_string(k);
      const Json &base = get(p, "attributes"), &list = get(p, "targets");
      needs(p, here, {"attributes"});
      attributes(base, nullptr, here + "/attributes");
      for (size_t t = 0; list.is_array() && t < list.size(); ++t) attributes(list[t], &base, here + "/targets/" + std::to_string(t));
      const size_t count = list.is_array() ? list.size() : 0;
      if (k == 0) targets = count;
      else if (count != targets) d_.warn(here + (count ? "/targets" : ""), "has " + std::to_string(count) + " morph targets, the first primitive " + std::to_string(targets));
      strided(get(p, "indices"), here + "/indices", "indices");
      const Json& view = item(get(j_, "bufferViews"), get(item(get(j_, "accessors"), get(p, "indices")), "bufferView"));
      if (number(get(view, "target"), 34963) != 34963) d_.warn(here + "/indices", "the buffer view is not for indices by its target");
      material(p, base, here);
    }
  }

  void material(const Json& p, const Json& base, const std::string& here) {
    const Json& list = get(j_, "materials");
    const Json& index = get(p, "material");
    if (item(list, index).is_null()) return;
    if (sets_.empty()) sets_.assign(list.size(), -2);
    int64_t& need = sets_[index.get<size_t>()];
    if (need == -2) need = setsOf(list[index.get<size_t>()], 0);
    if (need >= 0 && get(base, ("TEXCOORD_" + std::to_string(need)).c_str()).is_null())
      d_.warn(here + "/material", "material " + index.dump() + " uses TEXCOORD_" + std::to_string(need) + ", which the primitive does not have; (0,0) is used");
  }

  void strided(const Json& accessor, const std::string& at, const char* what) {
    const Json& view = item(get(j_, "bufferViews"), get(item(get(j_, "accessors"), accessor), "bufferView"));
    if (!get(view, "byteStride").is_null()) d_.warn(at, std::string(what) + " may not be strided");
  }

  void animation(const Json& a, const std::string& at) {
    needs(a, at, {"channels", "samplers"});
    const Json& samplers = get(a, "samplers");
    for (size_t i = 0; samplers.is_array() && i < samplers.size(); ++i) {
      const std::string here = at + "/samplers/" + std::to_string(i);
      const Json& input = item(get(j_, "accessors"), get(samplers[i], "input"));
      if (!input.is_null() && (get(input, "min").is_null() || get(input, "max").is_null())) d_.warn(here + "/input", "min or max of the key times is missing");
      strided(get(samplers[i], "input"), here + "/input", "key times");
      strided(get(samplers[i], "output"), here + "/output", "animation values");
    }
  }

  void accessor(const Json& a, const std::string& at) {
    needs(a, at, {"componentType", "count", "type"});
    reference(a, at, "bufferView", "bufferViews");
    const Json& sparse = get(a, "sparse");
    if (sparse.is_null()) return;
    needs(sparse, at + "/sparse", {"count", "indices", "values"});
    for (const char* part : {"indices", "values"}) {
      const Json& view = item(get(j_, "bufferViews"), get(get(sparse, part), "bufferView"));
      if (!get(view, "byteStride").is_null()) d_.warn(at + "/sparse/" + part + "/bufferView", "sparse data may not be strided");
    }
  }

  Document& d_;
  const Json& j_;
  std::vector<int64_t> parent_, sets_;
};

}  // namespace

void audit(Document& d) {
  if (!d.ok()) return;
  Auditor(d).run();
  auditBounds(d);
}

}  // namespace gobo::gltf
