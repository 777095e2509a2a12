// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <nlohmann/json.hpp>

#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal {
namespace {

// Insertion order is the order of the report.
using Json = nlohmann::ordered_json;

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }
Json number(const std::optional<double>& value) { return value ? number(*value) : Json(nullptr); }

Json vector(const Eigen::VectorXd& values) {
  Json list = Json::array();
  for (const double value : values) list.push_back(number(value));
  return list;
}

template <typename Matrix>
Json matrix(const std::optional<Matrix>& values) {
  if (!values) return nullptr;
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < values->rows(); ++i) rows.push_back(vector(values->row(i).transpose()));
  return rows;
}

/// Without a curve there is no noise about it, and no range over which it was fitted.
bool is_empty(const Calibration& calibration) { return calibration.alpha.size() == 0; }

Json noise(const Calibration& calibration) {
  Json object{{"law", to_string(calibration.noise.law)},
              {"parameters",
               is_empty(calibration) ? Json::array({nullptr}) : Json(vector(calibration.noise.parameters))}};
  Json deviations = Json::array();
  for (const Estimate& estimate : calibration.noise_estimates) deviations.push_back(number(estimate.std_dev));
  object["std"] = deviations;
  for (const auto& [channel, shape] : calibration.noise_shapes) {
    object["shapes"][channel]["family"] = shape.family;
    for (const auto& [name, value] : shape.parameters) {
      const auto std_dev = shape.std_dev.find(name);
      object["shapes"][channel][name] = number(value);
      object["shapes"][channel][name + "_std"] =
          std_dev == shape.std_dev.end() ? Json(nullptr) : number(std_dev->second);
    }
  }
  return object;
}

/// Whether the curve is better than none: null where that was not judged.
void put_checks(Json& object, const Calibration& calibration) {
  const std::optional<LeftOutCheck>& check = calibration.left_out;
  object["usable"] = check ? Json(check->usable) : Json(nullptr);
  object["usable_reason"] = check ? check->reason : std::string();
  object["left_out"] = nullptr;
  if (check)
    object["left_out"] = {{"groups", check->groups},
                          {"rms_raw_m", number(check->rms_raw_m)},
                          {"rms_raw_std_m", number(check->rms_raw_std_m)},
                          {"rms_corrected_m", number(check->rms_corrected_m)},
                          {"rms_corrected_std_m", number(check->rms_corrected_std_m)},
                          {"halves_p_value", number(check->halves_p_value)}};
  object["covariance_by_stops"] = matrix(calibration.alpha_covariance_by_stops);
  object["misfit"] = nullptr;
  if (const auto& misfit = calibration.misfit)
    object["misfit"] = {{"factor", number(misfit->factor)},
                        {"threshold", number(misfit->threshold)},
                        {"where", misfit->where}};
}

void put_estimate(Json& object, const std::string& name, const std::optional<Estimate>& estimate) {
  object[name] = estimate ? number(estimate->value) : Json(nullptr);
  object[name + "_std"] = estimate ? number(estimate->std_dev) : Json(nullptr);
}

