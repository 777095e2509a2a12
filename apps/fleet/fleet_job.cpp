// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/fleet_job.hpp"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <filesystem>
#include <memory>

#include "fleet/database.hpp"
#include "fleet/fingerprint.hpp"
#include "fleet/inputs.hpp"
#include "fleet/units.hpp"
#include "fleet/whole_fleet.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/write_lock.hpp"

namespace rangecal::app {
namespace {

using Eigen::VectorXd;
namespace fs = std::filesystem;

std::string columns(int order, const char* pattern) {
  std::string text;
  for (int i = 0; i <= order; ++i) text += fmt::format(fmt::runtime(pattern), i);
  return text;
}

class Fleet {
 public:
  explicit Fleet(const FleetJob& job) : job_(job), database_(job.output) {
    holds_fleet(database_, "main", job.output);
    database_.execute("PRAGMA journal_mode = DELETE; PRAGMA synchronous = NORMAL");
    const int n = job.order;
    database_.execute("BEGIN IMMEDIATE");
    database_.execute(
        "CREATE TABLE IF NOT EXISTS meta(key TEXT PRIMARY KEY, value TEXT) WITHOUT ROWID;"
        "CREATE TABLE IF NOT EXISTS inputs(name TEXT PRIMARY KEY, identity TEXT) WITHOUT ROWID;"
        "CREATE TABLE IF NOT EXISTS units(name TEXT PRIMARY KEY, kind TEXT, outcome TEXT, reason TEXT, readings INTEGER, used INTEGER,"
        " range_min_m REAL, range_max_m REAL, " +
        columns(n, "alpha_{0} REAL, alpha_{0}_std REAL, ") +
        "sigma REAL, sigma_std REAL, nll REAL, shape_p REAL, shape_m REAL, tail_p REAL, kurtosis REAL, dependence_p REAL,"
        " correlation REAL, theta BLOB, information BLOB, stamp INTEGER, contents INTEGER, notes TEXT, noise_shape TEXT) WITHOUT ROWID;"
        "CREATE TABLE IF NOT EXISTS posteriors(name TEXT PRIMARY KEY, source TEXT, " +
        columns(n, "alpha_{0} REAL, alpha_{0}_std REAL, ") +
        "sigma REAL, sigma_relative_std REAL, distance_sq REAL, p_value REAL) WITHOUT ROWID;"
        "CREATE TABLE IF NOT EXISTS oddities(name TEXT, what TEXT, size REAL, unit TEXT, p_value REAL, explanation TEXT, PRIMARY KEY(name, what)) WITHOUT ROWID");
    same("format", "rangecal-fleet/1");
    same("order", std::to_string(job.order));
    same("law", to_string(job.law));
    same("noise_shape", to_string(job.noise_shape));
    same("shard", job.share.queue ? "queue" : fmt::format("{}/{}", job.share.shard + 1, job.share.shards));
    identify_inputs(database_);
    renew_fits(database_);
    database_.execute("COMMIT");
  }

  /// Takes in what the job names. Throws InputError before anything is fitted.
  void take_inputs() {
    database_.execute("BEGIN");
    take_recordings(database_, job_.inputs);
    database_.execute("COMMIT");
    for (const std::string& file : job_.merge) merge_fleet(database_, file);
    database_.execute("BEGIN");
    identify_inputs(database_);
    database_.execute("COMMIT");
  }

  FleetResult run() {
    FleetResult result;
    result.resumed = database_.count("SELECT count(*) FROM units");
    database_.execute("DELETE FROM units WHERE readings IS NULL");  // a file that was missing may be back
    const Changes changes = forget_changed(database_);
    result.refitted = changes.changed;
    result.renewed = changes.renewed;
    result.resumed -= changes.changed + changes.renewed;
    if (changes.gone > 0) result.notes.push_back(gone_in_words(changes));
    fit_units();
    result.units = database_.count("SELECT count(*) FROM units");
    result.fitted = database_.count("SELECT count(*) FROM units WHERE theta IS NOT NULL");
    result.unreadable = database_.count("SELECT count(*) FROM units WHERE readings IS NULL");
    result.few = database_.count(fmt::format("SELECT count(*) FROM units WHERE theta IS NULL AND used < {}",
                                             readings_for_own_fit(job_.order)));
    result.partial = job_.share.partial();
    if (result.partial) return result;
    fit_whole(database_, job_, result);
    return result;
  }

