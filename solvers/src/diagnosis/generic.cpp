// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/generic.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <set>
#include <utility>

#include "rangecal/core/symmetric_eigen.hpp"

namespace rangecal::diagnosis {
namespace {

using Covariate = std::function<double(const ReadingView<double>&)>;

/// The value of a covariate of docs/formats.md at a reading; empty if it is none.
Covariate covariate_of(const Rows& rows, const std::string& name) {
  if (name == "range") return [](const auto& at) { return at.d; };
  if (name == "disparity") return [](const auto& at) { return 1.0 / at.d; };
  if (name == "sensor_bearing") return [](const auto& at) { return at.bearing; };
  if (name == "heading") return [](const auto& at) { return at.heading; };
  if (name == "time") return [](const auto& at) { return at.time_s; };
  if (name == "stop") return [](const auto& at) { return static_cast<double>(at.stop); };
  if (name == "repeat") return [](const auto& at) { return static_cast<double>(at.repeat); };
  if (name == "landmark") return [](const auto& at) { return static_cast<double>(at.landmark); };
  if (name == "radius") return [](const auto& at) { return at.radius; };
  if (name == "constant") return [](const auto&) { return 1.0; };
  const auto& names = rows.context.covariates;
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) return {};
  return [column = found - names.begin()](const auto& at) { return at.covariate[column]; };
}

enum class Channel { range, bearing, range_noise, bearing_noise, none };

Channel channel_of(const std::string& name) {
  if (name == "range") return Channel::range;
  if (name == "bearing") return Channel::bearing;
  if (name == "range_noise") return Channel::range_noise;
  if (name == "bearing_noise") return Channel::bearing_noise;
  return Channel::none;
}

bool grouped(const std::string& covariate) { return covariate == "landmark" || covariate == "stop"; }

/// Functions of the covariate that the curve is made of.
struct Basis {
  std::vector<double> knots;
  bool groups = false;
  double wavenumber = 0.0;  ///< > 0: cosine and sine instead of hats

  Eigen::Index size() const { return wavenumber > 0.0 ? 2 : static_cast<Eigen::Index>(knots.size()); }

  /// Value at x of the curve with coefficients c; nothing where x is missing.
  double value(double x, const Eigen::VectorXd& c) const {
    if (!std::isfinite(x)) return 0.0;
    if (wavenumber > 0.0) return c[0] * std::cos(wavenumber * x) + c[1] * std::sin(wavenumber * x);
    const auto above = std::lower_bound(knots.begin(), knots.end(), x);
    const auto j = above - knots.begin();
    if (groups) return above != knots.end() && *above == x ? c[j] : 0.0;
    if (above == knots.begin()) return c[0];
    if (above == knots.end()) return c[c.size() - 1];
    const double share = (x - knots[j - 1]) / (knots[j] - knots[j - 1]);
    return (1.0 - share) * c[j - 1] + share * c[j];
  }
};

class GenericEffect final : public Effect {
 public:
  GenericEffect(Channel channel, const Question& question, Covariate covariate, Basis basis,
                Eigen::MatrixXd directions, double typical)
      : channel_(channel),
        covariate_(std::move(covariate)),
        basis_(std::move(basis)),
        directions_(std::move(directions)) {
    info_.id = "generic";
    info_.kind =
        channel == Channel::range || channel == Channel::bearing ? EffectKind::mean : EffectKind::noise;
    info_.channel = question.channel;
    info_.covariate = question.covariate;
    info_.physics = "A smooth correction of " + question.channel + " against " + question.covariate +
                    ", of unknown cause.";
    unit_ = channel == Channel::range ? "m" : channel == Channel::bearing ? "rad" : "log_variance";
    for (Eigen::Index j = 0; j < directions_.cols(); ++j)
      info_.parameters.push_back({.name = fmt::format("c{}_{}", j + 1, unit_),
                                  .typical = typical,
                                  .low = -1e3 * typical,
                                  .high = 1e3 * typical});
  }

  const EffectInfo& info() const override { return info_; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const Eigen::VectorXd c = coefficients(p);
    const double change = basis_.value(covariate_(at), c);
    switch (channel_) {
      case Channel::range:
        return {.range = change};
      case Channel::bearing:
        return {.bearing = change};
      case Channel::range_noise:
        return {.range_log_variance = change};
      case Channel::bearing_noise:
        return {.bearing_log_variance = change};
      case Channel::none:
        break;
    }
    return {};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    const Eigen::VectorXd c = coefficients(p);
    std::vector<std::pair<std::string, double>> values;
    for (Eigen::Index k = 0; k < c.size(); ++k)
      values.emplace_back(basis_.wavenumber > 0.0
                              ? fmt::format("{}_at_wavenumber_{:.4g}_{}", k == 0 ? "cosine" : "sine",
                                            basis_.wavenumber, unit_)
                              : fmt::format("at_{:.4g}_{}", basis_.knots[static_cast<std::size_t>(k)], unit_),
                          c[k]);
    return values;
  }

  const Basis& basis() const { return basis_; }
  const Eigen::MatrixXd& directions() const { return directions_; }

 private:
  Eigen::VectorXd coefficients(const double* p) const {
    return directions_ * Eigen::Map<const Eigen::VectorXd>(p, directions_.cols());
  }

