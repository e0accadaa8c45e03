// SPDX-License-Identifier: Apache-2.0
#include "server/file_store.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "base/own_folder.h"
#include "scene/file_source.h"
#include "server/log.h"
#include "server/upload.h"

namespace gobo {
inline namespace server {

namespace fs = std::filesystem;

namespace {

constexpr const char* kBlobsFolder = "blobs folder";
constexpr uint64_t kLeastCharge = 64 << 10;        // a file costs an inode and a place in the index as well: bounds their number
constexpr int64_t kTouchNs = 3600 * 1000000000ll;  // the order of uses on disk is right to the hour
constexpr int64_t kSweepNs = 60 * 1000000000ll;
constexpr uint64_t kMostPrivate = 2ull << 30;  // without a folder of its own: /tmp may be memory
constexpr size_t kMostSteps = 16;
constexpr size_t kMostNamed = 20, kNamedBytes = 2000;  // missing files that an error names: it must fit into what clients take of metadata

int64_t nowNs() {
  timespec t{};
  ::clock_gettime(CLOCK_REALTIME, &t);
  return t.tv_sec * 1000000000ll + t.tv_nsec;
}

Status failed(const std::string& what, int error) {
  const bool none = error == ENOSPC || error == EDQUOT || error == EFBIG || error == EMFILE || error == ENFILE || error == ENOMEM;
  return {none ? Code::ResourceExhausted : Code::Internal, what + ": " + std::strerror(error)};
}

/// Errors that say that a file is not there. All others say nothing of it: it may be whole.
bool saysGone(int error) { return error == ENOENT || error == ENOTDIR; }
bool isGone(const std::string& path) {
  struct stat info {};
  return ::lstat(path.c_str(), &info) != 0 && saysGone(errno);
}

bool isHex(const std::string& text, size_t digits) { return text.size() == digits && text.find_first_not_of("0123456789abcdef") == std::string::npos; }

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return text;
}

std::string ownerFolder(const std::string& owner) { return sha256Hex(owner.data(), owner.size()).substr(0, 32); }

void flushFolder(const std::string& path) {
  const gobo::Descriptor d{::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
  if (d) ::fsync(d.get());
}

/// Adds the file's first `bytes` bytes.
Status addFile(Sha256& sha, int fd, uint64_t bytes, const StopToken& stop) {
  std::vector<char> slice(1 << 20);
  for (uint64_t at = 0; at < bytes;) {
    if (stop.stopRequested()) return {Code::Cancelled, "stopped"};
    const ssize_t n = ::pread(fd, slice.data(), size_t(std::min<uint64_t>(bytes - at, slice.size())), off_t(at));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return failed("cannot read a file that was put", n < 0 ? errno : EIO);
    sha.add(slice.data(), size_t(n));
    at += uint64_t(n);
  }
  return {};
}

/// A second name for the file; a copy where the file system has no hard links.
Status linkOrCopy(const std::string& from, const std::string& to) {
  if (::link(from.c_str(), to.c_str()) == 0) return {};
  if (errno != EPERM && errno != EOPNOTSUPP && errno != EMLINK && errno != EXDEV)
    return errno == ENAMETOOLONG ? invalidArgument("a step of it is too long for the file system") : failed("cannot link a file that was put", errno);
  std::error_code error;
  fs::copy_file(from, to, error);
  return error ? failed("cannot copy a file that was put", error.value()) : Status();
}

}  // namespace

Status checkSha256(const std::string& text, const std::string& field) {
  if (isHex(lower(text), 64)) return {};
  return invalidArgument(field + " = \"" + escaped(text.substr(0, 80)) + "\": must be 64 hex digits, the SHA-256 of a file", field);
}

Status checkFileNames(const std::map<std::string, std::string>& files, const std::string& source) {
  const auto bad = [](const std::string& name, const std::string& why) {
    return invalidArgument("open.files[\"" + escaped(name.substr(0, 200)) + "\"]: " + why, "open.files");
  };
  for (const auto& [name, digest] : files) {
    if (const Status ok = checkSideName(name, name); !ok.ok()) return bad(name, ok.message());
    const fs::path path(name);
    if (path.lexically_normal().string() != name || name.back() == '/' || name == ".")
      return bad(name, "must be a plain relative name, such as \"textures/a.png\"");
    if (size_t(std::distance(path.begin(), path.end())) > kMostSteps) return bad(name, "has more than " + std::to_string(kMostSteps) + " steps");
    for (const fs::path& step : path)
      if (step.string().size() > 255) return bad(name, "has a step of more than 255 bytes");
    for (fs::path above = path.parent_path(); !above.empty(); above = above.parent_path())
      if (files.count(above.string())) return bad(name, "\"" + escaped(above.string()) + "\" is a file too");
    GOBO_TRY(checkSha256(digest, "open.files[\"" + escaped(name) + "\"]").at("open.files"));
  }
  const std::string extension = lower(fs::path(source).extension().string());
  if (!files.count(source)) return invalidArgument("open.source = \"" + escaped(source.substr(0, 200)) + "\": is none of open.files", "open.source");
  if (extension != ".gltf" && extension != ".glb")
    return invalidArgument("open.source = \"" + escaped(source.substr(0, 200)) + "\": must be a .gltf or .glb", "open.source");
  return {};
}

uint64_t FileStore::Entry::charge() const { return std::max(kLeastCharge, whole || writing ? bytes : received); }

// The folder.

Result<std::shared_ptr<FileStore>> FileStore::open(const FileStoreOptions& options) {
  std::shared_ptr<FileStore> self(new FileStore(options));
  if (options.folder.empty()) {
    self->private_ = true;
    self->options_.bytes = std::min(options.bytes, kMostPrivate);
    return self;
  }
  GOBO_TRY(self->ensureFolder());
  const std::string name = options.folder + "/lock";
  self->lock_ = gobo::Descriptor{::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600)};
  if (!self->lock_) return failed("cannot open \"" + name + "\"", errno);
  if (::flock(self->lock_.get(), LOCK_EX | LOCK_NB) != 0) return Status(Code::Unavailable, "another daemon has the blobs folder", options.folder);
  self->scan();
  return self;
}

Status FileStore::ensureFolder() {
  const std::lock_guard lock(mutex_);
  if (private_ && options_.folder.empty()) {
    GOBO_ASSIGN(scratch_, ScratchFolder::make(options_.tmpFolder, kUploadFolder));
    options_.folder = scratch_->path();
  }
  if (!private_) GOBO_TRY(makeOwnFolder(options_.folder, kBlobsFolder));
  const std::string trees = options_.folder + "/trees";
  if (::mkdir(trees.c_str(), 0700) != 0 && errno != EEXIST) return failed("cannot make \"" + trees + "\"", errno);
  return {};
}

void FileStore::scan() {
  std::error_code error;
  fs::remove_all(options_.folder + "/trees", error);  // of a daemon that was killed
  ::mkdir((options_.folder + "/trees").c_str(), 0700);
  for (fs::directory_iterator owner(options_.folder, error), end; !error && owner != end; owner.increment(error)) {
    const std::string name = owner->path().filename().string();
    if (!isHex(name, 32)) continue;
    std::error_code inner;
    for (fs::directory_iterator it(owner->path(), inner); !inner && it != end; it.increment(inner)) {
      const std::string file = it->path().filename().string(), digest = file.substr(0, std::min<size_t>(64, file.size()));
      struct stat info {};
      if (!isHex(digest, 64) || ::lstat(it->path().c_str(), &info) != 0 || !S_ISREG(info.st_mode)) continue;
      Entry entry;
      entry.received = uint64_t(info.st_size);
      entry.used = info.st_mtim.tv_sec * 1000000000ll + info.st_mtim.tv_nsec;
      if (file == digest) {
        entry.whole = true;
        entry.bytes = entry.received;
      } else {
        char* rest = nullptr;
        entry.bytes = file.size() > 65 && file[64] == '.' ? std::strtoull(file.c_str() + 65, &rest, 10) : 0;
        if (entry.bytes == 0 || std::strcmp(rest, ".part") != 0 || entry.received > entry.bytes || entries_.count({name, digest})) {
          ::unlink(it->path().c_str());
          continue;
        }
      }
      Entry& kept = entries_[{name, digest}];
      if (kept.bytes && !kept.whole) ::unlink(pathOf({name, digest}, kept).c_str());  // a part beside the whole
      kept = entry;
    }
  }
  const std::lock_guard lock(mutex_);
  sweepParts();
  (void)makeRoom(nullptr, 0);
}

std::string FileStore::pathOf(const Key& key, const Entry& entry) const {
  return options_.folder + "/" + key.first + "/" + key.second + (entry.whole ? "" : "." + std::to_string(entry.bytes) + ".part");
}

void FileStore::drop(std::map<Key, Entry>::iterator at) {
  ::unlink(pathOf(at->first, at->second).c_str());
  entries_.erase(at);
}

void FileStore::sweepParts() {
  if (nowNs() - swept_ < kSweepNs) return;
  swept_ = nowNs();
  const int64_t oldest = nowNs() - int64_t(options_.partSeconds * 1e9);
  for (auto at = entries_.begin(); at != entries_.end();) {
    const auto next = std::next(at);
    if (!at->second.whole && !at->second.writing && at->second.used < oldest) drop(at);
    at = next;
  }
}

void FileStore::sweep() {
  const std::lock_guard lock(mutex_);
  swept_ = 0;
  sweepParts();
}

FileStore::Stats FileStore::stats() const {
  const std::lock_guard lock(mutex_);
  Stats s;
  for (const auto& [key, e] : entries_) {
    (e.whole ? s.files : s.parts) += 1;
    s.bytes += e.received;
  }
  s.evicted = evicted_;
  s.damaged = damaged_;
  return s;
}

// Room.

Status FileStore::makeRoom(const Key* key, uint64_t more) {
  std::map<std::string, uint64_t> ofOwner;
  uint64_t total = 0;
  using At = std::map<Key, Entry>::iterator;
  std::map<std::string, std::vector<At>> mayGo;  // the one that was used last first
  for (auto at = entries_.begin(); at != entries_.end(); ++at) {
    if (key && at->first == *key) continue;
    ofOwner[at->first.first] += at->second.charge();
    total += at->second.charge();
    if (!at->second.holds && !at->second.writing) mayGo[at->first.first].push_back(at);
  }
  for (auto& [owner, files] : mayGo) std::sort(files.begin(), files.end(), [](At a, At b) { return a->second.used > b->second.used; });
  const auto evict = [&](const std::string& owner) {
    std::vector<At>& files = mayGo[owner];
    if (files.empty()) return false;
    const uint64_t charge = files.back()->second.charge();
    drop(files.back());
    files.pop_back();
    ofOwner[owner] -= charge;
    total -= charge;
    ++evicted_;
    return true;
  };
  const auto refuse = [&](uint64_t held, const char* whose, uint64_t bound) {
    return Status(
        Code::ResourceExhausted,
        strf("no room for a file of %llu bytes: %s files that are in use or on their way have %llu, at most %llu (blobs.bytes = %llu, half of it for one "
             "client)",
             (unsigned long long)more, whose, (unsigned long long)held, (unsigned long long)bound, (unsigned long long)options_.bytes));
  };
  if (key) {
    if (more > most()) return refuse(0, "this client's", most());
    while (ofOwner[key->first] > most() - more)
      if (!evict(key->first)) return refuse(ofOwner[key->first], "this client's", most());
  }
  // Whoever has most makes room.
  while (total > options_.bytes - more) {
    std::string richest;
    for (const auto& [owner, files] : mayGo)
      if (!files.empty() && (richest.empty() || ofOwner[owner] > ofOwner[richest])) richest = owner;
    if (richest.empty()) return refuse(total, "all", options_.bytes);
    evict(richest);
  }
  return {};
}

Status FileStore::fitTogether(const std::string& owner, const std::map<std::string, uint64_t>& files) const {
  const auto add = [](uint64_t& sum, uint64_t more) { sum = more > UINT64_MAX - sum ? UINT64_MAX : sum + more; };  // sizes are what the client says
  const std::string folder = ownerFolder(owner);
  std::map<std::string, uint64_t> asked;  // one file may be asked for in both cases
  for (const auto& [digest, bytes] : files) asked[lower(digest)] = std::max(kLeastCharge, bytes);
  uint64_t together = 0, mine = 0, others = 0;
  for (const auto& [digest, charge] : asked) add(together, charge);
  const std::lock_guard lock(mutex_);
  for (const auto& [key, entry] : entries_) {
    const bool own = key.first == folder, stays = entry.holds || entry.writing;
    if (stays && !(own && asked.count(key.second))) add(own ? mine : others, entry.charge());
  }
  uint64_t ofOwner = together, ofAll = together;
  add(ofOwner, mine);
  add(ofAll, mine);
  add(ofAll, others);
  if (ofOwner <= most() && ofAll <= options_.bytes) return {};
  return {
      Code::ResourceExhausted,
      strf("the %zu files have %llu bytes together, beside %llu of this client's and %llu of others that are in use or on their way: they cannot be there at "
           "once (blobs.bytes = %llu, half of it for one client)",
           asked.size(), (unsigned long long)together, (unsigned long long)mine, (unsigned long long)others, (unsigned long long)options_.bytes)};
}

// Putting.

uint64_t FileStore::received(const std::string& owner, const std::string& sha256, uint64_t bytes) {
  const Key key{ownerFolder(owner), lower(sha256)};
  const std::lock_guard lock(mutex_);
  const auto at = entries_.find(key);
  if (at == entries_.end() || at->second.bytes != bytes) return 0;
  if (isGone(pathOf(key, at->second))) {  // somebody emptied the folder
    if (!at->second.writing && !at->second.holds) entries_.erase(at);
    return 0;
  }
  at->second.used = nowNs();
  return at->second.whole ? bytes : std::min(at->second.received, bytes - 1);  // all of it only once it is checked and can be opened
}

Result<std::unique_ptr<FilePut>> FileStore::begin(const std::string& owner, const std::string& sha256, uint64_t bytes, uint64_t offset, const StopToken& stop) {
  GOBO_TRY(checkSha256(sha256, "put.blob.sha256"));
  if (bytes == 0) return invalidArgument("put.blob.bytes = 0: the first message must say how many bytes the file has", "put.blob.bytes");
  GOBO_TRY(ensureFolder());
  const Key key{ownerFolder(owner), lower(sha256)};
  std::unique_ptr<FilePut> put(new FilePut());
  put->store_ = shared_from_this();
  put->owner_ = key.first;
  put->digest_ = key.second;
  put->bytes_ = bytes;
  const std::string folder = options_.folder + "/" + key.first;
  if (::mkdir(folder.c_str(), 0700) == 0) flushFolder(options_.folder);
  else if (errno != EEXIST) return failed("cannot make \"" + folder + "\"", errno);
  {
    const std::lock_guard lock(mutex_);
    sweepParts();
    auto at = entries_.find(key);
    if (at != entries_.end() && at->second.writing)
      return Status(Code::Aborted, "another call puts this file: ask what is missing, and go on once that one has ended", "put.blob.sha256");
    if (at != entries_.end() && !at->second.holds && isGone(pathOf(key, at->second))) {
      entries_.erase(at);
      at = entries_.end();
    }
    if (at != entries_.end() && at->second.whole) {
      if (at->second.bytes != bytes)
        return invalidArgument(strf("put.blob.bytes = %llu: the file of that digest has %llu", (unsigned long long)bytes, (unsigned long long)at->second.bytes),
                               "put.blob.bytes");
      at->second.used = nowNs();
      put->finished_ = true;
      put->received_ = bytes;
      return put;
    }
    if (at != entries_.end() && at->second.bytes != bytes) {  // another idea of its size: one of them is wrong
      drop(at);
      at = entries_.end();
    }
    const uint64_t has = at == entries_.end() ? 0 : at->second.received;
    if (offset > has)
      return Status(Code::OutOfRange, strf("put.offset = %llu: %llu bytes are there, go on from these", (unsigned long long)offset, (unsigned long long)has),
                    "put.offset");
    GOBO_TRY(makeRoom(&key, std::max(kLeastCharge, bytes)).at("put.blob.bytes"));
    Entry& e = entries_[key];
    e.bytes = bytes;
    e.received = offset;
    e.used = nowNs();
    e.writing = true;
    put->part_ = pathOf(key, e);  // from here on the entry is this call's
  }
  put->received_ = offset;
  put->resumed_ = offset > 0;
  put->fd_ = gobo::Descriptor{::open(put->part_.c_str(), O_CREAT | O_RDWR | O_CLOEXEC | O_NOFOLLOW, 0600)};
  if (!put->fd_) return failed("cannot write \"" + put->part_ + "\"", errno);
  struct stat info {};
  if (::fstat(put->fd_.get(), &info) != 0) return failed("cannot write \"" + put->part_ + "\"", errno);
  if (uint64_t(info.st_size) < offset) return Status(Code::Aborted, "what was there of the file is gone: ask what is missing", "put.offset");
  if (::ftruncate(put->fd_.get(), off_t(offset)) != 0) return failed("cannot write \"" + put->part_ + "\"", errno);
  GOBO_TRY(addFile(put->sha_, put->fd_.get(), offset, stop));
  return put;
}

FilePut::~FilePut() {
  if (part_.empty() || finished_) return;
  const std::lock_guard lock(store_->mutex_);
  const auto at = store_->entries_.find({owner_, digest_});
  if (at == store_->entries_.end() || at->second.whole) return;
  at->second.writing = false;
  struct stat info {};
  const bool known = (fd_ ? ::fstat(fd_.get(), &info) : ::lstat(part_.c_str(), &info)) == 0;  // it may be there though it could not be opened
  if (damaged_ || (known ? !S_ISREG(info.st_mode) || info.st_size == 0 : saysGone(errno))) {
    store_->drop(at);
    return;
  }
  if (known) at->second.received = std::min(bytes_, uint64_t(info.st_size));
  at->second.used = nowNs();
}

Status FilePut::add(const std::string& data) {
  if (there()) {
    dropped_ += data.size();
    if (dropped_ <= bytes_) return {};
  }
  if (there() || data.size() > bytes_ - received_)
    return invalidArgument(strf("put.data: goes beyond put.blob.bytes = %llu", (unsigned long long)bytes_), "put.data");
  for (size_t at = 0; at < data.size();) {
    const ssize_t n = ::pwrite(fd_.get(), data.data() + at, data.size() - at, off_t(received_ + at));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return failed("cannot keep the file", n < 0 ? errno : EIO);
    at += size_t(n);
  }
  sha_.add(data.data(), data.size());
  received_ += data.size();
  const std::lock_guard lock(store_->mutex_);
  if (const auto at = store_->entries_.find({owner_, digest_}); at != store_->entries_.end()) at->second.received = received_;
  return {};
}

Status FilePut::finish() {
  if (there()) return {};
  if (received_ != bytes_)
    return invalidArgument(
        strf("put.data: %llu of put.blob.bytes = %llu bytes are there: go on from them", (unsigned long long)received_, (unsigned long long)bytes_),
        "put.data");
  if (const std::string digest = sha_.hex(); digest != digest_) {
    damaged_ = true;
    if (resumed_)
      return invalidArgument("put.blob.sha256 = " + digest_ + ": what arrived in several calls has " + digest + " and is dropped: put it from 0",
                             "put.blob.sha256");
    return invalidArgument("put.blob.sha256 = " + digest_ + ": the bytes received have " + digest, "put.blob.sha256");
  }
  if (::fdatasync(fd_.get()) != 0) return failed("cannot keep the file", errno);
  const std::string folder = store_->options_.folder + "/" + owner_;
  {
    const std::lock_guard lock(store_->mutex_);
    if (::rename(part_.c_str(), (folder + "/" + digest_).c_str()) != 0) return failed("cannot keep the file", errno);
    FileStore::Entry& e = store_->entries_[{owner_, digest_}];
    e.bytes = e.received = bytes_;
    e.used = nowNs();
    e.whole = e.checked = true;
    e.writing = false;
  }
  finished_ = true;
  flushFolder(folder);
  return {};
}

// Using.

class FileStore::Hold {
 public:
  Hold(std::shared_ptr<FileStore> store, Key key) : store_(std::move(store)), key_(std::move(key)) {}
  ~Hold() {
    const std::lock_guard lock(store_->mutex_);
    if (const auto at = store_->entries_.find(key_); at != store_->entries_.end() && at->second.holds > 0) --at->second.holds;
  }
  Hold(const Hold&) = delete;
  Hold& operator=(const Hold&) = delete;

