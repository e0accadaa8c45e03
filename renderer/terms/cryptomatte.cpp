// SPDX-License-Identifier: Apache-2.0
#include "terms/cryptomatte.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdio>
#include <utility>

#include "base/check.h"
#include "base/disk.h"
#include "base/murmur3.h"
#include "trace/accel.h"
#include "trace/back_faces.h"
#include "trace/camera_draws.h"
#include "trace/sample_set.h"
#include "trace/view_samples.h"

namespace gobo {
inline namespace terms {

uint32_t cryptomatteId(std::string_view name) {
  const uint32_t hash = murmurHash3(name), exponent = hash >> 23 & 255u;
  return exponent == 0 || exponent == 255 ? hash ^ 1u << 23 : hash;
}

std::string cryptomatteHex(uint32_t id) {
  char text[9];
  std::snprintf(text, sizeof text, "%08x", id);
  return text;
}

namespace {

/// How many of a pixel's rays show each id.
class IdCounts {
 public:
  void clear() { size_ = 0; }
  void add(uint32_t id) {
    for (int i = 0; i < size_; ++i)
      if (entries_[size_t(i)].id == id) {
        ++entries_[size_t(i)].count;
        return;
      }
    entries_[size_t(size_++)] = {id, 1};
  }
  void write(int samples, float* ranks) {
    const auto end = entries_.begin() + size_, last = entries_.begin() + std::min(size_, kCryptomatteRanks);
    std::partial_sort(entries_.begin(), last, end, [](const Entry& a, const Entry& b) { return a.count != b.count ? a.count > b.count : a.id < b.id; });
    std::fill_n(ranks, kCryptomatteChannels, 0.0f);
    for (auto at = entries_.begin(); at != last; ++at) {
      *ranks++ = std::bit_cast<float>(at->id);
      *ranks++ = float(at->count) / float(samples);
    }
  }

 private:
  struct Entry {
    uint32_t id, count;
  };
  std::array<Entry, kMostCryptomatteSamples> entries_;  // no more ids than rays
  int size_ = 0;
};

class CryptomatteNode final : public Node {
 public:
  explicit CryptomatteNode(CryptomatteSettings s) : s_(std::move(s)) {
    s_.view.viewSamples = 1;
    GOBO_CHECK_LT(0, s_.samples);
    GOBO_CHECK_LE(s_.samples, kMostCryptomatteSamples);
    if (s_.share.of == 1)
      for (int first = 0; first < s_.samples; first += kLanes) runs_.push_back({uint32_t(first), std::min(kLanes, s_.samples - first)});
    for (uint32_t pass = 0; s_.share.of > 1 && samplesOf(pass) < uint32_t(s_.samples); ++pass) {
      const SamplePass p = samplePass(pass);
      runs_.push_back({sharedFirst(p.block * kBlockSamples + p.first, p.count, s_.share), int(std::min(p.count, uint32_t(s_.samples) - samplesOf(pass)))});
    }
  }
  std::string type() const override { return "cryptomatte"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets;
    if (s_.view.camera.cullBackFaces) t.facets = t.facets | kBackFaceFacets;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashView(h, s_.view);
    s_.view.place.hash(h);
    h.add(s_.samples).add(s_.share.index).add(s_.share.of).add(s_.viewSamples).add(s_.sampler).add(s_.seed).addArray(s_.objects).addArray(s_.materials);
    if (hasObjects() && s_.objects.empty()) h.add("objects");  // ids say for themselves that they are there
    if (hasMaterials() && s_.materials.empty()) h.add("materials");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    std::vector<PlaneShape> planes;
    if (hasObjects()) planes.push_back(unsetPlane<float>("object", kCryptomatteChannels));
    if (hasMaterials()) planes.push_back(unsetPlane<float>("material", kCryptomatteChannels));
    return Wiring(type(), in, 0).gives({"pixels", Domain::Pixel, {s_.view.width, s_.view.height, 1}, std::move(planes)});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    const double rays = double(s_.view.width) * s_.view.height * s_.samples;
    return {rays, 60.0 * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const size_t instances = ctx.scene->instances().size();
    for (const auto& [asked, ids] : {std::pair(hasObjects(), &s_.objects), std::pair(hasMaterials(), &s_.materials)})
      if (asked && ids->size() != instances)
        return internalError("cryptomatte: " + std::to_string(ids->size()) + " ids for " + std::to_string(instances) + " instances");
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const BackFaces passed = s_.view.camera.cullBackFaces ? BackFaces(*ctx.scene, *accel) : BackFaces();
    const FilmRays film(s_.view.camera, s_.view.filmWidth(), s_.view.filmHeight());
    std::vector<Vec2> viewSamples;
    for (int s = 0; s < s_.viewSamples; ++s) viewSamples.push_back(viewSamplePosition(s, s_.viewSamples));
    const auto& out = ctx.result;
    const auto objects = hasObjects() ? out->writable<float>("object") : std::span<float>();
    const auto materials = hasMaterials() ? out->writable<float>("material") : std::span<float>();
    const int width = s_.view.width;
    const size_t grain = std::max<size_t>(1, 16384 / size_t(s_.samples));  // a millisecond
    const bool complete = ctx.arena->parallelFor(
        size_t(width) * size_t(s_.view.height), grain,
        [&](size_t begin, size_t end) {
          IdCounts object, material;
          Ray rays[kLanes];
          Hit hits[kLanes];
          for (size_t p = begin; p < end; ++p) {
            const int x = s_.view.place.x + int(p % size_t(width)), y = s_.view.place.y + int(p / size_t(width));
            object.clear();
            material.clear();
            // A pixel's rays alone go together, whatever is around it: which of two triangles at the same distance is met may depend on the company.
            for (const Run& run : runs_) {
              cameraRays(film, viewSamples, x, y, run, rays);
              accel->intersect16(rays, run.count, hits, &passed);
              for (int i = 0; i < run.count; ++i) {
                if (!hits[i].valid()) continue;
                if (!objects.empty()) object.add(s_.objects[hits[i].instance]);
                if (!materials.empty()) material.add(s_.materials[hits[i].instance]);
              }
            }
            if (!objects.empty()) object.write(s_.samples, objects.data() + p * kCryptomatteChannels);
            if (!materials.empty()) material.write(s_.samples, materials.data() + p * kCryptomatteChannels);
          }
          if (ctx.counters) ctx.counters->rays += uint64_t(end - begin) * uint64_t(s_.samples);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  bool hasObjects() const { return s_.ofObjects || !s_.objects.empty(); }
  bool hasMaterials() const { return s_.ofMaterials || !s_.materials.empty(); }
  /// Consecutive samples of a pixel's sequence, at most kLanes.
  struct Run {
    uint32_t first;
    int count;
  };
  /// Those that PathChunk::startAtCamera makes of the same samples.
  void cameraRays(const FilmRays& film, const std::vector<Vec2>& viewSamples, int x, int y, const Run& run, Ray* rays) const {
    const SampleSet set(pixelSeed(s_.seed, x, y, 0), run.first, s_.sampler);
    const bool lens = s_.view.camera.hasLens();
    alignas(64) float px[kLanes], py[kLanes], ux[kLanes], uy[kLanes];
    if (viewSamples.empty()) {
      set.draw2D(kDrawFilm, px, py);
      if (lens) set.draw2D(kDrawLens, ux, uy);
    }
    for (int i = 0; i < run.count; ++i) {
      Vec2 offset, onLens(0.0f);
      if (viewSamples.empty()) {
        offset = Vec2(px[i], py[i]);
        if (lens) onLens = concentricDisk(Vec2(ux[i], uy[i]));
      } else {
        const uint64_t sample = uint64_t(run.first) + uint64_t(i), n = viewSamples.size();
        const int s = int((sample + set.turnShift(i, sample, uint32_t(n))) % n);
        offset = viewSamples[size_t(s)];
        if (lens) onLens = viewSampleLens(s, int(n), uint64_t(y) * uint64_t(s_.view.filmWidth()) + uint64_t(x));
      }
      rays[i] = film.at(float(x) + offset.x, float(y) + offset.y, onLens);
    }
  }

  CryptomatteSettings s_;
  std::vector<Run> runs_;
};

}  // namespace

NodePtr makeCryptomatteNode(CryptomatteSettings settings) { return std::make_shared<CryptomatteNode>(std::move(settings)); }

}  // namespace terms
}  // namespace gobo
