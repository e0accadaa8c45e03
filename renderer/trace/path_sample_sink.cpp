// SPDX-License-Identifier: Apache-2.0
#include "trace/path_sample_sink.h"

namespace gobo {
inline namespace trace {

void PathSampleSink::clear() {
  samples_.clear();
  vertices_.clear();
  contributions_.clear();
  lost_ = 0;
}

void PathSampleSink::start(uint64_t sample, int count) {
  count_ = count;
  chunk_ = contributions_.size();
  for (int i = 0; i < count; ++i) {
    lanes_[i].sample = {};
    lanes_[i].sample.sample = sample + uint64_t(i);
    lanes_[i].vertices.clear();
    lanes_[i].pdf = 0;
    chunkLost_[i] = 0;
  }
}

void PathSampleSink::vertex(int lane, const PathVertex& v) {
  Lane& l = lanes_[lane];
  if (l.vertices.size() < size_t(limits_.vertices)) l.vertices.push_back({v, l.pdf, false});
  else ++l.sample.cut;
}

void PathSampleSink::scatter(int lane, const PathScatter& s) {
  Lane& l = lanes_[lane];
  if (!s.passed) l.pdf = s.pdf;
  else if (l.sample.cut == 0) l.vertices.back().passed = true;
}

void PathSampleSink::contribute(int lane, const PathContribution& c) {
  if (contributions_.size() >= limits_.contributions) {
    ++chunkLost_[lane];
    return;
  }
  contributions_.push_back({c, uint32_t(lane), uint32_t(lanes_[lane].vertices.size())});
}

void PathSampleSink::finish(uint32_t dropped) {
  uint32_t index[kLanes];
  for (int i = 0; i < count_; ++i) {
    index[i] = uint32_t(samples_.size());
    if (dropped >> i & 1u) continue;
    Lane& l = lanes_[i];
    l.sample.firstVertex = uint32_t(vertices_.size());
    l.sample.vertices = uint32_t(l.vertices.size());
    vertices_.insert(vertices_.end(), l.vertices.begin(), l.vertices.end());
    samples_.push_back(l.sample);
    lost_ += chunkLost_[i];
  }
  size_t kept = chunk_;
  for (size_t k = chunk_; k < contributions_.size(); ++k) {
    Contribution c = contributions_[k];
    if (dropped >> c.sample & 1u) continue;
    c.sample = index[c.sample];
    contributions_[kept++] = c;
  }
  contributions_.resize(kept);
}

}  // namespace trace
}  // namespace gobo
