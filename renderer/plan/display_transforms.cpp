// SPDX-License-Identifier: Apache-2.0
#include "plan/display_transforms.h"

#include <algorithm>
#include <cmath>

#include "formulas/tone_map.glsl.h"
#include "plan/straight_alpha.h"

namespace gobo {
inline namespace plan {
namespace {

std::string listed(const std::vector<std::string>& names) {
  constexpr size_t kMost = 40;  // a config may have hundreds
  std::string text;
  for (size_t i = 0; i < std::min(names.size(), kMost); ++i) text += (i ? ", \"" : "\"") + names[i] + "\"";
  return names.empty() ? "none" : names.size() > kMost ? text + " and " + std::to_string(names.size() - kMost) + " more" : text;
}

bool hasName(const std::vector<std::string>& names, const std::string& name) { return std::find(names.begin(), names.end(), name) != names.end(); }

/// "request.encoding.view = \"Flim\"", of a request's own text.
std::string given(const char* field, const std::string& value) { return std::string("request.encoding.") + field + " = \"" + value.substr(0, 200) + "\""; }

Status sameConfig(const v1::Encoding& e, const ColorConfig& c) {
  if (e.ocio_hash().empty() || e.ocio_hash() == c.hash()) return {};
  return {Code::FailedPrecondition, given("ocio_hash", e.ocio_hash()) + ": the OpenColorIO config here, \"" + c.file() + "\", has " + c.hash(),
          "request.encoding.ocio_hash"};
}

Status refused(const char* field, const std::string& value, const std::string& why) {
  return invalidArgument(given(field, value) + ": " + why, std::string("request.encoding.") + field);
}

/// Whether a mask names `field` ("encoding.view") or a message that holds it.
bool masks(const google::protobuf::RepeatedPtrField<std::string>& mask, const std::string& field) {
  return std::any_of(mask.begin(), mask.end(), [&](const std::string& path) { return field == path || field.starts_with(path + "."); });
}

}  // namespace

bool throughView(const v1::Encoding& e) { return !e.display().empty() || !e.view().empty(); }

void replaceView(v1::RenderRequest& base, const google::protobuf::RepeatedPtrField<std::string>& mask) {
  v1::Encoding& e = *base.mutable_encoding();
  if (!throughView(e)) return;
  if (masks(mask, "encoding.display") || masks(mask, "encoding.view") || masks(mask, "encoding.look")) {
    if (!masks(mask, "tone_map.curve")) base.mutable_tone_map()->clear_curve();
    if (!masks(mask, "encoding.transfer")) e.clear_transfer();
    // Of another display the view that the base had is not meant.
    if (masks(mask, "encoding.display") && !masks(mask, "encoding.view")) e.clear_view();
  } else if ((masks(mask, "tone_map.curve") && base.tone_map().has_curve()) || (masks(mask, "encoding.transfer") && e.has_transfer())) {
    e.clear_display();
    e.clear_view();
    e.clear_look();
    e.clear_ocio_hash();
  }
}

DisplayTransforms::DisplayTransforms(Options options) : options_(std::move(options)) {}

Result<std::shared_ptr<const ColorConfig>> DisplayTransforms::config() {
  const std::lock_guard lock(mutex_);
  if (!config_) {
    config_ =
        options_.file.empty()
            ? Result<std::shared_ptr<const ColorConfig>>(Status(Code::FailedPrecondition,
                                                                "no OpenColorIO config is loaded: [color] ocio of gobod.toml names one, or the environment "
                                                                "variable OCIO of the daemon; of gobo --local, --ocio or OCIO"))
            : openColorConfig(options_.file, options_.workingSpace);
    if (config_->ok() && options_.say && !(**config_)->caution().empty())
      options_.say("OpenColorIO config \"" + options_.file + "\": " + (**config_)->caution());
  }
  return *config_;
}

Status DisplayTransforms::load() { return options_.file.empty() ? Status() : config().status(); }

Status DisplayTransforms::check() {
  if (options_.file.empty()) return {};
  GOBO_ASSIGN(const std::shared_ptr<const ColorConfig> c, config());
  for (const ColorConfig::Display& display : c->displays())
    for (const std::string& view : display.views) GOBO_TRY(c->processor(display.name, view, "").status());
  for (const std::string& look : c->looks()) GOBO_TRY(c->processor(c->displays().front().name, c->displays().front().views.front(), look).status());
  return {};
}

Status DisplayTransforms::resolve(v1::RenderRequest& resolved, const v1::RenderRequest& asked) {
  v1::Encoding& e = *resolved.mutable_encoding();
  if (!throughView(e)) {
    if (!e.look().empty()) return refused("look", e.look(), "is applied before a view: give request.encoding.display or view too");
    e.clear_ocio_hash();  // of no picture
    return {};
  }
  const char* const field = e.display().empty() ? "view" : "display";
  const std::string& value = e.display().empty() ? e.view() : e.display();
  if (e.format() != v1::Encoding::PNG && e.format() != v1::Encoding::JPEG)
    return refused(field, value, v1::Encoding::Format_Name(e.format()) + " keeps scene-linear values, which no view changes; ask for PNG or JPEG");
  for (const auto& [has, other] :
       {std::pair(asked.tone_map().has_curve(), "request.tone_map.curve"), std::pair(asked.encoding().has_transfer(), "request.encoding.transfer")})
    if (has) return refused(field, value, std::string("stands in the place of ") + other + ", which is given too: leave out one of them");
  const auto known = config();
  if (!known.ok())
    return Status(known.status().code() == Code::Internal ? Code::Internal : Code::FailedPrecondition, given(field, value) + ": " + known.status().message(),
                  std::string("request.encoding.") + field);
  const ColorConfig& c = **known;
  const std::string of = " of the OpenColorIO config \"" + c.file() + "\"";
  GOBO_TRY(sameConfig(e, c));
  const std::vector<ColorConfig::Display>& displays = c.displays();
  if (e.display().empty()) e.set_display(displays.front().name);
  const auto display = std::find_if(displays.begin(), displays.end(), [&](const ColorConfig::Display& d) { return d.name == e.display(); });
  if (display == displays.end()) {
    std::vector<std::string> names;
    for (const ColorConfig::Display& d : displays) names.push_back(d.name);
    return refused("display", e.display(), "no active display" + of + ": it has " + listed(names));
  }
  if (e.view().empty()) e.set_view(display->views.front());
  if (!hasName(display->views, e.view()))
    return refused("view", e.view(),
                   std::string(hasName(display->inactive, e.view()) ? "not among the active_views" : "no view") + of + " for display \"" + display->name +
                       "\": it has " + listed(display->views));
  if (!e.look().empty() && !hasName(c.looks(), e.look())) return refused("look", e.look(), "no look" + of + ": it has " + listed(c.looks()));
  e.set_ocio_hash(c.hash());
  resolved.mutable_tone_map()->clear_curve();
  e.clear_transfer();
  return processor(e).status().at(std::string("request.encoding.") + field);  // its files are read before anything is rendered
}

Result<std::shared_ptr<const ColorProcessor>> DisplayTransforms::processor(const v1::Encoding& e) {
  if (!throughView(e)) return std::shared_ptr<const ColorProcessor>();
  GOBO_ASSIGN(const std::shared_ptr<const ColorConfig> known, config());
  GOBO_TRY(sameConfig(e, *known));
  const std::tuple key(e.display(), e.view(), e.look());
  {
    const std::lock_guard lock(mutex_);
    if (const auto at = processors_.find(key); at != processors_.end()) return at->second;
  }
  GOBO_ASSIGN(std::shared_ptr<const ColorProcessor> made, known->processor(e.display(), e.view(), e.look()));  // others go on meanwhile
  const std::lock_guard lock(mutex_);
  if (processors_.size() >= kKept) processors_.clear();
  processors_[key] = made;
  return made;
}

Result<Image> shownByView(const Image& linear, double exposure, const ColorProcessor& processor, bool onBlack) {
  const float scale = formulas::exposureScale(float(exposure));
  if (linear.channels == 4 && !onBlack) {
    const StraightAlpha straight = straightAlpha(linear, scale);
    GOBO_ASSIGN(const Image shown, shownByView(straight.colour, exposure, processor, false));
    return withAlpha(shown, straight.alpha, linear.names);
  }
  Image out(linear.width, linear.height, 3);
  const size_t channels = size_t(linear.channels);
  constexpr float kMost = 65504.0f;  // of halves, for which views are made
  for (size_t p = 0; p < linear.pixels(); ++p)
    for (size_t c = 0; c < 3; ++c) {
      const float v = linear.data[channels * p + (channels >= 3 ? c : 0)] * scale;
      out.data[3 * p + c] = std::isnan(v) ? 0.0f : std::clamp(v, -kMost, kMost);
    }
  GOBO_TRY(processor.apply(out.data.data(), linear.pixels()));
  for (float& v : out.data) v = std::isnan(v) ? 0.0f : std::clamp(v, 0.0f, 1.0f);
  return out;
}

}  // namespace plan
}  // namespace gobo
