// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/formula_error.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>

#include "diagnosis/generic_effect.hpp"
#include "solvers/diagnosis/made_recordings.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal::diagnosis {
namespace {

/// Readings with a normal error of 5 mm of a camera that ranges by depth, d cos b, in which that change is `off` of itself too
/// large or small along b.
testing::SeedFit camera(double off, const std::string& name) {
  Recording recording = testing::depth_camera(400, 0.0, 0.0, name);
  Random random(seed_from(name, {2}));
  for (std::size_t i = 0; i < recording.pairs.true_m.size(); ++i) {
    const double d = recording.pairs.true_m[i], b = recording.pairs.bearing_rad[i];
    recording.pairs.reading_m[i] =
        d - d * (1.0 - std::cos(b)) * (1.0 + off * std::sin(3.0 * b)) + random.normal(0.0, 0.005);
  }
  testing::SeedFit seed(recording);
  // Spreads that do not depend on the curve tell nothing of it.
  const double f = 3.0,
               spread = seed.fit.state.noise.parameters[0] * std::pow(f, seed.fit.state.noise.power_of_f());
  seed.fit.state.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, spread)};
  return seed;
}

struct Fitted {
  Fit fit;
  double allowance = 0.0;
};

Fitted fitted_by_depth(const testing::SeedFit& seed, const SelectionPriors& priors = {}) {
  const Effect* depth = find_effect("axial_depth");
  Fitted out;
  out.fit =
      refit(seed.rows, {{depth, depth->start_grid(seed.rows.context).front()}}, seed.fit.state, seed.options);
  const Projector projector(seed.rows, working_problem(seed.rows, out.fit.model, out.fit.state),
                            out.fit.state);
  out.allowance = log_formula_allowance(seed.rows, projector, out.fit, 0, priors);
  return out;
}

/// The same by dense matrices: y - f - u of N readings, in standard deviations, is N(0, 1 + T T^T + Z Z^T) in what the curve leaves,
/// T the effect of its parameters at the widths of their priors, Z that of the changes of shape.
double by_dense_matrices(const testing::SeedFit& seed, const Fit& fit, const SelectionPriors& priors) {
  const CellGeometry geometry = cell_geometry(seed.rows, fit.state);
  const auto n = static_cast<Eigen::Index>(seed.rows.size()), alphas = fit.state.alpha.size();
  const ActiveEffect& depth = fit.model[0];
  Eigen::MatrixXd A(n, alphas + depth.parameters.size()), Z(n, 6);
  Eigen::VectorXd r(n), u(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto row = static_cast<std::size_t>(i);
    const auto cell = static_cast<std::size_t>(seed.rows.cell[row]);
    const ReadingView<double> view = view_of(seed.rows, geometry, row);
    const auto change = [&](const Eigen::VectorXd& p) { return depth.effect->reading(view, p.data()).range; };
    const double s = geometry.spread[cell];
    u[i] = change(depth.parameters) / s;
    r[i] = (seed.rows.range_m[row] - geometry.f[cell]) / s - u[i];
    for (Eigen::Index j = 0; j < alphas; ++j) A(i, j) = std::pow(view.d, static_cast<double>(j)) / s;
    for (Eigen::Index j = 0; j < depth.parameters.size(); ++j) {
      Eigen::VectorXd more = depth.parameters, less = more;
      more[j] += 1e-5, less[j] -= 1e-5;
      A(i, alphas + j) = (change(more) - change(less)) / (2e-5 * s);
    }
    for (int k = 1; k <= 3; ++k) {
      Z(i, 2 * k - 2) = u[i] * std::cos(k * view.bearing);
      Z(i, 2 * k - 1) = u[i] * std::sin(k * view.bearing);
    }
  }
  for (int j = 0; j < 6; ++j) {
    const Eigen::VectorXd left = Z.col(j) - u * (u.dot(Z.col(j)) / u.squaredNorm());
    Z.col(j) *= priors.formula_error / std::sqrt(6.0) * u.norm() / left.norm();
  }
  // Sizes are known by their prior too, about the estimate; the curve by the readings alone.
  const Eigen::MatrixXd B = A.leftCols(alphas);
  Eigen::MatrixXd T = A.rightCols(depth.parameters.size());
  for (const FreeParameter& p : fit.free) T.col(p.index) *= prior_width(seed.rows, fit.model, p);
  const auto without_curve = [&](const Eigen::MatrixXd& V) -> Eigen::MatrixXd {
    const Eigen::MatrixXd W = V.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
    return W - W * B * (B.transpose() * W * B).ldlt().solve(B.transpose() * W);
  };
  const Eigen::MatrixXd V = Eigen::MatrixXd::Identity(n, n) + T * T.transpose();
  const Eigen::MatrixXd exact = without_curve(V), inexact = without_curve(V + Z * Z.transpose());
  const double gain =
      0.5 * r.dot((exact - inexact) * r) -
      0.5 * std::log((Eigen::MatrixXd::Identity(6, 6) + Z.transpose() * exact * Z).determinant());
  return std::log(1.0 - priors.formula_is_off + priors.formula_is_off * std::exp(gain));
}

