// SPDX-License-Identifier: Apache-2.0
// gobo: the command line client of gobod. docs/protocol.md describes commands, exit codes and --set.
#include <cstdio>

#include <CLI/CLI.hpp>

#include "commands.h"

namespace {

using namespace gobo::cli;

void addRequestOptions(CLI::App& app, RequestOptions& o) {
  app.add_option("--request", o.file, "RenderRequest as JSON");
  app.add_option("--set", o.sets, "PATH=VALUE in the request, such as lights.key.color=1,0.9,0.8; repeat for several")->allow_extra_args(false);
  app.add_option("--camera", o.camera, "a camera of the scene");
  app.add_option("--size", o.size, "WIDTHxHEIGHT");
  app.add_option("--env", o.environment, "lat-long .hdr or .exr, or none");
  auto* spp = app.add_option("--spp", o.spp, "samples per pixel")->check(CLI::Range(1, 1048576));
  auto* time = app.add_option("--time", o.time, "stop after this many seconds")->check(CLI::PositiveNumber);
  auto* error = app.add_option("--error", o.error, "stop when the certificate's RMSE upper bound is at most this")->check(CLI::PositiveNumber);
  spp->excludes(time)->excludes(error);
  time->excludes(error);
  app.add_option("--deadline", o.deadlineMs, "give up after this many milliseconds")->check(CLI::PositiveNumber);
  app.add_option("--priority", o.priority, "INTERACTIVE, NORMAL or BATCH");
}

}  // namespace

