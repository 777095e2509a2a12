// SPDX-License-Identifier: BSD-3-Clause
// What to record next where distances are known. 25 batches of 20 readings from 0.4 to 4 m, one time for each, 20 s apart:
// time and distance rise together. f = 0.05 + 0.9 d + 0.05 d^2, s = 0.002 f^2.
#include <gtest/gtest.h>

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "diagnosis/extended_design.hpp"
#include "diagnosis/next_experiments.hpp"
#include "diagnosis/settled_by.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double sigma_of_pairs = 0.002;

double reading_at(double d) { return 0.05 + d * (0.9 + 0.05 * d); }

/// 2 cm with a time constant of two minutes.
double creep_m(double time_s) { return 0.02 * -std::expm1(-time_s / 120.0); }

void add_pair(Recording& recording, int batch, double d, double time_s, double reading_m) {
  Pairs& p = recording.pairs;
  p.batch.push_back(batch);
  p.true_m.push_back(d);
  p.time_s.push_back(time_s);
  p.reading_m.push_back(reading_m);
  p.row.push_back(static_cast<int>(p.row.size()) + 2);
  while (static_cast<int>(p.batch_labels.size()) <= batch)
    p.batch_labels.push_back(std::to_string(p.batch_labels.size()));
}

/// The design; readings with noise, and with or without the creep, where a random source is given.
Recording rising(Random* random, bool creeps) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  for (int k = 0; k < 25; ++k) {
    const double d = 0.4 + 3.6 * k / 24.0, f = reading_at(d), time_s = 20.0 * k;
    for (int i = 0; i < 20; ++i)
      add_pair(
          recording, k, d, time_s,
          f + (creeps ? creep_m(time_s) : 0.0) + (random ? sigma_of_pairs * f * f * random->normal() : 0.0));
  }
  return recording;
}

/// The estimate at the truth: every cell at an exact stop of its own.
JointState truth_of_pairs(const Rows& rows) {
  JointState state;
  state.alpha = Eigen::Vector3d(0.05, 0.9, 0.05);
  state.noise.law = NoiseLaw::f_squared;
  state.noise.parameters = Eigen::VectorXd::Constant(1, sigma_of_pairs);
  state.sigma_theta_rad = 1.0;
  state.landmarks = {Eigen::Vector2d::Zero()};
  for (const StopPrior& prior : rows.problem.stops) state.stops.push_back(prior.commanded);
  return state;
}

/// What least squares leaves of x: each reading weighed by its spread, the columns taken out.
double left_of(const Eigen::VectorXd& x, const Eigen::MatrixXd& columns, const Eigen::VectorXd& spread) {
  const Eigen::VectorXd unit = spread.cwiseInverse(), y = unit.cwiseProduct(x);
  const Eigen::MatrixXd J = unit.asDiagonal() * columns;
  return (y - J * J.colPivHouseholderQr().solve(y)).squaredNorm();
}

TEST(PairsNext, TheOrderIsChangedWhereTimeAndDistanceRiseTogether) {
  const Recording recording = rising(nullptr, false);
  const Rows rows = make_rows({&recording, 1});
  const JointState state = truth_of_pairs(rows);
  const ActiveEffect drift{find_effect("warmup_drift"), Eigen::Vector3d(0.02, 0.0, 120.0)};
  const ActiveEffect lens{find_effect("lens_distortion"), Eigen::VectorXd::Constant(1, -0.0024)};
  // By dense least squares over single readings, from the two formulas.
  const auto noncentrality = [&](const std::vector<double>& d, const std::vector<double>& t) {
    const auto n = static_cast<Eigen::Index>(d.size());
    const Eigen::ArrayXd D = Eigen::Map<const Eigen::ArrayXd>(d.data(), n);
    const Eigen::ArrayXd u = Eigen::Map<const Eigen::ArrayXd>(t.data(), n) / 120.0, risen = 1.0 - (-u).exp();
    const Eigen::ArrayXd f = 0.05 + D * (0.9 + 0.05 * D);
    Eigen::MatrixXd of_drift(n, 6), of_lens(n, 4);
    of_drift << Eigen::ArrayXd::Ones(n), D, D.square(), risen, D.square() * risen, u * (-u).exp();
    of_lens << Eigen::ArrayXd::Ones(n), D, D.square(), D.inverse();
    const Eigen::VectorXd spread = sigma_of_pairs * f.square();
    return std::min(left_of(-0.0024 * D.inverse(), of_drift, spread), left_of(0.02 * risen, of_lens, spread));
  };
  EXPECT_LT(noncentrality(recording.pairs.true_m, recording.pairs.time_s), 1.0);  // here they are one
  const ExtendedDesign extended = extend(rows, state, "random order");
  ASSERT_EQ(extended.rows.size(), 2 * rows.size());
  const std::vector<double> cell_d = cell_geometry(extended.rows, extended.state).d;
  std::vector<double> d;
  for (int cell : extended.rows.cell) d.push_back(cell_d[static_cast<std::size_t>(cell)]);
  const double lambda = noncentrality(d, extended.rows.time_s);
  // Twice the log likelihood ratio is N(lambda, 4 lambda), to exceed 2 * 3 nats.
  const double power = 0.5 * std::erfc(-(lambda - 6.0) / std::sqrt(8.0 * lambda));
  EXPECT_GT(power, 0.95);
  const Space after(extended.rows, {}, extended.state);
  const double left =
      after.left(after.change({lens}), {after.slope(drift, 0), after.slope(drift, 1), after.slope(drift, 2)});
  EXPECT_NEAR(left, lambda, 1e-4 * lambda);  // of differences over the time constant

  SearchResult found;
  found.verdict = Verdict::explained;
  found.best.fit.model = {drift};
  found.rivals.resize(1);
  found.rivals[0].fit.model = {lens};
  Diagnosis result;
  result.explanations.resize(1);
  result.explanations[0].effects = {"warmup_drift"};
  result.explanations[0].indistinguishable_from = {{"lens_distortion"}};
  DiagnoseOptions options;
  options.unseen = false;
  const Space space(rows, found.best.fit.model, state);
  add_next_experiments(space, found, options, state, {}, result);
  ASSERT_FALSE(result.next_experiments.empty());
  const NextExperiment& first = result.next_experiments.front();
  EXPECT_EQ(first.code, "random order");
  EXPECT_EQ(first.change, "read the same distances once more in random order");
  EXPECT_EQ(first.settles, (std::vector<std::string>{"warmup_drift", "lens_distortion"}));
  EXPECT_NEAR(first.power, power, 1e-3);
  EXPECT_EQ(result.explanations[0].separated_by, first.change);
  for (const NextExperiment& next : result.next_experiments)  // the same order again tells nothing
    EXPECT_NE(next.code, "another day");
}

