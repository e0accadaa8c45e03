// SPDX-License-Identifier: Apache-2.0
// Pictures into textures: one decode and one texel array per picture (images with the same bytes are one), one Texture per (glTF
// texture, colour or data) that looks at it. A picture that cannot be read leaves its texture out with a warning; NaN, Inf texels
// of float pictures become 0 and are counted.
#include "import/gltf/texture.h"

#include "base/transfer.h"
#include "import/gltf/container.h"

#include <cmath>

namespace gobo::gltf {
namespace {

Wrap wrapOf(int64_t mode) { return mode == 33071 ? Wrap::Clamp : mode == 33648 ? Wrap::Mirror : Wrap::Repeat; }

bool isFloatFormat(const std::vector<uint8_t>& b) {
  return b.size() > 4 && ((b[0] == 0x76 && b[1] == 0x2f && b[2] == 0x31 && b[3] == 0x01) || (b[0] == '#' && b[1] == '?'));
}

}  // namespace

const Textures::Texels* Textures::decode(int index) {
  if (decoded_[index].tried) return decoded_[index].texels.get();
  decoded_[index].tried = true;
  auto& encoded = document_.images[index];
  const std::string place = "/images/" + std::to_string(index);
  auto leaveOut = [&](const std::string& why) {
    document_.warn(place, "picture \"" + encoded.name + "\" is left out: " + why);
    return nullptr;
  };
  if (!encoded.problem.empty()) return nullptr;  // said when the file was opened
  const std::string kind = pictureKind(encoded.bytes);
  if (kind == "image/ktx2" || kind == "image/ktx" || kind == "image/basis")
    return leaveOut("it is " + kind.substr(6) + " (Basis Universal or GPU blocks), which is not decoded");
  const Hash128 digest = hashBytes(encoded.bytes.data(), encoded.bytes.size());
  const auto same = sameBytes_.find(digest);
  if (same != sameBytes_.end()) decoded_[index].texels = decoded_[same->second].texels;
  else {
    if (document_.options.files) document_.options.files->parsing(place);  // picture libraries are where files bite
    ReadLimits limits;
    limits.stop = document_.options.stop;
    auto image = readImageFromMemory(encoded.bytes.data(), encoded.bytes.size(), encoded.name.empty() ? "image" + std::to_string(index) : encoded.name, limits);
    if (document_.options.files) document_.options.files->parsing("");  // whatever became of it: what comes next is not its fault
    if (image.status().code() == Code::Cancelled) {
      document_.status = image.status();
      return nullptr;
    }
    if (!image.ok()) return leaveOut(image.status().message());
    const uint64_t decodedBytes = image->data.size() * sizeof(float);
    if (!document_.account(decodedBytes, document_.item("images", index))) return nullptr;
    decoded_[index].texels = texelsOf(index, *image, isFloatFormat(encoded.bytes));
    if (!decoded_[index].texels) return nullptr;
    document_.bytesUsed -= decodedBytes;  // the floats go now
    sameBytes_[digest] = index;
  }
  if (const size_t n = decoded_[index].texels->repaired) document_.warn(place, std::to_string(n) + " texels were not finite and are 0 now");
  return decoded_[index].texels.get();
}

std::shared_ptr<const Textures::Texels> Textures::texelsOf(int index, const Image& image, bool floats) {
  const size_t values = image.pixels() * 4;
  if (!document_.account(values * (floats ? 4 : 1), document_.item("images", index))) return nullptr;
  auto out = std::make_shared<Texels>();
  out->width = image.width;
  out->height = image.height;
  std::vector<float> texelsF(floats ? values : 0);
  std::vector<uint8_t> texels8(floats ? 0 : values);
  for (size_t i = 0; i < image.pixels(); ++i) {
    if (i % (1 << 16) == 0 && document_.options.stop.stopRequested()) {
      document_.status = Status(Code::Cancelled, "the load was cancelled", document_.path);
      return nullptr;
    }
    const float* p = image.data.data() + i * size_t(image.channels);
    const int n = image.channels;
    float rgba[4] = {p[0], n >= 3 ? p[1] : p[0], n >= 3 ? p[2] : p[0], n == 2 ? p[1] : n >= 4 ? p[3] : 1.0f};
    bool bad = false;
    for (int c = 0; c < 4; ++c) {
      if (!std::isfinite(rgba[c])) {
        rgba[c] = c == 3 ? 1.0f : 0.0f;
        bad = true;
      }
      if (floats) texelsF[i * 4 + c] = rgba[c];
      else texels8[i * 4 + c] = uint8_t(clamp01(rgba[c]) * 255.0f + 0.5f);
    }
    out->repaired += bad;
  }
  out->texels8 = std::move(texels8);
  out->texelsF = std::move(texelsF);
  return out;
}

TextureRef Textures::ref(const Cursor& info, bool srgb) {
  TextureRef ref;
  if (!info.exists()) return ref;
  if (!info["index"].exists()) info["index"].fail("index is missing");
  const int index = info["index"].index("textures");
  ref.texcoord = int(info["texCoord"].integer(0, 0, 1 << 20));
  const Cursor transform = info.extension("KHR_texture_transform");
  ref.offset = transform["offset"].vector(Vec2(0.0f));
  ref.scale = transform["scale"].vector(Vec2(1.0f));
  ref.rotation = float(transform["rotation"].number(0.0));
  ref.texcoord = int(transform["texCoord"].integer(ref.texcoord, 0, 1 << 20));
  if (index < 0 || !document_.ok()) return {};
  if (ref.texcoord >= kUvSets) {
    document_.warn(info.pointer, "texture coordinate set " + std::to_string(ref.texcoord) + " is not supported; set 0 is used");
    ref.texcoord = 0;
  }
  const auto key = std::pair(index, srgb);
  const auto known = made_.find(key);
  ref.texture = known != made_.end() ? known->second : (made_[key] = make(index, srgb));
  return ref.texture < 0 ? TextureRef{} : ref;
}

/// The texture's picture: WebP where the file offers it and it can be read, else the plain one.
const Textures::Texels* Textures::pictureOf(const Cursor& texture, int& source) {
  const int webp = texture.extension("EXT_texture_webp")["source"].index("images"), plain = texture["source"].index("images");
  const bool basis = texture.extension("KHR_texture_basisu").exists();
  if (!document_.ok()) return nullptr;
  for (const int candidate : {webp, plain}) {
    if (candidate < 0) continue;
    source = candidate;
    if (const Texels* texels = decode(candidate)) {
      if (basis) document_.warn(texture.pointer + "/extensions/KHR_texture_basisu", "KTX2 pictures are not read; the fallback is used");
      return texels;
    }
  }
  if (webp < 0 && plain < 0)
    document_.warn(texture.pointer,
                   basis ? "KTX2 pictures (KHR_texture_basisu) are not read and there is no fallback" : "texture has no picture in a supported format");
  return nullptr;
}

TextureRef Textures::roughnessFromGloss(const Cursor& info, float gloss) {
  TextureRef made = ref(info, false);
  if (!made.valid()) return made;
  const auto key = std::pair(made.texture, gloss);
  if (const auto known = glossy_.find(key); known != glossy_.end()) {
    made.texture = known->second;
    return made;
  }
  auto t = std::make_shared<Texture>(*scene_.textures[made.texture]);
  if (!document_.account(t->texels8.size() + t->texelsF.size() * 4, info)) return {};
  for (size_t i = 0; i + 3 < t->texels8.size(); i += 4) t->texels8[i + 1] = uint8_t(255.0f - gloss * float(t->texels8[i + 3]) + 0.5f);
  for (size_t i = 0; i + 3 < t->texelsF.size(); i += 4) t->texelsF[i + 1] = 1.0f - gloss * clamp01(t->texelsF[i + 3]);
  sealTexture(*t);
  scene_.textures.push_back(std::move(t));
  made.texture = glossy_[key] = int(scene_.textures.size() - 1);
  return made;
}

bool Textures::picture(const Cursor& info, LightProfile& out) {
  if (!info["index"].exists()) info["index"].fail("index is missing");
  const int index = info["index"].index("textures");
  int source = -1;
  const Texels* texels = index < 0 || !document_.ok() ? nullptr : pictureOf(document_.item("textures", index), source);
  if (!texels || !document_.ok()) return false;
  const size_t n = size_t(texels->width) * size_t(texels->height);
  if (texels->width > kLargestProfileSide || texels->height > kLargestProfileSide) {
    info["index"].fail("picture of " + std::to_string(texels->width) + " x " + std::to_string(texels->height) + " is larger than " +
                       std::to_string(kLargestProfileSide) + " texels a side");
    return false;
  }
  if (!document_.account(n * sizeof(Vec3), info)) return false;
  float linear[256];
  for (int i = 0; i < 256; ++i) linear[i] = float(decodeTransfer(Transfer::Srgb, i / 255.0));
  std::vector<Vec3> values(n);
  for (size_t i = 0; i < n; ++i)
    for (int c = 0; c < 3; ++c) values[i][c] = texels->texelsF.empty() ? linear[texels->texels8[4 * i + size_t(c)]] : texels->texelsF[4 * i + size_t(c)];
  out.name = document_.images[source].name;
  out.kind = ProfileKind::Picture;
  out.width = texels->width;
  out.height = texels->height;
  out.values = std::move(values);
  return true;
}

int Textures::make(int index, bool srgb) {
  const Cursor texture = document_.item("textures", index);
  const int sampler = texture["sampler"].index("samplers");
  int source = -1;
  const Texels* texels = pictureOf(texture, source);
  if (!texels || !document_.ok()) return -1;
  auto t = std::make_shared<Texture>();
  t->name = document_.images[source].name;
  t->width = texels->width;
  t->height = texels->height;
  if (sampler >= 0) {
    const Cursor s = document_.item("samplers", sampler);
    t->wrapU = wrapOf(s["wrapS"].integer(10497, 0, 1 << 20));
    t->wrapV = wrapOf(s["wrapT"].integer(10497, 0, 1 << 20));
    t->nearest = s["magFilter"].integer(9729, 0, 1 << 20) == 9728;
  }
  t->srgb = srgb && texels->texelsF.empty();
  t->texels8 = texels->texels8;
  t->texelsF = texels->texelsF;
  sealer_.seal(*t);
  scene_.textures.push_back(std::move(t));
  return int(scene_.textures.size() - 1);
}

}  // namespace gobo::gltf