TEST(FormulaAllowance, IsThatOfTheNormalLawOfAllReadings) {
  for (const double off : {0.0, 0.2}) {
    const testing::SeedFit seed = camera(off, "FormulaAllowance");
    const Fitted depth = fitted_by_depth(seed);
    ASSERT_TRUE(depth.fit.ok);
    EXPECT_NEAR(depth.allowance, by_dense_matrices(seed, depth.fit, {}), 2e-3) << off;
  }
}

TEST(FormulaAllowance, IsSmallWhereTheFormulaIsRightAndLargeWhereItIsOff) {
  const double right = fitted_by_depth(camera(0.0, "FormulaAllowance")).allowance;
  EXPECT_GT(right, std::log(1.0 - SelectionPriors{}.formula_is_off) - 1e-12);
  EXPECT_LT(right, 0.5);
  EXPECT_GT(fitted_by_depth(camera(0.3, "FormulaAllowance")).allowance, 5.0);
}

TEST(FormulaAllowance, ANameThatChoosesALandmarkHasAFormula) {
  const auto allowance = [](double off) {
    Recording recording = testing::recording_with({}, "FormulaAllowance.Landmark");
    Readings& readings = recording.readings;
    for (std::size_t i = 0; i < readings.size(); ++i)
      if (readings.landmark[i] == 0)
        readings.range_m[i] += 0.03 * (1.0 + off * std::sin(4.0 * readings.range_m[i]));
    const testing::SeedFit seed(recording);
    const Effect* reflectance = find_effect("target_reflectance");
    Fit best;
    for (const Eigen::VectorXd& start : reflectance->start_grid(seed.rows.context)) {
      Fit fit = refit(seed.rows, {{reflectance, start}}, seed.fit.state, seed.options);
      if (fit.ok && (!best.ok || fit.nll < best.nll)) best = std::move(fit);
    }
    const Projector projector(seed.rows, working_problem(seed.rows, best.model, best.state), best.state);
    return log_formula_allowance(seed.rows, projector, best, 0, {});
  };
  EXPECT_NEAR(allowance(0.0), 0.0, 0.5);
  EXPECT_GT(allowance(0.4), 2.0);
}

TEST(FormulaAllowance, ACurveHasNoFormula) {
  const testing::SeedFit seed = camera(0.3, "FormulaAllowance");
  GenericEffect curve(CurveChannel::range, "range", "sensor_bearing",
                      covariate_of(seed.rows, "sensor_bearing"), {{-0.5, 0.0, 0.5}, false, 0.0},
                      Eigen::MatrixXd::Identity(3, 3), 0.01);
  const Fit fit = refit(seed.rows, {{&curve, Eigen::VectorXd::Zero(3)}}, seed.fit.state, seed.options);
  const Projector projector(seed.rows, working_problem(seed.rows, fit.model, fit.state), fit.state);
  EXPECT_EQ(log_formula_allowance(seed.rows, projector, fit, 0, {}), 0.0);
}

TEST(FormulaAllowance, WhatBookkeepingFoundHasNone) {
  const testing::SeedFit seed = camera(0.3, "FormulaAllowance");
  const Fitted depth = fitted_by_depth(seed);
  const Projector projector(seed.rows, working_problem(seed.rows, depth.fit.model, depth.fit.state),
                            depth.fit.state);
  EXPECT_EQ(log_formula_allowance(seed.rows, projector, depth.fit, 1, {}), 0.0);
}

}  // namespace
}  // namespace rangecal::diagnosis
