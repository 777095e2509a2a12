// SPDX-License-Identifier: BSD-3-Clause
// Tails of readings whose cells share an error: the law of a tail is of what is left beside that error.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "diagnosis/subset.hpp"
#include "diagnosis/working.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/problems/tail_law.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double cell_sigma_m = 0.05, spread_m = 0.004, early_share = 0.1, reach_m = 0.1;

/// 40 distances, each read eight times: an error of 5 cm that a distance's readings share, noise of 4 mm, and one in ten too near.
Recording distances_with_errors_of_their_own() {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  Random random(seed_from("TailsBesideCells", {1}));
  for (int k = 0; k < 40; ++k) {
    const double d = 1.0 + 0.05 * k, shared = random.normal(0.0, cell_sigma_m);
    for (int i = 0; i < 8; ++i) {
      const double early = random.uniform() < early_share ? -reach_m * std::log(1.0 - random.uniform()) : 0.0;
      recording.pairs.true_m.push_back(d);
      recording.pairs.reading_m.push_back(d + shared + random.normal(0.0, spread_m) - early);
      recording.pairs.row.push_back(static_cast<int>(recording.pairs.row.size()) + 2);
    }
  }
  return recording;
}

ActiveEffect with(const char* id, std::vector<std::pair<const char*, double>> values) {
  const Effect* effect = find_effect(id);
  Eigen::VectorXd parameters(static_cast<Eigen::Index>(effect->info().parameters.size()));
  for (std::size_t j = 0; j < effect->info().parameters.size(); ++j)
    for (const auto& [name, value] : values)
      if (effect->info().parameters[j].name == name) parameters[static_cast<Eigen::Index>(j)] = value;
  return {effect, parameters};
}

/// -ln of the integral over the error that one distance's readings share, by the trapezoidal rule.
double nll_of_cell(const std::vector<double>& errors, const TailLaw& law) {
  const auto log_density = [&](double c) {
    double sum = -0.5 * std::pow(c / cell_sigma_m, 2) - std::log(cell_sigma_m) - half_log_two_pi;
    for (const double e : errors) sum += law.density(e - c, spread_m).value - std::log(spread_m);
    return sum;
  };
  constexpr double step = 1e-4, reach = 0.5;  // a fortieth of the noise; ten standard deviations
  double top = -std::numeric_limits<double>::infinity(), integral = 0.0;
  for (double c = -reach; c < reach; c += step) top = std::max(top, log_density(c));
  for (double c = -reach; c < reach; c += step) integral += step * std::exp(log_density(c) - top);
  return -top - std::log(integral);
}

TEST(TailsBesideCells, TheNllIsNextToTheIntegralOverWhatACellShares) {
  const testing::SeedFit seed(distances_with_errors_of_their_own());
  const Model model{with("cell_effect", {{"sigma_m", cell_sigma_m}}),
                    with("early_echo", {{"share", early_share}, {"reach_m", reach_m}})};
  JointState state = seed.fit.state;
  state.alpha = Eigen::Vector3d(0.0, 1.0, 0.0).head(state.alpha.size());
  state.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, spread_m)};
  const CellGeometry geometry = cell_geometry(seed.rows, state);
  double exact = 0.0;
  for (int c = 0; c < seed.rows.cell_count; ++c) {
    std::vector<double> errors;
    for (int i = seed.rows.cell_begin[static_cast<std::size_t>(c)];
         i < seed.rows.cell_begin[static_cast<std::size_t>(c) + 1]; ++i)
      errors.push_back(seed.rows.range_m[static_cast<std::size_t>(i)] -
                       geometry.f[static_cast<std::size_t>(c)]);
    exact += nll_of_cell(
        errors, tail_law_of(seed.rows, geometry, model,
                            static_cast<std::size_t>(seed.rows.cell_begin[static_cast<std::size_t>(c)])));
  }
  const double ours = nll_at(seed.rows, working_problem(seed.rows, model, state), state);
  EXPECT_NEAR(ours, exact, 0.1 * seed.rows.cell_count);  // Laplace's method: a tenth of a nat a cell
}

}  // namespace
}  // namespace rangecal::diagnosis
