// SPDX-License-Identifier: Apache-2.0
// A corpus as one file (tests/data/fuzz/corpus/TARGET.pack): a line of magic, then each input with its length before it, as 4 bytes, low first. In the order
// of the bytes, so that one set of inputs is one file.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo::fuzz {

using Inputs = std::vector<std::vector<uint8_t>>;

/// Errors: NotFound; InvalidArgument that names the file and the byte where it is no pack.
Result<Inputs> readPack(const std::string& path);
/// Sorted and each once. Errors: Internal that names the file.
Status writePack(const std::string& path, Inputs inputs);
/// Every file below the folder, packs unpacked, of at most `mostBytes` each, in the order of their paths; a file that is named is that file. Nothing where it
/// does not exist.
Inputs readInputs(const std::string& folderOrFile, size_t mostBytes);

}  // namespace gobo::fuzz
