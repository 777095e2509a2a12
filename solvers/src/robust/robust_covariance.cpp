// SPDX-License-Identifier: BSD-3-Clause
#include "robust/robust_covariance.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "joint_ml/newton_step.hpp"

namespace rangecal {
namespace {

/// What a channel's readings tell, and how many there are for it once the fit has taken its share.
struct ChannelInformation {
  ChannelInformation(const ShapeAtEstimate& at, double readings)
      : shape(shape_information(at.shape, at.spread)),
        count(readings),
        share(std::min(1.0, at.squares / readings)) {}

  double scale() const { return shape.spread(0, 0); }
  ShapeInformation shape;
  double count, share;
};

/// Cells whose expected information per reading is `location` and `bearing` / s^2 of the means, `spread` of
/// log s.
JointProblem with_information(const JointProblem& rows, double location, double bearing, double spread) {
  JointProblem problem = rows;
  Cells& c = problem.cells;
  for (std::size_t i = 0; i < c.size(); ++i) {
    c.range_weight[i] = c.count[i] * location;
    if (rows.reads_bearings) c.bearing_weight[i] = c.count[i] * bearing;
    c.count[i] *= 0.5 * spread;  // the Gaussian's is 2 of each reading
  }
  return problem;
}

/// Adds to the block from `begin` on what the parameters of the shape add along `v`; their standard
/// deviations.
std::vector<double> add_shape_part(const ChannelInformation& channel, const ShapeAtEstimate& at,
                                   const Eigen::VectorXd& v, int begin, Eigen::MatrixXd& covariance) {
  const Eigen::Index n = shape_parameter_count(at.shape.shape);
  if (n == 0 || at_limit(at.shape, at.spread) || !(covariance(begin, begin) > 0.0)) return {};
  const Eigen::MatrixXd& I = channel.shape.spread;
  const Eigen::VectorXd c = I.col(0).tail(n) / channel.scale();
  const Eigen::MatrixXd own =
      channel.count * (I.bottomRightCorner(n, n) - channel.scale() * c * c.transpose());
  const Eigen::LLT<Eigen::MatrixXd> factor(own);
  if (factor.info() != Eigen::Success) return {};
  const Eigen::MatrixXd V = factor.solve(Eigen::MatrixXd::Identity(n, n));
  covariance.block(begin, begin, v.size(), v.size()) += c.dot(V * c) * v * v.transpose();
  std::vector<double> deviations;
  for (const double variance : V.diagonal()) deviations.push_back(std::sqrt(variance));
  return deviations;
}

/// The Schur complement on the globals, `at_theta` added to that of log sigma_theta and `log_det` to that of
/// all sigmas; empty where the stops have no optimum.
Eigen::MatrixXd without_stops(JointSystem& system, double at_theta, const Eigen::MatrixXd& log_det) {
  if (!system.eliminate()) return {};
  Eigen::MatrixXd H = system.schur();
  H.bottomRightCorner(log_det.rows(), log_det.cols()) += log_det;
  H(system.layout().sigma_theta, system.layout().sigma_theta) += at_theta;
  return H;
}

bool is_positive(const Eigen::MatrixXd& H, const std::vector<int>& free) {
  return H.size() > 0 && Eigen::LLT<Eigen::MatrixXd>(H(free, free)).info() == Eigen::Success;
}

/// H of the header, the stops eliminated; empty where they have no optimum.
Eigen::MatrixXd reduced_information(const JointProblem& weighted, const JointState& state, bool sigma_s_free,
                                    bool marginal, const ChannelInformation& range,
                                    const ChannelInformation& bearing, const std::vector<int>& free) {
  const int alphas = static_cast<int>(state.alpha.size()),
            taus = static_cast<int>(state.noise.parameters.size());
  JointSystem system(weighted, alphas, taus, sigma_s_free);
  if (!std::isfinite(system.assemble(state, HessianKind::exact)) || !system.eliminate()) return {};
  const int ns = system.layout().sigma_count();
  Eigen::MatrixXd log_det = Eigen::MatrixXd::Zero(ns, ns);
  if (marginal) log_det = system.log_det_sigma_hessian(state);

  const JointProblem shaped =
      with_information(weighted, range.shape.location, bearing.shape.location, range.share * range.scale());
  const JointProblem held =
      with_information(weighted, range.shape.weight, bearing.shape.weight, 2.0 * range.share);
  JointSystem of_shape(shaped, alphas, taus, sigma_s_free), of_weights(held, alphas, taus, sigma_s_free);
  of_shape.assemble(state, HessianKind::fisher);
  of_weights.assemble(state, HessianKind::fisher);
  system.accumulate(of_shape, 1.0);  // priors and taped distances cancel in the difference
  system.accumulate(of_weights, -1.0);
  // Both channels share the cells' counts; log sigma_theta is coupled to nothing in what is expected:
  // q (j - 2) of the bearings in place of the ranges'.
  const double of_range = range.count * range.share, of_bearing = bearing.count * bearing.share;
  const Eigen::MatrixXd H =
      without_stops(system, of_bearing * (bearing.scale() - 2.0) - of_range * (range.scale() - 2.0), log_det);
  if (free.empty() || is_positive(H, free)) return H;
  // What is expected alone: q j of the bearings in place of the ranges'.
  return without_stops(of_shape, of_bearing * bearing.scale() - of_range * range.scale(), log_det);
}

}  // namespace

Eigen::MatrixXd shape_information_gap(const JointProblem& weighted, const JointState& state,
                                      const NoiseShapeParameters& range, const NoiseShapeParameters& bearing,
                                      double range_spread_m) {
  const int alphas = static_cast<int>(state.alpha.size()),
            taus = static_cast<int>(state.noise.parameters.size());
  const ShapeInformation of_range = shape_information(range, range_spread_m),
                         of_bearing = shape_information(bearing, state.sigma_theta_rad);
  const JointProblem shaped =
      with_information(weighted, of_range.location, of_bearing.location, of_range.spread(0, 0));
  const JointProblem held = with_information(weighted, of_range.weight, of_bearing.weight, 2.0);
  JointSystem system(weighted, alphas, taus), of_shape(shaped, alphas, taus), of_weights(held, alphas, taus);
  const Eigen::Index phis = system.layout().phi_count;
  if (!std::isfinite(system.assemble(state, HessianKind::exact)) || !system.eliminate()) return {};
  const Eigen::MatrixXd before = system.schur().topLeftCorner(phis, phis);
  system.assemble(state, HessianKind::exact);
  of_shape.assemble(state, HessianKind::fisher);
  of_weights.assemble(state, HessianKind::fisher);
  system.accumulate(of_shape, 1.0);  // priors cancel in the difference
  system.accumulate(of_weights, -1.0);
  if (!system.eliminate()) return {};
  return system.schur().topLeftCorner(phis, phis) - before;
}

double shape_information_of_log_sigma(const NoiseShapeParameters& shape, double spread, double readings) {
  return readings * (shape_information(shape, spread).spread(0, 0) - 2.0);
}

std::vector<double> add_shape_uncertainty(const NoiseShapeParameters& shape, double spread, double readings,
                                          int at, Eigen::MatrixXd& covariance) {
  const ShapeAtEstimate estimate{shape, readings, {}, spread};
  return add_shape_part(ChannelInformation(estimate, readings), estimate, Eigen::VectorXd::Ones(1), at,
                        covariance);
}

void set_robust_covariance(const JointProblem& weighted, bool marginal, ShapeAtEstimate& range,
                           ShapeAtEstimate& bearing, JointFit& fit) {
  range.shape_std.clear();
  bearing.shape_std.clear();
  const double readings = weighted.readings;
  if (!fit.covariance || !(readings > 0.0)) return;
  JointState state = fit.state;
  if (state.sigma_s_m) state.sigma_s_m = std::max(*state.sigma_s_m, no_sigma_s(weighted));
  const int alphas = static_cast<int>(state.alpha.size()),
            taus = static_cast<int>(state.noise.parameters.size());
  const bool sigma_s_free = fit.covariance->rows() > JointLayout(weighted, alphas, taus, false).global_count;
  const JointLayout layout(weighted, alphas, taus, sigma_s_free);
  std::vector<int> free;
  for (int i = 0; i < layout.global_count; ++i)
    if ((*fit.covariance)(i, i) > 0.0) free.push_back(i);

  const ChannelInformation of_range(range, readings), of_bearing(bearing, readings);
  const Eigen::MatrixXd H =
      reduced_information(weighted, state, sigma_s_free, marginal, of_range, of_bearing, free);
  if (H.size() == 0) {
    fit.covariance.reset();
    fit.covariance_reason = "no covariance: the stops have no optimum by the noise shape's information";
    return;
  }
  describe_covariance(H, layout, free, fit);
  if (!fit.covariance) return;
  const bool polynomial = !has_sigma(state.noise.law);
  const Eigen::VectorXd one = Eigen::VectorXd::Ones(1);
  range.shape_std = add_shape_part(of_range, range, polynomial ? state.noise.parameters : one,
                                   layout.tau_begin, *fit.covariance);
  bearing.shape_std = add_shape_part(of_bearing, bearing, one, layout.sigma_theta, *fit.covariance);
}

}  // namespace rangecal
