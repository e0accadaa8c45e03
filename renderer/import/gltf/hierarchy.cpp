// SPDX-License-Identifier: Apache-2.0
// The node tree, skins and animations into the rig. Structural faults are errors; an animation channel that cannot be
// followed is left out with a warning, because the scene can be shown without it.
#include "import/gltf/document.h"
#include "import/gltf/unique_names.h"

namespace gobo::gltf {
namespace {

RigNode readNode(Document& d, const Cursor& node) {
  RigNode n;
  const Cursor matrix = node["matrix"];
  if (matrix.exists()) {
    if (matrix.size() != 16) {
      matrix.fail("is not an array of 16 numbers");
      return n;
    }
    for (const char* key : {"translation", "rotation", "scale"})
      if (node[key].exists()) d.warn(matrix.pointer, std::string("node has a matrix and a ") + key + "; the matrix counts");
    for (size_t i = 0; i < 16; ++i) n.matrix[int(i / 4)][int(i % 4)] = matrix.at(i).number(0.0);
    if (n.matrix[0][3] != 0.0 || n.matrix[1][3] != 0.0 || n.matrix[2][3] != 0.0 || n.matrix[3][3] != 1.0) matrix.fail("last row is not 0 0 0 1");
    n.fixed = true;
    return n;
  }
  n.translation = node["translation"].vector(DVec3(0.0));
  n.scale = node["scale"].vector(Vec3(1.0f));
  const Vec4 q = node["rotation"].vector(Vec4(0, 0, 0, 1));
  const float length = glm::length(q);
  if (!(length > 1e-6f) || !std::isfinite(length)) {
    node["rotation"].fail("quaternion has no length");
    return n;
  }
  if (std::fabs(length - 1.0f) > 1e-2f) d.warn(node["rotation"].pointer, "quaternion is not of unit length and was scaled");
  n.rotation = q / length;
  return n;
}

}  // namespace

Status readHierarchy(Document& d, Rig& rig, std::vector<int>& place) {
  const Cursor nodes = d.list("nodes");
  const size_t n = nodes.size();
  if (!d.account(n * (sizeof(RigNode) + 32), nodes)) return d.status;
  std::vector<int> parent(n, -1);
  std::vector<std::vector<int>> children(n);
  for (size_t i = 0; i < n && d.ok(); ++i) {
    const Cursor list = nodes.at(i)["children"];
    for (size_t k = 0; k < list.size() && d.ok(); ++k) {
      const int c = list.at(k).index("nodes");
      if (c < 0) continue;
      if (parent[c] >= 0 || c == int(i)) {
        nodes.at(size_t(c)).fail("node " + std::to_string(c) + " is reached twice: the nodes form a cycle or share a child");
        return d.status;
      }
      parent[c] = int(i);
      children[i].push_back(c);
    }
  }
  place.assign(n, -1);
  std::vector<int> order;
  for (size_t i = 0; i < n; ++i)
    if (parent[i] < 0) order.push_back(int(i));
  for (size_t k = 0; k < order.size(); ++k) order.insert(order.end(), children[order[k]].begin(), children[order[k]].end());
  for (size_t i = 0; i < n && d.ok(); ++i) place[i] = -1;
  for (size_t k = 0; k < order.size() && d.ok(); ++k) {
    RigNode node = readNode(d, nodes.at(size_t(order[k])));
    node.parent = parent[order[k]] < 0 ? -1 : place[parent[order[k]]];
    place[order[k]] = int(k);
    rig.nodes.push_back(node);
  }
  for (size_t i = 0; i < n && d.ok(); ++i)
    if (place[i] < 0) nodes.at(i).fail("node " + std::to_string(i) + " is its own ancestor: the nodes form a cycle");
  return d.status;
}

Status readSkins(Document& d, Rig& rig, const std::vector<int>& place) {
  const Cursor list = d.list("skins");
  for (size_t i = 0; i < list.size() && d.ok(); ++i) {
    const Cursor joints = list.at(i)["joints"], matrices = list.at(i)["inverseBindMatrices"];
    const int accessor = matrices.index("accessors");
    list.at(i)["skeleton"].index("nodes");
    if (!joints.exists() || joints.size() == 0) joints.fail("a skin needs joints");
    if (joints.size() > 65536) joints.fail("more than 65536 joints");
    std::vector<int32_t> nodes;
    for (size_t k = 0; k < joints.size() && d.ok(); ++k) {
      const int j = joints.at(k).index("nodes");
      if (d.ok()) nodes.push_back(place[j]);
    }
    if (!d.ok()) break;
    std::vector<Mat4> inverse(nodes.size(), Mat4(1.0f));
    std::vector<float> values;
    if (accessor >= 0) {
      if (!readFloats(d, accessor, 16, values)) break;
      if (values.size() < inverse.size() * 16) {
        matrices.fail("holds " + std::to_string(values.size() / 16) + " matrices for " + std::to_string(inverse.size()) + " joints");
        break;
      }
      size_t odd = 0;
      for (size_t k = 0; k < inverse.size(); ++k) {
        Mat4& m = inverse[k];
        for (int c = 0; c < 16; ++c) m[c / 4][c % 4] = values[k * 16 + size_t(c)];
        bool finite = true;
        for (int c = 0; c < 16; ++c) finite = finite && std::isfinite(m[c / 4][c % 4]);
        if (!finite) m = Mat4(1.0f);
        odd += !finite || m[0][3] != 0.0f || m[1][3] != 0.0f || m[2][3] != 0.0f || std::fabs(m[3][3] - 1.0f) > 1e-4f;
        m[0][3] = m[1][3] = m[2][3] = 0.0f;
        m[3][3] = 1.0f;
      }
      if (odd) d.warn(matrices.pointer, std::to_string(odd) + " matrices are not affine; their last row counts as 0 0 0 1");
    }
    rig.skins.push_back({Array<int32_t>(std::move(nodes)), Array<Mat4>(std::move(inverse))});
  }
  return d.status;
}

namespace {

/// Key times and values of a sampler; false with a warning when it cannot be followed.
bool readSampler(Document& d, const Cursor& at, RigSampler& out, int& components) {
  const int input = at["input"].index("accessors"), output = at["output"].index("accessors");
  const std::string mode = at["interpolation"].text("LINEAR");
  if (!d.ok()) return false;
  auto leaveOut = [&](const Cursor& place, const std::string& why) {
    d.warn(place.pointer, why + "; the sampler is left out");
    return false;
  };
  if (input < 0 || output < 0) return leaveOut(at, "input or output is missing");
  if (mode == "STEP") out.interpolation = RigInterpolation::Step;
  else if (mode == "CUBICSPLINE") out.interpolation = RigInterpolation::CubicSpline;
  else if (mode != "LINEAR") return leaveOut(at["interpolation"], "\"" + mode + "\" is not LINEAR, STEP or CUBICSPLINE");
  if (accessorComponents(d, input) != 1) return leaveOut(at["input"], "key times are not SCALAR");
  std::vector<float> times, values;
  components = accessorComponents(d, output);
  if (!readFloats(d, input, 1, times) || !readFloats(d, output, components, values)) return false;
  for (size_t k = 0; k < times.size(); ++k) {
    if (!std::isfinite(times[k]) || times[k] < 0.0f) return leaveOut(at["input"], "time of key " + std::to_string(k) + " is negative or not finite");
    if (k && times[k] <= times[k - 1]) return leaveOut(at["input"], "time of key " + std::to_string(k) + " is not later than the one before");
  }
  for (const float v : values)
    if (!std::isfinite(v)) return leaveOut(at["output"], "a value is not finite");
  out.times = std::move(times);
  out.values = std::move(values);
  return true;
}

void readChannels(Document& d, const Cursor& at, Rig& rig, const std::vector<int>& place, const std::vector<size_t>& targets, RigAnimation& a) {
  const Cursor samplers = at["samplers"], channels = at["channels"];
  std::vector<int> made(samplers.size(), -1), widths(samplers.size(), 0);
  for (size_t i = 0; i < samplers.size() && d.ok(); ++i) {
    RigSampler s;
    if (!readSampler(d, samplers.at(i), s, widths[i])) continue;
    made[i] = int(a.samplers.size());
    a.samplers.push_back(std::move(s));
  }
  std::map<std::pair<int, int>, size_t> taken;
  bool first = true;
  for (size_t i = 0; i < channels.size() && d.ok(); ++i) {
    const Cursor channel = channels.at(i), target = channel["target"];
    const int sampler = channel["sampler"].indexInto(samplers), node = target["node"].index("nodes");
    const std::string path = target["path"].text();
    if (!d.ok()) return;
    if (sampler < 0) {
      d.warn(channel.pointer, "channel without a sampler is left out");
      continue;
    }
    if (node < 0) {
      d.warn(target.pointer, "channel without a node is left out");
      continue;
    }
    RigChannel c;
    c.node = place[node];
    c.sampler = made[sampler];
    size_t width = 3;
    if (path == "rotation") {
      c.path = RigPath::Rotation;
      width = 4;
    } else if (path == "scale") c.path = RigPath::Scale;
    else if (path == "weights") {
      c.path = RigPath::Weights;
      width = targets[c.node];
    } else if (path != "translation") {
      d.warn(target["path"].pointer, "\"" + path + "\" cannot be animated; the channel is left out");
      continue;
    }
    if (c.sampler < 0) {
      d.warn(channel.pointer, "its sampler is left out, and so is the channel");
      continue;
    }
    if (c.path != RigPath::Weights && rig.nodes[c.node].fixed) {
      d.warn(target.pointer, "the node has a matrix and cannot be animated; the channel is left out");
      continue;
    }
    if (width == 0) {
      d.warn(target.pointer, "the node has no morph targets to move; the channel is left out");
      continue;
    }
    const RigSampler& s = a.samplers[c.sampler];
    const size_t numbers = s.times.size() * width * (s.interpolation == RigInterpolation::CubicSpline ? 3 : 1);
    if (s.values.size() != numbers || widths[sampler] != (c.path == RigPath::Weights ? 1 : int(width))) {
      d.warn(channel["sampler"].pointer, "output has " + std::to_string(s.values.size()) + " numbers, " + path + " of " + std::to_string(s.times.size()) +
                                             " keys needs " + std::to_string(numbers) + "; the channel is left out");
      continue;
    }
    if (c.path == RigPath::Rotation) {
      const size_t step = s.interpolation == RigInterpolation::CubicSpline ? 12 : 4, from = s.interpolation == RigInterpolation::CubicSpline ? 4 : 0;
      size_t odd = 0;
      for (size_t k = from; k + 4 <= s.values.size(); k += step)
        odd += std::fabs(glm::length(Vec4(s.values[k], s.values[k + 1], s.values[k + 2], s.values[k + 3])) - 1.0f) > 1e-2f;
      if (odd) d.warn(channel["sampler"].pointer, std::to_string(odd) + " quaternions are not of unit length and are scaled");
    }
    if (const auto [earlier, fresh] = taken.insert({{c.node, int(c.path)}, i}); !fresh) {
      d.warn(channels.at(earlier->second)["target"].pointer, "channel " + std::to_string(i) + " moves the same and is left out");
      continue;
    }
    a.start = first ? s.times.front() : std::fmin(a.start, s.times.front());
    a.end = first ? s.times.back() : std::fmax(a.end, s.times.back());
    first = false;
    a.channels.push_back(c);
  }
}

}  // namespace

Status readAnimations(Document& d, Rig& rig, const std::vector<int>& place) {
  const Cursor list = d.list("animations");
  std::vector<size_t> targets(rig.nodes.size(), 0);
  for (const RigDeformed& m : rig.deformed) targets[m.node] = std::max(targets[m.node], m.weights.size());
  UniqueNames names;
  for (size_t i = 0; i < list.size() && d.ok(); ++i) {
    RigAnimation a;
    const std::string wanted = list.at(i)["name"].text("animation" + std::to_string(i));
    a.name = names.take(wanted.empty() || wanted == "*" ? "animation" + std::to_string(i) : wanted, wanted);
    readChannels(d, list.at(i), rig, place, targets, a);
    if (a.channels.empty()) {
      d.warn(list.at(i).pointer, "animation \"" + a.name + "\" moves nothing and is left out");
      continue;
    }
    rig.animations.push_back(std::move(a));
  }
  return d.status;
}

}  // namespace gobo::gltf
