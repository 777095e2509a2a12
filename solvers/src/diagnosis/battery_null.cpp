// SPDX-License-Identifier: BSD-3-Clause
// What the battery's p-values are worth together: its smallest ones, simulated under the fitted model.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "diagnosis/battery.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::diagnosis {
namespace {

/// The point of the smallest p-value's law that fixes the effective numbers.
constexpr double tail = 0.03;
constexpr double worth_a_p_value =
    0.15;  ///< share of the draws whose largest statistic is turned into a p-value

/// Errors of the stops (dx, dy, dh) drawn from their prior, to first order: a heading error of the stop
/// before turns the commanded step of a random walk.
std::vector<Eigen::Vector3d> stop_errors(const std::vector<StopPrior>& stops, Random& random) {
  std::vector<Eigen::Vector3d> errors(stops.size());
  std::vector<Eigen::Vector2d> of_place;
  for (std::size_t k = 0; k < stops.size(); ++k) {
    const StopPrior& prior = stops[k];
    const double unit_y = random.normal(), unit_x = random.normal(), unit_heading = random.normal();
    const Eigen::Vector3d drawn = stop_error(prior, prior.sigma_xy_m, {unit_x, unit_y, unit_heading});
    Eigen::Vector2d slip = drawn.head<2>();
    double turn = drawn.z();
    if (prior.chained && prior.shape)  // a step's own covariance is in the frame of the stop before
      slip = Eigen::Rotation2Dd(stops[k - 1].commanded.heading_rad) * slip;
    Eigen::Vector2d error = slip;
    if (of_place.size() <= static_cast<std::size_t>(prior.place)) of_place.resize(prior.place + 1);
    if (prior.chained) {
      const Pose2 &from = stops[k - 1].commanded, &to = prior.commanded;
      const double turned = errors[k - 1][2];
      error = errors[k - 1].head<2>() + turned * Eigen::Vector2d(from.y_m - to.y_m, to.x_m - from.x_m);
      if (prior.opens_place) error += slip;
      turn += turned;
    } else if (!prior.opens_place) {
      error = of_place[prior.place];
    }
    of_place[prior.place] = error;
    errors[k] << error, turn;
  }
  return errors;
}

}  // namespace

