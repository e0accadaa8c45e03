// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/gloss_levels.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "techniques/transfer/nodes.h"
#include "terms/environment_cells.h"

namespace gobo::transfer {

namespace {

constexpr double kPiD = std::numbers::pi;

size_t cellOf(const DVec3& d) {
  constexpr int n = EnvironmentCells::kSide;
  const int face = EnvironmentCells::faceOf(d);
  double u = 0, v = 0;
  EnvironmentCells::project(face, d, u, v);
  const auto index = [](double t) { return size_t(std::clamp(int((t + 1) * 0.5 * n), 0, n - 1)); };
  return (size_t(face) * n + index(v)) * n + index(u);
}

/// Directions of texels' middles and their solid angles.
struct Grid {
  int width, height;
  std::vector<float> sine, cosine, solidAngle, azimuthCos, azimuthSin;  // of rows; of columns
  Grid(int w, int h) : width(w), height(h) {
    for (int y = 0; y < h; ++y) {
      const double theta = (y + 0.5) * kPiD / h;
      sine.push_back(float(std::sin(theta)));
      cosine.push_back(float(std::cos(theta)));
      solidAngle.push_back(float(4 * kPiD / w * std::sin(theta) * std::sin(0.5 * kPiD / h)));
    }
    for (int x = 0; x < w; ++x) {
      const double phi = (x + 0.5) * 2 * kPiD / w - kPiD;
      azimuthCos.push_back(float(std::cos(phi)));
      azimuthSin.push_back(float(std::sin(phi)));
    }
  }
};

/// What a row or column of the level has of one of the map's.
struct TexelPart {
  int texel;
  double part;          // of the texel
  double sine, cosine;  // of the angle in the middle of the part
};

/// By overlap: each of `from` texels counts once, whatever the ratio. `angle`: of a place in [0,1].
template <class Angle>
std::vector<std::vector<TexelPart>> texelParts(int from, int to, const Angle& angle) {
  std::vector<std::vector<TexelPart>> out(static_cast<size_t>(to));
  for (int x = 0; x < to; ++x) {
    const int64_t begin = int64_t(x) * from, end = begin + from;  // in shares of a texel, of which each has `to`: exact
    for (int64_t texel = begin / to; texel * to < end; ++texel) {
      const int64_t low = std::max(begin, texel * to), high = std::min(end, (texel + 1) * to);
      const double middle = angle(double(low + high) / (2.0 * from * to));
      out[size_t(x)].push_back({int(texel), double(high - low) / to, std::sin(middle), std::cos(middle)});
    }
  }
  return out;
}

class GlossLevelsNode final : public Node {
 public:
  explicit GlossLevelsNode(EnvironmentPtr map) : map_(std::move(map)) {}
  std::string type() const override { return "gloss_levels"; }
  int version() const override { return 2; }  // 2: maps of any size whole
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(map_->content); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, {1, 1, 1}).reads<float>(0, "left", {6 * EnvironmentCells::kSide * EnvironmentCells::kSide});
    TermShape out{type(), Domain::Table, {1, 1, 1}, {}};
    for (const GlossLevel& level : kGlossLevels) out.planes.push_back(unsetPlane<float>(level.plane, 3 * level.width * level.height));
    return w.gives(out);
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto left = ctx.inputs[0]->floats("left");
    const auto sharp = ctx.result->writable<float>(kGlossLevels[0].plane);
    bool complete = sharpLevel(*map_, left, *ctx.arena, ctx.stop, sharp);
    for (size_t k = 1; complete && k < kGlossLevels.size(); ++k)
      complete = glossLevel(k, sharp, *ctx.arena, ctx.stop, ctx.result->writable<float>(kGlossLevels[k].plane));
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  EnvironmentPtr map_;
};

}  // namespace