 private:
  std::shared_ptr<FileStore> store_;
  const Key key_;
};

Result<std::shared_ptr<const void>> FileStore::hold(const Key& key, const std::string& field, const StopToken& stop) {
  const std::string what = field + " = " + key.second;
  const Status none = notFound(what + ": no such file of this caller's: put it first (Blobs.Put)", field);
  std::shared_ptr<const void> held;
  std::string path;
  uint64_t bytes = 0;
  bool checked = false;
  {
    const std::lock_guard lock(mutex_);
    const auto at = entries_.find(key);
    if (at == entries_.end() || !at->second.whole) return none;
    bytes = at->second.bytes;
    ++at->second.holds;
    held = std::make_shared<Hold>(shared_from_this(), key);
    path = pathOf(key, at->second);
    checked = at->second.checked;
    const int64_t now = nowNs();
    if (now - at->second.used > kTouchNs) ::utimensat(AT_FDCWD, path.c_str(), nullptr, 0);
    at->second.used = now;
  }
  const gobo::Descriptor fd{::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW)};
  struct stat info {};
  if (fd ? ::fstat(fd.get(), &info) != 0 : !saysGone(errno)) return failed(what + ": cannot open the file that was put", errno).at(field);
  bool good = fd && uint64_t(info.st_size) == bytes;
  if (good && !checked) {
    Sha256 sha;
    const Status read = addFile(sha, fd.get(), bytes, stop);
    if (!read.ok()) return read.at(field);
    good = sha.hex() == key.second;
  }
  const std::lock_guard lock(mutex_);
  const auto at = entries_.find(key);
  if (at == entries_.end()) return none;
  if (good) {
    at->second.checked = true;
    return held;
  }
  logWarn("blobs: %s is gone or damaged and is removed", path.c_str());
  ++damaged_;
  drop(at);  // what others have of it is a link of its own
  return none;
}

