// SPDX-License-Identifier: Apache-2.0
// What accessors and buffer views are used for: one accessor has one use, one view one kind of data, vertex data are aligned to 4
// bytes and have a stride where they share a view. And the indices of primitives that are not drawn. O(document).
#include <cmath>

#include "import/gltf/audit.h"

namespace gobo::gltf::audits {
namespace {

enum class Use : uint8_t { None, Vertices, Indices, Image, Other };
const char* nameOf(Use u) {
  constexpr const char* names[] = {"nothing", "vertices", "indices", "a picture", "other data"};
  return names[int(u)];
}

class Usage {
 public:
  explicit Usage(Document& d)
      : d_(d), j_(d.json), views_(length(get(j_, "bufferViews")), Use::None), accessors_(length(get(j_, "accessors"))), strided_(views_.size(), -1) {
    for (size_t i = 0; i < views_.size(); ++i)
      if (const double t = number(get(get(j_, "bufferViews")[i], "target"), 0); t != 0) views_[i] = t == 34962 ? Use::Vertices : Use::Indices;
  }

  void run() {
    each(j_, "images", [&](const Json& i, const std::string& at) {
      if (!get(i, "bufferView").is_null()) viewUse(get(i, "bufferView"), Use::Image, at + "/bufferView");
    });
    each(j_, "meshes", [&](const Json& m, const std::string& at) {
      const Json& list = get(m, "primitives");
      for (size_t k = 0; k < length(list); ++k) primitive(list[k], place(at + "/primitives", k));
    });
    each(j_, "skins", [&](const Json& s, const std::string& at) {
      const Json& matrices = get(s, "inverseBindMatrices");
      use(matrices, "inverse bind matrices", Use::Other, at + "/inverseBindMatrices");
      if (!get(viewOf(matrices), "byteStride").is_null()) d_.warn(at + "/inverseBindMatrices", "matrices may not be strided");
    });
    each(j_, "animations", [&](const Json& a, const std::string& at) {
      const Json& list = get(a, "samplers");
      for (size_t k = 0; k < length(list); ++k) {
        use(get(list[k], "input"), "key times", Use::Other, place(at + "/samplers", k) + "/input");
        use(get(list[k], "output"), "animation values", Use::Other, place(at + "/samplers", k) + "/output");
      }
    });
  }

 private:
  const Json& viewOf(const Json& accessor) { return item(get(j_, "bufferViews"), get(item(get(j_, "accessors"), accessor), "bufferView")); }

  void viewUse(const Json& view, Use use, const std::string& at) {
    if (item(get(j_, "bufferViews"), view).is_null()) return;
    Use& known = views_[size_t(number(view, 0))];
    if (known == Use::None) known = use;
    else if (known != use)
      d_.warn(at, "buffer view " + shown(view) + " is for " + nameOf(known) + " by its target or first use, and for " + nameOf(use) + " here");
  }

  void use(const Json& accessor, const char* what, Use kind, const std::string& at) {
    const Json& a = item(get(j_, "accessors"), accessor);
    if (a.is_null()) return;
    const char*& known = accessors_[size_t(number(accessor, 0))];
    if (!known) known = what;
    else if (std::string_view(known) != what) d_.warn(at, "accessor " + shown(accessor) + " serves as " + known + " already, and as " + what + " here");
    if (!get(a, "bufferView").is_null()) viewUse(get(a, "bufferView"), kind, at);
  }

  void attributes(const Json& list, const std::string& at) {
    if (!list.is_object()) return;
    for (const auto& [name, accessor] : list.items()) {
      if (!accessor.is_number()) continue;
      const std::string here = at + "/" + escaped(name);
      use(accessor, "vertices", Use::Vertices, here);
      const Json &a = item(get(j_, "accessors"), accessor), &view = viewOf(accessor);
      if (view.is_null()) continue;
      const double offset = number(get(a, "byteOffset"), 0), start = number(get(view, "byteOffset"), 0), stride = number(get(view, "byteStride"), 0);
      if (std::fmod(offset, 4) != 0 || std::fmod(start, 4) != 0 || (stride == 0 && std::fmod(elementSize(a), 4) != 0))
        d_.warn(here, "vertex data must be aligned to 4 bytes");
      int64_t& first = strided_[size_t(number(get(a, "bufferView"), 0))];
      if (first < 0) first = int64_t(number(accessor, 0));
      else if (first != int64_t(number(accessor, 0)) && stride == 0)
        d_.warn(here, "shares a buffer view that has no byteStride with accessor " + std::to_string(first));
    }
  }
  static double elementSize(const Json& a) {
    const double type = number(get(a, "componentType"), 0), unit = type <= 5121 ? 1 : type <= 5123 ? 2 : 4;
    const std::string kind = get(a, "type").get<std::string>();
    return unit * (kind == "SCALAR" ? 1 : kind == "VEC2" ? 2 : kind == "VEC3" ? 3 : 4);
  }

  void primitive(const Json& p, const std::string& at) {
    use(get(p, "indices"), "indices", Use::Indices, at + "/indices");
    attributes(get(p, "attributes"), at + "/attributes");
    const Json& targets = get(p, "targets");
    for (size_t t = 0; t < length(targets); ++t) attributes(targets[t], place(at + "/targets", t));
    if (number(get(p, "mode"), 4) < 4 && d_.ok()) undrawn(p, at);
  }

  /// Points and lines may not be drawn, but what they say is looked at all the same. Accessors may be shared: the work is bounded.
  void undrawn(const Json& p, const std::string& at) {
    const Json &index = get(p, "indices"), &vertices = item(get(j_, "accessors"), get(get(p, "attributes"), "POSITION"));
    if (item(get(j_, "accessors"), index).is_null() || vertices.is_null() || work_ > (64u << 20)) return;
    std::vector<uint32_t> values;
    const uint64_t before = d_.bytesUsed;
    const bool read = readIndices(d_, int(number(index, 0)), values);
    d_.bytesUsed = before;
    work_ += values.size();
    if (!read) {
      d_.warn(at + "/indices", d_.status.message());
      d_.status = Status();
      return;
    }
    const double count = number(get(vertices, "count"), 0);
    for (size_t k = 0; k < values.size(); ++k)
      if (values[k] >= count) {
        d_.warn(at + "/indices", "index " + std::to_string(values[k]) + " at " + std::to_string(k) + " is out of range: the primitive has " +
                                     shown(get(vertices, "count")) + " vertices");
        return;
      }
  }

  Document& d_;
  const Json& j_;
  std::vector<Use> views_;
  std::vector<const char*> accessors_;
  std::vector<int64_t> strided_;  // first vertex accessor of each view
  uint64_t work_ = 0;
};

}  // namespace

void auditUsage(Document& d) { Usage(d).run(); }

}  // namespace gobo::gltf::audits
