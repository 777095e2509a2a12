// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/formula_error.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/generic_effect.hpp"
#include "diagnosis/select/evidence.hpp"
#include "diagnosis/select/hypothesis.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr int orders = 3;  ///< of Legendre polynomials, and harmonics of an angle

/// True of a name that changes means by a formula of one shape. A curve that is free in its shape has no error of it, and of one that jumps
/// at a distance chosen from the readings a jump elsewhere would pass for one.
bool has_a_formula(const ActiveEffect& active) {
  return active.effect->info().kind == EffectKind::mean && !is_generic(*active.effect) &&
         !std::isfinite(active.effect->switching_distance(active.parameters.data()));
}

/// g_j at every reading, by columns; none where the covariate is the same for all.
Eigen::MatrixXd shapes_along_covariate(const Rows& rows, const CellGeometry& geometry,
                                       const EffectInfo& info) {
  const std::string& along = info.covariate;
  const bool ordered = along != "landmark" && along != "constant" && along != "radius";
  CovariateOf covariate = ordered ? covariate_of(rows, along) : CovariateOf();
  if (!covariate) covariate = covariate_of(rows, "range");
  Eigen::VectorXd x = values_along(rows, geometry, covariate);
  if (along == "sensor_bearing" || along == "heading") {
    Eigen::MatrixXd g(x.size(), 2 * orders);
    for (int k = 1; k <= orders; ++k) {
      g.col(2 * k - 2) = (k * x).array().cos();
      g.col(2 * k - 1) = (k * x).array().sin();
    }
    return g;
  }
  for (double& value : x)
    if (!std::isfinite(value)) value = 0.0;  // an empty field: the effect does nothing there
  const double low = x.minCoeff(), span = x.maxCoeff() - low;
  if (!(span > 0.0)) return {};
  x = 2.0 * (x.array() - low) / span - 1.0;
  Eigen::MatrixXd g(x.size(), orders);
  for (Eigen::Index i = 0; i < x.size(); ++i)
    for (int k = 1; k <= orders; ++k) g(i, k - 1) = std::legendre(static_cast<unsigned>(k), x[i]);
  return g;
}

/// The change of every reading by one effect, that of moved stops included.
std::pair<Eigen::VectorXd, Eigen::VectorXd> change_of(const Rows& rows, const Projector& projector,
                                                      const ActiveEffect& active) {
  const RowChanges changes = row_changes(rows, projector.geometry(), {active});
  std::pair<Eigen::VectorXd, Eigen::VectorXd> u{changes.range, changes.bearing};
  if (!active.effect->acts_on_stops()) return u;
  Signature moved;
  moved.range.setZero(rows.cell_count);
  moved.bearing.setZero(rows.cell_count);
  add_stop_changes(rows, projector, {active}, moved);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    u.first[static_cast<Eigen::Index>(i)] += moved.range[rows.cell[i]];
    u.second[static_cast<Eigen::Index>(i)] += moved.bearing[rows.cell[i]];
  }
  return u;
}

/// u g_j of one member, each of the size of u where u is taken out of it; of a change of the stops that curve and landmarks take up nearly
/// whole, of what the calibration leaves of it: a tenth of a path that is longer by one factor is no error of a formula.
void add_changes_of_shape(const Rows& rows, const Projector& projector, const ActiveEffect& active,
                          std::vector<Signature>& shapes, std::vector<double>& prior_variances, double size) {
  const Eigen::MatrixXd g = shapes_along_covariate(rows, projector.geometry(), active.effect->info());
  if (g.cols() == 0) return;
  const auto [range, bearing] = change_of(rows, projector, active);
  if (!range.allFinite() || !bearing.allFinite()) return;
  const Signature u = projector.of_rows(range, bearing);
  constexpr double nearly_all = 0.99;
  const bool is_left = active.effect->acts_on_stops() &&
                       projector.beside_known_stops(u) < (1.0 - nearly_all) * projector.raw_information(u);
  const Eigen::VectorXd projected = is_left ? projector.project(u) : Eigen::VectorXd();
  const auto beside_u = [&](const Signature& x) {
    return is_left ? projector.inner(x, projected, u) : projector.raw_inner(x, u);
  };
  const auto size_of = [&](const Signature& x) {
    return is_left ? projector.inner(x, projector.project(x), x) : projector.raw_information(x);
  };
  const double of_u = size_of(u);
  if (!(of_u > 0.0)) return;
  for (Eigen::Index j = 0; j < g.cols(); ++j) {
    Signature shape = projector.of_rows(range.cwiseProduct(g.col(j)), bearing.cwiseProduct(g.col(j)));
    const double along = beside_u(shape);
    const double left = size_of(shape) - along * along / of_u;
    if (!(left > 1e-6 * of_u)) continue;
    shape.scale(std::sqrt(of_u / left));
    shapes.push_back(std::move(shape));
    prior_variances.push_back(size * size / static_cast<double>(g.cols()));
  }
}

}  // namespace