bool sharpLevel(const Environment& map, std::span<const float> left, const TaskArena& arena, const StopToken& stop, std::span<float> out) {
  const int width = kGlossLevels[0].width, height = kGlossLevels[0].height;
  // Texels of a finer map go into those that they lie in, by their parts; a coarser one is looked up.
  const bool finer = map.width > width || map.height > height;
  using Parts = std::vector<std::vector<TexelPart>>;
  const Parts rows = finer ? texelParts(map.height, height, [](double v) { return v * kPiD; }) : Parts();
  const Parts columns = finer ? texelParts(map.width, width, [](double u) { return (u - 0.5) * 2 * kPiD; }) : Parts();
  Environment own;  // in its own axes
  own.width = map.width;
  own.height = map.height;
  own.texels = map.texels;
  own.file = map.file;
  return arena.parallelFor(
      size_t(height), 8,
      [&](size_t begin, size_t end) {
        for (size_t y = begin; y < end; ++y)
          for (size_t x = 0; x < size_t(width); ++x) {
            DVec3 sum(0.0);
            double weight = 0;
            const auto add = [&](double w, const DVec3& d, const Vec3& radiance) {
              if (isFinite(radiance)) sum += w * double(left[cellOf(d)]) * DVec3(radiance);
              weight += w;
            };
            if (finer) {
              for (const TexelPart& row : rows[y]) {
                const Vec3* texels = map.texels.data() + size_t(row.texel) * size_t(map.width);
                for (const TexelPart& column : columns[x])
                  add(row.sine * row.part * column.part, DVec3(row.sine * column.cosine, row.cosine, row.sine * column.sine), texels[column.texel]);
              }
            } else {
              const double theta = (double(y) + 0.5) / height * kPiD, phi = ((double(x) + 0.5) / width - 0.5) * 2 * kPiD, s = std::sin(theta);
              const DVec3 d(s * std::cos(phi), std::cos(theta), s * std::sin(phi));
              add(s, d, own.eval(Vec3(d)));
            }
            for (int c = 0; c < 3; ++c) out[3 * (y * size_t(width) + x) + size_t(c)] = float(sum[c] / weight);
          }
      },
      stop);
}

