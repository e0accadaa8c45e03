// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/surface_march.h"

#include <cmath>

#include "filters/stylised/unfolded_links.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr uint32_t kNoSource = ~0u, kNotQueued = ~0u;
constexpr double kFlat = 0.05, kFlatWidth = 0.1;  // how far out of a sample's plane a segment may lie: of its distance, and of a pixel's width
constexpr double kBetween = 1e-3;                 // how far beside two neighbours a way between them may run, of its length
constexpr double kAlike = 0.05;                   // of a step: a front's own distance that is shorter than a straight one by less is that one, with its error
constexpr float kSeen = 0.5f;                     // least share of a way that is free
constexpr uint8_t kDone = 1, kReopened = 2, kMostReopened = 16 * kReopened;
constexpr uint32_t kPollSamples = 1 << 12;

/// The least distance first, of equals the first place; a sample is in it once. Four children a node.
class Heap {
 public:
  Heap(const std::vector<double>& key, size_t count) : key_(key), place_(count, kNotQueued) {}
  bool empty() const { return heap_.empty(); }
  void push(uint32_t e) {  // or its key has become less
    if (place_[e] == kNotQueued) place_[e] = uint32_t(heap_.size()), heap_.push_back(e);
    up(place_[e]);
  }
  void moved(uint32_t e) {  // its key has changed either way
    if (place_[e] == kNotQueued) return push(e);
    up(place_[e]);
    down(place_[e]);
  }
  uint32_t pop() {
    const uint32_t top = heap_.front(), last = heap_.back();
    heap_.pop_back();
    place_[top] = kNotQueued;
    if (!heap_.empty()) heap_.front() = last, place_[last] = 0, down(0);
    return top;
  }

 private:
  bool less(uint32_t a, uint32_t b) const { return key_[a] != key_[b] ? key_[a] < key_[b] : a < b; }
  void put(size_t at, uint32_t e) { heap_[at] = e, place_[e] = uint32_t(at); }
  void up(size_t at) {
    const uint32_t e = heap_[at];
    for (; at > 0 && less(e, heap_[(at - 1) / 4]); at = (at - 1) / 4) put(at, heap_[(at - 1) / 4]);
    put(at, e);
  }
  void down(size_t at) {
    const uint32_t e = heap_[at];
    for (size_t child; (child = 4 * at + 1) < heap_.size(); at = child) {
      for (size_t k = child + 1; k < std::min(4 * at + 5, heap_.size()); ++k)
        if (less(heap_[k], heap_[child])) child = k;
      if (!less(heap_[child], e)) break;
      put(at, heap_[child]);
    }
    put(at, e);
  }
  const std::vector<double>& key_;
  std::vector<uint32_t> heap_, place_;
};

class March {
 public:
  March(const ContourInput& in, std::span<const uint8_t> links, std::span<const ContourSegment> contour, float cosine)
      : in_(in),
        links_(links),
        contour_(contour),
        cosine_(cosine),
        distance_(links.size(), HUGE_VAL),
        source_(links.size(), kNoSource),
        share_(links.size(), 0.0f),
        first_(links.size(), kNoSource),
        state_(links.size(), 0),
        heap_(distance_, links.size()) {
    for (size_t k = 0; k < 8; ++k) offset_[k] = ptrdiff_t(kAround[k].y) * in.width + kAround[k].x;
  }

  void seed(std::span<const uint32_t> squares) {
    const size_t w = size_t(in_.width);
    squares_ = squares;
    for (size_t s = squares.size(); s-- > 0;) first_[squares[s]] = uint32_t(s);  // a square's segments follow each other
    for (size_t s = 0; s < squares.size(); ++s)
      for (const size_t e : {size_t(squares[s]), size_t(squares[s]) + 1, squares[s] + w, squares[s] + w + 1}) {
        if (!in_.valid(e) || glm::dot(in_.at(in_.N, e), contour_[s].normal) < cosine_) continue;
        const DVec3 way = wayTo(uint32_t(s), e);
        const double d = glm::length(way);
        if (std::abs(glm::dot(way, DVec3(in_.at(in_.Ng, e)))) > double(in_.footprint[e]) || d >= distance_[e]) continue;
        set(e, d, uint32_t(s), 1.0f);
      }
  }

