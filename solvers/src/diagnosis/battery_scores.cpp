// SPDX-License-Identifier: BSD-3-Clause
// The answer to one question: score statistic, size and gain of shapes of the means or the variances.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "diagnosis/battery.hpp"
#include "diagnosis/skewed_score.hpp"

namespace rangecal::diagnosis {

Battery::Asked Battery::asked_of_mean(Question about, std::vector<Signature> block) const {
  Asked asked;
  Question& question = asked.question = std::move(about);
  question.of = Question::Of::mean;
  question.dof = 0;
  question.statistic = 0.0;
  double size_sq = 0.0;
  std::vector<Signature> kept;
  std::vector<Eigen::VectorXd> kept_projected;
  const int n = projector_.cells();
  Signature fitted;  // what a fit takes from the residuals
  fitted.range = fitted.bearing = Eigen::VectorXd::Zero(n);
  for (Signature& x : block) {
    const double least = projector_.least_information(x);
    for (std::size_t a = 0; a < active_.size(); ++a)
      x.take_out(projector_.inner(x, active_projected_[a], active_[a]), active_[a]);
    for (std::size_t a = 0; a < kept.size(); ++a)
      x.take_out(projector_.inner(x, kept_projected[a], kept[a]), kept[a]);
    Eigen::VectorXd projected = projector_.project(x);
    const double information = projector_.inner(x, projected, x);
    if (!(information > least)) continue;  // the calibration absorbs it
    x.see_whether_it_turns(information);
    const double scale = 1.0 / std::sqrt(information);
    projected *= scale;
    x.scale(scale);
    const double score = projector_.score(x);
    question.statistic += score * score;
    // The size is what the calibration leaves of the shape, not its coefficient.
    const Eigen::VectorXd range = projector_.unweighted(projected.head(n));
    const Eigen::VectorXd bearing =
        projected.tail(n).cwiseQuotient(projector_.bearing_information.cwiseMax(1e-300));
    const bool of_bearing = question.channel == "bearing";
    double squares = 0.0;  // over the readings
    for (int c = 0; c < n; ++c)
      squares +=
          (rows_.cell_begin[c + 1] - rows_.cell_begin[c]) * std::pow((of_bearing ? bearing : range)[c], 2);
    if (x.within()) squares += (of_bearing ? x.bearing_rows : x.range_rows).squaredNorm();
    size_sq += score * score * squares / static_cast<double>(rows_.size());
    fitted.range += score * range;
    fitted.bearing += score * bearing;
    if (x.within()) {
      if (!fitted.within())
        fitted.range_rows = fitted.bearing_rows = Eigen::VectorXd::Zero(x.range_rows.size());
      fitted.range_rows += score * x.range_rows;
      fitted.bearing_rows += score * x.bearing_rows;
    }
    ++question.dof;
    kept.push_back(x);
    kept_projected.push_back(projected);
    asked.mean_projected.push_back(rows_.pairs ? projected.head(n).eval() : projected);
    Signature within;
    if (x.within()) {
      within.range_rows = x.range_rows.cwiseProduct(projector_.row_range_information);
      within.bearing_rows = x.bearing_rows.cwiseProduct(projector_.row_bearing_information);
    }
    asked.mean_within.push_back(std::move(within));
  }
  if (question.dof == 0) return asked;
  question.size = std::sqrt(size_sq);
  question.gain = fitted_gain(question, fitted);
  question.log_p = log_chi_sq_survival(question.statistic, question.dof);
  return asked;
}

/// A score takes the mismatch for noise, a fit lets the spread fall: where the best of a shape lowers the
/// chi-square of a channel's n readings by D, the fit gains -(n/2) ln(1 - D/n) there. What is not the
/// readings' own is the stops' prior.
double Battery::fitted_gain(const Question& question, const Signature& fitted) const {
  const double n = static_cast<double>(rows_.size());
  const auto fall = [](const Eigen::VectorXd& information, const Eigen::VectorXd& residual,
                       const Eigen::VectorXd& change) {
    return information.size() == 0 || change.size() == 0
               ? 0.0
               : (information.array() * change.array() * (2.0 * residual.array() - change.array())).sum();
  };
  const double range =
      projector_.weighted(fitted.range).dot(2.0 * projector_.range_residual - fitted.range) +
      fall(projector_.row_range_information, projector_.row_range_residual, fitted.range_rows);
  const double bearing =
      fall(projector_.bearing_information, projector_.bearing_residual, fitted.bearing) +
      fall(projector_.row_bearing_information, projector_.row_bearing_residual, fitted.bearing_rows);
  const auto gain = [n](double chi_sq) { return -0.5 * n * std::log(std::max(1e-9, 1.0 - chi_sq / n)); };
  return std::max(0.0, gain(range) + gain(bearing) + 0.5 * (question.statistic - range - bearing));
}

Battery::Asked Battery::asked_of_rows(Question question, const std::vector<ShapeOf>& shapes,
                                      bool bearing) const {
  std::vector<Signature> block;
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(rows_.size()));
  for (const ShapeOf& shape_of : shapes) {
    const Shape shape = shape_of();
    block.push_back(bearing ? projector_.of_rows(none, shape.at) : projector_.of_rows(shape.at, none));
    if (shape.moved.size() == 0) continue;
    Eigen::VectorXd changes(rows_.cell_count);
    const Eigen::VectorXd unchanged = Eigen::VectorXd::Zero(rows_.cell_count);
    for (int c = 0; c < rows_.cell_count; ++c) changes[c] = shape.moved[c] - shape.at[rows_.cell_begin[c]];
    Signature& x = block.back();
    projector_.set_drift(bearing ? unchanged : changes, bearing ? changes : unchanged, x);
  }
  return asked_of_mean(std::move(question), std::move(block));
}

