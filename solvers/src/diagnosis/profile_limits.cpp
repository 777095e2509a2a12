// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/profile_limits.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "diagnosis/free_parameters.hpp"
#include "rangecal/core/quantiles.hpp"
#include "solver_log.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double two_sided = 0.5 * z95 * z95, one_sided = 0.5 * z95_one_sided * z95_one_sided;  // nats
constexpr double at_bound = 0.02;  // nats between an estimate and its bound: the same
constexpr double far = 4.0;        // in u: a factor of fifty

/// Half the log determinant of the information on (alpha, landmarks) at a state.
double half_log_information(const Rows& rows, const Model& model, const JointState& state) {
  if (rows.alpha_prior) return 0.0;
  return -Projector(rows, working_problem(rows, model, state), state).log_phi_volume();
}

class Profile {
 public:
  Profile(const Rows& rows, const RefitOptions& options, Fit& fit)
      : rows_(rows), options_(options), fit_(fit) {
    for (std::size_t a = 0; a < fit.free.size(); ++a)
      if (fit.free[a].acts == FreeParameter::Acts::numeric) numeric_.push_back(a);
  }

  void run() {
    const auto n = static_cast<Eigen::Index>(numeric_.size());
    if (n == 0) return;
    here_ = fit_.nll + half_log_information(rows_, fit_.model, fit_.state);
    for (Eigen::Index a = 0; a < n; ++a) leave_bound(a);
    for (int round = 0; round < 3 && differences(); ++round)
      if (!polish()) break;
    fit_.limits.assign(fit_.free.size(), std::nullopt);
    for (Eigen::Index a = 0; a < n; ++a) set_limits(a);
    set_covariance();
  }

 private:
  const FreeParameter& own(Eigen::Index a) const { return fit_.free[numeric_[static_cast<std::size_t>(a)]]; }
  double typical(Eigen::Index a) const { return size_of(info_of(fit_.model, own(a))); }
  double low(Eigen::Index a) const { return bounds_of(rows_, fit_.model, own(a)).first; }
  double high(Eigen::Index a) const { return bounds_of(rows_, fit_.model, own(a)).second; }
  double& parameter(Model& model, Eigen::Index a) const { return value_of(model, own(a)); }
  bool positive(Eigen::Index a) const { return low(a) >= 0.0; }
  double smallest(Eigen::Index a) const { return std::max(low(a), 1e-4 * typical(a)); }

  /// The parameter at u + step, within its bounds.
  double moved(Eigen::Index a, double step) const {
    const double p = parameter(fit_.model, a);
    if (!positive(a)) return std::clamp(p + step, low(a), high(a));
    return std::clamp(std::max(p, smallest(a)) * std::exp(step), smallest(a), high(a));
  }

  /// l(u + step) - l(u).
  double rise(const Eigen::VectorXd& step) const {
    Model model = fit_.model;
    JointState state = fit_.state;
    for (Eigen::Index a = 0; a < step.size(); ++a)
      if (step[a] != 0.0) parameter(model, a) = moved(a, step[a]);
    return restricted_nll(rows_, model, options_, state) - here_;
  }

  void take(const Eigen::VectorXd& step) {
    Model model = fit_.model;
    for (Eigen::Index a = 0; a < step.size(); ++a) parameter(model, a) = moved(a, step[a]);
    fit_.model = std::move(model);
    fit_.nll = calibrate_under(rows_, fit_.model, fit_.state, options_);
    here_ = fit_.nll + half_log_information(rows_, fit_.model, fit_.state);
  }

  /// An estimate that l_s draws to 0 may be positive by l: tries sizes from a tenth of the typical up.
  void leave_bound(Eigen::Index a) {
    const double p = std::max(parameter(fit_.model, a), smallest(a));
    if (!positive(a) || p > 0.1 * typical(a)) return;
    double best = -1e-3, best_step = 0.0;
    for (double size : {0.1, 0.2, 0.4, 0.8}) {
      const double step = std::log(size * typical(a) / p);
      const double change = rise(step * Eigen::VectorXd::Unit(static_cast<Eigen::Index>(numeric_.size()), a));
      if (change < best) best = change, best_step = step;
    }
    if (best_step != 0.0)
      take(best_step * Eigen::VectorXd::Unit(static_cast<Eigen::Index>(numeric_.size()), a));
  }

