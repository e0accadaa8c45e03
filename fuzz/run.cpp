// SPDX-License-Identifier: Apache-2.0
// gobo_fuzz_run TARGET SECONDS SEED FOLDER...: the properties under inputs that are made out of the files in the folders, built by any compiler
// and so with any sanitizer. It sees no branches: an input whose answer is of a new kind (its words without numbers and quotations) becomes a seed.
// The input at work is in out/fuzz/TARGET.SEED.now, also after a crash; a property that does not hold, a crash and more than kSeconds of processor for one
// input end the process with that file kept and the words that repeat it.
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
#include <map>
#include <set>

#include "fuzz/mutator.h"
#include "fuzz/properties.h"

namespace gobo::fuzz {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
constexpr long kSeconds = 60;   // of processor for one input: instrumented code is slow

struct Target { Outcome (*property)(Bytes); size_t mostBytes; const char* dictionary; };
const std::map<std::string, Target> kTargets{{"gltf", {tryGltf, 24 << 10, "gltf"}}, {"image", {tryImage, 8 << 10, "image"}}, {"blob", {tryBlob, 8 << 10, ""}},
                                             {"request_json", {tryRequestText, 4 << 10, "request"}}, {"request_proto", {tryRequestBytes, 4 << 10, "request"}}};

std::vector<uint8_t> contents(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
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
      if (line[i] == '\\' && i + 3 < to + 1 && line[i + 1] == 'x') { word += char(std::stoi(line.substr(i + 2, 2), nullptr, 16)); i += 3; }
      else if (line[i] == '\\' && i + 1 < to) word += line[++i];
      else word += line[i];
    }
    out.push_back(word);
  }
  return out;
}

/// The answer without what depends on the input's names and numbers.
std::string kindOf(const Outcome& outcome) {
  std::string kind = outcome.accepted ? "+" : "-";
  bool quoted = false;
  for (const char c : outcome.said) {
    if (c == '"') quoted = !quoted;
    else if (!quoted && !(c >= '0' && c <= '9') && c != '.') kind += c;
  }
  return kind.substr(0, 160);
}

/// The input at work, in a mapped file, so that it is there whatever ends the process.
class NowFile {
 public:
  NowFile(std::string path, size_t most) : path_(std::move(path)), most_(most) {
    fs::create_directories(fs::path(path_).parent_path());
    fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (fd_ < 0 || ::ftruncate(fd_, off_t(most)) != 0) { std::perror(path_.c_str()); std::exit(2); }
    bytes_ = static_cast<uint8_t*>(::mmap(nullptr, most, PROT_READ | PROT_WRITE, MAP_SHARED, fd_, 0));
    if (bytes_ == MAP_FAILED) { std::perror(path_.c_str()); std::exit(2); }
  }
  ~NowFile() { ::munmap(bytes_, most_); ::close(fd_); fs::remove(path_); }
  /// The file is the input and no byte more.
  void hold(const std::vector<uint8_t>& input) {
    if (::ftruncate(fd_, off_t(most_)) != 0) { std::perror(path_.c_str()); std::exit(2); }
    std::copy(input.begin(), input.end(), bytes_);
    if (::ftruncate(fd_, off_t(input.size())) != 0) { std::perror(path_.c_str()); std::exit(2); }
  }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  size_t most_;
  int fd_ = -1;
  uint8_t* bytes_ = nullptr;
};

int run(const std::string& name, const Target& target, double seconds, uint64_t seed, const std::vector<std::string>& folders) {
  std::vector<std::vector<uint8_t>> seeds;
  for (const std::string& folder : folders) {
    std::error_code error;
    std::vector<fs::path> files;
    for (auto it = fs::recursive_directory_iterator(folder, error); !error && it != fs::recursive_directory_iterator(); it.increment(error))
      if (it->is_regular_file() && it->file_size() <= target.mostBytes) files.push_back(it->path());
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) seeds.push_back(contents(file));
  }
  if (seeds.empty()) { std::fprintf(stderr, "%s: no seed of at most %zu bytes in the folders\n", name.c_str(), target.mostBytes); return 2; }
  Mutator mutator(seed, words(target.dictionary), target.mostBytes);
  NowFile now("out/fuzz/" + name + "." + std::to_string(seed) + ".now", target.mostBytes);
  std::set<std::string> kinds;
  uint64_t executions = 0, accepted = 0;
  const size_t given = seeds.size();
  const auto begun = Clock::now();
  const auto spent = [&] { return std::chrono::duration<double>(Clock::now() - begun).count(); };
  // Without seconds: the files as they are, so a finding can be repeated.
  while (executions < given || spent() < seconds) {
    std::vector<uint8_t> input = executions < given ? seeds[size_t(executions)] : mutator.mutate(seeds[mutator.below(seeds.size())], seeds[mutator.below(seeds.size())]);
    now.hold(input);
    limit(kSeconds);
    const Outcome outcome = target.property(input);
    limit(0);
    ++executions;
    accepted += outcome.accepted;
    if (!outcome.broken.empty()) {
      std::fprintf(stderr, "%s: %s\nrepeat: gobo_fuzz_run %s 0 0 FOLDER with %s in it\n", name.c_str(), outcome.broken.c_str(), name.c_str(), now.path().c_str());
      ::_exit(1);
    }
    if (kinds.insert(kindOf(outcome)).second && executions > given && seeds.size() < 5000) seeds.push_back(std::move(input));
  }
  std::printf("%s: %llu executions in %.0f s, %llu accepted, %zu kinds of answer, %zu seeds given, %zu made, seed %llu\n", name.c_str(), (unsigned long long)executions, spent(),
              (unsigned long long)accepted, kinds.size(), given, seeds.size() - given, (unsigned long long)seed);
  return 0;
}

}  // namespace
}  // namespace gobo::fuzz

int main(int argc, char** argv) {
  const auto target = argc > 4 ? gobo::fuzz::kTargets.find(argv[1]) : gobo::fuzz::kTargets.end();
  if (target == gobo::fuzz::kTargets.end()) {
    std::fprintf(stderr, "usage: gobo_fuzz_run gltf|image|blob|request_json|request_proto SECONDS SEED FOLDER...\n");
    return 2;
  }
  return gobo::fuzz::run(target->first, target->second, std::atof(argv[2]), std::strtoull(argv[3], nullptr, 10), {argv + 4, argv + argc});
}
