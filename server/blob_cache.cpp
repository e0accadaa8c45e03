// SPDX-License-Identifier: Apache-2.0
#include "server/blob_cache.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "base/descriptor.h"
#include "base/image_io.h"
#include "base/own_folder.h"
#include "server/encode.h"
#include "server/log.h"
#include "server/random_hex.h"
#include "server/scratch.h"

namespace gobo {
inline namespace server {
namespace {

namespace fs = std::filesystem;
constexpr const char* kTemporary = ".tmp-";
constexpr const char* kWhat = "blob cache";
constexpr int kMostNames = 8;          // that begin() tries
constexpr size_t kSmallFiles = 20000;  // .files and .stamp

bool endsWith(const std::string& text, std::string_view tail) {
  return text.size() >= tail.size() && text.compare(text.size() - tail.size(), tail.size(), tail) == 0;
}

Status failed(const std::string& what) {
  return Status(errno == ENOSPC || errno == EDQUOT ? Code::ResourceExhausted : Code::Internal, what + ": " + std::strerror(errno));
}

std::optional<std::string> smallFile(const std::string& path) {
  auto bytes = readFile(path, 16 << 20);
  if (!bytes.ok()) return std::nullopt;
  return std::string(bytes->begin(), bytes->end());
}

/// By rename, without a flush: what a power cut leaves of such a file does not have its form, and is written again.
void writeSmall(const std::string& path, const std::string& text) {
  static std::atomic<uint64_t> counter{0};
  const std::string temporary = path + "-" + std::to_string(::getpid()) + "-" + std::to_string(counter++) + ".stamp";
  const int fd = ::open(temporary.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (fd < 0) return;  // it costs the next load a digest; commit() has said what is wrong
  const bool whole = ::write(fd, text.data(), text.size()) == ssize_t(text.size());
  ::close(fd);
  if (!whole || ::rename(temporary.c_str(), path.c_str()) != 0) ::unlink(temporary.c_str());
}

/// Their keys are of another build, so nobody looks them up: they wait for trim(), which takes the least recently used first.
void sayOtherFormats(const std::string& folder) {
  std::string first;
  size_t count = 0;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string path = it->path().string();
    if (!endsWith(path, ".blob")) continue;
    const Descriptor fd{::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW)};
    std::array<uint8_t, kBlobHeaderBytes> header{};
    if (!fd || ::pread(fd.get(), header.data(), header.size(), 0) != ssize_t(header.size())) continue;
    const std::string why = otherBlobFormat(header);
    if (!why.empty() && ++count == 1) first = path + ": " + why;
  }
  if (count) logWarn("blob cache: %s; %zu such, set aside: scenes are read again, and they go as the least recently used", first.c_str(), count);
}

}  // namespace

std::string blobKeyHex(const BlobKey& key) {
  static const char* digits = "0123456789abcdef";
  std::string out;
  for (const uint8_t b : key) {
    out += digits[b >> 4];
    out += digits[b & 15];
  }
  return out;
}

BlobKey blobKeyOf(const std::string& hex) {
  BlobKey key{};
  const auto digit = [](char c) { return uint8_t(c <= '9' ? c - '0' : c - 'a' + 10); };
  for (size_t i = 0; i < key.size() && 2 * i + 1 < hex.size(); ++i) key[i] = uint8_t(digit(hex[2 * i]) << 4 | digit(hex[2 * i + 1]));
  return key;
}

Result<std::unique_ptr<BlobCache>> BlobCache::open(const std::string& folder, uint64_t maxBytes) {
  // Blobs in it are trusted: whoever can write there can make the daemon read what it has not checked.
  GOBO_TRY(makeOwnFolder(folder, kWhat));
  if (::access(folder.c_str(), W_OK | X_OK) != 0) return ioError("blob cache: cannot write to the folder", folder);
  std::error_code error;
  std::unique_ptr<BlobCache> cache(new BlobCache(folder, maxBytes));
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::string path = it->path().string();
    if (it->path().filename().string().rfind(kTemporary, 0) != 0) continue;
    if (const Descriptor fd = lockAbandonedFile(path); fd) ::unlink(path.c_str());
  }
  sayOtherFormats(folder);
  cache->trim("");
  return cache;
}

