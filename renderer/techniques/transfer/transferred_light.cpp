// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <memory>
#include <vector>

#include "base/check.h"
#include "filters/diffuse_albedo.h"
#include "techniques/transfer/harmonics.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/receiver_mesh.h"
#include "terms/surface.h"
#include "terms/surface_reader.h"
#include "trace/bsdf.h"

namespace gobo::transfer {

namespace {

class TransferredLightNode final : public Node {
 public:
  TransferredLightNode(const TransferSettings& s, float rotation, const Vec3& scale, bool bounced)
      : s_(s), rotation_(rotation), scale_(scale), bounced_(bounced) {}
  std::string type() const override { return "transferred_light"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(s_.bands).add(rotation_).addPod(scale_).add(bounced_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, bounced_ ? 3 : 2);
    w.over(0, {1, 1, 1}).reads<float>(0, "radiance", {3 * s_.harmonics()}).reads<float>(0, "rest", {3 * s_.harmonics()});
    w.over(1, s_.extent()).reads<float>(1, "transfer", {s_.harmonics()});
    if (bounced_) w.over(2, s_.extent()).reads<float>(2, "sum", {3 * s_.harmonics()});
    return w.gives({type(), Domain::List, s_.extent(), {plane<float>("direct", 3), plane<float>("bounced", 3)}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const size_t n = size_t(s_.harmonics());
    const std::vector<float> rest = inWorld(ctx.inputs[0]->floats("rest")), whole = inWorld(ctx.inputs[0]->floats("radiance"));
    const auto transfer = ctx.inputs[1]->floats("transfer");
    const std::span<const float> bounces = bounced_ ? ctx.inputs[2]->floats("sum") : std::span<const float>();
    const auto direct = ctx.result->writable<float>("direct"), bounced = ctx.result->writable<float>("bounced");
    const bool complete = ctx.arena->parallelFor(
        s_.size, 1024,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i)
            for (size_t c = 0; c < 3; ++c) {
              direct[3 * i + c] = maxOf(dot(transfer.data() + i * n, rest.data() + c * n, n), 0.0f);
              if (bounced_) bounced[3 * i + c] = maxOf(dot(bounces.data() + (3 * i + c) * n, whole.data() + c * n, n), 0.0f);
            }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  /// Of each channel, for nominal power.
  std::vector<float> inWorld(std::span<const float> map) const {
    const size_t n = size_t(s_.harmonics());
    std::vector<double> world(3 * n);
    turn(map, s_.bands, 3, double(rotation_), world);
    std::vector<float> out(3 * n);
    for (size_t h = 0; h < n; ++h)
      for (size_t c = 0; c < 3; ++c) out[c * n + h] = float(world[3 * h + c] * double(scale_[int(c)]));
    return out;
  }
  static float dot(const float* a, const float* b, size_t n) {
    float lane[8] = {};
    size_t i = 0;
    for (; i + 8 <= n; i += 8)
      for (size_t k = 0; k < 8; ++k) lane[k] += a[i + k] * b[i + k];
    float sum = ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]));
    for (; i < n; ++i) sum += a[i] * b[i];
    return sum;
  }
  TransferSettings s_;
  float rotation_;
  Vec3 scale_;
  bool bounced_;
};

class TransferPlacesNode final : public Node {
 public:
  TransferPlacesNode(const TransferSettings& s, const GBufferSettings& view) : s_(s), view_(view.extent()) {}
  std::string type() const override { return "transfer_places"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = ReceiverMesh::kFacets;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(s_.points).add(view_.width).add(view_.height).add(view_.layers); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, view_).reads<uint32_t>(0, "instance").reads<uint32_t>(0, "primitive").reads<float>(0, "bary", {2}).reads<float>(0, "P", {3});
    w.reads<float>(0, "Ng", {3}).over(1, s_.extent()).reads<uint8_t>(1, "usable").reads<float>(1, "normal", {3});
    return w.gives({type(), Domain::ViewSample, view_, {unsetPlane<uint32_t>("point", kCorners), unsetPlane<float>("weight", kCorners)}});
  }
  size_t workingBytes() const override { return size_t(s_.size) * 16; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto shared = receiverMesh(*ctx.scene, s_.points);
    const ReceiverMesh& mesh = *shared;
    GOBO_CHECK_EQ(mesh.size(), size_t(s_.size));
    const Term& g = *ctx.inputs[0];
    const auto instance = g.plane<uint32_t>("instance"), primitive = g.plane<uint32_t>("primitive");
    const auto bary = g.floats("bary"), Ng = g.floats("Ng"), normal = ctx.inputs[1]->floats("normal");
    const auto usable = ctx.inputs[1]->plane<uint8_t>("usable");
    const auto point = ctx.result->writable<uint32_t>("point");
    const auto weight = ctx.result->writable<float>("weight");
    const bool complete = ctx.arena->parallelFor(
        instance.size(), 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            Between at;
            bool found = false;
            if (instance[i] != ~0u) {
              // Ng is turned to the viewer: the front's points lie on the side that it looks at, or the back's do.
              found = mesh.locate(instance[i], primitive[i], bary[2 * i], bary[2 * i + 1], true, at);
              const size_t first = at.point[0];
              const float side = Ng[3 * i] * normal[3 * first] + Ng[3 * i + 1] * normal[3 * first + 1] + Ng[3 * i + 2] * normal[3 * first + 2];
              if (side < 0.0f) found = mesh.locate(instance[i], primitive[i], bary[2 * i], bary[2 * i + 1], false, at);
              if (found) leaveUnusable(usable, at);
            }
            for (size_t k = 0; k < kCorners; ++k) {
              point[kCorners * i + k] = found ? at.point[k] : 0u;
              weight[kCorners * i + k] = found ? at.weight[k] : 0.0f;
            }
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  TransferSettings s_;
  Extent view_;
};

class TransferredSurfaceNode final : public Node {
 public:
  TransferredSurfaceNode(const TransferSettings& s, const GBufferSettings& view, std::string part, bool extended)
      : s_(s), view_(view.extent()), camera_(view.camera), part_(std::move(part)), extended_(extended) {}
  std::string type() const override { return "transferred_surface"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.tileable = true;  // points are a list, which is whole
    if (extended_) t.facets = kSurfaceFacets;
    return t;
  }
  int version() const override { return 2; }  // 2: dimmed by the specular lobe above
  void hashParameters(Hasher& h) const override {
    hashCamera(h, camera_);
    h.add(view_.width).add(view_.height).add(view_.layers).add(part_);
    if (extended_) h.add(extended_);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 4);
    w.over(0, view_).reads<uint32_t>(0, "instance").reads<float>(0, "P", {3});
    if (extended_) SurfaceReader::reads(w, 0);
    w.over(1, view_).reads<float>(1, "N", {3}).reads<float>(1, "albedo", {3}).reads<float>(1, "material", {5}).reads<uint8_t>(1, "flags");
    w.over(2, view_).reads<uint32_t>(2, "point", {kCorners}).reads<float>(2, "weight", {kCorners});
    w.over(3, s_.extent()).reads<float>(3, part_, {3});
    return w.gives({"direct_light", Domain::Pixel, {view_.width, view_.height, 1}, {plane<float>("rgb", 3)}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto instance = ctx.inputs[0]->plane<uint32_t>("instance");
    const auto P = ctx.inputs[0]->floats("P"), N = ctx.inputs[1]->floats("N"), albedo = ctx.inputs[1]->floats("albedo"),
               material = ctx.inputs[1]->floats("material");
    const Vec3 eye(camera_.toWorld[3]), back(camera_.toWorld[2]);
    const auto flags = ctx.inputs[1]->plane<uint8_t>("flags");
    const auto point = ctx.inputs[2]->plane<uint32_t>("point");
    const auto weight = ctx.inputs[2]->floats("weight"), light = ctx.inputs[3]->floats(part_);
    const auto rgb = ctx.result->writable<float>("rgb");
    const size_t pixels = size_t(view_.width) * size_t(view_.height);
    const float scale = kInvPi / float(view_.layers);
    std::unique_ptr<const SurfaceReader> reader;
    if (extended_) {
      GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
      reader = std::make_unique<const SurfaceReader>(*ctx.scene, accel, *ctx.inputs[0], camera_);
    }
    const bool complete = ctx.arena->parallelFor(
        pixels, albedoGrain(1 << 13, extended_, view_.layers),
        [&](size_t begin, size_t end) {
          for (size_t s = 0; s < size_t(view_.layers); ++s)
            for (size_t p = begin; p < end; ++p) {
              const size_t i = s * pixels + p;
              if (instance[i] == ~0u || (flags[i] & kSurfaceUnlit)) continue;
              const Vec3 out = camera_.perspective ? glm::normalize(eye - Vec3(P[3 * i], P[3 * i + 1], P[3 * i + 2])) : back;
              Vec3 colour(albedo[3 * i], albedo[3 * i + 1], albedo[3 * i + 2]);
              float reflecting = (1.0f - material[5 * i]) * (1.0f - material[5 * i + 4]) * scale;
              if (flags[i] & kSurfaceExtended) {
                GOBO_CHECK(reader != nullptr);
                colour = diffuseAlbedo(*reader, i);
                reflecting = scale;
              } else if (material[5 * i + 2] > 0.0f && reflecting > 0.0f) {
                BsdfParams b;
                b.albedo = Vec3(1.0f);
                b.roughness = material[5 * i + 1];
                b.specular = material[5 * i + 2];
                b.ior = material[5 * i + 3];
                reflecting *= bsdfLobeAlbedos(b, clamp01(N[3 * i] * out.x + N[3 * i + 1] * out.y + N[3 * i + 2] * out.z)).diffuse.x;
              }
              for (size_t c = 0; c < 3; ++c) {
                float e = 0;
                for (size_t k = 0; k < kCorners; ++k) e += weight[kCorners * i + k] * light[3 * size_t(point[kCorners * i + k]) + c];
                rgb[3 * p + c] += colour[int(c)] * reflecting * e;
              }
            }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  TransferSettings s_;
  Extent view_;
  Camera camera_;
  std::string part_;
  bool extended_;
};

}  // namespace

NodePtr makeTransferredLightNode(const TransferSettings& settings, float rotation, const Vec3& scale, bool bounced) {
  return std::make_shared<TransferredLightNode>(settings, rotation, scale, bounced);
}
NodePtr makeTransferPlacesNode(const TransferSettings& settings, const GBufferSettings& view) { return std::make_shared<TransferPlacesNode>(settings, view); }
NodePtr makeTransferredSurfaceNode(const TransferSettings& settings, const GBufferSettings& view, const char* part, bool extended) {
  return std::make_shared<TransferredSurfaceNode>(settings, view, part, extended);
}

}  // namespace gobo::transfer