  Channel channel_;
  Covariate covariate_;
  Basis basis_;
  Eigen::MatrixXd directions_;
  EffectInfo info_;
  std::string unit_;
};

/// Score and information of the functions of a basis under the seed model, the calibration projected out.
struct Scored {
  Eigen::VectorXd score;
  Eigen::MatrixXd information;
};

Scored score_of(const Rows& rows, const Projector& projector, Channel channel, const Eigen::VectorXd& x,
                const Basis& basis) {
  const Eigen::Index n = x.size(), size = basis.size();
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(n);
  Scored scored{Eigen::VectorXd(size), Eigen::MatrixXd(size, size)};
  std::vector<Signature> signatures;
  std::vector<Eigen::VectorXd> projected, variance;
  for (Eigen::Index k = 0; k < size; ++k) {
    const Eigen::VectorXd unit = Eigen::VectorXd::Unit(size, k);
    Eigen::VectorXd shape = x.unaryExpr([&](double v) { return basis.value(v, unit); });
    if (channel == Channel::range || channel == Channel::bearing) {
      signatures.push_back(channel == Channel::range ? projector.of_rows(shape, none)
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
        sum += shape[i] * (channel == Channel::range_noise
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

std::vector<Basis> bases(const Question& finding, const Eigen::VectorXd& x) {
  std::vector<double> sorted;
  for (double v : x)
    if (std::isfinite(v)) sorted.push_back(v);
  std::sort(sorted.begin(), sorted.end());
  if (sorted.empty()) return {};
  std::vector<Basis> candidates;
  const double span = sorted.back() - sorted.front();
  if (finding.shape == "periodic" && span > 0.0)
    for (int k = 1; k <= 120; ++k) {
      candidates.emplace_back();
      candidates.back().wavenumber = std::numbers::pi * k / span;
    }
  const std::set<double> distinct(sorted.begin(), sorted.end());
  if (grouped(finding.covariate) || distinct.size() <= 4) {
    Basis basis;
    basis.groups = true;
    basis.knots.assign(distinct.begin(), distinct.end());
    if (!finding.group.empty() || basis.knots.size() <= 60) candidates.push_back(basis);
  }
  if (finding.covariate == "landmark") return candidates;
  for (int count : {3, 4, 6, 9, 14, 22}) {
    Basis basis;
    for (int j = 0; j < count; ++j) {
      const double v = sorted[static_cast<std::size_t>(
          std::lround((static_cast<double>(sorted.size()) - 1.0) * j / (count - 1.0)))];
      if (basis.knots.empty() || v > basis.knots.back() + 1e-9 * span) basis.knots.push_back(v);
    }
    if (basis.knots.size() >= 2) candidates.push_back(basis);
  }
  return candidates;
}

}  // namespace

GenericModel fit_generic_model(const Rows& rows, const SearchResult& found, const RefitOptions& options) {
  GenericModel model;
  const Battery& battery = found.partial ? *found.last : *found.first;
  const Fit& base = found.partial ? found.best.fit : found.baseline;
  const Projector& projector = battery.projector();
  const double price = 0.5 * std::log(std::max(10.0, 2.0 * rows.cell_count));
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  for (const Question& finding :
       found.partial ? found.left : found.shapes) {  // the first finding that a curve can correct
    const Channel channel = channel_of(finding.channel);
    const Covariate covariate = covariate_of(rows, finding.covariate);
    if (channel == Channel::none || !covariate) continue;
    Eigen::VectorXd x(n);
    for (Eigen::Index i = 0; i < n; ++i)
      x[i] = covariate(view_of(rows, projector.geometry(), static_cast<std::size_t>(i)));
    Reduced best;
    Basis chosen;
    for (const Basis& basis : bases(finding, x)) {
      const Reduced reduced = reduce(score_of(rows, projector, channel, x, basis), price);
      if (reduced.penalised > best.penalised) {
        best = reduced;
        chosen = basis;
      }
    }
    if (!(best.gain > 0.0) || best.directions.cols() == 0) continue;
    const double typical = channel == Channel::range || channel == Channel::bearing ? 0.01 : 0.5;
    const auto effect =
        std::make_shared<GenericEffect>(channel, finding, covariate, chosen, best.directions, typical);
    Model completed = base.model;
    completed.push_back({effect.get(), Eigen::VectorXd::Zero(best.directions.cols())});
    Fit fit = refit(rows, completed, base.state, options);
    if (!fit.ok || fit.nll > base.nll) continue;
    model.effect = effect;
    model.fit = std::move(fit);
    GenericCurve& curve = model.curve;
    curve.gain = base.nll - model.fit.nll;
    const Eigen::VectorXd values = effect->directions() * model.fit.model.back().parameters;
    const Eigen::MatrixXd covariance =
        effect->directions() *
        model.fit.covariance.bottomRightCorner(best.directions.cols(), best.directions.cols()) *
        effect->directions().transpose();
    const Eigen::VectorXd std_dev = covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
    curve.knots = effect->basis().knots;
    curve.values.assign(values.begin(), values.end());
    curve.std_dev.assign(std_dev.begin(), std_dev.end());
    const RowChanges changes =
        row_changes(rows, cell_geometry(rows, model.fit.state), {model.fit.model.back()});
    curve.row_change = channel == Channel::range         ? changes.range
                       : channel == Channel::bearing     ? changes.bearing
                       : channel == Channel::range_noise ? changes.range_log_variance
                                                         : changes.bearing_log_variance;
    break;
  }
  return model;
}

}  // namespace rangecal::diagnosis
