// SPDX-License-Identifier: Apache-2.0
#include "request/curves.h"

#include <algorithm>
#include <cmath>

#include "request/expressions.h"
#include "request/request.h"

namespace gobo {
inline namespace request {

namespace {

constexpr int kMostCurves = 256, kMostKeys = 4096;

/// Slope at a key between segments of slopes `left` and `right` and lengths hLeft and hRight (0: none, the key is an end): the weighted harmonic mean
/// of neighbours of one sign, 0 at an extremum, the segment's own at an end.
double slopeAt(double hLeft, double left, double hRight, double right) {
  if (!(hLeft > 0.0)) return right;
  if (!(hRight > 0.0)) return left;
  if (!(left * right > 0.0)) return 0.0;
  const double a = 2.0 * hRight + hLeft, b = hRight + 2.0 * hLeft;
  return (a + b) / (a / left + b / right);
}

Status checkKeys(const v1::Curve& c, int width, const std::string& path) {
  const auto refuse = [&](const std::string& field, const std::string& what) { return invalidArgument(path + "." + field + what, path + "." + field); };
  const int keys = c.time_s_size();
  if (keys < 1 || keys > kMostKeys) return refuse("time_s", " has " + std::to_string(keys) + " keys: must be 1 to " + std::to_string(kMostKeys));
  if (c.value_size() != keys * width)
    return refuse("value",
                  " has " + std::to_string(c.value_size()) + " numbers: must be " + std::to_string(width) + " for each of " + std::to_string(keys) + " times");
  for (int k = 0; k < keys; ++k)
    if (!std::isfinite(c.time_s(k)) || (k > 0 && !(c.time_s(k) > c.time_s(k - 1))))
      return refuse("time_s", "[" + std::to_string(k) + "] = " + std::to_string(c.time_s(k)) + ": times must be finite and increase");
  if (!v1::Curve::Interpolation_IsValid(c.interpolation()))
    return refuse("interpolation", " = " + std::to_string(int(c.interpolation())) + ": must be LINEAR, STEP or SMOOTH");
  return {};
}

Status applyCurve(v1::RenderRequest& request, const std::string& path, const v1::Curve& curve, double time) {
  const std::string place = "request.curves." + path;
  if (!mayVary(path))
    return invalidArgument(place + ": only numbers and vectors of camera, lights, environment, shadows, tone_map, integrator, meshes and filters have curves",
                           place);
  auto field = numberField(request, path);
  if (!field.ok()) return invalidArgument(place + ": " + field.status().message(), place);
  GOBO_TRY(checkKeys(curve, field->width, place));
  for (int k = 0; k < curve.time_s_size(); ++k)
    GOBO_TRY(checkNumberField(*field, curve.value().data() + k * field->width, place + ".value[" + std::to_string(k * field->width) + "]"));
  double value[3];
  evaluateCurve(curve, field->width, time, value);
  setNumberField(*field, value);
  return {};
}

}  // namespace

void evaluateCurve(const v1::Curve& curve, int width, double time, double* out) {
  const auto& t = curve.time_s();
  const auto& v = curve.value();
  const int keys = t.size();
  const auto at = [&](int key, int c) { return v[key * width + c]; };
  const int right = int(std::upper_bound(t.begin(), t.end(), time) - t.begin());  // of the first key after `time`
  if (right == 0 || right == keys || curve.interpolation() == v1::Curve::STEP) {
    for (int c = 0; c < width; ++c) out[c] = at(std::max(right - 1, 0), c);
    return;
  }
  const int left = right - 1;
  // Times are any finite numbers: the distance of two may be beyond the largest, and a slope between two.
  const double h = t[right] - t[left], s = std::isfinite(h) ? (time - t[left]) / h : (0.5 * time - 0.5 * t[left]) / (0.5 * t[right] - 0.5 * t[left]);
  for (int c = 0; c < width; ++c) {
    const double a = at(left, c), b = at(right, c);
    if (curve.interpolation() != v1::Curve::SMOOTH) {
      out[c] = a + (b - a) * s;
      continue;
    }
    const auto slope = [&](int from) { return (at(from + 1, c) - at(from, c)) / (t[from + 1] - t[from]); };
    const double d = slope(left), hBefore = left > 0 ? t[left] - t[left - 1] : 0.0, hAfter = right + 1 < keys ? t[right + 1] - t[right] : 0.0;
    const double m0 = slopeAt(hBefore, left > 0 ? slope(left - 1) : 0.0, h, d), m1 = slopeAt(h, d, hAfter, right + 1 < keys ? slope(right) : 0.0);
    const double cubic = a + h * m0 * s + s * s * ((3.0 * (b - a) - h * (2.0 * m0 + m1)) + s * (2.0 * (a - b) + h * (m0 + m1)));
    out[c] = std::isfinite(cubic) ? std::clamp(cubic, std::min(a, b), std::max(a, b)) : a + (b - a) * s;  // beyond them by rounding alone
  }
}

Status applyCurves(v1::RenderRequest& request) {
  if (request.curves().empty()) return {};
  if (request.curves_size() > kMostCurves)
    return invalidArgument("request.curves: " + std::to_string(request.curves_size()) + " curves, at most " + std::to_string(kMostCurves), "request.curves");
  const double time = request.has_time_s() ? request.time_s() : 0.0;
  std::vector<std::pair<std::string, v1::Curve>> curves(request.curves().begin(), request.curves().end());
  std::sort(curves.begin(), curves.end(), [](const auto& a, const auto& b) { return a.first < b.first; });  // the first error is always the same one
  request.clear_curves();
  for (const auto& [path, curve] : curves) GOBO_TRY(applyCurve(request, path, curve, time));
  return {};
}

}  // namespace request
}  // namespace gobo
