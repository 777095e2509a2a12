// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/problems/world/scene.hpp"

namespace rangecal {

/// One (stop, landmark), or one batch, as the sensor sees it: everything of its readings but the noise.
struct SceneCell {
  double bearing_rad = 0.0;
  double f_m = 0.0;          ///< mean reading, before any rounding; infinite where the optics see no spot
  double spread_m = 0.0;     ///< s(d); 0 where f is infinite
  world::Exposure exposure;  ///< with optics
};

/// The sensor of a scene, of either model.
///   polynomial: y = f(d) + s(d) e, theta = direction to the axis
///   optical:    what the firmware makes of the spot of the surface at d, s(d) e added to the range it stands for;
///               theta = what the encoder says
class SceneSensor {
 public:
  explicit SceneSensor(const Scene& scene);

  /// Of a surface at distance d [m]. Throws InputError where the noise has no positive spread there.
  SceneCell at(double d) const;
  /// Of every landmark in turn, seen from a stop that stands at `pose`; optical only.
  std::vector<world::Exposure> exposures(const Recording& layout, const Pose2& pose) const;
  /// A landmark at distance d, in the direction theta [rad]; `exposure`: of it, with optics.
  SceneCell of(double d, double theta, const world::Exposure* exposure) const;
  /// A reading of the cell with the error e ~ N(0, 1) [m]; infinite where there is none.
  double reading(const SceneCell& cell, double e) const;

 private:
  double spread(double d, double f) const;

  const Scene& scene_;
  world::World world_;
};

}  // namespace rangecal
