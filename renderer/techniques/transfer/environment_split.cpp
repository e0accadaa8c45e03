// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/environment_split.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "techniques/transfer/cell_cones.h"
#include "techniques/transfer/environment_harmonics.h"
#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/nodes.h"

namespace gobo::transfer {

namespace {

constexpr double kRing = 14 * kDegree, kBroadRing = 40 * kDegree;  // outer end of what is a peak's background
constexpr double kBroadContrast = 3;                               // mean radiance of a broad lamp by the map's that makes it one; twice that: in full
constexpr double kLeastFade = 0.01;                                // less of a light is not worth its shadow
constexpr int kCells = 6 * EnvironmentCells::kSide * EnvironmentCells::kSide;
constexpr double kLeastRadius = 0.1 * kDegree;

struct Peak {
  DVec3 top;
  double height;
};

/// Maxima above the map's mean with enough about them for a light, highest first.
std::vector<Peak> peaksOf(const SmoothedMap& smooth, const Icosphere& sphere, double weight, double share) {
  std::vector<Peak> peaks;
  const std::vector<int> root = climbed(smooth.value, sphere);
  for (size_t v = 0; v < root.size(); ++v)
    if (root[v] == int(v) && smooth.value[v] > weight / (4 * std::numbers::pi) && smooth.within[v] > (share - 1e-9) * weight)
      peaks.push_back({sphere.vertices[v], smooth.value[v]});
  std::stable_sort(peaks.begin(), peaks.end(), [](const Peak& a, const Peak& b) { return a.height > b.height; });
  return peaks;
}

struct Found {
  SkyDisk disk;
  std::vector<std::pair<size_t, double>> taken;  // parts of cells' fluxes
};

double smoothStep(double from, double to, double x) {
  const double t = std::clamp((x - from) / (to - from), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

/// What rises above the background about a peak, as a disk; it is taken out of `left`. False: too little.
bool take(const EnvironmentCells& cells, const Peak& peak, bool broad, double share, std::vector<double>& left, Found& out) {
  const double support = broad ? kBroadSupport : kSupport;
  double ring = 0, ringAngle = 0;
  cellsWithin(peak.top, broad ? kBroadRing : kRing, [&](size_t i, double cosine) {
    if (cosine > std::cos(support)) return;
    ring += left[i] * cells.cells[i].weight;
    ringAngle += cells.cells[i].solidAngle;
  });
  const double background = ringAngle > 0 ? ring / ringAngle : 0.0;
  double weight = 0, extent = 0;
  DVec3 moment(0.0);
  cellsWithin(peak.top, support, [&](size_t i, double) {
    const EnvironmentCell& cell = cells.cells[i];
    if (!(cell.weight > 0)) return;
    const double part = left[i] - background * cell.solidAngle / cell.weight;  // of the cell's flux that rises above
    if (!(part > 0)) return;
    out.taken.emplace_back(i, part);
    out.disk.flux += part * cell.flux;
    weight += part * cell.weight;
    moment += part * cell.moment;
    extent += part * cell.extent;
  });
  if (!(weight > 0) || !(glm::length(moment) > 0)) return false;
  const double length = glm::length(moment) / weight;
  out.disk.direction = moment / (length * weight);
  // Mean squared chord about the centre: 2 (1 - length) and what is inside of cells; of a disk it is half its radius squared.
  out.disk.radius = std::max(std::sqrt(2 * (2 * (1 - length) + extent / weight)), kLeastRadius);
  double fade = smoothStep(share, 2 * share, weight / cells.weight);
  if (broad) {  // a smooth sky's brightest part is what harmonics are for: a lamp is many times as bright as the mean of all
    const double disk = 2 * std::numbers::pi * (1 - std::cos(std::min(out.disk.radius, std::numbers::pi / 2)));
    fade *= smoothStep(kBroadContrast, 2 * kBroadContrast, weight / disk / (cells.weight / (4 * std::numbers::pi)));
  }
  if (!(fade > kLeastFade)) return false;
  for (auto& [i, part] : out.taken) {
    part *= fade;
    left[i] -= part;
  }
  out.disk.flux *= fade;
  out.disk.irradiance = out.disk.flux * length;
  return true;
}

class EnvironmentSplitNode final : public Node {
 public:
  EnvironmentSplitNode(EnvironmentPtr map, int bands, int lights, double share) : map_(std::move(map)), bands_(bands), lights_(lights), share_(share) {}
  std::string type() const override { return "environment_split"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.smallOutput = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(map_->content).add(bands_).add(lights_).add(share_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    const int n = 3 * bands_ * bands_, most = std::max(lights_, 1);
    return Wiring(type(), in, 0)
        .gives({type(),
                Domain::Table,
                {1, 1, 1},
                {plane<float>("radiance", n), plane<float>("rest", n), plane<uint32_t>("count"), plane<float>("direction", 3 * most),
                 plane<float>("irradiance", 3 * most), plane<float>("radius", most), plane<float>("left", kCells)}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const EnvironmentSplit split = splitEnvironment(*map_, bands_, lights_, share_, *ctx.arena, ctx.stop);
    if (split.full.empty()) return Status(Code::Cancelled, "stopped");
    std::copy(split.full.begin(), split.full.end(), ctx.result->writable<float>("radiance").begin());
    std::copy(split.rest.begin(), split.rest.end(), ctx.result->writable<float>("rest").begin());
    ctx.result->writable<uint32_t>("count")[0] = uint32_t(split.lights.size());
    const auto direction = ctx.result->writable<float>("direction"), irradiance = ctx.result->writable<float>("irradiance"),
               radius = ctx.result->writable<float>("radius");
    const auto left = ctx.result->writable<float>("left");
    for (size_t i = 0; i < left.size(); ++i) left[i] = split.left.empty() ? 1.0f : float(split.left[i]);
    for (size_t i = 0; i < split.lights.size(); ++i) {
      for (int c = 0; c < 3; ++c) {
        direction[3 * i + size_t(c)] = float(split.lights[i].direction[c]);
        irradiance[3 * i + size_t(c)] = float(split.lights[i].irradiance[c]);
      }
      radius[i] = float(split.lights[i].radius);
    }
    return TermPtr(ctx.result);
  }

 private:
  EnvironmentPtr map_;
  int bands_, lights_;
  double share_;
};

}  // namespace

EnvironmentSplit splitEnvironment(const Environment& map, int bands, int lights, double share, const TaskArena& arena, const StopToken& stop) {
  EnvironmentSplit out;
  out.full = environmentHarmonics(map, bands, arena, stop);
  if (out.full.empty()) return {};
  out.rest = out.full;
  if (lights == 0) return out;
  const EnvironmentCells cells(map, stop, &arena);
  if (stop.stopRequested()) return {};
  out.flux = cells.flux;
  if (!(cells.weight > 0)) return out;
  const SmoothedMap smooth = smoothedCells(cells, arena, stop);
  if (smooth.value.empty()) return {};
  std::vector<double> left(cells.cells.size(), 1.0);  // of each cell's flux
  std::vector<Found> found;
  for (const bool broad : {false, true})
    for (const Peak& peak : broad ? peaksOf(smoothedBlocks(cells, left), icosphere(kBroadLevel), cells.weight, share)
                                  : peaksOf(smooth, icosphere(kSmoothLevel), cells.weight, share)) {
      if (stop.stopRequested()) return {};
      Found f;
      if (take(cells, peak, broad, share, left, f)) found.push_back(std::move(f));
    }
  std::stable_sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return luminanceOf(a.disk.flux) > luminanceOf(b.disk.flux); });
  if (found.size() > size_t(lights)) found.resize(size_t(lights));
  std::vector<double> Y(size_t(bands * bands));
  out.left.assign(cells.cells.size(), 1.0);  // of those that were kept
  for (const auto& [disk, taken] : found) {
    out.lights.push_back(disk);
    for (const auto& [i, part] : taken) {
      out.left[i] = std::max(out.left[i] - part, 0.0);
      harmonics(glm::normalize(cells.cells[i].centre()), bands, Y.data());
      for (size_t h = 0; h < Y.size(); ++h)
        for (int c = 0; c < 3; ++c) out.rest[3 * h + size_t(c)] -= part * cells.cells[i].flux[c] * Y[h];
    }
  }
  return out;
}

NodePtr makeEnvironmentSplitNode(EnvironmentPtr map, int bands, int lights, double share) {
  return std::make_shared<EnvironmentSplitNode>(std::move(map), bands, lights, share);
}

}  // namespace gobo::transfer
