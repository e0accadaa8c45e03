// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/samples.h"

#include "techniques/subtractive/samples_node.h"

namespace gobo::subtractive {

namespace {

class DistantSamplesNode final : public SamplesNode {
 public:
  explicit DistantSamplesNode(const SamplesSettings& s) : SamplesNode(s.view, s.resampling), lights_(s.lights) {}
  std::string type() const override { return "subtractive_samples"; }
  void hashParameters(Hasher& h) const override {
    SamplesNode::hashParameters(h);
    for (const DistantLightSample& l : lights_) h.addPod(l.direction).addPod(l.irradiance);
  }

 private:
  class Distant final : public Lights {
   public:
    explicit Distant(const std::vector<DistantLightSample>& lights) : lights_(lights) {}
    void at(const TracedSample& sample, Arrivals& out) const override {
      const LitPoint& r = sample.point;
      const Frame frame = r.frame();
      const Vec3 wo = frame.toLocal(r.wo);
      for (const DistantLightSample& light : lights_) {
        if (!(glm::dot(light.direction, r.ng) > 0) || !(glm::dot(light.direction, r.n) > 0)) continue;
        const BsdfValue f = bsdfEval(r.bsdf, wo, frame.toLocal(light.direction));
        Arrivals::Light a{{byAlbedo(f.diffuse * light.irradiance, sample.by.diffuse), byAlbedo(f.specular * light.irradiance, sample.by.specular)}, {}};
        if (a.lobe[0] == Vec3(0.0f) && a.lobe[1] == Vec3(0.0f)) continue;
        a.point.direction = light.direction;
        a.point.distance = 3.0e38f;
        out.lights.push_back(a);
      }
    }

   private:
    const std::vector<DistantLightSample>& lights_;
  };

  std::unique_ptr<const Lights> lights(const RunContext&) const override { return std::make_unique<const Distant>(lights_); }
  size_t looked() const override { return lights_.size(); }
  size_t rays() const override { return lights_.size(); }

  std::vector<DistantLightSample> lights_;
};

}  // namespace

NodePtr makeSamplesNode(const SamplesSettings& settings) { return std::make_shared<DistantSamplesNode>(settings); }

}  // namespace gobo::subtractive
