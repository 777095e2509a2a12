// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "commands.hpp"
#include "diagnosis_text.hpp"
#include "each/each_job.hpp"
#include "ingest/bags/diagnosis_mcap.hpp"
#include "job_options.hpp"
#include "mpi_program.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "report/report.hpp"
#include "simulator_export.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

struct DiagnoseCommand {
  std::vector<std::string> recordings, force, without, group_by, effects;
  std::string simulation, json, calibration, report, mcap, trace, laws, patch, curve = "auto";
  double alarm_rate = 0.02;
  EachJob each;

  int run() const {
    if (!each.output.empty()) return run_each_apart();
    if (!each.page.empty() || each.threads != 0) throw InputError("--page and --threads are of --each");
    DiagnoseOptions options;
    options.alarm_rate = alarm_rate;
    if (!force.empty()) options.force = force;
    options.without = without;
    options.check();
    if (!trace.empty() && !force.empty())
      throw InputError("--trace: with --force nothing is searched, so there is nothing to trace");
    if (!report.empty()) report::require_available();
    require_writable({json, report, calibration, mcap, trace});
    require_apart({json, report, calibration, mcap, trace}, inputs());
    if (!mcap.empty()) require_place_for_file(mcap);
    if (!patch.empty()) require_patchable();
    const std::vector<Recording> loaded = load_recordings(recordings, {group_by});
    require_columns_of_formulas(loaded);
    if (curve != "auto") options.curve = curve_family_from_string(curve);
    std::vector<TriedSet> tried;
    options.laws = !laws.empty();
    if (!trace.empty()) options.trace = [&](const TriedSet& set) { tried.push_back(set); };
    if (::isatty(STDERR_FILENO)) options.progress = show_progress;
    const Diagnosis diagnosis = against(loaded, options);
    if (!json.empty()) write_file(json, diagnosis_to_json(diagnosis));
    if (!trace.empty()) write_file(trace, trace_to_json(tried));
    if (!report.empty()) write_file(report, report::diagnosis_page(loaded, diagnosis));
    if (!mcap.empty()) ingest::write_diagnosis_mcap(loaded, diagnosis, mcap);
    if (!laws.empty()) write_laws(diagnosis);
    if (!calibration.empty()) save_calibrations({diagnosis.corrected}, calibration);
    if (!patch.empty()) write_patch(diagnosis);
    fmt::print("{}\n\n{}", describe(loaded), diagnosis_text(diagnosis));
    say_what_is_next(diagnosis);
    return determined(diagnosis) ? done : not_delivered;
  }

 private:
  /// How the answer is put to use, where there is one that was not written down.
  void say_what_is_next(const Diagnosis& diagnosis) const {
    const bool named =
        diagnosis.verdict == Verdict::explained || diagnosis.verdict == Verdict::partly_explained;
    if (!named || !simulation.empty() || !determined(diagnosis)) return;
    const std::string file = calibration.empty() ? "completed.json" : calibration;
    fmt::print("\nNext\n");
    if (calibration.empty())
      fmt::print("  the same command with --calibration {} keeps the calibration with what was found\n",
                 file);
    fmt::print("  rangecal correct {} readings.csv  undoes its curve and effects in new readings\n", file);
  }

  int run_each_apart() const {
    for (const auto& [option, given] : {std::pair("--simulation", &simulation),
                                        {"--json", &json},
                                        {"--calibration", &calibration},
                                        {"--report", &report},
                                        {"--mcap", &mcap},
                                        {"--trace", &trace},
                                        {"--laws", &laws},
                                        {"--patch", &patch}})
      if (!given->empty())
        throw InputError(std::string(option) + " is of one diagnosis, and --each makes many");
    EachJob job = each;
    job.inputs = recordings, job.group_by = group_by, job.force = force, job.without = without;
    job.curve = curve, job.alarm_rate = alarm_rate;
    if (started_by_mpirun()) become_mpi_program(words_of(job), "run it without mpirun");
    job.check();
    job.progress = ::isatty(STDERR_FILENO) != 0;
    const EachResult result = run_each(job);
    fmt::print("{}", describe(job, result));
    for (const std::string& note : result.notes) fmt::print(stderr, "rangecal: {}\n", note);
    return done;
  }

