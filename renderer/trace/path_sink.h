// SPDX-License-Identifier: Apache-2.0
// A sink takes what the path kernel finds: it is a template parameter of the kernel, so that its calls are inlined and what it does
// not ask for is not computed. The kernel carries a chunk of up to 16 samples of one pixel (for sums: of a few pixels) together, a lane each; their events
// come interleaved, those of one lane in the order of its path:
//   start(sample, count)      a chunk: lane i < count is sample `sample` + i of its pixel, counted over all blocks of a stream
//   film(lane, position)      where the camera ray goes through the film, in pixels                                  (kVertices)
//   vertex(lane, v)           the path's ray ended here                                                              (kVertices)
//   scatter(lane, s)          the path goes on from its last vertex; a path that ends there has no such event         (kVertices)
//   contribute(lane, c)       light reached the camera by this path, as far as it has come
//   finish(dropped)           the chunk is done. Samples in `dropped`, a bit per lane, had a non-finite part: nothing of them counts,
//                             also what they contributed before. The kernel never hands over a non-finite value
// A sink lives on one thread. Events depend on (settings, pixel, block) alone: any number of threads, any sink, the same ones.
// What is a vertex: every surface that the path's rays end at, every scattering event inside a volume, and the way out of the scene. Lights
// without a mesh (rect, disk, sphere) are passed: light is collected from them between two vertices. Where a path goes straight on
// without an event of its own (clear panes, boundaries of index 1) the vertex's `scatter` says `passed`.
#pragma once

#include <concepts>
#include <cstdint>

#include "base/vec.h"
#include "trace/path_class.h"
#include "trace/path_tracer.h"

namespace gobo {
inline namespace trace {

enum class VertexKind : uint8_t { Surface, Volume, Escape };

struct PathVertex {
  VertexKind kind = VertexKind::Surface;
  int event = 1;        ///< the scattering event that happens here if one does; a volume's walk belongs to the event that entered it
  Vec3 position{0.0f};  ///< world; Escape: the direction of the ray that left the scene
  Vec3 normal{0.0f};    ///< shading normal on the viewer's side, or the triangle's where the path ends; 0 for Volume and Escape
};

struct PathScatter {
  Vec3 direction{0.0f};
  Vec3 weight{1.0f};        ///< f |cos| / pdf of the direction, without roulette; 1 in volumes, whose albedo and absorption are the way's
  Vec3 specularPart{0.0f};  ///< share of the weight by specular lobes; known at the first event only
  float pdf = 0;            ///< solid-angle density of `direction`; 0 for delta events and where it passed
  bool delta = false;
  bool passed = false;  ///< straight on, no event of its own
};

struct PathContribution {
  int slot = 0;    ///< first slot of the light's group
  int events = 0;  ///< scattering events of the path that the light came along
  PathClass pathClass = PathClass::None;
  Vec3 value{0.0f};     ///< radiance, weighted: the mean over samples of their sums is the picture
  Vec3 specular{0.0f};  ///< part of `value` by the first event's specular lobe. Zero unless kLobes or the split asks for it
};

template <class S>
concept PathSink = requires(S& sink, uint64_t sample, int lane, uint32_t dropped, const PathContribution& c) {
  { S::kVertices } -> std::convertible_to<bool>;  // asks for film, vertex and scatter
  { S::kLobes } -> std::convertible_to<bool>;     // asks for `specular` whatever the split
  sink.start(sample, lane);
  sink.contribute(lane, c);
  sink.finish(dropped);
}
&&(!S::kVertices || requires(S & sink, int lane, const Vec2& film, const PathVertex& v, const PathScatter& s) {
  sink.film(lane, film);
  sink.vertex(lane, v);
  sink.scatter(lane, s);
});

/// Where a contribution goes in a picture of that split: to(slot, value), twice for direct and indirect light by lobe.
template <class To>
inline void forEachSlot(SplitMode split, const PathContribution& c, To&& to) {
  switch (split) {
    case SplitMode::Combined: to(c.slot, c.value); return;
    case SplitMode::DirectIndirect: to(c.slot + (c.pathClass == PathClass::Emission ? 0 : c.pathClass == PathClass::Direct ? 1 : 2), c.value); return;
    case SplitMode::ByBounce: to(c.slot + c.events, c.value); return;
    case SplitMode::ByLobe:
    case SplitMode::ByLobeAndCurvature:
      if (c.pathClass == PathClass::Emission) {
        to(c.slot, c.value);
        return;
      }
      const int base = c.slot + (c.pathClass == PathClass::Direct ? 1 : 3);
      to(base, c.value - c.specular);
      to(base + 1, c.specular);
      return;
  }
}

}  // namespace trace
}  // namespace gobo
