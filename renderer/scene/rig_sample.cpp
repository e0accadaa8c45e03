// SPDX-License-Identifier: Apache-2.0
#include "scene/rig_sample.h"

#include <algorithm>

namespace gobo {
inline namespace scene {
namespace {

void normalise4(double* q) {
  const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (!(length > 1e-12)) {
    q[0] = q[1] = q[2] = 0.0;
    q[3] = 1.0;
    return;
  }
  for (int c = 0; c < 4; ++c) q[c] /= length;
}

/// The shorter way round; nearly equal ends by the chord, where the sine has lost its digits.
void slerp(const float* a, const float* b, double t, double* out) {
  double p[4], q[4], d = 0;
  for (int c = 0; c < 4; ++c) {
    p[c] = a[c];
    q[c] = b[c];
  }
  normalise4(p);
  normalise4(q);
  for (int c = 0; c < 4; ++c) d += p[c] * q[c];
  const double sign = d < 0 ? -1.0 : 1.0;
  d = std::fabs(d);
  double u = 1.0 - t, v = t;
  if (d < 1.0 - 1e-9) {
    const double angle = std::acos(d), s = std::sin(angle);
    u = std::sin((1.0 - t) * angle) / s;
    v = std::sin(t * angle) / s;
  }
  for (int c = 0; c < 4; ++c) out[c] = u * p[c] + sign * v * q[c];
  normalise4(out);
}

}  // namespace

void sampleAt(const RigSampler& s, double time, size_t width, bool rotation, double* out) {
  const bool cubic = s.interpolation == RigInterpolation::CubicSpline;
  const size_t stride = width * (cubic ? 3 : 1), middle = cubic ? width : 0, keys = s.times.size();
  const float* values = std::as_const(s.values).data();
  const auto hold = [&](size_t key) {
    for (size_t c = 0; c < width; ++c) out[c] = values[key * stride + middle + c];
    if (rotation) normalise4(out);
  };
  const size_t next = size_t(std::upper_bound(s.times.begin(), s.times.end(), time, [](double t, float key) { return t < double(key); }) - s.times.begin());
  if (next == 0) return hold(0);
  if (next == keys) return hold(keys - 1);
  const size_t k = next - 1;
  if (s.interpolation == RigInterpolation::Step) return hold(k);
  const double span = double(s.times[next]) - double(s.times[k]), t = (time - double(s.times[k])) / span;
  const float* a = values + k * stride;
  const float* b = values + next * stride;
  if (!cubic) {
    if (rotation) return slerp(a, b, t, out);
    for (size_t c = 0; c < width; ++c) out[c] = a[c] + t * (double(b[c]) - a[c]);
    return;
  }
  const double t2 = t * t, t3 = t2 * t;
  for (size_t c = 0; c < width; ++c)
    out[c] = (2 * t3 - 3 * t2 + 1) * a[width + c] + span * (t3 - 2 * t2 + t) * a[2 * width + c] + (3 * t2 - 2 * t3) * b[width + c] + span * (t3 - t2) * b[c];
  if (rotation) normalise4(out);
}

RigPose evaluatePose(const Rig& rig, const std::vector<const RigAnimation*>& chosen, double time) {
  struct Trs {
    glm::dvec3 t, s;
    double q[4];
  };
  std::vector<Trs> local(rig.nodes.size());
  for (size_t i = 0; i < local.size(); ++i) {
    const RigNode& n = rig.nodes[i];
    local[i] = {n.translation, glm::dvec3(n.scale), {n.rotation.x, n.rotation.y, n.rotation.z, n.rotation.w}};
    normalise4(local[i].q);
  }
  RigPose pose;
  pose.weights.resize(rig.deformed.size());
  for (size_t i = 0; i < rig.deformed.size(); ++i) pose.weights[i].assign(rig.deformed[i].weights.begin(), rig.deformed[i].weights.end());
  std::vector<std::vector<size_t>> morphed(chosen.empty() ? 0 : rig.nodes.size());  // entries of `deformed` by node
  for (size_t i = 0; i < rig.deformed.size() && !morphed.empty(); ++i)
    if (!pose.weights[i].empty()) morphed[rig.deformed[i].node].push_back(i);
  for (const RigAnimation* a : chosen)
    for (const RigChannel& c : a->channels) {
      const RigSampler& s = a->samplers[c.sampler];
      Trs& node = local[c.node];
      if (c.path == RigPath::Translation) sampleAt(s, time, 3, false, &node.t.x);
      else if (c.path == RigPath::Scale) sampleAt(s, time, 3, false, &node.s.x);
      else if (c.path == RigPath::Rotation) sampleAt(s, time, 4, true, node.q);
      else
        for (const size_t i : morphed[c.node]) sampleAt(s, time, pose.weights[i].size(), false, pose.weights[i].data());
    }
  pose.world.resize(rig.nodes.size());
  pose.turn.resize(rig.nodes.size());
  pose.facing.resize(rig.nodes.size());
  for (size_t i = 0; i < local.size(); ++i) {
    const RigNode& n = rig.nodes[i];
    glm::dmat4 m = n.matrix;
    glm::dquat turn(1, 0, 0, 0);
    if (Mat4 frame; n.fixed && rigidFrame(Mat4(m), frame)) turn = glm::quat_cast(glm::dmat3(Mat3(frame)));
    if (!n.fixed) {
      turn = glm::dquat(local[i].q[3], local[i].q[0], local[i].q[1], local[i].q[2]);
      m = glm::mat4_cast(turn);
      for (int c = 0; c < 3; ++c) m[c] *= local[i].s[c];
      m[3] = glm::dvec4(local[i].t, 1.0);
    }
    if (n.parent < 0) m[3] -= glm::dvec4(rig.origin, 0.0);
    pose.world[i] = n.parent < 0 ? m : pose.world[n.parent] * m;
    pose.turn[i] = n.parent < 0 ? turn : pose.turn[n.parent] * turn;
    // A parent that mirrors turns it round, and what rotations alone say does not.
    const glm::dvec3 z = turn * glm::dvec3(0, 0, 1), there = n.parent < 0 ? z : glm::dmat3(pose.world[n.parent]) * z;
    pose.facing[i] = glm::dot(there, there) > 0.0 ? there : pose.turn[i] * glm::dvec3(0, 0, 1);
  }
  return pose;
}

}  // namespace scene
}  // namespace gobo
