// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/mixture_density.h"

#include <algorithm>
#include <cmath>

#include "filters/path_density/composite.h"

namespace gobo::pathdensity {

namespace {

constexpr double kFilmVariance = 4.5, kColourVariance = 1.0;  // of K
constexpr double kMostMixtureSigma = 1e6;
constexpr double kMostCoordinate = 1e4;  // beyond it all colours are alike; squares stay exact enough beside the floor
constexpr double kNoShare = 60;          // exp(-30)

/// A component as c(x) reads it: smoothed by K.
struct Smoothed {
  double count = 0;  // N_j
  double scale = 0;  // sqrt(|K| / |S_j + K|)
  AxisPoint mean{};
  Triangle lower{};
};

struct Tiles {
  int side = 8, across = 0, down = 0;
  std::vector<Mixture> mixtures;
  std::vector<std::vector<Smoothed>> smoothed;  // beside the mixture's components

  Tiles(int width, int height, int tile) : side(tile), across((width + tile - 1) / tile), down((height + tile - 1) / tile) {
    mixtures.resize(size_t(across) * size_t(down));
    smoothed.resize(mixtures.size());
  }
  size_t at(int tx, int ty) const { return size_t(ty) * size_t(across) + size_t(tx); }
};

AxisPoint axesOf(const MetricPoints& p, size_t i) {
  AxisPoint x{double(p.x[i]), double(p.y[i]), double(p.l[i]), double(p.a[i]), double(p.b[i])};
  for (size_t c = 2; c < kAxes; ++c) x[c] = std::clamp(x[c], -kMostCoordinate, kMostCoordinate);
  return x;
}

std::vector<Smoothed> smoothedOf(const Mixture& mixture, size_t samples) {
  std::vector<Smoothed> out;
  for (const Gaussian& g : mixture.components()) {
    Smoothed s{g.weight * double(samples), 0.0, g.mean, {}};
    Triangle wide = g.covariance;
    double logScale = 0;
    for (size_t i = 0; i < kAxes; ++i) {
      const double k = i < 2 ? kFilmVariance : kColourVariance;
      wide[i * (i + 1) / 2 + i] += k;
      logScale += 0.5 * std::log(k);
    }
    if (s.count > 0 && choleskyOf(wide, s.lower)) {
      for (size_t i = 0; i < kAxes; ++i) logScale -= std::log(s.lower[i * (i + 1) / 2 + i]);
      s.scale = std::exp(logScale);
    } else {
      s.count = 0;
    }
    out.push_back(s);
  }
  return out;
}

/// Every sample of a tile, in order: what(i), i sorted.
template <class What>
void forTile(const SampleBins& bins, const Tiles& tiles, size_t tile, What&& what) {
  const int x0 = int(tile % size_t(tiles.across)) * tiles.side, y0 = int(tile / size_t(tiles.across)) * tiles.side;
  for (int y = y0; y < std::min(y0 + tiles.side, bins.height); ++y)
    for (int x = x0; x < std::min(x0 + tiles.side, bins.width); ++x)
      for (size_t i = bins.pixelBegin(x, y); i < bins.pixelEnd(x, y); ++i) what(i);
}

double countAround(const Tiles& tiles, size_t tile, const AxisPoint& x, std::vector<double>& r) {
  const int tx = int(tile % size_t(tiles.across)), ty = int(tile / size_t(tiles.across));
  r.assign(tiles.smoothed[tile].size(), 0.0);
  tiles.mixtures[tile].logDensity(x, r);
  double sum = 0;
  for (int v = std::max(ty - 1, 0); v <= std::min(ty + 1, tiles.down - 1); ++v)
    for (int u = std::max(tx - 1, 0); u <= std::min(tx + 1, tiles.across - 1); ++u) {
      const auto& components = tiles.smoothed[tiles.at(u, v)];
      const bool own = u == tx && v == ty;
      for (size_t j = 0; j < components.size(); ++j) {
        const Smoothed& s = components[j];
        const double count = s.count - (own ? r[j] : 0.0);
        if (count <= 0) continue;
        AxisPoint d;
        for (size_t i = 0; i < kAxes; ++i) d[i] = x[i] - s.mean[i];
        const double away = squaredBy(s.lower, d);
        if (away < kNoShare) sum += count * s.scale * std::exp(-0.5 * away);
      }
    }
  return sum;
}

/// Sorted. False: stopped.
bool measureMixture(const SampleBins& bins, const MetricPoints& points, const Settings& settings, const MixtureSettings& m, std::vector<float>& sigma,
                    uint64_t& components, const TaskArena& arena, const StopToken& stop) {
  Tiles tiles(bins.width, bins.height, m.tile);
  sigma.assign(points.size(), 0.0f);
  const bool fitted = arena.parallelFor(
      tiles.mixtures.size(), 1,
      [&](size_t tile, size_t) {
        std::vector<AxisPoint> own;
        forTile(bins, tiles, tile, [&](size_t i) { own.push_back(axesOf(points, i)); });
        MixtureLearner learner(own, m.fit);
        double last = -std::numeric_limits<double>::infinity();
        for (int i = 0; i < m.fit.iterations && !stop.stopRequested(); ++i) {
          const double now = learner.step(own);
          if (now - last < m.fit.enough) break;
          last = now;
        }
        tiles.mixtures[tile] = learner.mixture();
        tiles.smoothed[tile] = smoothedOf(learner.mixture(), own.size());
      },
      stop);
  if (!fitted || stop.stopRequested()) return false;
  for (const auto& tile : tiles.smoothed) components += uint64_t(std::count_if(tile.begin(), tile.end(), [](const Smoothed& s) { return s.count > 0; }));
  return arena.parallelFor(
             tiles.mixtures.size(), 1,
             [&](size_t tile, size_t) {
               std::vector<double> r;
               forTile(bins, tiles, tile, [&](size_t i) {
                 if ((i & 63) == 0 && stop.stopRequested()) return;
                 const double c = countAround(tiles, tile, axesOf(points, i), r);
                 const double s = c > 0 ? 2 * std::sqrt(double(settings.neighbours) / c) : kMostMixtureSigma;
                 sigma[i] = points.size() > 1 ? float(std::min(s, kMostMixtureSigma)) : 0.0f;  // a lone one has nothing to be measured by
               });
             },
             stop) &&
         !stop.stopRequested();
}

Status checkMixture(const SampleView& samples, const Settings& settings, const MixtureSettings& m) {
  GOBO_TRY(checkSettings(samples, settings));
  if (settings.border == Border::Correct || settings.treeEpsilon >= 0) return invalidArgument("mixture density: corrected borders and trees are for searches");
  // A tile is wide enough for K beside it.
  if (m.tile < 4 || m.tile > 64 || double(m.tile) < 4 * double(settings.metric.filmScale))
    return invalidArgument("mixture density: tiles of " + std::to_string(m.tile) + " pixels are not in [4, 64], or less than four film scales");
  if (m.fit.components < 1 || m.fit.components > 1024) return invalidArgument("mixture density: " + std::to_string(m.fit.components) + " components");
  if (m.fit.iterations < 0 || !(m.fit.floor > 0)) return invalidArgument("mixture density: iterations or the least variance are out of range");
  return {};
}

}  // namespace

Result<std::vector<float>> mixtureSigmasOf(const SampleView& samples, const Settings& settings, const MixtureSettings& mixture, LightTerm term,
                                           const TaskArena& arena, const StopToken& stop) {
  GOBO_TRY(checkMixture(samples, settings, mixture));
  const SampleBins bins = binSamples(samples, stop);
  if (stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  MetricPoints points;
  std::vector<float> sorted, sigma(samples.size());
  uint64_t components = 0;
  if (!makePoints(samples, bins, settings.metric, term, points, arena, stop) ||
      !measureMixture(bins, points, settings, mixture, sorted, components, arena, stop))
    return Status(Code::Cancelled, "stopped");
  for (size_t i = 0; i < sigma.size(); ++i) sigma[bins.order[i]] = sorted[i];
  return sigma;
}

Result<Filtered> rejectByMixture(const SampleView& samples, const Settings& asked, const MixtureSettings& mixture, const TaskArena& arena,
                                 const StopToken& stop, uint64_t* components) {
  GOBO_TRY(checkMixture(samples, asked, mixture));
  Settings settings = asked;
  GOBO_TRY(checkNeighbours(samples, settings));
  const SampleBins bins = binSamples(samples, stop);
  if (stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  Composite composite(samples, bins, settings);
  std::vector<float> sigma;
  uint64_t used = 0;
  const auto add = [&](LightTerm term, bool judged) {
    MetricPoints points;
    if (!judged) sigma.assign(samples.size(), 0.0f);
    else if (!makePoints(samples, bins, settings.metric, term, points, arena, stop) ||
             !measureMixture(bins, points, settings, mixture, sigma, used, arena, stop))
      return false;
    return composite.add(
        term, sigma, [&](size_t i, NeighbourSearch::Scratch&) { return sigma[i]; }, judged, arena, stop);
  };
  const bool judges = !std::isinf(settings.soft) || settings.density;
  bool complete = true;
  if (settings.judged == Judged::Together) complete = add(LightTerm::All, judges);
  else complete = (samples.direct.empty() || add(LightTerm::Direct, judges && settings.judged == Judged::Apart)) && add(LightTerm::Indirect, judges);
  if (!complete) return Status(Code::Cancelled, "stopped");
  if (components) *components = used;
  return composite.finish();
}

}  // namespace gobo::pathdensity
