// SPDX-License-Identifier: Apache-2.0
// Direct light of single requests, its cost, and its error against a path-traced reference: what both benches of subtractive shadows measure with.
// RMSE by the picture's mean, free of the reference's noise: the root of the mean of (x - a)(x - b), a and b its halves. "dark": of the quarter of the lit
// pixels that has the least light for its albedo, by their own mean. CPU seconds of an engine that has the scene and its acceleration structure but no term.
#pragma once

#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "base/image_io.h"
#include "import/load.h"
#include "measure/report.h"
#include "plan/engine.h"
#include "request/request.h"

namespace gobo::bench {

inline double cpu() {
  rusage u;
  getrusage(RUSAGE_SELF, &u);
  return double(u.ru_utime.tv_sec + u.ru_stime.tv_sec) + 1e-6 * double(u.ru_utime.tv_usec + u.ru_stime.tv_usec);
}

[[noreturn]] inline void fail(const Status& status) {
  std::fprintf(stderr, "bench: %s\n", status.toString().c_str());
  std::exit(1);
}

struct Run {
  Image image;
  double seconds = 0, rays = 0;
};

class Bench {
 public:
  Bench(v1::RenderRequest request, int threads, std::string pictures) : request_(std::move(request)), threads_(threads), pictures_(std::move(pictures)) {
    if (request_.scene().find('.') == std::string::npos) return;
    file_ = request_.scene();
    request_.set_scene("opened");
  }

  /// `other`: instead of the request's scene.
  Run render(const std::vector<std::string>& edits, const std::string& name, const ScenePtr& other = nullptr) const {
    const auto engine = opened();
    v1::RenderRequest warm = request_, r = request_;
    for (const std::string& e : edits)
      if (const Status s = setPath(r, e); !s.ok()) fail(s);
    warm.set_width(1);
    warm.set_height(1);
    warm.mutable_halt()->set_spp(1);
    RenderControl control;
    control.scene = other;
    if (auto first = engine->render(warm, control); !first.ok()) fail(first.status());
    const double start = cpu();
    auto result = engine->render(r, control);
    Run run;
    run.seconds = cpu() - start;
    if (!result.ok()) fail(result.status());
    for (const auto& warning : result->reply.warnings()) std::fprintf(stderr, "%s: %s\n", name.c_str(), warning.c_str());
    run.image = result->images[0].image();
    run.rays = double(result->reply.rays());
    if (!pictures_.empty()) {
      const auto bytes = encodeExr(run.image);
      if (!bytes.ok()) fail(bytes.status());
      if (const Status s = writeFileAtomic(pictures_ + name + ".exr", bytes->data(), bytes->size()); !s.ok()) fail(s);
    }
    return run;
  }

  /// All outputs of the request with these edits.
  std::vector<Image> images(const std::vector<std::string>& edits, const ScenePtr& other = nullptr) const {
    const auto engine = opened();
    v1::RenderRequest r = request_;
    for (const std::string& e : edits)
      if (const Status s = setPath(r, e); !s.ok()) fail(s);
    RenderControl control;
    control.scene = other;
    auto result = engine->render(r, control);
    if (!result.ok()) fail(result.status());
    std::vector<Image> out;
    for (const auto& i : result->images) out.push_back(i.image());
    return out;
  }

  /// Lights of the scene that are not its map are taken out of the request.
  void mapAlone() {
    for (const Light& light : scene()->lights)
      if (light.shape.kind != LightKind::Environment)
        if (const Status s = setPath(request_, "lights." + light.name + ".enabled=false"); !s.ok()) fail(s);
  }

  ScenePtr scene() const {
    EngineOptions options;
    options.loader = inProcessLoader();
    options.threads = threads_;
    options.anyPath = true;
    auto engine = Engine::create(options);
    if (!engine.ok()) fail(engine.status());
    auto scene = (*engine)->loadScene(file_.empty() ? request_.scene() : file_, true);
    if (!scene.ok()) fail(scene.status());
    return *scene;
  }

 private:
  /// An engine of its own for each picture: nothing is there from the one before.
  std::unique_ptr<Engine> opened() const {
    EngineOptions options;
    options.loader = inProcessLoader();
    options.threads = threads_;
    options.anyPath = true;
    auto engine = Engine::create(options);
    if (!engine.ok()) fail(engine.status());
    open(**engine);
    return std::move(*engine);
  }
  void open(Engine& engine) const {
    if (file_.empty()) return;
    if (auto opened = engine.openScene(file_, "opened"); !opened.ok()) fail(opened.status());
  }
  v1::RenderRequest request_;
  std::string file_;  // of the scene; empty: a built-in one
  int threads_;
  std::string pictures_;
};

class Errors {
 public:
  Errors(const Image& a, const Image& b, const Image& albedo) : a_(a), b_(b) {
    std::vector<std::pair<double, size_t>> light;  // by albedo
    for (size_t p = 0; p < a.pixels(); ++p) {
      const double l = luminanceOf(a, p) + luminanceOf(b, p), rho = luminanceOf(albedo, p);
      if (l > 0 && rho > 0) light.push_back({l / rho, p});
      sum_ += l / 2;
    }
    std::sort(light.begin(), light.end());
    for (size_t i = 0; i < light.size() / 4; ++i) dark_.push_back(light[i].second);
    for (size_t p = 0; p < a.pixels(); ++p) all_.push_back(p);
  }
  double relative(const Image& x) const { return error(x, all_); }
  double dark(const Image& x) const { return error(x, dark_); }
  double displayed(const Image& x) const {
    const double mean = sum_ / double(a_.pixels());
    double sum = 0;
    for (size_t i = 0; i < x.data.size(); ++i) {
      const double d = std::exp(-double(x.data[i]) / mean) - std::exp(-0.5 * (double(a_.data[i]) + b_.data[i]) / mean);
      sum += d * d;
    }
    return std::sqrt(sum / double(x.data.size()));
  }

 private:
  static double luminanceOf(const Image& x, size_t p) {
    const size_t c = size_t(x.channels);
    return double(luminance(Vec3(x.data[c * p], x.data[c * p + 1], x.data[c * p + 2])));
  }
  double error(const Image& x, const std::vector<size_t>& pixels) const {
    double error = 0, mean = 0;
    const size_t c = size_t(x.channels);
    for (const size_t p : pixels)
      for (size_t i = c * p; i < c * p + 3; ++i) {
        error += (double(x.data[i]) - a_.data[i]) * (double(x.data[i]) - b_.data[i]);
        mean += 0.5 * (double(a_.data[i]) + b_.data[i]);
      }
    return mean > 0 ? std::sqrt(std::max(error, 0.0) * 3.0 * double(pixels.size())) / mean : 0.0;
  }
  const Image &a_, &b_;
  std::vector<size_t> dark_, all_;
  double sum_ = 0;
};

}  // namespace gobo::bench
