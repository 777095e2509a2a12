// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "change/landmark_watch.hpp"
#include "json_states.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

/// Refuses what is no covariance: not symmetric, or negative in a direction, by more than the rounding of many updates, a
/// millionth of the standard deviations.
void check_covariance(const JsonFields& json, const Eigen::MatrixXd& P) {
  using Eigen::MatrixXd;
  constexpr double rounding = 1e-6;
  const Eigen::VectorXd sigma = P.diagonal().cwiseMax(0.0).cwiseSqrt();
  const MatrixXd limit = sigma * sigma.transpose();
  const Eigen::VectorXd scale = sigma.unaryExpr([](double s) { return s > 0.0 ? 1.0 / s : 0.0; });
  const MatrixXd correlation = scale.asDiagonal() * P * scale.asDiagonal();
  const bool symmetric = ((P - P.transpose()).array().abs() <= rounding * limit.array()).all(),
             bounded = (P.array().abs() <= (1.0 + rounding) * limit.array()).all(),
             positive = Eigen::LLT<MatrixXd>(correlation + rounding * MatrixXd::Identity(P.rows(), P.rows()))
                            .info() == Eigen::Success;
  json.check(symmetric, "P", "is no covariance: it is not symmetric");
  json.check(bounded && positive, "P", "is no covariance: it is not positive");
}

}  // namespace

static void fields(JsonFields& json, LandmarkWatch::Onset& onset) {
  json.whole("since", onset.since);
  json.whole("until", onset.until);
  auto& U = onset.score;
  auto& I = onset.information;
  json.required("numbers", std::tie(onset.weight, onset.cross, onset.log_up, onset.log_down,
                                    onset.spread_score, onset.spread_information, U[0], U[1], U[2], U[3],
                                    U[4], I[0], I[1], I[2], I[3], I[4]));
  json.required("beta", onset.beta);
  const auto negative = [](double information) { return information < 0.0; };
  json.check(
      onset.weight > 0.0 && onset.spread_information >= 0.0 && std::none_of(I.begin(), I.end(), negative),
      "holds what no readings make");
}

static void fields(JsonFields& json, LandmarkWatch& watch) {
  LandmarkFilter& filter = watch.filter;
  json.whole("readings", watch.readings);
  json.whole("tested", watch.tested);
  json.whole("opened_at", watch.opened_at);
  json.check(watch.opened_at <= watch.tested, "opened_at", "is beyond 'tested'");
  json.whole("stops", watch.stops);
  json.whole("naming_left", watch.naming_left, 0, watch.options.naming);
  if (json.reading()) watch.open = {};
  json.required("open", std::tie(watch.open.reading, watch.open.since));
  json.check(watch.open.reading >= 0 && watch.open.since >= 0, "open", "is negative");
  json.required("stop", watch.label);
  json.required("place", watch.place);
  pose_field(json, "commanded", filter.commanded);
  json.required("landmarks", filter.labels);
  json.required("radius_m", filter.radius_m);
  json.check(filter.radius_m.size() == filter.labels.size(), "radius_m", "is not one for each landmark");
  const Eigen::Index size = filter.pose() + 3 + 2 * static_cast<Eigen::Index>(filter.labels.size());
  json.numbers("x", filter.x, size);
  json.numbers("P", filter.P, size, size);
  if (json.reading()) check_covariance(json, filter.P);
  json.required("onsets", watch.onsets);
  for (std::size_t i = 0; i < watch.onsets.size(); ++i)
    for (const Eigen::VectorXd& beta : watch.onsets[i].beta)
      json.check(beta.size() == size && beta.allFinite(), "onsets[" + std::to_string(i) + "].beta",
                 "is not " + std::to_string(size) + " finite numbers each");
  json.check(watch.naming_left == 0 || !watch.onsets.empty(), "onsets", "is not that of an open alarm");
}

std::string state_of(const LandmarkWatch& watch) { return json_of(watch).dump(); }

void restore_watch(const std::string& text, LandmarkWatch& watch) {
  LandmarkWatch restored = watch;
  restored.onsets.clear();
  read_json(parsed_json(text), restored);
  watch = std::move(restored);
}

}  // namespace rangecal
