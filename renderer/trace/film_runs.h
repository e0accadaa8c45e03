// SPDX-License-Identifier: Apache-2.0
// Which pixels of a film have their rays go together, along one of its axes. Company may decide between triangles at the same distance: it is the same one
// whatever part of the picture is made.
#pragma once

#include <algorithm>
#include <vector>

namespace gobo {
inline namespace trace {

/// Pixels first .. first + count - 1 of a film.
struct FilmRun {
  int first, count;
};

/// Runs of `size` pixels that touch a view's from .. from + count - 1, in order; those at its ends may go beyond it. They are counted from the first pixel of
/// the film, whose last run may be shorter; what a view has outside the film (a guard band) is in runs of its own.
inline std::vector<FilmRun> filmRuns(int from, int count, int film, int size) {
  const auto down = [size](int v) { return (v >= 0 ? v : v - size + 1) / size * size; };
  std::vector<FilmRun> runs;
  for (int at = from < film ? down(from) : film + down(from - film); at < from + count; at += runs.back().count)
    runs.push_back({at, at < film ? std::min(size, film - at) : size});
  return runs;
}

}  // namespace trace
}  // namespace gobo