Result<std::shared_ptr<const MappedFile>> BlobCache::find(const BlobKey& key, const StopToken& stop) const {
  const std::string path = file(key, ".blob");
  const Descriptor d{::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW)};
  struct stat info {};
  if (!d || ::fstat(d.get(), &info) != 0) return std::shared_ptr<const MappedFile>();
  std::shared_ptr<const MappedFile> mapped;
  {
    const std::lock_guard lock(mutex_);
    if (const auto it = mapped_.find(path); it != mapped_.end()) mapped = it->second.lock();
  }
  if (!mapped || !mapped->isOf(info) || mapped->bytes().size() != uint64_t(info.st_size) || !mapped->intact()) {
    auto made = MappedFile::map(d.get(), path);
    if (!made.ok()) return std::shared_ptr<const MappedFile>();
    mapped = std::move(*made);
  }
  const FileStamp stamp = FileStamp::of(info);
  const bool settled = stamp.settled();  // of before the reading
  bool known = false;
  {
    const std::lock_guard lock(mutex_);
    const auto it = checked_.find(path);
    known = it != checked_.end() && it->second == stamp;
    checks_ += !known;
  }
  if (!known) {
    GOBO_TRY(checkBlobArrays(mapped->bytes(), stop));
    const std::lock_guard lock(mutex_);
    if (settled) checked_[path] = stamp;
  }
  {
    const std::lock_guard lock(mutex_);
    rememberMapped(path, mapped);
  }
  const std::string used = file(key, ".used");
  if (::utimensat(AT_FDCWD, used.c_str(), nullptr, 0) != 0) Descriptor(::open(used.c_str(), O_CREAT | O_WRONLY | O_CLOEXEC | O_NOFOLLOW, 0600));
  return mapped;
}

void BlobCache::rememberMapped(const std::string& path, const std::shared_ptr<const MappedFile>& mapped) const {
  std::erase_if(mapped_, [](const auto& e) { return e.second.expired(); });
  mapped_[path] = mapped;
}

void BlobCache::discard(const MappedFile& mapped) const {
  std::error_code error;
  for (fs::directory_iterator it(folder_, error), end; !error && it != end; it.increment(error)) {
    const std::string path = it->path().string();
    struct stat info {};
    if (!endsWith(path, ".blob") || ::lstat(path.c_str(), &info) != 0 || !mapped.isOf(info)) continue;
    logWarn("blob %s is removed: %s", it->path().stem().c_str(), mapped.lost().message().c_str());
    drop(path);
  }
}

void BlobCache::drop(const std::string& blob) const {
  ::unlink(blob.c_str());
  ::unlink((blob.substr(0, blob.size() - 5) + ".used").c_str());
  const std::lock_guard lock(mutex_);
  checked_.erase(blob);
}

uint64_t BlobCache::checks() const {
  const std::lock_guard lock(mutex_);
  return checks_;
}

BlobCache::Temporary::~Temporary() {
  if (!committed_ && !path_.empty()) ::unlink(path_.c_str());
  if (fd_ >= 0) ::close(fd_);
}

Result<std::unique_ptr<BlobCache::Temporary>> BlobCache::begin() const {
  const std::string problem = "cannot write in the blob cache \"" + folder_ + "\"";
  for (int tries = 0; tries < kMostNames; ++tries) {
    const auto name = randomHex(16);  // and not the process's number: daemons in containers that share the folder have the same one
    if (!name) return failed(problem);
    const std::string path = folder_ + "/" + kTemporary + *name;
    std::unique_ptr<Temporary> t(new Temporary());
    t->fd_ = lockNewFile(path).release();
    if (t->fd_ >= 0) {
      t->path_ = path;  // from here on it goes with `t`
      return t;
    }
    if (errno != ENOENT && errno != EEXIST && errno != EWOULDBLOCK) return failed(problem);
    if (errno == ENOENT) GOBO_TRY(makeOwnFolder(folder_, kWhat));  // somebody removed the folder
  }
  return Status(Code::Unavailable, problem + ": none of its new files stays");
}

Status BlobCache::stamp(Temporary& t, const BlobKey& key) const {
  std::array<uint8_t, kBlobHeaderBytes> header;
  if (::pread(t.fd_, header.data(), header.size(), 0) != ssize_t(header.size())) return failed("cannot read the blob");
  header = withBlobKey(header, key);
  if (::pwrite(t.fd_, header.data(), header.size(), 0) != ssize_t(header.size())) return failed("cannot write the blob");
  t.stamped_ = true;
  return {};
}

