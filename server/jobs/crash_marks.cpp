// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/crash_marks.h"

#include <signal.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <random>

#include "base/mapped_faults.h"
#include "server/log.h"
#include "server/scratch.h"

namespace gobo {
inline namespace jobs {

namespace fs = std::filesystem;

namespace {
constexpr uint64_t kMagic = 0x314b52414d4f4247ull;  // "GBOMARK1"
constexpr uint64_t kMagicText = ~0ull >> 8;         // all but the digit, which is the version
constexpr int kSlots = 128;                         // workers: at most 64
constexpr int kMostMarkNames = 8;                   // that open() tries
constexpr int kSignals[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};

std::atomic<std::atomic<int32_t>*> signalWord{nullptr};  // in the page of this process
std::atomic<std::atomic<uint32_t>*> othersWord{nullptr};
}  // namespace

struct CrashMarks::Page {
  uint64_t magic;
  std::atomic<int32_t> signal;
  std::atomic<uint32_t> others;
  struct Slot {
    std::atomic<int64_t> job, index;
  } slots[kSlots];  // job 0: free
};
static_assert(std::atomic<int64_t>::is_always_lock_free && std::atomic<int32_t>::is_always_lock_free);

namespace {

// Only what a signal handler may do: an atomic store, and the signal again with its own effect.
void crashed(int number) {
  if (std::atomic<int32_t>* word = signalWord.load()) word->store(number);
  ::signal(number, SIG_DFL);
  ::raise(number);
}

void install() {
  static const bool once = [] {
    for (const int number : kSignals) {
      if (number == SIGBUS && runOnOtherBusError(crashed)) continue;  // under a mapped file it is no crash
      struct sigaction now {
      }, wanted{};
      // A sanitizer's own handler, and its report, go before.
      if (::sigaction(number, nullptr, &now) != 0 || now.sa_handler != SIG_DFL) continue;
      wanted.sa_handler = crashed;
      wanted.sa_flags = int(SA_RESETHAND | SA_NODEFER);
      ::sigaction(number, &wanted, nullptr);
    }
    return true;
  }();
  (void)once;
}

}  // namespace

Result<std::unique_ptr<CrashMarks>> CrashMarks::open(const std::string& folder) {
  std::unique_ptr<CrashMarks> self(new CrashMarks);
  const auto failed = [&](const char* what) {
    return Status(errno == ENOSPC || errno == EDQUOT ? Code::ResourceExhausted : Code::Internal, std::string("cannot ") + what + ": " + std::strerror(errno),
                  self->path_);
  };
  std::random_device random;
  const std::string marks = folder + "/marks";
  if (::mkdir(marks.c_str(), 0700) != 0 && errno != EEXIST) return failed("make the folder of");
  for (int tries = 0; !self->fd_ && tries < kMostMarkNames; ++tries) {
    self->path_ = marks + "/" + std::to_string(::getpid()) + "-" + std::to_string(random());
    self->fd_ = lockNewFile(self->path_);
    if (!self->fd_ && errno != EEXIST && errno != EWOULDBLOCK) break;
  }
  if (!self->fd_) return failed("make");
  // Written, not only made longer: a page of a full disk would end the process when it is touched.
  const std::vector<char> zeroes(sizeof(Page), 0);
  if (::write(self->fd_.get(), zeroes.data(), zeroes.size()) != ssize_t(zeroes.size())) return failed("write");
  void* at = ::mmap(nullptr, sizeof(Page), PROT_READ | PROT_WRITE, MAP_SHARED, self->fd_.get(), 0);
  if (at == MAP_FAILED) return failed("map");
  self->page_ = static_cast<Page*>(at);
  self->page_->magic = kMagic;
  signalWord.store(&self->page_->signal);
  othersWord.store(&self->page_->others);
  install();
  return self;
}

CrashMarks::~CrashMarks() {
  if (page_) {
    std::atomic<int32_t>* mine = &page_->signal;
    std::atomic<uint32_t>* others = &page_->others;
    signalWord.compare_exchange_strong(mine, nullptr);
    othersWord.compare_exchange_strong(others, nullptr);
    ::munmap(page_, sizeof(Page));
  }
  if (fd_) ::unlink(path_.c_str());
}

std::vector<CrashReport> CrashMarks::read(const std::string& folder) {
  std::vector<CrashReport> reports;
  std::error_code error;
  for (fs::directory_iterator it(folder + "/marks", error), end; !error && it != end; it.increment(error)) {
    const std::string path = it->path().string();
    const gobo::Descriptor fd = lockAbandonedFile(path);
    if (!fd) continue;
    alignas(Page) char bytes[sizeof(Page)] = {};
    const ssize_t got = ::pread(fd.get(), bytes, sizeof bytes, 0);
    const Page& page = *reinterpret_cast<const Page*>(bytes);
    if (page.magic != kMagic && (page.magic & kMagicText) == (kMagic & kMagicText))
      logWarn("jobs: %s has version '%c', this build reads version '%c': what that crash left is not known", path.c_str(), char(page.magic >> 56),
              char(kMagic >> 56));
    if (got == ssize_t(sizeof bytes)) {
      CrashReport report;
      report.signal = page.signal.load();
      for (const auto& slot : page.slots)
        if (slot.job.load() != 0) report.tasks.push_back({slot.job.load(), slot.index.load()});
      report.alone = report.tasks.size() == 1 && page.others.load() == 0;
      if (page.magic == kMagic && report.signal != 0 && !report.tasks.empty()) reports.push_back(report);
    }
    ::unlink(path.c_str());
  }
  return reports;
}

CrashMarks::Working::Working(CrashMarks* marks, TaskId task) : marks_(marks) {
  if (!marks_) return;
  for (int i = 0; i < kSlots && slot_ < 0; ++i) {
    int64_t free = 0;
    // The index is there before anybody could read it: readers come when this process is gone.
    if (marks_->page_->slots[i].job.compare_exchange_strong(free, task.job)) slot_ = i;
  }
  if (slot_ >= 0) marks_->page_->slots[slot_].index.store(task.index);
}

CrashMarks::Working::~Working() {
  if (slot_ >= 0) marks_->page_->slots[slot_].job.store(0);
}

CrashMarks::Other::Other() {
  if (auto* word = othersWord.load()) word->fetch_add(1);
}

CrashMarks::Other::~Other() {
  if (auto* word = othersWord.load()) word->fetch_sub(1);
}

}  // namespace jobs
}  // namespace gobo
