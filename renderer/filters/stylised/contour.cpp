// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/contour.h"

#include <array>

#include "terms/term.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr size_t kRows = 16;  // of a piece

/// Sides of a square, numbered from its top clockwise; side k lies between corners k and k + 1. 4: none.
struct SquareCase {
  int count;
  int sides[2][2];
};
/// By the bits of lit corners (top left, top right, bottom right, bottom left). 5 and 10 cut off each lit corner by itself, so that the shadow is connected.
constexpr std::array<SquareCase, 16> kCases{{
    {0, {{4, 4}, {4, 4}}},
    {1, {{3, 0}, {4, 4}}},
    {1, {{0, 1}, {4, 4}}},
    {1, {{3, 1}, {4, 4}}},
    {1, {{1, 2}, {4, 4}}},
    {2, {{3, 0}, {1, 2}}},
    {1, {{0, 2}, {4, 4}}},
    {1, {{3, 2}, {4, 4}}},
    {1, {{2, 3}, {4, 4}}},
    {1, {{2, 0}, {4, 4}}},
    {2, {{0, 1}, {2, 3}}},
    {1, {{2, 1}, {4, 4}}},
    {1, {{1, 3}, {4, 4}}},
    {1, {{1, 0}, {4, 4}}},
    {1, {{0, 3}, {4, 4}}},
    {0, {{4, 4}, {4, 4}}},
}};

/// Where between two samples of visibility `from` and `to`, on both sides of it, the level is: 0 .. 1.
float crossing(const ContourInput& in, float from, float to) {
  const float linear = (in.level - from) / (to - from);
  if (!in.several) return linear;
  return 0.5f + (linear - 0.5f) * std::min(2.0f * (1.0f - std::abs(to - from)), 1.0f);
}

void extractSquareOf(const ContourInput& in, int x, int y, int code, float cosine, std::vector<ContourSegment>& out) {
  const size_t w = size_t(in.width), top = size_t(y) * w + size_t(x);
  const size_t corner[4] = {top, top + 1, top + w + 1, top + w};
  const SquareCase& c = kCases[size_t(code)];
  for (int s = 0; s < c.count; ++s) {
    ContourSegment segment;
    Vec3 normal(0.0f);
    bool whole = true;
    for (int k = 0; k < 2 && whole; ++k) {
      const size_t e = corner[c.sides[s][k]], f = corner[(c.sides[s][k] + 1) % 4];
      whole = onOneSurface(in, e, f, cosine);
      const float from = in.visibility(e), to = in.visibility(f);
      const Vec3 P = in.at(in.P, e);
      (k == 0 ? segment.a : segment.b) = P + crossing(in, from, to) * (in.at(in.P, f) - P);
      normal += in.at(in.N, e) + in.at(in.N, f);
    }
    const float length = glm::length(normal);
    if (!whole || segment.a == segment.b || !(length > 0.0f)) continue;
    segment.normal = normal / length;
    out.push_back(segment);
  }
}

void litRow(const ContourInput& in, size_t y, std::vector<uint8_t>& lit) {
  const size_t w = size_t(in.width), first = y * w;
  if (in.channels == 1)
    for (size_t x = 0; x < w; ++x) lit[x] = in.V[first + x] >= in.level;
  else
    for (size_t x = 0; x < w; ++x) lit[x] = in.lit(first + x);
}

void extractRows(const ContourInput& in, size_t begin, size_t end, float cosine, std::vector<ContourSegment>& out, std::vector<uint32_t>* squares) {
  std::vector<uint8_t> above(size_t(in.width)), below(size_t(in.width));
  litRow(in, begin, below);
  for (size_t y = begin; y < end; ++y) {
    above.swap(below);
    litRow(in, y + 1, below);
    for (size_t x = 0; x + 1 < size_t(in.width); ++x) {
      const int code = above[x] | above[x + 1] << 1 | below[x + 1] << 2 | below[x] << 3;
      if (code == 0 || code == 15) continue;
      extractSquareOf(in, int(x), int(y), code, cosine, out);
      if (squares) squares->resize(out.size(), uint32_t(y * size_t(in.width) + x));
    }
  }
}

}  // namespace

void extractSquare(const ContourInput& in, int x, int y, float cosine, std::vector<ContourSegment>& out) {
  const size_t w = size_t(in.width), top = size_t(y) * w + size_t(x);
  const int code = int(in.lit(top)) | int(in.lit(top + 1)) << 1 | int(in.lit(top + w + 1)) << 2 | int(in.lit(top + w)) << 3;
  extractSquareOf(in, x, y, code, cosine, out);
}

ContourInput surfaceInput(const Term& g, size_t layer) {
  ContourInput in;
  in.width = g.extent().width;
  in.height = g.extent().height;
  const size_t count = size_t(in.width) * size_t(in.height), first = layer * count;
  in.P = g.floats("P").subspan(3 * first, 3 * count);
  in.N = g.floats("N").subspan(3 * first, 3 * count);
  in.Ng = g.floats("Ng").subspan(3 * first, 3 * count);
  in.footprint = g.floats("footprint").subspan(first, count);
  in.instance = g.plane<uint32_t>("instance").subspan(first, count);
  return in;
}

ContourInput contourInput(const Term& visibility, const Term& g, size_t layer, int level, int levels) {
  ContourInput in = surfaceInput(g, layer);
  in.channels = visibility.channels("V");
  in.level = (float(level) + 0.5f) / float(levels);
  in.several = levels > 1;
  const size_t count = size_t(in.width) * size_t(in.height);
  in.V = visibility.floats("V").subspan(layer * count * size_t(in.channels), count * size_t(in.channels));
  return in;
}

bool onOneSurface(const ContourInput& in, size_t e, size_t f, float cosine) {
  if (!in.valid(e) || in.instance[e] != in.instance[f] || glm::dot(in.at(in.N, e), in.at(in.N, f)) < cosine) return false;
  const Vec3 step = in.at(in.P, f) - in.at(in.P, e);
  const float width = std::max(in.footprint[e], in.footprint[f]);
  return std::abs(glm::dot(step, in.at(in.Ng, e))) <= width && std::abs(glm::dot(step, in.at(in.Ng, f))) <= width;
}

Result<std::vector<ContourSegment>> extractContour(const ContourInput& in, float cosine, const TaskArena& arena, const StopToken& stop,
                                                   std::vector<uint32_t>* squares) {
  if (squares) squares->clear();
  std::vector<ContourSegment> all;
  if (in.width < 2 || in.height < 2) return all;
  const size_t rows = size_t(in.height) - 1, pieces = (rows + kRows - 1) / kRows;
  std::vector<std::vector<ContourSegment>> found(pieces);
  std::vector<std::vector<uint32_t>> places(squares ? pieces : 0);
  const bool complete = arena.parallelFor(
      pieces, 1,
      [&](size_t begin, size_t end) {
        for (size_t piece = begin; piece < end; ++piece)
          extractRows(in, piece * kRows, std::min((piece + 1) * kRows, rows), cosine, found[piece], squares ? &places[piece] : nullptr);
      },
      stop);
  if (!complete) return Status(Code::Cancelled, "contour: stopped");
  for (const std::vector<ContourSegment>& piece : found) all.insert(all.end(), piece.begin(), piece.end());
  for (const std::vector<uint32_t>& piece : places) squares->insert(squares->end(), piece.begin(), piece.end());
  return all;
}

}  // namespace filters
}  // namespace gobo
