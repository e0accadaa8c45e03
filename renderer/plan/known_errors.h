// SPDX-License-Identifier: Apache-2.0
// KnownErrors: how wrong finished pictures were, so that a dry run can say how wrong the next one will be. Of each picture (its request without
// samples, seed, size and encoding) the noise that its snapshots showed and its last two certificates; of each scene the noise of whichever picture was last.
// Nothing is traced for it. Bounded: the picture that was least recently rendered goes. Thread-safe.
#pragma once

#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

#include "base/hash.h"
#include "base/latest_map.h"
#include "gobo/v1/render.pb.h"

namespace gobo {
inline namespace plan {

struct ExpectedError {
  double standardError = 0;  ///< root of the mean variance of the beauty's pixels and channels, radiance; 0: not known
  double rmse = 0;           ///< of the beauty against the truth, radiance; 0: not known
  std::string from;          ///< in words; empty: nothing is known
};

class KnownErrors {
 public:
  explicit KnownErrors(size_t keep = 1024) : pictures_(keep) {}
  /// Of a finished picture: its resolved request with the samples that it got, and what the reply says of its errors.
  void add(const v1::RenderReply& reply);
  /// Of a resolved request at `spp` samples. `onlyNoise`: nothing of it but noise, which more samples take away, is wrong (samplesDecideAll()).
  ///
  /// A mean square error is b^2 + v / n: what samples do not change (0 where `onlyNoise`), and their variance. Snapshots tell v, a certificate the
  /// sum at its n; so does a second certificate at another n. Where one certificate is all that is known, its error is given as it was.
  ExpectedError at(const v1::RenderRequest& resolved, uint32_t spp, bool onlyNoise) const;

 private:
  struct Measured {
    double samples = 0, meanSquare = 0;
  };
  struct Picture {
    double variance = 0;                 // of one sample; 0: not known
    uint32_t noiseAt = 0;                // samples that it was found with
    std::vector<Measured> certificates;  // at most two, of different counts; the later last
  };

  mutable std::mutex mutex_;
  LatestMap<Hash128, Picture> pictures_;
};

}  // namespace plan
}  // namespace gobo
