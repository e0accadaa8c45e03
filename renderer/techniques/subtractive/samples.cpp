// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/samples.h"

#include "techniques/subtractive/distant_arrival.h"

namespace gobo::subtractive {

namespace {

class DistantSamplesNode final : public SamplesNode {
 public:
  explicit DistantSamplesNode(const SamplesSettings& s) : SamplesNode(s.view, s.resampling), lights_(s.lights) {}
  std::string type() const override { return "subtractive_samples"; }
  int version() const override { return 3; }  // 2: rays begin nearer to the surface; 3: what the specular lobe reflects without its table's padding
  void hashParameters(Hasher& h) const override {
    SamplesNode::hashParameters(h);
    for (const DistantLightSample& l : lights_) h.addPod(l.direction).addPod(l.irradiance);
  }

 private:
  class Distant final : public Lights {
   public:
    explicit Distant(const std::vector<DistantLightSample>& lights) : lights_(lights) {}
    void at(const TracedSample& sample, Arrivals& out) const override {
      const SampleFrame frame(sample.point);
      for (const DistantLightSample& light : lights_) {
        Arrivals::Light a;
        if (!arrives(light, sample, frame, a)) continue;
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