Battery::Asked Battery::asked_of_variance(Question about, const std::vector<Eigen::VectorXd>& shapes,
                                          bool bearing) const {
  const VarianceUnits& units = bearing ? bearing_units : range_units;
  Asked asked;
  Question& question = asked.question = std::move(about);
  asked.variance_of_bearing = bearing;
  question.of = Question::Of::variance;
  question.dof = 0;
  question.statistic = 0.0;
  std::vector<Eigen::VectorXd>& kept = asked.variance_columns;
  std::vector<double> scores;
  double size_sq = 0.0;
  const Eigen::VectorXd weight =
      0.5 * units.dof;  // information of a log variance: dof / 2 per unit slope squared
  const double total = weight.sum();
  for (Eigen::VectorXd x : shapes) {
    x.array() -= weight.dot(x) / total;  // the level belongs to the calibration's sigma
    for (const Eigen::VectorXd& direction : kept) x -= weight.cwiseProduct(direction).dot(x) * direction;
    const double information = weight.cwiseProduct(x).dot(x);
    if (information < 1e-6 * total) continue;
    x /= std::sqrt(information);
    const double score = 0.5 * x.dot(units.square - units.dof);
    scores.push_back(score);
    size_sq += score * score * weight.cwiseProduct(x).dot(x) / total;
    ++question.dof;
    kept.push_back(x);
  }
  if (question.dof == 0) return asked;
  question.size = std::sqrt(size_sq);
  question.third_cumulants = third_cumulants(kept, units.dof);
  question.statistic = skewed_chi_square(Eigen::Map<const Eigen::VectorXd>(scores.data(), question.dof),
                                         question.third_cumulants);
  // The score's chi-square overstates a large variance ratio. Fit the slopes: a few Newton steps on
  // sum [dof g + square e^-g] / 2 with g = level + sum b x.
  Eigen::MatrixXd design(units.dof.size(), static_cast<Eigen::Index>(kept.size()) + 1);
  design.col(0).setOnes();
  for (std::size_t j = 0; j < kept.size(); ++j) design.col(static_cast<Eigen::Index>(j) + 1) = kept[j];
  Eigen::VectorXd slopes = Eigen::VectorXd::Zero(design.cols());
  slopes[0] = std::log(std::max(1e-9, units.square.sum() / units.dof.sum()));
  const auto cost = [&](const Eigen::VectorXd& b) {
    const Eigen::ArrayXd g = (design * b).array();
    return 0.5 * (units.dof.array() * g + units.square.array() * (-g).exp()).sum();
  };
  const double level = cost(slopes);
  for (int step = 0; step < 4; ++step) {
    const Eigen::ArrayXd g = (design * slopes).array();
    const Eigen::VectorXd residual = (0.5 * (units.dof.array() - units.square.array() * (-g).exp())).matrix();
    const Eigen::MatrixXd information = design.transpose() * weight.asDiagonal() * design;
    slopes -= information.ldlt().solve(design.transpose() * residual).cwiseMax(-1.0).cwiseMin(1.0);
  }
  question.gain = std::max(0.0, level - cost(slopes));
  question.log_p = log_chi_sq_survival(question.statistic, question.dof);
  return asked;
}

}  // namespace rangecal::diagnosis
