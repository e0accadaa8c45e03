// SPDX-License-Identifier: Apache-2.0
// Internal to the glTF reader: textures on demand.
#pragma once

#include <map>

#include "base/image_io.h"
#include "import/gltf/document.h"
#include "scene/texture_seal.h"

namespace gobo::gltf {

class Textures {
 public:
  Textures(Document& document, Scene& scene) : document_(document), scene_(scene), decoded_(document.images.size()) {}
  /// The TextureRef of a textureInfo object; none if absent or if its picture cannot be read (a warning says why).
  TextureRef ref(const Cursor& info, bool srgb);
  /// A texture whose green is 1 - gloss * alpha of the given one.
  TextureRef roughnessFromGloss(const Cursor& info, float gloss);

  /// The finest level of a textureInfo's picture in linear RGB, sRGB decoded where it has 8 bits. False where there is none (a warning says why).
  bool picture(const Cursor& info, LightProfile& out);

 private:
  /// A picture as texels, RGBA: all its textures look at these, whatever their sampler and colour space.
  struct Texels {
    int width = 0, height = 0;
    Array<uint8_t> texels8;
    Array<float> texelsF;
    size_t repaired = 0;
  };
  struct Decoded {
    bool tried = false;
    std::shared_ptr<const Texels> texels;
  };
  const Texels* decode(int image);
  std::shared_ptr<const Texels> texelsOf(int index, const Image& image, bool floats);
  const Texels* pictureOf(const Cursor& texture, int& source);
  int make(int texture, bool srgb);
  Document& document_;
  Scene& scene_;
  std::vector<Decoded> decoded_;
  std::map<Hash128, int> sameBytes_;  ///< pictures that could be read, by their encoded bytes
  std::map<std::pair<int, bool>, int> made_;
  std::map<std::pair<int, float>, int> glossy_;
  TextureSealer sealer_;
};

}  // namespace gobo::gltf
