// SPDX-License-Identifier: Apache-2.0
// Random edits of scene and request, and the check that matters: a warm reply equals that of an empty store, bit for bit. Edits are drawn from the
// schema (fuzz/served/schema_leaves.h): every field, technique and output is among them.
#pragma once

#include <map>
#include <random>
#include <string>
#include <vector>

#include "fuzz/served/schema_leaves.h"
#include "fuzz/served/tiny_request.h"
#include "support/engines.h"

namespace gobo::testing {

struct SequenceResult {
  int renders = 0, reusedNodes = 0, ranNodes = 0, switches = 0;
  std::string failure;
  std::map<std::string, int> rendered;  ///< by the path of the field that was edited: requests that were not refused
};

/// The scene that a request is about is gone over to by other means.
inline const std::vector<fuzz::SchemaLeaf>& requestLeaves() {
  static const std::vector<fuzz::SchemaLeaf> leaves = [] {
    auto all = fuzz::schemaLeaves(*v1::RenderRequest::descriptor());
    std::erase_if(all, [](const fuzz::SchemaLeaf& l) { return l.path == "scene"; });
    std::shuffle(all.begin(), all.end(), std::mt19937_64(5));  // neighbours in the schema go together
    return all;
  }();
  return leaves;
}
inline const std::vector<fuzz::SchemaLeaf>& patchLeaves() {
  static const std::vector<fuzz::SchemaLeaf> leaves = [] {
    auto all = fuzz::schemaLeaves(*v1::PatchSceneRequest::descriptor());
    std::erase_if(all, [](const fuzz::SchemaLeaf& l) { return l.path == "scene"; });
    return all;
  }();
  return leaves;
}

class EditSequence {
 public:
  /// `cache`: folder of a disk tier, or empty. A tiny store forces evictions. `files`: paths of scenes that are gone over to and back
  /// among the edits; none: a built-in scene. One alone is one more of those.
  EditSequence(uint64_t seed, uint64_t storeBytes, const std::string& cache, const std::vector<std::string>& files = {})
      : rng_(seed), warm_(makeEngine(storeBytes, cache)), files_(files), next_(size_t(seed % 100000) * kLeavesOfOne) {
    static const char* scenes[] = {"cornell", "lights8", "grids"};
    for (const std::string& f : files_) EXPECT_TRUE(warm_->openScene(f, f).ok()) << f;
    const size_t at = rng_() % 4;
    scene_ = files_.empty() || (files_.size() == 1 && at < 3) ? scenes[at % 3] : files_[0];
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
    const fuzz::SchemaLeaf* shadow = nullptr;  // of any technique
    do shadow = &requestLeaves()[rng_() % requestLeaves().size()];
    while (shadow->path.rfind("lights.*.shadow.", 0) != 0);
    EXPECT_TRUE(drawLeaf(
        request_, *shadow, [&] { return uint32_t(rng_()); }, [](const auto&, uint32_t) { return "lamp"; }))
        << shadow->path;
    fuzz::makeTiny(request_);
    leaves_.push_back(shadow);
  }

  SequenceResult run(int steps) {
    SequenceResult out;
    for (int i = 0; i < steps && out.failure.empty(); ++i) {
      const v1::RenderRequest before = request_;
      edited_.clear();
      const std::string edit = i == 0 ? "start" : mutate(i);
      out.switches += request_.scene() != before.scene();
      history_ += edit + "; ";
      Result<RenderResult> warm = warm_->render(request_);
      const auto cold = makeEngine(256ull << 20, {}, 1 + int(rng_() % 2));
      if (ofFile()) { EXPECT_TRUE(cold->openScene(scene_, scene_).ok()) << scene_; }
      for (const auto& p : patches_)
        if (p.scene() == scene_) (void)cold->patchScene(p);
      Result<RenderResult> fresh = warm.ok() ? cold->render(warm->reply.resolved()) : cold->render(request_);
      if (warm.ok() != fresh.ok()) {
        out.failure = history_ + warm.status().toString() + " vs " + fresh.status().toString();
        break;
      }
      ++out.renders;
      out.rendered[edited_] += warm.ok();
      if (!warm.ok()) {  // refused alike (flags of a technique that has none): go on from what was good
        request_ = before;
        scene_ = before.scene();
        continue;
      }
      out.reusedNodes += int(nodesBy(*warm, v1::NodeReport::REUSED).size());
      out.ranNodes += int(nodesBy(*warm, v1::NodeReport::RUN).size());
      const std::string difference = firstDifference(*warm, *fresh);
      if (!difference.empty())
        out.failure = scene_ + ": " + history_ + difference + "\nbefore: " + messageToJson(before, false) + "\n now: " + messageToJson(request_, false);
      if (warm->reply.request_hash() != fresh->reply.request_hash()) out.failure = history_ + "request hashes differ";
    }
    return out;
  }

