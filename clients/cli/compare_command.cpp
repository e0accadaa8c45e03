// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <utility>

#include "base/image_io.h"
#include "commands.h"
#include "measure/metrics.h"
#include "pictures.h"
#include "report.h"

namespace gobo::cli {

int runCompare(const CompareCommand& c) {
  if (const Status folder = checkFolder("--diff", c.diff); !folder.ok()) return complain(folder);
  if (!c.diff.empty()) {
    const auto format = formatOf(c.diff);
    if (!format.ok() || *format != v1::Encoding::PNG) return complain(invalidArgument("--diff " + c.diff + ": must end in .png"));
  }
  auto a = readPicture(c.a);
  if (!a.ok()) return complain(a.status());
  auto b = readPicture(c.b);
  if (!b.ok()) return complain(b.status());
  for (const auto& [name, image] : {std::pair(c.a, &*a), std::pair(c.b, &*b)})
    if (image->channels == 2) return complain(invalidArgument("has two channels: what is compared has one, three or four", name));
  auto e = compareImages(*a, *b);
  if (!e.ok()) return complain(e.status());
  if (!c.diff.empty()) {
    const double scale = c.scale > 0 ? c.scale : e->maxAbs > 0 ? e->maxAbs : 1;
    auto bytes = encodePng(differenceImage(*a, *b, float(scale)));
    if (!bytes.ok()) return complain(bytes.status());
    if (const Status status = writeFileAtomic(c.diff, bytes->data(), bytes->size()); !status.ok()) return complain(status);
  }
  if (c.json) {
    std::printf(
        "{\"rmse\": %s, \"relMse\": %s, \"meanAbs\": %s, \"p99\": %s, \"maxAbs\": %s, \"ssim\": %s, \"flip\": %s, "
        "\"meanA\": %s, \"meanB\": %s, \"differingPixels\": %zu, \"nonFinite\": %zu, \"nonFiniteApart\": %zu, \"pixels\": %zu}\n",
        jsonNumber(e->rmse).c_str(), jsonNumber(e->relMse).c_str(), jsonNumber(e->meanAbs).c_str(), jsonNumber(e->p99).c_str(), jsonNumber(e->maxAbs).c_str(),
        jsonNumber(e->ssim).c_str(), jsonNumber(e->flip).c_str(), jsonNumber(e->meanA).c_str(), jsonNumber(e->meanB).c_str(), e->differingPixels, e->nonFinite,
        e->nonFiniteApart, a->pixels());
  } else {
    std::printf("RMSE %.6g, relMSE %.6g, mean |d| %.6g, p99 %.6g, max %.6g, SSIM %.6g, FLIP %.6g\n", e->rmse, e->relMse, e->meanAbs, e->p99, e->maxAbs, e->ssim,
                e->flip);
    std::printf("mean luminance %.6g and %.6g; %zu of %zu pixels differ; %zu not finite\n", e->meanA, e->meanB, e->differingPixels, a->pixels(), e->nonFinite);
  }
  if (c.maxRmse < 0) return kOk;
  if (e->nonFiniteApart > 0) std::fprintf(stderr, "gobo: --max-rmse: %zu pixels are not finite, and not the same in both\n", e->nonFiniteApart);
  return e->nonFiniteApart == 0 && e->rmse <= c.maxRmse ? kOk : kFailure;
}

}  // namespace gobo::cli
