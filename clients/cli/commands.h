// SPDX-License-Identifier: Apache-2.0
// The CLI's commands. Each takes its parsed options and returns an exit code (session.h).
#pragma once

#include <string>
#include <vector>

#include "measurement/series.h"
#include "session.h"

namespace gobo::cli {

/// What makes a RenderRequest: a JSON file, then the options, then --set in order; later ones win.
struct RequestOptions {
  std::string file, camera, size, environment, outputs, priority, denoise;
  std::vector<std::string> sets, curves, formulas;
  std::string style;  // a style sheet's file
  uint32_t spp = 0;
  double time = 0, error = 0, deadlineMs = 0;
  bool certificate = false, half = false, layers = false;
};

struct RenderCommand {
  std::string scene, out;
  RequestOptions request;
  bool json = false, progressive = false, quiet = false;
  bool planAll = false;  ///< print every row of the plan: by default rows of one kind are one
  uint32_t tile = 0;     ///< pixels a side of parts that are rendered one after the other; 0: the picture as one
};
int runRender(const SessionOptions& session, const RenderCommand& command);

/// What a render would do, without doing it.
int runPlan(const SessionOptions& session, const RenderCommand& command);

/// environment.transfer of a scene, kept for any map. Negative: the field's default.
struct PrecomputeCommand {
  std::string scene;
  RequestOptions request;  ///< what the scene is: its time, its variant
  int bands = -1, bounces = -1, samples = -1, points = -1;
  bool json = false, progressive = false, quiet = false;
};
int runPrecompute(const SessionOptions& session, const PrecomputeCommand& command);

struct RelightCommand {
  std::string id, out;
  RequestOptions request;  ///< what differs from the render
  bool json = false, progressive = false, quiet = false, planAll = false;
};
int runRelight(const SessionOptions& session, const RelightCommand& command);

int runScenes(const SessionOptions& session, bool json);
int runLoad(const SessionOptions& session, const std::string& source, const std::string& name, bool json);
int runInspect(const SessionOptions& session, const std::string& scene, bool json);
int runUnload(const SessionOptions& session, const std::string& scene);
int runStatus(const SessionOptions& session, bool json);
int runWorkers(const SessionOptions& session, bool json);
int runDropCaches(const SessionOptions& session, bool disk);
enum class CacheAct { List, Size, Evict, Pin, Unpin };
struct CacheCommand {
  std::string type, scene, sort = "used";  ///< type: '*' stands for any letters
  std::vector<std::string> keys;           ///< digests or how they begin
  uint32_t limit = 1000;                   ///< rows
  bool pinned = false, memory = false, json = false;
};
int runCache(const SessionOptions& session, CacheAct act, const CacheCommand& command);
int runShutdown(const SessionOptions& session);

struct CompareCommand {
  std::string a, b, diff;
  double scale = 0;     ///< error shown at full colour in --diff; 0: the largest
  double maxRmse = -1;  ///< exit 1 above it; negative: never
  bool json = false;
};
int runCompare(const CompareCommand& command);

struct MeasureCommand {
  std::string scene, out, csv;
  std::string output = "beauty";   ///< what the error is of
  std::vector<SeriesWord> series;  ///< --series, --sweep and --with in their order
  uint32_t pathTracing = 0;        ///< most samples of the plain series; 0: none
  std::string reference;           ///< FILE or FILE.exr:LAYER instead of a rendered one
  RequestOptions request;
  uint32_t referenceSpp = 1024;  ///< both halves together
  uint32_t repeats = 1;
  bool cold = false, json = false;
  std::string command;  ///< as it can be typed on another machine
};
int runMeasure(const SessionOptions& session, const MeasureCommand& command);

struct OcclusionCommand {
  std::string scene, light, techniques, csv, plot;
  RequestOptions request;
  int row = -1, column = -1;        ///< of the picture; neither: the middle row
  uint32_t referenceSamples = 256;  ///< shadow rays per view sample of the truth
};
int runOcclusion(const SessionOptions& session, const OcclusionCommand& command);

/// What environment.transfer makes of a map.
struct EnvironmentCommand {
  std::string map, out, csv;
  uint32_t bands = 5, lights = 16;  ///< as the request's fields
  double lightShare = -1;           ///< below 0: 0.02
  bool json = false;
  std::string method;                              ///< empty: moments
  std::string window, radius, refine, power, fit;  ///< of the published one; empty: its default, so that what does not go together is told
  double radiusDeg = 0, weber = 0;                 ///< 0: default
  uint32_t terms = 0;                              ///< of Haar wavelets; 0: as many as harmonics
};
int runEnvironment(const EnvironmentCommand& command);
/// The same by the published method.
Status analysePublished(const EnvironmentCommand& command);

enum class RegressAct { Run, Accept, Report };
struct RegressCommand {
  std::string suite, out;
  std::vector<std::string> cases;  ///< empty: all
  std::string by, why;             ///< of accept
  bool json = false;
};
int runRegress(const SessionOptions& session, RegressAct act, const RegressCommand& command);

struct BisectCommand {
  std::string suite, good, bad;    ///< good, bad: revisions
  std::vector<std::string> cases;  ///< empty: all
  std::string repository = ".", build = "make build", program = "build/clients/gobo";
  std::string work;         ///< folder; empty: below the user's cache
  double limitSeconds = 0;  ///< of a commit's build, and of its run; 0: any
  bool json = false;
};
int runBisect(const SessionOptions& session, const BisectCommand& command);

struct DemoCommand {
  std::string scene, out;  ///< out: folder for EXR and PNG of every step
  RequestOptions request;
};
int runDemo(const SessionOptions& session, const DemoCommand& command);

struct ViewCommand {
  std::string scene;  ///< empty: none yet
  std::string listen = "127.0.0.1:0";
};
int runView(const SessionOptions& session, const ViewCommand& command);

struct JobSubmitCommand {
  std::string scene, frames, name, key, priority;
  RequestOptions request;
  std::string format;  ///< of the files; empty: EXR
  double fps = 0, deadlineSeconds = 0;
  uint32_t attempts = 0, tile = 0;
  bool watch = false;
  std::string after, out;  ///< after: ids with commas; out: pattern of paths below the daemon's jobs.out_folder
};
struct JobLogCommand {
  std::string id, frames;
  uint32_t most = 0;  ///< of the newest entries; 0: the server's default
  bool follow = false, json = false;
};
struct JobFetchCommand {
  std::string id, out;  ///< out: folder
  std::string frames, outputs;
  bool follow = false;
};
int runJobSubmit(const SessionOptions& session, const JobSubmitCommand& command, bool json);
int runJobList(const SessionOptions& session, const std::vector<std::string>& states, bool json);
int runJobShow(const SessionOptions& session, const std::string& id, bool json);
int runJobWatch(const SessionOptions& session, const std::string& id, bool json);
enum class JobAct { Cancel, Pause, Resume, Retry, Prioritize, Delete };
/// For every id in turn; the exit code of the first that fails.
/// `priority`: LOW, MEDIUM or HIGH, of Prioritize.
int runJobAct(const SessionOptions& session, JobAct act, const std::vector<std::string>& ids, bool json, const std::string& priority = {});
/// What each of `ids` waits for from now on: jobs with commas between them, or with `none` nothing.
int runJobDepend(const SessionOptions& session, const std::vector<std::string>& ids, const std::string& after, bool none, bool json);
int runJobLog(const SessionOptions& session, const JobLogCommand& command);
int runJobFetch(const SessionOptions& session, const JobFetchCommand& command);

/// The fields that `options` name, and no others.
Result<v1::RenderRequest> describedBy(const RequestOptions& options);
/// The request that `options` describe, for the scene that the user means by `source` (ensureScene; may be empty where the request names one). What is wrong
/// with the options is said before a scene is loaded or sent.
Result<v1::RenderRequest> makeRequest(Session& session, const RequestOptions& options, const std::string& source);

}  // namespace gobo::cli