 private:
  void same(const std::string& key, const std::string& value) {
    Statement get = database_.prepare("SELECT value FROM meta WHERE key = ?");
    get.bind(1, key);
    if (!get.step()) {
      database_.prepare("INSERT INTO meta VALUES(?, ?)").bind(1, key).bind(2, value).run();
    } else if (get.text(0) != value) {
      throw InputError(fmt::format("{}: was made with {} {}, not {}", job_.output, key, get.text(0), value));
    }
  }

  void fit_units() {
    PendingUnits pending(database_, "units", job_.share);
    std::int64_t done = 0;
    const std::int64_t all = database_.count("SELECT count(*) FROM inputs");
    for (auto batch = pending.next(); !batch.empty(); batch = pending.next()) {
      std::vector<Unit> units(batch.size());
      tbb::parallel_for(std::size_t{0}, units.size(), [&](std::size_t i) {
        units[i] = fit_unit(batch[i].name, place_of(batch[i].name, batch[i].identity), job_);
      });
      database_.execute("BEGIN");
      for (const Unit& unit : units) insert(unit);
      database_.execute("COMMIT");
      pending.done();
      done += static_cast<std::int64_t>(units.size());
      if (job_.progress) fmt::print(stderr, "\rrangecal: {} of {} units ", done, all);
    }
    if (job_.progress && done > 0) fmt::print(stderr, "\n");
  }

  void insert(const Unit& unit) {
    const int n = job_.order;
    if (!insert_) {
      std::string marks = "?";
      for (int i = 1; i < 23 + 2 * (n + 1); ++i) marks += ", ?";
      insert_.reset(new Statement(database_.prepare("INSERT INTO units VALUES(" + marks + ")")));
    }
    const Calibration& c = unit.calibration;
    const double nan = std::nan("");
    const bool read = c.counts.read > 0;
    int at = 0;
    const auto put = [&](const auto& value) { insert_->bind(++at, value); };
    put(unit.name);
    put(std::string(!read ? "" : c.kind == RecordingKind::pairs ? "pairs" : "landmarks"));
    put(std::string(to_string(c.outcome)));
    put(c.reason);
    if (read)
      put(std::int64_t{c.counts.read});
    else
      put(nan);
    if (read)
      put(std::int64_t{c.counts.used});
    else
      put(nan);
    put(read ? c.range_min_m : nan);
    put(read ? c.range_max_m : nan);
    for (int i = 0; i <= n; ++i) {
      put(i < c.alpha.size() ? c.alpha[i] : nan);
      put(i < c.alpha.size() && c.alpha_covariance ? std::sqrt((*c.alpha_covariance)(i, i)) : nan);
    }
    const bool sigma = c.alpha.size() > 0 && c.noise.parameters.size() == 1;
    put(sigma ? c.noise.parameters[0] : nan);
    put(sigma && !c.noise_estimates.empty() ? c.noise_estimates[0].std_dev.value_or(nan) : nan);
    put(c.marginal_nll.value_or(nan));
    for (const double value : {unit.misfit.shape_p, unit.misfit.shape_m, unit.misfit.tail_p,
                               unit.misfit.kurtosis, unit.misfit.dependence_p, unit.misfit.correlation})
      put(value);
    put(unit.summary ? unit.summary->theta : VectorXd());
    put(unit.summary ? VectorXd(unit.summary->information.reshaped()) : VectorXd());
    put(unit.fingerprint.stamp);
    put(unit.fingerprint.contents);
    put(unit.notes);
    put(shape_to_json(c));
    insert_->run();
  }

  const FleetJob& job_;
  Database database_;
  std::unique_ptr<Statement> insert_;
};

}  // namespace

FleetResult run_fleet(const FleetJob& job) {
  std::optional<tbb::global_control> limit;
  if (job.threads > 0)
    limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(job.threads));
  const WriteLock lock(job.output);
  const bool fresh = !file_exists(job.output);
  std::optional<Fleet> fleet;
  try {
    fleet.emplace(job);
    fleet->take_inputs();
  } catch (...) {  // nothing was begun: no empty file stays behind
    fleet.reset();
    std::error_code ignored;
    if (fresh) fs::remove(job.output, ignored);
    throw;
  }
  FleetResult result = fleet->run();
  if (!job.csv.empty() && !result.partial) {
    Database database(job.output);
    write_csv(database, job.csv);
  }
  return result;
}

}  // namespace rangecal::app
