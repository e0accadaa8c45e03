// SPDX-License-Identifier: Apache-2.0
// TermShape: what a term looks like before it is made: type, domain, extent, planes. Nodes say theirs from those of their inputs (Node::infer), so
// that wrong wiring is an error while planning, admission knows bytes, and the executor makes the memory. Wiring collects what a node asks for.
#pragma once

#include <initializer_list>
#include <span>
#include <string>
#include <vector>

#include "base/status.h"
#include "terms/term.h"

namespace gobo {
inline namespace terms {

struct PlaneShape {
  enum class Fill : uint8_t {
    Zeroed,
    Unset,   ///< whatever was in memory: the node writes every element
    Absent,  ///< may come with the result: the node adds it where it is needed
  };
  std::string name;
  Format format = Format::F32;
  int channels = 1;
  Fill fill = Fill::Zeroed;
};

template <typename T>
PlaneShape plane(std::string name, int channels = 1) {
  return {std::move(name), formatOf<T>(), channels, PlaneShape::Fill::Zeroed};
}
template <typename T>
PlaneShape unsetPlane(std::string name, int channels = 1) {
  return {std::move(name), formatOf<T>(), channels, PlaneShape::Fill::Unset};
}

struct TermShape {
  std::string type;
  Domain domain = Domain::Pixel;
  Extent extent;  ///< an upper bound of the elements where `atMost`
  std::vector<PlaneShape> planes;
  bool atMost = false;  ///< the size comes with the result, which the node makes itself

  const PlaneShape* find(std::string_view name) const;
  /// Upper bound of Term::bytes() of such a term, but for kTermBytes.
  size_t bytes() const;
  /// Whether `term` is one of these. Errors: Internal, with what is different.
  Status holds(const Term& term) const;
};
TermShape shapeOf(const Term& term);
/// A term with the planes of `shape` that are not Absent; null if its size comes with the result. Throws std::bad_alloc.
std::shared_ptr<Term> makeTerm(const TermShape& shape);

/// What a node is wired to, checked against what it reads. The first thing that is wrong is the status.
class Wiring {
 public:
  /// `node`: its type. Errors from here on are Internal and begin with it.
  Wiring(std::string node, std::span<const TermShape> in, size_t inputs) : Wiring(std::move(node), in, inputs, inputs) {}
  Wiring(std::string node, std::span<const TermShape> in, size_t least, size_t most);

  /// Input `i` has a plane of T of one of these numbers of channels; none: of any.
  template <typename T>
  Wiring& reads(size_t i, std::string_view name, std::initializer_list<int> channels = {1}) {
    return reads(i, name, formatOf<T>(), channels);
  }
  Wiring& reads(size_t i, std::string_view name, Format format, std::initializer_list<int> channels);
  Wiring& over(size_t i, const Extent& extent);  ///< input `i` has this extent
  Wiring& require(bool holds, std::string_view what);
  Wiring& require(const Status& status);
  size_t size() const { return in_.size(); }
  /// Empty when there is no such input.
  const TermShape& input(size_t i) const;
  int channels(size_t i, std::string_view name) const;  ///< 0: no such plane
  bool ok() const { return status_.ok(); }
  const Status& status() const { return status_; }
  /// `shape`, if nothing is wrong.
  Result<TermShape> gives(TermShape shape) const;

 private:
  void fail(std::string what);
  std::string node_;
  std::span<const TermShape> in_;
  Status status_;
};

}  // namespace terms
}  // namespace gobo
