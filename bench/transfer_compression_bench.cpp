// SPDX-License-Identifier: Apache-2.0
// Bytes and added error of a scene's transfer table as floats, in halves and in clusters of principal directions (techniques/transfer/compression).
//   table error   Euclidean norm of what is missed, by the table's
//   light error   of direct (bounced) irradiance under each map of --env and under 16 random ones: RMS over points by the RMS of the light; the largest of them
//   bound         the largest of the clusters', by the RMS row
// Rows: direct transfer (bands^2 floats a point), then with one bounce (3 bands^2 more, one cluster for both parts of a point).
// Arguments: --scene NAME --points N --bands N --clusters N,N,... --kept N,N,...
//            --clusters-both N,N,... --kept-both N,N,...
//            --env FILE,FILE,... --threads N --out PATH
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "import/load.h"
#include "measure/report.h"
#include "nodes_by_hand.h"
#include "plan/engine.h"
#include "techniques/transfer/compression/clustered_table.h"
#include "techniques/transfer/environment_harmonics.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/receiver_mesh.h"

using namespace gobo;
using namespace gobo::transfer;

namespace {

[[noreturn]] void fail(const Status& status) {
  std::fprintf(stderr, "transfer_compression_bench: %s\n", status.toString().c_str());
  std::exit(1);
}

struct Floats {
  std::vector<float> values;
  size_t width = 0;
  size_t rows() const { return values.size() / width; }
};

struct Errors {
  double table = 0, light = 0;
};
/// `maps`: coefficients of one channel each, of a point's grey direct transfer; of its bounced one by channel too.
template <typename Packed>
Errors errorsOf(const Floats& table, const Packed& packed, size_t harmonics, const std::vector<std::vector<double>>& maps) {
  std::vector<float> back(table.width);
  std::vector<double> missed(maps.size(), 0.0), light(maps.size(), 0.0);
  double all = 0, off = 0;
  for (size_t i = 0; i < table.rows(); ++i) {
    packed.row(i, back);
    const float* row = table.values.data() + i * table.width;
    for (size_t d = 0; d < table.width; ++d) {
      off += std::pow(double(back[d]) - double(row[d]), 2);
      all += std::pow(double(row[d]), 2);
    }
    for (size_t m = 0; m < maps.size(); ++m)
      for (size_t part = 0; part < table.width; part += harmonics) {
        double whole = 0, difference = 0;
        for (size_t h = 0; h < harmonics; ++h) {
          whole += maps[m][h] * double(row[part + h]);
          difference += maps[m][h] * (double(back[part + h]) - double(row[part + h]));
        }
        light[m] += whole * whole;
        missed[m] += difference * difference;
      }
  }
  Errors out;
  out.table = std::sqrt(off / all);
  for (size_t m = 0; m < maps.size(); ++m) out.light = std::max(out.light, std::sqrt(missed[m] / light[m]));
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string scene = argumentOr(argc, argv, "--scene", "cornell");
  const int threads = std::atoi(argumentOr(argc, argv, "--threads", "2").c_str()), bands = std::atoi(argumentOr(argc, argv, "--bands", "5").c_str());
  if (bands < 1 || bands > 10) fail(invalidArgument("--bands: 1 to 10"));
  EngineOptions options;
  options.loader = inProcessLoader();
  options.threads = threads;
  options.anyPath = true;
  auto engine = Engine::create(options);
  if (!engine.ok()) fail(engine.status());
  auto loaded = (*engine)->loadScene(scene, true);
  if (!loaded.ok()) fail(loaded.status());
  NodesByHand run(*loaded, threads);
  TransferSettings s;
  s.points = uint32_t(std::atoi(argumentOr(argc, argv, "--points", "30000").c_str()));
  s.bands = bands;
  s.size = uint32_t(receiverMesh(run.view(ReceiverMesh::kFacets), s.points)->size());
  const TermPtr points = run(makeTransferPointsNode(s), {});
  TermPtr direct;
  for (uint32_t b = 0; b < 8; ++b) direct = run(makeDirectTransferNode(s, b), b == 0 ? std::vector{points} : std::vector{points, direct});
  const TermPtr bounced = run(makeBouncedTransferNode(s, 0, 128), {points, run(makePointAlbedoNode(s), {points}), direct});

  const size_t n = size_t(s.harmonics());
  std::vector<std::vector<double>> maps;
  for (const std::string& file : partsOf(argumentOr(argc, argv, "--env", ""), ',')) {
    const auto map = loadEnvironment(file);
    if (!map.ok()) fail(map.status());
    const std::vector<double> all = environmentHarmonics(**map, bands, run.arena());
    for (size_t c = 0; c < 3; ++c) {
      maps.emplace_back();
      for (size_t h = 0; h < n; ++h) maps.back().push_back(all[3 * h + c]);
    }
  }
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (int k = 0; k < 16; ++k) {  // a constant sky with as much again in all harmonics together
    maps.emplace_back(n);
    for (double& v : maps.back()) v = normal(random) / std::sqrt(double(n));
    maps.back()[0] = 1;
  }

  Table out("Transfer tables in fewer bytes",
            {"table", "as", "clusters", "kept", "bytes", "times smaller", "table error", "light error", "bound / RMS row", "s"});
  out.note("scene", scene);
  out.note("points", double(s.size));
  out.note("bands", double(bands));
  const auto values = direct->floats("transfer"), bounces = bounced->floats("sum");
  for (const bool both : {false, true}) {
    Floats table{{}, both ? 4 * n : n};
    for (size_t i = 0; i < s.size; ++i) {
      table.values.insert(table.values.end(), values.begin() + long(i * n), values.begin() + long((i + 1) * n));
      if (both) table.values.insert(table.values.end(), bounces.begin() + long(3 * i * n), bounces.begin() + long(3 * (i + 1) * n));
    }
    double squares = 0;
    for (const float v : table.values) squares += double(v) * double(v);
    const double typical = std::sqrt(squares / double(table.rows())), bytes = 4.0 * double(table.values.size());
    const std::string name = both ? "direct and bounced" : "direct";
    out.add({name, std::string("floats"), 0.0, double(table.width), bytes, 1.0, 0.0, 0.0, 0.0, 0.0});
    const auto half = halfTable(table.values, table.width, run.arena());
    if (!half.ok()) fail(half.status());
    const Errors rounding = errorsOf(table, *half, n, maps);
    out.add({name, std::string("halves"), 0.0, double(table.width), double(half->bytes()), bytes / double(half->bytes()), rounding.table, rounding.light,
             half->bound / typical, 0.0});
    for (const std::string& clusters : partsOf(argumentOr(argc, argv, both ? "--clusters-both" : "--clusters", both ? "32" : "16,64,256"), ','))
      for (const std::string& kept : partsOf(argumentOr(argc, argv, both ? "--kept-both" : "--kept", both ? "12,16,22" : "3,4,5,8"), ',')) {
        ClusterSettings settings;
        settings.clusters = size_t(std::atoi(clusters.c_str()));
        settings.kept = size_t(std::atoi(kept.c_str()));
        const auto start = std::chrono::steady_clock::now();
        const auto packed = clusteredTable(table.values, table.width, settings, run.arena());
        const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        if (!packed.ok()) fail(packed.status());
        const Errors e = errorsOf(table, *packed, n, maps);
        out.add({name, std::string("clusters"), double(packed->clusters()), double(packed->kept), double(packed->bytes()), bytes / double(packed->bytes()),
                 e.table, e.light, *std::max_element(packed->bound.begin(), packed->bound.end()) / typical, seconds});
      }
  }
  std::printf("%s", out.text().c_str());
  const std::string path = argumentOr(argc, argv, "--out", "");
  if (path.empty()) return 0;
  if (const Status status = out.write(path); !status.ok()) fail(status);
  return 0;
}
