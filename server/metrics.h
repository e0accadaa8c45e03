// SPDX-License-Identifier: Apache-2.0
// Metrics in Prometheus's text format (exposition format 0.0.4), written by hand: prometheus-cpp's exposer would be a second
// HTTP server beside the one that /health needs. Counters and histograms are kept here; gauges are asked for when somebody
// reads, by collectors that parts of the server register. Thread-safe. Cost: one mutex and one map look-up per event, a few
// events per call. Labels must come from bounded sets (methods, codes, classes, names in the configuration), never from clients.
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace gobo {
inline namespace server {

using MetricLabels = std::vector<std::pair<std::string, std::string>>;

/// What a collector writes into: family(), then its samples.
class MetricsWriter {
 public:
  explicit MetricsWriter(std::string& out) : out_(out) {}
  /// `type`: counter, gauge, histogram.
  void family(const std::string& name, const char* type, const std::string& help);
  void sample(const std::string& name, const MetricLabels& labels, double value);

 private:
  std::string& out_;
};

class Metrics {
 public:
  /// Names are declared once, before use (an unknown one fails a CHECK). `bounds` ascend; +Inf is added.
  void counter(const std::string& name, const std::string& help);
  void histogram(const std::string& name, const std::string& help, std::vector<double> bounds);
  /// Called at each read, in the order of registration; it must not call into this object.
  void collect(std::function<void(MetricsWriter&)> collector);

  void add(const std::string& name, const MetricLabels& labels = {}, double value = 1);
  void observe(const std::string& name, const MetricLabels& labels, double value);
  /// Of a counter, or the number of observations of a histogram; 0 before the first event.
  double value(const std::string& name, const MetricLabels& labels = {}) const;
  std::string text() const;

 private:
  struct Series {
    double value = 0, sum = 0;
    std::vector<double> buckets;
  };
  struct Family {
    std::string help;
    bool isHistogram = false;
    std::vector<double> bounds;
    std::map<MetricLabels, Series> series;
  };
  mutable std::mutex mutex_;
  std::map<std::string, Family> families_;
  mutable std::mutex collectorsMutex_;
  std::vector<std::function<void(MetricsWriter&)>> collectors_;
};

}  // namespace server
}  // namespace gobo