  /// Gradient and second differences, by steps that cost some tenths of a nat.
  bool differences() {
    const auto n = static_cast<Eigen::Index>(numeric_.size());
    gradient_ = Eigen::VectorXd::Zero(n);
    hessian_ = Eigen::MatrixXd::Zero(n, n);
    step_ = Eigen::VectorXd::Zero(n);
    for (Eigen::Index a = 0; a < n; ++a) {
      double up = 0.0, down = 0.0, h = 0.1;
      for (; h < far; h *= 2.0) {
        up = rise(h * Eigen::VectorXd::Unit(n, a));
        down = rise(-h * Eigen::VectorXd::Unit(n, a));
        if (!std::isfinite(up) || !std::isfinite(down)) return false;
        if (std::max(up, down) > 0.2) break;
      }
      step_[a] = h;
      gradient_[a] = (up - down) / (2.0 * h);
      hessian_(a, a) = (up + down) / (h * h);
    }
    for (Eigen::Index a = 0; a < n; ++a)
      for (Eigen::Index b = 0; b < a; ++b) {
        const auto at = [&](int i, int j) {
          return rise(i * step_[a] * Eigen::VectorXd::Unit(n, a) +
                      j * step_[b] * Eigen::VectorXd::Unit(n, b));
        };
        hessian_(a, b) = hessian_(b, a) =
            (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / (4.0 * step_[a] * step_[b]);
      }
    return hessian_.allFinite();
  }

  /// One Newton step, if it is a gain worth another.
  bool polish() {
    const Eigen::LLT<Eigen::MatrixXd> factor(hessian_);
    if (factor.info() != Eigen::Success) return false;
    const Eigen::VectorXd step = (-factor.solve(gradient_)).cwiseMax(-2.0 * step_).cwiseMin(2.0 * step_);
    if (!(rise(step) < -1e-3)) return false;
    take(step);
    return true;
  }

  /// The step of all when parameter a moves by 1: the others follow to where l is lowest.
  Eigen::VectorXd direction(Eigen::Index a) const {
    const Eigen::Index n = hessian_.rows();
    Eigen::VectorXd along = Eigen::VectorXd::Unit(n, a);
    const Eigen::LLT<Eigen::MatrixXd> factor(hessian_);
    if (n == 1 || factor.info() != Eigen::Success) return along;
    const Eigen::VectorXd column = factor.solve(Eigen::VectorXd::Unit(n, a));
    along = column / column[a];
    for (Eigen::Index b = 0; b < n; ++b)
      if (b != a && std::abs(along[b]) > 5.0) return Eigen::VectorXd::Unit(n, a);  // next to no curvature
    return along;
  }

  /// The parameter where l has risen by `level` on one side; its bound where it never does.
  double limit(Eigen::Index a, double side, double level) const {
    const Eigen::VectorXd along = direction(a);
    const double p = parameter(fit_.model, a), bound = side > 0.0 ? high(a) : low(a);
    double inner = 0.0, outer = step_[a], inner_rise = 0.0, outer_rise = rise(side * outer * along);
    while (outer_rise < level) {
      if (outer > 2.0 * far || moved(a, side * outer) == moved(a, 2.0 * side * outer)) return bound;
      inner = outer, inner_rise = outer_rise;
      outer *= 1.6;
      outer_rise = rise(side * outer * along);
      if (!std::isfinite(outer_rise)) return moved(a, side * inner);
    }
    // sqrt(rise) is nearly linear near an optimum, but not from a plateau: halves in between.
    for (int i = 0; i < 20 && std::abs(outer_rise - level) > 0.02; ++i) {
      const double low = std::sqrt(std::max(0.0, inner_rise)), high = std::sqrt(outer_rise);
      const double share = i % 2 == 1 ? 0.5 : std::clamp((std::sqrt(level) - low) / (high - low), 0.05, 0.95);
      const double middle = inner + share * (outer - inner), value = rise(side * middle * along);
      if (value < level - 0.02)
        inner = middle, inner_rise = value;
      else
        outer = middle, outer_rise = value;
    }
    return side > 0.0 ? std::max(p, moved(a, side * outer)) : std::min(p, moved(a, side * outer));
  }

  void set_limits(Eigen::Index a) {
    const auto n = static_cast<Eigen::Index>(numeric_.size());
    const bool lowest = positive(a) && rise(-2.0 * far * Eigen::VectorXd::Unit(n, a)) < at_bound;
    fit_.limits[numeric_[static_cast<std::size_t>(a)]] =
        lowest ? Limits{low(a), limit(a, 1.0, one_sided), true}
               : Limits{limit(a, -1.0, two_sided), limit(a, 1.0, two_sided)};
  }

  void set_covariance() {
    const auto n = static_cast<Eigen::Index>(numeric_.size());
    const Eigen::LLT<Eigen::MatrixXd> factor(hessian_);
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
    if (factor.info() == Eigen::Success) covariance = factor.solve(Eigen::MatrixXd::Identity(n, n));
    for (Eigen::Index a = 0; a < n; ++a) {
      const Limits& limits = *fit_.limits[numeric_[static_cast<std::size_t>(a)]];
      const double scale = positive(a) ? parameter(fit_.model, a) : 1.0;
      covariance.row(a) *= scale;
      covariance.col(a) *= scale;
      // Half the interval bounds what the curvature says, which at a bound or on a plateau is nothing.
      const double widest = (limits.high - limits.low) / 3.92;
      if (!(covariance(a, a) > 0.0) || covariance(a, a) > 4.0 * widest * widest || limits.low == low(a)) {
        covariance.row(a).setZero();
        covariance.col(a).setZero();
        covariance(a, a) = widest * widest;
      }
    }
    for (Eigen::Index a = 0; a < n; ++a) {
      const auto i = static_cast<Eigen::Index>(numeric_[static_cast<std::size_t>(a)]);
      fit_.covariance.row(i).setZero();
      fit_.covariance.col(i).setZero();
    }
    for (Eigen::Index a = 0; a < n; ++a)
      for (Eigen::Index b = 0; b < n; ++b)
        fit_.covariance(static_cast<Eigen::Index>(numeric_[static_cast<std::size_t>(a)]),
                        static_cast<Eigen::Index>(numeric_[static_cast<std::size_t>(b)])) = covariance(a, b);
  }

  const Rows& rows_;
  const RefitOptions& options_;
  Fit& fit_;
  std::vector<std::size_t> numeric_;  ///< of the free parameters
  double here_ = 0.0;                 ///< l at the fit
  Eigen::VectorXd gradient_, step_;
  Eigen::MatrixXd hessian_;
};

}  // namespace

double restricted_nll(const Rows& rows, const Model& model, const RefitOptions& options, JointState& state) {
  const double nll = calibrate_under(rows, model, state, options);
  return std::isfinite(nll) ? nll + half_log_information(rows, model, state) : nll;
}

void add_profile_limits(const Rows& rows, const RefitOptions& options, Fit& fit) {
  const SolverLog solves_are_parts("profile limits");
  Profile(rows, options, fit).run();
}

}  // namespace rangecal::diagnosis
