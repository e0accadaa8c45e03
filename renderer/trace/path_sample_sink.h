// SPDX-License-Identifier: Apache-2.0
// The sink of whole paths, for filters that judge samples by where they went (path-density outlier rejection, DeCoro, Weyrich & Rusinkiewicz 2010) and for
// tests: every contribution of every sample, with the vertices and densities of its path.
// Memory: 40 bytes a vertex, 44 a contribution, 32 a sample; at most what the limits say. A path keeps its first `vertices` vertices.
// Past `contributions` nothing is taken: lost() counts what was not, and its sums are not the picture.
#pragma once

#include <span>
#include <vector>

#include "trace/path_sink.h"
#include "trace/sample_set.h"

namespace gobo {
inline namespace trace {

class PathSampleSink {
 public:
  struct Limits {
    int vertices = 64;                       ///< a path
    size_t contributions = size_t(1) << 20;  ///< until clear()
  };
  struct Vertex {
    PathVertex at;
    float pdf = 0;        ///< solid-angle density of the direction that led here; 0 from the camera, from delta events
    bool passed = false;  ///< the path went straight on here, as if there were no vertex
  };
  struct Contribution : PathContribution {
    uint32_t sample = 0;    ///< index into samples()
    uint32_t vertices = 0;  ///< of the path's vertices, those before the light: from the last of them it was asked for, or its ray found it
  };
  struct Sample {
    uint64_t sample = 0;  ///< of its pixel and stream
    Vec2 film{0.0f};      ///< pixels
    uint32_t firstVertex = 0, vertices = 0;
    uint32_t cut = 0;  ///< vertices beyond the limit
  };

  static constexpr bool kVertices = true, kLobes = true;
  PathSampleSink() = default;
  explicit PathSampleSink(const Limits& limits) : limits_(limits) {}

  /// In order of tracing; dropped ones are left out.
  const std::vector<Sample>& samples() const { return samples_; }
  std::span<const Vertex> verticesOf(const Sample& s) const { return std::span(vertices_).subspan(s.firstVertex, s.vertices); }
  /// In order of arrival: those of a chunk's samples (16) come interleaved.
  const std::vector<Contribution>& contributions() const { return contributions_; }
  uint64_t lost() const { return lost_; }
  void clear();

  void start(uint64_t sample, int count);
  void film(int lane, const Vec2& position) { lanes_[lane].sample.film = position; }
  void vertex(int lane, const PathVertex& v);
  void scatter(int lane, const PathScatter& s);
  void contribute(int lane, const PathContribution& c);
  void finish(uint32_t dropped);

 private:
  struct Lane {
    Sample sample;
    std::vector<Vertex> vertices;
    float pdf = 0;  // of the ray that it follows
  };
  Limits limits_;
  Lane lanes_[kLanes];
  int count_ = 0;
  size_t chunk_ = 0;  // the chunk's first contribution: until finish() `sample` is the lane
  uint64_t chunkLost_[kLanes] = {};
  uint64_t lost_ = 0;
  std::vector<Sample> samples_;
  std::vector<Vertex> vertices_;
  std::vector<Contribution> contributions_;
};

}  // namespace trace
}  // namespace gobo