double log_formula_allowance(const Rows& rows, const Projector& projector, const Fit& fit, std::size_t known,
                             const SelectionPriors& priors) {
  std::vector<Signature> signatures;  // of the members' parameters, then of the changes of shape
  std::vector<double> widths;         // of the parameters' priors
  for (const FreeParameter& p : fit.free)
    if (p.acts == FreeParameter::Acts::mean) {
      signatures.push_back(
          effect_signature(rows, projector, fit.model[static_cast<std::size_t>(p.effect)], p.index));
      widths.push_back(prior_width(rows, fit.model, p));
    }
  const auto k = static_cast<Eigen::Index>(signatures.size());
  std::vector<double> variances;
  for (std::size_t e = known; e < fit.model.size(); ++e)
    if (has_a_formula(fit.model[e]))
      add_changes_of_shape(rows, projector, fit.model[e], signatures, variances, priors.formula_error);
  const auto m = static_cast<Eigen::Index>(variances.size());
  if (m == 0) return 0.0;
  Eigen::MatrixXd information(k + m, k + m);
  Eigen::VectorXd score(k + m);
  for (Eigen::Index b = 0; b < k + m; ++b) {
    const Signature& at = signatures[static_cast<std::size_t>(b)];
    const Eigen::VectorXd projected = projector.project(at);
    score[b] = projector.score(at);
    for (Eigen::Index a = 0; a <= b; ++a)
      information(a, b) = information(b, a) =
          projector.inner(signatures[static_cast<std::size_t>(a)], projected, at);
  }
  Eigen::MatrixXd I = information.bottomRightCorner(m, m);
  Eigen::VectorXd slope = score.tail(m);
  if (k > 0) {
    Eigen::MatrixXd of_members = information.topLeftCorner(k, k);
    // A parameter that the calibration absorbs is known by its prior alone.
    of_members.diagonal() += Eigen::Map<const Eigen::VectorXd>(widths.data(), k).cwiseAbs2().cwiseInverse();
    const Eigen::MatrixXd share = of_members.ldlt().solve(information.topRightCorner(k, m));
    I -= information.bottomLeftCorner(m, k) * share;
    slope -= share.transpose() * score.head(k);
  }
  // In units of the prior: 1 + C^(1/2) I C^(1/2)
  const Eigen::VectorXd root = Eigen::Map<const Eigen::VectorXd>(variances.data(), m).cwiseSqrt();
  const Eigen::MatrixXd within = Eigen::MatrixXd::Identity(m, m) + root.asDiagonal() * I * root.asDiagonal();
  const Eigen::LLT<Eigen::MatrixXd> factor(within);
  if (factor.info() != Eigen::Success) return 0.0;
  const Eigen::MatrixXd L = factor.matrixL();
  const Eigen::VectorXd b = root.cwiseProduct(slope);
  const double gain = 0.5 * b.dot(factor.solve(b)) - L.diagonal().array().log().sum();
  if (!std::isfinite(gain)) return 0.0;
  const double w = priors.formula_is_off;
  return gain > 0.0 ? gain + std::log(w + (1.0 - w) * std::exp(-gain)) : std::log1p(w * std::expm1(gain));
}

}  // namespace rangecal::diagnosis
