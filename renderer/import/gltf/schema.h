// SPDX-License-Identifier: Apache-2.0
// The structure of glTF 2.0 and of the extensions that are read, as one table: a row for each member of each object (type,
// range, allowed values, number of elements, what it needs and excludes, which list an index points into). checkSchema walks a
// document by it before anything else reads it; tests make a violating document from each row.
// Source: the JSON schemas of the glTF 2.0 specification and of the extensions (github.com/KhronosGroup/glTF).
//
// A violation is refused, or (where a row says so) answered with a warning, after which the member counts as absent, or, for a
// number, is clamped by its reader. Members that the table does not know are left alone, as the format asks.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace gobo::gltf {

struct Document;
struct Shape;

enum class Kind : uint8_t { Object, Objects, IndexMap, Index, Indices, Integer, Number, Numbers, Boolean, Text, Texts };
enum class Answer : uint8_t { Refuse, Warn };

inline constexpr double kLargest = 3.0e38;                 ///< what a float holds, with some room
inline constexpr double kLargestSize = 281474976710656.0;  ///< 2^48: sums of offsets and lengths cannot wrap

/// One member. Built by the functions below; the defaults refuse.
struct Field {
  std::string_view name;
  Kind kind = Kind::Object;
  const Shape* shape = nullptr;          ///< Object, Objects
  std::string_view list = {};            ///< Index, Indices, IndexMap: name of the list, in the root or in the nearest object around that has it
  std::string_view values = {};          ///< Text, Integer: the allowed ones, separated by blanks
  std::string_view needed = {};          ///< a member that must stand beside it
  std::string_view excluded = {};        ///< members that must not stand beside it, separated by blanks
  double lo = -kLargest, hi = kLargest;  ///< numbers and elements of numbers; for Index only lo counts
  bool openLow = false;                  ///< lo itself is outside
  uint32_t step = 1;                     ///< Integer: multiple of
  size_t least = 0, most = SIZE_MAX;     ///< elements
  bool isRequired = false, isDistinct = false;
  Answer type = Answer::Refuse;    ///< to a wrong type or number of elements, and where it is required: to its absence
  Answer value = Answer::Refuse;   ///< to a number outside its range, an unknown value, a repeated element
  Answer beside = Answer::Refuse;  ///< to what is missing or must not be beside it
  Answer none = Answer::Warn;      ///< to an empty list

  constexpr Field required() const {
    Field f = *this;
    f.isRequired = true;
    return f;
  }
  constexpr Field range(double low, double high) const {
    Field f = *this;
    f.lo = low;
    f.hi = high;
    return f;
  }
  constexpr Field above(double low) const {
    Field f = *this;
    f.lo = low;
    f.openLow = true;
    return f;
  }
  constexpr Field from(double low) const {
    Field f = *this;
    f.lo = low;
    return f;
  }
  constexpr Field multipleOf(uint32_t n) const {
    Field f = *this;
    f.step = n;
    return f;
  }
  constexpr Field oneOf(std::string_view allowed) const {
    Field f = *this;
    f.values = allowed;
    return f;
  }
  constexpr Field count(size_t low, size_t high) const {
    Field f = *this;
    f.least = low;
    f.most = high;
    return f;
  }
  constexpr Field distinct() const {
    Field f = *this;
    f.isDistinct = true;
    return f;
  }
  constexpr Field needs(std::string_view other) const {
    Field f = *this;
    f.needed = other;
    return f;
  }
  constexpr Field excludes(std::string_view others) const {
    Field f = *this;
    f.excluded = others;
    return f;
  }
  constexpr Field warnsOfValue() const {
    Field f = *this;
    f.value = Answer::Warn;
    return f;
  }
  constexpr Field warnsOfCompany() const {
    Field f = *this;
    f.beside = Answer::Warn;
    return f;
  }
  constexpr Field refusesNone() const {
    Field f = *this;
    f.none = Answer::Refuse;
    return f;
  }
  constexpr Field onlyWarns() const {
    Field f = *this;
    f.type = f.value = f.beside = Answer::Warn;
    return f;
  }
};

constexpr Field object(std::string_view name, const Shape& shape) { return {.name = name, .kind = Kind::Object, .shape = &shape}; }
/// Lists may not be empty; an empty one is a warning, because nothing is what it says.
constexpr Field objects(std::string_view name, const Shape& shape) { return {.name = name, .kind = Kind::Objects, .shape = &shape, .least = 1}; }
constexpr Field indexMap(std::string_view name, std::string_view list) { return {.name = name, .kind = Kind::IndexMap, .list = list, .least = 1}; }
constexpr Field index(std::string_view name, std::string_view list) { return {.name = name, .kind = Kind::Index, .list = list}; }
constexpr Field indices(std::string_view name, std::string_view list) {
  return {.name = name, .kind = Kind::Indices, .list = list, .least = 1, .isDistinct = true};
}
constexpr Field integer(std::string_view name, double lo = 0, double hi = kLargestSize) { return {.name = name, .kind = Kind::Integer, .lo = lo, .hi = hi}; }
constexpr Field number(std::string_view name) { return {.name = name, .kind = Kind::Number}; }
/// A factor: outside its range it is clamped, with a warning.
constexpr Field factor(std::string_view name, double lo = 0, double hi = 1) {
  return {.name = name, .kind = Kind::Number, .lo = lo, .hi = hi, .value = Answer::Warn};
}
constexpr Field numbers(std::string_view name, size_t n) { return {.name = name, .kind = Kind::Numbers, .least = n, .most = n}; }
constexpr Field factors(std::string_view name, size_t n, double hi = 1) {
  return {.name = name, .kind = Kind::Numbers, .lo = 0, .hi = hi, .least = n, .most = n, .value = Answer::Warn};
}
constexpr Field boolean(std::string_view name) { return {.name = name, .kind = Kind::Boolean}; }
constexpr Field text(std::string_view name) { return {.name = name, .kind = Kind::Text}; }
constexpr Field texts(std::string_view name) { return {.name = name, .kind = Kind::Texts, .least = 1, .isDistinct = true, .value = Answer::Warn}; }
/// Names and remarks: nothing depends on them.
constexpr Field remark(std::string_view name) { return {.name = name, .kind = Kind::Text, .type = Answer::Warn, .value = Answer::Warn}; }

/// An object of the format.
struct Shape {
  std::string_view name;
  std::span<const Field> fields;
};

/// An extension at an object; `shape` is what stands in its "extensions".
struct ExtensionRow {
  std::string_view extension;
  const Shape* place;
  const Shape* shape;
};

const Shape& rootShape();
const Shape& morphTargetShape();  ///< no rows of its own: every member is the index of an accessor
std::span<const ExtensionRow> extensionRows();
/// A texture reference or one of its kinds (normal, occlusion): extensions of the one may stand at all.
bool isTextureInfo(const Shape& shape);

/// Walks the document: the first violation that is refused becomes d.status (file, pointer, value), the others warnings;
/// members that a warning has answered are removed. O(document).
void checkSchema(Document& d);

}  // namespace gobo::gltf
