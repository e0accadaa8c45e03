// SPDX-License-Identifier: Apache-2.0
// Light along the edges of surfaces. A pixel that several surfaces share is like none of its neighbours, so that a filter over like pixels leaves its noise.
// Each of its view samples lies on a surface that pixels nearby show whole: it takes their light, times its own reflectance.
#pragma once

#include "terms/direct_unoccluded.h"
#include "terms/node.h"

namespace gobo::denoise {

/// Pixels around that are looked at.
inline constexpr int kEdgeRadius = 3;

/// Inputs: 0 features of `lobe`, 1 a picture "denoised" (plane rgb: of the demodulated light), 2 G-buffer, 3 surface. Output "denoised_edges", plane rgb f32x3:
/// the picture where the pixel is even (features.h). Elsewhere, with m_s modulationOf the view samples,
///     sum_s m_s L_s / sum_s m_s,   L_s = sum_q w rgb(q) / sum_q w
/// over the even pixels q around whose plane the sample is on (two widths of a pixel, normals within 20 degrees), w a Gaussian of a pixel; where there are none
/// L_s is the mean over all pixels around by similarity (similar.h). View samples that hit nothing bring nothing.
NodePtr makeViewSampleEdgesNode(int width, int height, int viewSamples, LobePart lobe);

}  // namespace gobo::denoise