Result<std::shared_ptr<const FileTree>> FileStore::tree(const std::string& owner, const std::map<std::string, std::string>& files, const std::string& field,
                                                        const StopToken& stop) {
  const std::string folder = ownerFolder(owner);
  std::string text = "gobo-files 1\n" + folder + "\n";
  std::shared_ptr<FileTree> made(new FileTree());
  std::string missing;
  size_t missed = 0, named = 0;
  Status first;
  for (const auto& [name, digest] : files) {
    text += std::to_string(name.size()) + " " + name + " " + lower(digest) + "\n";
    const std::string place = files.size() == 1 && field != "open.files" ? field : field + "[\"" + escaped(name) + "\"]";
    auto held = hold({folder, lower(digest)}, place, stop);
    if (held.ok()) {
      made->holds_.push_back(std::move(*held));
      continue;
    }
    if (held.status().code() != Code::NotFound) return held.status();
    if (++missed == 1) first = held.status();
    if (named == missed - 1 && named < kMostNamed && missing.size() + place.size() < kNamedBytes) {
      missing += (named ? ", " : "") + place + " = " + lower(digest);
      ++named;
    }
  }
  if (missed > 1)
    return notFound(
        strf("%zu of %zu files are not this caller's: put them first (Blobs.Put): ", missed, files.size()) + missing + (missed > named ? ", ..." : ""), field);
  if (missed) return first;
  made->key_ = sha256Hex(text.data(), text.size());
  GOBO_TRY(ensureFolder());
  made->folder_ = options_.folder + "/trees/" + made->key_;
  const std::lock_guard lock(treesMutex_);
  Tree& known = trees_[made->key_];
  std::error_code error;
  if (std::shared_ptr<const FileTree> there = known.tree.lock(); there && fs::is_directory(there->folder_, error)) return there;
  fs::remove_all(made->folder_, error);
  made->turn_ = known.turn = ++turns_;
  made->store_ = shared_from_this();  // from here on it is removed with its last owner
  known.tree = made;
  if (::mkdir(made->folder_.c_str(), 0700) != 0) return failed("cannot make \"" + made->folder_ + "\"", errno);
  for (const auto& [name, digest] : files) {
    const fs::path to = made->path(name);
    if (name.find('/') != std::string::npos && !fs::create_directories(to.parent_path(), error) && error)
      return failed("cannot make \"" + to.parent_path().string() + "\"", error.value());
    GOBO_TRY(linkOrCopy(options_.folder + "/" + folder + "/" + lower(digest), to.string()).at(field));
  }
  return std::shared_ptr<const FileTree>(made);
}

