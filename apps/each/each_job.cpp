// SPDX-License-Identifier: BSD-3-Clause
#include "each/each_job.hpp"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "diagnosis_words.hpp"
#include "fleet/database.hpp"
#include "fleet/fingerprint.hpp"
#include "fleet/inputs.hpp"
#include "fleet/units.hpp"
#include "numbers.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/core/version.hpp"
#include "rangecal/core/write_lock.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"
#include "report/report.hpp"
#include "text.hpp"

namespace rangecal::app {
namespace {

/// A row of `diagnoses`.
struct DiagnosedUnit {
  std::string name, reason;  ///< why there is no diagnosis
  std::optional<Recording> recording;
  std::optional<Diagnosis> diagnosis;
  double seconds = 0.0;
  Fingerprint fingerprint;
};

const std::vector<std::pair<const char*, const char*>> diagnosis_columns = {{"name", "TEXT PRIMARY KEY"},
                                                                            {"kind", "TEXT"},
                                                                            {"readings", "INTEGER"},
                                                                            {"used", "INTEGER"},
                                                                            {"verdict", "TEXT"},
                                                                            {"sentence", "TEXT"},
                                                                            {"names", "TEXT"},
                                                                            {"probability", "REAL"},
                                                                            {"estimates", "TEXT"},
                                                                            {"nll_before", "REAL"},
                                                                            {"nll_change", "REAL"},
                                                                            {"heldout_change", "REAL"},
                                                                            {"heldout_std", "REAL"},
                                                                            {"heldout_rms_before_m", "REAL"},
                                                                            {"heldout_rms_after_m", "REAL"},
                                                                            {"rms_before_m", "REAL"},
                                                                            {"rms_after_m", "REAL"},
                                                                            {"rest", "TEXT"},
                                                                            {"seconds", "REAL"},
                                                                            {"reason", "TEXT"},
                                                                            {"stamp", "INTEGER"},
                                                                            {"contents", "INTEGER"}};

/// "beam_offset 0.97, tilt 0.91": the names of the final model, with their probabilities where they were searched for.
std::string names_in_words(const Diagnosis& d) {
  std::string text;
  for (const std::string& id : d.final_effects) {
    text += (text.empty() ? "" : ", ") + id;
    for (const Member& member : d.members)
      if (member.effect == id) text += fmt::format(" {:.2f}", member.probability);
  }
  return text;
}

/// The parameters of the final model's effects: {"beam_offset.offset_m": {"estimate": 0.003, "std": 0.0002}}.
std::string estimates_json(const Diagnosis& d) {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  if (!d.final_effects.empty() && !d.explanations.empty())
    for (const EffectEstimate& e : d.explanations[0].parameters) {
      auto& one = json[e.name];
      one["estimate"] = e.estimate;
      if (std::isfinite(e.std_dev)) one["std"] = e.std_dev;
    }
  return json.dump();
}

/// "beam_offset.offset_m -16.3 +- 0.8 mm; ...": the same as a person reads it.
std::string estimates_in_words(const std::string& json) {
  std::string text;
  const auto estimates = nlohmann::ordered_json::parse(json.empty() ? "{}" : json);
  for (const auto& [name, one] : estimates.items()) {
    if (!one.at("estimate").is_number()) continue;
    const double estimate = one["estimate"], std_dev = one.value("std", std::nan(""));
    const Shown unit = unit_of({name, estimate, std_dev, 0.0, 0.0, ""});
    text += fmt::format("{}{} {}{}{}", text.empty() ? "" : "; ", name,
                        with_std(unit.factor * estimate, unit.factor * std_dev), unit.unit.empty() ? "" : " ",
                        unit.unit);
  }
  return text;
}

/// What has no name, and where.
std::string rest_in_words(const Diagnosis& d) {
  std::string text;
  for (const Finding& finding : d.location)
    if (finding.effects == std::vector<std::string>{"generic"})
      text += (text.empty() ? "" : "; ") + finding_in_words(finding);
  return text;
}

DiagnosedUnit diagnosed(const std::string& name, const std::string& place, const EachJob& job) {
  DiagnosedUnit unit;
  unit.name = name;
  const auto begin = std::chrono::steady_clock::now();
  try {
    unit.fingerprint = {stamp_of(place),
                        contents_of(place)};  // before the reading: a change meanwhile is one
    unit.recording = load_recordings({place}, {job.group_by}).front();
    require_columns_of_formulas({&*unit.recording, 1});
    unit.diagnosis = diagnose({&*unit.recording, 1}, job.options());
  } catch (const std::exception& error) {
    unit.reason = reason_of(error);
  }
  unit.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return unit;
}

class Diagnoses {
 public:
  explicit Diagnoses(const EachJob& job) : job_(job), database_(job.output) {
    require_own_file();
    std::string columns;
    for (const auto& [name, type] : diagnosis_columns)
      columns += fmt::format("{}{} {}", columns.empty() ? "" : ", ", name, type);
    database_.execute(
        "PRAGMA journal_mode = DELETE; PRAGMA synchronous = NORMAL; BEGIN IMMEDIATE;"
        "CREATE TABLE IF NOT EXISTS meta(key TEXT PRIMARY KEY, value TEXT) WITHOUT ROWID;"
        "CREATE TABLE IF NOT EXISTS inputs(name TEXT PRIMARY KEY, identity TEXT) WITHOUT ROWID;"
        "CREATE TABLE IF NOT EXISTS diagnoses(" +
        columns + ") WITHOUT ROWID");
    same("format", "rangecal-diagnoses/1");
    same("version", std::string(version()));
    same("options",
         fmt::format("alarm-rate {}, curve {}, force {}, without {}, group-by {}", job.alarm_rate, job.curve,
                     fmt::join(job.force, ","), fmt::join(job.without, ","), fmt::join(job.group_by, ",")));
    database_.execute("DELETE FROM diagnoses WHERE readings IS NULL");  // a file that was missing may be back
    database_.execute("COMMIT");
    before_ = database_.count("SELECT count(*) FROM diagnoses");
  }

