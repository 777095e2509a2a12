// SPDX-License-Identifier: BSD-3-Clause
#include "fresh.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <map>
#include <mutex>

#include "journal.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/experiments.hpp"
#include "rangecal/solvers/diagnosis/simulation_model.hpp"
#include "twins.hpp"

namespace rangecal::proof {
namespace {

using Clock = std::chrono::steady_clock;

Diagnosis ask(const Diagnose& diagnose, const Recording& recording, const DiagnoseOptions& options,
              double& seconds) {
  const Clock::time_point begin = Clock::now();
  Diagnosis out = diagnose(std::span<const Recording>(&recording, 1), options);
  seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  return out;
}

/// Only what the row scores is asked for; the row for speed asks for all.
DiagnoseOptions options_for(const std::string& row) {
  DiagnoseOptions options;
  if (row == "speed") return options;
  options.held_out = row == "lambda-100" || row == "lambda-400";
  options.unseen = row == "absorbed" || row == "stated-sigma";
  options.next_experiments = row == "experiment";
  return options;
}

/// What the experiments of the menu do to the members of an answer, by the world: for each, the sets that it
/// leaves with less than what tells them from the truth.
std::map<std::string, std::vector<std::vector<std::string>>> left_by_menu(
    const Case& c, const std::vector<std::vector<std::string>>& sets) {
  std::map<std::string, std::vector<std::vector<std::string>>> left;
  for (const world::Experiment& experiment : world::experiments()) {
    const std::string code = experiment.code;
    if (code == "E7" || code == "E10" || code == "E11" || code == "E12")
      continue;  // they take effects away, or repeat
    const SeedModel model(world::carry_out(c.clean, code));
    const Signatures signatures(model, c.seed);
    const Signal signal = projected(model, world::carry_out(c.planted, code));
    const double linearisation = signatures.left(signal, c.truth);
    auto& twins = left[code];
    for (const std::vector<std::string>& set : sets)
      if (set == c.truth || signatures.left(signal, set) - linearisation < 14.0) twins.push_back(set);
  }
  return left;
}

/// Carries out what the diagnosis of a right twin set proposes. Good: the set shrinks to the truth and what
/// that experiment cannot tell from it; where no experiment of the menu takes a member away, nothing is
/// proposed.
void try_experiment(Score& score, const Case& c, const Diagnosis& diagnosis, const Diagnose& diagnose) {
  if (score.result != Answer::right_set) return;  // nothing to shrink
  const std::vector<std::vector<std::string>> sets = answer_sets(diagnosis);
  const auto& menu = world::experiments();
  const auto settles = [&](const NextExperiment& next) {  // and can be carried out in the simulator
    if (std::none_of(menu.begin(), menu.end(), [&](const auto& e) { return next.code == e.code; }))
      return false;
    return std::any_of(next.settles.begin(), next.settles.end(), [&](const std::string& id) {
      return std::any_of(sets.begin(), sets.end(), [&](const std::vector<std::string>& set) {
        return std::find(set.begin(), set.end(), id) != set.end();
      });
    });
  };
  const auto proposed =
      std::find_if(diagnosis.next_experiments.begin(), diagnosis.next_experiments.end(), settles);
  const bool proposes = proposed != diagnosis.next_experiments.end();
  const auto left = left_by_menu(c, sets);
  const bool separable = std::any_of(left.begin(), left.end(),
                                     [&](const auto& entry) { return entry.second.size() < sets.size(); });
  if (!separable) {
    score.experiment = "none";
    score.experiment_good = !proposes;
    return;
  }
  score.experiment = proposes ? proposed->code : "nothing proposed";
  score.experiment_good = false;
  if (!proposes) return;
  double seconds = 0.0;
  const Diagnosis after =
      ask(diagnose, record(c, world::carry_out(c.planted, proposed->code), 1), options_for(""), seconds);
  const std::vector<std::vector<std::string>> now = answer_sets(after);
  const bool gone = proposed->code == "E10" || proposed->code == "E11" || proposed->code == "E12";
  const auto allowed = left.find(proposed->code);
  const bool shrunk =
      std::find(now.begin(), now.end(), c.truth) != now.end() &&
      std::all_of(now.begin(), now.end(), [&](const std::vector<std::string>& set) {
        return set == c.truth ||
               (allowed != left.end() && allowed->second.size() < sets.size() &&
                std::find(allowed->second.begin(), allowed->second.end(), set) != allowed->second.end());
      });
  score.experiment_good = shrunk || (gone && now.empty());
}

Score diagnose_case(const Case& c, bool oracle, const Diagnose& diagnose) {
  DiagnoseOptions options = options_for(c.row);
  double seconds = 0.0;
  const Recording recording = record(c, c.planted);
  const std::span<const Recording> recordings(&recording, 1);
  Diagnosis diagnosis;
  if (has_simulation(c.row)) {
    // SIM is a second run without the effect, and the calibration of one, in turns.
    const Recording second = simulation_of(c);
    if (c.index / 2 % 2 == 0) {
      options.simulation = ask(diagnose, second, options_for(""), seconds).baseline;
      diagnosis = ask(diagnose, recording, options, seconds);
    } else {
      const Clock::time_point begin = Clock::now();
      diagnosis = diagnose_against(recordings, std::span<const Recording>(&second, 1), options);
      seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    }
  } else {
    diagnosis = ask(diagnose, recording, options, seconds);
  }
  if (c.row == "closed-loop") {
    const std::vector<Recording> again =
        simulate(diagnosis.simulation, seed_from("prove.closed-loop", {c.seed}));
    diagnosis = diagnose_against(recordings, again, options);
  }
  Score out = score(c, diagnosis);
  out.seconds = seconds;
  if (c.row == "closed-loop") {
    out.result = diagnosis.verdict == Verdict::no_mismatch ? Answer::quiet : Answer::false_alarm;
    out.coverage = {};  // the simulation has the effect: what was planted is not what is left to estimate
  }
  const bool gains = c.row == "lambda-100" || c.row == "lambda-400" || c.row == "noise-50";
  if (oracle && gains && diagnosis.verdict == Verdict::explained)
    add_gain(out, c, recording, diagnosis, diagnose);
  if (c.row == "experiment") try_experiment(out, c, diagnosis, diagnose);
  return out;
}

Score everyday_case(std::uint64_t seed, int index, const std::string& design, const Diagnose& diagnose) {
  const EverydayTable table = everyday_table(seed, index, design);
  Score out;
  double seconds = 0.0;
  try {
    DiagnoseOptions options = options_for("everyday");
    options.held_out = true;
    out = score_everyday(table, ask(diagnose, table.recording, options, seconds));
  } catch (const std::exception& error) {
    const Diagnosis nothing;
    out = score_everyday(table, nothing);
    out.result = Answer::false_alarm;
    out.answer = "threw";
    out.error = error.what();
  }
  out.design = design, out.index = index, out.seed = world_seed("everyday", seed, index, design),
  out.seconds = seconds;
  return out;
}

struct Job {
  std::string row, design;
  int index = 0;
};

std::vector<Job> jobs_of(const FreshOptions& options) {
  std::vector<Job> jobs;
  const std::vector<std::string>& rows = options.rows.empty() ? row_names() : options.rows;
  const bool both = options.design == "both";
  for (const std::string& row : rows) {
    int count = options.worlds;
    if (row == "clean") count = (both ? 2 : 1) * ((5 * options.worlds + 2) / 3);
    if (row == "simulation-alike" || row == "simulation-alpha" || row == "closed-loop")
      count = (2 * options.worlds + 2) / 3;
    if (row == "speed") count = std::min(options.worlds, 40);
    const bool of_designs =
        both && row != "everyday" && row != "clean-any";  // these have no design or their own
    for (int i = 0; i < count; ++i)
      jobs.push_back({row,
                      of_designs ? (i % 2 == 0 ? "line" : "turning")
                      : both     ? "line"
                                 : options.design,
                      i});
  }
  return jobs;
}

}  // namespace

EverydayTable everyday_table(std::uint64_t seed, int index, const std::string& design) {
  const std::vector<std::string>& kinds = everyday_kinds();
  return draw_everyday(kinds[static_cast<std::size_t>(index) % kinds.size()],
                       world_seed("everyday", seed, index, design));
}

void add_gain(Score& score, const Case& c, const Recording& recording, const Diagnosis& diagnosis,
              const Diagnose& diagnose) {
  for (const std::string& id : c.truth)
    if (find_effect(id) == nullptr) return;  // outside the catalogue: there is no true effect to refit
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  options.force = c.truth;
  double seconds = 0.0;
  Diagnosis oracle;
  try {
    oracle = ask(diagnose, recording, options, seconds);
  } catch (const InputError&) {
    return;  // it cannot be fitted: nothing to compare with
  }
  const double best = oracle.explanations.empty() ? oracle.after.nll : oracle.explanations[0].nll;
  const double reached = diagnosis.before.nll - diagnosis.after.nll, possible = diagnosis.before.nll - best;
  if (!(possible > 0.0)) return;
  score.gain_ratio = reached / possible;
  score.gain_excess_nats = reached - possible;
}

Score run_case(const std::string& row, std::uint64_t seed, int index, const std::string& design, bool oracle,
               const Diagnose& diagnose, std::vector<std::string>* out_of_reach) {
  if (row == "everyday") return everyday_case(seed, index, design, diagnose);
  const Case c = draw_case(row, seed, index, design);
  if (out_of_reach) *out_of_reach = c.out_of_reach;
  try {
    return diagnose_case(c, oracle, diagnose);
  } catch (const std::exception& error) {
    const Diagnosis nothing;
    Score out = score(c, nothing);
    if (c.truth.empty()) out.result = Answer::false_alarm;
    if (c.row == "absorbed" || c.row == "closed-loop") out.result = Answer::false_alarm;
    out.answer = "threw";
    out.error = error.what();
    return out;
  }
}

FreshResult run_fresh(const FreshOptions& options, const Diagnose& diagnose) {
  const std::vector<Job> jobs = jobs_of(options);
  FreshResult out;
  out.scores.resize(jobs.size());
  std::vector<std::vector<std::string>> unreached(jobs.size());
  int done = 0;
  std::mutex reporting;
  std::map<ScoreKey, const Score*> known;
  for (const Score& score : options.known) {
    if (score.seed != world_seed(score.row, options.seed, score.index, score.design))
      throw InputError("the scores to resume from are of worlds of another seed");
    known[key_of(score)] = &score;
  }
  const auto run = [&](std::size_t i) {
    const Job& job = jobs[i];
    const auto before = known.find({job.row, job.design, job.index});
    out.scores[i] = before != known.end() ? *before->second
                                          : run_case(job.row, options.seed, job.index, job.design,
                                                     options.oracle, diagnose, &unreached[i]);
    const std::lock_guard<std::mutex> lock(reporting);
    if (before == known.end() && options.scored) options.scored(out.scores[i]);
    if (options.progress) options.progress(++done, static_cast<int>(jobs.size()));
  };
  // Small tasks, so that slow worlds do not leave a core idle; those for speed one by one.
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, jobs.size(), 1),
      [&](const auto& range) {
        for (std::size_t i = range.begin(); i != range.end(); ++i)
          if (jobs[i].row != "speed") run(i);
      },
      tbb::simple_partitioner{});
  for (std::size_t i = 0; i < jobs.size(); ++i)
    if (jobs[i].row == "speed") run(i);
  for (const auto& names : unreached)
    for (const std::string& name : names) ++out.out_of_reach[name];
  return out;
}

}  // namespace rangecal::proof
