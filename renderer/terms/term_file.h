// SPDX-License-Identifier: Apache-2.0
// The byte form of a term in files: those of the disk tier and the checkpoints of jobs (docs/term_file.md). A file says of which key
// its term is, inside its digest: under another file's name it is damaged, not another picture. parseTerm() alone decides whether
// bytes are the term of a key. Functions are thread-safe; `stop` is polled every few MB that are copied.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/stop.h"
#include "terms/term.h"

namespace gobo {
inline namespace terms {

/// Empty if stopped.
std::vector<uint8_t> serializeTerm(const Term& term, const Hash128& key, const StopToken& stop = {});
/// Null if damaged, of another key or another version, or stopped. Checks every length and the digest.
std::shared_ptr<Term> parseTerm(const uint8_t* bytes, size_t size, const Hash128& key, const StopToken& stop = {});
/// The bytes are a whole term file of an earlier or later version (the digest is right): nothing to this build, and no damage.
bool isOtherTermVersion(const uint8_t* bytes, size_t size);
/// "term file version 1, this build reads version 2". Only for bytes of which the above is true.
std::string otherTermVersion(const uint8_t* bytes);

}  // namespace terms
}  // namespace gobo
