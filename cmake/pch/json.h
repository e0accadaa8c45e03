// SPDX-License-Identifier: Apache-2.0
// The standard set and the JSON reader that the glTF files share.
#pragma once

#include <nlohmann/json.hpp>

#include "pch/standard.h"
