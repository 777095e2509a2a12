// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/search.hpp"

#include <optional>
#include <utility>

#include "diagnosis/findings.hpp"
#include "diagnosis/grids.hpp"

namespace rangecal::diagnosis {
namespace {

/// Where the fit beside a grid of ranges starts: with the noise that the grid leaves of the repeats' scatter.
/// The solves come back to it by small steps only where the grid holds most of that.
JointState start_beside_grids(const Rows& rows, const Bookkeeping& known, JointState state) {
  if (!has_grid(known.model)) return state;
  const std::optional<Noise> noise = noise_within_cells(rows, known.model);
  if (noise && noise->law == state.noise.law) state.noise = *noise;
  return state;
}

}  // namespace

Fit fit_root(const Rows& rows, const Bookkeeping& known, const Fit& baseline, const RefitOptions& options) {
  if (known.model.empty()) return baseline;
  Fit root = refit(rows, known.model, start_beside_grids(rows, known, baseline.state), options);
  return root.ok ? root : baseline;
}

SearchResult scan_seed_model(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options,
                             RefitOptions& refit_options, std::optional<NoiseLaw> law) {
  const auto report = [&](const char* stage, double fraction) {
    if (options.progress) options.progress(stage, fraction);
  };
  SearchResult result;
  report("fitting the seed model", 0.0);
  result.baseline = fit_baseline(rows, options, refit_options, known.model, law);
  report("scanning the residuals", 0.1);
  result.first = std::make_unique<Battery>(rows, Model{}, result.baseline.state);
  result.first->calibrate(options.null_draws, 1);
  result.rates = result.first->rates;
  result.alarm_p = result.first->alarm_p();
  result.shapes = findings(rows, *result.first, options.alarm_rate);
  result.known = known;
  return result;
}

}  // namespace rangecal::diagnosis
