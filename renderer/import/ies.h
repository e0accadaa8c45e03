// SPDX-License-Identifier: Apache-2.0
// IES LM-63 photometric files (1986, 1991, 1995, 2002, 2019): type C photometry, TILT=NONE or TILT=INCLUDE, whose table is for lamps that hang
// another way than they were measured and is left aside. Horizontal angles may stop at 0 (the same all round), 90 (four quadrants), 180 (two halves)
// or go round, and from 90 to 270 (two halves, LM-63-1995); they become a whole turn. Types A and B are refused.
#pragma once

#include <string>
#include <string_view>

#include "scene/light_profile.h"

namespace gobo {
inline namespace imports {

struct IesPhotometry {
  LightProfilePtr profile;  ///< relative to the largest value; sealed
  double candela = 0;       ///< that value, multiplier and ballast factors in; 0: all of it is black
};

/// `name` becomes the profile's. Errors: InvalidArgument that names what is wrong, the number's place and its value.
Result<IesPhotometry> readIes(std::string_view text, const std::string& name);

}  // namespace imports
}  // namespace gobo
