// SPDX-License-Identifier: Apache-2.0
// Frames of a job in parts, for more workers than there are frames: squares of spec.tile_px, row by row from the top left, each rendered as a
// request.window by whoever claims it, which gives each pixel the bits that it has in the whole for every technique, output and filter (plan/window.h
// has what lies around them rendered, too). When they are done, whoever claims the frame puts their pictures together and encodes it.
// Samples are not split: a pixel's sum is one chain of float64 additions, whose order the bits depend on.
// A part's file is a v1::RenderedPart: the pixels before they are encoded, since a view of depth or of motion needs the range of the whole.
#pragma once

#include "gobo/v1/farm.pb.h"
#include "plan/engine.h"
#include "server/jobs/task_store.h"
#include "terms/dropped_samples.h"

namespace gobo {
inline namespace jobs {

/// Of each frame of this (resolved) job; 0 where tile_px is absent or as large as the picture.
uint32_t partsOf(const v1::JobSpec& spec);
v1::Window partWindow(const v1::JobSpec& spec, uint32_t part);

/// Bytes that a part's file can have: what a message can.
inline constexpr uint64_t kPartBytes = 2000000000;
/// The file of a part. float32 pixels, 4 bytes a value: 12 MB for a beauty of 1024 x 1024. Errors: OutOfRange at job.tile_px beyond `most` bytes of pixels.
Result<std::string> writePart(const RenderResult& result, const TaskPlace& place, uint64_t most = kPartBytes);

/// Puts parts together: what the whole request's render would have given, for the encoder. Holds the whole picture and one part.
class FrameJoin {
 public:
  explicit FrameJoin(const v1::RenderRequest& whole) : whole_(whole) {}
  /// In their order, whatever they are. Errors: DataLoss, naming what is wrong with it: it must be rendered again.
  Status add(const void* bytes, size_t size, const TaskPlace& place);
  Result<RenderResult> finish();  ///< DataLoss when a pixel is missing

 private:
  struct Picture {
    std::string output;
    std::vector<std::string> names;
    std::shared_ptr<Term> term;
    DroppedTotal dropped;
  };
  Status begin(const v1::RenderedPart& part);
  Status take(const v1::RenderedPart::Picture& from, const v1::Window& window, Picture& to);
  void takeReply(const v1::RenderedPart& part);
  v1::RenderRequest whole_;
  RenderResult result_;
  std::vector<Picture> pictures_;
  bool photometric_ = false;
  uint64_t pixels_ = 0;
};

}  // namespace jobs
}  // namespace gobo
