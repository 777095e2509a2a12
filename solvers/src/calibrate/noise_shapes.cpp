// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/noise_shapes.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

namespace rangecal {
namespace {

template <typename Robust>
Calibration shaped_calibration(const LandmarksJob& job, Method method, const Robust& robust) {
  Calibration result = calibration_from_fit(job, method, robust.fit);
  if (result.alpha.size() == 0) return result;
  const RobustShapes& shapes = robust.shapes;
  if (const auto range = shape_estimate(shapes.range, shapes.range_std))
    result.noise_shapes["range"] = *range;
  if (const auto bearing = shape_estimate(shapes.bearing, shapes.bearing_std))
    result.noise_shapes["bearing"] = *bearing;
  JointState state = robust.fit.state;
  if (state.sigma_s_m) state.sigma_s_m = std::max(*state.sigma_s_m, no_sigma_s(job.problem));
  const RobustNll nll = robust_nll(*job.rows, state, shapes.range, shapes.bearing);
  if (!nll.ok) return result;
  const int count = shape_parameter_count(shapes.range.shape) + shape_parameter_count(shapes.bearing.shape);
  result.joint_nll = nll.joint;
  result.marginal_nll = nll.marginal;
  result.aic = 2.0 * (nll.marginal + job.parameters(state) + count);
  return result;
}

}  // namespace

std::optional<ShapeEstimate> shape_estimate(const NoiseShapeParameters& shape,
                                            const std::vector<double>& deviations) {
  if (shape_parameter_count(shape.shape) == 0) return std::nullopt;
  ShapeEstimate estimate;
  estimate.family = to_string(shape.shape);
  const bool student = shape.shape == NoiseShape::student_t;
  const std::vector<const char*> names =
      student ? std::vector<const char*>{"nu"} : std::vector<const char*>{"outlier_share", "outlier_scale"};
  const double values[2] = {student ? shape.nu : shape.outlier_share, shape.outlier_scale};
  for (std::size_t i = 0; i < names.size(); ++i) {
    estimate.parameters[names[i]] = values[i];
    if (i < deviations.size() && std::isfinite(deviations[i])) estimate.std_dev[names[i]] = deviations[i];
  }
  return estimate;
}

std::string in_words(const ShapeEstimate& shape) {
  const auto found_in = [](const std::map<std::string, double>& all, const char* name) {
    const auto found = all.find(name);
    return found == all.end() ? 0.0 : found->second;
  };
  const auto value = [&](const char* name) { return found_in(shape.parameters, name); };
  if (shape.family == to_string(NoiseShape::student_t)) {
    const double std_dev = found_in(shape.std_dev, "nu");
    return fmt::format("student-t with nu = {:.3g}{}", value("nu"),
                       std_dev > 0.0 ? fmt::format(" +- {:.2g}", std_dev) : std::string());
  }
  if (value("outlier_share") < 1e-5) return shape.family + " without an outlier";
  return fmt::format("{}: {:.3g} % of the readings with {:.3g} times the spread", shape.family,
                     100.0 * value("outlier_share"), value("outlier_scale"));
}

Calibration calibration_from_robust(const LandmarksJob& job, const RobustJointFit& fit) {
  return shaped_calibration(job, Method::full, fit);
}

Calibration calibration_from_robust(const LandmarksJob& job, const RobustMarginalFit& fit) {
  Calibration result = shaped_calibration(job, Method::marginal, fit);
  result.sigma_s_upper95_m = fit.fit.sigma_s_upper95_m;
  return result;
}

void report_shapes(CalibrationReport& report) {
  for (const Calibration& calibration : report.calibrations) {  // the last one asked for speaks
    if (calibration.noise_shapes.empty()) continue;
    report.noise_shape.clear();
    for (const char* channel : {"range", "bearing"}) {
      const auto found = calibration.noise_shapes.find(channel);
      if (found == calibration.noise_shapes.end()) continue;
      if (!report.noise_shape.empty()) report.noise_shape += "; of bearing ";
      report.noise_shape += in_words(found->second);
    }
  }
  if (!report.noise_shape.empty())
    report.notes.push_back(
        "noise is " + report.noise_shape +
        "; sigmas are its scales, and the closed forms, which know the gaussian only, have no "
        "NLL of it");
}

}  // namespace rangecal
