// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/oddities.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "fleet/fingerprint.hpp"
#include "fleet/units.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

/// The population as a simulation: its mean curve, which its scatter may move.
Calibration population_curve(const FleetJob& job, const Population& population) {
  const Eigen::Index n = job.order + 1;
  Calibration typical;
  typical.kind = RecordingKind::pairs;
  typical.outcome = Outcome::converged;
  typical.alpha = population.mean.head(n);
  typical.alpha_covariance = population.covariance.topLeftCorner(n, n);
  typical.noise = {job.law, Eigen::VectorXd::Constant(1, std::exp(population.mean[n]))};
  typical.range_min_m = population.range_min_m;
  typical.range_max_m = population.range_max_m;
  return typical;
}

struct OddUnit {
  std::string name, place;
  bool unlike = false;  ///< the others, in theta
};

std::vector<OddUnit> oddest(Database& database, int count) {
  std::vector<OddUnit> units;
  Statement worst = database.prepare(
      "SELECT name, max(what LIKE 'unlike%'), identity FROM oddities LEFT JOIN inputs USING(name) GROUP BY name ORDER BY min(p_value), name LIMIT ?");
  worst.bind(1, std::int64_t{count});
  while (worst.step())
    units.push_back({worst.text(0), place_of(worst.text(0), worst.text(2)), worst.integer(1) != 0});
  return units;
}

/// Where the diagnosis, which takes the noise law from the recording, was about another model than the fleet's questions were.
std::string other_model(const Calibration& own, const FleetJob& job) {
  std::string text;
  if (own.order() != job.order)
    text += fmt::format(", by a curve of order {} where the fleet's is of order {}", own.order(), job.order);
  if (own.noise.law != job.law)
    text += fmt::format(", by the noise law {} where the fleet's is {}", to_string(own.noise.law),
                        to_string(job.law));
  return text;
}

/// " range_offset.offset_m 0.182 +- 0.010.": what the effects named are estimated at.
std::string estimates_in_words(const Diagnosis& diagnosis) {
  if (diagnosis.explanations.empty()) return "";
  std::string text;
  for (const EffectEstimate& e : diagnosis.explanations[0].parameters)
    if (std::isfinite(e.std_dev))
      text += fmt::format("{}{} {:.3g} +- {:.2g}", text.empty() ? " " : ", ", e.name, e.estimate, e.std_dev);
  return text.empty() ? text : text + ".";
}

std::string diagnosis_in_words(const OddUnit& unit, const Calibration& typical, const FleetJob& job) {
  try {
    const Recording recording = load_recording(unit.place);
    DiagnoseOptions options;
    options.held_out = options.unseen = options.next_experiments = false;
    if (unit.unlike && recording.kind == RecordingKind::pairs) {
      options.simulation = typical;
      const Diagnosis apart = diagnose({&recording, 1}, options);
      if (apart.verdict != Verdict::no_mismatch)
        return "beside the population's curve (sizes: what is left beyond the population's scatter): " +
               apart.sentence + estimates_in_words(apart);
      options.simulation.reset();
    }
    const Diagnosis own = diagnose({&recording, 1}, options);
    return "physics within its own recording: " + (own.verdict == Verdict::no_mismatch
                                                       ? "none found" + other_model(own.baseline, job)
                                                       : own.sentence);
  } catch (const std::exception& error) {
    return "not diagnosed: " + reason_of(error);
  }
}

/// "alpha_0 +72 mm", "alpha_1 +0.3", "alpha_2 -0.02 1/m".
std::string coefficient_in_words(Eigen::Index power, double difference) {
  if (power == 0) return fmt::format("alpha_0 {:+.3g} mm", 1e3 * difference);
  const std::string unit = coefficient_unit(static_cast<int>(power));
  return fmt::format("alpha_{} {:+.3g}{}{}", power, difference, unit.empty() ? "" : " ", unit);
}

}  // namespace

std::string difference_in_words(const Eigen::VectorXd& difference, const Eigen::VectorXd& t) {
  std::vector<Eigen::Index> order(static_cast<std::size_t>(t.size()));
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  std::sort(order.begin(), order.end(),
            [&t](Eigen::Index a, Eigen::Index b) { return std::abs(t[a]) > std::abs(t[b]); });
  const bool together = std::abs(t[order[0]]) < 3.0;
  std::string text = "calibration differs from the population's: ";
  if (together) text += "no parameter by 3 sd, ";
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Eigen::Index i = order[k];
    if (k > 0 && std::abs(t[i]) < 3.0) break;
    if (k > 0) text += ", ";
    const bool sigma = i + 1 == t.size();
    text += fmt::format("{} ({:+.1f} sd)",
                        sigma ? fmt::format("sigma {:+.3g} %", 100.0 * std::expm1(difference[i]))
                              : coefficient_in_words(i, difference[i]),
                        t[i]);
  }
  return text + (together ? " the furthest: their combination is odd" : "");
}

void explain_oddities(Database& database, const FleetJob& job, FleetResult& result) {
  result.odd = database.count("SELECT count(DISTINCT name) FROM oddities");
  const std::vector<OddUnit> units = oddest(database, job.diagnoses);
  const Calibration typical = population_curve(job, result.population);
  std::vector<std::string> words(units.size());
  tbb::parallel_for(std::size_t{0}, units.size(),
                    [&](std::size_t i) { words[i] = diagnosis_in_words(units[i], typical, job); });
  database.execute("BEGIN");
  for (std::size_t i = 0; i < units.size(); ++i)
    database.prepare("UPDATE oddities SET explanation = explanation || '; ' || ? WHERE name = ?")
        .bind(1, words[i])
        .bind(2, units[i].name)
        .run();
  database.execute("COMMIT");
}

}  // namespace rangecal::app
