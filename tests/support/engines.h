// SPDX-License-Identifier: Apache-2.0
// Engines for tests: small, single-purpose, and with helpers that fail the test with the engine's own words.
#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <map>

#include "import/load.h"
#include "plan/engine.h"
#include "request/request.h"

namespace gobo::testing {

inline std::unique_ptr<Engine> makeEngine(uint64_t storeBytes = 256ull << 20, const std::string& cache = {}, int threads = 2) {
  EngineOptions o;
  o.loader = inProcessLoader();
  o.threads = threads;
  o.storeBytes = storeBytes;
  o.cacheFolder = cache;
  o.anyPath = true;
  auto engine = Engine::create(o);
  EXPECT_TRUE(engine.ok()) << engine.status().toString();
  return std::move(*engine);
}

inline v1::RenderRequest smallRequest(const std::string& scene, int width = 24, int height = 16, int spp = 4) {
  v1::RenderRequest r;
  r.set_scene(scene);
  r.set_width(width);
  r.set_height(height);
  r.set_view_samples(2);
  r.mutable_halt()->set_spp(spp);
  r.mutable_integrator()->set_max_bounces(2);
  return r;
}

inline void set(v1::RenderRequest& request, const std::string& assignment) {
  const Status s = setPath(request, assignment);
  ASSERT_TRUE(s.ok()) << assignment << ": " << s.toString();
}

inline RenderResult mustRender(Engine& engine, const v1::RenderRequest& request) {
  Result<RenderResult> r = engine.render(request);
  EXPECT_TRUE(r.ok()) << r.status().toString() << "\n" << messageToJson(request, true);
  return r.ok() ? std::move(*r) : RenderResult{};
}

/// Empty when both replies hold the same outputs bit for bit; otherwise where they first differ.
inline std::string firstDifference(const RenderResult& a, const RenderResult& b) {
  if (a.images.size() != b.images.size()) return "different numbers of images";
  for (size_t i = 0; i < a.images.size(); ++i) {
    const Image &x = a.images[i].image(), &y = b.images[i].image();
    if (x.width != y.width || x.height != y.height || x.channels != y.channels) return a.images[i].output + ": different sizes";
    for (size_t k = 0; k < x.data.size(); ++k)
      if (std::memcmp(&x.data[k], &y.data[k], 4) != 0)
        return a.images[i].output + "[" + std::to_string(k) + "]: " + std::to_string(x.data[k]) + " vs " + std::to_string(y.data[k]);
  }
  return {};
}

/// Labels of the nodes that ran.
inline std::map<std::string, v1::NodeReport> nodesBy(const RenderResult& r, v1::NodeReport::State state) {
  std::map<std::string, v1::NodeReport> out;
  for (const auto& n : r.reply.plan())
    if (n.state() == state) out[n.node()] = n;
  return out;
}

}  // namespace gobo::testing
