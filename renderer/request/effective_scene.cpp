// SPDX-License-Identifier: Apache-2.0
#include "request/effective_scene.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <numeric>
#include <sstream>
#include <string_view>
#include <unordered_map>

#include "base/closest.h"
#include "scene/coordinates.h"
#include "scene/edit.h"
#include "scene/environment_tents.h"
#include "scene/light_axes.h"
#include "scene/studio.h"
#include "trace/emission_profile.h"

namespace gobo {
inline namespace request {

namespace {

Vec3 toVec3(const v1::Vector3& v) { return Vec3(v.x(), v.y(), v.z()); }

Status checkFinite(const v1::Vector3& v, const std::string& path, bool nonNegative = false) {
  const Vec3 x = toVec3(v);
  const auto text = "(" + std::to_string(x.x) + ", " + std::to_string(x.y) + ", " + std::to_string(x.z) + ")";
  if (!isFinite(x)) return invalidArgument(path + " = " + text + ": must be finite", path);
  if (nonNegative && (x.x < 0 || x.y < 0 || x.z < 0)) return invalidArgument(path + " = " + text + ": must not be negative", path);
  return {};
}

Status checkCoordinate(const v1::Vector3& v, const std::string& path) {
  GOBO_TRY(checkFinite(v, path));
  if (isCoordinate(toVec3(v))) return {};
  std::ostringstream text;
  text << path << " = (" << v.x() << ", " << v.y() << ", " << v.z() << "): must be within 1e9 m of the origin along each axis";
  return invalidArgument(text.str(), path);
}

/// Large enough that single precision holds its square.
Status checkLength(double v, const std::string& path) {
  constexpr double kLeast = 1e-18;
  if (v >= kLeast) return {};
  std::ostringstream text;
  text << path << " = " << v << ": must be at least " << kLeast << " m";
  return invalidArgument(text.str(), path);
}

/// Degrees. A disk at infinity that directions in single precision can tell from its centre, or none.
Status checkAngularSize(double v, const std::string& path) {
  constexpr double kLeast = 1e-4;
  if (v == 0.0 || (v >= kLeast && v <= 90.0)) return {};
  std::ostringstream text;
  text << path << " = " << v << ": must be 0 (a direction) or within " << kLeast << " .. 90 degrees";
  return invalidArgument(text.str(), path);
}

/// A rectangle's area, whose square single precision holds as well.
Status checkArea(double width, double height, const std::string& path) {
  constexpr double kLeast = 1e-18;
  if (width * height >= kLeast) return {};
  std::ostringstream text;
  text << path << ".width = " << width << " by " << path << ".height = " << height << ": must be at least " << kLeast << " m^2";
  return invalidArgument(text.str(), path + (width <= height ? ".width" : ".height"));
}

Result<Vec3> unitVector(const v1::Vector3& v, const std::string& path) {
  GOBO_TRY(checkFinite(v, path));
  const DVec3 x(toVec3(v));  // in double precision every float's square is finite, and above 0 if it is
  const double length = glm::length(x);
  if (!(length > 1e-12)) return invalidArgument(path + ": must not be the zero vector", path);
  return Vec3(x / length);
}

float radians(double degrees) { return float(degrees * 0.017453292519943295); }

/// Focal lengths and principal point, in pixels of a width x height picture, as a window (K = [fx 0 cx; 0 fy cy; 0 0 1]).
Status applyIntrinsics(const v1::CameraSettings& k, double width, double height, Camera& camera) {
  const char* first = k.has_focal_x() ? "focal_x" : k.has_focal_y() ? "focal_y" : k.has_center_x() ? "center_x" : k.has_center_y() ? "center_y" : nullptr;
  if (!first) return {};
  const std::string path = std::string("request.camera.") + first;
  if (!camera.perspective) return invalidArgument(path + ": is of a perspective camera; this one is orthographic", path);
  if (k.panorama()) return invalidArgument(path + ": is of a perspective camera; request.camera.panorama shows all directions", path);
  if (k.has_focal_x() || k.has_focal_y()) {
    const double fy = k.has_focal_y() ? k.focal_y() : k.focal_x(), fx = k.has_focal_x() ? k.focal_x() : fy;
    camera.optics.focal = fy / height;
    camera.optics.pixelAspect = float(fy / fx);
  }
  camera.centre.x = k.has_center_x() ? float((0.5 * width - k.center_x()) / height * double(camera.optics.pixelAspect)) : 0.0f;
  camera.centre.y = k.has_center_y() ? float(k.center_y() / height - 0.5) : 0.0f;
  return {};
}

Status applyClipping(const v1::CameraSettings& settings, Camera& camera) {
  if (settings.has_clip_near()) camera.optics.clipNear = float(settings.clip_near());
  if (settings.has_clip_far()) camera.optics.clipFar = float(settings.clip_far());
  if (camera.optics.clipNear < camera.optics.clipFar) return {};
  std::ostringstream text;
  text << "request.camera.clip_far = " << settings.clip_far() << ": must lie behind clip_near = " << settings.clip_near();
  return invalidArgument(text.str(), "request.camera.clip_far");
}

/// f_number or lens_radius, and what is sharp; the pose is set.
Status applyLens(const v1::CameraSettings& k, Camera& camera, std::vector<std::string>& warnings) {
  const std::string at = "request.camera.";
  if (k.has_f_number() && k.has_lens_radius()) return invalidArgument(at + "lens_radius: says what f_number says; give one of them", at + "lens_radius");
  if (!k.has_f_number() && !k.has_lens_radius()) {
    for (const auto& [given, name] : {std::pair(k.has_focus_distance(), "focus_distance"), std::pair(k.has_sensor_height_mm(), "sensor_height_mm")})
      if (given) warnings.push_back(at + name + ": changes nothing of a pinhole; f_number or lens_radius opens the lens");
    return {};
  }
  const std::string opens = at + (k.has_f_number() ? "f_number" : "lens_radius");
  if (k.has_sensor_height_mm() && !k.has_f_number()) warnings.push_back(at + "sensor_height_mm: is for f_number, and lens_radius opens the lens");
  if (k.has_f_number() && (!camera.perspective || camera.optics.panorama))
    return invalidArgument(opens + ": needs a focal length, which " + (camera.optics.panorama ? "a panorama" : "an orthographic camera") + " does not have",
                           opens);
  if (camera.optics.panorama && k.lens_radius() > 0.0) return invalidArgument(opens + ": is not of a panorama, which has no plane of focus", opens);
  const double sensor = (k.has_sensor_height_mm() ? k.sensor_height_mm() : 24.0) * 1e-3;
  const double radius = k.has_f_number() ? sensor / camera.windowHeight64() / k.f_number() / 2.0 : k.lens_radius();
  constexpr double kLeast = 1e-12;  // a picometre blurs nothing; of much less single precision has no inverse
  if (!(radius > kLeast)) return {};
  double focus = k.focus_distance();
  if (!k.has_focus_distance()) {
    if (!k.has_look_at())
      return invalidArgument(at + "focus_distance: is needed with " + opens + " where no look_at says what is sharp", at + "focus_distance");
    focus = glm::dot(DVec3(toVec3(k.look_at())) - DVec3(camera.toWorld[3]), -DVec3(camera.toWorld[2]));
  }
  camera.optics.lensRadius = float(radius);
  camera.optics.focus = float(focus);
  // Rays bend by radius / focus: beyond this a pixel sees the world from the plane of the lens itself.
  constexpr double kMost = 1e4;
  if (!(radius <= kMost * focus)) {
    std::ostringstream text;
    text << opens << ": a lens of radius " << radius << " m is more than " << kMost << " times as wide as its focus_distance of " << focus << " m";
    return invalidArgument(text.str(), opens);
  }
  return {};
}

Result<Camera> effectiveCamera(const Scene& scene, const v1::RenderRequest& request, std::vector<std::string>& warnings) {
  const v1::CameraSettings& settings = request.camera();
  int index = 0;
  if (settings.has_name() && !settings.name().empty()) {
    index = scene.findCamera(settings.name());
    if (index < 0) {
      std::vector<std::string> names;
      for (const Camera& c : scene.cameras) names.push_back(c.name);
      return notFound("no camera '" + settings.name() + "'" + didYouMean(settings.name(), names) + " (has: " + someOf(names) + ")", "request.camera.name");
    }
  }
  Camera camera = scene.cameras[index];
  if (settings.has_cull_back_faces()) camera.cullBackFaces = settings.cull_back_faces();
  if (settings.has_yfov_deg()) {
    camera.yfov = radians(settings.yfov_deg());
    camera.perspective = true;
  }
  if (settings.has_orthographic_height()) {
    camera.perspective = false;
    camera.yheight = float(settings.orthographic_height());
  }
  GOBO_TRY(applyIntrinsics(settings, double(request.width()), double(request.height()), camera));
  GOBO_TRY(applyClipping(settings, camera));
  if (settings.panorama()) {
    if (settings.has_orthographic_height())
      return invalidArgument("request.camera.orthographic_height: has no meaning for request.camera.panorama", "request.camera.orthographic_height");
    camera.optics.panorama = true;
    camera.perspective = true;  // its rays leave one point
    camera.centre = Vec2(0.0f);
    camera.yfov = kPi;  // of its height; nothing reads it but keys
  }
  if (settings.has_position() || settings.has_look_at() || settings.has_up()) {
    if (settings.has_position()) GOBO_TRY(checkCoordinate(settings.position(), "request.camera.position"));
    if (settings.has_look_at()) GOBO_TRY(checkCoordinate(settings.look_at(), "request.camera.look_at"));
    const Vec3 position = settings.has_position() ? toVec3(settings.position()) : Vec3(camera.toWorld[3]);
    const Vec3 target = settings.has_look_at() ? toVec3(settings.look_at()) : position - Vec3(camera.toWorld[2]);
    Vec3 up = Vec3(camera.toWorld[1]);
    if (settings.has_up()) { GOBO_ASSIGN(up, unitVector(settings.up(), "request.camera.up")); }
    const Vec3 back = position - target;
    if (!(glm::length(back) > 1e-12f)) return invalidArgument("request.camera.look_at: is the camera's position", "request.camera.look_at");
    const Vec3 z = glm::normalize(back);
    Vec3 x = glm::cross(up, z);
    if (glm::length(x) < 1e-6f) x = glm::cross(std::fabs(z.y) < 0.9f ? Vec3(0, 1, 0) : Vec3(1, 0, 0), z);
    x = glm::normalize(x);
    camera.toWorld = Mat4(Vec4(x, 0), Vec4(glm::cross(z, x), 0), Vec4(z, 0), Vec4(position, 1));
    camera.name += "*";
  }
  GOBO_TRY(applyLens(settings, camera, warnings));
  return camera;
}

LightKind toKind(v1::LightEdit::Kind k) {
  switch (k) {
    case v1::LightEdit::SPOT: return LightKind::Spot;
    case v1::LightEdit::DIRECTIONAL: return LightKind::Directional;
    case v1::LightEdit::RECT: return LightKind::Rect;
    case v1::LightEdit::DISK: return LightKind::Disk;
    case v1::LightEdit::SPHERE: return LightKind::Sphere;
    default: return LightKind::Point;
  }
}

/// `profile` is not UNSPECIFIED.
Status applyProfile(v1::LightEdit::Profile profile, Scene& scene, LightShape& s, const std::string& path) {
  if (profile == v1::LightEdit::NONE) {
    s.profile = -1;
    s.profileRotation = 0.0f;
    return {};
  }
  if (s.kind != LightKind::Spot)
    return invalidArgument(path + ".profile = " + v1::LightEdit::Profile_Name(profile) + ": is a picture in front of a spot, which this light is not",
                           path + ".profile");
  const LightPattern pattern = profile == v1::LightEdit::BLINDS   ? LightPattern::Blinds
                               : profile == v1::LightEdit::WINDOW ? LightPattern::Window
                                                                  : LightPattern::Leaves;
  s.profile = int(scene.profiles.size());
  scene.profiles.push_back(patternProfile(pattern));
  return {};
}

/// Little or nothing of it would be seen: neither scene nor request has a lamp of any kind, nor the scene a colour that needs none.
bool unlit(const Scene& scene, const v1::RenderRequest& request) {
  if (hasLamp(scene)) return false;
  for (const auto& [name, edit] : request.lights())
    if (edit.kind() != v1::LightEdit::KIND_UNSPECIFIED) return false;  // adds one
  return std::none_of(scene.instances.begin(), scene.instances.end(),
                      [&](const Instance& i) { return scene.materials[size_t(scene.meshes[size_t(i.mesh)]->material)].bsdf.unlit; });
}

/// Lights whose unit glTF gives as candela or lux.
bool isPhotometric(LightKind k) { return k == LightKind::Point || k == LightKind::Spot || k == LightKind::Directional; }
constexpr float kLumensPerWatt = 683.0f;
Vec3 scaled(const Vec3& v, float scale) { return scale == 1.0f ? v : v * scale; }

bool movable(LightKind k) { return k != LightKind::Mesh && k != LightKind::Environment; }

}  // namespace

float nominalBucket(float intensity) {
  if (!(intensity > 0.0f) || !std::isfinite(intensity)) return 1.0f;
  return std::ldexp(1.0f, 4 * int(std::lround(std::log2(double(intensity)) / 4.0)));
}

Status applyLightShape(const v1::LightEdit& e, Scene& scene, size_t index, const std::string& path) {
  Light& light = scene.lights[index];
  LightShape& s = light.shape;
  if (e.kind() != v1::LightEdit::KIND_UNSPECIFIED) {
    if (!movable(s.kind)) return invalidArgument(path + ".kind: '" + light.name + "' is part of the scene's geometry or environment", path + ".kind");
    s.kind = toKind(e.kind());
    if (s.kind == LightKind::Point && s.profile >= 0 && scene.profiles[size_t(s.profile)]->kind == ProfileKind::Picture) s.profile = -1;  // for want of a cone
    // A light of another kind was turned by its axis alone: its edges follow, as long as they were.
    const Vec3 n = glm::cross(s.u, s.v);
    if (s.kind == LightKind::Rect && std::fabs(glm::dot(n, s.axis)) < 0.999f * glm::length(n)) {
      const Frame f(s.axis);
      const float w = glm::length(s.u), h = glm::length(s.v);
      s.u = f.x * w;
      s.v = f.y * h;
    }
  }
  const bool shapeFields = e.has_position() || e.has_direction() || e.has_width() || e.has_height() || e.has_radius() || e.has_inner_deg() ||
                           e.has_outer_deg() || e.has_angular_size_deg() || e.profile() != v1::LightEdit::PROFILE_UNSPECIFIED || e.has_profile_rotation_deg();
  if (shapeFields && !movable(s.kind))
    return invalidArgument(path + ": '" + light.name + "' is part of the scene's geometry or environment; only gain, color and intensity can be edited", path);
  if (e.has_position()) {
    GOBO_TRY(checkCoordinate(e.position(), path + ".position"));
    s.position = toVec3(e.position());
  }
  if (e.has_radius()) GOBO_TRY(checkLength(e.radius(), path + ".radius"));
  if (e.has_width()) GOBO_TRY(checkLength(e.width(), path + ".width"));
  if (e.has_height()) GOBO_TRY(checkLength(e.height(), path + ".height"));
  if (e.profile() != v1::LightEdit::PROFILE_UNSPECIFIED) GOBO_TRY(applyProfile(e.profile(), scene, s, path));
  if (e.has_profile_rotation_deg()) s.profileRotation = radians(std::fmod(e.profile_rotation_deg(), 360.0));
  LightShape before = s;  // unturned
  before.profileRotation = 0.0f;
  if (e.has_direction() || e.has_width() || e.has_height()) {
    Vec3 axis = s.axis;
    if (e.has_direction()) { GOBO_ASSIGN(axis, unitVector(e.direction(), path + ".direction")); }
    const float w = e.has_width() ? float(e.width()) * 0.5f : glm::length(s.u);
    const float h = e.has_height() ? float(e.height()) * 0.5f : glm::length(s.v);
    if (e.has_direction()) {
      const Frame f(axis);
      s.u = f.x * w;
      s.v = f.y * h;
    } else {
      s.u = glm::normalize(s.u) * w;
      s.v = glm::normalize(s.v) * h;
    }
    s.axis = axis;
    if (hasProfile(s)) s.u = carried(profileFrame(before).x, before.axis, axis);  // its right goes along: the picture turns no more than it must
    if (s.kind == LightKind::Rect) GOBO_TRY(checkArea(2.0 * double(w), 2.0 * double(h), path));
  }
  if (e.has_radius()) s.radius = float(e.radius());
  if (e.has_angular_size_deg()) {
    GOBO_TRY(checkAngularSize(e.angular_size_deg(), path + ".angular_size_deg"));
    s.angularSize = radians(e.angular_size_deg());
  }
  const float outer = e.has_outer_deg() ? radians(e.outer_deg()) : std::acos(glm::clamp(s.cosOuter, -1.0f, 1.0f));
  const float inner = e.has_inner_deg() ? radians(e.inner_deg()) : std::acos(glm::clamp(s.cosInner, -1.0f, 1.0f));
  if (e.has_outer_deg() || e.has_inner_deg()) {
    if (inner > outer) return invalidArgument(path + ".inner_deg: must not exceed outer_deg", path + ".inner_deg");
    s.cosOuter = std::cos(outer);
    s.cosInner = std::cos(inner);
  }
  return {};
}

Result<EffectiveScene> makeEffectiveScene(const ScenePtr& loaded, const v1::RenderRequest& request, const EnvironmentLoader& load, const ScenePoser& pose,
                                          const StopToken& stop, const EnvironmentPtr& known) {
  EffectiveScene out;
  GOBO_ASSIGN(const ScenePtr base, pose(loaded, request, stop));
  for (size_t k = loaded->warnings.size(); k < base->warnings.size(); ++k) out.warnings.push_back(base->warnings[k]);  // of edits
  auto scene = std::make_shared<Scene>(*base);

  // Environment: file, sky, constant, or the studio of a scene without light; rotation; or removed. Resolved requests of such scenes have the message.
  if (request.has_environment()) {
    const auto& e = request.environment();
    const int kinds = e.has_path() + e.has_digest() + e.has_sky() + e.has_constant();
    if (kinds > 1) return invalidArgument("request.environment: path, digest, sky and constant exclude each other", "request.environment");
    if (e.has_path() && e.path() == "none") {
      scene->environment = nullptr;
    } else if (e.has_path() || e.has_digest()) {
      GOBO_ASSIGN(scene->environment, load(e));
    } else if (e.has_sky()) {
      SkyParameters sky;
      if (e.sky().has_sun_direction()) { GOBO_ASSIGN(sky.sunDirection, unitVector(e.sky().sun_direction(), "request.environment.sky.sun_direction")); }
      if (e.sky().has_turbidity()) sky.turbidity = float(e.sky().turbidity());
      if (e.sky().has_sun_scale()) sky.sunScale = float(e.sky().sun_scale());
      out.sky = known ? known : skyEnvironment(sky, 512, stop);
      if (!out.sky) return Status(Code::Cancelled, "stopped");
      scene->environment = out.sky;
    } else if (e.has_constant()) {
      GOBO_TRY(checkFinite(e.constant(), "request.environment.constant", true));
      scene->environment = constantEnvironment(toVec3(e.constant()));
    } else if (e.default_() != v1::EnvironmentSettings::NONE && unlit(*scene, request)) {
      scene->environment = studioEnvironment();
      out.warnings.push_back(scene->lights.empty()
                                 ? "the scene has no light: environment.default = STUDIO lights it; NONE leaves it black"
                                 : "nothing but pictures that glow lights the scene: environment.default = STUDIO does; NONE leaves them alone");
    }
    if (e.has_rotation_deg() && scene->environment) {
      auto turned = std::make_shared<Environment>(*scene->environment);
      turned->rotation = radians(std::fmod(e.rotation_deg(), 360.0));
      scene->environment = turned;
    }
    if (kinds > 0)
      scene->lights.erase(std::remove_if(scene->lights.begin(), scene->lights.end(), [](const Light& l) { return l.shape.kind == LightKind::Environment; }),
                          scene->lights.end());
  }
  // A plain request shares the base scene as it is; seal() runs only when something moved.
  bool changed = request.has_environment();

  std::vector<std::pair<std::string, const v1::LightEdit*>> edits;
  for (const auto& [name, edit] : request.lights()) edits.emplace_back(name, &edit);
  std::sort(edits.begin(), edits.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  for (const auto& [name, edit] : edits) {
    const std::string path = "request.lights." + name;
    int index = scene->findLight(name);
    if (index < 0 && name == "environment" && scene->environment) continue;  // its light appears at seal()
    if (index < 0) {
      if (edit->kind() == v1::LightEdit::KIND_UNSPECIFIED) {
        std::vector<std::string> names;
        for (const Light& l : scene->lights) names.push_back(l.name);
        return notFound("no light '" + name + "' in the scene" + didYouMean(name, names) + " (has: " + someOf(names) + "); give `kind` to add one", path);
      }
      Light added;
      added.name = name;
      added.power = Vec3(nominalBucket(edit->has_intensity() ? float(edit->intensity()) : 1.0f));
      scene->lights.push_back(added);
      index = int(scene->lights.size()) - 1;
      changed = true;
    }
    const LightShape before = scene->lights[index].shape;
    GOBO_TRY(applyLightShape(*edit, *scene, size_t(index), path));
    changed = changed || std::memcmp(&before, &scene->lights[index].shape, sizeof before) != 0;
  }
  if (changed) {
    GOBO_TRY(scene->seal());
    out.scene = scene;
  } else {
    out.scene = base;
  }

  // Of the file's lights by name, the first of each as Scene::findLight: a look-up of that kind for each light would be quadratic.
  std::unordered_map<std::string_view, int> lightsInFile;
  for (size_t i = 0; i < base->lights.size(); ++i) lightsInFile.try_emplace(base->lights[i].name, int(i));
  const auto inFile = [&](const std::string& name) {
    const auto found = lightsInFile.find(name);
    return found == lightsInFile.end() ? -1 : found->second;
  };
  const size_t n = out.scene->lights.size();
  out.gains.resize(n);
  out.scales.assign(n, 1.0f);
  if (request.photometric())
    for (size_t i = 0; i < n; ++i)
      if (const int file = inFile(out.scene->lights[i].name); file >= 0 && isPhotometric(base->lights[size_t(file)].shape.kind))
        out.scales[i] = 1.0f / kLumensPerWatt;
  for (size_t i = 0; i < n; ++i) out.gains[i] = scaled(out.scene->lights[i].power / nominalScalar(out.scene->lights[i]), out.scales[i]);
  for (const auto& [name, edit] : edits) {
    const std::string path = "request.lights." + name;
    const int i = out.scene->findLight(name);
    if (i < 0) continue;
    const Light& light = out.scene->lights[i];
    Vec3 power = scaled(light.power, out.scales[size_t(i)]);
    if (edit->has_color() || edit->has_intensity()) {
      if (edit->has_color()) GOBO_TRY(checkFinite(edit->color(), path + ".color", true));
      const LightParts old = partsOf(light);
      const Vec3 color = edit->has_color() ? toVec3(edit->color()) : old.color;
      const float intensity = edit->has_intensity() ? float(edit->intensity()) : (inFile(name) < 0 ? 1.0f : old.intensity * out.scales[size_t(i)]);
      power = color * intensity;
    }
    Vec3 gain(1.0f);
    if (edit->has_gain()) {
      GOBO_TRY(checkFinite(edit->gain(), path + ".gain", true));
      gain = toVec3(edit->gain());
    }
    if (edit->has_enabled() && !edit->enabled()) gain = Vec3(0.0f);
    out.gains[i] = power * gain / nominalScalar(light);
  }
  if (request.has_environment() && request.environment().has_gain()) {
    GOBO_TRY(checkFinite(request.environment().gain(), "request.environment.gain", true));
    for (size_t i = 0; i < n; ++i)
      if (out.scene->lights[i].shape.kind == LightKind::Environment) out.gains[i] *= toVec3(request.environment().gain());
  }
  for (size_t i = 0; i < n && !request.photometric(); ++i) {
    const std::string& name = out.scene->lights[i].name;
    const auto edit = request.lights().find(name);
    const int file = inFile(name);
    out.asInFile = out.asInFile || (file >= 0 && isPhotometric(base->lights[size_t(file)].shape.kind) && maxComponent(out.gains[i]) > 0.0f &&
                                    (edit == request.lights().end() || !edit->second.has_intensity()));
  }
  for (size_t i = 0; i < n; ++i)
    if (!isFinite(out.gains[i]) || maxComponent(glm::abs(out.gains[i])) > 1e24f)  // times what the light gives it has to stay a float
      return invalidArgument("power of light '" + out.scene->lights[i].name + "' overflows", "request.lights." + out.scene->lights[i].name);
  out.gainChanges.resize(n);
  for (size_t i = 0; i < n; ++i) out.gainChanges[i] = out.gains[i] - out.scene->lights[i].power / nominalScalar(out.scene->lights[i]);
  GOBO_ASSIGN(out.camera, effectiveCamera(*out.scene, request, out.warnings));
  GOBO_ASSIGN(out.background, makeBackground(out.scene, out.gains, request.environment(), stop));
  return out;
}

double estimatedFlux(const Scene& scene, int index, const StopToken& stop) {
  const Light& light = scene.lights[index];
  const LightShape& s = light.shape;
  const double l = nominalScalar(light);
  Vec3 lo, hi;
  scene.bounds(lo, hi);
  const double radius = lo.x <= hi.x ? 0.5 * glm::length(hi - lo) : 1.0, crossSection = kPi * radius * radius;
  switch (s.kind) {
    case LightKind::Point:
      if (hasProfile(s)) return profileFlux(s, *scene.profiles[size_t(s.profile)]) * l;
      return 4 * kPi * l;
    case LightKind::Spot:
      if (hasProfile(s)) return profileFlux(s, *scene.profiles[size_t(s.profile)]) * l;
      return 2 * kPi * (1.0 - s.cosOuter) * l;
    case LightKind::Directional: return crossSection * l;
    case LightKind::Rect: return kPi * l * 4.0 * glm::length(s.u) * glm::length(s.v) * (s.twoSided ? 2 : 1);
    case LightKind::Disk: return kPi * l * kPi * s.radius * s.radius * (s.twoSided ? 2 : 1);
    case LightKind::Sphere: return kPi * l * 4.0 * kPi * s.radius * s.radius;
    case LightKind::Mesh: {
      const Instance& instance = scene.instances[s.instance];
      const Mesh& mesh = *scene.meshes[instance.mesh];
      double area = 0;
      for (size_t t = 0; t < mesh.triangles(); ++t) {
        if (t % 4096 == 0 && stop.stopRequested()) break;
        Vec3 p[3];
        for (int k = 0; k < 3; ++k) p[k] = Vec3(instance.toWorld * Vec4(mesh.positions[mesh.indices[3 * t + k]], 1.0f));
        area += 0.5 * glm::length(glm::cross(p[1] - p[0], p[2] - p[0]));
      }
      return kPi * l * area;
    }
    case LightKind::Environment: return crossSection * l * environmentFlux(scene.environment.get(), stop) / 4.0;
  }
  return 0;
}

void scaleClusters(EffectiveScene& effective, RelightGroups& groups) {
  groups.scales.assign(size_t(groups.count), 1.0f);
  for (int g = 0; g < groups.count; ++g) {
    const std::vector<int>& members = groups.members[size_t(g)];
    if (groups.single(g) || members.empty()) continue;
    float scale = 1.0f;
    for (int l : members) scale = std::min(scale, effective.scales[size_t(l)]);
    if (scale == 1.0f) continue;
    // The whole cluster: what else is in it is added to its share, for taking off a file's 683 times too much would leave its noise.
    groups.scales[size_t(g)] = scale;
    for (int l : members) {
      const Light& light = effective.scene->lights[size_t(l)];
      effective.gainChanges[size_t(l)] = effective.gains[size_t(l)] - scaled(light.power / nominalScalar(light), scale);
    }
  }
}

RelightGroups makeGroups(const Scene& scene, int maxGroups, const StopToken& stop) {
  const int n = int(scene.lights.size());
  RelightGroups g;
  g.groupOf.assign(n, 0);
  g.nominal.resize(n);
  std::vector<int> order(n);
  std::iota(order.begin(), order.end(), 0);
  if (n > maxGroups) {
    std::vector<double> flux(n);
    for (int i = 0; i < n; ++i) flux[i] = estimatedFlux(scene, i, stop);
    // A map first, however weak: its techniques claim groups of one light, and a gain of it inside a cluster would be path traced over what they brought.
    for (int i = 0; i < n; ++i)
      if (scene.lights[size_t(i)].shape.kind == LightKind::Environment) flux[size_t(i)] = std::numeric_limits<double>::infinity();
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return flux[a] > flux[b]; });
    std::sort(order.begin(), order.begin() + (maxGroups - 1));
  }
  g.count = std::min(n, maxGroups);
  g.members.resize(g.count);
  for (int k = 0; k < n; ++k) {
    const int group = std::min(k, g.count - 1);
    g.groupOf[order[k]] = group;
    g.members[group].push_back(order[k]);
  }
  for (auto& m : g.members) std::sort(m.begin(), m.end());
  for (int i = 0; i < n; ++i) g.nominal[i] = g.single(g.groupOf[i]) ? Vec3(nominalScalar(scene.lights[i])) : scene.lights[i].power;
  return g;
}

}  // namespace request
}  // namespace gobo
