// SPDX-License-Identifier: Apache-2.0
// Machines as /proc/cpuinfo has them, and commands without folders of this one.
#include "measurement/provenance.h"

#include <gtest/gtest.h>

namespace gobo::cli {
namespace {

TEST(Provenance, CoresAreCountedOnceAndProcessorsEach) {
  std::string text;
  for (int package = 0; package < 2; ++package)
    for (int core = 0; core < 3; ++core)
      for (int thread = 0; thread < 2; ++thread)
        text += "processor\t: " + std::to_string(package * 6 + core * 2 + thread) +
                "\nmodel name\t: A: CPU  @ 2 GHz\nphysical id\t: " + std::to_string(package) + "\ncore id\t\t: " + std::to_string(core) + "\nflags\t:\n\n";
  const Machine m = machineOf(text);
  EXPECT_EQ(m.cpu, "A: CPU  @ 2 GHz");
  EXPECT_EQ(m.cores, 6);
  EXPECT_EQ(m.logicalCores, 12);
  EXPECT_EQ(machineOf("").logicalCores, 0);
  EXPECT_EQ(machineOf("no colon\n:\n :\n").cpu, "");
  EXPECT_GT(thisMachine().logicalCores, 0);
}

TEST(Provenance, CommandsHaveNoFoldersAndAreWhatAShellReads) {
  EXPECT_EQ(commandText("gobo measure", {{"SCENE", "", "/home/me/scenes/my room.glb"},
                                         {"FILE", "--csv", "../out/m.csv"},
                                         {"PATH=VALUE", "--set", "environment.path=/data/sky.hdr"},
                                         {"PATH=VALUE", "--set", "shadows.axis_aligned.k=3"},
                                         {"PATH=T:V,T:V", "--curve", "lights.key.position=0:0/1/2,1:3/1/2;SMOOTH"},
                                         {"NAME", "--series", "it's \"A\" $x"},
                                         {"", "--cold", "", false},
                                         {"NAME", "--series", ""}}),
            "gobo measure 'my room.glb' --csv m.csv --set environment.path=sky.hdr --set shadows.axis_aligned.k=3 "
            "--curve 'lights.key.position=0:0/1/2,1:3/1/2;SMOOTH' --series 'it'\\''s \"A\" $x' --cold --series ''");
}

TEST(Provenance, FoldersOfValues) {
  EXPECT_EQ(withoutFolders("/a/b/c.hdr"), "c.hdr");
  EXPECT_EQ(withoutFolders("~/c.hdr"), "c.hdr");
  EXPECT_EQ(withoutFolders("./c.hdr"), "c.hdr");
  EXPECT_EQ(withoutFolders("a/b"), "a/b");  // may be numbers of a vector
  EXPECT_EQ(withoutFolders("environment.path=../c.hdr"), "environment.path=c.hdr");
  EXPECT_EQ(withoutFolders("/a=b/c"), "c");
  EXPECT_EQ(withoutFolders("x=1"), "x=1");
  EXPECT_EQ(fileName("a/"), "");
}

}  // namespace
}  // namespace gobo::cli
