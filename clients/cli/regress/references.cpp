// SPDX-License-Identifier: Apache-2.0
#include "regress/references.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <filesystem>

#include <nlohmann/json.hpp>

#include "base/image_io.h"
#include "regress/record.h"
#include "server/encode.h"

namespace gobo::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// One process at a time changes the log. Gone with the process, whatever ends it.
class Lock {
 public:
  explicit Lock(const std::string& path) : fd_(::open(path.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0644)) {
    if (fd_ >= 0 && ::flock(fd_, LOCK_EX) != 0) ::close(fd_), fd_ = -1;
  }
  ~Lock() {
    if (fd_ >= 0) ::close(fd_);
  }
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;
  bool held() const { return fd_ >= 0; }

 private:
  int fd_;
};

bool isDigest(const std::string& text) { return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == std::string::npos; }

Status makeFolder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return internalError("cannot make the folder: " + error.message(), folder.string());
  return {};
}

}  // namespace

std::string References::objectPath(const std::string& digest) const {
  return (fs::path(folder_) / "objects" / digest.substr(0, 2) / (digest + ".exr")).string();
}
std::string References::logPath() const { return (fs::path(folder_) / "accepted.jsonl").string(); }

Result<std::vector<Accepted>> References::log() const {
  std::vector<Accepted> out;
  std::error_code error;
  if (!fs::exists(logPath(), error)) return out;
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, readFile(logPath(), 1 << 28));
  const std::string text(bytes.begin(), bytes.end());
  int line = 0;
  for (size_t begin = 0; begin < text.size();) {
    ++line;
    const size_t end = std::min(text.find('\n', begin), text.size());
    const std::string row = text.substr(begin, end - begin);
    begin = end + 1;
    if (row.empty()) continue;
    const std::string place = logPath() + ":" + std::to_string(line) + ": ";
    try {
      const Json j = Json::parse(row);
      Accepted a;
      a.name = j.at("case").get<std::string>();
      a.digest = j.at("digest").get<std::string>();
      a.by = j.at("by").get<std::string>();
      a.why = j.at("why").get<std::string>();
      a.when = j.at("when").get<std::string>();
      a.facts = factsFromJson(j.at("render").dump());
      if (!isDigest(a.digest)) return invalidArgument(place + "digest \"" + a.digest + "\" is no SHA-256");
      out.push_back(std::move(a));
    } catch (const std::exception& e) { return invalidArgument(place + e.what()); }
  }
  return out;
}

Result<std::map<std::string, Accepted>> References::accepted() const {
  GOBO_ASSIGN(std::vector<Accepted> all, log());
  std::map<std::string, Accepted> out;
  for (Accepted& a : all) out[a.name] = std::move(a);
  return out;
}

Status References::accept(Accepted entry, const std::vector<uint8_t>& bytes) {
  entry.digest = sha256Hex(bytes.data(), bytes.size());
  const std::string object = objectPath(entry.digest);
  GOBO_TRY(makeFolder(fs::path(object).parent_path()));
  const Lock lock((fs::path(folder_) / ".lock").string());
  if (!lock.held()) return internalError("cannot lock the references", folder_);
  std::error_code error;
  // The object first: no line without one. One that is there may be damaged, or a pointer to what was never fetched.
  const auto there = fs::exists(object, error) ? readFile(object) : Result<std::vector<uint8_t>>(notFound(object));
  if (!there.ok() || *there != bytes) GOBO_TRY(writeFileAtomic(object, bytes.data(), bytes.size()));
  std::string text;
  if (fs::exists(logPath(), error)) {
    GOBO_ASSIGN(const std::vector<uint8_t> before, readFile(logPath(), 1 << 28));
    text.assign(before.begin(), before.end());
    if (!text.empty() && text.back() != '\n') text += '\n';
  }
  const Json j = {{"case", entry.name}, {"digest", entry.digest}, {"by", entry.by},
                  {"why", entry.why},   {"when", entry.when},     {"render", Json::parse(factsToJson(entry.facts))}};
  text += j.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  return writeFileAtomic(logPath(), text.data(), text.size());
}

Result<std::vector<Image>> References::parts(const Accepted& entry) const {
  const std::string path = objectPath(entry.digest);
  std::error_code error;
  if (!fs::exists(path, error)) return notFound("the reference of case \"" + entry.name + "\" is not there: \"" + path + "\"");
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, readFile(path));
  if (sha256Hex(bytes.data(), bytes.size()) != entry.digest)
    return Status(Code::DataLoss, "the reference of case \"" + entry.name + "\" has other bytes than its name says", path);
  return decodeParts(bytes, path, entry.facts.parts);
}

Result<std::vector<uint8_t>> encodeParts(const std::vector<Image>& parts) {
  std::vector<ExrLayer> layers;
  static const std::vector<std::string> names[] = {{"Y"}, {"R", "G", "B"}, {"R", "G", "B", "A"}};
  std::vector<std::vector<float>> pixels(parts.size());
  for (size_t k = 0; k < parts.size(); ++k) {
    const Image& image = parts[k];
    if (image.channels != 1 && image.channels != 3 && image.channels != 4)
      return invalidArgument("part " + std::to_string(k) + " has " + std::to_string(image.channels) + " channels: must have 1, 3 or 4");
    pixels[k] = image.data;
    layers.push_back({"part" + std::to_string(k), names[image.channels == 1 ? 0 : image.channels - 2], pixels[k], true, true});
  }
  if (parts.empty()) return invalidArgument("no parts");
  return encodeExr(parts[0].width, parts[0].height, layers);
}

Result<std::vector<Image>> decodeParts(const std::vector<uint8_t>& bytes, const std::string& name, uint32_t count) {
  std::vector<Image> parts;
  for (uint32_t k = 0; k < count; ++k) {
    GOBO_ASSIGN(Image image, readExrLayer(bytes.data(), bytes.size(), name, "part" + std::to_string(k)));
    parts.push_back(std::move(image));
  }
  return parts;
}

std::vector<std::string> planDifference(const std::vector<std::string>& before, const std::vector<std::string>& now) {
  std::vector<std::string> out;
  for (const std::string& n : now)
    if (std::find(before.begin(), before.end(), n) == before.end()) out.push_back("+ " + n);
  for (const std::string& n : before)
    if (std::find(now.begin(), now.end(), n) == now.end()) out.push_back("- " + n);
  return out;
}

std::string timeNow() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  return std::string(text, std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc));
}

}  // namespace gobo::cli