  /// The same command for the program that carries MPI.
  std::vector<std::string> words_of(const EachJob& job) const {
    std::vector<std::string> words{"diagnose"};
    words.insert(words.end(), job.inputs.begin(), job.inputs.end());
    words.insert(words.end(), {"--each", job.output, "--alarm-rate", fmt::format("{}", job.alarm_rate),
                               "--curve", job.curve, "--threads", std::to_string(job.threads)});
    if (!job.page.empty()) words.insert(words.end(), {"--page", job.page});
    for (const std::string& id : job.force) words.insert(words.end(), {"--force", id});
    for (const std::string& id : job.without) words.insert(words.end(), {"--without", id});
    for (const std::string& column : job.group_by) words.insert(words.end(), {"--group-by", column});
    for (const std::string& folder : effects) words.insert(words.end(), {"--effects", folder});
    return words;
  }

  /// A simulation's curve is given; else the recordings have to determine the one that stands by.
  bool determined(const Diagnosis& diagnosis) const {
    return !simulation.empty() || diagnosis.corrected.outcome != Outcome::unobservable ||
           has_answer(diagnosis.corrected);
  }

  void require_patchable() const {
    if (simulation.empty()) throw InputError("--patch: needs --simulation, which it is to repair");
    make_folder(patch);
    std::vector<std::string> outputs;
    for (const char* name : {"DistanceSensor.txt", "sensor.csv", "sensor.sdf", "sensor.urdf", "check.txt"})
      outputs.push_back((std::filesystem::path(patch) / name).string());
    require_apart(outputs, inputs());
    require_writable(outputs.back());
  }

  void write_patch(const Diagnosis& diagnosis) const {
    const auto files = simulator_patch(diagnosis, {simulation, 1e-3});
    if (files.empty())
      fmt::print(stderr, "rangecal: nothing is known to differ from the simulation: no patch is written\n");
    write_files(patch, files);
  }

  std::vector<std::string> inputs() const {
    std::vector<std::string> folders = recordings;
    if (!simulation.empty()) folders.push_back(simulation);
    std::vector<std::string> files = recording_files(folders);
    files.push_back(simulation);
    return files;
  }

  /// A file each, law_1.yaml the likeliest; those of a run before are gone.
  void write_laws(const Diagnosis& diagnosis) const {
    make_folder(laws);
    for (int number = 1; std::filesystem::remove(law_file(number)); ++number) {
    }
    int number = 0;
    for (const Law& law : diagnosis.laws) write_file(law_file(++number), law.text);
  }
  std::string law_file(int number) const {
    return (std::filesystem::path(laws) / fmt::format("law_{}.yaml", number)).string();
  }

  /// Throws InputError where the simulation is a recording that it is held against: that accounts for itself.
  void require_other_readings() const {
    namespace fs = std::filesystem;
    for (const std::string& folder : recordings)
      for (const char* table : reading_tables)
        if (std::error_code none;
            fs::equivalent(fs::path(folder) / table, fs::path(simulation) / table, none))
          throw InputError("--simulation " + simulation + ": holds the readings of " + folder +
                           " themselves, which it would account for whatever they are");
  }

  Diagnosis against(const std::vector<Recording>& loaded, DiagnoseOptions& options) const {
    if (simulation.empty()) return diagnose(loaded, options);
    if (std::filesystem::is_directory(simulation)) {
      require_other_readings();
      const std::vector<Recording> other{load_recording(simulation)};
      return diagnose_against(loaded, other, options);
    }
    options.simulation = load_calibration(simulation);
    if (!is_usable(options.simulation->outcome))
      throw InputError(simulation + ": its outcome is " + to_string(options.simulation->outcome) +
                       ", so nothing can be held against it");
    return diagnose(loaded, options);
  }

