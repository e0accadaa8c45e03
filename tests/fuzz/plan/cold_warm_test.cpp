// SPDX-License-Identifier: Apache-2.0
// Cold = warm: whatever was rendered before, a reply equals that of an empty store. `make bench` runs thousands of sequences.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "fuzz/plan/edit_sequences.h"
#include "fuzz/properties.h"
#include "support/thorough.h"
#include "support/twin_files.h"

namespace gobo::testing {
namespace {

int sequences(int standard) {
  const char* asked = std::getenv("GOBO_FUZZ_SEQUENCES");
  return asked ? std::max(1, std::atoi(asked)) : standard;
}

/// How often a request was rendered after each field was edited.
std::map<std::string, int> runSequences(uint64_t firstSeed, int count, int steps, uint64_t storeBytes, bool disk) {
  int reused = 0, ran = 0;
  std::map<std::string, int> rendered;
  const auto rich = std::filesystem::temp_directory_path() / ("gobo-rich-" + std::to_string(getpid()) + ".gltf");
  std::ofstream(rich) << fuzz::richGltf();
  for (int s = 0; s < count; ++s) {
    const auto folder = std::filesystem::temp_directory_path() / ("gobo-fuzz-" + std::to_string(getpid()) + "-" + std::to_string(s));
    EditSequence sequence(firstSeed + uint64_t(s), storeBytes, disk ? folder.string() : std::string(), {rich.string()});
    const SequenceResult r = sequence.run(steps);
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
    EXPECT_EQ(r.failure, "") << "sequence seed " << firstSeed + s;
    if (!r.failure.empty()) break;
    reused += r.reusedNodes;
    ran += r.ranNodes;
    for (const auto& [path, n] : r.rendered) rendered[path] += n;
  }
  std::error_code ignored;
  std::filesystem::remove(rich, ignored);
  // The test is empty if nothing is ever reused.
  EXPECT_GT(reused, count);
  std::cout << count << " sequences, " << ran << " nodes run, " << reused << " reused\n";
  return rendered;
}

TEST(ColdWarm, RandomEditsOfEveryFieldLargeStore) {
  const int most = 560, count = sequences(thoroughOr(most, 280));
  const std::map<std::string, int> rendered = runSequences(1, count, 8, 256ull << 20, false);
  if (HasFailure()) return;
  size_t never = 0;
  for (const fuzz::SchemaLeaf& leaf : requestLeaves()) {
    // Of a file that somebody put, and of a config of colours: an engine by itself has neither.
    if (leaf.path == "environment.digest" || leaf.path == "encoding.view" || leaf.path == "encoding.look") continue;
    const auto at = rendered.find(leaf.path);
    if (at != rendered.end() && at->second > 0) continue;
    ++never;
    std::cout << "never rendered: " << leaf.path << (at == rendered.end() ? " (never edited)" : "") << "\n";
  }
  std::cout << requestLeaves().size() << " fields, " << never << " never rendered after an edit\n";
  // What was refused with what else was drawn; of fewer sequences more was.
  if (count >= 280) { EXPECT_LE(never, requestLeaves().size() / (count >= most ? 32 : 16)); }
}
TEST(ColdWarm, RandomEditsTinyStoreEvicts) { runSequences(100001, sequences(60), 6, 96ull << 10, false); }
// Files that differ in one texture or one accessor alone, in one engine: what is shared must be equal, and nothing else is shared.
void runFileSequences(uint64_t firstSeed, int count, int steps, uint64_t storeBytes) {
  const std::vector<TwinFile> twins = twinFiles();
  const auto folder = std::filesystem::temp_directory_path() / ("gobo-twins-" + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  std::vector<std::string> paths;
  for (const TwinFile& t : twins) {
    paths.push_back((folder / ("twin" + std::to_string(paths.size()) + ".gltf")).string());
    std::ofstream(paths.back()) << t.text;
  }
  int reused = 0, switches = 0;
  for (int s = 0; s < count; ++s) {
    const size_t a = 1 + size_t(s) % (twins.size() - 1), b = 1 + size_t(s * 5 + 3) % (twins.size() - 1);
    EditSequence sequence(firstSeed + uint64_t(s), storeBytes, {}, {paths[0], paths[a], paths[b]});
    const SequenceResult r = sequence.run(steps);
    ASSERT_EQ(r.failure, "") << "sequence seed " << firstSeed + s << ", changed: " << twins[a].change << ", " << twins[b].change;
    reused += r.reusedNodes;
    switches += r.switches;
  }
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  EXPECT_GT(reused, count);
  EXPECT_GT(switches, count / 2) << "files are hardly ever changed: the test says little";
  std::cout << count << " sequences, " << switches << " changes of file, " << reused << " nodes reused\n";
}

TEST(ColdWarm, EveryTwinFileAfterTheOther) {
  const std::vector<TwinFile> twins = twinFiles();
  const auto warm = makeEngine();
  const std::string path = (std::filesystem::temp_directory_path() / ("gobo-twin-" + std::to_string(getpid()) + ".gltf")).string();
  const auto request = [](const std::string& scene) {
    v1::RenderRequest r = smallRequest(scene, 16, 12, 2);
    for (const char* e :
         {"outputs=beauty,albedo,normal,depth,alpha,direct,visibility:lamp,visibility:sun", "lights.lamp.kind=RECT", "lights.lamp.position=0.3,2.5,0.2",
          "lights.lamp.direction=0,-1,0", "lights.lamp.intensity=3", "lights.lamp.shadow.ray_traced.samples=2", "lights.sun.kind=DIRECTIONAL",
          "lights.sun.direction=0.1,-1,-0.1", "lights.sun.shadow.percentage_closer.taps=2", "lights.sun.shadow.map.resolution=16"})
      set(r, e);
    return r;
  };
  int different = 0, reused = 0;
  RenderResult first;
  for (size_t k = 0; k < twins.size(); ++k) {
    std::ofstream(path) << twins[k].text;
    const std::string name = "twin" + std::to_string(k);
    const auto cold = makeEngine();
    for (Engine* e : {warm.get(), cold.get()}) ASSERT_TRUE(e->openScene(path, name).ok()) << twins[k].change;
    const RenderResult here = mustRender(*warm, request(name)), fresh = mustRender(*cold, request(name));
    EXPECT_EQ(firstDifference(here, fresh), "") << twins[k].change;
    if (k == 0) {
      first = fresh;
      continue;
    }
    reused += int(nodesBy(here, v1::NodeReport::REUSED).size());
    EXPECT_NE(firstDifference(fresh, first), "") << twins[k].change << ": the change is invisible, the row says nothing";
    different += !firstDifference(fresh, first).empty();
  }
  std::error_code ignored;
  std::filesystem::remove(path, ignored);
  EXPECT_GT(reused, 10);
  EXPECT_EQ(different, int(twins.size()) - 1);
}

TEST(ColdWarm, RandomEditsAcrossTwinFiles) { runFileSequences(300001, sequences(42), 8, 256ull << 20); }
TEST(ColdWarm, RandomEditsDiskTier) { runSequences(200001, sequences(30), 6, 48ull << 10, true); }

}  // namespace
}  // namespace gobo::testing