TEST(PairsNext, WhatIsProposedFirstSettlesTheSet) {
  Random random(seed_from("PairsNext.Monotone", {1}));
  Recording recording = rising(&random, true);
  DiagnoseOptions options;
  options.held_out = options.unseen = false;
  const Diagnosis before = diagnose({&recording, 1}, options);
  ASSERT_EQ(before.verdict, Verdict::explained);
  const Explanation& explanation = before.explanations.at(0);
  ASSERT_GE(explanation.indistinguishable_from.size(), 1u) << before.sentence;
  ASSERT_FALSE(before.next_experiments.empty()) << explanation.separated_by;
  const NextExperiment& first = before.next_experiments.front();
  EXPECT_GT(first.power, 0.5) << first.change;
  // A period that fits the steps is among the causes: only other distances tell it.
  EXPECT_EQ(first.code, "denser");
  const Rows rows = make_rows({&recording, 1});
  const ExtendedDesign extended = extend(rows, truth_of_pairs(rows), first.code);
  const std::vector<double> d = cell_geometry(extended.rows, extended.state).d;
  for (std::size_t i = 0; i < extended.rows.size(); ++i) {
    const int cell = extended.rows.cell[i];
    if (cell < rows.cell_count) continue;
    const double at = d[static_cast<std::size_t>(cell)], f = reading_at(at);
    const double time_s = extended.rows.time_s[i];
    add_pair(recording, cell, at, time_s, f + creep_m(time_s) + sigma_of_pairs * f * f * random.normal());
  }
  const Diagnosis after = diagnose({&recording, 1}, options);
  ASSERT_EQ(after.verdict, Verdict::explained) << after.sentence;
  EXPECT_EQ(after.final_effects, std::vector<std::string>{"warmup_drift"}) << after.sentence;
  EXPECT_TRUE(after.explanations.at(0).indistinguishable_from.empty());
}

TEST(PairsNext, WhereNothingSeparatesItSaysSo) {
  // A straight curve, f' = 0.98 everywhere: one target's known distance off by dR, or its reading by c = -0.98 dR, are the
  // same at any distance.
  Random random(seed_from("PairsNext.OneTargetIsOff", {0}));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  for (const char* label : {"a", "b", "c"}) {
    Landmark target;
    target.label = label;
    recording.landmarks.push_back(target);
  }
  int batch = 0;
  for (int k = 0; k < 12; ++k)
    for (int target = 0; target < 3; ++target, ++batch)
      for (int i = 0; i < 10; ++i) {
        const double d = 0.5 + 3.5 * k / 11.0;
        add_pair(recording, batch, d, 0.0,
                 0.02 + 0.98 * d + (target == 1 ? 0.006 : 0.0) + random.normal(0.0, 0.004));
        recording.pairs.landmark.push_back(target);
      }
  recording.pairs.time_s.clear();
  DiagnoseOptions options;
  options.held_out = false;
  const Diagnosis d = diagnose({&recording, 1}, options);
  ASSERT_EQ(d.verdict, Verdict::explained) << d.sentence;
  const Explanation& explanation = d.explanations.at(0);
  ASSERT_EQ(explanation.indistinguishable_from.size(), 1u) << d.sentence;
  EXPECT_EQ(explanation.separated_by, "no change on the menu separates them");
  for (const NextExperiment& next : d.next_experiments)
    for (const char* id : {"target_reflectance", "landmark_radius"})
      EXPECT_EQ(std::count(next.settles.begin(), next.settles.end(), id), 0) << next.change;
}

