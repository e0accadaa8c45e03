// SPDX-License-Identifier: Apache-2.0
// The filters that request.filters may name: one line each.
#include "filters/parameter.h"
#include "filters/picture/chain.h"
#include "filters/picture/picture_filters.h"

namespace gobo {
inline namespace filters {

namespace {

using RequestFilter = v1::PictureFilter;
double parameterOf(const google::protobuf::Message& m, const char* name) { return numberParameter(m, name); }

const char* noGaussian(const RequestFilter& f) { return parameterOf(f.gaussian(), "sigma_px") > 0.0 ? nullptr : "sigma_px is 0"; }
NodePtr gaussianNode(PictureShape s, const RequestFilter& f) { return makeGaussianNode(std::move(s), parameterOf(f.gaussian(), "sigma_px")); }

const char* noSharpen(const RequestFilter& f) {
  return !(parameterOf(f.sharpen(), "amount") > 0.0) ? "amount is 0" : !(parameterOf(f.sharpen(), "sigma_px") > 0.0) ? "sigma_px is 0" : nullptr;
}
NodePtr sharpenNode(PictureShape s, const RequestFilter& f) {
  return makeSharpenNode(std::move(s), parameterOf(f.sharpen(), "sigma_px"), parameterOf(f.sharpen(), "amount"));
}

const char* noMedian(const RequestFilter& f) { return parameterOf(f.median(), "radius_px") > 0.0 ? nullptr : "radius_px is 0"; }
NodePtr medianNode(PictureShape s, const RequestFilter& f) {
  return makeMedianNode(std::move(s), int(parameterOf(f.median(), "radius_px")), parameterOf(f.median(), "deviations"));
}

const char* noBilateral(const RequestFilter& f) { return parameterOf(f.bilateral(), "sigma_px") > 0.0 ? nullptr : "sigma_px is 0"; }
NodePtr bilateralNode(PictureShape s, const RequestFilter& f) {
  return makeBilateralNode(std::move(s), parameterOf(f.bilateral(), "sigma_px"), parameterOf(f.bilateral(), "range"));
}

const char* noBloom(const RequestFilter& f) { return parameterOf(f.bloom(), "gain") > 0.0 ? nullptr : "gain is 0"; }
NodePtr bloomNode(PictureShape s, const RequestFilter& f) {
  return makeBloomNode(std::move(s), parameterOf(f.bloom(), "threshold"), parameterOf(f.bloom(), "gain"), parameterOf(f.bloom(), "radius_px"));
}

const char* noCompression(const RequestFilter& f) { return parameterOf(f.compression(), "share") < 1.0 ? nullptr : "share is 1"; }
NodePtr compressionNode(PictureShape s, const RequestFilter& f) { return makeCompressionNode(std::move(s), parameterOf(f.compression(), "share")); }

const char* noResample(const RequestFilter& f) { return parameterOf(f.resample(), "factor") > 1.0 ? nullptr : "factor is 1"; }
NodePtr resampleNode(PictureShape s, const RequestFilter& f) {
  return makeResampleNode(std::move(s), parameterOf(f.resample(), "factor"), v1::ResampleFilter::Kernel(choiceParameter(f.resample(), "kernel")),
                          boolParameter(f.resample(), "prefilter"));
}

std::array<double, 3> transmittanceOf(const RequestFilter& f) {
  return {parameterOf(f.color_balance(), "red"), parameterOf(f.color_balance(), "green"), parameterOf(f.color_balance(), "blue")};
}
const char* noColorBalance(const RequestFilter& f) {
  if (!(parameterOf(f.color_balance(), "density") > 0.0)) return "density is 0";
  return transmittanceOf(f) == std::array<double, 3>{1.0, 1.0, 1.0} ? "red, green and blue are 1" : nullptr;
}
NodePtr colorBalanceNode(PictureShape s, const RequestFilter& f) {
  return makeColorBalanceNode(std::move(s), transmittanceOf(f), parameterOf(f.color_balance(), "density"), boolParameter(f.color_balance(), "keep_luminance"));
}

}  // namespace

const std::vector<PictureFilterEntry>& pictureFilters() {
  static const std::vector<PictureFilterEntry> table{
      {RequestFilter::kGaussian, "gaussian", true, noGaussian, gaussianNode},
      {RequestFilter::kSharpen, "sharpen", true, noSharpen, sharpenNode},
      {RequestFilter::kMedian, "median", true, noMedian, medianNode},
      {RequestFilter::kBilateral, "bilateral", true, noBilateral, bilateralNode},
      {RequestFilter::kBloom, "bloom", false, noBloom, bloomNode},
      {RequestFilter::kCompression, "compression", true, noCompression, compressionNode},
      {RequestFilter::kResample, "resample", true, noResample, resampleNode},
      {RequestFilter::kColorBalance, "color_balance", false, noColorBalance, colorBalanceNode},
  };
  return table;
}

const PictureFilterEntry* findPictureFilter(v1::PictureFilter::FilterCase key) {
  for (const PictureFilterEntry& e : pictureFilters())
    if (e.key == key) return &e;
  return nullptr;
}

}  // namespace filters
}  // namespace gobo
