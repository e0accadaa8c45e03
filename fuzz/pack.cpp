// SPDX-License-Identifier: Apache-2.0
#include "fuzz/pack.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string_view>

namespace gobo::fuzz {
namespace {

namespace fs = std::filesystem;
constexpr std::string_view kMagic = "gobo fuzz pack 1\n";

std::vector<uint8_t> bytesOfFile(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

Result<Inputs> readPack(const std::string& path) {
  if (!fs::is_regular_file(path)) return notFound("no such pack", path);
  const std::vector<uint8_t> bytes = bytesOfFile(path);
  const auto wrong = [&](size_t at, const char* what) {
    return invalidArgument(std::string(what) + " at byte " + std::to_string(at) + " of " + std::to_string(bytes.size()), path);
  };
  if (bytes.size() < kMagic.size() || !std::equal(kMagic.begin(), kMagic.end(), bytes.begin())) return wrong(0, "no pack: its first line is another");
  Inputs out;
  for (size_t at = kMagic.size(); at < bytes.size();) {
    if (bytes.size() - at < 4) return wrong(at, "a length is cut off");
    const size_t size = size_t(bytes[at]) | size_t(bytes[at + 1]) << 8 | size_t(bytes[at + 2]) << 16 | size_t(bytes[at + 3]) << 24;
    at += 4;
    if (size > bytes.size() - at) return wrong(at, "an input is cut off");
    out.emplace_back(bytes.begin() + std::ptrdiff_t(at), bytes.begin() + std::ptrdiff_t(at + size));
    at += size;
  }
  return out;
}

Status writePack(const std::string& path, Inputs inputs) {
  std::sort(inputs.begin(), inputs.end());
  inputs.erase(std::unique(inputs.begin(), inputs.end()), inputs.end());
  std::string bytes(kMagic);
  for (const auto& input : inputs) {
    for (int shift = 0; shift < 32; shift += 8) bytes += char(input.size() >> shift & 255);
    bytes.append(input.begin(), input.end());
  }
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), std::streamsize(bytes.size()));
  out.close();
  return out ? Status() : internalError("cannot be written", path);
}

Inputs readInputs(const std::string& folderOrFile, size_t mostBytes) {
  std::vector<fs::path> files;
  std::error_code error;
  if (fs::is_regular_file(folderOrFile, error)) files.push_back(folderOrFile);
  for (auto it = fs::recursive_directory_iterator(folderOrFile, error); !error && it != fs::recursive_directory_iterator(); it.increment(error))
    if (it->is_regular_file()) files.push_back(it->path());
  std::sort(files.begin(), files.end());
  Inputs out;
  for (const fs::path& file : files) {
    Inputs held;
    if (file.extension() == ".pack") {
      if (auto pack = readPack(file.string()); pack.ok()) held = std::move(*pack);
    } else if (fs::file_size(file, error) <= mostBytes) held.push_back(bytesOfFile(file));
    for (auto& input : held)
      if (input.size() <= mostBytes) out.push_back(std::move(input));
  }
  return out;
}

}  // namespace gobo::fuzz
