// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "rangecal/core/symmetric_eigen.hpp"
#include "recursive/landmark_sums.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

/// The REML criterion as a function of the sigmas alone.
class Profile {
 public:
  Profile(const LandmarkSums& sums, int alphas, int order) : sums_(sums) {
    held_ = VectorXd::Zero(sums.reference.size());
    for (Eigen::Index i = 0; i < sums.reference.size(); ++i) {
      if (i <= order || i >= alphas)
        free_.push_back(i);
      else
        held_[i] = -sums.reference[i];
    }
  }

  /// +infinity where phi is not determined. Leaves phi - phi_0 in `delta`, l_s in `nll` and its Hessian in
  /// `hessian`.
  double operator()(const Vector2d& log_sigmas) {
    const LandmarkSums::At at = sums_.at(log_sigmas);
    const Eigen::LLT<MatrixXd> factor(at.hessian(free_, free_));
    if (factor.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
    delta = held_;
    MatrixXd bend = MatrixXd::Zero(delta.size(), delta.size());
    // the third order is small beside the second: each pass leaves some hundredth of what the one before did
    for (int pass = 0; pass < (sums_.third.empty() ? 1 : 5); ++pass) {
      if (!sums_.third.empty()) bend = along(sums_.third, delta);
      const VectorXd slope = at.gradient + at.hessian * held_ + 0.5 * bend * delta;
      delta(free_) = -factor.solve(VectorXd(slope(free_)));
    }
    if (!delta.allFinite()) return std::numeric_limits<double>::infinity();
    bend = along(sums_.third, delta);
    hessian = at.hessian + bend;
    nll = at.value + at.gradient.dot(delta) + 0.5 * delta.dot(at.hessian * delta) +
          delta.dot(bend * delta) / 6.0;
    const Eigen::LLT<MatrixXd> without(MatrixXd((hessian - sums_.beyond)(free_, free_)));
    if (without.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
    return nll + without.matrixLLT().diagonal().array().log().sum();
  }
  MatrixXd hessian;
  VectorXd delta;
  double nll = 0.0;

 private:
  const LandmarkSums& sums_;
  std::vector<Eigen::Index> free_;
  VectorXd held_;
};

struct Slopes {
  Vector2d g;
  Eigen::Matrix2d H;
};

/// First and second differences of the profile at x, where it is `here`, over +- h.
Slopes slopes_of(Profile& profile, const Vector2d& x, double here, double h) {
  const Vector2d e0(h, 0.0), e1(0.0, h);
  const double px = profile(x + e0), mx = profile(x - e0), py = profile(x + e1), my = profile(x - e1);
  const double pp = profile(x + e0 + e1), mm = profile(x - e0 - e1), pm = profile(x + e0 - e1),
               mp = profile(x - e0 + e1);
  Slopes at;
  at.g = {(px - mx) / (2.0 * h), (py - my) / (2.0 * h)};
  at.H(0, 0) = (px - 2.0 * here + mx) / (h * h);
  at.H(1, 1) = (py - 2.0 * here + my) / (h * h);
  at.H(0, 1) = at.H(1, 0) = (pp + mm - pm - mp) / (4.0 * h * h);
  return at;
}

constexpr double settled_step = 1e-7, settled_nats = 1e-6;

struct Newton {
  Vector2d step = Vector2d::Zero();
  double to_gain = 0.0;  ///< these two as in SumsFit
  bool settled = true;
};

/// Newton's step where the profile is `here`, for a grid so wide. Along an eigenvector of negative curvature it goes down,
/// as far as if the curvature were positive.
Newton newton_of(const Slopes& at, double here, double width) {
  const SymmetricEigen eigen = symmetric_eigen(at.H);
  Newton newton;
  for (Eigen::Index k = 0; k < 2; ++k) {
    const double curvature = eigen.values[k], bend = std::max(std::abs(curvature), 1e-100),
                 slope = eigen.vectors.col(k).dot(at.g), down = slope / bend, fall = width * std::abs(slope);
    const bool convex = curvature > 0.0;
    const double gain = convex ? std::min(0.5 * slope * down, fall) : fall + 0.5 * width * width * bend,
                 rounding = (convex ? 1e-13 : 1e-8) * std::abs(here);  // of the profile, and that over h^2
    newton.step -= down * eigen.vectors.col(k);
    newton.to_gain += gain;
    newton.settled =
        newton.settled && (gain < settled_nats + rounding || (convex && std::abs(down) < settled_step));
  }
  return newton;
}

}  // namespace

SumsFit minimise_sums(const LandmarkSums& sums, int alphas, int order, const Vector2d& start) {
  constexpr int max_iterations = 60;
  constexpr double h = 1e-3;
  const SolverLog log("sums");
  SumsFit fit;
  Profile profile(sums, alphas, order);
  const double reach = sums.grid.half_width;
  const auto inside = [&](const Vector2d& x) -> Vector2d {
    return x.cwiseMax((sums.grid.centre.array() - reach).matrix())
        .cwiseMin((sums.grid.centre.array() + reach).matrix());
  };
  Vector2d x = inside(start);
  double here = profile(x);
  if (!std::isfinite(here)) return fit;
  for (int iteration = 0;; ++iteration) {
    auto [g, H] = slopes_of(profile, x, here, h);
    if (!g.allFinite() || !H.allFinite()) return fit;
    // a sigma at the end of the grid that is drawn further out stays there
    for (int j = 0; j < 2; ++j) {
      const double from_centre = x[j] - sums.grid.centre[j];
      if (std::abs(from_centre) >= reach - 1e-9 && g[j] * from_centre < 0.0) {
        H(0, 1) = H(1, 0) = 0.0;
        H(j, j) = 1e100;
        g[j] = 0.0;
        fit.at_edge = true;
      }
    }
    const Newton newton = newton_of({g, H}, here, 2.0 * reach);
    fit.to_gain = newton.to_gain;
    fit.settled = newton.settled;
    const Vector2d step = std::min(1.0, 0.5 * reach / std::max(newton.step.norm(), 1e-300)) * newton.step;
    if (step.norm() < settled_step || iteration == max_iterations) break;
    bool moved = false;
    for (double factor_of_step = 1.0; factor_of_step > 1e-4 && !moved; factor_of_step *= 0.5) {
      const Vector2d trial = inside(x + factor_of_step * step);
      const double there = profile(trial);
      if (there < here) {
        x = trial;
        here = there;
        moved = true;
        log.iteration(iteration + 1, here, not_known, std::sqrt(2.0 * std::max(0.0, newton.to_gain)),
                      {"length", factor_of_step});
      }
    }
    if (!moved) break;
    fit.at_edge = false;
  }
  profile(x);
  fit.ok = true;
  fit.log_sigmas = x;
  fit.nll = profile.nll;
  fit.phi = sums.reference + profile.delta;
  fit.hessian = information_at(sums, profile.delta, x);
  log.end(-1, fit.nll, std::sqrt(2.0 * std::max(0.0, fit.to_gain)),
          fit.settled ? Outcome::converged : Outcome::not_converged);
  return fit;
}

MatrixXd information_at(const LandmarkSums& sums, const VectorXd& delta, const Vector2d& x) {
  constexpr double h = 1e-3;
  const Eigen::Index phis = delta.size();
  const LandmarkSums::At middle = sums.at(x);
  MatrixXd hessian = MatrixXd::Zero(phis + 2, phis + 2);
  hessian.topLeftCorner(phis, phis) = middle.hessian + along(sums.third, delta) - sums.beyond;
  const auto value_at = [&](const LandmarkSums::At& at) {
    return at.value + at.gradient.dot(delta) + 0.5 * delta.dot(at.hessian * delta);
  };
  for (int j = 0; j < 2; ++j) {
    Vector2d e = Vector2d::Zero();
    e[j] = h;
    const LandmarkSums::At above = sums.at(x + e), below = sums.at(x - e);
    const VectorXd cross =
        (above.gradient - below.gradient + (above.hessian - below.hessian) * delta) / (2.0 * h);
    hessian.col(phis + j).head(phis) = cross;
    hessian.row(phis + j).head(phis) = cross.transpose();
    hessian(phis + j, phis + j) = (value_at(above) - 2.0 * value_at(middle) + value_at(below)) / (h * h);
  }
  const auto corner = [&](double a, double b) { return value_at(sums.at(x + Vector2d(a, b))); };
  hessian(phis, phis + 1) = hessian(phis + 1, phis) =
      (corner(h, h) + corner(-h, -h) - corner(h, -h) - corner(-h, h)) / (4.0 * h * h);
  return hessian;
}

}  // namespace rangecal