int main(int argc, char** argv) {
  SessionOptions session;
  bool json = false, version = false;
  CLI::App app("gobo: client of the Gobo rendering server");
  app.fallthrough();
  app.require_subcommand(0, 1);
  app.add_option("--server", session.server, "unix:PATH or HOST:PORT; default $GOBO_SERVER, else " + gobo::defaultAddress());
  app.add_flag("--tls", session.credentials.tls, "speak TLS to HOST:PORT; the options below imply it");
  app.add_option("--tls-ca", session.credentials.ca, "PEM file of the authority that signed the server's certificate; default $GOBO_TLS_CA, else the system's");
  app.add_option("--tls-cert", session.credentials.cert, "PEM file of this client's certificate (mutual TLS)");
  app.add_option("--tls-key", session.credentials.key, "PEM file of its key");
  app.add_option("--token-file", session.credentials.tokenFile, "file that holds the bearer token; default $GOBO_TOKEN_FILE, or the token itself in $GOBO_TOKEN");
  app.add_flag("--local", session.local, "render in this process: no server is needed, any file may be opened");
  app.add_option("--root", session.roots, "--local: folders for files named inside requests");
  app.add_option("--cache", session.cache, "--local: folder of the disk cache");
  app.add_option("--threads", session.threads, "--local: render threads; 0: all")->check(CLI::Range(0, 1024));
  app.add_option("--timeout", session.timeoutSeconds, "seconds a call may take; 0: any")->check(CLI::NonNegativeNumber);
  app.add_option("--upload-limit", session.uploadMiB, "MiB of a scene file that is uploaded when the server cannot open it");
  app.add_flag("--json", json, "print the reply as JSON");
  app.add_flag("--version", version, "print the version");
  app.footer(kExitHelp);

  RenderCommand render;
  auto* renderApp = app.add_subcommand("render", "render a scene: a file, an id, or a built-in name");
  renderApp->add_option("scene", render.scene, "file, id or built-in name (may come from --request)");
  renderApp->add_option("-o,--out", render.out, "file: .exr .png .jpg .raw; several outputs go to out.NAME.exr");
  renderApp->add_option("--outputs", render.request.outputs, "beauty, albedo, normal, depth, ... separated by commas");
  renderApp->add_flag("--certificate", render.request.certificate, "ask for an error estimate");
  renderApp->add_flag("--half", render.request.half, "16-bit EXR or raw");
  renderApp->add_flag("--progressive", render.progressive, "show progress, write each snapshot");
  renderApp->add_flag("-q,--quiet", render.quiet, "print errors only");
  addRequestOptions(*renderApp, render.request);

  RelightCommand relight;
  auto* relightApp = app.add_subcommand("relight", "render again with changes");
  relightApp->add_option("render_id", relight.id, "printed by an earlier render")->required();
  relightApp->add_option("--set", relight.sets, "PATH=VALUE; repeat for several")->required()->allow_extra_args(false);
  relightApp->add_option("-o,--out", relight.out, "file: .exr .png .jpg .raw");
  relightApp->add_flag("-q,--quiet", relight.quiet, "print errors only");

  auto* scenesApp = app.add_subcommand("scenes", "loaded and built-in scenes");
  std::string source, name, scene;
  auto* loadApp = app.add_subcommand("load", "load a scene into the server");
  loadApp->add_option("source", source, "file or built-in name")->required();
  loadApp->add_option("--name", name, "id to give it");
  auto* inspectApp = app.add_subcommand("inspect", "what is in a scene");
  inspectApp->add_option("scene", scene, "id")->required();
  auto* unloadApp = app.add_subcommand("unload", "forget a scene");
  unloadApp->add_option("scene", scene, "id")->required();
  auto* statusApp = app.add_subcommand("status", "how the server is");
  bool disk = false;
  auto* dropApp = app.add_subcommand("drop-caches", "empty the server's term store");
  dropApp->add_flag("--disk", disk, "the disk cache too");
  auto* shutdownApp = app.add_subcommand("shutdown", "drain and stop the server (Unix socket only)");

  CompareCommand compare;
  auto* compareApp = app.add_subcommand("compare", "error between two pictures (no server needed)");
  compareApp->add_option("a", compare.a, "picture")->required();
  compareApp->add_option("b", compare.b, "picture")->required();
  compareApp->add_option("--diff", compare.diff, "write a signed difference picture (PNG)");
  compareApp->add_option("--scale", compare.scale, "error at full colour in --diff; default the largest")->check(CLI::PositiveNumber);
  compareApp->add_option("--max-rmse", compare.maxRmse, "exit 1 when the RMSE is above this")->check(CLI::NonNegativeNumber);

  MeasureCommand measure;
  auto* measureApp = app.add_subcommand("measure", "speed against error over values of one field");
  measureApp->add_option("scene", measure.scene, "file, id or built-in name")->required();
  measureApp->add_option("--sweep", measure.sweep, "PATH=V1,V2,... (';' between values that hold commas)")->required();
  measureApp->add_option("--reference-spp", measure.referenceSpp, "samples per pixel of the reference, both halves together")->check(CLI::Range(2, 1048576));
  measureApp->add_option("--repeat", measure.repeat, "renders per point; the median time counts")->check(CLI::Range(1, 1000));
  measureApp->add_flag("--cold", measure.cold, "drop the server's caches before each render");
  measureApp->add_option("--csv", measure.csv, "write the points");
  measureApp->add_option("--plot", measure.plot, "write a log-log plot (PNG)");
  addRequestOptions(*measureApp, measure.request);
  DemoCommand demo;
  auto* demoApp = app.add_subcommand("demo", "render a scene, relight it step by step, print cost and error of each step");
  demoApp->add_option("scene", demo.scene, "file, id or built-in name")->required();
  demoApp->add_option("-o,--out", demo.out, "folder for the pictures");
  addRequestOptions(*demoApp, demo.request);
  for (CLI::App* sub : app.get_subcommands({})) sub->footer(kExitHelp);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? kOk : kUsage;
  }
  if (version) {
    std::printf("gobo %s\n", gobo::buildVersion().c_str());
    return kOk;
  }
  if (app.get_subcommands().empty()) {
    std::fprintf(stderr, "%s", app.help().c_str());
    return kUsage;
  }
  watchInterrupts();
  render.json = relight.json = compare.json = json;
  if (*renderApp) return runRender(session, render);
  if (*relightApp) return runRelight(session, relight);
  if (*scenesApp) return runScenes(session, json);
  if (*loadApp) return runLoad(session, source, name, json);
  if (*inspectApp) return runInspect(session, scene, json);
  if (*unloadApp) return runUnload(session, scene);
  if (*statusApp) return runStatus(session, json);
  if (*dropApp) return runDropCaches(session, disk);
  if (*shutdownApp) return runShutdown(session);
  if (*compareApp) return runCompare(compare);
  if (*measureApp) return runMeasure(session, measure);
  if (*demoApp) return runDemo(session, demo);
  return kUsage;
}
