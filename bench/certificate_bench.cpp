// SPDX-License-Identifier: Apache-2.0
// Coverage and width of the certificate's interval on synthetic pictures with a known truth: docs/certificate.md.
//   certificate_bench [--seeds 1000] [--fraction 0.01] [--size 512] [--out table.json|.csv|.md|.txt]
// Exit status 1 when a case misses what docs/certificate.md promises.
#include <cstdio>
#include <cstdlib>

#include "../tests/support/certificate_cases.h"
#include "measure/report.h"

int main(int argc, char** argv) {
  using namespace gobo;
  using namespace gobo::testing;
  const int seeds = std::atoi(argumentOr(argc, argv, "--seeds", "1000").c_str());
  const double fraction = std::atof(argumentOr(argc, argv, "--fraction", "0.01").c_str());
  const int size = std::atoi(argumentOr(argc, argv, "--size", "512").c_str());
  const std::string path = argumentOr(argc, argv, "--out", "");
  if (seeds < 1 || fraction <= 0 || fraction > 1 || size < 8) {
    std::fprintf(stderr, "certificate_bench: --seeds at least 1, --fraction in (0,1], --size at least 8\n");
    return 2;
  }
  Table table("certificate", {"picture", "RMSE", "half the error in % of pixels", "holds RMSE", "claim holds", "half-width %",
                              "rel: holds", "rel: claim", "rel: half-width %", "promised"});
  table.note("seeds", double(seeds));
  table.note("pixels drawn", double(certificatePixels(size, size, fraction, 1).size()));
  table.note("of", double(size) * size);
  bool kept = true;
  for (const CertificateCase& picture : certificateCases(size)) {
    const Coverage c = measureCoverage(picture, fraction, seeds);
    const bool whole = picture.kind != Kind::Hidden;
    const bool ok = c.claimed >= 0.93 && c.relClaimed >= 0.93 && (!whole || c.whole >= 0.93) && (!picture.widthPromised || c.halfWidth <= 0.25);
    kept = kept && ok;
    table.add({picture.name, picture.rmse, 100 * picture.halfErrorArea(), c.whole, c.claimed, 100 * c.halfWidth, c.relWhole, c.relClaimed,
               100 * c.relHalfWidth, std::string(picture.widthPromised ? "93 %, width 25 %" : whole ? "93 %" : "claim 93 %") + (ok ? "" : " MISSED")});
  }
  std::fputs(table.text().c_str(), stdout);
  if (!path.empty())
    if (const Status status = table.write(path); !status.ok()) {
      std::fprintf(stderr, "%s\n", status.toString().c_str());
      return 2;
    }
  return kept ? 0 : 1;
}
