// SPDX-License-Identifier: Apache-2.0
#include "fuzz/served/sequence_script.h"

#include <algorithm>

#include "fuzz/served/message_edits.h"
#include "fuzz/served/small_daemon.h"
#include "fuzz/served/tiny_request.h"
#include "gobo/v1/jobs.pb.h"
#include "gobo/v1/service.pb.h"
#include "server/encode.h"
#include "tests/support/triangle_glb.h"

namespace gobo::fuzz::sequence_script {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

std::string pick(std::initializer_list<std::string> from, uint32_t value) { return *(from.begin() + value % from.size()); }

/// A scene's id as the caller would name it: mostly its own or everybody's.
std::string sceneId(const std::string& client, uint32_t value) {
  const std::string other = kClients[(value / 8) % std::size(kClients)];
  switch (value % 8) {
    case 0:
    case 1: return "cornell";
    case 2: return privatePrefix(client) + "0";
    case 3: return "open-" + client;
    case 4: return "shot";
    case 5: return privatePrefix(other) + "0";
    case 6: return "open-" + other;
    default: return pick({"fence", "none", "tri", "rich", ""}, value / 8);
  }
}

/// What a field of this name means outside of a render request.
std::string text(const ScriptedCall& call, const FieldDescriptor& field, uint32_t value, const std::string& root, const LearnedIds& learned) {
  const std::string& name = field.name();
  const bool ofRequest = field.file() == v1::RenderRequest::descriptor()->file() || field.file() == v1::ShadowTechnique::descriptor()->file();
  if (name == "scene") return sceneId(call.client, value);
  if (name == "render_id") return learned.any(value);
  if (name == "mask")
    return pick({"lights", "environment", "tone_map.exposure", "shadows", "halt", "camera", "outputs", "encoding", "width", "scene", "integrator.max_bounces",
                 "lights.light.color", "nothing"},
                value);
  if (name == "client") return value % 4 ? call.client : pick({"", kClients[0], kClients[1]}, value / 4);
  if (name == "digest" || field.containing_type() == v1::BlobDigest::descriptor()) {
    const std::string glb = triangleGlb();
    return pick({sha256Hex(glb.data(), glb.size()), std::string(64, '0'), "12"}, value);
  }
  if (ofRequest) return requestText(name, value, nullptr);
  if (name == "source")
    return pick({root + "/tri.glb", "cornell", root + "/rich.gltf", root + "/tri.glb", root + "/tri.glb", "fence", root + "/none.glb", "/etc/hostname"}, value);
  if (name == "name")
    return pick(
        {privatePrefix(call.client) + "0", "open-" + call.client, privatePrefix(call.client) + "0", "open-" + call.client, "shot", "cornell", "", "a/b"},
        value);
  if (name == "share") return pick({"*", kClients[0], kClients[1], "nobody"}, value);
  if (name == "extension") return pick({".glb", ".glb", ".glb", ".gltf", ".exe"}, value);
  if (name == "data") {
    std::string glb = value % 8 == 6 ? richGltf() : triangleGlb();
    if (value % 8 == 7) glb[value / 8 % glb.size()] ^= char(1 << value % 7);
    return glb;
  }
  if (name == "sha256" || name == "page_token" || name == "key") return value % 8 < 5 ? "" : pick({"k", "j-2", std::string(64, '0')}, value);
  if (name == "id") return "j-" + std::to_string(value % 8 < 6 ? 1 : 2 + value / 8 % 3);
  if (name == "materials") return pick({"glow", "white", "plain", "none"}, value);
  if (name == "instances") return pick({"tri", "floor", "body", "none"}, value);
  if (name == "lights") return requestText(name, value, nullptr);
  return "some";
}

/// Where nothing is edited: every plain text says what it usually says, the request of a job is there.
void begin(Message& m, const Texts& texts, uint32_t value) {
  const auto& r = *m.GetReflection();
  for (int i = 0; i < m.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor& f = *m.GetDescriptor()->field(i);
    if (f.is_repeated() || f.containing_oneof()) continue;  // an optional field is in a oneof of its own
    if (f.cpp_type() == FieldDescriptor::CPPTYPE_STRING) r.SetString(&m, &f, texts(f, value));
    else if (f.message_type() == v1::RenderRequest::descriptor() && m.GetDescriptor() == v1::JobSpec::descriptor())
      begin(*r.MutableMessage(&m, &f), texts, value);
  }
}

/// What the messages of these kinds need to cost little, or to be more than refused.
void settle(Message& m, const ScriptedCall& call, size_t at) {
  makeTiny(m);
  if (auto* const upload = dynamic_cast<v1::UploadSceneRequest*>(&m)) {
    if (at > 0) upload->clear_data();
    if (at == 0 && !(call.how & 0x08)) upload->set_total_bytes(upload->data().size());
    if (upload->name().rfind(privatePrefix(call.client), 0) == 0) upload->clear_share();
  } else if (auto* const put = dynamic_cast<v1::PutBlobRequest*>(&m)) {
    if (at > 0) put->clear_data();
    if (at == 0 && !(call.how & 0x08)) {
      put->mutable_blob()->set_sha256(sha256Hex(put->data().data(), put->data().size()));
      put->mutable_blob()->set_bytes(put->data().size());
    }
  } else if (auto* const open = dynamic_cast<v1::OpenSceneRequest*>(&m)) {
    if (open->name().rfind(privatePrefix(call.client), 0) == 0) open->clear_share();
  } else if (auto* const pin = dynamic_cast<v1::PinTermsRequest*>(&m)) {
    if (!pin->has_which() && !(call.how & 0x08)) pin->mutable_which()->set_type("*");
  } else if (auto* const place = dynamic_cast<v1::PrioritizeJobRequest*>(&m)) {
    if (!place->priority() && !(call.how & 0x08)) place->set_priority(v1::JobSpec::HIGH);
  } else if (auto* const depend = dynamic_cast<v1::DependRequest*>(&m)) {
    if (!(call.how & 0x08)) depend->clear_after();  // of the first job: a circle otherwise
  } else if (auto* const asked = dynamic_cast<v1::JobLogRequest*>(&m)) {
    if (!(call.how & 0x08)) asked->clear_frames();
  } else if (auto* const spec = dynamic_cast<v1::JobSpec*>(&m)) {
    if (!(call.how & 0x08)) spec->clear_out(), spec->clear_after();  // "some": no folder is configured
    v1::FrameRange* const frames = spec->has_frames() ? spec->mutable_frames() : nullptr;
    while (frames && frames->numbers_size() > 3) frames->mutable_numbers()->RemoveLast();
    const int64_t most = frames ? frames->first() + 2 * int64_t(std::max(1u, frames->step())) : 0;
    if (frames && frames->last() > most && frames->last() <= 1000000000 && frames->first() >= -1000000000) frames->set_last(most);
  }
}

}  // namespace
}  // namespace gobo::fuzz::sequence_script

