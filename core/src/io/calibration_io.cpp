// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/calibration_io.hpp"

#include <cmath>
#include <limits>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/json_fields.hpp"

namespace rangecal {
namespace {

/// Of any model that may hold: a longer list is a broken file, and its square no matrix to make room for.
constexpr Eigen::Index most_coefficients = 100;

struct CalibrationFile {
  std::vector<Calibration> calibrations;
  std::vector<std::string> notes;
};

const char* to_string(RecordingKind kind) { return kind == RecordingKind::pairs ? "pairs" : "landmarks"; }

/// A number and, under `name`_std, its standard deviation.
void estimate_fields(JsonFields& json, const std::string& name, std::optional<Estimate>& estimate) {
  std::optional<double> value, std_dev;
  if (estimate) value = estimate->value, std_dev = estimate->std_dev;
  json.optional(name, value);
  json.optional(name + "_std", std_dev);
  estimate = value ? std::optional(Estimate{*value, std_dev}) : std::nullopt;
}

bool is_covariance(const Eigen::MatrixXd& C) {
  constexpr double rounding = 1e-6;
  if (C.size() == 0 || !C.allFinite() || !(C.diagonal().minCoeff() >= 0.0)) return false;
  const Eigen::VectorXd spread = C.diagonal().cwiseSqrt();
  for (Eigen::Index i = 0; i < C.rows(); ++i)
    for (Eigen::Index j = 0; j < i; ++j) {
      const double largest = spread[i] * spread[j];
      if (std::abs(C(i, j) - C(j, i)) > rounding * largest || std::abs(C(i, j)) > (1.0 + rounding) * largest)
        return false;
    }
  return true;
}

void check_effects_covariance(const JsonFields& json, const Calibration& c) {
  const EffectsCovariance& known = *c.effects_covariance;
  for (std::size_t i = 0; i < known.parameters.size(); ++i) {
    const std::string &name = known.parameters[i],
                      item = "effects_covariance.parameters[" + std::to_string(i) + "]";
    const std::size_t dot = name.rfind('.');
    const auto effect = c.effects.find(name.substr(0, dot));
    json.check(dot != std::string::npos && effect != c.effects.end() &&
                   effect->second.contains(name.substr(dot + 1)),
               item, "'" + name + "' is no EFFECT.PARAMETER of field 'effects'");
    const auto here = known.parameters.begin() + static_cast<std::ptrdiff_t>(i);
    json.check(std::find(known.parameters.begin(), here, name) == here, item,
               "'" + name + "' is named twice");
  }
  const auto size = c.alpha.size() + static_cast<Eigen::Index>(known.parameters.size());
  json.check(known.matrix.rows() == size, "effects_covariance.matrix",
             "is not " + std::to_string(size) + " rows");
  json.check(is_covariance(known.matrix), "effects_covariance.matrix",
             "is no covariance: finite, symmetric, no negative variance");
}

/// What is read has to fit together.
void check_whole(const JsonFields& json, const Calibration& c) {
  if (const auto& bound = c.bound_alpha_std) {
    json.check(bound->size() == c.alpha.size(), "bound_alpha_std",
               "is not " + std::to_string(c.alpha.size()) + " numbers");
    json.check(bound->allFinite() && (bound->array() >= 0.0).all(), "bound_alpha_std",
               "is not finite, or negative");
  }
  const Noise& noise = c.noise;
  json.check(noise.parameters.size() > 0, "noise.parameters", "holds no number");
  json.check(!has_sigma(noise.law) || noise.parameters.size() == 1, "noise.parameters",
             "one number belongs to this law");
  json.check(!c.scale.is_reciprocal() || c.range_min_m + c.scale.offset_m > 0.0, "curve.offset_m",
             "puts a pole of the curve into the range fitted");
  if (c.effects_covariance) check_effects_covariance(json, c);
  if (!is_usable(c.outcome)) return;
  const std::string yet = ", yet the outcome is usable";
  json.check(c.alpha.size() > 0, "alpha", "is empty" + yet);
  json.check(c.alpha.allFinite(), "alpha", "is not finite" + yet);
  json.check(noise.parameters.allFinite(), "noise", "is not finite" + yet);
  json.check(!has_sigma(noise.law) || noise.parameters[0] > 0.0, "noise", "is not positive" + yet);
}

}  // namespace

void fields(JsonFields& json, CurveScale& scale) {
  json.word("family", scale.family, curve_family_from_string);
  if (scale.is_reciprocal()) {
    json.required("offset_m", scale.offset_m);
    json.optional("offset_std_m", scale.offset_std_m);
  }
  if (scale.family != CurveFamily::spline) return;
  if (json.reading()) scale.spline.emplace();
  SplineScale& spline = *scale.spline;
  Eigen::VectorXd knots = spline.u.knots(), values = spline.u.values();
  json.numbers("knots_m", knots);
  json.numbers("values_m", values);
  json.square("covariance", spline.covariance, knots.size());
  json.required("degrees", spline.degrees);
  if (json.writing()) return;
  json.check(NaturalSpline::are_knots(knots), "knots_m", "are not three numbers or more, in ascending order");
  json.check(values.size() == knots.size(), "values_m", "has not one number for each knot");
  json.check(is_covariance(spline.covariance), "covariance",
             "is no covariance: finite, symmetric, no negative variance");
  json.check(spline.degrees >= 2.0 && std::isfinite(spline.degrees), "degrees", "is not 2 or more");
  spline.u = NaturalSpline(std::move(knots), std::move(values));
  json.check(spline.u.least_slope() > 0.0, "values_m", "are of a spline that does not rise everywhere");
}

static void fields(JsonFields& json, ShapeEstimate& shape) {
  json.required("family", shape.family);
  std::map<std::string, std::optional<double>> numbers;  // PARAMETER and PARAMETER_std
  for (const auto& [name, value] : shape.parameters) {
    const auto std_dev = shape.std_dev.find(name);
    numbers[name] = value;
    numbers[name + "_std"] = std_dev == shape.std_dev.end() ? std::nullopt : std::optional(std_dev->second);
  }
  json.others(numbers);
  for (const auto& [name, value] : numbers) {
    if (!name.ends_with("_std"))
      shape.parameters[name] = value.value_or(std::numeric_limits<double>::quiet_NaN());
    else if (value)
      shape.std_dev[name.substr(0, name.size() - 4)] = *value;
  }
}

static void fields(JsonFields& json, LeftOutCheck& check) {
  json.optional("groups", check.groups);
  json.optional("what", check.what);
  json.optional("rms_raw_m", check.rms_raw_m);
  json.optional("rms_raw_std_m", check.rms_raw_std_m);
  json.optional("rms_corrected_m", check.rms_corrected_m);
  json.optional("rms_corrected_std_m", check.rms_corrected_std_m);
  json.optional("halves_p_value", check.halves_p_value);
}

static void fields(JsonFields& json, MisfitOfDeviations& misfit) {
  json.optional("factor", misfit.factor);
  json.optional("threshold", misfit.threshold);
  json.optional("where", misfit.where);
  json.optional("clusters", misfit.clusters);
}

static void fields(JsonFields& json, OutlierReading& outlier) {
  json.optional("recording", outlier.recording);
  json.optional("row", outlier.row);
  json.optional("channel", outlier.channel);
  json.optional("sigmas", outlier.sigmas);
  json.optional("reason", outlier.reason);
}

static void fields(JsonFields& json, EffectsCovariance& known) {
  json.required("parameters", known.parameters);
  json.square("matrix", known.matrix, 0,
              most_coefficients + static_cast<Eigen::Index>(known.parameters.size()));
}

static void fields(JsonFields& json, LandmarkEstimate& landmark) {
  json.optional("recording", landmark.recording);
  json.required("landmark", landmark.label);
  json.optional("x_m", landmark.position_m.x());
  json.optional("y_m", landmark.position_m.y());
  json.square("covariance", landmark.covariance, 2);
  json.square("covariance_by_stops", landmark.covariance_by_stops, 2);
}

static void fields(JsonFields& json, StopEstimate& stop) {
  json.optional("recording", stop.recording);
  json.required("stop", stop.label);
  json.optional("x_m", stop.pose.x_m);
  json.optional("y_m", stop.pose.y_m);
  json.optional("heading_rad", stop.pose.heading_rad);
}

static void fields(JsonFields& json, Counts& counts) {
  json.optional("read", counts.read);
  json.optional("used", counts.used);
  json.optional("dropped", counts.dropped);
  json.optional("cells_left_out", counts.cells_left_out);
}

/// The standard deviations stand beside the parameters.
static void noise_fields(JsonFields& json, Calibration& c) {
  json.word("law", c.noise.law, noise_law_from_string);
  json.required("parameters", c.noise.parameters);
  std::vector<std::optional<double>> deviations;
  for (const Estimate& estimate : c.noise_estimates) deviations.push_back(estimate.std_dev);
  json.optional("std", deviations);
  json.if_any("shapes", c.noise_shapes);
  if (json.writing()) return;
  for (std::size_t i = 0; i < deviations.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    json.check(at < c.noise.parameters.size(), "std[" + std::to_string(i) + "]", "has no parameter");
    c.noise_estimates.push_back({c.noise.parameters[at], deviations[i]});
  }
}

/// Files written before these checks have none of it.
static void check_fields(JsonFields& json, Calibration& c) {
  std::optional<bool> usable;  // null where that was not judged
  std::string reason;
  if (c.left_out) usable = c.left_out->usable, reason = c.left_out->reason;
  json.optional("usable", usable);
  json.optional("usable_reason", reason);
  json.optional("left_out", c.left_out);
  if (c.left_out) {
    json.check(usable.has_value(), "usable", "is neither true nor false");
    c.left_out->usable = *usable;
    c.left_out->reason = reason;
  }
  json.square("covariance_by_stops", c.alpha_covariance_by_stops, c.alpha.size());
  json.square("covariance_by_landmarks", c.alpha_covariance_by_landmarks, c.alpha.size());
  json.optional("misfit", c.misfit);
}

static void fields(JsonFields& json, Calibration& c) {
  json.format({"rangecal-calibration/1"});
  json.word("method", c.method, method_from_string);
  std::string kind = to_string(c.kind);
  json.optional("kind", kind);
  json.check(kind == "landmarks" || kind == "pairs", "kind", "is neither landmarks nor pairs");
  c.kind = kind == "pairs" ? RecordingKind::pairs : RecordingKind::landmarks;
  json.word("outcome", c.outcome, outcome_from_string);
  json.optional("reason", c.reason);

  std::optional<int> order;
  if (c.order() >= 0) order = c.order();
  json.optional("order", order);
  json.optional("curve", c.scale);
  json.required("alpha", c.alpha);
  json.check(!order || *order == c.order(), "order", "is not the number of alpha less one");
  json.square("covariance", c.alpha_covariance, c.alpha.size());
  json.square("covariance_with_choice", c.covariance_with_choice, c.alpha.size(), most_coefficients);
  json.optional("bound_alpha_std", c.bound_alpha_std);
  json.optional("covariance_reason", c.covariance_reason);
  check_fields(json, c);

  // Without a curve there is no noise about it, and no range over which it was fitted.
  Eigen::Vector2d range(c.range_min_m, c.range_max_m);
  if (json.writing() && c.alpha.size() == 0) {
    c.noise.parameters = Eigen::VectorXd::Constant(1, std::numeric_limits<double>::quiet_NaN());
    range.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  json.object("noise", [&](JsonFields& noise) { noise_fields(noise, c); });
  json.optional("outlier_count", c.outlier_count);
  json.optional("outliers", c.outliers);
  estimate_fields(json, "sigma_theta_rad", c.sigma_theta_rad);
  estimate_fields(json, "sigma_s_m", c.sigma_s_m);
  json.optional("sigma_s_upper95_m", c.sigma_s_upper95_m);
  json.optional("range_m", range);
  c.range_min_m = range[0];
  c.range_max_m = range[1];

  json.optional("effects", c.effects);
  json.optional("effects_covariance", c.effects_covariance);
  std::map<std::string, Eigen::VectorXd> ranges;
  for (const auto& [column, limits] : c.effects_range)
    ranges[column] = Eigen::Vector2d(limits.first, limits.second);
  json.optional("effects_range", ranges);
  for (const auto& [column, limits] : ranges) {
    json.check(limits.size() == 2 && limits.allFinite(), "effects_range." + column,
               "is not two finite numbers, [from, to]");
    c.effects_range[column] = {limits[0], limits[1]};
  }
  json.optional("labels", c.labels);
  json.optional("landmarks", c.landmarks);
  json.optional("stops", c.stops);
  json.optional("counts", c.counts);
  json.optional("nll", c.marginal_nll);
  json.optional("joint_nll", c.joint_nll);
  json.optional("aic", c.aic);
  json.optional("weakest_direction", c.weakest_direction);
  json.optional("iterations", c.iterations);
  json.optional("seconds", c.seconds);
  if (!std::isfinite(c.seconds)) c.seconds = 0.0;
  if (json.reading()) check_whole(json, c);
}

/// One calibration, or `methods`; notes beside them.
static void fields(JsonFields& json, CalibrationFile& file) {
  if (json.reading() && !json.has("methods")) file.calibrations.resize(1);
  if (file.calibrations.size() == 1) {
    fields(json, file.calibrations.front());
  } else {
    json.format({"rangecal-calibration/1"});
    json.required("methods", file.calibrations);
    json.check(!file.calibrations.empty(), "methods", "holds no calibration");
  }
  json.if_any("notes", file.notes);
}

std::string calibrations_to_json(const std::vector<Calibration>& calibrations,
                                 const std::vector<std::string>& notes) {
  // Labels may hold bytes that are no UTF-8 when they were made in memory: those are replaced, never thrown over.
  return json_of(CalibrationFile{calibrations, notes})
             .dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) +
         "\n";
}

void save_calibrations(const std::vector<Calibration>& calibrations, const std::string& path,
                       const std::vector<std::string>& notes) {
  write_file(path, calibrations_to_json(calibrations, notes));
}

std::vector<Calibration> load_calibrations(const std::string& path) {
  CalibrationFile file;
  read_json(read_file(path, std::size_t{256} << 20), path, file);
  return file.calibrations;
}

Calibration load_calibration(const std::string& path) {
  const std::vector<Calibration> calibrations = load_calibrations(path);
  if (calibrations.size() == 1) return calibrations.front();
  const std::span<const Method> methods = all_methods();
  for (auto method = methods.rbegin(); method != methods.rend(); ++method) {
    for (const Calibration& calibration : calibrations) {
      if (calibration.method == *method && is_usable(calibration.outcome)) return calibration;
    }
  }
  throw InputError(path, 0, "", "field 'methods': none of the calibrations is usable");
}

}  // namespace rangecal
