// SPDX-License-Identifier: Apache-2.0
#include "filters/stylised/abstraction.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include "filters/stylised/abstraction_cells.h"
#include "filters/stylised/abstraction_kernels.h"
#include "filters/stylised/averaged_distance.h"
#include "filters/stylised/contour.h"
#include "filters/stylised/screen_metric.h"
#include "terms/scratch.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr float kPerSigma = 3.0f;
constexpr int kAbstractionRun = 128;  // most pixels of a run
constexpr int kAbstractionTile = 32;  // of the planes that single samples read

class StyleAbstractionNode final : public Node {
 public:
  explicit StyleAbstractionNode(const StyleAbstractionSettings& s) : s_(s) { GOBO_CHECK(s.sigma >= 0.0f); }
  std::string type() const override { return "style_abstraction"; }
  int version() const override { return 4; }  // 2: a round window, sums of differences; 3: by cells where a surface is smooth; 4: strides within the picture
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override {
    if (!s_.varies) h.add(s_.sigma);
    h.add(s_.angle);
    if (s_.varies) h.add("varies");
    if (s_.pixel > 0.0f) h.add("screen").add(s_.pixel);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, s_.varies ? 3 : 2);
    w.over(0, s_.extent).reads<float>(0, "D").over(1, s_.extent);
    if (!(s_.pixel > 0.0f))
      w.reads<float>(1, "P", {3}).reads<float>(1, "N", {3}).reads<float>(1, "Ng", {3}).reads<float>(1, "footprint").reads<uint32_t>(1, "instance");
    if (s_.varies) w.over(2, s_.extent).reads<float>(2, "abstraction");
    return w.gives({"style_distance", Domain::ViewSample, s_.extent, {unsetPlane<float>("D")}});
  }
  size_t workingBytes() const override {
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    return count * (kPlanes * sizeof(float) + 1 + (s_.pixel > 0.0f ? PictureSurface::bytesPerSample() : 0)) + abstractionCellBytes(count);
  }
  Cost cost(const TermShape& result, uint32_t) const override { return {0.0, kReceiving * (s_.varies ? 150.0 : 60.0) * double(result.extent.elements())}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& g = *ctx.inputs.at(1);
    const auto from = ctx.inputs.at(0)->floats("D");
    const auto D = ctx.result->writable<float>("D");
    const size_t count = size_t(s_.extent.width) * size_t(s_.extent.height);
    const float cosine = std::cos(s_.angle) - kRoundedCosine;
    const auto varying = s_.varies ? ctx.inputs.at(2)->floats("abstraction") : std::span<const float>();
    const float unit = s_.varies ? *std::max_element(varying.begin(), varying.end()) : s_.sigma;  // of the planes
    if (!(unit > 0.0f)) {
      std::copy(from.begin(), from.end(), D.begin());
      return TermPtr(ctx.result);
    }
    const Scratch<float> planes(kPlanes * count);
    std::optional<PictureSurface> picture;
    if (s_.pixel > 0.0f) picture.emplace(s_.extent.width, s_.extent.height, s_.pixel);
    for (size_t layer = 0; layer < size_t(s_.extent.layers); ++layer) {
      const Layer l{picture ? picture->input() : surfaceInput(g, layer),
                    from.subspan(layer * count, count),
                    {unit, s_.varies ? varying.subspan(layer * count, count) : varying},
                    cosine};
      if (!smoothLayer(ctx, l, planes.get(), D.subspan(layer * count, count))) return Status(Code::Cancelled, "style_abstraction: stopped");
    }
    return TermPtr(ctx.result);
  }

 private:
  static constexpr size_t kPlanes = 9;

  /// Standard deviations: places are in units of the largest.
  struct Widths {
    float unit;
    std::span<const float> varying;
    float at(size_t e) const { return varying.empty() ? unit : varying[e]; }
  };

  struct Layer {
    ContourInput in;
    std::span<const float> d;
    Widths widths;
    float cosine;
    AbstractionInput input() const { return {in, d, widths.unit, cosine}; }
    float pixelsOfSigma(size_t e) const { return in.footprint[e] > 0.0f ? std::min(widths.at(e) / in.footprint[e], 1e6f) : 0.0f; }
  };

  /// Smooth places by cells, the rest sample by sample. False: stopped.
  bool smoothLayer(const RunContext& ctx, const Layer& l, float* planes, std::span<float> out) const {
    std::vector<uint8_t> done(out.size(), 0);
    if (!s_.varies && !abstractByCells(l.input(), *ctx.arena, ctx.stop, out, done)) return false;
    const int across = (l.in.width + kAbstractionTile - 1) / kAbstractionTile, down = (l.in.height + kAbstractionTile - 1) / kAbstractionTile;
    const auto each = [&](int count, const auto& body) {
      return ctx.arena->parallelFor(
          size_t(count), 1,
          [&](size_t begin, size_t end) {
            for (size_t k = begin; k < end; ++k) body(int(k));
          },
          ctx.stop);
    };
    std::vector<float> reach(size_t(across) * size_t(down), -1.0f);  // pixels that a tile's samples read around themselves; -1: it has none left
    const auto samplesOf = [&](int tile, const auto& body) {
      const int x0 = tile % across * kAbstractionTile, y0 = tile / across * kAbstractionTile;
      for (int y = y0; y < std::min(y0 + kAbstractionTile, l.in.height); ++y)
        for (int x = x0; x < std::min(x0 + kAbstractionTile, l.in.width); ++x) body(x, y, size_t(y) * size_t(l.in.width) + size_t(x));
    };
    if (!each(across * down, [&](int tile) {
          samplesOf(tile, [&](int, int, size_t e) {
            if (done[e]) return;
            if (l.input().counts(e)) {
              reach[size_t(tile)] = std::max(reach[size_t(tile)], kAbstractionReach * l.pixelsOfSigma(e));
            } else {
              out[e] = l.d[e], done[e] = 1;
            }
          });
        }))
      return false;
    const std::vector<uint8_t> wanted = around(reach, across, down);
    return each(across * down,
                [&](int tile) {
                  if (wanted[size_t(tile)]) samplesOf(tile, [&](int x, int y, size_t e) { separate(l, x, y, e, planes); });
                }) &&
           each(l.in.height, [&](int y) { smoothRow(l, planes, y, done, out); });
  }

  /// Tiles within reach of those that have any; runs of samples have the reach of the one that sees most, which may be of the next tile.
  static std::vector<uint8_t> around(const std::vector<float>& reach, int across, int down) {
    std::vector<uint8_t> wanted(reach.size(), 0);
    for (int y = 0; y < down; ++y)
      for (int x = 0; x < across; ++x) {
        const auto of = [&](int u, int v) { return u < 0 || u >= across ? -1.0f : reach[size_t(v * across + u)]; };
        if (of(x, y) < 0.0f) continue;
        float most = of(x, y);
        for (int u = x - kAbstractionRun / kAbstractionTile; u <= x + kAbstractionRun / kAbstractionTile; ++u) most = std::max(most, of(u, y));
        const int tiles = int(std::min(1.2f * most / float(kAbstractionTile), 1e5f)) + 1;  // 1.2: a window's rows are rounded to strides
        for (int v = std::max(y - tiles, 0); v <= std::min(y + tiles, down - 1); ++v)
          std::fill_n(wanted.begin() + (v * across + std::max(x - tiles, 0)), std::min(x + tiles, across - 1) - std::max(x - tiles, 0) + 1, uint8_t(1));
      }
    return wanted;
  }

  /// Sample e of the planes. Those without a distance have no area.
  static void separate(const Layer& l, int x, int y, size_t e, float* planes) {
    const size_t count = l.d.size();
    const float unit = l.widths.unit, scale = 1.0f / unit;
    const bool counts = l.input().counts(e);
    const Vec3 P = counts ? l.in.at(l.in.P, e) * scale : Vec3(0.0f), N = l.in.at(l.in.N, e);
    const float area = counts ? std::clamp(l.input().areaOf(x, y) * scale * scale, kLeastAbstractionArea, kMostAbstractionArea) : 0.0f;
    const float narrower = unit / l.widths.at(e);
    const float value[kPlanes] = {P.x, P.y, P.z, N.x, N.y, N.z, area, counts ? l.d[e] : 0.0f, std::min(narrower * narrower, 1e30f)};
    for (size_t k = 0; k < kPlanes; ++k) planes[k * count + e] = value[k];
  }

  /// Runs of pixels that take every same sample, with the window of the one that sees most: what is beyond 3 sigma of a pixel does not count anyway.
  static void smoothRow(const Layer& l, const float* first, int y, std::span<const uint8_t> done, std::span<float> out) {
    const size_t count = l.d.size(), row = size_t(y) * size_t(l.in.width);
    const AbstractionPlanes p{first,
                              first + count,
                              first + 2 * count,
                              first + 3 * count,
                              first + 4 * count,
                              first + 5 * count,
                              first + 6 * count,
                              first + 7 * count,
                              l.widths.varying.empty() ? nullptr : first + 8 * count};
    // Strides beyond the picture would find no sample of it, and 1.5 of its sides reach all of it from anywhere.
    const int side = std::max(l.in.width, l.in.height), longest = std::max(side / 12, 1);
    float sums[kAbstractionRun], weights[kAbstractionRun];
    for (int begin = 0, end = 0; begin < l.in.width; begin = end) {
      if (done[row + size_t(begin)]) {
        end = begin + 1;
        continue;
      }
      int stride = 0;
      float most = 0;  // pixels of sigma
      for (end = begin; end < std::min(begin + kAbstractionRun, l.in.width) && !done[row + size_t(end)]; ++end) {
        const size_t e = row + size_t(end);
        if (p.area[e] == 0.0f || !(l.widths.at(e) > 0.0f)) continue;
        const float pixels = l.pixelsOfSigma(e);
        const int step = std::clamp(int(pixels / kPerSigma), 1, longest);
        if (stride != 0 && step != stride) break;
        stride = step;
        most = std::max(most, pixels);
      }
      for (int x = begin; x < end; ++x) sums[x - begin] = 0, weights[x - begin] = p.area[row + size_t(x)];
      const float reach = std::min(kAbstractionReach * most, 1.5f * float(side));  // pixels
      if (stride != 0) addDisc(p, l.in.width, l.in.height, y, begin, end, reach / float(stride), stride, l.cosine, sums, weights);
      for (int x = begin; x < end; ++x) {
        const size_t e = row + size_t(x);
        out[e] = p.area[e] > 0.0f ? l.d[e] + sums[x - begin] / weights[x - begin] : l.d[e];
      }
    }
  }

  StyleAbstractionSettings s_;
};

}  // namespace

NodePtr makeStyleAbstractionNode(const StyleAbstractionSettings& settings) { return std::make_shared<StyleAbstractionNode>(settings); }

}  // namespace filters
}  // namespace gobo
