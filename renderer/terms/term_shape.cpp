// SPDX-License-Identifier: Apache-2.0
#include "terms/term_shape.h"

namespace gobo {
inline namespace terms {

namespace {

const char* formatName(Format f) {
  switch (f) {
    case Format::F32: return "f32";
    case Format::F64: return "f64";
    case Format::U32: return "u32";
    case Format::U8: return "u8";
  }
  return "?";
}

std::string text(const Extent& e) { return std::to_string(e.width) + " x " + std::to_string(e.height) + " x " + std::to_string(e.layers); }
std::string text(std::string_view name, Format format, int channels) {
  return std::string(name) + " (" + std::to_string(channels) + " " + formatName(format) + ")";
}

}  // namespace

const PlaneShape* TermShape::find(std::string_view name) const {
  for (const PlaneShape& p : planes)
    if (p.name == name) return &p;
  return nullptr;
}

size_t TermShape::bytes() const {
  size_t sum = planes.size() > 16 ? (planes.size() - 16) * kPlaneBytes : 0;
  for (const PlaneShape& p : planes) sum += extent.elements() * size_t(p.channels) * formatSize(p.format);
  return sum;
}

Status TermShape::holds(const Term& term) const {
  const auto differs = [&](const std::string& what) { return internalError("a term of type " + term.type() + " is not the " + type + " expected: " + what); };
  if (term.type() != type || term.domain() != domain) return differs("another type or domain");
  if (atMost ? term.extent().elements() > extent.elements() : !(term.extent() == extent)) return differs(text(term.extent()) + ", not " + text(extent));
  for (const Plane& p : term.planes()) {
    const PlaneShape* known = find(p.name);
    if (!known || known->format != p.format || known->channels != p.channels) return differs("plane " + text(p.name, p.format, p.channels));
  }
  for (const PlaneShape& p : planes)
    if (p.fill != PlaneShape::Fill::Absent && !term.hasPlane(p.name)) return differs("no plane " + text(p.name, p.format, p.channels));
  return {};
}

TermShape shapeOf(const Term& term) {
  TermShape shape{term.type(), term.domain(), term.extent(), {}};
  for (const Plane& p : term.planes()) shape.planes.push_back({p.name, p.format, p.channels});
  return shape;
}

std::shared_ptr<Term> makeTerm(const TermShape& shape) {
  if (shape.atMost) return nullptr;
  auto term = std::make_shared<Term>(shape.type, shape.domain, shape.extent);
  for (const PlaneShape& p : shape.planes)
    if (p.fill != PlaneShape::Fill::Absent) term->addRaw(p.name, p.format, p.channels, p.fill == PlaneShape::Fill::Zeroed);
  return term;
}

Wiring::Wiring(std::string node, std::span<const TermShape> in, size_t least, size_t most) : node_(std::move(node)), in_(in) {
  if (in.size() < least || in.size() > most)
    fail("has " + std::to_string(in.size()) + " inputs, needs " + std::to_string(least) + (least == most ? "" : " or more"));
}

void Wiring::fail(std::string what) {
  if (status_.ok()) status_ = internalError(node_ + " " + std::move(what));
}

const TermShape& Wiring::input(size_t i) const {
  static const TermShape none;
  return i < in_.size() ? in_[i] : none;
}

int Wiring::channels(size_t i, std::string_view name) const {
  const PlaneShape* p = input(i).find(name);
  return p ? p->channels : 0;
}

Wiring& Wiring::reads(size_t i, std::string_view name, Format format, std::initializer_list<int> channels) {
  const PlaneShape* p = input(i).find(name);
  const std::string which = "input " + std::to_string(i) + " (" + input(i).type + ")";
  if (!p || p->fill == PlaneShape::Fill::Absent) {
    fail("reads a plane " + std::string(name) + " that " + which + " has not");
    return *this;
  }
  bool known = channels.size() == 0;
  for (const int c : channels) known = known || c == p->channels;
  if (p->format != format || !known) fail("cannot read " + text(name, p->format, p->channels) + " of " + which);
  return *this;
}

Wiring& Wiring::over(size_t i, const Extent& extent) {
  if (!(input(i).extent == extent))
    fail("needs " + text(extent) + " of input " + std::to_string(i) + " (" + input(i).type + "), which is " + text(input(i).extent));
  return *this;
}

Wiring& Wiring::require(bool holds, std::string_view what) {
  if (!holds) fail("needs " + std::string(what));
  return *this;
}

Wiring& Wiring::require(const Status& status) {
  if (!status.ok()) fail(status.toString());
  return *this;
}

Result<TermShape> Wiring::gives(TermShape shape) const {
  if (!status_.ok()) return status_;
  return shape;
}

}  // namespace terms
}  // namespace gobo
