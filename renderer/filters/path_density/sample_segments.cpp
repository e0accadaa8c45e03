// SPDX-License-Identifier: Apache-2.0
#include "filters/path_density/sample_segments.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "filters/path_density/composite.h"

namespace gobo::pathdensity {

namespace {

constexpr float kMostSegmentSigma = 1e6f;
constexpr double kStays = 1e-6;  // squared, of a step

/// Of one sample's way.
MetricPoint endOfWay(const SampleBins& bins, const MetricPoints& p, size_t start, float filmScale, const SegmentSettings& s) {
  MetricPoint at = pointAt(p, start);
  const float perCell = filmScale / float(bins.cell), film2 = s.film * s.film, colour2 = s.colour * s.colour;
  const auto cellOf = [&](float v, int most) { return std::clamp(int(std::floor(v * perCell)), 0, most - 1); };
  for (int step = 0; step < s.most; ++step) {
    double sum[5] = {}, n = 0;
    const int x0 = cellOf(at.x - s.film, bins.cellsX), x1 = cellOf(at.x + s.film, bins.cellsX);
    for (int y = cellOf(at.y - s.film, bins.cellsY); y <= cellOf(at.y + s.film, bins.cellsY); ++y)
      for (size_t i = bins.cellsBegin(x0, y); i < bins.cellsEnd(x1, y); ++i) {
        const float dx = p.x[i] - at.x, dy = p.y[i] - at.y, dl = p.l[i] - at.l, da = p.a[i] - at.a, db = p.b[i] - at.b;
        if (dx * dx + dy * dy > film2 || dl * dl + da * da + db * db > colour2) continue;
        const float to[5] = {dx, dy, dl, da, db};
        for (int c = 0; c < 5; ++c) sum[c] += double(to[c]);
        ++n;
      }
    if (n == 0) break;  // by rounding: the density never falls on the way
    double far = 0;
    for (double& v : sum) {
      v /= n;
      far += v * v;
    }
    at = {at.x + float(sum[0]), at.y + float(sum[1]), at.l + float(sum[2]), at.a + float(sum[3]), at.b + float(sum[4])};
    if (far < kStays) break;
  }
  return at;
}

/// Sets of samples that were joined; a set is known by its first one.
class Sets {
 public:
  explicit Sets(size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0u); }
  uint32_t first(uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(uint32_t a, uint32_t b) {
    a = first(a);
    b = first(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<uint32_t> parent_;
};

/// Samples by cells of the film as wide as what joins them; each cell's in order.
struct EndCells {
  float side;
  int across, down;
  std::vector<uint32_t> start, order;

  EndCells(const std::vector<MetricPoint>& ends, float width, float height, float join)
      : side(join), across(int(width / join) + 1), down(int(height / join) + 1), start(size_t(across) * size_t(down) + 1, 0), order(ends.size()) {
    for (const MetricPoint& e : ends) ++start[cell(x(e), y(e)) + 1];
    for (size_t c = 1; c < start.size(); ++c) start[c] += start[c - 1];
    std::vector<uint32_t> next(start.begin(), start.end() - 1);
    for (size_t i = 0; i < ends.size(); ++i) order[next[cell(x(ends[i]), y(ends[i]))]++] = uint32_t(i);
  }
  int x(const MetricPoint& e) const { return std::clamp(int(e.x / side), 0, across - 1); }
  int y(const MetricPoint& e) const { return std::clamp(int(e.y / side), 0, down - 1); }
  size_t cell(int cx, int cy) const { return size_t(cy) * size_t(across) + size_t(cx); }
};

/// Sorted: the first sample of each one's segment. False: stopped.
bool joinEnds(const std::vector<MetricPoint>& ends, float width, float height, const SegmentSettings& s, std::vector<uint32_t>& of, const StopToken& stop) {
  const float film = s.join * s.film, colour = s.join * s.colour;
  const EndCells cells(ends, width, height, film);
  Sets sets(ends.size());
  for (size_t i = 0; i < ends.size(); ++i) {
    if ((i & 255) == 0 && stop.stopRequested()) return false;
    const MetricPoint& e = ends[i];
    for (int v = std::max(cells.y(e) - 1, 0); v <= std::min(cells.y(e) + 1, cells.down - 1); ++v)
      for (int u = std::max(cells.x(e) - 1, 0); u <= std::min(cells.x(e) + 1, cells.across - 1); ++u)
        for (uint32_t at = cells.start[cells.cell(u, v)]; at < cells.start[cells.cell(u, v) + 1]; ++at) {
          const uint32_t j = cells.order[at];
          if (j >= i) break;
          const MetricPoint& o = ends[j];
          const float dx = o.x - e.x, dy = o.y - e.y, dl = o.l - e.l, da = o.a - e.a, db = o.b - e.b;
          if (dx * dx + dy * dy <= film * film && dl * dl + da * da + db * db <= colour * colour) sets.join(uint32_t(i), j);
        }
  }
  of.resize(ends.size());
  for (size_t i = 0; i < ends.size(); ++i) of[i] = sets.first(uint32_t(i));
  return true;
}

/// Sorted: the first one, and how many. False: stopped.
bool segmentsOf(const SampleBins& bins, const MetricPoints& points, const Settings& settings, const SegmentSettings& s, std::vector<uint32_t>& of,
                std::vector<uint32_t>& size, const TaskArena& arena, const StopToken& stop) {
  std::vector<MetricPoint> ends(points.size());
  const bool complete = arena.parallelFor(
      points.size(), 1 << 10,
      [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) {
          if ((i & 63) == 0 && stop.stopRequested()) return;
          // Even light has ends wherever there are a few more samples, one or two windows apart: on the film what holds together are the samples themselves.
          const MetricPoint end = endOfWay(bins, points, i, settings.metric.filmScale, s), place = pointAt(points, i);
          ends[i] = {place.x, place.y, end.l, end.a, end.b};
        }
      },
      stop);
  const float scale = settings.metric.filmScale;
  if (!complete || stop.stopRequested() || !joinEnds(ends, float(bins.width) / scale, float(bins.height) / scale, s, of, stop)) return false;
  std::vector<uint32_t> count(of.size(), 0);
  for (const uint32_t f : of) ++count[f];
  size.resize(of.size());
  for (size_t i = 0; i < of.size(); ++i) size[i] = count[of[i]];
  return true;
}

Status checkSegments(const SampleView& samples, const Settings& settings, const SegmentSettings& s) {
  GOBO_TRY(checkSettings(samples, settings));
  if (settings.border == Border::Correct || settings.treeEpsilon >= 0)
    return invalidArgument("segments of samples: corrected borders and trees are for searches");
  if (!(s.film > 0 && s.film <= 8) || !(s.colour > 0) || !(s.join > 0 && s.join <= 1) || s.most < 0)
    return invalidArgument("segments of samples: windows, what joins or the number of steps are out of range");
  // Cells of what joins: no more than some for each pixel.
  if (double(s.film) * double(s.join) * double(settings.metric.filmScale) < 0.1)
    return invalidArgument("segments of samples: what joins is less than 0.1 pixels");
  return {};
}

}  // namespace

Result<Segments> segmentSamples(const SampleView& samples, const Settings& settings, const SegmentSettings& segments, LightTerm term, const TaskArena& arena,
                                const StopToken& stop) {
  GOBO_TRY(checkSegments(samples, settings, segments));
  const SampleBins bins = binSamples(samples, stop);
  if (stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  MetricPoints points;
  std::vector<uint32_t> of, size;
  if (!makePoints(samples, bins, settings.metric, term, points, arena, stop) || !segmentsOf(bins, points, settings, segments, of, size, arena, stop))
    return Status(Code::Cancelled, "stopped");
  // The first of a segment in the view's order, not in that of bins.
  std::vector<uint32_t> least(of.size(), 0xffffffffu);
  for (size_t i = 0; i < of.size(); ++i) least[of[i]] = std::min(least[of[i]], bins.order[i]);
  Segments out{std::vector<uint32_t>(of.size()), std::vector<uint32_t>(of.size())};
  for (size_t i = 0; i < of.size(); ++i) {
    out.of[bins.order[i]] = least[of[i]];
    out.size[bins.order[i]] = size[i];
  }
  return out;
}

Result<Filtered> rejectSmallSegments(const SampleView& samples, const Settings& asked, const SegmentSettings& segments, const TaskArena& arena,
                                     const StopToken& stop) {
  GOBO_TRY(checkSegments(samples, asked, segments));
  Settings settings = asked;
  GOBO_TRY(checkNeighbours(samples, settings));
  const SampleBins bins = binSamples(samples, stop);
  if (stop.stopRequested()) return Status(Code::Cancelled, "stopped");
  Composite composite(samples, bins, settings);
  std::vector<float> sigma;
  const auto add = [&](LightTerm term, bool judged) {
    sigma.assign(samples.size(), 0.0f);
    MetricPoints points;
    std::vector<uint32_t> of, size;
    if (judged) {
      if (!makePoints(samples, bins, settings.metric, term, points, arena, stop) || !segmentsOf(bins, points, settings, segments, of, size, arena, stop))
        return false;
      // One sample alone in the picture has nothing to be measured by.
      for (size_t i = 0; i < sigma.size() && sigma.size() > 1; ++i)
        sigma[i] = size[i] > 1 ? 2 * std::sqrt(float(settings.neighbours) / float(size[i] - 1)) : kMostSegmentSigma;
    }
    return composite.add(
        term, sigma, [&](size_t i, NeighbourSearch::Scratch&) { return sigma[i]; }, judged, arena, stop);
  };
  const bool judges = !std::isinf(settings.soft) || settings.density;
  bool complete = true;
  if (settings.judged == Judged::Together) complete = add(LightTerm::All, judges);
  else complete = (samples.direct.empty() || add(LightTerm::Direct, judges && settings.judged == Judged::Apart)) && add(LightTerm::Indirect, judges);
  if (!complete) return Status(Code::Cancelled, "stopped");
  return composite.finish();
}

}  // namespace gobo::pathdensity
