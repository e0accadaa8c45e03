// SPDX-License-Identifier: Apache-2.0
// The renderer in a program of one's own, without a server: a scene, its picture, the same relit. See CMakeLists.txt beside this file.
#include <gobo/base/image_io.h>
#include <gobo/import/load.h>
#include <gobo/plan/engine.h>
#include <gobo/request/request.h>

#include <fstream>
#include <iostream>

int main(int argc, char** argv) {
  gobo::EngineOptions options;
  options.loader = gobo::inProcessLoader();
  options.anyPath = true;  // files are our own
  auto engine = gobo::Engine::create(options);
  if (!engine.ok()) return std::cerr << engine.status().toString() << "\n", 1;

  gobo::v1::RenderRequest request;
  request.set_scene("fence");  // a built-in one; a file is opened first: (*engine)->openScene("scene.glb", "scene")
  for (int i = 1; i < argc; ++i)
    if (const gobo::Status s = gobo::setPath(request, argv[i]); !s.ok()) return std::cerr << s.toString() << "\n", 1;
  for (const char* file : {"sun.png", "no_sun.png"}) {
    const auto result = (*engine)->render(request);
    if (!result.ok()) return std::cerr << result.status().toString() << "\n", 1;
    const auto& reply = result->reply;
    const auto png = gobo::encodePng(gobo::toneMapped(result->images[0].image(), reply.resolved().tone_map()));
    if (!png.ok()) return std::cerr << png.status().toString() << "\n", 1;
    std::ofstream(file, std::ios::binary).write(reinterpret_cast<const char*>(png->data()), std::streamsize(png->size()));
    std::cout << file << ": " << reply.rays() << " rays, " << reply.plan_size() << " nodes, " << reply.total_ms() << " ms\n";
    (*request.mutable_lights())["sun"].set_enabled(false);  // a gain: nothing is traced again
  }
}
