// SPDX-License-Identifier: Apache-2.0
#include "pictures.h"

#include <algorithm>
#include <cstring>
#include <filesystem>

#include "base/hash.h"
#include "base/image_io.h"
#include "server/encode.h"

namespace gobo::cli {

namespace fs = std::filesystem;

namespace {

Status lost(const std::string& what) { return {Code::DataLoss, "the server's answer is damaged: " + what}; }

// Fills an Answer from one head message and the chunks behind it.
class Assembly {
 public:
  Status begin(const v1::RenderReply& reply) {
    answer_ = {};
    answer_.reply = reply;
    for (const v1::ImageDescriptor& image : reply.images()) {
      if (image.bytes() > (1ull << 36)) return lost("an image of " + std::to_string(image.bytes()) + " bytes");
      answer_.images.emplace_back().reserve(image.bytes());
    }
    begun_ = true;
    return {};
  }
  Status add(const v1::ImageChunk& chunk) {
    if (!begun_ || chunk.image() >= answer_.images.size()) return lost("a chunk of image " + std::to_string(chunk.image()));
    std::string& bytes = answer_.images[chunk.image()];
    const uint64_t total = answer_.reply.images(int(chunk.image())).bytes();
    if (chunk.offset() != bytes.size() || chunk.data().size() > total - bytes.size())
      return lost("a chunk at offset " + std::to_string(chunk.offset()) + " where " + std::to_string(bytes.size()) + " was due");
    bytes += chunk.data();
    return {};
  }
  bool complete() const {
    if (!begun_) return false;
    for (size_t i = 0; i < answer_.images.size(); ++i)
      if (answer_.images[i].size() != answer_.reply.images(int(i)).bytes()) return false;
    return true;
  }
  Status verify() const {
    if (!complete()) return lost("pictures are incomplete");
    for (size_t i = 0; i < answer_.images.size(); ++i) {
      const v1::ImageDescriptor& image = answer_.reply.images(int(i));
      if (hashBytes(answer_.images[i].data(), answer_.images[i].size()).hex() != image.digest()) return lost("digest of " + image.output());
    }
    return {};
  }
  Answer& answer() { return answer_; }

 private:
  Answer answer_;
  bool begun_ = false;
};

}  // namespace

Result<Answer> receive(Session& session, Session::Call& call, grpc::ClientReader<v1::RenderEvent>& reader, const StreamHooks& hooks) {
  Assembly assembly;
  bool final = false, snapshotOpen = false;
  v1::RenderEvent event;
  Status fault;
  while (fault.ok() && reader.Read(&event)) {
    switch (event.event_case()) {
      case v1::RenderEvent::kProgress:
        if (hooks.progress) hooks.progress(event.progress());
        break;
      case v1::RenderEvent::kSnapshot:
        fault = assembly.begin(event.snapshot());
        snapshotOpen = true;
        break;
      case v1::RenderEvent::kReply:
        fault = assembly.begin(event.reply());
        final = true;
        snapshotOpen = false;
        break;
      case v1::RenderEvent::kChunk: fault = assembly.add(event.chunk()); break;
      default: break;  // events of later versions
    }
    if (fault.ok() && snapshotOpen && assembly.complete()) {
      snapshotOpen = false;
      fault = assembly.verify();
      if (fault.ok() && hooks.snapshot) fault = hooks.snapshot(assembly.answer());
    }
  }
  if (!fault.ok()) {
    call.context.TryCancel();
    (void)reader.Finish();
    return fault;
  }
  GOBO_TRY(session.statusOf(reader.Finish()));
  if (!final) return lost("no reply");
  GOBO_TRY(assembly.verify());
  return std::move(assembly.answer());
}

Result<Answer> renderOnce(Session& session, const v1::RenderRequest& request, const StreamHooks& hooks) {
  Session::Call call(session);
  const bool progressive = hooks.progress || hooks.snapshot;
  auto reader = progressive ? session.render().RenderProgressive(&call.context, request) : session.render().Render(&call.context, request);
  return receive(session, call, *reader, hooks);
}

Result<v1::Encoding::Format> formatOf(const std::string& file) {
  std::string extension = fs::path(file).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (extension == ".exr") return v1::Encoding::EXR;
  if (extension == ".png") return v1::Encoding::PNG;
  if (extension == ".jpg" || extension == ".jpeg") return v1::Encoding::JPEG;
  if (extension == ".raw") return v1::Encoding::RAW_FLOAT;
  return invalidArgument("\"" + file + "\": the extension must be .exr, .png, .jpg or .raw");
}

Status checkFolder(const std::string& flag, const std::string& file) {
  const fs::path parent = fs::path(file).parent_path();
  std::error_code error;
  if (fs::is_directory(file, error)) return invalidArgument(flag + " " + file + ": is a folder");
  if (parent.empty() || fs::is_directory(parent, error)) return {};
  const bool there = fs::exists(parent, error);
  return notFound(flag + " " + file + (there ? ": \"" + parent.string() + "\" is no folder" : ": no such folder: \"" + parent.string() + "\""));
}

std::string fileFor(const std::string& out, const std::string& output, bool several) {
  if (!several) return out;
  std::string name = output;
  for (char& c : name)
    if (c == ':' || c == '/' || static_cast<unsigned char>(c) < 0x20) c = '-';
  const fs::path path(out);
  return (path.parent_path() / (path.stem().string() + "." + name + path.extension().string())).string();
}

Result<std::vector<std::string>> writeImages(const Answer& answer, const std::string& out) {
  std::vector<std::string> files;
  for (size_t i = 0; i < answer.images.size(); ++i) {
    files.push_back(fileFor(out, answer.reply.images(int(i)).output(), answer.images.size() > 1));
    GOBO_TRY(writeFileAtomic(files.back(), answer.images[i].data(), answer.images[i].size()));
  }
  return files;
}

Result<Image> rawImage(const Answer& answer, size_t index) {
  if (index >= answer.images.size()) return lost("image " + std::to_string(index) + " is missing");
  const v1::ImageDescriptor& d = answer.reply.images(int(index));
  const uint64_t want = uint64_t(d.width()) * d.height() * uint64_t(d.channels_size()) * 4;
  if (d.format() != v1::Encoding::RAW_FLOAT || d.width() > 65536 || d.height() > 65536 || answer.images[index].size() != want)
    return lost("image " + d.output() + " is not raw float of its size");
  Image image(int(d.width()), int(d.height()), d.channels_size());
  image.names.assign(d.channels().begin(), d.channels().end());
  std::memcpy(image.data.data(), answer.images[index].data(), want);
  return image;
}

}  // namespace gobo::cli
