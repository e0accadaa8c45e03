// SPDX-License-Identifier: Apache-2.0
// Numbers of a style of shadows that vary from place to place: formulas over what a view sample knows.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "filters/formula/formula.h"

namespace gobo {
inline namespace filters {

/// What formulas may read, in the order of their evaluators. time: seconds; distance: metres between the shadow's edge near by and what casts it, 0 where no
/// edge is seen; depth: metres from the camera; x, y, z: the place, metres; nx, ny, nz: its unit normal; edge: signed distance to the shadow's edge after
/// abstraction, metres, negative in shadow.
enum class StyleName : size_t { Time, Distance, Depth, X, Y, Z, Nx, Ny, Nz, Edge };
inline constexpr std::array<std::string_view, 10> kStyleNames{"time", "distance", "depth", "x", "y", "z", "nx", "ny", "nz", "edge"};

/// One field of ShadowStyle.
struct StyleFormula {
  Formula formula;
  double low = 0, high = 0;  ///< of the field: values are limited to it
  std::string place;         ///< for errors: request.expressions.PATH.formula
  struct Object {
    std::vector<uint32_t> instances;  ///< increasing
    int caster = -1;                  ///< index into StyleFormulas::casters
  };
  std::vector<Object> objects{};  ///< those of the formula
  bool reads(StyleName name) const { return formula.reads(size_t(name)); }
  /// Something that holds at the shadow's edge.
  bool readsEdges() const {
    bool caster = reads(StyleName::Distance);
    for (const Object& o : objects) caster = caster || o.caster >= 0;
    return caster;
  }
};

enum class StyleField : size_t { Inflation, Softness, Brightness, Abstraction };
inline constexpr std::array<const char*, 4> kStyleFields{"inflation", "softness", "brightness", "abstraction"};

inline constexpr size_t kMostCasters = 3;  ///< that the formulas of one style name

using StyleFormulaList = std::vector<std::pair<StyleField, StyleFormula>>;  ///< by field, each at most once

inline constexpr size_t kLayerFields = 3;  ///< of kStyleFields, the first ones: a layer's abstraction is one number for all places

struct StyleFormulas {
  StyleFormulaList all;                          ///< of the style's own fields
  std::vector<std::vector<uint32_t>> casters{};  ///< instances of each that a formula names, increasing
  double time = 0;
  std::vector<StyleFormulaList> layers{};  ///< of each layer's; as many as there are layers, or none
  const StyleFormula* find(StyleField field) const {
    for (const auto& [f, formula] : all)
      if (f == field) return &formula;
    return nullptr;
  }
};

}  // namespace filters
}  // namespace gobo
