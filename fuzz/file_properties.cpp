// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "base/image_io.h"
#include "base/utf8.h"
#include "fuzz/properties.h"
#include "import/load.h"
#include "tests/support/blob_bytes.h"

namespace gobo::fuzz {
namespace {

constexpr char kFile[] = "fuzz.gltf", kPicture[] = "fuzz.picture";

class OneFile final : public FileSource {
 public:
  explicit OneFile(Bytes bytes) : bytes_(bytes) {}
  Result<std::vector<uint8_t>> main(uint64_t) override { return std::vector<uint8_t>(bytes_.begin(), bytes_.end()); }
  Result<std::vector<uint8_t>> beside(const std::string& name, uint64_t) override {  // as openBeside says it
    GOBO_TRY(checkSideName(name, name));
    return notFound("file \"" + name + "\" does not exist beside the glTF");
  }

 private:
  Bytes bytes_;
};

}  // namespace

Outcome tryGltf(Bytes bytes) {
  OneFile files(bytes);
  LoadOptions options;
  options.files = &files;
  options.maxTriangles = 1 << 18;
  options.maxBytes = 64 << 20;
  options.textureBytes = 1 << 20;
  Outcome out;
  const auto scene = loadGltf(kFile, options);
  if (!scene.ok()) {
    out.said = scene.status().toString();
    out.broken = brokenStatus(scene.status(), kFile);
    return out;
  }
  out.accepted = true;
  out.broken = brokenValues(**scene);
  if (out.broken.empty()) out.broken = brokenBlob(**scene);
  if (out.broken.empty()) out.broken = brokenPoses(*scene);
  return out;
}

Outcome tryImage(Bytes bytes) {
  Outcome out;
  const ReadLimits limits{4096, 1 << 22};
  const auto image = readImageFromMemory(bytes.data(), bytes.size(), kPicture, limits);
  if (!image.ok()) {
    out.said = image.status().toString();
    out.broken = brokenStatus(image.status(), kPicture);
    return out;  // the environment's reader is the same, with wider limits
  }
  out.accepted = true;
  if (image->width <= 0 || image->height <= 0 || image->channels <= 0 || image->data.size() != image->pixels() * size_t(image->channels) ||
      (!image->names.empty() && image->names.size() != size_t(image->channels))) {
    out.broken = "size, channels and pixels disagree";
    return out;
  }
  const auto map = readEnvironment(bytes.data(), bytes.size(), kPicture);
  if (!map.ok()) {
    out.broken = brokenStatus(map.status(), kPicture);
    return out;
  }
  for (const Vec3& t : (*map)->texels)
    if (!isFinite(t) || t.x < 0 || t.y < 0 || t.z < 0) {
      out.broken = "a texel is not finite and >= 0";
      return out;
    }
  const auto [owner, view] = blobOf(**map).aligned();
  if (const auto back = readEnvironmentBlob(owner, view, BlobTrust::Foreign); !back.ok()) out.broken = "its blob is refused: " + back.status().toString();
  else if ((*back)->content != (*map)->content) out.broken = "its blob has another digest";
  return out;
}

}  // namespace gobo::fuzz
