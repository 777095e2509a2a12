// SPDX-License-Identifier: BSD-3-Clause
// What `diagnose --laws` finds where the catalogue has no name, and what `predict` says of it elsewhere. Worlds of the physical
// simulator's two designs, in turns, whose readings are changed by a law that no effect of the catalogue is, of
// noncentrality 200 against the seed model, by kind:
//
//   ripple    bearing + a cos(n b + phi), n 5 to 12
//   sector    range + a for directions b within 0.3 to 0.8 rad of one
//   hum       range + a cos(2 pi t / T + phi), 2 to 40 periods in the recording
//   bump      range + a exp(-((d - c) / w)^2 / 2), w 0.12 to 0.25 m
//   product   range + a (u - mean) (v - mean), u and v columns without a meaning, drawn for every stop
//
// d true distance [m], b direction in the sensor's frame [rad], t time from the first reading [s]; what is open is drawn. Each is then
// predicted in a second recording: the same sensor in the other design, once with the law and once without it.
//
//   law_study WORLDS [THREADS [PART...]]      PART: found, named, clean; without any, all; journal=FILE: see below
//
// A law stands if of the whitened means, less what the calibration absorbs, it leaves 5 % of the squares or less. `named`: worlds of one
// catalogued effect, noncentrality 100 and 400 in turns; `clean`: nothing is planted.
// journal=FILE: a line a world, written as they are done; worlds that it has are not done again (one build, one FILE).
#include <tbb/parallel_for.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <numbers>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "proof/rows.hpp"
#include "proof/seed_model.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/proportion.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "rangecal/solvers/diagnosis/predict_law.hpp"
#include "study.hpp"
#include "threads.hpp"

