// SPDX-License-Identifier: Apache-2.0
#include "command_line.h"

#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <sstream>

#include "base/closest.h"
#include "base/utf8.h"
#include "measurement/provenance.h"
#include "server/log.h"

#include <google/protobuf/descriptor.h>

namespace gobo::cli {

namespace {

constexpr const char* kOutputsHelp =
    "separated by commas: beauty, emission, direct, indirect, diffuse, specular, direct_diffuse, ..., negative_light, filtered:N, albedo, normal, position, "
    "depth, "
    "z_depth, alpha, "
    "object_id, material_id, cryptomatte_object, cryptomatte_material, motion, "
    "sample_count, variance, group:LIGHT, unoccluded:LIGHT, visibility:LIGHT, shadow_distance:LIGHT, shadow_flags:LIGHT, "
    "shadow_rays:LIGHT, "
    "shadow_width:LIGHT, shadow_basis:LIGHT";

constexpr const char* kPlanAllHelp = "show every row of the plan; by default rows of one kind are one";

/// What goes into messages must be UTF-8: protobuf sends anything and its receiver cannot read it. Names of files may be any bytes; those that are sent are
/// looked at where they are (session.cpp).
CLI::Validator utf8() {
  return CLI::Validator([](std::string& text) -> std::string { return isUtf8(text) ? "" : "is not UTF-8: " + cleanUtf8(text); }, "");
}

/// Only explicit type names: CLI11 would print "TEXT" and "UINT".
template <typename T>
CLI::Option* value(CLI::App& app, const std::string& names, T& target, const std::string& type, const std::string& help) {
  CLI::Option* option = app.add_option(names, target, help)->type_name(type);
  if (type != "FILE" && type != "FOLDER" && type != "SCENE" && type != "PATH") option->check(utf8());
  return option;
}

/// For options of real numbers. CLI11's own compare with < and >, which not-a-number passes, and print bounds of 309 digits.
CLI::Validator realNumber(double low, bool open, double high = std::numeric_limits<double>::infinity()) {
  const std::string range = std::string(" must be a finite number ") + (open ? "above " : "of at least ") + strf("%g", low) +
                            (std::isfinite(high) ? strf(" and at most %g", high) : "");
  return CLI::Validator(
      [=](std::string& text) -> std::string {
        double v = 0;
        const bool in = CLI::detail::lexical_cast(text, v) && std::isfinite(v) && (open ? v > low : v >= low) && v <= high;
        return in ? "" : text + range;
      },
      "");
}

/// What shadows.style has, as the schema says it; lines of 120 columns.
std::string styleHelp() {
  constexpr std::string_view prefix = "shadows.style.";
  std::string text =
      "Styles of shadows: --set shadows.style.FIELD=VALUE, --set lights.NAME.shadow.style.FIELD=VALUE, or a sheet of them (--style FILE); docs/intent.md\n";
  for (const FieldHelp& f : requestFields()) {
    if (!f.path.starts_with(prefix)) continue;
    std::string line = "  " + f.path.substr(prefix.size()) + " (" + f.type + "):";
    std::istringstream words(f.text);
    for (std::string word; words >> word;) {
      if (line.size() + 1 + word.size() > 120) text += line + "\n", line = "     ";
      line += " " + word;
    }
    text += line + "\n";
  }
  return text;
}

/// The choices of request.denoise, as the schema has them.
std::string filterNames() {
  const auto* type = v1::Denoise::descriptor()->FindOneofByName("filter");
  std::string text;
  for (int i = 0; i < type->field_count(); ++i) text += (i ? "|" : "") + type->field(i)->name();
  return text;
}

constexpr const char* kMeasureHelp =
    "Series: --series NAME begins one; one --sweep and any number of --with follow it. A --sweep without --series is a series named by its path.\n"
    "  gobo measure grids --output visibility:key --repeats 5 --path-tracing 64 --out m.json \\\n"
    "    --series \"axis aligned\" --with shadows.axis_aligned.rate=EQUATION --sweep shadows.axis_aligned.mean_samples=9,16,25 \\\n"
    "    --series pcss --with shadows.percentage_closer_soft.search_taps=16 --sweep shadows.map.resolution=128,256,512\n"
    "--set and the other options of a request are of all series and of the reference. docs/measuring.md\n";

/// What was given to a command, in its order. Options that hold one value each time (allow_extra_args(false)) stand as often in parse_order().
std::vector<CommandWord> wordsOf(const CLI::App& app) {
  std::map<const CLI::Option*, size_t> seen;
  std::vector<CommandWord> words;
  for (const CLI::Option* o : app.parse_order()) {
    const size_t n = seen[o]++;
    const std::string name = !o->nonpositional() ? "" : o->get_lnames().empty() ? "-" + o->get_snames().front() : "--" + o->get_lnames().front();
    const bool flag = o->get_items_expected_max() == 0;
    if (n < o->results().size()) words.push_back({o->get_type_name(), name, flag ? "" : o->results()[n], !flag});
  }
  return words;
}

std::vector<SeriesWord> seriesWords(const CLI::App& app, const CLI::Option* series, const CLI::Option* sweep, const CLI::Option* with) {
  std::map<const CLI::Option*, size_t> seen;
  std::vector<SeriesWord> words;
  for (const CLI::Option* o : app.parse_order()) {
    const size_t n = seen[o]++;
    if (n >= o->results().size()) continue;
    if (o == series) words.push_back({SeriesWord::Kind::Series, o->results()[n]});
    else if (o == sweep) words.push_back({SeriesWord::Kind::Sweep, o->results()[n]});
    else if (o == with) words.push_back({SeriesWord::Kind::With, o->results()[n]});
  }
  return words;
}

void addRequestOptions(CLI::App& app, RequestOptions& o, bool scheduling = true) {
  value(app, "--request", o.file, "FILE", "RenderRequest as JSON; - reads standard input");
  value(app, "--set", o.sets, "PATH=VALUE", "a field of the request, such as lights.key.color=1,0.9,0.8; repeat for several")->allow_extra_args(false);
  value(app, "--curve", o.curves, "PATH=T:V,T:V",
        "a number or vector (V/V/V) of the request over its time_s, such as lights.key.intensity=0:1,2:10; with ;STEP or ;SMOOTH; repeat for several")
      ->allow_extra_args(false);
  value(app, "--formula", o.formulas, "PATH=FORMULA",
        "a number of the request by a formula over time; of shadows.style also over terms: shadows.style.softness=0.02+0.3*distance (docs/expressions.md); "
        "repeat for several")
      ->allow_extra_args(false);
  value(app, "--style", o.style, "FILE",
        "style sheet: JSON with shadows.style, lights.NAME.shadow.style and expressions of these alone, such as {\"shadows\": {\"style\": {\"softness\": 0.1, "
        "\"inflation\": 0.05}}} (docs/intent.md)");
  value(app, "--camera", o.camera, "CAMERA", "a camera of the scene");
  value(app, "--size", o.size, "WIDTHxHEIGHT", "pixels");
  value(app, "--env", o.environment, "FILE", "lat-long .hdr or .exr, or none");
  value(app, "--denoise", o.denoise, filterNames(),
        "how noise is taken out of path-traced light (docs/noise.md); fireflies before it: --set denoise.outliers=path_density");
  auto* spp = value(app, "--spp", o.spp, "N", "samples per pixel")->check(CLI::Range(1, 1048576).description(""));
  auto* time = value(app, "--time", o.time, "SECONDS", "stop after this time")->check(realNumber(0, true));
  auto* error = value(app, "--error", o.error, "RMSE", "stop when the certificate's upper bound is at most this")->check(realNumber(0, true));
  spp->excludes(time)->excludes(error);
  time->excludes(error);
  if (!scheduling) return;
  value(app, "--deadline", o.deadlineMs, "MS", "give up after this many milliseconds")->check(realNumber(0, true));
  value(app, "--priority", o.priority, choices(v1::Scheduling::Class_descriptor()), "class of the scheduler");
}

}  // namespace

std::string choices(const google::protobuf::EnumDescriptor* type) {
  std::string text;
  for (int i = 0; i < type->value_count(); ++i)
    if (type->value(i)->number() != 0) text += (text.empty() ? "" : "|") + type->value(i)->name();
  return text;
}

CommandLine::CommandLine() : app("client of the Gobo rendering server", "gobo") {
  app.fallthrough();
  app.require_subcommand(0, 1);
  app.footer(kExitHelp);
  addSession();
  addRendering();
  addScenes();
  addServer();
  addCache();
  addJobs();
  addRegress();
  addMeasure();
  addTools();
}

CLI::App* CommandLine::command(CLI::App& parent, const std::string& name, const std::string& help, std::function<int()> run) {
  CLI::App* sub = parent.add_subcommand(name, help);
  sub->footer(kExitHelp);
  if (run) commands_.emplace_back(sub, std::move(run));
  return sub;
}

std::string CommandLine::mistyped(const CLI::ParseError& error) const {
  if (error.get_exit_code() != int(CLI::ExitCodes::ExtrasError) && error.get_exit_code() != int(CLI::ExitCodes::RequiredError)) return {};
  std::vector<const CLI::App*> chain{&app};  // the program, then the command, then its own
  while (!chain.back()->get_subcommands().empty()) chain.push_back(chain.back()->get_subcommands().front());
  const CLI::App& last = *chain.back();
  for (const std::string& word : app.remaining(true)) {
    const bool option = word.size() > 1 && word[0] == '-';
    std::vector<std::string> known;
    if (option) {
      for (const CLI::App* a : chain)
        for (const CLI::Option* o : a->get_options())
          for (const std::string& name : o->get_lnames()) known.push_back("--" + name);
      return "no option " + word.substr(0, word.find('=')) + didYouMean(word.substr(0, word.find('=')), known) + " (" +
             (chain.size() > 1 ? "gobo " + last.get_name() : last.get_name()) + " --help lists them)";
    }
    if (last.get_subcommands([](const CLI::App*) { return true; }).empty()) continue;
    for (const CLI::App* sub : last.get_subcommands([](const CLI::App*) { return true; })) known.push_back(sub->get_name());
    if (!closest(word, known).empty() || chain.size() == 1) return "no command '" + word + "'" + didYouMean(word, known) + " (gobo --help lists them)";
  }
  return {};
}

int CommandLine::run() {
  if (version) {
    std::printf("gobo %s\n", buildVersion().c_str());
    return kOk;
  }
  for (auto& [sub, run] : commands_)
    if (sub->parsed()) return run();
  std::fprintf(stderr, "%s", app.help().c_str());
  return kUsage;
}

void CommandLine::addSession() {
  value(app, "--server", session.server, "ADDRESS", "unix:PATH or HOST:PORT; default $GOBO_SERVER, else " + defaultAddress());
  app.add_flag("--local", session.local, "render in this process: no server is needed, any file may be opened");
  value(app, "--root", session.roots, "FOLDER", "--local: for files named inside requests; repeat for several")->allow_extra_args(false);
  value(app, "--cache", session.cache, "FOLDER", "--local: the disk cache");
  value(app, "--threads", session.threads, "N", "--local: render threads; 0: all")->check(CLI::Range(0, 1024).description(""));
  value(app, "--ocio", session.ocio, "FILE", "--local: OpenColorIO config of encoding.display and view; default $OCIO");
  value(app, "--timeout", session.timeoutSeconds, "SECONDS", "a call may take; 0: any")->check(realNumber(0, false));
  value(app, "--upload-limit", session.uploadMiB, "MIB", "of a scene file that is uploaded when the server cannot open it; default 512");
  value(app, "--token-file", session.tokenFile, "FILE", "bearer token for the server (first line); default $GOBO_TOKEN");
  app.add_flag("--tls", session.tls, "encrypt; trust the system's certificates");
  value(app, "--ca", session.ca, "FILE", "encrypt; trust these certificates (PEM)");
  value(app, "--cert", session.cert, "FILE", "mutual TLS: this client's certificate (PEM)");
  value(app, "--key", session.key, "FILE", "mutual TLS: its private key (PEM)");
  app.add_flag("--json", json, "print the reply as JSON");
  app.add_flag("--version", version, "print the version");
}

void CommandLine::addRendering() {
  CLI::App* render = command(app, "render", "render a scene: a file, an id, or a built-in name", [this] {
    render_.json = json;
    return runRender(session, render_);
  });
  value(*render, "scene", render_.scene, "SCENE", "file, id or built-in name (may come from --request)");
  value(*render, "-o,--out", render_.out, "FILE",
        ".exr .png .jpg .raw; several outputs go to out.NAME.exr, or with --layers into one .exr; - writes one picture to standard output, as request.encoding "
        "says");
  value(*render, "--outputs", render_.request.outputs, "OUTPUTS", kOutputsHelp);
  render->add_flag("--certificate", render_.request.certificate, "ask for an error estimate");
  render->add_flag("--layers", render_.request.layers, "one EXR file with every output as a named layer");
  render->add_flag("--half", render_.request.half, "16-bit EXR or raw");
  value(*render, "--tile", render_.tile, "PIXELS", "render part by part into one tiled EXR: pictures larger than memory; each pixel as without")
      ->check(CLI::Range(16, 16384).description(""));
  render->add_flag("--progressive", render_.progressive, "write each snapshot; progress also when standard error is no terminal");
  render->add_flag("--plan-all", render_.planAll, kPlanAllHelp);
  render->add_flag("-q,--quiet", render_.quiet, "print errors only");
  addRequestOptions(*render, render_.request);
  render->footer([] { return styleHelp(); });  // before the exit codes

  CLI::App* plan = command(app, "plan", "what a render would do and take, without doing it", [this] {
    render_.json = json;
    return runPlan(session, render_);
  });
  value(*plan, "scene", render_.scene, "SCENE", "file, id or built-in name (may come from --request)");
  value(*plan, "--outputs", render_.request.outputs, "OUTPUTS", kOutputsHelp);
  plan->add_flag("--certificate", render_.request.certificate, "ask for an error estimate");
  plan->add_flag("--plan-all", render_.planAll, kPlanAllHelp);
  addRequestOptions(*plan, render_.request);

  CLI::App* precompute = command(app, "precompute", "compute the transfer of environment.transfer, and keep it for renders under any map", [this] {
    precompute_.json = json;
    return runPrecompute(session, precompute_);
  });
  value(*precompute, "scene", precompute_.scene, "SCENE", "file, id or built-in name")->required();
  value(*precompute, "--bands", precompute_.bands, "N", "of spherical harmonics; default 5")->check(CLI::Range(2, 10).description(""));
  value(*precompute, "--bounces", precompute_.bounces, "N", "of indirect light; default 3")->check(CLI::Range(0, 16).description(""));
  value(*precompute, "--samples", precompute_.samples, "N", "directions a point; default 512")->check(CLI::Range(64, 16384).description(""));
  value(*precompute, "--points", precompute_.points, "N", "on the surfaces, at most; default 30000")->check(CLI::Range(100, 2000000).description(""));
  value(*precompute, "--set", precompute_.request.sets, "PATH=VALUE",
        "a field of the renders to come that changes the scene: time_s, animation, variant, seed; repeat for several")
      ->allow_extra_args(false);
  value(*precompute, "--deadline", precompute_.request.deadlineMs, "MS", "give up after this many milliseconds; blocks that are done stay")
      ->check(realNumber(0, true));
  value(*precompute, "--priority", precompute_.request.priority, choices(v1::Scheduling::Class_descriptor()), "class of the scheduler");
  precompute->add_flag("--progressive", precompute_.progressive, "progress also when standard error is no terminal");
  precompute->add_flag("-q,--quiet", precompute_.quiet, "print errors and warnings only");

  CLI::App* relight = command(app, "relight", "render again with changes", [this] {
    relight_.json = json;
    return runRelight(session, relight_);
  });
  value(*relight, "render_id", relight_.id, "RENDER_ID", "printed by an earlier render")->required();
  value(*relight, "-o,--out", relight_.out, "FILE",
        ".exr .png .jpg .raw; several outputs go to out.NAME.exr, or with --layers into one .exr; - writes one picture to standard output");
  value(*relight, "--outputs", relight_.request.outputs, "OUTPUTS", kOutputsHelp);
  relight->add_flag("--certificate", relight_.request.certificate, "ask for an error estimate");
  relight->add_flag("--layers", relight_.request.layers, "one EXR file with every output as a named layer");
  relight->add_flag("--half", relight_.request.half, "16-bit EXR or raw");
  relight->add_flag("--progressive", relight_.progressive, "write each snapshot; progress also when standard error is no terminal");
  relight->add_flag("--plan-all", relight_.planAll, kPlanAllHelp);
  relight->add_flag("-q,--quiet", relight_.quiet, "print errors only");
  addRequestOptions(*relight, relight_.request);
}

void CommandLine::addScenes() {
  command(app, "scenes", "loaded and built-in scenes", [this] { return runScenes(session, json); });
  CLI::App* load = command(app, "load", "load a scene into the server", [this] { return runLoad(session, source_, name_, json); });
  value(*load, "source", source_, "SCENE", "file or built-in name")->required();
  value(*load, "--name", name_, "ID", "id to give it");
  CLI::App* inspect = command(app, "inspect", "what is in a scene", [this] { return runInspect(session, scene_, json); });
  value(*inspect, "scene", scene_, "LOADED", "id")->required();
  CLI::App* unload = command(app, "unload", "forget a scene", [this] { return runUnload(session, scene_); });
  value(*unload, "scene", scene_, "LOADED", "id")->required();
}

void CommandLine::addServer() {
  command(app, "status", "how the server is", [this] { return runStatus(session, json); });
  command(app, "workers", "who renders frames of the server's jobs elsewhere (gobod --worker)", [this] { return runWorkers(session, json); });
  CLI::App* drop = command(app, "drop-caches", "empty the server's term store", [this] { return runDropCaches(session, disk_); });
  drop->add_flag("--disk", disk_, "the disk cache too");
  command(app, "shutdown", "drain and stop the server (Unix socket only)", [this] { return runShutdown(session); });
}

void CommandLine::addCache() {
  CLI::App* cache = command(app, "cache", "what the server's term store holds, in memory and on disk", nullptr);
  cache->require_subcommand(1);
  const auto act = [&](const char* name, const char* help, CacheAct what) {
    CLI::App* sub = command(*cache, name, help, [this, what] {
      cache_.json = json;
      return runCache(session, what, cache_);
    });
    value(*sub, "digest", cache_.keys, "DIGEST", "of terms, or the first 6 digits of them or more");
    value(*sub, "--type", cache_.type, "TYPE", "kind of node, such as direct_transfer; '*' stands for any letters: '*transfer*'");
    value(*sub, "--scene", cache_.scene, "LOADED", "id of the scene for which they were made");
    return sub;
  };
  CLI::App* list = act("list", "terms: type, scene, bytes, last use, what they cost, pins", CacheAct::List);
  list->add_flag("--pinned", cache_.pinned, "pinned ones alone");
  value(*list, "--sort", cache_.sort, "used|bytes|cost", "default used, latest first")->check(CLI::IsMember({"used", "bytes", "cost"}).description(""));
  value(*list, "--limit", cache_.limit, "N", "rows; default 1000")->check(CLI::Range(1, 1000000).description(""));
  act("size", "totals by type, bounds, and what is pinned", CacheAct::Size)->add_flag("--pinned", cache_.pinned, "of pinned ones alone");
  CLI::App* evict = act("evict", "drop terms from memory and disk, but for pinned ones", CacheAct::Evict);
  evict->add_flag("--memory", cache_.memory, "from memory alone");
  evict->add_flag("--pinned", cache_.pinned, "pinned ones too");
  act("pin", "keep terms from being evicted for room: at most half of memory and half of the disk cache", CacheAct::Pin);
  act("unpin", "let them be evicted again", CacheAct::Unpin);
}

void CommandLine::addJobs() {
  CLI::App* jobs = command(app, "jobs", "durable renders that outlive client and server", nullptr);
  jobs->require_subcommand(1);
  CLI::App* submit =
      command(*jobs, "submit", "queue a render of one or more frames; prints the job's id", [this] { return runJobSubmit(session, submit_, json); });
  value(*submit, "scene", submit_.scene, "SCENE", "file, id or built-in name (may come from --request)");
  value(*submit, "--frames", submit_.frames, "FIRST[-LAST[:STEP]],...", "frame numbers, both ends included, in the order of rendering, such as 1,5,9-20:2");
  value(*submit, "--fps", submit_.fps, "N", "animation time of a frame is FRAME / N")->check(realNumber(0, true));
  value(*submit, "--name", submit_.name, "TEXT", "for people; starts the names of the files");
  value(*submit, "--key", submit_.key, "TEXT", "the same key and job again: the job that is there");
  value(*submit, "--outputs", submit_.request.outputs, "OUTPUTS", kOutputsHelp);
  value(*submit, "--format", submit_.format, choices(v1::Encoding::Format_descriptor()), "of the files; default EXR");
  submit->add_flag("--layers", submit_.request.layers, "one EXR file a frame with every output as a named layer");
  submit->add_flag("--half", submit_.request.half, "16-bit EXR or raw");
  submit->add_flag("--certificate", submit_.request.certificate, "ask for an error estimate");
  value(*submit, "--job-priority", submit_.priority, choices(v1::JobSpec::Priority_descriptor()), "between jobs; default MEDIUM");
  value(*submit, "--job-deadline", submit_.deadlineSeconds, "SECONDS", "the job fails when it is not done by then")->check(realNumber(0, true));
  value(*submit, "--max-attempts", submit_.attempts, "N", "of each frame; default 3")->check(CLI::Range(1, 100).description(""));
  value(*submit, "--tile-px", submit_.tile, "N", "render each frame in squares of this side, by several workers; whole if absent")
      ->check(CLI::Range(16, 16384).description(""));
  value(*submit, "--after", submit_.after, "JOB,...", "jobs that must be done before a frame of this one starts");
  value(*submit, "--out", submit_.out, "PATTERN",
        "the daemon writes each file there too, below its jobs.out_folder: 'shots/{name}.{frame:04}.{ext}', with {job} and {output}");
  submit->add_flag("--watch", submit_.watch, "then watch it");
  addRequestOptions(*submit, submit_.request, false);

  CLI::App* list = command(*jobs, "list", "jobs, newest first", [this] { return runJobList(session, states_, json); });
  value(*list, "--state", states_, choices(v1::Job::State_descriptor()), "only these; repeat for several")->allow_extra_args(false);
  CLI::App* show = command(*jobs, "show", "a job with its frames", [this] { return runJobShow(session, job_, json); });
  value(*show, "job", job_, "JOB", "id")->required();
  CLI::App* watch = command(*jobs, "watch", "follow a job until it has ended", [this] { return runJobWatch(session, job_, json); });
  value(*watch, "job", job_, "JOB", "id")->required();
  const auto act = [&](CLI::App& parent, const char* name, const char* help, JobAct what) {
    CLI::App* sub = command(parent, name, help, [this, what] { return runJobAct(session, what, jobs_, json, jobPriority_); });
    value(*sub, "job", jobs_, "JOB", "ids")->required();
    return sub;
  };
  act(*jobs, "cancel", "stop jobs for good; finished frames stay", JobAct::Cancel);
  act(*jobs, "pause", "take jobs out of the queue; frames keep what they have", JobAct::Pause);
  act(*jobs, "resume", "put paused jobs back", JobAct::Resume);
  act(*jobs, "retry", "put failed and cancelled frames back; finished ones stay", JobAct::Retry);
  CLI::App* priority = act(*jobs, "priority", "change when jobs come to be rendered", JobAct::Prioritize);
  value(*priority, "--to", jobPriority_, choices(v1::JobSpec::Priority_descriptor()), "between jobs: a higher class starts first")->required();
  CLI::App* depend = command(*jobs, "depend", "change what jobs wait for", [this] { return runJobDepend(session, jobs_, after_, none_, json); });
  value(*depend, "job", jobs_, "JOB", "ids")->required();
  CLI::Option* after = value(*depend, "--after", after_, "JOB,...", "jobs that must be done first, in place of those before");
  after->excludes(depend->add_flag("--none", none_, "they wait for nothing any more"));
  CLI::App* log = command(*jobs, "log", "what happened to a job and its frames, and who had them", [this] {
    log_.json = json;
    return runJobLog(session, log_);
  });
  value(*log, "job", log_.id, "JOB", "id")->required();
  value(*log, "--frame", log_.frames, "FIRST[-LAST[:STEP]],...", "of these frames alone");
  value(*log, "--most", log_.most, "N", "of the newest entries; default 1000")->check(CLI::Range(1, 10000).description(""));
  log->add_flag("--follow", log_.follow, "go on as things happen, until the job has ended");
  act(*jobs, "delete", "forget ended jobs and their files", JobAct::Delete);
  act(app, "cancel", "the same as `jobs cancel`; a render is cancelled by Ctrl-C", JobAct::Cancel);
  CLI::App* fetch = command(*jobs, "fetch", "copy the files of finished frames", [this] { return runJobFetch(session, fetch_); });
  value(*fetch, "job", fetch_.id, "JOB", "id")->required();
  value(*fetch, "-o,--out", fetch_.out, "FOLDER", "made if absent; default here");
  value(*fetch, "--frames", fetch_.frames, "FIRST[-LAST[:STEP]],...", "such as 1,5,9-20:2; default all");
  value(*fetch, "--outputs", fetch_.outputs, "OUTPUTS", "default all");
  fetch->add_flag("--follow", fetch_.follow, "wait for frames that are not finished yet");
}

void CommandLine::addRegress() {
  CLI::App* regress = command(app, "regress", "render a suite and hold it against accepted references", nullptr);
  regress->require_subcommand(1);
  const auto act = [&](const char* name, const char* help, RegressAct what) {
    CLI::App* sub = command(*regress, name, help, [this, what] {
      regress_.json = json;
      return runRegress(session, what, regress_);
    });
    value(*sub, "suite", regress_.suite, "FILE", "suite, TOML (docs/regression.md)")->required();
    value(*sub, "--out", regress_.out, "FOLDER", "of pictures and reports; default SUITE.out beside the suite");
    return sub;
  };
  CLI::App* run = act("run", "render the cases and compare: exit 1 when one has changed, 3 when nothing is accepted for one", RegressAct::Run);
  CLI::App* accept = act("accept", "take pictures of the last run for references", RegressAct::Accept);
  act("report", "make the report of the last run again; exit code as of the run", RegressAct::Report);
  for (CLI::App* sub : {run, accept}) value(*sub, "case", regress_.cases, "CASE", "names; default all (accept: all that changed or are new)");
  value(*accept, "--by", regress_.by, "NAME", "who accepts")->required();
  value(*accept, "--why", regress_.why, "TEXT", "why: goes into the references' log")->required();

  CLI::App* bisect = command(*regress, "bisect", "which commit of a git repository changed a case: exit 0 when it is found, 1 when several are left", [this] {
    bisect_.json = json;
    return runBisect(session, bisect_);
  });
  value(*bisect, "suite", bisect_.suite, "FILE", "suite, TOML (docs/regression.md)")->required();
  value(*bisect, "case", bisect_.cases, "CASE", "names; default all");
  value(*bisect, "--good", bisect_.good, "REVISION", "whose pictures are the accepted ones")->required();
  value(*bisect, "--bad", bisect_.bad, "REVISION", "after it, whose pictures are not")->required();
  value(*bisect, "--repo", bisect_.repository, "FOLDER", "git repository, which is only read; default the current folder");
  value(*bisect, "--build", bisect_.build, "COMMAND", "shell command that builds a commit in its folder; default make build");
  value(*bisect, "--program", bisect_.program, "PATH", "what the build makes of gobo, below that folder; default build/clients/gobo");
  value(*bisect, "--work", bisect_.work, "FOLDER", "of builds and what was found so far; default one of the repository's below ~/.cache/gobo/bisect");
  value(*bisect, "--limit", bisect_.limitSeconds, "SECONDS", "skip a commit whose build, or whose run, takes longer; default any time")
      ->check(realNumber(0, false));
}

void CommandLine::addMeasure() {
  CLI::App* measure = command(app, "measure", "speed against error: series of settings against a path-traced reference", nullptr);
  value(*measure, "scene", measure_.scene, "SCENE", "file, id or built-in name")->required();
  auto* series = value(*measure, "--series", seriesNames_, "NAME", "begins a series: the --sweep and --with that follow are its own")->allow_extra_args(false);
  auto* sweep = value(*measure, "--sweep", sweeps_, "PATH=VALUES", "the points of a series: PATH=V1,V2,... (';' between values that hold commas)")
                    ->allow_extra_args(false);
  auto* with = value(*measure, "--with", withs_, "PATH=VALUE", "a field of the request in this series alone; repeat for several (--set: in all series)")
                   ->allow_extra_args(false);
  value(*measure, "--path-tracing", measure_.pathTracing, "N",
        "adds a series of plain path tracing at 1, 2, 4, ... N samples per pixel, of visibility:LIGHT of N shadow rays a view sample")
      ->check(CLI::Range(1, 1048576).description(""));
  value(*measure, "--output", measure_.output, "OUTPUT", "what the error is of: beauty (default), direct, indirect, ..., group:LIGHT, visibility:LIGHT");
  value(*measure, "--reference", measure_.reference, "FILE", "picture taken for the truth instead of rendering it: FILE, or FILE.exr:LAYER");
  value(*measure, "--reference-spp", measure_.referenceSpp, "N", "samples per pixel of the reference, both halves together; default 1024")
      ->check(CLI::Range(2, 1048576).description(""));
  value(*measure, "--repeats", measure_.repeats, "N", "runs of each point, round robin over the points of all series; default 1")
      ->check(CLI::Range(1, 1000).description(""));
  measure->add_flag("--cold", measure_.cold, "drop the server's caches before each run");
  value(*measure, "-o,--out", measure_.out, "FILE", "write everything as JSON: runs, points, requests, machine (python3 -m gobo.report FILE makes figures)");
  value(*measure, "--csv", measure_.csv, "FILE", "write a row for each run");
  addRequestOptions(*measure, measure_.request);
  measure->footer([] { return std::string(kMeasureHelp); });
  commands_.emplace_back(measure, [this, measure, series, sweep, with] {
    measure_.json = json;
    measure_.series = seriesWords(*measure, series, sweep, with);
    std::vector<CommandWord> words;
    if (session.local) words.push_back({"", "--local", "", false});
    if (session.local && session.threads) words.push_back({"N", "--threads", std::to_string(session.threads)});
    for (CommandWord& word : wordsOf(*measure)) words.push_back(std::move(word));
    measure_.command = commandText("gobo measure", words);
    return runMeasure(session, measure_);
  });
}

void CommandLine::addTools() {
  CLI::App* compare = command(app, "compare", "error between two pictures (no server needed)", [this] {
    compare_.json = json;
    return runCompare(compare_);
  });
  value(*compare, "a", compare_.a, "FILE",
        "picture, or FILE.exr:LAYER for one layer of a multi-layer file (without LAYER its R, G, B); PNG and JPEG are decoded from sRGB")
      ->required();
  value(*compare, "b", compare_.b, "FILE", "picture, as the first")->required();
  value(*compare, "--diff", compare_.diff, "FILE", "write a signed difference picture (PNG)");
  value(*compare, "--scale", compare_.scale, "X", "error at full colour in --diff; default the largest")->check(realNumber(1e-30, false, 1e30));
  value(*compare, "--max-rmse", compare_.maxRmse, "X", "exit 1 when the RMSE is above this, or a pixel is not finite in one alone")
      ->check(realNumber(0, false));

  CLI::App* occlusion = command(app, "occlusion", "visibility of one light along a row or column of the picture, by several shadow techniques and by rays",
                                [this] { return runOcclusion(session, occlusion_); });
  value(*occlusion, "scene", occlusion_.scene, "SCENE", "file, id or built-in name")->required();
  value(*occlusion, "--light", occlusion_.light, "LIGHT", "name; may be left out where there is one light");
  auto* row = value(*occlusion, "--row", occlusion_.row, "N", "of the picture, 0 on top; default the middle one")->check(CLI::Range(0, 16383).description(""));
  value(*occlusion, "--column", occlusion_.column, "N", "instead of a row, 0 on the left")->check(CLI::Range(0, 16383).description(""))->excludes(row);
  value(
      *occlusion, "--techniques", occlusion_.techniques, "TECHNIQUES",
      "such as \"exponential.c=80;convolution.order=16,map.blur=2\": ';' between techniques, ',' between fields of one; default every one that does the light");
  value(*occlusion, "--reference-samples", occlusion_.referenceSamples, "N",
        "shadow rays per view sample of the truth (1 is used for point-like lights); default 256")
      ->check(CLI::Range(1, 4096).description(""));
  value(*occlusion, "--csv", occlusion_.csv, "FILE", "write the line: pixel, truth, each technique");
  value(*occlusion, "--plot", occlusion_.plot, "FILE", "write a plot (PNG)");
  addRequestOptions(*occlusion, occlusion_.request);

  CLI::App* environment = command(app, "environment", "what environment.transfer makes of a map: harmonics and lights (no server needed)", [this] {
    environment_.json = json;
    return runEnvironment(environment_);
  });
  value(*environment, "map", environment_.map, "FILE", "lat-long or cube map, .hdr or .exr")->required();
  value(*environment, "--bands", environment_.bands, "N", "of spherical harmonics; default 5")->check(CLI::Range(2, 10).description(""));
  value(*environment, "--lights", environment_.lights, "N", "at most; default 16")->check(CLI::Range(0, 64).description(""));
  value(*environment, "--light-share", environment_.lightShare, "X", "moments: of the luminous flux that makes a peak a light; default 0.02")
      ->check(realNumber(0.001, false, 1.0));
  value(*environment, "--method", environment_.method, "moments|published",
        "how it is split: moments is environment.transfer's; published is that of the thesis of 2007, to compare with, and takes the options that follow");
  value(*environment, "--window", environment_.window, "none|hann|lanczos|least",
        "published: damps bands of the harmonics; least: no more than leaves nothing below 0; default none");
  value(*environment, "--radius", environment_.radius, "fixed|basin|best|curvature", "published: how large a light is; default fixed");
  value(*environment, "--radius-deg", environment_.radiusDeg, "DEG", "published: half angle of fixed lights; default 4.22")
      ->check(realNumber(0.5, false, 60.0));
  value(*environment, "--refine", environment_.refine, "none|quadric|log", "published: places of lights between vertices; default log");
  value(*environment, "--weber", environment_.weber, "X", "published: a light that adds no more than this fraction ends the list; default 0.03")
      ->check(realNumber(0.001, false, 0.999));
  value(*environment, "--power", environment_.power, "published|residual",
        "published: lights beside the harmonics of all of the map (they count twice), or taken out of them; default published");
  value(*environment, "--fit", environment_.fit, "greedy|l2|nnls|haar",
        "published: powers by --power, by least squares, by non-negative ones; haar: wavelets instead of harmonics and lights; default greedy");
  value(*environment, "--terms", environment_.terms, "N", "published: wavelets of --fit haar; default bands squared")
      ->check(CLI::Range(1, 24576).description(""));
  value(*environment, "-o,--out", environment_.out, "FILE",
        ".png: the map with its lights circled, what they leave (published: harmonics and lights together), and the harmonics of both (blue: negative); .exr: "
        "the four as layers");
  value(*environment, "--csv", environment_.csv, "FILE", "write the coefficients");

  CLI::App* view =
      command(app, "view", "show a scene in the browser: prints the address of a page of this machine", [this] { return runView(session, view_); });
  value(*view, "scene", view_.scene, "SCENE", "file, id or built-in name");
  value(*view, "--listen", view_.listen, "HOST:PORT", "loopback address of the page; port 0, the default, picks one");
  CLI::App* demo =
      command(app, "demo", "render a scene, relight it step by step, print cost and error of each step", [this] { return runDemo(session, demo_); });
  value(*demo, "scene", demo_.scene, "SCENE", "file, id or built-in name")->required();
  value(*demo, "-o,--out", demo_.out, "FOLDER", "for the pictures");
  addRequestOptions(*demo, demo_.request);

  CLI::App* completion = command(app, "completion", "print a completion script: source <(gobo completion bash)", [this] {
    auto script = completionScript(shell_);
    if (!script.ok()) return complain(script.status());
    std::printf("%s", script->c_str());
    return int(kOk);
  });
  value(*completion, "shell", shell_, "bash|zsh|fish", "the shell")->required();
  command(app, "man", "print the manual page: gobo man | man -l -", [this] {
    std::printf("%s", manual(app).c_str());
    return int(kOk);
  });
}

}  // namespace gobo::cli
