// SPDX-License-Identifier: Apache-2.0
// Where a view lies in the picture that it is a part of. What is drawn by chance for a pixel is drawn by its place in the whole picture, so that a part
// has the bits that it has there.
#pragma once

#include "base/hash.h"
#include "terms/term.h"

namespace gobo {
inline namespace terms {

struct ViewPlace {
  int x = 0, y = 0, filmWidth = 0, filmHeight = 0;  ///< 0 x 0: the view is the whole picture
  bool whole() const { return filmWidth == 0; }
  /// A whole view says nothing: keys of before hold.
  void hash(Hasher& h) const {
    if (!whole()) h.add("window").add(x).add(y).add(filmWidth).add(filmHeight);
  }
};

/// The element of the whole picture that an element of a view-sample domain is.
class FilmElements {
 public:
  FilmElements(const Extent& view, const ViewPlace& place) : view_(view), place_(place) {}
  size_t operator()(size_t e) const {
    if (place_.whole()) return e;
    const size_t row = e / size_t(view_.width), x = e % size_t(view_.width), y = row % size_t(view_.height), layer = row / size_t(view_.height);
    return (layer * size_t(place_.filmHeight) + y + size_t(place_.y)) * size_t(place_.filmWidth) + x + size_t(place_.x);
  }

 private:
  Extent view_;
  ViewPlace place_;
};

}  // namespace terms
}  // namespace gobo
