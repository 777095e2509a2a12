// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "change/landmark_watch.hpp"
#include "json_matrices.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/json_numbers.hpp"

namespace rangecal {
namespace {

using Json = nlohmann::ordered_json;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

std::int64_t count_in(const Json& json, const char* field) {
  return whole_number<std::int64_t>(json.at(field), field);
}

/// The plain numbers of an onset.
std::vector<double*> numbers_of(LandmarkWatch::Onset& onset) {
  std::vector<double*> all{&onset.weight,   &onset.cross,        &onset.log_up,
                           &onset.log_down, &onset.spread_score, &onset.spread_information};
  for (double& value : onset.score) all.push_back(&value);
  for (double& value : onset.information) all.push_back(&value);
  return all;
}

Json json_of(LandmarkWatch::Onset onset) {
  Json json{{"since", onset.since},
            {"until", onset.until},
            {"numbers", Json::array()},
            {"beta", lists(onset.beta)}};
  for (const double* value : numbers_of(onset)) json["numbers"].push_back(*value);
  return json;
}

LandmarkWatch::Onset onset_in(const Json& json, Index size) {
  LandmarkWatch::Onset onset;
  onset.since = count_in(json, "since");
  onset.until = count_in(json, "until");
  const std::vector<double*> numbers = numbers_of(onset);
  const VectorXd values = vector_in(json.at("numbers"), static_cast<Index>(numbers.size()), "numbers");
  for (std::size_t i = 0; i < numbers.size(); ++i) *numbers[i] = values[static_cast<Index>(i)];
  for (std::size_t k = 0; k < onset.beta.size(); ++k)
    onset.beta[k] = vector_in(json.at("beta").at(k), size, "beta");
  const auto negative = [](double information) { return information < 0.0; };
  if (!(onset.weight > 0.0) || onset.spread_information < 0.0 ||
      std::any_of(onset.information.begin(), onset.information.end(), negative))
    throw InputError("field 'onsets' holds what no readings make");
  return onset;
}

/// Throws InputError where P is no covariance: not symmetric, or negative in a direction, by more than the rounding of
/// many updates, a millionth of the standard deviations.
MatrixXd covariance_in(const Json& json, Index size) {
  constexpr double rounding = 1e-6;
  const MatrixXd P = square_in(json, size, "P");
  const VectorXd sigma = P.diagonal().cwiseMax(0.0).cwiseSqrt();
  const MatrixXd limit = sigma * sigma.transpose();
  const VectorXd scale = sigma.unaryExpr([](double s) { return s > 0.0 ? 1.0 / s : 0.0; });
  const MatrixXd correlation = scale.asDiagonal() * P * scale.asDiagonal();
  const bool symmetric = ((P - P.transpose()).array().abs() <= rounding * limit.array()).all(),
             bounded = (P.array().abs() <= (1.0 + rounding) * limit.array()).all(),
             positive =
                 Eigen::LLT<MatrixXd>(correlation + rounding * MatrixXd::Identity(size, size)).info() ==
                 Eigen::Success;
  if (!symmetric || !bounded || !positive)
    throw InputError(std::string("field 'P' is no covariance: it is not ") +
                     (symmetric ? "positive" : "symmetric"));
  return P;
}

}  // namespace

std::string json_of(const LandmarkWatch& watch) {
  const LandmarkFilter& filter = watch.filter;
  Json json{{"readings", watch.readings},
            {"tested", watch.tested},
            {"opened_at", watch.opened_at},
            {"stops", watch.stops},
            {"naming_left", watch.naming_left},
            {"open", {watch.open.reading, watch.open.since}},
            {"stop", watch.label},
            {"place", watch.place},
            {"commanded", {filter.commanded.x_m, filter.commanded.y_m, filter.commanded.heading_rad}},
            {"landmarks", filter.labels},
            {"radius_m", filter.radius_m},
            {"x", list(filter.x)},
            {"P", list(filter.P)},
            {"onsets", Json::array()}};
  for (const LandmarkWatch::Onset& onset : watch.onsets) json["onsets"].push_back(json_of(onset));
  return json.dump();
}

void restore_watch(const std::string& text, LandmarkWatch& watch) {
  try {
    const Json json = Json::parse(text);
    LandmarkWatch restored = watch;
    LandmarkFilter& filter = restored.filter;
    restored.readings = count_in(json, "readings");
    restored.tested = count_in(json, "tested");
    restored.opened_at = count_in(json, "opened_at");
    if (restored.opened_at > restored.tested) throw InputError("field 'opened_at' is beyond 'tested'");
    restored.stops = count_in(json, "stops");
    restored.naming_left =
        whole_number<std::int64_t>(json.at("naming_left"), "naming_left", 0, restored.options.naming);
    restored.open = {};
    restored.open.reading = whole_number<std::int64_t>(json.at("open").at(0), "open");
    restored.open.since = whole_number<std::int64_t>(json.at("open").at(1), "open");
    restored.label = json.at("stop");
    restored.place = json.at("place");
    filter.labels = json.at("landmarks").get<std::vector<std::string>>();
    const auto landmarks = static_cast<Index>(filter.labels.size()), size = filter.pose() + 3 + 2 * landmarks;
    const VectorXd radii = vector_in(json.at("radius_m"), landmarks, "radius_m");
    filter.radius_m.assign(radii.begin(), radii.end());
    const VectorXd pose = vector_in(json.at("commanded"), 3, "commanded");
    filter.commanded = {pose[0], pose[1], pose[2]};
    filter.x = vector_in(json.at("x"), size, "x");
    filter.P = covariance_in(json.at("P"), size);
    restored.onsets.clear();
    for (const Json& onset : json.at("onsets")) restored.onsets.push_back(onset_in(onset, size));
    if (restored.naming_left > 0 && restored.onsets.empty())
      throw InputError("field 'onsets' is not that of an open alarm");
    watch = std::move(restored);
  } catch (const Json::exception& error) {
    throw InputError("is no state of a watch: " + json_complaint(error));
  }
}

}  // namespace rangecal
