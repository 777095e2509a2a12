// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "commands.hpp"
#include "numbers.hpp"
#include "proof/everyday.hpp"
#include "proof/fresh.hpp"
#include "proof/journal.hpp"
#include "proof/sealed.hpp"
#include "proof/table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/core/write_lock.hpp"

namespace rangecal::app {
namespace {

struct ProveOptions {
  std::vector<std::string> folders, rows;
  int fresh = 0, make = 0, world = -1;
  std::uint64_t seed = 0;
  std::string design = "both", csv, out, dump;
  bool no_oracle = false, resume = false;
};

void show_progress(int done, int all) {
  if (!::isatty(STDERR_FILENO)) return;
  fmt::print(stderr, "\r{} of {} worlds{}", done, all, done == all ? "\n" : "");
}

void write_csv(const ProveOptions& o, const std::vector<proof::Score>& scores) {
  if (!o.csv.empty()) write_file(o.csv, proof::proof_csv(scores));
}

nlohmann::ordered_json world_as_json(const proof::Case& c) {
  return {{"row", c.row},       {"design", c.design}, {"index", c.index}, {"seed", c.seed},
          {"planted", c.truth}, {"sizes", c.sizes},   {"value", c.value}, {"truth", c.planted.truth}};
}

/// An everyday table with its key beside it.
void dump_table(const proof::EverydayTable& table, const std::string& folder) {
  require_replaceable(folder);
  save_recording(table.recording, folder, "rangecal prove");
  const nlohmann::ordered_json key = {{"kind", table.kind},
                                      {"causes", table.causes},
                                      {"alpha", std::vector(table.alpha.begin(), table.alpha.end())}};
  write_file(folder + "/key.json", key.dump(2) + "\n");
}

/// Writes one world of a row as a recording with its key beside it, and says how it was scored.
int dump_world(const ProveOptions& o) {
  if (o.rows.size() != 1 || o.design == "both")
    throw InputError("--world needs one --row, and --design line or turning");
  if (o.rows[0] == "everyday") {
    if (!o.dump.empty()) dump_table(proof::everyday_table(o.seed, o.world, o.design), o.dump);
  } else if (!o.dump.empty()) {
    const proof::Case c = proof::draw_case(o.rows[0], o.seed, o.world, o.design);
    require_replaceable(o.dump);
    save_recording(proof::record(c, c.planted), o.dump, "rangecal prove");
    if (proof::has_simulation(c.row)) {
      require_replaceable(o.dump + "/simulation");
      save_recording(proof::simulation_of(c), o.dump + "/simulation", "rangecal prove");
    }
    write_file(o.dump + "/key.json", world_as_json(c).dump(2) + "\n");
  }
  const proof::Score score = proof::run_case(o.rows[0], o.seed, o.world, o.design, !o.no_oracle, diagnose);
  fmt::print("{}", proof::proof_csv({score}));
  return done;
}

int prove_fresh(const ProveOptions& o) {
  proof::FreshOptions options;
  options.worlds = o.fresh, options.seed = o.seed, options.design = o.design, options.rows = o.rows;
  options.oracle = !o.no_oracle;
  options.progress = show_progress;
  for (const std::string& row : o.rows)
    if (std::find(proof::row_names().begin(), proof::row_names().end(), row) == proof::row_names().end())
      throw InputError("--row " + row +
                       " is not one of: " + fmt::format("{}", fmt::join(proof::row_names(), ", ")));
  if (o.resume && o.csv.empty())
    throw InputError("--resume needs the --csv FILE of the run that was stopped");
  require_writable(o.csv);
  std::optional<WriteLock> lock;
  if (!o.csv.empty()) lock.emplace(o.csv);
  if (o.resume && file_exists(o.csv)) options.known = proof::read_scores(read_file(o.csv), o.csv);
  std::optional<proof::Journal> journal;
  if (!o.csv.empty()) {
    journal.emplace(o.csv, options.known);
    options.scored = [&](const proof::Score& score) { journal->append(score); };
  }
  const proof::FreshResult result = proof::run_fresh(options, diagnose);
  if (journal) journal->finish(result.scores);
  fmt::print("{} fresh worlds a row, seed {}, designs: {}\n\n{}", o.fresh, o.seed, o.design,
             proof::proof_text(result.scores, result.out_of_reach));
  return done;
}

/// All answers first, on disk before a key is opened.
int prove_sealed(const ProveOptions& o) {
  require_writable({o.out, o.csv});
  std::vector<std::string> recordings;
  for (const std::string& folder : o.folders)
    for (const std::string& recording : proof::concealed_recordings(folder)) recordings.push_back(recording);
  std::vector<std::string> inputs = recording_files(recordings);
  for (const std::string& recording : recordings)
    inputs.insert(inputs.end(), {recording + "/commitment.txt", proof::key_file(recording)});
  require_apart({o.out, o.csv}, inputs);
  std::vector<proof::SealedAnswer> answers;
  nlohmann::ordered_json written = nlohmann::ordered_json::array();
  for (const std::string& recording : recordings) {
    answers.push_back(proof::answer_sealed(recording, diagnose));
    const Diagnosis& diagnosis = answers.back().diagnosis;
    written.push_back(
        {{"recording", recording},
         {"answer", proof::in_words(proof::answer_sets(diagnosis))},
         {"verdict", to_string(diagnosis.verdict)},
         {"probability", diagnosis.explanations.empty() ? 0.0 : diagnosis.explanations[0].probability},
         {"location", diagnosis.location.empty()
                          ? std::string()
                          : diagnosis.location[0].channel + "/" + diagnosis.location[0].covariate},
         {"sentence", diagnosis.sentence}});
    show_progress(static_cast<int>(answers.size()), static_cast<int>(recordings.size()));
  }
  if (!o.out.empty()) write_file(o.out, written.dump(2) + "\n");
  std::vector<proof::Score> scores;
  fmt::print("{:<44} {:<14} {:<40} {}\n", "recording", "", "planted", "answer");
  for (const proof::SealedAnswer& answer : answers) {
    scores.push_back(proof::score_sealed(answer, diagnose));
    fmt::print("{:<44} {:<14} {:<40} {}\n", answer.recording, to_string(scores.back().result),
               scores.back().planted, scores.back().answer);
  }
  write_csv(o, scores);
  fmt::print("\n{} commitments checked\n\n{}", scores.size(), proof::proof_text(scores, {}));
  return done;
}

int prove(const ProveOptions& o) {
  if (o.make > 0) {
    if (o.out.empty()) throw InputError("--make needs -o DIR");
    proof::make_concealed(o.out, o.make, o.seed);
    return done;
  }
  if (o.world >= 0) return dump_world(o);
  if (o.fresh > 0) return prove_fresh(o);
  if (o.folders.empty())
    throw InputError("prove: give folders of concealed recordings, or --fresh N --seed S");
  return prove_sealed(o);
}

}  // namespace

void add_prove(CLI::App& app, Action& chosen) {
  auto options = std::make_shared<ProveOptions>();
  CLI::App* command = app.add_subcommand(
      "prove", "diagnose recordings with sealed keys, or fresh simulated worlds, and score the answers");
  command->add_option("DIR", options->folders, "concealed recordings, or folders of them; keys in DIR-keys");
  command->add_option("--fresh", options->fresh, "worlds drawn for each row of the table")->check(positive());
  command->add_option("--seed", options->seed, "seed of the worlds")->check(whole());
  command->add_option("--design", options->design, "line, turning or both")
      ->check(CLI::IsMember({"line", "turning", "both"}));
  command->add_option("--row", options->rows,
                      "only these rows: " + fmt::format("{}", fmt::join(proof::row_names(), ", ")));
  command->add_option("--csv", options->csv, "one line per world, written as they are done");
  command->add_flag("--resume", options->resume,
                    "with --fresh: go on where the run that wrote --csv FILE was stopped");
  command->add_option("-o,--out", options->out, "file for the answers, or folder of --make");
  command->add_option("--make", options->make, "make that many concealed recordings")->check(positive());
  command->add_option("--world", options->world, "run the world of that number of one --row and --design");
  command->add_option(
      "--dump", options->dump,
      "folder for that world's recording, with its key and, in simulation/, what it is held against");
  command->add_flag("--no-oracle", options->no_oracle, "do not refit the true effect for comparison");
  command->footer(
      "A key says what was put into a recording; it is read once the diagnosis stands, and only if it matches the hash committed\n"
      "beside the recording. Fresh worlds have no keys to read: they are drawn from the seed and scored in memory.\n"
      "\n"
      "Examples:\n"
      "  rangecal prove notebooks_data/concealed -o answers.json\n"
      "  rangecal prove --fresh 300 --seed 7 --row lambda-400 --csv worlds.csv      (--resume goes on after a kill)\n"
      "  rangecal prove --row pair --design line --world 12 --seed 7 --dump world   one world as a recording, with its key\n"
      "  rangecal prove --make 5 --seed 7 -o concealed                              sealed recordings for others to try");
  command->callback([options, &chosen] { chosen = [options] { return prove(*options); }; });
}

}  // namespace rangecal::app
