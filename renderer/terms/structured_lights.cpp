// SPDX-License-Identifier: Apache-2.0
#include "terms/structured_lights.h"

#include <algorithm>
#include <cmath>
#include <queue>

namespace gobo {
inline namespace terms {
namespace {

constexpr double kCompact = 0.9;        // mean resultant length from which a stratum is a lamp: within some 26 degrees of its centroid
constexpr size_t kSearchBlock = 16384;  // texels of a piece of a search: what is found does not depend on it
constexpr size_t kPollEvery = 65536;

struct Stratum {
  double importance = 0, flux = 0, solidAngle = 0;
  DVec3 moment{0.0};
  size_t begin = 0, end = 0;  // of Strata::texels
  uint32_t lights = 0;
};

struct Strata {
  std::vector<Stratum> all;
  std::vector<uint32_t> texels;  // by stratum, in rising order in each
};

uint32_t rootOf(std::vector<uint32_t>& parent, uint32_t t) {
  while (parent[t] != t) t = parent[t] = parent[parent[t]];
  return t;
}
/// The lower texel leads, so that a stratum's name is its first texel.
void joinTexels(std::vector<uint32_t>& parent, uint32_t a, uint32_t b) {
  a = rootOf(parent, a);
  b = rootOf(parent, b);
  parent[std::max(a, b)] = std::min(a, b);
}

double luminanceAt(const Environment& map, size_t t) {
  const DVec3 c(map.texels[t]);
  return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z;
}

double luminanceDeviation(const Environment& map, const StopToken& stop) {
  const EnvironmentTents tents(map.width, map.height);
  double mean = 0, all = 0, variance = 0;
  for (int pass = 0; pass < 2; ++pass) {
    for (int y = 0; y < map.height && !stop.stopRequested(); ++y) {
      const double solid = tents.weight(y);
      for (int x = 0; x < map.width; ++x) {
        const double value = luminanceAt(map, size_t(y) * size_t(map.width) + size_t(x));
        if (pass == 0) {
          mean += solid * value;
          all += solid;
        } else {
          variance += solid * (value - mean) * (value - mean);
        }
      }
    }
    if (pass == 0) mean /= all;
  }
  return std::sqrt(variance / all);
}

Strata gather(const Environment& map, const TexelCells& cells, const StructuredSettings& s, const StopToken& stop) {
  Strata out;
  const std::vector<uint32_t> of = brightnessStrata(map, s.layers, stop);
  for (size_t t = 0; t < of.size(); ++t) {
    if (t % kPollEvery == 0 && stop.stopRequested()) return {};
    if (of[t] == kNoStratum) continue;
    if (of[t] == out.all.size()) out.all.emplace_back();
    Stratum& into = out.all[of[t]];
    const double weight = cells.weight(t);
    into.flux += weight;
    into.solidAngle += cells.solidAngle(t);
    into.moment += weight * cells.direction(t);
    ++into.end;
  }
  size_t at = 0;
  for (Stratum& a : out.all) {
    const size_t count = a.end;
    a.begin = a.end = at;
    at += count;
    a.importance = std::pow(a.flux, s.fluxPower) * std::pow(std::min(a.solidAngle, s.saturatedSolidAngle), s.solidAnglePower);
  }
  out.texels.resize(at);
  for (size_t t = 0; t < of.size(); ++t) {
    if (t % kPollEvery == 0 && stop.stopRequested()) return {};
    if (of[t] != kNoStratum) out.texels[out.all[of[t]].end++] = uint32_t(t);
  }
  return out;
}

/// The texel of a stratum with the least `value`, a cosine; of equal ones the brightest, then the first. A grid is full of places that are equally far, and
/// rounding must not choose between them: a map whose texels are moved around the axis keeps its lights.
template <class Value>
uint32_t least(const Strata& strata, const Stratum& in, const TexelCells& cells, const TaskArena* arena, const StopToken& stop, const Value& value) {
  const size_t count = in.end - in.begin, blocks = (count + kSearchBlock - 1) / kSearchBlock;
  const auto search = [&](const auto& body) {
    const auto pieces = [&](size_t begin, size_t end) {
      for (size_t b = begin; b < end; ++b) body(b, in.begin + b * kSearchBlock, std::min(in.end, in.begin + (b + 1) * kSearchBlock));
    };
    if (arena && blocks > 1) {
      arena->parallelFor(blocks, 1, pieces, stop);
    } else {
      pieces(0, blocks);
    }
  };
  std::vector<double> lowest(blocks, 2.0);
  search([&](size_t b, size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) lowest[b] = std::min(lowest[b], value(strata.texels[i]));
  });
  const double equal = *std::min_element(lowest.begin(), lowest.end()) + TexelCells::kEqual;
  std::vector<std::pair<double, uint32_t>> brightest(blocks, {-1.0, kNoStratum});
  search([&](size_t b, size_t begin, size_t end) {
    if (lowest[b] > equal) return;
    for (size_t i = begin; i < end; ++i) {
      const uint32_t t = strata.texels[i];
      if (value(t) <= equal && cells.weight(t) > brightest[b].first) brightest[b] = {cells.weight(t), t};
    }
  });
  std::pair<double, uint32_t> best = brightest[0];
  for (const auto& b : brightest)
    if (b.first > best.first) best = b;
  return best.second;
}

}  // namespace

std::vector<uint32_t> brightnessStrata(const Environment& map, int layers, const StopToken& stop) {
  const uint32_t width = uint32_t(map.width), height = uint32_t(map.height);
  const size_t count = size_t(width) * height;
  const double deviation = luminanceDeviation(map, stop);
  const auto layer = [&](size_t t) {
    const double value = luminanceAt(map, t);
    if (!(value > 0.0)) return -1;
    return value >= (layers - 1) * deviation ? layers - 1 : int(value / deviation);
  };
  std::vector<uint32_t> parent(count);
  std::vector<int> row(width), above(width), first(width);
  for (uint32_t y = 0; y < height; ++y) {
    if (stop.stopRequested()) return {};
    for (uint32_t x = 0; x < width; ++x) {
      const uint32_t t = y * width + x;
      parent[t] = t;
      row[x] = layer(t);
      if (row[x] < 0) continue;
      if (x > 0 && row[x - 1] == row[x]) joinTexels(parent, t, t - 1);
      if (y > 0 && above[x] == row[x]) joinTexels(parent, t, t - width);
    }
    if (row[0] >= 0 && row[0] == row[width - 1]) joinTexels(parent, y * width, y * width + width - 1);
    if (y == 0 || y == height - 1)  // over the pole: half a turn
      for (uint32_t x = 0; x < width; ++x)
        if (const uint32_t across = (x + width / 2) % width; row[x] >= 0 && row[x] == row[across]) joinTexels(parent, y * width + x, y * width + across);
    std::swap(row, above);
  }
  std::vector<uint32_t> stratum(count, kNoStratum);
  uint32_t next = 0;
  for (uint32_t t = 0; t < count; ++t) {
    if (t % kPollEvery == 0 && stop.stopRequested()) return {};
    if (!(luminanceAt(map, t) > 0.0)) continue;
    const uint32_t root = rootOf(parent, t);  // not after t
    if (root == t) stratum[t] = next++;
    stratum[t] = stratum[root];
  }
  return stratum;
}

std::vector<MapLight> structuredLights(const Environment& map, int lights, const TaskArena* arena, const StopToken& stop, const StructuredSettings& settings) {
  TexelCells cells(map, arena);
  Strata strata = gather(map, cells, settings, stop);
  // The largest quotient first; of equal ones the first stratum.
  using Claim = std::pair<double, uint32_t>;
  const auto later = [](const Claim& a, const Claim& b) { return a.first != b.first ? a.first < b.first : a.second > b.second; };
  std::priority_queue<Claim, std::vector<Claim>, decltype(later)> claims(later);
  for (uint32_t i = 0; i < strata.all.size(); ++i) claims.push({strata.all[i].importance, i});
  bool any = false;
  for (int n = 0; n < lights && !claims.empty() && !stop.stopRequested();) {
    const uint32_t index = claims.top().second;
    claims.pop();
    Stratum& in = strata.all[index];
    const double length = glm::length(in.moment);
    const DVec3 centre = length > 0.0 ? in.moment / length : DVec3(0, 1, 0);
    const uint32_t texel = !any || (in.lights == 0 && length >= kCompact * in.flux)
                               ? least(strata, in, cells, arena, stop, [&](uint32_t t) { return -glm::dot(centre, cells.direction(t)); })
                               : least(strata, in, cells, arena, stop, [&](uint32_t t) { return cells.nearest(t); });
    if (texel == kNoStratum) break;  // stopped
    cells.add(texel, stop);
    any = true;
    ++n;
    if (++in.lights < in.end - in.begin) claims.push({in.importance / (2.0 * in.lights + 1.0), index});
  }
  return cells.lights(stop);
}

}  // namespace terms
}  // namespace gobo
