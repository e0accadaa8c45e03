// SPDX-License-Identifier: Apache-2.0
#include "fuzz/served/tiny_request.h"

#include <algorithm>
#include <map>
#include <vector>

#include "gobo/v1/options.pb.h"
#include "plan/outputs.h"

namespace gobo::fuzz::tiny_request {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

constexpr uint32_t kMost = 64;            // of whatever is counted
constexpr uint32_t kPixelSamples = 2048;  // samples of the whole picture
/// Counts of which 64 would cost too much, or too little to be worth it.
const std::map<std::string, uint32_t> kMostOf{{"width", 16},       {"height", 16},           {"view_samples", 4},   {"resolution", 32}, {"samples", 16},
                                              {"max_samples", 32}, {"caustic_photons", 256}, {"extract_lights", 4}, {"area_lights", 4}, {"points", 300},
                                              {"lights", 4}};

void tame(v1::ShadowTechnique& shadow) {
  shadow.mutable_map();  // its default size is too large
  if (shadow.has_auto_()) shadow.mutable_auto_()->clear_time_ms();
  if (shadow.has_exponential()) shadow.mutable_exponential()->clear_device();
}

/// Keys that go together, mostly, and no count beyond what is tiny.
void tame(v1::Curve& curve) {
  auto& times = *curve.mutable_time_s();
  for (int k = 0; times.empty() && k < curve.value_size() && k < 2; ++k) curve.add_time_s(k);
  std::sort(times.begin(), times.end());
  times.erase(std::unique(times.begin(), times.end()), times.end());
  if (times.empty()) return;
  const int width = curve.value_size() >= 3 * times.size() ? 3 : 1;
  while (curve.value_size() < width * times.size()) curve.add_value(curve.value_size());
  curve.mutable_value()->Truncate(width * times.size());
  for (double& v : *curve.mutable_value())
    if (v > 16.0) v = 16.0;
}

void begin(v1::RenderRequest& request) {
  v1::Halt& halt = *request.mutable_halt();
  if (halt.has_error()) request.mutable_certificate();  // what it is measured by
  if (!halt.has_spp()) halt.set_spp(4);
}

void finish(v1::RenderRequest& request) {
  if (request.has_window() && request.width() && request.height()) {  // within the picture: drawn apart, its fields hardly ever are
    v1::Window& w = *request.mutable_window();
    w.set_x(w.x() % request.width());
    w.set_y(w.y() % request.height());
    w.set_width(std::clamp(w.width(), 1u, request.width() - w.x()));
    w.set_height(std::clamp(w.height(), 1u, request.height() - w.y()));
  }
  const uint64_t pixels = std::max<uint64_t>(1, uint64_t(request.width()) * request.height());
  const uint32_t most = std::max(4u, uint32_t(std::min<uint64_t>(kMost, kPixelSamples / pixels)));
  if (request.halt().spp() > most && request.halt().spp() <= kMost) request.mutable_halt()->set_spp(most);
}

void bound(Message& m);

/// The messages that a field has.
void boundEach(Message& m, const FieldDescriptor& f) {
  const auto& r = *m.GetReflection();
  if (!f.is_repeated()) {
    if (r.HasField(m, &f)) bound(*r.MutableMessage(&m, &f));
    return;
  }
  for (int k = 0; k < r.FieldSize(m, &f); ++k) {
    Message* held = r.MutableRepeatedMessage(&m, &f, k);
    if (f.is_map()) {
      const FieldDescriptor* const value = f.message_type()->map_value();
      if (value->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) continue;
      held = held->GetReflection()->MutableMessage(held, value);
    }
    bound(*held);
  }
}

/// Every unsigned 32-bit count of the message and of those that it has, also where only its default is too large. Seeds are no counts.
void bound(Message& m) {
  const auto& r = *m.GetReflection();
  auto* const request = dynamic_cast<v1::RenderRequest*>(&m);
  if (request) begin(*request);
  if (auto* const shadow = dynamic_cast<v1::ShadowTechnique*>(&m)) tame(*shadow);
  if (auto* const curve = dynamic_cast<v1::Curve*>(&m)) tame(*curve);
  for (int i = 0; i < m.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor& f = *m.GetDescriptor()->field(i);
    if (f.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) boundEach(m, f);
    if (f.cpp_type() != FieldDescriptor::CPPTYPE_UINT32 || f.is_repeated() || f.name() == "seed") continue;
    const v1::Number range = f.options().GetExtension(v1::number);
    const auto known = kMostOf.find(f.name());
    const uint32_t most = std::max(known == kMostOf.end() ? kMost : known->second, uint32_t(range.min()));
    const double value = r.HasField(m, &f) ? r.GetUInt32(m, &f) : range.default_();
    if (value > most && value <= range.max()) r.SetUInt32(&m, &f, most);
  }
  if (request) finish(*request);
}

}  // namespace
}  // namespace gobo::fuzz::tiny_request

