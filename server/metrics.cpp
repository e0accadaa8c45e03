// SPDX-License-Identifier: Apache-2.0
#include "server/metrics.h"

#include <cmath>
#include <cstdio>

#include "base/check.h"

namespace gobo {
inline namespace server {
namespace {

std::string number(double v) {
  if (std::isnan(v)) return "NaN";
  if (std::isinf(v)) return v > 0 ? "+Inf" : "-Inf";
  char text[40];
  if (v == std::floor(v) && std::fabs(v) < 9e15) std::snprintf(text, sizeof text, "%.0f", v);
  else std::snprintf(text, sizeof text, "%.9g", v);
  return text;
}

std::string quoted(const std::string& value) {
  std::string out = "\"";
  for (const char c : value) {
    if (c == '\n') out += "\\n";
    else if (c == '"' || c == '\\') (out += '\\') += c;
    else out += c;
  }
  return out + "\"";
}

}  // namespace

void MetricsWriter::family(const std::string& name, const char* type, const std::string& help) {
  out_ += "# HELP " + name + " " + help + "\n# TYPE " + name + " " + type + "\n";
}

void MetricsWriter::sample(const std::string& name, const MetricLabels& labels, double value) {
  out_ += name;
  for (size_t i = 0; i < labels.size(); ++i) out_ += (i ? "," : "{") + labels[i].first + "=" + quoted(labels[i].second);
  out_ += (labels.empty() ? " " : "} ") + number(value) + "\n";
}

void Metrics::counter(const std::string& name, const std::string& help) {
  const std::lock_guard lock(mutex_);
  families_[name].help = help;
}

void Metrics::histogram(const std::string& name, const std::string& help, std::vector<double> bounds) {
  const std::lock_guard lock(mutex_);
  Family& f = families_[name];
  f.help = help;
  f.isHistogram = true;
  f.bounds = std::move(bounds);
}

void Metrics::collect(std::function<void(MetricsWriter&)> collector) {
  const std::lock_guard lock(collectorsMutex_);
  collectors_.push_back(std::move(collector));
}

void Metrics::add(const std::string& name, const MetricLabels& labels, double value) {
  const std::lock_guard lock(mutex_);
  const auto family = families_.find(name);
  GOBO_CHECK(family != families_.end() && !family->second.isHistogram);
  family->second.series[labels].value += value;
}

void Metrics::observe(const std::string& name, const MetricLabels& labels, double value) {
  const std::lock_guard lock(mutex_);
  const auto family = families_.find(name);
  GOBO_CHECK(family != families_.end() && family->second.isHistogram);
  Series& s = family->second.series[labels];
  const std::vector<double>& bounds = family->second.bounds;
  s.buckets.resize(bounds.size());
  for (size_t i = 0; i < bounds.size(); ++i) s.buckets[i] += value <= bounds[i];
  s.value += 1;
  s.sum += value;
}

double Metrics::value(const std::string& name, const MetricLabels& labels) const {
  const std::lock_guard lock(mutex_);
  const auto family = families_.find(name);
  if (family == families_.end()) return 0;
  const auto series = family->second.series.find(labels);
  return series == family->second.series.end() ? 0 : series->second.value;
}

std::string Metrics::text() const {
  std::string out;
  MetricsWriter writer(out);
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [name, f] : families_) {
      writer.family(name, f.isHistogram ? "histogram" : "counter", f.help);
      if (!f.isHistogram && f.series.empty()) continue;
      for (const auto& [labels, s] : f.series) {
        if (!f.isHistogram) {
          writer.sample(name, labels, s.value);
          continue;
        }
        MetricLabels with = labels;
        with.emplace_back("le", "");
        for (size_t i = 0; i < f.bounds.size(); ++i) {
          with.back().second = number(f.bounds[i]);
          writer.sample(name + "_bucket", with, s.buckets[i]);
        }
        with.back().second = "+Inf";
        writer.sample(name + "_bucket", with, s.value);
        writer.sample(name + "_sum", labels, s.sum);
        writer.sample(name + "_count", labels, s.value);
      }
    }
  }
  const std::lock_guard lock(collectorsMutex_);
  for (const auto& collector : collectors_) collector(writer);
  return out;
}

}  // namespace server
}  // namespace gobo
