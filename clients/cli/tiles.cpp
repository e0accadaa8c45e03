// SPDX-License-Identifier: Apache-2.0
#include "tiles.h"

#include <algorithm>
#include <cctype>
#include <chrono>
#include <future>
#include <iterator>
#include <map>

#include "base/tiled_exr.h"
#include "request/request.h"
#include "server/encode.h"

namespace gobo::cli {

namespace {

Status checkTiles(const v1::RenderRequest& request, uint32_t tile, const std::string& file) {
  GOBO_ASSIGN(const v1::Encoding::Format format, formatOf(file));
  if (format != v1::Encoding::EXR) return invalidArgument("--tile writes an EXR of tiles: -o " + file + " must end in .exr");
  if (tile < 16) return invalidArgument("--tile " + std::to_string(tile) + ": must be at least 16");
  if (request.has_window()) return invalidArgument("--tile and request.window: one of them");
  if (request.halt().has_time_s() || request.halt().has_error()) return invalidArgument("--tile: each tile would end elsewhere by halt.time_s or halt.error");
  const auto lossy = request.encoding().compression();
  if (lossy == v1::Encoding::DWAA || lossy == v1::Encoding::DWAB)
    return invalidArgument("--tile: a file of tiles is not made with DWA", "request.encoding.compression");
  return {};
}

/// What the file says of itself: the whole picture's request.
std::map<std::string, std::string> metadataOf(const v1::RenderReply& reply) {
  v1::RenderRequest whole = reply.resolved();
  whole.clear_scheduling();
  return {{"gobo:request", messageToJson(whole, false)}, {"gobo:request_hash", reply.request_hash()}, {"gobo:plan", ""}};
}

/// Of all tiles: those that differ in their numbers alone are one.
class Warnings {
 public:
  void add(const v1::RenderReply& tile) {
    for (const std::string& text : tile.warnings()) {
      std::string words;
      std::remove_copy_if(text.begin(), text.end(), std::back_inserter(words), [](unsigned char c) { return std::isdigit(c) != 0; });
      Said& said = said_.try_emplace(words, Said{text}).first->second;
      ++said.tiles;
      said.alike = said.alike && said.first == text;
    }
  }
  void tell(v1::RenderReply& whole, int tiles) const {
    whole.clear_warnings();
    for (const auto& [words, said] : said_) {
      const std::string of = std::to_string(said.tiles) + " of " + std::to_string(tiles) + " tiles";
      whole.add_warnings(said.first + (said.tiles == tiles && said.alike ? ""
                                       : said.alike || said.tiles == 1   ? " (" + of + ")"
                                                                         : " (in the first; in " + of + ")"));
    }
  }

 private:
  struct Said {
    std::string first;
    int tiles = 0;
    bool alike = true;
  };
  std::map<std::string, Said> said_;
};

}  // namespace

Result<Tiled> renderTiles(Session& session, v1::RenderRequest request, uint32_t tile, const std::string& file, const std::function<void(int, int)>& progress) {
  GOBO_TRY(checkTiles(request, tile, file));
  const auto begun = std::chrono::steady_clock::now();
  const auto milliseconds = [&] { return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count(); };
  const v1::Encoding asked = request.encoding();
  v1::RenderRequest size;
  if (request.has_width()) size.set_width(request.width());
  if (request.has_height()) size.set_height(request.height());
  GOBO_TRY(resolveDefaults(size));
  const uint32_t width = size.width(), height = size.height(), side = std::min(tile, std::max(width, height));
  request.mutable_encoding()->set_format(v1::Encoding::EXR);
  request.mutable_encoding()->set_compression(v1::Encoding::NONE);  // until it is in the file
  request.mutable_encoding()->set_layers(true);

  Tiled made;
  const int all = int(((width + side - 1) / side) * ((height + side - 1) / side));
  const Unfinished unfinished;  // its temporary file is removed when it ends
  std::unique_ptr<TiledExr> out;
  std::string bytes;            // of the tile that is being written while the next is rendered
  std::future<Status> writing;  // after what it reads: waits when the function ends
  uint64_t rays = 0, peak = 0;
  Warnings warnings;
  const double deadlineMs = request.scheduling().deadline_ms();
  for (uint32_t y = 0; y < height; y += side)
    for (uint32_t x = 0; x < width; x += side) {
      v1::Window* const w = request.mutable_window();
      w->set_x(x);
      w->set_y(y);
      w->set_width(std::min(side, width - x));
      w->set_height(std::min(side, height - y));
      if (deadlineMs > 0) {  // of the whole: each call's counts from when it arrives
        const double left = deadlineMs - milliseconds();
        const int done = int((y / side) * ((width + side - 1) / side) + x / side);
        if (left <= 0)
          return Status(Code::DeadlineExceeded, "the deadline has passed after " + std::to_string(done) + " of " + std::to_string(all) + " tiles",
                        "--deadline");
        request.mutable_scheduling()->set_deadline_ms(left);
      }
      GOBO_ASSIGN(Answer answer, renderOnce(session, request));
      warnings.add(answer.reply);
      if (answer.images.size() != 1)
        return Status(Code::DataLoss, "the server's answer is damaged: " + std::to_string(answer.images.size()) + " pictures for a tile");
      rays += answer.reply.rays();
      peak = std::max<uint64_t>(peak, answer.reply.peak_bytes());
      if (!out) {
        made.reply = answer.reply;
        v1::RenderRequest* const whole = made.reply.mutable_resolved();
        whole->clear_window();
        *whole->mutable_encoding() = asked;
        whole->mutable_encoding()->set_format(v1::Encoding::EXR);
        made.reply.set_request_hash(requestHash(*whole));
        out = std::make_unique<TiledExr>(file, int(side), exrCompressionOf(asked.compression()), metadataOf(made.reply));
        request.set_scene_hash(whole->scene_hash());  // a scene that changes between two tiles is an error
      }
      if (writing.valid()) GOBO_TRY(writing.get());
      bytes = std::move(answer.images[0]);
      writing = std::async(std::launch::async, [&out, &bytes] { return out->add({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()}); });
      if (progress) progress(++made.tiles, all);
      else ++made.tiles;
    }
  GOBO_TRY(writing.get());
  GOBO_TRY(out->finish());
  v1::RenderReply& reply = made.reply;
  reply.set_rays(rays);
  reply.set_peak_bytes(peak);
  reply.set_total_ms(milliseconds());
  warnings.tell(reply, all);
  v1::ImageDescriptor& image = *reply.mutable_images(0);
  image.set_width(width);
  image.set_height(height);
  image.set_bytes(out->bytes());
  image.clear_digest();
  return made;
}

}  // namespace gobo::cli
