// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/whole_fleet.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include "fleet/fingerprint.hpp"
#include "fleet/oddities.hpp"
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

void put_population(Database& database, const Population& population) {
  Statement row = database.prepare("INSERT INTO population VALUES(?, ?, ?, ?)");
  for (Eigen::Index i = 0; i < population.mean.size(); ++i)
    row.bind(1, i <= population.order ? fmt::format("alpha_{}", i) : std::string("log_sigma"))
        .bind(2, population.mean[i])
        .bind(3, std::sqrt(population.mean_covariance(i, i)))
        .bind(4, std::sqrt(population.covariance(i, i)))
        .run();
}

void put_posteriors(Database& database, const FleetJob& job, const FleetJudge& judge, FleetResult& result) {
  const Population& population = result.population;
  const int n = job.order;
  std::string marks = "?";
  for (int i = 1; i < 6 + 2 * (n + 1); ++i) marks += ", ?";
  Statement posterior = database.prepare("INSERT INTO posteriors VALUES(" + marks + ")");
  Statement odd = database.prepare("INSERT OR REPLACE INTO oddities VALUES(?, ?, ?, ?, ?, ?)");
  Statement rows = database.prepare(
      "SELECT name, kind, used, shape_p, shape_m, tail_p, kurtosis, dependence_p, correlation, theta, information, identity"
      " FROM units LEFT JOIN inputs USING(name) ORDER BY name");
  const double limit =
      job.alarm_rate /
      (4.0 * static_cast<double>(std::max<std::int64_t>(result.units, 1)));  // four questions a unit
  std::size_t index = 0;
  while (rows.step()) {
    const std::string name = rows.text(0);
    VectorXd mean, deviation;
    double distance = std::nan(""), p_value = std::nan("");
    const bool own = rows.vector(9).size() > 0;
    std::string source = own ? "own readings and population" : "few readings and population";
    if (own) {
      const UnitSummary summary = summary_in(rows, 9, job);
      const UnitPosterior shrunk = shrink(summary, population);
      mean = shrunk.mean;
      deviation = shrunk.covariance.diagonal().cwiseSqrt();
      const UnitJudgement judged = judge(summary, index++);
      distance = judged.distance_sq;
      p_value = judged.p_value;
      if (p_value < limit) {  // the population says nothing of a unit that is none of it
        source = "own readings, unlike the others";
        mean = summary.theta;
        deviation = summary.information.inverse().diagonal().cwiseSqrt();
        Eigen::Index worst = 0;
        judged.t.cwiseAbs().maxCoeff(&worst);
        odd.bind(1, name)
            .bind(2, "unlike the others: " +
                         (worst <= n ? fmt::format("alpha_{}", worst) : std::string("sigma")))
            .bind(3, judged.t[worst])
            .bind(4, std::string("standard deviations"))
            .bind(5, p_value)
            .bind(6, difference_in_words(summary.theta - population.mean, judged.t))
            .run();
      }
      const auto ask = [&](int column, const std::string& what, const std::string& unit, auto&& words) {
        const double p = rows.number(column).value_or(1.0),
                     size = rows.number(column + 1).value_or(std::nan(""));
        if (p < limit)
          odd.bind(1, name).bind(2, what).bind(3, size).bind(4, unit).bind(5, p).bind(6, words(size)).run();
      };
      ask(3, "shape of the curve", "m",
          [](double m) { return fmt::format("two orders more move the curve by up to {:.3g} mm", 1e3 * m); });
      ask(5, "tails of the noise", "excess kurtosis", [](double k) {
        return fmt::format("tails {} than normal: excess kurtosis {:+.2g}", k > 0.0 ? "heavier" : "lighter",
                           k);
      });
      ask(7, "dependence of neighbours", "correlation", [](double r) {
        return fmt::format("neighbouring readings depend on each other: correlation {:+.2g}", r);
      });
    } else if (rows.text(1) == "pairs" && rows.number(2).value_or(0.0) > 0.0) {  // too few readings alone
      std::optional<Recording> recording;
      try {
        recording = load_recording(place_of(name, rows.text(11)));
      } catch (const InputError& error) {  // it was there when its readings were counted
        result.notes.push_back(name + " is left out: " + error.what());
        continue;
      }
      const Calibration fit = calibrate_in_population(make_pairs_problem({&*recording, 1}), population);
      if (fit.outcome != Outcome::converged) continue;
      mean.resize(n + 2);
      deviation.resize(n + 2);
      mean << fit.alpha, std::log(fit.noise.parameters[0]);
      deviation << fit.alpha_covariance->diagonal().cwiseSqrt(),
          *fit.noise_estimates[0].std_dev / fit.noise.parameters[0];
      ++result.by_population;
    } else {
      continue;
    }
    int at = 0;
    const auto put = [&](const auto& value) { posterior.bind(++at, value); };
    put(name);
    put(source);
    for (int i = 0; i <= n; ++i) {
      put(mean[i]);
      put(deviation[i]);
    }
    for (const double value : {std::exp(mean[n + 1]), deviation[n + 1], distance, p_value}) put(value);
    posterior.run();
  }
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
    put_posteriors(database, job, FleetJudge(stream, population), result);
  }
  database.execute("COMMIT");
  if (is_usable(population.outcome)) explain_oddities(database, job, result);
}

}  // namespace rangecal::app
