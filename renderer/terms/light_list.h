// SPDX-License-Identifier: Apache-2.0
// LightList: the unshadowed light of many lights at one point, light by light, in one pass over arrays of them with one look at the material. What
// terms/unoccluded_light.h gives for each, by cheaper ways where these are as good:
//   points, spots, directions      the same to rounding (those with an emission profile: that code itself)
//   balls, suns                    over Lambert surfaces as a point, which is exact where all of it is above the horizon; over gloss by the rules below
//   disks, rectangles              by these rules; over Lambert surfaces nearby by their closed forms where all of it is above the horizon
//   mesh lights                    of up to 32 triangles that shine evenly: the sum of their triangles, by the same ways as rectangles, where 2048 points do
//   rectangles at infinity         the diffuse lobe under their centre, as they are defined (direct_unoccluded.h); gloss by these rules up to 64 points
//   the rest of them               terms/unoccluded_light.h with `samples` samples: other mesh lights, what is far larger than the lobe, materials that
//                                  trace/bsdf_look.h does not cover
// The rules go by X = sin^2 a (sharpness + 1 / cos^2 + 4): a the half angle that the light is seen under (patches: half diagonal by distance, and 1 / cos^2 of
// their own cosine added), sharpness that of the lobe at its centre (bsdf_look.h), cos that of its centre. To second order the relative error of the mean
// over a light by its centre is the lobe's curvature over it, for GGX no more than (24 + 4) / 8 of (a / 2 c s)^2, that is 0.9 X; with what else varies 1.5 X.
//   kOne    X <= 0.001   one direction, to the centre
//   kSeven  X <= 0.03    7 points of a disk, exact to the fifth degree (Stroud 1971, S2 5-1); rectangles and triangles: 16 of Gauss and Legendre
//   kMany   X <= 0.3     24: 3 of Gauss and Legendre in the squared radius by 8 angles; rectangles and triangles: the 16
// Beyond, over gloss, by Y: the same with the lobe at its sharpest anywhere within the light. Triangles and rectangles at infinity go by Y throughout.
//   kDense  Y <= 10, 60, 600   64, 256, 1024 points (4, 8, 16 radii by 16, 32, 64 angles; squares of 8, 16, 32)
//   kCut    Y <= 300 without 1 / cos^2: what the horizon cuts or touches, by 256 points (Y <= 10) and 1024; a patch that is nearer than its half diagonal or
//           seen on edge, and light that folds at a tilted triangle's plane (bsdf.h) or is cut by it, by 1024
// Error of each lobe of each light, and so of their sum (all are >= 0), where no samples are drawn: 0.2 % at most up to kMany, 1 % by kDense (0.01 % measured
// over random materials; of 32 samples 6 % RMS); where something is cut 0.5 % RMS (0.11 %; 9 %), more for a sliver above a horizon.
// Immutable; any thread. Cost: 2 ns a light over Lambert, 6 over gloss, 60 and 150 for lights of some size that take 7 and 24 points.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "terms/light_rules.h"
#include "terms/unoccluded_light.h"
#include "trace/bsdf_look.h"

namespace gobo {
inline namespace terms {

struct SceneLight {
  int light = 0;  ///< index into the scene's lights
  Vec3 power{1.0f};
};

class LightList {
 public:
  /// The sampler's subset holds the lights, and it must outlive this.
  LightList(const SceneView& view, const LightSampler& sampler, std::span<const SceneLight> lights, int samples, uint64_t seed);

  /// Places in Values; some are nobody's.
  size_t places() const { return index_.size(); }
  /// Index into `lights` of the constructor; -1: nobody's, its values are 0.
  int light(size_t place) const { return index_[place]; }

  /// Radiance by place and channel. Buffers are used again from point to point.
  struct Values {
    std::vector<float> diffuse[3], specular[3];
    bool glossy = false;  ///< false: `specular` is not written, all of it is 0
  };
  /// `element`: of the whole picture's view samples; decides random numbers where there are any.
  void at(const LitPoint& point, size_t element, Values& out) const;
  /// The same of the only light. `values`: the caller's, to be used again.
  BsdfValue only(const LitPoint& point, size_t element, Values& values) const;
  /// Whether there is anything cheaper for such a light, and more than rounding between it and terms/unoccluded_light.h.
  static bool hasRules(const LightShape& shape);

  /// The `most` lights that give most (luminance of both lobes), and the light of all others in sum. Buffers are used again.
  struct Choice {
    struct Chosen {
      int light;
      size_t place;
    };
    std::vector<Chosen> chosen;  ///< ascending by light
    DVec3 rest[2] = {DVec3(0.0), DVec3(0.0)};
    std::vector<uint64_t> order, positive;  ///< its own
  };
  /// Of equal ones the first; none that gives nothing, or no number (without end: before all others). Nested: of more lights it begins with the same.
  /// O(lights): 6 ns each.
  void choose(const Values& values, size_t most, Choice& out) const;

  /// How lights of some size were found, for tests and benches: all of at() but the values.
  struct Ways {
    size_t one = 0, seven = 0, many = 0, dense = 0, closed = 0, sampled = 0;
  };
  Ways ways(const LitPoint& point, size_t element) const;

  static constexpr float kOne = 1e-3f, kSeven = 0.03f, kMany = 0.3f;
  static constexpr double kDense[3] = {10, 60, 600}, kCut = 300;
  static constexpr RuleSize kMostOfSquares = RuleSize::Points64;  ///< of rectangles at infinity, which have fewer samples
  static constexpr size_t kMostPoints = 2048;                     ///< of a mesh light, all triangles together: beyond, `samples` take less time

 private:
  enum Kind { Points, Directions, Caps, Patches, Squares, Meshes, Others, Kinds };
  static Kind kindOf(const LightShape& shape);
  struct Point;
  struct SeenSize;
  struct WeightedLobes;
  void block(const Point& at, Kind kind, size_t begin, size_t count, Values& out, Ways& ways) const;
  RuleSize sizeOf(const Point& at, const SeenSize& seen, const Vec3& towards) const;
  void give(const Point& at, size_t place, const WeightedLobes& sum, Values& out) const;
  void square(const Point& at, size_t place, Values& out, Ways& ways) const;
  void mesh(const Point& at, size_t place, Values& out, Ways& ways) const;
  void larger(const Point& at, Kind kind, size_t place, float x, Values& out, Ways& ways) const;
  void sampled(const Point& at, size_t place, Values& out) const;
  void run(const LitPoint& point, size_t element, Values& out, Ways& ways) const;

  size_t begin_[Kinds + 1] = {};  ///< places of each kind, multiples of 8
  std::vector<int> index_;
  std::vector<UnoccludedLight> whole_;  ///< by index
  std::vector<LightShape> shapes_;      ///< by index
  std::vector<Vec3> edges_[2];          ///< by index: of squares at infinity, half edges on the tangent plane
  std::vector<float> power_[3];
  std::vector<float> at_[3];               ///< position, or direction towards it
  std::vector<float> axis_[3];             ///< Spots, patches
  std::vector<float> cut_, ramp_, range_;  ///< Spots: cosine of the outer cone, 1 / width of its ramp; 1 / squared range, 0: none
  std::vector<float> size2_;               ///< Caps: squared radius, of suns squared sine; patches: squared half diagonal
  std::vector<float> scale_;               ///< Caps, patches: radiance, of patches times area
  std::vector<float> far_;                 ///< 1: at infinity
};

}  // namespace terms
}  // namespace gobo
