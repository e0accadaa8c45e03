// SPDX-License-Identifier: Apache-2.0
// One scene through Filament (Debian's libfilament-dev 1.9.25, OpenGL), for bench/filament_race, which compiles and runs it:
//   render SCENE.glb OUT.f32 --shadows pcf|vsm|none [--size WxH] [--map TEXELS] [--blur W] [--frames N] [--move light|camera|none]
// OUT.f32: the picture before any tone curve, W x H x 3 float, top row first, drawn into half floats. Timed frames are drawn into the swap
// chain (8 bits), each after the light has turned or the camera has moved a little, until its pixels are in memory.
// Prints one JSON object: milliseconds of every frame, with the pixels read back and without.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>
#include <vector>

#include <backend/PixelBufferDescriptor.h>
#include <filament/Camera.h>
#include <filament/Engine.h>
#include <filament/LightManager.h>
#include <filament/RenderTarget.h>
#include <filament/Renderer.h>
#include <filament/Scene.h>
#include <filament/SwapChain.h>
#include <filament/Texture.h>
#include <filament/TransformManager.h>
#include <filament/View.h>
#include <filament/Viewport.h>
#include <gltfio/AssetLoader.h>
#include <gltfio/FilamentAsset.h>
#include <gltfio/MaterialProvider.h>
#include <gltfio/ResourceLoader.h>
#include <utils/EntityManager.h>

using namespace filament;
using Clock = std::chrono::steady_clock;

namespace {

[[noreturn]] void fail(const std::string& what) {
  std::fprintf(stderr, "render: %s\n", what.c_str());
  std::exit(1);
}

struct Options {
  std::string scene, out, shadows = "pcf", move = "light";
  unsigned width = 1920, height = 1080, map = 1024;
  int frames = 20;
};

Options parse(int argc, char** argv) {
  Options o;
  if (argc < 3) fail("SCENE.glb and OUT.f32 are missing");
  o.scene = argv[1], o.out = argv[2];
  for (int i = 3; i + 1 < argc; i += 2) {
    const std::string name = argv[i], value = argv[i + 1];
    if (name == "--shadows") o.shadows = value;
    else if (name == "--size") {
      if (std::sscanf(value.c_str(), "%ux%u", &o.width, &o.height) != 2) fail("--size " + value);
    } else if (name == "--map") o.map = unsigned(std::atoi(value.c_str()));
    else if (name == "--frames") o.frames = std::atoi(value.c_str());
    else if (name == "--move") o.move = value;
    else fail("unknown option " + name);
  }
  return o;
}

std::vector<uint8_t> readAll(const std::string& path) {
  std::FILE* f = std::fopen(path.c_str(), "rb");
  if (!f) fail("cannot read " + path);
  std::vector<uint8_t> bytes;
  uint8_t buffer[65536];
  for (size_t n; (n = std::fread(buffer, 1, sizeof buffer, f)) > 0;) bytes.insert(bytes.end(), buffer, buffer + n);
  std::fclose(f);
  return bytes;
}

/// Filament frees the buffer's memory through this; ours stays, and the flag says that it is filled.
backend::PixelBufferDescriptor buffer(void* data, size_t size, backend::PixelDataFormat format, backend::PixelDataType type, bool* done) {
  return backend::PixelBufferDescriptor(
      data, size, format, type, [](void*, size_t, void* flag) { *static_cast<bool*>(flag) = true; }, done);
}

}  // namespace

