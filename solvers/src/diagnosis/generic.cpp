// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/generic.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <utility>

#include "diagnosis/findings.hpp"
#include "rangecal/core/symmetric_eigen.hpp"

namespace rangecal::diagnosis {
namespace {

bool grouped(const std::string& covariate) { return covariate == "landmark" || covariate == "stop"; }

/// Score and information of the functions of a basis under the seed model, the calibration projected out.
struct Scored {
  Eigen::VectorXd score;
  Eigen::MatrixXd information;
};

Scored score_of(const Rows& rows, const Projector& projector, CurveChannel channel, const Eigen::VectorXd& x,
                const CurveBasis& basis) {
  const Eigen::Index n = x.size(), size = basis.size();
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(n);
  Scored scored{Eigen::VectorXd(size), Eigen::MatrixXd(size, size)};
  std::vector<Signature> signatures;
  std::vector<Eigen::VectorXd> projected, variance;
  for (Eigen::Index k = 0; k < size; ++k) {
    const Eigen::VectorXd unit = Eigen::VectorXd::Unit(size, k);
    Eigen::VectorXd shape = x.unaryExpr([&](double v) { return basis.value(v, unit); });
    if (is_mean(channel)) {
      signatures.push_back(channel == CurveChannel::range ? projector.of_rows(shape, none)
                                                          : projector.of_rows(none, shape));
      projected.push_back(projector.project(signatures.back()));
      scored.score[k] = projector.score(signatures.back());
    } else {
      shape.array() -= shape.mean();
      double sum = 0.0;
      for (Eigen::Index i = 0; i < n; ++i) {
        const int c = rows.cell[i];
        const double range = projector.range_residual[c] + projector.row_range_residual[i];
        const double bearing = projector.bearing_residual[c] + projector.row_bearing_residual[i];
        sum += shape[i] * (channel == CurveChannel::range_noise
                               ? range * range * projector.row_range_information[i]
                               : bearing * bearing * projector.row_bearing_information[i]);
      }
      scored.score[k] = 0.5 * sum;
      variance.push_back(std::move(shape));
    }
  }
  for (Eigen::Index a = 0; a < size; ++a)
    for (Eigen::Index b = 0; b <= a; ++b)
      scored.information(a, b) = scored.information(b, a) =
          variance.empty() ? projector.inner(signatures[a], projected[b], signatures[b])
                           : 0.5 * variance[a].dot(variance[b]);
  return scored;
}

/// What the calibration leaves of a basis: directions with a tenth of a per mille of the largest information
/// or more.
struct Reduced {
  Eigen::MatrixXd directions;
  double gain = 0.0, penalised = -std::numeric_limits<double>::infinity();
};

Reduced reduce(const Scored& scored, double price) {
  const SymmetricEigen eigen = symmetric_eigen(scored.information);
  const double largest = eigen.values.tail(1)[0];
  Reduced reduced;
  std::vector<Eigen::Index> kept;
  for (Eigen::Index j = 0; j < eigen.values.size(); ++j) {
    if (!(eigen.values[j] > 1e-4 * largest)) continue;
    const double z = eigen.vectors.col(j).dot(scored.score);
    reduced.gain += 0.5 * z * z / eigen.values[j];
    kept.push_back(j);
  }
  reduced.directions = eigen.vectors(Eigen::all, kept);
  if (!kept.empty()) reduced.penalised = reduced.gain - price * static_cast<double>(kept.size());
  return reduced;
}

std::vector<CurveBasis> bases(const Question& finding, const Eigen::VectorXd& x) {
  std::vector<double> sorted;
  for (double v : x)
    if (std::isfinite(v)) sorted.push_back(v);
  std::sort(sorted.begin(), sorted.end());
  if (sorted.empty()) return {};
  std::vector<CurveBasis> candidates;
  const double span = sorted.back() - sorted.front();
  if (finding.shape == "periodic" && span > 0.0)
    for (int k = 1; k <= 120; ++k) {
      candidates.emplace_back();
      candidates.back().wavenumber = std::numbers::pi * k / span;
    }
  const std::set<double> distinct(sorted.begin(), sorted.end());
  if (grouped(finding.covariate) || distinct.size() <= 4) {
    CurveBasis basis;
    basis.groups = true;
    basis.knots.assign(distinct.begin(), distinct.end());
    if (!finding.group.empty() || basis.knots.size() <= 60) candidates.push_back(basis);
  }
  if (finding.covariate == "landmark") return candidates;
  for (int count : {3, 4, 6, 9, 14, 22}) {
    CurveBasis basis;
    basis.knots = knots_at_equal_shares(sorted, count);
    if (basis.knots.size() >= 2) candidates.push_back(basis);
  }
  return candidates;
}

}  // namespace

std::vector<Eigen::MatrixXd> directions_left(const Rows& rows, const Projector& projector,
                                             CurveChannel channel, const Eigen::VectorXd& x,
                                             const CurveBasis& basis,
                                             const std::vector<Eigen::MatrixXd>& roots) {
  const Scored scored = score_of(rows, projector, channel, x, basis);
  std::vector<Eigen::MatrixXd> left;
  for (const Eigen::MatrixXd& root : roots)
    left.push_back(
        root * reduce({root.transpose() * scored.score, root.transpose() * scored.information * root}, 0.0)
                   .directions);
  return left;
}

std::optional<CurveFit> fit_curve(const Rows& rows, const Projector& projector, const Fit& base,
                                  const Question& question, const RefitOptions& options) {
  const CurveChannel channel = curve_channel_of(question.channel);
  const CovariateOf covariate = covariate_of(rows, question.covariate);
  if (channel == CurveChannel::none || !covariate) return std::nullopt;
  const double price = price_of_curve_parameter(rows);
  const Eigen::VectorXd x = values_along(rows, projector.geometry(), covariate);
  Reduced best;
  CurveBasis chosen;
  std::vector<CurveBasis> candidates = bases(question, x);
  std::erase_if(candidates, [&](const CurveBasis& basis) { return !has_cells_for(rows, basis); });
  for (const CurveBasis& basis : candidates) {
    const Reduced reduced = reduce(score_of(rows, projector, channel, x, basis), price);
    if (reduced.penalised > best.penalised) {
      best = reduced;
      chosen = basis;
    }
  }
  if (!(best.gain > 0.0) || best.directions.cols() == 0) return std::nullopt;
  const double typical = is_mean(channel) ? 0.01 : 0.5;
  CurveFit curve;
  curve.channel = channel;
  curve.effect = std::make_shared<GenericEffect>(channel, question.channel, question.covariate, covariate,
                                                 chosen, best.directions, typical);
  constexpr double sizes = 3.0;
  curve.effect->choices = sizes * static_cast<double>(candidates.size());
  Model completed = base.model;
  completed.push_back({curve.effect.get(), Eigen::VectorXd::Zero(best.directions.cols())});
  curve.fit = refit(rows, completed, base.state, options);
  if (!curve.fit.ok || curve.fit.nll > base.nll) return std::nullopt;
  return curve;
}

GenericModel fit_generic_model(const Rows& rows, const SearchResult& found, const RefitOptions& options) {
  GenericModel model;
  const Battery& battery = found.partly() ? *found.last : *found.first;
  const Fit& base = found.partly() ? found.best.fit : found.baseline;
  for (const Question& finding :
       found.partly() ? found.left : found.shapes) {  // the first finding that a curve can correct
    std::optional<CurveFit> fitted = fit_curve(rows, battery.projector(), base, finding, options);
    if (!fitted) continue;
    const GenericEffect& effect = *fitted->effect;
    const CurveChannel channel = fitted->channel;
    model.effect = fitted->effect;
    model.fit = std::move(fitted->fit);
    GenericCurve& curve = model.curve;
    curve.gain = base.nll - model.fit.nll;
    const Eigen::VectorXd values = effect.directions() * model.fit.model.back().parameters;
    const Eigen::Index size = effect.directions().cols();
    const Eigen::MatrixXd covariance = effect.directions() *
                                       model.fit.covariance.bottomRightCorner(size, size) *
                                       effect.directions().transpose();
    const Eigen::VectorXd std_dev = covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
    curve.knots = effect.basis().knots;
    curve.values.assign(values.begin(), values.end());
    curve.std_dev.assign(std_dev.begin(), std_dev.end());
    const RowChanges changes =
        row_changes(rows, cell_geometry(rows, model.fit.state), {model.fit.model.back()});
    curve.row_change = channel == CurveChannel::range         ? changes.range
                       : channel == CurveChannel::bearing     ? changes.bearing
                       : channel == CurveChannel::range_noise ? changes.range_log_variance
                                                              : changes.bearing_log_variance;
    break;
  }
  return model;
}

}  // namespace rangecal::diagnosis