TEST(PairsNext, AColumnThatAChangeTakesIsNamed) {
  Random random(seed_from("PairsNext.Columns", {}));
  Recording recording = rising(&random, false);
  recording.pairs.time_s.clear();
  DiagnoseOptions options;
  options.held_out = false;
  const Diagnosis d = diagnose({&recording, 1}, options);
  const auto brings = [&](const char* id, const char* column) {
    return std::any_of(d.next_experiments.begin(), d.next_experiments.end(), [&](const NextExperiment& next) {
      return std::count(next.settles.begin(), next.settles.end(), id) > 0 &&
             next.change.find("with a column " + std::string(column) + ", which this recording lacks") !=
                 std::string::npos;
    });
  };
  EXPECT_TRUE(brings("warmup_drift", "time_s"));
  EXPECT_TRUE(brings("target_reflectance", "landmark"));
  EXPECT_TRUE(brings("range_scale", "temperature_c"));
  EXPECT_TRUE(brings("range_eccentricity", "bearing_rad"));
  for (const NextExperiment& next : d.next_experiments) {
    EXPECT_EQ(std::count(next.settles.begin(), next.settles.end(), "range_offset"), 0)
        << next.change;  // it is alpha_0
    EXPECT_GE(next.power, 0.1);
    EXPECT_LE(next.power, 1.0);
  }
}

TEST(PairsNext, WhatSettlesAnEffectIsSaidOfTargetsAtKnownDistances) {
  Recording recording = rising(nullptr, false);
  for (const char* label : {"a", "b"}) {
    Landmark target;
    target.label = label;
    target.radius_m = 0.05;
    recording.landmarks.push_back(target);
  }
  for (std::size_t i = 0; i < recording.pairs.size(); ++i) {
    recording.pairs.landmark.push_back(recording.pairs.batch[i] % 2);
    recording.pairs.bearing_rad.push_back(2.0 * std::sin(static_cast<double>(i)));
  }
  const Rows rows = make_rows({&recording, 1});
  std::vector<std::string> menu;
  for (const MenuEntry& entry : menu_for(rows)) menu.push_back(entry.change);
  int asked = 0;
  for (const Effect* effect : effects_of(rows.context)) {
    if (!effect->missing(rows.context).empty()) continue;
    ++asked;
    const std::string words = settled_by(rows, *effect);
    for (const char* word : {"stop", "landmark", "sweep", "path", "robot", "heading"})
      EXPECT_EQ(words.find(word), std::string::npos) << effect->info().id << ": " << words;
    if (effect->info().id == "range_eccentricity" || effect->info().id == "reciprocal_noise") {
      EXPECT_EQ(std::count(menu.begin(), menu.end(), words), 1) << words;
    }
  }
  EXPECT_GE(asked, 15);
  EXPECT_EQ(settled_by(rows, *find_effect("warmup_drift")),
            "let the sensor cool down, then record the same distances in random order");
  Rows of_stops = rows;
  of_stops.pairs = false;
  EXPECT_EQ(settled_by(of_stops, *find_effect("warmup_drift")),
            find_effect("warmup_drift")->info().settled_by);
}

TEST(PairsNext, SensorsThatReadLessFartherAwayAreAskedToo) {
  // y = 6 m - d, as of a sensor that counts down; without times the new run stands alone.
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "falling";
  Random random(seed_from("PairsNext.Falling"));
  for (int i = 0; i < 120; ++i) {
    const double d = 0.5 + 0.25 * (i % 12);
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(random.normal(6.0 - d, 0.005));
  }
  const Diagnosis found = diagnose(std::span(&recording, 1));
  EXPECT_TRUE(std::isfinite(found.after.nll));
}

TEST(PairsNext, AnExtendedDesignKeepsWhatIsThere) {
  const Recording recording = rising(nullptr, false);
  const Rows rows = make_rows({&recording, 1});
  const JointState state = truth_of_pairs(rows);
  for (const MenuEntry& entry : menu_for(rows)) {
    const ExtendedDesign extended = extend(rows, state, entry.code);
    ASSERT_GE(extended.rows.size(), rows.size()) << entry.change;
    ASSERT_EQ(extended.state.stops.size(), extended.rows.problem.stops.size()) << entry.change;
    const CellGeometry g = cell_geometry(extended.rows, extended.state);
    for (std::size_t i = 0; i < extended.rows.size(); ++i) {
      const auto cell = static_cast<std::size_t>(extended.rows.cell[i]);
      EXPECT_NEAR(extended.rows.range_m[i], reading_at(g.d[cell]), 1e-12) << entry.change;
      if (i >= rows.size()) continue;
      EXPECT_EQ(extended.rows.cell[i], rows.cell[i]) << entry.change;
      EXPECT_EQ(extended.rows.time_s[i], rows.time_s[i]) << entry.change;
      EXPECT_DOUBLE_EQ(g.d[cell], recording.pairs.true_m[i]) << entry.change;
    }
  }
  EXPECT_THROW(extend(rows, state, "E3"), std::invalid_argument);  // no landmarks to tape
}

}  // namespace
}  // namespace rangecal::diagnosis
