// SPDX-License-Identifier: Apache-2.0
// What both kinds of subtractive samples have in common (samples.h: of a map; light_samples.h: of a scene's lights): which samples are traced, and the sums.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "techniques/subtractive/receiver.h"
#include "terms/light_points.h"

namespace gobo::subtractive {

/// A sample that is traced, with the material that it is traced for.
struct TracedSample {
  size_t element = 0;
  LitPoint point;
  LobeAlbedos by;
};

/// What arrives at one. Its buffers are used again from sample to sample.
struct Arrivals {
  enum class Way : uint8_t { Ray, Open, Closed };  ///< to be traced; seen or hidden without a ray
  struct Light {
    Vec3 lobe[2];  ///< diffuse and specular radiance by Receivers::divisors
    LightPoint point;
    Way way = Way::Ray;
  };
  std::vector<Light> lights;
  /// The same of lights without a ray, in sum: they are seen as much as the others on the mean, by luminance.
  DVec3 rest[2] = {DVec3(0.0), DVec3(0.0)};
  void clear() { lights.clear(), rest[0] = rest[1] = DVec3(0.0); }
};

/// Of one sample, diffuse and specular: sums over the lights, of squares of their luminances, and of those that are seen.
struct SampleSums {
  DVec3 unshadowed[2] = {DVec3(0.0), DVec3(0.0)}, visible[2] = {DVec3(0.0), DVec3(0.0)};
  double squares[2] = {0, 0}, seen[2] = {0, 0};
};
/// One light more, of which `seen` of 0 .. 1 is: a shadow need not be hard.
void addLight(SampleSums& sums, const Vec3 (&lobes)[2], double seen);
/// `seen`: 1 for those of arrivals.lights that are. The rest is seen as a lobe's others are, or as the other lobe's where it has none, or else all of it;
/// squares are those of the others, made to hold the light of all.
SampleSums sumsOf(const Arrivals& arrivals, std::span<const char> seen);

/// The planes of such a term (samples.h).
struct SamplePlanes {
  explicit SamplePlanes(Term& term)
      : unshadowed(term.writable<float>("unshadowed")),
        visible(term.writable<float>("visible")),
        moments(term.writable<float>("moments")),
        traced(term.writable<uint8_t>("traced")) {}
  static std::vector<PlaneShape> shapes() {
    return {plane<float>("unshadowed", 6), plane<float>("visible", 6), plane<float>("moments", 4), plane<uint8_t>("traced")};
  }
  std::span<float> unshadowed, visible, moments;
  std::span<uint8_t> traced;
};
/// Of a sample that is traced.
void writeSums(const SampleSums& sums, const SamplePlanes& out, size_t e);

/// Whether a sample that is lit is traced: it is on the grid, or nothing there speaks for it.
bool speaksForItself(const Resampling& r, const Receivers& in, size_t e);
TracedSample sampleAt(const Receivers& in, size_t e);

/// Radiance by what the lobe reflects; 0 where that is nothing, no more than what sums of it can hold.
Vec3 byAlbedo(const Vec3& light, const Vec3& albedo);

class SamplesNode : public Node {
 public:
  SamplesNode(const GBufferSettings& view, const Resampling& resampling) : view_(view), resampling_(resampling) {}
  NodeTraits traits() const override;
  void hashParameters(Hasher& h) const override;
  Result<TermShape> infer(std::span<const TermShape> in) const override;
  Cost cost(const TermShape& result, uint32_t blocks) const override;
  Result<TermPtr> run(const RunContext& ctx) const final;

 protected:
  /// Any thread.
  class Lights {
   public:
    virtual ~Lights() = default;
    /// Adds to `out`, which is clear.
    virtual void at(const TracedSample& sample, Arrivals& out) const = 0;
  };
  /// Null if ctx.stop fired first.
  virtual std::unique_ptr<const Lights> lights(const RunContext& ctx) const = 0;
  virtual size_t looked() const = 0;  ///< lights that are looked at for each traced sample
  virtual size_t rays() const = 0;    ///< of these, with a ray
  const GBufferSettings& view() const { return view_; }

 private:
  GBufferSettings view_;
  Resampling resampling_;
};

}  // namespace gobo::subtractive
