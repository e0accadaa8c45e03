// SPDX-License-Identifier: Apache-2.0
// Every claim in NodeTraits, tested generically: a filter comes with synthetic inputs, the name of the plane it transforms, and (if it has
// one) a setting at which it is the identity. A new filter adds one entry to `subjects()`.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "filters/picture/picture_filters.h"
#include "unit/filters/synthetic.h"

namespace gobo {
namespace {

using namespace test;

struct Subject {
  const char* name;
  NodePtr node;
  std::vector<TermPtr> inputs;  ///< the first holds `in` in [0, 1]
  const char* in = "V";
  const char* out = "V";
  NodePtr identity;                               ///< the same family at its identity point; null if it has none
  std::function<NodePtr(const Extent&)> sized{};  ///< for a tile, where a node is of one extent
};

Subject axisAlignedSubject() {
  PlaneView view;
  view.width = 96;
  view.height = 80;
  view.layers = 2;
  const Extent e{view.width, view.height, view.layers};
  auto g = planeGBuffer(view);
  auto N = g->writable<float>("N");
  auto id = g->writable<uint32_t>("instance");
  for (size_t i = 0; i < e.elements(); ++i) {  // creases and holes, so that rejections take part
    if ((i / 7) % 13 == 0) N[3 * i] = 0.6f, N[3 * i + 2] = 0.8f;
    if ((i / 11) % 17 == 0) id[i] = ~0u;
  }
  auto omega = floatTerm(e, "Omega", [](int x, int y, int l) { return x % 31 == 5 ? 0.0f : 1.0f / (0.3f * (1 + 0.03f * float(x + y) + float(l))); });
  return {"axis_aligned", axisAligned(axisAlignedSettings(9)), {noiseTerm(e, "V", 21), g, omega}, "V", "V", axisAligned(axisAlignedSettings(0))};
}

/// Filters of pictures, on shares of one channel and on values that may be anything. Identities are left out of plans; these are points beside them that change
/// no bit.
std::vector<Subject> pictureSubjects() {
  std::vector<Subject> all;
  const Extent e{61, 47, 2};
  for (const bool share : {false, true}) {
    const PictureShape s{e, Domain::ViewSample, "V", 1, share};
    const auto in = [&] { return std::vector<TermPtr>{noiseTerm(e, "V", 21)}; };
    const auto tiled = [&](const char* name, const std::function<NodePtr(const PictureShape&)>& make, NodePtr identity) {
      all.push_back({name, make(s), in(), "V", "V", std::move(identity), [=](const Extent& tile) { return make({tile, Domain::ViewSample, "V", 1, share}); }});
    };
    tiled(
        "gaussian", [](const PictureShape& p) { return makeGaussianNode(p, 1.7); }, makeGaussianNode(s, 0.0));
    tiled(
        "sharpen", [](const PictureShape& p) { return makeSharpenNode(p, 1.2, 0.8); }, makeSharpenNode(s, 1.2, 0.0));
    tiled(
        "median", [](const PictureShape& p) { return makeMedianNode(p, 1, 0.0); }, makeMedianNode(s, 0, 0.0));
    tiled(
        "median by deviations", [](const PictureShape& p) { return makeMedianNode(p, 3, 1.0); }, makeMedianNode(s, 0, 1.0));
    tiled(
        "bilateral", [](const PictureShape& p) { return makeBilateralNode(p, 1.3, 0.2); }, makeBilateralNode(s, 1.3, 1e-9));
    all.push_back({"compression", makeCompressionNode(s, 0.1), in()});
    for (const auto kernel :
         {v1::ResampleFilter::BOX, v1::ResampleFilter::TENT, v1::ResampleFilter::GAUSSIAN, v1::ResampleFilter::MITCHELL, v1::ResampleFilter::LANCZOS})
      all.push_back({"resample", makeResampleNode(s, 2.3, kernel, kernel != v1::ResampleFilter::TENT), in()});
  }
  return all;
}

std::vector<Subject> subjects() {
  std::vector<Subject> all = pictureSubjects();
  all.push_back(axisAlignedSubject());
  return all;
}

TermPtr withFirst(const Subject& s, const std::function<float(size_t)>& f) {
  auto t = std::make_shared<Term>(s.inputs[0]->type(), s.inputs[0]->domain(), s.inputs[0]->extent());
  auto v = t->addPlane<float>(s.in);
  for (size_t i = 0; i < v.size(); ++i) v[i] = f(i);
  return t;
}
TermPtr runWith(const Subject& s, const NodePtr& node, TermPtr first, int threads = 2) {
  auto inputs = s.inputs;
  inputs[0] = std::move(first);
  return runFilter(node, inputs, threads);
}

TEST(FilterConformance, DeclaresNoFacet) {
  for (const Subject& s : subjects()) EXPECT_TRUE(s.node->traits().facets == Facet::None) << s.name;
}

TEST(FilterConformance, LinearInItsFirstInput) {
  for (const Subject& s : subjects()) {
    if (!s.node->traits().linearPerGroup) continue;
    const auto x = s.inputs[0]->floats(s.in);
    const auto y = noiseTerm(s.inputs[0]->extent(), s.in, 99);
    const auto fx = runFilter(s.node, s.inputs), fy = runWith(s, s.node, y);
    const float a = 3.5f, b = -1.25f;
    const auto fxy = runWith(s, s.node, withFirst(s, [&](size_t i) { return a * x[i] + b * y->floats(s.in)[i]; }));
    for (size_t i = 0; i < x.size(); ++i) ASSERT_NEAR(fxy->floats(s.out)[i], a * fx->floats(s.out)[i] + b * fy->floats(s.out)[i], 5e-6) << s.name << " " << i;
  }
}

TEST(FilterConformance, KeepsTheRange) {
  for (const Subject& s : subjects()) {
    if (!s.node->traits().rangePreserving) continue;
    const auto x = s.inputs[0]->floats(s.in);
    const auto binary = runWith(s, s.node, withFirst(s, [&](size_t i) { return x[i] < 0.5f ? 0.0f : 1.0f; }));
    for (float v : binary->floats(s.out)) ASSERT_TRUE(v >= 0.0f && v <= 1.0f) << s.name << " " << v;
    const auto shifted = runWith(s, s.node, withFirst(s, [&](size_t i) { return 0.25f + 0.5f * x[i]; }));
    for (float v : shifted->floats(s.out)) ASSERT_TRUE(v >= 0.25f && v <= 0.75f) << s.name << " " << v;
  }
}

TEST(FilterConformance, IdentityPoint) {
  for (const Subject& s : subjects()) {
    if (!s.identity) continue;
    const auto out = runFilter(s.identity, s.inputs);
    const auto x = s.inputs[0]->floats(s.in), y = out->floats(s.out);
    ASSERT_TRUE(std::equal(x.begin(), x.end(), y.begin(), y.end())) << s.name;
  }
}

TEST(FilterConformance, TilesWithTheirHaloEqualTheWhole) {
  for (const Subject& s : subjects()) {
    const NodeTraits traits = s.node->traits();
    if (!traits.tileable) continue;
    const Extent e = s.inputs[0]->extent();
    const auto whole = runFilter(s.node, s.inputs);
    const int tile = 29;  // no multiple of any block
    for (int y0 = 0; y0 < e.height; y0 += tile)
      for (int x0 = 0; x0 < e.width; x0 += tile) {
        const int x1 = std::min(e.width, x0 + tile), y1 = std::min(e.height, y0 + tile);
        const int hx0 = std::max(0, x0 - traits.halo), hy0 = std::max(0, y0 - traits.halo);
        const int hx1 = std::min(e.width, x1 + traits.halo), hy1 = std::min(e.height, y1 + traits.halo);
        std::vector<TermPtr> inputs;
        for (const TermPtr& t : s.inputs) inputs.push_back(t->extent() == e ? TermPtr(cropTerm(*t, hx0, hy0, hx1 - hx0, hy1 - hy0)) : t);
        const auto part = runFilter(s.sized ? s.sized({hx1 - hx0, hy1 - hy0, e.layers}) : s.node, inputs);
        for (int l = 0; l < e.layers; ++l)
          for (int y = y0; y < y1; ++y)
            for (int x = x0; x < x1; ++x)
              ASSERT_EQ(part->floats(s.out)[(size_t(l) * (hy1 - hy0) + y - hy0) * (hx1 - hx0) + x - hx0],
                        whole->floats(s.out)[(size_t(l) * e.height + y) * e.width + x])
                  << s.name << " tile " << x0 << "," << y0 << " pixel " << x << "," << y << "," << l;
      }
  }
}

TEST(FilterConformance, SameBitsForAnyNumberOfThreads) {
  for (const Subject& s : subjects()) {
    const auto one = runFilter(s.node, s.inputs, 1);
    for (int threads : {2, 5, 16}) EXPECT_EQ(runFilter(s.node, s.inputs, threads)->content(), one->content()) << s.name << " " << threads;
  }
}

TEST(FilterConformance, ParametersReachTheKey) {
  for (const Subject& s : subjects()) {
    if (!s.identity) continue;
    Hasher a, b;
    s.node->hashParameters(a);
    s.identity->hashParameters(b);
    EXPECT_NE(a.digest(), b.digest()) << s.name;
  }
}

}  // namespace
}  // namespace gobo
