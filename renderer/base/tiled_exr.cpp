// SPDX-License-Identifier: Apache-2.0
#include "base/tiled_exr.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfPartType.h>
#include <ImfStringAttribute.h>
#include <ImfTileDescription.h>
#include <ImfTiledOutputFile.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>

#include "base/exr_streams.h"

namespace gobo {
inline namespace base {

/// The library swallows what goes wrong while a file is closed; here it is kept.
class TiledExr::FileWriter final : public Imf::OStream {
 public:
  explicit FileWriter(const std::string& path) : OStream(path.c_str()), file_(std::fopen(path.c_str(), "wbxe")) {
    if (!file_) fail("create");
  }
  ~FileWriter() override { close(); }
  void write(const char c[], int n) override {
    if (std::fwrite(c, 1, size_t(n), file_) != size_t(n)) fail("write");
  }
  uint64_t tellp() override { return uint64_t(::ftello(file_)); }
  void seekp(uint64_t pos) override {
    if (::fseeko(file_, off_t(pos), SEEK_SET) != 0) fail("seek in");
  }
  bool flush() { return file_ && error_ == 0 && std::fflush(file_) == 0 && ::fsync(::fileno(file_)) == 0; }
  void close() {
    if (file_) std::fclose(file_);
    file_ = nullptr;
  }
  int error() const { return error_; }

 private:
  void fail(const char* what) {
    error_ = errno ? errno : EIO;
    throw std::system_error(error_, std::generic_category(), std::string("cannot ") + what + " " + fileName());
  }
  FILE* file_;
  int error_ = 0;
};

struct TiledExr::Impl {
  std::string path, temporary;
  std::unique_ptr<FileWriter> stream;  // before the file, which writes as it goes
  int tileSize = 0;
  ExrCompression compression = ExrCompression::Zip;
  std::map<std::string, std::string> metadata;
  std::unique_ptr<Imf::TiledOutputFile> file;
  Imf::Header header;
  std::vector<bool> written;
  int across = 0;

  void open(const Imf::Header& tile) {
    // Copied but for what is replaced: Header::erase() would leak (OpenEXR 3.1).
    for (auto a = tile.begin(); a != tile.end(); ++a)
      if (!metadata.count(a.name())) header.insert(a.name(), a.attribute());
    header.dataWindow() = header.displayWindow();
    header.compression() = exrCompression(compression);
    header.lineOrder() = Imf::RANDOM_Y;
    header.setTileDescription(Imf::TileDescription(unsigned(tileSize), unsigned(tileSize), Imf::ONE_LEVEL));
    header.setType(Imf::TILEDIMAGE);
    for (const auto& [name, text] : metadata)
      if (!text.empty()) header.insert(name, Imf::StringAttribute(text));
    static std::atomic<uint64_t> counter{0};
    temporary = path + ".tmp-" + std::to_string(getpid()) + "-" + std::to_string(counter++);
    stream = std::make_unique<FileWriter>(temporary);
    file = std::make_unique<Imf::TiledOutputFile>(*stream, header, 0);
    across = file->numXTiles();
    written.assign(size_t(across) * size_t(file->numYTiles()), false);
  }
};

TiledExr::TiledExr(std::string path, int tileSize, ExrCompression compression, std::map<std::string, std::string> metadata) : impl_(new Impl) {
  impl_->path = std::move(path);
  impl_->tileSize = tileSize;
  impl_->compression = compression;
  impl_->metadata = std::move(metadata);
}

TiledExr::~TiledExr() {
  if (!impl_->stream) return;
  impl_->file.reset();
  ::unlink(impl_->temporary.c_str());
}

Status TiledExr::add(std::span<const uint8_t> exr) {
  try {
    MemoryReader stream(exr.data(), exr.size());
    Imf::InputFile in(stream, 1);
    const Imf::Header& from = in.header();
    if (!impl_->file) impl_->open(from);
    Impl& to = *impl_;
    const Imath::Box2i whole = to.header.dataWindow(), box = from.dataWindow();
    if (from.displayWindow() != whole || !(from.channels() == to.header.channels())) return invalidArgument("a tile of another picture", to.path);
    const int tx = (box.min.x - whole.min.x) / to.tileSize, ty = (box.min.y - whole.min.y) / to.tileSize;
    const size_t at = size_t(ty) * size_t(to.across) + size_t(tx);
    if (box.min.x < whole.min.x || box.min.y < whole.min.y || at >= to.written.size() || to.file->dataWindowForTile(tx, ty) != box)
      return invalidArgument("pixels from " + std::to_string(box.min.x) + "," + std::to_string(box.min.y) + " are no tile of the picture", to.path);
    if (to.written[at]) return invalidArgument("a tile came twice", to.path);
    // Channel after channel, as the file has them; the library's places are those of the whole picture, so the memory's begin lies before it.
    const size_t width = size_t(box.max.x - box.min.x) + 1, height = size_t(box.max.y - box.min.y) + 1;
    size_t unit = 0;
    for (auto c = from.channels().begin(); c != from.channels().end(); ++c) unit += c.channel().type == Imf::HALF ? 2 : 4;
    std::vector<char> pixels(unit * width * height);
    Imf::FrameBuffer buffer;
    size_t offset = 0;
    for (auto c = from.channels().begin(); c != from.channels().end(); ++c) {
      const size_t size = c.channel().type == Imf::HALF ? 2 : 4;
      buffer.insert(c.name(), Imf::Slice::Make(c.channel().type, pixels.data() + offset, box, size, size * width));
      offset += size * width * height;
    }
    in.setFrameBuffer(buffer);
    in.readPixels(box.min.y, box.max.y);
    to.file->setFrameBuffer(buffer);
    to.file->writeTile(tx, ty);
    to.written[at] = true;
    return {};
  } catch (const std::system_error& e) {
    errno = e.code().value();
    return ioError("cannot write file", impl_->path);
  } catch (const std::exception& e) {
    errno = impl_->stream ? impl_->stream->error() : 0;  // OpenEXR throws what it makes of the stream's
    if (errno != 0) return ioError("cannot write file", impl_->path);
    return Status(Code::Internal, std::string("cannot write a tile: ") + e.what(), impl_->path);
  }
}

Status TiledExr::finish() {
  Impl& to = *impl_;
  const auto missing = std::count(to.written.begin(), to.written.end(), false);
  if (!to.file || missing) return Status(Code::FailedPrecondition, std::to_string(missing) + " tiles are missing", to.path);
  to.file.reset();  // writes where the tiles lie
  Status status;
  struct stat info {};
  if (!to.stream->flush() || ::stat(to.temporary.c_str(), &info) != 0) {
    if (to.stream->error()) errno = to.stream->error();
    status = ioError("cannot write file", to.path);
  }
  to.stream->close();
  if (status.ok() && ::rename(to.temporary.c_str(), to.path.c_str()) != 0) status = ioError("cannot rename file into place", to.path);
  if (!status.ok()) return status;
  to.stream.reset();
  bytes_ = size_t(info.st_size);
  return {};
}

}  // namespace base
}  // namespace gobo
