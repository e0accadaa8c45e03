// SPDX-License-Identifier: Apache-2.0
// An EXR of tiles that is written as its tiles come, so that a picture larger than memory is one file.
#pragma once

#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/image_io.h"

namespace gobo {
inline namespace base {

class TiledExr {
 public:
  /// `metadata` stands in place of the tiles' own; an empty text leaves the attribute out. Nothing is at `path` before finish().
  TiledExr(std::string path, int tileSize, ExrCompression compression, std::map<std::string, std::string> metadata);
  ~TiledExr();  ///< without finish(): nothing is left
  TiledExr(const TiledExr&) = delete;
  TiledExr& operator=(const TiledExr&) = delete;

  /// A tile, encoded as an EXR of one part whose display window is the whole picture and whose data window is the tile's place in it (ExrOptions::place).
  /// The first one says size, channels and attributes of the file. Errors: InvalidArgument (not a tile of this picture, or there twice), Internal (writing).
  Status add(std::span<const uint8_t> exr);
  /// Errors: FailedPrecondition when a tile is missing; of the file.
  Status finish();
  size_t bytes() const { return bytes_; }  ///< of the file, after finish()

 private:
  class FileWriter;
  struct Impl;
  std::unique_ptr<Impl> impl_;
  size_t bytes_ = 0;
};

}  // namespace base
}  // namespace gobo