Status BlobCache::commit(Temporary& t, const BlobKey& key, const std::shared_ptr<const MappedFile>& mapped) const {
  if (!t.stamped_) GOBO_TRY(stamp(t, key));
  if (::fsync(t.fd_) != 0) return failed("cannot write the blob");
  const std::string path = file(key, ".blob");
  if (::rename(t.path_.c_str(), path.c_str()) != 0) return failed("cannot rename the blob into place");
  t.committed_ = true;
  if (mapped) {
    const std::lock_guard lock(mutex_);
    rememberMapped(path, mapped);
  }
  const int folder = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder >= 0) {
    ::fsync(folder);
    ::close(folder);
  }
  trim(path);
  return {};
}

void BlobCache::trim(const std::string& keep) const {
  struct Item {
    std::string path;
    uint64_t bytes;
    int64_t used;
  };
  std::vector<Item> blobs, small;
  uint64_t total = 0;
  std::error_code error;
  for (fs::directory_iterator it(folder_, error), end; !error && it != end; it.increment(error)) {
    const std::string path = it->path().string();
    struct stat info {};
    if (::lstat(path.c_str(), &info) != 0 || !S_ISREG(info.st_mode)) continue;
    Item item{path, uint64_t(info.st_size), FileStamp::of(info).modifiedNs};
    const std::string stem = path.substr(0, path.size() - std::min<size_t>(path.size(), 5));
    if (endsWith(path, ".blob")) {
      if (::lstat((stem + ".used").c_str(), &info) == 0) item.used = std::max(item.used, FileStamp::of(info).modifiedNs);
      blobs.push_back(item);
      total += item.bytes;
    } else if (endsWith(path, ".used")) {
      if (::access((stem + ".blob").c_str(), F_OK) != 0) ::unlink(path.c_str());
    } else if (endsWith(path, ".files") || endsWith(path, ".stamp")) small.push_back(item);
  }
  const auto older = [](const Item& a, const Item& b) { return a.used < b.used; };
  std::sort(blobs.begin(), blobs.end(), older);
  for (const Item& item : blobs) {
    if (total <= maxBytes_) break;
    if (item.path == keep) continue;
    drop(item.path);
    total -= item.bytes;
  }
  if (small.size() <= kSmallFiles) return;
  std::sort(small.begin(), small.end(), older);
  for (size_t i = 0; i + kSmallFiles / 2 < small.size(); ++i) ::unlink(small[i].path.c_str());
}

std::optional<std::vector<std::string>> BlobCache::sideNames(const BlobKey& mainKey) const {
  const auto text = smallFile(file(mainKey, ".files"));
  if (!text || text->empty() || text->back() != '\0') return std::nullopt;
  std::vector<std::string> names;
  for (size_t at = 1; at < text->size();) {  // the first byte is a zero too: an empty list is not an empty file
    const size_t end = text->find('\0', at);
    names.push_back(text->substr(at, end - at));
    at = end + 1;
  }
  return names;
}

void BlobCache::rememberSideNames(const BlobKey& mainKey, const std::vector<std::string>& names) const {
  std::string text(1, '\0');
  for (const std::string& n : names) {
    text += n;
    text += '\0';
  }
  writeSmall(file(mainKey, ".files"), text);
}

std::optional<std::string> BlobCache::knownDigest(const std::string& path, const std::string& stamp) const {
  const auto text = smallFile(folder_ + "/" + sha256Hex(path.data(), path.size()) + ".stamp");
  if (!text || text->size() != stamp.size() + 66 || text->compare(0, stamp.size() + 1, stamp + "\n") != 0) return std::nullopt;
  return text->substr(stamp.size() + 1, 64);
}

void BlobCache::rememberDigest(const std::string& path, const std::string& stamp, const std::string& digest) const {
  const std::string text = stamp + "\n" + digest + "\n";
  writeSmall(folder_ + "/" + sha256Hex(path.data(), path.size()) + ".stamp", text);
}

uint64_t BlobCache::bytes() const {
  uint64_t total = 0;
  std::error_code error;
  for (fs::directory_iterator it(folder_, error), end; !error && it != end; it.increment(error))
    if (endsWith(it->path().string(), ".blob")) {
      std::error_code e;
      const uint64_t n = fs::file_size(it->path(), e);
      if (!e) total += n;
    }
  return total;
}

}  // namespace server
}  // namespace gobo