void Battery::calibrate(int draws, std::uint64_t seed) {
  const int cells = projector_.cells(), means = static_cast<int>(mean_projected_.size());
  Eigen::MatrixXd columns(2 * cells, means);
  bool within = false;
  for (int j = 0; j < means; ++j) {
    columns.col(j) = mean_projected_[j];
    within = within || mean_within_[j].within();
  }
  const Eigen::VectorXd range_sd = projector_.range_information.cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::VectorXd bearing_sd =
      rows_.pairs ? Eigen::VectorXd::Zero(cells).eval()
                  : projector_.bearing_information.cwiseMax(1e-300).cwiseSqrt().cwiseInverse().eval();
  const Eigen::Index n = static_cast<Eigen::Index>(rows_.size());
  Eigen::MatrixXd noise(2 * cells, draws);
  Eigen::MatrixXd row_noise_range, row_noise_bearing;
  if (within) {
    row_noise_range.resize(n, draws);
    row_noise_bearing.resize(n, draws);
  }
  std::vector<Eigen::VectorXd> variance_scores(draws);
  Eigen::MatrixXd scalars(std::max<std::size_t>(questions.size(), 1), draws);
  for (int b = 0; b < draws; ++b) {
    Random random(seed_from("battery", {seed, static_cast<std::uint64_t>(b)}));
    for (int c = 0; c < cells; ++c) {
      noise(c, b) = random.normal() * range_sd[c];
      noise(cells + c, b) = random.normal() * bearing_sd[c];
    }
    if (!rows_.pairs) {
      const std::vector<Eigen::Vector3d> moved = stop_errors(working_.problem.stops, random);
      const Signature stops = projector_.of_stops(moved);
      noise.col(b).head(cells) += stops.range;
      noise.col(b).tail(cells) += stops.bearing;
    }
    if (rows_.alpha_prior && !rows_.alpha_prior->exact()) {  // the simulation's own sampling error
      Eigen::VectorXd z(rows_.alpha_prior->mean.size());
      for (double& value : z) value = random.normal();
      const Eigen::VectorXd alpha = rows_.alpha_prior->precision.llt().matrixU().solve(z);
      for (int c = 0; c < cells; ++c) {
        double curve = 0.0;
        for (Eigen::Index a = alpha.size(); a-- > 0;) curve = curve * projector_.geometry().d[c] + alpha[a];
        noise(c, b) += curve;
      }
    }
    if (within)
      for (int c = 0; c < rows_.cell_count; ++c) {
        const int begin = rows_.cell_begin[c], count = rows_.cell_begin[c + 1] - begin;
        double range_mean = 0.0, bearing_mean = 0.0;
        for (int i = begin; i < begin + count; ++i) {
          row_noise_range(i, b) = random.normal() / std::sqrt(projector_.row_range_information[i]);
          row_noise_bearing(i, b) =
              rows_.pairs ? 0.0 : random.normal() / std::sqrt(projector_.row_bearing_information[i]);
          range_mean += row_noise_range(i, b) / count;
          bearing_mean += row_noise_bearing(i, b) / count;
        }
        for (int i = begin; i < begin + count; ++i) {
          row_noise_range(i, b) -= range_mean;
          row_noise_bearing(i, b) -= bearing_mean;
        }
      }
    // chi-square units by Wilson and Hilferty's cube, good to a few per mille from two degrees of freedom on
    const auto unit_noise = [&](const VarianceUnits& units) {
      Eigen::VectorXd excess(units.dof.size());
      for (Eigen::Index u = 0; u < excess.size(); ++u) {
        const double dof = units.dof[u];
        const double z = random.normal();
        if (dof < 1e-3) {
          excess[u] = 0.0;
        } else if (dof < 1.5) {
          excess[u] = dof * (z * z - 1.0);
        } else {
          const double k = 2.0 / (9.0 * dof);
          excess[u] = dof * (std::pow(1.0 - k + z * std::sqrt(k), 3) - 1.0);
        }
      }
      return excess;
    };
    const Eigen::VectorXd range_excess = unit_noise(range_units), bearing_excess = unit_noise(bearing_units);
    variance_scores[b].resize(static_cast<Eigen::Index>(variance_columns_.size()));
    for (std::size_t j = 0; j < variance_columns_.size(); ++j)
      variance_scores[b][static_cast<Eigen::Index>(j)] =
          0.5 * variance_columns_[j].dot(variance_of_bearing_[j] ? bearing_excess : range_excess);
    for (std::size_t q = 0; q < questions.size(); ++q)
      scalars(static_cast<Eigen::Index>(q), b) = random.normal();
  }
  Eigen::MatrixXd scores = columns.transpose() * noise;
  for (int j = 0; j < means; ++j)
    if (mean_within_[j].within())
      scores.row(j) += mean_within_[j].range_rows.transpose() * row_noise_range +
                       mean_within_[j].bearing_rows.transpose() * row_noise_bearing;
  // Per family and number of degrees of freedom the p-value falls with the statistic: only the largest is
  // worth one.
  struct Largest {
    int dof = 1;
    int family = 0;
    Eigen::VectorXd statistic;  // per draw
  };
  std::map<std::string, int> family_of;
  std::map<std::pair<int, int>, Largest> largest;
  std::vector<Eigen::VectorXd*> of_question;
  for (const Question& q : questions) {
    const int family = family_of.try_emplace(q.family, static_cast<int>(family_of.size())).first->second;
    Largest& entry = largest[{family, q.dof}];
    if (entry.statistic.size() == 0) entry = {q.dof, family, Eigen::VectorXd::Zero(draws)};
    of_question.push_back(&entry.statistic);
  }
  for (int b = 0; b < draws; ++b)
    for (std::size_t q = 0; q < questions.size(); ++q) {
      const Question& question = questions[q];
      double statistic = 0.0;
      for (int j = 0; j < question.dof; ++j) {
        const double score = question.of == Question::Of::mean ? scores(question.first_column + j, b)
                             : question.of == Question::Of::variance
                                 ? variance_scores[b][question.first_column + j]
                                 : scalars(static_cast<Eigen::Index>(q), b);
        statistic += score * score;
      }
      (*of_question[q])[b] = std::max((*of_question[q])[b], statistic);
    }
  const auto independent = [&](double log_p) {
    return std::log1p(-tail) / std::log1p(-std::clamp(std::exp(log_p), 1e-12, 0.5));
  };
  const auto rank = static_cast<Eigen::Index>(std::max(0.0, tail * draws - 1.0));
  std::vector<double> independent_questions(family_of.size(), 0.0);
  for (const auto& [key, entry] : largest) {
    Eigen::VectorXd sorted = entry.statistic;
    std::nth_element(sorted.begin(), sorted.begin() + rank, sorted.end(), std::greater<>());
    independent_questions[static_cast<std::size_t>(entry.family)] +=
        std::max(1.0, independent(log_chi_sq_survival(sorted[rank], entry.dof)));
  }
  Eigen::VectorXd smallest = Eigen::VectorXd::Zero(draws);  // ln p, corrected within families
  for (const auto& [key, entry] : largest) {
    Eigen::VectorXd sorted = entry.statistic;  // the smallest of all lies among each family's best
    const auto worth = static_cast<Eigen::Index>(worth_a_p_value * draws);
    std::nth_element(sorted.begin(), sorted.begin() + worth, sorted.end(), std::greater<>());
    for (int b = 0; b < draws; ++b)
      if (entry.statistic[b] >= sorted[worth])
        smallest[b] = std::min(
            smallest[b], log_of_smallest(log_chi_sq_survival(entry.statistic[b], entry.dof),
                                         independent_questions[static_cast<std::size_t>(entry.family)]));
  }
  for (const auto& [family, index] : family_of)
    rates.within[family] = independent_questions[static_cast<std::size_t>(index)];
  // That point is known from tail * draws values beyond it only: one standard error on the safe side.
  const auto safe = static_cast<Eigen::Index>(std::max(0.0, tail * draws - std::sqrt(tail * draws) - 1.0));
  std::nth_element(smallest.begin(), smallest.begin() + safe, smallest.end());
  rates.families = std::clamp(independent(smallest[safe]), 1.0, 1e7);
}

}  // namespace rangecal::diagnosis