bool glossLevel(size_t k, std::span<const float> sharp, const TaskArena& arena, const StopToken& stop, std::span<float> out) {
  const GlossLevel& level = kGlossLevels[k];
  const Grid to(level.width, level.height), from(level.sourceWidth, level.sourceWidth / 2);
  // The source: means of level 0 by solid angle, a plane a channel.
  const int many = kGlossLevels[0].width / level.sourceWidth;
  const Grid fine(kGlossLevels[0].width, kGlossLevels[0].height);
  const size_t n = size_t(from.width) * size_t(from.height);
  std::vector<float> source(3 * n);
  for (int y = 0; y < from.height; ++y)
    for (int x = 0; x < from.width; ++x) {
      double sum[3] = {}, weight = 0;
      for (int j = 0; j < many; ++j)
        for (int i = 0; i < many; ++i) {
          const double w = fine.solidAngle[size_t(y * many + j)];
          weight += w;
          for (size_t c = 0; c < 3; ++c) sum[c] += w * double(sharp[3 * (size_t(y * many + j) * size_t(fine.width) + size_t(x * many + i)) + c]);
        }
      for (size_t c = 0; c < 3; ++c) source[c * n + size_t(y * from.width + x)] = float(sum[c] / weight);
    }
  const float alpha = level.roughness * level.roughness, a2 = alpha * alpha;
  // GGX: beyond 5 alpha from the half vector lie 4 % of the microfacets (of rough lobes the hemisphere is the end).
  const double cone = std::min(2 * std::atan(5.0 * double(alpha)), 0.5 * kPiD);
  const float least = maxOf(float(std::cos(cone)), 0.0f);
  return arena.parallelFor(
      size_t(to.height), 1,
      [&](size_t begin, size_t end) {
        std::vector<float> weights(size_t(from.width));
        for (size_t y = begin; y < end; ++y) {
          const double theta = (double(y) + 0.5) * kPiD / to.height;
          const int first = std::clamp(int((theta - cone) / kPiD * from.height) - 1, 0, from.height - 1),
                    last = std::clamp(int((theta + cone) / kPiD * from.height) + 1, 0, from.height - 1);
          // Half the columns that a cone spans; all of them about a pole.
          const double reach = theta > cone && theta < kPiD - cone ? std::asin(std::min(std::sin(cone) / std::sin(theta), 1.0)) : kPiD;
          const int half = std::min(int(reach / (2 * kPiD) * from.width) + 2, from.width / 2);
          for (int x = 0; x < to.width; ++x) {
            const int middle = int((x + 0.5) * from.width / to.width), begin = middle - half, end = std::min(middle + half, begin + from.width - 1);
            double sum[3] = {}, weight = 0;
            for (int v = first; v <= last; ++v) {
              const float sines = to.sine[y] * from.sine[size_t(v)], cosines = to.cosine[y] * from.cosine[size_t(v)], omega = from.solidAngle[size_t(v)];
              const float ax = to.azimuthCos[size_t(x)], az = to.azimuthSin[size_t(x)];
              float row[4] = {};
              const auto piece = [&](int a, int b) {  // columns a to b of the row
                const float *ux = from.azimuthCos.data(), *uz = from.azimuthSin.data();
                for (int u = a; u <= b; ++u) {
                  const float c = cosines + sines * (ax * ux[u] + az * uz[u]), d = 0.5f * (1.0f + c) * (a2 - 1.0f) + 1.0f;
                  weights[size_t(u)] = c > least ? omega * c / (d * d) : 0.0f;
                }
                const float* red = source.data() + size_t(v) * size_t(from.width);
                for (int u = a; u <= b; ++u) {
                  const float w = weights[size_t(u)];
                  row[0] += w * red[u];
                  row[1] += w * red[n + size_t(u)];
                  row[2] += w * red[2 * n + size_t(u)];
                  row[3] += w;
                }
              };
              if (begin < 0) piece(begin + from.width, from.width - 1);
              piece(std::max(begin, 0), std::min(end, from.width - 1));
              if (end >= from.width) piece(0, end - from.width);
              for (int c = 0; c < 3; ++c) sum[c] += double(row[c]);
              weight += double(row[3]);
            }
            for (size_t c = 0; c < 3; ++c) out[3 * (y * size_t(to.width) + size_t(x)) + c] = weight > 0 ? float(sum[c] / weight) : 0.0f;
          }
        }
      },
      stop);
}

Vec3 GlossMap::level(size_t k, const Vec3& direction) const {
  const Environment& map = maps_[k];
  const Vec3 value = map.eval(direction);
  // In the half row about a pole: towards the row's mean.
  const float polar = std::acos(std::clamp(direction.y, -1.0f, 1.0f)) * (float(map.height) * kInvPi);
  const float near = minOf(polar, float(map.height) - polar);
  return near < 0.5f ? glm::mix(poles_[k][direction.y < 0.0f], value, clamp01(2.0f * near)) : value;
}

Vec3 GlossMap::at(const Vec3& direction, float roughness) const {
  size_t k = 1;
  while (k + 1 < kGlossLevels.size() && roughness > kGlossLevels[k].roughness) ++k;
  const float t = clamp01((roughness - kGlossLevels[k - 1].roughness) / (kGlossLevels[k].roughness - kGlossLevels[k - 1].roughness));
  const Vec3 a = t < 1.0f ? level(k - 1, direction) : Vec3(0.0f), b = t > 0.0f ? level(k, direction) : Vec3(0.0f);
  return (t < 1.0f ? (1.0f - t) * a : Vec3(0.0f)) + (t > 0.0f ? t * b : Vec3(0.0f));
}

NodePtr makeGlossLevelsNode(EnvironmentPtr map) { return std::make_shared<GlossLevelsNode>(std::move(map)); }

}  // namespace gobo::transfer
