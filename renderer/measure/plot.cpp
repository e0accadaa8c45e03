// SPDX-License-Identifier: Apache-2.0
#include "measure/plot.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/check.h"
#include "base/image_io.h"
#include "measure/font.h"

namespace gobo {
inline namespace measure {
namespace {

constexpr int kScale = 2;  // of the font
constexpr int kLineHeight = (kGlyphHeight + 4) * kScale;
const Vec3 kInk(0.02f), kGrid(0.80f), kMinorGrid(0.91f);
/// Okabe and Ito's colours, which the colour-blind can tell apart, decoded to linear; yellow is replaced by grey (on white).
const Vec3 kColours[8] = {Vec3(0.000f, 0.168f, 0.445f), Vec3(0.665f, 0.112f, 0.000f), Vec3(0.000f, 0.342f, 0.171f), Vec3(0.604f, 0.191f, 0.386f),
                          Vec3(0.791f, 0.347f, 0.000f), Vec3(0.093f, 0.456f, 0.815f), Vec3(0.180f, 0.180f, 0.180f), Vec3(0.020f, 0.020f, 0.020f)};

int textWidth(const std::string& s) { return s.empty() ? 0 : (int(s.size()) * kGlyphAdvance - 1) * kScale; }

class Canvas {
 public:
  Canvas(int w, int h) : image(w, h, 3) {
    std::fill(image.data.begin(), image.data.end(), 1.0f);
    image.names = {"R", "G", "B"};
  }

  void blend(int x, int y, const Vec3& colour, float alpha) {
    if (x < 0 || y < 0 || x >= image.width || y >= image.height || alpha <= 0) return;
    float* p = image.at(x, y);
    for (int c = 0; c < 3; ++c) p[c] += (colour[c] - p[c]) * std::min(alpha, 1.0f);
  }
  void box(int x0, int y0, int x1, int y1, const Vec3& colour) {
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) blend(x, y, colour, 1);
  }
  /// Coverage by distance to the segment: smooth at one pixel.
  void segment(double x0, double y0, double x1, double y1, double width, const Vec3& colour) {
    const double r = width / 2 + 1, dx = x1 - x0, dy = y1 - y0, length2 = std::max(dx * dx + dy * dy, 1e-12);
    for (int y = int(std::floor(std::min(y0, y1) - r)); y <= int(std::max(y0, y1) + r); ++y)
      for (int x = int(std::floor(std::min(x0, x1) - r)); x <= int(std::max(x0, x1) + r); ++x) {
        const double px = x + 0.5 - x0, py = y + 0.5 - y0, t = std::clamp((px * dx + py * dy) / length2, 0.0, 1.0);
        blend(x, y, colour, float(std::clamp(width / 2 + 0.5 - std::hypot(px - t * dx, py - t * dy), 0.0, 1.0)));
      }
  }
  /// The dashes of a segment that begins `along` pixels into its line.
  void dashes(double x0, double y0, double x1, double y1, double width, const Vec3& colour, double along) {
    constexpr double on = 9, period = 15;
    const double length = std::hypot(x1 - x0, y1 - y0);
    if (!(length > 0)) return;
    const auto part = [&](double from, double to) {
      const double a = from / length, b = to / length;
      segment(x0 + a * (x1 - x0), y0 + a * (y1 - y0), x0 + b * (x1 - x0), y0 + b * (y1 - y0), width, colour);
    };
    for (double start = std::floor(along / period) * period; start < along + length; start += period)
      if (start + on > along) part(std::max(start - along, 0.0), std::min(start + on - along, length));
  }
  /// Disc, square, diamond or triangle by `shape` % 4, of radius r.
  void mark(double cx, double cy, int shape, const Vec3& colour, double r = 5) {
    for (int y = int(cy - r - 2); y <= int(cy + r + 2); ++y)
      for (int x = int(cx - r - 2); x <= int(cx + r + 2); ++x) {
        const double px = x + 0.5 - cx, py = y + 0.5 - cy, ax = std::fabs(px), ay = std::fabs(py);
        const double inside[4] = {r - std::hypot(px, py), 0.85 * r - std::max(ax, ay), (1.2 * r - ax - ay) * 0.707,
                                  std::min((py + r) * 0.447 - ax * 0.894 + 0.2 * r, 0.7 * r - py)};
        blend(x, y, colour, float(std::clamp(inside[shape % 4] + 0.5, 0.0, 1.0)));
      }
  }
  /// Top left corner at (x, y); turned: reads upwards, with (x, y) its bottom left corner.
  void text(int x, int y, const std::string& s, const Vec3& colour, bool turned = false) {
    for (size_t i = 0; i < s.size(); ++i)
      for (int row = 0; row < kGlyphHeight * kScale; ++row)
        for (int column = 0; column < kGlyphWidth * kScale; ++column) {
          if (!(glyphRows(s[i])[row / kScale] >> (kGlyphWidth - 1 - column / kScale) & 1)) continue;
          const int along = int(i) * kGlyphAdvance * kScale + column, down = row + glyphDescent(s[i]) * kScale;
          turned ? blend(x + down, y - 1 - along, colour, 1) : blend(x + along, y + down, colour, 1);
        }
  }

  Image image;
};

struct Axis {
  bool logarithmic;
  double low = 0, high = 0;  // in data units
  double pixelLow = 0, pixelHigh = 0;

  /// Beyond these an axis with its margins would leave double, and no point would have a place.
  static constexpr double kLargest = 1e150;
  bool shows(double v) const { return std::fabs(v) <= kLargest && (!logarithmic || v >= 1 / kLargest); }
  double transform(double v) const { return logarithmic ? std::log10(v) : v; }
  double at(double v) const { return pixelLow + (transform(v) - transform(low)) / (transform(high) - transform(low)) * (pixelHigh - pixelLow); }
  /// Takes the range of `values` with a margin.
  void fit(const std::vector<double>& values) {
    low = logarithmic ? 1 : 0, high = logarithmic ? 10 : 1;
    if (values.empty()) return;
    const auto [a, b] = std::minmax_element(values.begin(), values.end());
    double from = transform(*a), to = transform(*b);
    const double least = logarithmic ? 0.3 : std::max(1e-12, 0.1 * std::max(std::fabs(from), std::fabs(to)));
    if (to - from < least) from -= least / 2, to += least / 2;
    const double margin = 0.06 * (to - from);
    low = from - margin, high = to + margin;
    if (logarithmic) low = std::pow(10, low), high = std::pow(10, high);
  }
};

std::string tickLabel(double v) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.4g", std::fabs(v) < 1e-300 ? 0.0 : v);
  std::string s = buffer;
  const size_t e = s.find('e');
  if (e == std::string::npos) return s;
  while (e + 2 < s.size() - 1 && s[e + 2] == '0') s.erase(e + 2, 1);  // 1e-05 -> 1e-5
  if (s[e + 1] == '+') s.erase(e + 1, 1);
  return s;
}

}  // namespace

