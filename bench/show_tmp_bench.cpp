// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include "base/image_io.h"
#include "plan/engine.h"
#include "plan/request.h"
using namespace gobo;
int main(int argc, char** argv) {
  EngineOptions o; o.anyPath = true; auto e = Engine::create(o);
  v1::RenderRequest r; 
  auto info = (*e)->openScene(argv[1], "s"); if (!info.ok()) { puts(info.status().toString().c_str()); return 1; }
  r.set_scene("s");
  for (int i = 3; i < argc; ++i) { auto s = setPath(r, argv[i]); if (!s.ok()) puts(s.toString().c_str()); }
  auto x = (*e)->render(r);
  if (!x.ok()) { puts(x.status().toString().c_str()); return 1; }
  for (auto& n : x->reply.plan()) printf("%-32s %d %9.2f ms %10lu rays %s\n", n.node().c_str(), n.state(), n.ms(), n.rays(), n.reason().c_str());
  for (auto& w : x->reply.warnings()) puts(w.c_str());
  for (auto& w : x->reply.path_classes_missing()) puts(w.c_str());
  if (x->reply.has_certificate()) puts(x->reply.certificate().ShortDebugString().c_str());
  auto png = encodePng(toneMapped(x->images[0].image, x->reply.resolved().tone_map()));
  double m = 0; for (float v : x->images[0].image.data) m += v; printf("mean %g  total %g ms\n", m / x->images[0].image.data.size(), x->reply.total_ms());
  (void)writeFileAtomic(argv[2], png->data(), png->size());
  auto exr = encodeExr(x->images[0].image); std::string p = argv[2]; (void)writeFileAtomic(p + ".exr", exr->data(), exr->size());
}
