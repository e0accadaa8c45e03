// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/frame_parts.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <algorithm>
#include <bit>
#include <cstring>

#include "plan/picture_warnings.h"
#include "plan/window.h"
#include "request/request.h"
#include "server/encode.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {

constexpr const char* kJoinedPlane = "value";

uint32_t columnsOf(uint32_t length, uint32_t tile) { return (length + tile - 1) / tile; }

Status damaged(const std::string& what) { return {Code::DataLoss, "a part's file is damaged: " + what}; }

/// What another render of the same part says, too: nothing of clocks and caches, so its file has the same bytes and name.
void keepRepeatable(const v1::RenderReply& from, v1::RenderReply& to) {
  *to.mutable_resolved() = from.resolved();
  for (const v1::NodeReport& n : from.plan()) {
    v1::NodeReport& row = *to.add_plan();
    row.set_node(n.node());
    row.set_samples(n.samples());
    row.set_device(n.device());
    row.set_approximate(n.approximate());
    if (n.state() != v1::NodeReport::PRUNED) continue;
    row.set_state(n.state());
    row.set_reason(n.reason());
  }
  *to.mutable_warnings() = from.warnings();
  *to.mutable_path_classes_missing() = from.path_classes_missing();
  to.set_seed(from.seed());
  to.set_build(from.build());
}

template <typename Rows>
void keepFirst(Rows& rows, const std::string& text) {
  if (std::find(rows.begin(), rows.end(), text) == rows.end()) *rows.Add() = text;
}

}  // namespace

uint32_t partsOf(const v1::JobSpec& spec) {
  if (!spec.has_tile_px()) return 0;
  const v1::RenderRequest& r = spec.request();
  const uint64_t parts = uint64_t(columnsOf(r.width(), spec.tile_px())) * columnsOf(r.height(), spec.tile_px());
  return parts < 2 ? 0 : uint32_t(parts);
}

v1::Window partWindow(const v1::JobSpec& spec, uint32_t part) {
  const uint32_t tile = spec.tile_px(), width = spec.request().width(), height = spec.request().height(), columns = columnsOf(width, tile);
  v1::Window w;
  w.set_x(part % columns * tile);
  w.set_y(part / columns * tile);
  w.set_width(std::min(tile, width - w.x()));
  w.set_height(std::min(tile, height - w.y()));
  return w;
}

Result<std::string> writePart(const RenderResult& result, const TaskPlace& place, uint64_t most) {
  static_assert(std::endian::native == std::endian::little);
  uint64_t pixelBytes = 0;
  for (const RenderedImage& image : result.images) pixelBytes += image.pixels().size_bytes();
  if (pixelBytes > most)
    return Status(Code::OutOfRange,
                  strf("job.tile_px: a part has %llu bytes in all its outputs, at most %llu: take smaller ones", (unsigned long long)pixelBytes,
                       (unsigned long long)most),
                  "job.tile_px");
  v1::RenderedPart part;
  part.set_frame(place.frame);
  part.set_part(*place.part);
  keepRepeatable(result.reply, *part.mutable_reply());
  *part.mutable_window() = result.reply.resolved().window();
  for (const RenderedImage& image : result.images) {
    v1::RenderedPart::Picture& p = *part.add_pictures();
    p.set_output(image.output);
    p.set_width(uint32_t(image.width()));
    p.set_height(uint32_t(image.height()));
    p.set_channels(uint32_t(image.channels()));
    for (const std::string& name : image.names()) p.add_names(name);
    const std::span<const float> pixels = image.pixels();
    p.set_pixels(pixels.data(), pixels.size_bytes());
    const DroppedTotal dropped = image.dropped();
    p.set_dropped_samples(dropped.samples);
    p.set_dropped_pixels(dropped.elements);
  }
  part.mutable_tables()->insert(result.tables.begin(), result.tables.end());
  for (const auto& [output, own] : result.attributes) (*part.mutable_attributes())[output].mutable_of()->insert(own.begin(), own.end());
  for (const auto& [name, m] : result.matrices) (*part.mutable_matrices())[name] = std::string(reinterpret_cast<const char*>(&m), sizeof m);
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream out(&stream);
    out.SetSerializationDeterministic(true);
    part.SerializeToCodedStream(&out);
  }
  return bytes;
}

Status FrameJoin::begin(const v1::RenderedPart& part) {
  for (const v1::RenderedPart::Picture& from : part.pictures()) {
    // One of a size of its own (a shadow map) is whole in every part.
    const bool cut = !showsMap(from.output()) && from.width() == part.window().width() && from.height() == part.window().height();
    const Extent extent{int(cut ? whole_.width() : from.width()), int(cut ? whole_.height() : from.height())};
    if (from.channels() < 1 || from.channels() > 4096 || extent.width < 1 || extent.height < 1) return damaged("no picture");
    Picture& p = pictures_.emplace_back();
    p.output = from.output();
    p.names = {from.names().begin(), from.names().end()};
    p.term = std::make_shared<Term>("frame_of_parts", Domain::Pixel, extent);
    p.term->addUnsetPlane<float>(kJoinedPlane, int(from.channels()));
  }
  result_.tables = {part.tables().begin(), part.tables().end()};
  for (const auto& [output, own] : part.attributes()) result_.attributes[output] = {own.of().begin(), own.of().end()};
  for (const auto& [name, bytes] : part.matrices()) {
    Mat4 m;
    if (bytes.size() != sizeof m) return damaged("matrix " + name);
    std::memcpy(&m, bytes.data(), sizeof m);
    result_.matrices[name] = m;
  }
  result_.reply.set_seed(part.reply().seed());
  result_.reply.set_build(part.reply().build());
  v1::RenderRequest& resolved = *result_.reply.mutable_resolved();
  resolved = part.reply().resolved();
  resolved.clear_window();
  return {};
}

