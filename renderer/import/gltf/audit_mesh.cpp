// SPDX-License-Identifier: Apache-2.0
// Rules about meshes, accessors and buffer views that the readers pass over. O(document).
#include <climits>
#include <cmath>

#include "base/to_index.h"
#include "import/gltf/audit.h"

namespace gobo::gltf::audits {
namespace {

class Meshes {
 public:
  explicit Meshes(Document& d) : d_(d), j_(d.json) {}

  void run() {
    each(j_, "bufferViews", [&](const Json& v, const std::string& at) { view(v, at); });
    each(j_, "accessors", [&](const Json& a, const std::string& at) { accessor(a, at); });
    each(j_, "meshes", [&](const Json& m, const std::string& at) { mesh(m, at); });
  }

 private:
  const Json& accessorOf(const Json& index) { return item(get(j_, "accessors"), index); }
  const Json& viewOf(const Json& accessor) { return item(get(j_, "bufferViews"), get(accessor, "bufferView")); }

  void view(const Json& v, const std::string& at) {
    const double stride = number(get(v, "byteStride"), 0), length = number(get(v, "byteLength"), 0);
    if (stride != 0 && number(get(v, "target"), 0) == 34963) d_.warn(at + "/byteStride", "indices may not be strided");
    if (stride > length)
      d_.warn(at + "/byteStride", "stride " + shown(get(v, "byteStride")) + " is more than the view's " + shown(get(v, "byteLength")) + " bytes");
    const double end = number(get(v, "byteOffset"), 0) + length, size = number(get(item(get(j_, "buffers"), get(v, "buffer")), "byteLength"), end);
    if (end > size) d_.warn(at, "the view ends at byte " + std::to_string(uint64_t(end)) + " of a buffer of " + std::to_string(uint64_t(size)));
  }

  void accessor(const Json& a, const std::string& at) {
    const double type = number(get(a, "componentType"), 0);
    if (get(a, "normalized") == true && (type == 5125 || type == 5126))
      d_.warn(at + "/normalized", "only 8- and 16-bit integers can be normalised; the numbers count as they are");
    const double start = number(get(viewOf(a), "byteOffset"), 0) + number(get(a, "byteOffset"), 0), stride = number(get(viewOf(a), "byteStride"), 0);
    if (const std::string kind = get(a, "type").get<std::string>(); kind[0] == 'M' && (std::fmod(start, 4) != 0 || std::fmod(stride, 4) != 0))
      d_.warn(at, "matrices must begin at multiples of 4 bytes");
    const Json& sparse = get(a, "sparse");
    for (const char* part : {"indices", "values"})
      if (!get(item(get(j_, "bufferViews"), get(get(sparse, part), "bufferView")), "byteStride").is_null())
        d_.warn(at + "/sparse/" + part + "/bufferView", "sparse data may not be strided");
  }

  static bool indexed(const std::string& name, const char* semantic, size_t& index) {
    const std::string head = std::string(semantic) + "_";
    if (name.compare(0, head.size(), head) != 0) return false;
    const std::string digits = name.substr(head.size());
    if (digits.empty() || digits.size() > 3 || (digits.size() > 1 && digits[0] == '0')) return false;
    for (const char c : digits)
      if (c < '0' || c > '9') return false;
    index = size_t(std::stoi(digits));
    return true;
  }

  void attributes(const Json& list, const Json* base, const std::string& at) {
    if (!list.is_object()) return;
    std::map<std::string, std::set<size_t>> sets;
    for (const auto& [name, accessor] : list.items()) {
      size_t index = 0;
      bool known = name == "POSITION" || name == "NORMAL" || name == "TANGENT" || (!name.empty() && name[0] == '_');
      for (const char* semantic : {"TEXCOORD", "COLOR", "JOINTS", "WEIGHTS"})
        if (indexed(name, semantic, index)) {
          known = true;
          sets[semantic].insert(index);
        }
      const std::string here = at + "/" + name;
      if (!known) d_.warn(here, "is no attribute of the format");
      else if (base && get(*base, name.c_str()).is_null()) d_.warn(here, "moves an attribute that the primitive does not have");
      if (!base && number(get(item(get(j_, "accessors"), accessor), "componentType"), 0) == 5125)
        d_.warn(here, "attributes may not be of 32-bit unsigned integers");
    }
    if (base) return;
    for (const auto& [semantic, indices] : sets)
      if (*indices.rbegin() + 1 != indices.size()) d_.warn(at, semantic + " sets are not numbered 0, 1, ...");
  }

