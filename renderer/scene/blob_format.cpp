// SPDX-License-Identifier: Apache-2.0
// Counts the members of the structs that a blob holds (by how many initialisers an aggregate takes), for the test that every one
// of them is in its field list.
#include <utility>

#include "scene/blob_codec.h"

namespace gobo::blob {
namespace {

struct Anything {
  template <typename T>
  operator T() const;
};
template <typename T, size_t... i>
constexpr bool takes(std::index_sequence<i...>) {
  return requires { T{(void(i), Anything{})...}; };
}
template <typename T, size_t n = 0>
constexpr size_t members() {
  if constexpr (!takes<T>(std::make_index_sequence<n + 1>())) return n;
  else return members<T, n + 1>();
}

struct Count {
  size_t n = 0;
  template <typename T>
  constexpr void operator()(const char*, const T&) {
    ++n;
  }
};
template <typename T>
size_t listed() {
  T item;
  Count c;
  visitStruct(item, c);
  return c.n;
}

}  // namespace

std::string forgottenFields() {
  std::string out;
  const auto check = [&](const char* name, size_t have, size_t list) {
    if (have != list) out += std::string(name) + " has " + std::to_string(have) + " members, " + std::to_string(list) + " are listed; ";
  };
  check("TextureRef", members<TextureRef>(), listed<TextureRef>());
  check("Coverage", members<Coverage>(), listed<Coverage>());
  check("Albedo", members<Albedo>(), listed<Albedo>());
  check("Bsdf", members<Bsdf>(), listed<Bsdf>());
  check("Emission", members<Emission>(), listed<Emission>());
  check("Material", members<Material>(), listed<Material>());
  check("LightShape", members<LightShape>(), listed<LightShape>());
  check("Light", members<Light>(), listed<Light>());
  check("Camera", members<Camera>() - 1, listed<Camera>());  // `optics` are a request's
  check("Instance", members<Instance>(), listed<Instance>());
  check("Mesh", members<Mesh>(), listed<Mesh>());
  check("Texture", members<Texture>(), listed<Texture>());
  check("LightProfile", members<LightProfile>(), listed<LightProfile>());
  check("Environment", members<Environment>() - 1, listed<Environment>());  // `file` is where it lies
  check("RigNode", members<RigNode>(), listed<RigNode>());
  check("RigSkin", members<RigSkin>(), listed<RigSkin>());
  check("RigTarget", members<RigTarget>(), listed<RigTarget>() - (kUvSets - 1));  // its uv sets are listed one by one
  check("RigSource", members<RigSource>(), listed<RigSource>());
  check("RigDeformed", members<RigDeformed>(), listed<RigDeformed>());
  check("RigFollower", members<RigFollower>(), listed<RigFollower>());
  check("RigSampler", members<RigSampler>(), listed<RigSampler>());
  check("RigChannel", members<RigChannel>(), listed<RigChannel>());
  check("RigAnimation", members<RigAnimation>(), listed<RigAnimation>());
  check("Rig", members<Rig>(), listed<Rig>());
  check("VariantUse", members<VariantUse>(), listed<VariantUse>());
  check("Variants", members<Variants>(), listed<Variants>());
  return out;
}

}  // namespace gobo::blob
