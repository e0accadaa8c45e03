// SPDX-License-Identifier: Apache-2.0
// The shared object behind base/color_config.h. Only this folder sees OpenColorIO, and no exception leaves it.
#include <OpenColorIO/OpenColorIO.h>

#include <algorithm>
#include <fstream>
#include <mutex>
#include <set>
#include <sstream>

#include "base/color_config.h"
#include "color/files_of_config.h"

namespace gobo::color {
namespace {

namespace ocio = OCIO_NAMESPACE;

/// Held while the library reads configs or makes processors, of whichever config: it reads variables of the environment into a string of its own that all
/// threads share (OpenColorIO 2.1, GetEnvVariable). Pictures go through processors side by side.
std::mutex& library() {
  static std::mutex mutex;
  return mutex;
}

/// What configs of the field call linear light with the primaries of Rec. 709, as name or alias: ACES 1.3 and later, its short form, ACES 1.0 to 1.2, and
/// OpenColorIO's own.
constexpr const char* kLinearRec709[] = {"lin_rec709", "Linear Rec.709 (sRGB)", "Utility - Linear - sRGB", "scene-linear Rec.709-sRGB"};

class Processor final : public ColorProcessor {
 public:
  explicit Processor(ocio::ConstCPUProcessorRcPtr cpu) : cpu_(std::move(cpu)) {}
  Status apply(float* rgb, size_t pixels) const override {
    constexpr size_t kBlock = 1024;  // stays in the first cache; the library works on four channels whatever it is given
    float block[4 * kBlock];
    try {
      for (size_t done = 0; done < pixels; done += kBlock) {
        const size_t n = std::min(kBlock, pixels - done);
        float* const at = rgb + 3 * done;
        for (size_t i = 0; i < n; ++i) {
          for (size_t c = 0; c < 3; ++c) block[4 * i + c] = at[3 * i + c];
          block[4 * i + 3] = 1.0f;
        }
        ocio::PackedImageDesc image(block, long(n), 1, 4);
        cpu_->apply(image);
        for (size_t i = 0; i < n; ++i)
          for (size_t c = 0; c < 3; ++c) at[3 * i + c] = block[4 * i + c];
      }
    } catch (const std::exception& e) { return invalidArgument(std::string("OpenColorIO: ") + e.what()); }
    return {};
  }

 private:
  ocio::ConstCPUProcessorRcPtr cpu_;
};

/// Where pictures enter the config.
struct WorkingSpace {
  std::string space;
  bool throughAces = false;  ///< `space` is ACES2065-1, and a matrix goes before it
  std::string shown, caution;
};

/// Empty shown: there is none.
WorkingSpace workingSpaceOf(const ocio::ConstConfigRcPtr& config) {
  for (const char* name : kLinearRec709)
    if (const auto space = config->getColorSpace(name)) return {space->getName(), false, space->getName(), ""};
  // The role that configs of version 2 have for exchange between configs: the matrix between it and Rec. 709 is the standard's.
  if (const auto space = config->getColorSpace(ocio::ROLE_INTERCHANGE_SCENE))
    return {space->getName(), true, std::string(space->getName()) + " (aces_interchange), by the matrix from linear Rec. 709", ""};
  if (const auto space = config->getColorSpace(ocio::ROLE_SCENE_LINEAR))
    return {space->getName(), false, space->getName(),
            std::string(
                "no colour space of it is called lin_rec709 or the like, and it has no role aces_interchange: pictures, which are linear Rec. 709, are taken "
                "for its scene_linear, \"") +
                space->getName() + "\"; color.working_space names another one"};
  return {};
}

/// One after the other; null transforms are none.
ocio::ConstTransformRcPtr pipeline(const WorkingSpace& from, const std::string& display, const std::string& view, const std::string& look) {
  const auto group = ocio::GroupTransform::Create();
  if (from.throughAces) {
    const auto toAcescg = ocio::BuiltinTransform::Create(), toAces = ocio::BuiltinTransform::Create();
    toAcescg->setStyle("UTILITY - ACES-AP1_to_LINEAR-REC709_BFD");
    toAcescg->setDirection(ocio::TRANSFORM_DIR_INVERSE);
    toAces->setStyle("ACEScg_to_ACES2065-1");
    group->appendTransform(toAcescg);
    group->appendTransform(toAces);
  }
  if (!look.empty()) {
    const auto transform = ocio::LookTransform::Create();
    transform->setSrc(from.space.c_str());
    transform->setDst(from.space.c_str());
    transform->setLooks(look.c_str());
    group->appendTransform(transform);
  }
  const auto shown = ocio::DisplayViewTransform::Create();
  shown->setSrc(from.space.c_str());
  shown->setDisplay(display.c_str());
  shown->setView(view.c_str());
  group->appendTransform(shown);
  return group;
}

class Config final : public ColorConfig {
 public:
  Config(std::string file, const std::string& text, ocio::ConstConfigRcPtr config, WorkingSpace from) : config_(std::move(config)), from_(std::move(from)) {
    file_ = std::move(file);
    files_ = filesOf(config_, text);
    hash_ = files_.hash;
    workingSpace_ = from_.shown;
    caution_ = from_.caution;
    for (int d = 0; d < config_->getNumDisplays(); ++d) {  // active ones, in the order of active_displays and active_views: defaults come first
      Display display;
      display.name = config_->getDisplay(d);
      for (int v = 0; v < config_->getNumViews(display.name.c_str()); ++v) display.views.push_back(config_->getView(display.name.c_str(), v));
      if (display.views.empty()) continue;
      const std::set<std::string> active(display.views.begin(), display.views.end());
      for (const auto type : {ocio::VIEW_DISPLAY_DEFINED, ocio::VIEW_SHARED})
        for (int v = 0; v < config_->getNumViews(type, display.name.c_str()); ++v)
          if (const std::string name = config_->getView(type, display.name.c_str(), v); !active.count(name)) display.inactive.push_back(name);
      displays_.push_back(std::move(display));
    }
    for (int i = 0; i < config_->getNumLooks(); ++i) looks_.push_back(config_->getLookNameByIndex(i));
  }

