// SPDX-License-Identifier: Apache-2.0
// The reference: a unidirectional path tracer with next-event estimation and MIS for every light kind (power heuristic,
// Veach 1997), light selection by tree, and Russian roulette that keeps a path with chance sqrt(throughput) (by throughput itself it
// costs 13 to 19 % noise a sample in rooms, half of that this way, for 1 to 11 % more rays). Which light it reaches through what:
// trace/reach.h. Not joined: a delta light through a specular chain (caustics of Point, Spot and hard Directional lights through mirrors or smooth
// refraction); such paths are no part of any class that it reports.
// Rect, Disk and Sphere lights are transparent: rays pass through them and collect what they emit, shadow rays ignore them.
// Light goes straight on through clear panes and boundaries of index 1 (trace/straight.h): shadow rays bring what is left of it, and
// for a path such a pass is no vertex and no event, but at the camera's first surface, where classes and G-buffer begin.
// Volumes: absorption and scattering inside closed meshes (trace/interior.h, trace/path_media.h); boundaries that bend light block
// shadow rays. Dispersion: the first dispersive boundary keeps one channel, three times as strong.
// Unlit surfaces (KHR_materials_unlit) show their base colour to the camera and through chains of delta events, to nothing
// else: they are no lights, and paths end there. Since no light owns them they are traced where `unlit` asks for them.
// Samples come in blocks, consecutive pieces of one Owen-scrambled Sobol (or Halton: `sampler`) sequence per pixel, so that the error goes on falling
// faster than with independent blocks; blocks of different streams (block / kBlocksPerStream) are independent. A block's result
// depends only on (settings, pixel, block), never on thread, tile or what was traced before.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/sampler_kind.h"
#include "scene/camera.h"
#include "trace/accel.h"
#include "trace/light_sampling.h"
#include "trace/light_selector.h"
#include "trace/path_class.h"

namespace gobo {
inline namespace trace {

enum class SplitMode : uint8_t {
  Combined,            ///< 1 slot a group
  DirectIndirect,      ///< emission, direct, indirect
  ByLobe,              ///< emission, direct diffuse, direct specular, indirect diffuse, indirect specular (lobe of the first event)
  ByLobeAndCurvature,  ///< as ByLobe, then indirect diffuse and specular light times the squared ratio of a pixel's width to the way it comes
                       ///< (curvature_sums.h)
  ByBounce,            ///< emission, then by number of scattering events 1 .. maxBounces + 1
};

/// Blocks b and b + kBlocksPerStream belong to independent sequences: halves that estimate an error take one stream each.
inline constexpr uint32_t kBlocksPerStream = 1u << 16;

struct PathTracerSettings {
  Camera camera;
  int width = 0, height = 0;
  int viewSamples = 0;  ///< 0: box pixel filter; S >= 1: sample i of the pixel (over all blocks) uses view sample i mod S (trace/view_samples.h); with Halton
                        ///< points S in a row, from a multiple of S on, use each once
  int maxBounces = 8;   ///< scattering events after the first
  int rouletteStart = 3;
  int blockSize = 16;  ///< samples a block, 1 .. 4096; results are best for powers of two
  uint64_t seed = 0;
  bool behindOnly = false;  ///< of direct light only what passes through the first surface: what techniques that see its front leave out
  bool unlit = false;       ///< unlit surfaces are shown, in group 0; else they are black
  PathClass cover = PathClass::All;
  SplitMode split = SplitMode::Combined;
  LightSelection selection = LightSelection::Tree;
  SamplerKind sampler = SamplerKind::Sobol;
  // Relight groups. Index k runs over the view's light subset (SceneView::lightSubset()).
  int groups = 1;
  std::vector<int> groupOf;         ///< group of light k
  std::vector<Vec3> nominal;        ///< radiometric scale that light k is traced with: white * nominalScalar when alone in
                                    ///< its group, its own power otherwise; sampling importance is its luminance
  void hash(Hasher& hasher) const;  ///< every field
};

/// Facets that the tracer reads, for the node that owns it.
inline constexpr Facet kPathTracerFacets =
    Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage | Facet::Albedo | Facet::Bsdf | Facet::Emission | Facet::LightShape | Facet::Environment;

int slotsPerGroup(SplitMode split, int maxBounces);
/// The first event's lobes are told apart.
inline bool splitsLobes(SplitMode split) { return split == SplitMode::ByLobe || split == SplitMode::ByLobeAndCurvature; }
/// Of ByLobeAndCurvature: the first of the two slots of a group that are no light.
inline constexpr int kCurvatureSlot = 5;

/// Neighbouring pixels of which a few samples each are traced together, row by row, so that the kernel's 16 lanes are full.
struct PixelGroup {
  int width = 1, height = 1;
  int pixels() const { return width * height; }
};
/// Consecutive samples of one of a pixel's independent sequences.
struct SampleRun {
  uint32_t stream = 0, first = 0, count = 1;  ///< count: 1, 2, 4, 8 or 16
};
inline PixelGroup pixelGroup(uint32_t samples) {
  switch (samples) {
    case 1: return {4, 4};
    case 2: return {4, 2};
    case 4: return {2, 2};
    case 8: return {2, 1};
    default: return {};
  }
}

class PathTracer {
 public:
  /// Null if `stop` fired first. O(vertices + texels of the environment): lights are weighed, their distributions made.
  static std::shared_ptr<const PathTracer> create(const SceneView& view, AccelPtr accel, const PathTracerSettings& settings, const StopToken& stop = {});
  ~PathTracer();
  /// groups * slotsPerGroup; slot = group * slotsPerGroup + split.
  int slots() const;
  /// Adds the SUM over the block's samples of pixel (x, y) to out[slot*3 + channel]. Adds the rays traced to `rays`.
  /// The slots of curvature are filled by traceGroup alone.
  /// Never adds a non-finite value: such samples count as zero and are counted in `dropped`.
  void traceBlock(int x, int y, uint32_t block, double* out, uint64_t& rays, uint64_t& dropped) const;
  /// The same of a run of samples for the pixels of a group (pixelGroup(run.count)), whose first one is (x, y), in both a multiple of its size; some may lie
  /// beyond the picture. Adds to out[i] where it is not null; `dropped` by pixel.
  void traceGroup(int x, int y, const SampleRun& run, std::span<double* const> out, uint64_t& rays, std::span<uint64_t> dropped) const;
  /// The same block's paths into a sink (trace/path_sink.h), chunk by chunk; traceBlock is this with sums. Compiled where
  /// trace/path_stages.h is included.
  template <class Sink>
  void traceInto(int x, int y, uint32_t block, Sink& sink, uint64_t& rays, uint64_t& dropped) const;
  struct Impl;
  const Impl& impl() const { return *impl_; }

 private:
  PathTracer();
  std::unique_ptr<Impl> impl_;
};

}  // namespace trace
}  // namespace gobo
