// SPDX-License-Identifier: Apache-2.0
// EXT_meshopt_compression: buffer views decoded by meshoptimizer, whose decoders are safe for untrusted input; sizes are
// checked here before anything is allocated.
#include <meshoptimizer.h>

#include "import/gltf/document.h"

namespace gobo::gltf {

bool unpackView(Document& d, const Cursor& at, uint64_t viewLength, std::vector<uint8_t>& out) {
  for (const char* key : {"buffer", "byteLength", "byteStride", "count", "mode"})
    if (!at[key].exists()) at[key].fail("is missing");
  const int buffer = at["buffer"].index("buffers");
  const uint64_t offset = uint64_t(at["byteOffset"].integer(0, 0, int64_t(1) << 48)), length = uint64_t(at["byteLength"].integer(0, 1, int64_t(1) << 48));
  const uint64_t stride = uint64_t(at["byteStride"].integer(1, 1, 256)), count = uint64_t(at["count"].integer(1, 1, int64_t(1) << 32));
  const std::string mode = at["mode"].text(), filter = at["filter"].text("NONE");
  if (!d.ok() || buffer < 0) return false;
  if (offset + length > d.buffers[buffer].size()) {
    at.fail("bytes " + std::to_string(offset) + " + " + std::to_string(length) + " are outside buffer " + std::to_string(buffer) + " of " +
            std::to_string(d.buffers[buffer].size()) + " bytes");
    return false;
  }
  if (count * stride != viewLength) {
    at["count"].fail(std::to_string(count) + " x " + std::to_string(stride) + " bytes are not the view's " + std::to_string(viewLength));
    return false;
  }
  // 16 bytes of output take at least a quarter of a byte, so a short stream cannot ask for much memory.
  if (count * stride > 4096 && count * stride / 64 > length) {
    at["count"].fail(std::to_string(length) + " bytes cannot hold " + std::to_string(count) + " elements");
    return false;
  }
  const bool attributes = mode == "ATTRIBUTES", triangles = mode == "TRIANGLES", indices = mode == "INDICES";
  if (!attributes && !triangles && !indices) at["mode"].fail("\"" + mode + "\" is not ATTRIBUTES, TRIANGLES or INDICES");
  else if (attributes ? stride % 4 != 0 : stride != 2 && stride != 4) at["byteStride"].fail("stride " + std::to_string(stride) + " does not fit mode " + mode);
  else if (triangles && count % 3) at["count"].fail(std::to_string(count) + " is no multiple of 3");
  if (filter != "NONE" && !attributes) at["filter"].fail("filters are for ATTRIBUTES only");
  else if (filter == "OCTAHEDRAL" && stride != 4 && stride != 8) at["byteStride"].fail("OCTAHEDRAL needs a stride of 4 or 8");
  else if (filter == "QUATERNION" && stride != 8) at["byteStride"].fail("QUATERNION needs a stride of 8");
  else if (filter != "NONE" && filter != "OCTAHEDRAL" && filter != "QUATERNION" && filter != "EXPONENTIAL") at["filter"].fail("\"" + filter + "\" is unknown");
  if (!d.ok() || !d.account(count * stride, at)) return false;
  out.resize(count * stride);
  const uint8_t* source = d.buffers[buffer].data() + offset;
  const int failed = attributes  ? meshopt_decodeVertexBuffer(out.data(), count, stride, source, length)
                     : triangles ? meshopt_decodeIndexBuffer(out.data(), count, stride, source, length)
                                 : meshopt_decodeIndexSequence(out.data(), count, stride, source, length);
  if (failed) {
    at.fail("compressed data cannot be decoded (code " + std::to_string(failed) + ")");
    return false;
  }
  if (filter == "OCTAHEDRAL") meshopt_decodeFilterOct(out.data(), count, stride);
  else if (filter == "QUATERNION") meshopt_decodeFilterQuat(out.data(), count, stride);
  else if (filter == "EXPONENTIAL") meshopt_decodeFilterExp(out.data(), count, stride);
  return true;
}

}  // namespace gobo::gltf
