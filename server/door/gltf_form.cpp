// SPDX-License-Identifier: Apache-2.0
#include "server/door/gltf_form.h"

#include <algorithm>
#include <cstring>
#include <exception>
#include <string_view>

namespace gobo {
inline namespace door {

namespace {
constexpr size_t kFormBuffer = 64 << 10;  // of the reader, which is told pieces of at most that
constexpr size_t kShownBytes = 1000;      // of names in an error, about: an empty field may come a million times
constexpr const char* kSceneField = "scene";
constexpr const char* kBoundary = "boundary=";

std::string lowerCase(std::string text) {
  for (char& c : text) c = char(c >= 'A' && c <= 'Z' ? c + 32 : c);
  return text;
}
}  // namespace

GltfForm::GltfForm(MHD_Connection* connection, const std::string& contentType, uint64_t mostBytes, uint64_t announced, std::unique_ptr<SharedLimit::Hold> held)
    : mostBytes_(mostBytes), announced_(announced), held_(std::move(held)), tail_("\r\n") {
  reader_ = MHD_create_post_processor(connection, kFormBuffer, &GltfForm::take, this);
  // As the reader finds it, in capitals or not: to the end of the line, with or without quotes.
  const size_t at = lowerCase(contentType).find(kBoundary);
  std::string boundary = at == std::string::npos ? "" : contentType.substr(at + std::strlen(kBoundary));
  if (boundary.size() > 1 && boundary.front() == '"' && boundary.back() == '"') boundary = boundary.substr(1, boundary.size() - 2);
  delimiter_ = "\r\n--" + boundary;
}

GltfForm::~GltfForm() {
  if (reader_) MHD_destroy_post_processor(reader_);
}

MHD_Result GltfForm::take(void* self, MHD_ValueKind, const char* name, const char*, const char*, const char*, const char* data, uint64_t offset, size_t bytes) {
  GltfForm& form = *static_cast<GltfForm*>(self);
  try {
    form.wrong_ = form.takePiece(name ? name : "", data, offset, bytes);
  } catch (const std::exception&) {  // no memory; the reader is C, through which nothing may fly
    form.wrong_ = Status(Code::ResourceExhausted, "no memory for the form");
  }
  return form.wrong_.ok() ? MHD_YES : MHD_NO;
}

Status GltfForm::takePiece(const std::string& name, const char* data, uint64_t offset, size_t bytes) {
  const std::string shown = escaped(name.substr(0, 80));
  if (offset == 0 && !begun_.insert(name).second) {
    if (!empty_.count(name)) return invalidArgument(shown + ": is in the form twice", shown);
    if (again_.size() < kShownBytes) again_ += (again_.empty() ? "" : " or ") + shown;
  }
  if (bytes == 0 && offset == 0) empty_.insert(name);
  if (bytes > 0) empty_.erase(name);
  if (name == kSceneField) {
    hasScene_ = true;
    if (scene_.size() + bytes > mostBytes_)
      return Status(Code::ResourceExhausted, "scene: has more than " + std::to_string(mostBytes_) + " bytes (limits.upload_bytes, and 256 MiB here)", "scene");
    // Once, as growing by doubling would hold more than was taken for the form. Pages that no byte comes to cost nothing.
    if (scene_.capacity() < scene_.size() + bytes) scene_.reserve(std::max<uint64_t>(scene_.size() + bytes, std::min(announced_, mostBytes_)));
    scene_.append(data, bytes);
    sha_.add(data, bytes);
    return {};
  }
  if (!fields_.count(name) && fields_.size() == kFields)
    return invalidArgument(shown + ": the form has more than " + std::to_string(kFields) + " fields", shown);
  std::string& value = fields_[name];
  if (value.size() + bytes > kValueBytes) return invalidArgument(shown + ": has more than " + std::to_string(kValueBytes) + " bytes", shown);
  value.append(data, bytes);
  return {};
}

// Delimiters that lie in the body, also across its pieces.
void GltfForm::count(const char* data, size_t bytes) {
  const size_t keep = delimiter_.size() - 1, kept = tail_.size();
  tail_.append(data, std::min(bytes, keep));
  const auto countIn = [&](std::string_view text, size_t before) {
    for (size_t at = 0; (at = text.find(delimiter_, at)) < before; at += delimiter_.size()) ++delimiters_;
  };
  countIn(tail_, kept);
  countIn({data, bytes}, bytes);
  if (bytes >= keep) tail_.assign(data + bytes - keep, keep);
  else if (tail_.size() > keep) tail_.erase(0, tail_.size() - keep);
}

void GltfForm::dropScene() {
  scene_ = {};
  held_.reset();
}

void GltfForm::add(const char* data, size_t bytes) {
  if (!wrong_.ok() || !reader_) return;
  arrived_ += bytes;
  if (arrived_ > announced_) {  // whose length nobody said
    wrong_ = Status(Code::ResourceExhausted, "the body has more than the " + std::to_string(announced_) + " bytes that it may have", "body");
    scene_ = {};
    return;
  }
  count(data, bytes);
  if (MHD_post_process(reader_, data, bytes) != MHD_YES && wrong_.ok()) wrong_ = invalidArgument("the body is not a multipart form", "body");
  if (!wrong_.ok()) scene_ = {};
}

Status GltfForm::finish() {
  const MHD_Result ended = reader_ ? MHD_destroy_post_processor(reader_) : MHD_NO;
  reader_ = nullptr;
  if (!wrong_.ok()) return wrong_;
  if (ended != MHD_YES) return invalidArgument("the body is not a multipart form, or ends before its last boundary", "body");
  if (!again_.empty() && delimiters_ != begun_.size() + 1) return invalidArgument(again_ + ": is in the form twice");
  digest_ = sha_.hex();
  return {};
}

}  // namespace door
}  // namespace gobo
