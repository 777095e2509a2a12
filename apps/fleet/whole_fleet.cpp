// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/whole_fleet.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <optional>

#include "fleet/fingerprint.hpp"
#include "fleet/oddities.hpp"
#include "fleet/units.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/solvers/fleet/judgement.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

namespace rangecal::app {
namespace {

using Eigen::VectorXd;

UnitSummary summary_in(const Statement& row, int column, const FleetJob& job) {
  const VectorXd theta = row.vector(column), information = row.vector(column + 1);
  const Eigen::Index p = job.order + 2;
  if (theta.size() != p || information.size() != p * p)
    throw InputError(job.output + ": a unit's theta is not of order " + std::to_string(job.order));
  return {theta, information.reshaped(p, p)};
}

/// What outliers the fleet has: the family of most readings among the units that have one, with the means of its
/// parameters, the share over the readings of all units.
NoiseShapeParameters shape_of_fleet(Database& database) {
  std::map<NoiseShape, double> readings;
  std::map<NoiseShape, NoiseShapeParameters> sums;
  double all = 0.0;
  Statement rows =
      database.prepare("SELECT noise_shape, used FROM units WHERE theta IS NOT NULL ORDER BY name");
  while (rows.step()) {
    const NoiseShapeParameters shape = shape_from_json(rows.text(0));
    const double used = rows.number(1).value_or(0.0);
    all += used;
    if (shape.shape == NoiseShape::gaussian) continue;
    NoiseShapeParameters& sum =
        sums.try_emplace(shape.shape, NoiseShapeParameters{shape.shape, 0.0, 0.0, 0.0, 0.0}).first->second;
    readings[shape.shape] += used;
    sum.nu += used * shape.nu;
    sum.outlier_share += used * shape.outlier_share;
    sum.outlier_scale += used * shape.outlier_scale;
    sum.outlier_mean += used * shape.outlier_mean;
  }
  if (readings.empty()) return {};
  const auto [family, most] = *std::max_element(
      readings.begin(), readings.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  NoiseShapeParameters shape = sums[family];
  shape.nu /= most;
  shape.outlier_scale /= most;
  shape.outlier_mean /= most;
  shape.outlier_share /= all;
  return shape;
}

void put_population(Database& database, const Population& population) {
  Statement row = database.prepare("INSERT INTO population VALUES(?, ?, ?, ?)");
  for (Eigen::Index i = 0; i < population.mean.size(); ++i)
    row.bind(1, i <= population.order ? fmt::format("alpha_{}", i) : std::string("log_sigma"))
        .bind(2, population.mean[i])
        .bind(3, std::sqrt(population.mean_covariance(i, i)))
        .bind(4, std::sqrt(population.covariance(i, i)))
        .run();
}

/// What is told of a unit's theta.
struct Told {
  std::string source;
  VectorXd mean, deviation;
  double distance_sq = std::nan(""), p_value = std::nan("");  ///< beside the others, of its own readings
};

/// The rows of posteriors, and those of oddities, from the units in the order of their names.
class PosteriorRows {
 public:
  PosteriorRows(Database& database, const FleetJob& job, const FleetJudge& judge, FleetResult& result)
      : job_(job),
        judge_(judge),
        result_(result),
        limit_(job.alarm_rate / (questions * static_cast<double>(std::max<std::int64_t>(result.units, 1)))),
        tails_are_common_(
            2 * database.count("SELECT count(*) FROM units WHERE theta IS NOT NULL AND noise_shape <> ''") >
            database.count("SELECT count(*) FROM units WHERE theta IS NOT NULL")),
        units_(database.prepare(
            "SELECT name, kind, used, shape_p, shape_m, tail_p, kurtosis, dependence_p, correlation, theta, information, identity"
            " FROM units LEFT JOIN inputs USING(name) ORDER BY name")),
        posterior_(database.prepare("INSERT INTO posteriors VALUES(" + marks(6 + 2 * (job.order + 1)) + ")")),
        odd_(database.prepare("INSERT OR REPLACE INTO oddities VALUES(?, ?, ?, ?, ?, ?)")) {}

  void put() {
    while (units_.step()) {
      const bool own = units_.vector(theta).size() > 0;
      if (const std::optional<Told> told = own ? of_own_readings() : of_few_readings()) put(*told);
    }
  }

 private:
  enum Column {  ///< of units_
    name,
    kind,
    used,
    shape_p,
    shape_m,
    tail_p,
    kurtosis,
    dependence_p,
    correlation,
    theta,
    information,
    identity
  };
  static constexpr double questions = 4.0;  ///< of each unit

  static std::string marks(int count) {
    std::string text = "?";
    for (int i = 1; i < count; ++i) text += ", ?";
    return text;
  }

  Told of_own_readings();
  std::optional<Told> of_few_readings();
  void put_unlike(const UnitSummary& summary, const UnitJudgement& judged);
  void put_misfits();
  template <typename Words>
  void put_misfit(int p_column, const std::string& what, const std::string& unit, const Words& words);
  void put(const Told& told);

  const FleetJob& job_;
  const FleetJudge& judge_;
  FleetResult& result_;
  double limit_;           ///< p-value below which a unit is odd
  bool tails_are_common_;  ///< most units have a noise shape of their own
  Statement units_, posterior_, odd_;
  std::size_t index_ = 0;  ///< among the units of own readings
};

/// A unit of readings enough: drawn to the population, unless it is none of it; its oddities are put down.
Told PosteriorRows::of_own_readings() {
  const UnitSummary summary = summary_in(units_, theta, job_);
  const UnitPosterior shrunk = shrink(summary, result_.population);
  const UnitJudgement judged = judge_(summary, index_++);
  Told told{"own readings and population", shrunk.mean, shrunk.covariance.diagonal().cwiseSqrt(),
            judged.distance_sq, judged.p_value};
  if (judged.p_value < limit_) {  // the population says nothing of a unit that is none of it
    told.source = "own readings, unlike the others";
    told.mean = summary.theta;
    told.deviation = summary.information.inverse().diagonal().cwiseSqrt();
    put_unlike(summary, judged);
  }
  put_misfits();
  return told;
}

/// A unit with too few readings to be fitted alone; nothing where it is no unit of pairs, or cannot be read.
std::optional<Told> PosteriorRows::of_few_readings() {
  if (units_.text(kind) != "pairs" || !(units_.number(used).value_or(0.0) > 0.0)) return std::nullopt;
  const std::string unit = units_.text(name);
  std::optional<Recording> recording;
  try {
    recording = load_recording(place_of(unit, units_.text(identity)));
  } catch (const InputError& error) {  // it was there when its readings were counted
    result_.notes.push_back(unit + " is left out: " + error.what());
    return std::nullopt;
  }
  const Calibration fit = calibrate_in_population(make_pairs_problem({&*recording, 1}), result_.population);
  if (fit.outcome != Outcome::converged) return std::nullopt;
  Told told{"few readings and population", VectorXd(job_.order + 2), VectorXd(job_.order + 2)};
  told.mean << fit.alpha, std::log(fit.noise.parameters[0]);
  told.deviation << fit.alpha_covariance->diagonal().cwiseSqrt(),
      *fit.noise_estimates[0].std_dev / fit.noise.parameters[0];
  ++result_.by_population;
  return told;
}

/// The oddity of a unit that is none of the population: the coordinate of theta that is furthest off.
void PosteriorRows::put_unlike(const UnitSummary& summary, const UnitJudgement& judged) {
  Eigen::Index worst = 0;
  judged.t.cwiseAbs().maxCoeff(&worst);
  const std::string what = worst <= job_.order ? fmt::format("alpha_{}", worst) : std::string("sigma");
  odd_.bind(1, units_.text(name))
      .bind(2, "unlike the others: " + what)
      .bind(3, judged.t[worst])
      .bind(4, std::string("standard deviations"))
      .bind(5, judged.p_value)
      .bind(6, difference_in_words(summary.theta - result_.population.mean, judged.t))
      .run();
}

/// The oddities of a unit's own residuals.
void PosteriorRows::put_misfits() {
  put_misfit(shape_p, "shape of the curve", "m", [](double m) {
    return fmt::format("two orders more move the curve by up to {:.3g} mm", 1e3 * m);
  });
  if (!tails_are_common_)
    put_misfit(tail_p, "tails of the noise", "excess kurtosis", [](double k) {
      return fmt::format("tails {} than normal: excess kurtosis {:+.2g}", k > 0.0 ? "heavier" : "lighter", k);
    });
  put_misfit(dependence_p, "dependence of neighbours", "correlation", [](double r) {
    return fmt::format("neighbouring readings depend on each other: correlation {:+.2g}", r);
  });
}

/// One of them: its p-value stands in `p_column`, its size behind it.
template <typename Words>
void PosteriorRows::put_misfit(int p_column, const std::string& what, const std::string& unit,
                               const Words& words) {
  const double p = units_.number(p_column).value_or(1.0),
               size = units_.number(p_column + 1).value_or(std::nan(""));
  if (p < limit_)
    odd_.bind(1, units_.text(name))
        .bind(2, what)
        .bind(3, size)
        .bind(4, unit)
        .bind(5, p)
        .bind(6, words(size))
        .run();
}

void PosteriorRows::put(const Told& told) {
  int at = 0;
  const auto bind = [&](const auto& value) { posterior_.bind(++at, value); };
  bind(units_.text(name));
  bind(told.source);
  for (Eigen::Index i = 0; i <= job_.order; ++i) {
    bind(told.mean[i]);
    bind(told.deviation[i]);
  }
  const Eigen::Index noise = job_.order + 1;
  for (const double value :
       {std::exp(told.mean[noise]), told.deviation[noise], told.distance_sq, told.p_value})
    bind(value);
  posterior_.run();
}

}  // namespace

void fit_whole(Database& database, const FleetJob& job, FleetResult& result) {
  const UnitStream stream = [&](const std::function<void(const UnitSummary&)>& visit) {
    Statement rows =
        database.prepare("SELECT theta, information FROM units WHERE theta IS NOT NULL ORDER BY name");
    while (rows.step()) visit(summary_in(rows, 0, job));
  };
  Population& population = result.population;
  population = fit_population(stream);
  population.order = job.order;
  population.law = job.law;
  population.shape = shape_of_fleet(database);
  {
    Statement range =
        database.prepare("SELECT min(range_min_m), max(range_max_m) FROM units WHERE theta IS NOT NULL");
    range.step();
    population.range_min_m = range.number(0).value_or(0.0);
    population.range_max_m = range.number(1).value_or(0.0);
  }
  database.execute(
      "BEGIN; DELETE FROM posteriors; DELETE FROM oddities; DELETE FROM meta WHERE key = 'population'; DROP TABLE IF EXISTS population;"
      "CREATE TABLE population(parameter TEXT PRIMARY KEY, mean REAL, mean_std REAL, std REAL) WITHOUT ROWID");
  database.prepare("INSERT INTO meta VALUES('population', ?)").bind(1, population_to_json(population)).run();
  if (is_usable(population.outcome)) {
    put_population(database, population);
    const FleetJudge judge(stream, population);
    PosteriorRows(database, job, judge, result).put();
  }
  database.execute("COMMIT");
  if (is_usable(population.outcome)) explain_oddities(database, job, result);
}

}  // namespace rangecal::app
