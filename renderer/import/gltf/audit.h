// SPDX-License-Identifier: Apache-2.0
// Internal to the audit: reading plain JSON whose structure has been checked (schema.h), where any member may be absent.
#pragma once

#include "import/gltf/document.h"

namespace gobo::gltf::audits {

inline const Json kNone;

inline const Json& get(const Json& object, const char* key) {
  if (!object.is_object()) return kNone;
  const auto it = object.find(key);
  return it == object.end() ? kNone : *it;
}
/// Element of a list, or null.
inline const Json& item(const Json& list, const Json& index) {
  if (!list.is_array() || !index.is_number()) return kNone;
  const double i = index.get<double>();
  return i >= 0 && i < double(list.size()) ? list[size_t(i)] : kNone;
}
inline double number(const Json& j, double otherwise) { return j.is_number() ? j.get<double>() : otherwise; }
inline size_t length(const Json& j) { return j.is_array() ? j.size() : 0; }
inline std::string place(const std::string& list, size_t i) { return list + "/" + std::to_string(i); }

/// f(element, pointer) for each element of a list of the root.
template <typename F>
void each(const Json& root, const char* list, F&& f) {
  const Json& items = get(root, list);
  for (size_t i = 0; i < length(items); ++i) f(items[i], place(std::string("/") + list, i));
}

/// Rules about meshes, accessors and views (audit_mesh.cpp), and about what they are used for (audit_usage.cpp).
void auditMeshes(Document& d);
void auditUsage(Document& d);

}  // namespace gobo::gltf::audits