  void take_inputs() {
    database_.execute("BEGIN");
    take_recordings(database_, job_.inputs);
    database_.execute("COMMIT");
    for (const std::string& file : job_.merge) {
      database_.prepare("ATTACH ? AS other").bind(1, file).run();
      database_.execute(
          "BEGIN; INSERT OR IGNORE INTO main.inputs SELECT * FROM other.inputs;"
          "INSERT OR REPLACE INTO main.diagnoses SELECT * FROM other.diagnoses; COMMIT; DETACH other");
    }
  }

  EachResult run() {
    EachResult result;
    const Changes changes = forget_changed(database_, "diagnoses");
    if (changes.gone > 0) result.notes.push_back(gone_in_words(changes));
    result.resumed = before_ - changes.changed - changes.renewed;
    diagnose_all();
    result.recordings = database_.count("SELECT count(*) FROM diagnoses");
    result.unreadable = database_.count("SELECT count(*) FROM diagnoses WHERE verdict IS NULL");
    Statement counts = database_.prepare(
        "SELECT verdict, count(*) FROM diagnoses WHERE verdict IS NOT NULL GROUP BY verdict ORDER BY 2 DESC, 1");
    while (counts.step()) result.verdicts.emplace_back(counts.text(0), counts.integer(1));
    if (!job_.page.empty() && !job_.share.partial()) write_file(job_.page, report::diagnoses_page(rows()));
    return result;
  }

 private:
  void require_own_file() {
    const std::int64_t tables = database_.count("SELECT count(*) FROM sqlite_master WHERE type = 'table'");
    if (tables > 0 &&
        database_.count("SELECT count(*) FROM sqlite_master WHERE name IN ('meta', 'inputs', 'diagnoses')") !=
            3)
      throw InputError(job_.output, 0, "", "is no file of 'rangecal diagnose --each'");
  }

  void same(const std::string& key, const std::string& value) {
    Statement get = database_.prepare("SELECT value FROM meta WHERE key = ?");
    get.bind(1, key);
    if (!get.step())
      database_.prepare("INSERT INTO meta VALUES(?, ?)").bind(1, key).bind(2, value).run();
    else if (get.text(0) != value)
      throw InputError(job_.output, 0, "",
                       fmt::format("was made with {} {}, not {}", key, get.text(0), value));
  }

  void diagnose_all() {
    PendingUnits pending(database_, "diagnoses", job_.share);
    std::int64_t done = 0;
    const std::int64_t all = database_.count("SELECT count(*) FROM inputs");
    for (auto batch = pending.next(); !batch.empty(); batch = pending.next()) {
      std::vector<DiagnosedUnit> units(batch.size());
      tbb::parallel_for(std::size_t{0}, units.size(), [&](std::size_t i) {
        units[i] = diagnosed(batch[i].name, place_of(batch[i].name, batch[i].identity), job_);
      });
      database_.execute("BEGIN");
      for (const DiagnosedUnit& unit : units) insert(unit);
      database_.execute("COMMIT");
      pending.done();
      done += static_cast<std::int64_t>(units.size());
      if (job_.progress) fmt::print(stderr, "\rrangecal: {} of {} recordings ", done, all);
    }
    if (job_.progress && done > 0) fmt::print(stderr, "\n");
  }

