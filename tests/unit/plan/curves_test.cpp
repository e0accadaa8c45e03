// SPDX-License-Identifier: Apache-2.0
// request.curves: the value at a time against closed forms; a curve is what would have been typed in, for every number of the schema that may vary;
// what has no curve is refused by name.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include <google/protobuf/descriptor.h>

#include "gobo/v1/options.pb.h"
#include "request/curves.h"
#include "request/request.h"

namespace gobo::curves_test {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;

v1::Curve curve(std::initializer_list<double> times, std::initializer_list<double> values, v1::Curve::Interpolation how = v1::Curve::LINEAR) {
  v1::Curve c;
  for (const double t : times) c.add_time_s(t);
  for (const double v : values) c.add_value(v);
  c.set_interpolation(how);
  return c;
}
double at(const v1::Curve& c, double time) {
  double v = NAN;
  evaluateCurve(c, 1, time, &v);
  return v;
}

TEST(Curves, LinearStepAndTheirEnds) {
  const v1::Curve line = curve({1, 2, 4}, {10, 20, -20});
  for (const auto& [t, v] : {std::pair{-5.0, 10.0}, {1.0, 10.0}, {1.25, 12.5}, {2.0, 20.0}, {3.0, 0.0}, {4.0, -20.0}, {9.0, -20.0}})
    EXPECT_EQ(at(line, t), v) << t;
  const v1::Curve step = curve({1, 2, 4}, {10, 20, -20}, v1::Curve::STEP);
  for (const auto& [t, v] : {std::pair{-5.0, 10.0}, {1.0, 10.0}, {1.999, 10.0}, {2.0, 20.0}, {3.999, 20.0}, {4.0, -20.0}, {9.0, -20.0}})
    EXPECT_EQ(at(step, t), v) << t;
  for (const auto how : {v1::Curve::LINEAR, v1::Curve::STEP, v1::Curve::SMOOTH})
    for (const double t : {-1.0, 3.0, 8.0}) EXPECT_EQ(at(curve({3}, {7}, how), t), 7.0);
  double v[3];
  evaluateCurve(curve({0, 2}, {0, 10, 100, 1, 20, 400}), 3, 1.0, v);
  EXPECT_EQ(v[0], 0.5);
  EXPECT_EQ(v[1], 15.0);
  EXPECT_EQ(v[2], 250.0);
}

TEST(Curves, KeysVeryCloseAndVeryFarApart) {
  const v1::Curve close = curve({0, 1e-310, 1}, {3, 7, 3}, v1::Curve::SMOOTH);
  EXPECT_EQ(at(close, 0), 3.0);
  for (const double t : {1e-311, 5e-311, 1e-310, 1e-300, 0.5}) {
    EXPECT_GE(at(close, t), 3.0) << t;
    EXPECT_LE(at(close, t), 7.0) << t;
  }
  for (const auto how : {v1::Curve::LINEAR, v1::Curve::SMOOTH}) EXPECT_EQ(at(curve({-1.7e308, 1.7e308}, {20, 100}, how), 0), 60.0);
  v1::RenderRequest r;
  (*r.mutable_curves())["integrator.max_bounces"] = close;
  ASSERT_TRUE(applyCurves(r).ok());
  EXPECT_EQ(r.integrator().max_bounces(), 3u);
}

TEST(Curves, SmoothIsALineOnLinesAndNeverBeyondItsKeys) {
  const v1::Curve line = curve({0, 1, 3, 3.5}, {5, 7, 11, 12}, v1::Curve::SMOOTH);
  for (double t = 0; t <= 3.5; t += 0.1) EXPECT_NEAR(at(line, t), 5 + 2 * t, 1e-12) << t;
  // Monotone data with a jump, where a cubic through all of it overshoots; an extremum; a flat piece.
  const v1::Curve hard = curve({0, 1, 2, 3, 4, 5, 6}, {0, 0.01, 10, 10.1, 3, 3, 8}, v1::Curve::SMOOTH);
  for (int k = 0; k < 6; ++k) {
    const double a = hard.value(k), b = hard.value(k + 1);
    double last = a;
    for (double s = 0; s <= 1.0; s += 1.0 / 64) {
      const double v = at(hard, k + s);
      EXPECT_GE(v, std::min(a, b));
      EXPECT_LE(v, std::max(a, b));
      EXPECT_GE((v - last) * (b - a), -1e-12) << k + s << ": monotone";
      last = v;
    }
  }
  for (const double t : {1.0, 2.0, 3.0, 4.0, 5.0}) {  // no corner
    const double h = 1e-6, before = (at(hard, t) - at(hard, t - h)) / h, after = (at(hard, t + h) - at(hard, t)) / h;
    EXPECT_NEAR(before, after, 1e-3) << t;
  }
  EXPECT_NEAR((at(hard, 3 + 1e-6) - at(hard, 3)) / 1e-6, 0.0, 1e-4) << "an extremum is flat";
}

/// Numbers and vectors that may vary, by path.
void visit(const Descriptor& d, const std::string& prefix, const std::function<void(const std::string&, const FieldDescriptor&)>& see) {
  for (int i = 0; i < d.field_count(); ++i) {
    const FieldDescriptor& f = *d.field(i);
    const std::string path = prefix.empty() ? std::string(f.name()) : prefix + "." + std::string(f.name());
    if (prefix.empty() && f.name() != "camera" && f.name() != "lights" && f.name() != "environment" && f.name() != "shadows" && f.name() != "tone_map" &&
        f.name() != "integrator")
      continue;
    if (f.is_map()) visit(*f.message_type()->FindFieldByName("value")->message_type(), path + ".key.light", see);
    else if (f.message_type() && f.message_type()->full_name() != "gobo.v1.Vector3") visit(*f.message_type(), path + (f.is_repeated() ? "[0]" : ""), see);
    else see(path, f);
  }
}

TEST(Curves, MeanWhatWouldHaveBeenTypedIn) {
  int tried = 0;
  visit(*v1::RenderRequest::descriptor(), "", [&](const std::string& path, const FieldDescriptor& f) {
    const bool vector = f.message_type() != nullptr;
    if (!vector && (f.is_repeated() || f.cpp_type() == FieldDescriptor::CPPTYPE_STRING || f.cpp_type() == FieldDescriptor::CPPTYPE_BOOL ||
                    f.cpp_type() == FieldDescriptor::CPPTYPE_ENUM))
      return;
    const v1::Number range = f.options().GetExtension(v1::number);
    double lo = range.has_min() ? range.min() : -3.0, hi = range.has_max() ? std::min(range.max(), lo + 8.0) : 5.0;
    if (range.exclusive_min()) lo += (hi - lo) / 4;
    v1::RenderRequest base;
    base.set_time_s(0.25);
    // Choices on the way are made by the client.
    const size_t dot = path.rfind('.');
    if (path.find("shadow") != std::string::npos && path.find(".map.") == std::string::npos) {
      ASSERT_TRUE(setPath(base, path.substr(0, dot) + "=").ok()) << path;
    }
    v1::RenderRequest typed = base, curved = base;
    v1::Curve& c = (*curved.mutable_curves())[path];
    c.add_time_s(0);
    c.add_time_s(1);
    const double mid = lo + (hi - lo) / 4;
    std::string text;
    for (int k = 0; k < (vector ? 3 : 1); ++k) c.add_value(lo);
    for (int k = 0; k < (vector ? 3 : 1); ++k) c.add_value(hi);
    char number[64];
    const bool integer = !vector && f.cpp_type() != FieldDescriptor::CPPTYPE_DOUBLE && f.cpp_type() != FieldDescriptor::CPPTYPE_FLOAT;
    std::snprintf(number, sizeof number, "%.17g", integer ? std::round(mid) : mid);
    text = vector ? std::string(number) + "," + number + "," + number : number;
    ASSERT_TRUE(setPath(typed, path + "=" + text).ok()) << path;
    const Status s = applyCurves(curved);
    ASSERT_TRUE(s.ok()) << path << ": " << s.toString();
    EXPECT_EQ(messageToJson(curved, false), messageToJson(typed, false)) << path;
    EXPECT_TRUE(resolveDefaults(curved).ok()) << path;
    ++tried;
    // Out of its range at a time that is not asked for.
    if (!range.has_max()) return;
    v1::RenderRequest far = base;
    v1::Curve& wrong = (*far.mutable_curves())[path];
    wrong.add_time_s(0);
    wrong.add_time_s(100);
    wrong.add_value(lo);
    wrong.add_value(range.max() * 2 + 1);
    const Status refused = applyCurves(far);
    EXPECT_EQ(refused.code(), Code::InvalidArgument) << path;
    EXPECT_EQ(refused.location(), "request.curves." + path + ".value[1]");
  });
  EXPECT_GT(tried, 100);
}

TEST(Curves, WhatHasNoCurveIsRefusedByName) {
  const auto refused = [](const std::string& path, const v1::Curve& c, const std::string& location, const std::string& words, const char* edit = nullptr) {
    v1::RenderRequest r;
    if (edit) { ASSERT_TRUE(setPath(r, edit).ok()); }
    (*r.mutable_curves())[path] = c;
    const Status s = applyCurves(r);
    EXPECT_EQ(s.code(), Code::InvalidArgument) << path;
    EXPECT_EQ(s.location(), "request.curves." + path + location);
    EXPECT_NE(s.message().find(words), std::string::npos) << s.toString();
  };
  const v1::Curve fine = curve({0, 1}, {1, 2});
  for (const char* path :
       {"width", "seed", "halt.spp", "time_s", "scheduling.deadline_ms", "window.x", "curves", "certificate.spp", "encoding.jpeg_quality", "", "no"})
    refused(path, fine, "", "only numbers and vectors of camera");
  refused("lights.key.intensty", fine, "", "did you mean 'intensity'?");
  refused("lights.key", fine, "", "neither a number nor a vector");
  refused("lights.key.enabled", fine, "", "neither a number nor a vector");
  refused("lights.key.kind", fine, "", "neither a number nor a vector");
  refused("environment.path", fine, "", "neither a number nor a vector");
  refused("camera", fine, "", "neither a number nor a vector");
  refused("shadows.exponential", fine, "", "neither a number nor a vector");
  refused("shadows.exponential.c", fine, "", "'exponential' is not what the request chooses");
  refused("shadows.exponential.c", fine, "", "'exponential' is not what the request chooses", "shadows.variance=");
  refused("lights.key.shadow.exponential.c", fine, "", "'exponential' is not what the request chooses");
  const std::string intensity = "lights.key.intensity";
  refused(intensity, curve({}, {}), ".time_s", "0 keys");
  refused(intensity, curve({0, 1}, {1}), ".value", "1 numbers");
  refused("lights.key.color", fine, ".value", "must be 3 for each of 2 times");
  refused(intensity, curve({0, 0}, {1, 1}), ".time_s", "increase");
  refused(intensity, curve({1, 0}, {1, 1}), ".time_s", "[1] = 0.0");
  refused(intensity, curve({0, NAN}, {1, 1}), ".time_s", "finite");
  refused(intensity, curve({0, 1}, {1, INFINITY}), ".value[1]", "finite");
  refused(intensity, curve({0, 1}, {1, -1}), ".value[1]", "at least 0");
  refused("lights.key.position", curve({0}, {1, 1e39, 0}), ".value[0]", "finite");
  refused(intensity, curve({0}, {1}, v1::Curve::Interpolation(9)), ".interpolation", "LINEAR, STEP or SMOOTH");
  v1::Curve many;
  for (int k = 0; k < 4097; ++k) many.add_time_s(k), many.add_value(1);
  refused(intensity, many, ".time_s", "4097 keys");
  v1::RenderRequest crowd;
  for (int k = 0; k < 257; ++k) (*crowd.mutable_curves())["lights.l" + std::to_string(k) + ".intensity"] = fine;
  EXPECT_EQ(applyCurves(crowd).location(), "request.curves");
}

}  // namespace
}  // namespace gobo::curves_test
