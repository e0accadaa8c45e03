// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/hidden_contours.h"

#include <array>
#include <string>

#include "terms/hidden_surface.h"
#include "terms/visibility.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr size_t kMostLayers = 9, kRowsOfPiece = 16;

/// One square's samples of all layers side by side: element layer * 4 + corner, corners from the top left clockwise.
class SquareSamples {
 public:
  SquareSamples() { instance_.fill(~0u); }
  void read(std::span<const ContourInput> layers, size_t top) {
    const size_t w = size_t(layers[0].width), corner[4] = {top, top + 1, top + w + 1, top + w};
    for (size_t l = 0; l < layers.size(); ++l)
      for (size_t c = 0; c < 4; ++c) copy(layers[l], corner[c], 4 * l + c);
  }
  void copy(const ContourInput& from, size_t e, size_t to) {
    instance_[to] = from.instance[e];
    V_[to] = from.visibility(e);
    footprint_[to] = from.footprint[e];
    for (size_t k = 0; k < 3; ++k) P_[3 * to + k] = from.P[3 * e + k], N_[3 * to + k] = from.N[3 * e + k], Ng_[3 * to + k] = from.Ng[3 * e + k];
  }
  /// As a contour's input with the level of `like`.
  ContourInput input(const ContourInput& like) const {
    ContourInput in;
    in.width = in.height = 2;
    in.V = V_, in.P = P_, in.N = N_, in.Ng = Ng_, in.footprint = footprint_, in.instance = instance_;
    in.level = like.level;
    in.several = like.several;
    return in;
  }

 private:
  std::array<float, 4 * kMostLayers> V_, footprint_;
  std::array<float, 12 * kMostLayers> P_, N_, Ng_;
  std::array<uint32_t, 4 * kMostLayers> instance_;
};

/// Squares that no layer holds alone.
class Straddling {
 public:
  Straddling(std::span<const ContourInput> layers, float cosine) : layers_(layers), cosine_(cosine) {}

  void extract(int x, int y, std::vector<ContourSegment>& out) {
    const size_t top = size_t(y) * size_t(layers_[0].width) + size_t(x);
    if (!crossed(top)) return;
    all_.read(layers_, top);
    const ContourInput in = all_.input(layers_[0]);
    for (size_t l = 0; l < layers_.size(); ++l) {
      std::array<size_t, 4> corner{4 * l, 0, 0, 0};
      if (!around(in, corner)) continue;
      bool one = true;
      for (size_t c = 0; c < 4; ++c) one = one && corner[c] / 4 == l;
      if (one) continue;
      found_.clear();
      const size_t raster[4] = {0, 1, 3, 2};
      for (size_t c = 0; c < 4; ++c) square_.copy(in, corner[c], raster[c]);
      extractSquare(square_.input(layers_[0]), 0, 0, cosine_, found_);
      if (found_.empty()) continue;
      known_.clear();
      for (const ContourInput& layer : layers_) extractSquare(layer, x, y, cosine_, known_);
      for (const ContourSegment& s : found_) {
        bool had = false;
        for (const ContourSegment& k : known_) had = had || (k.a == s.a && k.b == s.b);
        if (!had) out.push_back(s);
      }
    }
  }

 private:
  bool crossed(size_t top) const {
    const size_t w = size_t(layers_[0].width);
    bool light = false, dark = false;
    for (const ContourInput& layer : layers_)
      for (const size_t e : {top, top + 1, top + w + 1, top + w})
        if (layer.valid(e)) (layer.lit(e) ? light : dark) = true;
    return light && dark;
  }
  /// The nearest samples of the other corners that lie on one surface, each with the one before it and the last with the first.
  bool around(const ContourInput& in, std::array<size_t, 4>& corner) const {
    if (!in.valid(corner[0])) return false;
    for (size_t c = 1; c < 4; ++c) {
      bool found = false;
      for (size_t l = 0; l < layers_.size() && !found; ++l) {
        corner[c] = 4 * l + c;
        found = onOneSurface(in, corner[c - 1], corner[c], cosine_) && in.valid(corner[c]);
      }
      if (!found) return false;
    }
    return onOneSurface(in, corner[3], corner[0], cosine_);
  }

  std::span<const ContourInput> layers_;
  float cosine_;
  SquareSamples all_, square_;
  std::vector<ContourSegment> found_, known_;
};

}  // namespace

std::vector<NodeId> planHiddenContours(Graph& graph, const ShadowInput& input, int layers) {
  const GBufferSettings view{input.camera, input.width, input.height, input.viewSamples, input.place};
  VisibilitySettings hard;
  hard.samples = 1;
  hard.hard = true;
  hard.extent = view.extent();
  hard.place = view.place;
  if (input.clear) hard.glass = Glass::Seen;
  std::vector<NodeId> inputs;
  NodeId before = input.gbuffer;
  for (int k = 1; k <= layers; ++k) {
    const std::string number = " " + std::to_string(k);
    before = graph.add({makeHiddenSurfaceNode(view), {before}, {}, "hidden_surface" + number, 0, input.scene, false});
    inputs.push_back(graph.add({makeVisibilityNode(hard),
                                {before},
                                {input.light},
                                "hidden_visibility" + number + ":" + input.scene->lights[size_t(input.light)].name,
                                0,
                                input.scene,
                                false}));
    inputs.push_back(before);
  }
  return inputs;
}

void readsHiddenContours(Wiring& w, const Extent& extent, int layers) {
  for (size_t i = 2; i < 2 + 2 * size_t(layers); i += 2) {
    w.over(i, extent).reads<float>(i, "V", {1, 3}).over(i + 1, extent);
    w.reads<float>(i + 1, "P", {3}).reads<float>(i + 1, "N", {3}).reads<float>(i + 1, "Ng", {3}).reads<float>(i + 1, "footprint");
    w.reads<uint32_t>(i + 1, "instance");
  }
}

Status appendHiddenContours(const RunContext& ctx, const ContourInput& seen, size_t layer, int layers, float cosine, std::vector<ContourSegment>& contour) {
  if (layers == 0 || seen.width < 2 || seen.height < 2) return {};
  GOBO_CHECK(size_t(layers) < kMostLayers);
  std::vector<ContourInput> all{seen};
  for (size_t i = 2; i < 2 + 2 * size_t(layers); i += 2) {
    ContourInput in = contourInput(*ctx.inputs.at(i), *ctx.inputs.at(i + 1), layer);
    in.level = seen.level;
    in.several = seen.several;
    GOBO_ASSIGN(const std::vector<ContourSegment> found, extractContour(in, cosine, *ctx.arena, ctx.stop));
    contour.insert(contour.end(), found.begin(), found.end());
    all.push_back(in);
  }
  const size_t rows = size_t(seen.height) - 1, pieces = (rows + kRowsOfPiece - 1) / kRowsOfPiece;
  std::vector<std::vector<ContourSegment>> found(pieces);
  const bool complete = ctx.arena->parallelFor(
      pieces, 1,
      [&](size_t begin, size_t end) {
        Straddling straddling(all, cosine);
        for (size_t piece = begin; piece < end; ++piece)
          for (size_t y = piece * kRowsOfPiece; y < std::min((piece + 1) * kRowsOfPiece, rows); ++y)
            for (int x = 0; x + 1 < seen.width; ++x) straddling.extract(x, int(y), found[piece]);
      },
      ctx.stop);
  if (!complete) return Status(Code::Cancelled, "hidden contours: stopped");
  for (const std::vector<ContourSegment>& piece : found) contour.insert(contour.end(), piece.begin(), piece.end());
  return {};
}

}  // namespace filters
}  // namespace gobo