 private:
  static constexpr size_t kLeavesOfOne = 3;  ///< of the walk over all fields

  bool ofFile() const { return std::find(files_.begin(), files_.end(), scene_) != files_.end(); }

  /// Whether the request has the message that the field belongs to.
  static bool within(const google::protobuf::Message& message, const fuzz::SchemaLeaf& leaf) {
    const google::protobuf::Message* m = &message;
    for (size_t k = 0; k + 1 < leaf.way.size(); ++k) {
      const google::protobuf::FieldDescriptor& f = *leaf.way[k];
      const auto& r = *m->GetReflection();
      if (f.is_repeated() ? r.FieldSize(*m, &f) == 0 : !r.HasField(*m, &f)) return false;
      m = f.is_repeated() ? &r.GetRepeatedMessage(*m, &f, 0) : &r.GetMessage(*m, &f);
      if (f.is_map()) m = &m->GetReflection()->GetMessage(*m, f.message_type()->map_value());
    }
    return true;
  }

  std::string mutate(int step) {
    if (files_.size() > 1 && rng_() % 3 == 0) {
      scene_ = files_[rng_() % files_.size()];
      request_.set_scene(scene_);
      return scene_;
    }
    if (rng_() % 8 == 0) return patchScene();
    // In turn all fields; then those that matter after it: the same ones again, and what the request has a message for.
    const auto& leaves = requestLeaves();
    const fuzz::SchemaLeaf* leaf = nullptr;
    if (step % 3 == 1) leaf = &leaves[next_++ % leaves.size()];
    else if (rng_() % 2 && !leaves_.empty()) leaf = leaves_[rng_() % leaves_.size()];
    else {  // a technique has fewer fields than all the rest, and more that hang together
      std::vector<const fuzz::SchemaLeaf*> of[2];
      for (const fuzz::SchemaLeaf& l : leaves)
        if (within(request_, l)) of[l.path.find("shadow") != std::string::npos].push_back(&l);
      const auto& some = of[rng_() % 2 && !of[1].empty()];
      leaf = some[rng_() % some.size()];
    }
    leaves_.push_back(leaf);
    v1::RenderRequest drawn = request_;
    EXPECT_TRUE(draw(drawn, *leaf)) << leaf->path << ": nothing makes values for fields of its kind";
    fuzz::makeTiny(drawn);
    request_ = drawn;
    edited_ = leaf->path;
    return leaf->path;
  }

  bool draw(google::protobuf::Message& message, const fuzz::SchemaLeaf& leaf) {
    const auto scene = warm_->scene(scene_);
    const auto info = warm_->inspectScene(scene_);
    return drawLeaf(
        message, leaf, [&] { return uint32_t(rng_()); },
        [&](const google::protobuf::FieldDescriptor& f, uint32_t value) -> std::string {
          if (f.name() == "lights" && value % 4) return "lamp";
          if (f.name() == "materials" && info.ok()) return info->material_names(int(value % uint32_t(info->material_names_size())));
          if (f.name() == "instances" && info.ok()) return info->instance_names(int(value % uint32_t(info->instance_names_size())));
          return fuzz::requestText(f.name(), value, scene.ok() ? scene->get() : nullptr);
        });
  }

  std::string patchScene() {
    v1::PatchSceneRequest p;
    p.set_scene(scene_);
    std::string what = "patch";
    for (int k = 0; k < 2; ++k) {
      const fuzz::SchemaLeaf& leaf = patchLeaves()[rng_() % patchLeaves().size()];
      EXPECT_TRUE(draw(p, leaf)) << leaf.path << ": nothing makes values for fields of its kind";
      what += " " + leaf.path;
    }
    fuzz::makeTiny(p);
    if (warm_->patchScene(p).ok()) patches_.push_back(p);
    return what;
  }

  std::mt19937_64 rng_;
  std::unique_ptr<Engine> warm_;
  std::vector<std::string> files_;
  size_t next_;
  std::vector<const fuzz::SchemaLeaf*> leaves_;  ///< edited so far
  std::string scene_, history_, edited_;
  v1::RenderRequest request_;
  std::vector<v1::PatchSceneRequest> patches_;
};

}  // namespace gobo::testing