Status FrameJoin::take(const v1::RenderedPart::Picture& from, const v1::Window& window, Picture& to) {
  const size_t channels = size_t(to.term->channels(kJoinedPlane));
  if (from.output() != to.output || from.channels() != channels || from.pixels().size() != size_t(from.width()) * from.height() * channels * sizeof(float))
    return damaged("picture " + to.output);
  to.dropped.samples += from.dropped_samples();
  to.dropped.elements += from.dropped_pixels();
  const std::span<float> pixels = to.term->writable<float>(kJoinedPlane);
  const Extent& extent = to.term->extent();
  const bool cut = !showsMap(from.output()) && from.width() == window.width() && from.height() == window.height() &&
                   extent == Extent{int(whole_.width()), int(whole_.height())};
  if (!cut && extent != Extent{int(from.width()), int(from.height())}) return damaged("picture " + to.output + " is of another size");
  const size_t x = cut ? window.x() : 0, y = cut ? window.y() : 0, row = size_t(from.width()) * channels;
  for (size_t r = 0; r < from.height(); ++r)
    std::memcpy(pixels.data() + ((y + r) * size_t(extent.width) + x) * channels, from.pixels().data() + r * row * sizeof(float), row * sizeof(float));
  return {};
}

/// Of the nodes and warnings of all parts those that the whole would have.
void FrameJoin::takeReply(const v1::RenderedPart& part) {
  v1::RenderReply& reply = result_.reply;
  const v1::RenderReply& from = part.reply();
  for (const v1::NodeReport& node : from.plan()) {
    const auto same = [&](const v1::NodeReport& n) { return n.node() == node.node() && n.state() == node.state(); };
    if (node.node().rfind(kCropNode, 0) != 0 && std::none_of(reply.plan().begin(), reply.plan().end(), same)) *reply.add_plan() = node;
  }
  for (const std::string& warning : from.warnings()) {
    if (isPhotometricWarning(warning)) {
      photometric_ = true;
      continue;
    }
    const bool counted = std::any_of(part.pictures().begin(), part.pictures().end(), [&](const v1::RenderedPart::Picture& p) {
      return warning == droppedWarning(p.output(), {p.dropped_samples(), p.dropped_pixels()});
    });
    if (!counted) keepFirst(*reply.mutable_warnings(), warning);
  }
  for (const std::string& missing : from.path_classes_missing()) keepFirst(*reply.mutable_path_classes_missing(), missing);
}

Status FrameJoin::add(const void* bytes, size_t size, const TaskPlace& place) {
  v1::RenderedPart part;
  if (size > size_t(INT32_MAX) || !part.ParseFromArray(bytes, int(size))) return damaged("it is none");
  const v1::Window& w = part.window();
  if (part.frame() != place.frame || part.part() != place.part.value_or(UINT32_MAX))
    return damaged(strf("it is part %u of frame index %lld", part.part(), (long long)part.frame()));
  if (w.width() < 1 || w.height() < 1 || uint64_t(w.x()) + w.width() > whole_.width() || uint64_t(w.y()) + w.height() > whole_.height())
    return damaged("its window is beyond the picture");
  if (pictures_.empty()) GOBO_TRY(begin(part));
  if (size_t(part.pictures_size()) != pictures_.size()) return damaged(strf("it has %d pictures", part.pictures_size()));
  for (size_t i = 0; i < pictures_.size(); ++i) GOBO_TRY(take(part.pictures(int(i)), w, pictures_[i]));
  takeReply(part);
  pixels_ += uint64_t(w.width()) * w.height();
  return {};
}

Result<RenderResult> FrameJoin::finish() {
  if (pixels_ != uint64_t(whole_.width()) * whole_.height()) return damaged("parts are missing");
  v1::RenderReply& reply = result_.reply;
  for (Picture& p : pictures_) {
    if (const std::string warning = droppedWarning(p.output, p.dropped); !warning.empty()) reply.add_warnings(warning);
    result_.images.emplace_back(p.output, p.term, kJoinedPlane, p.names);
  }
  for (const RenderedImage& image : result_.images) {
    if (!photometric_ || image.output != "beauty") continue;
    if (const std::string warning = photometricWarning({image.pixels(), image.channels()}); !warning.empty()) reply.add_warnings(warning);
    break;
  }
  reply.set_request_hash(requestHash(reply.resolved()));
  return std::move(result_);
}

}  // namespace jobs
}  // namespace gobo