namespace gobo::fuzz {

std::string privatePrefix(const std::string& client) { return "private-" + client + "-"; }

std::vector<ScriptedCall> script(Bytes bytes) {
  std::vector<ScriptedCall> out;
  while (bytes.size() >= 4 && out.size() < kMostCalls) {
    ScriptedCall call;
    constexpr const char* kCallers[] = {kClients[0], kClients[0], kClients[0], kClients[1], kClients[1], kClients[1], kClients[2], kStranger};
    call.client = kCallers[bytes[0] % 8];
    call.beside = (bytes[0] & 0x20) != 0;
    call.method = everyMethod()[bytes[1] % everyMethod().size()];
    call.how = bytes[2];
    const size_t edits = std::min((bytes.size() - 4) / kEditBytes, size_t(bytes[3] % 5)) * kEditBytes;
    call.edits = bytes.subspan(4, edits);
    bytes = bytes.subspan(4 + edits);
    out.push_back(std::move(call));
  }
  return out;
}

void LearnedIds::add(const std::string& client, const std::string& renderId) {
  const std::lock_guard lock(mutex_);
  ids_.emplace_back(client, renderId);
}
std::string LearnedIds::any(uint32_t value) const {
  const std::lock_guard lock(mutex_);
  return ids_.empty() || value % 8 == 7 ? "00000000000000000000000000000000" : ids_[ids_.size() - 1 - value % ids_.size()].second;
}
std::string LearnedIds::ownerOf(const std::string& renderId) const {
  const std::lock_guard lock(mutex_);
  for (const auto& [client, id] : ids_)
    if (id == renderId) return client;
  return {};
}
std::vector<std::string> LearnedIds::othersThan(const std::string& client) const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> out;
  for (const auto& [owner, id] : ids_)
    if (owner != client) out.push_back(id);
  return out;
}

std::vector<MessagePtr> requestsOf(const ScriptedCall& call, const std::string& root, const LearnedIds& learned) {
  const Texts texts = [&](const google::protobuf::FieldDescriptor& field, uint32_t value) { return sequence_script::text(call, field, value, root, learned); };
  std::vector<MessagePtr> out;
  for (int i = 0; i < call.messages(); ++i) {
    MessagePtr m = newMessage(*call.method->input_type());
    sequence_script::begin(*m, texts, uint32_t(call.how >> 4));
    editMessage(*m, call.edits, texts);
    sequence_script::settle(*m, call, size_t(i));
    out.push_back(std::move(m));
  }
  return out;
}

}  // namespace gobo::fuzz
