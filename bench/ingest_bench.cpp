// SPDX-License-Identifier: Apache-2.0
// Where the time of a scene load goes: a sandboxed child with an empty cache (cold), a new daemon with the cache of the first
// (warm), and the load in this process that `gobo --local` does. Then the ray tracing structure, which follows either.
//   ingest_bench [--repeat N] [--out FILE.json]     the time split of sponza, FlightHelmet, DamagedHelmet
//   ingest_bench --layout                           nanoseconds a texture look-up by tile size
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <time.h>

#include "base/sobol.h"
#include "base/task_arena.h"
#include "import/load.h"
#include "scene/mipmap.h"
#include "server/ingest_loader.h"
#include "server/log.h"
#include "trace/accel.h"

namespace {

using namespace gobo;
using Clock = std::chrono::steady_clock;
double msSince(Clock::time_point t) { return std::chrono::duration<double, std::milli>(Clock::now() - t).count(); }

struct Row {
  double total = 0;
  LoadReport report;
};
const Row& median(std::vector<Row>& rows) {
  std::sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) { return a.total < b.total; });
  return rows[rows.size() / 2];
}

/// CPU time of this thread: what else runs on the machine counts less.
double cpuNs() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) * 1e9 + double(t.tv_nsec);
}

/// Random: a path tracer's second hits. Coherent: neighbouring pixels of a slanted view, a texel or so apart. Layouts take turns,
/// so that a busy machine hits all of them.
void layouts() {
  constexpr int tiles[] = {0, 1, 2, 3, 4}, n = 1 << 16;
  std::printf("nanoseconds a bilinear look-up, least of 15 rounds\n%-8s %-8s %8s %8s\n", "texels", "tile", "random", "coherent");
  for (const int size : {256, 1024, 4096}) {
    Texture t;
    t.width = t.height = size;
    t.srgb = true;
    std::vector<uint8_t> texels(size_t(size) * size * 4);
    for (size_t i = 0; i < texels.size(); i += 4) {
      const uint32_t v = hash32(1, uint32_t(i));
      std::memcpy(&texels[i], &v, 4);
    }
    t.texels8 = texels;
    sealTexture(t);
    std::vector<Texture> made;
    for (const int tile : tiles) made.push_back(mipmapped(t, false, 0, tile));
    std::vector<Vec2> at[2];
    for (int i = 0; i < n; ++i) {
      const float x = float(i % 256), y = float(i / 256), s = float(size);
      at[0].emplace_back(toUnit(hash32(2, i)), toUnit(hash32(3, i)));
      at[1].emplace_back((0.3f * x + 0.9f * y) / s, (0.9f * x - 0.3f * y) / s);
    }
    double best[std::size(tiles)][2];
    for (auto& b : best) b[0] = b[1] = 1e30;
    Vec4 sum(0.0f);
    for (int round = 0; round < 15; ++round)
      for (size_t k = 0; k < made.size(); ++k)
        for (int kind = 0; kind < 2; ++kind) {
          const double start = cpuNs();
          for (const Vec2& uv : at[kind]) sum += made[k].sample(uv);
          best[k][kind] = std::min(best[k][kind], (cpuNs() - start) / n);
        }
    for (size_t k = 0; k < made.size(); ++k)
      std::printf("%-8d %-8s %8.1f %8.1f%s\n", size, tiles[k] == 0 ? "rows" : std::to_string(1 << tiles[k]).c_str(), best[k][0], best[k][1],
                  sum.x < 0 ? "!" : "");
  }
}

}  // namespace

int main(int argc, char** argv) {
  int repeat = 5;
  std::string out;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--layout")) {
      layouts();
      return 0;
    }
    if (!std::strcmp(argv[i], "--repeat") && i + 1 < argc) repeat = std::max(1, std::atoi(argv[++i]));
    else if (!std::strcmp(argv[i], "--out") && i + 1 < argc) out = argv[++i];
  }
  setLogLevel(LogLevel::Warn);
  std::string folder = (std::filesystem::temp_directory_path() / "gobo-ingest-bench-XXXXXX").string();
  if (!::mkdtemp(folder.data())) return 1;
  const std::string data = "../shared/data/";
  std::string json = "[";
  std::printf("%-14s %-8s %9s %9s %9s %9s %9s %9s %9s   (ms, median of %d)\n", "scene", "load", "total", "child", "parse", "textures", "map", "BVH", "blob MB",
              repeat);
  const TaskArena arena;
  for (const auto& [name, file] : {std::pair<const char*, const char*>{"sponza", "derived/sponza.glb"},
                                   {"FlightHelmet", "gltf/FlightHelmet/FlightHelmet.gltf"},
                                   {"DamagedHelmet", "gltf/khronos/DamagedHelmet/glTF-Binary/DamagedHelmet.glb"}}) {
    const std::string path = std::filesystem::absolute(data + file).lexically_normal().string();
    if (!std::filesystem::exists(path)) {
      std::printf("%-14s is absent\n", name);
      continue;
    }
    double bvh = 0;
    for (const char* load : {"local", "cold", "warm"}) {
      std::vector<Row> rows;
      for (int k = 0; k < repeat; ++k) {
        IngestOptions options;
        options.cacheFolder = folder + "/" + name;
        if (!std::strcmp(load, "cold")) std::filesystem::remove_all(options.cacheFolder);
        auto loader = !std::strcmp(load, "local") ? Result<std::shared_ptr<SceneLoader>>(inProcessLoader()) : childLoader(options);
        if (!loader.ok()) {
          std::fprintf(stderr, "%s\n", loader.status().toString().c_str());
          return 1;
        }
        const auto start = Clock::now();
        const auto loaded = (*loader)->scene(path, {});
        rows.push_back({msSince(start), loaded.ok() ? loaded->report : LoadReport{}});
        if (!loaded.ok()) {
          std::fprintf(stderr, "%s\n", loaded.status().toString().c_str());
          return 1;
        }
        if (bvh == 0) {
          const std::vector<int> none;
          const auto building = Clock::now();
          (void)Accel::build(SceneView(*loaded->scene, Facet::All, none), arena);
          bvh = msSince(building);
        }
      }
      const Row& r = median(rows);
      std::printf("%-14s %-8s %9.1f %9.1f %9.1f %9.1f %9.2f %9.1f %9.1f\n", name, load, r.total, r.report.ingestMs, r.report.parseMs, r.report.textureMs,
                  r.report.mapMs, bvh, double(r.report.blobBytes) / 1e6);
      json += std::string(json.size() > 1 ? ",\n " : "\n ") + "{\"scene\":\"" + name + "\",\"load\":\"" + load + "\",\"total_ms\":" + std::to_string(r.total) +
              ",\"child_ms\":" + std::to_string(r.report.ingestMs) + ",\"parse_ms\":" + std::to_string(r.report.parseMs) +
              ",\"texture_ms\":" + std::to_string(r.report.textureMs) + ",\"map_ms\":" + std::to_string(r.report.mapMs) + ",\"bvh_ms\":" + std::to_string(bvh) +
              ",\"blob_bytes\":" + std::to_string(r.report.blobBytes) + ",\"cached\":" + (r.report.cached ? "true" : "false") + "}";
    }
  }
  if (!out.empty()) std::ofstream(out) << json << "\n]\n";
  std::filesystem::remove_all(folder);
  return 0;
}