  /// False when stopped.
  bool run(const StopToken& stop) {
    for (uint32_t n = 0; !heap_.empty(); ++n) {
      if (n % kPollSamples == 0 && stop.stopRequested()) return false;
      const size_t e = heap_.pop();
      state_[e] |= kDone;
      for (size_t k = 0; k < 8; ++k)
        if (links_[e] >> k & 1) reach(size_t(ptrdiff_t(e) + offset_[k]), e, (k + 4) % 8);
    }
    return true;
  }

  std::vector<double> take() { return std::move(distance_); }

 private:
  DVec3 at(size_t e) const { return DVec3(in_.at(in_.P, e)); }
  /// From sample e to the nearest point of a segment, and whether that is one of its ends.
  DVec3 wayTo(uint32_t segment, size_t e, bool* end = nullptr) const {
    const DVec3 p = at(e), a(contour_[segment].a), along = DVec3(contour_[segment].b) - a;
    const double length2 = glm::dot(along, along);
    const double t = length2 > 0 ? std::clamp(glm::dot(p - a, along) / length2, 0.0, 1.0) : 0.0;
    if (end) *end = t == 0 || t == 1;
    return a + t * along - p;
  }
  bool flat(size_t f, const DVec3& way, double d) const {
    return std::abs(glm::dot(way, DVec3(in_.at(in_.Ng, f)))) <= kFlat * d + kFlatWidth * double(in_.footprint[f]);
  }
  /// Down from a segment over those of neighbouring squares to the nearest that lies in f's plane; kNoSource if it does not itself. `way`: to that.
  uint32_t nearest(uint32_t segment, size_t f, DVec3& way) const {
    bool end = false;
    way = wayTo(segment, f, &end);
    double d2 = glm::dot(way, way);
    if (!flat(f, way, std::sqrt(d2))) return kNoSource;
    for (bool nearer = end; nearer;) {
      nearer = false;
      const size_t square = squares_[segment];
      const auto look = [&](size_t other) {
        for (size_t s = first_[other]; s < squares_.size() && squares_[s] == other; ++s) {
          const DVec3 w = wayTo(uint32_t(s), f);
          const double w2 = glm::dot(w, w);
          if (w2 < d2 * (1 - 1e-12) && flat(f, w, std::sqrt(w2))) d2 = w2, way = w, segment = uint32_t(s), nearer = true;
        }
      };
      for (size_t k = 0; k < 8; ++k)
        if (const ptrdiff_t other = ptrdiff_t(square) + offset_[k]; other >= 0 && size_t(other) < first_.size()) look(size_t(other));
    }
    return segment;
  }
  void set(size_t e, double d, uint32_t source, float share) {
    distance_[e] = d;
    source_[e] = source;
    share_[e] = share;
    heap_.moved(uint32_t(e));
  }
  void offer(size_t f, double d, uint32_t source, double step, float share = 0) {
    const bool straight = source != kNoSource, had = source_[f] != kNoSource;
    if (state_[f] & kDone) {  // it had its turn before a straight way to it was known: its neighbours have to hear
      if (!straight || !(d < distance_[f] * (1 - 1e-9)) || state_[f] >= kMostReopened) return;
      state_[f] = uint8_t((state_[f] + kReopened) & ~kDone);
      return set(f, d, source, share);
    }
    const double slack = straight == had ? 0.0 : straight ? kAlike * step : -kAlike * step;
    if (d < distance_[f] + slack) set(f, d, source, straight ? share : share_[f]);
  }

  /// Sample e has its distance; what does its linked neighbour f have by it? e is f's neighbour k.
  void reach(size_t f, size_t e, size_t k) {
    if ((state_[f] & kDone) && source_[f] != kNoSource) return;
    const double side = surfaceStep(in_, f, e);
    if (!(state_[f] & kDone)) offer(f, distance_[e] + side, kNoSource, side);
    for (const size_t j : {(k + 1) % 8, (k + 7) % 8}) {
      const bool there = links_[f] >> j & 1;
      const size_t g = size_t(ptrdiff_t(f) + offset_[j]);
      const bool both = there && (state_[g] & kDone) && linked(e, g);
      straightTo(f, e, both ? g : e, side);
      if (both && !(state_[f] & kDone)) front(f, e, g, side);
    }
  }
  bool linked(size_t e, size_t g) const {
    for (size_t k = 0; k < 8; k += 2)
      if (ptrdiff_t(g) - ptrdiff_t(e) == offset_[k]) return links_[e] >> k & 1;
    return false;
  }