FileTree::~FileTree() {
  if (!store_) return;
  const std::lock_guard lock(store_->treesMutex_);
  const auto at = store_->trees_.find(key_);
  if (at == store_->trees_.end() || at->second.turn != turn_) return;  // made again since: the folder is that one's
  store_->trees_.erase(at);
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

Result<std::shared_ptr<const FileTree>> FileStore::environment(const std::string& owner, const std::string& sha256, const std::string& field, std::string& path,
                                                               const StopToken& stop) {
  GOBO_TRY(checkSha256(sha256, field));
  const Key key{ownerFolder(owner), lower(sha256)};
  GOBO_ASSIGN(const std::shared_ptr<const void> held, hold(key, field, stop));
  std::string extension;
  {
    const gobo::Descriptor fd{::open((options_.folder + "/" + key.first + "/" + key.second).c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW)};
    char head[4] = {};
    const ssize_t n = fd ? ::pread(fd.get(), head, sizeof head, 0) : -1;
    if (n < 0) return failed(field + " = " + key.second + ": cannot read the file that was put", errno).at(field);
    const bool read = n == ssize_t(sizeof head);
    if (read && std::memcmp(head, "\x76\x2f\x31\x01", 4) == 0) extension = ".exr";
    if (read && std::memcmp(head, "#?", 2) == 0) extension = ".hdr";
  }
  if (extension.empty()) return invalidArgument(field + " = " + key.second + ": the file of that digest is no .hdr and no .exr", field);
  GOBO_ASSIGN(std::shared_ptr<const FileTree> made, tree(owner, {{"environment" + extension, key.second}}, field, stop));
  path = made->path("environment" + extension);
  return made;
}

}  // namespace server
}  // namespace gobo
