// SPDX-License-Identifier: Apache-2.0
// What nearly every file of the renderer includes and hardly anybody edits, compiled once a layer. Files still include what they use:
// a build with CMAKE_DISABLE_PRECOMPILE_HEADERS=ON must pass too.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <string>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/status.h"
#include "base/vec.h"