  /// The segments that e and g see, if f sees them between the two: as far as they do, each by how near to it the way passes. g == e: along the line to e
  /// alone.
  void straightTo(size_t f, size_t e, size_t g, double step) {
    if (source_[e] == kNoSource && source_[g] == kNoSource) return;
    const DVec3 p = at(f), u = at(e) - p, v = at(g) - p;
    const double uu = glm::dot(u, u), uv = glm::dot(u, v), vv = glm::dot(v, v), area2 = uu * vv - uv * uv;
    for (const uint32_t from : {source_[e], source_[g]}) {
      DVec3 way;
      const uint32_t s = from == kNoSource ? kNoSource : nearest(from, f, way);
      if (s != kNoSource) {
        const double d2 = glm::dot(way, way), du = glm::dot(way, u), dv = glm::dot(way, v);
        float share = -1;
        if (du > 0 && du * du >= (1 - kBetween * kBetween) * d2 * uu) share = share_[e];
        else if (g != e && area2 > 1e-12 * uu * vv) {
          const double a = du * vv - dv * uv, b = dv * uu - du * uv, beside = -kBetween * (std::abs(a) + std::abs(b));
          if (a >= beside && b >= beside) share = seenBy(e, a, g, b, std::sqrt(d2));
        }
        if (share >= kSeen) offer(f, std::sqrt(d2), s, step, share);
        else if (share >= 0 && source_[f] == kNoSource) share_[f] = share;
      }
      if (g == e || source_[e] == source_[g]) return;
    }
  }

  /// What is as far away as f or farther, where pixels are sheared, knows nothing of what lies between f and the contour; -1: so with both.
  float seenBy(size_t e, double a, size_t g, double b, double d) const {
    a = distance_[e] < d ? std::max(a, 0.0) : 0.0;
    b = distance_[g] < d ? std::max(b, 0.0) : 0.0;
    return a + b > 0 ? float((a * double(share_[e]) + b * double(share_[g])) / (a + b)) : -1.0f;
  }

  /// A straight front that passes e and g when it should.
  void front(size_t f, size_t e, size_t g, double fe) {
    const double fg = surfaceStep(in_, f, g), eg = surfaceStep(in_, e, g);
    const double uu = fe * fe, vv = fg * fg, ww = eg * eg, uv = 0.5 * (uu + vv - ww), area2 = uu * vv - uv * uv;
    if (!(area2 > 1e-12 * uu * vv) || !(ww > 0)) return;
    const double later = distance_[g] - distance_[e];  // all by e
    const double half = (uu - uv) * later, under = half * half - ww * (uu * later * later - area2);
    if (!(under >= 0)) return;
    const double t = (half + std::sqrt(under)) / ww;
    if (vv * t - uv * (t - later) > 0 && uu * (t - later) - uv * t > 0) offer(f, distance_[e] + t, kNoSource, fe);
  }

  const ContourInput& in_;
  std::span<const uint8_t> links_;
  std::span<const ContourSegment> contour_;
  float cosine_;
  std::vector<double> distance_;
  std::vector<uint32_t> source_;
  std::vector<float> share_;     // of the way to its segment, or to its neighbours', that is free
  std::vector<uint32_t> first_;  // of a square's segments, by its top left sample
  std::span<const uint32_t> squares_;
  std::vector<uint8_t> state_;  // kDone, and in steps of kReopened how often it had its turn again
  Heap heap_;
  ptrdiff_t offset_[8];
};

}  // namespace

Result<std::vector<double>> marchSurface(const ContourInput& in, std::span<const uint8_t> links, std::span<const ContourSegment> contour,
                                         std::span<const uint32_t> squares, float cosine, const StopToken& stop) {
  March march(in, links, contour, cosine);
  march.seed(squares);
  if (!march.run(stop)) return Status(Code::Cancelled, "surface distance: stopped");
  return march.take();
}

}  // namespace filters
}  // namespace gobo