  void insert(const DiagnosedUnit& unit) {
    std::string marks = "?";
    for (std::size_t i = 1; i < diagnosis_columns.size(); ++i) marks += ", ?";
    Statement row = database_.prepare("INSERT INTO diagnoses VALUES(" + marks + ")");
    int at = 0;
    const auto put = [&](const auto& value) { row.bind(++at, value); };
    const double none = std::nan("");
    put(unit.name);
    if (unit.recording) {
      put(std::string(unit.recording->kind == RecordingKind::pairs ? "pairs" : "landmarks"));
      put(std::int64_t{unit.recording->counts.read});
      put(std::int64_t{unit.recording->counts.used});
    } else {
      put(none), put(none), put(none);
    }
    if (const auto& d = unit.diagnosis) {
      const FitSummary &before = d->before, &after = d->after;
      const bool held = before.heldout_nll && after.heldout_nll && !d->final_effects.empty();
      put(std::string(to_string(d->verdict)));
      put(d->sentence);
      put(names_in_words(*d));
      put(d->explanations.empty() || d->final_effects.empty() ? none : d->explanations[0].probability);
      put(estimates_json(*d));
      put(before.nll);
      put(after.nll - before.nll);
      put(held ? *after.heldout_nll - *before.heldout_nll : none);
      put(held ? after.heldout_std.value_or(none) : none);
      put(before.heldout_rms_range_m.value_or(none));
      put(after.heldout_rms_range_m.value_or(none));
      put(before.rms_range_m);
      put(after.rms_range_m);
      put(rest_in_words(*d));
    } else {
      for (int i = 0; i < 14; ++i) put(none);
    }
    put(unit.seconds);
    put(unit.reason);
    put(unit.fingerprint.stamp);
    put(unit.fingerprint.contents);
    row.run();
  }

  /// What the page shows, in the order of the names.
  std::vector<report::DiagnosisRow> rows() {
    std::vector<report::DiagnosisRow> out;
    Statement row = database_.prepare(
        "SELECT name, verdict, names, estimates, nll_change, heldout_change, heldout_std, heldout_rms_before_m,"
        " heldout_rms_after_m, rest, seconds, reason FROM diagnoses ORDER BY name");
    while (row.step()) {
      report::DiagnosisRow& one = out.emplace_back();
      one.recording = row.text(0), one.verdict = row.text(1), one.names = row.text(2);
      one.estimates = estimates_in_words(row.text(3));
      one.nll_change = row.number(4), one.heldout_change = row.number(5), one.heldout_std = row.number(6);
      one.heldout_rms_before_m = row.number(7), one.heldout_rms_after_m = row.number(8);
      one.rest = row.text(9), one.seconds = row.number(10).value_or(0.0), one.reason = row.text(11);
    }
    return out;
  }

  const EachJob& job_;
  Database database_;
  std::int64_t before_ = 0;  ///< rows of runs before
};

}  // namespace

void EachJob::add_to(CLI::App& command) {
  command.add_option(
      "--each", output,
      "diagnose every recording for itself, also those in folders of recordings, and write a row each to this "
      "SQLite file; a run that was stopped goes on in it");
  command.add_option(
      "--page", page,
      "with --each: write a table of the rows to this file, one HTML page that needs no network");
  command
      .add_option("--threads", threads,
                  "with --each: so many recordings at a time; 0: as many as there are cores")
      ->check(not_negative())
      ->capture_default_str();
}

DiagnoseOptions EachJob::options() const {
  DiagnoseOptions options;
  options.alarm_rate = alarm_rate;
  options.unseen = options.next_experiments = false;  // of one recording, not of many
  if (!force.empty()) options.force = force;
  options.without = without;
  if (curve != "auto") options.curve = curve_family_from_string(curve);
  return options;
}

void EachJob::check() const {
  options().check();
  require_writable({output, page});
  require_apart({output, page}, recording_files(inputs));
}

EachResult run_each(const EachJob& job) {
  std::optional<tbb::global_control> limit;
  if (job.threads > 0)
    limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(job.threads));
  const WriteLock lock(job.output);
  const bool fresh = !file_exists(job.output);
  std::optional<Diagnoses> diagnoses;
  try {
    diagnoses.emplace(job);
    diagnoses->take_inputs();
  } catch (...) {  // nothing was begun: no empty file stays behind
    diagnoses.reset();
    std::error_code ignored;
    if (fresh) std::filesystem::remove(job.output, ignored);
    throw;
  }
  return diagnoses->run();
}

std::string describe(const EachJob& job, const EachResult& result) {
  std::string text = fmt::format("{} recordings in {}, {} were there already\n", result.recordings,
                                 job.output, result.resumed);
  for (const auto& [verdict, count] : result.verdicts) text += fmt::format("  {:<18} {}\n", verdict, count);
  if (result.unreadable > 0)
    text += fmt::format(
        "  {:<18} {}; ask: sqlite3 {} 'SELECT name, reason FROM diagnoses WHERE verdict IS NULL'\n",
        "not diagnosed", result.unreadable, job.output);
  return text;
}

}  // namespace rangecal::app
