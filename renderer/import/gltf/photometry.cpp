// SPDX-License-Identifier: Apache-2.0
// The IES files that a document names: in `extras.gobo_light.ies` of a KHR_lights_punctual light and in EXT_lights_ies. Read while the document
// is opened, since the files beside it can be read then alone; unlike a picture, one that is missing is an error, because brightness is in it.
#include "import/gltf/container.h"

namespace gobo::gltf {
namespace {

/// The text that `at` names: "uri" or "bufferView", or "text" in place. Sticky errors.
Status readPhotometryOf(Document& d, const Cursor& at) {
  const Cursor uri = at["uri"], view = at["bufferView"], text = at["text"];
  if (int(uri.exists()) + int(view.exists()) + int(text.exists()) != 1) at.fail("has to have one of uri, bufferView and text");
  if (!d.ok()) return d.status;
  std::vector<uint8_t> bytes;
  std::string name = at["name"].text();
  Cursor from = at;
  if (text.exists()) {
    const std::string inside = text.text();
    bytes.assign(inside.begin(), inside.end());
    from = text;
  } else if (uri.exists()) {
    const std::string place = uri.text();
    from = uri;
    if (!d.ok()) return d.status;
    if (isDataUri(place)) {
      auto data = decodeDataUri(place);
      if (!data.ok()) return data.status().at(d.path + "#" + uri.pointer);
      bytes = std::move(data->bytes);
    } else {
      GOBO_TRY(readNamed(d, uri, bytes));
      if (name.empty()) name = place;
    }
  } else {
    ViewBytes found;
    from = view;
    const int index = view.index("bufferViews");
    if (!d.ok() || !viewBytes(d, index, found)) return d.status;
    bytes.assign(found.data, found.data + found.size);
  }
  if (!d.account(bytes.size(), from) || !d.ok()) return d.status;
  d.files->parsing(from.pointer);
  auto read = readIes({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, name);
  d.files->parsing("");
  if (!read.ok()) {
    from.fail(read.status().message());
    return d.status;
  }
  if (!d.account(profileBytes(*read->profile), from)) return d.status;
  d.photometry.emplace(at.pointer, std::move(*read));
  return {};
}

}  // namespace

Status readPhotometry(Document& d) {
  const Cursor punctual = d.root().extension("KHR_lights_punctual")["lights"], measured = d.root().extension("EXT_lights_ies")["lights"];
  for (size_t i = 0; i < punctual.size() && d.ok(); ++i) {
    const Cursor ies = goboLight(punctual.at(i))["ies"];
    if (ies.exists()) GOBO_TRY(readPhotometryOf(d, ies));
  }
  for (size_t i = 0; i < measured.size() && d.ok(); ++i) GOBO_TRY(readPhotometryOf(d, measured.at(i)));
  return d.status;
}

}  // namespace gobo::gltf