namespace gobo::fuzz {

void makeTiny(google::protobuf::Message& message) { tiny_request::bound(message); }

std::string requestText(const std::string& field, uint32_t value, const Scene* scene) {
  const auto pick = [&](const std::vector<std::string>& from, uint32_t v) { return from.empty() ? std::string() : from[v % from.size()]; };
  std::vector<std::string> lights, cameras, animations;
  if (scene) {
    for (const Light& l : scene->lights) lights.push_back(l.name);
    for (const Camera& c : scene->cameras) cameras.push_back(c.name);
    if (scene->rig)
      for (const RigAnimation& a : scene->rig->animations) animations.push_back(a.name);
  }
  if (lights.empty()) lights = {"light", "lamp"};
  const uint32_t more = value / 8;
  if (value % 8 == 7) return pick({"", "*", "none", "\x01", "a.b", "beauty", "x:y", std::string(300, 'n')}, more);  // meaningful nowhere, or elsewhere
  if (field == "outputs") {
    const auto table = outputTable();
    const OutputInfo& info = table[more % table.size()];
    const uint32_t of = more / uint32_t(table.size());
    if (info.perFilter) return std::string(info.name) + ":" + std::to_string(of % 3);
    return info.perLight ? std::string(info.name) + ":" + pick(lights, of) : info.name;
  }
  if (field == "formula")  // most are numbers anywhere
    return pick({"0.2", "0.3 + 0.1*time", "0.1*distance", "0.5", "edge", "depth > 1 ? 0.1 : 0.2", "0.4", "object(\"floor\")", "2^-1", "1/0", "1", "(("}, more);
  if (field == "term")
    return more % 8 == 7 ? "visibility:" + pick(lights, more / 8)
                         : pick({"beauty", "direct", "indirect", "emission", "beauty", "indirect", "direct_specular"}, more % 8);
  if (field == "meshes") {
    std::vector<std::string> objects{"*"};
    if (scene)
      for (const Instance& o : scene->instances) objects.push_back(o.name);
    return pick(objects, more);
  }
  if (field == "expressions") {
    const std::string light = "lights." + pick(lights, more / 16);
    return pick({"tone_map.exposure", light + ".shadow.style.softness", "camera.yfov_deg", "shadows.style.softness", light + ".intensity",
                 "shadows.style.brightness", "shadows.style.abstraction", "camera.clip_near", light + ".gain", "width"},
                more);
  }
  if (field == "curves") {
    const std::string light = "lights." + pick(lights, more / 16);
    return pick({light + ".intensity", light + ".gain", light + ".position", light + ".shadow.ray_traced.samples", "camera.yfov_deg", "camera.position",
                 "camera.focal_x", "camera.clip_far", "tone_map.exposure", "environment.gain", "integrator.max_bounces", "integrator.caustic_radius",
                 "shadows.ray_traced.samples"},
                more);
  }
  if (field == "lights") return value % 8 == 6 ? "added" : pick(lights, more);
  if (field == "animation") return animations.empty() || value % 8 == 6 ? "*" : pick(animations, more);
  if (field == "variant") return pick(scene ? scene->variants.names : std::vector<std::string>(), more);
  if (field == "path") return "none";
  if (field == "scene_hash") return scene ? scene->hash().hex() : "";
  if (field == "name") return pick(cameras, more);
  return "some";
}

}  // namespace gobo::fuzz
