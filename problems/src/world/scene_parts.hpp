// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "rangecal/core/yaml_reader.hpp"
#include "rangecal/problems/world/physical/world.hpp"
#include "rangecal/problems/world/scene.hpp"

/// The parts that a scene file is read in.
namespace rangecal::scene_parts {

/// A list of finite numbers, at least one.
inline Eigen::VectorXd coefficients(const YamlReader& node) {
  const std::vector<double> values = node.numbers();
  if (values.empty()) node.fail("holds no number");
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

/// `sensor`, of either model; the scene's kind is known.
void read_sensor(const YamlReader& node, Scene& scene);

/// Throws where the optics cannot see the scene's landmarks, which are known by now.
void check_optics(const YamlReader& sensor, const Scene& scene);

/// `effects`; all else of the scene is known.
void read_effects(const YamlReader& node, Scene& scene);

/// A field of the optical sensor: where it is kept, and what it may hold.
struct OpticsField {
  const char* name;
  double world::OpticalSensor::*sensor;  ///< one of both is null
  double world::SpinningHead::*head;
  double low, high;  ///< both allowed
};
const std::vector<OpticsField>& optics_fields();

inline double& value_of(const OpticsField& field, SceneOptics& optics) {
  return field.sensor ? optics.sensor.*field.sensor : optics.head.*field.head;
}

}  // namespace rangecal::scene_parts
