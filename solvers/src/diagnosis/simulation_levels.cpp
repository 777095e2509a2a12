// SPDX-License-Identifier: BSD-3-Clause
// What a simulation's curve and noise levels say by themselves, whatever else differs.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "diagnosis/location.hpp"
#include "diagnosis/simulation_compare.hpp"
#include "rangecal/core/distributions.hpp"

namespace rangecal::diagnosis {

/// Nats that a further name for the difference of two curves has to earn, p = 3e-4: less may be the first
/// one's formula.
constexpr double curve_price = 6.5;

std::vector<std::string> curve_mismatch(const Rows& rows, const Bookkeeping& known, const SearchResult& found,
                                        const DiagnoseOptions& options) {
  Rows own = rows;
  own.alpha_prior.reset();
  DiagnoseOptions alone = options;
  alone.simulation.reset();
  alone.progress = nullptr;
  RefitOptions unused;
  if (scan_seed_model(own, known, alone, unused).alarm_p < alone.alarm_rate || !known.model.empty())
    return {};
  const std::vector<std::string> curve = {"range_offset", "range_scale", "laser_pointing"};
  std::vector<std::string> best;
  double lowest = found.baseline.nll;
  for (unsigned set = 1; set < 8; ++set) {
    Model model;
    std::vector<std::string> ids;
    for (unsigned j = 0; j < 3; ++j) {
      if (!(set >> j & 1u)) continue;
      const Effect* effect = find_effect(curve[j]);
      if (!effect) continue;
      ids.push_back(curve[j]);
      model.push_back({effect, effect->start_grid(rows.context).front()});
    }
    const Fit fit = refit(rows, model, found.baseline.state, RefitOptions{});
    const double value = fit.nll + curve_price * static_cast<double>(ids.size());
    if (!fit.ok || !(value < lowest)) continue;
    lowest = value;
    best = ids;
  }
  return best;
}

namespace {

/// One channel's noise in the recordings and in the simulation.
struct NoiseLevels {
  const char *channel, *parameter;
  Estimate own, held;

  bool known() const { return own.std_dev && own.value > 0.0 && held.value > 0.0; }
  double log_ratio() const { return std::log(own.value / held.value); }
  double z() const {
    const double sigma = std::hypot(*own.std_dev / own.value, held.std_dev.value_or(0.0) / held.value);
    return std::abs(log_ratio()) / std::max(sigma, 1e-9);
  }
};

std::vector<NoiseLevels> noise_levels(const Calibration& simulation, const Calibration& own) {
  std::vector<NoiseLevels> levels;
  if (own.noise.law == simulation.noise.law && own.noise_estimates.size() == 1 &&
      simulation.noise.parameters.size() == 1) {
    const Estimate held = simulation.noise_estimates.size() == 1
                              ? simulation.noise_estimates[0]
                              : Estimate{simulation.noise.parameters[0], std::nullopt};
    levels.push_back({"range_noise", "sigma_e", own.noise_estimates[0], held});
  }
  if (own.sigma_theta_rad && simulation.sigma_theta_rad)
    levels.push_back({"bearing_noise", "sigma_theta", *own.sigma_theta_rad, *simulation.sigma_theta_rad});
  std::erase_if(levels, [](const NoiseLevels& level) { return !level.known(); });
  return levels;
}

}  // namespace

void compare_noise(const Calibration& simulation, const Calibration& own, Diagnosis& result) {
  constexpr double least_z = 3.5;
  const std::vector<NoiseLevels> levels = noise_levels(simulation, own);
  for (const NoiseLevels& level : levels) {
    if (level.z() < least_z) continue;
    Finding f;
    f.channel = level.channel;
    f.covariate = "constant";
    f.shape = "level";
    f.size = 2.0 * level.log_ratio();
    // Two-sided, times the number of levels compared.
    f.set_log_p(std::min(
        0.0, log_chi_sq_survival(level.z() * level.z(), 1) + std::log(static_cast<double>(levels.size()))));
    f.effects = {"generic"};
    f.everywhere = "it is asked of all readings alike";
    result.location.push_back(f);
    order_location(result.location);
    result.notes.push_back(
        fmt::format("the recordings' {} is {:.3g} times the simulation's: {:.4g} against {:.4g}",
                    level.parameter, level.own.value / level.held.value, level.own.value, level.held.value));
    if (result.verdict != Verdict::no_mismatch) continue;
    result.verdict = Verdict::unexplained;
    result.final_effects = {"generic"};
    Explanation explanation;
    explanation.effects = {"generic"};
    explanation.probability = 1.0;
    explanation.nll = result.after.nll;
    explanation.p_value = f.p_value;
    explanation.physics =
        "The noise of the recordings has another level than the simulation's; set the simulator's spread to "
        "it.";
    result.explanations.push_back(explanation);
  }
}

}  // namespace rangecal::diagnosis
