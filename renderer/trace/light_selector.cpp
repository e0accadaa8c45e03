// SPDX-License-Identifier: Apache-2.0
#include "trace/light_selector.h"

#include <algorithm>
#include <cmath>

#include "scene/environment_tents.h"
#include "trace/emission_profile.h"

namespace gobo {
inline namespace trace {

namespace {

// Mean luminance of an emission texture over at most 64 x 64 texels; area lights with dark maps then get fewer samples.
float meanLuminance(const Texture* texture) {
  if (!texture || texture->width <= 0 || texture->height <= 0) return 1.0f;
  double sum = 0;
  const int nx = std::min(64, texture->width), ny = std::min(64, texture->height);
  for (int y = 0; y < ny; ++y)
    for (int x = 0; x < nx; ++x) sum += luminance(Vec3(texture->sample(Vec2((x + 0.5f) / nx, (y + 0.5f) / ny))));
  return float(std::max(sum / (double(nx) * ny), 1e-4));  // never 0: a bright spot may hide between the texels looked at
}

LightBounds meshBounds(const SceneView& view, const LightShape& shape, float radiance, const StopToken& stop) {
  LightBounds b;
  const Instance& instance = view.instances()[shape.instance];
  const auto mesh = view.mesh<Facet::Topology | Facet::Pose>(instance.mesh);
  const bool mirrored = glm::determinant(Mat3(instance.toWorld)) < 0.0f;
  double area = 0;
  DVec3 mean(0.0);
  std::vector<Vec3> normals;
  normals.reserve(mesh.triangles());
  for (size_t t = 0; t < mesh.triangles(); ++t) {
    if (t % 4096 == 0 && stop.stopRequested()) return b;
    Vec3 v[3];
    for (int c = 0; c < 3; ++c) {
      v[c] = Vec3(instance.toWorld * Vec4(mesh.positions[mesh.indices[3 * t + c]], 1.0f));
      b.lo = glm::min(b.lo, v[c]);
      b.hi = glm::max(b.hi, v[c]);
    }
    const DVec3 n = glm::cross(DVec3(v[1] - v[0]), DVec3(v[2] - v[0])) * (mirrored ? -0.5 : 0.5);
    const double length = glm::length(n);
    if (!(length > 0)) continue;
    area += length;
    mean += n;
    normals.push_back(Vec3(n / length));
  }
  const double length = glm::length(mean);
  b.cosNormals = -1.0f;
  if (length > 1e-6 * area) {
    b.axis = Vec3(mean / length);
    b.cosNormals = 1.0f;
    for (const Vec3& n : normals) b.cosNormals = std::fmin(b.cosNormals, glm::dot(n, b.axis));
    b.cosNormals = std::fmax(-1.0f, b.cosNormals - 1e-5f);
  }
  b.cosEmission = 0.0f;
  b.twoSided = view.coverage(mesh.material).doubleSided;
  const TextureRef& ref = view.emission(mesh.material).texture;
  const float texture = meanLuminance(ref.valid() ? view.textures()[ref.texture].get() : nullptr);
  b.power = float(area) * kPi * radiance * texture * (b.twoSided ? 2.0f : 1.0f);
  return b;
}

LightBounds finiteBounds(const SceneView& view, int light, float scale, const StopToken& stop) {
  const LightShape& s = view.lightShape(light);
  LightBounds b;
  b.lo = b.hi = s.position;
  b.axis = s.axis;
  switch (s.kind) {
    case LightKind::Point:
      b.cosNormals = -1.0f;
      b.cosEmission = 0.0f;
      b.power = 4 * kPi * scale;
      break;
    case LightKind::Spot:
      b.cosNormals = 1.0f;
      b.cosEmission = s.cosOuter;
      b.power = 2 * kPi * (1 - 0.5f * (s.cosInner + s.cosOuter)) * scale;
      b.power = std::fmax(b.power, 1e-6f * scale);
      break;
    case LightKind::Rect: {
      const Vec3 e = glm::abs(s.u) + glm::abs(s.v);
      b.lo -= e;
      b.hi += e;
      b.cosEmission = 0.0f;
      b.twoSided = s.twoSided;
      b.power = 4 * glm::length(glm::cross(s.u, s.v)) * kPi * scale * (s.twoSided ? 2.0f : 1.0f);
      break;
    }
    case LightKind::Disk: {
      const Vec3 e = s.radius * glm::sqrt(glm::max(Vec3(0.0f), Vec3(1.0f) - s.axis * s.axis));
      b.lo -= e;
      b.hi += e;
      b.cosEmission = 0.0f;
      b.twoSided = s.twoSided;
      b.power = kPi * sqr(s.radius) * kPi * scale * (s.twoSided ? 2.0f : 1.0f);
      break;
    }
    case LightKind::Sphere:
      b.lo -= Vec3(s.radius);
      b.hi += Vec3(s.radius);
      b.cosNormals = -1.0f;
      b.cosEmission = 0.0f;
      b.power = 4 * kPi * sqr(s.radius) * kPi * scale;
      break;
    case LightKind::Mesh: return meshBounds(view, s, scale, stop);
    case LightKind::Directional:
    case LightKind::Environment: break;
  }
  if (const LightProfilePtr profile = view.lightProfile(light)) b.power = std::fmax(float(profileFlux(s, *profile)), 1e-6f) * scale;
  return b;
}

// Radius of the sphere around the scene's instances: what an infinite light's irradiance is multiplied with to give watts.
float sceneRadius(const SceneView& view, const StopToken& stop) {
  Vec3 lo(3e38f), hi(-3e38f);
  for (const Instance& i : view.instances()) {
    size_t polled = 0;
    for (const Vec3& p : view.mesh<Facet::Pose>(i.mesh).positions) {
      if (polled++ % 16384 == 0 && stop.stopRequested()) return 1.0f;
      const Vec3 q(i.toWorld * Vec4(p, 1.0f));
      lo = glm::min(lo, q);
      hi = glm::max(hi, q);
    }
  }
  return lo.x <= hi.x ? std::fmax(0.5f * glm::length(hi - lo), 1e-20f) : 1.0f;
}

}  // namespace

void LightSelector::build(const SceneView& view, const std::vector<Vec3>& nominal, LightSelection selection, const StopToken& stop) {
  const std::vector<int>& subset = view.lightSubset();
  const int n = int(subset.size());
  treeIndex_.assign(n, -1);
  tableProbability_.assign(n, 0.0f);
  std::vector<double> weight(n, 0.0);  // of the table
  std::vector<LightBounds> bounds;
  double finitePower = 0, infinitePower = 0;
  float radius = -1.0f;
  for (int k = 0; k < n; ++k) {
    const float scale = luminance(nominal[k]);
    if (!(scale > 0.0f)) continue;
    ++count_;
    only_ = k;
    const LightKind kind = view.lightShape(subset[k]).kind;
    if (kind == LightKind::Directional || kind == LightKind::Environment) {
      if (radius < 0.0f) radius = sceneRadius(view, stop);
      const double irradiance =
          kind == LightKind::Directional ? scale : scale * environmentFlux(view.environment().get(), stop) / 4.0;  // of an environment: mean radiance times pi
      weight[k] = std::max(irradiance * M_PI * radius * radius, 1e-30);
      infinitePower += weight[k];
    } else {
      const LightBounds b = finiteBounds(view, subset[k], scale, stop);
      const double power = std::max(double(b.power), 1e-30);
      if (selection == LightSelection::Tree) {
        treeIndex_[k] = int(bounds.size());
        finite_.push_back(k);
        bounds.push_back(b);
        bounds.back().power = float(power);
      } else {
        weight[k] = power;
      }
      finitePower += power;
    }
    if (selection == LightSelection::Uniform) weight[k] = 1.0;
    if (stop.stopRequested()) return;
  }
  if (count_ != 1) only_ = -1;
  if (count_ <= 1) return;
  if (!bounds.empty()) {
    tree_.build(bounds, stop);
    if (stop.stopRequested()) return;
    // Watts decide between near and far, within limits: a lamp may matter although the sun is stronger elsewhere.
    treeShare_ = infinitePower > 0 ? float(std::clamp(finitePower / (finitePower + infinitePower), 0.2, 0.8)) : 1.0f;
  }
  double total = 0;
  for (double w : weight) total += w;
  if (!(total > 0)) return;
  std::vector<int> members;
  for (int k = 0; k < n; ++k)
    if (weight[k] > 0) members.push_back(k);
  const size_t m = members.size();
  table_.resize(m);
  std::vector<double> scaled(m);
  std::vector<size_t> small, large;
  for (size_t i = 0; i < m; ++i) {
    scaled[i] = weight[members[i]] / total * double(m);
    tableProbability_[members[i]] = float(weight[members[i]] / total * (1.0 - treeShare_));
    table_[i].k = members[i];
    (scaled[i] < 1.0 ? small : large).push_back(i);
  }
  while (!small.empty() && !large.empty()) {
    const size_t s = small.back(), l = large.back();
    small.pop_back();
    table_[s].keep = float(scaled[s]);
    table_[s].alias = members[l];
    scaled[l] -= 1.0 - scaled[s];
    if (scaled[l] < 1.0) {
      large.pop_back();
      small.push_back(l);
    }
  }
}

int LightSelector::sampleMany(const Vec3& p, const Vec3* n, float u, float& probability) const {
  if (u < treeShare_) {
    const int i = tree_.sample(p, n, u / treeShare_, probability);
    probability *= treeShare_;
    return i < 0 ? -1 : finite_[i];
  }
  if (table_.empty()) return -1;
  const float scaled = std::fmin((u - treeShare_) / (1.0f - treeShare_), 0x1.fffffep-1f) * float(table_.size());
  const size_t slot = std::min(size_t(scaled), table_.size() - 1);
  const Entry& e = table_[slot];
  const int k = scaled - float(slot) < e.keep ? e.k : e.alias;
  probability = tableProbability_[k];
  return k;
}

float LightSelector::probabilityMany(const Vec3& p, const Vec3* n, int k) const {
  if (treeIndex_[k] >= 0) return treeShare_ * tree_.probability(p, n, treeIndex_[k]);
  return tableProbability_[k];
}

}  // namespace trace
}  // namespace gobo