  static void show_progress(const std::string& stage, double fraction) {
    constexpr int width = 30;
    const int full = static_cast<int>(std::lround(width * fraction));
    fmt::print(stderr, "\r[{}{}] {:<36}", std::string(static_cast<std::size_t>(full), '#'),
               std::string(static_cast<std::size_t>(width - full), ' '), stage);
    if (fraction >= 1.0) fmt::print(stderr, "\r{:70}\r", "");
    std::fflush(stderr);
  }
};

}  // namespace

void add_diagnose(CLI::App& app, Action& chosen) {
  CLI::App* command =
      app.add_subcommand("diagnose", "find what the model leaves out, name the physics, complete the model");
  const auto state = std::make_shared<DiagnoseCommand>();
  command->add_option("REC", state->recordings, "recording folders of one sensor; with --each of any")
      ->required();
  command->add_option(
      "--simulation", state->simulation,
      "hold this against the recordings: a calibration file, or a recording made by a simulator");
  command->add_option("--json", state->json, "write the diagnosis to this file (rangecal-diagnosis/1)");
  command->add_option("--calibration", state->calibration,
                      "write the corrected calibration, effects in it, to this file");
  command->add_option("--report", state->report,
                      "write a report to look at to this file: one HTML page that needs no network");
  command->add_option(
      "--mcap", state->mcap,
      "write scans, landmarks, stops, residuals and the finding to this file for Foxglove, Lichtblick and "
      "PlotJuggler (docs/viewers.md)");
  command->add_option(
      "--patch", state->patch,
      "write to this folder what repairs the simulation, and a check by readings held out (docs/export.md)");
  command
      ->add_option("--alarm-rate", state->alarm_rate,
                   "false alarms per recording of the seed model, all questions together")
      ->capture_default_str();
  command
      ->add_option(
          "--curve", state->curve,
          "the seed model's curve, of pairs: polynomial in the distance d, polynomial in 1 / (d + c) (reciprocal), "
          "spline, or auto (the first, but where readings fall with distance the better of the first two by AIC)")
      ->capture_default_str();
  command
      ->add_option("--force", state->force,
                   "fit exactly these effects, whatever the residuals say; several as a,b or a b")
      ->delimiter(',');
  command
      ->add_option(
          "--without", state->without,
          "leave these effects out of the catalogue: what would be found without them? several as a,b or a b")
      ->delimiter(',');
  command
      ->add_option("--group-by", state->group_by,
                   "columns that say which readings belong together (trials, days, places), in place of the "
                   "recording's own: held out are whole groups; several as a,b or a b")
      ->delimiter(',');
  command->add_option(
      "--trace", state->trace,
      "write every set of causes that was fitted to this file (rangecal-trace/1): why was one not named?");
  add_effects_option(*command, &state->effects);
  state->each.add_to(*command);
  command->add_option(
      "--laws", state->laws,
      "look for formulas of what has no name, and write them to this folder as files for --effects, the "
      "likeliest first");
  command->footer(
      "Examples:\n"
      "  rangecal diagnose notebooks_data/field-layout\n"
      "  rangecal diagnose my-recording --json d.json --calibration cal.json && rangecal correct cal.json readings.csv\n"
      "  rangecal diagnose my-recording --mcap diagnosis.mcap      opens in Foxglove, Lichtblick and PlotJuggler\n"
      "  rangecal diagnose my-recording --simulation my-simulator-run\n"
      "  rangecal diagnose recordings/ --each found.db --page found.html\n"
      "  mpirun --enable-recovery -n 16 rangecal diagnose recordings/ --each found.db\n"
      "docs/diagnosis.md says what the verdicts mean. Exit code 1: the recording does not determine the curve.");
  command->callback([state, &chosen] { chosen = [state] { return state->run(); }; });
}

}  // namespace rangecal::app