  /// Highest texture coordinate set that a material asks for, or -1.
  int64_t setsOf(const Json& j, int depth) {
    int64_t most = -1;
    if (depth > 8 || !j.is_object()) return most;
    for (const auto& [key, value] : j.items()) {
      if (key == "extras" || !value.is_object()) continue;
      if (get(value, "index").is_number() && key.size() > 7 && key.compare(key.size() - 7, 7, "Texture") == 0) {
        const Json& moved = get(get(get(value, "extensions"), "KHR_texture_transform"), "texCoord");
        most = std::max(most,
                        int64_t(toInteger(number(moved, number(get(value, "texCoord"), 0)), -1, INT_MAX)));  // of an unknown extension: nobody has checked it
      }
      most = std::max(most, setsOf(value, depth + 1));
    }
    return most;
  }

  void mesh(const Json& m, const std::string& at) {
    const Json& primitives = get(m, "primitives");
    size_t targets = 0;
    for (size_t k = 0; k < length(primitives); ++k) {
      const Json& p = primitives[k];
      const std::string here = place(at + "/primitives", k);
      const Json &base = get(p, "attributes"), &list = get(p, "targets");
      attributes(base, nullptr, here + "/attributes");
      for (size_t t = 0; t < length(list); ++t) attributes(list[t], &base, place(here + "/targets", t));
      if (k == 0) targets = length(list);
      else if (length(list) != targets)
        d_.warn(here + (length(list) ? "/targets" : ""),
                "has " + std::to_string(length(list)) + " morph targets, the first primitive " + std::to_string(targets));
      if (!get(viewOf(accessorOf(get(p, "indices"))), "byteStride").is_null()) d_.warn(here + "/indices", "indices may not be strided");
      bounds(base, here + "/attributes/POSITION");
      for (size_t t = 0; t < length(list); ++t) bounds(list[t], place(here + "/targets", t) + "/POSITION");
      material(p, base, here);
      variants(p, here);
    }
    if (const size_t weights = length(get(m, "weights")); weights > 0 && weights != targets)
      d_.warn(at + "/weights", std::to_string(weights) + " weights for " + std::to_string(targets) + " morph targets");
  }

  void bounds(const Json& attributes, const std::string& at) {
    const Json& a = accessorOf(get(attributes, "POSITION"));
    if (!a.is_null() && (length(get(a, "min")) != 3 || length(get(a, "max")) != 3)) d_.warn(at, "min or max of the positions is missing; the data count");
  }

  void variants(const Json& p, const std::string& here) {
    const Json& mappings = get(get(get(p, "extensions"), "KHR_materials_variants"), "mappings");
    std::set<double> seen;
    for (size_t i = 0; i < length(mappings); ++i) {
      const Json& list = get(mappings[i], "variants");
      for (size_t k = 0; k < length(list); ++k)
        if (!seen.insert(number(list[k], -1)).second)
          d_.warnOnce(place(place(here + "/extensions/KHR_materials_variants/mappings", i) + "/variants", k),
                      "variant " + shown(list[k]) + " has a material already; the last one counts");
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
    const Json& m = list[index.get<size_t>()];
    const Json &anisotropy = get(get(get(m, "extensions"), "KHR_materials_anisotropy"), "anisotropyStrength"),
               &coat = get(get(get(m, "extensions"), "KHR_materials_clearcoat"), "clearcoatNormalTexture");
    if ((!anisotropy.is_null() || !coat.is_null()) && get(m, "normalTexture").is_null() && get(base, "TANGENT").is_null())
      d_.warn(here + "/material",
              "material " + index.dump() + " needs tangents, which the primitive does not have; they are made from its texture coordinates");
  }

  Document& d_;
  const Json& j_;
  std::vector<int64_t> sets_;
};

}  // namespace

void auditMeshes(Document& d) { Meshes(d).run(); }

}  // namespace gobo::gltf::audits