  Result<std::shared_ptr<const ColorProcessor>> processor(const std::string& display, const std::string& view, const std::string& look) const override {
    try {
      const std::lock_guard lock(library());
      const auto processor = config_->getProcessor(pipeline(from_, display, view, look));
      // Not the library's default, which approximates powers and logarithms where it is built with SSE. Debian's is not, but pictures must not hang on that.
      const auto cpu = processor->getOptimizedCPUProcessor(ocio::BIT_DEPTH_F32, ocio::BIT_DEPTH_F32, ocio::OPTIMIZATION_LOSSLESS);
      if (const std::string changed = files_.changed(); !changed.empty())
        return Status(Code::FailedPrecondition, "\"" + changed + "\", a file of the OpenColorIO config \"" + file_ +
                                                    "\", has changed since the config was read: restart the daemon to use what it is now");
      return std::shared_ptr<const ColorProcessor>(std::make_shared<Processor>(cpu));
    } catch (const std::exception& e) {
      return invalidArgument("display \"" + display + "\", view \"" + view + "\"" + (look.empty() ? "" : ", look \"" + look + "\"") +
                             " of the OpenColorIO config \"" + file_ + "\": " + e.what());
    }
  }

 private:
  ocio::ConstConfigRcPtr config_;
  WorkingSpace from_;
  ConfigFiles files_;
};

Result<std::shared_ptr<const ColorConfig>> openConfig(const std::string& file, const std::string& workingSpace) {
  const std::string name = "OpenColorIO config \"" + file + "\"";
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in || text.str().empty()) return notFound(name + ": cannot be read, or is empty");
  try {
    const std::lock_guard lock(library());
    ocio::ClearAllCaches();                 // of files that another config had read: by their names, whatever is in them now
    std::istringstream stream(text.str());  // the bytes that are hashed are the bytes that are parsed
    const auto read = ocio::Config::CreateFromStream(stream)->createEditableCopy();
    const size_t slash = file.rfind('/');
    read->setWorkingDir(slash == std::string::npos ? "." : file.substr(0, std::max<size_t>(slash, 1)).c_str());
    read->setProcessorCacheFlags(ocio::PROCESSOR_CACHE_OFF);  // who asks keeps them, and not for ever
    read->validate();
    const ocio::ConstConfigRcPtr config = read;
    WorkingSpace from;
    if (!workingSpace.empty()) {
      const auto space = config->getColorSpace(workingSpace.c_str());
      if (!space) return invalidArgument("color.working_space = \"" + workingSpace + "\": the " + name + " has no such colour space, role or alias");
      from = {space->getName(), false, space->getName(), ""};
    } else {
      from = workingSpaceOf(config);
    }
    if (from.shown.empty())
      return Status(Code::FailedPrecondition,
                    name +
                        ": nothing in it stands for linear Rec. 709 (a colour space or alias lin_rec709, the role aces_interchange or "
                        "scene_linear); color.working_space names what does");
    const auto made = std::make_shared<Config>(file, text.str(), config, from);
    if (made->displays().empty()) return invalidArgument(name + ": has no active display with a view");
    return std::shared_ptr<const ColorConfig>(made);
  } catch (const std::exception& e) { return invalidArgument(name + ": " + e.what()); }
}

}  // namespace
}  // namespace gobo::color

extern "C" [[gnu::visibility("default")]] const gobo::ColorModule gobo_color = {gobo::color::openConfig};
