// SPDX-License-Identifier: Apache-2.0
#include "fuzz/served/rendered_request.h"
#include "import/load.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "fuzz/served/message_edits.h"
#include "fuzz/served/tiny_request.h"
#include "fuzz/targets.h"
#include "plan/engine.h"
#include "request/request.h"
#include "scene/load.h"
#include "server/encode.h"

namespace gobo::fuzz::rendered_request {
namespace {

constexpr uint8_t kScene = 0x07, kCold = 0x18, kEncoded = 0x20;  // bits of the first byte; files only of what is rendered a third time
constexpr size_t kMostEdits = 24;

std::unique_ptr<Engine> engine(int threads) {
  EngineOptions o;
  o.loader = inProcessLoader();
  o.threads = threads;
  o.storeBytes = 64 << 20;
  o.environmentBytes = 64 << 20;
  o.accelBytes = 64 << 20;
  auto made = Engine::create(o);
  if (!made.ok()) throw std::runtime_error(made.status().toString());
  return std::move(*made);
}

const ScenePtr& sceneOf(uint8_t choice) {
  static const ScenePtr scenes[] = {richScene(), *makeBuiltinScene("cornell")};
  return scenes[(choice & kScene) % 4 == 3];  // mostly the one with everything in it
}

/// What a client may do about it: a code that blames the request, and the field's name. Rules of the shadows name the field as it is written in
/// either place: shadows.map.lookup.
std::string brokenRefusal(const Status& s) {
  const std::string wrong = brokenStatus(s, s.location().rfind("shadows", 0) == 0 ? "shadows" : "request");
  if (!wrong.empty()) return wrong;
  switch (s.code()) {
    case Code::InvalidArgument:
    case Code::NotFound:
    case Code::PermissionDenied:
    case Code::FailedPrecondition:
    case Code::ResourceExhausted: return {};
    default: return "does not blame the request: " + s.toString();
  }
}

/// The first bit in which two answers to one request differ; how one of them was made is said by `what`.
std::string difference(const RenderResult& a, const RenderResult& b, const char* what) {
  const std::string place = std::string(what) + ": ";
  if (a.images.size() != b.images.size()) return place + "another number of pictures";
  for (size_t i = 0; i < a.images.size(); ++i) {
    const auto x = a.images[i].pixels(), y = b.images[i].pixels();
    if (a.images[i].output != b.images[i].output || x.size() != y.size() || a.images[i].width() != b.images[i].width())
      return place + a.images[i].output + " has another shape";
    for (size_t k = 0; k < x.size(); ++k)
      if (std::memcmp(&x[k], &y[k], sizeof(float)) != 0)
        return place + a.images[i].output + "[" + std::to_string(k) + "] " + std::to_string(x[k]) + " became " + std::to_string(y[k]);
  }
  return a.reply.request_hash() == b.reply.request_hash() ? "" : place + "another request hash";
}

/// A window's pictures are those of the whole there; maps of lights (shadow_basis) are no part of it.
std::string differenceOfWindow(const RenderResult& part, const RenderResult& whole, const v1::Window& w) {
  if (part.images.size() != whole.images.size()) return "the whole has another number of pictures";
  for (size_t i = 0; i < part.images.size(); ++i) {
    const std::string& name = part.images[i].output;
    const Image &a = part.images[i].image(), &b = whole.images[i].image();
    const bool map = name.rfind("shadow_basis", 0) == 0;
    const int x0 = map ? 0 : int(w.x()), y0 = map ? 0 : int(w.y());
    if (a.channels != b.channels || (map ? a.width != b.width || a.height != b.height : a.width != int(w.width()) || a.height != int(w.height())))
      return name + " of the window has another shape";
    for (int y = 0; y < a.height; ++y)
      if (std::memcmp(a.at(0, y), b.at(x0, y + y0), sizeof(float) * size_t(a.channels) * size_t(a.width)) != 0)
        return name + " of the window is not the whole's, row " + std::to_string(y);
  }
  return {};
}

/// The pictures as files: of equal requests they are equal bytes.
std::string encoded(RenderResult& a, RenderResult& b) {
  const auto x = encodeImages(a), y = encodeImages(b);
  if (!x.ok()) return x.status().code() == Code::InvalidArgument ? "" : "the pictures cannot be encoded: " + x.status().toString();
  if (!y.ok()) return "encoded once, but not twice: " + y.status().toString();
  if (x->size() != y->size()) return "another number of files";
  for (size_t i = 0; i < x->size(); ++i)
    if (!std::ranges::equal((*x)[i].bytes, (*y)[i].bytes)) return "file " + (*x)[i].descriptor.output() + " has other bytes";
  return {};
}

Outcome render(uint8_t how, const v1::RenderRequest& request) {
  // Kept from input to input: what a store holds must not change an answer.
  static const std::unique_ptr<Engine> warm = engine(2), alone = engine(1);
  Outcome out;
  RenderControl control;
  control.scene = sceneOf(how);
  Result<RenderResult> first = warm->render(request, control);
  if (!first.ok()) {
    out.said = first.status().toString();
    out.broken = brokenRefusal(first.status());
    return out;
  }
  out.accepted = true;
  for (const RenderedImage& image : first->images)
    for (const float v : image.pixels())
      if (!std::isfinite(v)) {
        out.broken = image.output + " is not finite";
        return out;
      }
  for (const v1::NodeReport& node : first->reply.plan())
    out.said += v1::NodeReport::State_Name(node.state()) + " " + node.node().substr(0, node.node().find(':')) + "\n";
  // As resolved: that is what a time or an error had ended, with the samples that it got.
  const auto again = [&](Engine& other, const char* what) {
    Result<RenderResult> second = other.render(first->reply.resolved(), control);
    if (out.broken.empty()) out.broken = second.ok() ? difference(*first, *second, what) : std::string(what) + " it is refused: " + second.status().toString();
    return second;
  };
  Result<RenderResult> second = again(*warm, "rendered again");
  if (first->reply.resolved().has_window() && out.broken.empty()) {
    v1::RenderRequest whole = first->reply.resolved();
    whole.clear_window();
    const Result<RenderResult> all = warm->render(whole, control);
    if (all.ok()) out.broken = differenceOfWindow(*first, *all, first->reply.resolved().window());
    else if (all.status().code() != Code::ResourceExhausted) out.broken = "the whole of a window is refused: " + all.status().toString();
  }
  if (!out.broken.empty() || (how & kCold) != kCold) return out;
  alone->dropCaches(false);
  Result<RenderResult> third = again(*alone, "on one thread without a store");
  alone->dropCaches(false);
  if (out.broken.empty() && (how & kEncoded) == kEncoded) out.broken = encoded(*second, *third);
  return out;
}

}  // namespace
}  // namespace gobo::fuzz::rendered_request

namespace gobo::fuzz {

v1::RenderRequest renderedRequest(Bytes bytes) {
  v1::RenderRequest request;
  if (bytes.size() < 2) return request;
  const Scene* const scene = rendered_request::sceneOf(bytes[0]).get();
  const size_t edits = std::min((bytes.size() - 2) / kEditBytes, size_t(bytes[1]) % (rendered_request::kMostEdits + 1)) * kEditBytes;
  const Bytes wire = bytes.subspan(2 + edits);
  if (!request.ParseFromArray(wire.data(), int(wire.size()))) request.Clear();
  editMessage(request, bytes.subspan(2, edits),
              [&](const google::protobuf::FieldDescriptor& field, uint32_t value) { return requestText(field.name(), value, scene); });
  request.clear_scene();  // it is given
  makeTiny(request);
  return request;
}

Outcome tryRenderedRequest(Bytes bytes) {
  if (bytes.size() < 2) return {};
  const v1::RenderRequest request = renderedRequest(bytes);
  Outcome out = rendered_request::render(bytes[0], request);
  if (!out.broken.empty()) out.broken += "\n" + messageToJson(request, false);
  return out;
}

}  // namespace gobo::fuzz
