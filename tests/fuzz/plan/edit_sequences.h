// SPDX-License-Identifier: Apache-2.0
// Random edits of scene and request, and the check that matters: a warm reply equals that of an empty store, bit for bit.
#pragma once

#include <functional>
#include <random>
#include <string>
#include <vector>

#include "support/engines.h"

namespace gobo::testing {

struct SequenceResult {
  int renders = 0, reusedNodes = 0, ranNodes = 0, switches = 0;
  std::string failure;
};

class EditSequence {
 public:
  /// `cache`: folder of a disk tier, or empty. A tiny store forces evictions. `files`: paths of scenes that are gone over to and back
  /// among the edits; none: a built-in scene.
  EditSequence(uint64_t seed, uint64_t storeBytes, const std::string& cache, const std::vector<std::string>& files = {})
      : rng_(seed), warm_(makeEngine(storeBytes, cache)), files_(files) {
    static const char* scenes[] = {"cornell", "lights8", "grids"};
    scene_ = files_.empty() ? scenes[rng_() % 3] : files_[0];
    for (const std::string& f : files_) EXPECT_TRUE(warm_->openScene(f, f).ok()) << f;
    request_ = smallRequest(scene_, 16, 12, 4);
    static const char* lamp[] = {"RECT", "DISK", "SPHERE", "SPOT", "DIRECTIONAL", "POINT"};
    (void)setPath(request_, std::string("lights.lamp.kind=") + lamp[rng_() % 6]);
    (void)setPath(request_, "lights.lamp.position=0.2,1.6,0.4");
    (void)setPath(request_, "lights.lamp.direction=0,-1,-0.2");
    (void)setPath(request_, "lights.lamp.radius=0.2");
    (void)setPath(request_, "lights.lamp.angular_size_deg=" + std::to_string(seed % 3 * 4));
    (void)setPath(request_, "lights.lamp.outer_deg=50");
    if (request_.lights().at("lamp").kind() == v1::LightEdit::SPOT && seed % 2 == 0) (void)setPath(request_, "lights.lamp.profile=WINDOW");
    (void)setPath(request_, "lights.lamp.intensity=3");
  }

  SequenceResult run(int steps) {
    SequenceResult out;
    for (int i = 0; i < steps && out.failure.empty(); ++i) {
      const v1::RenderRequest before = request_;
      const std::string edit = i == 0 ? "start" : mutate();
      out.switches += request_.scene() != before.scene();
      history_ += edit + "; ";
      Result<RenderResult> warm = warm_->render(request_);
      const auto cold = makeEngine(256ull << 20, {}, 1 + int(rng_() % 2));
      if (!files_.empty()) EXPECT_TRUE(cold->openScene(scene_, scene_).ok()) << scene_;
      for (const auto& p : patches_)
        if (p.scene() == scene_) (void)cold->patchScene(p);
      Result<RenderResult> fresh = warm.ok() ? cold->render(warm->reply.resolved()) : cold->render(request_);
      if (warm.ok() != fresh.ok()) {
        out.failure = history_ + warm.status().toString() + " vs " + fresh.status().toString();
        break;
      }
      ++out.renders;
      if (!warm.ok()) {  // refused alike (flags of a technique that has none): go on from what was good
        request_ = before;
        scene_ = before.scene();
        continue;
      }
      out.reusedNodes += int(nodesBy(*warm, v1::NodeReport::REUSED).size());
      out.ranNodes += int(nodesBy(*warm, v1::NodeReport::RUN).size());
      const std::string difference = firstDifference(*warm, *fresh);
      if (!difference.empty()) out.failure = scene_ + ": " + history_ + difference;
      if (warm->reply.request_hash() != fresh->reply.request_hash()) out.failure = history_ + "request hashes differ";
    }
    return out;
  }

 private:
  double uniform(double lo, double hi) { return lo + (hi - lo) * double(rng_() % 10007) / 10007.0; }
  std::string number(double lo, double hi) { return std::to_string(uniform(lo, hi)); }
  std::string triple(double lo, double hi) { return number(lo, hi) + "," + number(lo, hi) + "," + number(lo, hi); }
  std::string pick(std::initializer_list<const char*> values) { return *(values.begin() + rng_() % values.size()); }

