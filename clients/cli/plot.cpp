// SPDX-License-Identifier: Apache-2.0
#include "plot.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "server/log.h"

namespace gobo::cli {
namespace {

// 3 x 5 letters, rows from the top, 3 bits each.
const std::map<char, uint16_t> kGlyphs = {
    {'0', 075557}, {'1', 026227}, {'2', 071747}, {'3', 071717}, {'4', 055711}, {'5', 074717}, {'6', 074757}, {'7', 071222},
    {'8', 075757}, {'9', 075717}, {'.', 000002}, {'-', 000700}, {'e', 007747}, {'M', 057755}, {'S', 074717}, {'R', 075765},
    {'E', 074747}, {'A', 025755}, {'Y', 055222}, {' ', 0}};

struct Canvas {
  Image image{640, 480, 3};
  Canvas() { std::fill(image.data.begin(), image.data.end(), 1.0f); }
  void dot(int x, int y, Vec3 c) {
    if (x < 0 || y < 0 || x >= image.width || y >= image.height) return;
    float* p = image.at(x, y);
    p[0] = c.x, p[1] = c.y, p[2] = c.z;
  }
  void line(double x0, double y0, double x1, double y1, Vec3 c) {
    const int n = std::max(1, int(std::ceil(std::max(std::abs(x1 - x0), std::abs(y1 - y0)))));
    for (int i = 0; i <= n; ++i) dot(int(std::lround(x0 + (x1 - x0) * i / n)), int(std::lround(y0 + (y1 - y0) * i / n)), c);
  }
  void text(int x, int y, const std::string& s, Vec3 c) {
    for (const char ch : s) {
      const auto it = kGlyphs.find(ch);
      if (it != kGlyphs.end())
        for (int r = 0; r < 5; ++r)
          for (int k = 0; k < 3; ++k)
            if (it->second >> (14 - 3 * r - k) & 1)
              for (int d = 0; d < 4; ++d) dot(x + 2 * k + (d & 1), y + 2 * r + (d >> 1), c);
      x += 8;
    }
  }
};

}  // namespace

Image plotLogLog(const std::vector<PlotPoint>& all, const std::string& xLabel, const std::string& yLabel) {
  const Vec3 ink(0.0f), grey(0.8f), blue(0.02f, 0.1f, 0.6f);
  const double left = 70, right = 620, top = 30, bottom = 440;
  Canvas canvas;
  std::vector<PlotPoint> points;
  for (const PlotPoint& p : all)
    if (p.x > 0 && p.y > 0 && std::isfinite(p.x) && std::isfinite(p.y)) points.push_back(p);
  std::sort(points.begin(), points.end(), [](const PlotPoint& a, const PlotPoint& b) { return a.x < b.x; });
  double x0 = 0, x1 = 1, y0 = 0, y1 = 1;
  if (!points.empty()) {
    x0 = y0 = 1e9, x1 = y1 = -1e9;
    for (const PlotPoint& p : points) {
      x0 = std::min(x0, std::log10(p.x)), x1 = std::max(x1, std::log10(p.x));
      y0 = std::min(y0, std::log10(p.y)), y1 = std::max(y1, std::log10(p.y));
    }
    x0 -= 0.1, x1 += 0.1, y0 -= 0.1, y1 += 0.1;
  }
  const auto px = [&](double v) { return left + (std::log10(v) - x0) / (x1 - x0) * (right - left); };
  const auto py = [&](double v) { return bottom - (std::log10(v) - y0) / (y1 - y0) * (bottom - top); };
  // Grid at 1, 2, 5 of each decade.
  for (int decade = int(std::floor(x0)); decade <= int(std::ceil(x1)); ++decade)
    for (const int m : {1, 2, 5}) {
      const double v = m * std::pow(10.0, decade), x = px(v);
      if (x < left || x > right) continue;
      canvas.line(x, top, x, bottom, grey);
      canvas.text(int(x) - 8, int(bottom) + 8, strf("%g", v), ink);
    }
  for (int decade = int(std::floor(y0)); decade <= int(std::ceil(y1)); ++decade)
    for (const int m : {1, 2, 5}) {
      const double v = m * std::pow(10.0, decade), y = py(v);
      if (y < top || y > bottom) continue;
      canvas.line(left, y, right, y, grey);
      canvas.text(4, int(y) - 5, strf("%g", v), ink);
    }
  canvas.line(left, bottom, right, bottom, ink);
  canvas.line(left, top, left, bottom, ink);
  canvas.text(int(right) - 8 * int(xLabel.size()), 460, xLabel, ink);
  canvas.text(4, 8, yLabel, ink);
  for (size_t i = 0; i < points.size(); ++i) {
    const PlotPoint& p = points[i];
    const double x = px(p.x), y = py(p.y);
    if (i) canvas.line(px(points[i - 1].x), py(points[i - 1].y), x, y, blue);
    if (p.yError > 0) canvas.line(x, std::clamp(py(p.y + p.yError), top, bottom), x, p.y > p.yError ? std::clamp(py(p.y - p.yError), top, bottom) : bottom, blue);
    for (int dy = -3; dy <= 3; ++dy)
      for (int dx = -3; dx <= 3; ++dx) canvas.dot(int(x) + dx, int(y) + dy, blue);
  }
  return std::move(canvas.image);
}

}  // namespace gobo::cli
