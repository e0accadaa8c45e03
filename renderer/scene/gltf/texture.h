// SPDX-License-Identifier: Apache-2.0
// Internal to the glTF reader: textures on demand.
#pragma once

#include <map>

#include "base/image_io.h"
#include "scene/gltf/document.h"

namespace gobo::gltf {

class Textures {
 public:
  Textures(Document& document, Scene& scene) : document_(document), scene_(scene), decoded_(document.images.size()) {}
  /// The TextureRef of a textureInfo object; none if absent or if its picture cannot be read (a warning says why).
  TextureRef ref(const Cursor& info, bool srgb);
  /// A texture whose green is 1 - gloss * alpha of the given one.
  TextureRef roughnessFromGloss(const Cursor& info, float gloss);

 private:
  struct Decoded { bool tried = false, floats = false; Image image; };
  const Image* decode(int image);
  const Image* pictureOf(const Cursor& texture, int& source);
  int make(int texture, bool srgb);
  Document& document_;
  Scene& scene_;
  std::vector<Decoded> decoded_;
  std::map<std::pair<int, bool>, int> made_;
};

}  // namespace gobo::gltf
