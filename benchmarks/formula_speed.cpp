// SPDX-License-Identifier: BSD-3-Clause
// What an effect by formula costs beside the built-in effect that it was printed from (`rangecal effects --as-yaml ID`): nanoseconds of one
// evaluation of the change, and of its slopes in all parameters, of a thousand readings; milliseconds of a diagnosis of a recording with
// that effect forced, the fastest of five.
//
//   formula_speed notebooks_data/concealed/world-11

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "rangecal/core/files.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace {

using namespace rangecal;

constexpr std::size_t readings = 1000;
constexpr int passes = 300;

EffectContext usual_context() {
  EffectContext context;
  context.stop_count = 20, context.landmark_count = 6;
  context.landmark_labels = {"a", "b", "c", "d", "e", "f"};
  context.landmark_radius_m.assign(6, 0.05);
  context.commanded.resize(20);
  context.path_m.resize(20);
  context.stop_time_s.resize(20);
  context.duration_s = 3600.0;
  context.range_min_m = 0.3, context.range_max_m = 6.0;
  return context;
}

std::vector<ReadingView<double>> usual_views(const EffectContext& context) {
  Random random(seed_from("formula_speed"));
  std::vector<ReadingView<double>> views(readings);
  for (ReadingView<double>& at : views) {
    at.d = random.uniform(0.3, 6.0), at.axis_distance = at.d + 0.05;
    at.bearing = random.uniform(-3.1, 3.1);
    at.f = 1.02 * at.d, at.slope = 1.02, at.curvature = 0.0, at.spread = 0.01, at.spread_power = 2;
    at.radius = 0.05, at.heading = random.uniform(-3.1, 3.1);
    at.time = random.uniform(0.0, 1.0), at.time_s = 3600.0 * at.time;
    at.context = &context;
  }
  return views;
}

template <typename Work>
double nanoseconds(const Work& work) {
  double least = 1e300;
  for (int pass = 0; pass < passes; ++pass) {
    const auto start = std::chrono::steady_clock::now();
    work();
    least = std::min(least, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return least * 1e9 / static_cast<double>(readings);
}

/// One evaluation of the change, and of all slopes as fits take them: by the effect's own formula, else by central differences.
std::pair<double, double> cost_of(const Effect& effect, const std::vector<ReadingView<double>>& views) {
  const EffectInfo& info = effect.info();
  Eigen::VectorXd p(static_cast<Eigen::Index>(info.parameters.size()));
  for (std::size_t i = 0; i < info.parameters.size(); ++i)
    p[static_cast<Eigen::Index>(i)] = info.parameters[i].typical;
  double sum = 0.0;
  const auto add = [&](const ReadingChange<double>& c) {
    sum += c.range + c.bearing + c.range_log_variance + c.bearing_log_variance;
  };
  const double change = nanoseconds([&] {
    for (const ReadingView<double>& at : views) add(effect.reading(at, p.data()));
  });
  const double slopes = nanoseconds([&] {
    for (std::size_t i = 0; i < info.parameters.size(); ++i) {
      if (info.parameters[i].discrete) continue;
      const auto j = static_cast<Eigen::Index>(i);
      const double h = difference_step(info.parameters[i], p[j]);
      Eigen::VectorXd up = p, down = p;
      up[j] += h, down[j] -= h;
      for (const ReadingView<double>& at : views) {
        if (const auto own = effect.slope(at, p.data(), static_cast<int>(i))) {
          add(*own);
        } else {
          add(effect.reading(at, up.data()));
          add(effect.reading(at, down.data()));
        }
      }
    }
  });
  if (!std::isfinite(sum)) fmt::print("{}: not finite\n", info.id);
  return {change, slopes};
}

double milliseconds_with(const std::string& id, const Recording& recording) {
  DiagnoseOptions options;
  options.force = {{id}};
  options.held_out = options.unseen = options.next_experiments = false;
  double least = 1e300;
  for (int pass = 0; pass < 5; ++pass) {
    const auto start = std::chrono::steady_clock::now();
    diagnose({&recording, 1}, options);
    least = std::min(least, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return 1e3 * least;
}

/// Those of the catalogue that are formulas, as effects of a user's own; their files are gone afterwards.
void add_all_as_formulas() {
  const std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("formula_speed." + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  for (const Effect* effect : known_effects())
    if (const std::string yaml = as_formula(*effect); !yaml.empty())
      write_file((folder / (effect->info().id + ".yaml")).string(), yaml);
  add_effects_by_formula(folder.string());
  std::filesystem::remove_all(folder);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    fmt::print(stderr, "usage: formula_speed RECORDING\n");
    return 2;
  }
  const Recording recording = load_recording(argv[1]);
  const EffectContext context = usual_context();
  const std::vector<ReadingView<double>> views = usual_views(context);
  const std::vector<const Effect*> catalogue = known_effects();
  add_all_as_formulas();
  fmt::print("{:<22}{:>10}{:>9}{:>7}{:>10}{:>9}{:>7}{:>10}{:>9}{:>7}\n", "", "change ns", "formula", "ratio",
             "slopes ns", "formula", "ratio", "fit ms", "formula", "ratio");
  const auto pair = [](double built_in, double formula) {
    return fmt::format("{:>10.1f}{:>9.1f}{:>7.2f}", built_in, formula, formula / built_in);
  };
  for (const Effect* built_in : catalogue) {
    const Effect* formula = find_effect("my_" + built_in->info().id);
    if (formula == nullptr || !built_in->missing(context).empty()) continue;
    const auto [change, slopes] = cost_of(*built_in, views);
    const auto [own_change, own_slopes] = cost_of(*formula, views);
    fmt::print("{:<22}{}{}{}\n", built_in->info().id, pair(change, own_change), pair(slopes, own_slopes),
               pair(milliseconds_with(built_in->info().id, recording),
                    milliseconds_with(formula->info().id, recording)));
  }
}