Json to_json(const Calibration& calibration) {
  Json object;
  object["format"] = "rangecal-calibration/1";
  object["method"] = to_string(calibration.method);
  object["kind"] = calibration.kind == RecordingKind::pairs ? "pairs" : "landmarks";
  object["outcome"] = to_string(calibration.outcome);
  object["reason"] = calibration.reason;
  object["order"] = calibration.order() < 0 ? Json(nullptr) : Json(calibration.order());
  object["curve"] = {{"family", to_string(calibration.scale.family)}};
  if (!calibration.scale.is_distance()) {
    object["curve"]["offset_m"] = number(calibration.scale.offset_m);
    object["curve"]["offset_std_m"] = number(calibration.scale.offset_std_m);
  }
  object["alpha"] = vector(calibration.alpha);
  object["covariance"] = matrix(calibration.alpha_covariance);
  object["covariance_with_choice"] = matrix(calibration.covariance_with_choice);
  object["bound_alpha_std"] =
      calibration.bound_alpha_std ? vector(*calibration.bound_alpha_std) : Json(nullptr);
  object["covariance_reason"] = calibration.covariance_reason;
  put_checks(object, calibration);
  object["noise"] = noise(calibration);
  object["outlier_count"] = calibration.outlier_count;
  object["outliers"] = Json::array();
  for (const OutlierReading& one : calibration.outliers)
    object["outliers"].push_back({{"recording", one.recording},
                                  {"row", one.row},
                                  {"channel", one.channel},
                                  {"sigmas", number(one.sigmas)},
                                  {"reason", one.reason}});
  put_estimate(object, "sigma_theta_rad", calibration.sigma_theta_rad);
  put_estimate(object, "sigma_s_m", calibration.sigma_s_m);
  object["sigma_s_upper95_m"] = number(calibration.sigma_s_upper95_m);
  object["range_m"] = is_empty(calibration)
                          ? Json::array({nullptr, nullptr})
                          : Json::array({number(calibration.range_min_m), number(calibration.range_max_m)});
  object["effects"] = Json::object();
  for (const auto& [effect, parameters] : calibration.effects) {
    object["effects"][effect] = Json::object();
    for (const auto& [name, value] : parameters) object["effects"][effect][name] = number(value);
  }
  object["effects_covariance"] = nullptr;
  if (const auto& known = calibration.effects_covariance)
    object["effects_covariance"] = {{"parameters", known->parameters},
                                    {"matrix", matrix(std::optional(known->matrix))}};
  object["effects_range"] = Json::object();
  for (const auto& [column, range] : calibration.effects_range)
    object["effects_range"][column] = {number(range.first), number(range.second)};
  object["labels"] = calibration.labels;
  object["landmarks"] = Json::array();
  for (const LandmarkEstimate& landmark : calibration.landmarks) {
    object["landmarks"].push_back({{"recording", landmark.recording},
                                   {"landmark", landmark.label},
                                   {"x_m", number(landmark.position_m.x())},
                                   {"y_m", number(landmark.position_m.y())},
                                   {"covariance", matrix(landmark.covariance)},
                                   {"covariance_by_stops", matrix(landmark.covariance_by_stops)}});
  }
  object["stops"] = Json::array();
  for (const StopEstimate& stop : calibration.stops) {
    object["stops"].push_back({{"recording", stop.recording},
                               {"stop", stop.label},
                               {"x_m", number(stop.pose.x_m)},
                               {"y_m", number(stop.pose.y_m)},
                               {"heading_rad", number(stop.pose.heading_rad)}});
  }
  const Counts& counts = calibration.counts;
  object["counts"] = {{"read", counts.read}, {"used", counts.used}};
  object["counts"]["dropped"] = Json::object();
  for (const auto& [reason, count] : counts.dropped) object["counts"]["dropped"][reason] = count;
  object["counts"]["cells_left_out"] = counts.cells_left_out;
  object["nll"] = number(calibration.marginal_nll);
  object["joint_nll"] = number(calibration.joint_nll);
  object["aic"] = number(calibration.aic);
  object["weakest_direction"] = calibration.weakest_direction;
  object["iterations"] = calibration.iterations;
  object["seconds"] = number(calibration.seconds);
  return object;
}

}  // namespace

std::string calibrations_to_json(const std::vector<Calibration>& calibrations,
                                 const std::vector<std::string>& notes) {
  Json top;
  if (calibrations.size() == 1) {
    top = to_json(calibrations.front());
  } else {
    top["format"] = "rangecal-calibration/1";
    top["methods"] = Json::array();
    for (const Calibration& calibration : calibrations) top["methods"].push_back(to_json(calibration));
  }
  if (!notes.empty()) top["notes"] = notes;
  // Labels may hold bytes that are no UTF-8 when they were made in memory: those are replaced, never thrown over.
  return top.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

void save_calibrations(const std::vector<Calibration>& calibrations, const std::string& path,
                       const std::vector<std::string>& notes) {
  write_file(path, calibrations_to_json(calibrations, notes));
}

}  // namespace rangecal
