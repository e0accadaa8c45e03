// SPDX-License-Identifier: Apache-2.0
#include "terms/extract_lights.h"

#include <algorithm>
#include <limits>

#include "scene/environment_tents.h"
#include "terms/structured_lights.h"
#include "terms/wavelet_lights.h"

namespace gobo {
inline namespace terms {

namespace {

// A map of fewer texels than kFewTexels has too few places for lights: a constant one has a single texel, and all light would come from +X. Whatever
// its proportions, it is less than 32 wide and high: the finer one leaves no texel out.
constexpr size_t kFewTexels = 32;
constexpr int kFineWidth = 64, kFineHeight = 32;
constexpr size_t kFineTexels = size_t(kFineWidth) * kFineHeight;

struct Cell {
  int x0, y0, x1, y1;
  double power;
};

/// Integral of luminance x solid angle over map cells by a summed-area table in double.
class PowerTable {
 public:
  PowerTable(const Environment& e, const StopToken& stop)
      : w_(e.width), h_(e.height), tents_(e.width, e.height), sums_(size_t(e.width + 1) * (e.height + 1), 0.0) {
    for (int y = 0; y < h_ && !stop.stopRequested(); ++y) {
      const double omega = texelWeight(y);
      double row = 0;
      for (int x = 0; x < w_; ++x) {
        row += omega * luminance(e.texels[size_t(y) * w_ + x]);
        at(x + 1, y + 1) = at(x + 1, y) + row;
      }
    }
  }
  /// Of the bilinear look-up, so that fluxes are the map's.
  double texelWeight(int y) const { return tents_.weight(y); }
  double power(int x0, int y0, int x1, int y1) const { return sum(x1, y1) - sum(x0, y1) - sum(x1, y0) + sum(x0, y0); }

 private:
  double& at(int x, int y) { return sums_[size_t(y) * (w_ + 1) + x]; }
  double sum(int x, int y) const { return sums_[size_t(y) * (w_ + 1) + x]; }
  int w_, h_;
  EnvironmentTents tents_;
  std::vector<double> sums_;
};

std::pair<Cell, Cell> splitCell(const Environment& e, const PowerTable& table, const Cell& c) {
  // Longer side on the sphere: longitude shrinks by the sine of the cell's middle latitude.
  const double mid = std::sin(double(kPi) * 0.5 * (c.y0 + c.y1) / e.height);
  const bool alongX = c.x1 - c.x0 > 1 && (c.y1 - c.y0 <= 1 || 2.0 * mid * (c.x1 - c.x0) / e.width >= double(c.y1 - c.y0) / e.height);
  const int lo = (alongX ? c.x0 : c.y0) + 1, hi = alongX ? c.x1 : c.y1;
  int cut = lo;
  while (cut < hi - 1 && (alongX ? table.power(c.x0, c.y0, cut, c.y1) : table.power(c.x0, c.y0, c.x1, cut)) < 0.5 * c.power) ++cut;
  Cell a = c, b = c;
  if (alongX) {
    a.x1 = cut;
    b.x0 = cut;
  } else {
    a.y1 = cut;
    b.y0 = cut;
  }
  a.power = table.power(a.x0, a.y0, a.x1, a.y1);
  b.power = table.power(b.x0, b.y0, b.x1, b.y1);
  return {a, b};
}

void emitCell(const Environment& e, const PowerTable& table, const Cell& c, std::vector<MapLight>& lights, const StopToken& stop) {
  DVec3 centre(0.0), rgb(0.0);
  for (int y = c.y0; y < c.y1 && !stop.stopRequested(); ++y) {
    const double omega = table.texelWeight(y);
    const double theta = double(kPi) * (y + 0.5) / e.height;
    for (int x = c.x0; x < c.x1; ++x) {
      const Vec3 v = e.texels[size_t(y) * e.width + x];
      const double w = omega * luminance(v), phi = (double(x) + 0.5) / e.width * 2.0 * double(kPi) - double(kPi);
      centre += w * DVec3(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
      rgb += omega * DVec3(v);
    }
  }
  const double length = glm::length(centre);
  if (!(rgb.x + rgb.y + rgb.z > 0)) return;
  if (length > 0) centre /= length;
  else centre = DVec3(0, 1, 0);  // from all sides alike: any direction is as good
  lights.push_back({centre, rgb});
}

std::vector<MapLight> medianCut(const Environment& e, int lights, const StopToken& stop) {
  const PowerTable table(e, stop);
  std::vector<Cell> cells{{0, 0, e.width, e.height, table.power(0, 0, e.width, e.height)}};
  while (int(cells.size()) < lights && !stop.stopRequested()) {
    int best = -1;
    for (size_t i = 0; i < cells.size(); ++i) {
      const Cell& c = cells[i];
      if ((c.x1 - c.x0) * (c.y1 - c.y0) > 1 && c.power > 0 && (best < 0 || c.power > cells[best].power)) best = int(i);
    }
    if (best < 0) break;  // fewer lit texels than lights asked for
    const auto [a, b] = splitCell(e, table, cells[best]);
    cells[best] = a;
    cells.push_back(b);
  }
  std::vector<MapLight> out;
  for (const Cell& c : cells) emitCell(e, table, c, out, stop);
  return out;
}

std::vector<MapLight> lightsOf(const Environment& map, int lights, ExtractBy by, const TaskArena* arena, const StopToken& stop) {
  switch (by) {
    case ExtractBy::MedianCut: break;
    case ExtractBy::Structured: return structuredLights(map, lights, arena, stop);
    case ExtractBy::Wavelet: return waveletLights(map, lights, arena, stop);
  }
  return medianCut(map, lights, stop);
}

/// What the bilinear look-up makes of a map, in its own axes.
Environment finerMap(const Environment& map) {
  Environment out;
  out.width = kFineWidth;
  out.height = kFineHeight;
  std::vector<Vec3> texels;
  texels.reserve(kFineTexels);
  for (int y = 0; y < kFineHeight; ++y)
    for (int x = 0; x < kFineWidth; ++x)
      texels.push_back(interpolateTexels(map, (x + 0.5) * map.width / double(kFineWidth), (y + 0.5) * map.height / double(kFineHeight)));
  out.texels = std::move(texels);
  return out;
}

/// Integral over the sphere of the bilinear look-up, by channel.
DVec3 channelFlux(const Environment& map) {
  const EnvironmentTents tents(map.width, map.height);
  DVec3 sum(0.0);
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) sum += tents.weight(y) * DVec3(map.texels[size_t(y) * size_t(map.width) + size_t(x)]);
  return sum;
}

class ExtractLightsNode final : public Node {
 public:
  ExtractLightsNode(int lights, ExtractBy by, size_t texels) : lights_(lights), by_(by), texels_(texels) {}
  std::string type() const override { return "extract_lights"; }
  int version() const override { return 3; }  // 2: of the bilinear look-up; 3: maps of few texels are made finer
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = Facet::Environment;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    h.add(lights_);
    if (by_ != ExtractBy::MedianCut) h.add(int(by_));  // without: the key that it had when it was the only one
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    TermShape out{"light_list", Domain::List, {lights_, 1, 1}, {plane<float>("direction", 3), plane<float>("irradiance", 3)}};
    out.atMost = true;
    return Wiring(type(), in, 0).gives(std::move(out));
  }
  size_t workingBytes() const override {
    const bool finer = texels_ < kFewTexels;
    const size_t texels = finer ? kFineTexels : texels_, map = finer ? kFineTexels * sizeof(Vec3) : 0;
    switch (by_) {
      case ExtractBy::MedianCut: break;
      case ExtractBy::Structured: return map + structuredBytes(texels);
      case ExtractBy::Wavelet: return map + waveletBytes(texels);
    }
    return map + texels * sizeof(double);
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const std::vector<MapLight> lights = extractLights(*ctx.scene->environment(), lights_, by_, ctx.arena, ctx.stop);
    if (ctx.stop.stopRequested()) return Status(Code::Cancelled, "stopped");
    return lightListTerm(lights);
  }

 private:
  int lights_;
  ExtractBy by_;
  size_t texels_;
};

}  // namespace

std::vector<MapLight> extractLights(const Environment& map, int lights, ExtractBy by, const TaskArena* arena, const StopToken& stop) {
  if (map.texels.size() >= kFewTexels) return lightsOf(map, lights, by, arena, stop);
  const Environment finer = finerMap(map);
  std::vector<MapLight> out = lightsOf(finer, lights, by, arena, stop);
  // The look-up between the finer texels is not quite the map's: no flux is lost or made.
  const DVec3 own = channelFlux(map), found = channelFlux(finer);
  for (MapLight& light : out)
    for (int k = 0; k < 3; ++k)
      if (found[k] > 0) light.flux[k] *= own[k] / found[k];
  return out;
}

TermPtr lightListTerm(std::span<const MapLight> lights) {
  auto out = std::make_shared<Term>("light_list", Domain::List, Extent{int(lights.size()), 1, 1});
  const auto direction = out->addPlane<float>("direction", 3), irradiance = out->addPlane<float>("irradiance", 3);
  for (size_t i = 0; i < lights.size(); ++i)
    for (int k = 0; k < 3; ++k) {
      direction[3 * i + size_t(k)] = float(lights[i].direction[k]);
      irradiance[3 * i + size_t(k)] = float(std::min(lights[i].flux[k], double(std::numeric_limits<float>::max())));
    }
  return out;
}

NodePtr makeExtractLightsNode(int lights, ExtractBy by, size_t texels) { return std::make_shared<ExtractLightsNode>(lights, by, texels); }

}  // namespace terms
}  // namespace gobo
