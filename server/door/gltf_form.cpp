// SPDX-License-Identifier: Apache-2.0
#include "server/door/gltf_form.h"

namespace gobo {

namespace {
constexpr size_t kFormBuffer = 64 << 10;  // of the reader, which is told pieces of at most that
constexpr const char* kSceneField = "scene";
}  // namespace

GltfForm::GltfForm(MHD_Connection* connection, uint64_t mostBytes, std::unique_ptr<SharedLimit::Hold> held) : mostBytes_(mostBytes), held_(std::move(held)) {
  reader_ = MHD_create_post_processor(connection, kFormBuffer, &GltfForm::take, this);
}

GltfForm::~GltfForm() {
  if (reader_) MHD_destroy_post_processor(reader_);
}

MHD_Result GltfForm::take(void* self, MHD_ValueKind, const char* name, const char*, const char*, const char*, const char* data, uint64_t offset, size_t bytes) {
  GltfForm& form = *static_cast<GltfForm*>(self);
  form.wrong_ = form.takePiece(name ? name : "", data, offset, bytes);
  return form.wrong_.ok() ? MHD_YES : MHD_NO;
}

Status GltfForm::takePiece(const std::string& name, const char* data, uint64_t offset, size_t bytes) {
  const std::string shown = escaped(name.substr(0, 80));
  if (name == kSceneField) {
    if (hasScene_ && offset == 0 && !scene_.empty()) return invalidArgument(shown + ": is in the form twice", shown);
    hasScene_ = true;
    if (scene_.size() + bytes > mostBytes_)
      return Status(Code::ResourceExhausted, "scene: has more than " + std::to_string(mostBytes_) + " bytes (limits.upload_bytes, and 256 MiB here)", "scene");
    scene_.append(data, bytes);
    sha_.add(data, bytes);
    return {};
  }
  const auto at = fields_.find(name);
  if (at != fields_.end() && offset == 0 && !at->second.empty()) return invalidArgument(shown + ": is in the form twice", shown);
  if (at == fields_.end() && fields_.size() == kFields)
    return invalidArgument(shown + ": the form has more than " + std::to_string(kFields) + " fields", shown);
  std::string& value = fields_[name];
  if (value.size() + bytes > kValueBytes) return invalidArgument(shown + ": has more than " + std::to_string(kValueBytes) + " bytes", shown);
  value.append(data, bytes);
  return {};
}

void GltfForm::add(const char* data, size_t bytes) {
  if (!wrong_.ok() || !reader_) return;
  if (MHD_post_process(reader_, data, bytes) != MHD_YES && wrong_.ok()) wrong_ = invalidArgument("the body is not a multipart form", "body");
  if (!wrong_.ok()) scene_ = {};
}

Status GltfForm::finish() {
  const MHD_Result ended = reader_ ? MHD_destroy_post_processor(reader_) : MHD_NO;
  reader_ = nullptr;
  if (!wrong_.ok()) return wrong_;
  if (ended != MHD_YES) return invalidArgument("the body is not a multipart form, or ends before its last boundary", "body");
  digest_ = sha_.hex();
  return {};
}

}  // namespace gobo
