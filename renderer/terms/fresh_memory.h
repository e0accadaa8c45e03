// SPDX-License-Identifier: Apache-2.0
// What memory costs that was not used before: on a virtual machine whose free pages go back to its host the system maps and clears 0.2 to 5 GB/s,
// several times slower than a node fills it. Measured as blocks are mapped (ZeroedBytes), so that who keeps results can tell when keeping one costs more than
// making it again. Thread-safe. Decides what is kept, never what is in it.
#pragma once

namespace gobo {
inline namespace terms {

/// Milliseconds of one thread for a MiB of fresh memory: the mean over the last blocks, newest first in weight; 0 before the first block.
double freshMemoryMsPerMiB();

/// The mean that freshMemoryMsPerMiB() is of: a block's `ms` for `mib`. For blocks of less than a huge page nothing is counted.
double meanFreshMs(double before, double ms, double mib);

}  // namespace terms
}  // namespace gobo
