// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/environment_split.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "techniques/transfer/environment_harmonics.h"
#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/icosphere.h"
#include "techniques/transfer/nodes.h"
#include "terms/environment_cells.h"

namespace gobo::transfer {

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kSmooth = 3 * kDegree, kSupport = 3 * kSmooth;  // standard deviation and end of the Gaussian
constexpr double kRing = 14 * kDegree;                           // outer end of what is a peak's background
constexpr int kLevel = 5;                                        // edges of 2.0 to 2.4 degrees
constexpr int kCells = 6 * EnvironmentCells::kSide * EnvironmentCells::kSide;
constexpr double kLeastRadius = 0.1 * kDegree;

double luminanceOf(const DVec3& c) { return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z; }

/// The cells of a cube within an angle of a direction: those of the boxes about the cone on each face.
class ConeCells {
 public:
  explicit ConeCells(const EnvironmentCells& cells) {
    directions_.reserve(cells.cells.size());
    for (size_t i = 0; i < cells.cells.size(); ++i) directions_.push_back(EnvironmentCells::cellDirection(i));
  }
  /// visit(cell, cosine of the angle between `d` and its middle)
  template <typename Visit>
  void within(const DVec3& d, double angle, Visit&& visit) const {
    constexpr int n = EnvironmentCells::kSide;
    const double least = std::cos(angle);
    for (int face = 0; face < 6; ++face) {
      int x0 = 0, x1 = n - 1, y0 = 0, y1 = n - 1;
      const int axis = face / 2;
      const double along = face % 2 ? -d[axis] : d[axis];
      const double towards = std::acos(std::clamp(along, -1.0, 1.0));
      if (towards - angle > 55 * kDegree) continue;  // a face's corners are 54.74 degrees off its middle
      if (towards + angle < 80 * kDegree) {          // else the cone may come near the plane of the centre: the whole face
        const double u = d[(axis + 1) % 3] / along, v = d[(axis + 2) % 3] / along;
        // A cone's image lies within tan(towards + angle) - tan(towards) of its axis's, and in no direction further.
        const double reach = std::tan(towards + angle) - std::tan(towards) + 2.0 / n;
        const auto cell = [](double t) { return std::clamp(int(std::floor((t + 1) * 0.5 * n)), 0, n - 1); };
        if (u + reach < -1 || u - reach > 1 || v + reach < -1 || v - reach > 1) continue;
        x0 = cell(u - reach);
        x1 = cell(u + reach);
        y0 = cell(v - reach);
        y1 = cell(v + reach);
      }
      for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; ++x) {
          const size_t i = (size_t(face) * n + size_t(y)) * n + size_t(x);
          const double cosine = glm::dot(d, directions_[i]);
          if (cosine >= least) visit(i, cosine);
        }
    }
  }
  const DVec3& direction(size_t cell) const { return directions_[cell]; }

 private:
  std::vector<DVec3> directions_;
};

/// Luminance of the smoothed map at the vertices.
std::vector<double> smoothed(const EnvironmentCells& cells, const ConeCells& cones, const Icosphere& sphere, const TaskArena& arena, const StopToken& stop) {
  std::vector<double> out(sphere.vertices.size());
  const bool complete = arena.parallelFor(
      out.size(), 256,
      [&](size_t begin, size_t end) {
        for (size_t v = begin; v < end; ++v) {
          double light = 0, weight = 0;
          cones.within(sphere.vertices[v], kSupport, [&](size_t i, double cosine) {
            // exp(-angle^2 / 2 sigma^2) with angle^2 = 2 (1 - cosine), within 0.2 % up to the end
            const double g = std::exp((cosine - 1) / (kSmooth * kSmooth));
            light += g * cells.cells[i].weight;
            weight += g * cells.cells[i].solidAngle;
          });
          out[v] = weight > 0 ? light / weight : 0.0;
        }
      },
      stop);
  return complete ? out : std::vector<double>();
}

/// Where climbing ends, for every vertex; of equals the lower index.
std::vector<int> climbed(const std::vector<double>& value, const Icosphere& sphere) {
  std::vector<int> root(value.size());
  for (size_t v = 0; v < value.size(); ++v) {
    root[v] = int(v);
    for (const int n : sphere.neighbours[v])
      if (n >= 0 && (value[size_t(n)] > value[size_t(root[v])] || (value[size_t(n)] == value[size_t(root[v])] && n < root[v]))) root[v] = n;
  }
  for (int& r : root)
    while (root[size_t(r)] != r) r = root[size_t(r)];
  return root;
}

struct Peak {
  DVec3 top;
  double height;
};

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
  const EnvironmentCells cells(map, stop);
  if (stop.stopRequested()) return {};
  out.flux = cells.flux;
  if (!(cells.weight > 0)) return out;
  const Icosphere& sphere = icosphere(kLevel);
  const ConeCells cones(cells);
  const std::vector<double> value = smoothed(cells, cones, sphere, arena, stop);
  if (value.empty()) return {};

  std::vector<Peak> peaks;
  const std::vector<int> root = climbed(value, sphere);
  for (size_t v = 0; v < root.size(); ++v)
    if (root[v] == int(v) && value[v] > cells.weight / (4 * std::numbers::pi)) peaks.push_back({sphere.vertices[v], value[v]});
  std::stable_sort(peaks.begin(), peaks.end(), [](const Peak& a, const Peak& b) { return a.height > b.height; });

  std::vector<double> left(cells.cells.size(), 1.0);                              // of each cell's flux
  std::vector<std::pair<SkyDisk, std::vector<std::pair<size_t, double>>>> found;  // with what each takes of which cell
  for (const Peak& peak : peaks) {
    if (stop.stopRequested()) return {};
    double ring = 0, ringAngle = 0;
    cones.within(peak.top, kRing, [&](size_t i, double cosine) {
      if (cosine > std::cos(kSupport)) return;
      ring += left[i] * cells.cells[i].weight;
      ringAngle += cells.cells[i].solidAngle;
    });
    const double background = ringAngle > 0 ? ring / ringAngle : 0.0;
    SkyDisk disk;
    double weight = 0, extent = 0;
    DVec3 moment(0.0);
    std::vector<std::pair<size_t, double>> taken;
    cones.within(peak.top, kSupport, [&](size_t i, double) {
      const EnvironmentCell& cell = cells.cells[i];
      if (!(cell.weight > 0)) return;
      const double part = left[i] - background * cell.solidAngle / cell.weight;  // of the cell's flux that rises above
      if (!(part > 0)) return;
      taken.emplace_back(i, part);
      disk.flux += part * cell.flux;
      weight += part * cell.weight;
      moment += part * cell.moment;
      extent += part * cell.extent;
    });
    if (!(weight > 0) || !(glm::length(moment) > 0)) continue;
    const double size = weight / cells.weight, t = std::clamp(size / share - 1.0, 0.0, 1.0), fade = t * t * (3 - 2 * t);
    if (!(fade > 0)) continue;
    for (auto& [i, part] : taken) {
      part *= fade;
      left[i] -= part;
    }
    const double length = glm::length(moment) / weight;
    disk.direction = moment / (length * weight);
    disk.flux *= fade;
    disk.irradiance = disk.flux * length;
    // Mean squared chord about the centre: 2 (1 - length) and what is inside of cells; of a disk it is half its radius squared.
    disk.radius = std::max(std::sqrt(2 * (2 * (1 - length) + extent / weight)), kLeastRadius);
    found.emplace_back(disk, std::move(taken));
  }
  std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return luminanceOf(a.first.flux) > luminanceOf(b.first.flux); });
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
