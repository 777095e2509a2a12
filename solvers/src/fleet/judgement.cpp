// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/fleet/judgement.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <boost/math/special_functions/beta.hpp>
#include <cmath>
#include <optional>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::int64_t few = 100;  // up to here each unit has a W of its own; beyond, its leverage is small

MatrixXd total(const UnitSummary& unit, const MatrixXd& Sigma) {
  const Eigen::Index p = unit.theta.size();
  return Sigma + unit.information.llt().solve(MatrixXd::Identity(p, p));
}

struct Residual {
  VectorXd white, each;  ///< r, z
};

/// Nothing where E is not positive definite: such a unit is the mean all by itself.
std::optional<Residual> residual(const VectorXd& e, const MatrixXd& E) {
  const Eigen::LLT<MatrixXd> factor(E);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return Residual{factor.matrixL().solve(e), e.cwiseQuotient(E.diagonal().cwiseSqrt())};
}

/// P of a larger G of k coordinates among n others: 1 / (1 + G) ~ Beta((n - k) / 2, k / 2).
double upper(double G, double n, double k) {
  return boost::math::ibeta(0.5 * (n - k), 0.5 * k, 1.0 / (1.0 + std::fmax(G, 0.0)));
}

/// P that the smallest of so many p-values is below p.
double smallest_of(double count, double p) { return -std::expm1(count * std::log1p(-p)); }

}  // namespace

FleetJudge::FleetJudge(const UnitStream& units, const Population& population)
    : Sigma_(population.covariance), outlying_(population.outlying) {
  const auto kept = [&](const auto& visit) {
    std::size_t index = 0;
    units([&](const UnitSummary& unit) {
      if (!is_outlying(index)) visit(index, unit);
      ++index;
    });
    if (index != outlying_.size()) refuse_stream(fmt::format("{}", index));
  };
  if (population.units <= few)
    kept([&](std::size_t index, const UnitSummary& unit) { few_.emplace_back(index, unit); });
  else
    all_ = scatter_of([&](const std::function<void(const UnitSummary&)>& visit) {
      kept([&](std::size_t, const UnitSummary& unit) { visit(unit); });
    });
}

void FleetJudge::refuse_stream(const std::string& units) const {
  throw InputError(fmt::format(
      "FleetJudge: the population says of {} units which are outlying, the stream has {}; it needs the population "
      "that was fitted to these units, not one read from a file",
      outlying_.size(), units));
}

bool FleetJudge::is_outlying(std::size_t index) const {
  if (index >= outlying_.size()) refuse_stream("more");
  return outlying_[index];
}

UnitJudgement FleetJudge::operator()(const UnitSummary& unit, std::size_t index) const {
  const bool among = !is_outlying(index);
  if (few_.empty()) return judge(unit, all_, among);
  const Scatter others = scatter_of([&](const std::function<void(const UnitSummary&)>& visit) {
    for (const auto& [at, other] : few_)
      if (at != index) visit(other);
  });
  return judge(unit, others, false);
}

FleetJudge::Scatter FleetJudge::scatter_of(const UnitStream& units) const {
  const Eigen::Index p = Sigma_.rows();
  Scatter scatter{0.0, VectorXd::Zero(p), {}, MatrixXd::Zero(p, p), VectorXd::Zero(p)};
  MatrixXd weights = MatrixXd::Zero(p, p);
  units([&](const UnitSummary& unit) {
    const MatrixXd weight = total(unit, Sigma_).llt().solve(MatrixXd::Identity(p, p));
    weights += weight;
    scatter.mean += weight * unit.theta;
    scatter.units += 1.0;
  });
  scatter.mean_covariance = weights.llt().solve(MatrixXd::Identity(p, p));
  scatter.mean = scatter.mean_covariance * scatter.mean;
  units([&](const UnitSummary& unit) {
    const auto own = residual(unit.theta - scatter.mean, total(unit, Sigma_) - scatter.mean_covariance);
    if (!own) return;
    scatter.white += own->white * own->white.transpose();
    scatter.each += own->each.cwiseAbs2();
  });
  scatter.white *= 1.0 - 1.0 / scatter.units;
  scatter.each *= 1.0 - 1.0 / scatter.units;
  return scatter;
}

UnitJudgement FleetJudge::judge(const UnitSummary& unit, const Scatter& scatter, bool among) const {
  const MatrixXd T = total(unit, Sigma_), E = T + (among ? -1.0 : 1.0) * scatter.mean_covariance;
  const auto own = residual(unit.theta - scatter.mean, E);
  const auto p = static_cast<double>(unit.theta.size());
  UnitJudgement result;
  result.t = VectorXd::Zero(unit.theta.size());
  if (!own) return result;
  const double n = scatter.units - (among ? 1.0 : 0.0);
  const auto by_others = [among](double B) { return among ? B / std::fmax(1.0 - B, 1e-300) : B; };
  const double G = by_others(own->white.dot(scatter.white.llt().solve(own->white)));
  const VectorXd each = own->each.cwiseAbs2().cwiseQuotient(scatter.each).unaryExpr(by_others);
  result.distance_sq = (n - 1.0) * G;
  result.t = ((n - 1.0) * each).cwiseSqrt().cwiseProduct(own->each.cwiseSign());
  result.p_value =
      smallest_of(2.0, std::fmin(upper(G, n, p), smallest_of(p, upper(each.maxCoeff(), n, 1.0))));
  return result;
}

}  // namespace rangecal
