// SPDX-License-Identifier: Apache-2.0
// Shadow maps: linear depth seen from a light, pre-filtered in a basis in which filtering commutes with the shadow test, read once
// per view sample. (T. Annen, "Efficient Shadow Map Filtering", 2008; docs/shadow_maps.md has the family, its parameters and errors.)
//
//   light_depth_map (source) -+-> shadow_encode (basis + Gaussian) -> [shadow_mipmap | shadow_summed_area] -> shadow_lookup -> V
//                             +-> depth_bounds (pyramid of smallest and largest z) -> percentage_closer, soft lookups, flags
//
// Every map term has domain LightTexel and Extent{texels, 1, faces}: faces are 1, or 6 for lights that shine all round. Texels are
// row-major; a chain of levels is packed one after the other (mipLevel()). Nodes before the lookup do not depend on the camera.
// Cost: resolution^2 rays per face; encode 4 bytes in, 4 C out per texel; a bilinear lookup reads 16 C bytes per view sample.
#pragma once

#include <memory>

#include "filters/shadow_map/light_frame.h"
#include "filters/shadow_map/shadow_basis.h"
#include "gobo/v1/filters.pb.h"
#include "terms/node.h"
#include "terms/view_place.h"

namespace gobo {
inline namespace device {
class ComputeDevice;
}
}  // namespace gobo

namespace gobo {
inline namespace filters {

/// v1::ShadowMapSettings with its defaults filled in.
struct ShadowMapSettings {
  int resolution = 1024, blur = 1, anisotropy = 16;
  bool cameraFit = false;
  float bias = 0.0005f, slopeBias = 1.0f;
  v1::ShadowMapSettings::Lookup lookup = v1::ShadowMapSettings::BILINEAR;
};
ShadowMapSettings shadowMapSettings(const v1::ShadowMapSettings& settings);

/// Where level l of a packed chain over a square of `resolution` texels begins, and its side: ceil(resolution / 2^l).
struct MipLevel {
  size_t offset = 0;
  int side = 0;
};
MipLevel mipLevel(int resolution, int level);
/// Levels down to one texel.
int mipLevels(int resolution);
inline size_t mipTexels(int resolution) { return mipLevel(resolution, mipLevels(resolution)).offset; }
inline Extent mipExtent(int resolution, int faces) { return {int(mipTexels(resolution)), 1, faces}; }

/// Source, term "light_depth_map": plane z f32 in [0,1], 1 where nothing is hit; closer than `near` reads 0. One ray through each
/// texel's centre, or the same by scan conversion (depth_raster.h): Automatic takes what is faster for the scene's triangles and the map's texels;
/// they differ by at most 1e-5 but for texels that a silhouette passes within 1e-4 texels of.
enum class DepthMethod { Automatic, Rays, Raster };
/// `clear`: surfaces that light passes straight on cast nothing (trace/solid_scene.h).
NodePtr makeLightDepthMapNode(const LightFrames& frames, int resolution, DepthMethod method = DepthMethod::Automatic, bool clear = false);

/// Filter, term "depth_bounds": plane bounds f32 (depth_bounds.h): the depth map and chains of the smallest and largest depth below a texel.
NodePtr makeDepthBoundsNode(int resolution, int faces);

/// Filter, term "shadow_basis": plane B, f32 or u8 (`bytes`), basis->channels() interleaved values a texel: the basis of z, filtered by a
/// separable Gaussian of radius `blur`, sigma (2 blur + 1) / 4; taps beyond the map repeat its rim. `device` null: cpu; only the linear exponential
/// basis has a device form.
NodePtr makeShadowEncodeNode(ShadowBasisPtr basis, int blur, int resolution, int faces, bool bytes, std::shared_ptr<ComputeDevice> device = nullptr);
/// Filter, term "shadow_basis": the same plane as a packed chain of levels; each halves by the box of what a texel covers.
NodePtr makeShadowMipmapNode(ShadowBasisPtr basis, int resolution, int faces, bool bytes);
/// Filter, term "shadow_summed_area" (summed_area.h); bounded bases only.
NodePtr makeShadowSummedAreaNode(ShadowBasisPtr basis, int resolution, int faces);

/// 2 radius + 1 Gaussian weights, sigma = (2 radius + 1) / 4, that sum to 1.
std::vector<float> shadowGaussian(int radius);

/// What lookups know of the view: the camera's place, for the footprint of a pixel on a surface.
struct ShadowView {
  Vec3 eye{0.0f};  ///< perspective: the camera's position; orthographic: the direction towards it
  bool perspective = true;
};
/// Input i is a "shadow_basis" of so many channels, as floats or bytes.
inline Wiring& readsBasis(Wiring& w, size_t i, int channels) {
  const PlaneShape* B = w.input(i).find("B");
  return w.reads(i, "B", B && B->format == Format::U8 ? Format::U8 : Format::F32, {channels});
}
/// What look-ups make: of the G-buffer's domain and extent, plane V.
inline TermShape visibilityOver(const TermShape& gbuffer, PlaneShape::Fill fill = PlaneShape::Fill::Zeroed) {
  return {"visibility", gbuffer.domain, gbuffer.extent, {{"V", Format::F32, 1, fill}}};
}

struct ShadowLookup {
  LightFrames frames;
  ShadowMapSettings map;
  ShadowView view;
  /// Exponential basis only: find kernels that reach behind the receiver and compare depths there.
  v1::ExponentialShadow::Classification classification = v1::ExponentialShadow::OFF;
  float epsilon = 0.05f;
  bool fallbackKernel = true;
};
/// Filter, term "visibility": domain and extent of the G-buffer, plane V f32 in [0,1]; 1 where the G-buffer has no surface or the map does
/// not reach; with a classification also plane flags f32, 1 where it found a violation. Inputs: "gbuffer", the map as the settings' lookup
/// wants it; with a classification also "depth_bounds".
NodePtr makeShadowLookupNode(ShadowBasisPtr basis, const ShadowLookup& lookup, std::shared_ptr<ComputeDevice> device = nullptr);

struct PercentageCloserLookup {
  LightFrames frames;
  ShadowMapSettings map;
  ShadowView view;
  v1::PercentageCloserShadow::Pattern pattern = v1::PercentageCloserShadow::REGULAR;
  int taps = 2;  ///< 1 without bilinear weights: the hard shadow map
  bool hard = false;
  bool skip = true;
  ViewPlace place;  ///< POISSON turns its disks by the pixel's place in the whole picture
};
/// Does it ask the pyramid of depth bounds, or do with the depth map?
bool readsDepthBounds(const PercentageCloserLookup& lookup);
/// Filter, term "visibility", plane V as above. Inputs: "gbuffer"; "depth_bounds" or, unless it readsDepthBounds, "light_depth_map".
NodePtr makePercentageCloserNode(const PercentageCloserLookup& lookup);

/// Filter, term "pixels", plane image f32: every image of a "shadow_basis" (as 1/2 + B / 2) or face of a "light_depth_map" in a mosaic, for
/// people to look at.
NodePtr makeBasisMosaicNode(int resolution, int channels, int faces);

}  // namespace filters
}  // namespace gobo
