// SPDX-License-Identifier: Apache-2.0
// Rays from a transfer point, distributed as the cosine about its normal: irradiance of radiance L is pi times the mean of L over them.
#pragma once

#include <algorithm>
#include <atomic>

#include "base/sobol.h"
#include "techniques/transfer/harmonics.h"
#include "terms/node.h"
#include "trace/accel.h"

namespace gobo::transfer {

class PointRays {
 public:
  /// `cell`: size of what is about the point; it leaves the surface by a thousandth of that. `reach`: of its instance (Accel::reach).
  PointRays(const Vec3& position, const Vec3& normal, float cell, const Vec3& reach, uint64_t seed)
      : frame_(normal), origin_(offsetOrigin(position + normal * (1e-3f * cell), normal, reach)), seed_(seed) {}
  Ray at(uint32_t index) const {
    const Vec2 u = SobolSampler(seed_, index).next2D();
    const float r = std::sqrt(u.x), a = 2.0f * kPi * u.y;
    Ray ray;
    ray.origin = origin_;
    ray.direction = glm::normalize(frame_.toWorld(Vec3(r * std::cos(a), r * std::sin(a), std::sqrt(maxOf(1.0f - u.x, 1e-8f)))));
    return ray;
  }
  /// From where those leave, in any (unit) direction.
  Ray along(const Vec3& direction) const {
    Ray ray;
    ray.origin = origin_;
    ray.direction = direction;
    return ray;
  }

 private:
  Frame frame_;
  Vec3 origin_;
  uint64_t seed_;
};

/// Term "transfer_points" (nodes.h), which must outlive this.
class RaysOfPoints {
 public:
  RaysOfPoints(const Term& points, const Accel& accel)
      : position_(points.floats("position")),
        normal_(points.floats("normal")),
        cell_(points.floats("cell")),
        instance_(points.plane<uint32_t>("instance")),
        accel_(accel) {}
  size_t size() const { return cell_.size(); }
  Vec3 normal(size_t i) const { return Vec3(normal_[3 * i], normal_[3 * i + 1], normal_[3 * i + 2]); }
  PointRays of(size_t i, uint64_t seed) const {
    return {Vec3(position_[3 * i], position_[3 * i + 1], position_[3 * i + 2]), normal(i), cell_[i], accel_.reach(instance_[i]), seed};
  }
  static void reads(Wiring& w, size_t input) {
    w.reads<float>(input, "position", {3}).reads<float>(input, "normal", {3}).reads<float>(input, "cell").reads<uint32_t>(input, "instance");
  }

 private:
  std::span<const float> position_, normal_, cell_;
  std::span<const uint32_t> instance_;
  const Accel& accel_;
};

/// Tells who watches how far a node that is `part` of `parts` equal ones has come with its points: the share of all parts, so that it goes on from one node to
/// the next. Some hundred times a node at most. Threads may call done().
class PointProgress {
 public:
  PointProgress(const RunContext& ctx, uint32_t points, uint32_t part, uint32_t parts)
      : report_(ctx.progress), points_(std::max(points, 1u)), step_(std::max(points / 128u, 1u)), part_(part), parts_(std::max(parts, part + 1)) {
    if (report_) report_(double(part_) / parts_);
  }
  void done(size_t points) const {
    if (!report_) return;
    const uint64_t before = done_.fetch_add(points), now = before + points;
    if (before / step_ != now / step_) report_((part_ + std::min(double(now) / points_, 1.0)) / parts_);
  }

 private:
  const std::function<void(double)>& report_;
  const uint32_t points_, step_, part_, parts_;
  mutable std::atomic<uint64_t> done_{0};
};

}  // namespace gobo::transfer
