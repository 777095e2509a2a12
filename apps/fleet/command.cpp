// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/command.hpp"

#include <fmt/core.h>

#include <cmath>
#include <cstdio>
#include <filesystem>

#include "commands.hpp"
#include "numbers.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "shard.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

/// Throws InputError where the table would take the place of a file of a recording: of one that is named, or in a folder that
/// is. One folder at a time: there may be millions.
void keep_recordings(const std::string& csv, const std::vector<std::string>& inputs) {
  if (!file_exists(csv)) return;
  std::error_code none;
  for (const std::string& input : inputs) {
    require_apart({csv}, recording_files({input}));
    for (const auto& entry : std::filesystem::directory_iterator(input, none))
      require_apart({csv}, recording_files({entry.path().string()}));
  }
}

}  // namespace

void FleetCommand::prepare() {
  job.law = noise_law_from_string(noise);
  job.noise_shape = noise_shape_from_string(noise_shape);
  if (!has_sigma(job.law)) throw InputError("--noise polynomial has no one sigma for a population");
  const Shard part = shard_from(shard);
  job.share.shard = part.index;
  job.share.shards = part.count;
  if (job.inputs.empty() && job.merge.empty())
    throw InputError("fleet: neither recordings nor --merge are given");
  require_writable({job.output, job.csv});
  require_apart({job.output, job.csv}, job.merge);
  require_apart({job.output}, recording_files(job.inputs));
  keep_recordings(job.csv, job.inputs);
}

int FleetCommand::deliver(const FleetResult& result) const {
  fmt::print("{}", page(result));
  for (const std::string& note : result.notes) fmt::print(stderr, "rangecal: {}\n", note);
  return result.partial || is_usable(result.population.outcome) ? done : not_delivered;
}

std::string FleetCommand::page(const FleetResult& r) const {
  const std::int64_t unsolved = r.units - r.fitted - r.unreadable - r.few;
  std::string text = fmt::format(
      "Units        {} in {}: {} fitted, {} unreadable, {} with too few readings{}; {} were there already{}{}\n",
      r.units, job.output, r.fitted, r.unreadable, r.few,
      unsolved > 0 ? fmt::format(", {} without a solution", unsolved) : "", r.resumed,
      r.refitted > 0 ? fmt::format(", {} changed and fitted anew", r.refitted) : "",
      r.renewed > 0 ? fmt::format(", {} fitted anew (by another version before)", r.renewed) : "");
  if (r.partial)
    return text + fmt::format("Shard        {} of {}; --merge all of them to have the population\n",
                              job.share.shard + 1, job.share.shards);
  const Population& p = r.population;
  text += fmt::format("Population   {}{}{}, of {} units after {} passes; {} left out as unlike the others\n",
                      to_string(p.outcome), p.reason.empty() ? "" : ": ", p.reason, p.units, p.iterations,
                      p.left_out);
  if (!is_usable(p.outcome)) return text;
  text += "\n  parameter          mean                 std over units\n";
  for (Eigen::Index i = 0; i < p.mean.size(); ++i) {
    const bool noise_row = i > p.order;
    const double mean = noise_row ? std::exp(p.mean[i]) : p.mean[i], std_dev = std::sqrt(p.covariance(i, i)),
                 error = std::sqrt(p.mean_covariance(i, i)) * (noise_row ? mean : 1.0);
    text += fmt::format("  {:<12} {:>12.6f} +- {:<10.6f} {:>12}  {}\n",
                        noise_row ? "sigma" : fmt::format("alpha_{}", i), mean, error,
                        noise_row ? fmt::format("{:.1f} %", 100.0 * std_dev) : fmt::format("{:.6f}", std_dev),
                        noise_row ? law_unit(job.law, 0) : coefficient_unit(static_cast<int>(i)));
  }
  if (r.by_population > 0)
    text += fmt::format("\nFew readings {} too few of their own, calibrated with the population\n",
                        r.by_population == 1 ? "1 unit has" : fmt::format("{} units have", r.by_population));
  if (const std::int64_t rest = r.units - r.fitted - r.unreadable - r.by_population; rest > 0)
    text += fmt::format(
        "\nNo answer    {}; ask: sqlite3 {} 'SELECT name, outcome, reason FROM units WHERE theta IS NULL'\n",
        rest, job.output);
  text += fmt::format("\nOdd units    {}", r.odd);
  return text +
         (r.odd > 0 ? fmt::format("; ask: sqlite3 {} 'SELECT * FROM oddities ORDER BY p_value'\n", job.output)
                    : "\n");
}

CLI::App* declare_fleet(CLI::App& app, FleetCommand& given) {
  CLI::App* command =
      app.add_subcommand("fleet", "calibrate thousands of sensors of one make, and name the odd ones");
  command->add_option("REC", given.job.inputs, "recordings, one per sensor, or folders of them");
  command
      ->add_option("-o,--output", given.job.output,
                   "the SQLite file of results; a run that was stopped goes on in it")
      ->required();
  command->add_option("--order", given.job.order, "of f, the same for all")
      ->check(CLI::Range(0, 6))
      ->capture_default_str();
  command->add_option("--noise", given.noise, "noise law of all: constant, f, f2, f3, d2")
      ->capture_default_str();
  command
      ->add_option(
          "--noise-shape", given.noise_shape,
          "of each unit: auto (by AIC), gaussian, student-t, contaminated, one-sided (late or early echoes)")
      ->capture_default_str();
  command->add_option("--csv", given.job.csv, "write the units with their posteriors as a table");
  command
      ->add_option("--diagnose", given.job.diagnoses,
                   "at most so many odd units are diagnosed, the oddest first")
      ->check(not_negative())
      ->capture_default_str();
  command
      ->add_option("--alarm-rate", given.job.alarm_rate,
                   "probability that any unit of a faultless fleet is called odd")
      ->check(CLI::Range(1e-12, 0.5))
      ->capture_default_str();
  command->add_option("--threads", given.job.threads, "threads; 0: all. The results do not depend on it")
      ->check(not_negative())
      ->capture_default_str();
  command->add_option("--shard", given.shard,
                      "I/N: every N-th unit from the I-th on, into a file of its own");
  command->add_option("--merge", given.job.merge, "files of shards to be taken in");
  command->footer(
      "Each sensor has its own curve and noise; over the fleet they scatter about a mean. The scatter is estimated, each sensor's\n"
      "answer is drawn towards the mean by as much as its own readings leave open, and a sensor with a handful of readings is\n"
      "calibrated all the same. Tables: units, posteriors, oddities, population, meta (population as JSON).\n"
      "A unit that cannot be read has its reason in units.reason; the others go on. In a further run over the file, units whose\n"
      "recordings changed are fitted anew, those whose recordings are gone stay.\n"
      "\n"
      "Examples:\n"
      "  rangecal fleet sensors/ -o fleet.db --csv fleet.csv\n"
      "  sqlite3 fleet.db 'SELECT name, what, explanation FROM oddities ORDER BY p_value'\n"
      "  mpirun --enable-recovery -n 8 rangecal fleet sensors/ -o fleet.db\n"
      "  rangecal fleet sensors/ -o 2.db --shard 2/8      (with 1/8 .. 8/8, then: rangecal fleet --merge 1.db 2.db ... -o fleet.db)");
  return command;
}

}  // namespace rangecal::app
