// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include <google/protobuf/util/message_differencer.h>

#include "base/utf8.h"
#include "fuzz/properties.h"
#include "gobo/v1/jobs.pb.h"
#include "gobo/v1/service.pb.h"
#include "plan/scene_library.h"
#include "request/effective_scene.h"
#include "request/posed_scene.h"
#include "request/request.h"

namespace gobo::fuzz {
namespace {

using google::protobuf::Message;

/// The rich scene without its animation (posing has its own properties, and costs).
ScenePtr plainScene() {
  static const ScenePtr scene = [] {
    auto copy = std::make_shared<Scene>(*richScene());
    copy->rig = nullptr;
    (void)copy->seal();
    return ScenePtr(copy);
  }();
  return scene;
}

class OneScene final : public SceneLoader {
 public:
  Result<LoadedScene> scene(const std::string&, const StopToken&) override { return LoadedScene{plainScene(), {}}; }
  Result<EnvironmentPtr> environment(const std::string& path, const StopToken&) override { return notFound("no file", path); }
};

std::string bytesOf(const Message& m) {
  std::string out;
  google::protobuf::io::StringOutputStream stream(&out);
  google::protobuf::io::CodedOutputStream coded(&stream);
  coded.SetSerializationDeterministic(true);
  m.SerializeToCodedStream(&coded);
  coded.Trim();
  return out;
}

void resolved(Message& m, Outcome& out) {
  if (const Status s = resolveDefaults(m); !s.ok()) {
    out.said = s.toString();
    out.broken = brokenStatus(s, "request.");
    return;
  }
  out.accepted = true;
  std::unique_ptr<Message> again(m.New()), back(m.New());
  again->CopyFrom(m);
  if (const Status s = resolveDefaults(*again); !s.ok()) {
    out.broken = "resolved, then refused: " + s.toString();
    return;
  }
  if (bytesOf(*again) != bytesOf(m)) {
    out.broken = "resolving again changes it";
    return;
  }
  const std::string json = messageToJson(m, false);
  if (const Status s = messageFromJson(json, *back, "again"); !s.ok()) {
    out.broken = "its JSON is refused: " + s.toString() + " " + json;
    return;
  }
  if (messageHash(*back) != messageHash(m) || bytesOf(*back) != bytesOf(m)) out.broken = "its JSON is another message: " + json;
}

void effective(v1::RenderRequest request, Outcome& out) {
  if (request.environment().has_sky()) request.mutable_environment()->mutable_sky()->clear_sun_direction();  // a bake costs 0.1 s: once a kind
  if (request.environment().has_sky()) request.mutable_environment()->clear_sky();
  const auto none = [](const v1::EnvironmentSettings& e) -> Result<EnvironmentPtr> {
    return e.has_digest() ? notFound("no file '" + e.digest() + "'", "request.environment.digest")
                          : notFound("no file '" + e.path() + "'", "request.environment.path");
  };
  const auto made = makeEffectiveScene(plainScene(), request, none, requestedScene);
  if (!made.ok()) {
    out.said = made.status().toString();
    out.broken = brokenStatus(made.status(), "");
    return;
  }
  out.broken = brokenValues(*made->scene);
  for (const Vec3& g : made->gains)
    if (!isFinite(g)) out.broken = "a gain is not finite";
  for (const Vec3& g : made->gainChanges)
    if (!isFinite(g)) out.broken = "a change of a gain is not finite";
  const Camera& c = made->camera;
  for (int k = 0; k < 16; ++k)
    if (!std::isfinite(c.toWorld[k / 4][k % 4])) out.broken = "the camera is not finite: " + messageToJson(request.camera(), false);
  if (!std::isfinite(c.yfov) || !std::isfinite(c.yheight)) out.broken = "the camera's field is not finite";
}

/// Fields of a later schema are kept on the wire and left out of JSON and hash: they are no part of what is compared.
bool parse(Message& m, Bytes bytes) {
  if (!m.ParseFromArray(bytes.data(), int(bytes.size()))) return false;
  m.DiscardUnknownFields();
  return true;
}

}  // namespace

Outcome tryRequestText(Bytes bytes) {
  Outcome out;
  const std::string text(bytes.begin(), bytes.end());
  v1::RenderRequest request;
  if (!text.empty() && text[0] == '{') {
    if (const Status s = messageFromJson(text, request, "file.json"); !s.ok()) {
      out.said = s.toString();
      out.broken = brokenStatus(s, "file.json");
      return out;
    }
  } else {
    for (size_t at = 0; at < text.size();) {
      const size_t end = std::min(text.find('\n', at), text.size());
      const std::string line = text.substr(at, end - at);
      at = end + 1;
      if (!isUtf8(line)) continue;  // a command line's bytes; protobuf says no to them when it is sent
      if (const Status s = setPath(request, line); !s.ok()) {
        out.said = s.toString();
        out.broken = line.find('=') == 0 ? "" : brokenStatus(s, "");
        if (!out.broken.empty()) return out;
      }
    }
    for (const std::string& path : setPaths(request)) {  // what relight sends as its mask
      v1::RenderRequest base;
      const Status s = applyMask(base, request, {path});
      if (!s.ok() && s.message().empty()) out.broken = "a mask's error says nothing: " + path;
    }
  }
  if (out.broken.empty()) resolved(request, out);
  if (out.accepted && out.broken.empty()) effective(request, out);
  return out;
}

Outcome tryRequestBytes(Bytes bytes) {
  Outcome out;
  if (bytes.empty()) return out;
  const Bytes rest = bytes.subspan(1);
  if (bytes[0] % 4 == 0) {
    v1::RenderRequest request;
    if (!parse(request, rest)) return out;
    resolved(request, out);
    if (out.accepted && out.broken.empty()) effective(request, out);
  } else if (bytes[0] % 4 == 1) {
    v1::RelightRequest relight;
    if (!parse(relight, rest)) return out;
    v1::RenderRequest request;
    request.set_scene("rich");
    (*request.mutable_lights())["lamp"].set_intensity(3);
    const std::vector<std::string> mask(relight.mask().begin(), relight.mask().end());
    if (const Status s = applyMask(request, relight.patch(), mask); !s.ok()) {
      out.said = s.toString();
      if (s.message().empty() || s.code() != Code::InvalidArgument) out.broken = "a mask's error says nothing: " + out.said;
      return out;
    }
    resolved(request, out);
    if (out.accepted && out.broken.empty()) effective(request, out);
  } else if (bytes[0] % 4 == 2) {
    v1::PatchSceneRequest patch;
    if (!parse(patch, rest)) return out;
    patch.set_scene("rich");
    SceneLibrary library({}, false, std::make_shared<OneScene>());
    (void)library.openFile("rich.gltf", "rich.gltf", "rich");
    const auto info = library.patch(patch);
    if (!info.ok()) {
      out.said = info.status().toString();
      out.broken = brokenStatus(info.status(), "");
      return out;
    }
    out.accepted = true;
    out.broken = brokenValues(**library.find("rich"));
  } else {
    v1::JobSpec spec;
    if (!parse(spec, rest)) return out;
    resolved(spec, out);
  }
  return out;
}

}  // namespace gobo::fuzz
