// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/json_numbers.hpp"

namespace rangecal {
namespace {

using Tree = nlohmann::json;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// A value of the file together with where it stands. A missing key and null are the same.
class Field {
 public:
  Field(const Tree& value, const std::string& file, std::string name)
      : value_(value), file_(file), name_(std::move(name)) {}

  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(file_, 0, "", name_.empty() ? what : "field '" + name_ + "': " + what);
  }
  bool is_null() const { return value_.is_null(); }

  Field at(const std::string& key) const {
    static const Tree null;
    if (!value_.is_object()) fail("is not an object");
    const auto found = value_.find(key);
    return Field(found == value_.end() ? null : *found, file_, name_.empty() ? key : name_ + "." + key);
  }
  Field required(const std::string& key) const {
    Field field = at(key);
    if (field.is_null()) field.fail("is missing");
    return field;
  }
  std::vector<Field> items() const {
    if (is_null()) return {};
    if (!value_.is_array()) fail("is not a list");
    std::vector<Field> items;
    for (const Tree& item : value_)
      items.emplace_back(item, file_, name_ + "[" + std::to_string(items.size()) + "]");
    return items;
  }
  std::vector<std::pair<std::string, Field>> members() const {
    if (is_null()) return {};
    if (!value_.is_object()) fail("is not an object");
    std::vector<std::pair<std::string, Field>> members;
    for (const auto& [key, value] : value_.items())
      members.emplace_back(key, Field(value, file_, name_ + "." + key));
    return members;
  }

  std::string text() const {
    if (is_null()) return "";
    if (!value_.is_string()) fail("is not a text");
    return value_.get<std::string>();
  }
  bool flag() const {
    if (!value_.is_boolean()) fail("is neither true nor false");
    return value_.get<bool>();
  }
  std::optional<double> maybe_number() const {
    if (is_null()) return std::nullopt;
    if (!value_.is_number()) fail("is not a number");
    return value_.get<double>();
  }
  double number() const { return maybe_number().value_or(kNaN); }
  int whole() const {
    const double value = maybe_number().value_or(0.0);
    if (value != std::floor(value) || std::abs(value) > std::numeric_limits<int>::max())
      fail("is not a whole number");
    return static_cast<int>(value);
  }
  Eigen::VectorXd vector() const {
    const std::vector<Field> list = items();
    Eigen::VectorXd values(static_cast<Eigen::Index>(list.size()));
    for (std::size_t i = 0; i < list.size(); ++i) values[static_cast<Eigen::Index>(i)] = list[i].number();
    return values;
  }
  std::optional<Eigen::MatrixXd> matrix(Eigen::Index size) const {
    if (is_null()) return std::nullopt;
    const std::vector<Field> rows = items();
    if (static_cast<Eigen::Index>(rows.size()) != size) fail("is not " + std::to_string(size) + " rows");
    Eigen::MatrixXd values(size, size);
    for (Eigen::Index i = 0; i < size; ++i) {
      const Field& row = rows[static_cast<std::size_t>(i)];
      const Eigen::VectorXd numbers = row.vector();
      if (numbers.size() != size) row.fail("is not " + std::to_string(size) + " numbers");
      values.row(i) = numbers.transpose();
    }
    return values;
  }