std::vector<double> axisTicks(double low, double high, bool logarithmic) {
  GOBO_CHECK_LT(low, high);
  std::vector<double> out;
  if (logarithmic) {
    GOBO_CHECK_GT(low, 0.0);
    const double decades = std::log10(high / low);
    const int step = std::max(1, int(std::ceil(decades / 8)));
    for (int e = int(std::floor(std::log10(low))); e <= int(std::ceil(std::log10(high))); ++e)
      for (int m : {1, 2, 5}) {
        const double v = m * std::pow(10.0, e);
        if (v < low || v > high || (m != 1 && decades > 2.2) || (decades > 2.2 && e % step != 0)) continue;
        out.push_back(v);
      }
    if (out.size() >= 2) return out;
    out.clear();  // less than half a decade: evenly spaced values read better
  }
  const double rough = (high - low) / 6, power = std::pow(10.0, std::floor(std::log10(rough)));
  const double step = power * (rough / power > 5 ? 10 : rough / power > 2 ? 5 : rough / power > 1 ? 2 : 1);
  for (double k = std::ceil(low / step); k * step <= high; ++k) out.push_back(k * step + 0.0);  // + 0.0: never -0
  return out;
}

Image drawPlot(const Plot& plot) {
  GOBO_CHECK(plot.width >= 320 && plot.height >= 240);
  Canvas canvas(plot.width, plot.height);
  Axis x{plot.logX}, y{plot.logY};
  std::vector<double> xs, ys;
  int legend = 0;
  for (const PlotSeries& s : plot.series) {
    legend = std::max(legend, textWidth(s.name));
    for (const PlotPoint& p : s.points) {
      if (!x.shows(p.x) || !y.shows(p.y)) continue;
      xs.push_back(p.x), ys.push_back(p.y);
      if (p.high > p.low)
        for (double v : {p.low, p.high})
          if (y.shows(v)) ys.push_back(v);
    }
  }
  x.fit(xs), y.fit(ys);
  const auto yTicks = axisTicks(y.low, y.high, y.logarithmic), xTicks = axisTicks(x.low, x.high, x.logarithmic);
  int labels = 0;
  for (double v : yTicks) labels = std::max(labels, textWidth(tickLabel(v)));

  const int left = 16 + kLineHeight + labels, top = 16 + (plot.title.empty() ? 0 : kLineHeight + 6);
  const int right = std::max(left + 80, plot.width - 20 - (legend ? std::min(legend, plot.width / 2) + 44 : 0));
  const int bottom = plot.height - 16 - 2 * kLineHeight;
  x.pixelLow = left, x.pixelHigh = right, y.pixelLow = bottom, y.pixelHigh = top;

  const auto minor = [](const Axis& axis) {  // 2..9 of every decade
    std::vector<double> out;
    if (axis.logarithmic && std::log10(axis.high / axis.low) < 8)
      for (int e = int(std::floor(std::log10(axis.low))); e <= int(std::log10(axis.high)) + 1; ++e)
        for (int m = 2; m < 10; ++m)
          if (const double v = m * std::pow(10.0, e); v > axis.low && v < axis.high) out.push_back(v);
    return out;
  };
  for (double v : minor(x)) canvas.box(int(x.at(v)), top, int(x.at(v)) + 1, bottom, kMinorGrid);
  for (double v : minor(y)) canvas.box(left, int(y.at(v)), right, int(y.at(v)) + 1, kMinorGrid);
  int free = -1000;  // labels that would run into one another are left out
  for (double v : xTicks) {
    const int at = int(x.at(v)), half = textWidth(tickLabel(v)) / 2;
    canvas.box(at, top, at + 1, bottom + 5, kGrid);
    if (at - half < free) continue;
    canvas.text(at - half, bottom + 9, tickLabel(v), kInk);
    free = at + half + 8;
  }
  for (double v : yTicks) {
    const int at = int(y.at(v));
    canvas.box(left - 5, at, right, at + 1, kGrid);
    canvas.text(left - 9 - textWidth(tickLabel(v)), at - kGlyphHeight * kScale / 2, tickLabel(v), kInk);
  }
  canvas.box(left, top, left + 2, bottom, kInk);
  canvas.box(left, bottom - 1, right, bottom + 1, kInk);
  canvas.text(std::max(4, (plot.width - textWidth(plot.title)) / 2), 12, plot.title, kInk);
  canvas.text((left + right - textWidth(plot.xLabel)) / 2, bottom + 12 + kLineHeight, plot.xLabel, kInk);
  canvas.text(6, (top + bottom + textWidth(plot.yLabel)) / 2, plot.yLabel, kInk, true);

  for (size_t i = 0; i < plot.series.size(); ++i) {
    const PlotSeries& s = plot.series[i];
    const Vec3 colour = kColours[i % 8];
    const PlotPoint* last = nullptr;
    double along = 0;  // of the line, in pixels
    const auto join = [&](double x0, double y0, double x1, double y1) {
      if (i / 8 % 2) canvas.dashes(x0, y0, x1, y1, s.width, colour, along);
      else canvas.segment(x0, y0, x1, y1, s.width, colour);
      along += std::hypot(x1 - x0, y1 - y0);
    };
    for (const PlotPoint& p : s.points) {
      if (!x.shows(p.x) || !y.shows(p.y)) {
        if (s.gaps) last = nullptr;
        continue;
      }
      const double px = x.at(p.x), py = y.at(p.y);
      if (p.high > p.low && y.shows(p.high)) {
        const double lowest = y.shows(p.low) ? y.at(p.low) : double(bottom);
        canvas.segment(px, lowest, px, y.at(p.high), 1.2, colour);
        for (double end : {lowest, y.at(p.high)}) canvas.segment(px - 4, end, px + 4, end, 1.2, colour);
      }
      if (s.line && last) join(x.at(last->x), y.at(last->y), px, py);
      if (s.marks) canvas.mark(px, py, int(i), colour);
      last = &p;
    }
    const int row = top + 8 + int(i) * kLineHeight;
    along = 0;
    if (s.line) join(right + 12, row + 7, right + 34, row + 7);
    if (s.marks) canvas.mark(right + 23, row + 7, int(i), colour);
    canvas.text(right + 42, row, s.name, kInk);
  }
  return canvas.image;
}

Status writePlot(const Plot& plot, const std::string& path) {
  GOBO_ASSIGN(const std::vector<uint8_t> png, encodePng(drawPlot(plot)));
  return writeFileAtomic(path, png.data(), png.size());
}

}  // namespace measure
}  // namespace gobo
