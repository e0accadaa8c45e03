// SPDX-License-Identifier: Apache-2.0
// Camera G-buffer: what each view sample sees first, after alpha coverage. Term type "gbuffer", domain ViewSample.
// Planes: P f32x3 world position | N f32x3 unit shading normal towards the viewer (before normal maps) | Ng f32x3 unit geometric normal
// towards the viewer | uv f32x2 (set 0) | depth f32 distance along the ray, +inf where nothing is hit | instance u32,
// ~0u where nothing is hit | primitive u32 | bary f32x2 | footprint f32 world width of a pixel at P (2 t tan(fovy/2)/H).
// View sample s of S sits at viewSamplePosition(s, S) inside its pixel: the same for every pixel.
// Rays go in packets of the film's 4x4 tiles, whatever part of it the view is (trace/film_runs.h).
// Instances whose BSDF is delta at the hit are still stored; "direct" terms are zero there (the path-traced remainder has them).
#pragma once

#include "scene/camera.h"
#include "terms/node.h"
#include "terms/view_place.h"
#include "trace/view_samples.h"

namespace gobo {
inline namespace terms {

/// What of it is made: all planes; or depth, instance and primitive, with P or without, for pictures of nothing but distances and ids: a sixth to a third
/// of the memory, which takes longer to get than rays take to trace.
enum class GBufferPart : uint8_t { Hits, HitsAndPositions, All };

struct GBufferSettings {
  Camera camera;
  int width = 0, height = 0, viewSamples = 1;
  ViewPlace place;
  GBufferPart part = GBufferPart::All;
  Extent extent() const { return {width, height, viewSamples}; }
  int filmWidth() const { return place.whole() ? width : place.filmWidth; }
  int filmHeight() const { return place.whole() ? height : place.filmHeight; }
};
void hashCamera(Hasher& hasher, const Camera& camera);
/// Camera, size and view samples. Sources that draw numbers by the place on the film add `view.place`; it is part of what the others read.
void hashView(Hasher& hasher, const GBufferSettings& view);

NodePtr makeGBufferNode(const GBufferSettings& settings);

}  // namespace terms
}  // namespace gobo
