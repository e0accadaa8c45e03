// SPDX-License-Identifier: Apache-2.0
// gobo_fuzz_run TARGET SECONDS SEED FOLDER...: the properties under inputs that are made out of the files in the folders (packs are unpacked), built by any
// compiler and so with any sanitizer. It sees no branches: an input whose answer is of a new kind (its words without numbers and quotations) becomes a
// seed. The first of each kind are in out/fuzz/TARGET.SEED.pack at the end. The input at work is in out/fuzz/TARGET.SEED.now, also
// after a crash; a property that does not hold, a crash and more than kSeconds of processor for one input end the process with that file kept and the
// words that repeat it.
// gobo_fuzz_run pack FILE FOLDER... and unpack FILE FOLDER: a corpus as one file, and back (fuzz/pack.h).
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>

#include <google/protobuf/stubs/logging.h>

#include "base/hash.h"
#include "fuzz/mutator.h"
#include "fuzz/pack.h"
#include "fuzz/targets.h"

namespace gobo::fuzz {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
constexpr long kSeconds = 60;  // of processor for one input: instrumented code is slow

std::vector<Target> everyTarget() {
  std::vector<Target> out(readerTargets().begin(), readerTargets().end());
  out.insert(out.end(), servedTargets().begin(), servedTargets().end());
  return out;
}

/// SIGPROF ends the process after that much of its processor time: a busy machine is no finding. 0: never.
void limit(long seconds) {
  const itimerval timer{{0, 0}, {seconds, 0}};
  ::setitimer(ITIMER_PROF, &timer, nullptr);
}

/// The words of libFuzzer's dictionary: name="word", with \xNN.
std::vector<std::string> words(const std::string& name) {
  std::vector<std::string> out;
  std::ifstream in("fuzz/" + name + ".dict");
  for (std::string line; !name.empty() && std::getline(in, line);) {
    const size_t from = line.find('"'), to = line.rfind('"');
    if (line.empty() || line[0] == '#' || from == std::string::npos || to <= from) continue;
    std::string word;
    for (size_t i = from + 1; i < to; ++i) {
      if (line[i] == '\\' && i + 3 < to + 1 && line[i + 1] == 'x') {
        word += char(std::stoi(line.substr(i + 2, 2), nullptr, 16));
        i += 3;
      } else if (line[i] == '\\' && i + 1 < to) word += line[++i];
      else word += line[i];
    }
    out.push_back(word);
  }
  return out;
}

constexpr size_t kKindLength = 64;
constexpr size_t kMostKept = 400;  // inputs of the pack: what comes later is a variant, and tests run them all

/// A line of the answer without what depends on the input's names and numbers.
std::string kindOf(const std::string& line, bool accepted) {
  std::string kind = accepted ? "+" : "-";
  char quote = 0;
  for (size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (quote ? c == quote : c == '"' || (c == '\'' && i > 0 && line[i - 1] == ' ')) quote = quote ? 0 : c;
    else if (!quote && !(c >= '0' && c <= '9') && c != '.') kind += c;
  }
  return kind.substr(0, std::min(kind.find(" ("), kKindLength));  // what follows in brackets is a place or a list
}

/// Whether it has a kind that was not there yet.
bool addKinds(const Target& target, const Outcome& outcome, std::set<std::string>& kinds) {
  bool added = false;
  for (size_t at = 0; at <= outcome.said.size();) {
    const size_t end = std::min(outcome.said.find('\n', at), outcome.said.size());
    added = kinds.insert(kindOf(outcome.said.substr(at, end - at), outcome.accepted)).second || added;
    if (!target.lines) break;  // parsers quote the input from the second line on
    at = end + 1;
  }
  return added;
}

/// The input at work, in a mapped file, so that it is there whatever ends the process.
class NowFile {
 public:
  NowFile(std::string path, size_t most) : path_(std::move(path)), most_(most) {
    fs::create_directories(fs::path(path_).parent_path());
    fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (fd_ < 0 || ::ftruncate(fd_, off_t(most)) != 0) {
      std::perror(path_.c_str());
      std::exit(2);
    }
    bytes_ = static_cast<uint8_t*>(::mmap(nullptr, most, PROT_READ | PROT_WRITE, MAP_SHARED, fd_, 0));
    if (bytes_ == MAP_FAILED) {
      std::perror(path_.c_str());
      std::exit(2);
    }
  }
  ~NowFile() {
    ::munmap(bytes_, most_);
    ::close(fd_);
    fs::remove(path_);
  }
  /// The file is the input and no byte more.
  void hold(const std::vector<uint8_t>& input) {
    if (::ftruncate(fd_, off_t(most_)) != 0) {
      std::perror(path_.c_str());
      std::exit(2);
    }
    std::copy(input.begin(), input.end(), bytes_);
    if (::ftruncate(fd_, off_t(input.size())) != 0) {
      std::perror(path_.c_str());
      std::exit(2);
    }
  }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  size_t most_;
  int fd_ = -1;
  uint8_t* bytes_ = nullptr;
};

int run(const Target& target, double seconds, uint64_t seed, const std::vector<std::string>& folders) {
  const std::string name = target.name;
  Inputs seeds, kept;
  for (const std::string& folder : folders)
    for (auto& input : readInputs(folder, target.mostBytes)) seeds.push_back(std::move(input));
  if (seeds.empty()) {
    std::fprintf(stderr, "%s: no seed of at most %zu bytes in the folders\n", name.c_str(), target.mostBytes);
    return 2;
  }
  Mutator mutator(seed, words(target.dictionary), target.mostBytes);
  const std::string out = "out/fuzz/" + name + "." + std::to_string(seed);
  NowFile now(out + ".now", target.mostBytes);
  std::set<std::string> kinds;
  uint64_t executions = 0, accepted = 0;
  const size_t given = seeds.size();
  const auto begun = Clock::now();
  const auto spent = [&] { return std::chrono::duration<double>(Clock::now() - begun).count(); };
  // Without seconds: the files as they are, so a finding can be repeated.
  while (executions < given || spent() < seconds) {
    std::vector<uint8_t> input =
        executions < given ? seeds[size_t(executions)] : mutator.mutate(seeds[mutator.below(seeds.size())], seeds[mutator.below(seeds.size())]);
    now.hold(input);
    limit(kSeconds);
    const Outcome outcome = target.property(input);
    limit(0);
    ++executions;
    accepted += outcome.accepted;
    if (!outcome.broken.empty()) {
      std::fprintf(stderr, "%s: %s\nrepeat: gobo_fuzz_run %s 0 0 FOLDER with %s in it\n", name.c_str(), outcome.broken.c_str(), name.c_str(),
                   now.path().c_str());
      ::_exit(1);
    }
    if (!addKinds(target, outcome, kinds)) continue;
    if (kept.size() < kMostKept) kept.push_back(input);
    if (executions > given && seeds.size() < 5000) seeds.push_back(std::move(input));
  }
  if (const Status s = writePack(out + ".pack", kept); !s.ok()) {
    std::fprintf(stderr, "%s\n", s.toString().c_str());
    return 2;
  }
  std::printf("%s: %llu executions in %.0f s, %llu accepted, %zu kinds of answer, %zu seeds given, %zu made, seed %llu\n", name.c_str(),
              (unsigned long long)executions, spent(), (unsigned long long)accepted, kinds.size(), given, seeds.size() - given, (unsigned long long)seed);
  return 0;
}

int pack(const std::string& file, const std::vector<std::string>& folders) {
  Inputs inputs;
  for (const std::string& folder : folders)
    for (auto& input : readInputs(folder, SIZE_MAX)) inputs.push_back(std::move(input));
  const Status s = writePack(file, inputs);
  if (!s.ok()) std::fprintf(stderr, "%s\n", s.toString().c_str());
  return s.ok() ? 0 : 2;
}

/// A file an input, named by what it is.
int unpack(const std::string& file, const fs::path& folder) {
  const auto inputs = readPack(file);
  if (!inputs.ok()) {
    std::fprintf(stderr, "%s\n", inputs.status().toString().c_str());
    return 2;
  }
  fs::create_directories(folder);
  for (const auto& input : *inputs)
    std::ofstream(folder / hashBytes(input.data(), input.size()).hex(), std::ios::binary)
        .write(reinterpret_cast<const char*>(input.data()), std::streamsize(input.size()));
  std::printf("%zu inputs\n", inputs->size());
  return 0;
}

}  // namespace
}  // namespace gobo::fuzz

int main(int argc, char** argv) {
  using namespace gobo::fuzz;
  const std::string what = argc > 1 ? argv[1] : "";
  google::protobuf::SetLogHandler(nullptr);  // it says of every text that it is not UTF-8
  if (what == "pack" && argc > 3) return pack(argv[2], {argv + 3, argv + argc});
  if (what == "unpack" && argc == 4) return unpack(argv[2], argv[3]);
  std::string names;
  for (const Target& target : everyTarget()) {
    if (what == target.name && argc > 4) return run(target, std::atof(argv[2]), std::strtoull(argv[3], nullptr, 10), {argv + 4, argv + argc});
    names += std::string(names.empty() ? "" : "|") + target.name;
  }
  std::fprintf(stderr, "usage: gobo_fuzz_run %s SECONDS SEED FOLDER...\n       gobo_fuzz_run pack FILE FOLDER... | unpack FILE FOLDER\n", names.c_str());
  return 2;
}