 private:
  const Tree& value_;
  const std::string& file_;
  std::string name_;
};

// The inverse of to_string of an enumeration, with file and field in its error.
template <typename Parse>
auto parsed(const Field& field, Parse parse) {
  try {
    return parse(field.text());
  } catch (const InputError& error) {
    field.fail(error.what());
  }
}

std::optional<Estimate> estimate(const Field& top, const std::string& name) {
  const auto value = top.at(name).maybe_number();
  if (!value) return std::nullopt;
  return Estimate{*value, top.at(name + "_std").maybe_number()};
}

void read_noise(const Field& field, Calibration& calibration) {
  calibration.noise.law = parsed(field.required("law"), noise_law_from_string);
  const Field parameters = field.required("parameters");
  calibration.noise.parameters = parameters.vector();
  if (calibration.noise.parameters.size() == 0) parameters.fail("holds no number");
  if (calibration.noise.law != NoiseLaw::polynomial && calibration.noise.parameters.size() != 1) {
    parameters.fail("one number belongs to this law");
  }
  const std::vector<Field> deviations = field.at("std").items();
  for (std::size_t i = 0; i < deviations.size(); ++i) {
    if (static_cast<Eigen::Index>(i) >= calibration.noise.parameters.size())
      deviations[i].fail("has no parameter");
    calibration.noise_estimates.push_back(
        {calibration.noise.parameters[static_cast<Eigen::Index>(i)], deviations[i].maybe_number()});
  }
  for (const auto& [channel, shape] : field.at("shapes").members()) {
    ShapeEstimate& estimate = calibration.noise_shapes[channel];
    estimate.family = shape.required("family").text();
    for (const auto& [name, value] : shape.members()) {
      if (name == "family") continue;
      if (name.ends_with("_std")) {
        if (const auto std_dev = value.maybe_number())
          estimate.std_dev[name.substr(0, name.size() - 4)] = *std_dev;
      } else {
        estimate.parameters[name] = value.number();
      }
    }
  }
}

bool is_covariance(const Eigen::MatrixXd& C) {
  constexpr double rounding = 1e-6;
  if (!C.allFinite() || !(C.diagonal().minCoeff() >= 0.0)) return false;
  const Eigen::VectorXd spread = C.diagonal().cwiseSqrt();
  for (Eigen::Index i = 0; i < C.rows(); ++i)
    for (Eigen::Index j = 0; j < i; ++j) {
      const double largest = spread[i] * spread[j];
      if (std::abs(C(i, j) - C(j, i)) > rounding * largest || std::abs(C(i, j)) > (1.0 + rounding) * largest)
        return false;
    }
  return true;
}

void read_calibrated_effects(const Field& top, Calibration& calibration) {
  for (const auto& [effect, parameters] : top.at("effects").members()) {
    calibration.effects[effect];
    for (const auto& [name, value] : parameters.members()) {
      calibration.effects[effect][name] = value.number();
      if (!std::isfinite(calibration.effects[effect][name])) value.fail("is not finite");
    }
  }
  for (const auto& [column, limits] : top.at("effects_range").members()) {
    const Eigen::VectorXd range = limits.vector();
    if (range.size() != 2 || !range.allFinite()) limits.fail("is not two finite numbers, [from, to]");
    calibration.effects_range[column] = {range[0], range[1]};
  }
  for (const Field& label : top.at("labels").items()) calibration.labels.push_back(label.text());
  const Field known = top.at("effects_covariance");
  if (known.is_null()) return;
  EffectsCovariance covariance;
  for (const Field& item : known.required("parameters").items()) {
    const std::string name = item.text();
    const std::size_t dot = name.rfind('.');
    const auto effect = calibration.effects.find(name.substr(0, dot));
    if (dot == std::string::npos || effect == calibration.effects.end() ||
        !effect->second.contains(name.substr(dot + 1)))
      item.fail("'" + name + "' is no EFFECT.PARAMETER of field 'effects'");
    if (std::find(covariance.parameters.begin(), covariance.parameters.end(), name) !=
        covariance.parameters.end())
      item.fail("'" + name + "' is named twice");
    covariance.parameters.push_back(name);
  }
  const Field values = known.required("matrix");
  covariance.matrix =
      *values.matrix(calibration.alpha.size() + static_cast<Eigen::Index>(covariance.parameters.size()));
  if (!is_covariance(covariance.matrix))
    values.fail("is no covariance: finite, symmetric, no negative variance");
  calibration.effects_covariance = std::move(covariance);
}

void read_places(const Field& top, Calibration& calibration) {
  for (const Field& item : top.at("landmarks").items()) {
    LandmarkEstimate landmark{item.at("recording").whole(),
                              item.required("landmark").text(),
                              {item.at("x_m").number(), item.at("y_m").number()},
                              std::nullopt,
                              std::nullopt};
    if (const auto covariance = item.at("covariance").matrix(2))
      landmark.covariance = Eigen::Matrix2d(*covariance);
    if (const auto covariance = item.at("covariance_by_stops").matrix(2))
      landmark.covariance_by_stops = Eigen::Matrix2d(*covariance);
    calibration.landmarks.push_back(std::move(landmark));
  }
  for (const Field& item : top.at("stops").items()) {
    calibration.stops.push_back(
        {item.at("recording").whole(),
         item.required("stop").text(),
         {item.at("x_m").number(), item.at("y_m").number(), item.at("heading_rad").number()}});
  }
}

/// Files written before these checks have none of it.
void read_checks(const Field& top, Calibration& calibration) {
  calibration.alpha_covariance_by_stops = top.at("covariance_by_stops").matrix(calibration.alpha.size());
  if (const Field misfit = top.at("misfit"); !misfit.is_null())
    calibration.misfit = MisfitOfDeviations{misfit.at("factor").number(), misfit.at("threshold").number(),
                                            misfit.at("where").text()};
  calibration.outlier_count = top.at("outlier_count").whole();
  for (const Field& item : top.at("outliers").items())
    calibration.outliers.push_back({item.at("recording").whole(), item.at("row").whole(),
                                    item.at("channel").text(), item.at("sigmas").number(),
                                    item.at("reason").text()});
  const Field left_out = top.at("left_out");
  if (left_out.is_null()) return;
  LeftOutCheck check;
  check.groups = left_out.at("groups").whole();
  check.rms_raw_m = left_out.at("rms_raw_m").number();
  check.rms_raw_std_m = left_out.at("rms_raw_std_m").number();
  check.rms_corrected_m = left_out.at("rms_corrected_m").number();
  check.rms_corrected_std_m = left_out.at("rms_corrected_std_m").number();
  check.halves_p_value = left_out.at("halves_p_value").maybe_number();
  check.usable = top.at("usable").flag();
  check.reason = top.at("usable_reason").text();
  calibration.left_out = std::move(check);
}

void read_counts(const Field& field, Counts& counts) {
  if (field.is_null()) return;
  counts.read = field.at("read").whole();
  counts.used = field.at("used").whole();
  counts.cells_left_out = field.at("cells_left_out").whole();
  for (const auto& [reason, count] : field.at("dropped").members()) counts.dropped[reason] = count.whole();
}

void check_format(const Field& top) {
  const Field format = top.required("format");
  if (format.text() != "rangecal-calibration/1") format.fail("is not rangecal-calibration/1");
}

/// Of any model that may hold: a longer list is a broken file, and its square no matrix to make room for.
constexpr Eigen::Index most_coefficients = 100;

/// The scale of f; a file without one is of a polynomial.
CurveScale read_scale(const Field& curve, double range_min_m) {
  CurveScale scale;
  if (curve.is_null()) return scale;
  scale.family = parsed(curve.required("family"), curve_family_from_string);
  if (scale.is_distance()) return scale;
  const Field offset = curve.required("offset_m");
  scale.offset_m = offset.number();
  if (!(range_min_m + scale.offset_m > 0.0)) offset.fail("puts a pole of the curve into the range fitted");
  scale.offset_std_m = curve.at("offset_std_m").maybe_number();
  return scale;
}

Calibration read_calibration(const Field& top) {
  check_format(top);
  Calibration calibration;
  calibration.method = parsed(top.required("method"), method_from_string);
  const Field kind = top.at("kind");
  if (kind.text() == "pairs") {
    calibration.kind = RecordingKind::pairs;
  } else if (!kind.is_null() && kind.text() != "landmarks") {
    kind.fail("is neither landmarks nor pairs");
  }
  calibration.outcome = parsed(top.required("outcome"), outcome_from_string);
  calibration.reason = top.at("reason").text();

  const Field alpha = top.required("alpha");
  calibration.alpha = alpha.vector();
  const Field order = top.at("order");
  if (!order.is_null() && order.whole() != calibration.order())
    order.fail("is not the number of alpha less one");
  calibration.alpha_covariance = top.at("covariance").matrix(calibration.alpha.size());
  const Field with_choice = top.at("covariance_with_choice");
  if (const auto rows = static_cast<Eigen::Index>(with_choice.items().size()); rows > 0) {
    if (rows < calibration.alpha.size() || rows > most_coefficients)
      with_choice.fail("has " + std::to_string(rows) + " rows, not " +
                       std::to_string(calibration.alpha.size()) + " to " + std::to_string(most_coefficients));
    calibration.covariance_with_choice = with_choice.matrix(rows);
  }
  if (const Field bound = top.at("bound_alpha_std"); !bound.is_null()) {
    calibration.bound_alpha_std = bound.vector();
    if (calibration.bound_alpha_std->size() != calibration.alpha.size())
      bound.fail("is not " + std::to_string(calibration.alpha.size()) + " numbers");
    if (!calibration.bound_alpha_std->allFinite() || (calibration.bound_alpha_std->array() < 0.0).any())
      bound.fail("is not finite, or negative");
  }
  calibration.covariance_reason = top.at("covariance_reason").text();
  read_checks(top, calibration);
  const Field noise = top.required("noise");
  read_noise(noise, calibration);
  if (is_usable(calibration.outcome)) {
    if (calibration.alpha.size() == 0) alpha.fail("is empty, yet the outcome is usable");
    if (!calibration.alpha.allFinite()) alpha.fail("is not finite, yet the outcome is usable");
    if (!calibration.noise.parameters.allFinite()) noise.fail("is not finite, yet the outcome is usable");
    if (calibration.noise.law != NoiseLaw::polynomial && !(calibration.noise.parameters[0] > 0.0))
      noise.fail("is not positive, yet the outcome is usable");
  }
  calibration.sigma_theta_rad = estimate(top, "sigma_theta_rad");
  calibration.sigma_s_m = estimate(top, "sigma_s_m");
  calibration.sigma_s_upper95_m = top.at("sigma_s_upper95_m").maybe_number();
  const Field range = top.at("range_m");
  if (!range.is_null()) {
    const Eigen::VectorXd limits = range.vector();
    if (limits.size() != 2) range.fail("is not [min, max]");
    calibration.range_min_m = limits[0];
    calibration.range_max_m = limits[1];
  }
  calibration.scale = read_scale(top.at("curve"), calibration.range_min_m);
  read_calibrated_effects(top, calibration);
  read_places(top, calibration);
  read_counts(top.at("counts"), calibration.counts);
  calibration.marginal_nll = top.at("nll").maybe_number();
  calibration.joint_nll = top.at("joint_nll").maybe_number();
  calibration.aic = top.at("aic").maybe_number();
  calibration.weakest_direction = top.at("weakest_direction").text();
  calibration.iterations = top.at("iterations").whole();
  calibration.seconds = top.at("seconds").maybe_number().value_or(0.0);
  return calibration;
}

}  // namespace

std::vector<Calibration> load_calibrations(const std::string& path) {
  const std::string text = read_file(path, std::size_t{256} << 20);
  Tree json;
  try {
    json = Tree::parse(text);
  } catch (const Tree::exception& error) {
    throw InputError(path, 0, "", "is not JSON: " + json_complaint(error));
  }
  const Field top(json, path, "");
  check_format(top);
  const Field methods = top.at("methods");
  std::vector<Calibration> calibrations;
  if (methods.is_null()) {
    calibrations.push_back(read_calibration(top));
  } else {
    for (const Field& item : methods.items()) calibrations.push_back(read_calibration(item));
    if (calibrations.empty()) methods.fail("holds no calibration");
  }
  return calibrations;
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
