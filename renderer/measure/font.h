// SPDX-License-Identifier: Apache-2.0
// A 5 x 7 bitmap font for printable ASCII, drawn for this project: labels of plots without a font library.
#pragma once

#include <cstdint>

namespace gobo {
inline namespace measure {

inline constexpr int kGlyphWidth = 5, kGlyphHeight = 7, kGlyphAdvance = 6;
/// Seven rows, top first, bit 4 leftmost. Other characters than 0x20..0x7e give a box.
const uint8_t* glyphRows(char c);
/// Rows by which the glyph hangs below the base line, to be added to its position: 2 for g j p q y, else 0.
int glyphDescent(char c);

}  // namespace measure
}  // namespace gobo
