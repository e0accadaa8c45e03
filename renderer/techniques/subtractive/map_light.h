// SPDX-License-Identifier: Apache-2.0
// What subtractive shadows know of an environment: its unshadowed light at every sample, and the few lights whose shadows stand for all of it. Both of
// the map without the peaks that have shadows of their own (techniques/transfer/environment_split.h).
#pragma once

#include "terms/extract_lights.h"
#include "terms/gbuffer.h"

namespace gobo::subtractive {

inline constexpr int kBands = 5;  ///< of the split that both read

/// Where diffuse light comes from. Table: below. Harmonics: nine of them (Ramamoorthi, Hanrahan 2001), as published: exact for maps of three bands; of one
/// lamp, as a part of its irradiance on a plane that faces it, (0.375 + 2 x + 1.875 x^2) / 4 at a cosine of x: 1.06 at most, and -0.04 at -0.53, where it is
/// cut at 0.
enum class DiffuseBy : uint8_t { Table, Harmonics };

/// Term "unshadowed_map", domain ViewSample: "diffuse", "specular" f32x3, radiance, >= 0. Inputs: G-buffer, surface, environment split; gloss levels, if
/// anything shines.
///   diffuse   the lobe's albedo / pi times the irradiance about the shading normal, bilinear in a table of 128 x 65 normals that the node makes for itself
///             from at most 2048 lights (median cut). Within 0.1 % under a uniform map (measured 0.04 %); of one lamp, within 1.3 % of the irradiance of a
///             plane that faces it (measured 1.1 %, about the normals at right angles to it)
///   specular  the lobe's albedo times the map prefiltered for the roughness about the lobe's own direction (Karis 2013): round highlights, no horizon.
///             Under a uniform map within 1e-6
/// Cost: some 30 ms of one core for the table (harmonics: none), and about 0.1 us a sample, whatever the map.
NodePtr makeUnshadowedMapNode(const GBufferSettings& view, EnvironmentPtr map, float rotation, const Vec3& scale, bool shines, DiffuseBy by = DiffuseBy::Table);

/// Term "light_list" as extract_lights has it, of the map in 512 x 256 texels without its peaks. Input: environment split. Small. The map is a parameter: one
/// that turns keeps its lights.
NodePtr makeResidualLightsNode(EnvironmentPtr map, int lights, ExtractBy by);

}  // namespace gobo::subtractive