  std::string mutate() {
    const std::vector<std::function<std::string()>> edits{
        [&] { return "lights.lamp.color=" + triple(0, 2); },
        [&] { return "lights.lamp.intensity=" + number(0, 40); },
        [&] { return "lights.lamp.position=" + triple(-0.8, 1.8); },
        [&] {
          return "lights.lamp.enabled=" + pick({"true", "false"});
        },
        [&] { return "lights.lamp.gain=" + triple(0, 3); },
        [&] { return "lights.lamp.radius=" + number(0.01, 0.5); },
        [&] { return technique("lights.lamp.shadow."); },
        [&] { return technique("lights.lamp.shadow."); },
        [&] { return technique("shadows."); },
        [&] { return "lights.lamp.shadow.map." + mapEdit(); },
        [&] { return "shadows.map." + mapEdit(); },
        [&] {
          return "halt.spp=" + pick({"2", "4", "16", "32", "48"});
        },
        [&] {
          return "seed=" + pick({"0", "1"});
        },
        [&] {
          return "view_samples=" + pick({"1", "2", "4"});
        },
        [&] {
          return "integrator.max_bounces=" + pick({"0", "1", "2"});
        },
        [&] {
          return "integrator.indirect=" + pick({"true", "false"});
        },
        [&] {
          return "integrator.max_groups=" + pick({"1", "2", "3", "16"});
        },
        [&] {
          return "integrator.light_selection=" + pick({"TREE", "POWER", "UNIFORM"});
        },
        [&] { return "environment.constant=" + triple(0, 1); },
        [&] { return "environment.gain=" + triple(0, 2); },
        [&] {
          return "environment.rotation_deg=" + pick({"0", "30", "90"});
        },
        [&] {
          return "environment.extract_lights=" + pick({"0", "2", "4"});
        },
        [&] { return "tone_map.exposure=" + number(-2, 2); },
        [&] {
          return "outputs=" + pick({"beauty", "beauty,depth", "beauty,direct,indirect", "beauty,visibility:lamp", "albedo,normal", "beauty,group:lamp",
                                    "beauty,shadow_basis:lamp", "alpha,shadow_flags:lamp"});
        },
        [&] {
          return "camera.yfov_deg=" + pick({"40", "55"});
        },
    };
    if (!files_.empty() && rng_() % 3 == 0) {
      scene_ = files_[rng_() % files_.size()];
      request_.set_scene(scene_);
      return scene_;
    }
    if (!files_.empty() && rng_() % 8 == 0) {
      const std::string edit = "camera.cull_back_faces=" + pick({"true", "false"});
      (void)setPath(request_, edit);
      return edit;
    }
    if (rng_() % 8 == 0) return patchScene();
    const std::string edit = edits[rng_() % edits.size()]();
    (void)setPath(request_, edit.substr(edit.find(' ') + 1));  // what stands before a blank is set already
    return edit;
  }

  /// A technique at `path`, with a map that is small enough for a test.
  std::string technique(const std::string& path) {
    const std::string size = path + "map.resolution=" + pick({"1", "8", "20"});
    (void)setPath(request_, size);
    return size + " " + path +
           pick({"path_traced=",
                 "ray_traced.samples=4",
                 "ray_traced.samples=9",
                 "axis_aligned.k=2",
                 "axis_aligned.mu=2",
                 "axis_aligned.radius_px=3",
                 "axis_aligned.max_samples=32",
                 "axis_aligned.mean_samples=12",
                 "shadow_map=",
                 "percentage_closer.taps=3",
                 "percentage_closer.pattern=POISSON",
                 "percentage_closer.skip=false",
                 "variance.bleeding_reduction=0.1",
                 "convolution.order=2",
                 "convolution.order=5",
                 "convolution.bytes=true",
                 "exponential.c=40",
                 "exponential.c=300",
                 "exponential.filtering=LOGARITHMIC",
                 "exponential.classification=Z_MAX",
                 "exponential.classification=THRESHOLD",
                 "exponential_variance.c_positive=20",
                 "moment.moment_bias=0.0001",
                 "auto.error=0.05"});
  }
  std::string mapEdit() {
    return pick({"resolution=8", "resolution=12", "blur=0", "blur=2", "bias=0.001", "slope_bias=2", "fit=CAMERA", "fit=SCENE", "lookup=BILINEAR",
                 "lookup=TRILINEAR", "lookup=ANISOTROPIC", "lookup=SUMMED_AREA", "anisotropy=2"});
  }

  std::string patchScene() {
    const auto info = warm_->inspectScene(scene_);
    if (!info.ok()) return "inspect failed";
    v1::PatchSceneRequest p;
    p.set_scene(scene_);
    std::string what;
    if (rng_() % 2) {
      const std::string name = info->material_names(int(rng_() % info->material_names_size()));
      auto& m = (*p.mutable_materials())[name];
      m.mutable_base_color()->set_x(float(uniform(0, 1)));
      m.mutable_base_color()->set_y(float(uniform(0, 1)));
      m.mutable_base_color()->set_z(0.5f);
      what = "recolour " + name;
    } else {
      const std::string name = info->instance_names(int(rng_() % info->instance_names_size()));
      auto& m = (*p.mutable_instances())[name];
      for (int k = 0; k < 16; ++k) m.add_matrix(k % 5 == 0 ? 1.0f : 0.0f);
      m.set_matrix(12, float(uniform(-0.1, 0.1)));
      what = "move " + name;
    }
    if (warm_->patchScene(p).ok()) patches_.push_back(p);
    return what;
  }

  std::mt19937_64 rng_;
  std::unique_ptr<Engine> warm_;
  std::vector<std::string> files_;
  std::string scene_, history_;
  v1::RenderRequest request_;
  std::vector<v1::PatchSceneRequest> patches_;
};

}  // namespace gobo::testing
