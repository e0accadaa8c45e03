// SPDX-License-Identifier: Apache-2.0
// A technique brings light into the picture. Each family of them is a folder under techniques/, with one line in techniques/registry.cpp; the
// planner (plan/planner.h) knows none by name. docs/add_a_technique.md shows how one is added.
#pragma once

#include <span>

#include "base/status.h"

namespace gobo {
inline namespace technique {

class PlanContext;  // technique/plan_context.h

class Technique {
 public:
  virtual ~Technique() = default;
  virtual const char* name() const = 0;
  /// Its light is right through a lens too (Camera::hasLens), where a pixel's samples look from many points. Not so of what shades the points of a
  /// G-buffer as they look from the camera's position, or filters over neighbours.
  virtual bool seesThroughLens() const { return false; }
  /// Which paths of which lights it takes, by PlanContext::cover(). All techniques claim before any plans.
  virtual Status claim(PlanContext&) const { return {}; }
  /// Adds nodes and the planes that they bring; whatever it claimed is brought. Called in the order of the registry, which is the order that
  /// planes are summed in.
  virtual Status plan(PlanContext&) const = 0;
};

/// In the order of summation.
std::span<const Technique* const> registeredTechniques();

}  // namespace technique
}  // namespace gobo