int main(int argc, char** argv) {
  const Options o = parse(argc, argv);
  const size_t pixels = size_t(o.width) * o.height;
  Engine* engine = Engine::create(Engine::Backend::OPENGL);
  if (!engine) fail("no OpenGL: run under xvfb-run");
  SwapChain* chain = engine->createSwapChain(o.width, o.height, 0);
  Renderer* renderer = engine->createRenderer();
  Scene* scene = engine->createScene();
  View* view = engine->createView();

  gltfio::MaterialProvider* materials = gltfio::createUbershaderLoader(engine);
  gltfio::AssetConfiguration configuration{};
  configuration.engine = engine;
  configuration.materials = materials;
  gltfio::AssetLoader* loader = gltfio::AssetLoader::create(configuration);
  const std::vector<uint8_t> bytes = readAll(o.scene);
  gltfio::FilamentAsset* asset = loader->createAssetFromBinary(bytes.data(), uint32_t(bytes.size()));
  if (!asset) fail(o.scene + " is not read");
  gltfio::ResourceConfiguration resources{};
  resources.engine = engine;
  resources.gltfPath = o.scene.c_str();
  resources.recomputeBoundingBoxes = true;
  if (!gltfio::ResourceLoader(resources).loadResources(asset)) fail("resources of " + o.scene);
  scene->addEntities(asset->getEntities(), asset->getEntityCount());
  if (asset->getLightEntityCount() != 1 || asset->getCameraEntityCount() != 1) fail("one light and one camera are wanted");

  auto& lights = engine->getLightManager();
  const auto light = lights.getInstance(asset->getLightEntities()[0]);
  const math::float3 sun = normalize(lights.getDirection(light));
  LightManager::ShadowOptions shadow;
  shadow.mapSize = o.map;
  lights.setShadowOptions(light, shadow);
  lights.setShadowCaster(light, o.shadows != "none");

  const math::mat4f eye = engine->getTransformManager().getWorldTransform(engine->getTransformManager().getInstance(asset->getCameraEntities()[0]));
  const utils::Entity cameraEntity = utils::EntityManager::get().create();
  Camera* camera = engine->createCamera(cameraEntity);
  camera->setProjection(45.0, double(o.width) / o.height, 0.5, 60.0, Camera::Fov::VERTICAL);
  camera->setModelMatrix(eye);
  camera->setExposure(16.0f, 1.0f / 125.0f, 100.0f);

  view->setCamera(camera);
  view->setScene(scene);
  view->setViewport({0, 0, o.width, o.height});
  view->setPostProcessingEnabled(false);  // its table of colours is wrong on llvmpipe
  view->setShadowingEnabled(o.shadows != "none");
  if (o.shadows == "vsm") view->setShadowType(View::ShadowType::VSM);

  std::vector<uint8_t> shown(pixels * 4);
  const auto place = [&](int k) {  // where light or camera are in frame k; frame 0: as in the file
    const float angle = 0.01f * float(k), c = std::cos(angle), s = std::sin(angle);
    if (o.move == "light") lights.setDirection(light, math::float3{c * sun.x + s * sun.z, sun.y, -s * sun.x + c * sun.z});
    if (o.move == "camera") camera->setModelMatrix(math::mat4f::translation(math::float3{0.02f * float(k), 0, 0}) * eye);
  };
  const auto frame = [&](int k, bool read) {
    const auto begun = Clock::now();
    place(k);
    bool done = !read;
    while (!renderer->beginFrame(chain)) {}
    renderer->render(view);
    if (read)
      renderer->readPixels(0, 0, o.width, o.height, buffer(shown.data(), shown.size(), backend::PixelDataFormat::RGBA, backend::PixelDataType::UBYTE, &done));
    renderer->endFrame();
    engine->flushAndWait();
    while (!done) engine->flushAndWait();
    return std::chrono::duration<double, std::milli>(Clock::now() - begun).count();
  };
  for (int k = 1; k <= 3; ++k) frame(-k, true);  // shaders are compiled
  std::vector<double> withRead, without;
  const std::clock_t processor = std::clock();
  for (int k = 1; k <= o.frames; ++k) withRead.push_back(frame(k, true));
  const double cpu = 1000.0 * double(std::clock() - processor) / CLOCKS_PER_SEC / std::max(1, o.frames);
  for (int k = 1; k <= o.frames; ++k) without.push_back(frame(k, false));
  frame(0, true);

  // The picture to compare, without the swap chain's 8 bits.
  Texture* colour = Texture::Builder()
                        .width(o.width)
                        .height(o.height)
                        .levels(1)
                        .format(Texture::InternalFormat::RGBA16F)
                        .usage(Texture::Usage::COLOR_ATTACHMENT | Texture::Usage::SAMPLEABLE)
                        .build(*engine);
  Texture* depth = Texture::Builder()
                       .width(o.width)
                       .height(o.height)
                       .levels(1)
                       .format(Texture::InternalFormat::DEPTH24)
                       .usage(Texture::Usage::DEPTH_ATTACHMENT)
                       .build(*engine);
  RenderTarget* target =
      RenderTarget::Builder().texture(RenderTarget::AttachmentPoint::COLOR, colour).texture(RenderTarget::AttachmentPoint::DEPTH, depth).build(*engine);
  view->setRenderTarget(target);
  std::vector<float> picture(pixels * 4);
  bool done = false;
  place(0);
  while (!renderer->beginFrame(chain)) {}
  renderer->render(view);
  renderer->readPixels(target, 0, 0, o.width, o.height,
                       buffer(picture.data(), picture.size() * 4, backend::PixelDataFormat::RGBA, backend::PixelDataType::FLOAT, &done));
  renderer->endFrame();
  while (!done) engine->flushAndWait();

  std::FILE* f = std::fopen(o.out.c_str(), "wb");
  if (!f) fail("cannot write " + o.out);
  double mean = 0, mean8 = 0;
  for (size_t y = 0; y < o.height; ++y)
    for (size_t x = 0; x < o.width; ++x) {
      const float* p = &picture[4 * (y * o.width + x)];  // Filament gives the top row first
      mean += p[1] / double(pixels);
      mean8 += shown[4 * (y * o.width + x) + 1] / 255.0 / double(pixels);
      if (std::fwrite(p, 4, 3, f) != 3) fail("cannot write " + o.out);
    }
  if (std::fclose(f) != 0) fail("cannot write " + o.out);

  const auto list = [](const std::vector<double>& v) {
    std::string text = "[";
    for (const double x : v) {
      char b[32];
      std::snprintf(b, sizeof b, "%s%.2f", text.size() > 1 ? ", " : "", x);
      text += b;
    }
    return text + "]";
  };
  std::printf("{\"frame_ms\": %s, \"frame_without_reading_ms\": %s, \"cpu_ms\": %.2f, \"mean\": %.6f, \"mean_8bit\": %.6f}\n", list(withRead).c_str(),
              list(without).c_str(), cpu, mean, mean8);
  std::fflush(stdout);
  std::_Exit(0);  // Filament's own end asks for every resource to be handed back one by one; the process ends here
}
