// SPDX-License-Identifier: Apache-2.0
#include "server/ingest_loader.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <filesystem>
#include <mutex>

#include "base/descriptor.h"
#include "base/file_stamp.h"
#include "base/image_io.h"
#include "scene/blob.h"
#include "server/blob_cache.h"
#include "server/encode.h"
#include "server/file_digest.h"
#include "server/ingest_child.h"
#include "server/log.h"

namespace gobo {
inline namespace server {
namespace {

constexpr const char* kCannotWrite = "cannot write the blob";  // begins what a child says whose output takes no more
using Clock = std::chrono::steady_clock;
double msSince(Clock::time_point t) { return std::chrono::duration<double, std::milli>(Clock::now() - t).count(); }

/// At most n at once; who waits looks at its stop token.
class Gate {
 public:
  explicit Gate(uint32_t n) : free_(n) {}
  bool enter(const StopToken& stop) {
    std::unique_lock lock(mutex_);
    while (free_ == 0) {
      if (stop.stopRequested()) return false;
      changed_.wait_for(lock, std::chrono::milliseconds(20));
    }
    --free_;
    return true;
  }
  void leave() {
    {
      const std::lock_guard lock(mutex_);
      ++free_;
    }
    changed_.notify_one();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  uint32_t free_;
};

class ChildLoader final : public SceneLoader {
 public:
  ChildLoader(IngestOptions options, std::unique_ptr<BlobCache> cache) : options_(std::move(options)), cache_(std::move(cache)), gate_(options_.atOnce) {}

  Result<LoadedScene> scene(const std::string& path, const StopToken& stop) override {
    LoadedScene out;
    GOBO_TRY(load(ingest::Task::Scene, path, stop, out.report, [&](const auto& map, BlobTrust trust, const BlobKey* key) -> Status {
      GOBO_ASSIGN(out.scene, readSceneBlob(map, trust, key));
      return {};
    }));
    return out;
  }
  Result<EnvironmentPtr> environment(const std::string& path, const StopToken& stop) override {
    EnvironmentPtr out;
    LoadReport report;
    GOBO_TRY(load(ingest::Task::Environment, path, stop, report, [&](const auto& map, BlobTrust trust, const BlobKey* key) -> Status {
      GOBO_ASSIGN(out, readEnvironmentBlob(map, trust, key));
      return {};
    }));
    return out;
  }
  void discard(const MappedFile& file) override {
    if (cache_) cache_->discard(file);
  }

 private:
  /// Digest of a file, from its stamp if that may be trusted.
  Result<std::string> digestOf(Result<int> opened, const std::string& path, const StopToken& stop) {
    if (!opened.ok()) return opened.status();
    const int fd = *opened;
    struct stat info {};
    ::fstat(fd, &info);
    const FileStamp stamp = FileStamp::of(info);
    if (!options_.verifyAlways)
      if (const auto known = cache_->knownDigest(path, stamp.text())) {
        ::close(fd);
        return *known;
      }
    auto digest = fileDigest(fd, path, {options_.inputBytes, "ingest.input_bytes"}, stop);
    const bool still = ::fstat(fd, &info) == 0 && FileStamp::of(info) == stamp && stamp.settled();
    ::close(fd);
    if (digest.ok() && still) cache_->rememberDigest(path, stamp.text(), *digest);
    return digest;
  }

  /// Of the scene file alone, under the options that the result depends on.
  BlobKey mainKey(ingest::Task task, const std::string& path, const std::string& digest) const {
    std::string text = "gobo-ingest 5\n";
    for (const uint64_t v : {uint64_t(task), options_.triangles, options_.inputBytes, options_.textureBytes, options_.memoryBytes})
      text += std::to_string(v) + "\n";
    text += blobFormatHash().hex() + "\n" + std::filesystem::path(path).filename().string() + "\n" + digest + "\n";
    return blobKeyOf(sha256Hex(text.data(), text.size()));
  }
  static BlobKey wholeKey(const BlobKey& main, const std::vector<SideFile>& sides) {
    std::string text = blobKeyHex(main) + "\n";
    for (const SideFile& s : sides) text += std::to_string(s.name.size()) + " " + s.name + " " + s.digest + "\n";
    return blobKeyOf(sha256Hex(text.data(), text.size()));
  }

  /// The blob of what is on the disk now; nothing when it is not known which files that takes, or one cannot be read.
  Result<std::shared_ptr<const MappedFile>> cached(ingest::Task task, const std::string& path, const StopToken& stop, BlobKey& key) {
    const std::shared_ptr<const MappedFile> none;
    const auto digest = digestOf(openRegular(path), path, stop);
    if (!digest.ok()) return none;
    const BlobKey main = mainKey(task, path, *digest);
    const auto names = cache_->sideNames(main);
    if (!names) return none;
    std::vector<SideFile> sides;
    for (const std::string& name : *names) {
      const auto side = digestOf(openBeside(path, name), path + "\n" + name, stop);
      if (!side.ok() && side.status().code() != Code::NotFound) return none;
      sides.push_back({name, side.ok() ? *side : "absent", ""});
    }
    key = wholeKey(main, sides);
    return cache_->find(key, stop);
  }

  template <typename Read>
  Status load(ingest::Task task, const std::string& path, const StopToken& stop, LoadReport& report, const Read& read) {
    if (cache_) {
      BlobKey key;
      const auto mapping = Clock::now();
      const auto map = cached(task, path, stop, key);
      if (map.status().code() == Code::Cancelled) return Status(Code::Cancelled, "the load was cancelled", path);
      if (!map.ok() || *map) {
        const Status status = map.ok() ? read(*map, BlobTrust::Own, &key) : map.status();
        if (status.ok()) {
          report = {};
          report.mapMs = msSince(mapping);
          report.blobBytes = (*map)->bytes().size();
          report.cached = true;
          return {};
        }
        logWarn("blob %s is removed: %s", blobKeyHex(key).c_str(), status.toString().c_str());
        cache_->remove(key);
      }
    }
    if (!gate_.enter(stop)) return Status(Code::Cancelled, "the load was cancelled", path);
    struct Leave {
      Gate& gate;
      ~Leave() { gate.leave(); }
    } leave{gate_};
    if (cache_) {
      auto temporary = cache_->begin();
      if (!temporary.ok()) cacheFails(temporary.status());
      else {
        const Status status = ingest(task, path, stop, report, read, temporary->get());
        if (status.message().find(kCannotWrite) == std::string::npos) return status;
        cacheFails(status);  // full: once more, into memory
      }
    }
    return ingest(task, path, stop, report, read, nullptr);
  }

  /// At most once a minute: every load would say the same.
  void cacheFails(const Status& status) {
    const int64_t now = std::chrono::duration_cast<std::chrono::seconds>(Clock::now().time_since_epoch()).count();
    int64_t last = lastWarning_.load();
    if ((last != 0 && now - last < 60) || !lastWarning_.compare_exchange_strong(last, now)) return;
    logWarn("blob cache: %s; scenes are loaded without it (said once a minute)", status.toString().c_str());
  }

  /// With a temporary of the cache, or into memory.
  template <typename Read>
  Status ingest(ingest::Task task, const std::string& path, const StopToken& stop, LoadReport& report, const Read& read, BlobCache::Temporary* temporary) {
    const Descriptor memory{temporary ? -1 : ::memfd_create("gobo-blob", MFD_CLOEXEC | MFD_ALLOW_SEALING)};
    if (!temporary && !memory) return Status(Code::ResourceExhausted, std::string("memfd: ") + std::strerror(errno), path);
    const int output = temporary ? temporary->fd() : memory.get();

    const auto begun = Clock::now();
    const ingest::Job job{
        task, path, options_.triangles, options_.inputBytes, options_.textureBytes, options_.memoryBytes, options_.blobBytes, options_.cpuSeconds};
    GOBO_ASSIGN(const IngestOutcome outcome, runIngest(*readers_, job, output, options_.wallSeconds, stop));
    report = {outcome.done.parseMs, outcome.done.textureMs, msSince(begun), 0, 0, false};

    // The child is gone and held the only other descriptor: from here on nobody else can change these bytes.
    const auto mapping = Clock::now();
    if (memory && ::fcntl(memory.get(), F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL) != 0)
      return internalError(std::string("memfd seals: ") + std::strerror(errno), path);
    const BlobKey main = mainKey(task, path, outcome.mainDigest), whole = wholeKey(main, outcome.sides);
    if (temporary) (void)cache_->stamp(*temporary, whole);  // one that cannot be stamped is refused below, or not kept
    auto map = MappedFile::map(output, temporary ? cache_->path(whole) : path);
    if (!map.ok()) return internalError("the sandboxed reader wrote no blob", path);
    if (const Status status = read(*map, BlobTrust::Foreign, nullptr); !status.ok())
      return Status(status.code(), "the sandboxed reader's result is refused: " + status.message(), path);
    report.mapMs = msSince(mapping);
    report.blobBytes = (*map)->bytes().size();
    if (!temporary) return {};
    std::vector<std::string> names;
    for (const SideFile& s : outcome.sides) names.push_back(s.name);
    // A cache that cannot be written to costs time, not the load.
    if (const Status kept = cache_->commit(*temporary, whole, *map); !kept.ok()) {
      cacheFails(kept);
      return {};
    }
    cache_->rememberSideNames(main, names);
    if (!outcome.mainStamp.empty()) cache_->rememberDigest(path, outcome.mainStamp, outcome.mainDigest);
    for (const SideFile& s : outcome.sides)
      if (!s.stamp.empty()) cache_->rememberDigest(path + "\n" + s.name, s.stamp, s.digest);
    return {};
  }

  IngestOptions options_;
  const std::shared_ptr<Readers> readers_ = forkedReaders(options_.program);
  std::unique_ptr<BlobCache> cache_;
  Gate gate_;
  std::atomic<int64_t> lastWarning_{0};
};

}  // namespace

Result<std::shared_ptr<SceneLoader>> childLoader(const IngestOptions& wanted) {
  IngestOptions options = wanted;
  if (options.program.empty()) options.program = findIngestProgram();
  if (options.program.empty() || ::access(options.program.c_str(), X_OK) != 0)
    return Status(Code::FailedPrecondition, options.program.empty() ? std::string("gobo-ingest is not beside this program; name it with ingest.program")
                                                                    : "cannot run \"" + options.program + "\" (ingest.program)");
  std::unique_ptr<BlobCache> cache;
  if (!options.cacheFolder.empty()) {
    auto opened = BlobCache::open(options.cacheFolder, options.cacheBytes);
    if (opened.ok()) cache = std::move(*opened);
    else if (opened.status().code() == Code::FailedPrecondition) return opened.status();
    else logWarn("%s; scenes are loaded without the blob cache", opened.status().toString().c_str());
  }
  return std::shared_ptr<SceneLoader>(std::make_shared<ChildLoader>(options, std::move(cache)));
}

}  // namespace server
}  // namespace gobo