namespace {

using namespace rangecal;

constexpr double pi = std::numbers::pi;
constexpr double noncentrality = 200.0;
const std::array<const char*, 2> columns{"temperature_c", "supply_v"};

/// What a law may depend on, of one reading.
struct Where {
  double d = 0.0, b = 0.0, t = 0.0;
  std::array<double, 2> u{};  ///< of the columns
};

/// A law to be found: its change [m or rad] for an amplitude of 1.
struct Planted {
  bool of_bearing = false;
  std::vector<std::string> variables;
  std::function<double(const Where&)> shape;
};

const std::vector<std::string> kinds{"ripple", "sector", "hum", "bump", "product"};

/// `seen`: readings of the world it is to act in.
Planted draw_law(const std::string& kind, const std::vector<Where>& seen, Random& r) {
  const Where any = seen[r.index(seen.size())];
  const double phase = r.uniform(-pi, pi);
  if (kind == "ripple") {
    const double n = 5.0 + static_cast<double>(r.index(8));
    return {true, {"b"}, [=](const Where& x) { return std::cos(n * x.b + phase); }};
  }
  if (kind == "sector") {
    const double half = r.uniform(0.3, 0.8);
    return {
        false, {"b"}, [=](const Where& x) { return std::abs(wrap_angle(x.b - any.b)) < half ? 1.0 : 0.0; }};
  }
  if (kind == "hum") {
    const double period = seen.back().t / std::exp(r.uniform(std::log(2.0), std::log(40.0)));
    return {false, {"t"}, [=](const Where& x) { return std::cos(2.0 * pi * x.t / period + phase); }};
  }
  if (kind == "bump") {
    const double width = r.uniform(0.12, 0.25);
    return {
        false, {"d"}, [=](const Where& x) { return std::exp(-0.5 * std::pow((x.d - any.d) / width, 2)); }};
  }
  std::array<double, 2> mean{};
  for (const Where& x : seen)
    for (std::size_t j = 0; j < 2; ++j) mean[j] += x.u[j] / static_cast<double>(seen.size());
  return {false, {columns[1], columns[0]}, [=](const Where& x) {
            return (x.u[0] - mean[0]) * (x.u[1] - mean[1]);
          }};
}

/// Values of the columns for every stop, which have nothing to do with time.
std::vector<std::array<double, 2>> draw_columns(std::size_t stops, Random& r) {
  std::vector<std::array<double, 2>> values;
  for (std::size_t k = 0; k < stops; ++k) values.push_back({r.uniform(15.0, 30.0), r.uniform(4.6, 5.2)});
  return values;
}

/// A world without physics of its own, and the columns that its recordings hold.
struct Place {
  world::World world;
  std::vector<std::array<double, 2>> u;  ///< of every stop
};

std::vector<Where> readings_of(const Place& place, const world::Expected& expected) {
  std::vector<Where> all;
  for (std::size_t i = 0; i < expected.stop.size(); ++i)
    all.push_back({expected.distance_m[i], expected.bearing_mean_rad[i],
                   expected.time_s[i] - expected.time_s.front(),
                   place.u[static_cast<std::size_t>(expected.stop[i])]});
  return all;
}

/// The readings' means with a law in them.
world::Expected with_law(const world::Expected& clean, const std::vector<Where>& at, const Planted& law,
                         double size) {
  world::Expected changed = clean;
  for (std::size_t i = 0; i < at.size(); ++i)
    (law.of_bearing ? changed.bearing_mean_rad : changed.range_mean_m)[i] += size * law.shape(at[i]);
  return changed;
}

double noncentrality_of(const proof::SeedModel& model, const std::vector<Where>& at, const Planted& law,
                        double size) {
  return model.fit(with_law(model.expected(), at, law, size)).residual.squared_norm();
}

/// The amplitude of the noncentrality that is asked for; 0 where the calibration absorbs all of it.
double amplitude_of(const proof::SeedModel& model, const std::vector<Where>& at, const Planted& law) {
  double size = 1e-3;
  for (int round = 0; round < 6; ++round) {
    const double reached = noncentrality_of(model, at, law, size);
    if (!(reached > 1e-6)) return 0.0;
    size *= std::sqrt(noncentrality / reached);
  }
  const double largest = law.of_bearing ? 0.2 : 0.5;  // [rad], [m]: beyond it nobody needs a formula
  return std::abs(size) < largest ? size : 0.0;
}

Recording record(const Place& place, const Planted* law, double size, std::uint64_t seed) {
  Recording recording = world::simulate(place.world, seed);
  const world::Expected expected = world::expected(place.world, world::placing_of(place.world, seed));
  const std::vector<Where> at = readings_of(place, expected);
  const auto landmarks = static_cast<int>(place.world.landmarks.size());
  Readings& r = recording.readings;
  for (const char* const column : columns) r.covariates[column].resize(r.size());
  for (std::size_t i = 0; i < r.size(); ++i) {
    for (std::size_t j = 0; j < 2; ++j)
      r.covariates[columns[j]][i] = place.u[static_cast<std::size_t>(r.stop[i])][j];
    if (!law) continue;
    const auto of = static_cast<std::size_t>(
        (r.stop[i] * landmarks + r.landmark[i]) * place.world.timing.repeats + r.repeat[i]);
    if (law->of_bearing)
      r.bearing_rad[i] = wrap_angle(r.bearing_rad[i] + size * law->shape(at[of]));
    else
      r.range_m[i] += size * law->shape(at[of]);
  }
  return recording;
}

/// The change of every reading's range and bearing that a law makes as it was found.
std::vector<ReadingChange<double>> changes_of(const Law& law, const std::vector<Where>& at) {
  const std::unique_ptr<Effect> effect = effect_from_formula(law.text, law.id);
  const Eigen::VectorXd values = stated_values(*effect).value;
  EffectContext context;
  context.covariates = {columns.begin(), columns.end()};
  context.duration_s = at.back().t;
  std::vector<ReadingChange<double>> changes;
  for (const Where& x : at) {
    ReadingView<double> view{};
    view.d = view.axis_distance = view.f = x.d;
    view.slope = 1.0;
    view.bearing = x.b;
    view.time_s = x.t;
    view.covariate = x.u.data();
    view.context = &context;
    changes.push_back(effect->reading(view, values.data()));
  }
  return changes;
}

/// Of the whitened means of what was planted, less what the calibration absorbs: the share of the squares that the law leaves.
double share_left(const proof::SeedModel& model, const std::vector<Where>& at, const Planted& planted,
                  double size, const Law& law) {
  const std::vector<ReadingChange<double>> found = changes_of(law, at);
  const world::Expected& e = model.expected();
  const int cells = model.cells();
  Eigen::VectorXd truth = Eigen::VectorXd::Zero(model.jacobian().rows()), left = truth;
  const double root = std::sqrt(static_cast<double>(model.repeats()));
  for (std::size_t i = 0; i < at.size(); ++i) {
    const int c = model.cell(e.stop[i], e.landmark[i]);
    const double range = root / model.range_sd_m(c) / model.repeats();
    const double bearing = root / model.bearing_sd_rad(c) / model.repeats();
    (planted.of_bearing ? truth[cells + c] : truth[c]) +=
        (planted.of_bearing ? bearing : range) * size * planted.shape(at[i]);
    left[c] -= range * found[i].range;
    left[cells + c] -= bearing * found[i].bearing;
  }
  left += truth;
  return model.project(left).squaredNorm() / model.project(truth).squaredNorm();
}

/// The sensor of one world in the surroundings of another.
world::World same_sensor_in(const world::World& surroundings, const world::World& of) {
  world::World there = surroundings;
  there.sensor = of.sensor;
  there.head = of.head;
  there.noise = of.noise;
  return there;
}

/// What came out of one world, as it stands in the journal.
struct WorldOutcome {
  int has_law = 0, beats_curve = 0, stands = 0, right_variables = 0, named = 0, right_name = 0;
  int predicted = 0, better = 0, better_than_curve = 0, confirmed = 0, refuted = 0, wrongly_confirmed = 0;
  double left = 1.0, seconds = 0.0;
  std::string answer = "-";
};

Diagnosis look_for_laws(const Recording& recording, WorldOutcome& outcome) {
  DiagnoseOptions options;
  options.laws = true;
  options.unseen = options.next_experiments = false;
  const auto start = std::chrono::steady_clock::now();
  Diagnosis diagnosis = diagnose({&recording, 1}, options);
  outcome.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  outcome.has_law = !diagnosis.laws.empty();
  outcome.beats_curve = outcome.has_law && diagnosis.laws.front().log_evidence_over_curve > 0.0;
  outcome.named = !diagnosis.final_effects.empty() && diagnosis.final_effects.front() != "generic";
  outcome.answer = proof::in_words(proof::answer_sets(diagnosis));
  if (outcome.has_law) outcome.answer += ": " + diagnosis.laws.front().formula;
  return diagnosis;
}

WorldOutcome found_in(int number) {
  Random r(seed_from("law study", {static_cast<std::uint64_t>(number)}));
  const std::string& kind = kinds[static_cast<std::size_t>(number) % kinds.size()];
  const bool line = number / static_cast<int>(kinds.size()) % 2 == 0;
  const world::World here = line ? world::make_line_design() : world::make_turning_design();
  Place first{world::vary(here, r), {}};
  first.u = draw_columns(first.world.robot.stops.size(), r);
  const proof::SeedModel model(first.world);
  const std::vector<Where> at = readings_of(first, model.expected());
  Planted law;
  double size = 0.0;
  while (size == 0.0) {
    law = draw_law(kind, at, r);
    size = amplitude_of(model, at, law);
  }
  if (r.uniform(0.0, 1.0) < 0.5) size = -size;

  WorldOutcome outcome;
  const Diagnosis diagnosis = look_for_laws(record(first, &law, size, r.bits()), outcome);
  if (!outcome.has_law) return outcome;
  const Law& best = diagnosis.laws.front();
  outcome.left = share_left(model, at, law, size, best);
  outcome.stands = outcome.left <= 0.05;
  outcome.right_variables = best.variables == law.variables;

  const world::World there = line ? world::make_turning_design() : world::make_line_design();
  Place second{same_sensor_in(world::vary(there, r), first.world), {}};
  second.u = draw_columns(second.world.robot.stops.size(), r);
  const std::unique_ptr<Effect> effect = effect_from_formula(best.text, best.id);
  const StatedValues values = stated_values(*effect);
  const std::uint64_t noise = r.bits();
  const Recording with = record(second, &law, size, noise), without = record(second, nullptr, 0.0, noise);
  const LawPrediction there_too = predict_law(*effect, values, {&with, 1});
  const LawPrediction not_there = predict_law(*effect, values, {&without, 1});
  outcome.predicted = 1;
  outcome.better = there_too.heldout_gain.value_or(0.0) > 0.0;
  outcome.better_than_curve = there_too.heldout_gain_over_curve.value_or(0.0) > 0.0;
  outcome.confirmed = there_too.verdict == LawVerdict::confirmed;
  outcome.refuted = not_there.verdict == LawVerdict::refuted;
  outcome.wrongly_confirmed =
      not_there.verdict == LawVerdict::confirmed || not_there.verdict == LawVerdict::another_size;
  return outcome;
}

WorldOutcome of_case(const std::string& row, int number) {
  const proof::Case c =
      proof::draw_case(row, seed_from("law study, " + row), number, number / 2 % 2 == 0 ? "line" : "turning");
  WorldOutcome outcome;
  const Diagnosis diagnosis = look_for_laws(proof::record(c, c.planted), outcome);
  outcome.right_name = proof::names_of(proof::answer_sets(diagnosis), c.truth).found > 0;
  return outcome;
}

constexpr std::array flags{
    &WorldOutcome::has_law,         &WorldOutcome::beats_curve, &WorldOutcome::stands,
    &WorldOutcome::right_variables, &WorldOutcome::named,       &WorldOutcome::right_name,
    &WorldOutcome::predicted,       &WorldOutcome::better,      &WorldOutcome::better_than_curve,
    &WorldOutcome::confirmed,       &WorldOutcome::refuted,     &WorldOutcome::wrongly_confirmed};

std::string text_of(const WorldOutcome& outcome) {
  std::ostringstream text;
  for (int WorldOutcome::*const flag : flags) text << outcome.*flag << ' ';
  text << outcome.left << ' ' << outcome.seconds << ' ' << outcome.answer;
  return text.str();
}

WorldOutcome outcome_of(const std::string& text) {
  WorldOutcome outcome;
  std::istringstream fields(text);
  for (int WorldOutcome::*const flag : flags) fields >> outcome.*flag;
  fields >> outcome.left >> outcome.seconds >> std::ws;
  std::getline(fields, outcome.answer);
  return outcome;
}

std::vector<WorldOutcome> study(const std::string& part, int worlds, StudyJournal& journal,
                                const std::function<WorldOutcome(int)>& carry_out) {
  std::vector<WorldOutcome> all(static_cast<std::size_t>(worlds));
  tbb::parallel_for(0, worlds, [&](int number) {
    WorldOutcome& outcome = all[static_cast<std::size_t>(number)];
    const std::string key = part + " " + std::to_string(number);
    if (const std::string* known = journal.find(key)) {
      outcome = outcome_of(*known);
      return;
    }
    outcome = carry_out(number);
    journal.add(key, text_of(outcome));
  });
  return all;
}

void print_share(const char* what, const std::vector<WorldOutcome>& all, int WorldOutcome::*member,
                 int WorldOutcome::*of, const char* wanted) {
  int count = 0, yes = 0;
  for (const WorldOutcome& o : all) {
    if (of && !(o.*of)) continue;
    ++count;
    yes += o.*member;
  }
  if (count == 0) return;
  const auto [low, high] = wilson(yes, count);
  std::printf("%-58s %5d %7.1f %%  %5.1f to %5.1f %%  %s\n", what, count, 100.0 * yes / count, 100.0 * low,
              100.0 * high, wanted);
}

void print_times(const std::vector<WorldOutcome>& all) {
  std::vector<double> seconds;
  for (const WorldOutcome& o : all) seconds.push_back(o.seconds);
  std::sort(seconds.begin(), seconds.end());
  std::printf("%-58s %5zu %7.2f s  worst %.2f s\n", "a diagnosis with laws: median", seconds.size(),
              seconds[seconds.size() / 2], seconds.back());
}

void print_found(const std::vector<WorldOutcome>& all) {
  print_share("outside the catalogue: a law within 5 % of what was planted", all, &WorldOutcome::stands,
              nullptr, ">= 80 %");
  print_share("the right variables in the formula", all, &WorldOutcome::right_variables, nullptr, ">= 90 %");
  print_share("likelier than the free curve", all, &WorldOutcome::beats_curve, nullptr, "");
  print_share("a name was given", all, &WorldOutcome::named, nullptr, "");
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    std::vector<WorldOutcome> own;
    for (std::size_t i = k; i < all.size(); i += kinds.size()) own.push_back(all[i]);
    print_share(("  " + kinds[k] + ": within 5 %").c_str(), own, &WorldOutcome::stands, nullptr, "");
    print_share(("  " + kinds[k] + ": right variables").c_str(), own, &WorldOutcome::right_variables, nullptr,
                "");
    print_share(("  " + kinds[k] + ": elsewhere, better than the seed model").c_str(), own,
                &WorldOutcome::better, &WorldOutcome::predicted, "");
  }
  print_share("elsewhere: a law predicts better than the seed model", all, &WorldOutcome::better,
              &WorldOutcome::predicted, ">= 95 %");
  print_share("elsewhere: better than a free curve", all, &WorldOutcome::better_than_curve,
              &WorldOutcome::predicted, ">= 80 %");
  print_share("elsewhere: confirmed", all, &WorldOutcome::confirmed, &WorldOutcome::predicted, "");
  print_share("elsewhere without the cause: refuted", all, &WorldOutcome::refuted, &WorldOutcome::predicted,
              ">= 95 %");
  print_share("elsewhere without the cause: said to act", all, &WorldOutcome::wrongly_confirmed,
              &WorldOutcome::predicted, "");
  print_times(all);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: law_study WORLDS [THREADS [PART...]]\n");
    return 2;
  }
  const int worlds = std::max(1, std::atoi(argv[1]));
  const auto limit = at_most(argc > 2 ? std::atoi(argv[2]) : 0);
  const StudyParts parts(argc, argv, 3);
  StudyJournal journal(parts.journal);
  std::printf("%-58s %5s %9s  %-15s  %s\n", "what", "worlds", "figure", "95 % interval", "asked");
  if (parts.wants("found")) print_found(study("found", worlds, journal, found_in));
  if (parts.wants("named")) {
    std::vector<WorldOutcome> all = study("named", worlds, journal, [](int number) {
      return of_case(number % 2 == 0 ? "lambda-100" : "lambda-400", number);
    });
    for (WorldOutcome& o : all) o.has_law = o.has_law && !o.right_name;
    print_share("catalogued: a law and not the name", all, &WorldOutcome::has_law, nullptr, "<= 2 %");
    print_share("catalogued: the name", all, &WorldOutcome::right_name, nullptr, "");
  }
  if (parts.wants("clean"))
    print_share("clean: a law",
                study("clean", worlds, journal, [](int number) { return of_case("clean", number); }),
                &WorldOutcome::has_law, nullptr, "<= 1 %");
  return 0;
}
